"""Pack a C library as functional mock-up units: FMI 3.0 model exchange, and FMI 2.0 co-simulation; source and binary.

The states of a unit are the packed moments; means and variances of states and outputs are its outputs, the model's
parameters are tunable. What the moments are at the start follows from the parameters when the initialisation ends. In
co-simulation the library's own propagator makes every step as accurate as the tolerance asks for.
"""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ExportError
from cadet_sym.export.fmu_stubs import stubs_2, stubs_3
from cadet_sym.export.names import identifiers
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.version import VERSION

__all__ = ["check_fmu_tools", "unit_files"]

Array = npt.NDArray[np.float64]

PLATFORMS: Mapping[tuple[str, str], tuple[str, str, str]] = {
    # system and machine: folder of FMI 2.0, of FMI 3.0, and what a shared library ends with
    ("Linux", "x86_64"): ("linux64", "x86_64-linux", ".so"),
    ("Linux", "aarch64"): ("aarch64-linux", "aarch64-linux", ".so"),
    ("Darwin", "x86_64"): ("darwin64", "x86_64-darwin", ".dylib"),
    ("Darwin", "arm64"): ("darwin64", "aarch64-darwin", ".dylib"),
    ("Windows", "AMD64"): ("win64", "x86_64-windows", ".dll"),
}

NOT_IN_A_UNIT = ("main.c", "test.c")


@dataclass(frozen=True)
class _Variable:
    """One variable of a unit; its value reference is its place in the list, the time being the first."""

    name: str
    description: str
    causality: str = "local"
    start: float | None = None  # of a parameter
    derivative_of: int | None = None


def check_fmu_tools() -> str:
    """The folder of the FMI headers.

    Raises
    ------
    ExportError
        If there is no C compiler, FMPy, which brings the headers, is not installed, or units have no name for this
        platform.
    """
    if shutil.which("gcc") is None:
        raise ExportError("an FMU holds a compiled library, and there is no C compiler `gcc` here; install one")
    spec = find_spec("fmpy")
    if spec is None or not spec.submodule_search_locations:
        raise ExportError("an FMU needs the FMI headers, which FMPy brings; install it: pip install 'cadet-sym[fmu]'")
    if _machine() not in PLATFORMS:
        raise ExportError(f"FMI has no name for this platform ({' '.join(_machine())}); export C and build it there")
    return str(Path(spec.submodule_search_locations[0]) / "c-code")


def _machine() -> tuple[str, str]:
    return platform.system(), platform.machine()


def unit_files(
    lowered: MomentFunctions, p: Array, duration: float, prefix: str, files: Mapping[str, str], templates: Mapping[str, str]
) -> dict[str, bytes]:
    """The units: file name to content.

    Parameters
    ----------
    lowered : the moment equations.
    p : start values of the parameters.
    duration : of the default experiment.
    prefix : model identifier, a C identifier.
    files : the C library, name to text.
    templates : what to add to it for every standard: "unit.h", "fmi2.c", "fmi3.c".

    Raises
    ------
    ExportError
        If a tool is missing, or the C compiler refuses the sources.
    """
    headers = check_fmu_tools()
    library = {name: text for name, text in files.items() if name.endswith((".c", ".h")) and name not in NOT_IN_A_UNIT}
    library.pop("reference.h", None)
    digest = hashlib.sha256("".join(f"{name}\n{text}" for name, text in sorted(library.items())).encode())
    token = f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"
    glue = {
        "unit.h": templates["unit.h"].replace("@token@", token),
        "fmi2.c": templates["fmi2.c"].replace("@stubs@", stubs_2()),
        "fmi3.c": templates["fmi3.c"].replace("@stubs@", stubs_3()),
    }
    binaries = _compiled({**library, **glue}, headers, prefix)
    variables = _variables(lowered, p)
    about = _About(prefix, lowered.equations.quasi_linear.system.model.name or prefix, token, duration)
    units = {}
    for standard, suffix, describe in (("fmi3", "", _description_3), ("fmi2", "_cs", _description_2)):
        parts = {name: text for name, text in glue.items() if name in ("unit.h", f"{standard}.c")}
        sources = sorted(name for name in {**library, **parts} if name.endswith(".c"))
        content: dict[str, bytes] = {
            "modelDescription.xml": describe(about, variables, lowered, sources),
            **{f"sources/{name}": text.encode() for name, text in {**library, **parts}.items()},
        }
        if standard == "fmi3":
            content["sources/buildDescription.xml"] = _build_description(prefix, sources)
        folder_2, folder_3, ending = PLATFORMS[_machine()]
        folder = folder_3 if standard == "fmi3" else folder_2
        content[f"binaries/{folder}/{prefix}{ending}"] = binaries[standard]
        units[f"{prefix}{suffix}.fmu"] = _packed(content)
    return units


def _compiled(sources: Mapping[str, str], headers: str, prefix: str) -> dict[str, bytes]:
    """A shared library for each standard; what they share is compiled once."""
    ending = PLATFORMS[_machine()][2]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        names = sorted(name for name in sources if name.endswith(".c"))
        _run(["gcc", "-c", "-O1", "-std=c99", "-fPIC", "-fvisibility=hidden", f"-I{headers}", *names], folder, prefix)
        made = {}
        for standard, other in (("fmi2", "fmi3"), ("fmi3", "fmi2")):
            objects = [f"{name[:-2]}.o" for name in names if name != f"{other}.c"]
            library = f"{standard}{ending}"
            _run(["gcc", "-shared", "-s", "-o", library, *objects, "-lm"], folder, prefix)
            made[standard] = (folder / library).read_bytes()
        return made


def _run(command: Sequence[str], folder: Path, prefix: str) -> None:
    try:
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    except OSError as error:
        raise ExportError(f"the FMU of `{prefix}` could not be built: {error.strerror or error}") from error
    if run.returncode:
        reason = (run.stderr.strip().splitlines() or ["no reason given"])[-1][:200]
        raise ExportError(f"the FMU of `{prefix}` could not be built: {reason}")


def _packed(content: Mapping[str, bytes]) -> bytes:
    """A zip file that depends on its content alone."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(content):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content[name])
    return buffer.getvalue()


@dataclass(frozen=True)
class _About:
    """What a description begins with."""

    prefix: str
    name: str
    token: str
    duration: float

    @property
    def tool(self) -> str:
        """Who wrote it."""
        return f"cadet-sym {VERSION}"


def _description_2(
    about: _About, variables: Sequence[_Variable], lowered: MomentFunctions, sources: Sequence[str]
) -> bytes:
    attributes = {"fmiVersion": "2.0", "modelName": about.name, "guid": about.token, "generationTool": about.tool,
                  "variableNamingConvention": "flat"}
    root = ElementTree.Element("fmiModelDescription", attributes)
    flags = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUstate", "canSerializeFMUstate",
             "canNotUseMemoryManagementFunctions")
    unit = ElementTree.SubElement(root, "CoSimulation", {"modelIdentifier": about.prefix, **dict.fromkeys(flags, "true")})
    files = ElementTree.SubElement(unit, "SourceFiles")
    for name in sources:
        ElementTree.SubElement(files, "File", {"name": name})
    ElementTree.SubElement(root, "DefaultExperiment", _experiment(about))
    listed = ElementTree.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        entry = ElementTree.SubElement(listed, "ScalarVariable", _attributes(variable, reference))
        start = {} if variable.start is None else {"start": repr(variable.start)}
        derivative = {} if variable.derivative_of is None else {"derivative": str(variable.derivative_of + 1)}
        ElementTree.SubElement(entry, "Real", {**derivative, **start})
    structure = ElementTree.SubElement(root, "ModelStructure")
    for kind in ("Outputs", "InitialUnknowns"):
        part = ElementTree.SubElement(structure, kind)
        for reference, variable in enumerate(variables):
            if variable.causality == "output":
                ElementTree.SubElement(part, "Unknown", {"index": str(reference + 1)})
    return _xml(root)


def _description_3(
    about: _About, variables: Sequence[_Variable], lowered: MomentFunctions, sources: Sequence[str]
) -> bytes:
    attributes = {"fmiVersion": "3.0", "modelName": about.name, "instantiationToken": about.token,
                  "generationTool": about.tool, "variableNamingConvention": "flat"}
    root = ElementTree.Element("fmiModelDescription", attributes)
    ElementTree.SubElement(root, "ModelExchange", {"modelIdentifier": about.prefix})
    ElementTree.SubElement(root, "DefaultExperiment", _experiment(about))
    listed = ElementTree.SubElement(root, "ModelVariables")
    size = lowered.facts.packing.size
    for reference, variable in enumerate(variables):
        start = {} if variable.start is None else {"start": repr(variable.start)}
        derivative = {} if variable.derivative_of is None else {"derivative": str(variable.derivative_of)}
        ElementTree.SubElement(listed, "Float64", {**_attributes(variable, reference), **derivative, **start})
    structure = ElementTree.SubElement(root, "ModelStructure")
    outputs = [str(k) for k, variable in enumerate(variables) if variable.causality == "output"]
    derivatives = [str(1 + size + k) for k in range(size)]
    unknown = sorted({*outputs, *derivatives, *(str(1 + k) for k in range(size))}, key=int)
    for kind, references in (("Output", outputs), ("ContinuousStateDerivative", derivatives), ("InitialUnknown", unknown)):
        for reference in references:
            ElementTree.SubElement(structure, kind, {"valueReference": reference})
    return _xml(root)


def _build_description(prefix: str, sources: Sequence[str]) -> bytes:
    root = ElementTree.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = ElementTree.SubElement(root, "BuildConfiguration", {"modelIdentifier": prefix})
    files = ElementTree.SubElement(build, "SourceFileSet", {"language": "C99"})
    for name in sources:
        ElementTree.SubElement(files, "SourceFile", {"name": name})
    ElementTree.SubElement(build, "Library", {"name": "m"})
    return _xml(root)


def _xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)


def _experiment(about: _About) -> dict[str, str]:
    return {"startTime": "0.0", "stopTime": repr(about.duration), "tolerance": "1e-7"}


def _attributes(variable: _Variable, reference: int) -> dict[str, str]:
    kind = {"name": variable.name, "valueReference": str(reference), "causality": variable.causality}
    if variable.description:
        kind["description"] = variable.description
    if variable.causality == "independent":
        return {**kind, "variability": "continuous"}
    if variable.start is not None:
        return {**kind, "variability": "tunable", "initial": "exact"}
    return {**kind, "variability": "continuous", "initial": "calculated"}


def _variables(lowered: MomentFunctions, p: Array) -> list[_Variable]:
    """The time, packed moments, their derivatives, parameters, outputs: in the order of their value references."""
    facts = lowered.facts
    moments = list(_moments(facts.states, facts.outputs, lowered))
    declared = lowered.equations.quasi_linear.system.model.parameters
    words = _words(facts.states, facts.outputs)
    found = [_Variable("time", "", "independent"), *moments]
    found += [_Variable(f"der_{m.name}", "", derivative_of=1 + k) for k, m in enumerate(moments)]
    for (name, word), value in zip(identifiers(lowered.parameters).items(), p, strict=True):
        text = ", ".join(part for part in (declared[name].text or name, declared[name].unit) if part)
        found.append(_Variable(f"parameter_{word}", text, "parameter", float(value)))
    found += [
        _Variable(f"{what}_{words[f'output {name}']}", f"{what} of the output {name}", "output")
        for what in ("mean", "variance")
        for name in facts.outputs
    ]
    return found


def _words(states: Sequence[str], outputs: Sequence[str]) -> dict[str, str]:
    return identifiers([*states, *(f"output {name}" for name in outputs)])


def _moments(states: Sequence[str], outputs: Sequence[str], lowered: MomentFunctions) -> Iterator[_Variable]:
    packing, words = lowered.facts.packing, _words(states, outputs)
    for name in states:
        yield _Variable(f"mean_{words[name]}", f"mean of {name}", "output")
    for i, j in zip(*packing.triangle, strict=True):
        row, column = states[int(i)], states[int(j)]
        if i == j:
            yield _Variable(f"variance_{words[row]}", f"variance of {row}", "output")
        else:
            yield _Variable(f"covariance_{words[row]}__{words[column]}", f"covariance of {row} and {column}")
    if packing.distance:
        yield _Variable("distance", "distance travelled")
    for k in range(packing.ground):
        yield _Variable(f"ground_{k}", "correlation with the ground between the wheels")
