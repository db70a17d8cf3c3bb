"""The functional mock-up units are valid, and run in another simulator as the model runs here."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from exported import compiler

import cadet_sym as cs
from cadet_sym.errors import ExportError
from cadet_sym.export import fmu
from cadet_sym.language.modelfile import loads

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")

KINDS = ["", "_cs"]

STANDING = """
schema = 1
name = "Starts in the stationary state"
[parameters]
k = 30.0
rough = 0.1
V = 4.0
[rates]
x = "v"
v = "-k*(x - h) - 2*v - v**3 - (5 if t > 1.23 and t < 1.3 else 0)"
[contacts]
h = {}
[ground]
kind = "exponential"
sigma = "rough"
cutoff = 0.5
[travel]
speed = "V"
[initial]
START
[outputs]
closure = "x - h"
[run]
duration = 3.0
points = 4
"""


@pytest.fixture(scope="module", params=["standing", "steady"])
def unit(request, tmp_path_factory):
    compiler()
    start = 'whole = "stationary"' if request.param == "steady" else 'x = "h"'
    text = STANDING.replace("START", start)
    if request.param == "steady":  # nothing stationary depends on the time
        text = text.replace(" - (5 if t > 1.23 and t < 1.3 else 0)", "")
    compiled = cs.compile(loads(text))
    return compiled, compiled.export_c(tmp_path_factory.mktemp("fmu") / "x", prefix="steady", fmu=True)


def agree(compiled: cs.CompiledModel, found, parameters) -> None:
    history = compiled.propagate(found["time"], parameters=parameters)
    expected = {
        "mean_x": history.mean["x"],
        "variance_x": history.variance["x"],
        "variance_v": history.variance["v"],
        "mean_output_closure": history.mean["closure"],
        "variance_output_closure": history.variance["closure"],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-5, atol=1e-5 * np.abs(values).max() + 1e-10, err_msg=name)


@pytest.mark.parametrize("kind", KINDS)
def test_they_are_valid(kind, unit):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(unit[1] / f"steady{kind}.fmu")) == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("parameters", [{}, {"k": 20.0, "rough": 0.25}], ids=["declared", "changed"])
def test_they_run_elsewhere_and_take_parameters(kind, parameters, unit):
    compiled, folder = unit
    found = fmpy.simulate_fmu(
        str(folder / f"steady{kind}.fmu"),
        start_values={f"parameter_{name}": value for name, value in parameters.items()},
        relative_tolerance=1e-8, output_interval=0.05, record_events=False, stop_time=3.0,
    )
    start = compiled.equations.packing.unpack(compiled.initial(parameters))[1]
    assert found["variance_x"][0] == pytest.approx(start[0, 0], rel=1e-6)
    agree(compiled, found, parameters)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [path.stem for path in sorted((ROOT / "models").glob("*.toml"))])
def test_every_model_that_ships(name, kind, shipped, tmp_path):
    from fmpy.validation import validate_fmu

    compiled = shipped(name)
    folder = compiled.export_c(tmp_path / "c", prefix=name, fmu=True)
    path = str(folder / f"{name}{kind}.fmu")
    assert validate_fmu(path) == []
    duration = compiled.model.number(compiled.model.run.duration) / (4 if name == "half_car_acceleration" else 1)
    found = fmpy.simulate_fmu(
        path, relative_tolerance=1e-8, output_interval=duration / 200, stop_time=duration, record_events=False
    )
    history = compiled.propagate(found["time"], rtol=1e-9)
    words = fmu._words(compiled.states, compiled.outputs)
    for state in compiled.states:
        expected = history.variance[state]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[f"variance_{words[state]}"], expected, rtol=1e-5, atol=1e-5 * scale + 1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_means_and_variances_are_outputs_and_parameters_tunable(kind, unit):
    description = fmpy.read_model_description(str(unit[1] / f"steady{kind}.fmu"))
    kinds = {v.name: (v.causality, v.variability) for v in description.modelVariables}
    assert kinds["parameter_k"] == ("parameter", "tunable")
    assert kinds["mean_x"][0] == kinds["variance_h_height"][0] == kinds["variance_output_closure"][0] == "output"


def test_a_co_simulation_goes_back_and_refuses_what_it_cannot_do(unit, tmp_path):
    from fmpy.fmi1 import FMICallException
    from fmpy.fmi2 import FMU2Slave

    compiled, folder = unit
    description = fmpy.read_model_description(str(folder / "steady_cs.fmu"))
    reference = {v.name: v.valueReference for v in description.modelVariables}
    place = fmpy.extract(str(folder / "steady_cs.fmu"), str(tmp_path))
    slave = FMU2Slave(guid=description.guid, unzipDirectory=place, modelIdentifier="steady", instanceName="x")
    slave.instantiate()
    with pytest.raises(FMICallException):
        slave.setupExperiment(startTime=1.0)
    slave.reset()
    slave.setupExperiment(tolerance=1e-9, startTime=0.0)
    slave.enterInitializationMode()
    slave.setReal([reference["parameter_rough"]], [0.2])
    slave.exitInitializationMode()
    with pytest.raises(FMICallException):
        slave.setReal([reference["mean_x"]], [0.2])
    slave.doStep(0.0, 0.7)
    kept = slave.getFMUstate()
    text = slave.serializeFMUstate(kept)
    ends = []
    for again in (kept, slave.deSerializeFMUstate(text)):
        slave.setFMUstate(again)
        slave.doStep(0.7, 1.1)
        slave.doStep(1.8, 4.2)  # beyond the model's own run
        ends.append(slave.getReal([reference["variance_v"]])[0])
    assert ends[0] == ends[1]
    history = compiled.propagate([0.0, 6.0], parameters={"rough": 0.2})
    assert ends[0] == pytest.approx(float(history.variance["v"][-1]), rel=1e-6)
    with pytest.raises(FMICallException):
        slave.doStep(3.0, 1.0)
    slave.terminate()
    slave.freeInstance()


def test_the_same_model_gives_the_same_unit(unit, tmp_path):
    compiled, folder = unit
    again = compiled.export_c(tmp_path / "again", prefix="steady", fmu=True)
    for kind in KINDS:
        assert (again / f"steady{kind}.fmu").read_bytes() == (folder / f"steady{kind}.fmu").read_bytes()


def test_without_a_compiler_nothing_is_written(shipped, tmp_path, monkeypatch):
    monkeypatch.setattr(fmu.shutil, "which", lambda _: None)
    with pytest.raises(ExportError, match="C compiler"):
        shipped("duffing").export_c(tmp_path / "c", fmu=True)
    assert not list(tmp_path.iterdir())


def test_a_compiler_that_fails_is_one_sentence_and_nothing_is_written(shipped, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    (tmp_path / "bin").mkdir()
    fake = tmp_path / "bin" / "gcc"
    fake.write_text("#!/bin/sh\necho 'no room' >&2\nexit 1\n")
    fake.chmod(0o755)
    with pytest.raises(ExportError, match="could not be built: no room"):
        shipped("duffing").export_c(tmp_path / "c", fmu=True)
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]
