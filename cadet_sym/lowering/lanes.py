"""A CasADi function for every column of its arguments, in LLVM's intermediate language: eight columns at a time.

Every operation is that of the function itself, on eight numbers side by side, so that the bits are the same. Arguments may be
shared by all columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca

from cadet_sym.lowering.instructions import SEVERAL, Module, arguments, counted
from cadet_sym.lowering.operations import Entry, Operation, operations

__all__ = ["over_columns"]

LONGEST = 2000
"""Operations of a function up to which this is worth the time to compile it."""


def over_columns(function: ca.Function, shared: Sequence[bool], module: Module) -> str:
    """The name of a function (count, ...), which calls one for so many columns; pointers to what is shared stay."""
    called = module.name_of(function)
    name = f"{called}.over{''.join(str(int(each)) for each in shared)}"
    if name in module.loops:
        return name
    sizes = [0 if same else function.nnz_in(k) for k, same in enumerate(shared)]
    sizes += [function.nnz_out(k) for k in range(function.n_out())]
    lanes = SEVERAL.lanes
    assert lanes is not None
    if not (function.is_a("SXFunction") and function.n_instructions() <= LONGEST and not function.find_functions(0)):
        module.loops[name] = _loop(function, name, called, sizes)
        return name
    given = arguments(function)
    module.loops[f"{name}.one"] = _loop(function, f"{name}.one", called, sizes)
    module.loops[f"{name}.eight"] = _several(function, shared, f"{name}.eight", module)
    module.loops[f"{name}.eights"] = _loop(function, f"{name}.eights", f"{name}.eight", [lanes * size for size in sizes])
    module.loops[name] = "\n".join(
        [
            f"define internal void @{name}(i64 %count, {given}) nounwind {{",
            f"  %times = sdiv i64 %count, {lanes}",
            f"  call void @{name}.eights(i64 %times, {given})",
            f"  %done = mul i64 %times, {lanes}",
            "  %rest = sub i64 %count, %done",
            *_advanced(given, "%done", sizes),
            f"  call void @{name}.one(i64 %rest, {_pointers(len(sizes))})",
            "  ret void",
            "}\n",
        ]
    )
    return name


def _loop(function: ca.Function, name: str, called: str, sizes: Sequence[int]) -> str:
    given = arguments(function)
    call = f"  call void @{called}({_pointers(len(sizes))})"
    return counted(name, given.split(", "), [*_advanced(given, "%k", sizes), call])


def _advanced(given: str, columns: str, sizes: Sequence[int]) -> Iterator[str]:
    """Pointers %p0, %p1, ... so many columns further on."""
    for k, (pointer, size) in enumerate(zip(given.split(", "), sizes, strict=True)):
        yield f"  %f{k} = mul i64 {columns}, {size}"
        yield f"  %p{k} = getelementptr double, {pointer}, i64 %f{k}"


def _pointers(count: int) -> str:
    return ", ".join(f"ptr %p{k}" for k in range(count))


def _several(function: ca.Function, shared: Sequence[bool], name: str, module: Module) -> str:
    """The text of the function for eight columns."""
    steps = operations(function)
    module.kinds.update(step.kind for step in steps)
    lines = [f"define internal void @{name}({arguments(function)}) nounwind {{"]
    loaded: dict[Entry, str] = {}
    for k, step in enumerate(steps):
        values = []
        for operand in step.operands:
            if isinstance(operand, Entry):
                if operand not in loaded:
                    loaded[operand] = f"%l{len(loaded)}"
                    size = 0 if shared[operand.vector] else function.nnz_in(operand.vector)
                    lines += _load(loaded[operand], operand, size)
                values.append(loaded[operand])
            else:
                values.append(f"%a{operand}" if type(operand) is int else SEVERAL.constant(operand))
        if step.kind == "OUTPUT":
            lines += _store(k, step, values[0], function)
        else:
            lines += SEVERAL.instructions(k, step.kind, values)
    return "\n".join([*lines, "  ret void", "}\n"])


def _load(register: str, entry: Entry, size: int) -> Iterator[str]:
    """An entry of eight columns that are so far apart."""
    N, lanes, so_far = SEVERAL.type, SEVERAL.lanes or 1, "poison"
    pointer = f"%i{entry.vector}"
    if size == 1:
        yield f"  {register} = load {N}, ptr {pointer}, align 8"
        return
    if size == 0:
        yield f"  {register}p = getelementptr double, ptr {pointer}, i64 {entry.index}"
        yield f"  {register}v = load double, ptr {register}p"
        yield f"  {register}i = insertelement {N} poison, double {register}v, i64 0"
        yield f"  {register} = shufflevector {N} {register}i, {N} poison, <{lanes} x i32> zeroinitializer"
        return
    for i in range(lanes):
        there = register if i == lanes - 1 else f"{register}.{i}"
        yield f"  {register}p{i} = getelementptr double, ptr {pointer}, i64 {entry.index + i * size}"
        yield f"  {register}v{i} = load double, ptr {register}p{i}"
        yield f"  {there} = insertelement {N} {so_far}, double {register}v{i}, i64 {i}"
        so_far = there


def _store(k: int, step: Operation, value: str, function: ca.Function) -> Iterator[str]:
    """An entry of eight columns of a result."""
    entry, N = step.entry, SEVERAL.type
    assert entry is not None
    size = function.nnz_out(entry.vector)
    if size == 1:
        yield f"  store {N} {value}, ptr %o{entry.vector}, align 8"
        return
    for i in range(SEVERAL.lanes or 1):
        yield f"  %e{k}.{i} = extractelement {N} {value}, i64 {i}"
        yield f"  %s{k}.{i} = getelementptr double, ptr %o{entry.vector}, i64 {entry.index + i * size}"
        yield f"  store double %e{k}.{i}, ptr %s{k}.{i}"
