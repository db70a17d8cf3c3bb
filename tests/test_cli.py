"""Every command on every shipped model: what it prints, writes and returns."""

from __future__ import annotations

import csv
import json
from importlib.metadata import version

import numpy as np
import pytest
from conftest import ROOT, SHIPPED, one_in

import cadet_sym as cs
from cadet_sym.arguments import one_set_each, parse_sweep
from cadet_sym.cli import main

OLEO = str(ROOT / "models" / "oleo_acceleration.toml")
STEADY = str(ROOT / "models" / "oleo_constant_speed.toml")
DUFFING = str(ROOT / "models" / "duffing.toml")


@pytest.fixture
def run(capsys):
    """Run a command; gives its exit status, standard output and standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        status = main([str(word) for word in words])
        out, err = capsys.readouterr()
        return status, out, err

    return run


@pytest.fixture
def run_json(run):
    """Run a command that must succeed and print one JSON object and nothing else."""

    def run_json(*words: str) -> dict:
        status, out, err = run(*words, "--json")
        assert status == 0, err
        assert "NaN" not in out
        return json.loads(out)

    return run_json


def assert_shape(values: list, *shape: int) -> None:
    assert np.shape(np.array(values, dtype=float)) == shape


def test_moments_of_every_model_has_the_shape_of_the_contract(model_file, run_json):
    found = run_json("moments", model_file, "--points", "5")
    assert list(found) == ["model", "states", "time", "mean", "covariance", "outputs"]
    n = len(found["states"])
    assert_shape(found["time"], 5)
    assert_shape(found["mean"], 5, n)
    assert_shape(found["covariance"], 5, n, n)
    for moments in found["outputs"].values():
        assert_shape(moments["mean"], 5)
        assert_shape(moments["variance"], 5)
    covariance = np.array(found["covariance"])
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))


def test_moments_prints_a_table_for_every_model(model_file, run):
    status, out, err = run("moments", model_file, "--points", "3")
    assert (status, err) == (0, "")
    assert cs.load(model_file).name in out
    assert "variance" in out


def test_show_holds_elements_against_adaptive_integration(run, run_json):
    (element,) = run_json("show", OLEO, "--check")["describing_functions"]
    assert max(element["check"].values()) < 1e-9
    status, text, _ = run("show", OLEO, "--check")
    assert status == 0
    assert "25 cases against adaptive integration good to " in text


def test_moments_holds_elements_against_adaptive_integration_at_the_moments_of_the_run(run, run_json):
    found = run_json("moments", OLEO, "--points", 3, "--check")["check"]
    assert found["times"] == [0.0, 5.0, 10.0]
    assert [each["where"] for each in found["functions"]] == ["rates", "variance of damper_force"]
    assert max(max(each["error"], each["gain_error"]) for each in found["functions"]) < 1e-12
    status, text, _ = run("moments", OLEO, "--points", 3, "--check")
    assert status == 0
    assert "at the moments of 3 times, 0 to 10: largest error " in text


@pytest.mark.parametrize("model_file", one_in(3, SHIPPED), ids=lambda path: path.stem)
def test_show_of_every_model(model_file, run, run_json):
    found = run_json("show", model_file)
    status, text, _ = run("show", model_file)
    assert status == 0
    assert found["equations"].keys() == set(found["states"])
    for name in (*found["states"], *found["outputs"]):
        assert name in text
    for element in found["describing_functions"]:
        assert element["method"] in text
    status, latex, _ = run("show", model_file, "--latex")
    assert status == 0
    assert latex.count("{") == latex.count("}")


MEASURED = """
schema = 1
name = "Everything measured"
[elements.damper]
arguments = ["v"]
table = [[-1, -900], [-0.2, -400], [0, 0], [0.2, 600], [1, 1500]]
[rates]
x = "v"
v = "-100*(x - h) - damper(v - der(h))/300"
[contacts]
h = {}
[ground]
kind = "exponential"
sigma = 0.02
cutoff = 0.3
rolling_contact = 3.0
[travel]
speed = { table = [[0, 5], [1, 8], [3, 12]] }
[outputs]
force = "damper(v - der(h))"
[run]
duration = 1.0
points = 3
"""


def test_every_command_takes_measured_curves(run, run_json, tmp_path):
    file = tmp_path / "measured.toml"
    file.write_text(MEASURED)
    shown = run_json("show", file)
    assert shown["describing_functions"][0]["function"] == "table(z; 5 rows)"
    status, latex, err = run("show", file, "--latex")
    assert (status, err) == (0, "")
    assert r"f_{1} &= \operatorname{table}_{5}\left(z\right)" in latex
    assert r"\dot{\mu_{x}} &= \mu_{v}" in latex
    for words in (
        ("show", file, "--check"),
        ("moments", file),
        ("stationary", file, "--at", 1),
        ("validate", file, "--paths", 100),
        ("export", file, "--to", tmp_path / "c", "--matlab"),
    ):
        status, _, err = run(*words)
        assert (status, err) == (0, ""), words


@pytest.mark.parametrize("path", one_in(3, SHIPPED))  # what is written is tested of all
def test_export_of_models_that_ship(path, run, tmp_path):
    status, _, err = run("export", path, "--to", tmp_path / "c")
    assert status == 0, err
    assert {path.suffix for path in (tmp_path / "c").iterdir()} >= {".c", ".h"}


def test_the_run_of_the_paper(run_json):
    found = run_json("moments", OLEO, "--times", "1,5,10")
    x = found["states"].index("x")
    np.testing.assert_allclose(
        [row[x] for row in found["mean"]], [-0.020092, -0.349578, -1.108472], atol=6e-7
    )
    variance = [row[x][x] for row in found["covariance"]]
    np.testing.assert_allclose(variance, [0.299064, 1.902317, 1.345210], atol=6e-7)
    assert found["time"] == [1.0, 5.0, 10.0]


def test_set_changes_a_parameter(run_json):
    found = run_json("moments", OLEO, "--times", "1,5,10", "--set", "r=1")
    x = found["states"].index("x")
    np.testing.assert_allclose(
        [row[x][x] for row in found["covariance"]], [0.272771, 1.145568, 0.853872], atol=6e-7
    )
    np.testing.assert_allclose([row[x] for row in found["mean"]], 0.0, atol=1e-12)


def test_set_may_be_repeated_and_may_take_several(run_json):
    apart = run_json("moments", OLEO, "--points", "2", "--set", "r=1", "--set", "a=2")
    together = run_json("moments", "--set", "r=1", "a=2", OLEO, "--points", "2")
    equals = run_json("moments", "--set=r=1", "a=2", "--points", "2", OLEO)
    assert apart == together == equals


def test_several_settings_are_told_from_what_follows_them():
    assert one_set_each(["--set", "r=1", "a=2", "m.toml"]) == ["--set", "r=1", "--set", "a=2", "m.toml"]
    assert one_set_each(["--set", "r=1", "a=2.toml"]) == ["--set", "r=1", "a=2.toml"]
    assert one_set_each(["--sweep", "r=0:1:3", "--set", "a=1"]) == ["--sweep", "r=0:1:3", "--set", "a=1"]
    assert one_set_each(["--set", "µ=1", "β=-2", "--json"]) == ["--set", "µ=1", "--set", "β=-2", "--json"]


def test_rtol_duration_and_points_reach_the_run(run_json):
    rough = run_json("moments", DUFFING, "--duration", "3", "--points", "4", "--rtol", "1e-4")
    fine = run_json("moments", DUFFING, "--duration", "3", "--points", "4", "--rtol", "1e-10")
    assert rough["time"] == fine["time"] == [0.0, 1.0, 2.0, 3.0]
    assert rough["covariance"] != fine["covariance"]
    np.testing.assert_allclose(rough["covariance"], fine["covariance"], atol=1e-3)


def test_stationary_solutions_of_the_paper(run_json):
    found = run_json("stationary", STEADY)
    assert list(found) == ["model", "states", "drifting", "solutions"]
    (only,) = found["solutions"]
    x = found["states"].index("x")
    assert only["mean"][x] == pytest.approx(-0.3507455099, rel=1e-6)
    assert only["covariance"][x][x] == pytest.approx(1.8536208817, rel=1e-6)
    assert only["stable"] is True
    assert only["residual"] < 1e-8
    (symmetric,) = run_json("stationary", STEADY, "--set", "r=1")["solutions"]
    assert symmetric["covariance"][x][x] == pytest.approx(1.1233493998, rel=1e-6)


def test_stationary_needs_a_speed_where_the_vehicle_starts_from_rest(run, run_json):
    status, _, err = run("stationary", OLEO)
    assert status == 2
    assert "--speed" in err
    assert run_json("stationary", OLEO, "--speed", "20")["solutions"][0]["stable"] is True


def test_a_sweep_lists_the_solutions_at_every_value(run, run_json, tmp_path):
    found = run_json("stationary", STEADY, "--sweep", "r=0.1:1:3")
    assert found["parameter"] == "r"
    assert found["values"] == [0.1, 0.55, 1.0]
    assert [len(row) for row in found["solutions"]] == [1, 1, 1]
    x = found["states"].index("x")
    assert found["solutions"][2][0]["covariance"][x][x] == pytest.approx(1.1233493998, rel=1e-6)
    status, out, _ = run(
        "stationary",
        STEADY,
        "--sweep",
        "r=0.1:1:3",
        "--plot",
        tmp_path / "r.png",
        "--save",
        tmp_path / "r.csv",
    )
    assert status == 0
    assert out.count("stable") >= 3
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "r.csv").open(newline="") as stream:
        assert [float(row["r"]) for row in csv.DictReader(stream)] == [0.1, 0.55, 1.0]


def test_a_sweep_is_read_as_name_low_high_count():
    name, values = parse_sweep("zeta=0.1:0.3:3")
    assert name == "zeta"
    np.testing.assert_allclose(values, [0.1, 0.2, 0.3])


def test_stationary_prints_every_solution(run):
    status, out, err = run("stationary", DUFFING, "--all")
    assert status == 0, err
    assert "stable, residual" in out


@pytest.mark.parametrize("suffix", [".nc", ".csv", ".mat"])
def test_moments_saves_and_draws(suffix, run, tmp_path):
    files = tmp_path / "new" / f"run{suffix}", tmp_path / "new" / "run.pdf"
    status, out, err = run("moments", DUFFING, "--points", "9", "--save", files[0], "--plot", files[1])
    assert status == 0, err
    for file in files:
        assert file.stat().st_size > 0
        assert str(file) in out
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(file.name for file in files)


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """One small judgement of the Duffing oscillator, as JSON and as text, with its figure."""
    import contextlib
    import io

    figure = tmp_path_factory.mktemp("judged") / "duffing.png"
    found, text = io.StringIO(), io.StringIO()
    common = ["validate", DUFFING, "--paths", "400", "--seed", "3"]
    with contextlib.redirect_stdout(found):
        assert main([*common, "--json"]) == 0
    with contextlib.redirect_stdout(text):
        assert main([*common, "--plot", str(figure)]) == 0
    return json.loads(found.getvalue()), text.getvalue(), figure


def test_validate_has_the_shape_of_the_contract(judged):
    found, _, _ = judged
    keys = ["model", "states", "time", "paths", "cadet", "monte_carlo", "outputs", "verdict", "inputs", "method", "notes"]
    assert list(found) == keys
    k, n = len(found["time"]), len(found["states"])
    simulated = ("mean", "variance", "mean_standard_error", "variance_standard_error")
    assert found["paths"] == 400
    for side, moments in (("cadet", ("mean", "variance")), ("monte_carlo", simulated)):
        assert found[side].keys() == set(moments)
        for moment in moments:
            assert_shape(found[side][moment], k, n)
        for output in found["outputs"].values():
            for moment in moments:
                assert_shape(output[side][moment], k)
    assert found["verdict"].keys() == {*found["states"], *found["outputs"]}
    for verdict in found["verdict"].values():
        assert verdict.keys() >= {"discrepancy", "limit", "text"}


def test_validate_judges_within_its_own_limits(judged):
    found, _, _ = judged
    x = found["states"].index("x")
    cadet, true = found["cadet"]["variance"][-1][x], found["monte_carlo"]["variance"][-1][x]
    verdict = found["verdict"]["x"]
    assert verdict["discrepancy"] == pytest.approx(100 * (cadet - true) / true)
    assert 0 < verdict["limit"] < 60
    assert ("agrees" in verdict["text"]) or ("low" in verdict["text"]) or ("high" in verdict["text"])


def test_validate_prints_the_table_the_sentences_and_the_times(judged):
    found, text, figure = judged
    assert "400 simulated paths" in text
    for name in found["outputs"] or found["states"]:
        assert found["verdict"][name]["text"] in text
    for part in ("compiling", "CADET", "simulation", "figure"):
        assert part in text.splitlines()[-2]
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_validate_simulates_until_the_limits_are_as_wanted_and_says_what_it_saved(run, run_json):
    common = ["validate", "models/oleo_constant_speed.toml", "--paths", "auto", "--target", "0.05", "--set", "r=0.1"]
    found = run_json(*common)
    se = np.array(found["outputs"]["closure"]["monte_carlo"]["variance_standard_error"][1:])
    variance = np.array(found["outputs"]["closure"]["monte_carlo"]["variance"][1:])
    assert (2.7 * se < 0.051 * variance).all()
    assert "control variates" in found["method"]
    assert "times as many plain paths" in found["method"]
    oleo = found["inputs"]["v"]
    assert oleo["elements"] == ["oleo"]
    assert abs(oleo["skewness"][-1]) < 0.5


def test_validate_can_simulate_plainly(run):
    status, out, _ = run("validate", DUFFING, "--paths", "200", "--plain")
    assert status == 0
    assert "99 % limits from the second and fourth moments of 200 paths." in out


def test_a_target_out_of_reach_shows_what_was_obtained(run):
    common = ["validate", DUFFING, "--plain", "--paths", "auto", "--target", "1e-4", "--time-limit", "0.01"]
    status, out, err = run(*common)
    assert status == 1
    assert "2048 simulated paths" in out
    assert "the limits wanted, 0.0001, were not reached in 0.01 s: with 2048 paths" in err


def test_python_dash_m_is_the_same_command(run_json, capsys, monkeypatch):
    import runpy

    monkeypatch.setattr("sys.argv", ["cadet-sym", "--version"])
    with pytest.raises(SystemExit) as stopped:
        runpy.run_module("cadet_sym", run_name="__main__")
    assert stopped.value.code == 0
    assert capsys.readouterr().out.strip() == version("cadet-sym")


def test_help_names_every_command(run):
    status, out, _ = run("--help")
    assert status == 0
    for command in ("moments", "stationary", "validate", "show", "export", "--debug"):
        assert command in out
