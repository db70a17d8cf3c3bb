"""LLVM's intermediate language, a piece at a time: numbers, single operations by CasADi's names, loops.

No licence is given to change the arithmetic, so that machine code gives CasADi's own numbers to the last bit, but for
exponentials and their like that are taken several at a time (`lowering.vectors`) and sums over columns (`lowering.lanes`).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as ca

__all__ = ["ONE", "PRELUDE", "SEVERAL", "Module", "Numbers", "arguments", "counted", "declarations", "literal"]


class Module(Protocol):
    """What is written along with a function."""

    kinds: set[str]  # of operations on numbers
    loops: dict[str, str]  # texts of loops, by name

    def name_of(self, function: ca.Function) -> str:
        """The name of a function that is called, which is written if it is not yet."""
        ...

    def named(self, function: ca.Function, variant: tuple[int, ...], write: Callable[[], list[str]]) -> str:
        """The same of what makes use of that function in one way or another."""
        ...



PRELUDE = """declare ptr @malloc(i64)
declare void @free(ptr)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
"""
"""What every module may call."""

ARITHMETIC: Mapping[str, str] = {
    # N stands for the type of the numbers
    "ADD": "fadd N {0}, {1}",
    "SUB": "fsub N {0}, {1}",
    "MUL": "fmul N {0}, {1}",
    "DIV": "fdiv N {0}, {1}",
    "NEG": "fneg N {0}",
    "SQ": "fmul N {0}, {0}",
    "TWICE": "fadd N {0}, {0}",
    "INV": "fdiv N 1.0, {0}",
}

INTRINSICS: Mapping[str, str] = {
    "SQRT": "sqrt",
    "FABS": "fabs",
    "COPYSIGN": "copysign",
    "FLOOR": "floor",
    "CEIL": "ceil",
    "FMIN": "minnum",
    "FMAX": "maxnum",
    "FMA": "fmuladd",  # a b + c, in one rounding where the processor has that; no operation of CasADi's
}

COMPARISONS: Mapping[str, str] = {"LT": "olt", "LE": "ole", "EQ": "oeq", "NE": "une"}

FUNCTIONS: Mapping[str, str] = {
    # of the C library, by CasADi's names
    "POW": "pow",
    "CONSTPOW": "pow",
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

OPERANDS: Mapping[str, int] = {
    # where there is not one
    **dict.fromkeys(("copysign", "minnum", "maxnum", "pow", "atan2", "fmod", "remainder", "hypot"), 2),
    "fmuladd": 3,
}


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
    called = {}
    for kind in set(kinds) & FUNCTIONS.keys():
        called[FUNCTIONS[kind]] = _declaration(FUNCTIONS[kind], FUNCTIONS[kind], "double")
    for kind in set(kinds) & INTRINSICS.keys():
        for numbers in (ONE, SEVERAL):
            name = f"llvm.{INTRINSICS[kind]}.{numbers.suffix}"
            called[name] = _declaration(name, INTRINSICS[kind], numbers.type)
    return [called[name] for name in sorted(called)]


def _declaration(name: str, function: str, type: str) -> str:
    return f"declare {type} @{name}({', '.join([type] * OPERANDS.get(function, 1))}) nounwind"


@dataclass(frozen=True)
class Numbers:
    """One number, or several side by side on which the processor works at once."""

    lanes: int | None = None

    @property
    def type(self) -> str:
        """LLVM's name of it."""
        return self.of("double")

    @property
    def truth(self) -> str:
        """The same of what is true or false."""
        return self.of("i1")

    @property
    def suffix(self) -> str:
        """What names of LLVM's own functions end with."""
        return "f64" if self.lanes is None else f"v{self.lanes}f64"

    def of(self, one: str) -> str:
        """Of numbers of another type as many."""
        return one if self.lanes is None else f"<{self.lanes} x {one}>"

    def constant(self, value: float) -> str:
        """A number, everywhere the same."""
        return literal(value) if self.lanes is None else self.same(f"double {literal(value)}")

    def same(self, one: str) -> str:
        """Of several numbers: one everywhere, after its type."""
        return f"<{', '.join([one] * (self.lanes or 1))}>"

    def instructions(self, k: int | str, kind: str, x: Sequence[str], truths: set[str] | None = None) -> list[str]:
        """Register %a<k> from its operands.

        What is true or false is 1 or 0 there as it is in CasADi, and in register %e<k> as a truth; `truths` are those
        registers %a of which that is known, to which this one is added.

        Raises
        ------
        ValueError
            If the operation is not known here.
        """
        N, B, zero = self.type, self.truth, self.constant(0.0)
        if kind in ARITHMETIC:
            text = ARITHMETIC[kind].replace(" N ", f" {N} ").replace("1.0", self.constant(1.0))
            return [f"  %a{k} = {text.format(*x)}"]
        if kind in INTRINSICS:
            given = ", ".join(f"{N} {each}" for each in x)
            return [f"  %a{k} = call {N} @llvm.{INTRINSICS[kind]}.{self.suffix}({given})"]
        if kind in FUNCTIONS:
            return self._calls(k, FUNCTIONS[kind], x)
        truths = set() if truths is None else truths
        if kind in COMPARISONS or kind in ("AND", "OR", "NOT"):
            made = [f"  %e{k} = fcmp {COMPARISONS[kind]} {N} {x[0]}, {x[1]}"] if kind in COMPARISONS else []
            if not made:
                made, known = self._as_truths(k, x, truths)
                true = "true" if self.lanes is None else self.same("i1 true")
                operation, other = ("xor", true) if kind == "NOT" else (kind.lower(), known[-1])
                made.append(f"  %e{k} = {operation} {B} {known[0]}, {other}")
            truths.add(f"%a{k}")
            return [*made, f"  %a{k} = uitofp {B} %e{k} to {N}"]
        if kind == "IF_ELSE_ZERO":
            made, known = self._as_truths(k, x[:1], truths)
            return [*made, f"  %a{k} = select {B} {known[0]}, {N} {x[1]}, {N} {zero}"]
        if kind == "SIGN":  # of zero and of what is no number: itself
            return [
                f"  %c{k} = fcmp olt {N} {x[0]}, {zero}",
                f"  %d{k} = fcmp ogt {N} {x[0]}, {zero}",
                f"  %e{k} = select {B} %d{k}, {N} {self.constant(1.0)}, {N} {x[0]}",
                f"  %a{k} = select {B} %c{k}, {N} {self.constant(-1.0)}, {N} %e{k}",
            ]
        if kind in ("ASSIGN", "LIFT"):
            return [f"  %a{k} = select i1 true, {N} {x[0]}, {N} {zero}"]
        raise ValueError(f"the operation `{kind.lower()}` has no machine code")

    def _as_truths(self, k: int | str, x: Sequence[str], truths: set[str]) -> tuple[list[str], list[str]]:
        """Instructions by which numbers are taken as truths, and the registers of these."""
        lines, known = [], []
        for j, each in enumerate(x):
            known.append(f"%e{each[2:]}" if each in truths else f"%{'cd'[j]}{k}")
            if each not in truths:
                lines.append(f"  {known[-1]} = fcmp une {self.type} {each}, {self.constant(0.0)}")
        return lines, known

    def _calls(self, k: int | str, name: str, x: Sequence[str]) -> list[str]:
        """Of a function of the C library; nobuiltin: the very function, not what LLVM takes it for."""
        if self.lanes is None:
            return [f"  %a{k} = call double @{name}({', '.join(f'double {each}' for each in x)}) nobuiltin"]
        lines, so_far = [], "poison"
        for i in range(self.lanes):
            own = [f"%f{k}.{i}.{j}" for j in range(len(x))]
            lines += [f"  {one} = extractelement {self.type} {each}, i64 {i}" for one, each in zip(own, x, strict=True)]
            lines.append(f"  %v{k}.{i} = call double @{name}({', '.join(f'double {one}' for one in own)}) nobuiltin")
            there = f"%a{k}" if i == self.lanes - 1 else f"%g{k}.{i}"
            lines.append(f"  {there} = insertelement {self.type} {so_far}, double %v{k}.{i}, i64 {i}")
            so_far = there
        return lines


ONE, SEVERAL = Numbers(), Numbers(8)
