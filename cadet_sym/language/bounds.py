"""What keeps a hostile expression cheap: limits on length, nesting, exponents and digits.

SymPy evaluates as it builds, so every node is checked before the next one is built on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.numeric import evaluate


@dataclass(frozen=True)
class Limits:
    """Bounds on what a model may hold; `limits(...)` raises them for a while."""

    characters: int = 2_000  # of one expression
    levels: int = 50  # of nesting in one expression
    exponent: int = 64  # largest numeric exponent
    rows: int = 10_000  # of a table
    bytes: int = 1_000_000  # of a model file
    table_bytes: int = 10_000_000  # of a table beside it


LIMITS = Limits()
_current: ContextVar[Limits] = ContextVar("limits", default=LIMITS)


def current_limits() -> Limits:
    """The limits in force."""
    return _current.get()


@contextmanager
def limits(**changed: Any) -> Iterator[Limits]:
    """Other limits within a `with`: `with limits(rows=100_000): model = load(...)`."""
    token = _current.set(replace(_current.get(), **changed))
    try:
        yield _current.get()
    finally:
        _current.reset(token)


_DIGITS = 8192  # bits of numerator and denominator together; a double needs 2100
_NOT_REAL = "this is not a real number (a division by zero, or the root or logarithm of a negative one)"
_FOREIGN = (sp.I, sp.zoo, sp.nan, sp.oo, -sp.oo)


def power(base: sp.Expr, exponent: sp.Expr) -> sp.Expr:
    """`base**exponent`, refused before SymPy multiplies it out where the exponent is out of bounds."""
    most = current_limits().exponent
    if exponent.is_Rational and abs(exponent) > most:
        raise ModelError(f"the exponent {shown(exponent)} is beyond the limit of {most}")
    if exponent.is_Rational and exponent.q > 10**6 and base.is_Rational:
        raise ModelError(f"the exponent {shown(exponent)} of a number has too many digits")
    if base.is_Rational and exponent.is_Rational and _bits(base) * abs(exponent) > 8 * _DIGITS:
        raise ModelError(f"`{shown(base)}**{shown(exponent)}` is beyond the range of floating point")
    if base.is_zero and exponent.is_negative:
        raise ModelError("division by zero")
    return sp.Pow(base, exponent)


def checked(result: sp.Expr) -> sp.Expr:
    """`result` if it is a real number or a real expression within the limits; ModelError that says what it is else."""
    most = current_limits().exponent
    for term in sp.Add.make_args(result):
        for factor in sp.Mul.make_args(term):
            if factor.is_Rational:
                if _bits(factor) > _DIGITS:
                    raise ModelError("a number with too many digits comes out of this; write it as a decimal")
            elif isinstance(factor, sp.Pow) and factor.exp.is_Rational and abs(factor.exp) > most:
                raise ModelError(f"this is a power of {shown(factor.exp)}, and exponents go to {most}")
            elif isinstance(factor, sp.Pow) and factor.base.is_Rational and factor.base < 0:
                raise ModelError(_NOT_REAL)
    if result.has(*_FOREIGN):
        raise ModelError(_NOT_REAL)
    if not result.free_symbols and not result.has(sp.Function):
        _finite(result)
    elif not result.free_symbols:
        _finite_function(result)
    return result


def _finite(result: sp.Expr) -> None:
    value = evaluate(result)
    if math.isnan(value):
        raise ModelError("this is not a real number")
    if math.isinf(value):
        raise ModelError("this number is beyond the range of floating point (1.8e308)")
    if value == 0 and result.is_Rational and result != 0:
        raise ModelError("this number is too small for floating point (5e-324)")


def _finite_function(result: sp.Expr) -> None:
    from cadet_sym.language.vocabulary import ElementCall, Lookup, der

    if not result.has(ElementCall, Lookup, der):
        _finite(result)


def _bits(number: sp.Expr) -> int:
    return int(number.p).bit_length() + int(number.q).bit_length()


def shown(number: sp.Expr) -> str:
    """A number for a message, short."""
    text = str(number)
    return text if len(text) <= 24 else f"{text[:10]}...({len(text)} digits)"
