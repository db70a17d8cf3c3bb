"""The normal distribution in CasADi: smooth, exact in both tails, finite at zero variance."""

from __future__ import annotations

import math

import casadi as ca

# R(x) = (1 - Phi(x))/phi(x), Mills' ratio: R(x) = t p(2 t - 1), t = 5/(5 + x), x >= 0. Coefficients of p by rising power:
# Chebyshev interpolation of R(x)/t at 60 points in 40 digits, cut where 1e-17 is reached, written in powers.
# tests/test_expectation_normal.py makes them again.
MILLS_SCALE = 5.0
MILLS = (
    0.38561620943063152947,
    0.33357331903779201068,
    0.2483094123147732843,
    0.15718221510930904795,
    0.082728943146536754511,
    0.034650946817430084061,
    0.010425100482455760399,
    0.0015006565641357517803,
    -0.00039999239499687317098,
    -0.00027317183218848721672,
    -2.9766610464679601493e-05,
    2.4947131637442161429e-05,
    8.36291717326492554e-06,
    -1.9949560171085465191e-06,
    -1.3890066276983256712e-06,
    1.672135196036281378e-07,
    2.187326704718788253e-07,
    -1.9336856714432650546e-08,
    -3.528247937954380557e-08,
    3.479624855535839e-09,
    5.6344023950886061444e-09,
    -6.3737336877330261315e-10,
    -7.6883681299298408623e-10,
    6.6737009758463364172e-11,
    6.2512108943208252108e-11,
)
FAR = 39.0  # phi(39) is smaller than any number


def density(u: ca.SX) -> ca.SX:
    """Standard normal density phi(u)."""
    return ca.exp(-u * u / 2) * (1 / math.sqrt(2 * math.pi))


def mills_ratio(x: ca.SX) -> ca.SX:
    """(1 - Phi(x))/phi(x) for x >= 0, to 4e-16 relative."""
    t = MILLS_SCALE / (MILLS_SCALE + x)
    y = 2 * t - 1
    total = ca.SX(MILLS[-1])
    for coefficient in reversed(MILLS[:-1]):
        total = total * y + coefficient
    return t * total


def mills_moments(x: ca.SX, count: int) -> list[ca.SX]:
    """r_n(x) = int_0^inf t^n exp(-x t - t^2/2) dt for n < count, x >= 0: E[(e - x)_+^n] = phi(x) r_n(x)."""
    ratios = [mills_ratio(x)]
    if count > 1:
        ratios.append(1 - x * ratios[0])
    for n in range(2, count):
        ratios.append((n - 1) * ratios[n - 2] - x * ratios[n - 1])
    return ratios


def magnitude(x: ca.SX) -> ca.SX:
    """|x| with the slope of the right-hand side at zero, where `fabs` has none."""
    return ca.if_else(x >= 0, x, -x)


def positive_part(x: ca.SX) -> ca.SX:
    """max(x, 0) with slope one at zero, where `fmax` has a half."""
    return ca.if_else(x >= 0, x, 0)
