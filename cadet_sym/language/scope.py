"""Which names may stand where, and the sentence that says why one may not."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.names import a
from cadet_sym.language.vocabulary import DISTANCE, FUNCTIONS, TIME, ElementCall, der

# what a name of a kind is called, and why it has no business in most places
_REASONS = {
    "noise": "`{name}` is white noise: it may enter a rate, linearly; here its variance would be infinite",
    "contact": "`{name}` is a contact: the ground's height may stand in a rate or an output, not in {place}",
    "state": "`{name}` is a state, which may not stand in {place}",
    "output": "`{name}` is an output, which may stand only in a later output",
    "element": "`{name}` is an element: write it with its arguments, `{name}(...)`",
    "later output": "`{name}` is declared later: an output may use the outputs above it",
    "vehicle's name": "`{name}` belongs to the vehicle: the ground's equations see only the ground's states "
    "and noises, parameters and `s`",
}


@dataclass(frozen=True)
class Scope:
    """The names that may stand in one place.

    Parameters
    ----------
    place : what the place is called in a message ("the rate of a state").
    kinds : every declared name and its kind: state, parameter, contact, element, output, noise, argument.
    allowed : the kinds that may stand here.
    derivatives : kind -> highest order of `der` of it that may stand here.
    elements : name -> number of arguments.
    time, distance : whether `t` and `s` may stand here.
    """

    place: str = ""
    kinds: Mapping[str, str] = field(default_factory=dict)
    allowed: frozenset[str] = frozenset()
    derivatives: Mapping[str, int] = field(default_factory=dict)
    elements: Mapping[str, int] = field(default_factory=dict)
    time: bool = False
    distance: bool = False
    open: bool = False

    def refusal(self, name: str) -> str | None:
        """Why `name` may not stand here, or None."""
        if self.open:
            return None
        if name in ("t", "s"):
            if self.time if name == "t" else self.distance:
                return None
            meaning = "time" if name == "t" else "distance"
            return f"{meaning}, `{name}`, may not stand in {self.place}"
        kind = self.kinds.get(name)
        if kind is None:
            return f"undeclared name `{name}`{self._near(name)}"
        if kind in self.allowed:
            return None
        return _REASONS.get(kind, "`{name}` may not stand in {place}").format(name=name, place=self.place)

    def call_refusal(self, name: str, count: int) -> str | None:
        """Why `name` may not be called with `count` arguments here, or None."""
        if self.open:
            return None
        if name not in self.elements:
            if name in self.kinds and self.kinds[name] != "element":
                return f"`{name}` is {a(self.kinds[name])}, not a function: multiply with `*`"
            if name in self.kinds:
                return f"the element `{name}` may not stand in {self.place}"
            return f"undeclared function or element `{name}`{self._near(name, calls=True)}"
        wanted = self.elements[name]
        if wanted != count:
            return f"the element `{name}` takes {wanted} argument{'s' if wanted != 1 else ''}, {count} given"
        return None

    def derivative_refusal(self, name: str, order: int) -> str | None:
        """Why `der(name, order)` may not stand here, or None."""
        if self.open or order == 0:
            return None if self.open else self.refusal(name)
        kind = self.kinds.get(name)
        if kind is None:
            return f"undeclared name `{name}`{self._near(name)}"
        if order <= self.derivatives.get(kind, 0):
            return None
        if kind == "state" and self.derivatives.get("state"):
            return (
                f"`der({name}, {order})`: of a state only the first derivative is known; take `der` of its rate's state"
            )
        if kind == "state" and "state" in self.allowed:
            return f"`der({name})`: the derivative of a state may stand in an output; in a rate, write that rate"
        if kind in ("contact", "state"):
            return f"`der({name})` may not stand in {self.place}"
        return f"`der` is taken of a contact or a state, and `{name}` is {a(kind)}"

    def check(self, expr: sp.Basic) -> None:
        """Raise ModelError for the first name in `expr` that may not stand here."""
        if self.open:
            return
        inner: set[sp.Basic] = set()
        for call in sorted(expr.atoms(der), key=str):
            _raise(self.derivative_refusal(str(call.of), call.order), str(call.of))
            inner.add(call.of)
        for call in sorted(expr.atoms(ElementCall), key=str):
            _raise(self.call_refusal(call.name, len(call.arguments)), call.name)
        bare = expr.replace(lambda e: isinstance(e, der), lambda e: sp.Integer(0)) if inner else expr
        for free in sorted(bare.free_symbols, key=str):
            name = "t" if free == TIME else "s" if free == DISTANCE else free.name
            _raise(self.refusal(name), name)

    def _near(self, name: str, *, calls: bool = False) -> str:
        known = [*self.elements, *FUNCTIONS] if calls else [n for n, k in self.kinds.items() if k in self.allowed]
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
        if near:
            return f"; did you mean {' or '.join(f'`{n}`' for n in near)}?"
        if calls:
            return ": declare it in [elements], or see the list of functions"
        return ": declare it in [parameters], or correct it"


ANYTHING = Scope(open=True)


def _raise(problem: str | None, token: str) -> None:
    if problem:
        raise ModelError(problem, token=token)
