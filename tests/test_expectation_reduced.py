"""Exponentials, polynomials in further arguments, and functions of linear forms: no more is integrated than has to be."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from conftest import half
from nested_integrals import function_of, truth

from cadet_sym.expectation import describing_function
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.check import check
from cadet_sym.lowering.elements import element_function

X, Y, W, U = (symbol(name) for name in "xywu")
A, C = symbol("a"), symbol("c")
NUMBERS = {A: 1.3, C: 0.7}
CLOSED = [
    "exp(x + y)", "exp(0.3*x - y)*x", "exp(0.2*x)*abs(y)", "sin(x + y)*y", "cos(x - a*y)*x*y", "erf(y - a*x)*x**2",
    "(x if x - y > c else 2*y)", "max(x - c, 0)*exp(-y/2)*y", "exp(-a*x)*(clip(y, -c, c) + x)", "abs(x - 2*y + c)*y**2",
    "sign(x)*(c + exp(-(x/a)**2)/2)*max(y, 0)", "exp(-(x - 0.5)**2 - 2*y**2)*abs(y)*x",
    "exp(-a*x**2)*max(y, 0)",
]  # fmt: skip
INTEGRATED = [
    "exp(-(x - 0.5)**2 - y)*abs(y)*tanh(x)", "max(x - 2*y, 0)**1.5*y", "tanh(x + a*y)*exp(y/2)",
    "sign(x - a*y)*asin(clip(0.7 - x, -1, 1))",
]  # fmt: skip
COVARIANCES = [((0.7, 1.5), 0.5), ((1.0, 0.3), -0.95), ((0.9, 0.8), 0.999999), ((0.5, 1.0), 1.0), ((0.6, 0.0), 0.0)]


def describe(text: str, arguments=(X, Y)):
    return describing_function(arguments, parse(text), name="f", values=NUMBERS)


def jacobian(df, count: int) -> ca.Function:
    """(m, S) -> E[f] and gains, and their derivatives."""
    v = ca.SX.sym("v", count * (count + 3) // 2)
    moments = ca.vertcat(*element_function(df, (A, C))(v[:count], v[count:], [*NUMBERS.values()]))
    return ca.Function("J", [v], [moments, ca.jacobian(moments, v)])


@pytest.mark.parametrize("text", CLOSED)
def test_there_is_a_closed_form(text):
    df = describe(text)
    assert df.method == "closed form"
    assert any(isinstance(product, Reduced) for product in df.products)


@pytest.mark.parametrize("text", half([*CLOSED, *INTEGRATED]))
def test_it_is_the_integral_at_any_correlation(text):
    function = jacobian(describe(text), 2)
    for (stds, rho), mean in zip(COVARIANCES, ((0.4, -0.3), (-1.2, 0.7), (0.2, 0.9), (0.1, -0.4), (0.9, 1.1)), strict=True):
        L = np.array([[stds[0], 0], [rho * stds[1], stds[1] * np.sqrt(1 - rho**2)]])
        S = L @ L.T
        wanted = truth(*function_of(text, ("x", "y"), {"a": 1.3, "c": 0.7}), mean, L, 1e-10)
        moments, slopes = (np.array(x) for x in function([*mean, *S[np.tril_indices(2)]]))
        H, size = slopes[1:, :2], wanted.size
        assert moments[0, 0] == pytest.approx(wanted.value, abs=1e-8 * size)
        assert L.T @ moments[1:, 0] == pytest.approx(wanted.gains, abs=1e-7 * size)
        assert np.all(np.isfinite(slopes))
        if abs(rho) < 1 and min(stds) > 0:
            assert pytest.approx(wanted.bends, abs=1e-6 * size) == L.T @ H @ L
            heat = np.array([H[0, 0] / 2, H[1, 0], H[1, 1] / 2])
            assert slopes[0, 2:] == pytest.approx(heat, abs=1e-7 * np.abs(heat).max())


def test_a_bell_that_a_parameter_turns_over_has_an_expectation_under_small_variances_only():
    """E exp(-a x^2) = (1 + 2 a S)^(-1/2) as long as that is a number; it factors out of what is independent."""
    function = element_function(describe("exp(-a*x**2)*max(y, 0)"), (A, C))
    for a, s, exists in ((1.3, 4.0, True), (-0.1, 4.0, True), (-0.1, 5.5, False)):
        F, gain = (np.array(x).ravel() for x in function([0, 0], [s, 0, 1], [a, 0.7]))
        assert np.isfinite([*F, *gain]).all() == exists
        assert not exists or F[0] == pytest.approx(1 / np.sqrt((1 + 2 * a * s) * 2 * np.pi), rel=1e-12)


WEIGHTED = ["clip(x*y, -1, 1)*w", "max(x**2 - y, 0)*w**2", "sign(x**2 - y)*x*(w - u)", "tanh(x*y)*w", "max(x, y, 1)*w"]


@pytest.mark.parametrize("text", half(WEIGHTED))
def test_further_arguments_enter_by_their_regression_on_the_others(text):
    """w = b.(x, y) + rest: E[w f] is the sum of E of b_x x f, of b_y y f and of what is independent times f."""
    df = describe(text, (X, Y, W, U))
    assert df.error <= 1e-8
    rng = np.random.default_rng(4)
    L = np.eye(4) + 0.4 * np.tril(rng.normal(size=(4, 4)))
    S, mean = L @ L.T, rng.normal(size=4)
    b = S[2:, :2] @ np.linalg.inv(S[:2, :2])
    left = S[2:, 2:] - b @ S[:2, 2:]
    start = mean[2:] - b @ mean[:2]
    w, u = (f"({start[k]:.17g} + {b[k, 0]:.17g}*x + {b[k, 1]:.17g}*y)" for k in range(2))
    polynomials = {  # E over what is left of w and u
        WEIGHTED[0]: w, WEIGHTED[1]: f"({w}**2 + {left[0, 0]:.17g})", WEIGHTED[2]: f"({w} - {u})",
        WEIGHTED[3]: w, WEIGHTED[4]: w,
    }  # fmt: skip
    core = text.partition("*w")[0].partition("*(w")[0]
    wanted = truth(*function_of(f"{core}*{polynomials[text]}", ("x", "y"), {}), mean[:2], L[:2, :2], 1e-10)
    moments, slopes = (np.array(x) for x in jacobian(df, 4)([*mean, *S[np.tril_indices(4)]]))
    assert moments[0, 0] == pytest.approx(wanted.value, abs=1e-8 * wanted.size)
    here, step = np.array([*mean, *S[np.tril_indices(4)]]), 1e-3
    v = ca.SX.sym("v", 14)
    function = ca.Function("f", [v], [ca.vertcat(*element_function(df, (A, C))(v[:4], v[4:], [*NUMBERS.values()]))])
    for k, e in enumerate(step * np.eye(14)):
        one, two = (np.array(function(here + n * e)) - np.array(function(here - n * e)) for n in (1, 2))
        differences = ((8 * one - two) / (12 * step)).ravel()
        assert slopes[:, k] == pytest.approx(differences, rel=1e-6, abs=1e-6 * np.abs(slopes).max())
        if k < 4:
            assert moments[1 + k, 0] == pytest.approx(differences[0], rel=1e-6, abs=1e-6 * wanted.size)


@pytest.mark.parametrize("text", [*CLOSED, *INTEGRATED])
def test_without_variance_it_is_the_function_itself(text):
    function, _ = function_of(text, ("x", "y"), {"a": 1.3, "c": 0.7})
    for S in ([0.0, 0.0, 0.0], [1e-300, 0.0, 1e-300]):
        moments, slopes = (np.array(x) for x in jacobian(describe(text), 2)([0.45, -0.3, *S]))
        assert moments[0, 0] == pytest.approx(float(function(np.array(0.45), np.array(-0.3))), rel=1e-12)
        assert np.all(np.isfinite(slopes))


@pytest.mark.filterwarnings("ignore:overflow")  # in places far out that have no weight
def test_an_exponential_of_two_arguments_is_exact_at_ten_times_its_scale():
    found = check(describe("exp(x + y)"))
    assert max(found.error, found.gain_error) < 1e-9
