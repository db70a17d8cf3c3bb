"""Expressions: canonical symbols, `der`, `ElementCall`, `Lookup`; text to expression and back."""

from cadet_sym.language.bounds import LIMITS, Limits, limits
from cadet_sym.language.canonical import canonical
from cadet_sym.language.names import exact
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.parser import parse
from cadet_sym.language.printer import unparse
from cadet_sym.language.scope import ANYTHING, Scope
from cadet_sym.language.vocabulary import (
    DISTANCE,
    SPEED,
    SPEED_RATE,
    TIME,
    ElementCall,
    Lookup,
    NamedElement,
    clip,
    der,
    extreme,
    heaviside,
    piecewise,
    relation,
    symbol,
)

__all__ = [
    "ANYTHING",
    "DISTANCE",
    "LIMITS",
    "SPEED",
    "SPEED_RATE",
    "TIME",
    "ElementCall",
    "Limits",
    "Lookup",
    "NamedElement",
    "Scope",
    "canonical",
    "clip",
    "der",
    "evaluate",
    "exact",
    "extreme",
    "heaviside",
    "limits",
    "parse",
    "piecewise",
    "relation",
    "symbol",
    "unparse",
]
