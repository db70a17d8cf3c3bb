"""Names and numbers as they are declared: what may be a name, which name was meant, what number a float stands for."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.vocabulary import FUNCTIONS, KEYWORDS, RESERVED

_NAME = re.compile(r"[^\W\d]\w*")


def name_problem(name: str) -> str | None:
    """Why `name` cannot be declared, or None if it can."""
    if not isinstance(name, str) or not name:
        return "a name is a non-empty text"
    if len(name) > 100:
        return "a name has at most 100 characters"
    if unicodedata.normalize("NFKC", name) != name:
        return f"write it in its normal form, `{unicodedata.normalize('NFKC', name)}`"
    if not _NAME.fullmatch(name) or not name.isidentifier():
        return "a name is letters, digits and underscores, and begins with a letter or an underscore"
    if name in KEYWORDS:
        return "it is a keyword of the expressions"
    if name in FUNCTIONS:
        return "it is a function of the expressions"
    if name in RESERVED:
        return f"it is reserved for {RESERVED[name]}"
    return None


def a(kind: str) -> str:
    """The kind of a thing with its article."""
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`; did you mean ...?`, or nothing if no known name is near."""
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=0.6)
    return f"; did you mean {' or '.join(f'`{n}`' for n in near)}?" if near else ""


def exact(value: int | float) -> sp.Rational:
    """A number as written: 0.1 is one tenth (the shortest decimal that gives the same double)."""
    if isinstance(value, int):
        return sp.Integer(value)
    if value != value or value in (float("inf"), float("-inf")):
        raise ModelError("this number is not finite")
    return sp.Rational(repr(float(value)))
