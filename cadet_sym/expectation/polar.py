"""Homogeneous functions of two arguments, f(r x, r y) = r^k f(x, y), r > 0: in polar coordinates the radius has a closed form.

With z = L w + m, w standard normal, mu = L^-1 m and e a unit vector of the plane of w, at the angle t from that of mu,

    E[f] = int f(L e(t)) phi(mu x e) T_{k+1}(mu . e) dt,    T_n(b) = int_0^oo r^n phi(r - b) dr,

T_0 = Phi(b), T_1 = b T_0 + phi(b), T_n = b T_{n-1} + (n-1) T_{n-2}. The gains are homogeneous of degree k-1; where f jumps
across a ray from the origin, they have the integral along it besides. Half planes x > 0 and x < 0 are taken one by one: there
f = |x|^k f(sign x, q), and kinks, jumps and poles off the line are those of a function of the one variable q = y/|x|.
Angles count in units in which the density has the width one, t = u/sqrt(1 + d^2), d = |mu|: nothing is lost to rounding
where the mean is many deviations from the origin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import sympy as sp

from cadet_sym.expectation.algebra import Algebra, Number
from cadet_sym.expectation.panels import Nodes, Panel, finished, panels
from cadet_sym.expectation.planar import Moments
from cadet_sym.expectation.quadrature import Integral, Rule
from cadet_sym.expectation.steep import Steep

Evaluate = Callable[[Sequence[sp.Expr], Mapping[sp.Symbol, Number]], list[Number]]

REACH = 8.0  # standard deviations across the direction of the mean; 1e-15 of the probability lies beyond
LONGEST = 3.5  # an arc of a half plane is no longer than pi: one that seems so is empty
FIXED = Rule(order=40, straight=40, graded=48)  # where one has to do for all
ROOT_TWO_PI, ROOT_HALF = float(np.sqrt(2 * np.pi)), float(np.sqrt(0.5))
NEAR = 0.3  # standard deviations; nearer poles have NARROW, whatever the function
NARROW = Rule(panels=4, order=32, straight=40, graded=48)
ALMOST_ONE = 1 - 1e-15
FAR = 100.0
MARGIN = 1e-10  # of the angle, what a pole keeps from the ends of an arc and is wide at least


@dataclass(frozen=True)
class Arc:
    """Directions (side, q), lower < q < upper, between which f is smooth."""

    side: int  # sign of x
    lower: sp.Expr
    upper: sp.Expr
    value: sp.Expr  # f there, in x and y
    slopes: tuple[sp.Expr, sp.Expr]
    poles: tuple[Steep, ...]  # in q
    singular: tuple[bool, bool]

    def parts(self, rule: Rule) -> list[Integral]:
        """The arc, or its two halves if it is singular at both ends, for `panels`."""
        # every pole is met again half a turn on; the density is steep too
        steep = (Steep(sp.S.Zero, sp.S.One),) * (2 * len(self.poles) + (not any(self.singular)))
        ends = [(True, False), (False, True)] if all(self.singular) else [self.singular]
        return [Integral(sp.S.Zero, sp.S.One, self.value, sp.Dummy("u"), steep, end, rule) for end in ends]


@dataclass(frozen=True)
class Ray:
    """A direction (side, q) across which f jumps: by how much more it is at larger q, at |x| = 1.

    Of the two directions without x, q = +-oo, by how much more it is at positive x, at |y| = 1.
    """

    side: int
    position: sp.Expr
    jump: sp.Expr


@dataclass(frozen=True)
class Homogeneous:
    """A homogeneous function of two arguments."""

    outer: int  # index of x
    inner: int  # index of y
    value: sp.Expr
    symbols: tuple[sp.Symbol, sp.Symbol]
    degree: int
    arcs: tuple[Arc, ...]
    rays: tuple[Ray, ...]
    rule: Rule = FIXED  # where no pole is nearer to the line than `NEAR`
    error: float = 0.0
    fixed: bool = False  # whether that rule is to be taken everywhere

    @property
    def free(self) -> frozenset[sp.Basic]:
        """Parameters."""
        return frozenset(self.value.free_symbols - set(self.symbols))

    @cached_property
    def nodes(self) -> int:
        """Directions at which the function is evaluated."""
        return sum(part.nodes for arc in self.arcs for part in arc.parts(self.rule))

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """None that stand still while the other argument moves, but for those at zero."""
        return iter(())

    def expressions(self) -> Iterator[sp.Expr]:
        """Whatever depends on parameters."""
        for arc in self.arcs:
            yield from (arc.lower, arc.upper)

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """The same as for the kinks."""
        return iter(())


@dataclass(frozen=True)
class Frame:
    """The half plane x > 0 in polar coordinates about the origin, from the direction of the mean on.

    Without a mean there is no such direction: nearer than one standard deviation, that of x is taken.
    """

    mu: tuple[Number, Number]
    c: tuple[Number, Number]  # the vector from which angles count, of w
    C: tuple[Number, Number]  # and of z
    p: tuple[Number, Number]  # what is a quarter turn on from it and has unit length in w, of z
    M: tuple[Number, Number]  # mu, along c and across
    d: Number  # |c|
    unit: Number  # sqrt(1 + |mu|^2): a unit of the angle over that of u
    s: Number
    spread: Number  # of y

    @staticmethod
    def of(at: Moments, xp: Algebra) -> Frame:
        """That of a normal distribution."""
        mu = at.m / at.s, (at.mean - at.lean * (at.m / at.s)) / at.left
        square = mu[0] ** 2 + mu[1] ** 2
        far = square > 1
        d = xp.sqrt(xp.where(far, square, 1.0))
        c = xp.where(far, mu[0], 1.0), xp.where(far, mu[1], 0.0)
        C = xp.where(far, at.m, at.s), xp.where(far, at.mean, at.lean)
        p = -at.s * (c[1] / d), at.left * (c[0] / d) - at.lean * (c[1] / d)
        M = xp.where(far, d, mu[0]), xp.where(far, 0.0, mu[1])
        return Frame(mu, c, C, p, M, d, xp.sqrt(1 + square), at.s, xp.sqrt(at.left**2 + at.lean**2))


@dataclass(frozen=True)
class Piece:
    """A part of an arc: how it is run through, where its singular end is, how far beyond reach, and whether it is there."""

    part: Integral
    panels: list[Panel]
    end: Number
    beyond: Number
    there: Number


class Node:
    """Some nodes of an arc: the function, its slopes and the density along the radius there."""

    def __init__(
        self,
        function: Homogeneous,
        arc: Arc,
        piece: Piece,
        frame: Frame,
        nodes: Nodes,
        evaluate: Evaluate,
        xp: Algebra,
        more: int = 1,
    ):
        part, nodes = piece.part, finished(piece.part, nodes, piece.end, xp)
        self.k, self.frame, self.xp, self.weight, self.there = function.degree, frame, xp, nodes.weight, piece.there
        t = nodes.u / frame.unit
        self.cosine, self.sine = xp.cos(t), xp.sin(t)
        ahead, aside = self.cosine * (frame.unit / frame.d), self.sine * frame.unit
        x, y = (C * ahead + p * aside for C, p in zip(frame.C, frame.p, strict=True))
        if any(part.singular):  # one of them vanishes at that end: without cancellation
            rise = frame.unit * xp.sin((nodes.distance + piece.beyond) / frame.unit)
            if (arc.lower if part.singular[0] else arc.upper).is_infinite:
                x = frame.s * rise
            else:
                y = (rise if part.singular[0] else -rise) * frame.spread
        b = frame.M[0] * self.cosine + frame.M[1] * self.sine
        across = frame.M[1] * self.cosine - frame.M[0] * self.sine
        self.radial = along_radius(b, across, frame.unit, self.k + more, xp)
        known = dict(zip(function.symbols, (arc.side * x, y), strict=True))
        self.value, *self.slopes = evaluate((arc.value, *arc.slopes), known)

    def sums(self) -> list[Number]:
        """What the nodes add to E[f], the gains, and E|f|."""
        first, second = (self.weight * self.radial[n] for n in (self.k + 1, self.k))
        terms = [first * self.value, *(second * slope for slope in self.slopes), first * self.xp.fabs(self.value)]
        return [self.xp.where(self.there, term, 0.0) for term in terms]  # of an empty arc they may be anywhere

    def by_density(self) -> list[Number]:
        """What they add to E[f v_i], v = w - mu, of which the gains are linear functions: no derivative of f is used."""
        first, e = self.frame.unit * self.radial[self.k + 2], self._direction()
        factors = (e[i] * first - self.frame.mu[i] * self.radial[self.k + 1] for i in (0, 1))
        return [self.xp.where(self.there, self.weight * self.value * factor, 0.0) for factor in factors]

    def _direction(self) -> tuple[Number, Number]:
        """The unit vector in w."""
        c0, c1 = self.frame.c[0] / self.frame.d, self.frame.c[1] / self.frame.d
        return c0 * self.cosine - c1 * self.sine, c1 * self.cosine + c0 * self.sine

    def derivatives(self) -> list[Number]:
        """What they add to E[slope v_i] and E[slope (v_i v_j - delta_ij)], v = w - mu: slopes row by row, ij = 11, 12, 22.

        The function stays where it is; the density is differentiated.
        """
        frame, (zeroth, first, second) = self.frame, self.radial[self.k : self.k + 3]
        first, second = frame.unit * first, frame.unit**2 * second
        e = self._direction()
        factors = [e[i] * first - frame.mu[i] * zeroth for i in (0, 1)]
        for i, j in ((0, 0), (0, 1), (1, 1)):
            mixed = e[i] * frame.mu[j] + e[j] * frame.mu[i]
            factors.append(e[i] * e[j] * second - mixed * first + (frame.mu[i] * frame.mu[j] - float(i == j)) * zeroth)
        terms = [self.weight * slope * factor for slope in self.slopes for factor in factors]
        return [self.xp.where(self.there, term, 0.0) for term in terms]


def along_radius(b: Number, across: Number, unit: Number, count: int, xp: Algebra) -> list[Number]:
    """T_n(b)/unit^n phi(across), n <= count."""
    density = xp.exp(across * across * -0.5) / ROOT_TWO_PI
    ratio = b / unit
    found = [density * (0.5 + 0.5 * xp.erf(b * ROOT_HALF))]
    found.append(ratio * found[0] + density * xp.exp(b * b * -0.5) / (ROOT_TWO_PI * unit))
    for n in range(2, count + 1):
        found.append(ratio * found[n - 1] + (n - 1) / unit**2 * found[n - 2])
    return found


class Layout:
    """Where the nodes of a function go under one distribution, in NumPy or CasADi."""

    def __init__(self, function: Homogeneous, at: Moments, evaluate: Evaluate, xp: Algebra):
        self.function, self.evaluate, self.xp = function, evaluate, xp
        self.at = {1: at, -1: replace(at, m=-at.m, lean=-at.lean)}  # those of |x|
        self.frames = {side: Frame.of(moments, xp) for side, moments in self.at.items()}

    def value(self, expr: sp.Expr) -> Number:
        """Of an expression in the parameters."""
        return self.evaluate((expr,), {})[0]

    def pieces(self, arc: Arc) -> list[Piece]:
        """The parts of an arc, cut into panels."""
        xp, (low, high, first, last) = self.xp, self.stretch(arc)
        middle = (low + high) / 2
        steep = [] if any(arc.singular) else [(0.0 * middle, 1.0 + 0.0 * middle)]
        steep = [self._inside(low, high, *place) for place in steep + self.poles(arc, middle)]
        parts = arc.parts(self.function.rule)
        ends = [low, high] if len(parts) == 1 else [low, middle, high]
        found = []
        for part, start, stop in zip(parts, ends[:-1], ends[1:], strict=True):
            end, beyond = (-stop, last - high) if part.singular[1] else (start, low - first)
            found.append(Piece(part, panels(part, start, stop, steep, xp, MARGIN), end, beyond, high > low))
        return found

    def _inside(self, low: Number, high: Number, centre: Number, width: Number) -> tuple[Number, Number]:
        """A steep place no nearer to an end of its arc than `MARGIN`, where rounding tells on which side nodes are."""
        xp = self.xp
        inside = xp.fmin(xp.fmax(centre, low + MARGIN), high - MARGIN)
        return inside, xp.sqrt(width**2 + xp.fmin(xp.fabs(inside - centre), FAR) ** 2)

    def nearest(self) -> Number:
        """How near to the line the nearest pole of any arc is, in standard deviations; no more than `FAR`."""
        xp, nearest = self.xp, FAR
        for arc in self.function.arcs:
            low, high, _, _ = self.stretch(arc)
            for centre, width in self.poles(arc, (low + high) / 2):
                outside = xp.fmax(xp.fmax(centre - high, low - centre), 0.0)
                nearest = xp.fmin(nearest, xp.where(high > low, xp.fmax(width, outside), FAR))
        return nearest

    def stretch(self, arc: Arc) -> tuple[Number, Number, Number, Number]:
        """Ends of the arc within reach, and of all of it, in units of the density; the middle is within half a turn."""
        xp, frame, turn = self.xp, self.frames[arc.side], 2 * np.pi
        low, high = (self.angle(arc.side, q) for q in (arc.lower, arc.upper))
        wraps = xp.where(high < low, turn, 0.0)
        down = xp.where(low + high > 0, wraps, 0.0)
        low, high = low - down, high + (wraps - down)  # in that order: a small angle is not to lose digits
        high = xp.where(high - low > LONGEST, low, high)
        reach = xp.where(frame.d > REACH, xp.asin(xp.fmin(REACH / frame.d, 1.0)), turn)
        within = [xp.fmin(xp.fmax(end, -reach), reach) for end in (low, high)]
        first, last, start, end = (frame.unit * angle for angle in (*within, low, high))
        return first, last, start, end

    def angle(self, side: int, q: sp.Expr) -> Number:
        """That of (1, q), q perhaps infinite; in (-pi, pi]."""
        at, frame = self.at[side], self.frames[side]
        if q.is_infinite:
            sign = 1 if q is sp.S.Infinity else -1
            return self.xp.atan2(sign * frame.c[0], sign * frame.c[1])
        slope = self.value(q)
        return self.xp.atan2(
            frame.C[0] * slope - frame.C[1], frame.c[0] * at.left + frame.c[1] * (slope * at.s - at.lean)
        )

    def poles(self, arc: Arc, middle: Number) -> list[tuple[Number, Number]]:
        """Centres and widths of poles nearest the middle of an arc, and half a turn beyond it."""
        found, turn = [], np.pi * self.frames[arc.side].unit
        for pole in arc.poles:
            centre, width = self._pole(arc.side, self.value(pole.centre), self.value(pole.width))
            nearest = centre + turn * self.xp.floor((middle - centre) / turn + 0.5)
            beyond = nearest + turn * self.xp.where(nearest > middle, -1.0, 1.0)
            found += [(nearest, width), (beyond, width)]
        return found

    def _pole(self, side: int, centre: Number, width: Number) -> tuple[Number, Number]:
        """Real and imaginary part of the angle of (1, centre + i width): tan t = X/Y."""
        at, frame, xp = self.at[side], self.frames[side], self.xp
        X = frame.C[0] * centre - frame.C[1], frame.C[0] * width
        Y = frame.c[0] * at.left + frame.c[1] * (at.s * centre - at.lean), frame.c[1] * at.s * width
        squares = X[0] ** 2 + X[1] ** 2, Y[0] ** 2 + Y[1] ** 2
        product = X[0] * Y[0] + X[1] * Y[1], xp.fabs(X[1] * Y[0] - X[0] * Y[1])
        real = xp.atan2(2 * product[0], squares[1] - squares[0]) / 2
        imaginary = xp.atanh(xp.fmin(2 * product[1] / (squares[0] + squares[1]), ALMOST_ONE)) / 2
        return frame.unit * real, frame.unit * imaginary

    # -- jumps ----------------------------------------------------------------------------------------------------

    def jumps(self) -> list[Number]:
        """What all jumps add to the gains: across its ray, each times the integral of r^k times the density along it."""
        total: list[Number] = [0.0, 0.0]
        for ray in self.function.rays:
            strength = self.value(ray.jump)
            if ray.position.is_infinite:
                total[0] += strength * self._along_axis(ray)
                continue
            slope = self.value(ray.position)
            strength = strength * self._along(ray, slope)
            total[0] -= ray.side * slope * strength
            total[1] += strength
        return total

    def _along(self, ray: Ray, slope: Number) -> Number:
        """int r^k N(r (1, q)) dr."""
        at, frame, k = self.at[ray.side], self.frames[ray.side], self.function.degree
        rise = slope * at.s - at.lean
        length = self.xp.sqrt(at.left**2 + rise**2)
        b = (frame.mu[0] * at.left + frame.mu[1] * rise) / length
        radial = along_radius(b, (at.m * slope - at.mean) / length, frame.unit, k, self.xp)[k]
        return radial * (frame.unit * at.left * at.s / length) ** k / length

    def _along_axis(self, ray: Ray) -> Number:
        """int r^k N(r (0, +-1)) dr."""
        at, frame, k = self.at[ray.side], self.frames[ray.side], self.function.degree
        sign = 1 if ray.position is sp.S.Infinity else -1
        radial = along_radius(sign * frame.mu[1], frame.mu[0], frame.unit, k, self.xp)[k]
        return radial * (frame.unit * at.left) ** k / at.s
