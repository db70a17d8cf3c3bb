"""Sweeps: the same numbers in any process, labelled, and whole although points fail."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import cache
from multiprocessing import get_all_start_methods, get_context

import numpy as np
import pytest
from conftest import ROOT
from reference_models import toml

import cadet_sym as cs
from cadet_sym import sweeps
from cadet_sym.errors import ModelError
from cadet_sym.solve import shares
from cadet_sym.solve.native import Native
from cadet_sym.solve.shares import Team
from cadet_sym.sweeps import sweep

MODEL = """
name = "oscillator"
[parameters]
k = 4.0
e = 0.1
[rates]
x = "v"
v = "-k*x - 0.4*v - e*x**3 + w"
[noise]
w = 1.0
[run]
duration = 5.0
points = 6
"""


def test_a_grid_in_processes_gives_the_serial_numbers_bit_for_bit():
    values = {"k": [2.0, 4.0, 9.0], "e": [0.0, 0.5]}
    serial = sweep(toml(MODEL), values, workers=1)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        parallel = sweep(toml(MODEL), values, executor=executor)
    reversed_ = sweep(toml(MODEL), {name: list(v)[::-1] for name, v in values.items()}, workers=1)
    for i, history in enumerate(serial.histories):
        assert history is not None
        for other in (parallel[i], reversed_[len(serial) - 1 - i]):
            assert other is not None
            np.testing.assert_array_equal(other.state_covariance, history.state_covariance)
    data = parallel.to_xarray()
    assert data["covariance"].dims == ("k", "e", "time", "state", "state_2")
    alone = cs.compile(toml(MODEL)).propagate(parameters={"k": 9.0, "e": 0.5})
    np.testing.assert_array_equal(data["mean"].sel(k=9.0, e=0.5), alone.state_mean)


SCRIPT = """
import cadet_sym as cs
print("begun")
found = cs.sweep({path!r}, {{"zeta": [0.01, 0.02, 0.03]}}, workers=2, progress=False, engine="direct", points=3)
print(found.failures, len(found))
"""


def test_processes_do_not_run_a_script_again_that_is_not_guarded(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT.format(path=str(ROOT / "models" / "oleo_acceleration.toml")))
    ran = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "begun\n{} 3\n", "")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("oleo_acceleration", {"zeta": np.linspace(0.01, 0.2, 40)}),
        ("quarter_car_linear", {"c_s": np.linspace(500.0, 2500.0, 200)}),
        ("stop_and_go", {"V": np.linspace(10.0, 15.0, 12)}),
        ("half_car", {"c": np.linspace(1000.0, 2000.0, 9)}),
    ],
)
def test_many_threads_give_the_serial_numbers_bit_for_bit(name, values):
    model = cs.load(ROOT / "models" / f"{name}.toml")
    run = {"rtol": 1e-6, "points": 41, "progress": False}
    before = sys.stdout
    compiled = cs.compile(model)
    (parameter, column), *_ = values.items()
    alone = [compiled.propagate(parameters={parameter: x}, rtol=1e-6, points=41) for x in column]
    assert alone[0].provenance.engine.endswith("machine code")
    found = sweep(model, values, workers=8, **run)
    assert sys.stdout is before
    for one, other in zip(alone, found.histories, strict=True):
        assert other is not None
        assert other.derivatives is not None  # it never left this process
        for moment in ("state_mean", "state_covariance", "output_mean", "output_variance"):
            np.testing.assert_array_equal(getattr(other, moment), getattr(one, moment))
        assert other.provenance.parameters == one.provenance.parameters


@pytest.mark.parametrize("engine", ["auto", "direct", "stepping"])
def test_threads_that_make_a_models_functions_at_once_get_the_same_numbers(engine, monkeypatch):
    """Nothing is made beforehand, and Python's lock changes hands as often as it can."""
    monkeypatch.setenv("CADET_SYM_CACHE", "off")
    values, before = np.linspace(2.0, 9.0, 12).tolist(), sys.getswitchinterval()
    alone = [cs.compile(toml(MODEL)).propagate(parameters={"k": k}, engine=engine) for k in values[:3]]
    compiled = cs.compile(toml(MODEL))
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(6) as executor:
            found = list(executor.map(lambda k: compiled.propagate(parameters={"k": k}, engine=engine), values))
    finally:
        sys.setswitchinterval(before)
    for one, other in zip(alone, found[:3], strict=True):
        np.testing.assert_array_equal(other.state_covariance, one.state_covariance)
    for k, other in zip(values, found, strict=True):
        np.testing.assert_array_equal(
            compiled.propagate(parameters={"k": k}, engine=engine).state_covariance, other.state_covariance
        )


def test_threads_keep_each_to_its_own_engine_and_failure():
    """Some points are stiff, some overflow, and go through SUNDIALS, whose output is caught from the whole process."""
    model = toml(MODEL.replace("0.4*v", "d*v").replace("e = 0.1", "e = 0.1\nd = 0.4"))
    values, before = {"d": [0.4, 1e5, 0.4, 2e5], "e": [0.1, 0.1, -50.0, 0.1]}, sys.stdout
    serial = sweep(model, values, kind="samples", workers=1, progress=False)
    threads = sweep(model, values, kind="samples", workers=4, progress=False)
    assert serial.failures == threads.failures
    assert list(serial.failures) == [2]
    assert len({each.provenance.engine for each in serial.histories if each is not None}) > 1
    for one, other in zip(serial.histories, threads.histories, strict=True):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            assert one.provenance.engine == other.provenance.engine
            np.testing.assert_array_equal(one.state_covariance, other.state_covariance)
    assert sys.stdout is before


def test_runs_at_once_are_those_of_each_alone():
    """Stiff ones, some that are not, and one that overflows; times that begin later."""
    compiled = cs.compile(toml(MODEL.replace("0.4*v", "d*v").replace("e = 0.1", "e = 0.1\nd = 0.4")))
    values = {"d": [0.4, 0.5, 1e5, 0.4, 2e5], "e": [0.0, 0.5, 0.1, -50.0, 0.1]}
    runs = compiled.propagate_all(values, [0.5, 1.0, 4.0], rtol=1e-7)
    assert list(runs.failures) == [3]
    with pytest.raises(cs.SolverError) as caught:
        runs[3]
    assert len(caught.value.details["partial"].time) < 3
    engines = set()
    for i in (0, 1, 2, 4):
        own = {name: column[i] for name, column in values.items()}
        alone = compiled.propagate([0.5, 1.0, 4.0], rtol=1e-7, parameters=own)
        engines.add(alone.provenance.engine)
        assert runs[i].provenance.engine == alone.provenance.engine
        assert runs[i].provenance.parameters == alone.provenance.parameters
        assert runs[i].provenance.statistics["steps"] == alone.provenance.statistics["steps"]
        for moment in ("time", "state_mean", "state_covariance", "output_mean", "output_variance"):
            np.testing.assert_array_equal(getattr(runs[i], moment), getattr(alone, moment))
    assert len(engines) > 1


@pytest.mark.parametrize("count", [1, 2, 12])
def test_threads_that_share_runs_out_give_the_numbers_of_one(count):
    """Among them some that are stiff, and one that fails."""
    compiled = cs.compile(toml(MODEL.replace("0.4*v", "d*v").replace("e = 0.1", "e = 0.1\nd = 0.4")))
    values = {"d": np.where(np.arange(count) % 9 == 4, 1e5, 0.4), "e": np.where(np.arange(count) == 5, -50.0, 0.1)}
    one, three = (compiled.propagate_all(values, points=7, workers=workers) for workers in (1, 3))
    assert list(one.failures) == list(three.failures) == [5][: count > 5]
    for k in set(range(count)) - set(one.failures):
        assert one[k].provenance.engine == three[k].provenance.engine
        np.testing.assert_array_equal(one[k].state_covariance, three[k].state_covariance)
        np.testing.assert_array_equal(one[k].output_variance, three[k].output_variance)


def test_nodes_taken_side_by_side_give_each_run_its_own_numbers():
    """Of quadratures, whose nodes are evaluated several at a time, whoever runs what beside them."""
    model = toml(MODEL.replace("e*x**3", "e*tanh(x*v) - abs(v)*tanh(2*v)"))
    values = {"e": np.linspace(0.1, 0.5, 13)}
    one, three = (sweep(model, values, workers=count) for count in (1, 3))
    compiled = cs.compile(model)
    for k, e in enumerate(values["e"]):
        alone = compiled.propagate(parameters={"e": e})
        assert alone.provenance.engine == Native.name
        for runs in (one, three):
            np.testing.assert_array_equal(runs[k].state_covariance, alone.state_covariance)


def test_a_compiled_model_is_not_what_is_swept(shipped):
    with pytest.raises(ModelError, match="hand over the model, `compiled.model`"):
        cs.sweep(shipped("duffing"), {"zeta": [0.1]})


def test_there_is_at_least_one_worker():
    with pytest.raises(ModelError, match="`workers` is 0"):
        sweep(toml(MODEL), {"k": [2.0]}, workers=0)


def test_runs_at_once_need_as_many_values_of_each_parameter():
    with pytest.raises(ModelError, match="as many"):
        cs.compile(toml(MODEL)).propagate_all({"k": [1.0, 2.0], "e": [0.1, 0.2, 0.3]})


def test_samples_and_an_executor_of_ones_own():
    with ThreadPoolExecutor(1) as executor:
        result = sweep(toml(MODEL), {"k": [2.0, 4.0], "e": [0.3, 0.1]}, kind="samples", executor=executor, points=3)
    assert result.to_xarray()["output_mean"].sizes["sample"] == 2
    assert result.to_xarray()["e"].values.tolist() == [0.3, 0.1]
    assert len(result) == 2


def test_a_point_that_fails_is_kept_as_such():
    result = sweep(toml(MODEL), {"e": [0.1, -50.0]}, workers=1)
    assert result[0] is not None
    assert result[1] is None
    assert "e = -50" in result.failures[1]
    assert result.to_xarray()["failed"].values.tolist() == [False, True]
    assert np.isnan(result.to_xarray()["mean"].sel(e=-50.0)).all()


def test_a_point_without_a_stationary_start_is_kept_as_such_and_touches_no_other():
    model = toml(MODEL.replace("0.4*v", "d*v").replace("e = 0.1", "e = 0.1\nd = 0.4") + '[initial]\nwhole = "stationary"\n')
    values = [0.3, 0.5, -0.4, 0.8]
    found = sweep(model, {"d": values}, workers=1, progress=False)
    assert list(found.failures) == [2]
    assert found.failures[2].startswith("d = -0.4: No stationary moments")
    compiled = cs.compile(model)
    for i in (0, 1, 3):
        alone = compiled.propagate(parameters={"d": values[i]})
        np.testing.assert_array_equal(found.histories[i].state_covariance, alone.state_covariance)


def test_a_sweep_that_is_stopped_begins_no_more_points(monkeypatch):
    begun = []

    some = sweeps._Task.some

    def interrupted(task, first, rows, threads):
        begun.append(first)
        if len(begun) > 1:
            raise KeyboardInterrupt
        return some(task, first, rows, threads)

    monkeypatch.setattr(sweeps._Task, "some", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sweep(toml(MODEL), {"k": np.linspace(2.0, 9.0, 2000)}, workers=2, progress=False)
    assert len(begun) < 20


def test_the_bar_goes_to_standard_error(capsys):
    sweep(toml(MODEL), {"e": [0.1, 0.2]}, workers=1, progress=True)
    assert capsys.readouterr().out == ""


def test_dask_takes_the_points_through_its_own_executor():
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        result = sweep(toml(MODEL), {"e": [0.1, 0.2]}, executor=client.get_executor())
    assert not result.failures


@pytest.mark.parametrize(
    ("values", "kind", "message"),
    [
        ({}, "grid", "at least one"),
        ({"k": [float("nan")]}, "grid", "finite"),
        ({"k": [1.0, 2.0], "e": [1.0]}, "samples", "as many"),
        ({"k": [1.0]}, "spiral", "grid, samples"),
        ({"q": [1.0]}, "grid", "`q`"),
    ],
)
def test_wrong_arguments_are_named(values, kind, message):
    with pytest.raises(ModelError, match=message):
        sweep(toml(MODEL), values, kind=kind)


@pytest.mark.parametrize("workers", [1, 2, 3, 40])
def test_a_team_does_every_part_once_and_tells_of_what_went_wrong(workers):
    def fails(part):
        raise ArithmeticError(f"part {part.start}")

    team = Team(workers - 1)
    for count in (0, 1, 13, 200):
        parts = team.share(count, lambda part: range(part.start, part.stop))
        assert [k for part in parts for k in part] == list(range(count))
    with pytest.raises(ArithmeticError, match="part"):
        team.share(100, fails)


def test_teams_at_once_and_from_within_threads_of_their_own_wait_for_nobody_who_does_not_come(monkeypatch):
    monkeypatch.setattr(shares, "_others", cache(lambda: ThreadPoolExecutor(1)))  # one thread for all of them

    def ask(begin: int) -> list[int]:
        return Team(3).share(20, lambda part: sum(range(begin + part.start, begin + part.stop)))

    with ThreadPoolExecutor(4) as pool:
        assert [sum(each) for each in pool.map(ask, range(50))] == [sum(range(k, k + 20)) for k in range(50)]


@pytest.mark.skipif("fork" not in get_all_start_methods(), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of a process with threads that forks
def test_a_process_that_was_forked_has_threads_of_its_own():
    def ask() -> None:
        sys.exit(len(set(Team(1).share(40, who))))

    def who(part: slice) -> int:
        time.sleep(0.01)  # so that the other comes
        return threading.get_ident()

    assert len(set(Team(1).share(40, who))) == 2
    child = get_context("fork").Process(target=ask)
    child.start()
    child.join(60)
    assert child.exitcode == 2


def test_a_sweep_like_one_before_is_not_tried_out_first(monkeypatch):
    """How many points are done at once touches no number; other arguments of the runs make it another sweep."""
    model, some, taken = toml(MODEL), sweeps._Task.some, []

    def watched(task, first, rows, *more):
        taken.append(len(rows))
        return some(task, first, rows, *more)

    monkeypatch.setattr(sweeps._Task, "some", watched)
    count = 2 * sweeps.SHARE  # as many as are done at once however slow the machine
    values = {"k": np.linspace(2.0, 9.0, count)}
    found = [sweep(model, values, workers=2, points=points) for points in (6, 6, 5)]
    assert taken[0] == 1
    assert sum(taken[: taken.index(count)]) == count
    assert taken[taken.index(count) + 1] == 1
    for one, again in zip(found[0].histories, found[1].histories, strict=True):
        np.testing.assert_array_equal(one.state_covariance, again.state_covariance)
