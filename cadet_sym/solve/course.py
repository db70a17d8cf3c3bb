"""March the moments through a run, stretch by stretch, with one of the engines.

The run is cut at every known breakpoint (a kink of the speed, an edge of the profile, a wheel that meets the ground) and
restarted there, for no integrator sees an input that is shorter than its step.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from threading import RLock
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.breakdown import Breakdown, explain
from cadet_sym.solve.cvodes import Direct
from cadet_sym.solve.krylov import Stepping
from cadet_sym.solve.many import Start, Trajectory
from cadet_sym.solve.native import Native
from cadet_sym.solve.onset import onset
from cadet_sym.solve.resting import Resting
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.stiff import Stiff, bdf_compiles

__all__ = ["ENGINES", "Engine", "March", "edges", "march"]

Array = npt.NDArray[np.float64]

SWING = 0.5
"""Share of a step's tolerance that explicit formulas of CVODES are given."""

PATIENCE = 5_000
"""Steps between two output times after which the gains, held during a step, react too strongly to be held."""

FEW = 700
"""Packed moments up to which a Jacobian of all of them is a matter of milliseconds (36 states)."""

ENGINES = ("auto", "direct", "implicit", "krylov", "explicit", "stepping", "native", "stiff")


class March(NamedTuple):
    """A run that was integrated."""

    y: Array  # (k, size) moments at the times asked for
    engine: str  # by its name
    steps: int  # or how much work it was
    doubtful: bool  # whether it set out from gains that may have misled it


class Engine(Protocol):
    """One way to integrate a stretch."""

    @property
    def name(self) -> str:
        """The method, by its name in the literature."""
        ...

    @property
    def stiff(self) -> bool:
        """Whether its formulas are implicit."""
        ...

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    steps: int
    """How much work it was."""

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`; raises Breakdown."""
        ...


def edges(breakpoints: Iterable[float], grid: Array) -> tuple[float, ...]:
    """Where the run begins, its known breakpoints, and where it ends."""
    return 0.0, *sorted(b for b in set(breakpoints) if 0.0 < b < grid[-1]), float(grid[-1])


def march(
    lowered: MomentFunctions,
    start: Start,
    grid: Array,
    kind: str,
    tolerance: Tolerance,
    asked: float | None = None,
    *,
    alone: bool = False,
) -> March:
    """Integrate stretch by stretch; an engine alone is left alone: no other takes over what it gives up.

    A breakdown leaves as it is, or, where the tolerance asked for is given, explained to the user.
    """
    engine = _engine(lowered, start.p, kind, tolerance)
    y, found, known, doubtful = start.y, np.empty((len(grid), len(start.y))), 0, False
    names = {engine.name: 0}  # in the order of their appearance, and their steps
    if grid[0] == 0:
        found[0], known = start.y, 1
    for begin, end in itertools.pairwise(edges(start.breakpoints, grid)):
        if end <= begin:
            continue
        last = int(grid.searchsorted(end, side="right"))
        inside = grid[known:last]
        stretch = inside if inside.size and inside[-1] == end else np.append(inside, end)
        try:
            values, honest, used = _advance(engine, begin, y, stretch, alone)
        except Breakdown as breakdown:
            if asked is None:
                raise
            reached = np.empty((0, len(y))) if breakdown.found is None else breakdown.found[: inside.size]
            kept = np.concatenate([found[:known], reached])
            partial = Trajectory(grid[: len(kept)], kept, engine.name, asked, {})
            raise explain(lowered, start.p, breakdown, begin, y, partial) from None
        found[known:last], known = values[: inside.size], last
        y, doubtful = values[-1], doubtful or not honest
        engine = used if isinstance(used, Resting) else engine  # what rests once may rest again
        names[used.name] = names.get(used.name, 0) + used.steps * (used is not engine)
    return March(found, ", then ".join(names), engine.steps + sum(names.values()), doubtful)


def _engine(lowered: MomentFunctions, p: Array, kind: str, tolerance: Tolerance) -> Engine:
    if kind == "native":
        return Native(lowered, p, tolerance)
    if kind == "stiff":
        return Stiff(lowered, p, tolerance)
    if kind in ("direct", "explicit"):
        if kind == "explicit":  # many small errors of one sign add up where moments swing
            tolerance = replace(tolerance, relative=tolerance.relative * SWING)
        return Direct(lowered, p, tolerance, stiff=kind == "direct")
    if kind == "implicit":
        tolerance = replace(tolerance, steps=PATIENCE)
    return Stepping(lowered, p, tolerance, stiff=kind != "stepping", full_newton=kind == "krylov")


def _advance(engine: Engine, begin: float, y: Array, stretch: Array, alone: bool) -> tuple[Array, bool, Engine]:
    """One stretch, whether it began with gains that are those of the run, and by which engine.

    What one engine gives up, the next goes through, or it is said how far the first came that knows.
    """
    told: Breakdown | None = None
    for each in [engine] if alone else _one_after_the_other(engine):
        try:
            return *_from_onset(each, begin, y, stretch), each
        except Breakdown as breakdown:
            if told is None or told.found is None:  # who knows to the last step where it was
                told = breakdown
            resting = _resting(each, breakdown, begin, y, stretch)
            if resting is not None:
                return resting
    assert told is not None, "there is at least one engine"
    raise told


def _resting(
    engine: Engine, told: Breakdown, begin: float, y: Array, stretch: Array
) -> tuple[Array, bool, Engine] | None:
    """The stretch from where an engine gave it up, if it was friction that holds something at rest; None if it was not."""
    places = [(np.empty((0, len(y))), begin, y)]
    if told.found is not None and told.time is not None and told.y is not None and np.isfinite(told.y).all():
        places.insert(0, (told.found[: len(stretch) - 1], told.time, told.y))
    after = Resting(engine.lowered, engine.p, engine.tolerance)
    _, last, there = places[0]
    if isinstance(engine, Resting) or not after.is_wanted(last, there, float(stretch[-1])):
        return None
    for found, time, here in places:
        try:
            rest = _alone(after, time, here, stretch[len(found) :])
        except Breakdown:
            continue
        return np.vstack([found, rest]), True, after
    return None


def _one_after_the_other(engine: Engine) -> Iterator[Engine]:
    """An engine and those that take over from it: implicit formulas in machine code from explicit ones, then CVODES."""
    yield engine
    lowered, p, tolerance = engine.lowered, engine.p, engine.tolerance
    if isinstance(engine, Native) and bdf_compiles(lowered):
        yield Stiff(lowered, p, tolerance)
    if isinstance(engine, Native | Stiff) and lowered.facts.packing.size <= FEW:
        yield Direct(lowered, p, tolerance)
    if not (isinstance(engine, Stepping) and (engine.full_newton or not engine.stiff)):
        yield Stepping(lowered, p, tolerance, stiff=True, full_newton=True)


_turns = RLock()


def _from_onset(engine: Engine, begin: float, y: Array, stretch: Array) -> tuple[Array, bool]:
    """One stretch with one engine; implicit formulas begin where the gains do not mislead them."""
    if not engine.stiff:
        return _alone(engine, begin, y, stretch), True
    first = onset(engine.lowered, engine.p, engine.tolerance, begin, y, stretch)
    if not first.steps:
        return _alone(engine, begin, y, stretch), first.honest
    engine.steps += first.steps
    if len(first.found) == len(stretch):
        return first.found, True
    try:
        rest = _alone(engine, first.time, first.y, stretch[len(first.found) :])
    except Breakdown as breakdown:
        if breakdown.found is not None:
            breakdown.found = np.vstack([first.found, breakdown.found])
        raise
    return np.vstack([first.found, rest]), first.honest


def _alone(engine: Engine, begin: float, y: Array, stretch: Array) -> Array:
    """Threads take turns, except in machine code: what SUNDIALS prints is the whole process's."""
    with nullcontext() if isinstance(engine, Native | Stiff) else _turns:
        return engine.advance(begin, y, stretch)
