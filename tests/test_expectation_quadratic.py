"""Polynomials times powers of quadratic polynomials: by integrals, by the laws they obey, at any scale, and in models."""

from __future__ import annotations

import dataclasses
import warnings
from functools import cache

import casadi as ca
import mpmath
import numpy as np
import pytest
from conftest import half
from exported import Exported
from hypothesis import given, settings
from hypothesis import strategies as st

import cadet_sym as cs
from cadet_sym.errors import LinearisationError
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.adaptive import integrate
from cadet_sym.expectation.homogeneous import homogeneous
from cadet_sym.expectation.nested import nested
from cadet_sym.expectation.quadratic import QuadraticPower
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.expectation.smooth import planar
from cadet_sym.expectation.squares import error_of, quadratic_powers, with_count
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.lowering.elements import element_function

NAMES = [symbol(name) for name in ("x", "y", "w", "q", "r", "s")]
TWO = [
    "sqrt(x**2 + y**2)", "x/sqrt(x**2 + y**2)", "y*sqrt(x**2 + y**2 + 0.01)", "y**3/(x**2 + x*y + 2*y**2)",
    "x/(1 + x**2 + y**2)", "(1 - 1/sqrt(1 + x**2 + y**2))*y", "((x - 1)**2 + (y + 2)**2 + 0.1)**1.5",
    "x*y*(x**2 + 3*y**2)**(-0.7)", "y*abs(x)*sqrt(x**2 + y**2 + 1)",
    "tanh(3*y)*x/sqrt(x**2 + y**2 + 0.1)",
    "y*log(0.3 + x**2 + y**2)", "x*log(sqrt(x**2 + 2*y**2))", "x*log(1 + x**2 + y**2)/(1 + x**2 + y**2)",
]  # fmt: skip
THREE = [
    "sqrt(x**2 + y**2 + w**2)", "x*sqrt(x**2 + y**2 + w**2)", "w*x/sqrt(x**2 + y**2 + 0.04)",
    "(x - w)/sqrt((x - w)**2 + 2*y**2)",
    "x/(x**2 + y**2 + w**2)**1.5", "w/(x**2 + x*y + y**2 + y*w + w**2 + 1)", "x*y*w*sqrt(1 + (x + y)**2)",
    "max(w, 0)*x/sqrt(x**2 + y**2 + 0.04)", "clip(w, -1, 0.9)*x*sqrt(x**2 + y**2)",
    "exp(-abs(w))*sin(w)*x*sqrt(x**2 + y**2 + 1)", "max(w, 0)*log(0.2 + x**2 + y**2 + x*y)",
    "tanh(w)*x/sqrt(x**2 + y**2 + 0.04)",
]  # fmt: skip
CORRELATIONS = [-0.999999, -0.95, 0.0, 0.5, 1.0]


def arguments_of(text: str):
    return tuple(z for z in NAMES if parse(text).has(z))


@cache
def describe(text: str):
    return describing_function(arguments_of(text), parse(text), name="f")


@cache
def function_of(text: str) -> ca.Function:
    df = describe(text)
    assert any(isinstance(product, QuadraticPower) for product in df.products)
    assert df.error <= 1e-10
    return element_function(df, ())


@cache
def with_jacobian(text: str) -> ca.Function:
    function, n = function_of(text), len(arguments_of(text))
    v = ca.SX.sym("v", n + n * (n + 1) // 2)
    out = ca.vertcat(*function(v[:n], v[n:], []))
    return ca.Function("both", [v], [out, ca.jacobian(out, v)])


def lower(S) -> np.ndarray:
    S = np.asarray(S, float)
    return S[np.tril_indices(len(S))]


def found(function: ca.Function, mean, S) -> np.ndarray:
    return np.concatenate([np.array(r).ravel() for r in function(mean, lower(S), [])])


def moments(n: int, rho: float, stds=(0.9, 1.4, 0.6)) -> tuple[np.ndarray, np.ndarray]:
    stds = np.array(stds[:n])
    return np.array([0.3, -0.5, 0.8])[:n], np.outer(stds, stds) * rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))


def factor(S: np.ndarray) -> np.ndarray:
    """Lower triangular, zeros on the diagonal allowed."""
    L = np.zeros_like(S)
    for k in range(len(S)):
        left = S[k:, k] - L[k:, :k] @ L[k, :k]
        if left[0] > 1e-13 * S[k, k]:
            L[k:, k] = left / np.sqrt(left[0])
    return L


@pytest.mark.parametrize("rho", CORRELATIONS)
@pytest.mark.parametrize("text", half(TWO))
def test_two_arguments_are_the_integral(text, rho):
    mean, S = moments(2, rho)
    truth = integrate(arguments_of(text), parse(text), {}, mean, factor(S), tolerance=1e-11, most=3_000_000)
    values = found(function_of(text), mean, S)
    assert values[0] == pytest.approx(truth.value, abs=1e-9 * truth.size + 3 * truth.error)
    along = factor(S).T @ values[1:]  # E[f e] = L^T E[grad f]
    assert along == pytest.approx(truth.moments, abs=1e-8 * truth.size + 3 * truth.error)


LOADED = "max(w, 0)*x/sqrt(x**2 + y**2 + 1)"


@pytest.mark.parametrize("text", [THREE[0], *(pytest.param(text, marks=pytest.mark.slow) for text in (THREE[1], LOADED))])
def test_three_arguments_are_the_integral(text):
    mean, S = moments(3, -0.6)
    truth = integrate(arguments_of(text), parse(text), {}, mean, factor(S), tolerance=1e-7, most=1_500_000)
    values = found(function_of(text), mean, S)
    assert values[0] == pytest.approx(truth.value, abs=1e-7 * truth.size + 3 * truth.error)
    assert factor(S).T @ values[1:] == pytest.approx(truth.moments, abs=1e-7 * truth.size + 3 * truth.error)


def power_of_a_length(n: int, power: float, m: float, sd: float) -> mpmath.mpf:
    """E|z|^(2 power), z ~ N(m, sd^2 1) of n components: the noncentral chi distribution."""
    with mpmath.workdps(40):
        p, m, sd = mpmath.mpf(power), mpmath.mpf(m), mpmath.mpf(sd)
        shift = -(m**2) / (2 * sd**2)
        return (2 * sd**2) ** p * mpmath.gamma(n / 2 + p) / mpmath.gamma(mpmath.mpf(n) / 2) * mpmath.hyp1f1(-p, n / 2, shift)


@pytest.mark.parametrize("n", half([2, 3, 4, 6]))
@pytest.mark.parametrize("power", ["0.5", "-0.5", "1.5", "0.15", "-0.9"])
def test_a_length_is_that_of_the_noncentral_chi_distribution(n, power):
    function = function_of(f"({' + '.join(f'{z}**2' for z in NAMES[:n])})**({power})")
    direction = np.array([0.6, -0.8, 0, 0, 0, 0])[:n]
    for m, sd in ((0.0, 1.0), (0.3, 1.0), (2.0, 1e-3), (1.0, 1e3), (7.0, 1.0), (1e-30, 1e-30)):
        F, *gain = found(function, m * direction, sd**2 * np.eye(n))
        wanted = power_of_a_length(n, float(power), m, sd)
        assert pytest.approx(float(wanted), rel=1e-11) == F
        if m:
            slope = mpmath.diff(lambda x, sd=sd: power_of_a_length(n, float(power), x, sd), m, h=1e-12 * max(m, sd))
            assert gain == pytest.approx(float(slope) * direction, rel=1e-8, abs=1e-13 * F / sd)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_a_logarithm_is_the_derivative_of_a_power_in_its_exponent(n):
    function = function_of(f"log({' + '.join(f'{z}**2' for z in NAMES[:n])})")
    direction = np.array([0.6, -0.8, 0, 0, 0, 0])[:n]
    for m, sd in ((0.0, 1.0), (0.3, 1.0), (2.0, 1e-3), (1.0, 1e3), (7.0, 1.0)):
        F, *gain = found(function, m * direction, sd**2 * np.eye(n))
        with mpmath.workdps(40):

            def logarithm(x, sd=sd):
                return mpmath.diff(lambda p: power_of_a_length(n, p, x, sd), 0, h=1e-12)

            wanted, slope = logarithm(m), mpmath.diff(logarithm, m, h=1e-10 * max(m, sd))
        assert pytest.approx(float(wanted), rel=1e-11, abs=1e-11) == F
        assert gain == pytest.approx(float(slope) * direction, rel=1e-8, abs=1e-13 / sd)


WITH_EXPONENTS = [
    "x*sqrt(x**2 + y**2)**p", "(x**2 + y**2 + w**2)**p", "max(w, 0)*(1 + x**2 + y**2)**p",
    "x*y*(c + x**2 + y**2)**(p - 1)",
]  # fmt: skip


@pytest.mark.parametrize("text", half(WITH_EXPONENTS))
def test_an_exponent_may_be_a_parameter(text):
    """With any number it is the function with that number, and its derivative is that of differences."""
    p, c, arguments = symbol("p"), symbol("c"), arguments_of(text)
    free = tuple(s for s in (c, p) if parse(text).has(s))
    df = describing_function(arguments, parse(text), values={c: 0.5, p: 0.7})
    assert all(isinstance(product, QuadraticPower) for product in df.products)
    function, q = element_function(df, free), ca.SX.sym("q", len(free))
    mean, S = moments(len(arguments), 0.5)

    def at(number: float) -> np.ndarray:
        return np.concatenate([np.array(r).ravel() for r in function(mean, lower(S), [0.5, number][-len(free) :])])

    for number in (0.7, 0.2, -0.3, 1.0, 1.5):
        exact = describing_function(arguments, parse(text.replace("p", str(number)).replace("c", "0.5")))
        assert at(number) == pytest.approx(found(element_function(exact, ()), mean, S), rel=1e-10, abs=1e-12)
    slopes = ca.Function("slopes", [q], [ca.jacobian(ca.vertcat(*function(mean, lower(S), q)), q[-1])])
    wanted = (8 * (at(0.71) - at(0.69)) - (at(0.72) - at(0.68))) / 0.12
    assert np.array(slopes([0.5, 0.7][-len(free) :])).ravel() == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_an_exponent_with_which_there_is_no_expectation_gives_no_number():
    p, text = symbol("p"), "(x**2 + y**2)**p"
    with pytest.raises(LinearisationError, match="no Gaussian expectation.*add a positive number"):
        describing_function(tuple(NAMES[:2]), parse(text), values={p: -1.0})
    df = describing_function(tuple(NAMES[:2]), parse(text), values={p: -0.3})
    function = element_function(df, (p,))
    values = [float(function([0, 0], [1, 0, 1], [number])[0]) for number in (-0.9, -1.0, -1.3)]
    assert np.isfinite(values).tolist() == [True, False, False]
    errors = [error_of(df.products[0], {p: number}) for number in (-0.3, 0.6, -0.9, -1.0, 3.0)]
    assert max(errors[:2]) < 1e-10
    assert np.isinf(errors[3:]).all()


def test_derivatives_that_hardly_exist_are_those_of_differences():
    """The third derivatives of x|z|^(1/2) fall off slowly under the integral: they were 1e-4 off."""
    both, (mean, S) = with_jacobian("x*(x**2 + y**2)**0.25"), moments(2, 0.5)
    v = np.array([*mean, *lower(S)])
    for k, h in enumerate(1e-5 * np.eye(5)):
        slope = (np.array(both(v + h)[0]) - np.array(both(v - h)[0])).ravel() / 2e-5
        assert np.array(both(v)[1])[:, k] == pytest.approx(slope, rel=1e-8, abs=1e-9)


def test_a_mean_far_away_costs_no_digits():
    function, (m, s) = function_of("x/sqrt(x**2 + y**2 + 0.25)".replace("0.25", "1")), (1e8, 1.0)
    F, along, across = found(function, [m, 0], np.diag([s, 2 * s]))
    assert pytest.approx(1.0, rel=1e-14) == F
    assert along == pytest.approx((1 + 2 * s) / m**3, rel=1e-11)  # E[(1 + y^2) Q^(-3/2)]
    assert across == 0


FORMS = [
    "(x**2 + y**2)**0.3", "(x**2 + y**2 + 1e-6)**(-0.5)", "sqrt(x**2 + y**2 + w**2 + q**2)",
    "((x - 2*y)**2 + (0.3*x + w - 1)**2 + (y + 0.1*w)**2 + 1)**(-1)", "((x + y)**2 + (y - q)**2 + (x + q + 2*w)**2)**1.5",
]  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(text=st.sampled_from(FORMS), scale=st.sampled_from([1e-6, 1.0, 1e3]), seed=st.integers(0, 10**6))
def test_steins_lemma_holds_for_random_moments(text, scale, seed):
    """E[x f] = m E[f] + S E[grad f], each side its own integral."""
    rng, n = np.random.default_rng(seed), len(arguments_of(text))
    L = scale * rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-3, 0, n)
    mean, S = scale * rng.normal(size=n), L @ L.T
    F, *gain = found(function_of(text), mean, S)
    turned = found(function_of(f"x*{text}"), mean, S)[0]
    size = F * np.sqrt(mean[0] ** 2 + S[0, 0])
    assert mean[0] * F + S[0] @ gain == pytest.approx(turned, rel=1e-10, abs=1e-10 * size)


@pytest.mark.parametrize("text", half(TWO + THREE))
def test_the_jacobian_is_that_of_differences(text):
    both, n = with_jacobian(text), len(arguments_of(text))
    mean, S = moments(n, 0.5)
    v = np.array([*mean, *lower(S)])
    F, J = (np.array(r) for r in both(v))
    assert J[0, :n] == pytest.approx(F[1:].ravel(), rel=1e-12, abs=1e-14)

    def at(step: np.ndarray) -> np.ndarray:
        return np.array(both(v + step)[0]).ravel()

    for k, h in enumerate(1e-2 * np.eye(len(v))):
        slope = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / 12e-2
        assert J[:, k] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(J).max())


@pytest.mark.parametrize("text", half(TWO + THREE))
def test_without_variance_it_is_the_function_and_derivatives_are_its_own(text):
    both, arguments = with_jacobian(text), arguments_of(text)
    n, mean, h = len(arguments), np.array([0.7, -0.4, 0.5])[: len(arguments)], 1e-3

    def f(z: np.ndarray) -> float:
        return float(evaluate(parse(text), dict(zip(arguments, z, strict=True))))

    F, J = (np.array(r) for r in both(np.concatenate([mean, np.zeros(n * (n + 1) // 2)])))
    assert F[0] == pytest.approx(f(mean), rel=1e-12)
    gains = [(8 * (f(mean + e) - f(mean - e)) - f(mean + 2 * e) + f(mean - 2 * e)) / (12 * h) for e in h * np.eye(n)]
    assert F[1:].ravel() == pytest.approx(gains, rel=1e-7, abs=1e-8)
    curvature = [(f(mean + e) - 2 * f(mean) + f(mean - e)) / (2 * h * h) for e in h * np.eye(n)]  # half of it: heat equation
    own = [k for k, (i, j) in enumerate((i, j) for i in range(n) for j in range(i + 1)) if i == j]
    assert J[0, n:][own] == pytest.approx(curvature, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("text", half(text for text in TWO + THREE if text != "x/(x**2 + y**2 + w**2)**1.5"))  # see below
def test_whatever_vanishes_all_is_finite(text):
    both, n = with_jacobian(text), len(arguments_of(text))
    for stds in ((0, 0, 0), (1e-150, 0, 0), (1, 0, 0), (0, 1, 1), (1e3, 1e-6, 1), (1, 1, 0)):
        for rho in (0.0, 1.0, -1.0):
            for mean in (np.zeros(n), np.array([0.4, -0.3, 0.2])[:n], np.array([1e8, 0, 0])[:n]):
                v = np.concatenate([mean, lower(moments(n, rho, stds)[1])])
                assert all(np.all(np.isfinite(np.array(r))) for r in both(v)), (stds, rho, mean)


@pytest.mark.parametrize("text", ["x*sqrt(x**2 + y**2 + w**2)", "max(w, 0)*x/sqrt(x**2 + y**2 + 0.04)"])
def test_a_covariance_that_is_not_quite_one_is_taken_as_the_nearest(text):
    rng, mean = np.random.default_rng(4), np.array([0.3, -0.5, 0.8])
    root = np.array([[1.0, 0.0], [2.0, 0.0], [0.5, 1.0]])  # y = 2 x
    wanted = found(function_of(text), mean, root @ root.T)
    for _ in range(20):
        noise = 1e-6 * rng.normal(size=(3, 3))
        assert found(function_of(text), mean, root @ root.T + noise + noise.T) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("text", ["x*sqrt(x**2 + y**2)", "x/sqrt(x**2 + y**2)", "y/sqrt(x**2 + y**2 + 0.01)"])
def test_with_one_variance_left_there_is_one_argument(text):
    function, x = function_of(text), NAMES[0]
    alone = element_function(describing_function((x,), parse(text).subs(NAMES[1], parse("0.3"))), ())
    assert found(function, [0.4, 0.3], np.diag([0.5, 0]))[:2] == pytest.approx(found(alone, [0.4], [[0.5]]), rel=1e-10)
    line = element_function(describing_function((x,), parse(text).subs(NAMES[1], parse("0.4 - 2*x"))), ())
    F, a, b = found(function, [0.3, -0.2], [[0.25, -0.5], [-0.5, 1.0]])
    assert [F, a - 2 * b] == pytest.approx(found(line, [0.3], [[0.25]]), rel=1e-8)


def test_friction_in_the_plane_is_that_along_a_line_when_nothing_moves_across():
    F, gain, across = found(function_of("x/sqrt(x**2 + y**2)"), [0.4, 0], np.diag([1.0, 0]))
    sign = element_function(describing_function((NAMES[0],), parse("sign(x)")), ())
    assert [F, gain] == pytest.approx(found(sign, [0.4], [[1.0]]), rel=1e-8)
    assert across == 0


def test_a_length_does_not_turn_with_the_axes():
    rng = np.random.default_rng(0)
    function, mean, S = function_of("sqrt(x**2 + y**2 + w**2)"), np.array([0.7, -0.4, 0.1]), np.diag([1e-12, 1.0, 1e-4])
    wanted = found(function, mean, S)
    for _ in range(3):
        R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        F, *gain = found(function, R @ mean, R @ S @ R.T)
        assert [F, *(R.T @ gain)] == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("text", ["x*sqrt(x**2 + y**2)", "y**3/(x**2 + x*y + 2*y**2)", "y*sqrt(x**2 + y**2 + 0.01)"])
def test_integrals_over_two_variables_give_the_same(text):
    arguments, wish = arguments_of(text), Wish({})
    other = homogeneous(arguments, (0, 1), parse(text), wish)
    products = (other,) if other is not None else planar(arguments, (0, 1), parse(text), wish)
    assert products
    function = element_function(dataclasses.replace(describe(text), products=products), ())
    for rho in CORRELATIONS[:-1]:
        mean, S = moments(2, rho)
        assert found(function_of(text), mean, S) == pytest.approx(found(function, mean, S), rel=3e-8, abs=1e-9)


def test_parameters_stay_parameters():
    a, e, x = symbol("a"), symbol("e"), NAMES[0]
    df = describing_function(tuple(NAMES[:2]), parse("a*x/sqrt(a**2*x**2 + (y - e)**2 + e**2)"), values={a: 2.0, e: 0.5})
    function, q = element_function(df, (a, e)), ca.SX.sym("q", 2)
    mean, S = [0.3, 0.2], [0.8, 0.1, 0.5]
    plain = element_function(describing_function(tuple(NAMES[:2]), parse("3*x/sqrt(9*x**2 + (y - 0.7)**2 + 0.49)")), ())
    assert np.array(function(mean, S, [3, 0.7])[1]).ravel() == pytest.approx(np.array(plain(mean, S, [])[1]).ravel(), rel=1e-12)
    slopes = ca.Function("slopes", [q], [ca.jacobian(ca.vertcat(*function(mean, S, q)), q)])
    for k, h in enumerate(1e-4 * np.eye(2)):
        ends = [np.concatenate([np.array(r).ravel() for r in function(mean, S, np.array([3, 0.7]) + s * h)]) for s in (1, -1)]
        assert np.array(slopes([3, 0.7]))[:, k] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-6, abs=1e-8)
    assert x in df.body.free_symbols


@pytest.mark.parametrize(
    ("load", "rest"), [("w*exp(-w**2)", "x/sqrt(x**2 + y**2)"), ("w**2", "exp(x/3)*sqrt(x**2 + y**2 + 1)")]
)
def test_exponentials_leave_the_polynomial_under_the_integral(load, rest):
    df = describe(f"{load}*{rest}")
    assert isinstance(df.products[0], Reduced)
    assert isinstance(df.products[0].core.products[0], QuadraticPower)
    mean, S = moments(3, 0.0)
    first, second = (element_function(describe(part), ()) for part in (load, rest))
    wanted = float(first(mean[2], S[2, 2], [])[0]) * found(second, mean[:2], S[:2, :2])[0]
    assert found(element_function(df, ()), mean, S)[0] == pytest.approx(wanted, rel=1e-11)


def test_a_kink_may_stand_at_a_parameter():
    k, c = symbol("k"), symbol("c")
    df = describing_function(tuple(NAMES[:3]), parse("max(w - k, 0)*x/sqrt(x**2 + y**2 + c)"), values={k: 0.1, c: 0.5})
    assert isinstance(df.products[0], QuadraticPower)
    function, q = element_function(df, (k, c)), ca.SX.sym("q", 2)
    mean, S = moments(3, 0.5)
    slopes = ca.Function("slopes", [q], [ca.jacobian(ca.vertcat(*function(mean, lower(S), q)), q)])
    for j, h in enumerate(1e-4 * np.eye(2)):
        ends = [function(mean, lower(S), [0.1, 0.5] + h * s) for s in (1, -1)]
        up, down = (np.concatenate([np.array(r).ravel() for r in end]) for end in ends)
        assert np.array(slopes([0.1, 0.5]))[:, j] == pytest.approx((up - down) / 2e-4, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("load", ["max(w, 0)", "tanh(w)", "tanh(2*w - 1)"])
def test_friction_under_a_load_that_varies_by_itself_is_a_product(load):
    text = f"{load}*x/sqrt(x**2 + y**2 + 0.04)"
    mean, S = moments(3, 0.5)
    S[2, :2] = S[:2, 2] = 0
    factor = element_function(describing_function((NAMES[2],), parse(load)), ())(mean[2], S[2, 2], [])[0]
    friction = found(function_of("x/sqrt(x**2 + y**2 + 0.04)"), mean[:2], S[:2, :2])
    assert found(function_of(text), mean, S)[:3] == pytest.approx(float(factor) * friction, rel=1e-11)


def test_a_smooth_factor_is_that_of_integrals_over_two_variables():
    """tanh(w) x/r with w = a x + b y + rest: the integral over w of what is left of the others."""
    text, arguments = "tanh(w)*x/sqrt(x**2 + y**2 + 1)", tuple(NAMES[:3])
    other = nested(arguments, (0, 1, 2), parse(text), "it", Wish({}))
    function = element_function(dataclasses.replace(describe(text), products=(other,)), ())
    for rho in (0.0, 0.5, -0.9):
        mean, S = moments(3, rho)
        assert found(function_of(text), mean, S) == pytest.approx(found(function, mean, S), rel=1e-7, abs=1e-8)


@pytest.mark.parametrize(
    "text", ["sqrt(x**2 - y**2 + 1)", "sqrt(x**2 + y)", "sqrt(x**2 + y**2 - 1)", "sqrt(x**2 + abs(y))", "sqrt(x**2 + y**4)"]
)
def test_what_is_no_sum_of_squares_is_left_to_others(text):
    powers, rest = quadratic_powers(arguments_of(text), parse(text), "it", Wish({}))
    assert not powers
    assert rest == parse(text)


@pytest.mark.parametrize("text", ["1/(x**2 + y**2)", "1/(x**2 + y**2 + w**2)**1.5", "x/(x**2 + y**2)**1.5"])
def test_what_is_infinite_is_refused_with_a_remedy(text):
    with pytest.raises(LinearisationError, match="no Gaussian expectation.*add a positive number"):
        describe(text)


def test_what_is_infinite_with_one_variance_alone_is_no_number_then():
    assert np.isnan(found(function_of("x/(x**2 + y**2 + w**2)**1.5"), np.zeros(3), np.diag([1.0, 0, 0]))[1])
    function = function_of("1/sqrt(x**2 + y**2)")
    assert all(np.isnan(found(function, [0, m], np.diag([0, 1.0]))[0]) for m in (0, 3))
    assert found(function, [0, 1e3], np.diag([0, 1.0]))[0] == pytest.approx(1e-3, rel=2e-6)
    assert found(function, [3, 4], np.zeros((2, 2))) == pytest.approx([0.2, -3 / 125, -4 / 125], rel=1e-12)


@pytest.mark.parametrize("text", ["x*sqrt(x**2 + y**2 + w**2)", "w*x/sqrt(x**2 + y**2 + 0.04)"])
def test_scalar_operations_give_the_same(text):
    df = describe(text)
    fixed = tuple(with_count(product) for product in df.products)
    assert all(product.error < 1e-8 for product in fixed)
    function = element_function(dataclasses.replace(df, products=fixed), ())
    assert function.find_functions() == []
    v = ca.SX.sym("v", 9)
    out = ca.vertcat(*function(v[:3], v[3:], []))
    both = ca.Function("both", [v], [out, ca.jacobian(out, v)])
    for mean, S in (moments(3, 0.5), (np.array([0.4, -0.3, 0.2]), np.zeros((3, 3))), (np.zeros(3), 1e-6 * np.eye(3))):
        v = np.concatenate([mean, lower(S)])
        for a, b in zip(both(v), with_jacobian(text)(v), strict=True):
            assert np.array(a) == pytest.approx(np.array(b), rel=1e-7, abs=1e-8 * np.abs(np.array(b)).max())


MISSILE = """
schema = 1
name = "drag of a velocity"
[parameters]
c = 0.4
[rates]
u = "-c*u*sqrt(u**2 + v**2 + w**2) + a"
v = "-c*v*sqrt(u**2 + v**2 + w**2) - 0.3*w + b"
w = "-c*w*sqrt(u**2 + v**2 + w**2) + 0.3*v + d"
[noise]
a = "1.0"
b = "0.5"
d = "0.2"
[run]
duration = {duration}
points = 3
"""


def compiled(tmp_path, duration: float):
    path = tmp_path / "model.toml"
    path.write_text(MISSILE.format(duration=duration))
    return cs.compile(cs.load(path))


def test_a_velocity_in_space_runs_from_rest_and_settles(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = compiled(tmp_path, 40.0)
        history, fixed = model.propagate(), model.stationary()
    assert fixed.state_covariance == pytest.approx(history.state_covariance[-1], rel=1e-6)
    J, y, h = model.functions.jacobian, np.array([0.1, -0.2, 0.3, 0.5, 0.1, 0.05, 0.4, 0.1, 0.3]), 1e-4
    rate = model.functions.rate
    differences = [np.array(rate(0, y + h * e, [0.4]) - rate(0, y - h * e, [0.4])) / (2 * h) for e in np.eye(9)]
    assert np.array(J(0, y, [0.4])) == pytest.approx(np.hstack(differences), abs=1e-7)


def test_gradients_are_differences(tmp_path):
    model, h = compiled(tmp_path, 1.0), 1e-4
    slope = model.propagate().gradient("u", ["c"])[-1][0]
    ends = [float(model.propagate(parameters={"c": 0.4 + s * h}).std["u"][-1]) ** 2 for s in (1, -1)]
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-5)


def test_a_block_slides_from_rest_under_a_load_that_varies():
    """Coulomb friction in the plane: by symmetry both directions obey the same equations."""
    u, v, n, a, b, d = map(symbol, ("u", "v", "n", "a", "b", "d"))
    friction, load = cs.from_library("coulomb_in_plane", force=1, speed="0.1"), parse("0.6*max(1 + n, 0)")
    rates = {u: -load * friction(u, v) + a, v: -load * friction(v, u) + b, n: -2 * n + d}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = cs.compile(cs.Model(cs.Vehicle(rates=rates), noise={a: 0.3, b: 0.3, d: 0.5}, duration=2, points=3))
        P = model.propagate().state_covariance
    assert 0 < P[-1, 0, 0] < 0.5
    assert np.allclose(P[:, 0, 0], P[:, 1, 1], rtol=1e-7)


SPRING = """
schema = 1
name = "spring"
[parameters]
k = 0.3
c = 0.5
[rates]
x = "v"
v = "-x - 0.8*v - k*v*sqrt(x**2 + v**2 + c) + w"
[noise]
w = "1.0"
[run]
duration = 1
points = 3
"""


@pytest.mark.slow
def test_the_c_of_a_model_computes_the_same(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(SPRING)
    model = cs.compile(cs.load(path))
    model.export_c(tmp_path / "c")
    c, plain, p = Exported(tmp_path / "c", "spring", tmp_path), model.functions, [0.3, 0.5]
    for y in ([0, 0, 0, 0, 0], [0.1, -0.2, 0.5, 0.1, 0.4], [3.0, 1.0, 2.0, -1.9, 2.0]):
        wanted = np.array(plain.rate(0, y, p)).ravel()
        assert c.call("rate", 0.0, np.array(y, float), np.array(p), result=5) == pytest.approx(wanted, abs=1e-8)
        J = np.array(ca.densify(plain.jacobian(0, y, p)))
        found = c.call("jacobian_dense", 0.0, np.array(y, float), np.array(p), result=25).reshape(5, 5).T
        assert found == pytest.approx(J, abs=1e-7)
