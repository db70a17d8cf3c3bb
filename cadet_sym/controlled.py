"""Simulation helped by CADET: the quasi-linear system as a control variate for the paths of the nonlinear one.

The simulation itself knows nothing of describing functions. Here the compiled moment equations are turned into the
numbers that it asks for, a `Twin`: along the run f(x, t) is replaced by N x + g with N = E[df/dx] and
g = E[f] - N m, m and P being the moments that `propagate` finds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import pairwise
from time import perf_counter
from typing import Any, Literal, TypedDict, Unpack

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.augmentation import AugmentedSystem, augment
from cadet_sym.compiled import CompiledModel
from cadet_sym.compiled import compile as compile_model
from cadet_sym.errors import CadetError, ModelError
from cadet_sym.language.model import Model
from cadet_sym.simulation import Ensemble
from cadet_sym.simulation import simulate as simulate_plainly
from cadet_sym.simulation.arguments import CHECKED, check_numbers, output_times
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.twin import Twin
from cadet_sym.solve.many import Start
from cadet_sym.solve.transient import integrate

__all__ = ["Options", "simulate", "twin_of"]

Array = npt.NDArray[np.float64]

POINTS = 2000  # of the moments between which gains are interpolated, over a run
RTOL = 1e-8  # of these moments
EDGE = 1e-9  # of a stretch: how far inside it speed and ground are taken at its ends
FIRST, GROWTH = 1e-8, 1.2  # of a stretch: where its first moments are taken, and by what the next are farther from its start


class Options(TypedDict, total=False):
    """What `simulate` takes besides a model, the number of paths and `control`."""

    seed: int
    times: Sequence[float] | Array | None
    step: float | None
    level: float
    keep: int
    run_in: float | None
    check_step: bool
    target: float
    watch: Sequence[str] | None
    time_limit: float | None
    levels: Mapping[str, Sequence[float]] | None
    histograms: Mapping[str, int | Sequence[float] | Array] | None
    average_from: float | None
    scheme: str | None
    engine: str | None
    threads: int | None
    executor: Executor | None
    progress: bool | Callable[[int], Any]


def simulate(
    model: Model | AugmentedSystem | CompiledModel,
    paths: int | Literal["auto"] = 2000,
    *,
    control: bool | None = None,
    **options: Unpack[Options],
) -> Ensemble:
    """Simulate the original nonlinear model: its true moments, with limits, from as few paths as can be.

    The quasi-linear system rides along with every path on the same noise. Its moments are known, so that what chance
    does to it tells what chance does to the path (control variates; see `simulation.control`). The moments stay those
    of the original model, with standard errors from independent batches of paths.

    Parameters
    ----------
    model : a model, its augmented system, or the compiled model.
    paths : realisations, or "auto": as many as `target` asks for.
    control : True, use the quasi-linear system; False, simulate plainly; None, use it if it can be had and a pilot
        sample shows that it saves more than it costs. `Ensemble.method` says what was done and what it saved.
    options : as the engine takes them,

        seed : a whole number, not negative; the same seed gives the same paths.
        times : (k,) output times; the model's own run if not given.
        step : longest time step; if not given, one whose measured error is below half of the sampling error.
        level : probability of the limits, 0.99.
        keep : paths to be kept as they are, for plots, 20.
        target, watch, time_limit : with `paths="auto"`, the half-width wanted of the limits of a variance over the
            variance and of a mean over the standard deviation, 0.01; of which states and outputs; seconds there are.
        levels, histograms, average_from : up-crossings, distributions and averages over time.
        executor, threads : where groups of paths are worked out; results do not depend on it.
        run_in, check_step, scheme, engine, progress : see `simulation.engine.simulate`.

    Returns
    -------
    Ensemble : `mean`, `variance`, their `limit`, `method`; `plain_paths(name)` is what plain simulation would need.

    Raises
    ------
    ModelError : an argument or the model is wrong; with `control=True` also a model of which there is no twin.
    SolverError : every path diverged, or the target was not reached in the time there was; `partial` holds the
        ensemble so far.
    """
    system = augment(model.model) if isinstance(model, CompiledModel) else model
    check_numbers(paths=None if paths == "auto" else paths, **{k: v for k, v in options.items() if k in CHECKED})
    if control is False:
        return simulate_plainly(system, paths, **options)
    declared = system.model if isinstance(system, AugmentedSystem) else system
    options["times"] = times = output_times(declared, options.get("times"))
    began = perf_counter()
    try:
        if declared.initial.whole:
            raise ModelError(NO_TWIN)
        twin = twin_of(model if isinstance(model, CompiledModel) else compile_model(declared), times)
    except CadetError as error:
        if control:
            raise
        ensemble = simulate_plainly(system, paths, **options)
        return replace(ensemble, notes=(*ensemble.notes, f"Simulated without the quasi-linear system: {error}"))
    seconds = {"quasi-linear system": perf_counter() - began}
    ensemble = simulate_plainly(system, paths, twin=twin, insist=bool(control), **options)
    return replace(ensemble, seconds={**seconds, **ensemble.seconds})


NO_TWIN = (
    '[initial] whole = "stationary": the paths are run in before t = 0, where the quasi-linear system is no control '
    "variate; start from numbers and let the run itself settle"
)


def twin_of(compiled: CompiledModel, times: Array) -> Twin:
    """The quasi-linear system of a compiled model along its run, as numbers.

    Parameters
    ----------
    times : (k,) output times of the simulation.
    """
    linearised = _Linearised(compiled, times)
    return Twin(linearised, *compiled.packing.unpack(linearised.at(times)))


def _knots(start: float, end: float, count: int) -> Array:
    """Times between which gains are interpolated: even, and ever closer to the start.

    Where a jump meets no variance, as friction does at rest, its gain grows like 1/sqrt(t - start) towards it.
    """
    even = np.linspace(0.0, 1.0, count)[1:]
    close = FIRST * GROWTH ** np.arange(math.log(even[0] / FIRST) / math.log(GROWTH))
    return start + (end - start) * np.concatenate([close[close < 0.9 * even[0]], even])


class _Linearised:
    """Times -> N and g of the vehicle's rates, interpolated between `POINTS` of a run, stretch by stretch."""

    def __init__(self, compiled: CompiledModel, times: Array):
        from scipy.interpolate import CubicSpline

        end, self.compiled, self.p = float(times[-1]), compiled, compiled.parameter_vector()
        system = augment(compiled.model)  # its moment equations may come from the cache, without their symbols
        self.vehicle, self.states = system.vehicle_size, len(system.states)
        self.motion = Problem(system, times).motion
        breakpoints = compiled.breakpoints(self.p, end)
        self.edges = np.unique([0.0, *breakpoints, end])
        stretches = [_knots(a, b, max(8, int(POINTS * (b - a) / end))) for a, b in pairwise(self.edges)]
        begin = Start(compiled.initial(), self.p, breakpoints)
        self.run = integrate(compiled.functions, begin, np.unique(np.concatenate([*stretches, times])), rtol=RTOL)
        self.splines = [CubicSpline(part, self._gains(part)) for part in stretches]

    def __call__(self, time: Array) -> tuple[Array, Array]:
        """N (k, nv, n) and g (k, nv)."""
        which = np.clip(np.searchsorted(self.edges, time, side="right") - 1, 0, len(self.splines) - 1)
        found = np.empty((len(time), self.vehicle, self.states + 1))
        for k, spline in enumerate(self.splines):
            found[which == k] = spline(np.clip(time[which == k], spline.x[0], spline.x[-1]))
        return found[:, :, :-1], found[:, :, -1]

    def at(self, times: Array) -> Array:
        """Packed moments (k, size) at some of the times of the run."""
        return self.run.y[np.searchsorted(self.run.time, times), : self.compiled.packing.moments]

    def _gains(self, stretch: Array) -> Array:
        """(k, nv, n + 1): N and g at times of one stretch, its ends taken just inside it."""
        y = self.at(stretch)
        mean = y[:, : self.states]
        time = np.minimum(stretch, stretch[-1] - EDGE * (stretch[-1] - stretch[0]))
        ctx = np.stack([time, self.motion.distance(time), self.motion.speed(time), self.motion.rate(time)])
        p = np.repeat(self.p[:, None], len(time), axis=1)
        N, rate = (part.full() for part in self._function().map(len(time))(y.T, ctx, p))
        N = N.reshape(self.vehicle, len(time), self.states).transpose(1, 0, 2)
        return np.concatenate([N, (rate.T - np.einsum("kab,kb->ka", N, mean))[:, :, None]], axis=2)

    def _function(self) -> ca.Function:
        # In SX symbols the parts that are not asked for, nearly all of the covariance, drop out.
        functions, packing, nv = self.compiled.functions, self.compiled.packing, self.vehicle
        y, ctx, p = ca.SX.sym("y", packing.moments), ca.SX.sym("ctx", 4), ca.SX.sym("p", len(self.p))
        place = ctx[1] if packing.distance else ca.SX(0, 1)
        rate = functions.rate(ctx[0], ca.vertcat(y, place, ca.SX.zeros(packing.ground)), p)
        N = functions.gain_matrix(y, ctx, p)
        return ca.Function("linearised", [y, ctx, p], [ca.densify(N[:nv, :]), ca.densify(rate[:nv])])
