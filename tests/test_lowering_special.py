"""The normal distribution in CasADi against many digits, and the table that it is computed from made again."""

from __future__ import annotations

import casadi as ca
import mpmath as mp
import numpy as np
import pytest

from cadet_sym.lowering.bivariate import orthant
from cadet_sym.lowering.complex import Complex
from cadet_sym.lowering.special import (
    MILLS,
    MILLS_SCALE,
    complex_mills_ratio,
    hermite,
    mills_moments,
    mills_ratio,
)


def exact_ratio(x):
    return mp.sqrt(mp.pi / 2) * mp.exp(x * x / 2) * mp.erfc(x / mp.sqrt(2))


def test_the_coefficients_of_mills_ratio_are_the_interpolation_they_are_said_to_be():
    with mp.workdps(40):

        def g(y):
            t = (y + 1) / 2
            return exact_ratio(MILLS_SCALE * (1 - t) / t) / t

        angles = [mp.pi * (2 * k + 1) / 120 for k in range(60)]
        samples = [g(mp.cos(angle)) for angle in angles]
        chebyshev = [
            (1 if n == 0 else 2) * mp.fsum(s * mp.cos(n * a) for s, a in zip(samples, angles, strict=True)) / 60
            for n in range(len(MILLS))
        ]
        # T_n in powers, by its recurrence
        powers = [[mp.mpf(1)], [mp.mpf(0), mp.mpf(1)]]
        for n in range(2, len(MILLS)):
            shifted = [mp.mpf(0), *(2 * c for c in powers[n - 1])]
            for k, c in enumerate(powers[n - 2]):
                shifted[k] -= c
            powers.append(shifted)
        made = [mp.fsum(c * p[k] for c, p in zip(chebyshev, powers, strict=True) if k < len(p)) for k in range(len(MILLS))]
        assert all(abs(a - b) <= 1e-16 for a, b in zip(made, MILLS, strict=True))


def compiled(build):
    x = ca.SX.sym("x")
    return ca.Function("f", [x], [build(x), ca.jacobian(build(x), x)])


def test_mills_ratio_and_its_slope_to_full_accuracy():
    f = compiled(mills_ratio)
    for x in [0.0, 1e-9, *np.linspace(0.01, 12, 60), 38.0, 1e3, 1e8]:
        value, slope = (float(v) for v in f(x))
        with mp.workdps(60):
            wanted = exact_ratio(mp.mpf(x)) if x < 100 else 1 / mp.mpf(x) - mp.mpf(x) ** -3
            assert value == pytest.approx(float(wanted), rel=1e-15)
            if x < 100:
                assert slope == pytest.approx(float(x * wanted - 1), rel=1e-10, abs=1e-14)  # R' = x R - 1


@pytest.mark.parametrize("count", [3, 6])
def test_moments_of_the_tail_keep_their_digits_far_out(count):
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.vertcat(*(r.real for r in mills_moments(Complex(x), count, far=True)))])
    for at in (0.0, 0.5, 2.0, 3.1, 8.0, 50.0, 1e4):
        wanted = [
            mp.quad(lambda t, k=n, x=at: t**k * mp.exp(-t * t / 2 - x * t), [0, 1 / (1 + at), 10 / (1 + at), 12])
            for n in range(count)
        ]
        assert np.allclose(f(at).full().ravel(), [float(w) for w in wanted], rtol=1e-9)


def test_mills_ratio_of_complex_argument():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    value = complex_mills_ratio(Complex(x, y))
    assert value.imaginary is not None
    f = ca.Function("f", [x, y], [value.real, value.imaginary])
    for a in (0.0, 0.3, 2.0, 9.0):
        for b in (-7.0, -0.5, 0.0, 1.0, 12.0):
            re, im = (float(v) for v in f(a, b))
            assert complex(re, im) == pytest.approx(complex(exact_ratio(mp.mpc(a, b))), rel=1e-12)


def test_hermite_polynomials_differentiate_the_density():
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.vertcat(*(hermite(x, n) for n in range(5)))])
    assert f(2.0).full().ravel().tolist() == [1, 2, 3, 2, -5]


def exact_orthant(h, k, rho):
    if abs(rho) == 1:
        return float(mp.ncdf(-max(h, k))) if rho > 0 else 0.0
    r = mp.sqrt(1 - mp.mpf(rho) ** 2)

    def inner(x):
        return mp.npdf(x) * mp.ncdf((rho * x - k) / r)

    turn = k / rho if rho else h
    breaks = sorted({h, h + 1, h + 3, h + 9} | {t for t in (turn, turn - r, turn + r, turn + 6 * r) if h < t < h + 9})
    return float(mp.quad(inner, breaks))


@pytest.mark.parametrize("rho", [-1.0, -0.999999, -0.95, 0.0, 0.5, 0.999, 0.99999999, 1.0])
def test_orthant_probabilities_up_to_correlation_one(rho):
    h, k, r = ca.SX.sym("h"), ca.SX.sym("k"), ca.SX.sym("r")
    value = orthant(h, k, r)
    f = ca.Function("f", [h, k, r], [value, ca.gradient(value, h)])
    for a, b in ((0.0, 0.0), (0.0, 1.0), (0.7, 0.7), (1.0, 0.2), (3.0, 0.01), (5.0, 6.0), (39.0, 0.0), (1e-9, 1e-9)):
        found, slope = (float(v) for v in f(a, b, rho))
        assert found == pytest.approx(exact_orthant(a, b, rho), abs=1e-12)
        if abs(rho) < 1:  # dP/dh = -phi(h) Phi((rho h - k)/sqrt(1 - rho^2))
            wanted = -float(mp.npdf(a) * mp.ncdf((rho * a - b) / mp.sqrt(1 - mp.mpf(rho) ** 2)))
            assert slope == pytest.approx(wanted, abs=1e-7)
