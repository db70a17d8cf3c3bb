"""Smooth functions of two arguments with no closed form inside: accuracy at any scale, derivatives, cost, and in models."""

from __future__ import annotations

import dataclasses
import time
from functools import cache

import casadi as ca
import numpy as np
import pytest
from conftest import half, one_in
from gaussian_integrals import covariance, one, two

import cadet_sym as cs
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.planar import Planar
from cadet_sym.expectation.smooth import _Case, with_counts
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.lowering.elements import element_function

X, Y = symbol("x"), symbol("y")
TEXTS = [
    "tanh(x*y)", "x*tanh(x*y)/(1 + x**2 + y**2)",
    "y*log(0.1 + x**2 + y**2)**2", "tanh(x)*tanh(y)", "tanh(x + y**2)", "tanh(x + x*y)*y**2",
    "y*tanh(x*y - 1)", "log(1 + x**2*y**2)", "log((x - 1)**2 + (y + 2)**2 + 0.1)**2", "exp(tanh(x*y))",
]  # fmt: skip
MOMENTS = [((0.4, -0.3), (0.7, 1.5)), ((2.0, 1.0), (3.0, 2.0))]
CORRELATIONS = [0.5, -0.999999]
MODEL = """
schema = 1
name = "two arguments at once"
[parameters]
k = {k}
[rates]
x = "v"
v = "-x - 0.4*v - tanh(k*x*v) + w"
[noise]
w = "1.0"
[run]
duration = 1.0
points = 3
"""


@cache
def describe(text: str):
    return describing_function((X, Y), parse(text), name="f")


KINKED = ["max(x, 0)*tanh(x*y)", "abs(x - 0.1)*tanh(x*y)", "max(y, 0.2)*log(x**2 + y**2 + 1)**2"]


def planar(text: str) -> Planar:
    (found,) = describe(text).products
    assert isinstance(found, Planar)
    return found


def value(text: str):
    return lambda x, y: np.broadcast_to(evaluate(parse(text), {X: x, Y: y}), np.broadcast_shapes(np.shape(x), np.shape(y)))


def stacked(parts) -> np.ndarray:
    return np.concatenate([np.array(part).ravel() for part in parts])


@pytest.mark.parametrize("text", one_in(3, TEXTS + KINKED))
def test_it_is_the_integral_at_any_correlation(text):
    df = describe(text)
    function, f = element_function(df, ()), value(text)
    assert all(isinstance(product, Planar) for product in df.products)
    assert df.error <= 1e-8
    for mean, stds in MOMENTS:
        for rho in CORRELATIONS:
            fine = [*np.linspace(-6, 6, 9), 0.1, 0.2]  # panels narrow enough for the steep places between them, and kinks
            wanted = two(f, mean, stds, rho, (fine, fine))
            size = two(lambda x, y: np.abs(f(x, y)), mean, stds, rho, ([0.1], [0.2]))
            assert float(function(mean, covariance(stds, rho), [])[0]) == pytest.approx(wanted, abs=1e-8 * size), (mean, rho)


@pytest.mark.parametrize("text", one_in(3, TEXTS + KINKED))
def test_gains_are_slopes_and_the_heat_equation_holds(text):
    function = element_function(describe(text), ())
    m, S = ca.SX.sym("m", 2), ca.SX.sym("S", 3)
    both = ca.Function("both", [m, S], [*function(m, S, []), ca.jacobian(ca.vertcat(*function(m, S, [])), ca.vertcat(m, S))])
    mean, cov, h = np.array([0.3, -0.4]), np.array([0.8, 0.3, 1.1]), 1e-2
    _, gain, J = (np.array(r) for r in both(mean, cov))
    assert J[0, :2] == pytest.approx(gain.ravel(), rel=1e-7, abs=1e-8)  # other numbers of nodes
    for k, e in enumerate(np.eye(5)):

        def at(n: int, e: np.ndarray = e) -> np.ndarray:
            return stacked(both(mean + n * h * e[:2], cov + n * h * e[2:])[:2])

        slope = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)  # a step so long that other numbers of nodes do not show
        assert J[:, k] == pytest.approx(slope, rel=1e-5, abs=1e-6)
    # dF/dS11 = (1/2) d2F/dm1^2, of F and of the gains
    assert J[0, 2:] == pytest.approx([J[1, 0] / 2, J[1, 1], J[2, 1] / 2], abs=1e-8)


@pytest.mark.parametrize("text", one_in(3, TEXTS + KINKED))
def test_without_variance_it_is_the_function_and_derivatives_are_finite(text):
    function, f = element_function(describe(text), ()), value(text)
    m, S = ca.SX.sym("m", 2), ca.SX.sym("S", 3)
    J = ca.Function("J", [m, S], [ca.jacobian(ca.vertcat(*function(m, S, [])), ca.vertcat(m, S))])
    for variances in ([0, 0, 0], [1e-300, 0, 1e-300], [0, 0, 1], [1, 0, 0]):
        F, gain = function([0.3, -0.2], variances, [])
        assert np.all(np.isfinite(np.array(J([0.3, -0.2], variances))))
        if not any(v > 0.1 for v in variances):
            assert float(F) == pytest.approx(float(f(0.3, -0.2)), rel=1e-9)
            slope = [(f(0.3 + h, -0.2 + k) - f(0.3 - h, -0.2 - k)) / 2e-6 for h, k in ((1e-6, 0), (0, 1e-6))]
            assert np.array(gain).ravel() == pytest.approx([float(s) for s in slope], rel=1e-6, abs=1e-8)


def test_with_full_correlation_one_argument_is_left():
    function = element_function(describe("tanh(x*y)"), ())
    alone = element_function(describing_function((X,), parse("tanh(x*(0.5 - 2*x))")), ())
    assert float(function([0.3, -0.1], [0.49, -0.98, 1.96], [])[0]) == pytest.approx(float(alone(0.3, 0.49, [])[0]), abs=1e-8)


@pytest.mark.parametrize("stds", [(1.0, 1.0), (3.0, 3.0), (10.0, 7.0)])
@pytest.mark.parametrize("rho", [1.0, -1.0])
@pytest.mark.parametrize("text", ["tanh(x*y)", "x*tanh(x*y)*y"])
def test_with_full_correlation_two_poles_may_be_one(text, stds, rho):
    """Where both means are zero the line through them passes x y = 0 twice at the same place."""
    function, f = element_function(describe(text), ()), parse(text)
    wanted, _ = one(lambda u: evaluate(f, {X: stds[0] * u, Y: rho * stds[1] * u}), 0.0, 1.0, [0.0])
    assert float(function([0, 0], covariance(stds, rho), [])[0]) == pytest.approx(wanted, rel=1e-8)


def test_a_kink_may_stand_at_a_parameter():
    k = symbol("k")
    df = describing_function((X, Y), parse("max(x, k)*tanh(x*y)"), values={k: 0.1})
    function, q = element_function(df, (k,)), ca.SX.sym("q")
    slopes = ca.Function("slopes", [q], [ca.jacobian(ca.vertcat(*function([0.3, -0.2], [0.8, 0.3, 1.1], q)), q)])

    def at(n: int) -> np.ndarray:
        return stacked(function([0.3, -0.2], [0.8, 0.3, 1.1], 0.1 + n * 1e-2))

    assert np.array(slopes(0.1)).ravel() == pytest.approx((8 * (at(1) - at(-1)) - (at(2) - at(-2))) / 12e-2, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("text", ["sign(x)*tanh(x + y)", "max(x - y, 0)*tanh(x*y)", "abs(x)**0.5*tanh(x*y)"])
def test_jumps_slanted_kinks_and_singular_ends_are_left_to_others(text):
    assert not any(isinstance(product, Planar) for product in describe(text).products)


def test_the_order_follows_the_scale():
    function = element_function(describe("tanh(x*y)"), ())
    assert float(function([4e-4, 3e-4], covariance((1e-3, 1e-3), 0.5), [])[0]) == pytest.approx(4e-4 * 3e-4 + 0.5e-6, rel=1e-8)
    # far out it is the sign of the product: E[sign(x) sign(y)] = (2/pi) asin(rho)
    found = [float(function([0, 0], covariance((s, s), 0.5), [])[0]) for s in (1e3, 1e4)]
    assert found == pytest.approx([1 / 3, 1 / 3], abs=1e-8)
    small, large = np.inf, np.inf
    for _ in range(5):  # by turns, the least of each: others use the machine too
        small, large = min(small, time_of(function, 0.01)), min(large, time_of(function, 1e4))
    assert large > 2 * small


def time_of(function: ca.Function, variance: float) -> float:
    started = time.process_time()
    for _ in range(10):
        function([0, 0], [variance, 0, variance], [])
    return time.process_time() - started


def test_fixed_numbers_of_nodes_give_the_same_in_scalar_operations():
    found = planar("tanh(x*y)")
    fixed = with_counts(found, (48, 28), {})
    assert fixed.error < 1e-6
    df = describe("tanh(x*y)")
    functions = [element_function(d, ()) for d in (df, dataclasses.replace(df, products=(fixed,)))]
    assert functions[1].find_functions() == []
    for mean, S in (([0.4, -0.3], [0.5, 0.2, 0.9]), ([0.4, -0.3], [0, 0, 0])):
        a, b = (stacked(f(mean, S, [])) for f in functions)
        assert a == pytest.approx(b, abs=1e-7)


def test_a_model_runs_and_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("CADET_SYM_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "model.toml"
    path.write_text(MODEL.format(k=1.0))
    first, again = (cs.compile(cs.load(path)).propagate() for _ in range(2))
    assert np.array_equal(first.state_covariance, again.state_covariance)
    compiled = cs.compile(cs.load(path))
    J, y, h = compiled.functions.jacobian, np.array([0.1, -0.2, 0.5, 0.1, 0.4]), 1e-5
    differences = [
        np.array(compiled.functions.rate(0, y + h * e, [1.0]) - compiled.functions.rate(0, y - h * e, [1.0])) / (2 * h)
        for e in np.eye(5)
    ]
    assert np.array(J(0, y, [1.0])) == pytest.approx(np.hstack(differences), abs=1e-6)


def test_the_error_claimed_is_that_at_other_moments_too():
    generator = np.random.default_rng(3)
    found = planar("tanh(x*y)")
    for _ in range(20):
        size, lean, *mean = generator.normal(0, [0.8, 1, 1, 1])
        error, _ = _Case.of(found, {}, 1.0, np.exp(size), np.tanh(lean), (mean[0], mean[1])).error(found.step)
        assert error < 3 * found.error
    assert found.nodes < 1300


RUN = """
schema = 1
name = "driven to rest"
[parameters]
k = 0.3
c = 0.5
[rates]
x = "v"
v = "-x - 0.8*v - {force} + w"
[noise]
w = "1.0"
[run]
duration = {duration}
points = 3
"""


@pytest.mark.parametrize("force", half(["k*v*sqrt(x**2 + v**2 + c)", "k*tanh(c*x*v) + k*v", "k*max(x, c*v)*abs(v)*sign(v)"]))
def test_the_stationary_state_is_the_end_of_a_long_run_and_gradients_are_differences(tmp_path, force):
    path = tmp_path / "model.toml"
    path.write_text(RUN.format(force=force, duration=60.0))
    compiled = cs.compile(cs.load(path))
    fixed, history = compiled.stationary(), compiled.propagate()
    assert fixed.state_covariance == pytest.approx(history.state_covariance[-1], abs=1e-6)
    assert fixed.state_mean == pytest.approx(history.state_mean[-1], abs=1e-6)
    path.write_text(RUN.format(force=force, duration=2.0))
    compiled, h = cs.compile(cs.load(path)), 1e-4
    found = compiled.propagate().gradient("x", ["k", "c"])[-1]
    for name, value, slope in (("k", 0.3, found[0]), ("c", 0.5, found[1])):
        ends = [float(compiled.propagate(parameters={name: value + sign * h}).std["x"][-1]) ** 2 for sign in (1, -1)]
        assert slope == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-5, abs=1e-7)
