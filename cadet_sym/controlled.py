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
from cadet_sym.simulate import Ensemble, simulate
from cadet_sym.simulate.arguments import output_times
from cadet_sym.simulate.plan import Problem
from cadet_sym.simulate.twin import Twin

__all__ = ["controlled_simulation", "twin_of"]

Array = npt.NDArray[np.float64]

POINTS = 2000  # of the moments between which gains are interpolated, over a run
RTOL = 1e-10  # of these moments


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
    history = compiled.propagate(times, rtol=RTOL)
    return Twin(_Linearised(compiled, float(times[-1])), history.state_mean, history.state_covariance)


class _Linearised:
    """Times -> N and g of the vehicle's rates, from moments interpolated between `POINTS` of a run."""

    def __init__(self, compiled: CompiledModel, end: float):
        from scipy.interpolate import CubicSpline

        self.compiled, self.p = compiled, compiled.parameter_vector()
        system = compiled.equations.quasi_linear.system
        self.vehicle, self.states = system.vehicle_size, len(system.states)
        self.motion = Problem(system, np.array([end])).motion
        self.edges = np.unique([0.0, *compiled.breakpoints(self.p, end), end])
        stretches = [np.linspace(a, b, max(8, int(POINTS * (b - a) / end))) for a, b in pairwise(self.edges)]
        dense = compiled.propagate(np.unique(np.concatenate(stretches)), rtol=RTOL)
        packing = compiled.equations.packing
        y = np.stack([packing.pack(m, P) for m, P in zip(dense.state_mean, dense.state_covariance, strict=True)])
        self.splines = [CubicSpline(part, y[np.searchsorted(dense.time, part)]) for part in stretches]
        self.function = self._function()

    def __call__(self, time: Array) -> tuple[Array, Array]:
        """N (k, nv, n) and g (k, nv)."""
        packing, count = self.compiled.equations.packing, len(time)
        y = np.zeros((packing.size, count))
        which = np.clip(np.searchsorted(self.edges, time, side="right") - 1, 0, len(self.splines) - 1)
        for k, spline in enumerate(self.splines):
            y[: packing.moments, which == k] = spline(time[which == k]).T
        place = self.motion.distance(time)
        if packing.distance:
            y[packing.moments] = place
        ctx = np.stack([time, place, self.motion.speed(time), self.motion.rate(time)])
        p = np.repeat(self.p[:, None], count, axis=1)
        N, rate = (np.asarray(part) for part in self.function.map(count)(y, ctx, p))
        N = N.reshape(self.vehicle, count, self.states).transpose(1, 0, 2)
        return N, rate.T - np.einsum("kab,kb->ka", N, y[: self.states].T)

    def _function(self) -> ca.Function:
        functions, packing, nv = self.compiled.functions, self.compiled.equations.packing, self.vehicle
        y, ctx, p = ca.MX.sym("y", packing.size), ca.MX.sym("ctx", 4), ca.MX.sym("p", len(self.p))
        N = functions.gain_matrix(y[: packing.moments], ctx, p)
        rate = functions.rate(ctx[0], y, p)
        return ca.Function("linearised", [y, ctx, p], [ca.densify(N[:nv, :]), ca.densify(rate[:nv])])
