"""Moments that repeat: against closed forms of linear systems, and against the end of a long run."""

import json

import numpy as np
import pytest
import sympy as sp

import cadet_sym as cs
from cadet_sym.cli import main

x, v, w, t, h = sp.symbols("x v w t h")
OMEGA = 2.0
T = 2 * np.pi / OMEGA


def model(rates, noise, **more):
    return cs.compile(cs.Model(cs.Vehicle(rates=rates), noise=noise, name="cycle", **more))


def test_harmonic_forcing_of_a_linear_system():
    """x' = -a x + cos(omega t) + w: mean (a cos + omega sin) / (a^2 + omega^2), variance Q / 2a, multipliers of e^-aT."""
    a, Q = 0.7, 0.3
    found = model({x: -a * x + sp.cos(OMEGA * t) + w}, {w: Q}).periodic(T)
    time = found.time
    expected = (a * np.cos(OMEGA * time) + OMEGA * np.sin(OMEGA * time)) / (a**2 + OMEGA**2)
    np.testing.assert_allclose(found.mean["x"], expected, atol=1e-7)
    np.testing.assert_allclose(found.variance["x"], Q / (2 * a), rtol=1e-7)
    np.testing.assert_allclose(found.multipliers, [np.exp(-a * T), np.exp(-2 * a * T)], rtol=1e-6)
    assert found.stable


def test_a_coefficient_that_swings():
    """x' = -(a + b cos(omega t)) x + w: P by the integral of its linear equation over one period."""
    a, b, Q = 0.7, 2.0, 0.3
    found = model({x: -(a + b * sp.cos(OMEGA * t)) * x + w}, {w: Q}).periodic(T, points=9)

    def decay(s, u):  # of a variance from s to u
        return np.exp(-2 * (a * (u - s) + b / OMEGA * (np.sin(OMEGA * u) - np.sin(OMEGA * s))))

    nodes, weights = np.polynomial.legendre.leggauss(60)
    for time, variance in zip(found.time, found.variance["x"], strict=True):
        s = time - T + T * (nodes + 1) / 2
        fresh = Q * T / 2 * weights @ decay(s, time)
        np.testing.assert_allclose(variance, fresh / (1 - decay(time - T, time)), rtol=1e-7)


def test_noise_that_swings():
    """P' = -2 a P + Q (1 + cos(omega t))."""
    a, Q = 0.7, 0.3
    found = model({x: -a * x + w}, {w: Q * (1 + sp.cos(OMEGA * t))}).periodic(T)
    swing = (2 * a * np.cos(OMEGA * found.time) + OMEGA * np.sin(OMEGA * found.time)) / (4 * a**2 + OMEGA**2)
    np.testing.assert_allclose(found.variance["x"], Q * (1 / (2 * a) + swing), rtol=1e-7)


def mathieu(depth, eps):
    stiffness = 1 + depth * sp.cos(OMEGA * t)
    return model({x: v, v: -0.2 * v - stiffness * x - eps * x**3 + 0.5 * sp.cos(OMEGA * t) + w}, {w: 0.2})


def test_a_parametrically_excited_duffing_oscillator_ends_there():
    compiled = mathieu(0.3, 0.5)
    found = compiled.periodic(T, points=11)
    long = compiled.propagate(60 * T + found.time, rtol=1e-10)
    for name in ("x", "v"):
        np.testing.assert_allclose(found.mean[name], long.mean[name], atol=1e-7)
        np.testing.assert_allclose(found.variance[name], long.variance[name], rtol=1e-7)
    assert found.stable
    assert found.residual < 1e-7
    assert found.state_covariance[0] == pytest.approx(found.state_covariance[-1], rel=1e-7)


def test_resonance_without_a_limit_is_a_failure_that_names_its_multiplier():
    with pytest.raises(cs.SolverError, match="Floquet multiplier") as caught:
        mathieu(0.9, 0.0).periodic(T)
    assert abs(caught.value.details["multipliers"][0]) > 1


def test_a_hardening_spring_limits_the_same_resonance():
    compiled = mathieu(0.9, 1.0)
    found = compiled.periodic(T, points=5)
    long = compiled.propagate(np.append(np.arange(30) * T, 30 * T + found.time), engine="explicit")
    np.testing.assert_allclose(found.variance["x"], long.variance["x"][-5:], rtol=1e-5)


def test_a_vehicle_whose_speed_swings():
    vehicle = cs.Vehicle(rates={x: v, v: -4 * x - v - cs.der(h, 2)}, contacts={h: cs.Contact()})
    ground = cs.exponential(sigma=1, cutoff=0.2).rolling_contact(cutoff=2)
    compiled = cs.compile(cs.Model(vehicle, ground, cs.Travel(speed=10 + 3 * sp.cos(OMEGA * t)), name="swing"))
    found = compiled.periodic(T, points=5)
    long = compiled.propagate(30 * T + found.time, rtol=1e-10)
    np.testing.assert_allclose(found.variance["x"], long.variance["x"], rtol=1e-6)
    np.testing.assert_allclose(found.variance["h.height"], long.variance["h.height"], rtol=1e-7)


def test_a_drift_is_named():
    with pytest.raises(cs.SolverError, match="multiplier of one") as caught:
        model({x: v, v: -v + sp.cos(OMEGA * t) + w}, {w: 1}).periodic(T)
    assert "`x`" in str(caught.value)


@pytest.mark.parametrize(
    ("period", "message"), [(T / 2, "do not have the period"), (-1.0, "above zero"), (np.nan, "finite")]
)
def test_wrong_periods_are_refused(period, message):
    with pytest.raises(cs.ModelError, match=message):
        model({x: -x + sp.cos(OMEGA * t) + w}, {w: 1}).periodic(period)


def test_wheels_in_one_track_are_refused():
    with pytest.raises(cs.ModelError, match="on one track"):
        cs.compile("models/half_car.toml").periodic(1.0)


def test_the_command_prints_a_period(tmp_path, capsys):
    path = tmp_path / "forced.toml"
    path.write_text(
        'schema = 1\nname = "Forced"\n[rates]\nx = "-x + cos(2*t) + w"\n[noise]\nw = "1"\n', encoding="utf-8"
    )
    assert main(["moments", str(path), "--period", repr(T), "--points", "5"]) == 0
    assert "stable, largest Floquet multiplier 0.0432" in capsys.readouterr().out
    assert main(["moments", str(path), "--period", repr(T), "--json", "--save", str(tmp_path / "a.nc")]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["stable"]
    assert content["mean"][0][0] == pytest.approx(0.2)
    assert main(["moments", str(path), "--period", "1", "--duration", "2"]) == 2
