"""Tables of a model file: keys that are known, values of the type wanted, expressions in the scope of their place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.names import did_you_mean, exact
from cadet_sym.language.noise import Noise
from cadet_sym.language.parser import parse
from cadet_sym.language.scope import Scope

_NEW = object()


class Entries:
    """One table of the file: knows its name, refuses keys that it does not know."""

    def __init__(self, name: str, content: Any):
        if not isinstance(content, Mapping):
            table, _, key = name.rpartition(".")
            raise ModelError(f"a table is wanted, not {kind_of(content)}", table=table, key=key)
        self.name, self.content = name, content

    def only(self, known: Iterable[str]) -> Entries:
        """Refuse unknown keys."""
        known = list(known)
        for key in self.content:
            if key not in known:
                near = did_you_mean(key, known) or f"; known here: {', '.join(known)}"
                raise ModelError(f"unknown key `{key}`{near}", table=self.name, key=key)
        return self

    def get(self, key: str, kind: type | tuple[type, ...], default: Any = _NEW) -> Any:
        """A value of the type wanted."""
        if key not in self.content:
            if default is _NEW:
                raise ModelError(f"`{key}` is missing", table=self.name)
            return default
        value = self.content[key]
        kinds = kind if isinstance(kind, tuple) else (kind,)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            wanted = " or ".join(_KINDS[k] for k in kinds)
            raise ModelError(f"{wanted} is wanted, not {kind_of(value)}", table=self.name, key=key)
        return value

    def names(self, key: str) -> list[str]:
        """A list of texts."""
        value = self.get(key, (list, str))
        value = [value] if isinstance(value, str) else value
        for item in value:
            if not isinstance(item, str):
                raise ModelError(
                    f"a list of names is wanted, and {item!r} is {kind_of(item)}", table=self.name, key=key
                )
        return value

    def expression(self, key: str, scope: Scope, value: Any = _NEW) -> sp.Expr:
        """A number, or the expression that a text is."""
        return expression(self.content[key] if value is _NEW else value, scope, table=self.name, key=key)


def expression(value: Any, scope: Scope, **where: str) -> sp.Expr:
    """A number, or the expression that a text is, in the scope of its place."""
    try:
        if isinstance(value, str):
            return parse(value, scope)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return exact(value)
        raise ModelError(f"a number or an expression in quotes is wanted, not {kind_of(value)}")
    except ModelError as error:
        raise error.placed(**where) from None


_KINDS = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    list: "a list",
    dict: "a table",
    bool: "true or false",
}


def kind_of(value: Any) -> str:
    """What a TOML value is, with its article."""
    return _KINDS.get(type(value), "a date" if hasattr(value, "isoformat") else type(value).__name__)


CURVE_KEYS = ("table", "outside", "interpolation", "columns", "units")


def one_of(entries: Entries, key: str, words: tuple[str, ...], default: str) -> str:
    """One of the words that a key may have."""
    word = entries.get(key, str, default)
    if word not in words:
        raise ModelError(
            f"`{key}` is {' or '.join(f'{w!r}' for w in words)}, not {word!r}", table=entries.name, key=key
        )
    return word


def noise_names(entries: Entries) -> list[str]:
    """Names of the noises, in either form of declaration."""
    if {"names", "intensity"} & set(entries.content):
        return entries.only(["names", "intensity"]).names("names")
    return list(entries.content)


def read_noise(entries: Entries, scope: Scope) -> Noise:
    """White noise: `w = "Q"` each, or `names` and `intensity` as a matrix."""
    names = noise_names(entries)
    try:
        if "intensity" not in entries.content and "names" not in entries.content:
            return Noise.independent({name: entries.expression(name, scope) for name in names})
        rows = entries.get("intensity", list)
        rows = [row if isinstance(row, list) else [row] for row in rows]
        matrix = [[entries.expression("intensity", scope, value) for value in row] for row in rows]
        return Noise(tuple(names), matrix)
    except ModelError as error:
        error.table = entries.name
        raise
