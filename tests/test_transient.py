"""Moments over a run: engines agree, breakpoints are met, positive semidefinite throughout, failures say where."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import SHIPPED, half
from reference_models import toml
from scipy.linalg import expm

import cadet_sym as cs
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.modelfile import loads
from cadet_sym.packing import Packing
from cadet_sym.solve import choice, stiff
from cadet_sym.solve.evaluate import _roomy, gains_over, results, results_over, results_shared
from cadet_sym.solve.implicit import Inverse, PackedIndex, scaled_form
from cadet_sym.solve.lyapunov import modal_form
from cadet_sym.solve.start import initial_moments

OLEO = cs.compile("models/oleo_acceleration.toml")


def pulses(count: int) -> cs.Model:
    """An oscillator driven by noise, with a force of 10 ms now and then."""
    edges = [(sp.Rational(k), sp.Rational(k) + sp.Rational(1, 100)) for k in range(1, count + 1)]
    force = " + ".join(f"heaviside(t - {a}) - heaviside(t - {b})" for a, b in edges[:3])
    return toml(
        f"""
        name = "pulses"
        [rates]
        x = "v"
        v = "-4*x - 0.4*v + 100*({force}) + w"
        [noise]
        w = 1.0
        [run]
        duration = {count + 1}
        """
    )


def relative_error(history: cs.MomentHistory, reference: cs.MomentHistory) -> float:
    """Largest error of a covariance over the product of the largest standard deviations."""
    size = np.sqrt(reference.variance.values.max(axis=0))
    return float((np.abs(history.state_covariance - reference.state_covariance) / np.outer(size, size)).max())


@pytest.mark.parametrize("engine", ["direct", "implicit", "krylov", "explicit", "native", "stiff"])
def test_every_engine_gives_the_same_moments_and_says_its_name(engine):
    reference = OLEO.propagate(rtol=1e-10, points=11)
    history = OLEO.propagate(rtol=1e-7, points=11, engine=engine)
    assert relative_error(history, reference) < 1e-5
    names = {"native": "Runge-Kutta 8(5,3), machine code", "stiff": "BDF (Newton + Lyapunov), machine code"}
    assert history.provenance.engine.startswith(names.get(engine, "CVODE"))


def test_a_smaller_tolerance_gives_a_smaller_error():
    reference = OLEO.propagate(rtol=1e-11, points=11)
    errors = [relative_error(OLEO.propagate(rtol=r, points=11), reference) for r in (1e-4, 1e-6, 1e-8)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert errors[1] < 1e-5


def test_results_do_not_depend_on_what_ran_before():
    fresh = cs.compile("models/oleo_acceleration.toml").propagate(parameters={"zeta": 0.05})
    used = cs.compile("models/oleo_acceleration.toml")
    used.propagate(parameters={"zeta": 0.3})
    used.propagate(points=7)
    np.testing.assert_array_equal(used.propagate(parameters={"zeta": 0.05}).state_covariance, fresh.state_covariance)


def test_repeated_runs_build_nothing(monkeypatch):
    import casadi as ca

    compiled = cs.compile("models/oleo_acceleration.toml")
    first = compiled.propagate(rtol=1e-6)
    monkeypatch.setattr(ca, "integrator", None)
    again = compiled.propagate(rtol=1e-6, parameters={"zeta": 0.011})
    assert not np.array_equal(first.state_covariance, again.state_covariance)
    np.testing.assert_array_equal(compiled.propagate(rtol=1e-6).state_covariance, first.state_covariance)


@pytest.mark.parametrize("times", [[0.0], [3.7], [0.0, 1e-9, 5.0], [1.0, 1.005, 1.01, 2.0], np.geomspace(1e-6, 4, 9)])
def test_output_times_may_stand_anywhere(times):
    compiled = cs.compile(pulses(3))
    everywhere = compiled.propagate(np.unique([0.0, *times, 4.0]), rtol=1e-9)
    history = compiled.propagate(times, rtol=1e-9)
    rows = np.searchsorted(everywhere.time, times)
    np.testing.assert_allclose(history.state_mean, everywhere.state_mean[rows], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(history.state_covariance, everywhere.state_covariance[rows], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("engine", ["auto", "implicit", "explicit", "stiff"])
def test_a_short_pulse_is_met(engine):
    model = toml('name = "p"\n[rates]\nv = "-0.1*v + heaviside(t - 50) - heaviside(t - 50.01)"\n[run]\nduration = 60')
    history = cs.compile(model).propagate([49.0, 50.01, 60.0], engine=engine)
    exact = 10 * (1 - np.exp(-0.001)) * np.exp(-0.1 * np.array([0.0, 9.99]))
    np.testing.assert_allclose(history.mean["v"], [0.0, *exact], rtol=1e-6, atol=1e-12)


def test_no_duration_gives_the_start():
    history = OLEO.propagate(duration=0.0, points=1)
    np.testing.assert_array_equal(history.state_covariance[0], OLEO.propagate([0.0, 1.0]).state_covariance[0])


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_covariances_stay_positive_semidefinite_from_complete_rest(rtol):
    model = toml(
        """
        name = "from rest"
        [rates]
        x = "v"
        v = "-100*(x - y) - 0.1*(v - u)*abs(v - u)"
        y = "u"
        u = "100*(x - y) - 1e4*y - 0.2*u**3 + w"
        [noise]
        w = 1.0
        [run]
        duration = 5.0
        """
    )
    for engine in ("direct", "implicit"):
        times = np.concatenate([[0.0], np.geomspace(1e-6, 5, 60)])
        history = cs.compile(model).propagate(times, rtol=rtol, engine=engine)
        lowest = np.linalg.eigvalsh(history.state_covariance)[:, 0]
        trace = np.trace(history.state_covariance, axis1=1, axis2=2)
        assert np.all(lowest >= -1e-9 * trace)


UNSTABLE = toml("""
    name = "a pendulum upside down"
    [parameters]
    a = 4.0
    [rates]
    x = "v"
    v = "a*x + w"
    [noise]
    w = 1.0
    [run]
    duration = 5.0
    points = 11
""")


@pytest.mark.parametrize("engine", ["auto", "direct", "implicit", "krylov", "stiff"])
def test_errors_that_grow_with_the_system_begin_small(engine):
    """The variance grows a thousand million times; P(t) is the integral of exp(A s) Q exp(A s)^T."""
    history, w = cs.compile(UNSTABLE).propagate(engine=engine), 2.0
    t = history.time[1:]
    both = np.sinh(2 * w * t) / w  # of cosh^2, sinh^2: (both +- 2 t)/4
    P = np.array([[(both - 2 * t) / (4 * w**2), np.sinh(w * t) ** 2 / (2 * w**2)], [np.zeros_like(t), (both + 2 * t) / 4]])
    for i, j in ((0, 0), (0, 1), (1, 1)):
        assert np.abs(history.state_covariance[1:, i, j] / P[i, j] - 1).max() < 1e-6


def test_runs_that_grow_at_their_own_rate_are_each_as_by_themselves():
    compiled, values = cs.compile(UNSTABLE), [4.0, 2.0, -1.0, 9.0]
    many = compiled.propagate_all({"a": values}, duration=6.0)  # longer than declared: no run tells of the others
    for k, a in enumerate(values):
        alone = compiled.propagate(parameters={"a": a}, duration=6.0)
        assert np.array_equal(many[k].state_covariance, alone.state_covariance)


def test_an_unstable_model_says_when_where_and_why_and_keeps_what_was_reached():
    model = toml('name = "u"\n[rates]\nx = "x + x**3 + w"\ny = "-y + w"\n[noise]\nw = 1.0\n[run]\nduration = 50.0')
    with pytest.raises(SolverError, match=r"variance of `x`.*eigenvalue") as caught:
        cs.compile(model).propagate(points=1001)
    error: Any = caught.value
    assert 0.1 < error.time < 2.0
    assert error.state == "x"
    assert error.eigenvalues[0].real > 1
    assert isinstance(error.partial, cs.MomentHistory)
    assert len(error.partial.time) > 2
    assert error.partial.time[-1] <= error.time
    np.testing.assert_allclose(error.partial.variance["y"], (1 - np.exp(-2 * error.partial.time)) / 2, rtol=1e-5)


def test_a_rate_that_does_not_exist_is_named():
    model = toml('name = "n"\n[rates]\nx = "-x"\ny = "-y + sqrt(1 - t)"\n[run]\nduration = 3.0')
    with pytest.raises(SolverError, match="mean of `y`") as caught:
        cs.compile(model).propagate(points=31)
    error: Any = caught.value
    assert error.time == pytest.approx(1.0, abs=0.05)
    assert error.partial.time[-1] == pytest.approx(1.0, abs=0.11)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rtol": 0.0}, "rtol"),
        ({"rtol": float("nan")}, "rtol"),
        ({"times": [0.0, 2.0, 1.0]}, "1 follows 2"),
        ({"times": [-1.0, 2.0]}, "begins at 0"),
        ({"times": []}, "non-empty"),
        ({"times": [0.0, float("inf")]}, "finite"),
        ({"engine": "magic"}, "auto, direct"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ModelError, match=message):
        OLEO.propagate(**arguments)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n", [1, 4, 7])
def test_the_implicit_inverse_solves_its_own_equation(n, seed):
    rng = np.random.default_rng(seed)
    packing, scale, g = Packing(n, distance=True), rng.uniform(0.1, 10, n), 0.3
    N = rng.standard_normal((n, n)) - 2 * np.eye(n)
    form = scaled_form(N, scale)
    y = rng.standard_normal(packing.size)
    mean, P = packing.unpack(y)
    r = np.concatenate([packing.pack(mean - g * N @ mean, P - g * (N @ P + P @ N.T)), y[packing.moments :]])
    z = np.empty_like(r)
    Inverse.build(PackedIndex(packing), scale, form, g).apply(r, z)
    np.testing.assert_allclose(z, y, rtol=1e-8, atol=1e-9 * np.abs(y).max())


def test_a_matrix_without_eigenvectors_has_a_neighbour_with():
    N = np.diag(np.ones(3), 1)
    assert (form := modal_form(N)) is None or form.condition > 1e7
    assert scaled_form(N, np.ones(4)).condition < 1e10


def test_a_rate_that_jumps_as_the_run_leaves_rest_is_met_on_the_far_side():
    x, v, w, y, z = sp.symbols("x v w y z")
    turn = cs.Element("turn", [y, z], sp.sign(y * z))
    vehicle = cs.Vehicle(rates={x: v, v: -x - v - turn(v, x) + w})
    compiled = cs.compile(cs.Model(vehicle, noise=cs.Noise(("w",), sp.ImmutableMatrix([[1]])), duration=1))
    runs = [compiled.propagate([0.0, 1e-3, 1.0], engine=engine) for engine in ("direct", "implicit", "explicit")]
    for run in runs:
        assert not run.state_mean[0].any()
        assert not run.state_covariance[0].any()
        assert run.covariance["x", "v"][1] == pytest.approx(0.5e-6, rel=0.01)
        np.testing.assert_allclose(run.state_covariance[2], runs[0].state_covariance[2], rtol=1e-6)
    # E[sign(v x)] is 2 asin(r)/pi, and r = sqrt(3)/2 as soon as white noise has driven a mass
    assert runs[0].mean["v"][1] == pytest.approx(-2e-3 / 3, rel=0.01)


@pytest.mark.parametrize("stiffness", [1e4, 1e6, 1e8])
def test_what_swings_for_long_is_followed_by_formulas_of_high_order(stiffness):
    """An oscillator that hardly decays from rest: implicit formulas took ten times the steps, and ended in another engine."""
    x, v, w = sp.symbols("x v w")
    vehicle = cs.Vehicle(rates={x: v, v: -stiffness * x - 1e-3 * v + w})
    model = cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=20)
    history = cs.compile(model).propagate()
    assert history.provenance.engine.startswith("Runge-Kutta")
    stationary = np.diag([1 / (2e-3 * stiffness), 1 / 2e-3])
    ahead = expm(20 * np.array([[0, 1], [-stiffness, -1e-3]]))
    expected = stationary - ahead @ stationary @ ahead.T
    np.testing.assert_allclose(np.diag(history.state_covariance[-1]), np.diag(expected), rtol=1e-6)


@pytest.mark.parametrize("k", [1, 2, 5, 7, 9, 13, 100])
def test_many_places_give_the_numbers_of_each(k):
    """Functions of many places are made for few numbers of them: what is over goes nowhere."""
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ca.sin(x) * y, ca.vertcat(x[1], 0, y)])
    rng = np.random.default_rng(k)
    a, b = rng.normal(size=(k, 2)), rng.normal(size=(k, 1))
    alone = [results(function, *each) for each in zip(a, b, strict=True)]
    for found, expected in zip(results_over(function, a, b), zip(*alone, strict=True), strict=True):
        np.testing.assert_array_equal(found, expected)
    few = {_roomy(each) for each in range(1, 1001)}
    assert len(few) < 40
    assert all(each <= _roomy(each) <= 1.25 * each for each in range(1, 1001))
    shared = results_over(function, a, np.repeat(b[:1], k, axis=0))
    for found, expected in zip(results_shared(function, k, a, b[0]), shared, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_the_bound_of_modes_is_one():
    """Also of matrices that are zero or nilpotent; and it is none of their norms."""
    rng, shape = np.random.default_rng(3), (200, 2, 6, 6)
    matrices = rng.normal(size=shape) * (rng.uniform(size=shape) < 0.4) * 10.0 ** rng.integers(-9, 9, (200, 1, 6, 1))
    matrices[0], matrices[1] = 0.0, np.triu(np.ones((6, 6)), 1)
    largest = np.abs(np.linalg.eigvals(matrices)).max(axis=(1, 2))
    assert (choice._bounds(matrices) >= largest * (1 - 1e-12)).all()
    swings = np.array([[0.0, 1.0], [-1e8, -10.0]])[None, None]
    assert choice._bounds(swings)[0] < 1.2e4


def test_runs_that_begin_alike_are_given_their_first_modal_form(monkeypatch):
    model = toml('name = "stiff"\n[rates]\nx = "-1e6*x - x**3 + w"\n[noise]\nw = 1.0\n[run]\nduration = 20.0')
    compiled, made = cs.compile(model), []
    monkeypatch.setattr(stiff, "scaled_form", lambda *given: made.append(1) or scaled_form(*given))
    first = compiled.propagate(points=3)
    forms = len(made)
    second = compiled.propagate(points=5)
    assert len(made) == forms > 0
    np.testing.assert_allclose(first.variance["x"][-1], second.variance["x"][-1], rtol=1e-6)


def test_where_the_gains_are_said_to_stand_still_they_do_at_any_time_and_moments(shipped):
    rng, still = np.random.default_rng(0), set()
    for path in SHIPPED:
        compiled = shipped(path.stem)
        p = np.tile(compiled.parameter_vector(), (20, 1))
        y = compiled.initial() + rng.normal(size=(20, compiled.packing.size))
        N = gains_over(compiled.functions, np.linspace(0.0, compiled.declaration.duration, 20), y, p)
        if choice.stands_still(compiled.functions):
            assert (N[0] == N).all()
            still.add(path.stem)
    assert "quarter_car_linear" in still
    assert "oleo_constant_speed" not in still


@pytest.mark.parametrize(
    ("rate", "speed", "still"),
    [
        ("-4*x - 0.4*v + w", "3.0", True),
        ("-4*x - 0.4*v + sin(t)", "3.0", False),  # with time in any place it is not looked at where
        ("-4*x - 0.4*v - sin(t)*x + w", "3.0", False),
        ("-4*x - 0.4*v - tanh(v) + w", "3.0", False),
        ("-4*x - 0.4*v + h", "3.0", True),
        ("-4*x - 0.4*v + h", "3.0 + t", False),
    ],
)
def test_gains_that_may_move_are_not_said_to_stand_still(rate, speed, still):
    parts = [f'name = "oscillator"\n[rates]\nx = "v"\nv = "{rate}"']
    if rate.endswith("w"):
        parts.append("[noise]\nw = 1.0")
    if rate.endswith("h"):
        parts.append('[contacts]\nh = {}\n[ground]\nkind = "iso8608"\ngd = 1e-6\nn0 = 0.1\ncutoff = 0.01')
        parts.append(f'[travel]\nspeed = "{speed}"')
    assert choice.stands_still(cs.compile(toml("\n".join(parts))).functions) == still


@pytest.mark.parametrize("path", half(SHIPPED), ids=lambda path: path.stem)
def test_many_runs_start_as_each_alone_whichever_parameters_differ(path, shipped):
    """The start is found once where none that it depends on does."""
    compiled = shipped(path.stem)
    declared = compiled.parameter_vector()
    for column in range(len(declared)):
        p = np.tile(declared, (3, 1))
        p[:, column] *= (1.0, 1.01, 1.02)
        alone = [initial_moments(compiled.functions, own[None])[0] for own in p]
        np.testing.assert_array_equal(initial_moments(compiled.functions, p), alone)


@pytest.mark.parametrize("text", ["tanh(x)**2", "sqrt(1 + x**2)"])
def test_a_variance_that_rounding_alone_leaves_is_not_followed(text):
    """The gain of an even function is zero: what sums over nodes leave of it made every step too long."""
    model = f"""
schema = 1
name = "what drifts with the square"
[rates]
x = "-x + u"
v = "-v + {text}"
[noise]
u = 1.0
[run]
duration = 0.5
points = 2
"""
    moments = cs.compile(loads(model)).propagate()
    assert moments.std["v"][-1] < 1e-12
    function = cs.element_function(cs.describing_function(symbol("x"), parse(text)))
    t, w = np.polynomial.legendre.leggauss(20)
    t, w = (t + 1) / 4, w / 4
    variances = (1 - np.exp(-2 * t)) / 2
    wanted = sum(b * np.exp(a - 0.5) * float(function(0, p, [])[0]) for a, b, p in zip(t, w, variances, strict=True))
    assert moments.mean["v"][-1] == pytest.approx(wanted, rel=1e-7)
