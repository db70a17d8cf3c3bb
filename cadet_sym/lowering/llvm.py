"""Write a CasADi function, with all that it calls, in LLVM's intermediate language.

A function takes a pointer for every argument and every result. Each is written once, however often it is called, under a name
that follows from its text: what is the same is shared, and a text is the same whenever it is written.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping

import casadi as ca

from cadet_sym.lowering.graphs import choice, graph, mapped
from cadet_sym.lowering.instructions import PRELUDE, declarations
from cadet_sym.lowering.scalars import scalars

__all__ = ["intermediate"]

WRITERS: Mapping[str, Callable[..., list[str]]] = {
    "SXFunction": scalars,
    "MXFunction": graph,
    "Map": mapped,
    "Switch": choice,
}
"""By CasADi's names of kinds of functions."""


def intermediate(function: ca.Function, name: str) -> str:
    """The function as LLVM's text, under a name.

    Raises
    ------
    ValueError
        If something in it is not known here.
    """
    return _Module().text(function, name)


class _Module:
    """Functions that call each other, each under a name made of its text."""

    def __init__(self) -> None:
        self.kinds: set[str] = set()
        self.loops: dict[str, str] = {}
        self.texts: dict[str, str] = {}  # by name; what is called stands before what calls it
        # by CasADi's hash, which is good while the function is there, and by what was made of it
        self.known: dict[tuple[int, ...], tuple[str, ca.Function]] = {}

    def text(self, function: ca.Function, name: str) -> str:
        """All of it, with a function that is called from elsewhere."""
        whole = "\n".join(self._written(function)).replace("define internal void @self(", "define void @self(")
        whole = whole.replace("@self", f"@{name}")
        return "\n".join([PRELUDE, *declarations(self.kinds), *self.loops.values(), *self.texts.values(), whole])

    def name_of(self, function: ca.Function) -> str:
        """The name of a function that is called, which is written if it is not yet."""
        return self.named(function, (), lambda: self._written(function))

    def named(self, function: ca.Function, variant: tuple[int, ...], write: Callable[[], list[str]]) -> str:
        """The same of what makes use of that function in one way or another."""
        key = hash(function), *variant
        if key not in self.known:
            text = "\n".join(write()) + "\n"
            name = f"{function.name()}.{hashlib.sha256(text.encode()).hexdigest()[:16]}"
            self.known[key] = name, function
            self.texts[name] = text.replace("@self", f"@{name}")
        return self.known[key][0]

    def _written(self, function: ca.Function) -> list[str]:
        writer = WRITERS.get(function.class_name())
        if writer is None:
            raise ValueError(f"`{function.name()}`, a {function.class_name()}, has no machine code")
        return writer(function, self)
