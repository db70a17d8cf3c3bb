"""The normal distribution in CasADi: exact in both tails, of complex argument too, finite at zero variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import casadi as ca
import numpy as np

from cadet_sym.lowering.complex import Complex, select

# R(x) = (1 - Phi(x))/phi(x), Mills' ratio: R(x) = t p(2 t - 1), t = 5/(5 + x), x >= 0. Coefficients of p by rising power:
# Chebyshev interpolation of R(x)/t at 60 points in 40 digits, cut where 1e-17 is reached, written in powers.
# tests/test_lowering_special.py makes them again.
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
WEIDEMAN_ORDER = 40
FAR = 39.0  # phi(39) is smaller than any number
FRACTION_FROM = 3.0  # beyond, the recurrence upwards loses digits and the continued fraction converges
FRACTION_FROM_IMAGINARY = 8.0
FRACTION_TERMS = 40


def density(u: ca.SX) -> ca.SX:
    """Standard normal density phi(u)."""
    return ca.exp(-u * u / 2) * (1 / math.sqrt(2 * math.pi))


def hermite(u: ca.SX, order: int) -> ca.SX:
    """He_n(u), the polynomials of the normal density."""
    before, value = ca.SX(0), ca.SX(1)
    for n in range(order):
        before, value = value, u * value - n * before
    return value


def density_sum(weights: ca.SX | ca.DM, x: ca.SX | ca.DM, mean: ca.SX, s: ca.SX, order: int) -> ca.SX:
    """d^order/dm^order of sum_i weights_i phi((x_i - m)/s)/s: an integral over a stretch by the nodes of a rule."""
    u = clipped((x - mean) / s)
    return ca.dot(weights, hermite(u, order) * density(u)) / s ** (order + 1)


def clipped(u: ca.SX) -> ca.SX:
    """The argument of a density, kept where the density is not zero."""
    return ca.if_else(u > FAR, FAR, ca.if_else(u < -FAR, -FAR, u))


def magnitude(x: ca.SX) -> ca.SX:
    """|x| with the slope of the right-hand side at zero, where `fabs` has none."""
    return ca.if_else(x >= 0, x, -x)


def positive_part(x: ca.SX) -> ca.SX:
    """max(x, 0) with slope one at zero, where `fmax` has a half."""
    return ca.if_else(x >= 0, x, 0)


def mills_ratio(x: ca.SX) -> ca.SX:
    """(1 - Phi(x))/phi(x) for x >= 0, to 4e-16 relative; of every entry of a column."""
    return _mills_function()(x.T).T if x.numel() > 1 else _mills_function()(x)


@cache
def _mills_function() -> ca.Function:
    """Made once: a call is put in line at a fraction of the cost of building the polynomial anew."""
    x = ca.SX.sym("x")
    t = MILLS_SCALE / (MILLS_SCALE + x)
    return ca.Function("mills", [x], [t * _polynomial(MILLS, 2 * t - 1)])


def _polynomial(coefficients: Sequence[float], y: ca.SX) -> ca.SX:
    """Horner's rule in y^4 for every fourth power: four chains that a processor computes side by side."""
    square = y * y
    fourth = square * square
    chains = []
    for start in range(4):
        own = coefficients[start::4]
        total = ca.SX(own[-1])
        for coefficient in reversed(own[:-1]):
            total = total * fourth + coefficient
        chains.append(total)
    return (chains[0] + y * chains[1]) + square * (chains[2] + y * chains[3])


def complex_mills_ratio(x: Complex) -> Complex:
    """int_0^inf exp(-x t - t^2/2) dt for Re x >= 0, to 2e-14.

    J. A. C. Weideman, "Computation of the complex error function", SIAM J. Numer. Anal. 31 (1994), 1497.
    """
    real, imaginary = _complex_mills_function()(x.real, ca.SX(0) if x.imaginary is None else x.imaginary)
    return Complex(real, imaginary)


@cache
def _complex_mills_function() -> ca.Function:
    parts = ca.SX.sym("x"), ca.SX.sym("y")
    scale, coefficients = _weideman()
    q = Complex(*parts) * (1 / math.sqrt(2))
    t = (Complex(ca.SX(scale)) + q).inverse()
    Z = (Complex(ca.SX(scale)) - q) * t
    total = Complex(ca.SX(coefficients[-1]))
    for coefficient in reversed(coefficients[:-1]):
        total = total * Z + Complex(ca.SX(coefficient))
    value = (total * t * t * 2.0 + t * (1 / math.sqrt(math.pi))) * math.sqrt(math.pi / 2)
    imaginary = ca.SX(0) if value.imaginary is None else value.imaginary
    return ca.Function("complex_mills", list(parts), [value.real, imaginary])


@cache
def _weideman() -> tuple[float, list[float]]:
    """Length and coefficients of the rational series of the complex error function."""
    size = 4 * WEIDEMAN_ORDER
    scale = math.sqrt(WEIDEMAN_ORDER / math.sqrt(2))
    t = scale * np.tan(np.arange(1 - size // 2, size // 2) * np.pi / size)
    values = np.concatenate([[0.0], np.exp(-(t**2)) * (scale**2 + t**2)])
    series = np.real(np.fft.fft(np.fft.fftshift(values))) / size
    return scale, [float(c) for c in series[1 : WEIDEMAN_ORDER + 1]]


def mills_moments(x: Complex, count: int, *, far: bool = False) -> list[Complex]:
    """r_n(x) = int_0^inf t^n exp(-x t - t^2/2) dt for n < count, Re x >= 0: E[(e - x)_+^n] = phi(x) r_n(x).

    With `far`, full relative accuracy however large x is; without, absolute accuracy of phi(x) r_n(x).
    """
    ratio = Complex(mills_ratio(x.real)) if x.imaginary is None else complex_mills_ratio(x)
    moments = [ratio, Complex(ca.SX(1)) - x * ratio][:count]
    for n in range(2, count):
        moments.append(moments[n - 2] * (n - 1) - x * moments[n - 1])
    if not far or count == 1:
        return moments
    is_far = x.real > FRACTION_FROM
    if x.imaginary is not None:  # near the imaginary axis the fraction converges farther out only
        is_far = ca.logic_or(is_far, x.size_squared() > FRACTION_FROM_IMAGINARY**2)
    quotients = _fractions(x, count)
    product = ratio
    for n in range(1, count):
        product = product * quotients[n - 1]
        moments[n] = select(is_far, product, moments[n])
    return moments


def _fractions(x: Complex, count: int) -> list[Complex]:
    """r_n/r_(n-1), n = 1 .. count - 1, by the continued fraction r_n/r_(n-1) = n/(x + r_(n+1)/r_n)."""
    if x.imaginary is None:
        return [Complex(q) for q in ca.vertsplit(_fraction_function(count, False)(x.real))]
    values = ca.vertsplit(_fraction_function(count, True)(x.real, x.imaginary))
    return [Complex(a, b) for a, b in zip(values[: count - 1], values[count - 1 :], strict=True)]


@cache
def _fraction_function(count: int, is_complex: bool) -> ca.Function:
    parts = [ca.SX.sym("x"), ca.SX.sym("y")][: 1 + is_complex]
    x = Complex(*parts)
    last = count + FRACTION_TERMS
    tail = x.inverse() * float(last)
    quotients: list[Complex] = []
    for n in reversed(range(1, last)):
        tail = (x + tail).inverse() * float(n)
        quotients.append(tail)
    kept = quotients[::-1][: count - 1]
    rows = [q.real for q in kept] + [q.imaginary for q in kept if q.imaginary is not None]
    return ca.Function("fractions", parts, [ca.vertcat(*rows)])
