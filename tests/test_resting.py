"""What dry friction holds without any variance stays where it is, as the exact solution (in Filippov's sense) does."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import cadet_sym as cs
from cadet_sym.lowering.functions import MomentFunctions

pytest.importorskip("llvmlite")

x, v, x2, v2, z, w, t = sp.symbols("x v x2 v2 z w t")
SIGN = cs.Element("friction", [z], sp.sign(z))
TIMES = np.linspace(0, 5, 101)


def run(rates: dict, values: dict | None = None, **more) -> cs.MomentHistory:
    model = cs.Model(cs.Vehicle(rates=rates), initial=cs.Initial(values=values or {}), duration=5, **more)
    return cs.compile(model).propagate(TIMES)


def half_swings(times: np.ndarray, stiffness: float, friction: float, start: float) -> tuple[np.ndarray, np.ndarray]:
    """x'' = -k x - F sign(x'), half a swing about +-F/k after the other, until the spring no longer overcomes friction."""
    omega, least = np.sqrt(stiffness), friction / stiffness
    position, velocity, begin = np.full_like(times, start), np.zeros_like(times), 0.0
    while abs(start) > least:
        centre = np.sign(start) * least
        swing, phase = start - centre, omega * (times - begin)
        on = (phase >= 0) & (phase < np.pi)
        position[on], velocity[on] = centre + swing * np.cos(phase[on]), -swing * omega * np.sin(phase[on])
        start, begin = centre - swing, begin + np.pi / omega
        position[times >= begin] = start
    return position, velocity


@pytest.mark.parametrize("friction", [0.01, 1.0, 3.0, 20.0])
def test_an_oscillator_comes_to_rest_where_it_should(friction):
    history = run({x: v, v: -100 * x - friction * SIGN(v)}, {x: 0.1})
    position, velocity = half_swings(TIMES, 100.0, friction, 0.1)
    np.testing.assert_allclose(history.mean["x"], position, atol=1e-9)
    np.testing.assert_allclose(history.mean["v"], velocity, atol=1e-8)
    assert not history.state_covariance.any()
    if friction > 0.1:
        assert "elements seeing deviations of at least 1e-12" in history.provenance.engine


def test_a_mass_pushed_slowly_breaks_away_when_the_spring_overcomes_friction():
    history = run({x: v, v: 100 * (0.05 * t - x) - v - 2 * SIGN(v)})
    away, later = 2 / (100 * 0.05), TIMES[TIMES > 0.4]
    exact = solve_ivp(
        lambda t, y: [y[1], 100 * (0.05 * t - y[0]) - y[1] - 2], (away, 5), [0, 0], "DOP853", later, rtol=1e-11, atol=1e-14
    )
    assert np.abs(history.mean["x"][TIMES < 0.4]).max() < 1e-12
    np.testing.assert_allclose(history.mean["x"][TIMES > 0.4], exact.y[0], atol=2e-8)


def test_masses_rest_on_each_other_and_on_the_ground():
    force = 3 * SIGN(v - v2)
    rates = {x: v, v: -100 * x - 2 * v - force - SIGN(v), x2: v2, v2: -400 * x2 - 4 * v2 + force - SIGN(v2)}
    history = run(rates, {x: 0.1})
    push = 400 * history.mean["x2"][-1], 100 * history.mean["x"][-1]
    np.testing.assert_allclose(history.state_mean[-20:], history.state_mean[-1:].repeat(20, axis=0), atol=1e-10)
    assert abs(sum(push)) <= 2  # what friction can hold
    assert max(map(abs, push)) <= 4
    assert abs(history.mean["x"][-1]) > 1e-4


def test_friction_takes_all_variance_in_finite_time_once_noise_stops():
    until = sp.Piecewise((1, t < 2), (0, True))
    rates = {x: v, v: -100 * x - v - SIGN(v) + until * w}
    history = run(rates, noise=cs.Noise(names=("w",), intensity=sp.Matrix([[0.1]])))
    lasting = run({x: v, v: -100 * x - v - SIGN(v) + w}, noise=cs.Noise(names=("w",), intensity=sp.Matrix([[0.1]])))
    noisy = TIMES <= 2
    np.testing.assert_allclose(history.variance["v"][noisy], lasting.variance["v"][noisy], rtol=1e-6)
    assert history.variance["v"][-1] < 1e-20


def test_a_relay_slides_along_its_switching_line():
    """x'' = -sign(x + x'/2): once on the line x' = -2 x, where the control is strong enough, the motion stays there."""
    history = run({x: v, v: -SIGN(x + v / 2)}, {x: 0.1})
    sliding = TIMES > 1
    np.testing.assert_allclose(history.mean["v"][sliding], -2 * history.mean["x"][sliding], atol=1e-9)
    late, early = history.mean["x"][60], history.mean["x"][40]
    assert late == pytest.approx(early * np.exp(-2 * (TIMES[60] - TIMES[40])), rel=1e-5)


def test_the_resting_rate_is_the_rate_as_the_least_deviations_vanish():
    vehicle = cs.Vehicle(rates={x: v, v: -100 * x - v**3 - SIGN(v) + w})
    model = cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=1)
    functions: MomentFunctions = cs.compile(model).functions
    y = np.array([0.1, -0.2, 0.3, 0.05, 0.4])
    plain = np.asarray(functions.rate(0, y, [])).ravel()
    np.testing.assert_allclose(np.asarray(functions.resting_rate(0, y, [0, 0])).ravel(), plain, rtol=1e-14)
    wider = np.asarray(functions.resting_rate(0, y, [0.01, 0.02])).ravel()
    mean = np.asarray(functions.rate(0, y + np.array([0, 0, 0.01, 0, 0.02]), [])).ravel()[:2]
    np.testing.assert_allclose(wider[:2], mean, rtol=1e-14)
