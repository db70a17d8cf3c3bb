"""Numbers of an expression: its value by NumPy, with no SymPy evaluation on the way.

Used for parameters, for the check of a speed history and for constants; what the solvers run is lowered elsewhere.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from cadet_sym.errors import ModelError
from cadet_sym.language.vocabulary import Lookup


def erf(z: Any) -> Any:
    """The error function."""
    if np.ndim(z) == 0:
        return math.erf(z)
    from scipy.special import erf as of_arrays  # late: SciPy takes longer to import than most models to be read

    return of_arrays(z)


def _power(base: Any, exponent: Any) -> Any:
    return np.power(np.asarray(base, float), exponent)


def _all(function: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *arguments: functools.reduce(function, arguments)


# one row a class: what its arguments' values become
NUMPY: dict[type, Callable[..., Any]] = {
    sp.Add: _all(np.add),
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
    with np.errstate(all="ignore"):
        result = _steps_of(expr).run(values or {})
    return float(result) if np.ndim(result) == 0 else np.asarray(result, float)


@dataclass(frozen=True)
class _Steps:
    """An expression as a list of calls, each subexpression once: a place in a list of values for each."""

    known: tuple[Any, ...]  # the numbers in it, None where a value is yet to come
    symbols: tuple[tuple[int, sp.Basic], ...]
    calls: tuple[tuple[int, Callable[..., Any], tuple[int, ...]], ...]  # result, function, arguments

    def run(self, given: Mapping[Any, Any]) -> Any:
        values = list(self.known)
        for place, symbol in self.symbols:
            if symbol not in given:
                raise ModelError(f"`{symbol}` has no value here", token=str(symbol))
            values[place] = given[symbol]
        for place, function, arguments in self.calls:
            values[place] = function(*[values[k] for k in arguments])
        return values[-1]


@functools.lru_cache(maxsize=4096)
def _steps_of(expr: sp.Basic) -> _Steps:
    places: dict[sp.Basic, int] = {}
    known: list[Any] = []
    symbols, calls = [], []

    def place_of(node: sp.Basic) -> int:
        if node in places:
            return places[node]
        value, function, parts = None, None, node.args
        if node.is_Rational:
            value = quotient(node)
        elif isinstance(node, sp.NumberSymbol):
            value = float(node)
        elif isinstance(node, BooleanTrue | BooleanFalse):
            value = bool(node)
        elif isinstance(node, sp.Piecewise):
            function, parts = _chosen, tuple(part for branch in node.args for part in branch.args)
        elif isinstance(node, Lookup):
            from cadet_sym.language.curve import curve_values

            function, parts = functools.partial(curve_values, node), (node.argument,)
        else:
            function = NUMPY.get(type(node))
        arguments = () if function is None else tuple(map(place_of, parts))
        places[node] = len(known)
        known.append(value)
        if function is not None:
            calls.append((places[node], function, arguments))
        elif value is None:
            symbols.append((places[node], node))
        return places[node]

    place_of(expr)
    return _Steps(tuple(known), tuple(symbols), tuple(calls))


def _chosen(*parts: Any) -> Any:
    """The value of a conditional from value and condition of every branch, taken or not: NaN in one not taken does no harm."""
    value = parts[-2]
    for k in range(len(parts) - 4, -1, -2):
        value = np.where(parts[k + 1], parts[k], value)
    return value


def quotient(number: Any) -> float:
    """The double nearest to a rational number; inf beyond the range of doubles."""
    try:
        return int(number.p) / int(number.q)
    except OverflowError:
        return math.inf if number > 0 else -math.inf
