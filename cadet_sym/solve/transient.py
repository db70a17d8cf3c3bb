"""Integrate the moment equations over a run: y' = rate(t, y, p) from y(0), at the times asked for.

A rough run says how large every moment becomes (`rough`), that and the eigenvalues of N which engine suits (`choice`), and the
engine is led through the run from breakpoint to breakpoint (`course`). A step's error is held under local (|y| + size / 100).
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from weakref import ref

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.packing import Packing
from cadet_sym.solve.choice import choose, compiles, modes
from cadet_sym.solve.course import ENGINES, Engine, Start, Trajectory, edges, march, march_ahead
from cadet_sym.solve.definite import lost, warn_of_loss
from cadet_sym.solve.rough import ABSOLUTE, Outline, outline
from cadet_sym.solve.scales import Tolerance, fits, peaks
from cadet_sym.solve.sound import is_sound
from cadet_sym.solve.stiff import MANY_STATES

__all__ = ["ENGINES", "Start", "Trajectory", "check_times", "integrate", "integrate_ahead"]

Array = npt.NDArray[np.float64]

DIFFERENT = 1e-5
"""Of a moment's size: what a doubtful run may differ by from one at a hundredth of the tolerance."""

BETWEEN = 100.0
"""How much more the correlation with the ground between two wheels may err: it is smoothed on its way to the wheel behind."""


AHEAD = 4_000_000
"""Numbers that runs begun together may hold: where each of them takes long, nothing is gained."""


def integrate(
    lowered: MomentFunctions,
    start: Start,
    grid: Array,
    *,
    rtol: float = 1e-8,
    engine: str = "auto",
    declared: Callable[[], Start] | None = None,
) -> Trajectory:
    """Integrate the packed moments from the start to the times of the grid.

    Parameters
    ----------
    grid : increasing, from 0 on (see `check_times`).
    engine : "auto", or "direct" (CasADi's CVODES), "implicit" or "krylov" (BDF with the Lyapunov inverse, by itself
        or as the preconditioner of GMRES), "explicit" (Adams, CasADi's CVODES), "stepping" (the same, restarted at no
        cost), "native" (explicit Runge-Kutta formulas in machine code, where LLVM is there), "stiff" (BDF in machine code).
    declared : the start at the model's own parameters. The sizes found there serve for other values unless they turn
        out not to suit: repeated runs find them once, and no result depends on what ran before.

    Raises
    ------
    SolverError
        If the integration fails or overflows: says at what time, for which state, and what was reached; `partial` is
        the Trajectory up to there.
    """
    if not 1e-13 <= rtol <= 0.1:
        raise ModelError(f"rtol is {rtol!r}; it must lie between 1e-13 and 0.1.")
    if engine not in ENGINES:
        raise ModelError(f"`{engine}` is not an engine; those are: {', '.join(ENGINES)}.")
    if engine in ("native", "stiff") and not compiles(lowered, start, engine):
        raise ModelError(
            f'engine "{engine}": there is no machine code of it for this model. That needs LLVM, for wheels that follow each '
            f"other on many elements `jit=True`, and \"stiff\" at most {MANY_STATES} states and no such wheels; leave "
            "`engine` out."
        )
    began = time.perf_counter()
    packing, plan = lowered.facts.packing, _plan(lowered, start, grid, engine, declared)
    kind, size = plan.kind, plan.size
    tolerance = _tolerance(rtol, size, packing, kind)
    y, used, doubtful = march(lowered, start, grid, kind, tolerance, rtol, plan.ahead.pop((rtol, grid.tobytes()), None))
    sound = is_sound(y, packing, size)
    if not sound and not fits(size, y, packing):
        size = peaks(np.vstack([start.y, y]), packing)
        y, used, doubtful = march(lowered, start, grid, kind, _tolerance(rtol, size, packing, kind), rtol)
    if not sound and lost(y, packing).any():
        y, used, doubtful = march(lowered, start, grid, kind, _tolerance(rtol * 1e-3, size, packing, kind), rtol)
        warn_of_loss(grid, y, packing, lowered.facts.states)
    if doubtful:
        again = march(lowered, start, grid, kind, _tolerance(rtol * 1e-2, size, packing, kind), rtol)
        _compare(y, again.y, size, rtol)
        y, used = again.y, again.engine
    statistics = {"steps": float(used.steps), "stretches": len(edges(start, grid)) - 1.0}
    return Trajectory(grid, y, used.name, rtol, statistics | {"seconds": time.perf_counter() - began})


def _compare(y: Array, again: Array, size: Array, rtol: float) -> None:
    """Warn where a run whose gains had no bound at the start is another at a hundredth of the tolerance."""
    change = float((np.abs(again - y) / size).max(initial=0.0))
    if not change <= max(DIFFERENT, 100 * rtol):
        warnings.warn(
            "friction holds the system where the run sets out, and its gain there says nothing of the gain later: at a "
            f"hundredth of the tolerance the moments differ by {change:.1g} of their size, and may do so again. Ask for a "
            'smaller rtol, or start with a little variance; engine="native" takes no gains, only rates.',
            RuntimeWarning,
            stacklevel=4,
        )


def check_times(times: npt.ArrayLike) -> Array:
    """The times as an increasing array from zero on."""
    grid = np.atleast_1d(np.asarray(times, dtype=float))
    if grid.ndim == 1 and grid.size and grid[0] >= 0 and grid[-1] < np.inf and (grid[1:] > grid[:-1]).all():
        return grid
    if grid.ndim != 1 or grid.size == 0 or not np.all(np.isfinite(grid)):
        raise ModelError("times must be a non-empty sequence of finite numbers.")
    if np.any(np.diff(grid) <= 0):
        row = int(np.argmax(np.diff(grid) <= 0))
        raise ModelError(f"times must increase, but {grid[row + 1]:g} follows {grid[row]:g}.")
    raise ModelError(f"times begin at {grid[0]:g}; the run begins at 0.")


@dataclass(frozen=True)
class _Plan:
    """What is settled before a run is integrated."""

    kind: str  # of engine
    size: Array  # of every moment
    ahead: dict[tuple[float, bytes], Engine] = field(default_factory=dict)  # by tolerance and times: what began already


_plans: Memory[_Plan] = Memory()


def _plan(
    lowered: MomentFunctions, start: Start, grid: Array, engine: str, declared: Callable[[], Start] | None
) -> _Plan:
    """The plan of a run, remembered for the next of the same."""

    def make() -> _Plan:
        known = outline(lowered, start, float(grid[-1]), declared)
        return _planned(lowered, [start], grid, engine, known)[0]

    return _plans(start, _key(lowered, grid, engine, declared is None), make)


def _key(lowered: MomentFunctions, grid: Array, engine: str, alone: bool) -> Hashable:
    return ref(lowered), lowered.jit, float(grid[-1]), engine, alone


def _planned(lowered: MomentFunctions, starts: Sequence[Start], grid: Array, engine: str, known: Outline) -> list[_Plan]:
    """The plans of runs that differ in their parameters."""
    kinds = [engine] * len(starts)
    if engine == "auto":
        found = modes(lowered, np.array([start.p for start in starts]), float(grid[-1]), known.along)
        kinds = [choose(lowered, start, grid, each) for start, each in zip(starts, found, strict=True)]
    return [_Plan(kind, known.size) for kind in kinds]


def integrate_ahead(
    lowered: MomentFunctions,
    starts: Sequence[Start],
    grid: Array,
    *,
    rtol: float,
    engine: str,
    declared: Callable[[], Start],
) -> None:
    """Begin many runs that are to come, all at once, which takes less time; see `integrate`."""
    key = _key(lowered, grid, engine, alone=False)
    new = [start for start in starts if not _plans.knows(start, key)]
    if new:
        known = outline(lowered, starts[0], float(grid[-1]), declared)
        for start, each in zip(new, _planned(lowered, new, grid, engine, known), strict=True):
            _plans.keep(start, key, each)
    if len(starts) * len(grid) * lowered.facts.packing.size > AHEAD:
        return
    plans = [(start, _plan(lowered, start, grid, engine, declared)) for start in starts]
    native = [(start, each) for start, each in plans if each.kind == "native" and grid[-1] > 0]
    tolerances = [_tolerance(rtol, each.size, lowered.facts.packing, each.kind) for _, each in native]
    begun = march_ahead(lowered, [start for start, _ in native], grid, tolerances)
    for (_, each), run in zip(native, begun, strict=True):
        each.ahead[rtol, grid.tobytes()] = run


def _tolerance(rtol: float, size: Array, packing: Packing, kind: str) -> Tolerance:
    """What a step may err by: errors add up, the more steps the more, and small values matter the more."""
    tight = min(1.0, max(rtol, 1e-13) / 1e-6)
    weighed = size
    if packing.ground:
        weighed = size.copy()
        weighed[len(size) - packing.ground :] *= BETWEEN
    if kind == "native":  # the errors of its order hardly add up
        return Tolerance(max(rtol, 1e-13), tight**0.5 * ABSOLUTE, weighed)
    return Tolerance(max(tight**0.75 * rtol, 2e-14), tight**0.5 * ABSOLUTE, weighed)
