"""Take a CasADi function of scalars apart into its operations, for those who write it in another language.

An operation refers to what it needs by the operation that made it, not by a work register. A call of another function is an
operation too, followed by one for every number of its results. Long functions are cut into blocks, which compilers take in
linear time; what a later block needs of an earlier one goes through a scratch array.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import casadi as ca

__all__ = ["Blocks", "Entry", "Operation", "cut", "kinds", "operations", "size"]


class Entry(NamedTuple):
    """One number of an argument or result of the function."""

    vector: int
    index: int


Operand = int | float | Entry
"""The number of an operation, a constant, or an entry of an argument."""


class Operation(NamedTuple):
    """One operation in scalars, one entry of a result written, or a call: its operands are the entries of all arguments."""

    kind: str  # CasADi's name without its OP_; `OUTPUT` writes a result, `RESULT` reads one of a `CALL`
    operands: tuple[Operand, ...]
    entry: Entry | None = None  # that is written; of what the operation of that number calls, counted through all results
    called: ca.Function | None = None


@dataclass(frozen=True)
class Blocks:
    """A list of operations cut into pieces."""

    ranges: tuple[range, ...]
    places: dict[int, int]  # of the operations that later blocks need, in the scratch array
    scratch: int  # length of that array


@cache
def kinds() -> dict[int, str]:
    """CasADi's names of operations, by their numbers."""
    return {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}


def operations(function: ca.Function) -> list[Operation]:
    """The operations of a function made of SX, in the order in which CasADi evaluates them.

    Raises
    ------
    ValueError
        If the function is not made of operations in scalars.
    """
    if not function.is_a("SXFunction"):
        raise ValueError(f"`{function.name()}` is not made of scalar operations")
    names, calls = kinds(), function.instructions_sx() if function.find_functions(0) else None
    register: dict[int, Operand] = {}
    found: list[Operation] = []
    for k in range(function.n_instructions()):
        kind = names[function.instruction_id(k)]
        into = function.instruction_output(k)
        if kind == "CONST":
            register[into[0]] = function.instruction_constant(k)
            continue
        read = function.instruction_input(k)
        if kind == "INPUT":
            register[into[0]] = Entry(*read)
        elif kind == "OUTPUT":
            found.append(Operation(kind, (register[read[0]],), Entry(*into)))
        else:
            operands, here = tuple(register[i] for i in read), len(found)
            if kind != "CALL":
                register[into[0]] = here
                found.append(Operation(kind, operands))
                continue
            assert calls is not None
            found.append(Operation(kind, operands, called=calls[k].which_function()))
            for j, i in enumerate(into):
                register[i] = len(found)
                found.append(Operation("RESULT", (), Entry(here, j)))
    return found


def reordered(steps: Sequence[Operation], order: Sequence[int]) -> list[Operation]:
    """The same operations in another order, in which each comes after what it needs."""
    place = {k: there for there, k in enumerate(order)}
    found = []
    for kind, operands, entry, called in map(steps.__getitem__, order):
        if kind == "RESULT":
            assert entry is not None
            entry = entry._replace(vector=place[entry.vector])
        moved = tuple(place[each] if type(each) is int else each for each in operands)
        found.append(Operation(kind, moved, entry, called))
    return found


def size(function: ca.Function) -> int:
    """How many operations there are in a function and in those that it calls, each of these counted once."""
    every = [function, *function.find_functions()]
    return sum(each.n_instructions() for each in every if each.class_name() in ("SXFunction", "MXFunction"))


class _Step(Protocol):
    @property
    def operands(self) -> Iterable[object]: ...


def cut(steps: Sequence[_Step], length: int) -> Blocks:
    """Blocks of a length, with a place for every value that a later block needs; places are used again."""
    ranges = tuple(range(k, min(k + length, len(steps))) for k in range(0, len(steps), length)) or (range(0),)
    used = {operand: k for k, step in enumerate(steps) for operand in step.operands if type(operand) is int}
    places: dict[int, int] = {}
    free: list[int] = []
    returned: dict[int, list[int]] = {}
    count = 0
    for b, block in enumerate(ranges):
        free += returned.pop(b, [])
        for k in block:
            if used.get(k, -1) < block.stop:
                continue
            place = free.pop() if free else count
            count += place == count
            places[k] = place
            returned.setdefault(used[k] // length + 1, []).append(place)
    return Blocks(ranges, places, count)
