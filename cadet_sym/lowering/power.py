"""Expectation of |z - k|^q: a power of a variance and a squared distance, times a polynomial of their ratio."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import prod
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.power import Power, shape

if TYPE_CHECKING:
    from cadet_sym.lowering.gaussian import Gaussian


def power_moment(power: Power, gaussian: Gaussian, order: int) -> ca.SX:
    """d^order/dm^order of E[coefficient |z - k|^q], or of that times sign(z - k): those of q - order; finite at rest."""
    falling = prod((power.exponent - j for j in range(order)), start=sp.S.One)
    odd, key = power.odd ^ bool(order % 2), (power.position, power.exponent, power.share, power.odd, order)
    if key not in gaussian.powers:
        function = _moment(power.exponent - order, power.share, odd=odd)
        gaussian.powers[key] = function(gaussian.m - gaussian.value(power.position), gaussian.v)
    return gaussian.value(power.coefficient) * float(falling) * gaussian.powers[key]


@lru_cache(maxsize=256)
def _moment(exponent: sp.Rational, share: sp.Rational, *, odd: bool) -> ca.Function:
    """(m, v) -> E|z|^e or E[sign(z) |z|^e]; made once, for it is put in line at a fraction of the cost."""
    m, v = ca.SX.sym("m"), ca.SX.sym("v")
    R = v + float(share) * m * m
    power = (exponent - 1) / 2 if odd else exponent / 2
    value = _to_the(R, power) * _chebyshev_sum(shape(exponent, share, odd=odd), 2 * (v / R) - 1)
    return ca.Function("power", [m, v], [ca.cse(m * value if odd else value)])


def _to_the(R: ca.SX, power: sp.Rational) -> ca.SX:
    """R^power; powers that differ by an integer share their costly factor, and quarters are square roots."""
    whole = sp.floor(power)
    quarters = 4 * (power - whole)
    root = ca.sqrt(R)
    parts = {1: ca.sqrt(root), 2: root, 3: root * ca.sqrt(root)}
    fraction = parts[int(quarters)] if quarters.is_Integer else R ** float(power - whole)
    for _ in range(abs(int(whole))):
        fraction = fraction * R if whole > 0 else fraction / R
    return fraction


def _chebyshev_sum(coefficients: Sequence[float], y: ca.SX) -> ca.SX:
    """sum_n a_n T_n(y): in powers of y it would lose digits, by Clenshaw's rule in single steps it takes thrice as long.

    With T_(4k+j) = 2 T_(4k) T_j - T_(4k-j) it is sum_k P_k T_k(T_4(y)), P_k a sum over T_0 .. T_3: Clenshaw's rule in T_4.
    """
    a = [*coefficients, *[0.0] * (-len(coefficients) % 4)]
    for k in range(len(a) - 4, 0, -4):
        for j in (1, 2, 3):
            a[k - j] -= a[k + j]
            a[k + j] *= 2
    second = 2 * y * y - 1
    third, fourth = y * (2 * second - 1), 2 * second * second - 1
    blocks = [(a[k] + a[k + 1] * y) + (a[k + 2] * second + a[k + 3] * third) for k in range(0, len(a), 4)]
    above, total = ca.SX(0), ca.SX(0)
    for block in reversed(blocks[1:]):
        above, total = total, 2 * fourth * total + (block - above)
    return fourth * total + (blocks[0] - above)
