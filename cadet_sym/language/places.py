"""The declared names of a model, and the scope of every place in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from cadet_sym.errors import ModelError
from cadet_sym.language.names import a, did_you_mean
from cadet_sym.language.scope import Scope

_TABLES = {
    "parameter": "parameters",
    "state": "rates",
    "contact": "contacts",
    "element": "elements",
    "output": "outputs",
    "noise": "noise",
}
_ORDER = 8  # highest derivative of a contact that the grammar takes


@dataclass(frozen=True)
class Places:
    """Every declared name with its kind, and how many arguments each element takes."""

    kinds: Mapping[str, str]
    elements: Mapping[str, int]
    travels: bool

    @classmethod
    def declared(cls, *, elements: Mapping[str, int], travels: bool, **names: Iterable[str]) -> Places:
        """Collect the names of each kind; a name may be declared once."""
        kinds: dict[str, str] = {}
        for kind, declared in names.items():
            for name in declared:
                if name in kinds:
                    both = "declared twice" if kinds[name] == kind else f"{a(kinds[name])} and {a(kind)}"
                    raise ModelError(
                        f"`{name}` is {both}: one name, one thing; give one of them another name",
                        table=_TABLES[kind],
                        key=name,
                    )
                kinds[name] = kind
        return cls(kinds, dict(elements), travels)

    def of_kind(self, kind: str) -> list[str]:
        """Names of one kind, in the order declared."""
        return [name for name, k in self.kinds.items() if k == kind]

    def not_a_state(self, name: str) -> str:
        """The sentence for a name that should be a state and is not."""
        kind = self.kinds.get(name)
        states = self.of_kind("state")
        what = f"`{name}` is {a(kind)}, not a state" if kind else f"there is no state `{name}`"
        return what + did_you_mean(name, states)

    def _scope(self, place: str, allowed: Iterable[str], **more: object) -> Scope:
        return replace(Scope(place, self.kinds, frozenset(allowed)), **more)

    def parameter(self) -> Scope:
        """Value of a parameter."""
        return self._scope("a parameter", ["parameter"])

    def number(self, what: str) -> Scope:
        """Where a number stands, an expression in parameters may stand."""
        return self._scope(what, ["parameter"])

    def element(self, arguments: Iterable[str]) -> Scope:
        """Body of an element: its arguments, which shadow parameters, then parameters, `t` and other elements."""
        kinds = {**self.kinds, **dict.fromkeys(arguments, "argument")}
        scope = self._scope("an element", ["argument", "parameter"], elements=self.elements, time=True)
        return replace(scope, kinds=kinds)

    def rate(self) -> Scope:
        """Rate of a state."""
        return self._scope(
            "a rate",
            ["state", "parameter", "contact", "noise"],
            elements=self.elements,
            derivatives={"contact": _ORDER},
            time=True,
            distance=self.travels,
        )

    def output(self, name: str) -> Scope:
        """An output: it sees the outputs declared before it."""
        outputs = self.of_kind("output")
        later = outputs[outputs.index(name) :]
        scope = self._scope(
            "an output",
            ["state", "parameter", "contact", "output"],
            elements=self.elements,
            derivatives={"contact": _ORDER, "state": 1},
            time=True,
            distance=self.travels,
        )
        return replace(scope, kinds={**self.kinds, **dict.fromkeys(later, "later output")})

    def travel(self) -> Scope:
        """Speed or distance."""
        return self._scope("a speed history", ["parameter"], time=True)

    def intensity(self) -> Scope:
        """Intensity of white noise in time."""
        return self._scope("the intensity of a noise in time", ["parameter"], time=True)

    def initial(self) -> Scope:
        """Initial value of a state."""
        return self._scope("an initial value", ["parameter", "contact"], derivatives={"contact": _ORDER})

    def ground(self, states: Iterable[str], noises: Iterable[str]) -> Places:
        """The ground's own scope: its states and noises hide the vehicle's names, parameters stay."""
        kinds = {name: kind for name, kind in self.kinds.items() if kind in ("parameter", "element")}
        outer = {name: "vehicle's name" for name, kind in self.kinds.items() if kind not in ("parameter", "element")}
        own: dict[str, str] = {}
        for kind, names in (("state", states), ("noise", noises)):
            for name in names:
                if name in own or kinds.get(name) == "parameter":
                    other = own.get(name, "parameter")
                    raise ModelError(
                        f"`{name}` is {a(other)} and {a(kind)} of the ground: give one of them another name",
                        table="ground",
                        key=name,
                    )
                own[name] = kind
        return Places({**outer, **kinds, **own}, {}, True)

    def ground_rate(self) -> Scope:
        """Rate, in distance, of a state of the ground."""
        return self._scope("an equation of the ground", ["state", "parameter", "noise"], distance=True)

    def ground_height(self) -> Scope:
        """Height of the ground."""
        return self._scope("the height of the ground", ["state", "parameter"], distance=True)

    def ground_number(self) -> Scope:
        """A number of the ground: it may vary along it."""
        return self._scope("a number of the ground", ["parameter"], distance=True)
