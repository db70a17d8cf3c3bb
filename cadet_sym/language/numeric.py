"""Numbers of an expression: its value by NumPy, with no SymPy evaluation on the way.

Used for parameters, for the check of a speed history and for constants; what the solvers run is lowered elsewhere.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import sympy as sp
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from cadet_sym.errors import ModelError
from cadet_sym.language.vocabulary import Lookup


def erf(z: Any) -> Any:
    """The error function."""
    return np.vectorize(math.erf, otypes=[float])(z)


def _power(base: Any, exponent: Any) -> Any:
    return np.power(np.asarray(base, float), exponent)


def _all(function: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *arguments: functools.reduce(function, arguments)


# one row a class: what its arguments' values become
NUMPY: dict[type, Callable[..., Any]] = {
    sp.Add: lambda *terms: sum(terms),
    sp.Mul: _all(np.multiply),
    sp.Pow: _power,
    sp.exp: np.exp,
    sp.log: np.log,
    sp.Abs: np.abs,
    sp.sign: np.sign,
    sp.sin: np.sin,
    sp.cos: np.cos,
    sp.tan: np.tan,
    sp.asin: np.arcsin,
    sp.acos: np.arccos,
    sp.atan: np.arctan,
    sp.atan2: np.arctan2,
    sp.sinh: np.sinh,
    sp.cosh: np.cosh,
    sp.tanh: np.tanh,
    sp.erf: erf,
    sp.Min: _all(np.minimum),
    sp.Max: _all(np.maximum),
    sp.Heaviside: lambda z, at_zero: np.heaviside(z, at_zero),
    sp.StrictGreaterThan: np.greater,
    sp.GreaterThan: np.greater_equal,
    sp.StrictLessThan: np.less,
    sp.LessThan: np.less_equal,
    sp.Equality: np.equal,
    sp.Unequality: np.not_equal,
    sp.And: _all(np.logical_and),
    sp.Or: _all(np.logical_or),
    sp.Not: np.logical_not,
}


def evaluate(expr: sp.Basic, values: Mapping[sp.Symbol, Any] | None = None) -> Any:
    """Value of `expr` where each symbol has the value given: float, or an array for arrays.

    Out of range gives inf or nan, as floating point does; a symbol with no value raises ModelError.
    """
    known: dict[sp.Basic, Any] = dict(values or {})
    with np.errstate(all="ignore"):
        result = _evaluate(expr, known)
    return float(result) if np.ndim(result) == 0 else np.asarray(result, float)


def _evaluate(expr: sp.Basic, known: dict[sp.Basic, Any]) -> Any:
    if expr in known:
        return known[expr]
    if expr.is_Rational:
        value: Any = quotient(expr)
    elif isinstance(expr, sp.NumberSymbol):
        value = float(expr)
    elif isinstance(expr, BooleanTrue | BooleanFalse):
        value = bool(expr)
    elif isinstance(expr, sp.Piecewise):
        # the branch not taken is computed too and thrown away: NaN there does no harm
        value = _evaluate(expr.args[-1].args[0], known)
        for branch in reversed(expr.args[:-1]):
            value = np.where(_evaluate(branch.args[1], known), _evaluate(branch.args[0], known), value)
    elif isinstance(expr, Lookup):
        from cadet_sym.language.curve import curve_values

        value = curve_values(expr, _evaluate(expr.argument, known))
    elif type(expr) in NUMPY:
        value = NUMPY[type(expr)](*(_evaluate(argument, known) for argument in expr.args))
    else:
        raise ModelError(f"`{expr}` has no value here", token=str(expr))
    known[expr] = value
    return value


def quotient(number: Any) -> float:
    """The double nearest to a rational number; inf beyond the range of doubles."""
    try:
        return int(number.p) / int(number.q)
    except OverflowError:
        return math.inf if number > 0 else -math.inf
