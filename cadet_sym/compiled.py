"""Compile a model: every stage from the declaration to CasADi functions, and what can be done with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
import numpy.typing as npt

from cadet_sym.compilation import Compiled, from_file, from_model
from cadet_sym.errors import ModelError
from cadet_sym.lowering.facts import Declaration
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.packing import Packing
from cadet_sym.results import MomentHistory, PeriodicMoments, Provenance
from cadet_sym.runs import Names, Runs, output_times, run_all, run_cycle, starts_of
from cadet_sym.solutions import StationaryMoments, StationarySolutions
from cadet_sym.solve.breakpoints import find_breakpoints
from cadet_sym.solve.start import initial_moments
from cadet_sym.tables import Shown

if TYPE_CHECKING:
    from cadet_sym.language.model import Model
    from cadet_sym.moments import MomentEquations
    from cadet_sym.solve.frozen import FrozenProblem

__all__ = ["CompiledModel", "compile"]

Array = npt.NDArray[np.float64]


def compile(
    model: Model | str | Path,
    *,
    parameters: Mapping[str, Any] | None = None,
    grid: tuple[int, int] | None = None,
    jit: bool = False,
) -> CompiledModel:
    """Turn a model, or the file it is declared in, into its compiled moment equations.

    What is made is kept on disk and found again by what it was made of (see `cadet_sym.cache`).

    Parameters
    ----------
    model : a `Model`, or the path of a model file.
    parameters : values in place of those declared; the model is checked with them.
    grid : elements and modes an element between two wheels of one track (see `cadet_sym.delay`); by default the
        cheapest that resolves the vehicle's modes at the speeds of the run.
    jit : take seconds to make good machine code of models with hundreds of numbers between wheels that follow each
        other; it is kept, so that it is made once. That of others is made in any case.

    Raises
    ------
    ModelError, LinearisationError
        If the model is wrong, or an element has no Gaussian expectation.
    """
    values = dict(parameters or {})
    if isinstance(model, str | Path):
        made = from_file(Path(model), values, grid)
    else:
        made = from_model(model.with_parameters(values) if values else model, grid)
    made.functions.jit = jit
    return CompiledModel(made)


@dataclass(frozen=True, eq=False, repr=False)
class CompiledModel(Shown):
    """A model whose moment equations are ready to be integrated, solved for their fixed points, or exported."""

    _made: Compiled

    def __str__(self) -> str:
        kinds = {"states": self.states, "outputs": self.outputs, "parameters": self.parameters}
        lines = (f"  {kind}: {', '.join(names)}" for kind, names in kinds.items() if names)
        return "\n".join([f"{self.declaration.name}: {self.packing.moments} moment equations", *lines])

    @property
    def functions(self) -> MomentFunctions:
        """The moment equations as CasADi functions."""
        return self._made.functions

    @property
    def declaration(self) -> Declaration:
        """The numbers that the model declares."""
        return self._made.declaration

    @cached_property
    def model(self) -> Model:
        """The model it was made of."""
        return self._made.model()

    @property
    def equations(self) -> MomentEquations:
        """The moment equations in symbols; through them every earlier stage."""
        return self.functions.equations

    @property
    def packing(self) -> Packing:
        """The order in which the moments stand in one vector."""
        return self.functions.facts.packing

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the augmented states: the vehicle's, then the ground filters'."""
        return self.functions.facts.states

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.functions.facts.outputs

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that have a number of their own, in the order of p."""
        return self.functions.parameters

    def parameter_vector(self, values: Mapping[str, float] | None = None) -> Array:
        """p: the declared numbers, with `values` in their place where given."""
        return np.array(self._made.vectors(_alone(values), 1)[0])

    def initial(self, parameters: Mapping[str, float] | None = None) -> Array:
        """The packed moments at t = 0.

        Raises
        ------
        ModelError
            If the ground has no stationary state to start from, or the covariance is not positive semidefinite.
        """
        return initial_moments(self.functions, self.parameter_vector(parameters)[None])[0]

    def breakpoints(self, p: Array, duration: float) -> tuple[float, ...]:
        """Times in the run at which a known input changes abruptly: the integration is restarted there."""
        return find_breakpoints(self.functions, p, duration)

    def propagate(
        self,
        times: npt.ArrayLike | None = None,
        *,
        duration: float | None = None,
        points: int | None = None,
        rtol: float | None = None,
        parameters: Mapping[str, float] | None = None,
        engine: str = "auto",
    ) -> MomentHistory:
        """Integrate mean and covariance over the run; by default the model's own duration and output times.

        Parameters
        ----------
        times : output times, increasing from 0 on; or give `duration` and `points`.
        rtol : relative tolerance, the model's own by default; absolute tolerances follow from each state's size.
        parameters : values in place of the declared ones.
        engine : "auto" chooses by the number of states and the eigenvalues of N; see `solve.transient`.

        Raises
        ------
        ModelError
            Wrong times, tolerances or parameters.
        SolverError
            If the integration fails; says when, where, and what was reached. `partial` is the history up to there.
        """
        p = self._made.vectors(_alone(parameters), 1)
        return self._run(p, times, duration, points, rtol, engine, alike=bool(parameters))[0]

    def propagate_all(
        self,
        values: Mapping[str, npt.ArrayLike],
        times: npt.ArrayLike | None = None,
        *,
        duration: float | None = None,
        points: int | None = None,
        rtol: float | None = None,
        engine: str = "auto",
        workers: int = 1,
    ) -> Runs:
        """The same for many values of parameters, side by side: to the last bit what `propagate` gives for each.

        In explicit machine code all of it is one call, which leaves Python's lock to other threads.

        Parameters
        ----------
        workers : threads that share the runs out among them. Worth it where runs are machine code.

        Raises
        ------
        ModelError
            Wrong times, tolerances or parameters.
        SolverError
            If there is nothing to start from. The error of a run that fails later is raised where its history is asked for.
        """
        columns = {name: np.atleast_1d(np.asarray(column, dtype=float)) for name, column in values.items()}
        counts = {column.size for column in columns.values()}
        if len(counts) != 1:
            raise ModelError("runs at once need at least one parameter, and as many values of each.")
        p = self._made.vectors(columns, *counts)
        return self._run(p, times, duration, points, rtol, engine, alike=True, workers=workers)

    def _run(
        self,
        p: Array,
        times: npt.ArrayLike | None,
        duration: float | None,
        points: int | None,
        rtol: float | None,
        engine: str,
        *,
        alike: bool,
        workers: int = 1,
    ) -> Runs:
        grid, rtol = output_times(self._made, times, duration, points), self.declaration.rtol if rtol is None else rtol
        more = {"alike": alike, "derivatives": self.gradient, "workers": workers}
        return run_all(self._made, p, grid, rtol=rtol, engine=engine, **more)

    def periodic(
        self,
        period: float,
        *,
        points: int = 101,
        parameters: Mapping[str, float] | None = None,
    ) -> PeriodicMoments:
        """Find moments that repeat with a period, where the rates do: harmonic forcing, parametric excitation.

        Shooting with the monodromy matrix of the moment equations, for small systems; the start is the model's own.

        Parameters
        ----------
        period : with which every coefficient repeats.
        points : output times from 0 to the period, both ends.
        parameters : values in place of the declared ones.

        Raises
        ------
        ModelError
            If the rates do not repeat with this period, or the system is too large.
        SolverError
            If no cycle was found: the largest Floquet multiplier says why.
        """
        return run_cycle(self._made, self.parameter_vector(parameters), float(period), points)

    def gradient(
        self,
        name: str | tuple[str, str],
        parameters: Sequence[str] | None = None,
        times: npt.ArrayLike | None = None,
        *,
        initial: Sequence[str | tuple[str, str]] = (),
        moment: str = "variance",
        method: str = "auto",
        values: Mapping[str, float] | None = None,
    ) -> Array:
        """Derivatives (k, c) of a mean or variance at the times, with respect to parameters and to the start.

        Parameters
        ----------
        name : a state, an output, or a pair of states (their covariance).
        parameters : names, those of elements among them; by default all that have a number of their own.
        times : increasing; by default the end of the run.
        initial : states, whose mean at the start, and pairs of states, whose covariance at the start adds a column each.
        moment : "variance" or "mean".
        method : "forward" integrates a column a parameter with the moments, "adjoint" one run backwards a time; "auto"
            takes the adjoint for many more parameters than times where runs are not machine code, and forward
            where the adjoint gives up.
        values : parameters in place of the declared ones.

        Raises
        ------
        ModelError
            Unknown names.
        SolverError
            If the derivatives break down, or do not exist.
        """
        from cadet_sym.solve.gradient import Gradient, start_entry
        from cadet_sym.solve.sensitivity import check_method, quantity

        check_method(method)
        names = self.parameters if parameters is None else tuple(parameters)
        columns = [self._made.column(each) for each in names]
        entries = [start_entry(self.functions, each) for each in initial]
        for each, entry in zip(initial, entries, strict=True):
            if entry < 0:
                raise ModelError(f"`{each}` is not a state or a pair of states; those are: {', '.join(self.states)}.")
        grid = output_times(self._made, [self.declaration.duration] if times is None else times)
        find = Gradient(self.functions, lambda p: starts_of(self._made, p[None], float(grid[-1]))[0])
        wanted = quantity(self.functions, name, moment)
        return find(wanted, self.parameter_vector(values), columns, entries, grid, method)

    def frozen(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> FrozenProblem:
        """The stationary moment equations in plain numbers, at one speed and one instant (see `stationary`)."""
        from cadet_sym.solve.freeze import conditions, freeze

        return freeze(self.functions, conditions(self.functions, self.parameter_vector(parameters), speed, at))

    @overload
    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: Literal[True],
        parameters: Mapping[str, float] | None = None,
        start: StationaryMoments | None = None,
    ) -> StationarySolutions: ...

    @overload
    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: Literal[False] = False,
        parameters: Mapping[str, float] | None = None,
        start: StationaryMoments | None = None,
    ) -> StationaryMoments: ...

    @overload
    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: bool,
        parameters: Mapping[str, float] | None = None,
        start: StationaryMoments | None = None,
    ) -> StationaryMoments | StationarySolutions: ...

    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: bool = False,
        parameters: Mapping[str, float] | None = None,
        start: StationaryMoments | None = None,
    ) -> StationaryMoments | StationarySolutions:
        """Find moments that stay as they are: E[f] = 0 and N P + P N^T + D = 0.

        Parameters
        ----------
        speed : speed held constant; by default that of the model at the start.
        at : instant at which an explicit dependence on t is frozen.
        all : look for all solutions, stable ones first, instead of one (a stable one if there is one).
        parameters : values in place of the declared ones.
        start : a solution near by, as in a sweep: where to begin.

        Raises
        ------
        ModelError
            If nothing is stationary about the model: it stands still, or depends on t explicitly and no `at` is given.
        SolverError
            If no solution was found: what was tried, the best residual, and the eigenvalue to blame.
        """
        from cadet_sym.stationary import find_stationary

        found = find_stationary(self._made, self.parameter_vector(parameters), speed, at, all, start)
        return found if all else found[0]

    def provenance(self, engine: str, rtol: float, statistics: Mapping[str, float], p: Array) -> Provenance:
        """How a result of this model was obtained, at the parameters p."""
        return Names.of(self._made).provenance(engine, rtol, statistics, p)

    def export_c(
        self,
        path: str | Path,
        *,
        prefix: str | None = None,
        force: bool = False,
        fmu: bool = False,
        matlab: bool = False,
    ) -> Path:
        """Write the moment equations as a C99 library with a propagator and a stationary solver; returns the folder.

        Parameters
        ----------
        path : folder to write to, whole or not at all; made if it is missing.
        prefix : what all public names of the library begin with; by default the model's name.
        force : write to a folder that holds files that are not ours, too; they stay.
        fmu : add functional mock-up units: PREFIX.fmu, FMI 3.0 model exchange, and PREFIX_cs.fmu, FMI 2.0 co-simulation
            (needs gcc and FMPy).
        matlab : add the equations as a MATLAB (or GNU Octave) function.

        Raises
        ------
        ModelError
            If the ground has no stationary state to start from, or the covariance is not positive semidefinite.
        ExportError
            If something cannot be exported or written; nothing is written then.
        """
        from cadet_sym.export.c import Run, export_c

        run = Run(self.parameter_vector(), self.initial(), self.declaration.duration, self.declaration.points)
        return export_c(self.functions, run, path, prefix=prefix, force=force, fmu=fmu, matlab=matlab)


def _alone(values: Mapping[str, float] | None) -> dict[str, list[float]]:
    """Parameters of one run as those of many."""
    return {name: [value] for name, value in (values or {}).items()}
