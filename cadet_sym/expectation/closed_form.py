"""Pieces of polynomial x exp(a z + b z^2): the form whose Gaussian expectation is known, and its derivatives.

A function is held twice over: its `segments` (what it is between two kinks) and its `kinks` (by how much the expression
changes there, in powers of the distance from the kink). The expectation is the segment around the mean, taken as if it
held everywhere, corrected by the tails of the changes at all kinks. Every tail is then small, and nothing cancels when the
variance vanishes. A function continuous at a kink has a change whose constant is exactly zero, found symbolically.

With x = z - k, h = m - k, the change J(x) at the kink k contributes

    E[J 1(z > k)] for h < 0,   -E[J 1(z < k)] for h >= 0.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import sympy as sp

from cadet_sym.expectation.pieces import Partition

Exponent = tuple[sp.Expr, sp.Expr]  # a, b of exp(a z + b z^2)
PLAIN: Exponent = (sp.S.Zero, sp.S.Zero)
JUMPS_KEPT = 4  # of the function and its derivatives: enough for F_0 .. F_4


@dataclass(frozen=True)
class Term:
    """sum_n coefficients[n] x^n exp(rate x + curvature x^2), x the distance from a centre."""

    rate: sp.Expr
    curvature: sp.Expr
    coefficients: tuple[sp.Expr, ...]

    @property
    def exponent(self) -> Exponent:
        """The pair (rate, curvature)."""
        return self.rate, self.curvature

    def derivative(self) -> Term:
        """d/dx, of the same form."""
        return Term(self.rate, self.curvature, _derivative(self.coefficients, self.exponent))


@dataclass(frozen=True)
class Segment:
    """What the function is for lower < z < upper: a sum of terms about a centre."""

    lower: sp.Expr
    upper: sp.Expr
    centre: sp.Expr
    terms: tuple[Term, ...]


@dataclass(frozen=True)
class Kink:
    """By how much the function changes at a point: terms about that point, and the jumps of f, f', f'' they make."""

    position: sp.Expr
    terms: tuple[Term, ...]
    jumps: tuple[sp.Expr, ...] = ()


@dataclass(frozen=True)
class PiecewiseForm:
    """A function as segments, and as changes at kinks."""

    segments: tuple[Segment, ...]
    kinks: tuple[Kink, ...]

    def derivative(self) -> PiecewiseForm:
        """The derivative between the kinks, without the impulses that jumps leave there."""
        segments = tuple(
            Segment(s.lower, s.upper, s.centre, _nonzero(t.derivative() for t in s.terms))
            for s in self.segments
        )
        kinks = tuple(
            Kink(k.position, _nonzero(t.derivative() for t in k.terms), k.jumps[1:]) for k in self.kinks
        )
        return PiecewiseForm(segments, kinks)


Decomposition = dict[Exponent, tuple[sp.Expr, ...]]  # exponent -> coefficients of z^n


def decompose(expr: sp.Expr, z: sp.Symbol) -> Decomposition | None:
    """Write a smooth expression as a sum of polynomial x exp(a z + b z^2); None if it is not one."""
    if expr.is_polynomial(z):
        return {PLAIN: _coefficients(expr, z)}
    if not expr.has(sp.exp, sp.sinh, sp.cosh, sp.Pow):
        return None
    groups: dict[Exponent, list[sp.Expr]] = defaultdict(list)
    for term in sp.Add.make_args(sp.expand(expr.rewrite([sp.sinh, sp.cosh], sp.exp), power_base=False)):
        polynomial, exponent = [], []
        for factor in sp.Mul.make_args(term):
            base, power = factor.as_base_exp()
            if base is sp.E:
                exponent.append(power)
            elif not base.has(z) and power.has(z) and base.is_positive:
                exponent.append(power * sp.log(base))
            else:
                polynomial.append(factor)
        product, total = sp.Mul(*polynomial), sp.expand(sp.Add(*exponent))
        if not product.is_polynomial(z) or not total.is_polynomial(z) or sp.degree(total, z) > 2:
            return None
        c, a, b = (total.coeff(z, n) for n in range(3))
        if b != 0 and not b.is_nonpositive:
            return None
        groups[a, b].append(product * sp.exp(c))
    return {key: _coefficients(sp.Add(*terms), z) for key, terms in groups.items()}


def piecewise_form(partition: Iterable[tuple[sp.Expr, sp.Expr, Decomposition]]) -> PiecewiseForm:
    """Join (lower, upper, decomposition) cells, which may overlap, into segments and kinks."""
    segments: list[Segment] = []
    changes: dict[sp.Expr, dict[Exponent, list[tuple[sp.Expr, ...]]]] = defaultdict(lambda: defaultdict(list))
    for lower, upper, parts in partition:
        finite = [bound for bound in (lower, upper) if not bound.is_infinite]
        centre = finite[0] if finite else sp.S.Zero
        terms = tuple(_shifted(key, coefficients, centre) for key, coefficients in parts.items())
        segments.append(Segment(lower, upper, centre, terms))
        for bound in finite:
            for key, coefficients in parts.items():
                changes[bound][key].append(
                    coefficients if bound is lower else tuple(-c for c in coefficients)
                )
    kinks = (_kink(position, groups) for position, groups in changes.items())
    return PiecewiseForm(tuple(segments), tuple(k for k in kinks if k.terms))


def jumps(cells: Iterable[tuple[sp.Expr, sp.Expr, sp.Expr]], z: sp.Symbol) -> dict[sp.Expr, list[sp.Expr]]:
    """Jumps of f, f', f'', .. at every bound of (lower, upper, value) cells."""
    at: dict[sp.Expr, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for lower, upper, value in cells:
        if not lower.is_infinite:
            at[lower] += value
        if not upper.is_infinite:
            at[upper] -= value
    result = {}
    for position, change in at.items():
        sizes = []
        for _ in range(JUMPS_KEPT):
            sizes.append(normal(change.subs(z, position)))
            change = sp.diff(change, z)
        result[position] = sizes
    return result


def bounded(partition: Partition) -> list[tuple[sp.Expr, sp.Expr, sp.Expr]]:
    """Cells as (lower, upper, value); conditions on the parameters go into the value."""
    result = []
    for cell, value in partition:
        if cell.conditions:
            value = sp.Piecewise((value, sp.And(*cell.conditions)), (0, True))
        result.append((cell.lower, cell.upper, value))
    return result


def _coefficients(expr: sp.Expr, z: sp.Symbol) -> tuple[sp.Expr, ...]:
    return tuple(reversed(sp.Poly(expr, z).all_coeffs()))


def _derivative(coefficients: tuple[sp.Expr, ...], exponent: Exponent) -> tuple[sp.Expr, ...]:
    a, b = exponent
    size = len(coefficients)
    at = dict(enumerate(coefficients))
    result = [
        (n + 1) * at.get(n + 1, 0) + a * at.get(n, 0) + 2 * b * at.get(n - 1, 0) for n in range(size + 1)
    ]
    while result and result[-1] == 0:
        result.pop()
    return tuple(sp.sympify(c) for c in result)


def _nonzero(terms: Iterable[Term]) -> tuple[Term, ...]:
    return tuple(t for t in terms if any(c != 0 for c in t.coefficients))


def _shifted(key: Exponent, coefficients: tuple[sp.Expr, ...], centre: sp.Expr) -> Term:
    """Re-expand sum c_n z^n exp(a z + b z^2) in powers of x = z - centre."""
    a, b = key
    factor = sp.exp(a * centre + b * centre**2)
    shifted = [
        normal(
            factor
            * sp.Add(
                *(sp.binomial(j, n) * c * centre ** (j - n) for j, c in enumerate(coefficients) if j >= n)
            )
        )
        for n in range(len(coefficients))
    ]
    while len(shifted) > 1 and shifted[-1] == 0:
        shifted.pop()
    return Term(normal(a + 2 * b * centre), b, tuple(shifted))


def _kink(position: sp.Expr, groups: Mapping[Exponent, list[tuple[sp.Expr, ...]]]) -> Kink:
    terms = []
    for key, changes in groups.items():
        size = max(map(len, changes))
        total = tuple(sp.Add(*(c[n] for c in changes if len(c) > n)) for n in range(size))
        terms.append(_shifted(key, total, position))
    terms = list(_nonzero(terms))
    jumps, differentiated = [], terms
    for _ in range(JUMPS_KEPT):
        jumps.append(normal(sp.Add(*(t.coefficients[0] for t in differentiated if t.coefficients))))
        differentiated = [t.derivative() for t in differentiated]
    return Kink(position, tuple(terms), tuple(jumps))


def normal(expr: sp.Expr) -> sp.Expr:
    """An expression in a form in which what is identically zero is zero."""
    if expr.is_Rational:
        return expr
    expanded = sp.expand(expr)
    if expanded.is_Rational or expanded.is_Symbol or not expanded.is_Add:
        return expanded
    if expanded.is_polynomial(*expanded.free_symbols):
        return expanded
    return sp.S.Zero if _vanishes(expanded) else expanded


def _vanishes(expr: sp.Expr) -> bool:
    """Whether an expression is zero at points chosen at random, to many digits; never guessed for a conditional."""
    if expr.has(sp.Piecewise, sp.Max, sp.Min, sp.Heaviside, sp.sign, sp.Abs):
        return False
    symbols = sorted(expr.free_symbols, key=str)
    for start in (3, 11):
        values = {s: sp.Rational(start + 2 * i, 7) + sp.sqrt(start + i) / 5 for i, s in enumerate(symbols)}
        value = expr.subs(values)
        size = sum((abs(sp.N(term.subs(values), 15)) for term in sp.Add.make_args(expr)), sp.Float(0))
        if not abs(sp.N(value, 40)) <= size * sp.Float("1e-30"):
            return False
    return True
