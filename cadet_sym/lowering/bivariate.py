"""The bivariate normal distribution in CasADi, finite and exact up to correlation +-1."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

from cadet_sym.expectation.panels import legendre
from cadet_sym.lowering.special import FAR, density, magnitude, mills_ratio

OWEN_ORDER = 16  # nodes that give Owen's T to 6e-17
APEX = 1e-16  # squared distance from the corner below which the direction to it no longer matters
LEAST = 1e-32  # added to 1 - rho^2


def one_minus_square(rho: ca.SX) -> ca.SX:
    """1 - rho^2, positive."""
    rest = (1 - rho) * (1 + rho)
    return ca.if_else(rest > 0, rest, 0) + LEAST


def orthant(h: ca.SX, k: ca.SX, rho: ca.SX) -> ca.SX:
    """P(X > h, Y > k) of two standard normal variables of correlation rho; h, k >= 0.

    (Q(h) + Q(k))/2 - T(h, a) - T(k, b) with Owen's T and a, b the tangents of the angles under which the corner (h, k) is
    seen from the feet of the two sides: D. B. Owen, Ann. Math. Statist. 27 (1956), 1075.
    """
    return _orthant_function()(h, k, rho)


@cache
def _orthant_function() -> ca.Function:
    h, k, rho = ca.SX.sym("h"), ca.SX.sym("k"), ca.SX.sym("rho")
    rest = one_minus_square(rho)
    r = ca.sqrt(rest)
    tails = [density(x) * mills_ratio(x) for x in (h, k)]
    # At the corner only the sum of the two angles is defined: they are taken as equal, which also keeps derivatives right.
    near = h * h - 2 * rho * h * k + k * k < APEX * rest
    hA, kA = ca.if_else(near, 1, h), ca.if_else(near, 1, k)
    first = _owen(h, tails[0], kA - rho * hA, hA * r, r, near)
    second = _owen(k, tails[1], hA - rho * kA, kA * r, r, near)
    return ca.Function("orthant", [h, k, rho], [(tails[0] + tails[1]) / 2 - first - second])


def _owen(h: ca.SX, tail: ca.SX, rise: ca.SX, run: ca.SX, r: ca.SX, near: ca.SX) -> ca.SX:
    """T(h, rise/run), run >= 0; steep ones from T(h, a) = (Q(h) + Q(a h))/2 - Q(h) Q(a h) - T(a h, 1/a)."""
    up = rise >= 0
    rise = magnitude(rise)
    steep = rise > run
    across = ca.if_else(near, h * rise / ca.if_else(steep, run, 1), rise / r)
    across = ca.if_else(across < FAR, across, FAR)
    slope = ca.if_else(steep, run, rise) / ca.if_else(steep, rise, ca.if_else(run > 0, run, 1))
    base = ca.if_else(steep, across, h)
    total = ca.SX(0)
    for x, w in zip(*legendre(OWEN_ORDER), strict=True):
        square = 1 + (slope * float(x)) ** 2
        total += float(w) * ca.exp(-base * base * square / 2) / square
    value = total * slope / (2 * math.pi)
    beyond = density(across) * mills_ratio(across)
    value = ca.if_else(steep, (tail + beyond) / 2 - tail * beyond - value, value)
    return ca.if_else(up, value, -value)
