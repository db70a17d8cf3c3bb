"""Pack the moment equations as a functional mock-up unit: FMI 3.0 model exchange, source and binary.

The states of the unit are the packed moments; means and variances are its outputs, the model's parameters are tunable.
CasADi's DaeBuilder writes it. Start values are those at the parameters it was exported with.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ExportError
from cadet_sym.export.names import identifiers
from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["check_fmu_tools", "fmu_bytes"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Variable:
    """One variable of the unit."""

    name: str
    description: str
    start: float = 0.0
    unit: str = ""


def check_fmu_tools() -> str:
    """The folder of the FMI headers.

    Raises
    ------
    ExportError
        If there is no C compiler, or FMPy, which brings the headers, is not installed.
    """
    if shutil.which("gcc") is None:
        raise ExportError("an FMU holds a compiled library, and there is no C compiler `gcc` here; install one")
    spec = find_spec("fmpy")
    if spec is None or not spec.submodule_search_locations:
        raise ExportError("an FMU needs the FMI headers, which FMPy brings; install it: pip install 'cadet-sym[fmu]'")
    return str(Path(spec.submodule_search_locations[0]) / "c-code")


def fmu_bytes(lowered: MomentFunctions, p: Array, start: Array, duration: float, name: str) -> bytes:
    """The unit as the content of an .fmu file.

    Parameters
    ----------
    lowered : the moment equations.
    p, start : parameters (start values of the tunable ones) and packed moments at t = 0.
    duration : of the default experiment.
    name : model identifier, a C identifier.

    Raises
    ------
    ExportError
        If a tool is missing, or the C compiler refuses what CasADi wrote.
    """
    headers = check_fmu_tools()
    dae = _dae(lowered, p, start, duration, name)
    with _scratch_folder() as folder:
        try:
            files = dae.export_fmu({"no_warning": True, "with_serialization": False})
            _mend(folder / "modelDescription.xml")
            options = {"compiler": "gcc", "flags": ["-O1"]}
            files = dae.compile_fmu(files, {"include_dirs": [headers], "compiler_options": options})
            return Path(dae.pack_fmu(files, {})).read_bytes()
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1][:200]
            raise ExportError(f"the FMU of `{name}` could not be built: {reason}") from None


def _mend(path: Path) -> None:
    """What FMI 3.0 demands and CasADi does not write.

    Names are flat, not structured; outputs that are states with an exact start are no unknowns at the start. The date
    goes, so that the same model gives the same description.
    """
    tree = ElementTree.parse(path)
    root = tree.getroot()
    root.set("variableNamingConvention", "flat")
    root.attrib.pop("generationDateAndTime", None)
    exact = {
        variable.get("valueReference") for variable in root.iterfind("ModelVariables/*[@initial='exact']")
    }
    structure = root.find("ModelStructure")
    assert structure is not None
    for unknown in structure.findall("InitialUnknown"):
        if unknown.get("valueReference") in exact:
            structure.remove(unknown)
    tree.write(path, encoding="UTF-8", xml_declaration=True)


@contextmanager
def _scratch_folder() -> Iterator[Path]:
    """CasADi writes the parts of a unit to the working directory: give it one of its own."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield Path(folder)
        finally:
            os.chdir(before)


def _dae(lowered: MomentFunctions, p: Array, start: Array, duration: float, name: str) -> ca.DaeBuilder:
    dae = ca.DaeBuilder(name, "", {})
    t = dae.add("time", "independent")
    moments, parameters, outputs = _variables(lowered, p, start)
    states = [_add(dae, entry, "output" if _is_result(entry) else "local", "continuous") for entry in moments]
    tunable = [_add(dae, entry, "parameter", "tunable") for entry in parameters]
    y = ca.vertcat(*states)
    numbers = ca.vertcat(*tunable) if tunable else ca.MX(0, 1)
    rate = lowered.rate(t, y, numbers)
    for k, state in enumerate(states):
        dae.eq(dae.der(state), rate[k])
    values = ca.vertcat(*lowered.outputs(t, y, numbers)) if outputs else ca.MX(0, 1)
    for k, entry in enumerate(outputs):
        dae.eq(dae.add(entry.name, "output", {"description": entry.description}), ca.densify(values)[k])
    dae.set_start_time(0.0)
    dae.set_stop_time(duration)
    dae.set_tolerance(1e-7)
    return dae


def _add(dae: ca.DaeBuilder, entry: _Variable, causality: str, variability: str) -> ca.MX:
    options = {"start": entry.start, "description": entry.description, "initial": "exact"}
    return dae.add(entry.name, causality, variability, options)


def _is_result(entry: _Variable) -> bool:
    return entry.name.startswith(("mean_", "variance_"))


def _variables(
    lowered: MomentFunctions, p: Array, start: Array
) -> tuple[list[_Variable], list[_Variable], list[_Variable]]:
    """Packed moments, parameters and outputs, each with a name of letters, digits and underscores."""
    equations, packing = lowered.equations, lowered.equations.packing
    model = equations.quasi_linear.system.model
    names, outputs = equations.states, list(equations.quasi_linear.outputs)
    words = identifiers([*names, *(f"output {name}" for name in outputs)])
    moments = [(f"mean_{words[name]}", f"mean of {name}") for name in names]
    for i, j in zip(*packing.triangle, strict=True):
        row, column = names[i], names[j]
        if i == j:
            moments.append((f"variance_{words[row]}", f"variance of {row}"))
        else:
            moments.append((f"covariance_{words[row]}__{words[column]}", f"covariance of {row} and {column}"))
    if packing.distance:
        moments.append(("distance", "distance travelled"))
    moments += [(f"ground_{k}", "correlation with the ground between the wheels") for k in range(packing.ground)]
    parameters = [
        _Variable(f"parameter_{word}", model.parameters[name].text or name, float(value))
        for (name, word), value in zip(identifiers(lowered.parameters).items(), p, strict=True)
    ]
    moment_variables = [
        _Variable(name, text, float(value)) for (name, text), value in zip(moments, start, strict=True)
    ]
    results = [
        _Variable(f"{what}_{words[f'output {name}']}", f"{what} of the output {name}")
        for what in ("mean", "variance")
        for name in outputs
    ]
    return moment_variables, parameters, results
