"""Simulation helped by CADET: the quasi-linear system as a control variate for the paths of the nonlinear one.

The simulation itself knows nothing of describing functions. Here the compiled moment equations are turned into the
numbers that it asks for, a `Twin`: along the run f(x, t) is replaced by N x + g with N = E[df/dx] and
g = E[f] - N m, m and P being the moments that `propagate` finds.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.compiled import CompiledModel
from cadet_sym.compiled import compile as compile_model
from cadet_sym.errors import ModelError
from cadet_sym.language.model import Model
from cadet_sym.simulation import Ensemble, simulate
from cadet_sym.simulation.arguments import output_times
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.twin import Twin

__all__ = ["controlled_simulation", "twin_of"]

Array = npt.NDArray[np.float64]

POINTS = 2000  # of the moments between which gains are interpolated, over a run
RTOL = 1e-8  # of these moments
EDGE = 1e-9  # of a stretch: how far inside it speed and ground are taken at its ends


def controlled_simulation(model: Model | CompiledModel, paths: Any = 2000, **options: Any) -> Ensemble:
    """Simulate with the quasi-linear system as control variate: the true moments, with limits, from fewer paths.

    Parameters
    ----------
    model : a model, or a compiled one.
    paths, options : as for `simulate`; `paths="auto"` simulates until the limits are within `target`.

    Returns
    -------
    Ensemble : `saved("variance")` tells how many times more paths plain simulation would have needed.

    Raises
    ------
    ModelError, LinearisationError, SolverError : as `compile`, `propagate` and `simulate` do.
    """
    compiled = model if isinstance(model, CompiledModel) else compile_model(model)
    if compiled.model.initial.whole:
        raise ModelError(
            '[initial] whole = "stationary": the paths are run in before t = 0, where the quasi-linear system is no '
            "control variate; start from numbers and let the run itself settle"
        )
    times = output_times(compiled.model, options.pop("times", None))
    return simulate(compiled.model, paths, times=times, twin=twin_of(compiled, times), **options)


def twin_of(compiled: CompiledModel, times: Array) -> Twin:
    """The quasi-linear system of a compiled model along its run, as numbers.

    Parameters
    ----------
    times : (k,) output times of the simulation.
    """
    linearised = _Linearised(compiled, times)
    history, at = linearised.history, np.searchsorted(linearised.history.time, times)
    return Twin(linearised, history.state_mean[at], history.state_covariance[at])


class _Linearised:
    """Times -> N and g of the vehicle's rates, interpolated between `POINTS` of a run, stretch by stretch."""

    def __init__(self, compiled: CompiledModel, times: Array):
        from scipy.interpolate import CubicSpline

        end, self.compiled, self.p = float(times[-1]), compiled, compiled.parameter_vector()
        system = compiled.equations.quasi_linear.system
        self.vehicle, self.states = system.vehicle_size, len(system.states)
        self.motion = Problem(system, times).motion
        self.edges = np.unique([0.0, *compiled.breakpoints(self.p, end), end])
        stretches = [np.linspace(a, b, max(8, int(POINTS * (b - a) / end))) for a, b in pairwise(self.edges)]
        self.history = compiled.propagate(np.unique(np.concatenate([*stretches, times])), rtol=RTOL)
        self.splines = [CubicSpline(part, self._gains(part)) for part in stretches]

    def __call__(self, time: Array) -> tuple[Array, Array]:
        """N (k, nv, n) and g (k, nv)."""
        which = np.clip(np.searchsorted(self.edges, time, side="right") - 1, 0, len(self.splines) - 1)
        found = np.empty((len(time), self.vehicle, self.states + 1))
        for k, spline in enumerate(self.splines):
            found[which == k] = spline(time[which == k])
        return found[:, :, :-1], found[:, :, -1]

    def _gains(self, stretch: Array) -> Array:
        """(k, nv, n + 1): N and g at times of one stretch, its ends taken just inside it."""
        packing, at = self.compiled.equations.packing, np.searchsorted(self.history.time, stretch)
        mean, covariance = self.history.state_mean[at], self.history.state_covariance[at]
        y = np.stack([packing.pack(m, P) for m, P in zip(mean, covariance, strict=True)], axis=1)
        inset = EDGE * (stretch[-1] - stretch[0])
        time = np.clip(stretch, stretch[0] + inset, stretch[-1] - inset)
        ctx = np.stack([time, self.motion.distance(time), self.motion.speed(time), self.motion.rate(time)])
        p = np.repeat(self.p[:, None], len(time), axis=1)
        N, rate = (part.full() for part in self._function().map(len(time))(y, ctx, p))
        N = N.reshape(self.vehicle, len(time), self.states).transpose(1, 0, 2)
        return np.concatenate([N, (rate.T - np.einsum("kab,kb->ka", N, mean))[:, :, None]], axis=2)

    def _function(self) -> ca.Function:
        # In SX symbols the parts that are not asked for, nearly all of the covariance, drop out.
        functions, packing, nv = self.compiled.functions, self.compiled.equations.packing, self.vehicle
        y, ctx, p = ca.SX.sym("y", packing.moments), ca.SX.sym("ctx", 4), ca.SX.sym("p", len(self.p))
        place = ctx[1] if packing.distance else ca.SX(0, 1)
        rate = functions.rate(ctx[0], ca.vertcat(y, place, ca.SX.zeros(packing.ground)), p)
        N = functions.gain_matrix(y, ctx, p)
        return ca.Function("linearised", [y, ctx, p], [ca.densify(N[:nv, :]), ca.densify(rate[:nv])])
