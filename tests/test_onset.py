"""From rest every engine finds the moments of an independent integrator, whatever gains have no bound without variance."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT, half
from reference_models import toml
from scipy.integrate import solve_ivp

import cadet_sym as cs
from cadet_sym.lowering import functions
from cadet_sym.solve import course, transient
from cadet_sym.solve.course import march
from cadet_sym.solve.evaluate import Rate
from cadet_sym.solve.onset import Onset

TIMES = np.array([0.0, 1e-3, 0.1, 1.0])
COMPILED = ("auto", "native", "stiff", "direct", "implicit", "krylov")


@pytest.fixture
def no_machine_code(monkeypatch):
    """As where there is no LLVM."""
    monkeypatch.setattr(functions, "available", lambda: False)


def independent(compiled: cs.CompiledModel, times: np.ndarray) -> np.ndarray:
    """Covariances (k, n, n) by LSODA, from a start that DOP853 made with steps as long as the time that has passed."""
    p, y, packing = compiled.parameter_vector(), compiled.initial(), compiled.packing
    into = Rate(compiled.functions, p)

    def rate(t, at):
        slope = np.empty(len(at))
        into._same = 0  # it counts evaluations at one time, and there are many integrators here
        into(t, np.ascontiguousarray(at), slope)
        return slope

    first = 1e-9
    y = solve_ivp(rate, (0, first), y, method="DOP853", rtol=1e-11, atol=1e-40).y[:, -1]
    spread = np.sqrt(np.maximum(np.diag(packing.unpack(y)[1]), 1e-20))
    scale = np.concatenate([spread, packing.pack(spread, np.outer(spread, spread))[packing.n :]])
    scale = np.concatenate([scale, np.ones(len(y) - len(scale))])
    found = solve_ivp(
        rate, (first, times[-1]), y, method="LSODA", t_eval=times[1:], rtol=1e-10, atol=1e-12 * scale, first_step=first
    )
    assert found.success
    return packing.unpack(np.vstack([compiled.initial(), found.y.T]))[1]


def agrees(history: cs.MomentHistory, expected: np.ndarray) -> None:
    """To 1e-5 of the standard deviations that the run reaches."""
    spread = np.sqrt(np.diagonal(expected, axis1=1, axis2=2).max(axis=0))
    error = np.abs(history.state_covariance - expected) / np.outer(spread, spread)
    assert error.max() < 1e-5, f"{history.provenance.engine}: {error.max():.1e}"


def oscillator(friction: float) -> cs.Model:
    """Held by dry friction, driven by white noise of intensity 1."""
    x, v, w = sp.symbols("x v w")
    sign = cs.Element("friction", [x], sp.sign(x))
    vehicle = cs.Vehicle(rates={x: v, v: -100 * x - friction * sign(v) - v + w})
    return cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=1)


def times_of(friction: float) -> np.ndarray:
    """The larger the friction, the sooner the velocity's variance settles."""
    return TIMES / max(1.0, friction / 30) ** 2


@cache
def expected_of(friction: float) -> np.ndarray:
    return independent(cs.compile(oscillator(friction)), times_of(friction))


@pytest.mark.parametrize("friction", [1e-2, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("engine", COMPILED)
def test_friction_from_rest(friction, engine):
    history = cs.compile(oscillator(friction)).propagate(times_of(friction), rtol=1e-8, engine=engine)
    agrees(history, expected_of(friction))


@pytest.mark.parametrize("friction", [1e-2, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("engine", half(["auto", "direct", "implicit", "krylov"]))
@pytest.mark.usefixtures("no_machine_code")
def test_friction_from_rest_without_machine_code(friction, engine):
    history = cs.compile(oscillator(friction)).propagate(times_of(friction), rtol=1e-8, engine=engine)
    agrees(history, expected_of(friction))


@pytest.mark.parametrize("engine", COMPILED)
@pytest.mark.parametrize("share", [1e-30, 1e-14, 1e-8])
def test_next_to_nothing_misleads_as_nothing_does(share, engine):
    model, friction = oscillator(100.0), 100.0
    last = expected_of(friction)[-1]
    covariance = {(name, name): share * last[i, i] for i, name in enumerate(("x", "v"))}
    compiled = cs.compile(dataclasses.replace(model, initial=cs.Initial(covariance=covariance)))
    history = compiled.propagate(times_of(friction), rtol=1e-8, engine=engine)
    expected = expected_of(friction).copy()
    np.testing.assert_allclose(history.state_covariance[0], share * np.diag(np.diag(last)), rtol=1e-12)
    expected[0] = history.state_covariance[0]
    agrees(history, expected)


@pytest.mark.parametrize("engine", ["stiff", "implicit", "krylov"])
def test_what_explicit_steps_leave_is_taken_up_where_they_ended(engine):
    """A step's length away, the position's variance would be four parts in ten thousand off; and gains held in a step react
    too strongly to friction for Newton's method, which has to be noticed in time."""
    compiled, times = cs.compile(oscillator(100.0)), np.array([0.0, 0.5, 1.0, 20.0])
    expected = compiled.propagate(times, rtol=1e-9, engine="direct").state_covariance
    found = compiled.propagate(times, rtol=1e-7, engine=engine).state_covariance
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-5, atol=1e-14)


@pytest.mark.slow
def test_a_run_that_may_have_been_misled_is_run_again_and_a_difference_is_told(monkeypatch):
    monkeypatch.setattr(course, "onset", lambda *given: Onset(np.empty((0, 5)), given[3], given[4], 0, honest=False))
    compiled, times = cs.compile(oscillator(30.0)), times_of(30.0)
    agrees(compiled.propagate(times, rtol=1e-8, engine="direct"), expected_of(30.0))
    marched = []

    def off_by_a_little(*given):
        found = march(*given)
        marched.append(given[4])
        return found._replace(y=found.y * (1 + 1e-4 * len(marched)))

    monkeypatch.setattr(transient, "march", off_by_a_little)
    with pytest.warns(RuntimeWarning, match="friction holds the system") as told:
        compiled.propagate(times, rtol=1e-8, engine="direct")
    assert {each.filename for each in told} == {__file__}  # where it was asked for
    assert marched[-1].relative < 0.1 * marched[-2].relative


def locked(intensity: float) -> cs.CompiledModel:
    """Two masses on springs, of which noise drives one, and friction hardly lets them move against each other."""
    x1, v1, x2, v2, z, w = sp.symbols("x1 v1 x2 v2 z w")
    force = 1000 * cs.Element("friction", [z], sp.sign(z))(v1 - v2)
    vehicle = cs.Vehicle(rates={x1: v1, v1: -100 * x1 - 2 * v1 - force + w, x2: v2, v2: -400 * x2 - 4 * v2 + force})
    return cs.compile(cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.Matrix([[intensity]])), duration=20))


@pytest.mark.parametrize("engine", ["auto", "stiff", "direct"])
@pytest.mark.parametrize("intensity", [1.0, 1e-2])
def test_masses_that_friction_holds_together_move_as_one(engine, intensity):
    """Their difference varies by a ten-millionth of what they do, and how its gain answers is as large as its decay."""
    history = locked(intensity).propagate(engine=engine)
    assert history.variance["x1"][-1] == pytest.approx(intensity / (2 * 6 * 500), rel=1e-4)
    difference = history.variance["v1"] + history.variance["v2"] - 2 * history.covariance["v1", "v2"]
    # Q = 4 F sqrt(2/pi) s where friction balances the noise
    assert difference[-1] == pytest.approx(np.pi / 2 * (intensity / 4000) ** 2, rel=1e-2)
    assert history.provenance.statistics["steps"] < 40_000
    if intensity == 1:  # else it is a matter of rounding, and CVODES may take over
        assert "then" not in history.provenance.engine


ELEMENTS = {
    "Bouc-Wen": ("-10*x - 90*z - 0.4*v + w", "v - 10*abs(v)*z - 10*v*abs(z)"),
    "relay with dead zone": ("-100*x - 30*(1 if v > 0.01 else (-1 if v < -0.01 else 0)) - 0.4*v + w", "-z"),
    "oleo": ("-100*x - 20*(v**2 if v > 0 else -0.1*v**2) - 0.4*v + w", "-z"),
    "Stribeck": ("-100*x - 10*sign(v)*(1 + 0.5*exp(-abs(v)/0.02)) - 0.4*v + w", "-z"),
}


@cache
def with_element(name: str) -> tuple[cs.CompiledModel, np.ndarray]:
    force, memory = ELEMENTS[name]
    text = f'name = "e"\n[rates]\nx = "v"\nv = "{force}"\nz = "{memory}"\n[noise]\nw = 1.0\n[run]\nduration = 1.0'
    compiled = cs.compile(toml(text))
    return compiled, independent(compiled, TIMES)


@pytest.mark.parametrize("engine", [*COMPILED, "explicit"])
@pytest.mark.parametrize("name", ELEMENTS)
def test_other_elements_from_rest(name, engine):
    compiled, expected = with_element(name)
    spread = np.sqrt(np.maximum(np.diagonal(expected, axis1=1, axis2=2).max(axis=0), 1e-300))
    error = np.abs(compiled.propagate(TIMES, rtol=1e-8, engine=engine).state_covariance - expected)
    assert (error / np.outer(spread, spread)).max() < 1e-5


@pytest.mark.slow
def test_the_moments_of_friction_from_rest_are_those_of_paths():
    model = oscillator(1.0)
    history, truth = cs.compile(model).propagate(rtol=1e-8, engine="direct"), cs.simulate(model, paths=1000, seed=1)
    assert history.variance["v"][-1] == pytest.approx(truth.variance["v"][-1], rel=0.1)


@cache
def half_car() -> tuple[cs.CompiledModel, np.ndarray, np.ndarray]:
    """Bounce, pitch and two wheels that follow each other, with dry friction at both axles; moments by DOP853."""
    text = (ROOT / "models" / "half_car.toml").read_text()
    for k in (1, 2):
        text = text.replace(f"c*(w + x_{k}*q - w_{k})", f"(c*(w + x_{k}*q - w_{k}) + 200*sign(w + x_{k}*q - w_{k}))")
    times = np.array([0.0, 0.01, 0.05])
    compiled = cs.compile(toml(text.replace("schema = 1\n", "")))
    return compiled, times, independent(compiled, times)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["auto", "direct", "implicit", "krylov"])
def test_a_half_car_with_friction_and_wheels_that_follow_each_other(engine):
    compiled, times, expected = half_car()
    agrees(compiled.propagate(times, rtol=1e-8, engine=engine), expected)


@pytest.mark.parametrize("engine", ["direct", "implicit", "krylov", "stiff"])
def test_a_rate_that_jumps_later_jumps_as_at_the_start(engine):
    """As noise begins, E[sign(v x)] leaps from nothing to what the correlation of a driven mass makes it."""
    text = """
    name = "later"
    [elements.turn]
    arguments = ["y", "z"]
    value = "sign(y*z)"
    [rates]
    x = "v"
    v = "-x - v - turn(v, x) + w"
    [noise]
    w = "BEGINNING"
    [run]
    duration = 2.0
    """
    later, first = (cs.compile(toml(text.replace("BEGINNING", each))) for each in ("1 if t > 0.5 else 0", "1"))
    times = np.array([0.0, 1e-3, 1.0])
    expected = first.propagate(times, rtol=1e-9, engine="explicit")
    found = later.propagate(np.append(0.0, 0.5 + times[1:]), rtol=1e-8, engine=engine)
    agrees(found, expected.state_covariance)
    np.testing.assert_allclose(found.state_mean, expected.state_mean, rtol=1e-4, atol=1e-12)
