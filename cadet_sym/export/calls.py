"""The functions that a model's equations call, in C: each is written once, however often it is called."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import casadi as ca

from cadet_sym.errors import ExportError
from cadet_sym.export.functions import Calls, Program
from cadet_sym.export.graphs import choice, graph, mapped
from cadet_sym.export.program import translate
from cadet_sym.export.tables import Tables

__all__ = ["CalledFunctions"]


def _scalars(function: ca.Function, name: str, calls: Calls) -> Program:
    return translate(function, name, calls=calls, tables=calls.tables, plain=True)


WRITERS: Mapping[str, Callable[[ca.Function, str, Calls], Program]] = {
    "SXFunction": _scalars,
    "MXFunction": graph,
    "Map": mapped,
    "Switch": choice,
}
"""By CasADi's names of kinds of functions."""

NAME = "@self"
"""Stands for a function's name until its text, by which it is known again, is there."""


class CalledFunctions:
    """Functions and tables of constants of a library whose names begin with a prefix."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.texts: dict[str, Program] = {}  # by text; what is called stands before what calls it
        # by CasADi's hash, which is good while the function is there
        self.known: dict[int, tuple[Program, ca.Function]] = {}
        self.tables = Tables()

    def of(self, function: ca.Function) -> Program:
        """A function that is called, which is written if it is not yet.

        Raises
        ------
        ExportError
            If something in it has no C.
        """
        key = hash(function)
        if key not in self.known:
            self.known[key] = self._written(function), function
        return self.known[key][0]

    @property
    def chooses(self) -> bool:
        """Whether what is computed depends on the data."""
        return any(function.class_name() == "Switch" for _, function in self.known.values())

    def source(self, outside: Iterable[str]) -> str:
        """The text of all; those of `outside` may be called from other files."""
        public = set(outside)
        texts = [each.text if each.name in public else _private(each) for each in self.texts.values()]
        return "\n".join([self.tables.text, *texts])

    def header(self, outside: Iterable[str]) -> str:
        """Prototypes of those that may be called from other files."""
        public = set(outside)
        found = []
        for each in self.texts.values():
            if each.name in public:
                begin = each.text.index(f"void {each.name}(")
                found.append(f"{each.text[begin : each.text.index(')', begin)]});\n")
        return "".join(found)

    def _written(self, function: ca.Function) -> Program:
        writer = WRITERS.get(function.class_name())
        if writer is None:
            raise ExportError(f"`{function.name()}`, a {function.class_name()}, has no C")
        try:
            made = writer(function, NAME, self)
        except ValueError as error:
            raise ExportError(str(error)) from None
        if made.text not in self.texts:
            name = f"{self.prefix}_{function.name()}_{len(self.texts)}"
            self.texts[made.text] = Program(name, made.text.replace(NAME, name), made.scratch, made.counts, made.called)
        return self.texts[made.text]


def _private(program: Program) -> str:
    return program.text.replace(f"void {program.name}(", f"static void {program.name}(")
