"""Polynomials times a power of a quadratic polynomial that is nowhere negative, of any number of arguments.

With the square completed, Q = c + y_1^2 + .. + y_r^2, y = T z + e linear forms of the arguments, and any monomial in y,

    Q^-a = 1/Gamma(a) int_0^inf t^(a-1) exp(-t Q) dt,    E[y^n Q^-a] = 1/Gamma(a) int_0^inf t^(a-1) E[y^n exp(-t Q)] dt,

a positive power being a whole one, multiplied out, times a negative one: one dimension is left, in any number of arguments.
`tilted` says what is under the integral, and how it is taken. Gains, and what they change with, are the same integrals for the
derivatives of f, monomials times Q^(p-1), Q^(p-2), ..; where a derivative is so large at Q = 0 that it may have an impulse
there, E[f exp(-t Q)] is differentiated in its place. The exponent may be a parameter. A logarithm is the derivative of a
power in its exponent, d/dp Q^p = Q^p log Q, under the integral with a = -p:

    Q^-a log Q = 1/Gamma(a) int_0^inf (psi(a) - log t) t^(a-1) exp(-t Q) dt.

A factor g of one argument (a normal load that cannot pull, max(N, 0); a smooth one, as tanh(w)) is one more y, and comes under
the integral as its expectation and the derivatives of that, which Stein's lemma asks for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp
from sympy.polys.rings import PolyElement, PolyRing, ring

from cadet_sym.expectation.algebra import Number
from cadet_sym.expectation.univariate import Univariate

SHORTEST = sp.Rational(1, 4)  # a, at least; one more where p is given with the moments

Terms = dict[tuple[int, ...], float]
"""Coefficients of a polynomial, by the exponents of y_1, .., y_n and of c, which derivative of g, those of log Q and of p."""


@dataclass(frozen=True)
class Row:
    """A derivative of E[f]: for every monomial of f the expectation of a polynomial times Q^(p - power), differentiated on."""

    power: int
    terms: tuple[Terms, ...]
    left: tuple[int, ...] = ()  # means in which that expectation is to be differentiated
    plain: bool = False  # of one monomial, without its coefficient


@dataclass(frozen=True)
class Shape:
    """What the sums do not depend on the moments for: sum_a c_a y^a g(y_size) Q^p, Q = c + y_1^2 + .. + y_rank^2."""

    size: int  # number of y
    rank: int
    monomials: tuple[tuple[int, ...], ...]
    power: sp.Rational
    cone: bool  # whether c = 0
    kinked: bool = False  # whether there is such a g
    log: bool = False  # whether it is all times log Q
    given: bool = False  # whether p is given with the moments, and `power` is what it is likely to be

    @cached_property
    def degree(self) -> int:
        """The least in what is in Q."""
        return min(sum(powers[: self.rank]) for powers in self.monomials)

    def exists(self, order: int) -> bool:
        """Whether derivatives of that order have an expectation that is a plain integral."""
        return not self.cone or bool(2 * self.power + self.degree + self.rank - order > 0)

    def is_plain(self, order: int) -> bool:
        """Whether they are taken as that: not where it hardly exists, and its integrand falls too slowly to be added up."""
        return self.exists(order + 1)

    def allows(self, p: Number) -> Number:
        """Whether with that p there is an expectation, and an a."""
        allowed = p < min(row.power for row in self.gains) - float(SHORTEST)
        return allowed * (2 * p + self.degree + self.rank > 0) if self.cone else allowed

    def is_kinked_in(self, i: int) -> bool:
        """Whether that y is the argument of g."""
        return self.kinked and i == self.size - 1

    def floor(self, order: int) -> float:
        """A variance below all others, of which derivatives of that order are numbers."""
        return 10.0 ** -min(100.0, 250 / (order + 1 + max(0.0, -float(self.power))))

    @cached_property
    def falls(self) -> float:
        """The power of 1/t as which the slowest of the integrands falls in the end, where c = 0."""
        orders = [j for j in range(4) if self.exists(j)]
        return min(float(self.power - j) + self.rank / 2 + (self.degree + j + 1) // 2 for j in orders)

    @cached_property
    def gains(self) -> tuple[Row, ...]:
        """E[f] and its derivatives in the means of y."""
        return (self.row(), *(self.row(i) for i in range(self.size)))

    @cached_property
    def curvatures(self) -> tuple[Row, ...]:
        """Its second derivatives and its third, by `symmetric`."""
        return tuple(self.row(*i) for order in (2, 3) for i in symmetric(self.size, order))

    @cached_property
    def slopes(self) -> tuple[Row, ...]:
        """Of E[f] and the gains, derivatives in c, if it is not zero, then in every coefficient."""
        first = [(), *((i,) for i in range(self.size))]
        found = [] if self.cone else [self.row(*i, -1) for i in first]
        return (*found, *(self.row(*i, only=a) for a in range(len(self.monomials)) for i in first))

    @cached_property
    def least(self) -> float:
        """The smallest a."""
        return float(min(row.power for row in self.gains) - self.power) - self.given

    def row(self, *derivatives: int, only: int | None = None) -> Row:
        """The derivative in some of y, -1 standing for c, of all monomials or of one."""
        R, *symbols = ring([*(f"y{i}" for i in range(self.size)), "c", "g", "log", "p"], sp.QQ)
        found = [self._derivative(R, symbols, powers, derivatives) for powers in self.monomials]
        terms = [{m: float(c) for m, c in P.terms()} if only in (None, k) else {} for k, (P, _, _) in enumerate(found)]
        return Row(found[0][1], tuple(terms), found[0][2], plain=only is not None)

    def _derivative(
        self, R: PolyRing, symbols: Sequence[PolyElement], powers: Sequence[int], derivatives: Sequence[int]
    ) -> tuple[PolyElement, int, tuple[int, ...]]:
        """P and j, P Q^(p - j) being the derivative of a monomial, and those that are left to take."""
        *y, c, g, log, given = symbols
        c = R.zero if self.cone else c
        Q = sum((s**2 for s in y[: self.rank]), start=c)
        P, j, p = log if self.log else R.one, 0, given if self.given else R(sp.QQ.from_sympy(self.power))
        for s, n in zip(y, powers, strict=True):
            P *= s**n
        for i in (i for i in derivatives if i >= self.rank):
            P = P.diff(y[i]) + (g * P if self.is_kinked_in(i) else R.zero)  # g^n stands for its derivative of order n
        left = [i for i in derivatives if i < self.rank]
        while left and self.is_plain(j + 1):
            i = left.pop(0)
            inner = 2 * y[i] if i >= 0 else R.one
            P, j = P.diff(y[i] if i >= 0 else c) * Q + inner * (P * (p - j) + P.diff(log)), j + 1
        while j - self.power < SHORTEST + int(self.given):
            P, j = P * Q, j + 1
        return P, j, tuple(left)


def symmetric(size: int, order: int) -> list[tuple[int, ...]]:
    """Indices i >= j >= .. of the distinct derivatives of an order."""
    found: list[tuple[int, ...]] = [()]
    for _ in range(order):
        found = [(*before, i) for before in found for i in range(before[-1] + 1 if before else size)]
    return found


def less(numbers: tuple[int, ...], at: int) -> tuple[int, ...]:
    """One of them by one less."""
    return tuple(n - (i == at) for i, n in enumerate(numbers))


@dataclass(frozen=True)
class QuadraticPower:
    """A polynomial times a power of a quadratic polynomial."""

    used: tuple[int, ...]  # indices of the arguments
    symbols: tuple[sp.Symbol, ...]
    value: sp.Expr
    forms: tuple[tuple[sp.Expr, ...], ...]  # of y: a coefficient for each argument, then the offset
    rank: int
    constant: sp.Expr  # c
    power: sp.Rational  # p; if that is a parameter, for the numbers declared
    exponent: sp.Expr  # p itself
    log: bool  # whether it is all times the logarithm of the quadratic polynomial
    terms: tuple[tuple[tuple[int, ...], sp.Expr], ...]  # of the polynomial in y
    factor: Univariate | None = None  # g, of the last of the forms, which is an argument itself
    step: float = 0.2
    nodes: int = 0  # where the moments are of the order of the function's own scale
    error: float = 0.0
    count: int = 0  # of nodes, if it is to be the same always

    @property
    def shape(self) -> Shape:
        """What is to be integrated."""
        monomials = tuple(powers for powers, _ in self.terms)
        given, kinked, cone = not self.exponent.is_number, self.factor is not None, self.constant == 0
        return Shape(len(self.forms), self.rank, monomials, self.power, cone, kinked, self.log, given)

    @property
    def free(self) -> frozenset[sp.Basic]:
        """Parameters."""
        return frozenset(self.value.free_symbols - set(self.symbols))

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """Those of g: no others stand still while the other arguments move."""
        if self.factor is not None:
            argument = next(i for i, slope in zip(self.used, self.forms[-1], strict=False) if slope != 0)
            yield from ((argument, position) for position in self.factor.kinks())

    def expressions(self) -> Iterator[sp.Expr]:
        """Whatever depends on parameters."""
        yield from (self.constant, self.exponent)
        for row in self.forms:
            yield from row
        if self.factor is not None:
            yield from self.factor.kinks()

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """None that stand still."""
        return iter(())
