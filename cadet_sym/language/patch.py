"""The contact patch: the mean of the ground over its length, as a filter of stated order."""

from __future__ import annotations

from math import comb, factorial

import sympy as sp

from cadet_sym.language.roadfilters import chain
from cadet_sym.language.shaping import ShapingFilter, cascade


def patched(road: ShapingFilter, length: sp.Expr, order: int) -> ShapingFilter:
    """u(s) = (1 / L) times the integral of the ground from s - L to s.

    The transfer function (1 - exp(-pL)) / (pL) with the Pade approximant [n/n] of the exponential:
    (P(pL) - P(-pL)) / (pL P(pL)), stable, 1 at p = 0, of relative degree 1 for an odd order and 2 for an even one.
    """
    P = [sp.Rational(comb(order, k) * factorial(2 * order - k), factorial(2 * order)) for k in range(order + 1)]
    leading = P[order] * length**order
    denominator = [P[k] * length**k / leading for k in range(order)]
    numerator = [2 * P[k] * length ** (k - 1) / leading if k % 2 else sp.S.Zero for k in range(1, order + 1)]
    return cascade(road, chain(denominator, numerator))
