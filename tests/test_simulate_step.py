"""The step: what it knows of the ground within it, and how its error falls."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import oleo, toml

from cadet_sym.augmentation import augment
from cadet_sym.simulation.laws import stationary_covariance
from cadet_sym.simulation.plain import _Ground
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.streams import Streams, start_values
from cadet_sym.simulation.within import copy_rows, spread_within
from cadet_sym.simulation.workers import records_in_parts, records_of

C = np.array([[0.0, 1.0], [-0.4, -2.2]])
G = np.diag([0.0, 1.6])


def test_the_spread_within_a_step_is_known_in_closed_form():
    """For R(s) = exp(-|s|): c^2 = (1 - 2 (x - 1 + exp(-x))/x^2) / (2 (1 - exp(-x)))."""
    x = np.geomspace(0.05, 30.0, 40)
    c = spread_within(np.array([[-1.0]]), np.array([[2.0]]), np.eye(1), x)[:, 0]
    assert np.allclose(c**2, (1 - 2 * (x - 1 + np.exp(-x)) / x**2) / (2 * (1 - np.exp(-x))), rtol=2e-3)


def test_on_a_short_step_a_rough_state_spreads_by_one_over_root_six_and_a_smooth_one_like_a_line():
    c = spread_within(C, G, stationary_covariance(C, G), np.array([0.0, 1e-5, 1e-4]))
    assert np.allclose(c, [1 / np.sqrt(12), 1 / np.sqrt(6)], rtol=1e-3)
    assert np.allclose(spread_within(C, 0 * G, 0 * G, np.array([0.1])), 1 / np.sqrt(12))


WHEELS = """
[rates]
x = "v"
v = "-30*(x - (f + r)/2) - 2*v - 0.2*der(f, 2)"
[contacts]
f = {}
r = { setback = 0.7 }
[ground]
kind = "exponential"
sigma = 1.0
cutoff = 0.4
rolling_contact = 3.0
[travel]
speed = "2*t*(4 - t)/3"
[run]
duration = 4.0
points = 3
"""


def test_integrals_of_the_ground_are_what_adding_up_on_a_fine_grid_gives():
    """Under both wheels, which meet the same ground one after the other."""
    problem = Problem(augment(toml(WHEELS)), np.linspace(0.0, 4.0, 3))
    plan, grid = problem.plan(0.001)
    streams = [Streams.of(3, 0, 4, purpose) for purpose in range(plan.purposes)]
    road = _Ground(plan.ground, streams, start_values(plan.start, streams)[1])
    nodes = np.stack([road.node(k) for k in range(len(grid.time))])
    for each in problem.program.ground_rows:
        for a, source in enumerate(each.sources):
            state, integral = nodes[:, each.first + a], nodes[:, source]
            steps = np.diff(grid.place)[:, None]
            added = np.cumsum(0.5 * steps * (state[1:] + state[:-1]), axis=0)
            assert np.abs(integral[1:] - integral[0] - added).max() < 5e-3 * np.abs(added).max()


def test_an_integral_that_is_a_state_is_not_carried():
    system = augment(toml(WHEELS))
    rows = copy_rows(system, system.states)
    assert [each.carried for each in rows] == [(0,), (0,)]  # that of the slope is the height
    assert rows[1].sources == (rows[1].first + 2, rows[1].first)
    assert [each.size for each in copy_rows(system, [])] == [2, 2]


def bias(model, step: float, pairs: int, at: float):
    """What a step does to the variance of x beside half of it, relative, and its standard error."""
    problem = Problem(augment(model), np.array([at]))
    records = records_in_parts(problem.plan(step, paired=True)[0], "numba", 1, pairs)
    fine, coarse = ((each[0, 0] - each[0, 0].mean()) ** 2 for each in records)
    return (coarse - fine).mean() / fine.mean(), (coarse - fine).std() / np.sqrt(pairs) / fine.mean()


def test_a_ground_that_passes_quickly_keeps_its_spectrum():
    """A linear undercarriage at 80 m/s: its ground goes through a third of its correlation length in a step."""
    error, doubt = bias(oleo("R43C").with_parameters({"gamma": 0.0}), 2e-3, 2000, 10.0)
    assert doubt < 1e-3
    assert abs(error) < 1e-3 + 3 * doubt


def test_the_error_of_a_step_falls_with_its_square():
    (long, a), (short, b) = (bias(oleo("R43C"), step, 6000, 10.0) for step in (8e-3, 4e-3))
    assert abs(long) < 0.04
    assert abs(long - 4 * short) < 4 * np.hypot(a, 4 * b)


@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_a_wheel_that_stands_feels_still_ground(engine):
    model = toml(WHEELS.replace("2*t*(4 - t)/3", "0"))
    records, _ = records_of(Problem(augment(model), np.array([0.0, 2.0, 4.0])).plan(0.05)[0], engine, 0, 0, 20)
    assert np.isfinite(records).all()
    assert np.array_equal(records[0, 2:], records[-1, 2:])
