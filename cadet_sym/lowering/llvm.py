"""Write a CasADi function of scalars in LLVM's intermediate language.

One instruction an operation, in CasADi's order and without licence to change the arithmetic, so that machine code gives
CasADi's own numbers to the last bit. The function takes a pointer for every argument and every result.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import casadi as ca

from cadet_sym.lowering.operations import Blocks, Entry, Operation, cut, operations

__all__ = ["BLOCK", "counted", "intermediate", "literal", "repeated"]

BLOCK = 1000
"""Operations of one block; the time to compile it grows faster than its length."""

ARITHMETIC: Mapping[str, str] = {
    "ADD": "fadd double {0}, {1}",
    "SUB": "fsub double {0}, {1}",
    "MUL": "fmul double {0}, {1}",
    "DIV": "fdiv double {0}, {1}",
    "NEG": "fneg double {0}",
    "SQ": "fmul double {0}, {0}",
    "TWICE": "fadd double {0}, {0}",
    "INV": "fdiv double 1.0, {0}",
    "SQRT": "call double @llvm.sqrt.f64(double {0})",
    "FABS": "call double @llvm.fabs.f64(double {0})",
    "COPYSIGN": "call double @llvm.copysign.f64(double {0}, double {1})",
    "FLOOR": "call double @llvm.floor.f64(double {0})",
    "CEIL": "call double @llvm.ceil.f64(double {0})",
}

COMPARISONS: Mapping[str, str] = {"LT": "olt", "LE": "ole", "EQ": "oeq", "NE": "une"}

FUNCTIONS: Mapping[str, str] = {
    # of the C library, by CasADi's names
    "POW": "pow",
    "CONSTPOW": "pow",
    "FMIN": "fmin",
    "FMAX": "fmax",
    "ATAN2": "atan2",
    "FMOD": "fmod",
    "REMAINDER": "remainder",
    "HYPOT": "hypot",
    **{
        name.upper(): name
        for name in (
            *("exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"),
            *("asinh", "acosh", "atanh", "erf", "expm1", "log1p"),
        )
    },
}

TWO_OPERANDS = {"pow", "fmin", "fmax", "atan2", "fmod", "remainder", "hypot"}


def literal(value: float) -> str:
    """A number to its last bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def intermediate(function: ca.Function, name: str) -> str:
    """The function as LLVM's text, under a name.

    Raises
    ------
    ValueError
        If the function is not made of operations in scalars, or one of them is not known here.
    """
    steps = operations(function)
    pieces = cut(steps, BLOCK)
    pointers = [f"%i{k}" for k in range(function.n_in())] + [f"%o{k}" for k in range(function.n_out())]
    blocks = len(pieces.ranges)
    head = ", ".join(f"ptr {x}" for x in pointers)
    texts = [*_declarations(steps)]
    for k, block in enumerate(pieces.ranges):
        scope = "internal " if blocks > 1 else ""
        own, more = (f"{name}_{k}", ", ptr %w") if blocks > 1 else (name, "")
        texts += [f"define {scope}void @{own}({head}{more}) nounwind {{", *_block(steps, block, pieces), "  ret void", "}"]
    if blocks > 1:
        texts += [f"define void @{name}({head}) nounwind {{", f"  %w = alloca [{max(pieces.scratch, 1)} x double], align 32"]
        texts += [f"  call void @{name}_{k}({head}, ptr %w)" for k in range(blocks)]
        texts += ["  ret void", "}"]
    return "\n".join(texts) + "\n"


def repeated(function: ca.Function, name: str) -> str:
    """The function under a name, and as NAME_over(count, ...) at so many places: all but its last argument go on with them.

    Raises
    ------
    ValueError
        See `intermediate`.
    """
    inputs, outputs = range(function.n_in()), range(function.n_out())
    sizes = [function.nnz_in(k) for k in inputs[:-1]] + [0] + [function.nnz_out(k) for k in outputs]
    pointers = [f"%i{k}" for k in inputs] + [f"%o{k}" for k in outputs]
    here = []
    for k, (pointer, size) in enumerate(zip(pointers, sizes, strict=True)):
        here += [f"  %f{k} = mul i64 %k, {size}", f"  %p{k} = getelementptr double, ptr {pointer}, i64 %f{k}"]
    here.append(f"  call void @{name}({', '.join(f'ptr %p{k}' for k in range(len(pointers)))})")
    return intermediate(function, name) + counted(f"{name}_over", [f"ptr {each}" for each in pointers], here)


def counted(name: str, arguments: Sequence[str], body: Sequence[str]) -> str:
    """The text of a function of (i64 %count, ...) that does the same for every %k from 0 to %count - 1."""
    lines = [
        f"define void @{name}({', '.join(['i64 %count', *arguments])}) nounwind {{",
        "start:",
        "  br label %test",
        "test:",
        "  %k = phi i64 [0, %start], [%next, %body]",
        "  %more = icmp slt i64 %k, %count",
        "  br i1 %more, label %body, label %end",
        "body:",
        *body,
        "  %next = add i64 %k, 1",
        "  br label %test",
        "end:",
        "  ret void",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _declarations(steps: Sequence[Operation]) -> list[str]:
    kinds = {step.kind for step in steps}
    called = {FUNCTIONS[kind] for kind in kinds if kind in FUNCTIONS}
    if kinds & {"SQRT"}:
        called.add("llvm.sqrt.f64")
    called |= {f"llvm.{kind.lower()}.f64" for kind in ("FABS", "FLOOR", "CEIL") if kind in kinds}
    texts = []
    if "COPYSIGN" in kinds:
        texts.append("declare double @llvm.copysign.f64(double, double)")
    for one in sorted(called):
        types = "double, double" if one in TWO_OPERANDS else "double"
        texts.append(f"declare double @{one}({types}) nounwind")
    return texts


def _block(steps: Sequence[Operation], block: range, pieces: Blocks) -> list[str]:
    """The instructions of one block: what it reads is loaded once."""
    lines: list[str] = []
    loaded: dict[object, str] = {}

    def load(key: object, pointer: str, index: int) -> str:
        if key not in loaded:
            register = loaded[key] = f"%l{len(loaded)}"
            lines.append(f"  {register}p = getelementptr double, ptr {pointer}, i64 {index}")
            lines.append(f"  {register} = load double, ptr {register}p")
        return loaded[key]

    def value(operand: int | float | Entry) -> str:
        if isinstance(operand, Entry):
            return load(operand, f"%i{operand.vector}", operand.index)
        if type(operand) is not int:
            return literal(operand)
        return f"%a{operand}" if operand in block else load(operand, "%w", pieces.places[operand])

    def store(k: int, text: str, pointer: str, index: int) -> None:
        lines.append(f"  %s{k} = getelementptr double, ptr {pointer}, i64 {index}")
        lines.append(f"  store double {text}, ptr %s{k}")

    for k in block:
        kind, operands, written = steps[k]
        values = [value(operand) for operand in operands]
        if written is not None:
            store(k, values[0], f"%o{written.vector}", written.index)
            continue
        lines += _instructions(k, kind, values)
        if k in pieces.places:
            store(k, f"%a{k}", "%w", pieces.places[k])
    return lines


def _instructions(k: int, kind: str, x: Sequence[str]) -> list[str]:
    """Register %a<k> from its operands."""
    if kind in ARITHMETIC:
        return [f"  %a{k} = {ARITHMETIC[kind].format(*x)}"]
    if kind in FUNCTIONS:
        given = ", ".join(f"double {each}" for each in x)  # nobuiltin: the very function, not what LLVM takes it for
        return [f"  %a{k} = call double @{FUNCTIONS[kind]}({given}) nobuiltin"]
    if kind in COMPARISONS:
        return [f"  %c{k} = fcmp {COMPARISONS[kind]} double {x[0]}, {x[1]}", f"  %a{k} = uitofp i1 %c{k} to double"]
    if kind in ("AND", "OR"):
        return [
            f"  %c{k} = fcmp une double {x[0]}, 0.0",
            f"  %d{k} = fcmp une double {x[1]}, 0.0",
            f"  %e{k} = {kind.lower()} i1 %c{k}, %d{k}",
            f"  %a{k} = uitofp i1 %e{k} to double",
        ]
    if kind == "NOT":
        return [f"  %c{k} = fcmp oeq double {x[0]}, 0.0", f"  %a{k} = uitofp i1 %c{k} to double"]
    if kind == "IF_ELSE_ZERO":
        return [f"  %c{k} = fcmp une double {x[0]}, 0.0", f"  %a{k} = select i1 %c{k}, double {x[1]}, double 0.0"]
    if kind == "SIGN":  # of zero and of what is no number: itself
        return [
            f"  %c{k} = fcmp olt double {x[0]}, 0.0",
            f"  %d{k} = fcmp ogt double {x[0]}, 0.0",
            f"  %e{k} = select i1 %d{k}, double 1.0, double {x[0]}",
            f"  %a{k} = select i1 %c{k}, double -1.0, double %e{k}",
        ]
    if kind in ("ASSIGN", "LIFT"):
        return [f"  %a{k} = select i1 true, double {x[0]}, double 0.0"]
    raise ValueError(f"the operation `{kind.lower()}` has no machine code")
