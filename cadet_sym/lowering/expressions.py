"""A SymPy expression as a CasADi one: one table, memoised, so that what is shared stays shared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce

import casadi as ca
import sympy as sp
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.tables import lookup_table
from cadet_sym.language.vocabulary import Lookup

Converter = Callable[..., ca.SX]


def to_casadi(expr: sp.Basic, env: Mapping[sp.Symbol, ca.SX]) -> ca.SX:
    """Convert an expression; `env` gives what each symbol becomes.

    Raises
    ------
    LinearisationError
        If a function has no counterpart, or a symbol is not in `env`.
    """
    return Lowering(env).convert(expr)


class Lowering:
    """Converts expressions under one meaning of the symbols; remembers what it has converted."""

    def __init__(self, env: Mapping[sp.Symbol, ca.SX], *, split_powers: bool = False):
        self.env, self.split_powers = env, split_powers
        self.done: dict[sp.Basic, ca.SX] = {}

    def convert(self, expr: sp.Basic) -> ca.SX:
        """The CasADi expression."""
        if expr not in self.done:
            self.done[expr] = self._convert(expr)
        return self.done[expr]

    def _convert(self, expr: sp.Basic) -> ca.SX:
        if isinstance(expr, sp.Symbol):
            if expr not in self.env:
                raise LinearisationError(f"`{expr}` has no value here; declare it as a parameter")
            return self.env[expr]
        if isinstance(expr, (BooleanTrue, BooleanFalse)):
            return ca.SX(bool(expr))
        if isinstance(expr, sp.Piecewise):
            return self._piecewise(expr)
        if isinstance(expr, sp.Pow):
            return self._power(expr)
        if isinstance(expr, sp.Expr) and expr.is_number:
            return ca.SX(_number(expr))
        if isinstance(expr, Lookup):
            return curve(expr, self.convert(expr.argument))
        rule = _TABLE.get(type(expr))
        if rule is None:
            raise LinearisationError(f"`{type(expr).__name__}` in `{expr}` has no numerical counterpart")
        return rule(*(self.convert(argument) for argument in expr.args))

    def _piecewise(self, expr: sp.Piecewise) -> ca.SX:
        result: ca.SX | None = None
        for value, condition in reversed(expr.args):
            branch = self.convert(value)
            if isinstance(condition, BooleanTrue):
                result = branch
            else:
                result = ca.if_else(self.convert(condition), branch, ca.SX.nan() if result is None else result)
        assert result is not None
        return result

    def _power(self, expr: sp.Pow) -> ca.SX:
        if expr.is_number:
            return ca.SX(_number(expr))
        base, power = expr.args
        if base is sp.E:
            return ca.exp(self.convert(power))
        if power.is_Integer:
            return _integer_power(self.convert(base), int(power))
        if power == sp.S.Half:
            return ca.sqrt(self.convert(base))
        if power == -sp.S.Half:
            return 1 / ca.sqrt(self.convert(base))
        if self.split_powers and power.is_Rational and not 0 < power < 1:
            # x^q and x^(q - 1) share their costly factor; not at x = 0, where the slope of the product is undefined
            whole = sp.floor(power)
            return self.convert(base ** (power - whole)) * _integer_power(self.convert(base), int(whole))
        return self.convert(base) ** self.convert(power)


def curve(lookup: Lookup, x: ca.SX) -> ca.SX:
    """A measured curve at a point, or at a column of points."""
    table = lookup_table(lookup)
    result = polynomial(table.segments[0], x - table.centres[0])
    for knot, centre, segment in zip(table.knots, table.centres[1:], table.segments[1:], strict=True):
        result = ca.if_else(x >= knot, polynomial(segment, x - centre), result)
    return result


def polynomial(coefficients: Sequence[float], x: ca.SX) -> ca.SX:
    """sum_n coefficients[n] x^n."""
    total = ca.SX(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total = total * x + coefficient
    return total


def _number(expr: sp.Expr) -> float:
    if expr.is_Rational or expr.is_Float:
        return float(expr)
    value = sp.N(expr, 20)
    if not value.is_real:
        raise LinearisationError(f"`{expr}` is not a real number")
    return float(value)


def _integer_power(base: ca.SX, power: int) -> ca.SX:
    if power < 0:
        return 1 / _integer_power(base, -power)
    result, square = None, base
    while power:
        if power & 1:
            result = square if result is None else result * square
        power >>= 1
        if power:
            square = square * square
    return ca.SX(1) if result is None else result


def _heaviside(x: ca.SX, at_zero: ca.SX | float = 0.5) -> ca.SX:
    return ca.if_else(x > 0, 1, ca.if_else(x < 0, 0, at_zero))


def _folded(operation: Callable[[ca.SX, ca.SX], ca.SX]) -> Converter:
    return lambda *arguments: reduce(operation, arguments)


def _product(*factors: ca.SX) -> ca.SX:
    return reduce(lambda a, b: -b if a.is_constant() and float(a) == -1 else a * b, factors)


_TABLE: dict[type, Converter] = {
    sp.Add: _folded(lambda a, b: a + b),
    sp.Mul: _product,
    sp.Abs: ca.fabs,
    sp.sign: ca.sign,
    sp.Heaviside: _heaviside,
    sp.Max: _folded(ca.fmax),
    sp.Min: _folded(ca.fmin),
    sp.exp: ca.exp,
    sp.log: ca.log,
    sp.sin: ca.sin,
    sp.cos: ca.cos,
    sp.tan: ca.tan,
    sp.asin: ca.asin,
    sp.acos: ca.acos,
    sp.atan: ca.atan,
    sp.atan2: ca.atan2,
    sp.sinh: ca.sinh,
    sp.cosh: ca.cosh,
    sp.tanh: ca.tanh,
    sp.asinh: ca.asinh,
    sp.acosh: ca.acosh,
    sp.atanh: ca.atanh,
    sp.erf: ca.erf,
    sp.floor: ca.floor,
    sp.ceiling: ca.ceil,
    sp.StrictGreaterThan: lambda a, b: a > b,
    sp.GreaterThan: lambda a, b: a >= b,
    sp.StrictLessThan: lambda a, b: a < b,
    sp.LessThan: lambda a, b: a <= b,
    sp.Equality: lambda a, b: a == b,
    sp.Unequality: lambda a, b: a != b,
    sp.And: _folded(ca.logic_and),
    sp.Or: _folded(ca.logic_or),
    sp.Not: ca.logic_not,
}
