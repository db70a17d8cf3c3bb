"""E[f(x) g(y)] of two jointly Gaussian arguments, f and g piecewise polynomial, and the derivatives of f and g.

f is the polynomial around the mean of x, plus tails beyond the kinks: (x - k)^n where x > k for a kink above the mean,
-(x - k)^n where x < k for one below. Products of polynomials and tails follow from Stein's lemma, down to the orthant
probability of the bivariate normal distribution. Nothing divides by a variance, for a density at a kink is only ever met
times the standard deviation, or is an impulse that is there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import comb

import casadi as ca
import sympy as sp

from cadet_sym.expectation.closed_form import PiecewiseForm, Term
from cadet_sym.expectation.univariate import Univariate
from cadet_sym.lowering.bivariate import one_minus_square, orthant
from cadet_sym.lowering.gaussian import Gaussian
from cadet_sym.lowering.special import hermite, magnitude


@dataclass
class Pair:
    """Two Gaussian variables and their covariance."""

    x: Gaussian
    y: Gaussian
    covariance: ca.SX
    rho: ca.SX = field(init=False)

    def __post_init__(self):
        rho = self.covariance / (self.x.s * self.y.s)
        self.rho = ca.if_else(rho > 1, 1, ca.if_else(rho < -1, -1, rho))
        self.bounded = self.rho * self.x.s * self.y.s  # the covariance that two such variances allow
        self.corners: dict[tuple[sp.Expr, sp.Expr], _Corner] = {}
        self.tails: dict[sp.Expr, _Tail] = {}
        self.conditionals: dict[sp.Expr, Gaussian] = {}
        self.other: Pair | None = None

    def swapped(self) -> Pair:
        """The same with the arguments exchanged."""
        if self.other is None:
            self.other = Pair(self.y, self.x, self.covariance)
            self.other.other = self
        return self.other

    def expectation(self, f: Univariate, g: Univariate, orders: tuple[int, int]) -> ca.SX:
        """E[f^(i)(x) g^(j)(y)], impulses at jumps included."""
        a, b = _derivative(f.closed, orders[0]), _derivative(g.closed, orders[1])
        total = self._regular(a, b)
        total += self._impulses(f, orders[0], g, orders[1])
        total += self.swapped()._impulses(g, orders[1], f, orders[0], since=orders[0])
        return total

    # -- polynomials and tails ------------------------------------------------------------------------------------

    def _regular(self, a: PiecewiseForm, b: PiecewiseForm) -> ca.SX:
        total = ca.SX(0)
        for first in a.segments:
            for second in b.segments:
                moment = self._polynomials(first.centre, first.terms, second.centre, second.terms)
                total += self.x.inside(first, self.y.inside(second, moment))
        total += self._tails_times_segments(a, b)
        total += self.swapped()._tails_times_segments(b, a)
        for kink in a.kinks:
            for other in b.kinks:
                corner = self.corner(kink.position, other.position)
                for i, c in enumerate(_coefficients(kink.terms)):
                    for j, d in enumerate(_coefficients(other.terms)):
                        if c != 0 and d != 0:
                            total += self.x.value(c) * self.y.value(d) * corner.moment(i, j)
        return total

    def _polynomials(self, c: sp.Expr, first: tuple[Term, ...], d: sp.Expr, second: tuple[Term, ...]) -> ca.SX:
        """E of a polynomial in x - c times one in y - d."""
        moment = self.powers(c, d)
        total = ca.SX(0)
        for i, u in enumerate(_coefficients(first)):
            for j, v in enumerate(_coefficients(second)):
                if u != 0 and v != 0:
                    total += self.x.value(u) * self.y.value(v) * moment(i, j)
        return total

    def powers(self, c: sp.Expr, d: sp.Expr) -> Callable[[int, int], ca.SX]:
        """E[(x - c)^i (y - d)^j] as a function of i and j."""
        hx, hy = self.x.m - self.x.value(c), self.y.m - self.y.value(d)
        table: dict[tuple[int, int], ca.SX] = {(0, 0): ca.SX(1)}

        def moment(i: int, j: int) -> ca.SX:
            if (i, j) not in table:
                if i > 0:
                    value = hx * moment(i - 1, j)
                    value += (i - 1) * self.x.p * moment(i - 2, j) if i > 1 else 0
                    value += j * self.covariance * moment(i - 1, j - 1) if j else 0
                else:
                    value = hy * moment(0, j - 1) + ((j - 1) * self.y.p * moment(0, j - 2) if j > 1 else 0)
                table[i, j] = value
            return table[i, j]

        return moment

    def _tails_times_segments(self, a: PiecewiseForm, b: PiecewiseForm) -> ca.SX:
        total = ca.SX(0)
        for kink in a.kinks:
            tail = self.tail(kink.position)
            changes = _coefficients(kink.terms)
            for segment in b.segments:
                value = ca.SX(0)
                for i, c in enumerate(changes):
                    for j, d in enumerate(_coefficients(segment.terms)):
                        if c != 0 and d != 0:
                            value += self.x.value(c) * self.y.value(d) * tail.moment(i, segment.centre, j)
                total += self.y.inside(segment, value)
        return total

    def tail(self, k: sp.Expr) -> _Tail:
        """(x - k)^i beyond a kink, times powers of y."""
        return self.tails.setdefault(k, _Tail(self, k))

    def corner(self, k: sp.Expr, l: sp.Expr) -> _Corner:
        """Beyond a kink of x and one of y."""
        if (k, l) not in self.corners:
            self.corners[k, l] = _Corner(self, k, l)
        return self.corners[k, l]

    # -- impulses -------------------------------------------------------------------------------------------------

    def given(self, position: sp.Expr) -> Gaussian:
        """Y where X is at a point; the point is kept within reach of the mean of X."""
        if position not in self.conditionals:
            _, u = self.x.density(position)
            p = self.y.v * one_minus_square(self.rho)
            self.conditionals[position] = Gaussian(self.y.m - self.rho * self.y.s * u, p, self.y.env)
        return self.conditionals[position]

    def _impulses(self, f: Univariate, i: int, g: Univariate, j: int, *, since: int = 0) -> ca.SX:
        """E of the impulses of f^(i) times g^(j), without those impulses that jumps of g^(l), l < since, leave."""
        total = ca.SX(0)
        for jump in f.jumps:
            for order in range(i):
                size = jump.size(order)
                if size != 0:
                    total += self.x.value(size) * self._impulse(jump.position, i - 1 - order, g, j, since)
        return total

    def _impulse(self, position: sp.Expr, q: int, g: Univariate, j: int, since: int) -> ca.SX:
        """E[delta^(q)(x - k) g^(j)(y)] = (-d/dx)^q of the density of x times E[g^(j) | x], at k."""
        given, (phi, u) = self.given(position), self.x.density(position)
        ratio = self.rho * self.y.s / self.x.s
        total = ca.SX(0)
        for l in range(q + 1):
            outer = hermite(-u, q - l) * phi / self.x.s ** (q - l + 1)
            total += comb(q, l) * (-ratio) ** l * outer * given.expectation(g, j + l, since=since)
        return total


class _Tail:
    """t_i(x) = (x - k)^i beyond the kink as seen from the mean, times powers of y - d."""

    def __init__(self, pair: Pair, position: sp.Expr):
        self.pair, self.position = pair, position
        self.table: dict[tuple[int, sp.Expr, int], ca.SX] = {}

    def moment(self, i: int, d: sp.Expr, j: int) -> ca.SX:
        """E[t_i(x) (y - d)^j] by Stein's lemma in y."""
        key = i, d, j
        if key not in self.table:
            pair = self.pair
            if j == 0:
                self.table[key] = pair.x.tail_moment(self.position, i)
            else:
                value = (pair.y.m - pair.y.value(d)) * self.moment(i, d, j - 1)
                if j > 1:
                    value += (j - 1) * pair.y.v * self.moment(i, d, j - 2)
                slope = i * self.moment(i - 1, d, j - 1) if i else self._impulse(d, j - 1)
                self.table[key] = value + pair.bounded * slope
        return self.table[key]

    def _impulse(self, d: sp.Expr, j: int) -> ca.SX:
        """E[delta(x - k) (y - d)^j]."""
        given = self.pair.given(self.position)
        h = given.m - given.value(d)
        powers = [ca.SX(1), h]
        for n in range(2, j + 1):
            powers.append(h * powers[n - 1] + (n - 1) * given.p * powers[n - 2])
        phi, _ = self.pair.x.density(self.position)
        return phi / self.pair.x.s * powers[j]


class _Corner:
    """Products of a tail in x and a tail in y."""

    def __init__(self, pair: Pair, k: sp.Expr, l: sp.Expr):
        self.pair, self.k, self.l = pair, k, l
        self.table: dict[tuple[int, int], ca.SX] = {}
        self.hx, self.hy = pair.x.m - pair.x.value(k), pair.y.m - pair.y.value(l)

    def moment(self, i: int, j: int) -> ca.SX:
        """E[t_i(x) t_j(y)]."""
        if (i, j) not in self.table:
            self.table[i, j] = self._moment(i, j)
        return self.table[i, j]

    def _moment(self, i: int, j: int) -> ca.SX:
        pair = self.pair
        if i > 0:
            value = self.hx * self.moment(i - 1, j)
            own = (i - 1) * self.moment(i - 2, j) if i > 1 else _at(pair, self.k, self.l, j)
            cross = j * self.moment(i - 1, j - 1) if j else _at(pair.swapped(), self.l, self.k, i - 1)
            return value + pair.x.v * own + pair.bounded * cross
        if j > 0:
            value = self.hy * self.moment(0, j - 1)
            own = (j - 1) * self.moment(0, j - 2) if j > 1 else _at(pair.swapped(), self.l, self.k, 0)
            return value + pair.y.v * own + pair.bounded * _at(pair, self.k, self.l, j - 1)
        _, u = pair.x.density(self.k)
        _, w = pair.y.density(self.l)
        sides = ca.if_else(u >= 0, -1, 1) * ca.if_else(w >= 0, -1, 1)
        return sides * orthant(magnitude(u), magnitude(w), pair.rho * sides)


def _at(pair: Pair, k: sp.Expr, l: sp.Expr, j: int) -> ca.SX:
    """E[delta(x - k) t_j(y)], t_j the tail at l as seen from the unconditional mean of y.

    Of y - l, given x, the mean is taken in standard deviations, as in the orthant probability: at correlation one, where both
    kinks are one, the two must agree to the last bit on which side of the other each is.
    """
    x, y = pair.x, pair.y
    phi, u = x.density(k)
    w = (y.m - y.value(l)) / y.s
    given = Gaussian(y.s * (w - pair.rho * u), y.v * one_minus_square(pair.rho), y.env)
    whole = [ca.SX(1), given.m]
    for n in range(2, j + 1):
        whole.append(given.m * whole[n - 1] + (n - 1) * given.p * whole[n - 2])
    shift = ca.if_else(given.m >= 0, 1, 0) - ca.if_else(w >= 0, 1, 0)
    return phi / x.s * (given.tail_moment(sp.S.Zero, j) + shift * whole[j])


def _derivative(form: PiecewiseForm, order: int) -> PiecewiseForm:
    for _ in range(order):
        form = form.derivative()
    return form


def _coefficients(terms: tuple[Term, ...]) -> tuple[sp.Expr, ...]:
    """Of the only term, a polynomial."""
    return terms[0].coefficients if terms else ()
