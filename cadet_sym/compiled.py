"""Compile a model: every stage from the declaration to CasADi functions, and what can be done with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, overload

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.augment import augment
from cadet_sym.delay import CHOICES, choose_grid
from cadet_sym.errors import ModelError
from cadet_sym.language.model import Model
from cadet_sym.language.modelfile import load
from cadet_sym.linearise import linearise
from cadet_sym.lowering.initial import filter_matrices, initial_moments, vehicle_start
from cadet_sym.lowering.system import LoweredSystem, lower
from cadet_sym.moments import MomentEquations, moment_equations
from cadet_sym.results import MomentHistory, Provenance, StationaryMoments, StationarySolutions
from cadet_sym.solve.breakpoints import find_breakpoints
from cadet_sym.solve.freeze import Conditions, conditions, freeze
from cadet_sym.solve.frozen import FrozenProblem
from cadet_sym.solve.search import stationary_points
from cadet_sym.solve.start import profile_mean
from cadet_sym.solve.stationary import StationaryPoint, stationary_point
from cadet_sym.solve.steady import steady_start
from cadet_sym.solve.transient import Trajectory, integrate

__all__ = ["CompiledModel", "compile"]

Array = npt.NDArray[np.float64]


GRID_TOLERANCE = 1e-6
"""Error accepted in what the ground between two wheels does, when the grid there is chosen automatically."""


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
        (best, _) = coarse.wheel_grid()
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

    def wheel_grid(self, y: Array | None = None, p: Array | None = None) -> tuple[tuple[int, int], float]:
        """The grid between the wheels that suits the gains at the moments y (default: the start), and its error.

        The error is that of the discrete exponential over all gaps and the speeds of the run (see `choose_grid`);
        speeds below a twentieth of the highest are left out, for there the ground hardly excites anything.
        """
        p = self.parameter_vector() if p is None else p
        delay = self.equations.delay
        if delay is None:
            raise ModelError("no track has two wheels: there is no grid between them.")
        packing = self.equations.packing
        moments = np.zeros(packing.moments) if y is None else y[: packing.moments]
        times = np.linspace(0.0, self.model.number(self.model.run.duration), 257)
        speeds = np.asarray(self.functions.motion.map(len(times))(times[None, :], np.tile(p[:, None], len(times)))[0])
        fast = np.unique(speeds[speeds >= 0.05 * speeds.max()].round(9)) if speeds.max() > 0 else np.ones(1)
        setbacks = np.asarray(self.functions.noise(np.zeros(4), p)[2]).ravel()
        places = [[float(setbacks[columns[0]]) for columns in track.columns] for track in delay.tracks]
        lengths = np.concatenate([np.diff(place) for place in places])
        exponents = []
        for V in fast:
            N = np.asarray(self.functions.gain_matrix(moments, np.array([0.0, 0.0, V, 0.0]), p))
            exponents.append(np.outer(lengths / V, np.linalg.eigvals(N)).ravel())
        rests = bool(np.any(speeds <= 1e-9 * speeds.max()))
        return choose_grid(np.concatenate(exponents), GRID_TOLERANCE, rests=rests)

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
        times: Sequence[float] | None = None,
        *,
        duration: float | None = None,
        points: int | None = None,
        rtol: float | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> MomentHistory:
        """Integrate mean and covariance over the run; by default the model's own duration and output times.

        Raises
        ------
        ModelError
            Wrong times, tolerances or parameters.
        SolverError
            If the integration fails; says when, where, and what was reached.
        """
        run = self.model.run
        if times is None:
            end = self.model.number(run.duration) if duration is None else duration
            times = np.linspace(0.0, end, run.points if points is None else points)
        p = self.parameter_vector(parameters)
        grid = np.atleast_1d(np.asarray(times, dtype=float))
        breakpoints = self.breakpoints(p, float(grid[-1])) if grid.size else ()
        trajectory = integrate(
            self.functions,
            self.initial(parameters),
            p,
            grid,
            rtol=run.rtol if rtol is None else rtol,
            breakpoints=breakpoints,
        )
        return self._history(trajectory, p)

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
    def stationary(self, *, all: Literal[True], **held: Any) -> StationarySolutions: ...

    @overload
    def stationary(self, *, all: Literal[False] = False, **held: Any) -> StationaryMoments: ...

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
        return Provenance(
            engine=engine,
            rtol=rtol,
            statistics=statistics,
            parameters=dict(zip(self.parameters, p.tolist(), strict=True)),
            model_hash=self.model.hash,
            version=version("cadet-sym"),
        )

    def export_c(self, path: str | Path, *, prefix: str | None = None, force: bool = False) -> Path:
        """Write the moment equations as a C99 library with a propagator and a stationary solver; returns the folder.

        Parameters
        ----------
        path : folder to write to, whole or not at all; made if it is missing.
        prefix : what all public names of the library begin with; by default the model's name.
        force : write to a folder that holds files that are not ours, too; they stay.

        Raises
        ------
        ModelError
            If the ground has no stationary state to start from, or the covariance is not positive semidefinite.
        ExportError
            If something cannot be exported or written; nothing is written then.
        """
        from cadet_sym.export.c import Run, export_c

        run = Run(self.parameter_vector(), self.initial(), self.model.number(self.model.run.duration), self.model.run.points)
        return export_c(self.functions, run, path, prefix=prefix, force=force)

    def _history(self, trajectory: Trajectory, p: Array) -> MomentHistory:
        mean, covariance = self.equations.packing.unpack(trajectory.y)
        k = len(trajectory.time)
        if self.outputs:
            pairs = self.functions.outputs.map(k)(
                trajectory.time[None, :], trajectory.y.T, np.tile(p[:, None], k)
            )
            output_mean, output_variance = (np.asarray(part).T for part in pairs)
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
            provenance=self._provenance(trajectory.engine, trajectory.rtol, trajectory.statistics, p),
        )


def _sees(rows: Array, drift: Array) -> bool:
    """Whether linear forms of the state have a part in a drifting direction."""
    if not drift.size:
        return False
    parts = np.abs(rows @ drift).max(initial=0.0)
    return bool(parts > 1e-9 * np.abs(rows).max(initial=1e-300))
