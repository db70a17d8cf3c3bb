"""Branches of a model as the user sees them: named, judged, drawn, saved, and the same as solutions found one by one."""

import json

import numpy as np
import pytest
import sympy as sp
import xarray as xr

import cadet_sym as cs
from cadet_sym.cli import main

BISTABLE = """
schema = 1
name = "Two wells"
[parameters]
Q = { value = 0.1, unit = "1/s" }
[rates]
x = "x - x**3 + w"
[noise]
w = "Q"
[outputs]
square = "x**2"
"""


@pytest.fixture(name="file")
def _file(tmp_path):
    path = tmp_path / "wells.toml"
    path.write_text(BISTABLE, encoding="utf-8")
    return path


@pytest.fixture(scope="module", name="wells")
def _wells():
    x, w, Q = sp.symbols("x w Q")
    model = cs.Model(cs.Vehicle(rates={x: x - x**3 + w}), parameters={Q: 0.1}, noise={w: Q}, name="wells")
    return cs.compile(model), cs.branches(model, "Q", (0.02, 0.6))


def test_the_double_well_has_five_solutions_below_its_fold_and_one_above(wells):
    _, found = wells
    np.testing.assert_allclose(found.folds, [1 / 3, 1 / 3], rtol=1e-9)
    assert [found.count(Q) for Q in (0.05, 0.3, 0.4)] == [(3, 2), (3, 2), (1, 0)]


@pytest.mark.slow
def test_points_of_a_branch_are_stationary_moments(wells):
    compiled, found = wells
    for branch in found:
        for i in (0, len(branch) // 2, len(branch) - 1):
            near = compiled.stationary(all=True, parameters={"Q": branch.values[i]})
            gaps = [
                abs(s.mean["x"] - branch.mean["x"][i]) + abs(s.variance["x"] - branch.variance["x"][i]) for s in near
            ]
            assert min(gaps) < 1e-7
            assert near[int(np.argmin(gaps))].stable == branch.stable[i]
        assert np.all((branch.growth < 1e-6) == branch.stable) or branch.folds


def test_the_speed_of_a_vehicle_is_a_parameter():
    compiled = cs.compile("models/half_car.toml")
    found = cs.branches(compiled, "speed", (10.0, 20.0))
    (branch,) = found
    i = len(branch) // 2
    one = compiled.stationary(speed=float(branch.values[i]))
    np.testing.assert_allclose(branch.state_covariance[i], one.state_covariance, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(branch.output_variance[i], one.output_variance, rtol=1e-7)


def test_what_drifts_is_named_and_left_out():
    found = cs.branches("models/quarter_car_linear.toml", "c_s", (500.0, 2000.0))
    assert found.drifting == ("h.height",)
    Q = 2 * np.pi**2 * 0.01 * 256e-6 * 20
    branch = found[0]
    np.testing.assert_allclose(branch.variance["stroke"], Q * 276 / (2 * branch.values), rtol=1e-9)
    assert np.isnan(branch.mean["h.height"]).all()


def test_branches_are_saved_and_drawn(wells, tmp_path):
    _, found = wells
    data = xr.load_dataset(found.save(tmp_path / "wells.nc"))
    assert data.sizes["point"] == sum(map(len, found))
    assert data.fold.sum() == 2
    np.testing.assert_array_equal(data.Q, np.concatenate([branch.values for branch in found]))
    header, *rows = (found.save(tmp_path / "wells.csv")).read_text().splitlines()
    assert header == "branch,Q,stable,growth,mean x,variance x"
    assert len(rows) == data.sizes["point"]
    assert found.plot(tmp_path / "wells.png").stat().st_size > 10_000


def test_stable_is_drawn_solid_and_unstable_dashed(wells):
    from cadet_sym.plotting import branches_figure

    figure = branches_figure(wells[1])
    styles = {(line.get_label(), line.get_linestyle()) for line in figure.axes[0].get_lines()}
    assert styles == {("stable", "-"), ("unstable", "--"), ("fold", "None")}


def test_the_command_prints_draws_and_saves(file, tmp_path, capsys):
    figure = tmp_path / "wells.png"
    assert main(["stationary", str(file), "--branches", "Q=0.05:0.5", "--plot", str(figure)]) == 0
    printed = capsys.readouterr().out
    assert "folds at Q = 0.333333333, 0.333333333" in printed
    assert printed.count("unstable") == 2
    assert figure.exists()


def test_the_command_prints_json(file, capsys):
    file.write_text(BISTABLE.replace("x - x**3", "-x - x**3"), encoding="utf-8")  # of one well: one branch is soon followed
    assert main(["stationary", str(file), "--branches", "Q=0.05:0.5", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["parameter"], content["folds"]) == ("Q", [])
    (branch,) = content["branches"]
    assert len(branch["values"]) == len(branch["outputs"]["square"]["mean"]) > 25


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--branches", "Q=1"], "NAME=LO:HI"),
        (["--branches", "Q=1:0.5"], "LO below HI"),
        (["--branches", "nothing=0:1"], "not a parameter"),
        (["--branches", "speed=1:2"], "no ground to travel on"),
        (["--branches", "Q=0.1:1", "--all"], "leave out --sweep and --all"),
    ],
)
def test_wrong_arguments_are_named(file, capsys, words, message):
    assert main(["stationary", str(file), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_range_without_solutions_is_a_failure():
    x, w, a = sp.symbols("x w a")
    model = cs.Model(cs.Vehicle(rates={x: a * x + x**3 + w}), parameters={a: 1}, noise={w: 1}, name="runaway")
    with pytest.raises(cs.SolverError, match="No stationary moments"):
        cs.branches(model, "a", (1.0, 2.0))


def test_a_search_may_begin_at_a_solution_near_by():
    compiled = cs.compile("models/quarter_car_damper.toml")
    near = compiled.stationary(speed=19.0)
    warm, cold = compiled.stationary(speed=20.0, start=near), compiled.stationary(speed=20.0)
    assert "given start" in warm.path[-1]
    np.testing.assert_allclose(warm.state_covariance, cold.state_covariance, rtol=1e-9, atol=1e-15)
