"""Expression to text: the exact inverse of `parse`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sympy as sp
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from cadet_sym.errors import ModelError
from cadet_sym.language.vocabulary import ElementCall, Lookup, der

# how tightly a text binds
_CHOICE, _OR, _AND, _COMPARE, _SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(9)

_CALLS: dict[type, str] = {
    sp.Abs: "abs",
    sp.sign: "sign",
    sp.exp: "exp",
    sp.log: "log",
    sp.sin: "sin",
    sp.cos: "cos",
    sp.tan: "tan",
    sp.asin: "asin",
    sp.acos: "acos",
    sp.atan: "atan",
    sp.atan2: "atan2",
    sp.sinh: "sinh",
    sp.cosh: "cosh",
    sp.tanh: "tanh",
    sp.erf: "erf",
    sp.Min: "min",
    sp.Max: "max",
}
_RELATIONS: dict[type, str] = {
    sp.StrictGreaterThan: ">",
    sp.GreaterThan: ">=",
    sp.StrictLessThan: "<",
    sp.LessThan: "<=",
    sp.Equality: "==",
    sp.Unequality: "!=",
}


def unparse(expr: sp.Basic) -> str:
    """Text of a canonical expression in the language of the model file; `parse(unparse(e)) == e`."""
    return _text(expr)[0]


def _text(expr: sp.Basic) -> tuple[str, int]:
    """Text and how tightly it binds."""
    if expr.is_Rational:
        return _rational(expr)
    if isinstance(expr, sp.Symbol):
        return expr.name, _ATOM
    for kind, write in _WRITERS:
        if isinstance(expr, kind):
            return write(expr)
    if type(expr) in _CALLS:
        return f"{_CALLS[type(expr)]}({', '.join(unparse(a) for a in expr.args)})", _ATOM
    if type(expr) in _RELATIONS:
        left, right = (_at_least(side, _SUM) for side in expr.args)
        return f"{left} {_RELATIONS[type(expr)]} {right}", _COMPARE
    raise ModelError(f"`{expr}` ({type(expr).__name__}) has no text in the language of the models")


def _at_least(expr: sp.Basic, binding: int) -> str:
    text, own = _text(expr)
    return text if own >= binding else f"({text})"


def _rational(number: Any) -> tuple[str, int]:
    text, binding = number_text(abs(number))
    return (f"-{text}", _PRODUCT if binding == _PRODUCT else _SIGN) if number < 0 else (text, binding)


def number_text(number: Any) -> tuple[str, int]:
    """A rational number that is not negative: a decimal if one gives it exactly, else a fraction."""
    if number.q == 1 and number < 10**16:
        return str(number.p), _ATOM
    decimal = repr(int(number.p) / int(number.q)) if number < 10**308 and number > sp.Rational(1, 10**300) else ""
    if decimal and sp.Rational(decimal) == number:
        return decimal, _ATOM
    return (str(number.p), _ATOM) if number.q == 1 else (f"{number.p}/{number.q}", _PRODUCT)


def _add(expr: Any) -> tuple[str, int]:
    constant, rest = [a for a in expr.args if a.is_Rational], [a for a in expr.args if not a.is_Rational]
    text = ""
    for term in [*rest, *constant]:
        if not text:
            text = _at_least(term, _SUM)
        elif term.could_extract_minus_sign() and _leading(term) < 0:
            text += f" - {_at_least(-term if term.is_Rational else _negated(term), _PRODUCT)}"
        else:
            text += f" + {_at_least(term, _PRODUCT)}"
    return text, _SUM


def _leading(term: Any) -> Any:
    return term.as_coeff_Mul(rational=True)[0]


def _negated(term: Any) -> Any:
    """A product without the minus of its coefficient, never multiplied out."""
    coefficient, rest = term.as_coeff_Mul(rational=True)
    return rest if coefficient == -1 else sp.Mul(-coefficient, *sp.Mul.make_args(rest), evaluate=False)


def _mul(expr: Any) -> tuple[str, int]:
    """Product with its coefficient first, unless a sum would come next: SymPy would multiply that out."""
    coefficient = sp.Mul(*(a for a in expr.args if a.is_Rational))
    above, below = [], []
    for factor in (a for a in expr.args if not a.is_Rational):
        inverted = isinstance(factor, sp.Pow) and factor.exp.is_Rational and factor.exp < 0
        (below if inverted else above).append(factor)
    above.sort(key=lambda f: isinstance(f, sp.Add))
    texts = [_at_least(factor, _POWER) for factor in above]
    size, minus = abs(coefficient), coefficient < 0
    number, binding = number_text(size)
    numerator, denominator = (number, "") if binding == _ATOM else (str(size.p), str(size.q))
    only_sums = bool(above) and all(isinstance(f, sp.Add) for f in above)
    last = only_sums and bool(below)  # a number times one sum is multiplied out, times a quotient it is not
    if (numerator != "1" and not last) or not texts:
        texts.insert(len(texts) if only_sums else 0, numerator)
    text = "*".join(texts)
    for factor in below:
        text += f"/{_at_least(sp.Pow(factor.base, -factor.exp), _POWER)}"
    if last and numerator != "1":
        text += f"*{numerator}"
    if denominator:
        text += f"/{denominator}"
    if minus and only_sums:
        return f"-({text})", _SIGN
    return (f"-{text}", _PRODUCT) if minus else (text, _PRODUCT)


def _pow(expr: Any) -> tuple[str, int]:
    base, exponent = expr.base, expr.exp
    if exponent == sp.Rational(1, 2):
        return f"sqrt({unparse(base)})", _ATOM
    if exponent.is_Rational and exponent < 0 and not base.is_Rational:
        return f"1/{_at_least(sp.Pow(base, -exponent), _POWER)}", _PRODUCT
    base_text, own = _text(base)
    if own < _ATOM:
        base_text = f"({base_text})"
    exponent_text, own = _text(exponent)
    return f"{base_text}**{exponent_text if own >= _ATOM else f'({exponent_text})'}", _POWER


def _piecewise(expr: Any) -> tuple[str, int]:
    text = ""
    for branch in expr.args:
        value, test = branch.args
        text += _at_least(value, _OR)
        if test != sp.true:
            text += f" if {_at_least(test, _OR)} else "
    return text, _CHOICE


def _junction(word: str, binding: int) -> Callable[[Any], tuple[str, int]]:
    return lambda expr: (f" {word} ".join(_at_least(a, binding + 1) for a in expr.args), binding)


def _element(expr: Any) -> tuple[str, int]:
    return f"{expr.name}({', '.join(unparse(a) for a in expr.arguments)})", _ATOM


def _lookup(expr: Any) -> tuple[str, int]:
    raise ModelError("a measured curve has no text: it is declared as a table")


def _truth(expr: Any) -> tuple[str, int]:
    return ("0 < 1" if expr == sp.true else "1 < 0"), _COMPARE


_WRITERS: list[tuple[Any, Callable[[Any], tuple[str, int]]]] = [
    (sp.Add, _add),
    (sp.Mul, _mul),
    (sp.exp, lambda e: (f"exp({unparse(e.args[0])})", _ATOM)),
    (sp.Pow, _pow),
    (sp.Piecewise, _piecewise),
    (sp.Heaviside, lambda e: (f"heaviside({unparse(e.args[0])})", _ATOM)),
    (sp.And, _junction("and", _AND)),
    (sp.Or, _junction("or", _OR)),
    (sp.Not, lambda e: (f"not ({unparse(e.args[0])})", _AND)),
    (ElementCall, _element),
    (der, lambda e: (f"der({unparse(e.of)}" + (f", {e.order})" if e.order > 1 else ")"), _ATOM)),
    (Lookup, _lookup),
    (BooleanTrue | BooleanFalse, _truth),
    (type(sp.pi), lambda e: ("pi", _ATOM)),
    (type(sp.E), lambda e: ("exp(1)", _ATOM)),
]
