"""Simulation as a whole: the same numbers whatever computes them, honest errors, clear refusals."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from conftest import ROOT
from reference_models import oleo, oscillator, toml

import cadet_sym as cs
from cadet_sym.augmentation import augment
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.simulation import Ensemble, simulate
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.statistics import moments_of, step_error_of
from cadet_sym.simulation.workers import group_size, records_of

TIMES = [0.0, 0.5, 1.5, 2.0]
HALF_CAR = """
[parameters]
k = 40.0
[rates]
z = "v"
q = "p"
v = "-k*(z - q/2 - f) - k*(z + q/2 - r) - 3*(v - der(f) + v - der(r)) - 5*(z - f)**3"
p = "k*(z - q/2 - f) - k*(z + q/2 - r) - 4*p - 2*abs(p)*p + w1 + w2/2"
[noise]
names = ["w1", "w2"]
intensity = [["0.3 + t/10", "0.1"], ["0.1", "0.2"]]
[contacts]
f = {}
r = { setback = 1.3 }
l = { track = "left" }
[ground]
kind = "exponential"
sigma = 0.1
cutoff = 0.5
rolling_contact = 6.0
[travel]
speed = "if_moving"
[outputs]
acceleration = "der(v)"
[run]
duration = 3.0
points = 7
""".replace("if_moving", "0 if t < 0.4 else 5*(t - 0.4)")


def same(a: Ensemble, b: Ensemble) -> bool:
    fields = ("count", "mean", "second", "third", "fourth", "product")
    return all(np.array_equal(getattr(a.moments, f), getattr(b.moments, f)) for f in fields)


@pytest.mark.parametrize("model", [toml(HALF_CAR), oleo("R43C")], ids=["half car", "oleo"])
@pytest.mark.parametrize("paired", [False, True])
def test_numpy_and_numba_give_the_same_paths(model, paired):
    problem = Problem(augment(model), np.linspace(0.0, 1.5, 7))
    plan, _ = problem.plan(0.013, paired=paired)
    fast, plain = (records_of(plan, engine, 11, 3, 21) for engine in ("numba", "numpy"))
    for a, b in zip(fast, plain, strict=True):
        assert np.allclose(a, b, rtol=1e-9, atol=1e-11)


def test_a_pair_is_the_two_runs_it_stands_for():
    """The coarse path of a pair meets the same ground as the fine one and is what a coarse step gives."""
    problem = Problem(augment(toml(HALF_CAR)), np.linspace(0.0, 3.0, 7))
    plan, _ = problem.plan(0.02, paired=True)
    fine, coarse = records_of(plan, "numpy", 1, 0, 40)
    ground = [k for k, name in enumerate(problem.names) if "." in name]
    assert np.array_equal(fine[:, ground], coarse[:, ground])
    alone, _ = records_of(problem.plan(0.01)[0], "numpy", 1, 0, 40)
    assert np.allclose(alone, fine, rtol=1e-9, atol=1e-11)
    assert 0 < np.abs(fine - coarse)[1:, :4].max() < 0.05 * np.abs(fine[:, :4]).max()


def test_two_programs_never_share_a_name():
    """Machine code is found by the names of functions, also where it was compiled by another process."""
    from cadet_sym.simulation import translated

    programs = [Problem(augment(m), np.array([1.0])).program for m in (oleo("R43C"), toml(HALF_CAR))]
    pairs = [translated.compile_program(program.numba_source) for program in programs]
    assert len({function.__name__ for pair in pairs for function in pair}) == 4
    assert translated.compile_program(programs[0].numba_source) is pairs[0]


SMALL_RUN = """
from cadet_sym.language.modelfile import loads
from cadet_sym.simulation import simulate
model = loads('schema = 1\\n[rates]\\nx = "-x + w"\\n[noise]\\nw = 1.0\\n[run]\\nduration = 1.0')
print(repr(simulate(model, 40, times=[1.0], step=0.1, check_step=False, threads=1).mean["x"][0]))
"""


@pytest.mark.slow
def test_what_numba_left_on_disk_and_cannot_read_is_written_anew(tmp_path):
    """An index that names a module which is no more, or is cut off."""

    def small_run() -> str:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run([sys.executable, "-c", SMALL_RUN], env=environment, capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 0, done.stderr
        assert "Error" not in done.stderr
        return done.stdout

    first = small_run()
    indices = sorted(tmp_path.rglob("*.nbi"))
    assert len(indices) > 2
    for number, index in enumerate(indices):
        with index.open("rb") as file:
            version = pickle.dumps(pickle.load(file))
        gone = b"cno_such_module\nGone\n."
        index.write_bytes(version + gone if number % 2 else version[:5])
    broken = {index: index.read_bytes() for index in indices}
    assert small_run() == first
    assert any(index.read_bytes() != broken[index] for index in indices)


def test_results_do_not_depend_on_threads_or_executors():
    model = oscillator("-v*abs(v)", Q=1.0, scalar=True)
    runs = [simulate(model, 3000, times=TIMES, step=0.05, threads=n, check_step=False) for n in (1, 3)]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        runs.append(simulate(model, 3000, times=TIMES, step=0.05, executor=pool, check_step=False, engine="numpy"))
    assert same(runs[0], runs[1])
    assert np.allclose(runs[0].moments.fourth, runs[2].moments.fourth, rtol=1e-9)


def test_a_cluster_of_dask_gives_the_same_numbers():
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    model = oscillator("-v*abs(v)", Q=1.0, scalar=True)
    alone = simulate(model, 3000, times=TIMES, step=0.05, check_step=False, engine="numpy")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        spread = simulate(model, 3000, times=TIMES, step=0.05, check_step=False, engine="numpy", executor=client.get_executor())
    assert same(alone, spread)


def test_any_executor_will_do_also_for_control_variates():
    """Whatever has `submit`; what it is given can be sent elsewhere."""

    class Elsewhere(Executor):
        def submit(self, work, /, *words, **more):
            done = Future()
            work, words = pickle.loads(pickle.dumps((work, words)))
            done.set_result(work(*words, **more))
            return done

    model = oscillator("-v*abs(v)", Q=1.0, scalar=True)
    here, there = (
        cs.simulate(model, 2500, times=TIMES, step=0.05, check_step=False, control=True, executor=each)
        for each in (None, Elsewhere())
    )
    assert same(here, there)
    assert np.array_equal(here.estimates.variance, there.estimates.variance)
    assert "v" in here.controlled


def test_more_paths_begin_with_the_same_paths():
    model = oscillator("-v", Q=1.0, scalar=True)
    few, many = (simulate(model, n, times=TIMES, step=0.1, keep=50) for n in (20, 1500))
    assert np.array_equal(few.kept, many.kept[:20])
    assert few.path("v").shape == (20, 4)
    other = simulate(model, 20, times=TIMES, step=0.1, seed=1)
    assert not np.isclose(other.kept[:, 1:], few.kept[:, 1:]).any()


def test_groups_depend_on_the_model_alone():
    assert group_size(101, 5) == 1024
    assert group_size(10_001, 40) == 16


def test_moments_are_those_of_all_paths_together():
    rng = np.random.default_rng(0)
    x = rng.gamma(2.0, size=(3, 4, 1000)) * np.array([1, 10, 1e-3, 5])[:, None] + np.array([0, 1e3, 0, -2])[:, None]
    parts = [moments_of(x[:, :, a:b], 3) for a, b in ((0, 17), (17, 600), (600, 1000))]
    joined, whole = parts[0].joined(parts[1]).joined(parts[2]), moments_of(x, 3)
    for name in ("count", "mean", "second", "third", "fourth", "product", "variance_standard_error"):
        assert np.allclose(getattr(joined, name), getattr(whole, name), rtol=1e-7), name
    assert np.allclose(whole.variance, x.var(axis=2, ddof=1))
    for k in range(3):
        assert np.allclose(whole.covariance[k], np.cov(x[k, :3]))


def test_a_path_counts_until_it_is_no_longer_finite():
    x = np.random.default_rng(0).normal(size=(2, 3, 50))
    x[1, 2, 7] = np.inf
    moments = moments_of(x, 2)
    assert moments.count.tolist() == [50, 49]
    rest = np.delete(x[1], 7, axis=1)
    assert np.allclose(moments.variance[1], rest.var(axis=1, ddof=1))
    assert np.allclose(moments.joined(moments_of(x * np.nan, 2)).mean, moments.mean)


def test_standard_errors_are_the_spread_over_seeds():
    model = oscillator("-v*abs(v)*3", Q=1.0, scalar=True)
    runs = [simulate(model, 250, times=[1.0], step=0.1, seed=s, check_step=False, threads=1) for s in range(200)]
    for moment in ("mean", "variance"):
        values = [getattr(r, moment)["v"][0] for r in runs]
        claimed = np.mean([getattr(r, f"{moment}_standard_error")["v"][0] for r in runs])
        assert claimed == pytest.approx(np.std(values, ddof=1), rel=0.16)


def test_limits_hold_the_truth_as_often_as_they_say():
    """v' = -v + w: variance (1 - exp(-2 t))/2, Gaussian."""
    truth = (1 - np.exp(-2.0)) / 2
    inside = {"mean": 0, "variance": 0}
    for seed in range(200):
        run = simulate(
            oscillator("-v", Q=1.0, scalar=True), 400, times=[1.0], step=0.02, seed=seed, check_step=False, threads=1
        )
        for moment, value in (("mean", 0.0), ("variance", truth)):
            low, high = getattr(run, f"{moment}_limits")("v", 0.9)
            inside[moment] += bool(low[0] < value < high[0])
    assert all(180 - 4 * 4.2 < count < 180 + 4 * 4.2 for count in inside.values())


def test_limits_widen_with_their_level():
    run = simulate(oscillator("-v", Q=1.0, scalar=True), 100, times=TIMES, step=0.1, level=0.9)
    se = run.variance_standard_error["v"][1:]
    assert np.allclose(run.limit("variance")["v"][1:], 1.6448536 * se)
    assert np.allclose(run.limit("variance", 0.99)["v"][1:], 2.5758293 * se)
    with pytest.raises(ModelError, match="between 0 and 1"):
        run.limit("mean", 99)
    with pytest.raises(ModelError, match='"mean" or "variance"'):
        run.limit("skewness")


def test_the_step_error_says_what_the_step_does():
    """v' = -v + w by Heun: the stationary variance is off by a known factor."""
    model = oscillator("-v", Q=1.0, scalar=True)
    h = 0.4

    def variance(step):
        r, g = 1 - step + step**2 / 2, 1 - step / 2
        return g**2 * step / (1 - r**2)

    run = simulate(model, 4000, times=[8.0], step=h)
    expected = 2 * (variance(h) - variance(h / 2))
    assert run.step_error is not None
    claimed, doubt = run.variance_step_error["v"][0], run.step_error.variance_standard_error[0, 0]
    assert abs(claimed - expected) < 4 * doubt
    assert doubt < 0.3 * abs(expected)
    assert abs(run.variance["v"][0] - variance(h)) < 4 * run.variance_standard_error["v"][0]


def test_a_step_is_chosen_whose_error_is_below_the_sampling_error():
    run = simulate(oleo("R41A"), 1000, times=[1.0, 5.0, 10.0])
    assert (np.abs(run.variance_step_error["x"]) < run.variance_standard_error["x"]).all()
    assert (np.abs(run.mean_step_error["x"]) < run.mean_standard_error["x"]).all()
    assert run.notes == ()
    # Stiff where the paths are, not where they start: the first choice is too long.
    model, times = oscillator("-2*v - 30*x**3", Q=4.0), np.array([5.0])
    stiff = simulate(model, 2000, times=times)
    assert stiff.notes == ()
    assert stiff.step < 0.6 * Problem(augment(model), times).first_step


def test_a_step_that_is_too_long_is_told():
    run = simulate(oleo("R41A"), 2000, times=[10.0, 20.0], step=0.4)
    assert any("time step 0.4" in note for note in run.notes)
    unchecked = simulate(oleo("R41A"), 100, times=[1.0], step=0.1, check_step=False)
    assert unchecked.step_error is None
    assert np.isnan(unchecked.variance_step_error["x"]).all()


def test_a_blow_that_few_paths_feel_asks_for_no_shorter_step():
    """The force of a stop that hardly any path reaches is far from the others' with any step."""
    run = simulate(cs.load(ROOT / "models" / "measured_road.toml"), 200)
    assert run.step > 5e-4
    assert run.notes == ()


def test_the_choice_of_a_step_gives_up_on_a_model_that_diverges_by_itself():
    model = toml('[rates]\nx = "x**3 - x"\n[initial.covariance]\n"x,x" = 0.25\n[run]\nduration = 12.0\npoints = 13')
    with pytest.warns(RuntimeWarning, match="paths diverged"):
        run = simulate(model, 500)
    assert run.step > 1e-3
    assert any("The error of the time step" in note for note in run.notes)


def test_step_error_needs_pairs_that_stay_finite():
    x = np.zeros((1, 1, 3))
    x[..., 1:] = np.nan
    assert np.isnan(step_error_of(x, x).mean).all()


def test_a_stiff_gap_that_the_first_step_does_not_see_is_found():
    """The mean stands at the edge of the gap, whose stiffness, 1900 rad/s, is gone from the largest differences."""
    model = toml("""
        name = "gear pair with backlash"
        [elements.mesh]
        arguments = ["z"]
        value = "5e4*(z - clip(z, -0.001, 0.001))"
        [rates]
        w1 = "(20 - 0.1*w1 - mesh(x) - 4*(w1 - w2))/0.02 + n/0.02"
        w2 = "(-20 + mesh(x) + 4*(w1 - w2) - 0.1*w2)/0.05"
        x = "w1 - w2"
        [noise]
        n = 40.0
        [initial]
        x = 0.0014
        [run]
        duration = 0.5
        points = 3
    """)
    run = simulate(model, 256, seed=1)
    assert run.diverged == 0
    assert run.step < 1e-3


def test_diverging_paths_are_counted_and_told():
    model = toml('[rates]\nx = "x**3 - x"\n[initial.covariance]\n"x,x" = 0.25\n[run]\nduration = 12.0\npoints = 13')
    with pytest.warns(RuntimeWarning, match="paths diverged") as caught:
        run = simulate(model, 2000, step=0.02)
    share = run.diverged / 2000
    assert abs(share - 0.0455) < 4 * np.sqrt(0.0455 / 2000)
    assert run.moments.count[-1] == 2000 - run.diverged
    assert str(run.diverged) in str(caught[0].message)
    assert np.isfinite(run.variance["x"]).all()


def test_a_model_whose_paths_all_diverge_is_an_error_in_one_sentence():
    model = toml('[rates]\nx = "x**2 + 1"\n[run]\nduration = 3.0\npoints = 4')
    with pytest.raises(SolverError, match=r"all 50 paths diverged with a step of .*give `step`"):
        simulate(model, 50, step=0.01)


def test_a_whole_stationary_start_is_run_in():
    model = oleo("R41A", duration=2.0).to_toml().replace('ground = "smooth"', 'whole = "stationary"')
    run = simulate(toml(model.replace("schema = 1\n", "")), 3000, times=[0.0, 1.0, 2.0], run_in=40.0)
    assert run.run_in == 40.0
    assert any("run in for 40" in note for note in run.notes)
    assert (np.abs(run.variance["x"] - 1.97) < 4 * run.variance_standard_error["x"]).all()
    assert (np.abs(run.mean["x"] + 0.338) < 4 * run.mean_standard_error["x"]).all()


def test_progress_is_told_path_by_path(capsys):
    told = []
    model = oscillator("-v", Q=1.0, scalar=True)
    simulate(model, 2500, times=TIMES, step=0.1, progress=told.append)
    assert sum(told) == 2500
    assert len(told) == 3
    simulate(model, 100, times=TIMES, step=0.1, progress=True)
    assert capsys.readouterr().out == ""


def test_an_ensemble_is_labelled():
    run = simulate(toml(HALF_CAR), 200, step=0.02)
    assert run.states[:4] == ("z", "q", "v", "p")
    assert run.outputs == ("acceleration",)
    assert run.covariance["z", "v"].shape == (7,)
    assert np.allclose(run.covariance["v", "v"], run.std["v"] ** 2)
    data = run.to_xarray()
    assert data["variance"].sel(state="z").shape == (7,)
    assert data["output_mean"].sel(output="acceleration").shape == (7,)
    assert data["path_states"].shape == (20, 7, len(run.states))
    assert "acceleration: mean" in str(run)


BAD = {
    "paths": ({"paths": 0}, "`paths` is a whole number, 2 or more, or \"auto\"; found 0"),
    "negative paths": ({"paths": -5}, "`paths` .* found -5"),
    "half a path": ({"paths": 10.5}, "`paths` .* found 10.5"),
    "step": ({"step": 0.0}, "`step` is a time greater than zero; found 0.0"),
    "negative step": ({"step": -0.1}, "`step` .* found -0.1"),
    "no number": ({"step": float("nan")}, "`step` .* found nan"),
    "seed": ({"seed": -1}, "`seed` is a whole number, 0 or more; found -1"),
    "level": ({"level": 1.0}, "`level` is a probability"),
    "keep": ({"keep": -1}, "`keep`"),
    "threads": ({"threads": 0}, "`threads`"),
    "run-in": ({"run_in": -1.0}, "`run_in` is a time not negative"),
    "times": ({"times": [0.0, 2.0, 1.0]}, "`times` are increasing"),
    "times before the start": ({"times": [-1.0, 2.0]}, "`times` are increasing"),
    "no time": ({"times": [0.0]}, "nothing but 0"),
    "average": ({"average_from": -1.0}, "`average_from` is a time not negative; found -1.0"),
    "watch": ({"paths": "auto", "watch": []}, "`watch` names nothing"),
    "engine": ({"engine": "fortran"}, "`engine` is"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_arguments_are_refused_in_one_sentence(case):
    arguments, message = BAD[case]
    with pytest.raises(ModelError, match=message):
        simulate(oscillator("-v", Q=1.0, scalar=True), **{"times": TIMES, **arguments})


def test_intensities_must_be_positive_semidefinite():
    text = HALF_CAR.replace('"0.3 + t/10"', '"0.3 - t/10"')
    with pytest.raises(ModelError, match="positive semidefinite"):
        simulate(toml(text), 10, times=[0.0, 3.0])
