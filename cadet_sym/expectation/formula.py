"""The expectation of a nonlinearity written out, for reading: E[f(z)] in the mean m and the variance p of z.

A piece c (z - k)^n e^(a (z - k)) between l and u contributes, with x = m + a p - k and the standardised ends
alpha, beta about m + a p,

    c e^(a (m - k) + a^2 p / 2) sum_j binomial(n, j) x^(n-j) p^(j/2) J_j(alpha, beta)

    J_0 = Phi(beta) - Phi(alpha),  J_1 = phi(alpha) - phi(beta)
    J_j = (j-1) J_(j-2) - [beta^(j-1) phi(beta) - alpha^(j-1) phi(alpha)]

What is computed is arranged otherwise (see `closed_form`), so that nothing cancels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import sympy as sp

from cadet_sym.expectation.closed_form import Segment, Term
from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.univariate import Univariate

if TYPE_CHECKING:
    from cadet_sym.expectation.describing import DescribingFunction

__all__ = ["expectation_formula", "tidy"]

MOST_PIECES = 8  # of which a formula can be read


def expectation_formula(describing: DescribingFunction) -> sp.Expr | None:
    """E[f] of a describing function; None if it has no closed form that is short enough to be read.

    There is one for functions of one argument made of polynomials, exponentials, sines and cosines, and for
    polynomials of several.
    """
    total = sp.S.Zero
    for product in describing.products:
        value = _of_product(product, describing) if isinstance(product, Product) else None
        if value is None:
            return None
        total += value
    return tidy(total)


def tidy(expression: sp.Expr) -> sp.Expr:
    """Terms sorted by the exponentials and error functions that they hold, the rest of each factored."""
    atoms = sorted(expression.atoms(sp.exp, sp.erf), key=str)
    marks = {atom: sp.Dummy(real=True) for atom in atoms}
    sorted_out = sp.collect(sp.expand(expression.xreplace(marks)), list(marks.values()), sp.factor)
    return sorted_out.xreplace({mark: atom for atom, mark in marks.items()})


def _of_product(product: Product, describing: DescribingFunction) -> sp.Expr | None:
    if not product.functions:
        return product.coefficient * _moment(product.powers, describing.means, _covariances(describing))
    if len(product.functions) > 1 or any(product.powers):
        return None
    index, function = next(iter(product.functions))
    variance = _covariances(describing)[index, index]
    p = sp.Dummy(positive=True)
    value = _of_univariate(function, describing.means[index], p)
    return None if value is None else product.coefficient * value.xreplace({p: variance})


def _covariances(describing: DescribingFunction) -> Mapping[tuple[int, int], sp.Symbol]:
    pairs = ((i, j) for i in range(len(describing.means)) for j in range(i + 1))
    lower = dict(zip(pairs, describing.covariances, strict=True))
    return lower | {(j, i): value for (i, j), value in lower.items()}


def _moment(powers: Sequence[int], means: Sequence[sp.Symbol], S: Mapping[tuple[int, int], sp.Symbol]) -> sp.Expr:
    """E[prod z_i^n_i] by Stein's lemma: E[z_a g] = m_a E[g] + sum_i S_ai E[dg/dz_i]."""
    a = next((i for i, n in enumerate(powers) if n), None)
    if a is None:
        return sp.S.One
    rest = [n - (i == a) for i, n in enumerate(powers)]
    total = means[a] * _moment(rest, means, S)
    for i, n in enumerate(rest):
        if n:
            lower = [k - (j == i) for j, k in enumerate(rest)]
            total += S[a, i] * n * _moment(lower, means, S)
    return sp.expand(total)


def _of_univariate(function: Univariate, m: sp.Symbol, p: sp.Symbol) -> sp.Expr | None:
    if function.tables or function.error_functions or function.powers or function.integrals:
        return None
    if len(function.closed.segments) > MOST_PIECES:
        return None
    total = sp.S.Zero
    for segment in function.closed.segments:
        for term in segment.terms:
            value = _of_term(segment, term, m, p)
            if value is None:
                return None
            total += value
    return total


def _of_term(segment: Segment, term: Term, m: sp.Symbol, p: sp.Symbol) -> sp.Expr | None:
    whole = segment.lower.is_infinite and segment.upper.is_infinite
    if term.curvature != 0 or (term.rate.has(sp.I) and not whole):
        return None
    shifted = m + term.rate * p
    distance = shifted - segment.centre
    bounds = (segment.lower, segment.upper)
    ends = (b if b.is_infinite else (b - shifted) / sp.sqrt(p) for b in bounds)
    J = _partial_moments(len(term.coefficients), *ends, whole=whole)
    total = sp.Add(
        *(
            c * sp.binomial(n, j) * distance ** (n - j) * sp.sqrt(p) ** j * J[j]
            for n, c in enumerate(term.coefficients)
            for j in range(n + 1)
        )
    )
    factor = sp.exp(term.rate * (m - segment.centre) + term.rate**2 * p / 2)
    value = factor * total
    return sp.re(sp.expand(value, complex=True)) if term.rate.has(sp.I) else value


def _partial_moments(count: int, alpha: sp.Expr, beta: sp.Expr, *, whole: bool) -> list[sp.Expr]:
    """J_0 .. of a standard normal variable between alpha and beta."""
    if whole:
        return [sp.S.Zero if j % 2 else sp.factorial2(j - 1) for j in range(count)]
    J = [_distribution(beta) - _distribution(alpha), _density(alpha) - _density(beta)]
    for j in range(2, count):
        tails = [_edge(end, j - 1) for end in (alpha, beta)]
        J.append((j - 1) * J[j - 2] + tails[0] - tails[1])
    return J


def _edge(end: sp.Expr, power: int) -> sp.Expr:
    return sp.S.Zero if end.is_infinite else end**power * _density(end)


def _density(end: sp.Expr) -> sp.Expr:
    return sp.S.Zero if end.is_infinite else sp.exp(-(end**2) / 2) / sp.sqrt(2 * sp.pi)


def _distribution(end: sp.Expr) -> sp.Expr:
    if end.is_infinite:
        return sp.S.One if end == sp.oo else sp.S.Zero
    return (1 + sp.erf(sp.factor(end / sp.sqrt(2)))) / 2
