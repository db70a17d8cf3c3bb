"""Pieces of polynomial x exp(a z + b z^2): the form whose Gaussian expectation is known, and its derivatives.

A function is held twice over: its `segments` (what it is between two kinks) and its `kinks` (by how much the expression
changes there, in powers of the distance from the kink). The expectation is the segment around the mean, taken as if it
held everywhere, corrected by the tails of the changes at all kinks. Every tail is then small, and nothing cancels when the
variance vanishes. A function continuous at a kink has a change whose constant is exactly zero, found symbolically.

With x = z - k, h = m - k, the change J(x) at the kink k contributes

    E[J 1(z > k)] for h < 0,   -E[J 1(z < k)] for h >= 0.

Rates a may be complex: a function with sin and cos is the real part of such a sum.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import sympy as sp
from sympy.logic.boolalg import Boolean

from cadet_sym.language.numeric import evaluate

Exponent = tuple[sp.Expr, sp.Expr]  # a, b of exp(a z + b z^2)
Coefficients = tuple[sp.Expr, ...]  # of z^0, z^1, ...
Decomposition = dict[Exponent, Coefficients]
PLAIN: Exponent = (sp.S.Zero, sp.S.Zero)


@dataclass(frozen=True)
class Term:
    """The real part of sum_n coefficients[n] x^n exp(rate x + curvature x^2), x the distance from a centre."""

    rate: sp.Expr
    curvature: sp.Expr
    coefficients: Coefficients

    @property
    def is_polynomial(self) -> bool:
        """Whether there is no exponential."""
        return (self.rate, self.curvature) == PLAIN

    def derivative(self) -> Term:
        """d/dx, of the same form."""
        coefficients = _derivative(self.coefficients, (self.rate, self.curvature))
        return Term(self.rate, self.curvature, coefficients)


PLAIN_TERM = Term(sp.S.Zero, sp.S.Zero, ())


@dataclass(frozen=True)
class Segment:
    """What the function is for lower < z < upper: a sum of terms about a centre."""

    lower: sp.Expr
    upper: sp.Expr
    centre: sp.Expr
    terms: tuple[Term, ...]


@dataclass(frozen=True)
class Kink:
    """By how much the function changes at a point: terms about that point."""

    position: sp.Expr
    terms: tuple[Term, ...]


@dataclass(frozen=True)
class PiecewiseForm:
    """A function as segments, and as changes at kinks."""

    segments: tuple[Segment, ...] = ()
    kinks: tuple[Kink, ...] = ()

    def derivative(self) -> PiecewiseForm:
        """The derivative between the kinks, without the impulses that jumps leave there."""
        segments = (Segment(s.lower, s.upper, s.centre, _nonzero(t.derivative() for t in s.terms)) for s in self.segments)
        kinks = (Kink(k.position, _nonzero(t.derivative() for t in k.terms)) for k in self.kinks)
        return PiecewiseForm(tuple(s for s in segments if s.terms), tuple(k for k in kinks if k.terms))


def decompose(expr: sp.Expr, z: sp.Symbol) -> Decomposition | None:
    """Write a smooth expression as a sum of polynomial x exp(a z + b z^2), a complex; None if it is not one."""
    if expr.is_polynomial(z):
        return {PLAIN: _coefficients(expr, z)}
    if not all(isinstance(f, _ELEMENTARY) or not f.has(z) for f in expr.atoms(sp.Function, sp.Pow)):
        return None
    exponential = expr.replace(lambda e: isinstance(e, _TRIGONOMETRIC) and e.has(z), _as_exponentials)
    groups: dict[Exponent, list[sp.Expr]] = defaultdict(list)
    for term in sp.Add.make_args(sp.expand(exponential, power_base=False)):
        factors = _separate(term, z)
        if factors is None:
            return None
        exponent, coefficient = factors
        if exponent[1].has(sp.I):  # a wave that gets shorter and shorter, sin(z^2)
            return None
        groups[exponent].append(coefficient)
    return {key: _coefficients(sp.Add(*terms), z) for key, terms in _without_conjugates(groups).items()}


_TRIGONOMETRIC = (sp.sin, sp.cos, sp.sinh, sp.cosh)
_ELEMENTARY = (*_TRIGONOMETRIC, sp.exp, sp.Pow)


def _as_exponentials(function: sp.Expr) -> sp.Expr:
    w = function.args[0]
    i = sp.I if isinstance(function, sp.sin | sp.cos) else sp.S.One
    sign = -1 if isinstance(function, sp.sin | sp.sinh) else 1
    scale = 2 * i if sign < 0 else sp.Integer(2)
    return (sp.exp(i * w) + sign * sp.exp(-i * w)) / scale


def _separate(term: sp.Expr, z: sp.Symbol) -> tuple[Exponent, sp.Expr] | None:
    """A product as ((a, b), polynomial) of polynomial x exp(a z + b z^2)."""
    polynomial: list[sp.Expr] = []
    exponents: list[sp.Expr] = []
    for factor in sp.Mul.make_args(term):
        base, power = factor.as_base_exp()
        if isinstance(factor, sp.exp):
            exponents.append(factor.args[0])
        elif isinstance(base, sp.exp):
            exponents.append(base.args[0] * power)
        elif not base.has(z) and power.has(z) and not base.is_nonpositive:
            exponents.append(power * sp.log(base))
        else:
            polynomial.append(factor)
    product, total = sp.Mul(*polynomial), sp.expand(sp.Add(*exponents))
    if not product.is_polynomial(z) or not total.is_polynomial(z) or sp.degree(total, z) > 2:
        return None
    c, a, b = (total.coeff(z, n) for n in range(3))
    return (a, b), product * sp.exp(c)


def _without_conjugates(groups: Mapping[Exponent, list[sp.Expr]]) -> dict[Exponent, list[sp.Expr]]:
    """Of two conjugate terms keep one, doubled: the function is the real part of the sum."""
    kept: dict[Exponent, list[sp.Expr]] = {}
    for (a, b), terms in groups.items():
        partner = (sp.conjugate(a), b)
        if partner != (a, b) and partner in kept:
            kept[partner] = [2 * t for t in kept[partner]]
        else:
            kept[a, b] = terms
    return kept


def piecewise_form(cells: Iterable[tuple[sp.Expr, sp.Expr, Boolean, Decomposition]]) -> PiecewiseForm:
    """Join (lower, upper, condition, decomposition) cells, which may overlap, into segments and kinks."""
    segments: list[Segment] = []
    changes: dict[sp.Expr, dict[Exponent, list[Coefficients]]] = defaultdict(lambda: defaultdict(list))
    for lower, upper, condition, parts in cells:
        finite = [bound for bound in (lower, upper) if not bound.is_infinite]
        centre = finite[0] if finite and not _may_be_infinite(finite[0]) else sp.S.Zero
        parts = {key: tuple(where(condition, c) for c in value) for key, value in parts.items()}
        terms = _nonzero(_shifted(key, coefficients, centre) for key, coefficients in parts.items())
        if terms:
            segments.append(Segment(lower, upper, centre, terms))
        for bound in finite:
            for key, coefficients in parts.items():
                signed = coefficients if bound is lower else tuple(-c for c in coefficients)
                changes[bound][key].append(signed)
    kinks = (Kink(position, _change(position, groups)) for position, groups in changes.items())
    return PiecewiseForm(tuple(segments), tuple(k for k in kinks if k.terms))


def _may_be_infinite(position: sp.Expr) -> bool:
    """Whether it is one over something that may vanish, as the kink of clip(x y^2) in x: about it all digits are lost then."""
    powers = (power for power in position.atoms(sp.Pow) if power.base.free_symbols)
    return any(power.exp.could_extract_minus_sign() for power in powers)


def jump_of(terms: tuple[Term, ...], order: int) -> sp.Expr:
    """Jump of the derivative of that order that a change at a kink makes."""
    for _ in range(order):
        terms = tuple(t.derivative() for t in terms)
    total = sp.Add(*(t.coefficients[0] for t in terms if t.coefficients))
    return (total + total.xreplace({sp.I: -sp.I})) / 2 if total.has(sp.I) else total  # all else in it is real


def about(centre: sp.Expr, coefficients: Coefficients) -> Coefficients:
    """Coefficients of a polynomial in powers of the distance from a point."""
    return _shifted(PLAIN, coefficients, centre).coefficients


def where(condition: Boolean, value: sp.Expr) -> sp.Expr:
    """A value where a condition on parameters holds, else zero."""
    if condition == sp.true or value == 0:
        return value
    return sp.Piecewise((value, condition), (sp.S.Zero, sp.true), evaluate=False)


def _coefficients(expr: sp.Expr, z: sp.Symbol) -> Coefficients:
    return tuple(reversed(sp.Poly(expr, z).all_coeffs()))


def _derivative(coefficients: Coefficients, exponent: Exponent) -> Coefficients:
    a, b = exponent
    size = len(coefficients)
    at = dict(enumerate(coefficients))
    result = [
        (n + 1) * at.get(n + 1, sp.S.Zero) + a * at.get(n, sp.S.Zero) + 2 * b * at.get(n - 1, sp.S.Zero)
        for n in range(size + 1)
    ]
    while result and result[-1] == 0:
        result.pop()
    return tuple(result)


def _nonzero(terms: Iterable[Term]) -> tuple[Term, ...]:
    return tuple(t for t in terms if any(c != 0 for c in t.coefficients))


def _shifted(key: Exponent, coefficients: Coefficients, centre: sp.Expr) -> Term:
    """Re-expand sum c_n z^n exp(a z + b z^2) in powers of x = z - centre."""
    if centre == 0:
        return Term(*key, tuple(normal(c) for c in coefficients))
    a, b = key
    factor = sp.exp(a * centre + b * centre**2)
    shifted = []
    for n in range(len(coefficients)):
        powers = (sp.binomial(j, n) * coefficients[j] * centre ** (j - n) for j in range(n, len(coefficients)))
        shifted.append(normal(factor * sp.Add(*powers)))
    return Term(normal(a + 2 * b * centre), b, tuple(shifted))


def _change(position: sp.Expr, groups: Mapping[Exponent, list[Coefficients]]) -> tuple[Term, ...]:
    terms = []
    for key, changes in groups.items():
        size = max(map(len, changes))
        total = tuple(sp.Add(*(c[n] for c in changes if len(c) > n)) for n in range(size))
        terms.append(_shifted(key, total, position))
    return _nonzero(terms)


def normal(expr: sp.Expr) -> sp.Expr:
    """An expression in a form in which what is identically zero is zero."""
    if expr.is_Rational:
        return expr
    expanded = sp.expand(expr)
    if not expanded.is_Add or expanded.is_polynomial(*expanded.free_symbols):
        return expanded if not expanded.has(*_RADICAL) or not _vanishes(expanded) else sp.S.Zero
    return sp.S.Zero if _vanishes(expanded) else expanded


_RADICAL = (sp.Pow, sp.exp, sp.log, sp.Function)


def _vanishes(expr: sp.Expr) -> bool:
    """Whether an expression is zero at points chosen at random, to many digits; never guessed for a conditional."""
    terms = sp.Add.make_args(expr)
    if len(terms) == 1 or expr.has(sp.Piecewise, sp.Max, sp.Min, sp.Heaviside, sp.sign, sp.Abs):
        return False
    symbols = sorted(expr.free_symbols, key=str)
    for start in (3, 11):
        point = {s: sp.Rational(start + 2 * i, 7) for i, s in enumerate(symbols)}
        if not expr.has(sp.I):  # doubles are enough to see that it is not zero
            values = [evaluate(term, {s: float(v) for s, v in point.items()}) for term in terms]
            if abs(math.fsum(values)) > 1e-9 * max(map(abs, values)):
                return False
        exact = [sp.N(term.subs(point), 40) for term in terms]
        size = sp.Add(*(abs(value) for value in exact))
        if not size.is_finite or abs(sum(exact, sp.Float(0, 40))) > size * sp.Float("1e-30"):
            return False
    return True
