"""LLVM's intermediate language, a piece at a time: numbers, single operations by CasADi's names, loops.

No licence is given to change the arithmetic, so that machine code gives CasADi's own numbers to the last bit.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

import casadi as ca

__all__ = ["PRELUDE", "Module", "arguments", "counted", "declarations", "instructions", "literal"]


class Module(Protocol):
    """What is written along with a function."""

    kinds: set[str]  # of operations on numbers
    loops: dict[str, str]  # texts of loops, by name

    def name_of(self, function: ca.Function) -> str:
        """The name of a function that is called, which is written if it is not yet."""
        ...



PRELUDE = """declare ptr @malloc(i64)
declare void @free(ptr)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
"""
"""What every module may call."""

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


def arguments(function: ca.Function, *more: str) -> str:
    """Pointers to the entries of all arguments, then of all results."""
    pointers = [f"ptr %i{k}" for k in range(function.n_in())] + [f"ptr %o{k}" for k in range(function.n_out())]
    return ", ".join([*pointers, *more])


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


def declarations(kinds: Iterable[str]) -> list[str]:
    """Of the functions that operations of these kinds call."""
    kinds = set(kinds)
    called = {FUNCTIONS[kind] for kind in kinds if kind in FUNCTIONS}
    called |= {f"llvm.{kind.lower()}.f64" for kind in ("SQRT", "FABS", "FLOOR", "CEIL") if kind in kinds}
    texts = []
    if "COPYSIGN" in kinds:
        texts.append("declare double @llvm.copysign.f64(double, double)")
    for one in sorted(called):
        types = "double, double" if one in TWO_OPERANDS else "double"
        texts.append(f"declare double @{one}({types}) nounwind")
    return texts


def instructions(k: int, kind: str, x: Sequence[str]) -> list[str]:
    """Register %a<k> from its operands.

    Raises
    ------
    ValueError
        If the operation is not known here.
    """
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
