"""CasADi's graphs of matrices in C, and its functions that call others many times or by choice.

Nothing is unrolled: an operation on many entries is a loop, the call of a function for every column too, and constants are
tables. Sums are taken in CasADi's order, so that the bits are the same. What CasADi's own generator gives for such
functions is several times as long, and hands on integers where pointers belong, which strict compilers refuse.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import casadi as ca

from cadet_sym.export.functions import Calls, Program, call, definition, own_names, signature, sizes_of, taken
from cadet_sym.export.steps import OPERATIONS
from cadet_sym.export.tables import constant
from cadet_sym.lowering.matrices import Matrices
from cadet_sym.lowering.operations import kinds

__all__ = ["choice", "graph", "mapped"]


def graph(function: ca.Function, name: str, calls: Calls) -> Program:
    """Write a function of matrices.

    Raises
    ------
    ValueError
        If it makes use of something not known here.
    """
    return _Graph(function, calls).program(name)


def mapped(function: ca.Function, name: str, calls: Calls) -> Program:
    """Write a function that is called for every column of its arguments."""
    each, count = function.info()["f"], function.info()["n"]
    called, sizes = calls.of(each), sizes_of(each)
    places = [place for names in own_names(function) for place in names]

    def column(k: str) -> list[str]:
        return [call(called, each, [_column(place, size, k) for place, size in zip(places, sizes, strict=True)])]

    body = _over(count, column)
    counts = {kind: count * number for kind, number in called.counts.items()}
    return Program(name, _text(function, name, body), called.scratch, counts, (called.name,))


def choice(function: ca.Function, name: str, calls: Calls) -> Program:
    """Write a function that calls one of several by the number that is its first argument; it costs what the dearest does.

    Raises
    ------
    ValueError
        If these functions do not take and give the same entries.
    """
    info, (inputs, outputs) = function.info(), own_names(function)
    if info["project_in"] or info["project_out"]:
        raise ValueError(f"the functions that `{function.name()}` chooses from differ in their sparsity")
    cases = [calls.of(each) for each in (*info["f"], info["f_def"])]
    last, rest = len(cases) - 1, (*inputs[1:], *outputs)
    body = [f"switch (i0[0] > K(-1.0) && i0[0] < {constant(float(last))} ? (int)i0[0] : {last}) {{"]
    for k, case in enumerate(cases):
        body += [f"case {k}:" if k < last else "default:", f"    {call(case, info['f_def'], rest)}", "    break;"]
    scratch, dearest = max(case.scratch for case in cases), max(cases, key=lambda case: case.operations)
    called = tuple(dict.fromkeys(case.name for case in cases))
    return Program(name, _text(function, name, [*body, "}"]), scratch, dearest.counts, called)


class _Graph(Matrices):
    """Writes instructions as loops and calls."""

    language = "C"

    def __init__(self, function: ca.Function, calls: Calls) -> None:
        super().__init__(function)
        self.calls = calls
        self.counts: Counter[str] = Counter()
        self.called: dict[str, Program] = {}

    def program(self, name: str) -> Program:
        """All of it."""
        self.walk()
        scratch = self.used + max((each.scratch for each in self.called.values()), default=0)
        body = [f"R w[{self.used}];"] * bool(self.used) + self.lines
        counts = {kind: count for kind, count in sorted(self.counts.items()) if kind != "moves"}
        return Program(name, _text(self.function, name, body), scratch, counts, tuple(self.called))

    def can_sum(self, function: ca.Function) -> bool:
        return True

    def pointer(self, pointer: str, first: int) -> str:
        base, _, before = pointer.partition(" + ")
        return f"{base} + {int(before or 0) + first}"

    def numbers(self, values: Sequence[float]) -> str:
        return self.calls.tables.add("R", map(constant, values))

    def copy(self, there: str, x: str, size: int) -> None:
        self.lines += _over(size, lambda k: [f"{_entry(there, k)} = {_entry(x, k)};"])

    def tile(self, count: int, there: str, x: str, size: int) -> None:
        self.lines += _over(
            count, lambda k: _over(size, lambda j: [f"{_entry(there, _row(k, size, j))} = {_entry(x, j)};"], "j")
        )

    def pick(self, which: Sequence[int], there: str, x: str) -> None:
        at = self.calls.tables.add("int", map(str, which))
        self.lines += _over(len(which), lambda k: [f"{_entry(there, k)} = {_entry(x, f'{at}[{k}]')};"])

    def put(self, which: Sequence[int], there: str, x: str, *, adds: bool) -> None:
        at, sign = self.calls.tables.add("int", map(str, which)), "+=" if adds else "="
        self.lines += _over(len(which), lambda k: [f"{_entry(there, f'{at}[{k}]')} {sign} {_entry(x, k)};"])
        self.counts["additions"] += adds * len(which)

    def add_up(self, count: int, there: str, x: str, size: int) -> None:
        self._nothing(there, size)
        self.lines += _over(
            count, lambda k: _over(size, lambda j: [f"{_entry(there, j)} += {_entry(x, _row(k, size, j))};"], "j")
        )
        self.counts["additions"] += count * size

    def multiply(self, shape: tuple[int, int, int], there: str, x: str, y: str) -> None:
        rows, n, columns = shape

        def add(k: str, i: str, j: str) -> str:
            return f"{_entry(there, _row(k, rows, j))} += {_entry(x, _row(i, rows, j))} * {_entry(y, _row(k, n, i))};"

        self.lines += _over(
            columns, lambda k: _over(n, lambda i: _over(rows, lambda j: [add(k, i, j)], "j"), "i")
        )
        self.counts.update({"additions": rows * n * columns, "multiplications": rows * n * columns})

    def call(self, function: ca.Function, given: Sequence[str], results: Sequence[str]) -> None:
        self.lines.append(call(self._called(function, 1), function, (*given, *results)))

    def call_over(
        self, function: ca.Function, count: int, shared: Sequence[bool], summed: Sequence[bool], given: Sequence[str],
        results: Sequence[str],
    ) -> None:
        called = self._called(function, count)
        totals = [(j, there, function.nnz_out(j)) for j, there in enumerate(results) if summed[j]]

        def column(k: str) -> Iterable[str]:
            places = [x if shared[j] else _column(x, function.nnz_in(j), k) for j, x in enumerate(given)]
            places += [f"s{j}" if summed[j] else _column(x, function.nnz_out(j), k) for j, x in enumerate(results)]
            yield from (f"R s{j}[{size}];" for j, _, size in totals)
            yield call(called, function, places)
            for i, there, size in totals:
                yield from _over(size, lambda j, i=i, there=there: [f"{_entry(there, j)} += s{i}[{j}];"], "j")

        for _, there, size in totals:
            self._nothing(there, size)
            self.counts["additions"] += count * size
        lines = _over(count, column)
        self.lines += ["{", *_indented(lines), "}"] if totals and count == 1 else lines

    def operate(self, operation: int, count: int, shared: Sequence[bool], given: Sequence[str], there: str) -> None:
        kind = kinds()[operation]
        self._only(kind in OPERATIONS, f"there is `{kind.lower()}`")
        cost, text = OPERATIONS[kind]

        def one(k: str) -> list[str]:
            operands = [_entry(x, "0" if same else k) for x, same in zip(given, shared, strict=True)]
            return [f"{_entry(there, k)} = {text.format(*operands)};"]

        self.lines += _over(count, one)
        self.counts[cost] += count

    def _nothing(self, there: str, size: int) -> None:
        self.lines += _over(size, lambda k: [f"{_entry(there, k)} = K(0.0);"])

    def _called(self, function: ca.Function, times: int) -> Program:
        called = self.calls.of(function)
        self.called[called.name] = called
        self.counts.update({kind: times * count for kind, count in called.counts.items()})
        return called


def _text(function: ca.Function, name: str, body: Iterable[str]) -> str:
    inputs, outputs = taken(function)
    return definition(f"void {name}", signature(inputs, outputs), (*inputs, *outputs), _indented(body)) + "\n"


def _over(count: int, body: Callable[[str], Iterable[str]], index: str = "k") -> list[str]:
    """Lines for so many values of an index."""
    if count == 1:
        return [*body("0")]
    lines, head = [*body(index)], f"for (int {index} = 0; {index} < {count}; {index}++)"
    if count == 0:
        return []
    return [head, *_indented(lines)] if len(lines) == 1 else [f"{head} {{", *_indented(lines), "}"]


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _entry(pointer: str, index: str) -> str:
    """An entry of what a pointer points to."""
    base, _, first = pointer.partition(" + ")
    if index.isdecimal():
        return f"{base}[{int(first or 0) + int(index)}]"
    return f"{base}[{first} + {index}]" if first else f"{base}[{index}]"


def _row(k: str, size: int, j: str) -> str:
    """The index of entry j of part k."""
    return j if k == "0" else f"{k} + {j}" if size == 1 and j != "0" else k if size == 1 else f"{size} * {k} + {j}"


def _column(pointer: str, size: int, k: str) -> str:
    """A pointer to column k."""
    return pointer if k == "0" or not size else f"{pointer} + {k}" if size == 1 else f"{pointer} + {size} * {k}"
