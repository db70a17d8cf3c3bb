"""Take a CasADi function of scalars apart into its operations, for those who write it in another language.

An operation refers to what it needs by the operation that made it, not by a work register. Long functions are cut into
blocks, which compilers take in linear time; what a later block needs of an earlier one goes through a scratch array.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import casadi as ca

__all__ = ["Blocks", "Entry", "Operation", "cut", "operations"]


class Entry(NamedTuple):
    """One number of an argument or result of the function."""

    vector: int
    index: int


Operand = int | float | Entry
"""The number of an operation, a constant, or an entry of an argument."""


class Operation(NamedTuple):
    """One operation in scalars, or one entry of a result written."""

    kind: str  # CasADi's name without its OP_; `OUTPUT` writes a result
    operands: tuple[Operand, ...]
    written: Entry | None = None


@dataclass(frozen=True)
class Blocks:
    """A list of operations cut into pieces."""

    ranges: tuple[range, ...]
    places: dict[int, int]  # of the operations that later blocks need, in the scratch array
    scratch: int  # length of that array


@cache
def _kinds() -> dict[int, str]:
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
    kinds = _kinds()
    register: dict[int, Operand] = {}
    found: list[Operation] = []
    for k in range(function.n_instructions()):
        kind = kinds[function.instruction_id(k)]
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
            operands = tuple(register[i] for i in read)
            register[into[0]] = len(found)
            found.append(Operation(kind, operands))
    return found


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
