"""Explicit Runge-Kutta formulas as machine code, the rate too: for what is not stiff the fastest of all.

Moments that stay as they are at the start are left out (see `lowering.held`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.kernel import kernel
from cadet_sym.lowering.machine import MachineCode, address, available, in_turn
from cadet_sym.memory import Memory
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.runge_kutta import HEAD, PROCEDURES, REPORT, STALLED, WORK
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.tableaux import DORMAND_PRINCE, RANOCHA_3, RANOCHA_5, Pair

__all__ = ["Native", "has_machine_code", "integrate_together", "prepare"]

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

FEW, MANY, LONG = 4, 8, 128
"""Lanes of short vectors and of those that are as long as this (see `runge_kutta`)."""

LINE = 8
"""Numbers in a line of the processor's cache."""

RESTS = 1e-10
"""A rate below this share of its own terms is zero."""


@dataclass
class Call:
    """A call of the integrator, and the memory that it reads and writes."""

    lanes: int
    arguments: tuple[float, ...]
    _alive: tuple[object, ...]
    y: Array  # packed moments at the start, of which those at `free` are integrated
    free: Places
    held: Places
    times: Array
    x: Array  # where it arrived
    values: Array  # (k, free)
    report: Array
    status: int | None = None  # what was returned, if it was made


@dataclass
class Native:
    """The moment equations of one run under the pair of order 8 of Dormand and Prince.

    Where wheels follow each other, stability limits the steps: on the way from wheel to wheel values decay fast. Pairs that
    are stable for longer then compete with it (see `runge_kutta`).
    """

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    steps: int = field(default=0, init=False)
    pairs: tuple[Pair, ...] = field(default=(DORMAND_PRINCE,), init=False)
    ahead: Call | None = field(default=None, init=False)  # made for the first stretch
    name = "Runge-Kutta 8(5,3), machine code"
    stiff = False

    def __post_init__(self) -> None:
        if self.lowered.facts.delay is not None:
            self.pairs = DORMAND_PRINCE, RANOCHA_5, RANOCHA_3
            self.name = f"Runge-Kutta {', '.join(pair.name for pair in self.pairs)}, machine code"

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`."""
        call, self.ahead = self.ahead or self.call(begin, y, grid), None
        status = _march(call.lanes)(*call.arguments) if call.status is None else call.status
        return self._found(call, status)

    def call(self, begin: float, y: Array, grid: Array) -> Call:
        """The call of the integrator for a stretch, to be made now or together with others."""
        free, held = _parts(self.lowered, self.p, y)
        rate, which = _rate(self.lowered, held)
        assert rate is not None, "chosen only where there is machine code"
        tables = np.array([pair.packed for pair in self.pairs])
        n, report = len(free), np.zeros(REPORT)
        lanes = FEW if n < LONG else MANY
        x, size = _padded(y[free], lanes, 0.0), _padded(self.tolerance.size[free], lanes, 1.0)
        values, work = np.empty((len(grid), len(x))), _zeros(WORK * len(x) + HEAD)
        times, given = np.ascontiguousarray(grid, dtype=float), np.concatenate([self.p, y[held]])
        arguments = (
            rate.addresses[which], begin, address(times), len(times), address(x), len(x), n, address(given),
            address(size), self.tolerance.relative, self.tolerance.absolute, float(np.nextafter(times[-1], begin)),
            self.tolerance.steps, address(tables), len(tables), address(work), address(values), address(report),
        )  # fmt: skip
        return Call(lanes, arguments, (rate, given, size, tables, work), y, free, held, times, x[:n], values[:, :n], report)

    def _found(self, call: Call, status: int) -> Array:
        values, report, held = call.values, call.report, call.held
        self.steps += int(report[1])
        found = values if not len(held) else np.repeat(call.y[None], len(values), axis=0)
        if len(held):
            found[:, call.free] = values
        if status:
            here = call.y.copy()
            here[call.free] = call.x
            reached = int(np.searchsorted(call.times, report[0], side="right"))
            reason = "Its steps shrink to nothing." if status == STALLED else "It took too many steps."
            raise Breakdown(reason, found[:reached], float(report[0]), here)
        if not np.isfinite(values).all():
            raise Breakdown("the result is not finite")
        return found


def integrate_together(runs: Sequence[tuple[Native, float, Array, Array]]) -> None:
    """Integrate the first stretch of many runs (engine, begin, y, grid) while Python's lock is left to others only once."""
    calls = [engine.call(begin, y, grid) for engine, begin, y, grid in runs]
    for lanes in {call.lanes for call in calls}:
        same = [call for call in calls if call.lanes == lanes]
        for call, status in zip(same, in_turn(_march(lanes), [call.arguments for call in same]), strict=True):
            call.status = status
    for (engine, *_), call in zip(runs, calls, strict=True):
        engine.ahead = call


def has_machine_code(lowered: MomentFunctions, p: Array, y: Array) -> bool:
    """Whether a run from y can be integrated so."""
    return _rate(lowered, _parts(lowered, p, y)[1])[0] is not None


def _rate(lowered: MomentFunctions, held: Places) -> tuple[MachineCode | None, str]:
    name = "free_rate" if len(held) else "rate"
    return lowered.machine(name), name


def prepare() -> None:
    """Make the integrator, or read it from the cache: what a run needs that does not depend on the model."""
    if available():
        _march(FEW)


@cache
def _march(lanes: int) -> Any:
    """The integrator; the same machine code for all models."""
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    state = (vector, integer, integer, vector, vector)
    types = (vector, number, vector, integer, *state, number, number, number, integer, vector, integer)
    return kernel(*PROCEDURES, lanes=lanes).function("march", *types, vector, vector, vector, returns=integer)


def _zeros(count: int) -> Array:
    """A vector of zeros that begins where a line of the processor's cache does."""
    room = np.zeros(count + LINE)
    first = -(address(room) // room.itemsize) % LINE
    return room[first : first + count]


def _padded(values: Array, lanes: int, rest: float) -> Array:
    """Values, and as many more as fill the last lanes."""
    vector = _zeros(-(-len(values) // lanes) * lanes)
    vector[: len(values)] = values
    vector[len(values) :] = rest
    return vector


_places: Memory[tuple[Places, Places]] = Memory()
_resting: Memory[bool] = Memory()


def _parts(lowered: MomentFunctions, p: Array, y: Array) -> tuple[Places, Places]:
    """The packed moments that have to be integrated from y on, and those that stay."""
    free, held = _places(lowered, "", lambda: _free_and_held(lowered, len(y)))
    if not len(held):
        return free, held
    rests = _resting(lowered, p.tobytes() + y[held].tobytes(), lambda: _rest(lowered, p, y, held))
    return (free, held) if rests else (np.arange(len(y)), held[:0])


def _free_and_held(lowered: MomentFunctions, size: int) -> tuple[Places, Places]:
    every = np.arange(size)
    # of a large model, the few that stay do not pay for a rate of its own
    free = every if lowered.large else np.array(lowered.free_entries()["free"], dtype=np.intp).ravel()
    return free, np.delete(every, free)


def _rest(lowered: MomentFunctions, p: Array, y: Array, held: Places) -> bool:
    """Whether the rates of the held moments, which depend on them and the speed alone, vanish at any speed."""
    nothing = y.copy()
    nothing[held] = 0.0
    for speed in (1.0, 2.7):
        found, forced = (np.asarray(lowered.held_rate(0, 0, speed, at, p)).ravel()[held] for at in (y, nothing))
        if not np.abs(found).max() <= RESTS * np.abs(forced).max():
            return False
    return True
