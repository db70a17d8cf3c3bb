"""Integrate the moment equations over a run: y' = rate(t, y, p) from y(0), at the times asked for.

A rough run says how large every moment becomes (`rough`), that and the eigenvalues of N which engine suits (`choice`), and the
engine is led through the run from breakpoint to breakpoint (`course`). A step's error is held under local (|y| + size / 100).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple
from weakref import ref

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError, SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.packing import Packing
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.choice import QUICK, choose, compiles, modes, rings
from cadet_sym.solve.course import ENGINES, March, edges, march
from cadet_sym.solve.definite import lost, warn_of_loss
from cadet_sym.solve.many import Start, Starts, Trajectories, Trajectory
from cadet_sym.solve.native import march_all, method
from cadet_sym.solve.rough import ABSOLUTE, outline
from cadet_sym.solve.scales import STEPS, Tolerance, fits, most_steps, peaks
from cadet_sym.solve.shares import ALONE, Team, Then, Which, among, nothing
from cadet_sym.solve.sound import are_sound
from cadet_sym.solve.stiff import MANY_STATES
from cadet_sym.warning import warn

__all__ = ["ENGINES", "check_times", "engine_for", "integrate", "integrate_all"]

Array = npt.NDArray[np.float64]

DIFFERENT = 1e-5
"""Of a moment's size: what a doubtful run may differ by from one at a hundredth of the tolerance."""

BETWEEN = 100.0
"""How much more the correlation with the ground between two wheels may err: it is smoothed on its way to the wheel behind."""


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
    return integrate_all(lowered, start.alone, grid, rtol=rtol, engine=engine, declared=declared)[0]


def integrate_all(
    lowered: MomentFunctions,
    starts: Starts,
    grid: Array,
    *,
    rtol: float = 1e-8,
    engine: str = "auto",
    declared: Callable[[], Start] | None = None,
    team: Team = ALONE,
    then: Then = nothing,
) -> Trajectories:
    """Integrate many runs, each to the numbers of `integrate`; those of explicit machine code in one call, or one a part.

    Parameters
    ----------
    then : is called with every run, as soon as its moments are known, by the thread that has them at hand.
    """
    if not 1e-13 <= rtol <= 0.1:
        raise ModelError(f"rtol is {rtol!r}; it must lie between 1e-13 and 0.1.")
    if engine not in ENGINES:
        raise ModelError(f"`{engine}` is not an engine; those are: {', '.join(ENGINES)}.")
    if engine in ("native", "stiff") and not all(compiles(lowered, start, engine) for start in starts):
        raise ModelError(
            f'engine "{engine}": there is no machine code of it for this model. That needs LLVM, for wheels that follow each '
            f"other on many elements `jit=True`, and \"stiff\" at most {MANY_STATES} states and no such wheels; leave "
            "`engine` out."
        )
    began = time.perf_counter()
    plans = _plans(lowered, starts, grid, engine, declared)
    ways = {known: edges(known, grid) for known in set(starts.breakpoints)}
    courses = [ways[known] for known in starts.breakpoints]
    y, steps, sound = _together(lowered, starts, courses, grid, plans, rtol, team, then)
    engines, doubted = [method(lowered)] * len(starts), np.flatnonzero(~sound).tolist()

    def known(k: int) -> March | None:
        return None if np.isnan(steps[k]) else March(y[k], engines[k], int(steps[k]), doubtful=False)

    def settle(part: slice) -> list[March | SolverError | ArithmeticError]:
        runs = []
        for k in doubted[part]:
            runs.append(_settled(lowered, starts[k], grid, plans[k], rtol, known(k), y[k]))
            then(slice(k, k + 1), y[k : k + 1])
        return runs

    failures = {}
    for k, run in zip(doubted, (run for part in team.share(len(doubted), settle) for run in part), strict=True):
        if isinstance(run, March):
            engines[k], steps[k] = run.engine, run.steps
        else:
            failures[k] = run
    seconds = (time.perf_counter() - began) / max(len(starts), 1)
    stretches = np.array([len(course) - 1.0 for course in courses])
    statistics = {"steps": steps, "stretches": stretches, "seconds": np.full(len(starts), seconds)}
    return Trajectories(grid, y, engines, rtol, statistics, failures)


def _settled(
    lowered: MomentFunctions, start: Start, grid: Array, plan: _Plan, rtol: float, known: March | None, y: Array
) -> March | SolverError | ArithmeticError:
    """A run that was not found sound as it should be, with its moments written to y, or why there is none."""
    try:
        run = _judged(lowered, start, grid, plan, rtol, known)
    except (SolverError, ArithmeticError) as error:
        y.fill(np.nan)
        return error
    if run is not known:
        y[:] = run.y
    return run


def _together(
    lowered: MomentFunctions,
    starts: Starts,
    courses: Sequence[tuple[float, ...]],
    grid: Array,
    plans: Sequence[_Plan],
    rtol: float,
    team: Team,
    then: Then,
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Runs in explicit machine code, all in one call, and room for the others.

    Returns
    -------
    The packed moments (runs, k, size); the steps of every run, NaN of those that were not integrated or broke down; and
    which are sound as they are.
    """
    packing, whole = lowered.facts.packing, (len(starts), len(grid), lowered.facts.packing.size)
    native = [k for k, plan in enumerate(plans) if plan.kind == "native"]
    groups = [[k for k, plan in enumerate(plans) if plan.care == care] for care in {plan.care: None for plan in plans}]
    if len(groups) > 1 or 0 < len(native) < len(starts):  # tolerances of their own, or engines
        y, steps, sound = np.empty(whole), np.full(len(starts), np.nan), np.zeros(len(starts), dtype=bool)
        for group in groups:
            these = [k for k in group if plans[k].kind == "native"]
            own, ways = starts.of(these), [courses[k] for k in these]
            further = partial(among, np.array(these, dtype=int), then)
            found = _together(lowered, own, ways, grid, [plans[k] for k in these], rtol, team, further)
            y[these], steps[these], sound[these] = found
        return y, steps, sound
    if not native:
        return np.empty(whole), np.full(len(starts), np.nan), np.zeros(len(starts), dtype=bool)
    size = plans[0].size
    if any(plan.size is not size for plan in plans):
        size = np.array([plan.size for plan in plans])
    tolerance = _tolerance(rtol, size, packing, "native", plans[0].care)
    sound = np.zeros(len(starts), dtype=bool)

    def look(which: Which, y: Array) -> None:
        sound[which] = fine = are_sound(y, packing, size[which] if size.ndim > 1 else size)
        if fine.all():
            then(which, y)
        else:
            then(np.arange(len(starts))[which][fine], y[fine])

    runs = march_all(lowered, starts.p, starts.y, courses, grid, tolerance, team, look)
    done = runs.status == 0
    return runs.y, np.where(done, runs.steps, np.nan), done & sound


def _judged(lowered: MomentFunctions, start: Start, grid: Array, plan: _Plan, rtol: float, run: March | None) -> March:
    """A run that was not found sound: integrated by itself if it was not yet, and again where it is not what it should be."""
    packing, kind, size, sound = lowered.facts.packing, plan.kind, plan.size, False
    if run is None:
        run = march(lowered, start, grid, kind, _tolerance(rtol, size, packing, kind, plan.care), rtol)
        sound = bool(are_sound(run.y[None], packing, size)[0])
    if not sound and not fits(size, run.y, packing):
        size = peaks(np.vstack([start.y, run.y]), packing)
        run = march(lowered, start, grid, kind, _tolerance(rtol, size, packing, kind, plan.care), rtol)
    if not sound and lost(run.y, packing).any():
        run = march(lowered, start, grid, kind, _tolerance(rtol * 1e-3, size, packing, kind, plan.care), rtol)
        warn_of_loss(grid, run.y, packing, lowered.facts.states)
    if run.doubtful:
        again = _again(lowered, start, grid, kind, _tolerance(rtol * 1e-2, size, packing, kind, plan.care))
        _compare(run.y, again.y if again else None, size, rtol)
        run = again or run
    return run


def _again(lowered: MomentFunctions, start: Start, grid: Array, kind: str, tolerance: Tolerance) -> March | None:
    """Another run, if it comes to its end."""
    try:
        return march(lowered, start, grid, kind, tolerance)
    except Breakdown:
        return None


def _compare(y: Array, again: Array | None, size: Array, rtol: float) -> None:
    """Warn where a run whose gains had no bound at the start is another at a hundredth of the tolerance."""
    change = np.inf if again is None else float((np.abs(again - y) / size).max(initial=0.0))
    if not change <= max(DIFFERENT, 100 * rtol):
        found = "there is no run to hold it against" if again is None else f"the moments differ by {change:.1g} of their size"
        text = (
            "friction holds the system where the run sets out, and its gain there says nothing of the gain later: at a "
            f"hundredth of the tolerance {found}. Ask for a "
            'smaller rtol, or start with a little variance; engine="native" takes no gains, only rates.'
        )
        warn(RuntimeWarning(text))


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


class Care(NamedTuple):
    """What a run asks for besides a tolerance."""

    growth: float  # how many times larger its moments become than they begin, where errors grow with them
    steps: int  # that it may take


@dataclass(frozen=True)
class _Plan:
    """What is settled before a run is integrated."""

    kind: str  # of engine
    size: Array  # of every moment
    care: Care


_known: Memory[list[_Plan]] = Memory()


def _plans(
    lowered: MomentFunctions, starts: Starts, grid: Array, engine: str, declared: Callable[[], Start] | None
) -> list[_Plan]:
    """The plans of runs; of a single one remembered for the next of the same."""
    end = float(grid[-1])

    def make(these: Starts) -> list[_Plan]:
        known, kinds, steps = outline(lowered, these[0], end, declared), [engine] * len(these), [STEPS] * len(these)
        if engine == "auto":
            found = modes(lowered, these.p, end, known.along, QUICK)
            kinds = choose(lowered, these, grid, found)
            steps = [most_steps(these.y.shape[1]) if each else STEPS for each in rings(lowered, found).tolist()]
        growth, ways = known.growth(lowered.facts.packing), list(zip(kinds, steps, strict=True))
        plans = {way: _Plan(way[0], known.size, Care(growth, way[1])) for way in set(ways)}
        return [plans[way] for way in ways]

    if len(starts) == 1:
        key = ref(lowered), lowered.jit, end, engine, declared is None
        return _known(starts, key, lambda: make(starts))
    return make(starts) if declared is not None else [make(starts.of([k]))[0] for k in range(len(starts))]


def engine_for(lowered: MomentFunctions, start: Start, grid: Array) -> str:
    """The kind of engine that is chosen for a run."""
    return _plans(lowered, start.alone, grid, "auto", None)[0].kind


def _tolerance(rtol: float, size: Array, packing: Packing, kind: str, care: Care) -> Tolerance:
    """What a step may err by: errors add up, the more steps the more, and small values matter the more."""
    tight = min(1.0, max(rtol, 1e-13) / 1e-6)
    absolute = tight**0.5 * ABSOLUTE / care.growth
    weighed = size
    if packing.ground:
        weighed = size.copy()
        weighed[..., size.shape[-1] - packing.ground :] *= BETWEEN
    if kind == "native":  # the errors of its order hardly add up
        return Tolerance(max(rtol, 1e-13), absolute, weighed, care.steps)
    return Tolerance(max(tight**0.75 * rtol, 2e-14), absolute, weighed)
