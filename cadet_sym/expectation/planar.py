"""Functions of two arguments, smooth but for kinks in one, with no closed form inside: integrated over both at once.

The order is found at run time.

With z_o = m + s u the outer argument and z_i = m_i + L u + r v the inner one given it, u and v independent standard normal,

    E[f] = int phi(u) int phi(v) f dv du.

Either integral is taken in equal steps of a variable tau in which the poles of its integrand off the line, at c +- i w, lie
about pi/2 away however narrow they are, so that the error falls as exp(-pi^2/h):

    tau = (u/2) + sum_k asinh((u - c_k)/w_k)  for the outer,    sinh(tau) = sinh(v/2)/sin(w/2), from c on,  for the inner.

Poles of the outer integrand are those of f itself, for likely values of the other argument, and places where the mean of the
inner argument passes a pole. The step h belongs to the function; how many steps there are follows from the moments, on the
inner line for every outer node on its own: fewer, and over a shorter stretch, the farther out it is.

A function with kinks at values of one argument is a sum of functions that are zero but between two of these: that argument is
the outer one, and nodes on its line between the ends are those of Gauss and Legendre in tau.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from math import ceil, log

import numpy as np
import sympy as sp

from cadet_sym.expectation.algebra import Algebra, Number
from cadet_sym.expectation.panels import legendre
from cadet_sym.expectation.steep import Steep

REACH = 7.0  # of (u, v) from the mean; 2e-11 of the probability lies beyond
SHORTEST = 1.0  # half the inner line however far out u is
TAPER, LEAST = 0.7, 0.2  # how far steps grow with the distance from the mean
WIDER = 0.45  # by how much steps on the outer line are longer than on the inner one, without correlation
GAUSS, AT_ENDS = 1.4, 6  # how many more nodes a line takes that has an end
SPACED = 2.0  # standard deviations from a pole beyond which nodes are equally spaced
NARROWEST = 1e-9
HALF_PI = float(np.pi / 2)
ROOT_TWO_PI = float(np.sqrt(2 * np.pi))
FAR = 100.0
LIKELY = (-4.0, -2.0, 0.0, 2.0, 4.0)
LARGE = 1e50
PARALLEL = 1e-100  # a pole whose distance does not change with the outer argument is passed nowhere


@dataclass(frozen=True)
class Rungs:
    """Numbers of nodes, each so many times the one before, or the next multiple of one number."""

    first: int
    ratio: float
    length: int
    every: int = 1
    multiple: int = 1

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """The numbers, ascending."""
        exponents = range(self.length - 1, -1, -self.every)
        return tuple(self.multiple * ceil(self.first * self.ratio**k / self.multiple) for k in reversed(exponents))

    def index(self, steps: Number, xp: Algebra) -> Number:
        """Which of them makes as many steps: the smallest that does, or the last."""
        lowest = self.length - 1 - self.every * (len(self.counts) - 1)
        exponent = xp.log(xp.fmax(steps, 1.0) + 1) / log(self.ratio) - (log(self.first) / log(self.ratio) + lowest)
        return xp.fmin(xp.fmax(xp.ceil(exponent / self.every), 0), len(self.counts) - 1)


TOGETHER = 4  # nodes of an inner line that are taken at once, by which it is faster and larger
OUTER = Rungs(10, 1.19, 19)
INNER = Rungs(8, 1.12, 25, multiple=TOGETHER)


@dataclass(frozen=True)
class Moments:
    """Mean and standard deviation of the outer argument; the inner one given it is m_i + lean u + left v."""

    m: Number
    s: Number
    mean: Number
    lean: Number
    left: Number
    spread: Number  # of the inner argument not given anything


@dataclass(frozen=True)
class Planar:
    """A smooth function of two arguments, or the part of one between two values of one of them, and where it is steep."""

    outer: int  # index of the argument
    inner: int
    value: sp.Expr
    symbols: tuple[sp.Symbol, sp.Symbol]  # of the outer and of the inner argument
    own: tuple[Steep, ...]  # poles in the outer argument; their widths may depend on the inner one
    pole: Steep | None  # in the inner argument
    step: float = 0.2
    nodes: int = 0  # where the moments are of the order of the function's own scale
    error: float = 0.0
    counts: tuple[int, int] | None = None  # of nodes, outer and inner, where they are to be the same always
    lower: sp.Expr = sp.S.NegativeInfinity  # it is zero where the outer argument is not between these
    upper: sp.Expr = sp.S.Infinity

    @property
    def ends(self) -> tuple[tuple[sp.Expr, int], ...]:
        """Those that are finite, 1 at the lower and -1 at the upper one."""
        return tuple((end, side) for end, side in ((self.lower, 1), (self.upper, -1)) if not end.is_infinite)

    @property
    def free(self) -> frozenset[sp.Basic]:
        """Parameters."""
        return self.value.free_symbols.union(*(end.free_symbols for end, _ in self.ends)) - set(self.symbols)

    def outer_rule(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and weights on [0, 1]: equal steps where nothing is at either end, else those of Gauss and Legendre."""
        return legendre(count) if self.ends else (np.linspace(0, 1, count), np.full(count, 1 / (count - 1)))

    @cached_property
    def curve(self) -> sp.Expr | None:
        """A polynomial in both arguments that is zero at the centre of the pole; None if there is no pole, or no such."""
        if self.pole is None:
            return None
        outer, inner = self.symbols
        numerator, denominator = sp.fraction(sp.together(self.pole.centre))
        curve = sp.expand(denominator * inner - numerator)
        return curve if curve.is_polynomial(outer, inner) and sp.total_degree(curve, outer, inner) <= 2 else None

    @cached_property
    def slopes(self) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
        """The function and its derivatives in the outer and the inner argument."""
        return self.value, *(sp.diff(self.value, z) for z in self.symbols)

    @cached_property
    def course(self) -> tuple[tuple[sp.Expr, ...], tuple[sp.Expr, ...]]:
        """The curve and its two derivatives; its three second ones, nothing if it is straight."""
        curve, (x, y) = self.curve, self.symbols
        assert curve is not None
        across, rise = sp.diff(curve, x), sp.diff(curve, y)
        bends = sp.diff(across, x), sp.diff(across, y), sp.diff(rise, y)
        return (curve, across, rise), bends if any(bends) else ()

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of kinks."""
        return ((self.outer, end) for end, _ in self.ends)

    def expressions(self) -> Iterator[sp.Expr]:
        """Bounds."""
        return (end for end, _ in self.ends)

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """Arguments, centres and widths of poles off the line, where the other argument is zero."""
        for place, argument, gone in ((p, self.outer, self.symbols[1]) for p in self.own):
            yield argument, place.centre.subs(gone, 0), place.width.subs(gone, 0)


Evaluate = Callable[[sp.Expr, Mapping[sp.Symbol, Number]], Number]


class Layout:
    """Where the nodes go, in NumPy or CasADi."""

    def __init__(self, planar: Planar, evaluate: Evaluate, xp: Algebra, reach: float = REACH, step: float | None = None):
        self.planar, self.evaluate, self.xp, self.reach = planar, evaluate, xp, reach
        self.step = planar.step if step is None else step

    # -- the outer line -------------------------------------------------------------------------------------------

    def places(self, moments: Moments) -> list[tuple[Number, Number]]:
        """Centres and widths of what the outer integrand has near the line, in u."""
        found = [self._own(place, moments) for place in self.planar.own]
        found += self.passed(moments) if self.planar.pole else []
        return [self._projected(centre, width, self.reach) for centre, width in found]

    def _own(self, place: Steep, at: Moments) -> tuple[Number, Number]:
        """A pole of f in the outer argument: its place for likely values of the inner one, the narrowest counting most."""
        xp, (outer, inner) = self.xp, self.planar.symbols
        likely = [at.mean]
        if place.width.has(inner) or place.centre.has(inner):
            likely = [at.mean + k * at.spread for k in LIKELY]
            pole = self.planar.pole
            nearest = self._limited(self.evaluate(pole.centre, {outer: at.m})) if pole else 0.0
            likely.append(xp.fmax(xp.fmin(likely[-1], nearest), likely[0]))
        widths = [xp.fmin(self.evaluate(place.width, {outer: at.m, inner: y}), LARGE**2) + LARGE**-2 for y in likely]
        centres = [self._limited(self.evaluate(place.centre, {outer: at.m, inner: y})) for y in likely]
        narrow = reduce(xp.fmin, widths)
        weights = [(narrow / w) ** 2 for w in widths]
        centre = sum(c * w for c, w in zip(centres, weights, strict=True)) / sum(weights)
        return (centre - at.m) / at.s, narrow / at.s

    def passed(self, at: Moments) -> list[tuple[Number, Number]]:
        """Where the mean of the inner argument, given the outer one, passes the pole: a u^2 + b u + c = +- i size."""
        xp, (outer, inner) = self.xp, self.planar.symbols
        here, (slopes, bends) = {outer: at.m, inner: at.mean}, self.planar.course
        c, across, rise = (self.evaluate(e, here) for e in slopes)
        b = across * at.s + rise * at.lean
        if not bends:
            b = xp.where(xp.fabs(b) > PARALLEL, b, PARALLEL)
            u = -c / b
            return [(u, self._size(at, u, rise) / xp.fabs(b))]
        bend = [self.evaluate(e, here) for e in bends]
        a = (bend[0] * at.s * at.s + 2 * bend[1] * at.s * at.lean + bend[2] * at.lean * at.lean) / 2
        a = xp.where(xp.fabs(a) > PARALLEL, a, PARALLEL)
        real, imaginary = b * b - 4 * a * c, 4 * a * self._size(at, 0.0, rise)
        absolute = xp.sqrt(real * real + imaginary * imaginary)
        apart = xp.sqrt(xp.fmax(absolute + real, 0.0) / 2)
        beside = xp.sqrt(xp.fmax(absolute - real, 0.0) / 2)
        return [((-b + side * apart) / (2 * a), beside / xp.fabs(2 * a)) for side in (-1, 1)]

    def _size(self, at: Moments, u: Number, rise: Number) -> Number:
        """How far off zero the curve is at the pole, and what the rest of the inner argument adds to that."""
        pole = self.planar.pole
        assert pole is not None
        width = self.xp.fmin(self.evaluate(pole.width, {self.planar.symbols[0]: at.m + at.s * u}), LARGE**2)
        return self.xp.fabs(rise) * self.xp.sqrt(at.left * at.left + width * width)

    def _limited(self, place: Number) -> Number:
        return self.xp.fmax(self.xp.fmin(place, LARGE), -LARGE)

    def _projected(self, centre: Number, width: Number, reach: Number) -> tuple[Number, Number]:
        """A pole beyond reach acts on the nearest end, as wide as it is far."""
        xp = self.xp
        inside = xp.fmin(xp.fmax(centre, -reach), reach)
        far = xp.fmin(xp.fabs(centre - inside), FAR)
        return inside, xp.fmin(xp.sqrt(xp.fmin(width, FAR) ** 2 + far**2) + NARROWEST, FAR)

    def tau(self, u: Number, places: list[tuple[Number, Number]]) -> Number:
        """The variable in which nodes on the outer line are equally spaced."""
        return sum((self.xp.asinh((u - c) / w) for c, w in places), start=u / SPACED)

    def slope(self, u: Number, places: list[tuple[Number, Number]]) -> Number:
        """Its derivative."""
        total = 1 / SPACED
        for c, w in places:
            total = total + 1 / self.xp.sqrt((u - c) ** 2 + w * w)
        return total

    def ends(self, at: Moments) -> tuple[Number, Number]:
        """Where the outer line begins and ends."""
        low, high = (
            sign * self.reach if end.is_infinite else self._within((self.evaluate(end, {}) - at.m) / at.s)
            for end, sign in ((self.planar.lower, -1), (self.planar.upper, 1))
        )
        return low, high

    def _within(self, u: Number) -> Number:
        return self.xp.fmin(self.xp.fmax(u, -self.reach), self.reach)

    def outer_steps(self, first: Number, last: Number, at: Moments) -> Number:
        """How many steps the outer line takes from tau = first to last: longer ones where f is averaged over the inner one."""
        wide = 1 + WIDER * self.xp.sqrt(at.left / at.spread)
        steps = (last - first) / (wide * self.step)
        return GAUSS * steps + AT_ENDS if self.planar.ends else steps

    # -- the inner line -------------------------------------------------------------------------------------------

    def stretch(self, u: Number, moments: Moments) -> tuple[Number, Number, Number, Number]:
        """Centre of the pole, 2 sin(w/2) of its width w, and tau at the two ends of the inner line at one outer node."""
        xp, at = self.xp, moments
        reach = xp.sqrt(xp.fmax(self.reach**2 - u * u, SHORTEST**2))
        centre, width = 0.0 * u, 0.0 * u + FAR
        if self.planar.pole:
            outer = {self.planar.symbols[0]: at.m + at.s * u}
            pole = self.planar.pole
            centre = (self._limited(self.evaluate(pole.centre, outer)) - at.mean - at.lean * u) / at.left
            width = xp.fmin(self.evaluate(pole.width, outer), LARGE**2) / at.left
        centre, width = self._projected(centre, width, reach)
        width = SPACED * xp.sin(xp.fmin(width / SPACED, HALF_PI))  # where sinh(i width/SPACED) is: the pole at tau = i pi/2
        return centre, width, -self.inner_tau(reach + centre, width), self.inner_tau(reach - centre, width)

    def inner_tau(self, distance: Number, width: Number) -> Number:
        """The variable in which nodes on the inner line are equally spaced, from the pole on."""
        grow = self.xp.exp(distance / SPACED)
        return self.xp.asinh((grow - 1 / grow) * (SPACED / 2 / width))

    def steps(self, u: Number, first: Number, last: Number) -> Number:
        """How many steps the inner line takes: fewer where the outer density has fallen already."""
        left = self.xp.fmax(1 - TAPER * (u / self.reach) ** 2, LEAST)
        return (last - first) * left / self.step

    def inner_nodes(self, line: tuple[Number, Number, Number, Number], count: int) -> tuple[Number, Number, Number]:
        """So many nodes v as rows, weights that hold phi(v), and a factor of all weights.

        `line` is centre and width of the pole, as `stretch` gives them, tau at the first node, and the step.
        """
        centre, width, first, step = line
        xp = self.xp
        up, down = xp.geometric(first, step, count, width / (2 * SPACED))
        ratio = up - down
        root = xp.sqrt(ratio * ratio + 1)
        length = xp.log(ratio + root)  # asinh(ratio): what is lost far below the pole has no weight
        v = centre + SPACED * length
        return v, (up + down) / root * xp.exp(v * v * -0.5), step * SPACED / ROOT_TWO_PI


def density(u: Number, xp: Algebra) -> Number:
    """phi(u)."""
    return xp.exp(u * u * -0.5) / ROOT_TWO_PI
