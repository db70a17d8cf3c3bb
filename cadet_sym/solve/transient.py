"""Integrate the moment equations over a run: y' = rate(t, y, p) from y(0), at the times asked for.

The run is cut at every known breakpoint (a kink of the speed, an edge of the profile, a wheel that meets the
ground) and restarted there, for no integrator sees an input that is shorter than its step. Every moment is
integrated in units of its own size, so that one tolerance means the same for a displacement in metres and a
force in newtons: |error| <= rtol (|y| + 1e-4 size) a step.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError, SolverError
from cadet_sym.lowering.system import LoweredSystem
from cadet_sym.moments import Packing

__all__ = ["Trajectory", "check_times", "integrate"]

Array = npt.NDArray[np.float64]

SAFETY = 0.1
"""The integrator's tolerance over what is asked for: errors of single steps add up over a run."""

ABSOLUTE = 1e-4
"""Absolute over relative tolerance, in units of each moment's own size."""


@dataclass(frozen=True)
class Trajectory:
    """Packed moments at the times asked for, and how they were integrated."""

    time: Array  # (k,)
    y: Array  # (k, size)
    engine: str
    rtol: float
    statistics: Mapping[str, float] = field(default_factory=dict)


def integrate(
    lowered: LoweredSystem,
    start: Array,
    p: Array,
    times: Array,
    *,
    rtol: float = 1e-8,
    breakpoints: Sequence[float] = (),
) -> Trajectory:
    """Integrate the packed moments from `start` at t = 0 to the `times` (increasing, from 0 on).

    Raises
    ------
    SolverError
        If the integration fails or overflows: says at what time, for which state, and what was reached.
    """
    times = check_times(times)
    if not (np.isfinite(rtol) and 1e-13 <= rtol <= 0.1):
        raise ModelError(f"rtol is {rtol!r}; it must lie between 1e-13 and 0.1.")
    began = time.perf_counter()
    size = _sizes(lowered, start, p, times, breakpoints)
    y, counts = _march(lowered, start, p, times, breakpoints, size, SAFETY * rtol)
    reached = _peaks(y, lowered.equations.packing)
    if np.any(reached > 100 * size):  # the rough run missed how large something grows
        size = np.maximum(size, reached)
        y, counts = _march(lowered, start, p, times, breakpoints, size, SAFETY * rtol)
    statistics = {**counts, "seconds": time.perf_counter() - began}
    return Trajectory(times, y, "CVODES (BDF, direct)", rtol, statistics)


def check_times(times: npt.ArrayLike) -> Array:
    """The times as an increasing array from zero on."""
    grid = np.atleast_1d(np.asarray(times, dtype=float))
    if grid.ndim != 1 or grid.size == 0 or not np.all(np.isfinite(grid)):
        raise ModelError("times must be a non-empty sequence of finite numbers.")
    if np.any(np.diff(grid) <= 0):
        row = int(np.argmax(np.diff(grid) <= 0))
        raise ModelError(f"times must increase, but {grid[row + 1]:g} follows {grid[row]:g}.")
    if grid[0] < 0:
        raise ModelError(f"times begin at {grid[0]:g}; the run begins at 0.")
    return grid


def _sizes(
    lowered: LoweredSystem, start: Array, p: Array, times: Array, breakpoints: Sequence[float]
) -> Array:
    """How large every moment becomes, from a rough run with tolerances far below anything's size."""
    packing = lowered.equations.packing
    grid = np.unique(np.concatenate([times, np.linspace(0, times[-1], 33)[1:]]))
    slopes = np.hstack([np.asarray(lowered.rate(t, start, p)) for t in (0.0, times[-1] / 2, times[-1])])
    largest = np.abs(start).max() + np.abs(np.nan_to_num(slopes)).max() * max(times[-1], 1e-300)
    small = np.sqrt(largest) if largest > 0 else 1.0
    failure = SolverError("")
    for fraction in (1e-8, 1e-5, 1e-2):
        try:
            sizes = np.full(packing.size, fraction * small)
            y, _ = _march(lowered, start, p, grid, breakpoints, sizes, 1e-2)
        except SolverError as error:
            failure = error
        else:
            return _peaks(np.vstack([start, y]), packing)
    raise failure


def _peaks(y: Array, packing: Packing) -> Array:
    """Largest size of every moment over a run: standard deviations and their products for the covariances."""
    rows, columns = packing.triangle
    n = packing.n
    diagonal = n + np.flatnonzero(rows == columns)
    deviation = np.sqrt(np.abs(y[:, diagonal]).max(axis=0))
    deviation = np.where(deviation > 0, deviation, np.max(deviation, initial=0.0) * 1e-3)
    deviation = np.where(deviation > 0, deviation, 1.0)
    mean = np.maximum(np.abs(y[:, :n]).max(axis=0), deviation)
    alongside = np.abs(y[:, packing.moments :])
    alongside = np.maximum(alongside.max(axis=0, initial=0.0), 1e-3 * alongside.max(initial=0.0))
    alongside = np.where(alongside > 0, alongside, 1.0)
    return np.concatenate([mean, deviation[rows] * deviation[columns], alongside])


def _march(
    lowered: LoweredSystem,
    start: Array,
    p: Array,
    times: Array,
    breakpoints: Sequence[float],
    size: Array,
    rtol: float,
) -> tuple[Array, dict[str, float]]:
    """Integrate stretch by stretch; returns the moments at the times, and counts of work."""
    edges = [0.0, *sorted(b for b in set(breakpoints) if 0 < b < times[-1]), float(times[-1])]
    y, found, counts = start, [], {"steps": 0.0, "stretches": 0.0}
    if times[0] == 0:
        found.append(start)
    for begin, end in itertools.pairwise(edges):
        if end <= begin:
            continue
        asked = times[(times > begin) & (times <= end)]
        grid = asked if asked.size and asked[-1] == end else np.append(asked, end)
        stretch = _stretch(lowered, y, p, begin, grid, size, rtol)
        counts["steps"] += stretch[1]
        counts["stretches"] += 1
        found.extend(stretch[0][: asked.size])
        y = stretch[0][-1]
    return np.array(found), counts


def _stretch(
    lowered: LoweredSystem, y: Array, p: Array, begin: float, grid: Array, size: Array, rtol: float
) -> tuple[Array, float]:
    integrator = _integrator(lowered, tuple(grid - begin), rtol)
    inputs = ca.vertcat(ca.DM(p), ca.DM(size), begin)
    try:
        result = integrator(x0=ca.DM(y / size), p=inputs)["xf"]
    except RuntimeError as error:
        raise _failure(lowered, y, p, begin, float(grid[-1]), str(error)) from None
    values = np.asarray(result).T * size
    if not np.all(np.isfinite(values)):
        raise _failure(lowered, y, p, begin, float(grid[-1]), "the result is not finite")
    return values, float(integrator.stats().get("nsteps", 0))


@lru_cache(maxsize=64)
def _integrator(lowered: LoweredSystem, grid: tuple[float, ...], rtol: float) -> ca.Function:
    """CVODES over one stretch, time counted from its beginning, every moment in units of its size."""
    n = lowered.equations.packing.size
    t, x = ca.SX.sym("t"), ca.SX.sym("x", n)
    p = ca.SX.sym("p", len(lowered.parameters) + n + 1)
    count = len(lowered.parameters)
    size, begin = p[count : count + n], p[count + n]
    ode = lowered.rate(begin + t, size * x, p[:count]) / size
    options = {
        "reltol": rtol,
        "abstol": ABSOLUTE * rtol,
        "max_num_steps": 1_000_000,
        "show_eval_warnings": False,
        "disable_internal_warnings": True,
    }
    dae = {"x": x, "p": p, "t": t, "ode": ode}
    return ca.integrator("run", "cvodes", dae, 0.0, list(grid), options)


def _failure(
    lowered: LoweredSystem, y: Array, p: Array, begin: float, end: float, reason: str
) -> SolverError:
    """Say where a stretch breaks down: bisect for the last time that is reached."""
    names = lowered.equations.states
    rate = np.asarray(lowered.rate(begin, y, p)).ravel()
    if not np.all(np.isfinite(rate)):
        bad = int(np.flatnonzero(~np.isfinite(rate))[0])
        return SolverError(
            f"the moment equations are not finite at t = {begin:g} ({_moment(bad, lowered)}); "
            "check the parameters and the initial state."
        )
    size = np.maximum(np.abs(y), 1e-12)
    reached, far, last = begin, end, y
    for _ in range(12):
        middle = (reached + far) / 2
        try:
            trial = np.asarray(
                _integrator(lowered, (middle - reached,), 1e-4)(
                    x0=ca.DM(last / size), p=ca.vertcat(ca.DM(p), ca.DM(size), reached)
                )["xf"]
            ).ravel()
            good = bool(np.all(np.isfinite(trial)))
        except RuntimeError:
            good = False
        if good:
            reached, last = middle, trial * size
        else:
            far = middle
    n = lowered.equations.packing.n
    _, covariance = lowered.equations.packing.unpack(last)
    worst = int(np.argmax(np.abs(np.diag(covariance))))
    return SolverError(
        f"the integration breaks down near t = {reached:.6g}: the variance of `{names[worst]}` is "
        f"{covariance[worst, worst]:.3g} there and grows (mean {last[:n][worst]:.3g}). {reason.splitlines()[0][:160]}"
    )


def _moment(index: int, lowered: LoweredSystem) -> str:
    """What an entry of the packed moments is, in words."""
    packing, names = lowered.equations.packing, lowered.equations.states
    if index < packing.n:
        return f"the mean of `{names[index]}`"
    if index < packing.moments:
        rows, columns = packing.triangle
        k = index - packing.n
        return f"the covariance of `{names[rows[k]]}` and `{names[columns[k]]}`"
    return "the ground between the wheels"
