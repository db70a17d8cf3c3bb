"""The ground under the wheels: its exact law, shared tracks, starts, and the white noise it kicks the vehicle with."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from reference_models import toml
from scipy.linalg import expm, solve_continuous_lyapunov

import cadet_sym as cs
from cadet_sym.augmentation import augment
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE
from cadet_sym.simulation.laws import covariance_factor, exact_law, stationary_covariance
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.workers import records_of

C = np.array([[0.0, 1.0], [-0.4, -2.2]])
G = np.diag([0.0, 1.6])


def test_the_law_of_a_step_is_the_matrix_exponential_and_its_integral():
    d = np.array([0.0, 1e-9, 1e-3, 0.7, 40.0])
    phi, sigma = exact_law(C, G, d)
    P = solve_continuous_lyapunov(C, -G)
    for k, length in enumerate(d):
        E = expm(C * length)
        assert np.allclose(phi[k], E, rtol=1e-12, atol=1e-14)
        assert np.allclose(sigma[k], P - E @ P @ E.T, rtol=1e-9, atol=1e-13)
    assert np.array_equal(phi[0], np.eye(2))
    assert not sigma[0].any()


def test_a_tiny_step_keeps_its_relative_accuracy():
    _, sigma = exact_law(C, G, np.array([1e-4]))
    expected = 1.6 * np.array([[1e-12 / 3, 1e-8 / 2], [1e-8 / 2, 1e-4]])
    assert np.allclose(sigma[0], expected, rtol=3e-4)


def test_two_steps_are_one():
    (a, b), (sa, sb) = exact_law(C, G, np.array([0.3, 0.5]))
    whole, sigma = exact_law(C, G, np.array([0.8]))
    assert np.allclose(b @ a, whole[0], rtol=1e-13)
    assert np.allclose(sb + b @ sa @ b.T, sigma[0], rtol=1e-13)


def test_factors_of_singular_covariances():
    rng = np.random.default_rng(0)
    for rank in (0, 1, 2, 3):
        half = rng.normal(size=(5, 3, rank)) * np.array([1e-6, 1.0, 1e3])[:, None]
        sigma = half @ np.swapaxes(half, -1, -2)
        L = covariance_factor(sigma)
        assert np.allclose(L @ np.swapaxes(L, -1, -2), sigma, rtol=1e-7, atol=1e-20)
        assert not np.triu(L, 1).any()


def test_an_integrated_road_has_no_stationary_start():
    with pytest.raises(ModelError, match="smooth.*cutoff"):
        stationary_covariance(np.zeros((1, 1)), np.eye(1))


WHEELS = """
[rates]
x = "0"
[contacts]
front = {{}}
rear = {{ setback = 1.5 }}
near = {{ setback = 0.25 }}
other = {{ track = "right" }}
[ground]
kind = "exponential"
sigma = 1.3
cutoff = 0.4
rolling_contact = 3.0
[travel]
speed = "{speed}"
[initial]
ground = "{ground}"
[run]
duration = 4.0
points = {points}
"""
P0 = np.diag([1.3**2 * 3.0 / 3.4, 1.3**2 * 0.4 * 3.0**2 / 3.4])  # of height and slope under a rolling contact


def ground(speed="1.0", start="stationary", points=41, paths=4000, step=0.05, engine="numba"):
    system = augment(toml(WHEELS.format(speed=speed, ground=start, points=points)))
    problem = Problem(system, np.linspace(0.0, 4.0, points))
    plan, grid = problem.plan(step)
    records, _ = records_of(plan, engine, 1, 0, paths)
    return {name: records[:, k] for k, name in enumerate(problem.names)}, grid.place[grid.output]


def test_the_rear_wheel_meets_what_the_front_wheel_met():
    rows, place = ground()
    assert np.allclose(place, np.linspace(0.0, 4.0, 41))
    assert np.array_equal(rows["rear.height"][15:], rows["front.height"][:-15])
    assert np.array_equal(rows["rear.slope"][15:], rows["front.slope"][:-15])


def test_wheels_meet_the_same_ground_at_any_speed():
    rows, place = ground(speed="2*t*(4 - t)/5", points=9, paths=20_000)
    n = 20_000
    C_ = np.array([[0.0, 1.0], [-1.2, -3.4]])
    for k in (0, 3, 8):
        xi = {w: np.stack([rows[f"{w}.height"][k], rows[f"{w}.slope"][k]]) for w in ("front", "rear", "near", "other")}
        for w in xi:
            assert np.allclose(
                xi[w] @ xi[w].T / n, P0, atol=5 * np.sqrt(2 / n) * np.sqrt(np.outer(P0.diagonal(), P0.diagonal())).max()
            )
        for ahead, behind, gap in (("front", "rear", 1.5), ("near", "rear", 1.25), ("front", "near", 0.25)):
            expected = expm(C_ * gap) @ P0
            size = np.sqrt(np.outer(P0.diagonal(), P0.diagonal()))
            assert (np.abs(xi[ahead] @ xi[behind].T / n - expected) < 5 * size / np.sqrt(n / 2)).all()
        assert (np.abs(xi["front"] @ xi["other"].T / n) < 5 * np.sqrt(np.outer(P0.diagonal(), P0.diagonal()) / n)).all()
    assert place[-1] == pytest.approx(2 / 5 * (4 * 8 - 64 / 3))


def test_a_vehicle_at_rest_stands_on_still_ground():
    rows, _ = ground(speed="0 if t < 2 else 3*(t - 2)", points=9, paths=64)
    for name in ("front.height", "rear.slope", "other.height"):
        assert (rows[name][:5] == rows[name][0]).all()
        assert (rows[name][5] != rows[name][0]).all()


def test_smooth_ground_is_flat_until_a_wheel_has_left_it():
    rows, place = ground(start="smooth", paths=64)
    for wheel, setback in (("front", 0.0), ("near", 0.25), ("rear", 1.5)):
        flat = place <= setback + 1e-12
        assert not rows[f"{wheel}.height"][flat].any()
        assert rows[f"{wheel}.height"][place > setback + 0.09].all()
    assert np.array_equal(rows["rear.height"][15:], rows["front.height"][:-15])


KICK = """
[rates]
y = "-der(h, 2)"
z = "-der(h, 2)/2 - 0.3*(z + h)"
[contacts]
h = {{ setback = 0.0 }}
[ground]
{ground}
[travel]
speed = "{speed}"
[initial]
ground = "smooth"
[run]
duration = 3.0
points = 7
"""
GROUNDS = {
    "rolling": 'kind = "exponential"\nsigma = 1.0\ncutoff = 0.4\nrolling_contact = 3.0',
    "two noises": (
        'kind = "shaping_filter"\nrates = { a = "-a + b + w1 - w2", b = "-2*b + w2", u = "3*(2*a + b - u)" }\n'
        'noise = { names = ["w1", "w2"], intensity = [[1.0, 0.3], [0.3, 2.0]] }\nheight = "u"'
    ),
    "inhomogeneous": (
        'kind = "shaping_filter"\nrates = { a = "-(1 + s/10)*a + w", u = "(3 + sin(s))*(a - u)" }\n'
        'noise = { w = "2 + cos(s)" }\nheight = "u"'
    ),
    "with a profile": (
        'kind = "exponential"\nsigma = 1.0\ncutoff = 0.4\nrolling_contact = 3.0\nprofile = "s*s/(1 + s)/9 if s > 0 else 0"'
    ),
}


@pytest.mark.parametrize("road", GROUNDS)
def test_white_noise_of_the_ground_enters_a_rate_as_the_increment_of_its_slope(road):
    system = augment(toml(KICK.format(ground=GROUNDS[road], speed="2 + 3*t")))
    problem = Problem(system, np.linspace(0.0, 3.0, 7))
    plan, _ = problem.plan(0.01)
    records, _ = records_of(plan, "numpy", 1, 0, 50)
    rows = dict(zip(problem.names, np.swapaxes(records, 0, 1), strict=True))
    V, s = ((2 + 3 * problem.times)[:, None], (2 * problem.times + 1.5 * problem.times**2)[:, None])
    slope = {
        "rolling": lambda: rows["h.slope"],
        "two noises": lambda: 3 * (2 * rows["h.a"] + rows["h.b"] - rows["h.u"]),
        "inhomogeneous": lambda: (3 + np.sin(s)) * (rows["h.a"] - rows["h.u"]),
        "with a profile": lambda: rows["h.slope"] + 3 * s**2 / (1 + s) / 9,
    }[road]()
    # Exact to rounding where V' is constant; the profile's own curvature is stepped by the trapezoidal rule.
    accuracy = 1e-3 if road == "with a profile" else 1e-8
    assert np.abs(rows["y"] + V * slope).max() < accuracy * np.abs(V * slope).max()


def test_a_profile_drives_the_vehicle_like_any_input():
    """A linear vehicle over a bump, against an integration of the same equations in time."""
    from scipy.integrate import solve_ivp

    system = augment(
        toml(
            """
            [rates]
            x = "v"
            v = "-9*(x - h) - 0.6*(v - der(h))"
            [contacts]
            h = { setback = 0.5 }
            [ground]
            kind = "shaping_filter"
            rates = { u = "4*(0 - u)" }
            height = "u"
            profile = "0.2*s*(2 - s) if s < 2 else 0"
            [travel]
            speed = "1 + t"
            [run]
            duration = 4.0
            points = 9
            """
        )
    )

    def height(s):
        return np.where((s > 0) & (s < 2), 0.2 * s * (2 - s), 0.0)

    def slope(s):
        return np.where((s > 0) & (s < 2), 0.4 - 0.4 * s, 0.0)

    def rate(t, y):
        s = t + t * t / 2 - 0.5
        return [y[1], -9 * (y[0] - height(s)) - 0.6 * (y[1] - (1 + t) * slope(s))]

    edges = [0.0, np.sqrt(2) - 1, np.sqrt(6) - 1, 4.0]
    y, expected, times = np.zeros(2), [], np.linspace(0.0, 4.0, 9)
    for a, b in pairwise(edges):
        inside = [t for t in times if a <= t < b]
        run = solve_ivp(rate, (a, b - 1e-12), y, rtol=1e-10, atol=1e-12, t_eval=[*inside, b - 1e-12])
        expected += list(run.y[:, :-1].T)
        y = run.y[:, -1]
    expected.append(y)
    problem = Problem(system, times)
    plan, _ = problem.plan(0.002)
    records, _ = records_of(plan, "numpy", 0, 0, 2)
    assert np.allclose(records[:, :2, 0], expected, atol=5e-5)


def test_a_profile_reaches_the_wheels_through_the_rolling_contact():
    """u' = b (g - u) along the road, from what lies behind the wheel at the start."""
    text = WHEELS.format(speed=2, ground="stationary", points=7).replace("sigma = 1.3", "sigma = 1e-9")
    system = augment(toml(text.replace("[travel]", 'profile = "cos(s) if s > -100 else 0"\n[travel]')))
    problem = Problem(system, np.linspace(0.0, 4.0, 7))
    records, _ = records_of(problem.plan(0.01)[0], "numpy", 0, 0, 2)
    for wheel, setback in (("front", 0.0), ("rear", 1.5)):
        s = 2 * problem.times - setback
        expected = 3 * (3 * np.cos(s) + np.sin(s)) / 10
        assert np.allclose(records[:, problem.names.index(f"{wheel}.height"), 0], expected, atol=1e-7)


def test_a_wheel_set_back_starts_on_the_ground_where_it_is():
    """It started on that under the origin: on ground that varies, four times the variance here."""
    x, a = sp.symbols("x a")
    road = cs.exponential(0.02 * (1 + sp.sin(DISTANCE / 3) / 2), 0.3)
    vehicle = cs.Vehicle({x: -x + a}, {a: cs.Contact(setback=5)})
    model = cs.Model(vehicle, road, cs.Travel(speed=8.0), duration=1)
    truth = cs.simulate(model, paths=2000, seed=1, times=[1e-3, 0.5])
    history = cs.compile(model).propagate(truth.time)
    wanted = (0.02 * (1 + np.sin(-5 / 3) / 2)) ** 2
    assert history.variance["a.height"][0] == pytest.approx(wanted, rel=1e-2)
    off = history.variance["a.height"] - truth.variance["a.height"]
    assert (np.abs(off) < 4 * truth.variance_standard_error["a.height"]).all()
