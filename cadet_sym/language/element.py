"""A nonlinearity, declared once and called where it acts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.canonical import canonical
from cadet_sym.language.names import a, name_problem
from cadet_sym.language.vocabulary import ElementCall, NamedElement, symbol


@dataclass(frozen=True)
class Element:
    """A function of one or several arguments: a damper, a spring, a friction, a measured curve.

    Parameters
    ----------
    name : what it is called in rates and outputs.
    arguments : its arguments, as symbols; they shadow parameters of the same name.
    value : an expression in the arguments, parameters, `t` and other elements; or a measured curve (`Lookup`).
    text : a word about it.

    Calling it, `oleo(v)`, gives the expression to be used in a rate.
    """

    name: str
    arguments: Any  # a tuple of symbols
    value: Any
    text: str = field(default="", compare=False)
    elements: tuple[Element, ...] = field(init=False, compare=False, repr=False)  # called in `value`

    def __post_init__(self):
        set_field(self, "name", declared_name(self.name, "element", table="elements"))
        set_field(self, "arguments", tuple(map(symbol, declared_arguments(self.name, self.arguments))))
        try:
            set_field(self, "elements", tuple(harvest([self.value])))
            set_field(self, "value", canonical(self.value))
            self._require_arguments()
        except ModelError as error:
            raise error.placed(table=f"elements.{self.name}", key="value") from None

    def _require_arguments(self) -> None:
        """Something of its arguments is in its value, unless that is zero: an element that is switched off."""
        if self.value != 0 and not self.value.free_symbols & set(self.arguments):
            names = " or ".join(f"`{argument}`" for argument in self.arguments)
            raise ModelError(
                f"`{self.value}` is not a function of the state: there is no {names} in it; use it, or write this in the rate"
            )

    def __call__(self, *arguments: Any) -> sp.Expr:
        """The element at arguments, for use in a rate or an output."""
        if len(arguments) != len(self.arguments):
            wanted = len(self.arguments)
            plural = "s" if wanted != 1 else ""
            raise ModelError(f"the element `{self.name}` takes {wanted} argument{plural}, {len(arguments)} given")
        return ElementCall(NamedElement(self.name, self), *(sp.sympify(a, strict=True) for a in arguments))


def declared_arguments(element: str, given: Any) -> list[str]:
    """Names of the arguments of an element: one or more, each once."""
    where = {"table": f"elements.{element}", "key": "arguments"}
    listed = [given] if isinstance(given, sp.Symbol | str) else given
    names = [declared_name(argument, "argument", **where) for argument in listed]
    if not names or len(set(names)) != len(names):
        what = "no argument" if not names else "an argument twice"
        raise ModelError(f"the element `{element}` has {what}", **where)
    return names


def harvest(expressions: Iterable[Any]) -> list[Element]:
    """The elements called in expressions built in Python, and those that these call; each once, in order of name.

    Raises
    ------
    ModelError : two different elements of one name.
    """
    found: dict[str, Element] = {}
    waiting = [
        name.element
        for expr in expressions
        if isinstance(expr, sp.Basic)
        for name in sorted(expr.atoms(NamedElement), key=lambda n: n.name)
    ]
    while waiting:
        element = waiting.pop(0)
        known = found.setdefault(element.name, element)
        if known != element:
            raise ModelError(
                f"two different elements are called `{element.name}`: give one of them another name",
                table="elements",
                key=element.name,
            )
        if known is element:
            waiting.extend(e for e in element.elements if found.get(e.name) is not e)
    return list(found.values())


def written_out(body: sp.Expr, elements: Iterable[Element]) -> sp.Expr:
    """An expression with the values of elements in place of their calls, those that these call too."""
    known = {e.name: e for e in elements}
    while calls := body.atoms(ElementCall):
        table = {}
        for call in calls:
            called = known[call.name]
            known |= {e.name: e for e in called.elements}
            table[call] = called.value.xreplace(dict(zip(called.arguments, call.arguments, strict=True)))
        body = body.xreplace(table)
    return body


def declared_name(name: Any, kind: str, **where: str) -> str:
    """A name as declared, or ModelError that says why it cannot be one."""
    name = name.name if isinstance(name, sp.Symbol) else name
    if problem := name_problem(name):
        raise ModelError(f"`{name}` cannot be the name of {a(kind)}: {problem}", token=str(name), **where)
    return name


def set_field(record: Any, name: str, value: Any) -> None:
    """Set a field of a frozen record while it is made."""
    object.__setattr__(record, name, value)
