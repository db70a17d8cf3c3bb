"""The quasi-linear twin as control variate: the same truth, from far fewer paths."""

from __future__ import annotations

import dataclasses
import inspect

import numpy as np
import pytest
from conftest import ROOT
from reference_models import oleo, oscillator, toml, value

import cadet_sym as cs
from cadet_sym.augmentation import augment
from cadet_sym.controlled import Options, twin_of
from cadet_sym.errors import CadetError, ModelError, SolverError
from cadet_sym.simulation import simulate
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.riders import CrossingRider
from cadet_sym.simulation.workers import records_of


@pytest.fixture(scope="module")
def figure_2():
    return cs.compile(oleo("R41C", duration=3.0))


def row(case: str, t: float):
    return next(row for row in value(case)["rows"] if row["t"] == t)


def test_the_twin_saves_most_of_the_paths_and_tells_the_same_truth(figure_2):
    run = cs.simulate(figure_2, 1500, times=[1.0, 3.0], seed=1)
    assert run.notes == ()
    assert run.saved("variance")["x"][-1] > 30
    assert run.saved("mean")["x"][-1] > 300
    for at, t in enumerate((1.0, 3.0)):
        truth = row("R41Cx", t)
        for moment, key in (("mean", "mean"), ("variance", "var")):
            se = np.hypot(getattr(run, f"{moment}_standard_error")["x"][at], truth[f"se_{key}"])
            assert abs(getattr(run, moment)["x"][at] - truth[key]) < 4 * se
    plain = run.moments
    assert (np.abs(run.estimates.mean - plain.mean) < 5 * plain.mean_standard_error).all()
    assert (np.abs(run.estimates.variance - plain.variance) < 5 * plain.variance_standard_error).all()


def test_the_twin_saves_where_the_undercarriage_accelerates():
    run = cs.simulate(oleo("R43C"), 1500, times=[4.0, 10.0], seed=1, step=2e-3, check_step=False, control=True)
    assert (run.saved("variance")["x"] > (30, 6)).all()
    assert (run.saved("mean")["x"] > 100).all()
    for at, t in enumerate((4.0, 10.0)):
        truth = row("R43Cx", t)
        for moment, key in (("mean", "mean"), ("variance", "var")):
            se = np.hypot(getattr(run, f"{moment}_standard_error")["x"][at], truth[f"se_{key}"])
            assert abs(getattr(run, moment)["x"][at] - truth[key]) < 4 * se + 2e-3 * truth[key] ** 2
    assert run.controlled[:1] == ("closure",)
    assert "control variates" in run.method
    assert run.plain_paths("x") > 6 * 1500


def test_the_twin_of_a_model_from_the_cache_needs_no_equations(tmp_path, monkeypatch):
    monkeypatch.setenv("CADET_SYM_CACHE", str(tmp_path))
    for _ in range(2):
        known = cs.compile(ROOT / "models" / "oleo_acceleration.toml")
        twin_of(known, np.array([0.0, 1.0]))
    assert "symbolic" not in vars(known.functions)


def test_friction_that_starts_from_rest_has_a_twin():
    """The gain of a jump grows like 1/sqrt(t) towards a start without variance."""
    model = oscillator("-v - 0.3*sign(v)", Q=0.5, scalar=True)
    run = cs.simulate(model, 2000, times=[0.1, 1.0], step=0.01, check_step=False, control=True)
    assert run.notes == ()
    assert (run.saved("variance")["v"] > 5).all()
    plain = run.moments
    assert (np.abs(run.estimates.variance - plain.variance) < 4 * plain.variance_standard_error).all()


def test_the_twin_is_left_where_it_saves_nothing():
    """Lightly damped strong stiffness: after some periods the paths have forgotten their twins."""
    model = oscillator("-0.1*v - x - x**3", Q=0.2)
    run = cs.simulate(model, 400, times=[20.0, 30.0])
    assert run.controlled == ()
    assert any("explains too little" in note for note in run.notes)
    assert "second and fourth moments" in run.method
    assert cs.simulate(model, 400, times=[20.0, 30.0], step=0.05, control=True).method


def test_a_twin_that_runs_away_is_left():
    """Its gain under strong friction is too stiff for steps that the bounded friction itself lets pass."""
    model = toml(
        """
        name = "stuck"
        [elements.friction]
        library = "coulomb"
        force = 30.0
        [rates]
        x = "v"
        v = "-x - 0.1*v - friction(v) + w"
        [noise]
        w = 1.0
        [run]
        duration = 5.0
        points = 11
        """
    )
    ensemble = cs.simulate(model, paths=200, seed=1)
    assert "simulated without it" in " ".join((ensemble.method, *ensemble.notes))
    assert 2e-4 < ensemble.variance["v"][-1] < 2e-3


def test_a_model_without_expectations_is_simulated_plainly():
    model = oscillator("-v/(1 + v) - v", Q=0.01, scalar=True)
    run = cs.simulate(model, 200, times=[0.5], step=0.05)
    assert any("Simulated without the quasi-linear system:" in note for note in run.notes)
    with pytest.raises(CadetError):
        cs.simulate(model, 200, times=[0.5], step=0.05, control=True)


def test_options_of_simulate_are_those_of_the_engine():
    arguments = inspect.signature(simulate).parameters
    assert set(Options.__annotations__) == set(arguments) - {"model", "paths", "twin", "insist"}


def test_an_output_that_is_not_linear_is_helped_too(figure_2):
    run = cs.simulate(figure_2, 1500, times=[3.0], seed=1)
    assert run.saved("mean")["damper_force"][0] > 20
    assert run.saved("variance")["damper_force"][0] > 5


@pytest.mark.slow
def test_standard_errors_of_controlled_estimates_are_their_spread_over_seeds(figure_2):
    twin = twin_of(figure_2, np.array([3.0]))
    runs = [simulate(figure_2.model, 320, times=[3.0], step=0.05, seed=s, check_step=False, twin=twin) for s in range(60)]
    for moment in ("mean", "variance"):
        values = np.array([getattr(r, moment)["x"][0] for r in runs])
        claimed = np.mean([getattr(r, f"{moment}_standard_error")["x"][0] for r in runs])
        assert claimed == pytest.approx(values.std(ddof=1), rel=0.35)


def test_a_linear_system_is_its_own_twin():
    """Nothing is left to chance: the estimates are the moment equations' own, up to the step."""
    model = toml(
        """
        [rates]
        x = "v"
        v = "-4*(x - h) - 0.5*(v - der(h)) + w"
        [noise]
        w = 0.3
        [contacts]
        h = {}
        [ground]
        kind = "exponential"
        sigma = 0.5
        cutoff = 0.4
        rolling_contact = 4.0
        [travel]
        speed = "1 + t"
        [outputs]
        stroke = "x - h"
        [run]
        duration = 2.0
        points = 3
        """
    )
    compiled = cs.compile(model)
    history = compiled.propagate()
    run = cs.simulate(compiled, 200)
    for name in ("x", "v", "stroke"):
        assert np.allclose(run.mean[name], 0.0, atol=1e-9)
        assert np.allclose(run.variance[name], history.variance[name], rtol=2e-3)
        assert (run.variance_standard_error[name][1:] < 1e-3 * history.variance[name][1:]).all()


def test_a_twin_with_wrong_moments_is_found_out(figure_2):
    twin = twin_of(figure_2, np.array([3.0]))
    wrong = dataclasses.replace(twin, covariance=1.3 * twin.covariance)
    run = simulate(figure_2.model, 1000, times=[3.0], step=0.02, check_step=False, twin=wrong)
    assert any("without it are estimated" in note for note in run.notes)
    assert run.variance["x"][0] == run.moments.variance[0, 0]


def test_a_control_that_hardly_any_path_feels_is_no_false_twin():
    """While the car sets out, no path reaches the bend of its damper, though some would: that little is in the error."""
    run = cs.simulate(cs.load(ROOT / "models" / "stop_and_go.toml"), 640, times=[0.4, 4.0, 10.4], seed=1, check_step=False)
    assert run.notes == ()
    assert (run.saved("variance")["stroke"] > 10).all()


def test_paths_are_simulated_until_the_limits_are_as_wanted(figure_2):
    run = cs.simulate(figure_2, "auto", times=[1.0, 3.0], target=0.01, watch=["x"], seed=2)
    assert (run.limit("variance")["x"] <= 0.01 * run.variance["x"]).all()
    assert (run.limit("mean")["x"] <= 0.01 * run.std["x"]).all()
    assert run.paths < 40_000
    plain = simulate(oscillator("-v*abs(v)", Q=1.0, scalar=True), "auto", times=[0.5, 1.0], target=0.05)
    assert (plain.limit("variance")["v"] <= 0.05 * plain.variance["v"]).all()
    assert 4096 <= plain.paths <= 20_000


def test_a_target_out_of_reach_is_told_with_what_was_obtained():
    model = oscillator("-v*abs(v)", Q=1.0, scalar=True)
    with pytest.raises(SolverError, match=r"limits wanted, 1e-05, were not reached in 0.01 s: with 2048 paths") as error:
        simulate(model, "auto", times=[1.0], step=0.1, target=1e-5, time_limit=0.01)
    assert error.value.details["partial"].paths == 2048


def test_a_run_in_start_has_no_twin():
    text = oleo("R41A", duration=2.0).to_toml().replace('ground = "smooth"', 'whole = "stationary"')
    model = toml(text.replace("schema = 1\n", ""))
    with pytest.raises(ModelError, match="no control variate"):
        cs.simulate(model, 100, control=True)
    run = cs.simulate(model, 100, times=[1.0], step=0.1, run_in=1.0, check_step=False)
    assert run.controlled == ()
    assert any("Simulated without the quasi-linear system: [initial] whole" in note for note in run.notes)


def test_numpy_and_numba_carry_the_same_riders():
    compiled = cs.compile(oleo("R43C", duration=1.0))
    times = np.array([0.5, 1.0])
    system = augment(compiled.model)
    rider = CrossingRider(system.states[0] + system.outputs["damper_force"] / 10, (0.0, 0.3))
    problem = Problem(system, times, [rider], twin_of(compiled, times))
    plan, _ = problem.plan(0.01, paired=True)
    fast, plain = (records_of(plan, engine, 0, 5, 21) for engine in ("numba", "numpy"))
    for a, b in zip(fast, plain, strict=True):
        assert a.shape == (2, problem.quantities + 4 + 4, 21)
        assert np.allclose(a, b, rtol=1e-9, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "t", "step"), [("R41C", 3.0, 0.005), ("R43C", 4.0, 5e-4)])
def test_controlled_estimates_are_unbiased_and_their_limits_hold(case, t, step):
    seeds, truth, compiled = 200, row(f"{case}x", t), cs.compile(oleo(case))
    twin = twin_of(compiled, np.array([t]))
    runs = [simulate(compiled.model, 400, times=[t], step=step, seed=s, check_step=False, twin=twin) for s in range(seeds)]
    for moment, key in (("mean", "mean"), ("variance", "var")):
        values = np.array([getattr(r, moment)["x"][0] for r in runs])
        error = np.hypot(values.std(ddof=1) / np.sqrt(seeds), truth[f"se_{key}"])
        print(f"{moment}: {values.mean():.6g}, true {truth[key]:.6g}, {(values.mean() - truth[key]) / error:+.2f} errors")
        assert abs(values.mean() - truth[key]) < 2 * error
        inside = sum(abs(r.limit(moment)["x"][0]) > abs(getattr(r, moment)["x"][0] - values.mean()) for r in runs)
        assert 194 <= inside <= 200
