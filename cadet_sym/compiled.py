"""Compile a model: every stage from the declaration to CasADi functions, and what can be done with them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, overload

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.augmentation import augment
from cadet_sym.delay import CHOICES
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.model import Model
from cadet_sym.language.modelfile import load
from cadet_sym.linearisation import linearise
from cadet_sym.lowering.initial import filter_matrices, initial_moments, vehicle_start
from cadet_sym.lowering.system import LoweredSystem, lower
from cadet_sym.moments import MomentEquations, moment_equations
from cadet_sym.results import MomentHistory, Provenance, StationaryMoments, StationarySolutions
from cadet_sym.solve.breakpoints import find_breakpoints
from cadet_sym.solve.evaluate import over_time
from cadet_sym.solve.freeze import Conditions, conditions, freeze
from cadet_sym.solve.frozen import FrozenProblem
from cadet_sym.solve.scales import peaks
from cadet_sym.solve.search import stationary_points
from cadet_sym.solve.sensitivity import adjoint, check_method, forward, quantity
from cadet_sym.solve.start import profile_mean
from cadet_sym.solve.stationary import StationaryPoint, stationary_point
from cadet_sym.solve.steady import steady_start
from cadet_sym.solve.transient import Start, Trajectory, check_times, integrate
from cadet_sym.solve.wheels import present_error, suitable_grid

__all__ = ["CompiledModel", "compile"]

Array = npt.NDArray[np.float64]

COARSE = 1e-2
"""Estimated error of the grid between the wheels (conservative, by 1 to 100) above which there is a warning."""


def compile(model: Model | str | Path, *, grid: tuple[int, int] | None = None) -> CompiledModel:
    """Turn a model, or the file it is declared in, into its compiled moment equations.

    Parameters
    ----------
    model : a `Model`, or the path of a model file.
    grid : elements and nodes an element between two wheels of one track (see `cadet_sym.delay`); by default the
        cheapest that resolves the vehicle's modes at the speeds of the run.

    Raises
    ------
    ModelError, LinearisationError
        If the model is wrong, or an element has no Gaussian expectation.
    """
    if not isinstance(model, Model):
        model = load(model)
    quasi_linear = linearise(augment(model))
    equations = moment_equations(quasi_linear, grid or CHOICES[0])
    if grid is None and equations.delay is not None:
        coarse = CompiledModel(model, lower(equations))
        still = np.zeros(equations.packing.moments)
        duration = model.number(model.run.duration)
        best = suitable_grid(coarse.functions, coarse.parameter_vector(), still, duration)
        equations = moment_equations(quasi_linear, best)
    return CompiledModel(model, lower(equations))


@dataclass(frozen=True, eq=False)
class CompiledModel:
    """A model whose moment equations are ready to be integrated, solved for their fixed points, or exported."""

    model: Model
    functions: LoweredSystem

    @property
    def equations(self) -> MomentEquations:
        """The moment equations in symbols; through them every earlier stage."""
        return self.functions.equations

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the augmented states: the vehicle's, then the ground filters'."""
        return self.equations.states

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.equations.quasi_linear.outputs)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that have a number of their own, in the order of p."""
        return self.functions.parameters

    def parameter_vector(self, values: Mapping[str, float] | None = None) -> Array:
        """p: the declared numbers, with `values` in their place where given."""
        declared = self.model.parameter_values()
        for name in values or {}:
            if name not in self.parameters:
                known = ", ".join(self.parameters) or "none"
                raise ModelError(f"`{name}` is not a parameter with a number of its own; those are: {known}.")
        return np.array([float({**declared, **(values or {})}[name]) for name in self.parameters])

    @cached_property
    def _initial(self) -> ca.Function:
        return initial_moments(self.functions)

    def initial(self, parameters: Mapping[str, float] | None = None) -> Array:
        """The packed moments at t = 0.

        Raises
        ------
        ModelError
            If the ground has no stationary state to start from, or the covariance is not positive semidefinite.
        """
        p = self.parameter_vector(parameters)
        if self.model.initial.whole:
            return steady_start(self.functions, p)
        system = self.equations.quasi_linear.system
        if system.copies and self.model.initial.ground == "stationary":
            self._refuse_drifting_ground(p)
        y = np.asarray(self._initial(p)).ravel()
        y[: self.equations.packing.n] += profile_mean(self.functions, p)
        _, covariance = self.equations.packing.unpack(y)
        lowest = float(np.linalg.eigvalsh(covariance)[0]) if len(covariance) else 0.0
        if not lowest >= -1e-9 * max(float(np.trace(covariance)), 1e-300):
            raise ModelError(
                f"[initial]: the covariance at the start is not positive semidefinite (smallest eigenvalue "
                f"{lowest:.3g}); check [initial.covariance]: |cov(a, b)| may not exceed std(a) std(b)."
            )
        return y

    def _refuse_drifting_ground(self, p: Array) -> None:
        for copy in self.equations.quasi_linear.system.copies:
            C = np.asarray(filter_matrices(self.functions, copy)(p)[0])
            if np.linalg.eigvals(C).real.max(initial=-1.0) > -1e-12 * np.abs(C).max(initial=1e-300):
                raise ModelError(
                    f'[initial] ground = "stationary": the ground under `{copy.contact}` has no stationary height '
                    '(an integrated road wanders without bound). Start with `ground = "smooth"`, or give the road a '
                    "low-frequency `cutoff`."
                )

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
        run = self.model.run
        if times is None:
            end = self.model.number(run.duration) if duration is None else duration
            times = np.linspace(0.0, end, run.points if points is None else points)
        grid = check_times(times)
        start = self._start(self.parameter_vector(parameters), float(grid[-1]))
        try:
            trajectory = integrate(
                self.functions,
                start,
                grid,
                rtol=run.rtol if rtol is None else rtol,
                engine=engine,
                declared=(lambda: self._start(self.parameter_vector(), float(grid[-1]))) if parameters else None,
            )
        except SolverError as error:
            if isinstance(partial := error.details.get("partial"), Trajectory):
                error.partial = error.details["partial"] = self._history(partial, start.p, {})  # type: ignore[attr-defined]
            raise
        return self._history(trajectory, start.p, self._wheel_error(trajectory, start.p))

    def gradient(
        self,
        name: str | tuple[str, str],
        parameters: Sequence[str] | None = None,
        times: Sequence[float] | None = None,
        *,
        moment: str = "variance",
        method: str = "auto",
        values: Mapping[str, float] | None = None,
    ) -> Array:
        """Derivatives (k, c) of a mean or variance at the times with respect to parameters.

        Parameters
        ----------
        name : a state, an output, or a pair of states (their covariance).
        parameters : names; by default all that have a number of their own.
        times : increasing; by default the end of the run.
        moment : "variance" or "mean".
        method : "forward" integrates a column a parameter with the moments, "adjoint" one run backwards a time; "auto"
            takes the adjoint for more parameters than the run has times and 20. Where the adjoint gives up, forward.
        values : parameters in place of the declared ones.

        Raises
        ------
        ModelError
            Unknown names.
        SolverError
            If the derivatives break down.
        """
        check_method(method)
        names = self.parameters if parameters is None else tuple(parameters)
        for each in names:
            if each not in self.parameters:
                known = ", ".join(self.parameters) or "none"
                raise ModelError(f"`{each}` is not a parameter with a number of its own; those are: {known}.")
        columns = [self.parameters.index(each) for each in names]
        grid = check_times([self.model.number(self.model.run.duration)] if times is None else times)
        start = self._start(self.parameter_vector(values), float(grid[-1]))
        wanted = quantity(self.functions, name, moment)
        rough = integrate(self.functions, start, np.linspace(0, grid[-1], 33) if grid[-1] > 0 else grid, rtol=1e-4)
        size = peaks(rough.y, self.equations.packing)
        slope = self._start_slope(start.p)
        if method == "adjoint" or (method == "auto" and len(columns) > 20 + len(grid)):
            try:
                return self._adjoint_gradient(wanted, start, grid, size, slope)[:, columns]
            except SolverError:
                if method == "adjoint":
                    raise
        y, S = forward(self.functions, start, slope[:, columns], columns, size, grid)
        rows = []
        for t, moments, part in zip(grid, y, S, strict=True):
            _, in_y, in_p = (np.asarray(each) for each in wanted(t, moments, start.p))
            rows.append(in_y[0] @ part + in_p[0, columns])
        return np.array(rows)

    def _adjoint_gradient(self, wanted: ca.Function, start: Start, grid: Array, size: Array, slope: Array) -> Array:
        y = integrate(self.functions, start, grid, rtol=1e-9).y
        rows = []
        for t, moments in zip(grid, y, strict=True):
            _, in_y, in_p = (np.asarray(each) for each in wanted(t, moments, start.p))
            in_start, at_start = (in_p[0], in_y[0])
            if t > 0:
                direct, at_start = adjoint(self.functions, start, size, float(t), in_y[0])
                in_start = in_p[0] + direct
            rows.append(in_start + at_start @ slope)
        return np.array(rows)

    def _start_slope(self, p: Array) -> Array:
        """Derivative (size, parameters) of the start: central differences where a stationary state is solved for."""
        here = self.initial(dict(zip(self.parameters, p.tolist(), strict=True)))
        if np.allclose(np.asarray(self._initial(p)).ravel(), here, rtol=1e-12, atol=0):
            q = ca.MX.sym("q", len(p))
            return np.asarray(ca.Function("slope", [q], [ca.jacobian(self._initial(q), q)])(p))
        columns = []
        for j, step in enumerate(1e-5 * np.maximum(np.abs(p), 1e-3)):
            move = step * np.eye(len(p))[j]
            ends = [self.initial(dict(zip(self.parameters, q.tolist(), strict=True))) for q in (p + move, p - move)]
            columns.append((ends[0] - ends[1]) / (2 * step))
        return np.array(columns).T.reshape(len(here), len(p))

    def _start(self, p: Array, duration: float) -> Start:
        """Moments at the start and known breakpoints, remembered for the parameters last used."""
        kept, key = self._starts, (p.tobytes(), duration)
        if key not in kept:
            if len(kept) >= 64:
                kept.clear()
            values = dict(zip(self.parameters, p.tolist(), strict=True))
            kept[key] = Start(self.initial(values), p, self.breakpoints(p, duration))
        return kept[key]

    @cached_property
    def _starts(self) -> dict[tuple[bytes, float], Start]:
        return {}

    def frozen(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> FrozenProblem:
        """The stationary moment equations in plain numbers, at one speed and one instant (see `stationary`)."""
        return freeze(self.functions, conditions(self.functions, self.parameter_vector(parameters), speed, at))

    @overload
    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: Literal[True],
        parameters: Mapping[str, float] | None = None,
    ) -> StationarySolutions: ...

    @overload
    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: Literal[False] = False,
        parameters: Mapping[str, float] | None = None,
    ) -> StationaryMoments: ...

    @overload
    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: bool,
        parameters: Mapping[str, float] | None = None,
    ) -> StationaryMoments | StationarySolutions: ...

    def stationary(
        self,
        *,
        speed: float | None = None,
        at: float | None = None,
        all: bool = False,
        parameters: Mapping[str, float] | None = None,
    ) -> StationaryMoments | StationarySolutions:
        """Find moments that stay as they are: E[f] = 0 and N P + P N^T + D = 0.

        Parameters
        ----------
        speed : speed held constant; by default that of the model at the start.
        at : instant at which an explicit dependence on t is frozen.
        all : look for all solutions, stable ones first, instead of one (a stable one if there is one).
        parameters : values in place of the declared ones.

        Raises
        ------
        ModelError
            If nothing is stationary about the model: it stands still, or depends on t explicitly and no `at` is given.
        SolverError
            If no solution was found: what was tried, the best residual, and the eigenvalue to blame.
        """
        p = self.parameter_vector(parameters)
        held = conditions(self.functions, p, speed, at)
        problem = freeze(self.functions, held)
        offset = np.asarray(vehicle_start(self.functions)(p)[0]).ravel()
        start = np.concatenate([offset, np.zeros(problem.n - len(offset))])
        rest = (start, np.zeros((problem.n, problem.n)))
        points = stationary_points(problem, rest) if all else (stationary_point(problem, rest),)
        found = tuple(self._fixed_point(point, held) for point in points)
        return StationarySolutions(found) if all else found[0]

    def _fixed_point(self, point: StationaryPoint, held: Conditions) -> StationaryMoments:
        """Name the moments of a stationary point; what drifts has none."""
        y = self.equations.packing.pack(point.mean, point.covariance)
        pair = self.functions.outputs_at(y, held.context, held.p)
        mean, variance = (np.asarray(part).ravel() for part in pair)
        rows = self.functions.output_rows(held.context, held.p)
        rows = rows if isinstance(rows, tuple | list) else (rows,)[: len(self.outputs)]
        loose = np.array([_sees(np.asarray(row), point.drift) for row in rows], dtype=bool)
        mean[loose] = variance[loose] = np.nan
        state_mean, covariance = point.mean.copy(), point.covariance.copy()
        state_mean[point.drifting] = np.nan
        covariance[point.drifting, :] = covariance[:, point.drifting] = np.nan
        names = (*self.states, *self.outputs)
        return StationaryMoments(
            model=self.model.name,
            states=self.states,
            outputs=self.outputs,
            state_mean=state_mean,
            state_covariance=covariance,
            output_mean=mean,
            output_variance=variance,
            stable=point.stable,
            residual=point.residual,
            eigenvalues=point.eigenvalues,
            drifting=tuple(n for n, d in zip(names, (*point.drifting, *loose), strict=True) if d),
            path=point.path,
            provenance=self._provenance(f"exact Newton ({point.path[-1]})", 0.0, {}, held.p),
        )

    def _provenance(self, engine: str, rtol: float, statistics: Mapping[str, float], p: Array) -> Provenance:
        from importlib.metadata import version  # late: it takes longer to import than much of this package

        return Provenance(
            engine=engine,
            rtol=rtol,
            statistics=statistics,
            parameters=dict(zip(self.parameters, p.tolist(), strict=True)),
            model_hash=self.model.hash,
            version=version("cadet-sym"),
        )

    def _wheel_error(self, trajectory: Trajectory, p: Array) -> dict[str, float]:
        """Estimated error of the grid between the wheels at the end of a run; a warning if it is coarse."""
        if self.equations.delay is None:
            return {}
        moments = trajectory.y[-1, : self.equations.packing.moments]
        error = present_error(self.functions, p, moments, float(trajectory.time[-1]))
        if error > COARSE:
            warnings.warn(
                f"the ground between the wheels may not be resolved (estimated error {error:.1g}); "
                "compile the model with a finer grid, for example `cs.compile(model, grid=(8, 10))`",
                stacklevel=3,
            )
        return {"wheel grid error": error}

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
        fmu : add a functional mock-up unit, FMI 3.0 model exchange (needs gcc and FMPy).
        matlab : add the equations as a MATLAB (or GNU Octave) function.

        Raises
        ------
        ModelError
            If the ground has no stationary state to start from, or the covariance is not positive semidefinite.
        ExportError
            If something cannot be exported or written; nothing is written then.
        """
        from cadet_sym.export.c import Run, export_c

        settings = self.model.run
        duration = self.model.number(settings.duration)
        run = Run(self.parameter_vector(), self.initial(), duration, settings.points)
        return export_c(self.functions, run, path, prefix=prefix, force=force, fmu=fmu, matlab=matlab)

    def _history(self, trajectory: Trajectory, p: Array, more: Mapping[str, float]) -> MomentHistory:
        mean, covariance = self.equations.packing.unpack(trajectory.y)
        k = len(trajectory.time)
        if self.outputs:
            output_mean, output_variance = over_time(self.functions.outputs, trajectory.time, trajectory.y, p)
        else:
            output_mean = output_variance = np.zeros((k, 0))
        return MomentHistory(
            model=self.model.name,
            states=self.states,
            outputs=self.outputs,
            time=trajectory.time,
            state_mean=mean,
            state_covariance=covariance,
            output_mean=output_mean,
            output_variance=output_variance,
            provenance=self._provenance(trajectory.engine, trajectory.rtol, {**trajectory.statistics, **more}, p),
        )


def _sees(rows: Array, drift: Array) -> bool:
    """Whether linear forms of the state have a part in a drifting direction."""
    if not drift.size:
        return False
    parts = np.abs(rows @ drift).max(initial=0.0)
    return bool(parts > 1e-9 * np.abs(rows).max(initial=1e-300))
