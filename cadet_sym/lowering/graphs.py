"""CasADi's graphs of matrices in LLVM's intermediate language, and its functions that call others many times or by choice.

What an instruction makes has a place of its own in a work array, or is a part of what is there already. Nothing is
unrolled: an operation on many entries is a loop, and so is the call of a function for every column.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import casadi as ca

from cadet_sym.lowering.instructions import Module, arguments, counted, literal
from cadet_sym.lowering.lanes import over_columns, side_by_side
from cadet_sym.lowering.operations import kinds as names

__all__ = ["choice", "graph", "mapped"]

LARGEST = 4096
"""Numbers that a function may keep on the stack."""

WIDEST = 64
"""Numbers that are added to others at once ..."""

TOGETHER = 8
"""... for so many columns: a processor adds them side by side, where each has to wait for the one before it."""

LOOPS = {
    # out = x x x ...
    "tiled": counted(
        "tiled",
        ("ptr %out", "ptr %x", "i64 %n"),
        [
            "  %f = mul i64 %k, %n",
            "  %p = getelementptr double, ptr %out, i64 %f",
            "  %b = mul i64 %n, 8",
            "  call void @llvm.memcpy.p0.p0.i64(ptr %p, ptr %x, i64 %b, i1 false)",
        ],
    ),
    # out_k = x_(at_k)
    "picked": counted(
        "picked",
        ("ptr %out", "ptr %x", "ptr %at"),
        [
            "  %a = getelementptr i64, ptr %at, i64 %k",
            "  %i = load i64, ptr %a",
            "  %p = getelementptr double, ptr %x, i64 %i",
            "  %v = load double, ptr %p",
            "  %o = getelementptr double, ptr %out, i64 %k",
            "  store double %v, ptr %o",
        ],
    ),
}
"""Loops, by name."""


def _summed(n: int) -> str:
    """@summed.N(count, out, x): out += the sum of N numbers at x, at x + N, at x + 2 N, ..., in this order."""
    return _accumulated(f"summed.{n}", n, 1, weighted=False)


def _multiplied(n: int, columns: int) -> str:
    """@multiplied.N.M(count, out, x, y): the same, each N times their own number of y; for M columns of out and y at once."""
    return _accumulated(f"multiplied.{n}.{columns}", n, columns, weighted=True)


def _accumulated(name: str, n: int, columns: int, *, weighted: bool) -> str:
    vector, every = f"<{n} x double>", range(columns)
    starts = [
        line
        for j in every
        for line in (
            f"  %o{j} = getelementptr double, ptr %out, i64 {j * n}",
            f"  %before{j} = load {vector}, ptr %o{j}, align 8",
            *([f"  %f{j} = mul i64 %count, {j}", f"  %y{j} = getelementptr double, ptr %y, i64 %f{j}"] if weighted else []),
        )
    ]
    adds = []
    for j in every:
        if weighted:
            adds += [
                f"  %q{j} = getelementptr double, ptr %y{j}, i64 %k",
                f"  %w{j} = load double, ptr %q{j}",
                f"  %i{j} = insertelement {vector} poison, double %w{j}, i64 0",
                f"  %s{j} = shufflevector {vector} %i{j}, {vector} poison, <{n} x i32> zeroinitializer",
                f"  %t{j} = fmul {vector} %v, %s{j}",
            ]
        adds.append(f"  %more{j} = fadd {vector} %sum{j}, {f'%t{j}' if weighted else '%v'}")
    lines = [
        f"define internal void @{name}(i64 %count, ptr %out, ptr %x{', ptr %y' * weighted}) nounwind {{",
        "start:",
        *starts,
        "  br label %test",
        "test:",
        "  %k = phi i64 [0, %start], [%next, %body]",
        *(f"  %sum{j} = phi {vector} [%before{j}, %start], [%more{j}, %body]" for j in every),
        "  %go = icmp slt i64 %k, %count",
        "  br i1 %go, label %body, label %end",
        "body:",
        f"  %f = mul i64 %k, {n}",
        "  %p = getelementptr double, ptr %x, i64 %f",
        f"  %v = load {vector}, ptr %p, align 8",
        *adds,
        "  %next = add i64 %k, 1",
        "  br label %test",
        "end:",
        *(f"  store {vector} %sum{j}, ptr %o{j}, align 8" for j in every),
        "  ret void",
        "}",
    ]
    return "\n".join(lines) + "\n"


@cache
def _of_entries(operation: int, operands: int) -> ca.Function:
    """An operation on numbers as a function."""
    x = [ca.SX.sym(f"x{k}") for k in range(operands)]
    return ca.Function("entries", x, [ca.SX.binary(operation, *x) if operands == 2 else ca.SX.unary(operation, *x)])


def mapped(function: ca.Function, module: Module) -> list[str]:
    """The lines of `@self`, a function that is called for every column of its arguments."""
    info = function.info()
    name, given = over_columns(info["f"], info["n"], [False] * function.n_in(), module), arguments(function)
    return [
        f"define internal void @self({given}) nounwind {{",
        f"  call void @{name}(i64 {info['n']}, {given})",
        "  ret void",
        "}",
    ]


def choice(function: ca.Function, module: Module) -> list[str]:
    """The lines of `@self`, which calls one of several functions by the number that is its first argument.

    Raises
    ------
    ValueError
        If these functions do not take and give the same entries.
    """
    info = function.info()
    if info["project_in"] or info["project_out"]:
        raise ValueError(f"the functions that `{function.name()}` chooses from differ in their sparsity")
    cases, given = [*info["f"], info["f_def"]], arguments(function)
    rest = given.partition(", ")[2]
    lines = [
        f"define internal void @self({given}) nounwind {{",
        "  %x = load double, ptr %i0",
        "  %a = fcmp ogt double %x, -1.0",
        f"  %b = fcmp olt double %x, {literal(len(cases) - 1)}",
        "  %c = and i1 %a, %b",
        "  %n = fptosi double %x to i64",
        "  %k = select i1 %c, i64 %n, i64 -1",
        f"  switch i64 %k, label %case{len(cases) - 1} [",
        *(f"    i64 {k}, label %case{k}" for k in range(len(cases) - 1)),
        "  ]",
    ]
    for k, case in enumerate(cases):
        lines += [f"case{k}:", f"  call void @{module.name_of(case)}({rest})", "  ret void"]
    return [*lines, "}"]


def _sums(function: ca.Function) -> dict[int, list[bool]]:
    """Of calls for columns side by side, which results are summed over these and not used otherwise."""
    kind = [names()[function.instruction_id(k)] for k in range(function.n_instructions())]
    holds: dict[int, tuple[int, int]] = {}  # by register: the call and which of its results
    users: dict[tuple[int, int], list[int]] = {}
    for k, name in enumerate(kind):
        for i in function.instruction_input(k) if name != "INPUT" else ():
            if i in holds:
                users[holds[i]].append(k)
        for j, to in enumerate(function.instruction_output(k) if name != "OUTPUT" else ()):
            holds.pop(to, None)
            if name == "CALL":
                holds[to] = k, j
                users[k, j] = []
    found = {}
    for k in {k for k, _ in users}:
        called = function.instruction_MX(k).which_function()
        if called.class_name() == "Map" and side_by_side(each := called.info()["f"]):
            found[k] = []
            for j in range(each.n_out()):
                summed = [kind[i] == "HORZREPSUM" and function.instruction_MX(i).nnz() == each.nnz_out(j) for i in users[k, j]]
                found[k].append(summed == [True])
    return found


def graph(function: ca.Function, module: Module) -> list[str]:
    """The lines of `@self`, a function of matrices.

    Raises
    ------
    ValueError
        If it makes use of something not known here.
    """
    return _Graph(function, module).text()


class _Graph:
    """Writes the instructions one after the other."""

    def __init__(self, function: ca.Function, module: Module) -> None:
        self.function, self.module = function, module
        self.lines: list[str] = []
        self.tables: list[str] = []
        self.used, self.count = 0, 0
        self.at: dict[int, str] = {}  # what CasADi has in a register: a pointer ...
        self.size: dict[int, int] = {}  # ... to so many numbers,
        self.tiled: dict[int, tuple[str, int]] = {}  # or one to fewer that are there again and again
        self.summed: set[int] = set()  # or one to the sum of what CasADi has there
        self.sums = _sums(function)
        self.written = [0] * function.n_out()

    def text(self) -> list[str]:
        for k in range(self.function.n_instructions()):
            self.operation = self.function.instruction_id(k)
            kind = names()[self.operation]
            read, into = self.function.instruction_input(k), self.function.instruction_output(k)
            if kind == "OUTPUT":
                self._output(read[0], into[0])
                continue
            node = self.function.instruction_MX(k)
            write = getattr(self, f"_of_{kind.lower()}", None)
            if kind == "CALL":
                self._call(k, node.which_function(), read, into)
            elif write is not None:
                write(node, read, into)
            else:
                self._entries(kind, node, read, into)
        begin, end = f"  %w = alloca [{self.used} x double], align 32", []
        if self.used > LARGEST:
            begin, end = f"  %w = call ptr @malloc(i64 {8 * self.used})", ["  call void @free(ptr %w)"]
        head = f"define internal void @self({arguments(self.function)}) nounwind {{"
        return [*self.tables, head, *[begin] * bool(self.used), *self.lines, *end, "  ret void", "}"]

    # -- instructions -----------------------------------------------------------------------------------------

    def _of_input(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._part(into[0], f"%i{read[0]}", node.info()["offset"], node.nnz())

    def _output(self, of: int, result: int) -> None:
        there = self._pointer(f"%o{result}", self.written[result])
        self._copy(there, self._whole(of), self.size[of])
        self.written[result] += self.size[of]

    def _of_const(self, node: ca.MX, _: list[int], into: list[int]) -> None:
        values = node.to_DM().nonzeros()
        numbers = ", ".join(f"double {literal(value)}" for value in values)
        self._part(into[0], self._table(f"[{len(values)} x double] [{numbers}]"), 0, len(values))

    def _call(self, k: int, called: ca.Function, read: list[int], into: list[int]) -> None:
        summed = self.sums.get(k, [False] * len(into))
        if called.class_name() == "Map":  # what is the same in every column need not be there for each
            info = called.info()
            each, count = info["f"], info["n"]
            shared = [i in self.tiled and self.tiled[i][1] == each.nnz_in(j) for j, i in enumerate(read)]
            name, first = over_columns(each, count, shared, self.module, summed), f"i64 {count}, "
            given = [self.tiled[i][0] if same else self._whole(i) for i, same in zip(read, shared, strict=True)]
            sizes = [called.nnz_out(j) // count if total else called.nnz_out(j) for j, total in enumerate(summed)]
        else:
            name, first, given = self.module.name_of(called), "", [self._whole(i) for i in read]
            sizes = [called.nnz_out(j) for j in range(len(into))]
        results = [self._new(to, size) for to, size in zip(into, sizes, strict=True)]
        self.summed.update(to for to, total in zip(into, summed, strict=True) if total)
        pointers = ", ".join(f"ptr {pointer}" for pointer in [*given, *results])
        self.lines.append(f"  call void @{name}({first}{pointers})")

    def _of_horzsplit(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        parts, first = node.info()["output"], 0
        for j, to in enumerate(into):
            self._part(to, self._whole(read[0]), first, parts.nnz_out(j))
            first += parts.nnz_out(j)

    def _of_vertsplit(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._only(node.dep(0).is_column(), "a matrix is split into rows")
        self._of_horzsplit(node, read, into)

    def _of_horzcat(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        parts, first = [(self._whole(i), self.size[i]) for i in read], 0
        there = self._new(into[0], node.nnz())
        for pointer, size in parts:
            self._copy(self._pointer(there, first), pointer, size)
            first += size

    def _of_vertcat(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._only(node.is_column(), "matrices are put below each other")
        self._of_horzcat(node, read, into)

    def _of_horzrepmat(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        x, n = self._whole(read[0]), self.size[read[0]]
        self._part(into[0], "null", 0, node.nnz())
        self.tiled[into[0]] = x, n

    def _of_horzrepsum(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        x, count, n = self._whole(read[0]), self.size[read[0]], node.nnz()
        if read[0] in self.summed:
            self._part(into[0], x, 0, n)
            return
        there = self._new(into[0], n)
        self.lines.append(f"  call void @llvm.memset.p0.i64(ptr {there}, i8 0, i64 {8 * n}, i1 false)")
        self._only(0 < n <= WIDEST, f"so many numbers as {n} are added to others")
        self.module.loops[f"summed.{n}"] = _summed(n)
        self.lines.append(f"  call void @summed.{n}(i64 {count // n}, ptr {there}, ptr {x})")

    def _of_mtimes(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        (rows, columns), n = node.shape, node.dep(1).shape[1]
        self._only(all(each.is_dense() for each in (node, node.dep(1), node.dep(2))), "sparse matrices are multiplied")
        before, x, y = (self._whole(i) for i in read)
        there = self._new(into[0], node.nnz())
        self._copy(there, before, node.nnz())
        self._only(0 < rows <= WIDEST, f"so many numbers as {rows} are added to others")
        for k in range(0, columns, TOGETHER):
            some = min(TOGETHER, columns - k)
            self.module.loops[f"multiplied.{rows}.{some}"] = _multiplied(rows, some)
            given = self._pointer(there, k * rows), x, self._pointer(y, k * n)
            self.lines.append(f"  call void @multiplied.{rows}.{some}(i64 {n}, ptr {given[0]}, ptr {given[1]}, ptr {given[2]})")

    def _of_reshape(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._part(into[0], self._whole(read[0]), 0, node.nnz())

    def _of_transpose(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        rows, columns = node.shape
        self._only(node.is_dense(), "a sparse matrix is transposed")
        self._pick(read[0], into[0], [i * columns + j for j in range(columns) for i in range(rows)])

    def _of_getnonzeros(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._pick(read[0], into[0], [int(i) for i in node.mapping().nonzeros()])

    def _entries(self, kind: str, node: ca.MX, read: list[int], into: list[int]) -> None:
        """An operation on every entry; one number takes part in all."""
        count = node.nnz()
        sizes = [self.size[i] for i in read]
        self._only(all(size in (1, count) for size in sizes), f"matrices of other sparsity meet in `{kind.lower()}`")
        operation = _of_entries(self.operation, len(read))
        name = over_columns(operation, count, [size != count for size in sizes], self.module)
        given = [self._whole(i) for i in read]
        pointers = ", ".join(f"ptr {each}" for each in (*given, self._new(into[0], count)))
        self.lines.append(f"  call void @{name}(i64 {count}, {pointers})")

    # -- memory -----------------------------------------------------------------------------------------------

    def _new(self, register: int, size: int) -> str:
        """A place of its own; of what is not used the register is negative."""
        there = self._pointer("%w", self.used)
        self.used += size
        self._part(register, there, 0, size)
        return there

    def _part(self, register: int, pointer: str, first: int, size: int) -> None:
        if register >= 0:
            self.at[register], self.size[register] = self._pointer(pointer, first), size
            self.tiled.pop(register, None)
            self.summed.discard(register)

    def _whole(self, register: int) -> str:
        """Where its numbers are, all of them."""
        if register in self.tiled:
            (x, n), size = self.tiled[register], self.size[register]
            self._loop("tiled", size // max(n, 1), self._new(register, size), x, f"i64 {n}")
        return self.at[register]

    def _pointer(self, pointer: str, first: int) -> str:
        if not first:
            return pointer
        self.count += 1
        self.lines.append(f"  %x{self.count} = getelementptr double, ptr {pointer}, i64 {first}")
        return f"%x{self.count}"

    def _copy(self, there: str, pointer: str, size: int) -> None:
        self.lines.append(f"  call void @llvm.memcpy.p0.p0.i64(ptr {there}, ptr {pointer}, i64 {8 * size}, i1 false)")

    def _pick(self, source: int, register: int, which: Sequence[int]) -> None:
        first = which[0] if which else 0
        if list(which) == list(range(first, first + len(which))):
            self._part(register, self._whole(source), first, len(which))
            return
        x, table = self._whole(source), self._table(f"[{len(which)} x i64] [{', '.join(f'i64 {i}' for i in which)}]")
        self._loop("picked", len(which), self._new(register, len(which)), x, f"ptr {table}")

    def _loop(self, name: str, count: int, there: str, x: str, more: str) -> None:
        self.module.loops[name] = LOOPS[name]
        self.lines.append(f"  call void @{name}(i64 {count}, ptr {there}, ptr {x}, {more})")

    def _table(self, values: str) -> str:
        name = f"@self.c{len(self.tables)}"
        self.tables.append(f"{name} = internal constant {values}")
        return name

    def _only(self, fine: bool, otherwise: str) -> None:
        if not fine:
            raise ValueError(f"{otherwise} in `{self.function.name()}`, which has no machine code")
