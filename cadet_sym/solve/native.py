"""Explicit Runge-Kutta formulas as machine code, the rate too: for what is not stiff the fastest of all.

Moments that stay as they are at the start are left out (see `lowering.held`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from math import nextafter
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.kernel import kernel
from cadet_sym.lowering.machine import MachineCode, address, available
from cadet_sym.memory import Memory
from cadet_sym.solve.breakdown import settled
from cadet_sym.solve.evaluate import results_over
from cadet_sym.solve.runge_kutta import HEAD, PROCEDURES, REPORT, WORK
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.shares import ALONE, Team, Then, among, nothing
from cadet_sym.solve.tableaux import DORMAND_PRINCE, RANOCHA_3, RANOCHA_5, Pair

__all__ = [
    "Made",
    "Marched",
    "Native",
    "aligned_zeros",
    "has_machine_code",
    "have_machine_code",
    "made_ready",
    "march_all",
    "march_made",
    "method",
    "pairs_of",
    "prepare",
]

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

FEW, MANY, LONG = 4, 8, 128
"""Lanes of short vectors and of those that are as long as this (see `runge_kutta`)."""

LINE = 8
"""Numbers in a line of the processor's cache."""

RESTS = 1e-10
"""A rate below this share of its own terms is zero."""


class Marched(NamedTuple):
    """Runs through the same output times (k,)."""

    y: Array  # (runs, k, size) packed moments; of a run that was given up, as far as it came
    time: Array  # (runs,) where each arrived
    here: Array  # (runs, size) with these moments
    steps: Array  # (runs,)
    known: Array  # (runs,) output times that were reached
    status: Array  # (runs,) 0, or why a run was given up


@dataclass
class Native:
    """The moment equations of one run under the pair of order 8 of Dormand and Prince, or those of `method`."""

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    steps: int = field(default=0, init=False)
    name = "Runge-Kutta 8(5,3), machine code"
    stiff = False

    def __post_init__(self) -> None:
        self.name = method(self.lowered)

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`."""
        run = march_all(self.lowered, self.p[None], y[None], [(begin, float(grid[-1]))], grid, self.tolerance)
        self.steps += int(run.steps[0])
        return settled(run.y[0], int(run.status[0]), int(run.known[0]), float(run.time[0]), run.here[0])


def march_all(
    lowered: MomentFunctions,
    p: Array,
    y: Array,
    edges: Sequence[tuple[float, ...]],
    grid: Array,
    tolerance: Tolerance,
    team: Team = ALONE,
    then: Then = nothing,
) -> Marched:
    """Carry runs that differ in their parameters (runs, count) from y (runs, size) through the times of the grid.

    Python's lock is left to other threads once, for all of it, or for each part of a team's.

    Parameters
    ----------
    edges : of every run, the times at which its stretches begin, and the end of the last.
    tolerance : with sizes (size,) or (runs, size).
    then : is called for every part of the runs by the thread that carried it.
    """
    rests = _rest(lowered, p, y)
    if rests.any() and not rests.all():
        groups = [np.flatnonzero(rests), np.flatnonzero(~rests)]
        parts = []
        for k in groups:
            own = p[k], y[k], [edges[i] for i in k.tolist()], grid, tolerance.of(k)
            parts.append(march_all(lowered, *own, team, partial(among, k, then)))
        order = np.argsort(np.concatenate(groups))
        return Marched(*(np.concatenate(pair)[order] for pair in zip(*parts, strict=True)))
    return march_made(_made(lowered, bool(rests[0])), p, y, edges, grid, tolerance, team, then)


def march_made(
    made: Made, p: Array, y: Array, edges: Sequence[tuple[float, ...]], grid: Array, tolerance: Tolerance, team: Team = ALONE,
    then: Then = nothing,
) -> Marched:
    """The same under a rate that was made ready."""
    assert made.rate, "chosen only where there is machine code"
    (runs, whole), k = y.shape, len(grid)
    p, here, grid = np.ascontiguousarray(p), y.copy(), np.ascontiguousarray(grid, dtype=float)
    size, found, reports = np.ascontiguousarray(tolerance.size), np.empty((runs, k, whole)), np.zeros((runs, REPORT))
    ways = {times: np.array(list(_travel(times))) for times in set(edges)}

    def some(part: slice) -> None:
        travel = np.concatenate([ways[times] for times in edges[part]])
        work = aligned_zeros((WORK + 1) * made.n + HEAD + p.shape[1] + whole)
        _march_all(made.lanes)(
            made.rate, part.stop - part.start, address(grid), k, address(here[part]), whole, made.places, made.entries, made.n,
            address(p[part]), p.shape[1], address(size[part] if size.ndim > 1 else size), whole * (size.ndim - 1),
            tolerance.relative, tolerance.absolute, address(travel), tolerance.steps, *made.tables, address(work),
            address(found[part]), address(reports[part]),
        )  # fmt: skip
        then(part, found[part])

    team.share(runs, some)
    time, steps, _, _, known, status = reports.T
    return Marched(found, time, here, steps, known, status)


def _travel(edges: tuple[float, ...]) -> Iterator[float]:
    """The stretches of a run as the integrator takes them."""
    yield len(edges) - 1
    for begin, end in pairwise(edges):
        yield from (begin, end, nextafter(end, begin))


@dataclass(frozen=True)
class Made:
    """What the integrator takes of a rate: where its machine code and tables are."""

    rate: int  # 0 if there is none
    entries: int  # that move
    lanes: int
    n: int  # entries, and as many more as fill the last lanes
    places: int
    tables: tuple[int, int]  # where they are, and how many
    alive: tuple[Any, ...]


_ready: Memory[Made] = Memory()


def _made(lowered: MomentFunctions, rests: bool) -> Made:
    def make() -> Made:
        code, name = _rate(lowered, rests)
        every = np.arange(lowered.facts.packing.size)
        free, held = _free_and_held(lowered) if rests else (every, every[:0])
        return made_ready(code, name, free, held, pairs_of(lowered))

    return _ready(lowered, (rests, lowered.jit), make)


def made_ready(
    code: MachineCode | None, name: str, free: Places, held: Places, pairs: Sequence[Pair] = (DORMAND_PRINCE,)
) -> Made:
    """A rate in machine code, (t, free, p and held) -> the rates of the free, ready to be integrated."""
    lanes = FEW if len(free) < LONG else MANY
    places, tables = np.concatenate([free, held]).astype(float), np.array([pair.packed for pair in pairs])
    at, n = (address(tables), len(tables)), -(-len(free) // lanes) * lanes
    rate = 0 if code is None else code.addresses[name]
    return Made(rate, len(free), lanes, n, address(places), at, (code, places, tables))


def method(lowered: MomentFunctions) -> str:
    """The formulas by which runs are integrated, by their names.

    Where wheels follow each other, stability limits the steps: on the way from wheel to wheel values decay fast. Pairs that
    are stable for longer then compete with the one of order 8 (see `runge_kutta`).
    """
    return f"Runge-Kutta {', '.join(pair.name for pair in pairs_of(lowered))}, machine code"


def pairs_of(lowered: MomentFunctions) -> tuple[Pair, ...]:
    """The pairs of formulas by which runs are integrated."""
    return (DORMAND_PRINCE,) if lowered.facts.delay is None else (DORMAND_PRINCE, RANOCHA_5, RANOCHA_3)


def have_machine_code(lowered: MomentFunctions, p: Array, y: Array) -> npt.NDArray[np.bool_]:
    """Whether runs with parameters (runs, count) from y (runs, size) can be integrated so, (runs,)."""
    rests = _rest(lowered, p, y)
    there = {kind: _rate(lowered, kind)[0] is not None for kind in set(rests.tolist())}
    return np.where(rests, there.get(True, False), there.get(False, False))


def has_machine_code(lowered: MomentFunctions, p: Array, y: Array) -> bool:
    """Whether a run from y can be integrated so."""
    return bool(have_machine_code(lowered, p[None], y[None])[0])


def _rate(lowered: MomentFunctions, rests: bool) -> tuple[MachineCode | None, str]:
    name = "free_rate" if rests else "rate"
    return lowered.machine(name), name


def prepare() -> None:
    """Make the integrator, or read it from the cache: what a run needs that does not depend on the model."""
    if available():
        _march_all(FEW)


@cache
def _march_all(lanes: int) -> Any:
    """The integrator; the same machine code for all models."""
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    runs = (vector, integer, vector, integer, vector, integer, vector, integer, integer)
    tolerance = (vector, integer, vector, integer, number, number)
    rest = (vector, integer, vector, integer, vector, vector, vector)
    return kernel(*PROCEDURES, lanes=lanes, plain=True).function("march_all", *runs, *tolerance, *rest, returns=integer)


def aligned_zeros(count: int) -> Array:
    """A vector of zeros that begins where a line of the processor's cache does."""
    room = np.zeros(count + LINE)
    first = -(address(room) // room.itemsize) % LINE
    return room[first : first + count]


_places: Memory[tuple[Places, Places]] = Memory()
_resting: Memory[npt.NDArray[np.bool_]] = Memory()


def _rest(lowered: MomentFunctions, p: Array, y: Array) -> npt.NDArray[np.bool_]:
    """Of which runs the moments that may be held, `_free_and_held`, stay as they are, (runs,)."""
    held = _free_and_held(lowered)[1]
    if not len(held):
        return np.zeros(len(y), dtype=bool)
    if len(y) > 1:
        return _look(lowered, p, y, held)
    return _resting(lowered, p.tobytes() + y.take(held, axis=1).tobytes(), lambda: _look(lowered, p, y, held))


def _look(lowered: MomentFunctions, p: Array, y: Array, held: Places) -> npt.NDArray[np.bool_]:
    """Whether the rates of the held moments, which depend on them and the speed alone, vanish at any speed."""
    runs, nothing = len(y), y.copy()
    nothing[:, held] = 0.0
    zero, speeds = np.zeros(4 * runs), np.repeat((1.0, 2.7), 2 * runs)
    slopes = results_over(lowered.held_rate, zero, zero, speeds, np.concatenate([y, nothing] * 2), np.tile(p, (4, 1)))[0]
    found = np.abs(slopes[:, held]).max(axis=1).reshape(2, 2, runs)  # at each speed, of y and where nothing is held
    return np.asarray((found[:, 0] <= RESTS * found[:, 1]).all(axis=0))


def _free_and_held(lowered: MomentFunctions) -> tuple[Places, Places]:
    """The packed moments that have to be integrated, and those that may stay as they are at the start."""

    def find() -> tuple[Places, Places]:
        every = np.arange(lowered.facts.packing.size)
        # of a large model, the few that stay do not pay for a rate of its own
        free = every if lowered.large else np.array(lowered.free_entries()["free"], dtype=np.intp).ravel()
        return free, np.delete(every, free)

    return _places(lowered, "", find)
