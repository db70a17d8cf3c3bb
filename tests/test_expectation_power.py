"""Roots and other powers of a distance: E|z - k|^q and its derivatives, at any ratio of mean to deviation."""

from __future__ import annotations

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy as sp
from conftest import half

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.univariate import Univariate
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.check import check
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.gaussian import Gaussian

Z = symbol("z")
EXPONENTS = ("0.05", "0.5", "1.5", "2.9", "3.1", "9.9")
DISTANCES = (0.0, 1e-6, 0.1, -0.8, 1.7, -3.0, 4.5, -7.0, 11.0, -60.0, 3e4)  # of the mean from the zero, in deviations


def exact(q: mpmath.mpf, u: float, *, odd: bool) -> mpmath.mpf:
    """E|z|^q or E[sign(z) |z|^q] for z ~ N(u, 1)."""
    if odd:
        factor, half = u * 2 ** ((q + 1) / 2) * mpmath.gamma(1 + q / 2), (1 - q) / 2
    else:
        factor, half = 2 ** (q / 2) * mpmath.gamma((1 + q) / 2), -q / 2
    kummer = mpmath.hyp1f1(half, mpmath.mpf(3 if odd else 1) / 2, -mpmath.mpf(u) ** 2 / 2)
    return factor * kummer / mpmath.sqrt(mpmath.pi)


def made(text: str) -> Univariate:
    (product,) = describing_function((Z,), parse(text)).products
    ((_, function),) = product.functions
    return function


@pytest.mark.parametrize("q", half(EXPONENTS))
@pytest.mark.parametrize("odd", [False, True])
def test_a_power_and_its_derivatives_are_exact_at_any_mean(q, odd):
    """Relative to E|f|, each derivative in deviations; those in the variance follow by half the second one in the mean."""
    function = made(f"3*abs(z - 0.2)**{q}" + ("*sign(z - 0.2)" if odd else ""))
    assert function.powers
    assert not function.integrals
    m, p = ca.SX.sym("m"), ca.SX.sym("p")
    gaussian = Gaussian(m, p, {})
    orders = [gaussian.expectation(function, order) for order in range(4)]
    moments = ca.Function("moments", [m, p], [ca.vertcat(*orders, ca.jacobian(orders[0], p), ca.jacobian(orders[1], p))])
    for u in DISTANCES:
        for s in (1e-3, 40.0):
            found = np.array(moments(0.2 + s * u, s * s)).ravel() * s ** np.array([0, 1, 2, 3, 2, 3])
            with mpmath.workdps(40):
                e, at = mpmath.mpf(q), (mpmath.mpf(0.2 + s * u) - mpmath.mpf("0.2")) / s
                size, wanted = 3 * exact(e, at, odd=False), []
                for order in range(4):
                    wanted.append(3 * mpmath.rf(e - order + 1, order) * exact(e - order, at, odd=odd ^ bool(order % 2)))
                wanted = [float(x / size) for x in (*wanted, wanted[2] / 2, wanted[3] / 2)]
            bound = 1e-12 + 1e-15 * abs(u)  # the second is the rounding of the mean less the place of the zero
            assert found / (float(size) * s ** float(q)) == pytest.approx(wanted, rel=0, abs=bound), (u, s)


@pytest.mark.parametrize("text", ["abs(z - 0.2)**0.4*sign(z - 0.2)", "abs(z - 0.2)**1.5"])
def test_a_power_at_rest_is_the_function_and_has_finite_slopes(text):
    body = parse(text)
    function = element_function(describing_function((Z,), body), ())
    v = ca.SX.sym("v", 2)
    both = ca.vertcat(*function(v[0], v[1], []))
    slopes = ca.Function("slopes", [v], [both, ca.jacobian(both, v)])
    for m in (-3.0, 0.2, 0.7):
        values, derivatives = (np.array(each) for each in slopes([m, 0.0]))
        assert np.all(np.isfinite(derivatives))
        assert values[0, 0] == pytest.approx(float(body.subs(Z, m)), rel=1e-14, abs=1e-15)
        if m != 0.2:
            wanted = [float(sp.diff(body, Z, n).subs({Z: m}).doit()) for n in (1, 2)]
            assert [values[1, 0], 2 * derivatives[0, 1]] == pytest.approx(wanted, rel=1e-10)


def test_a_power_is_found_in_sums_and_what_is_none_stays_a_quadrature():
    found = made("a*abs(2*z - 1)**1.5 + z**2*sign(z) - sqrt(abs(z))")
    assert {(p.position, p.exponent) for p in found.powers} == {(sp.S.Half, sp.Rational(3, 2)), (0, sp.S.Half)}
    assert not found.integrals
    others = ("max(z, 0)**0.5", "sqrt(abs(z)) + sqrt(max(z, 0))", "abs(z)**a", "abs(z)**10.5", "sqrt(abs(z)) if a > z else 0")
    for text in others:
        left = made(text)
        assert left.integrals, text
        assert not left.powers, text


@pytest.mark.parametrize(
    "text",
    half([
        "max(k*max(z - c, 0)**1.5*(1 + c*v), 0)",  # the contact of Hunt and Crossley, which does not stick
        "max(k*max(c - z, 0)**k*(1 + c*v), 0)",
        "max(abs(v)**0.5 - k, 0)",
        "v*max(k - abs(v)**-0.5, 0)",
        "max(k*sqrt(1 + v**2) - 3, 0)",
    ]),
)
def test_where_a_power_changes_sign_is_found(text):
    body, numbers = parse(text), {"c": 0.3, "k": 1.5}
    arguments = tuple(each for each in (Z, symbol("v")) if body.has(each))
    df = describing_function(arguments, body, values={name: value for name, value in numbers.items() if body.has(symbol(name))})
    found = check(df, numbers)
    assert found.sure < 1e-8
    assert max(found.error, found.gain_error) < 1e-9


def test_a_power_of_which_no_sign_is_known_is_refused():
    with pytest.raises(LinearisationError, match="a sign only where `z - 1` is not negative"):
        describing_function((Z,), parse("max((z - 1)**n, 0)"), values={"n": 1.5})
