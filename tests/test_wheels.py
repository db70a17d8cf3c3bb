"""Three axles on one track against integrals that know nothing of grids, and half a car against its own simulation."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from conftest import ROOT
from reference_models import toml
from scipy.integrate import quad

import cadet_sym as cs

ALPHA, BETA = 0.2, 2.0
SETBACKS = (0.0, 1.7, 4.6)
OMEGA, ZETA = 10.0, 0.1


def three_axles(speed: str, duration: float = 4.0, damper: float = 0.0) -> cs.Model:
    quadratic = f" - {damper}*(v**2 if v > 0 else -0.5*v**2)" if damper else ""
    return toml(
        f"""
        name = "three axles"
        [rates]
        x = "v"
        v = "-{OMEGA**2}*x - {2 * ZETA * OMEGA}*v + {OMEGA**2}*(h1 + h2 + h3)/3{quadratic}"
        [contacts]
        h1 = {{}}
        h2 = {{ setback = {SETBACKS[1]} }}
        h3 = {{ setback = {SETBACKS[2]} }}
        [ground]
        kind = "exponential"
        sigma = 1.0
        cutoff = {ALPHA}
        rolling_contact = {BETA}
        [travel]
        speed = "{speed}"
        [run]
        duration = {duration}
        """
    )


def autocovariance(d: np.ndarray) -> np.ndarray:
    """Of the rolled exponential ground: its spectrum is proportional to 1/((k^2 + a^2)(k^2 + b^2))."""
    d = np.abs(d)
    return BETA * (BETA * np.exp(-ALPHA * d) - ALPHA * np.exp(-BETA * d)) / (BETA**2 - ALPHA**2)


@pytest.mark.parametrize("speed", [3.0, 12.0])
def test_three_axles_at_constant_speed_against_the_spectral_integral(speed):
    def density(kappa: float) -> float:
        w = kappa * speed
        ground = 2 * ALPHA * BETA**2 / ((kappa**2 + ALPHA**2) * (kappa**2 + BETA**2)) / np.pi
        wheels = sum(np.exp(-1j * kappa * L) for L in SETBACKS) / 3
        return ground * abs(wheels * OMEGA**2 / (OMEGA**2 - w**2 + 2j * ZETA * OMEGA * w)) ** 2

    peak = OMEGA / speed
    edges = sorted([0.0, 0.05, 0.2, 1.0, *(factor * peak for factor in (0.8, 1.0, 1.2, 3.0, 10.0, 100.0))])
    parts = [quad(density, a, b, epsabs=1e-14, epsrel=1e-12, limit=400)[0] for a, b in pairwise(edges)]
    found = cs.compile(three_axles(str(speed))).stationary(speed=speed)
    assert found.variance["x"] == pytest.approx(sum(parts), rel=1e-8)
    assert found.stable


def test_three_axles_from_rest_against_the_double_integral_over_the_autocovariance():
    model = three_axles("2*t")
    history = cs.compile(model).propagate([1.0, 2.0, 4.0], rtol=1e-9)
    damped = OMEGA * np.sqrt(1 - ZETA**2)
    nodes, weights = np.polynomial.legendre.leggauss(10)
    wanted = []
    for t in history.time:
        edges = np.linspace(0.0, t, 81)
        half = np.diff(edges)[:, None] / 2
        tau = (edges[:-1, None] + half * (nodes + 1)).ravel()
        w = (half * weights).ravel() * OMEGA**2 * np.exp(-ZETA * OMEGA * (t - tau)) * np.sin(damped * (t - tau)) / damped
        s = tau**2
        pairs = product(SETBACKS, repeat=2)
        ground = sum(autocovariance(s[:, None] - a - s[None, :] + b) for a, b in pairs) / 9
        wanted.append(w @ ground @ w)
    np.testing.assert_allclose(history.variance["x"], wanted, rtol=1e-5, atol=1e-6 * max(wanted))


def half_car(gamma: float) -> cs.Model:
    return cs.load(ROOT / "models" / "half_car_acceleration.toml").with_parameters({"gamma": gamma})


NONLINEAR = {"half car": lambda: half_car(2000.0), "three axles": lambda: three_axles("3*t", damper=0.1)}
LINEAR = {"half car": lambda: half_car(0.0), "three axles": lambda: three_axles("3*t")}


def discrepancies(model: cs.Model, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """How far means and variances of what the vehicle does lie from a plain simulation of it, the ground delayed exactly: in
    standard errors, and those of the variances as a share of them."""
    times = np.linspace(0, model.number(model.run.duration), 6)[1:]
    history = cs.compile(model).propagate(times)
    truth = cs.simulate(model, paths=paths, seed=seed, times=times, control=False)
    names = [*truth.states[: len(model.vehicle.rates)], *truth.outputs]
    found = [(history.mean[n] - truth.mean[n]) / truth.mean_standard_error[n] for n in names]
    found += [(history.variance[n] - truth.variance[n]) / truth.variance_standard_error[n] for n in names]
    share = [history.variance[n] / truth.variance[n] - 1.0 for n in names]
    return np.abs(np.ravel(found)), np.abs(np.ravel(share))


def inside(errors: np.ndarray) -> bool:
    """Inside 99 % limits, as often as chance allows for so many, and nowhere far outside."""
    return bool(np.mean(errors > 2.576) <= 0.05 and errors.max() < 4.0)


@pytest.mark.parametrize("vehicle", NONLINEAR)
@pytest.mark.slow
def test_a_nonlinear_vehicle_accelerating_lies_inside_the_limits_of_its_simulation(vehicle):
    assert inside(discrepancies(NONLINEAR[vehicle](), 1000, 4)[0])


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", LINEAR)
def test_a_linear_vehicle_accelerating_lies_inside_the_limits_of_many_paths(vehicle):
    """Nothing is approximated: what is left is the delay."""
    assert inside(discrepancies(LINEAR[vehicle](), 20_000, 5)[0])


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", NONLINEAR)
def test_against_many_paths_only_the_shape_of_the_distribution_is_missed(vehicle):
    """The describing functions take it for Gaussian, which costs a few per cent of a variance (theory.md)."""
    errors, share = discrepancies(NONLINEAR[vehicle](), 20_000, 6)
    assert share.max() < 0.05
    assert np.median(errors) < 2.0


def test_wheels_on_ground_that_varies_start_on_one_and_the_same_ground():
    model = toml(
        """
        name = "three wheels"
        [rates]
        x = "v"
        v = "-60*x - 3*v + 20*(a + b + c)"
        [contacts]
        a = {}
        b = { setback = 1.7 }
        c = { setback = 3.0 }
        [ground]
        kind = "shaping_filter"
        rates = { h = "p", p = "-3*p - 2*h + w*(1 + 0.5*sin(s))" }
        noise = { w = 1e-3 }
        height = "h"
        [travel]
        speed = "4 + t"
        [run]
        duration = 3.0
        """
    )
    with pytest.warns(RuntimeWarning, match="the ground at the start is not the same under all wheels of a track") as told:
        history = cs.compile(model).propagate(np.linspace(0, 3, 7))
    assert told[0].filename == __file__  # where it was asked for
    P = history.state_covariance
    assert (np.linalg.eigvalsh(P)[:, 0] >= -1e-12 * np.trace(P, axis1=1, axis2=2)).all()
    with pytest.warns(RuntimeWarning, match="the ground at the start"):
        truth = cs.simulate(model, paths=4000, seed=2, times=[1.0, 3.0])
    for name in truth.states:
        found = np.interp([1.0, 3.0], history.time, history.variance[name])
        assert (np.abs(found - truth.variance[name]) < 4 * truth.variance_standard_error[name]).all(), name


@pytest.mark.parametrize(
    ("q", "start", "error"),
    [
        ("64e-6 if s < 6 else 1024e-6", "stationary", 2e-2),
        ("64e-6 if s < 6 else 1024e-6", "smooth", 2e-2),
        ("1e-4*(1 + 0.5*sin(s))", "smooth", 1e-5),
    ],
)
def test_noise_that_varies_along_the_road_is_the_same_as_its_amplitude(q, start, error):
    """E[w w'] = q(s) delta, or sqrt(q(s)) w with E[w w'] = delta: behind a change of class each wheel meets its own q.

    A jump of the amplitude is one of the correlation with the ground between the wheels, which a grid does not resolve.
    """
    found = []
    for rate, intensity in (("-0.5*h + w", q), (f"-0.5*h + w*sqrt({q})", "1.0")):
        model = toml(
            f"""
            name = "three wheels"
            [rates]
            x = "v"
            v = "-60*x - 3*v - v*abs(v) + 20*(a + b + c)"
            [contacts]
            a = {{}}
            b = {{ setback = 1.7 }}
            c = {{ setback = 3.0 }}
            [ground]
            kind = "shaping_filter"
            rates = {{ h = "{rate}" }}
            noise = {{ w = "{intensity}" }}
            height = "h"
            [travel]
            speed = "4 + t"
            [initial]
            ground = "{start}"
            [run]
            duration = 3.0
            """
        )
        found.append(cs.compile(model, grid=(8, 10)).propagate(np.linspace(0, 3, 13)).state_covariance)
    P, other = found
    size = np.sqrt(np.diagonal(P, axis1=1, axis2=2).max(axis=0))
    assert (np.abs(P - other) / np.outer(size, size)).max() < error
    assert (np.linalg.eigvalsh(P)[:, 0] >= -1e-9 * np.trace(P, axis1=1, axis2=2)).all()
