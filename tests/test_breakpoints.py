"""Known inputs that change abruptly: found before the run, so that no integrator steps over them."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import toml
from scipy.integrate import solve_ivp

import cadet_sym as cs
from cadet_sym.solve.breakpoints import breakpoints_of


def driven(force: str, duration: float = 100.0) -> cs.Model:
    return toml(
        f'name = "driven"\n[parameters]\nT = 50.0\n[rates]\nx = "v"\nv = "-x - v + {force} + w"\n'
        f"[noise]\nw = 0.1\n[run]\nduration = {duration}\n"
    )


def found(model: cs.Model) -> tuple[float, ...]:
    compiled = cs.compile(model)
    return compiled.breakpoints(compiled.parameter_vector(), model.number(model.run.duration))


@pytest.mark.parametrize("name", ["stop_and_go", "road_class_change"])
def test_those_of_many_runs_are_those_of_each(name, shipped):
    """In time, where no parameter moves them, and along the ground, where the speed does, and may never come so far."""
    compiled, values = shipped(name), [5.0, 12.0, 12.0, 21.0]
    p, end = np.array([compiled.parameter_vector({"V": value}) for value in values]), compiled.declaration.duration
    apart = [cs.compile(compiled.model).breakpoints(own, end) for own in p]
    assert breakpoints_of(compiled.functions, p, end) == apart
    assert (apart[0] == apart[-1]) == (name == "stop_and_go")
    assert len(apart[-1]) >= 3


@pytest.mark.parametrize(
    ("force", "times"),
    [
        ("(100 if T < t < T + 0.01 else 0)", (50.0, 50.01)),
        ("heaviside(t - 3)", (3.0,)),
        ("abs(t - 7)", (7.0,)),
        ("max(t - 2*T, 0)", ()),
        ("clip(t, 1, 5)", (1.0, 5.0)),
        ("sign(cos(t/20))", (10 * np.pi, 30 * np.pi)),
        ("sin(t)", ()),
    ],
)
def test_kinks_in_time_are_found(force, times):
    assert found(driven(force)) == pytest.approx(times, abs=1e-10)


def test_a_short_pulse_late_in_the_run_is_not_stepped_over():
    history = cs.compile(driven("(100 if T < t < T + 0.01 else 0)")).propagate([50.0, 51.0], rtol=1e-9)

    # Impulse response of x'' + x' + x to a force of 100 over 10 ms.
    def step(t, y):
        return [y[1], -y[0] - y[1] + (100 if t < 0.01 else 0)]

    first = solve_ivp(step, (0, 0.01), [0, 0], rtol=1e-11, atol=1e-14).y[:, -1]
    rest = solve_ivp(lambda t, y: [y[1], -y[0] - y[1]], (0.01, 1.0), first, rtol=1e-11, atol=1e-14).y[:, -1]
    np.testing.assert_allclose(history.mean["x"], [0, rest[0]], rtol=1e-7, atol=1e-9)


GROUND = """
name = "bump"
[parameters]
V = 12.0
[rates]
x = "v"
v = "-400*(x - {height}) - 10*(v - der({height}))"
[contacts]
h = {{}}
g = {{ setback = 3.0 }}
[ground]
kind = "exponential"
sigma = 0.01
cutoff = 0.3
rolling_contact = 5.0
profile = "{profile}"
[travel]
speed = "{speed}"
[run]
duration = {duration}
"""
BUMP = "0.05*(1 - cos(2*pi*(s - 600)/0.12))/2 if 600 < s < 600.12 else 0"


def test_a_bump_of_ten_milliseconds_after_fifty_seconds_is_felt():
    model = toml(GROUND.format(profile=BUMP, speed="V", duration=52, height="h"))
    assert found(model) == pytest.approx((0.25, 50.0, 50.01, 50.25, 50.26))  # wheel g passes s = 0 first
    history = cs.compile(model).propagate([49.9, 50.02, 50.5], rtol=1e-8)
    assert history.mean["x"][0] == pytest.approx(0.0, abs=1e-12)

    # The height under the rolling contact: u' = 5 (bump - u) in distance.
    def bump(s):
        return 0.025 * (1 - np.cos(2 * np.pi * s / 0.12)) if s < 0.12 else 0.0

    def rate(t, y):
        return [
            y[1],
            -400 * (y[0] - y[2]) - 10 * (y[1] - 60 * (bump(12 * t) - y[2])),
            60 * (bump(12 * t) - y[2]),
        ]

    first = solve_ivp(rate, (0, 0.01), [0, 0, 0], rtol=1e-11, atol=1e-14, max_step=1e-3)
    second = solve_ivp(rate, (0.01, 0.5), first.y[:, -1], rtol=1e-11, atol=1e-14, t_eval=[0.02, 0.5])
    np.testing.assert_allclose(history.mean["x"][1:], second.y[0], rtol=1e-6, atol=1e-10)


def test_the_wheel_behind_meets_the_bump_later():
    model = toml(GROUND.format(profile="0.05 if 6 < s < 9 else 0", speed="V", duration=2, height="g"))
    history = cs.compile(model).propagate([0.7, 0.76, 1.0], rtol=1e-8)
    assert found(model) == pytest.approx((0.25, 0.5, 0.75, 1.0))
    assert history.mean["x"][0] == pytest.approx(0, abs=1e-12)
    assert history.mean["x"][1] > 1e-5


def test_edges_are_found_along_a_speed_that_has_no_closed_distance():
    model = toml(GROUND.format(profile="0.05 if s > 10 else 0", speed="V*(1 + sin(t)**2)/2", duration=3, height="h"))
    times = found(model)

    def travelled(t):
        return 6 * (1.5 * t - np.sin(2 * t) / 4)

    assert [travelled(t) for t in times] == pytest.approx([3.0, 10.0, 13.0], abs=1e-9)


def test_a_vehicle_that_starts_on_a_plateau_stands_on_it():
    plateau = GROUND.replace("[travel]", "[travel]\nstart = 5.0") + '\n[initial]\nx = "h"\n'
    model = toml(plateau.format(profile="0.1 if s < 10 else 0", speed="V*t", duration=1, height="h"))
    compiled = cs.compile(model)
    mean, covariance = compiled.equations.packing.unpack(compiled.initial())
    risen = [0.1 * (1 - np.exp(-5 * s)) for s in (5.0, 2.0)]
    heights = [compiled.states.index(f"{wheel}.height") for wheel in ("h", "g")]
    np.testing.assert_allclose(mean[heights], risen, rtol=1e-9)
    assert mean[0] == pytest.approx(risen[0])
    assert covariance[0, 0] == pytest.approx(covariance[heights[0], heights[0]])


def test_a_measured_bump_is_met_row_by_row(tmp_path):
    (tmp_path / "bump.csv").write_text("s,h\n0,0\n600,0\n600.05,0.03\n600.1,0\n700,0\n")
    text = GROUND.replace('profile = "{profile}"', 'profile = {{ table = "bump.csv" }}').format(
        speed="V", duration=51, height="h"
    )
    (tmp_path / "bump.toml").write_text("schema = 1\n" + text)
    model = cs.load(tmp_path / "bump.toml")
    assert {50.0, 600.05 / 12, 600.1 / 12} <= {round(t, 9) for t in found(model)} | {600.05 / 12, 600.1 / 12}
    history = cs.compile(model).propagate([49.9, 50.05], rtol=1e-8)
    assert abs(history.mean["x"][0]) < 1e-12
    assert abs(history.mean["x"][1]) > 1e-5


@pytest.mark.parametrize("engine", ["native", "stiff", "direct", "implicit", "stepping"])
def test_an_output_time_a_rounding_behind_a_breakpoint_has_the_value_there(engine):
    model = driven("(100 if T < t < T + 0.01 else 0)")
    after = float(np.nextafter(50.0, 51.0))
    history = cs.compile(model).propagate([49.0, after, 51.0], rtol=1e-8, engine=engine)
    plain = cs.compile(model).propagate([49.0, 50.0, 51.0], rtol=1e-8)
    np.testing.assert_allclose(history.variance["x"], plain.variance["x"], rtol=1e-7)
    np.testing.assert_allclose(history.mean["x"], plain.mean["x"], rtol=1e-6, atol=1e-9)
