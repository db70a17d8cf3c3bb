"""SymPy expressions to lines of Python that numba compiles and NumPy runs alike.

The source is written from a closed table of SymPy classes, never from a user's text: names in it are made here
(`x0`, `c3`, `e17`), and a class that is not in the table is refused. What does not depend on the path is taken
out of the lines: expressions in parameters alone become constants `q`, those in time, distance and speed become
coefficients `c` with one value a step, both worked out once for all paths.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy as sp
from sympy.logic.boolalg import Boolean, BooleanAtom

from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, SPEED, SPEED_RATE, TIME, ElementCall, Lookup
from cadet_sym.language.numeric import quotient
from cadet_sym.simulation.curves import curve_table

__all__ = ["RUN_SYMBOLS", "Emitter", "Shared"]

RUN_SYMBOLS = (TIME, DISTANCE, SPEED, SPEED_RATE)
_NUMBER, _CONSTANT, _RUN, _PATH = range(4)
_LARGEST_POWER = 64  # beyond it the power function takes over from multiplication

# SymPy class: the text of the call, with one operand a place.
CALLS: dict[type, str] = {
    sp.exp: "exp({})",
    sp.log: "log({})",
    sp.sin: "sin({})",
    sp.cos: "cos({})",
    sp.tan: "tan({})",
    sp.asin: "asin({})",
    sp.acos: "acos({})",
    sp.atan: "atan({})",
    sp.atan2: "atan2({}, {})",
    sp.sinh: "sinh({})",
    sp.cosh: "cosh({})",
    sp.tanh: "tanh({})",
    sp.erf: "erf({})",
    sp.Abs: "fabs({})",
    sp.sign: "sign({})",
    sp.Heaviside: "heaviside({}, {})",
    sp.StrictLessThan: "({} < {})",
    sp.LessThan: "({} <= {})",
    sp.StrictGreaterThan: "({} > {})",
    sp.GreaterThan: "({} >= {})",
    sp.Equality: "({} == {})",
    sp.Unequality: "({} != {})",
    sp.Not: "not_({})",
}
# SymPy class: the text of two operands, applied from the left to as many as there are.
FOLDS: dict[type, str] = {
    sp.Add: "{} + {}",
    sp.Mul: "{} * {}",
    sp.Min: "minimum({}, {})",
    sp.Max: "maximum({}, {})",
    sp.And: "({} & {})",
    sp.Or: "({} | {})",
}


@dataclass
class Shared:
    """What the lines refer to by number: constants `q`, coefficients `c` and the tables of measured curves."""

    elements: Mapping[str, Any]
    constants: dict[sp.Basic, int] = field(default_factory=dict)  # in parameters alone
    coefficients: dict[sp.Basic, int] = field(default_factory=dict)  # in time, distance, speed as well
    curves: dict[sp.Basic, tuple[int, int]] = field(default_factory=dict)  # first place, breakpoints
    tables: list[np.ndarray] = field(default_factory=list)
    along_run: set[sp.Basic] = field(default_factory=lambda: set(RUN_SYMBOLS))  # known at each step, for all paths

    def curve(self, lookup: Lookup) -> tuple[int, int]:
        """First place of the curve in the joined tables, and its number of breakpoints."""
        key = sp.Tuple(*lookup.args[1:])
        if key not in self.curves:
            self.curves[key] = (sum(map(len, self.tables)), len(lookup.knots))
            self.tables.append(curve_table(lookup))
        return self.curves[key]

    def table(self) -> np.ndarray:
        """All tables of curves, joined (never empty, so that its type is plain)."""
        return np.concatenate([*self.tables, np.zeros(1)])


class Emitter:
    """Writes each distinct subexpression that depends on the path as one line `e<k> = ...`.

    Parameters
    ----------
    names : SymPy symbol to the name that holds its value on this path.
    shared : where constants, coefficients and curves are collected; several emitters may share it.
    suffix : ends the names of lines and coefficients, so that one expression can be written at two times.
    letter : begins the names of lines.
    lines : where the lines go; an element's body is written among those of its caller.
    """

    def __init__(
        self,
        names: Mapping[sp.Symbol, str],
        shared: Shared,
        suffix: str = "",
        letter: str = "e",
        lines: list[str] | None = None,
    ):
        self.names = dict(names)
        self.shared = shared
        self.suffix, self.letter = suffix, letter
        self.lines: list[str] = [] if lines is None else lines
        self._known: dict[Any, str] = {}
        self._levels: dict[sp.Basic, int] = {}

    def operand(self, node: sp.Basic) -> str:
        """Name or literal that holds the value of the expression; writes the lines it needs."""
        if node not in self._known:
            self._known[node] = self._write(node)
        return self._known[node]

    def _write(self, node: sp.Basic) -> str:
        if node in self.names:
            return self.names[node]
        level = self._level(node)
        if level == _NUMBER:
            return _literal(node)
        if level == _PATH:
            return self._line(self._text(node))
        if level == _CONSTANT:
            name = f"q{self.shared.constants.setdefault(node, len(self.shared.constants))}"
        else:
            place = self.shared.coefficients.setdefault(node, len(self.shared.coefficients))
            name = f"c{place}{self.suffix}"
        # A condition worked out beforehand is kept as 0 or 1.
        return f"({name} != 0.0)" if _is_condition(node) else name

    def _line(self, text: str) -> str:
        if text.isidentifier():
            return text
        name = f"{self.letter}{len(self.lines)}{self.suffix}"
        self.lines.append(f"{name} = {text}")
        return name

    def _text(self, node: sp.Basic) -> str:
        kind = type(node)
        if kind in (sp.Add, sp.Mul):
            return self._sum_or_product(node)
        if kind is sp.Pow:
            return self._power(*node.args)
        if kind is sp.Piecewise:
            return self._piecewise(node)
        if kind is ElementCall:
            return self._element(node)
        if kind is Lookup:
            first, count = self.shared.curve(node)
            return f"lookup({self.operand(node.args[0])}, T, {first}, {count})"
        if kind in FOLDS:
            return self._fold(FOLDS[kind], [self.operand(a) for a in node.args])
        if kind in CALLS:
            return CALLS[kind].format(*(self.operand(a) for a in node.args))
        raise ModelError(
            f"the simulation cannot evaluate `{kind.__name__}` in `{node}`; write it with the functions of the "
            "expression language"
        )

    def _sum_or_product(self, node: sp.Basic) -> str:
        """A sum or product whose part that does not depend on the path is one operand, worked out beforehand."""
        still = [a for a in node.args if self._level(a) < _PATH]
        moving = [self.operand(a) for a in node.args if self._level(a) == _PATH]
        if not still:
            return self._fold(FOLDS[type(node)], moving)
        together = node.func(*still)
        if type(node) is sp.Mul and together == -1:
            return "-" + self._line(self._fold("{} * {}", moving))
        return self._fold(FOLDS[type(node)], [self.operand(together), *moving])

    def _fold(self, pattern: str, operands: Sequence[str]) -> str:
        text = operands[0]
        for operand in operands[1:]:
            text = pattern.format(text if text in operands else self._line(text), operand)
        return text

    def _piecewise(self, node: sp.Basic) -> str:
        """Select among the branches, all of which are evaluated: NaN in one that is not taken does no harm."""
        text = "nan"
        for value, condition in reversed(node.args):
            if condition == sp.true:
                text = self.operand(value)
            else:
                text = self._line(f"where({self.operand(condition)}, {self.operand(value)}, {text})")
        return text

    def _element(self, call: sp.Basic) -> str:
        """Write the body of a declared element with the operands of its arguments in their places."""
        element = self.shared.elements[call.name]
        names = {a: self.operand(v) for a, v in zip(element.arguments, call.arguments, strict=True)}
        return Emitter(names, self.shared, self.suffix, self.letter, self.lines).operand(element.value)

    def _power(self, base: sp.Basic, exponent: Any) -> str:
        if exponent.is_Rational and exponent.q <= 2 and abs(exponent.p) <= _LARGEST_POWER:
            root = self.operand(base) if exponent.q == 1 else self._line(f"sqrt({self.operand(base)})")
            whole = self._whole_power(root, abs(int(exponent.p)))
            return whole if exponent.p > 0 else f"1.0 / {whole}"
        return f"power({self.operand(base)}, {self.operand(exponent)})"

    def _whole_power(self, base: str, n: int) -> str:
        """Base to a whole power by squaring, each power one line."""
        if n == 1:
            return base
        key = (base, n)
        if key not in self._known:
            half = self._whole_power(base, n // 2)
            square = self._line(f"{half} * {half}")
            self._known[key] = self._line(f"{square} * {base}") if n % 2 else square
        return self._known[key]

    def _level(self, node: sp.Basic) -> int:
        """What the value depends on: nothing, parameters, the run (time, distance, speed), or the path."""
        if node not in self._levels:
            if node in self.names:
                level = _PATH
            elif isinstance(node, sp.Number | sp.NumberSymbol | BooleanAtom):
                level = _NUMBER
            elif node in self.shared.along_run:
                level = _RUN
            else:
                # An element may hold the time: a call of it changes along the run at least.
                least = _RUN if isinstance(node, ElementCall) else _CONSTANT
                level = max([least, *(self._level(a) for a in node.args)])
            self._levels[node] = level
        return self._levels[node]


def _is_condition(node: sp.Basic) -> bool:
    return isinstance(node, Boolean) and not isinstance(node, sp.Symbol)


def _literal(number: Any) -> str:
    if isinstance(number, BooleanAtom):
        return str(bool(number))
    value = quotient(number) if number.is_Rational else float(number)
    if math.isfinite(value):
        return repr(value)
    return "nan" if math.isnan(value) else "inf" if value > 0 else "(-inf)"
