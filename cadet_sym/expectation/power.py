"""Roots and other powers of a distance, |z - k|^q: their expectation is one smooth function, kept as a polynomial."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache

import mpmath
import sympy as sp

from cadet_sym.expectation.cells import Cell, Partition
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.pieces import affine

DIGITS = 40
LEFT = 1e-17  # of the largest coefficient, below which the rest is left out
POINTS = 64  # of the interpolation, doubled until it is as accurate
LOW, LOW_SHARE, SHARE = 3, sp.Rational(1, 16), sp.Rational(1, 4)
HIGHEST = 10  # from which on a polynomial for all ratios of mean and deviation loses digits


@dataclass(frozen=True)
class Power:
    """coefficient |z - position|^exponent, times sign(z - position) if `odd`; the exponent is a number, no integer."""

    coefficient: sp.Expr
    position: sp.Expr
    exponent: sp.Rational
    odd: bool

    @property
    def share(self) -> sp.Rational:
        """c in the variable v/(v + c d^2) of the polynomials: so chosen that these are short, and no digits are lost."""
        return LOW_SHARE if self.exponent < LOW else SHARE


_Key = tuple[sp.Expr, sp.Rational, Cell]  # position, exponent, conditions


def powers_in(cells: Partition, z: sp.Symbol) -> tuple[tuple[Power, ...], Partition]:
    """Take the powers that are the same on both sides of their zero, but for the sign, out of a partition of the line."""
    terms = [(cell, term, _one_sided(term, cell, z)) for cell, value in cells for term in sp.Add.make_args(value)]
    above: dict[_Key, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    below: dict[_Key, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for cell, _, found in terms:
        if found is not None:
            (above if cell.lowers else below)[found[0]] += found[1]
    powers: dict[_Key, Power] = {}
    for key, coefficient in above.items():
        position, exponent, conditions = key
        for sign in (1, -1) if key in below else ():
            if normal(coefficient - sign * below[key]) == 0:
                powers[key] = Power(conditions.indicated(coefficient), position, exponent, sign < 0)
    left: dict[Cell, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for cell, term, found in terms:
        left[cell] += term if found is None or found[0] not in powers else sp.S.Zero
    return tuple(powers.values()), [(cell, value) for cell, value in left.items() if value != 0] if powers else cells


def _one_sided(term: sp.Expr, cell: Cell, z: sp.Symbol) -> tuple[_Key, sp.Expr] | None:
    """A power of the distance from the end of a half-line, as what it is told by, and its coefficient; or None."""
    if len(cell.lowers) + len(cell.uppers) != 1:
        return None
    (end,), side = cell.lowers or cell.uppers, 1 if cell.lowers else -1
    coefficient, varying = term.as_independent(z, as_Add=False)
    base, exponent = varying.as_base_exp()
    line = affine(base, z) if exponent.is_Rational and not exponent.is_Integer and 0 < exponent < HIGHEST else None
    if line is None or not line[0].is_number or side * line[0] < 0 or normal(line[0] * end + line[1]) != 0:
        return None
    return (end, exponent, Cell((), (), cell.conditions)), coefficient * (side * line[0]) ** exponent


@lru_cache(maxsize=256)
def shape(exponent: sp.Rational, share: sp.Rational, *, odd: bool) -> tuple[float, ...]:
    """G in E|z|^e = R^(e/2) G(w), R = v + c m^2, w = v/R, for z ~ N(m, v), in Chebyshev's polynomials of 2 w - 1; c is `share`.

    If odd that of E[sign(z) |z|^e] = m R^((e - 1)/2) G(w). With M Kummer's function,

        E|z|^e          =      (2 v)^(e/2)       Gamma((1 + e)/2) / sqrt(pi)    M(-e/2,      1/2, -m^2/(2 v)),
        E[sign(z)|z|^e] = m 2^((e+1)/2) v^((e-1)/2) Gamma(1 + e/2) / sqrt(pi)   M((1 - e)/2, 3/2, -m^2/(2 v)),

    which also for e < -1, where there is no expectation, are the derivatives in m of those of larger exponents.
    """
    with mpmath.workdps(DIGITS):
        count = POINTS
        while True:
            series = _interpolated(exponent, share, count, odd=odd)
            least = LEFT * max(map(abs, series))
            last = max(n for n, coefficient in enumerate(series) if abs(coefficient) > least)
            if last < count - 4:
                return tuple(float(coefficient) for coefficient in series[: last + 1])
            count *= 2


def _interpolated(exponent: sp.Rational, share: sp.Rational, count: int, *, odd: bool) -> list[mpmath.mpf]:
    """Coefficients of Chebyshev's polynomials."""
    e, c = (mpmath.mpf(int(q.p)) / int(q.q) for q in (exponent, share))
    half, scale = (e - 1) / 2 if odd else e / 2, 2 ** ((e + odd) / 2) / mpmath.sqrt(mpmath.pi)
    scale *= mpmath.gamma(1 + e / 2 if odd else (1 + e) / 2)
    angles = [mpmath.pi * (k + mpmath.mpf(1) / 2) / count for k in range(count)]
    cosines = [mpmath.cos(angle) for angle in angles]
    values = []
    for y in cosines:
        w = (1 + y) / 2
        M = mpmath.hyp1f1(-half, mpmath.mpf(3 if odd else 1) / 2, -(1 / w - 1) / (2 * c))
        values.append(scale * M * w**half)
    sums, before, now = [sum(values) / count], [mpmath.mpf(1)] * count, cosines
    for _ in range(count - 1):
        sums.append(2 * sum(f * t for f, t in zip(values, now, strict=True)) / count)
        before, now = now, [2 * y * t - b for y, t, b in zip(cosines, now, before, strict=True)]
    return sums
