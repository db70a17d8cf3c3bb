"""Expectations without a closed form: Gauss-Legendre on panels between the moving kinks, denser where f is steep.

With u = (z - m)/s the integral of f(m + s u) phi(u) runs over |u| <= REACH between two kinks. A smooth stretch is cut into
panels of equal length. A steep place (centre c, width w) splits it. If f has a pole there (at c +- i w: a zero of what
stands under a root, the middle of a tanh), either side is run through by u = c +- w sinh(tau), which spreads the panels
evenly over all scales from w to the whole stretch (Johnston & Elliott 2005, Int. J. Numer. Meth. Engng 62, 564). If it has
a step there (a kink smoothed by a normal distribution of width w), either side is split where the step is over. At an end
where f has a power that is not an integer, z^q, the first panel is run through by u = a + L t^4.

The same code lays out the nodes in NumPy, where the error is estimated, and in CasADi.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.expectation.pieces import Cell
from cadet_sym.expectation.steep import Steep, singular_at, steep_places

REACH = 8.2  # standard deviations from the mean; 2e-16 of the probability lies beyond
SINGULAR_LENGTH = 1.5  # of the panel at a singular end, in standard deviations
SINGULAR_POWER = 4
WIDEST = 100.0  # a steep place wider or farther than this many standard deviations is none
NARROWEST = 1e-13
TINY = 1e-100
STEP_REACH = 6.5  # widths beyond which a step is over to 4e-11
ROOT_TWO_PI = float(np.sqrt(2 * np.pi))

Number = Any  # float, NumPy array or CasADi SX


@dataclass(frozen=True)
class Wish:
    """How accurate an expectation shall be, and for what numbers of the parameters."""

    sample: Mapping[sp.Symbol, float]
    error: float = 2e-12


@dataclass(frozen=True)
class Rule:
    """How many panels on a stretch, how many nodes on a panel."""

    panels: int
    order: int
    singular: int = 20  # nodes of the panel at a singular end
    straight: int = 4  # panels where nothing is steep


@dataclass(frozen=True)
class Integral:
    """A smooth expression between two kinks, of which the expectation is taken by quadrature."""

    lower: sp.Expr
    upper: sp.Expr
    value: sp.Expr
    argument: sp.Symbol
    steep: tuple[Steep, ...] = ()
    singular: tuple[bool, bool] = (False, False)  # at the lower, the upper end; not at both
    rule: Rule = Rule(4, 16)
    error: float = field(default=0.0, compare=False)

    @property
    def nodes(self) -> int:
        """Points at which the expression is evaluated."""
        zones = 2 if any(place.step for place in self.steep) else 1
        panels = self.rule.panels * zones * sum(place.sides for place in self.steep)
        graded = 0
        if any(self.singular):
            panels += (2 if self.steep else 1) * self.rule.straight - self.rule.panels * zones * bool(self.steep)
            graded = self.rule.singular * (3 if self.steep else 1)
        elif not self.steep:
            panels = self.rule.straight
        return self.rule.order * panels + graded

    def derivative(self) -> Integral:
        """The same for the derivative of the expression."""
        return replace(self, value=sp.diff(self.value, self.argument))


@dataclass(frozen=True)
class Nodes:
    """Places u with weights that hold phi(u), as columns; if the stretch has a singular end, also the distance from it."""

    u: Number
    weight: Number
    distance: Number | None = None  # from the singular end, in standard deviations; positive
    length: Number | None = None  # of the panel, if it begins at the singular end


@cache
def legendre(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return (nodes + 1) / 2, weights / 2


def _composite(rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on [0, 1] of panels of equal length."""
    nodes, weights = legendre(rule.order)
    starts = np.arange(rule.panels)[:, None]
    return ((starts + nodes) / rule.panels).ravel(), np.tile(weights / rule.panels, rule.panels)


def lay_out(
    part: Integral, low: Number, high: Number, steep: list[tuple[Number, Number]], xp: Any, column: Any
) -> list[Nodes]:
    """Nodes on the stretch from low to high, which lies within reach.

    Parameters
    ----------
    low, high : ends of the stretch in u; the true ends if within reach, else -REACH, REACH.
    steep : centre and width in u of each of `part.steep`.
    xp : `numpy` or `casadi`.
    column : makes a column of constants, as `xp` wants it.
    """
    layout = _Layout(part, xp, column, mirrored=part.singular[1])
    if part.singular[1]:  # the singular end comes first
        low, high, steep = -high, -low, [(-centre, width) for centre, width in steep]
    nodes = layout.split(low, high, steep) if steep else layout.smooth(low, high)
    return [layout.finished(n, low) for n in nodes]


@dataclass(frozen=True)
class _Place:
    """A steep place inside the stretch, and how both its sides are run through."""

    centre: Number
    width: Number  # of the place itself
    scale: Number  # on which the sides are graded
    over: Number  # where a step is over; far away for a pole


@dataclass
class _Layout:
    """Lays out one stretch; the singular end, if there is one, is the lower one."""

    part: Integral
    xp: Any
    column: Any
    mirrored: bool

    def __post_init__(self):
        self.t, self.w = (self.column(x) for x in _composite(self.part.rule))
        self.singular = any(self.part.singular)

    def finished(self, nodes: Nodes, end: Number) -> Nodes:
        """The nodes with their distance from a singular end, turned round if the stretch was."""
        if not self.singular:
            return nodes
        distance = self.xp.fmax(nodes.u - end if nodes.distance is None else nodes.distance, TINY)
        return replace(nodes, u=-nodes.u if self.mirrored else nodes.u, distance=distance)

    def smooth(self, low: Number, high: Number) -> list[Nodes]:
        """Panels of equal length, and a graded one at a singular end."""
        if self.singular:
            return self.from_end(low, high - low)
        return [self.straight(low, high)]

    def straight(self, low: Number, high: Number) -> Nodes:
        """Panels of equal length, which may be as long as the whole stretch."""
        t, w = (self.column(x) for x in _composite(replace(self.part.rule, panels=self.part.rule.straight)))
        u = low + (high - low) * t
        return Nodes(u, w * (high - low) * _density(u, self.xp))

    def from_end(self, end: Number, length: Number) -> list[Nodes]:
        """From a singular end inwards: a graded panel, then straight ones."""
        first = self.xp.fmin(length, SINGULAR_LENGTH)
        return [self.graded(end, 0.0, first), self.straight(end + first, end + length)]

    def graded(self, end: Number, start: Number, stop: Number) -> Nodes:
        """From start to stop away from a singular end, by u = end + t^4."""
        t, w = (self.column(x) for x in legendre(self.part.rule.singular))
        first, last = _fourth_root(start, self.xp), _fourth_root(stop, self.xp)
        tau = first + (last - first) * t
        distance = tau**SINGULAR_POWER
        weight = SINGULAR_POWER * tau ** (SINGULAR_POWER - 1) * (last - first) * w
        u = end + distance
        at_end = isinstance(start, float) and start == 0
        return Nodes(u, weight * _density(u, self.xp), distance, stop if at_end else None)

    def split(self, low: Number, high: Number, steep: list[tuple[Number, Number]]) -> list[Nodes]:
        """Both sides of every steep place, up to half the way to the next one."""
        places = self.sorted_places(low, high, steep)
        nodes: list[Nodes] = []
        for i, place in enumerate(places):
            before = places[i - 1] if i else None
            after = places[i + 1] if i + 1 < len(places) else None
            left = (before.centre + place.centre) / 2 if before else low
            right = (place.centre + after.centre) / 2 if after else high
            if i == 0 and self.singular:
                left = (low + place.centre) / 2
                nodes += self.from_end(low, left - low)
                nodes += self.side(place, after, place.centre - left, -1)
                nodes += self.away_from_end(low, place, right)
            else:
                nodes += self.side(place, after, place.centre - left, -1) if self.part.steep[0].left else []
                nodes += self.side(place, before, right - place.centre, 1) if self.part.steep[0].right else []
        return nodes

    def sorted_places(
        self, low: Number, high: Number, steep: list[tuple[Number, Number]]
    ) -> list[_Place]:
        """The places in order, those outside moved to the nearest end."""
        rows = []
        for (centre, width), kind in zip(steep, self.part.steep, strict=True):
            inside, wide = _projected(centre, width, low, high, self.xp)
            scale, over = (WIDEST, STEP_REACH * wide) if kind.step else (wide, WIDEST)
            rows.append((inside, wide, scale, over))
        return [_Place(*row) for row in _sorted(rows, self.xp)]

    def side(self, place: _Place, other: _Place | None, length: Number, sign: int) -> list[Nodes]:
        """One side of a steep place; `other` is the next one on its other side."""
        xp, scale, over = self.xp, place.scale, place.over
        if other is not None:
            far = xp.fabs(place.centre - other.centre)
            scale = xp.fmin(scale, xp.sqrt(far**2 + other.scale**2))
            rest = other.over - far
            over = xp.fmin(over, xp.fmax(rest, 0) + (rest <= 0) * WIDEST)
        if not any(kind.step for kind in self.part.steep):
            return [self.stretched(place.centre, scale, 0.0, length, sign)]
        over = xp.fmin(over, 0.45 * length)
        return [
            self.stretched(place.centre, scale, 0.0, over, sign),
            self.stretched(place.centre, scale, over, length, sign),
        ]

    def stretched(self, centre: Number, width: Number, start: Number, end: Number, sign: int) -> Nodes:
        """From start to end away from the centre, by u = c +- width sinh(tau)."""
        xp = self.xp
        first, last = _asinh(start / width, xp), _asinh(end / width, xp)
        grow = xp.exp(first + (last - first) * self.t)
        u = centre + sign * (width / 2) * (grow - 1 / grow)
        weight = self.w * (last - first) * (width / 2) * (grow + 1 / grow) * _density(u, xp)
        return Nodes(u, weight)

    def away_from_end(self, end: Number, place: _Place, right: Number) -> list[Nodes]:
        """The side of the first place that looks away from a singular end, perhaps a very near one."""
        xp = self.xp
        length = right - end
        start = place.centre - end
        over = start + xp.fmin(xp.fmin(place.over, SINGULAR_LENGTH), 0.45 * (length - start))
        last = xp.fmin(xp.fmax(over, SINGULAR_LENGTH), length)
        return [
            self.graded(end, start, over),
            self.graded(end, over, last),
            self.straight(end + last, right),
        ]


def _density(u: Number, xp: Any) -> Number:
    return xp.exp(-u * u / 2) / ROOT_TWO_PI


def _asinh(x: Number, xp: Any) -> Number:
    return xp.log(x + xp.sqrt(x * x + 1))


def _fourth_root(x: Number, xp: Any) -> Number:
    return xp.sqrt(xp.sqrt(x + TINY)) if not isinstance(x, float) else x**0.25


def _projected(centre: Number, width: Number, low: Number, high: Number, xp: Any) -> tuple[Number, Number]:
    """A steep place outside the stretch acts on its nearest end, as wide as it is far."""
    inside = xp.fmin(xp.fmax(centre, low), high)
    far = xp.fmin(xp.fabs(centre - inside), WIDEST)
    return inside, xp.fmin(xp.sqrt(xp.fmin(width, WIDEST) ** 2 + far**2) + NARROWEST, WIDEST)


def _sorted(rows: list[tuple[Number, ...]], xp: Any) -> list[tuple[Number, ...]]:
    """Sort by the first entries with compare-exchange steps, which work on symbols."""
    where = xp.if_else if hasattr(xp, "if_else") else xp.where
    rows = list(rows)
    for last in range(len(rows) - 1, 0, -1):
        for i in range(last):
            a, b = rows[i], rows[i + 1]
            swap = a[0] > b[0]
            rows[i] = tuple(where(swap, v, u) for u, v in zip(a, b, strict=True))
            rows[i + 1] = tuple(where(swap, u, v) for u, v in zip(a, b, strict=True))
    return rows


def integrals(cell: Cell, value: sp.Expr, z: sp.Symbol, where: str, wish: Wish) -> Iterator[Integral]:
    """Find the steep places and singular ends of a piece, and the order that its accuracy needs."""
    from cadet_sym.expectation.accuracy import chosen

    for lower, upper, singular in stretches(cell, value, z):
        steep = tuple(steep_places(value, z, cell, singular))
        part = Integral(lower, upper, cell.indicated(value), z, steep, singular)
        yield chosen(part, where, wish)


def stretches(
    cell: Cell, value: sp.Expr, z: sp.Symbol
) -> list[tuple[sp.Expr, sp.Expr, tuple[bool, bool]]]:
    """A cell, or its two halves if the expression is singular at both ends."""
    lower, upper = cell.lower, cell.upper
    singular = singular_at(value, z, lower), singular_at(value, z, upper)
    if not all(singular):
        return [(lower, upper, singular)]
    middle = (lower + upper) / 2
    return [(lower, middle, (True, False)), (middle, upper, (False, True))]
