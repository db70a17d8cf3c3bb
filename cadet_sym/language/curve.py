"""Measured curves: slopes, pieces and values of a `Lookup`."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.language.vocabulary import Lookup

# A slope of the monotone cubic is kept as a decimal of so many digits: exact rationals would grow without end.
_SLOPE_DIGITS = 17


def monotone_slopes(knots: Sequence[sp.Rational], values: Sequence[sp.Rational]) -> list[sp.Rational]:
    """Slopes at the rows of the monotone cubic (Fritsch & Butland 1984, SIAM J. Sci. Stat. Comput. 5, 300).

    Inside, the weighted harmonic mean of the two secants, or 0 where they differ in sign; at the ends the one-sided
    three-point slope, limited to keep the shape.
    """
    steps = [float(b - a) for a, b in pairwise(knots)]
    secants = [float(b - a) / h for a, b, h in zip(values, values[1:], steps, strict=False)]
    if len(secants) == 1:
        return [(values[1] - values[0]) / (knots[1] - knots[0])] * 2
    slopes = [_end(steps[0], steps[1], secants[0], secants[1])]
    for k in range(1, len(secants)):
        before, after = secants[k - 1], secants[k]
        if before * after <= 0:
            slopes.append(0.0)
            continue
        w1, w2 = 2 * steps[k] + steps[k - 1], steps[k] + 2 * steps[k - 1]
        slopes.append((w1 + w2) / (w1 / before + w2 / after))
    slopes.append(_end(steps[-1], steps[-2], secants[-1], secants[-2]))
    return [sp.Rational(f"{slope:.{_SLOPE_DIGITS}g}") for slope in slopes]


def _end(h0: float, h1: float, d0: float, d1: float) -> float:
    slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 <= 0 and abs(slope) > 3 * abs(d0) else slope


def coefficients(curve: Lookup) -> list[tuple[sp.Rational, ...]]:
    """Polynomials (c0, c1, ...) in z - z_k, one a row interval."""
    z, f = ([Fraction(int(v.p), int(v.q)) for v in column] for column in (curve.knots, curve.values))
    secants = [(b - a) / (q - p) for (a, b), (p, q) in zip(pairwise(f), pairwise(z), strict=True)]
    if curve.method == "linear":
        pieces: list[tuple[Fraction, ...]] = list(zip(f, secants, strict=False))
    else:
        slopes = [Fraction(int(m.p), int(m.q)) for m in monotone_slopes(curve.knots, curve.values)]
        pieces = []
        for k, d in enumerate(secants):
            h, a, b = z[k + 1] - z[k], slopes[k], slopes[k + 1]
            pieces.append((f[k], a, (3 * d - 2 * a - b) / h, (a + b - 2 * d) / h**2))
    return [tuple(sp.Rational(c.numerator, c.denominator) for c in piece) for piece in pieces]


def curve_pieces(curve: Lookup, low: Any = sp.S.NegativeInfinity, high: Any = sp.S.Infinity) -> sp.Expr:
    """The curve as a Piecewise of polynomials in its argument, which is known to lie between two numbers."""
    z, knots = curve.argument, curve.knots
    polynomials = [_polynomial(piece, z, k) for piece, k in zip(coefficients(curve), knots, strict=False)]
    edges = list(knots[1:-1])
    if curve.outside != "extrapolate":
        polynomials = [curve.values[0], *polynomials, curve.values[-1]]
        edges = list(knots)
    first = bisect_right(edges, low)
    last = max(first, bisect_left(edges, high))
    return pieced(polynomials[first : last + 1], edges[first:last], z)


def pieced(polynomials: Sequence[sp.Expr], edges: Sequence[sp.Expr], z: sp.Expr) -> sp.Expr:
    """The first polynomial before the first edge, and so on; the last after the last edge."""
    if not edges:
        return polynomials[-1]
    branches = [(p, sp.StrictLessThan(z, edge, evaluate=False)) for p, edge in zip(polynomials, edges, strict=False)]
    return sp.Piecewise(*branches, (polynomials[-1], sp.true), evaluate=False)


def _polynomial(piece: Sequence[sp.Rational], z: sp.Expr, knot: sp.Rational) -> sp.Expr:
    """c0 + c1 (z - k) + ... as it stands: SymPy's evaluation of thousands of them would take seconds.

    Unless z is a sum, or a slope is 1: a sum within another is no polynomial to SymPy. Numbers are put in.
    """
    if z.is_Add or z.is_number or piece[1] == 1:
        return sp.Add(*(c * (z - knot) ** n for n, c in enumerate(piece)))
    d = sp.Add(z, -knot, evaluate=False) if knot != 0 else z
    terms = [piece[0]] if piece[0] != 0 else []
    for n, c in enumerate(piece[1:], start=1):
        power = d if n == 1 else sp.Pow(d, n, evaluate=False)
        if c != 0:
            terms.append(power if c == 1 else sp.Mul(c, power, evaluate=False))
    return sp.Add(*terms, evaluate=False) if terms else sp.S.Zero


def travelled(curve: Lookup) -> sp.Expr:
    """Integral from 0 to its argument of a curve that begins at 0 or later and holds its ends."""
    z, knots, values = curve.argument, curve.knots, curve.values
    parts, carried = [_polynomial((sp.S.Zero, values[0]), z, sp.S.Zero)], values[0] * knots[0]
    for k, piece in enumerate(coefficients(curve)):
        whole = (carried, *(c / (n + 1) for n, c in enumerate(piece)))
        parts.append(_polynomial(whole, z, knots[k]))
        carried = sp.Add(*(c * (knots[k + 1] - knots[k]) ** n for n, c in enumerate(whole)))
    parts.append(_polynomial((carried, values[-1]), z, knots[-1]))
    return pieced(parts, knots, z)


@lru_cache(maxsize=32)
def _in_doubles(curve: Lookup) -> tuple[np.ndarray, np.ndarray]:
    """Rows and polynomials: from rationals a slow way for a quadrature that asks a thousand times."""
    return np.array([float(k) for k in curve.knots]), np.array([[float(c) for c in piece] for piece in coefficients(curve)])


def curve_values(curve: Lookup, z: Any) -> np.ndarray:
    """Values of the curve at numbers."""
    z = np.asarray(z, float)
    knots, pieces = _in_doubles(curve)
    at = np.clip(z, knots[0], knots[-1]) if curve.outside != "extrapolate" else z
    k = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    value = np.zeros_like(at)
    for n in reversed(range(pieces.shape[1])):
        value = value * (at - knots[k]) + pieces[k, n]
    return value
