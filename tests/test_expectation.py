"""Describing functions against the references, through the compiled CasADi function, and against their own laws."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_models import value

import cadet_sym as cs
from cadet_sym.expectation import describing_function
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.elements import element_function

X, Y = symbol("x"), symbol("y")

STOP = "(1 + x)**(-1.4) if x > -0.9 else 0.1**(-1.4) - 1.4*0.1**(-2.4)*(x + 0.9)"
ONE = {
    "cube": "x**3",
    "quint": "x**5",
    "abs": "abs(x)",
    "zabsz": "abs(x)*x",
    "abs15": "abs(x)**1.5*sign(x)",
    "sign": "sign(x)",
    "relay_dz": "1 if x > 0.5 else -1 if x < -0.5 else 0",
    "sat": "clip(x, -1, 1)",
    "deadzone": "max(x - 0.5, 0) + min(x + 0.5, 0)",
    "gapcubic": "x + 5*(abs(x) - 0.5)**3*sign(x) if abs(x) > 0.5 else x",
    # slope 2 below zero and 5 above, and the change of slope beyond each break
    "pwl5": "2*min(x, 0) + 5*max(x, 0) - 2*max(x - 0.3, 0) - 1.8*max(x - 1, 0) - 1.2*min(x + 0.3, 0) - 0.3*min(x + 1, 0)",
    "asymquad": "x**2 if x > 0 else -0.1*x**2",
    "gas_clip": "(1 + max(x, -0.9))**(-1.4)",
    "gas_lin": STOP,
    "gas_bump": f"({STOP}) + 5000*min(x + 0.9, 0)**2",
}
TWO = {"xy": "x*y", "absx_y": "abs(x)*y", "x2y": "x**2*y"}
TWO |= {"bw_a1": "abs(y)*x", "bw_b1": "y*abs(x)"}


def compiled(text: str, arguments: tuple[sp.Symbol, ...] = (X,)):
    return element_function(describing_function(arguments, parse(text), name="f"), ())


def rows(case: str, table: dict[str, str]) -> list:
    return [pytest.param(row, id=f"{case}-{row['fn']}-{i}") for i, row in enumerate(value(case)) if row["fn"] in table]


@pytest.mark.parametrize("row", [r for case in ("R01", "R02", "R03", "R04", "R06") for r in rows(case, ONE)])
def test_one_argument_gives_the_reference(row):
    m, s = float(row["m"]), float(row["s"])
    F, gain = compiled(ONE[row["fn"]])(m, s * s, [])
    np.testing.assert_allclose([float(F), float(gain)], [float(row["Ef"]), float(row["Edf"])], rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("row", [r for case in ("R07", "R09") for r in rows(case, TWO)])
def test_two_correlated_arguments_give_the_reference(row):
    mx, my, sx, sy, rho = (float(row[key]) for key in ("mx", "my", "sx", "sy", "rho"))
    F, gain = compiled(TWO[row["fn"]], (X, Y))([mx, my], [sx * sx, rho * sx * sy, sy * sy], [])
    got = [float(F), *np.asarray(gain).ravel()]
    np.testing.assert_allclose(got, [float(row[k]) for k in ("Ef", "Efx", "Efy")], rtol=1e-10, atol=1e-12)


def test_every_function_of_the_references_is_tested():
    for cases, table in ((("R01", "R02", "R03", "R04", "R06"), ONE), (("R07", "R09"), TWO)):
        assert {row["fn"] for case in cases for row in value(case)} == set(table)


AS_PYTHON = {  # with numbers and symbols as they come in Python
    "abs(x)**1.5*sign(x)": lambda x, y: sp.Abs(x) ** 1.5 * sp.sign(x),
    "(1 + max(x, -0.9))**(-1.4)": lambda x, y: (1 + sp.Max(x, -0.9)) ** -1.4,
    "x**2 if x > 0.1 else -0.1*x**2": lambda x, y: sp.Piecewise((x**2, x > 0.1), (-0.1 * x**2, True)),
    "tanh(2.5*x)": lambda x, y: sp.tanh(2.5 * x),
    "abs(x)": lambda x, y: sp.sqrt(x**2),
    "abs(y)*abs(x)**0.5*x": lambda x, y: sp.Abs(y) * sp.Abs(x) ** 0.5 * x,
    "0.3*sign(x)*max(y - 0.1, 0)": lambda x, y: 0.3 * sp.sign(x) * sp.Max(y - 0.1, 0),
    "2*max(x - 0.1, 0)": lambda x, y: 2 * cs.Element("ramp", [y], sp.Max(y - 0.1, 0))(x),
}


@pytest.mark.parametrize("real", [True, None])
@pytest.mark.parametrize("text", AS_PYTHON)
def test_an_expression_made_in_python_is_what_its_text_is(text, real):
    x, y = sp.symbols("x y", real=real)
    used, own = ((x, y), (X, Y)) if "y" in text else (x, (X,))
    one, other = cs.describing_function(used, AS_PYTHON[text](x, y)), describing_function(own, parse(text))
    assert (one.body, one.method, one.nodes) == (other.body, other.method, other.nodes)
    moments = ([0.2, -0.1], [0.49, 0.2, 0.8]) if "y" in text else (0.2, 0.49)
    for mine, theirs in zip(cs.element_function(one)(*moments, []), element_function(other, ())(*moments, []), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert cs.check(one).error < 1e-8


PIECES = ["x**3", "abs(x)*x", "max(x - 0.3, 0)", "clip(2*x, -1, 0.5)", "x**2*exp(-x)", "sign(x + 0.2)*x", "heaviside(x)*x**2"]


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(PIECES), st.floats(-3, 3), st.floats(0.05, 3))
def test_closed_forms_equal_adaptive_integration(text, m, s):
    from scipy.integrate import quad

    F, _ = compiled(text)(m, s * s, [])
    f = sp.lambdify(X, parse(text), "numpy")
    kinks = sorted(k for k in (-0.5, -0.2, 0.0, 0.25, 0.3) if abs(k - m) < 12 * s)

    def density(z):
        return float(f(z)) * np.exp(-(((z - m) / s) ** 2) / 2) / (s * np.sqrt(2 * np.pi))

    edges = [m - 12 * s, *kinks, m + 12 * s]
    total = sum(quad(density, a, b, epsabs=1e-13, epsrel=1e-12, limit=200)[0] for a, b in itertools.pairwise(edges))
    assert float(F) == pytest.approx(total, rel=1e-8, abs=1e-9)


@settings(deadline=None)  # the first case of each compiles
@given(st.sampled_from([*PIECES, "tanh(x)", "sqrt(1 + x**2)"]), st.floats(-3, 3))
def test_without_variance_the_expectation_is_the_value(text, m):
    if min(abs(m - k) for k in (-0.5, -0.2, 0.0, 0.25, 0.3)) < 1e-6:
        return
    F, gain = compiled(text)(m, 0.0, [])
    expression = parse(text)
    assert float(F) == pytest.approx(float(expression.subs(X, m)), rel=1e-9, abs=1e-12)
    h = 1e-6
    slope = (float(expression.subs(X, m + h)) - float(expression.subs(X, m - h))) / (2 * h)
    assert float(gain) == pytest.approx(slope, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("text", ["abs(x)*x", "tanh(3*x)", "clip(x, -1, 1)", "abs(x)**1.5"])
def test_the_gain_is_the_slope_in_the_mean_and_the_heat_equation_holds(text):
    function, h = compiled(text), 1e-4
    for m, p in ((0.2, 0.5), (-1.0, 0.1), (0.0, 2.0)):
        F, gain = (float(v) for v in function(m, p, []))
        up, down = (float(function(m + d, p, [])[0]) for d in (h, -h))
        assert gain == pytest.approx((up - down) / (2 * h), rel=1e-6, abs=1e-8)
        wider, narrower = (float(function(m, p + d, [])[0]) for d in (h, -h))
        curvature = (up - 2 * F + down) / h**2
        assert (wider - narrower) / (2 * h) == pytest.approx(curvature / 2, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("text", ["1/x", "log(x)", "(1 + x)**(-1.4)", "exp(x**2)"])
def test_what_has_no_expectation_is_refused(text):
    with pytest.raises(cs.LinearisationError):
        compiled(text)
