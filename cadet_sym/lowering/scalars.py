"""A CasADi function of scalars in LLVM's intermediate language: one instruction an operation.

Exponentials and their like that do not wait for each other, as at the nodes of a quadrature, are taken together, up to eight
at a time, by the functions of `lowering.vectors`; what is needed for them goes before.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import casadi as ca

from cadet_sym.lowering.instructions import ONE, SEVERAL, Module, arguments, literal
from cadet_sym.lowering.operations import Blocks, Entry, Operation, cut, operations, reordered
from cadet_sym.lowering.vectors import VECTORS, of_scalars

__all__ = ["BLOCK", "is_casadis", "scalars"]

BLOCK = 1000
"""Operations of one block; the time to compile it grows faster than its length."""

TOGETHER = 4
"""Exponentials from which on taking them together is faster than one by one ..."""

WORTH = 16
"""... and in all from which on that is worth the time to compile what takes them."""


def scalars(function: ca.Function, module: Module) -> list[str]:
    """The lines of `@self` and of the blocks that it is cut into.

    Raises
    ------
    ValueError
        If an operation is not known here.
    """
    written = operations(function)
    steps = _side_by_side(written)
    pieces = cut(steps, BLOCK)
    room, size = _room_of_calls(steps, max(pieces.scratch, int(len(pieces.ranges) > 1)))
    writer = _Writer(steps, pieces, room, module, together=steps is not written)
    blocks, begin = pieces.ranges, f"define internal void @self({arguments(function)}) nounwind {{"
    work = [f"  %w = alloca [{size} x double], align 32"] * bool(size)
    if len(blocks) == 1:
        return [begin, *work, *writer.block(blocks[0]), "  ret void", "}"]
    lines, given = [], arguments(function, "ptr %w")
    for k, block in enumerate(blocks):
        lines += [f"define internal void @self_{k}({given}) nounwind {{", *writer.block(block), "  ret void", "}"]
    calls = [f"  call void @self_{k}({given})" for k in range(len(blocks))]
    return [*lines, begin, *work, *calls, "  ret void", "}"]


def is_casadis(function: ca.Function) -> bool:
    """Whether machine code surely gives CasADi's numbers to the last bit: no sums over columns, nothing taken together."""
    if function.find_functions():
        return False
    several = {getattr(ca, f"OP_{kind}") for kind in VECTORS}
    return sum(function.instruction_id(k) in several for k in range(function.n_instructions())) < WORTH


def _side_by_side(steps: list[Operation]) -> list[Operation]:
    """The same operations, those of a kind in `VECTORS` next to each other where they do not wait for each other.

    They stay as they are where too few can be taken together.
    """
    waits: list[int] = []  # for so many such operations one after the other
    for step in steps:
        before = [k for k in step.operands if type(k) is int]
        if step.kind == "RESULT":
            assert step.entry is not None
            before.append(step.entry.vector)
        waits.append(max((waits[k] + (steps[k].kind in VECTORS) for k in before), default=0))
    keys = [(wait, step.kind if step.kind in VECTORS else "") for wait, step in zip(waits, steps, strict=True)]
    counts = Counter(key for key in keys if key[1]).values()
    if sum(count for count in counts if count >= TOGETHER) < WORTH:
        return steps
    return reordered(steps, sorted(range(len(steps)), key=keys.__getitem__))


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

    def __init__(
        self, steps: Sequence[Operation], pieces: Blocks, room: dict[int, int], module: Module, *, together: bool
    ) -> None:
        self.steps, self.places, self.room, self.module = steps, pieces.places, room, module
        self.kinds = VECTORS.keys() if together else set()  # of operations that are taken together

    def block(self, block: range) -> list[str]:
        """The instructions of one block."""
        self.within, self.lines, self.loaded = block, [], {}
        self.truths: set[str] = set()
        eight = False
        k = block.start
        while k < block.stop:
            some = self._alike(k)
            eight |= len(some) >= TOGETHER
            if len(some) < TOGETHER:
                self._operation(k)
                some = some[:1]
            else:
                self._together(some)
            for each in some:
                if each in self.places:
                    self._store(f"%s{each}", f"%a{each}", "%w", self.places[each])
            k = some.stop
        return [f"  %e = alloca {SEVERAL.type}, align 64"] * eight + self.lines

    def _alike(self, k: int) -> range:
        """Operations from this one on that can be taken together."""
        kind, last = self.steps[k].kind, k + 1
        while (
            kind in self.kinds
            and last < min(k + (SEVERAL.lanes or 1), self.within.stop)
            and self.steps[last].kind == kind
            and not any(type(x) is int and x >= k for x in self.steps[last].operands)
        ):
            last += 1
        return range(k, last)

    def _together(self, some: range) -> None:
        values = [self._value(self.steps[k].operands[0]) for k in some]
        values += values[:1] * ((SEVERAL.lanes or 1) - len(values))  # beyond those that are there, any: they go nowhere
        name = of_scalars(self.steps[some.start].kind, self.module)
        self.lines.append(f"  call void @{name}(ptr %e, {', '.join(f'double {value}' for value in values)})")
        for i, k in enumerate(some):
            self._load(f"%a{k}", "%e", i)

    def _operation(self, k: int) -> None:
        kind, operands, entry, called = self.steps[k]
        values = [self._value(operand) for operand in operands]
        if kind == "OUTPUT":
            assert entry is not None
            self._store(f"%s{k}", values[0], f"%o{entry.vector}", entry.index)
        elif called is not None:
            self._call(k, called, values)
        elif kind == "RESULT":
            assert entry is not None
            before = self.steps[entry.vector]
            self._load(f"%a{k}", "%w", self.room[entry.vector] + len(before.operands) + entry.index)
        else:
            self.module.kinds.add(kind)
            self.lines += ONE.instructions(k, kind, values, self.truths)

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
