"""Numbers as C: arrays, and constants to their last bit."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

__all__ = ["Tables", "array", "constant"]

NAME = "@table"
"""Stands for the name of a table while it is told by its text whether it is there."""


class Tables:
    """Constants of one file, each table of them once."""

    def __init__(self, prefix: str = "c") -> None:
        self.prefix = prefix
        self.names: dict[str, str] = {}  # by text

    def add(self, type: str, values: Iterable[str]) -> str:
        """The name of a table."""
        return self.names.setdefault(array(f"static const {type} {NAME}", values), f"{self.prefix}{len(self.names)}")

    @property
    def text(self) -> str:
        """All of them."""
        return "".join(f"{text.replace(NAME, name)}\n" for text, name in self.names.items())


def constant(value: float) -> str:
    """A number as C, to its last bit."""
    if value != value:
        return "(R)NAN"
    if value in (float("inf"), float("-inf")):
        return "(R)INFINITY" if value > 0 else "(-(R)INFINITY)"
    return f"{'TINY' if 0 < abs(value) < 1e-30 else 'K'}({value!r})"


def array(declaration: str, values: Iterable[str]) -> str:
    """A C array, at least one long, for C has no empty ones."""
    items = list(values) or ["0"]
    return f"{declaration}[{len(items)}] = {{\n{rows(items)}\n}};"


def rows(items: Iterable[str]) -> str:
    """Items between commas, in lines of moderate length; strings one a line."""
    items = list(items)
    if any('"' in item for item in items):
        return ",\n".join(f"    {item}" for item in items)
    return textwrap.fill(
        ", ".join(items), 116, initial_indent="    ", subsequent_indent="    ",
        break_long_words=False, break_on_hyphens=False,
    )
