"""CasADi's graphs of matrices in LLVM's intermediate language, and its functions that call others many times or by choice.

An operation on many entries is a loop, and so is the call of a function for every column.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from cadet_sym.lowering.instructions import Module, arguments, counted, literal
from cadet_sym.lowering.lanes import over_columns, side_by_side
from cadet_sym.lowering.matrices import Matrices, of_entries

__all__ = ["choice", "graph", "mapped"]

LARGEST = 4096
"""Numbers that a function may keep on the stack."""

WIDEST = 64
"""Numbers that are added to others at once ..."""

TOGETHER = 8
"""... for so many columns: a processor adds them side by side, where each has to wait for the one before it."""

PLACE = (
    "  %a = getelementptr i64, ptr %at, i64 %k",
    "  %i = load i64, ptr %a",
    "  %o = getelementptr double, ptr %out, i64 %i",
    "  %p = getelementptr double, ptr %x, i64 %k",
    "  %v = load double, ptr %p",
)
"""Of a loop: %o is the place at_k of out, %v is x_k."""

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
    # out_(at_k) = x_k
    "put": counted("put", ("ptr %out", "ptr %x", "ptr %at"), [*PLACE, "  store double %v, ptr %o"]),
    # out_(at_k) += x_k
    "added": counted(
        "added",
        ("ptr %out", "ptr %x", "ptr %at"),
        [*PLACE, "  %before = load double, ptr %o", "  %sum = fadd double %before, %v", "  store double %sum, ptr %o"],
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


def graph(function: ca.Function, module: Module) -> list[str]:
    """The lines of `@self`, a function of matrices.

    Raises
    ------
    ValueError
        If it makes use of something not known here.
    """
    return _Graph(function, module).text()


class _Graph(Matrices):
    """Writes them as calls of functions and loops."""

    language = "machine code"

    def __init__(self, function: ca.Function, module: Module) -> None:
        super().__init__(function)
        self.module = module
        self.tables: list[str] = []
        self.count = 0

    def text(self) -> list[str]:
        self.walk()
        begin, end = f"  %w = alloca [{self.used} x double], align 32", []
        if self.used > LARGEST:
            begin, end = f"  %w = call ptr @malloc(i64 {8 * self.used})", ["  call void @free(ptr %w)"]
        head = f"define internal void @self({arguments(self.function)}) nounwind {{"
        return [*self.tables, head, *[begin] * bool(self.used), *self.lines, *end, "  ret void", "}"]

    def can_sum(self, function: ca.Function) -> bool:
        return side_by_side(function)

    def pointer(self, pointer: str, first: int) -> str:
        self.count += 1
        self.lines.append(f"  %x{self.count} = getelementptr double, ptr {_register(pointer)}, i64 {first}")
        return f"%x{self.count}"

    def numbers(self, values: Sequence[float]) -> str:
        return self._table(f"[{len(values)} x double] [{', '.join(f'double {literal(value)}' for value in values)}]")

    def copy(self, there: str, x: str, size: int) -> None:
        given = f"ptr {_register(there)}, ptr {_register(x)}, i64 {8 * size}"
        self.lines.append(f"  call void @llvm.memcpy.p0.p0.i64({given}, i1 false)")

    def tile(self, count: int, there: str, x: str, size: int) -> None:
        self._loop("tiled", count, there, x, f"i64 {size}")

    def pick(self, which: Sequence[int], there: str, x: str) -> None:
        self._loop("picked", len(which), there, x, self._places(which))

    def put(self, which: Sequence[int], there: str, x: str, *, adds: bool) -> None:
        self._loop("added" if adds else "put", len(which), there, x, self._places(which))

    def add_up(self, count: int, there: str, x: str, size: int) -> None:
        self._only(0 < size <= WIDEST, f"so many numbers as {size} are added to others")
        self.module.loops[f"summed.{size}"] = _summed(size)
        self.lines.append(f"  call void @llvm.memset.p0.i64(ptr {_register(there)}, i8 0, i64 {8 * size}, i1 false)")
        self._given(f"summed.{size}", count, there, x)

    def multiply(self, shape: tuple[int, int, int], there: str, x: str, y: str) -> None:
        rows, n, columns = shape
        self._only(0 < rows <= WIDEST, f"so many numbers as {rows} are added to others")
        for k in range(0, columns, TOGETHER):
            some = min(TOGETHER, columns - k)
            name = f"multiplied.{rows}.{some}"
            self.module.loops[name] = _multiplied(rows, some)
            self._given(name, n, self._further(there, k * rows), x, self._further(y, k * n))

    def call(self, function: ca.Function, given: Sequence[str], results: Sequence[str]) -> None:
        pointers = ", ".join(f"ptr {_register(each)}" for each in (*given, *results))
        self.lines.append(f"  call void @{self.module.name_of(function)}({pointers})")

    def call_over(
        self, function: ca.Function, count: int, shared: Sequence[bool], summed: Sequence[bool], given: Sequence[str],
        results: Sequence[str],
    ) -> None:
        self._given(over_columns(function, count, shared, self.module, summed), count, *given, *results)

    def operate(self, operation: int, count: int, shared: Sequence[bool], given: Sequence[str], there: str) -> None:
        self._given(over_columns(of_entries(operation, len(given)), count, shared, self.module), count, *given, there)

    def _given(self, name: str, count: int, *pointers: str) -> None:
        """Call a loop."""
        self.lines.append(f"  call void @{name}(i64 {count}, {', '.join(f'ptr {_register(each)}' for each in pointers)})")

    def _loop(self, name: str, count: int, there: str, x: str, more: str) -> None:
        self.module.loops[name] = LOOPS[name]
        self.lines.append(f"  call void @{name}(i64 {count}, ptr {_register(there)}, ptr {_register(x)}, {more})")

    def _places(self, which: Sequence[int]) -> str:
        return f"ptr {self._table(f'[{len(which)} x i64] [' + ', '.join(f'i64 {each}' for each in which) + ']')}"

    def _table(self, values: str) -> str:
        name = f"@self.c{len(self.tables)}"
        self.tables.append(f"{name} = internal constant {values}")
        return name


def _register(pointer: str) -> str:
    """An argument, result or the work array by its name here; pointers to parts and constants have theirs."""
    return pointer if pointer[:1] in ("%", "@") else f"%{pointer}" if pointer else "null"
