"""A CasADi function of scalars in LLVM's intermediate language: one instruction an operation, in CasADi's order."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from cadet_sym.lowering.instructions import ONE, Module, arguments, literal
from cadet_sym.lowering.operations import Blocks, Entry, Operation, cut, operations

__all__ = ["BLOCK", "scalars"]

BLOCK = 1000
"""Operations of one block; the time to compile it grows faster than its length."""


def scalars(function: ca.Function, module: Module) -> list[str]:
    """The lines of `@self` and of the blocks that it is cut into.

    Raises
    ------
    ValueError
        If an operation is not known here.
    """
    steps = operations(function)
    module.kinds.update(step.kind for step in steps)
    pieces = cut(steps, BLOCK)
    room, size = _room_of_calls(steps, max(pieces.scratch, int(len(pieces.ranges) > 1)))
    writer = _Writer(steps, pieces, room, module)
    blocks, begin = pieces.ranges, f"define internal void @self({arguments(function)}) nounwind {{"
    work = [f"  %w = alloca [{size} x double], align 32"] * bool(size)
    if len(blocks) == 1:
        return [begin, *work, *writer.block(blocks[0]), "  ret void", "}"]
    lines, given = [], arguments(function, "ptr %w")
    for k, block in enumerate(blocks):
        lines += [f"define internal void @self_{k}({given}) nounwind {{", *writer.block(block), "  ret void", "}"]
    calls = [f"  call void @self_{k}({given})" for k in range(len(blocks))]
    return [*lines, begin, *work, *calls, "  ret void", "}"]


def _room_of_calls(steps: Sequence[Operation], scratch: int) -> tuple[dict[int, int], int]:
    """Where the arguments of every call, followed by its results, are in the scratch array; how long that is then."""
    room = {}
    for k, step in enumerate(steps):
        if step.called is not None:
            room[k] = scratch
            scratch += len(step.operands) + sum(step.called.nnz_out(j) for j in range(step.called.n_out()))
    return room, scratch


class _Writer:
    """Writes blocks of operations; what a block reads is loaded once."""

    def __init__(self, steps: Sequence[Operation], pieces: Blocks, room: dict[int, int], module: Module) -> None:
        self.steps, self.places, self.room, self.module = steps, pieces.places, room, module

    def block(self, block: range) -> list[str]:
        """The instructions of one block."""
        self.within, self.lines, self.loaded = block, [], {}
        truths: set[str] = set()
        for k in block:
            kind, operands, entry, called = self.steps[k]
            values = [self._value(operand) for operand in operands]
            if kind == "OUTPUT":
                assert entry is not None
                self._store(f"%s{k}", values[0], f"%o{entry.vector}", entry.index)
            elif called is not None:
                self._call(k, called, values)
                continue
            elif kind == "RESULT":
                assert entry is not None
                before = self.steps[entry.vector]
                self._load(f"%a{k}", "%w", self.room[entry.vector] + len(before.operands) + entry.index)
            else:
                self.lines += ONE.instructions(k, kind, values, truths)
            if k in self.places:
                self._store(f"%s{k}", f"%a{k}", "%w", self.places[k])
        return self.lines

    def _value(self, operand: int | float | Entry) -> str:
        if isinstance(operand, Entry):
            return self._once(operand, f"%i{operand.vector}", operand.index)
        if type(operand) is not int:
            return literal(operand)
        return f"%a{operand}" if operand in self.within else self._once(operand, "%w", self.places[operand])

    def _once(self, key: int | Entry, pointer: str, index: int) -> str:
        if key not in self.loaded:
            self.loaded[key] = f"%l{len(self.loaded)}"
            self._load(self.loaded[key], pointer, index)
        return self.loaded[key]

    def _load(self, register: str, pointer: str, index: int) -> None:
        self.lines.append(f"  {register}p = getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  {register} = load double, ptr {register}p")

    def _store(self, register: str, value: str, pointer: str, index: int) -> None:
        self.lines.append(f"  {register} = getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store double {value}, ptr {register}")

    def _call(self, k: int, called: ca.Function, values: Sequence[str]) -> None:
        first = self.room[k]
        for j, value in enumerate(values):
            self._store(f"%s{k}.{j}", value, "%w", first + j)
        pointers = []
        for nnz in (*map(called.nnz_in, range(called.n_in())), *map(called.nnz_out, range(called.n_out()))):
            pointers.append(f"ptr %r{k}.{len(pointers)}")
            self.lines.append(f"  {pointers[-1][4:]} = getelementptr double, ptr %w, i64 {first}")
            first += nnz
        self.lines.append(f"  call void @{self.module.name_of(called)}({', '.join(pointers)})")
