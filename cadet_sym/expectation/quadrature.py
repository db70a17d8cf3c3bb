"""Expectations without a closed form: the smooth pieces between kinks, where each is steep, and the rule for its nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import sympy as sp

from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.steep import Steep, singular_at, steep_places
from cadet_sym.expectation.tame import growing


@dataclass(frozen=True)
class Wish:
    """How accurate an expectation shall be, and for what numbers of the parameters."""

    sample: Mapping[sp.Symbol, float]
    error: float = 2e-11
    scale: float = 1.0  # of the arguments: what one unit of the states is of them
    plain: bool = False  # steep places left alone: the inside of an integral over three arguments
    lean: bool = False  # nodes at kinks alone and fewer along curves: the inside is a sum over many itself
    outside: Mapping[sp.Symbol, tuple[sp.Expr, sp.Expr]] = field(default_factory=dict)  # bounds of arguments integrated over


@dataclass(frozen=True)
class Rule:
    """How many panels on a side of a steep place, how many nodes on a panel."""

    panels: int = 1
    order: int = 32
    straight: int = 32  # nodes where nothing is steep
    graded: int = 24  # nodes of a panel at a singular end
    power: int = 4  # of the substitution there
    whole: bool = False  # whether that panel is the whole stretch
    hermite: bool = False  # on the whole line, Gauss-Hermite, the least for what is as smooth as the density
    cut: bool = False  # into parts on which polynomials stand for it, at most so many a panel

    def finer(self) -> Rule:
        """Twice the nodes."""
        return replace(self, order=2 * self.order, straight=2 * self.straight, graded=2 * self.graded)


FEW, NARROW = 40, 10.0
"""Nodes on the whole line or on a side of a steep place, and how long the variable may be in which they are enough."""

TYPICAL = 3  # parts that a panel is cut into where the distribution is as wide as what is steep

PLAIN_RULE = Rule(panels=1, order=16, straight=20, graded=20, hermite=True)
PLAIN_ERROR = 1e-5  # what may be expected where f changes on the scale of its arguments


@dataclass(frozen=True)
class Integral:
    """A smooth expression between two kinks, of which the expectation is taken by quadrature."""

    lower: sp.Expr
    upper: sp.Expr
    value: sp.Expr
    argument: sp.Symbol
    steep: tuple[Steep, ...] = ()
    singular: tuple[bool, bool] = (False, False)  # at the lower, the upper end; not at both
    rule: Rule = Rule()
    error: float = field(default=0.0, compare=False)
    rate: sp.Expr = sp.S.Zero  # times exp(rate z), which moves the mean by rate p and leaves the value

    @property
    def singular_end(self) -> tuple[sp.Expr, int] | None:
        """The singular end, and 1 if it is the upper one, else -1."""
        return (self.upper, 1) if self.singular[1] else (self.lower, -1) if self.singular[0] else None

    @property
    def is_whole_line(self) -> bool:
        """Whether there is no kink at either end."""
        return bool(self.lower.is_infinite and self.upper.is_infinite)

    @property
    def is_trapezoidal(self) -> bool:
        """Whether one steep place on the whole line is taken by the trapezoidal rule."""
        return self.is_whole_line and len(self.steep) == 1 and not self.steep[0].step and not self.rule.cut

    @property
    def has_panels(self) -> bool:
        """Whether it is cut into panels, not taken as a whole by one of the rules for the whole line."""
        return not self.is_trapezoidal and not (self.rule.hermite and self.is_whole_line and not self.steep)

    @property
    def nodes(self) -> int:
        """Points at which the expression is evaluated."""
        rule, places = self.rule, [place for place in self.steep if not place.joined]
        zones = 1 + min(2, len(places)) if any(place.step for place in places) else 1
        if self.is_trapezoidal:
            return rule.order
        if any(self.singular) and not self.steep:
            return rule.graded if rule.whole else rule.graded + rule.straight
        if not self.steep:
            return rule.order * TYPICAL if rule.cut else rule.straight
        side = (TYPICAL if rule.cut else rule.panels) * rule.order * zones
        nodes = side * sum(place.sides for place in places)
        if any(self.singular) and (zones == 1 or any(place.root for place in places)):
            return nodes + side + 2 * rule.graded + rule.straight
        pole = 0 if all(place.step for place in self.steep) else rule.panels * rule.order
        return nodes - side + pole + 3 * rule.graded + 2 * rule.straight if any(self.singular) else nodes

    def finer(self) -> Integral:
        """The same with twice the nodes."""
        return replace(self, rule=self.rule.finer())

    @property
    def is_coarse(self) -> bool:
        """Whether fewer nodes would not be enough anywhere, or there is nothing steep that they are for."""
        return not self.steep or any(self.singular) or self.rule.panels * self.rule.order <= FEW

    def coarser(self) -> Integral:
        """The same with as few nodes as are enough where all that is steep is wide: where `NARROW` holds."""
        return self if self.is_coarse else replace(self, rule=replace(self.rule, panels=1, order=FEW))

    def derivative(self) -> Integral:
        """The same for the derivative of the expression."""
        return replace(self, value=sp.diff(self.value, self.argument))


def integrals(cell: Cell, value: sp.Expr, z: sp.Symbol, where: str, wish: Wish) -> Iterator[Integral]:
    """Find the steep places and singular ends of a piece, and the order that its accuracy needs."""
    from cadet_sym.expectation.accuracy import chosen

    for rate, rest in growing(value, cell, z):
        for part in _integrals(cell, rest, z, wish):
            yield replace(part if wish.plain else chosen(part, where, wish), rate=rate)


def _integrals(cell: Cell, value: sp.Expr, z: sp.Symbol, wish: Wish) -> Iterator[Integral]:
    for lower, upper, singular in stretches(cell, value, z):
        if wish.plain:
            yield Integral(lower, upper, cell.indicated(value), z, (), singular, PLAIN_RULE, PLAIN_ERROR)
            continue
        steep = tuple(steep_places(value, z, Cell.between(lower, upper), singular))
        steep = (_one_sided(steep[0], lower, upper, wish),) if len(steep) == 1 else steep
        yield Integral(lower, upper, cell.indicated(value), z, steep, singular)


def _one_sided(place: Steep, lower: sp.Expr, upper: sp.Expr, wish: Wish) -> Steep:
    """A steep place that for the numbers known lies beyond an end: the function is used on one side of it only."""
    known = {s: wish.sample[s] for e in (place.centre, lower, upper) for s in e.free_symbols if s in wish.sample}
    if any(e.free_symbols - known.keys() for e in (place.centre, lower, upper)):
        return place
    centre, low, high = (float(sp.N(e.subs(known))) for e in (place.centre, lower, upper))
    return replace(place, left=place.left and centre > low, right=place.right and centre < high)


def stretches(
    cell: Cell, value: sp.Expr, z: sp.Symbol, *, rough: bool = False
) -> list[tuple[sp.Expr, sp.Expr, tuple[bool, bool]]]:
    """A cell, or its two halves if the expression is singular at both ends, as a rough one is at any."""
    lower, upper = cell.lower, cell.upper
    singular = tuple(not end.is_infinite and (rough or singular_at(value, z, end)) for end in (lower, upper))
    singular = singular[0], singular[1]
    if not all(singular):
        return [(lower, upper, singular)]
    middle = (lower + upper) / 2
    return [(lower, middle, (True, False)), (middle, upper, (False, True))]
