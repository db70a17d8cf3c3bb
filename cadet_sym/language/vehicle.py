"""The vehicle: its states and their rates, where it touches the ground, what is read off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.canonical import canonical
from cadet_sym.language.element import Element, declared_name, harvest, set_field
from cadet_sym.language.frozen import FrozenDict
from cadet_sym.language.vocabulary import symbol


@dataclass(frozen=True)
class Contact:
    """Where a wheel meets the ground.

    Parameters
    ----------
    setback : distance behind the leading wheel, a number or an expression in parameters; not negative.
    track : name of the track it runs on; wheels of one track meet the same ground.
    """

    setback: Any = sp.S.Zero
    track: str = "main"

    def __post_init__(self):
        set_field(self, "setback", canonical(self.setback))
        if not isinstance(self.track, str) or not self.track:
            raise ModelError(f"the track of a contact is a name, not {self.track!r}")


@dataclass(frozen=True)
class Vehicle:
    """A system of first-order equations, der(x) = rate, with contacts to the ground.

    Parameters
    ----------
    rates : state -> its rate; the order declared is the order of the results.
    contacts : contact -> `Contact`; the contact's symbol is the ground's height under it.
    outputs : name -> expression in states, contacts, `t`, elements and earlier outputs.
    elements : name -> `Element`; those called in rates and outputs need not be given.
    """

    rates: Mapping[Any, Any]
    contacts: Mapping[Any, Any] = field(default_factory=FrozenDict)
    outputs: Mapping[Any, Any] = field(default_factory=FrozenDict)
    elements: Mapping[str, Element] = field(default_factory=FrozenDict)
    order: tuple[sp.Symbol, ...] = field(init=False, repr=False)  # of results: states, then contacts

    def __post_init__(self):
        called = [*_values(self.rates), *_values(self.outputs)]
        set_field(self, "rates", _declared(self.rates, "state", "rates"))
        set_field(self, "contacts", FrozenDict(_contacts(self.contacts)))
        outputs = _declared(self.outputs, "output", "outputs")
        set_field(self, "outputs", FrozenDict((name.name, value) for name, value in outputs.items()))
        set_field(self, "elements", _elements(self.elements, called))
        set_field(self, "order", (*self.rates, *self.contacts))
        if not self.rates:
            raise ModelError("a system has at least one state: declare its rate", table="rates")

    @property
    def states(self) -> tuple[sp.Symbol, ...]:
        """The states in the order declared."""
        return tuple(self.rates)


def _values(table: Any) -> list[Any]:
    return list(table.values()) if isinstance(table, Mapping) else []


def entries(table: Any, what: str) -> list[tuple[Any, Any]]:
    """Items of a mapping, or ModelError that says what was given in its place."""
    if not isinstance(table, Mapping):
        raise ModelError(f"{what}: a mapping of names to values is wanted, not {type(table).__name__}")
    return list(table.items())


def _declared(table: Any, kind: str, where: str) -> FrozenDict[sp.Symbol, sp.Expr]:
    declared: dict[sp.Symbol, sp.Expr] = {}
    for key, value in entries(table, where):
        name = declared_name(key, kind, table=where)
        if symbol(name) in declared:
            raise ModelError(f"{kind} `{name}` is declared twice", table=where, key=name)
        try:
            declared[symbol(name)] = canonical(value)
        except ModelError as error:
            raise error.placed(table=where, key=name) from None
    return FrozenDict(declared)


def _contacts(table: Any) -> list[tuple[sp.Symbol, Contact]]:
    contacts = []
    for key, contact in entries(table, "contacts"):
        name = declared_name(key, "contact", table="contacts")
        if not isinstance(contact, Contact):
            raise ModelError("a Contact is wanted, as cs.Contact(setback=2.5)", table="contacts", key=name)
        contacts.append((symbol(name), contact))
    return contacts


def _elements(given: Any, called: list[Any]) -> FrozenDict[str, Element]:
    elements: dict[str, Element] = {}
    for name, element in entries(given, "elements"):
        if not isinstance(element, Element) or element.name != name:
            raise ModelError("an Element of that name is wanted", table="elements", key=str(name))
        elements[element.name] = element
    declared = [call for element in elements.values() for call in element.elements]
    for element in [*harvest(called), *declared]:
        if elements.setdefault(element.name, element) != element:
            raise ModelError(
                f"two different elements are called `{element.name}`: give one of them another name",
                table="elements",
                key=element.name,
            )
    return FrozenDict(elements)
