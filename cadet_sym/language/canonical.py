"""SymPy expression of a user to the expression that the same text would give."""

from __future__ import annotations

import numbers
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.core.symbol import Str
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from cadet_sym.errors import ModelError
from cadet_sym.language.bounds import checked, current_limits, power
from cadet_sym.language.names import exact
from cadet_sym.language.vocabulary import (
    HALF,
    ElementCall,
    Lookup,
    der,
    extreme,
    heaviside,
    negation,
    piecewise,
    relation,
    symbol,
)

_PASSES = 8


def _heaviside(z: sp.Expr, at_zero: sp.Expr = HALF) -> sp.Expr:
    if at_zero != HALF:
        raise ModelError(f"the unit step here is 1/2 at 0, and `Heaviside({z}, {at_zero})` is not")
    return heaviside(z)


# class -> what its canonical arguments are built into
_BUILD: dict[type, Callable[..., Any]] = {
    sp.Add: sp.Add,
    sp.Mul: sp.Mul,
    sp.Pow: power,
    sp.exp: lambda z: checked(sp.exp(z)),
    sp.log: sp.log,
    sp.Abs: sp.Abs,
    sp.sign: sp.sign,
    sp.sin: sp.sin,
    sp.cos: sp.cos,
    sp.tan: sp.tan,
    sp.asin: sp.asin,
    sp.acos: sp.acos,
    sp.atan: sp.atan,
    sp.atan2: sp.atan2,
    sp.sinh: sp.sinh,
    sp.cosh: sp.cosh,
    sp.tanh: sp.tanh,
    sp.erf: sp.erf,
    sp.sec: lambda z: 1 / sp.cos(z),
    sp.csc: lambda z: 1 / sp.sin(z),
    sp.cot: lambda z: sp.cos(z) / sp.sin(z),
    sp.erfc: lambda z: 1 - sp.erf(z),
    sp.Heaviside: _heaviside,
    sp.Min: lambda *z: extreme(sp.Min, z),
    sp.Max: lambda *z: extreme(sp.Max, z),
    sp.ITE: lambda test, yes, no: sp.Or(sp.And(test, yes), sp.And(negation(test), no)),
    sp.And: sp.And,
    sp.Or: sp.Or,
    sp.Not: negation,
    der: der,
    sp.StrictGreaterThan: lambda a, b: relation(sp.StrictGreaterThan, a, b),
    sp.GreaterThan: lambda a, b: relation(sp.GreaterThan, a, b),
    sp.StrictLessThan: lambda a, b: relation(sp.StrictLessThan, a, b),
    sp.LessThan: lambda a, b: relation(sp.LessThan, a, b),
    sp.Equality: lambda a, b: relation(sp.Equality, a, b),
    sp.Unequality: lambda a, b: relation(sp.Unequality, a, b),
}


def canonical(expr: Any) -> sp.Expr:
    """The expression with real symbols, exact numbers, and every part built as the parser builds it.

    Parameters
    ----------
    expr : a number (int, float, Fraction, NumPy or SymPy) or a SymPy expression; text is for `parse`.

    Raises
    ------
    ModelError : for what the language does not have (complex numbers, integrals, unknown functions).
    """
    result = _settled(_basic(expr), current_limits().exponent)
    if not isinstance(result, sp.Expr):
        raise ModelError(f"a value is wanted, not the condition `{result}`: say what holds in each case, as `1 if ... else 0`")
    return result


# A model's expressions pass here more than once: from the text, from the record, from a change of parameters.
@lru_cache(maxsize=4096)
def _settled(expr: sp.Basic, exponent: int) -> sp.Expr:
    """Build again until nothing changes; what comes out is within the limit of exponents that was given."""
    try:
        result = _canonical(expr, {})
        for _ in range(_PASSES):
            again = _canonical(result, {})
            if again == result:
                return again
            result = again
    except RecursionError:
        raise ModelError("the expression is nested too deeply; split it into elements") from None
    return result


def condition(expr: Any) -> Any:
    """A canonical condition, as `z > 0`."""
    return _canonical(_basic(expr), {})


def _basic(value: Any) -> sp.Basic:
    if isinstance(value, bool) or (isinstance(value, numbers.Complex) and not isinstance(value, numbers.Real)):
        raise ModelError(f"a number is wanted, not {value!r}")
    if isinstance(value, sp.Basic):
        return value
    if isinstance(value, numbers.Integral):
        return sp.Integer(int(value))
    if isinstance(value, Fraction):
        return sp.Rational(value.numerator, value.denominator)
    if isinstance(value, numbers.Real):
        return exact(float(value))
    raise ModelError(f"a number or a SymPy expression is wanted, not {type(value).__name__} ({value!r:.60})")


def _canonical(expr: sp.Basic, seen: dict[sp.Basic, Any]) -> Any:
    if expr in seen:
        return seen[expr]
    if isinstance(expr, sp.Symbol):
        result: Any = symbol(expr.name)
    elif isinstance(expr, sp.Float):
        result = exact(float(expr))
    elif expr.is_Rational or expr is sp.pi or isinstance(expr, BooleanTrue | BooleanFalse):
        result = expr
    elif expr is sp.E:
        result = sp.E
    elif isinstance(expr, sp.Piecewise):
        result = piecewise([(_canonical(b.args[0], seen), _canonical(b.args[1], seen)) for b in expr.args])
    elif isinstance(expr, ElementCall):
        result = ElementCall(Str(expr.name), *(_canonical(a, seen) for a in expr.arguments))
    elif isinstance(expr, AppliedUndef):
        result = ElementCall(Str(expr.func.__name__), *(_canonical(a, seen) for a in expr.args))
    elif isinstance(expr, sp.re):  # SymPy's |e^x| of a symbol that is not declared real; here all are
        result = _canonical(expr.args[0], seen)
    elif isinstance(expr, Lookup):
        result = Lookup(_canonical(expr.argument, seen), *expr.args[1:])
    elif type(expr) in _BUILD:
        result = _BUILD[type(expr)](*(_canonical(argument, seen) for argument in expr.args))
        if isinstance(result, sp.Expr):
            result = checked(result)
    else:
        raise ModelError(f"`{expr}` ({type(expr).__name__}) is not in the language of the models")
    seen[expr] = result
    return result
