"""Expectations without a closed form: Gauss-Legendre on panels between the moving kinks, denser where f is steep.

With u = (z - m)/s the integral of f(m + s u) phi(u) runs over |u| <= REACH between two kinks. A smooth stretch is cut into
panels of equal length. A steep place (centre c, width w: a zero of what stands under a root, the middle of a tanh) splits
it, and either side is run through by u = c +- w sinh(tau), which spreads the panels evenly over all scales from w to the
whole stretch (Johnston & Elliott 2005, Int. J. Numer. Meth. Engng 62, 564). At an end where f has a power that is not
an integer, z^q, the first panel is run through by u = a + L t^4.

The same code lays out the nodes in NumPy, where the error is estimated, and in CasADi.
"""

from __future__ import annotations

from collections.abc import Mapping
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
ROOT_TWO_PI = float(np.sqrt(2 * np.pi))

Sample = Mapping[sp.Symbol, float]  # numbers for the parameters, at which orders are chosen and errors estimated
Number = Any  # float, NumPy array or CasADi SX


@dataclass(frozen=True)
class Rule:
    """How many panels on a stretch, how many nodes on a panel."""

    panels: int
    order: int
    singular: int = 20  # nodes of the panel at a singular end


@dataclass(frozen=True)
class Integral:
    """A smooth expression between two kinks, of which the expectation is taken by quadrature."""

    lower: sp.Expr
    upper: sp.Expr
    value: sp.Expr
    argument: sp.Symbol
    steep: tuple[Steep, ...] = ()
    singular: tuple[bool, bool] = (False, False)  # at the lower, the upper end
    rule: Rule = Rule(4, 16)
    error: float = field(default=0.0, compare=False)

    @property
    def nodes(self) -> int:
        """Points at which the expression is evaluated."""
        halves = max(1, sum(place.sides for place in self.steep))
        return self.rule.order * self.rule.panels * halves + self.rule.singular * sum(self.singular)

    def derivative(self) -> Integral:
        """The same for the derivative of the expression."""
        return replace(self, value=sp.diff(self.value, self.argument))


@dataclass(frozen=True)
class Nodes:
    """Places u with weights that hold phi(u), as columns; on a panel at a singular end also the distance from it."""

    u: Number
    weight: Number
    distance: Number | None = None  # from the singular end, in standard deviations
    end: int = 0  # -1 at the lower end, 1 at the upper one
    end_u: Number = 0.0
    length: Number = 0.0


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
    nodes: list[Nodes] = []
    start, end = low, high
    share = SINGULAR_LENGTH if sum(part.singular) < 2 else SINGULAR_LENGTH / 2
    if part.singular[0]:
        start = xp.fmin(low + SINGULAR_LENGTH, low + (high - low) * share / SINGULAR_LENGTH)
        nodes.append(_graded(low, start - low, -1, part.rule.singular, xp, column))
    if part.singular[1]:
        end = xp.fmax(high - SINGULAR_LENGTH, high - (high - low) * share / SINGULAR_LENGTH)
        nodes.append(_graded(high, high - end, 1, part.rule.singular, xp, column))
    t, w = (column(x) for x in _composite(part.rule))
    if not steep:
        u = start + (end - start) * t
        nodes.append(Nodes(u, w * (end - start) * _density(u, xp)))
        return nodes
    places = _sorted([_projected(c, w0, start, end, xp) for c, w0 in steep], xp)
    for i, (centre, width) in enumerate(places):
        left = start if i == 0 else (places[i - 1][0] + centre) / 2
        right = end if i == len(places) - 1 else (centre + places[i + 1][0]) / 2
        for bound, sign, used in ((left, -1, part.steep[i].left), (right, 1, part.steep[i].right)):
            if used:
                nodes.append(_stretched(centre, width, sign * (bound - centre), sign, t, w, xp))
    return nodes


def _density(u: Number, xp: Any) -> Number:
    return xp.exp(-u * u / 2) / ROOT_TWO_PI


def _graded(end: Number, length: Number, side: int, order: int, xp: Any, column: Any) -> Nodes:
    t, w = legendre(order)
    distance = length * column(t**SINGULAR_POWER)
    u = end - side * distance
    weight = length * column(SINGULAR_POWER * t ** (SINGULAR_POWER - 1) * w) * _density(u, xp)
    return Nodes(u, weight, distance, side, end, length)


def _projected(centre: Number, width: Number, low: Number, high: Number, xp: Any) -> tuple[Number, Number]:
    """A steep place outside the stretch acts on its nearest end, as wide as it is far."""
    inside = xp.fmin(xp.fmax(centre, low), high)
    far = xp.fmin(xp.fabs(centre - inside), WIDEST)
    return inside, xp.fmin(xp.sqrt(xp.fmin(width, WIDEST) ** 2 + far**2) + NARROWEST, WIDEST)


def _sorted(places: list[tuple[Number, Number]], xp: Any) -> list[tuple[Number, Number]]:
    """Sort by centre with compare-exchange steps, which work on symbols."""
    where = xp.if_else if hasattr(xp, "if_else") else xp.where
    places = list(places)
    for last in range(len(places) - 1, 0, -1):
        for i in range(last):
            (a, u), (b, v) = places[i], places[i + 1]
            swap = a > b
            places[i] = where(swap, b, a), where(swap, v, u)
            places[i + 1] = where(swap, a, b), where(swap, u, v)
    return places


def _stretched(centre: Number, width: Number, length: Number, sign: int, t: Number, w: Number, xp: Any) -> Nodes:
    """From the centre outwards by u = c +- width sinh(tau)."""
    ratio = length / width
    top = xp.log(ratio + xp.sqrt(ratio * ratio + 1))
    grow = xp.exp(top * t)
    u = centre + sign * (width / 2) * (grow - 1 / grow)
    weight = w * top * (width / 2) * (grow + 1 / grow) * _density(u, xp)
    return Nodes(u, weight)


def integral(cell: Cell, value: sp.Expr, z: sp.Symbol, where: str, sample: Sample) -> Integral:
    """Find the steep places and singular ends of a piece, and the order that its accuracy needs."""
    from cadet_sym.expectation.accuracy import chosen

    singular = (singular_at(value, z, cell.lower), singular_at(value, z, cell.upper))
    steep = tuple(steep_places(value, z, cell, singular))
    part = Integral(cell.lower, cell.upper, cell.indicated(value), z, steep, singular)
    return chosen(part, where, sample)
