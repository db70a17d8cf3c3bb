"""The step: what it knows of the ground within it, and how its error falls."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import oleo, toml

import cadet_sym as cs
from cadet_sym.augmentation import augment
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.simulation import simulate
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


STIFF = """
[rates]
zs = "vs"
zu = "vu"
vs = "-20*(zs - zu) - 2*(vs - vu) - 0.03*abs(vs - vu)*(vs - vu)"
vu = "100*(zs - zu) + 10*(vs - vu) - 900000*(zu - h) - 300*(vu - der(h)) + w"
slow = "-100000*(slow - zs) + 300*w"
[noise]
w = 0.4
[contacts]
h = {}
[ground]
kind = "exponential"
sigma = 0.5
cutoff = 0.3
rolling_contact = 2.0
[travel]
speed = "10"
[run]
duration = 10.0
points = 3
"""
LINEAR = STIFF.replace(" - 0.03*abs(vs - vu)*(vs - vu)", "")


def stiff_covariance() -> np.ndarray:
    """Of (zs, zu, vs, vu, slow, u, q), linear, stationary."""
    A, Q, V, a, b = np.zeros((7, 7)), np.zeros((7, 7)), 10.0, 0.3, 2.0
    A[0, 2] = A[1, 3] = 1.0
    A[2, :4] = [-20, 20, -2, 2]
    A[3, [0, 1, 2, 3, 5, 6]] = [100, -900_100, 10, -310, 900_000, 300 * V]
    A[4, [0, 4]] = [100_000, -100_000]
    A[5, 6] = V
    A[6, 5:] = [-V * a * b, -V * (a + b)]
    Q[np.ix_([3, 4], [3, 4])] = 0.4 * np.outer([1.0, 300.0], [1.0, 300.0])
    Q[6, 6] = V * b * b * 2 * a * 0.25
    return stationary_covariance(A, Q)


def test_a_stiff_linear_vehicle_takes_long_steps_and_has_the_covariance_of_its_lyapunov_equation():
    """A tyre of 150 Hz and a relaxation of 1e5 1/s, in steps of 10 ms: Heun's rule would need some of 1e-5 s."""
    model = toml(LINEAR)
    run = simulate(model, 8000, seed=1, step=0.01, check_step=False)
    assert run.scheme == "exponential"
    P = stiff_covariance()
    for k, name in enumerate(("zs", "zu", "vs", "slow")):
        truth = P[k, k] if name != "slow" else P[4, 4]
        assert abs(run.variance[name][-1] - truth) < 4 * run.variance_standard_error[name][-1], name
    with pytest.raises(SolverError, match="diverged"):
        simulate(model, 50, seed=1, step=0.01, check_step=False, scheme="heun")


@pytest.mark.parametrize("text", [STIFF, WHEELS], ids=["noises and a relaxation", "two wheels"])
def test_the_exponential_rule_is_the_same_by_numba_and_numpy(text):
    problem = Problem(augment(toml(text)), np.array([0.0, 0.5, 1.0]), scheme="exponential")
    plan, _ = problem.plan(0.013, paired=True)
    for a, b in zip(*(records_of(plan, engine, 1, 3, 21) for engine in ("numba", "numpy")), strict=True):
        assert (np.abs(a - b) <= 1e-9 * np.abs(b).max(axis=(0, 2), keepdims=True)).all()


def test_the_exponential_rule_is_heuns_where_nothing_is_linear():
    text = WHEELS.replace("-30*(x - (f + r)/2) - 2*v", "-abs(v)*v - (x - (f + r)/2)**3").replace('x = "v"', 'x = "sin(v)"')
    model = toml(text.replace("2*t*(4 - t)/3", "3"))
    plans = [Problem(augment(model), np.array([2.0]), scheme=scheme).plan(0.01)[0] for scheme in ("heun", "exponential")]
    heun, exponential = (records_of(plan, "numpy", 1, 0, 30)[0] for plan in plans)
    assert np.allclose(heun, exponential, rtol=1e-9, atol=1e-12)


def test_both_rules_tell_the_same_paths():
    """On the same ground; speeds, kicks and coefficients that vary."""
    text = WHEELS.replace("- 2*v", "- (2 + t)*v - v*abs(v)")
    plans = [Problem(augment(toml(text)), np.array([4.0]), scheme=scheme).plan(0.002)[0] for scheme in ("heun", "exponential")]
    heun, exponential = (records_of(plan, "numpy", 1, 0, 30)[0] for plan in plans)
    size = heun[0, :2].std(axis=1, keepdims=True)
    assert np.abs(heun - exponential)[0, :2].max() < (2e-4 * size).max()
    assert np.array_equal(heun[0, 2:], exponential[0, 2:])


def test_a_step_that_is_two_carries_the_noise_of_the_first_through_the_second():
    """Linear, driven by noise alone: nothing but chance, and both steps meet the same."""
    text = STIFF[: STIFF.index("[contacts]")].replace("900000*(zu - h)", "900*zu").replace("300*(vu - der(h))", "3*vu")
    text = text.replace(" - 0.03*abs(vs - vu)*(vs - vu)", "").replace("100000", "50")
    model = toml(text + "[run]\nduration = 2.0\npoints = 3")
    plan, _ = Problem(augment(model), np.array([1.0, 2.0]), scheme="exponential").plan(0.05, paired=True)
    fine, coarse = records_of(plan, "numpy", 1, 0, 30)
    assert np.allclose(fine, coarse, rtol=1e-9, atol=1e-11)


def test_the_rule_is_chosen_by_the_problem_and_can_be_given():
    assert Problem(augment(toml(STIFF)), np.array([1.0])).scheme == "exponential"
    assert Problem(augment(oleo("R43C")), np.array([10.0])).scheme == "heun"
    assert Problem(augment(toml(STIFF)), np.array([1.0]), scheme="heun").scheme == "heun"
    with pytest.raises(ModelError, match='`scheme` is "heun" or "exponential"; found .euler'):
        simulate(toml(STIFF), 10, scheme="euler")


def test_the_twin_of_a_stiff_vehicle_takes_the_same_steps():
    compiled = cs.compile(toml(STIFF))
    run = cs.simulate(compiled, 1000, seed=1, step=0.01, check_step=False, control=True, times=[2.0, 10.0])
    assert run.scheme == "exponential"
    assert run.notes == ()
    assert (run.saved("variance")["zs"] > 5).all()
    plain = run.moments
    assert (np.abs(run.estimates.variance - plain.variance) < 5 * plain.variance_standard_error)[:, :3].all()
