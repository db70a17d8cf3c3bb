"""A CasADi function for every column of its arguments, in LLVM's intermediate language: eight columns at a time.

Every operation is that of the function itself, on eight numbers side by side, so that the bits are the same, but for two
things that would take most of the time: exponentials and their like are those of `lowering.vectors`, and where columns are
summed, eight sums are taken side by side, and added in the end. Nothing depends on where among the eight a column is: where
their number is no multiple of eight, the last eight begin before the others end.

Arguments may be shared by all columns; what follows from these alone is found once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import casadi as ca

from cadet_sym.lowering.instructions import SEVERAL, Module, arguments, counted
from cadet_sym.lowering.operations import Entry, Operation, kinds, operations
from cadet_sym.lowering.vectors import VECTORS, vector

__all__ = ["over_columns", "side_by_side"]

LONGEST = 2000
"""Operations of a function up to which this is worth the time to compile it."""

IN_PLACE = 2
"""Exponentials of a function up to which they are written where they are; of more, each is a call."""

N, LANES = SEVERAL.type, SEVERAL.lanes or 1


def side_by_side(function: ca.Function) -> bool:
    """Whether a function can be written for eight columns at a time."""
    return function.is_a("SXFunction") and function.n_instructions() <= LONGEST and not function.find_functions(0)


def over_columns(
    function: ca.Function, count: int, shared: Sequence[bool], module: Module, summed: Sequence[bool] = ()
) -> str:
    """The name of a function (count, ...), which calls one for so many columns.

    Pointers to what is shared stay. Of what is summed only the sum is written; the function must be one to be taken
    `side_by_side`.
    """
    few = count < LANES
    if side_by_side(function) and (not few or any(summed) or not VECTORS.keys().isdisjoint(_kinds(function))):
        summed = summed or [False] * function.n_out()
        return module.named(function, (few, *shared, *summed), lambda: _Lanes(function, shared, summed, module, few).text())
    return _one_by_one(function, shared, module)


def _kinds(function: ca.Function) -> set[str]:
    names = kinds()
    return {names[function.instruction_id(k)] for k in range(function.n_instructions())}


def _one_by_one(function: ca.Function, shared: Sequence[bool], module: Module) -> str:
    """The same by calls, one after the other."""
    called = module.name_of(function)
    name = f"{called}.over{''.join(str(int(each)) for each in shared)}"
    if name not in module.loops:
        sizes = [0 if same else function.nnz_in(k) for k, same in enumerate(shared)]
        sizes += [function.nnz_out(k) for k in range(function.n_out())]
        given = arguments(function).split(", ")
        advanced = [line for pointer, size in zip(given, sizes, strict=True) for line in _advanced(pointer[5:], "%k", size)]
        pointers = ", ".join(f"ptr %{pointer[5:]}p" for pointer in given)
        module.loops[name] = counted(name, given, [*advanced, f"  call void @{called}({pointers})"])
    return name


def _advanced(pointer: str, columns: str, size: int, lane: str = "") -> Iterator[str]:
    """Pointer %...p, so many columns further on."""
    yield f"  %{pointer}f{lane} = mul i64 {columns}, {size}"
    yield f"  %{pointer}p{lane} = getelementptr double, ptr %{pointer}, i64 %{pointer}f{lane}"


class _Lanes:
    """Writes the operations on eight columns, or on all if they are fewer; those on shared numbers before the others."""

    def __init__(
        self, function: ca.Function, shared: Sequence[bool], summed: Sequence[bool], module: Module, few: bool
    ) -> None:
        self.function, self.shared, self.summed, self.module, self.few = function, shared, summed, module, few
        self.steps = operations(function)
        self.uses = Counter(step.kind for step in self.steps)
        module.kinds.update(self.uses.keys() - VECTORS.keys())
        self.before: list[str] = []
        self.lines: list[str] = []
        self.loaded: dict[Entry, str] = {}
        self.same: set[int] = set()  # operations on shared numbers alone
        self.truths: set[str] = set()
        self.sums: list[tuple[int, Entry]] = []  # the operation that gives what is summed, and where that belongs

    def text(self) -> list[str]:
        for k, step in enumerate(self.steps):
            if step.kind == "OUTPUT":
                self._output(k, step)
            else:
                self._operation(k, step)
        head = f"define internal void @self(i64 %count, {arguments(self.function)}) nounwind {{"
        columns = self._once() if self.few else self._loop()
        ends = [line for k, entry in self.sums for line in _total(k, entry)]
        return [head, "start:", *self.before, *columns, *ends, "  ret void", "}"]

    # -- the columns ------------------------------------------------------------------------------------------

    def _loop(self) -> Iterator[str]:
        """Eight by eight; the last eight begin where eight are left, and of them what is new is summed."""
        yield f"  %last = sub i64 %count, {LANES}"
        yield "  br label %columns"
        yield "columns:"
        yield "  %k = phi i64 [0, %start], [%next, %columns]"
        yield from (f"  %b{k} = phi {N} [zeroinitializer, %start], [%t{k}, %columns]" for k, _ in self.sums)
        yield "  %few = icmp sgt i64 %k, %last"
        yield "  %first = select i1 %few, i64 %last, i64 %k"
        yield "  %again = sub i64 %k, %first"
        yield from self._new("sge", "%again")
        yield from self._pointers("%first")
        yield from self.lines
        yield f"  %next = add i64 %k, {LANES}"
        yield "  %more = icmp slt i64 %next, %count"
        yield "  br i1 %more, label %columns, label %end"
        yield "end:"

    def _once(self) -> Iterator[str]:
        """All of them, fewer than eight: the others of the eight are the last one again."""
        yield from (f"  %b{k} = select i1 true, {N} zeroinitializer, {N} zeroinitializer" for k, _ in self.sums)
        yield from self._new("slt", "%count")
        yield "  %last = sub i64 %count, 1"
        for i in range(LANES):
            yield f"  %m{i} = icmp slt i64 {i}, %count"
            yield f"  %j{i} = select i1 %m{i}, i64 {i}, i64 %last"
            yield from self._pointers(f"%j{i}", str(i))
        yield from self.lines

    def _new(self, comparison: str, bound: str) -> Iterator[str]:
        """Which of the eight are to be summed."""
        if self.sums:
            yield from _everywhere("%known", "i64", bound)
            yield f"  %new = icmp {comparison} {SEVERAL.of('i64')} <{', '.join(f'i64 {i}' for i in range(LANES))}>, %known"

    def _pointers(self, first: str, lane: str = "") -> Iterator[str]:
        """To what one column or eight have of the arguments and results."""
        for k, same in enumerate(self.shared):
            if not same:
                yield from _advanced(f"i{k}", first, self.function.nnz_in(k), lane)
        for k, only_sum in enumerate(self.summed):
            if not only_sum:
                yield from _advanced(f"o{k}", first, self.function.nnz_out(k), lane)

    def _place(self, register: str, vector: str, index: int, size: int, i: int) -> str:
        """A pointer to an entry of one of the eight."""
        pointer, offset = (f"%{vector}p{i}", index) if self.few else (f"%{vector}p", index + i * size)
        return f"  {register} = getelementptr double, ptr {pointer}, i64 {offset}"

    # -- operations -------------------------------------------------------------------------------------------

    def _operation(self, k: int, step: Operation) -> None:
        values = [self._value(operand) for operand in step.operands]
        if all(self._is_same(operand) for operand in step.operands):
            self.same.add(k)
        lines = self.before if k in self.same else self.lines
        if step.kind in VECTORS:
            lines += vector(k, step.kind, values[0], self.module, in_place=not self.few and self.uses[step.kind] <= IN_PLACE)
        else:
            lines += SEVERAL.instructions(k, step.kind, values, self.truths)

    def _is_same(self, operand: int | float | Entry) -> bool:
        if isinstance(operand, Entry):
            return self.shared[operand.vector]
        return operand in self.same if type(operand) is int else True

    def _value(self, operand: int | float | Entry) -> str:
        if not isinstance(operand, Entry):
            return f"%a{operand}" if type(operand) is int else SEVERAL.constant(operand)
        if operand not in self.loaded:
            self.loaded[operand] = register = f"%l{len(self.loaded)}"
            if self.shared[operand.vector]:
                self.before += _load_shared(register, operand)
            else:
                self.lines += self._load(register, operand)
        return self.loaded[operand]

    def _load(self, register: str, entry: Entry) -> Iterator[str]:
        size, so_far = self.function.nnz_in(entry.vector), "poison"
        if size == 1 and not self.few:
            yield f"  {register} = load {N}, ptr %i{entry.vector}p, align 8"
            return
        for i in range(LANES):
            there = register if i == LANES - 1 else f"{register}.{i}"
            yield self._place(f"{register}p{i}", f"i{entry.vector}", entry.index, size, i)
            yield f"  {register}v{i} = load double, ptr {register}p{i}"
            yield f"  {there} = insertelement {N} {so_far}, double {register}v{i}, i64 {i}"
            so_far = there

    def _output(self, k: int, step: Operation) -> None:
        entry, value = step.entry, self._value(step.operands[0])
        assert entry is not None
        if self.summed[entry.vector]:
            self.sums.append((k, entry))
            self.lines.append(f"  %n{k} = select {SEVERAL.truth} %new, {N} {value}, {N} zeroinitializer")
            self.lines.append(f"  %t{k} = fadd {N} %b{k}, %n{k}")
        else:
            self.lines += self._store(k, entry, value)

    def _store(self, k: int, entry: Entry, value: str) -> Iterator[str]:
        size = self.function.nnz_out(entry.vector)
        if size == 1 and not self.few:
            yield f"  store {N} {value}, ptr %o{entry.vector}p, align 8"
            return
        for i in range(LANES):
            yield f"  %f{k}.{i} = extractelement {N} {value}, i64 {i}"
            yield self._place(f"%s{k}.{i}", f"o{entry.vector}", entry.index, size, i)
            yield f"  store double %f{k}.{i}, ptr %s{k}.{i}"


def _everywhere(register: str, one: str, value: str) -> Iterator[str]:
    """A number eight times."""
    every = SEVERAL.of(one)
    yield f"  {register}i = insertelement {every} poison, {one} {value}, i64 0"
    yield f"  {register} = shufflevector {every} {register}i, {every} poison, <{LANES} x i32> zeroinitializer"


def _load_shared(register: str, entry: Entry) -> Iterator[str]:
    yield f"  {register}p = getelementptr double, ptr %i{entry.vector}, i64 {entry.index}"
    yield f"  {register}v = load double, ptr {register}p"
    yield from _everywhere(register, "double", f"{register}v")


def _reordered(register: str, count: int, value: str, which: Sequence[int]) -> str:
    """Some of so many numbers."""
    order = ", ".join(f"i32 {i}" for i in which)
    return f"  {register} = shufflevector <{count} x double> {value}, <{count} x double> poison, <{len(which)} x i32> <{order}>"


def _total(k: int, entry: Entry) -> Iterator[str]:
    """What is left of eight sums: half of them added to the others, and again."""
    value, count = f"%t{k}", LANES
    while count > 1:
        half = count // 2
        low, high = f"%g{k}.{half}", f"%h{k}.{half}"
        yield _reordered(low, count, value, range(half))
        yield _reordered(high, count, value, range(half, count))
        value, count = f"%u{k}.{half}", half
        yield f"  {value} = fadd <{half} x double> {low}, {high}"
    yield f"  %v{k} = extractelement <1 x double> {value}, i64 0"
    yield f"  %w{k} = getelementptr double, ptr %o{entry.vector}, i64 {entry.index}"
    yield f"  store double %v{k}, ptr %w{k}"
