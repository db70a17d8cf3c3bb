"""Write the moment equations of a model as a C99 library that needs nothing but libm.

The equations come from CasADi's graphs (`program`), what integrates and solves them from templates that are the same
for every model. The text depends on the model and on the versions of cadet-sym and CasADi alone: no date, path or host.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files as resources
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.export.calls import CalledFunctions
from cadet_sym.export.description import equations_text
from cadet_sym.export.fmu import check_fmu_tools, unit_files
from cadet_sym.export.folder import check_folder, write_folder
from cadet_sym.export.functions import Program
from cadet_sym.export.ground import GroundTables, ground_tables, start_values
from cadet_sym.export.matlab import matlab_text
from cadet_sym.export.names import c_comment, c_string, identifiers, prefix_of
from cadet_sym.export.program import translate
from cadet_sym.export.reference import Sample, reference_text, sample
from cadet_sym.export.tables import array, constant, rows
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.portable import PortableFunctions, portable
from cadet_sym.solve.start import profile_mean
from cadet_sym.version import VERSION

__all__ = ["Library", "Run", "export_c", "library"]

Array = npt.NDArray[np.float64]

CASADI_VERSION: str = ca.CasadiMeta.version()

SCALARS = ("t", "s", "V")

SOURCES: Mapping[str, tuple[str, ...]] = {
    # what is appended to the library's name: the functions in that file
    "_rate": ("rate", "slope"),
    "_jacobian": ("jacobian",),
    "_outputs": ("outputs",),
    "_held": ("held", "held_jacobian", "held_outputs"),
    "_motion": ("start", "motion", "switches"),
}

AT_MOST = ", at most: expectations choose the order of their quadrature by the data"

TEMPLATES = ("linear", "propagate", "stationary", "breakpoints")

MOVED = ("rate", "jacobian", "slope", "held", "held_jacobian")
"""Functions that leave the ground between the wheels to a loop, where there is any."""


@dataclass(frozen=True)
class Run:
    """What a library starts from: the parameters' numbers, the moments at the start, the model's own run."""

    p: Array
    start: Array
    duration: float
    points: int


def export_c(
    lowered: MomentFunctions,
    run: Run,
    path: str | Path,
    *,
    prefix: str | None = None,
    force: bool = False,
    fmu: bool = False,
    matlab: bool = False,
) -> Path:
    """Write the library to a folder, whole or not at all.

    Parameters
    ----------
    lowered : the moment equations.
    run : parameters and start that become the library's defaults.
    path : folder to write to; made if it is missing.
    prefix : what all public names begin with; by default the model's name.
    force : write to a folder that holds other files, too.
    fmu : add functional mock-up units, NAME.fmu (FMI 3.0 model exchange) and NAME_cs.fmu (FMI 2.0 co-simulation).
    matlab : add the equations as a MATLAB (or GNU Octave) function.

    Raises
    ------
    ExportError
        If an operation has no C, the folder is not ours, or it cannot be written to; nothing is written then.
    """
    check_folder(path, force=force)
    if fmu:
        check_fmu_tools()
    written = library(lowered, run, prefix)
    library_files = written.files()
    files: dict[str, str | bytes] = {**library_files}
    if matlab:
        files[f"{written.prefix}.m"] = matlab_text(lowered.unrolled(), run.p, run.start, written.prefix)
    if fmu:
        nominals = {"nominals": rows(f"{size:g}" for size in written.sample.size)}
        templates = {name: written.filled(name, nominals) for name in ("unit.h", "fmi2.c", "fmi3.c")}
        files |= unit_files(lowered, run.p, run.duration, written.prefix, library_files, templates)
    return write_folder(path, files, written.about, force=force)


def library(lowered: MomentFunctions, run: Run, prefix: str | None = None) -> Library:
    """Translate everything, write nothing."""
    model = lowered.equations.quasi_linear.system.model
    functions = portable(lowered)
    name = prefix_of(prefix or model.name or "model")
    programs, calls = {}, CalledFunctions(name)
    for key in (key for keys in SOURCES.values() for key in keys):
        function = getattr(functions, key)
        moved = "_parts" if key in MOVED and functions.gain.nnz() else ""
        programs[key] = translate(function, f"{name}_{function.name()}{moved}", SCALARS, calls)
    return Library(lowered, functions, programs, calls, run, name)


@dataclass(frozen=True, eq=False)
class Library:
    """A model's library as text."""

    lowered: MomentFunctions
    functions: PortableFunctions
    programs: Mapping[str, Program]
    calls: CalledFunctions
    run: Run
    prefix: str

    @property
    def about(self) -> dict[str, str]:
        """What wrote it."""
        return {
            "written by": "cadet-sym",
            "kind": "C library",
            "model": self.model_name,
            "prefix": self.prefix,
            "cadet-sym": VERSION,
            "casadi": CASADI_VERSION,
        }

    @property
    def model_name(self) -> str:
        """The model's own name."""
        return self.lowered.equations.quasi_linear.system.model.name

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the augmented states."""
        return self.lowered.equations.states

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.lowered.equations.quasi_linear.outputs)

    @cached_property
    def ground(self) -> GroundTables:
        """The ground between wheels on one track, and the Jacobian's pattern."""
        return ground_tables(self.functions, self.lowered.equations.packing.n)

    @property
    def pattern(self) -> ca.Sparsity:
        """Places of the Jacobian's entries."""
        return self.ground.pattern

    @cached_property
    def sample(self) -> Sample:
        """Moments such as a run has."""
        return sample(self.lowered, self.run.p, self.run.start, self.run.duration)

    @property
    def steady(self) -> bool:
        """Whether the run starts in the stationary state."""
        return self.lowered.equations.quasi_linear.system.model.initial.whole

    def files(self) -> dict[str, str]:
        """Name to content of every file."""
        name = self.prefix
        found = {f"{name}.h": self.filled("header.h", self._header()), f"{name}_real.h": self.filled("real.h")}
        found[f"{name}.c"] = self._tables()
        called = [each for program in self.programs.values() for each in program.called]
        if called:
            found[f"{name}_called.h"] = self.filled("called.h", {"prototypes": self.calls.header(called)})
            found[f"{name}_called.c"] = self.filled("called.c", {"functions": self.calls.source(called)})
        for suffix, keys in SOURCES.items():
            parts = [self.programs[key] for key in keys]
            include = "called" if any(part.called for part in parts) else "real"
            found[f"{name}{suffix}.c"] = f'#include "{name}_{include}.h"\n\n' + "\n".join(part.text for part in parts)
        choices = {
            "switches": self._switches,
            "steady": int(self.steady),
            "gaps": len(self.ground.gaps),
            "real": "ground" if self.ground.gaps else "real",
            "settling": len(self.functions.settling),
            "filter": rows(f"{{{each.place}, {each.row}, {each.column}}}" for each in self.functions.settling),
        }
        for template in TEMPLATES:
            found[f"{name}_{template}.c"] = self.filled(f"{template}.c", choices)
        found[f"{name}_start.c"] = self._start()
        if self.ground.gaps:
            found[f"{name}_ground.h"] = self.filled("ground.h", self.ground.header())
            found[f"{name}_ground.c"] = self.filled("ground.c", self.ground.source(name))
        blocks = "blocks" if self.ground.gaps else "dense"
        found[f"{name}_{blocks}.c"] = self.filled(f"{blocks}.c")
        sources = sorted(file for file in found if file.endswith(".c"))
        found["main.c"] = self.filled("main.c")
        found["test.c"] = self.filled("test.c")
        run = self.run.p, self.run.start, self.run.duration
        found["reference.h"] = reference_text(self.lowered, *run, self.sample)
        found["Makefile"] = self.filled("Makefile", {"objects": " ".join(f"{s[:-2]}.o" for s in sources)})
        found["CMakeLists.txt"] = self.filled("CMakeLists.txt", {"sources": " ".join(sources)})
        found["README.md"] = self._readme()
        return found

    @cached_property
    def _profile(self) -> Array:
        """What the profile of the ground behind the start adds to the means."""
        return profile_mean(self.lowered, self.run.p)

    def _start(self) -> str:
        """The moments at the start."""
        if self.steady:
            return self.filled("steady.c", {"tables": array("static const R start", map(constant, self.run.start.tolist()))})
        include = f'#include "{self.prefix}_ground.h"\n' if self.ground.gaps else ""
        prototype = f"void {self.prefix}_start_parts(const R *restrict p, R *restrict parts);\n"
        values = start_values(self.functions, self.ground, map(constant, self._profile.tolist()))
        return self.filled("start.c", {**values, "include": include + prototype})

    def filled(self, template: str, values: Mapping[str, object] | None = None) -> str:
        """A template with the names of this library."""
        text = resources("cadet_sym.export").joinpath("templates", template).read_text(encoding="utf-8")
        for key, value in {**(values or {}), "p": self.prefix, "P": self.prefix.upper()}.items():
            text = text.replace(f"@{key}@", str(value))
        return text

    @property
    def _switches(self) -> int:
        """Functions whose changes of sign are breakpoints."""
        return self.functions.switches.size1_out(0)

    def _header(self) -> dict[str, object]:
        packing = self.lowered.equations.packing
        alongside = [", the distance"] * packing.distance + [", the ground between the wheels"] * bool(packing.ground)
        upper = self.prefix.upper()
        return {
            "title": c_comment(self.model_name or self.prefix),
            "version": VERSION,
            "casadi": CASADI_VERSION,
            "states": packing.n,
            "parameters": len(self.lowered.parameters),
            "outputs": len(self.outputs),
            "moments": packing.moments,
            "size": packing.size,
            "alongside": "".join(alongside),
            "nonzeros": self.pattern.nnz(),
            "switches": self._switches,
            "distance": int(packing.distance),
            "dependence": AT_MOST if self.calls.chooses else "; they do not depend on the data",
            "operations": "\n".join(f" * {line}" for line in self._costs()),
            "rate_operations": self._rate_operations,
            "output_operations": self.programs["outputs"].operations,
            "initial_note": self._initial_note,
            "steady": int(self.steady),
            "explicit": int(bool(self.lowered.facts.explicit)),
            "factors": self._factors(),
            "squares": "@P@_STATES * @P@_STATES" if self.ground.gaps else "@P@_SIZE * @P@_SIZE",
            "state_enum": _enumeration(f"{upper}_STATE_", "states", self.states),
            "parameter_enum": _enumeration(f"{upper}_PARAMETER_", "parameters", self._described_parameters()),
            "output_enum": _enumeration(f"{upper}_OUTPUT_", "outputs", self.outputs),
        }

    @property
    def _initial_note(self) -> str:
        if self.steady:
            return ", stationary at the default parameters, whatever p says; use @p@_start"
        if self._profile.any():
            return "; what the profile behind the start adds to the means is that of the default parameters"
        return ""

    def _factors(self) -> str:
        """Fields of a decomposed linear system."""
        if not self.ground.gaps:
            return "    @p@_real matrix[@P@_SIZE * @P@_SIZE];\n    int pivots[@P@_SIZE];"
        head, ground = self.ground.head, self.ground.active - self.ground.head
        return (
            f"    @p@_real values[@P@_NONZEROS];\n    @p@_real blocks[{self.ground.blocks}];\n"
            f"    @p@_real head[{head} * {head}];\n    @p@_real across[{head} * {ground}];\n"
            f"    int pivots[@P@_SIZE];\n    int coupled[{head}];"
        )

    @property
    def _rate_operations(self) -> int:
        return self.programs["rate"].operations + self.ground.operations

    def _described_parameters(self) -> dict[str, str]:
        """Parameters with what the model says about them."""
        declared = self.lowered.equations.quasi_linear.system.model.parameters
        return {
            name: ", ".join(part for part in (name, declared[name].text, declared[name].unit) if part)
            for name in self.lowered.parameters
        }

    def _costs(self) -> Iterable[str]:
        for key in ("rate", "jacobian", "outputs"):
            counts = ", ".join(f"{count} {kind}" for kind, count in self.programs[key].counts.items())
            yield from textwrap.wrap(f"{key}: {counts or 'nothing'}", 110, subsequent_indent="  ")
        if self.ground.gaps:
            yield f"rate, the ground between the wheels: {self.ground.operations} additions and multiplications"

    def _tables(self) -> str:
        name, pattern = self.prefix, self.pattern
        columns, rows = pattern.colind(), pattern.row()
        V = float(self.lowered.motion(0.0, self.run.p)[0])
        parts = [
            f'#include "{name}_real.h"\n',
            f"const char *const {name}_model = {c_string(self.model_name)};",
            array(f"const char *const {name}_state_names", map(c_string, self.states)),
            array(f"const char *const {name}_parameter_names", map(c_string, self.lowered.parameters)),
            array(f"const char *const {name}_output_names", map(c_string, self.outputs)),
            array(f"const R {name}_default_parameters", map(constant, self.run.p.tolist())),
            f"const R {name}_duration = {constant(self.run.duration)};",
            f"const int {name}_points = {self.run.points};",
            f"const R {name}_start_speed = {constant(V)};",
            array(f"const int {name}_jacobian_column", map(str, columns)),
            array(f"const int {name}_jacobian_row", map(str, rows)),
        ]
        return "\n".join(parts) + "\n"

    def _readme(self) -> str:
        name, upper = self.prefix, self.prefix.upper()
        packing = self.lowered.equations.packing
        equations = "\n".join(f"    {line}".rstrip() for line in equations_text(self.lowered.equations))
        costs = "\n".join(f"    {line}" for line in self._costs())
        return self.filled(
            "README.md",
            {
                "title": self.model_name or name,
                "text": self.lowered.equations.quasi_linear.system.model.text,
                "equations": equations,
                "costs": costs,
                "dependence": AT_MOST if self.calls.chooses else ", the same for all data",
                "branches": " at most" if self.calls.chooses else " and no branch that depends on data",
                "version": VERSION,
                "casadi": CASADI_VERSION,
                "size": packing.size,
                "states": packing.n,
                "step_operations": 4 * self._rate_operations + 13 * packing.size + 4,
                "scratch": max(program.scratch for program in self.programs.values()),
                "upper": upper,
            },
        )


def _enumeration(prefix: str, title: str, names: Sequence[str] | Mapping[str, str]) -> str:
    """An enum with one member a name; comments give the names as the model has them."""
    if not names:
        return f"/* no {title} */"
    comments = names if isinstance(names, Mapping) else {name: name for name in names}
    members = [
        f"    {prefix}{word} = {k}{',' if k + 1 < len(names) else ''} /* {c_comment(comments[name])} */"
        for k, (name, word) in enumerate(identifiers(names).items())
    ]
    return "\n".join([f"enum {{ /* {title} */", *members, "};"])
