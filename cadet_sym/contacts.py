"""The ground as the contacts meet it: one copy of the filter for every setback of every track, heights along s(t).

Here is the chain rule: der(u) = V u', der(u, 2) = V' u' + V^2 u'', where u' = F (C xi + D w + o) + g' along the
ground.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, SPEED, SPEED_RATE, TIME, Lookup, der
from cadet_sym.language.ground import ShapingFilter
from cadet_sym.language.model import Model

__all__ = [
    "FilterCopy",
    "Heights",
    "NoiseSource",
    "at_wheel",
    "derivative_of",
    "filter_copies",
    "filter_rates",
    "travel_of",
]


@dataclass(frozen=True)
class NoiseSource:
    """One white noise as one column of the noise input sees it."""

    name: str
    domain: Literal["time", "distance"]
    track: str = ""
    setback: sp.Expr = sp.S.Zero  # the column is driven by w(s - setback)


@dataclass(frozen=True)
class FilterCopy:
    """The ground's shaping filter as one set of wheels meets it: one copy per setback of each track."""

    contact: str  # the first contact declared there gives the states their names
    contacts: Mapping[sp.Symbol, int]  # those whose height holds this filter's, and its weight there
    track: str  # two coherent tracks share a common and a difference filter, each a track of its own here
    setback: sp.Expr
    filter: ShapingFilter
    start: int  # index of its first state in the augmented system
    columns: tuple[int, ...]  # its columns of the noise input

    @property
    def states(self) -> slice:
        """Where its states are in the augmented system."""
        return slice(self.start, self.start + len(self.filter.states))


def filter_copies(model: Model, first: int) -> tuple[tuple[FilterCopy, ...], tuple[NoiseSource, ...]]:
    """Give every distinct setback of every track its copy of the filter, and every copy its noise columns.

    `first` is the index of the first filter state in the augmented system.
    """
    copies: list[FilterCopy] = []
    sources: list[NoiseSource] = []
    if model.noise is not None:
        sources += [NoiseSource(name, "time") for name in model.noise.names]
    met: dict[tuple[str, sp.Expr], dict[sp.Symbol, int]] = {}
    filters: dict[str, ShapingFilter] = {}
    for contact, where in model.vehicle.contacts.items():
        for track, road, weight in () if model.ground is None else model.ground.filters(where.track):
            filters[track] = road
            met.setdefault((track, sp.sympify(where.setback)), {})[contact] = weight
    for (track, setback), contacts in met.items():
        road = filters[track]
        columns = tuple(range(len(sources), len(sources) + road.D.cols))
        sources += [NoiseSource(f"{track}.w{j + 1}", "distance", track, setback) for j in range(road.D.cols)]
        name = next(iter(contacts)).name
        copies.append(FilterCopy(name, contacts, track, setback, road, first, columns))
        first += len(road.states)
    return tuple(copies), tuple(sources)


def filter_rates(copy: FilterCopy, states: tuple[sp.Symbol, ...], noises: tuple[sp.Dummy, ...]) -> list[sp.Expr]:
    """Rates of one filter copy in time: xi_dot = V (C xi + D w + o), at s - setback."""
    xi = sp.Matrix(states[copy.states])
    w = sp.Matrix([noises[j] for j in copy.columns])
    rates = copy.filter.C * xi + copy.filter.D * w + copy.filter.offset
    return [at_wheel(SPEED * rate, copy) for rate in rates]


def at_wheel(expression: sp.Expr, copy: FilterCopy) -> sp.Expr:
    """Take what depends on s at the wheel's own place, s - setback."""
    if copy.setback == 0:
        return expression
    return expression.xreplace({DISTANCE: DISTANCE - copy.setback})


class Heights:
    """What the ground height and its derivatives under each contact are in terms of the filter's states."""

    def __init__(
        self,
        model: Model,
        copies: tuple[FilterCopy, ...],
        states: tuple[sp.Symbol, ...],
        noises: tuple[sp.Dummy, ...],
    ) -> None:
        self.model, self.states, self.noises = model, states, noises
        self.copies_of = {
            contact: [copy for copy in copies if contact in copy.contacts] for contact in model.vehicle.contacts
        }
        self.known: dict[tuple[sp.Symbol, int], sp.Expr] = {}

    def substitute(self, expression: sp.Expr, where: str) -> sp.Expr:
        """Replace every contact and its derivatives; white noise stays as its dummy symbol."""
        table: dict[sp.Basic, sp.Expr] = {}
        for call in expression.atoms(der):
            contact, order = call.args
            if contact in self.copies_of:
                table[call] = self.derivative(contact, int(order), where)
        for contact in self.copies_of:
            if contact in expression.free_symbols:
                table[contact] = self.derivative(contact, 0, where)
        # Calls of `der` hold the contact itself: replace them first, and as a whole.
        calls = {k: v for k, v in table.items() if isinstance(k, der)}
        return expression.xreplace(calls).xreplace({k: v for k, v in table.items() if k not in calls})

    def derivative(self, contact: sp.Symbol, order: int, where: str) -> sp.Expr:
        """Derivative of the height with respect to time, by the chain rule along s(t)."""
        if (contact, order) not in self.known:
            chain = self._chain(order)
            parts = []
            for copy in self.copies_of[contact]:
                in_space = self._space_derivatives(copy, contact.name, order, where)
                total = sp.Add(*(factor * u for factor, u in zip(chain, in_space, strict=True)))
                parts.append(copy.contacts[contact] * total)
            self.known[contact, order] = sp.Add(*parts)
        return self.known[contact, order]

    def _space_derivatives(self, copy: FilterCopy, contact: str, order: int, where: str) -> list[sp.Expr]:
        """u, u', ..., u^(order) with respect to s; the last may contain white noise, no earlier one."""
        filter_ = copy.filter
        xi = sp.Matrix(self.states[copy.states])
        w = sp.Matrix([self.noises[j] for j in copy.columns])
        row, affine = sp.Matrix(filter_.F), sp.sympify(filter_.profile)
        derivatives = [(row * xi)[0] + affine]
        for k in range(1, order + 1):
            noise = (row * filter_.D).applyfunc(sp.expand)
            if not noise.is_zero_matrix and k < order:
                raise ModelError(_too_rough(contact, order, order - k, where))
            row, affine = (
                row.diff(DISTANCE) + row * filter_.C,
                (row * filter_.offset)[0] + derivative_of(affine, DISTANCE),
            )
            derivatives.append((row * xi)[0] + affine + (noise * w)[0])
        return [at_wheel(u, copy) for u in derivatives]

    def _chain(self, order: int) -> list[sp.Expr]:
        """Factors a_j of d^k u / dt^k = sum_j a_j u^(j), from a_j' + a_(j-1) V (Faa di Bruno)."""
        factors: list[sp.Expr] = [sp.S.One]
        for _ in range(order):
            shifted = [sp.S.Zero, *(SPEED * a for a in factors)]
            grown = [*(self._timederivative_of(a) for a in factors), sp.S.Zero]
            factors = [sp.expand(a + b) for a, b in zip(shifted, grown, strict=True)]
        return factors

    def _timederivative_of(self, factor: sp.Expr) -> sp.Expr:
        speed = travel_of(self.model)[0]
        jerk = derivative_of(derivative_of(speed, TIME), TIME) if factor.has(SPEED_RATE) else sp.S.Zero
        return sp.diff(factor, SPEED) * SPEED_RATE + sp.diff(factor, SPEED_RATE) * jerk + sp.diff(factor, TIME)


def derivative_of(expression: sp.Expr, variable: sp.Symbol) -> sp.Expr:
    """Derivative of an expression that has kinks; the model has refused jumps where they would matter."""
    tables = {table: table.as_piecewise() for table in expression.atoms(Lookup)}
    slope = sp.diff(expression.xreplace(tables), variable)
    return slope.replace(sp.DiracDelta, lambda *_: sp.S.Zero)


def _too_rough(contact: str, order: int, stages: int, where: str) -> str:
    more = "one more filter stage" if stages == 1 else f"{stages} more filter stages"
    return (
        f"{where}: the ground is too rough for `der({contact}, {order})`: its variance would be infinite. "
        f"It needs {more} between the white noise and the height; add `rolling_contact`."
    )


def travel_of(model: Model) -> tuple[sp.Expr, sp.Expr | None, sp.Expr]:
    """Speed, distance (if it is known in closed form) and the place of the start."""
    travel = model.travel
    if travel is None:
        return sp.S.Zero, sp.S.Zero, sp.S.Zero
    if travel.distance is not None:
        return derivative_of(travel.distance, TIME), travel.distance, travel.distance.xreplace({TIME: sp.S.Zero})
    speed = sp.sympify(travel.speed)
    return speed, travel.closed_distance(), sp.sympify(travel.start)
