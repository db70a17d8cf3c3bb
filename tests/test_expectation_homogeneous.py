"""Homogeneous functions of two arguments: by the integral, by the laws they obey, where nothing varies, and in models."""

from __future__ import annotations

import dataclasses
from functools import cache

import casadi as ca
import numpy as np
import pytest
from conftest import one_in
from gaussian_integrals import BESIDE, covariance, panels

import cadet_sym as cs
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.homogeneous import _Cases, degree_of, with_one_rule
from cadet_sym.expectation.polar import Homogeneous
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.lowering.check import check_at
from cadet_sym.lowering.elements import element_function

X, Y = symbol("x"), symbol("y")
SMOOTH = [
    "sqrt(sqrt(x**2 + y**2)*sqrt(x**2 + x*y + 2*y**2))", "x*sqrt(x**2 + 2*y**2)/(x**2 + y**2)",
    "x**3/((x**2 + y**2)*sqrt(x**2 + 3*y**2))",
]  # fmt: skip
KINKED = ["x*abs(x)/sqrt(x**2 + y**2)", "abs(x)**1.5*abs(y)**0.5", "max(x - 2*y, abs(y))"]
JUMPING = ["atan2(y, x)", "atan(y/(x - y))", "x if x > 2*abs(y) else y**2/sqrt(x**2 + y**2)"]
TEXTS = SMOOTH + KINKED + JUMPING
MOMENTS = [
    ((0.3, -0.2), (0.9, 1.05), 0.3),
    ((0.0, 0.0), (1.0, 2.0), 0.0),
    ((-1.0, 0.5), (0.1, 0.3), -0.95),
    ((2.0, 1.0), (3.0, 0.02), 0.5),
    ((0.3, -1e-3), (1e-3, 1e-2), 0.7),
]
FINER = np.concatenate([BESIDE, [s * 1.5 * 0.2**j for j in range(7, 14) for s in (-1, 1)]])
ACROSS = np.array([-10, -3, -1, -0.5, -0.3, 0, 0.3, 1 / 3, 0.5, 1, 3, 10])  # slopes of lines, kinks among them


@cache
def describe(text: str):
    return describing_function((X, Y), parse(text), name="f")


def function_of(text: str) -> ca.Function:
    df = describe(text)
    assert isinstance(df.products[0], Homogeneous), text
    assert df.error <= 1e-8
    return element_function(df, ())


@cache
def with_jacobian(text: str) -> ca.Function:
    function, v = function_of(text), ca.SX.sym("v", 5)
    out = ca.vertcat(*function(v[:2], v[2:], []))
    return ca.Function("both", [v], [out, ca.jacobian(out, v)])


def by_integration(text: str, mean, stds, rho) -> tuple[np.ndarray, float]:
    """E[f] and, by Stein's lemma, the gains; E|f|."""
    (mx, my), (sx, sy) = mean, stds
    breaks = [-mx / sx + FINER] + [(k * mx - my) / (rho * sy - k * sx) + BESIDE[:7] for k in ACROSS if rho * sy != k * sx]
    u, w = panels(np.concatenate(breaks))
    u, w = u[w > 1e-19][:, None], w[w > 1e-19]
    x, centre, spread = mx + sx * u, my + rho * sy * u, sy * np.sqrt(1 - rho * rho)
    v, p = panels(np.concatenate([(x * ACROSS - centre) / spread, -centre / spread + FINER], axis=1))
    x, y = np.broadcast_to(x, v.shape), centre + spread * v
    f = np.broadcast_to(evaluate(parse(text), {X: x, Y: y}), v.shape) * p * w[:, None]
    S = np.array([[sx * sx, rho * sx * sy], [rho * sx * sy, sy * sy]])
    gains = np.linalg.solve(S, [np.sum((x - mx) * f), np.sum((y - my) * f)])
    return np.array([np.sum(f), *gains]), float(np.sum(np.abs(f)))


def found(function: ca.Function, mean, S) -> np.ndarray:
    return np.concatenate([np.array(r).ravel() for r in function(mean, S, [])])


@pytest.mark.parametrize("text", one_in(4, TEXTS))
def test_it_is_the_integral(text):
    function = function_of(text)
    for mean, stds, rho in MOMENTS:
        wanted, size = by_integration(text, mean, stds, rho)
        error = (found(function, mean, covariance(stds, rho)) - wanted) * [1, *stds]
        assert np.abs(error) == pytest.approx(0, abs=1e-8 * max(size, 1e-3 * max(stds))), (mean, stds, rho)


@pytest.mark.parametrize("text", one_in(4, TEXTS))
def test_gains_are_slopes_and_derivatives_those_of_the_gains(text):
    both = with_jacobian(text)
    for mean, stds, rho in MOMENTS[:4]:
        v = np.array([*mean, *covariance(stds, rho)])
        units = np.array([*stds, stds[0] ** 2, stds[0] * stds[1], stds[1] ** 2])
        F, J = (np.array(r) for r in both(v))
        for k, unit in enumerate(units):
            step = 1e-4 * unit * np.eye(5)[k]
            slope = (np.array(both(v + step)[0]) - np.array(both(v - step)[0])).ravel() / 2e-4
            scale = np.abs(J * units).max(axis=1) + np.abs(F[0]) * 1e-3
            assert J[:, k] * unit == pytest.approx(slope, abs=2e-6 * scale.max()), (mean, k)
        assert J[0, :2] == pytest.approx(F[1:].ravel(), rel=1e-7, abs=1e-9 * np.abs(F).max())
        assert J[0, 2:] == pytest.approx([J[1, 0] / 2, J[1, 1], J[2, 1] / 2], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("text", TEXTS[::3])
def test_the_scale_of_both_arguments_is_a_factor(text):
    function, degree = function_of(text), float(degree_of(parse(text), frozenset((X, Y))))
    unit = found(function, [0.3, -0.2], [0.8, 0.3, 1.1])
    for scale in (1e-6, 1e3):
        scaled = found(function, [0.3 * scale, -0.2 * scale], np.array([0.8, 0.3, 1.1]) * scale**2)
        assert scaled == pytest.approx(unit * scale ** np.array([degree, degree - 1, degree - 1]), rel=1e-9)


@pytest.mark.parametrize("text", one_in(4, TEXTS))
def test_without_variance_it_is_the_function_and_derivatives_are_finite(text):
    both = with_jacobian(text)
    x, y, h = 0.7, -0.2, 1e-4

    def f(x: float, y: float) -> float:
        return float(evaluate(parse(text), {X: x, Y: y}))

    F, J = (np.array(r) for r in both([x, y, 0, 0, 0]))
    slopes = [(f(x + h * a, y + h * b) - f(x - h * a, y - h * b)) / (2 * h) for a, b in ((1, 0), (0, 1))]
    bends = [(f(x + h, y) - 2 * f(x, y) + f(x - h, y)) / (2 * h * h), (f(x, y + h) - 2 * f(x, y) + f(x, y - h)) / (2 * h * h)]
    assert F.ravel() == pytest.approx([f(x, y), *slopes], rel=1e-6, abs=1e-8)
    assert [J[0, 2], J[0, 4]] == pytest.approx(bends, rel=1e-5, abs=1e-5)
    degenerate = [[0, 0, 0], [1e-300, 0, 0], [1, 0, 0], [0, 0, 1], [1, 2, 4], [1, -2, 4], [1e-6, 0, 0]]
    for v in [[*mean, *S] for S in degenerate for mean in ((0, 0), (x, y), (1, 0))]:
        assert all(np.all(np.isfinite(np.array(r))) for r in both(v)), v


@pytest.mark.parametrize("text", SMOOTH + KINKED)
def test_with_full_correlation_one_argument_is_left(text):
    function = function_of(text)
    alone = element_function(describing_function((X,), parse(text).subs(Y, parse("0.4 - 2*x")), name="f"), ())
    F = found(function, [0.3, -0.2], [0.25, -0.5, 1.0])
    one = found(alone, 0.3, 0.25)
    assert F[0] == pytest.approx(one[0], rel=1e-7)
    assert F[1] - 2 * F[2] == pytest.approx(one[1], rel=1e-6, abs=1e-7)  # along the line


@pytest.mark.parametrize("text", ["max(min(x, y), 0)", "max(abs(x), abs(y))"])
def test_arcs_that_are_many_deviations_long_have_nodes_enough(text):
    """Nearly the whole of them where the mean is six to seven deviations from the origin."""
    df = describing_function((X, Y), parse(text))
    correlated = np.array([[1, 1.4 * 0.99999], [1.4 * 0.99999, 1.96]])
    cases = [(np.array([0.02, -0.01]), correlated, {}), (np.array([0.146, 7e-3]), np.diag([1.0, 1e-6]), {})]
    result = check_at(df, cases, 4_000_000)
    assert max(result.error, result.gain_error) < 1e-9


def test_one_argument_without_variance_leaves_the_other():
    function = function_of("x*abs(x)/sqrt(x**2 + y**2)")
    alone = element_function(describing_function((X,), parse("x*abs(x)/sqrt(x**2 + 0.09)")), ())
    assert found(function, [0.4, 0.3], [0.5, 0, 0])[:2] == pytest.approx(found(alone, 0.4, 0.5), rel=1e-9)


@pytest.mark.parametrize(
    ("text", "degree"),
    [("x*y", 2), ("sqrt(x**2 + y**2)", 1), ("sign(x)*abs(y)**2.5", 2.5), ("atan(y/x)", 0), ("max(x, 0)", 1), ("tanh(x/y)", 0),
     ("x + 1", None), ("tanh(x)", None), ("x if y > 0 else -y", 1), ("x if y > 1 else -y", None), ("max(x, 1)", None)],
)  # fmt: skip
def test_the_degree_is_seen(text, degree):
    assert degree_of(parse(text), frozenset((X, Y))) == (degree if degree is None else parse(str(degree)))


def test_a_jump_that_is_not_seen_shows_in_the_gains():
    (found,) = describe("atan2(y, x)").products
    assert _Cases(found, {}).lost() < 1e-9
    assert _Cases(dataclasses.replace(found, rays=()), {}).lost() > 0.1


def test_parameters_stay_parameters():
    (mu, df) = symbol("mu"), describing_function((X, Y), parse("x*abs(x)/sqrt(x**2 + mu**2*y**2)"), values={symbol("mu"): 2.0})
    assert isinstance(df.products[0], Homogeneous)
    function = element_function(df, (mu,))
    wanted = found(function_of("x*abs(x)/sqrt(x**2 + y**2)"), [0.3, 3 * 0.2], [0.8, 3 * 0.1, 9 * 0.5])
    F, gain = function([0.3, 0.2], [0.8, 0.1, 0.5], [3.0])
    assert [float(F), *np.array(gain).ravel() / [1, 3]] == pytest.approx(wanted, rel=1e-8)
    q = ca.SX.sym("q")
    slope = ca.Function("slope", [q], [ca.jacobian(function([0.3, 0.2], [0.8, 0.1, 0.5], q)[0], q)])
    up, down = (float(function([0.3, 0.2], [0.8, 0.1, 0.5], [3 + h])[0]) for h in (1e-4, -1e-4))
    assert float(slope(3.0)) == pytest.approx((up - down) / 2e-4, rel=1e-6)


@pytest.mark.parametrize("text", ["x*abs(x)/sqrt(x**2 + y**2)", "atan2(y, x)"])
def test_scalar_operations_give_the_same(text):
    df = describe(text)
    fixed = with_one_rule(df.products[0], {})
    assert fixed.error < 1e-8
    functions = [element_function(d, ()) for d in (df, dataclasses.replace(df, products=(fixed,)))]
    assert functions[1].find_functions() == []
    for mean, S in (([0.4, -0.3], [0.5, 0.2, 0.9]), ([2.0, -0.3], [0.1, 0, 0.2]), ([0.4, -0.3], [0, 0, 0])):
        a, b = (found(f, mean, S) for f in functions)
        assert a == pytest.approx(b, rel=1e-7)


def test_a_plate_that_slides_runs_from_rest():
    """Friction against the velocity in two directions: by symmetry each obeys the same equations."""
    x, y, w1, w2 = map(symbol, ("x", "y", "w1", "w2"))
    speed = parse("sqrt(x**2 + y**2)")
    vehicle = cs.Vehicle(rates={x: -x * speed - x / speed + w1, y: -y * speed - y / speed + w2})
    model = cs.Model(vehicle, noise={w1: 1, w2: 1}, duration=0.2, points=3)
    P = cs.compile(model).propagate().state_covariance
    assert 0 < P[-1, 0, 0] < 0.2
    assert np.allclose(P[:, 0, 0], P[:, 1, 1], rtol=1e-7)
