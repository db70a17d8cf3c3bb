"""Results keep their names, their shapes and their missing values wherever they go."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from conftest import ROOT

import cadet_sym as cs
from cadet_sym.errors import ExportError, ModelError
from cadet_sym.results import MomentHistory, Provenance
from cadet_sym.solutions import StationaryMoments, StationarySolutions, StationarySweep

HOW = Provenance(
    "CVODES", 1e-8, statistics={"seconds": 0.25}, parameters={"r": 0.1}, model_hash="abc", version="0.1.0"
)
STATES, OUTPUTS = ("x", "v", "h.height"), ("closure",)


@pytest.fixture
def history() -> MomentHistory:
    k, n = 5, 3
    rng = np.random.default_rng(1)
    roots = rng.normal(size=(k, n, n))
    return MomentHistory(
        model="toy",
        states=STATES,
        outputs=OUTPUTS,
        time=np.linspace(0.0, 2.0, k),
        state_mean=rng.normal(size=(k, n)),
        state_covariance=roots @ roots.transpose(0, 2, 1),
        output_mean=rng.normal(size=(k, 1)),
        output_variance=rng.random((k, 1)),
        provenance=HOW,
    )


def solution(*, stable: bool = True, mean: float = 1.0) -> StationaryMoments:
    gap = np.nan
    return StationaryMoments(
        model="toy",
        states=("x", "v"),
        outputs=OUTPUTS,
        state_mean=np.array([mean, gap]),
        state_covariance=np.array([[4.0, gap], [gap, gap]]),
        output_mean=np.array([mean]),
        output_variance=np.array([4.0]),
        stable=stable,
        residual=1e-14,
        eigenvalues=np.array([-1 + 2j, -1 - 2j]),
        drifting=("v",),
        path=("Newton, 4 iterations",),
        provenance=HOW,
    )


def test_moments_are_found_by_name_for_states_filter_states_and_outputs(history):
    np.testing.assert_array_equal(history.mean["v"], history.state_mean[:, 1])
    np.testing.assert_array_equal(history.mean["h.height"], history.state_mean[:, 2])
    np.testing.assert_array_equal(history.mean["closure"], history.output_mean[:, 0])
    np.testing.assert_allclose(history.std["x"] ** 2, history.variance["x"])
    np.testing.assert_array_equal(history.variance["closure"], history.output_variance[:, 0])
    np.testing.assert_array_equal(history.covariance["v", "x"], history.covariance["x", "v"])
    np.testing.assert_array_equal(history.covariance["closure", "closure"], history.variance["closure"])
    np.testing.assert_array_equal(np.asarray(history.covariance), history.state_covariance)
    np.testing.assert_array_equal(np.asarray(history.mean), history.mean.values)
    assert dict(history.mean).keys() == {*STATES, *OUTPUTS}
    assert len(history.mean) == 4
    assert list(history.mean) == [*STATES, *OUTPUTS]


def test_an_unknown_name_is_answered_with_the_known_ones(history):
    with pytest.raises(KeyError, match="'clousre'.*x, v, h.height, closure; did you mean 'closure'"):
        history.mean["clousre"]
    with pytest.raises(KeyError, match="takes two names"):
        history.covariance["x"]
    with pytest.raises(KeyError, match="of outputs only variances"):
        history.covariance["x", "closure"]


def test_arrays_are_read_only_and_of_the_shape_the_names_say(history):
    with pytest.raises(ValueError, match="read-only"):
        history.state_mean[0, 0] = 1.0
    with pytest.raises(ValueError, match=r"state_mean of MomentHistory has shape \(5, 2\)"):
        MomentHistory(
            **{
                name: getattr(history, name)
                for name in ("model", "states", "outputs", "time", "state_covariance")
            },
            state_mean=np.zeros((5, 2)),
            output_mean=history.output_mean,
            output_variance=history.output_variance,
            provenance=HOW,
        )


def test_the_dictionary_of_a_history_has_the_shape_of_the_contract(history):
    content = json.loads(json.dumps(history.to_dict(), allow_nan=False))
    assert list(content) == ["model", "states", "time", "mean", "covariance", "outputs"]
    assert np.shape(content["mean"]) == (5, 3)
    assert np.shape(content["covariance"]) == (5, 3, 3)
    assert content["outputs"]["closure"].keys() == {"mean", "variance"}
    np.testing.assert_array_equal(content["covariance"], history.state_covariance)


def test_what_does_not_exist_is_null_never_nan():
    content = json.loads(json.dumps(solution().to_dict(), allow_nan=False))
    assert content["drifting"] == ["v"]
    (only,) = content["solutions"]
    assert only["mean"] == [1.0, None]
    assert only["covariance"] == [[4.0, None], [None, None]]
    assert only["outputs"] == {"closure": {"mean": 1.0, "variance": 4.0}}
    assert only["stable"] is True


def test_a_sweep_keeps_values_without_a_solution():
    pair = solution(), solution(stable=False, mean=-1.0)
    sweep = StationarySweep("toy", "r", np.array([1.0, 2.0, 3.0]), (pair, (), (solution(),)), {2.0: "none"})
    content = sweep.to_dict()
    assert [len(row) for row in content["solutions"]] == [2, 0, 1]
    assert content["values"] == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(sweep.values_found, [1.0, 1.0, 3.0])
    dataset = sweep.to_xarray()
    np.testing.assert_array_equal(dataset["r"], [1.0, 1.0, 3.0])
    assert "parameter r" not in dataset.attrs


def test_netcdf_gives_back_what_was_saved_with_its_attributes(history, tmp_path):
    import xarray as xr

    path = history.save(tmp_path / "new folder" / "run.nc")
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        assert dataset["covariance"].dims == ("time", "state", "state_2")
        np.testing.assert_array_equal(
            dataset["covariance"].sel(state="x", state_2="v"), history.covariance["x", "v"]
        )
        np.testing.assert_array_equal(dataset["output_mean"].sel(output="closure"), history.mean["closure"])
        assert dataset.attrs["model_hash"] == "abc"
        assert dataset.attrs["rtol"] == 1e-8
        assert dataset.attrs["cadet_sym_version"] == "0.1.0"
        assert dataset.attrs["parameter r"] == 0.1
        assert "SI" in dataset.attrs["units"]


def test_csv_has_a_column_for_every_moment(history, tmp_path):
    path = history.save(tmp_path / "run.csv")
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 5
    for k, row in enumerate(rows):
        assert float(row["covariance x h.height"]) == history.covariance["x", "h.height"][k]
        assert float(row["variance closure"]) == history.variance["closure"][k]
        assert float(row["time"]) == history.time[k]


def test_mat_gives_back_what_was_saved(history, tmp_path):
    from scipy.io import loadmat

    found = loadmat(history.save(tmp_path / "run.mat"), simplify_cells=True)
    np.testing.assert_array_equal(found["covariance"], history.state_covariance)
    assert list(found["state"]) == list(STATES)
    assert found["attributes"]["model_hash"] == "abc"


@pytest.mark.parametrize("suffix", [".nc", ".csv", ".mat"])
def test_stationary_solutions_and_sweeps_can_be_saved(suffix, tmp_path):
    sweep = StationarySweep("toy", "r", np.array([1.0, 2.0]), ((solution(),), ()), {2.0: "none"})
    for name, record in (
        ("one", solution()),
        ("two", StationarySolutions((solution(), solution(stable=False)))),
        ("sweep", sweep),
    ):
        assert record.save(tmp_path / f"{name}{suffix}").stat().st_size > 0
    assert not list(tmp_path.glob(".*"))


def test_nothing_half_written_is_left_and_the_old_file_stays(history, tmp_path, monkeypatch):
    path = history.save(tmp_path / "run.csv")
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("cadet_sym.files._save_csv", full)
    with pytest.raises(ExportError, match="No space left"):
        history.save(path)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["run.csv"]


def test_a_wrong_target_is_refused_in_one_sentence(history, tmp_path):
    with pytest.raises(ModelError, match=r"found the suffix `.txt`; end the name in .nc or .csv or .mat"):
        history.save(tmp_path / "run.txt")
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="is not a folder"):
        history.save(tmp_path / "file" / "run.nc")
    (tmp_path / "folder.nc").mkdir()
    with pytest.raises(ExportError, match="it is a folder"):
        history.save(tmp_path / "folder.nc")


def test_records_print_themselves_short(history):
    for record in (history, solution(), StationarySolutions((solution(), solution(stable=False)))):
        text, page = str(record), record._repr_html_()
        assert "closure" in text
        assert "toy" in page
        assert len(text.splitlines()) < 20
    assert "nan" not in str(solution())
    assert "drifting" in str(solution())


def test_results_show_at_a_prompt_what_they_print():
    model = cs.load(ROOT / "models" / "oleo_constant_speed.toml")
    compiled = cs.compile(model)
    history, paths = compiled.propagate(points=3, duration=1.0), cs.simulate(model, paths=50, times=[0.0, 0.5, 1.0])
    sweep = cs.sweep(model, {"zeta": np.linspace(0.01, 0.2, 12)}, points=3, duration=1.0, workers=1)
    shown = [compiled, history, paths, cs.compare(history, paths), sweep, compiled.stationary(), compiled.stationary(all=True)]
    for each in shown:
        assert repr(each) == str(each)
        assert "array(" not in str(each)
        assert len(str(each).splitlines()) > 2
    assert "12 runs" in str(sweep)
    assert f"{history.std['closure'][-1]:.6g}" in str(sweep)  # of zeta = 0.01, which is declared
