"""The functional mock-up unit is valid, and runs in another simulator as the model runs here."""

from __future__ import annotations

import numpy as np
import pytest
from exported import compiler

import cadet_sym as cs
from cadet_sym.errors import ExportError
from cadet_sym.export import fmu

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")


@pytest.fixture(scope="module")
def unit(shipped, tmp_path_factory):
    compiler()
    compiled: cs.CompiledModel = shipped("oleo_acceleration")
    folder = compiled.export_c(tmp_path_factory.mktemp("fmu") / "oleo", prefix="oleo", fmu=True)
    return compiled, str(folder / "oleo.fmu")


def test_it_is_valid(unit):
    from fmpy.validation import validate_fmu

    assert validate_fmu(unit[1]) == []


@pytest.mark.parametrize("r", [0.1, 1.0])
def test_it_runs_elsewhere_and_takes_parameters(unit, r):
    compiled, path = unit
    found = fmpy.simulate_fmu(path, start_values={"parameter_r": r}, relative_tolerance=1e-8, output_interval=1.0)
    history = compiled.propagate(found["time"], parameters={"r": r})
    expected = {
        "mean_x": history.mean["x"],
        "variance_v": history.variance["v"],
        "variance_output_damper_force": history.variance["damper_force"],
        "mean_output_closure": history.mean["closure"],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-5, atol=1e-5 * np.abs(values).max() + 1e-12)


def test_means_and_variances_are_outputs_and_parameters_tunable(unit):
    description = fmpy.read_model_description(unit[1])
    kinds = {v.name: (v.causality, v.variability) for v in description.modelVariables}
    assert kinds["parameter_r"] == ("parameter", "tunable")
    assert kinds["mean_x"][0] == kinds["variance_h_height"][0] == kinds["variance_output_closure"][0] == "output"


def test_without_a_compiler_nothing_is_written(shipped, tmp_path, monkeypatch):
    monkeypatch.setattr(fmu.shutil, "which", lambda _: None)
    with pytest.raises(ExportError, match="C compiler"):
        shipped("duffing").export_c(tmp_path / "c", fmu=True)
    assert not list(tmp_path.iterdir())
