"""Where the nodes of a quadrature go: between the moving kinks, denser where f is steep.

With u = (z - m)/s the integral of f(m + s u) phi(u) runs over |u| <= REACH between two kinks.

- A smooth stretch is taken by Gauss-Legendre.
- A pole of f off the line, at c +- i w (a zero of what stands under a root, the middle of a tanh), splits it, and either side
  is run through by u = c +- l asinh((w/l) sinh(tau)): nodes spread evenly over all scales from w, as in the sinh substitution
  of Johnston & Elliott (2005, Int. J. Numer. Meth. Engng 62, 564), up to l, from where on they are equally spaced, as the
  normal density wants it. On the whole line the same substitution makes one integral of both sides for the trapezoidal rule,
  which converges geometrically.
- A step of width w (a kink smoothed by a normal distribution) splits it, and either side is split where the step is over.
- From an end where f has a power that is not an integer, z^q, it is run through by u = a + t^power.

The same code lays out the nodes in NumPy, where the error is estimated, and in CasADi.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from cadet_sym.expectation.algebra import Algebra, Number
from cadet_sym.expectation.quadrature import Integral

REACH = 8.0  # standard deviations from the mean; 1e-15 of the probability lies beyond
PANEL = 1.5  # length of the panel at a singular end where something else is steep, in standard deviations
WIDEST = 100.0  # a steep place wider or farther than this many standard deviations is none
NARROWEST = 1e-9  # what is steeper counts as a kink
MERGED = 1e-6  # beyond this, and twice their distance, two roots are one
MERGED_POLE = 0.05  # the same of a pole and a singular end
TINY = 1e-100
STEP_REACH = 8.2  # widths beyond which a step is over to 2e-16
SPACED = 2.0  # l, standard deviations from a pole beyond which nodes are equally spaced
LONGEST, STEEPEST, FEWEST = 4.2, 1.6, 2  # standard deviations, and by how much exp tau grows, on a part for a polynomial
ROOT_TWO_PI = float(np.sqrt(2 * np.pi))


@dataclass(frozen=True)
class Nodes:
    """Places u with weights, as columns; if the stretch has a singular end, also the distance from it."""

    u: Number
    weight: Number
    distance: Number | None = None  # from the singular end, in standard deviations; positive
    length: Number | None = None  # of the panel, if it begins at the singular end


@cache
def legendre(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return (nodes + 1) / 2, weights / 2


@cache
def composite(panels: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on [0, 1] of panels of equal length."""
    nodes, weights = legendre(order)
    starts = np.arange(panels)[:, None]
    return ((starts + nodes) / panels).ravel(), np.tile(weights / panels, panels)


@dataclass(frozen=True)
class Panel:
    """A stretch of the line, and how it is run through by nodes on [0, 1]."""

    run: Callable[..., Nodes]  # (t, w, algebra, numbers) -> nodes, the weights without a density
    numbers: tuple[Number, ...]
    length: Number  # of the stretch, in whatever runs through it; zero if there is nothing of it
    parts: int  # of equal length in that, with so many nodes each
    order: int

    @property
    def rule(self) -> tuple[np.ndarray, np.ndarray]:
        """t, w."""
        return composite(self.parts, self.order)

    def cuts(self, xp: Algebra) -> list[Number]:
        """Places u that cut it for a polynomial on each part, in its own order; the last ones are its end if it takes fewer."""
        first, last = (self.nodes(t, 0.0, xp).u for t in (0.0, 1.0))
        needed = xp.fmax(xp.ceil(xp.fabs(last - first) / LONGEST), xp.ceil(self.length / STEEPEST))
        needed = xp.fmin(xp.fmax(needed, FEWEST), self.parts)
        return [first, *(self.nodes(xp.fmin(k / needed, 1.0), 0.0, xp).u for k in range(1, self.parts)), last]

    def nodes(self, t: Number, w: Number, xp: Algebra) -> Nodes:
        """The nodes that those on [0, 1] become."""
        return self.run(t, w, xp, *self.numbers)


def _straight(t: Number, w: Number, xp: Algebra, low: Number, high: Number) -> Nodes:
    return Nodes(low + (high - low) * t, w * (high - low))


def _graded(t: Number, w: Number, xp: Algebra, end: Number, first: Number, last: Number) -> Nodes:
    """By u = end + tau^4."""
    tau = first + (last - first) * t
    distance = tau**4
    return Nodes(end + distance, 4 * tau**3 * (last - first) * w, distance)


@dataclass(frozen=True)
class _FromEnd:
    """By u = end + stop t^power."""

    power: int

    def __call__(self, t: Number, w: Number, xp: Algebra, end: Number, stop: Number) -> Nodes:
        distance = stop * t**self.power
        return Nodes(end + distance, stop * (self.power * t ** (self.power - 1) * w), distance, stop)


def _stretched(
    t: Number, w: Number, xp: Algebra, centre: Number, width: Number, first: Number, last: Number, sign: int
) -> Nodes:
    """By u = centre + sign l asinh((w/l) sinh(tau))."""
    grow = xp.exp(first + (last - first) * t)
    distance, slope = _distances(grow, 1 / grow, width, _spacing(width, xp), xp)
    return Nodes(centre + sign * distance, w * (last - first) * slope)


def _spacing(width: Number, xp: Algebra) -> Number:
    """l of a pole."""
    return xp.sqrt(width * width + SPACED**2)


def _distances(grow: Number, fall: Number, width: Number, length: Number, xp: Algebra) -> tuple[Number, Number]:
    """Distance from a pole and its derivative in tau, where exp(tau) = grow = 1/fall."""
    half = width / 2
    ratio = (half / length) * (grow - fall)
    return length * xp.asinh(ratio), half * (grow + fall) / xp.sqrt(ratio * ratio + 1)


def lay_out(part: Integral, low: Number, high: Number, steep: list[tuple[Number, Number]], xp: Algebra) -> list[Nodes]:
    """Nodes on the stretch from low to high, which lies within reach, their weights with the normal density.

    Parameters
    ----------
    low, high : ends of the stretch in u; the true ends if within reach, else -REACH, REACH.
    steep : centre and width in u of each of `part.steep`.
    xp : the algebra of the numbers.
    """
    if part.is_trapezoidal:
        return [_Layout(part, xp).trapezoidal(low, high, *steep[0])]
    if not part.has_panels:
        u, w = np.polynomial.hermite_e.hermegauss(part.rule.straight)
        return [Nodes(xp.column(u), xp.column(w / ROOT_TWO_PI))]
    found = []
    for panel in panels(part, low, high, steep, xp):
        nodes = panel.nodes(xp.column(panel.rule[0]), xp.column(panel.rule[1]), xp)
        nodes = replace(nodes, weight=nodes.weight * density(nodes.u, xp))
        found.append(finished(part, nodes, -high if part.singular[1] else low, xp))
    return found


def panels(
    part: Integral,
    low: Number,
    high: Number,
    steep: list[tuple[Number, Number]],
    xp: Algebra,
    narrowest: float = NARROWEST,
) -> list[Panel]:
    """The stretches into which one is cut, whose nodes have yet to be `finished`; no steep place is taken as narrower."""
    layout = _Layout(part, xp, narrowest)
    if part.singular[1]:  # the singular end comes first
        low, high, steep = -high, -low, [(-centre, width) for centre, width in steep]
    return layout.split(low, high, steep) if steep else layout.smooth(low, high)


def finished(part: Integral, nodes: Nodes, end: Number, xp: Algebra) -> Nodes:
    """The nodes with their distance from a singular end, if there is one, turned round if the stretch was."""
    if not any(part.singular):
        return nodes
    distance = nodes.u - end if nodes.distance is None else nodes.distance
    return replace(nodes, u=-nodes.u if part.singular[1] else nodes.u, distance=xp.fmax(distance, TINY))


def density(u: Number, xp: Algebra) -> Number:
    """phi(u)."""
    return xp.exp(u * u * -0.5) * (1 / ROOT_TWO_PI)


@dataclass(frozen=True)
class _Place:
    """A steep place inside the stretch, and how both its sides are run through."""

    centre: Number
    scale: Number  # on which the sides are graded
    over: Number  # where a step is over; far away for a pole
    reach: Number  # how far it is seen beside another: so far, too; not at all for a pole


class _Layout:
    """Lays out one stretch; the singular end, if there is one, is the lower one."""

    def __init__(self, part: Integral, xp: Algebra, narrowest: float = NARROWEST):
        self.part, self.rule, self.xp, self.narrowest = part, part.rule, xp, narrowest
        self.singular = any(part.singular)
        self.has_steps = any(place.step for place in part.steep)
        self.has_roots = any(place.root for place in part.steep)
        self.has_poles = not all(place.step for place in part.steep)

    # -- nothing steep --------------------------------------------------------------------------------------------

    def smooth(self, low: Number, high: Number) -> list[Panel]:
        """One panel, and a graded one at a singular end."""
        if not self.singular:
            return [self.straight(low, high)]
        return [self.graded(low, 0.0, high - low)] if self.rule.whole else self.from_end(low, high - low)

    def straight(self, low: Number, high: Number) -> Panel:
        """One panel, which may be as long as the whole stretch."""
        parts, order = (self.rule.panels, self.rule.order) if self.rule.cut else (1, self.rule.straight)
        return Panel(_straight, (low, high), high - low, parts, order)

    def from_end(self, end: Number, length: Number) -> list[Panel]:
        """From a singular end inwards: a graded panel, then a straight one."""
        first = self.xp.fmin(length, PANEL)
        return [self.graded(end, 0.0, first), self.straight(end + first, end + length)]

    def graded(self, end: Number, start: Number, stop: Number) -> Panel:
        """From start to stop away from a singular end, by u = end + t^power."""
        if isinstance(start, float) and start == 0:
            return Panel(_FromEnd(self.rule.power), (end, stop), stop, 1, self.rule.graded)
        first, last = self.root(start), self.root(stop)
        return Panel(_graded, (end, first, last), last - first, 1, self.rule.graded)

    def root(self, x: Number) -> Number:
        """The inverse of the substitution at a singular end, of power 4."""
        return self.xp.sqrt(self.xp.sqrt(x + TINY))

    # -- steep places ---------------------------------------------------------------------------------------------

    def trapezoidal(self, low: Number, high: Number, centre: Number, width: Number) -> Nodes:
        """The whole line in equal steps of tau, u = c + width sinh(tau)."""
        count = self.rule.order
        centre, width = map(self.xp.frozen, self.projected(centre, width, low, high))
        length = _spacing(width, self.xp)
        first = -self.substituted(centre - low, width, length)
        last = self.substituted(high - centre, width, length)
        step = (last - first) / (count - 1)
        up, down = self.xp.geometric(first, step, count)
        distance, slope = _distances(up, down, width, length, self.xp)
        u = centre + distance
        return Nodes(u, step * slope * density(u, self.xp))

    def split(self, low: Number, high: Number, steep: list[tuple[Number, Number]]) -> list[Panel]:
        """Both sides of every steep place, up to half the way to the next one."""
        places = self.sorted_places(low, high, steep)
        sides = self.part.steep[0]
        nodes: list[Panel] = []
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
                nodes += self.side(place, after, place.centre - left, -1) if sides.left else []
                behind = place.centre - low if self.singular else None
                nodes += self.side(place, before, right - place.centre, 1, behind) if sides.right else []
        return nodes

    def sorted_places(self, low: Number, high: Number, steep: list[tuple[Number, Number]]) -> list[_Place]:
        """The places in order, those outside moved to the nearest end."""
        rows = []
        for (centre, width), kind in zip(steep, self.part.steep, strict=True):
            inside, wide = self.projected(centre, width, low, high)
            if self.singular:  # what lies beyond the singular end is mirrored there, that no panel but the first begins at it
                inside = self.xp.fmin(self.xp.fmax(centre, 2 * low - centre), high)
            if not kind.step:
                wide = self.xp.frozen(wide)
                rounded = self.xp.frozen(inside) if kind.sides == 2 else inside
                inside = self.xp.fmin(self.xp.fmax(rounded, low), high)  # not beyond an end where f has no values
            over = STEP_REACH * wide
            if kind.joined:
                rows[-1] = (rows[-1][0], wide, *rows[-1][2:])
            else:
                rows.append((inside, WIDEST, over, over) if kind.step else (inside, wide, WIDEST, 0.0))
        return [_Place(*row) for row in _sorted(rows, self.xp)]

    def side(
        self, place: _Place, other: _Place | None, length: Number, sign: int, behind: Number | None = None
    ) -> list[Panel]:
        """One side of a steep place; `other` is the next one on its other side, a singular end so far `behind`."""
        xp, scale, ends = self.xp, place.scale, [length]
        if behind is not None:
            scale = xp.fmin(scale, behind + MERGED)
        if self.has_steps:
            ends.insert(0, xp.fmin(place.over, 0.45 * length))
        if other is not None:
            far = xp.fabs(place.centre - other.centre)
            scale = xp.fmin(scale, xp.sqrt(far**2 + other.scale**2))
            if self.has_steps:  # either step may be over first
                rest = xp.fmin(xp.fmax(other.reach - far, 0.0), 0.45 * length)
                ends[:1] = xp.fmin(rest, ends[0]), xp.fmax(rest, ends[0])
        return [self.stretched(place.centre, scale, begin, end, sign) for begin, end in pairwise([0.0, *ends])]

    def stretched(self, centre: Number, width: Number, start: Number, end: Number, sign: int) -> Panel:
        """From start to end away from a pole."""
        length = _spacing(width, self.xp)
        first, last = self.substituted(start, width, length), self.substituted(end, width, length)
        return Panel(_stretched, (centre, width, first, last, sign), last - first, self.rule.panels, self.rule.order)

    def substituted(self, distance: Number, width: Number, length: Number) -> Number:
        """tau at a distance from a pole: sinh(tau) = (l/w) sinh(distance/l)."""
        if isinstance(distance, float) and distance == 0:
            return 0.0
        grow = self.xp.exp(distance / length)
        return self.xp.asinh((length / width / 2) * (grow - 1 / grow))

    def projected(self, centre: Number, width: Number, low: Number, high: Number) -> tuple[Number, Number]:
        """A steep place outside the stretch acts on its nearest end, as wide as it is far."""
        xp = self.xp
        inside = xp.fmin(xp.fmax(centre, low), high)
        far = xp.fmin(xp.fabs(centre - inside), WIDEST)
        return inside, xp.fmin(xp.sqrt(xp.fmin(width, WIDEST) ** 2 + far**2) + self.narrowest, WIDEST)

    def away_from_end(self, end: Number, place: _Place, right: Number) -> list[Panel]:
        """The side of the first place that looks away from a singular end, perhaps a very near one; both may be roots."""
        xp = self.xp
        length = right - end
        start = place.centre - end
        if self.has_roots or not self.has_steps:
            merged = MERGED if self.has_roots else MERGED_POLE
            near = xp.fmin(start, length / 2)
            far = xp.fmin(near + merged, right - place.centre)
            scale = start + merged if self.has_roots else xp.fmin(place.scale, start + merged)
            return [
                self.stretched(place.centre, place.scale, 0.0, near, 1),
                self.graded(end, start + near, start + far),
                self.stretched(place.centre, scale, far, right - place.centre, 1),
            ]
        found, begin = [], start
        over = start + xp.fmin(xp.fmin(place.over, PANEL), 0.45 * (length - start))
        if self.has_poles:  # nearer to one than the end is, that is what nodes are laid out for
            begin = xp.where(place.reach > 0, start, xp.fmin(2 * start, over))
            found.append(self.stretched(place.centre, place.scale, 0.0, begin - start, 1))
        last = xp.fmin(xp.fmax(over, PANEL), length)
        return [
            *found,
            self.graded(end, begin, over),
            self.graded(end, over, last),
            self.straight(end + last, right),
        ]


def _sorted(rows: list[tuple[Number, ...]], xp: Algebra) -> list[tuple[Number, ...]]:
    """Sort by the first entries with compare-exchange steps, which work on symbols."""
    rows = list(rows)
    for last in range(len(rows) - 1, 0, -1):
        for i in range(last):
            a, b = rows[i], rows[i + 1]
            swap = a[0] > b[0]
            rows[i] = tuple(xp.where(swap, v, u) for u, v in zip(a, b, strict=True))
            rows[i + 1] = tuple(xp.where(swap, u, v) for u, v in zip(a, b, strict=True))
    return rows
