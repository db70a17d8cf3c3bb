"""Piecewise polynomials of two arguments that switch along conics: a polynomial around the mean, and integrals along them.

Let f change by a polynomial J across a curve w(t), in the plane of two independent standard normal variables w. Written in
Hermite polynomials, J = sum b_ij He_i(w1) He_j(w2), all but its first term is a divergence when multiplied by the density, for
He_i phi = -(He_(i-1) phi)', and so is the density itself away from the mean, phi = -div(w phi/|w|^2). By Gauss's theorem a
curve with J more on its left hand contributes

    E[J 1(left)] or -E[J 1(right)] = int (V_2 w1' - V_1 w2' - b_00 theta') phi dt,
    V_1 = sum_(i>0) b_ij He_(i-1)(w1) He_j(w2),    V_2 = sum_(j>0) b_0j He_(j-1)(w2),

the first where the mean is on its right hand, so that with the polynomial around the mean

    E[f] = E[polynomial] + sum of curves.

The gains are the same for the derivatives of f, and where f jumps, J times the density integrated along the curve besides; so
are their derivatives. `conic` says where the nodes go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb, factorial, perm, pi

import sympy as sp

from cadet_sym.expectation.algebra import Algebra, Number
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.conic import CURVES, Course, Point, Side, outer
from cadet_sym.expectation.planar import Moments

Evaluate = Callable[[Sequence[sp.Expr], Mapping[sp.Symbol, Number]], list[Number]]

Terms = Mapping[tuple[int, int], sp.Expr]
"""Coefficients of p^i q^j."""

ORDERS = tuple(range(8, 161, 8))  # nodes of a side
FIRST = 20.0  # nodes of a side, and more for each unit of its length in tau
SHORT, LONG = 8.0, 40.0  # the same, and how many more, where it is short
FARTHEST = 50.0  # standard deviations: farther out the density is zero anyway


@dataclass(frozen=True)
class Border:
    """A conic across which f changes."""

    kind: str  # of `CURVES`
    shape: tuple[sp.Expr, ...]
    jump: sp.Expr  # by how much f is more on its left hand, in p and q

    @property
    def branches(self) -> tuple[int, ...]:
        """Of a hyperbola two, on either side of p = 0."""
        return (1, -1) if self.kind == "hyperbola" else (1,)

    def level(self, p: sp.Symbol, q: sp.Symbol) -> sp.Expr:
        """What is zero on the curve and positive on its left hand."""
        if self.kind == "parabola":
            a, b, c = self.shape
            return q - a * p**2 - b * p - c
        return p * q - self.shape[0] if self.kind == "hyperbola" else self.shape[0] - p**2 - q**2


@dataclass(frozen=True)
class Region:
    """What f is where the mean lies on the given hand of some borders, 1 the left one."""

    value: sp.Expr  # in p and q
    hands: tuple[tuple[int, int], ...]  # border, hand


@dataclass(frozen=True)
class Along:
    """A polynomial times the density, or a derivative of that in means, integrated along a curve.

    `across` is the derivative that the jump was met in: in p, in q (0, 1), or a parameter, in which the curve moves.
    """

    factor: sp.Expr
    across: int | sp.Symbol
    derivatives: tuple[int, ...] = ()


@dataclass(frozen=True)
class Row:
    """One expectation: of a derivative of f, in the sense of distributions."""

    derivatives: tuple[sp.Symbol, ...] = ()  # the last one may be a parameter, the others are p or q

    def area(self, terms: Terms, p: sp.Symbol, q: sp.Symbol) -> Terms:
        """The derivative of a polynomial."""
        for z in self.derivatives:
            if z in (p, q):
                k = int(z == q)
                terms = {_less(powers, k): powers[k] * c for powers, c in terms.items() if powers[k]}
            else:
                slopes = ((powers, sp.diff(c, z)) for powers, c in terms.items() if c.has(z))
                terms = {powers: slope for powers, slope in slopes if slope != 0}
        return terms

    def along(self, jump: sp.Expr, p: sp.Symbol, q: sp.Symbol) -> list[Along]:
        """What the derivatives of 1(left) times the jump leave along the curve, where that does not vanish."""
        index, found, factor = {p: 0, q: 1}, [], jump
        remaining = list(self.derivatives)
        while remaining:  # each leaves something along the curve, on which those after it act
            z = remaining.pop()
            found.append(Along(factor, index.get(z, z), tuple(index[later] for later in reversed(remaining))))
            factor = sp.expand(sp.diff(factor, z))
        return [each for each in found if each.factor != 0]


@dataclass(frozen=True)
class Switched:
    """A polynomial on either side of conics that do not meet, in coordinates p, q = linear forms of the arguments."""

    outer: int  # indices of the arguments
    inner: int
    value: sp.Expr
    symbols: tuple[sp.Symbol, sp.Symbol]  # of the arguments
    forms: tuple[tuple[sp.Expr, sp.Expr, sp.Expr], ...]  # p = a x + b y + c, and q; a and b are numbers
    coordinates: tuple[sp.Symbol, sp.Symbol]
    regions: tuple[Region, ...]
    borders: tuple[Border, ...]
    finer: float = 1.0  # how many times the nodes that are enough where there is not much to cancel
    error: float = 0.0
    order: int = 0  # nodes of every side, if they are to be the same always

    @cached_property
    def free(self) -> frozenset[sp.Basic]:
        """Parameters."""
        found = {s for region in self.regions for s in region.value.free_symbols}
        found |= {s for border in self.borders for e in (border.jump, *border.shape) for s in e.free_symbols}
        return frozenset(found - set(self.coordinates))

    @property
    def nodes(self) -> int:
        """Points at which it is evaluated, where sides are of no great length."""
        return sum(4 * len(border.branches) for border in self.borders) * (self.order or 32)

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """None that stand still while the other argument moves."""
        return iter(())

    def expressions(self) -> Iterator[sp.Expr]:
        """Whatever depends on parameters."""
        return (e for border in self.borders for e in border.shape)

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """The same as for the kinks."""
        return iter(())

    def rows(self, *more: sp.Symbol) -> tuple[Row, ...]:
        """E[f] and its gains; with parameters, the derivatives of these."""
        p, q = self.coordinates
        if not more:
            return Row(), Row((p,)), Row((q,))
        return tuple(Row((*first, symbol)) for symbol in more for first in ((), (p,), (q,)))

    @property
    def jumps(self) -> bool:
        """Whether it is seen to be discontinuous."""
        return not all(self.is_continuous(border, border.jump) for border in self.borders)

    def is_continuous(self, border: Border, jump: sp.Expr) -> bool:
        """Whether a jump is seen to vanish along a curve."""
        p, q = self.coordinates
        if border.kind == "circle":  # of degree one in q there
            return normal(sp.rem(jump, -border.level(p, q), q)) == 0
        level = border.level(p, q)
        return normal(jump.subs(q, sp.expand(q - level / sp.diff(level, q)))) == 0


def _less(powers: tuple[int, int], k: int) -> tuple[int, int]:
    return powers[0] - (k == 0), powers[1] - (k == 1)


@lru_cache(maxsize=1024)
def polynomial(value: sp.Expr, p: sp.Symbol, q: sp.Symbol) -> Terms:
    """Coefficients of p^i q^j."""
    return {powers: c for powers, c in sp.Poly(value, p, q).terms() if c != 0}


class Expansion:
    """E of derivatives of polynomials under one distribution."""

    def __init__(self, at: Moments, xp: Algebra):
        self.at, self.xp = at, xp
        self.known: dict[tuple[int, int], Number] = {(0, 0): 1.0}

    def power(self, i: int, j: int) -> Number:
        """E[p^i q^j], by Stein's lemma."""
        if i < 0 or j < 0:
            return 0.0
        if (i, j) not in self.known:
            at = self.at
            if i:
                value = at.m * self.power(i - 1, j) + (i - 1) * at.s**2 * self.power(i - 2, j)
                value = value + j * at.s * at.lean * self.power(i - 1, j - 1)
            else:
                value = at.mean * self.power(0, j - 1) + (j - 1) * (at.lean**2 + at.left**2) * self.power(0, j - 2)
            self.known[i, j] = value
        return self.known[i, j]

    def mean(self, terms: Mapping[tuple[int, int], Number], a: int = 0, b: int = 0) -> Number:
        """E of the derivative, a times in p and b times in q, of the sum of c p^i q^j."""
        total: Number = 0.0
        for (i, j), c in terms.items():
            if i >= a and j >= b:
                total = total + c * (perm(i, a) * perm(j, b)) * self.power(i - a, j - b)
        return total

    def hermite(self, terms: Mapping[tuple[int, int], Number]) -> list[Number]:
        """b_ij, by `hermite_indices`: E of the derivatives in w1 and w2 over i! j!."""
        at, found = self.at, []
        for i, j in hermite_indices(degree_of(terms)):
            total: Number = 0.0
            for k in range(i + 1):  # d/dw1 = s d/dp + lean d/dq, d/dw2 = left d/dq
                total = total + comb(i, k) * at.s**k * at.lean ** (i - k) * self.mean(terms, k, i - k + j)
            found.append(at.left**j * total / (factorial(i) * factorial(j)))
        return found


def degree_of(terms: Mapping[tuple[int, int], Number]) -> int:
    """The total degree."""
    return max((i + j for i, j in terms), default=0)


def hermite_indices(degree: int) -> list[tuple[int, int]]:
    """i, j of the Hermite polynomials of so high a degree."""
    return [(i, n - i) for n in range(degree + 1) for i in range(n + 1)]


class Sums:
    """What the nodes of one curve add to some rows."""

    def __init__(self, function: Switched, border: Border, rows: Sequence[Row], evaluate: Evaluate, xp: Algebra):
        self.function, self.border, self.rows, self.evaluate, self.xp = function, border, rows, evaluate, xp
        self.p, self.q = function.coordinates
        self.areas = [row.area(polynomial(border.jump, self.p, self.q), self.p, self.q) for row in rows]
        self.alongs = [
            [each for each in row.along(border.jump, self.p, self.q) if not function.is_continuous(border, each.factor)]
            for row in rows
        ]

    @cached_property
    def acts(self) -> Number:
        """Whether f changes across the curve, for the numbers of the parameters."""
        jump = self._valued(polynomial(self.border.jump, self.p, self.q))
        return sum((self.xp.fabs(c) for c in jump.values()), start=0.0) > 0

    @property
    def count(self) -> int:
        """How many numbers `coefficients` gives."""
        return sum(len(hermite_indices(degree_of(area))) for area in self.areas)

    def coefficients(self, at: Moments) -> list[Number]:
        """b_ij of all rows, one after the other: what the nodes share."""
        expansion = Expansion(at, self.xp)
        return [b for area in self.areas for b in expansion.hermite(self._valued(area))]

    def _valued(self, terms: Mapping[tuple[int, int], sp.Expr]) -> dict[tuple[int, int], Number]:
        return dict(zip(terms, self.evaluate(list(terms.values()), {}), strict=True))

    def terms(self, at: Moments, coefficients: Sequence[Number], point: Point, weight: Number) -> list[Number]:
        """What points add, to every row."""
        xp, (w1, w2), (d1, d2) = self.xp, point.w, point.slopes
        w1, w2 = (xp.fmin(xp.fmax(x, -FARTHEST), FARTHEST) for x in (w1, w2))
        density = weight * xp.exp((w1 * w1 + w2 * w2) * -0.5) / (2 * pi)
        first, second = (_hermite(w, max(map(degree_of, self.areas), default=0)) for w in (w1, w2))
        found, start = [], 0
        for area, alongs in zip(self.areas, self.alongs, strict=True):
            indices = hermite_indices(degree_of(area))
            b = dict(zip(indices, coefficients[start : start + len(indices)], strict=True))
            start += len(indices)
            total: Number = -b[0, 0] * point.turning if area else 0.0
            for (i, j), value in b.items() if area else ():
                if i:
                    total = total - value * first[i - 1] * second[j] * d2
                elif j:
                    total = total + value * second[j - 1] * d1
            for along in alongs:
                total = total + self._along(along, at, point, (w1, w2))
            found.append(total * density)
        return found

    def _along(self, along: Along, at: Moments, point: Point, w: tuple[Number, Number]) -> Number:
        """The factor times how far the curve moves to the right, times derivatives of the density in the means over itself."""
        known = {self.p: point.p, self.q: point.q}
        dp, dq = at.s * point.slopes[0], at.lean * point.slopes[0] + at.left * point.slopes[1]
        if isinstance(along.across, int):
            (factor,) = self.evaluate((along.factor,), known)
            moved = dp if along.across else -dq
        else:
            factor, growth = self.evaluate((along.factor, sp.diff(self.border.level(self.p, self.q), along.across)), known)
            moved = growth * self._stretch(point, dp, dq)
        slopes = w[0] / at.s - at.lean / (at.s * at.left) * w[1], w[1] / at.left
        ratio: Number = 1.0
        if along.derivatives:
            ratio = slopes[along.derivatives[0]]
        if len(along.derivatives) == 2:
            ratio = ratio * slopes[along.derivatives[1]] - self._inverse(at, *along.derivatives)
        return factor * moved * ratio / (at.s * at.left)

    def _stretch(self, point: Point, dp: Number, dq: Number) -> Number:
        """ds over the gradient of what is zero on the curve."""
        if self.border.kind == "parabola":
            return dp
        g = (point.q, point.p) if self.border.kind == "hyperbola" else (-2 * point.p, -2 * point.q)
        return (g[1] * dp - g[0] * dq) / (g[0] ** 2 + g[1] ** 2)

    def _inverse(self, at: Moments, i: int, j: int) -> Number:
        """An entry of S^-1."""
        tilt = at.lean / (at.s * at.left)
        if i != j:
            return -tilt / at.left
        return 1 / at.left**2 if i else 1 / at.s**2 + tilt**2


def around(
    function: Switched, rows: Sequence[Row], at: Moments, courses: Sequence[Course], evaluate: Evaluate, xp: Algebra
) -> list[Number]:
    """E of the polynomial around the mean, for every row; one course of each border."""
    expansion, total = Expansion(at, xp), []
    for row in rows:
        found: Number = 0.0
        for region in function.regions:
            terms = row.area(polynomial(region.value, *function.coordinates), *function.coordinates)
            value = expansion.mean(dict(zip(terms, evaluate(list(terms.values()), {}), strict=True)))
            for border, hand in region.hands:
                left = courses[border].is_left
                value = xp.where(left, value if hand > 0 else 0.0, 0.0 if hand > 0 else value)
            found = found + value
        total.append(found)
    return total


def courses_of(border: Border, at: Moments, evaluate: Evaluate, xp: Algebra) -> list[Course]:
    """The branches of a border under one distribution."""
    shape = evaluate(border.shape, {})
    return [CURVES[border.kind].course(at, shape, branch, xp) for branch in border.branches]


def order_index(side: Side, finer: float, xp: Algebra) -> Number:
    """Which of `ORDERS` a side takes, by its length in tau."""
    tau = side.last - side.first
    wanted = finer * xp.fmin(FIRST + side.each * tau, SHORT + LONG * tau)
    return xp.fmin(xp.fmax(xp.ceil(wanted / ORDERS[0]) - 1, 0.0), len(ORDERS) - 1)


def side_points(
    border: Border, numbers: Sequence[Number], side: Sequence[Number], t: Number, w: Number, xp: Algebra
) -> tuple[Point, Number]:
    """The points for nodes on [0, 1], and their weights, from the numbers of a course and of a side of it."""
    first, last, length, sign, *centre = side
    kind = CURVES[border.kind]
    distance, slope = outer(first + (last - first) * t, length, kind.spaced, xp)
    point = kind.point(numbers, centre, sign * distance, xp)
    return point, w * (last - first) * slope


def _hermite(w: Number, degree: int) -> list[Number]:
    found: list[Number] = [1.0, w]
    for n in range(1, degree):
        found.append(w * found[n] - n * found[n - 1])
    return found
