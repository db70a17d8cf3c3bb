"""Run a compiled model over a time: one run or many that differ in their parameters, which take one way.

What is done for all of them at once is done at once: their starts, the choice of an engine, the integration in explicit
machine code, the outputs. Every number is the one of a run by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.compilation import Compiled
from cadet_sym.errors import SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.packing import Packing
from cadet_sym.results import MomentHistory, PeriodicMoments, Provenance
from cadet_sym.solve.breakpoints import breakpoints_of
from cadet_sym.solve.freeze import context_at
from cadet_sym.solve.many import Start, Starts, Trajectories, Trajectory
from cadet_sym.solve.outputs import Outputs, outputs_of
from cadet_sym.solve.senseless import refuse_senseless
from cadet_sym.solve.shares import Team
from cadet_sym.solve.start import initial_moments
from cadet_sym.solve.transient import check_times, integrate, integrate_all
from cadet_sym.solve.wheels import present_errors
from cadet_sym.version import VERSION
from cadet_sym.warning import warn

__all__ = ["Names", "Runs", "output_times", "run_all", "run_cycle", "starts_of"]

Array = npt.NDArray[np.float64]
Derivatives = Callable[..., Array]

COARSE = 1e-2
"""Estimated error of the grid between the wheels (conservative, by 1 to 100) above which there is a warning."""


@dataclass(frozen=True)
class Names:
    """Whose moments they are."""

    model: str
    hash: str  # of the model
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    packing: Packing

    @classmethod
    def of(cls, made: Compiled) -> Names:
        """Those of a compiled model."""
        facts, declared = made.functions.facts, made.declaration
        return cls(declared.name, declared.hash, facts.states, facts.outputs, facts.parameters, facts.packing)

    def provenance(self, engine: str, rtol: float, statistics: Mapping[str, float], p: Array) -> Provenance:
        """How a result of the model was obtained, at the parameters p."""
        return Provenance(
            engine=engine,
            rtol=rtol,
            statistics=statistics,
            parameters=dict(zip(self.parameters, p.tolist(), strict=True)),
            model_hash=self.hash,
            version=VERSION,
        )


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of one model through the same times; each is a history, made when it is asked for, or the error it ended with."""

    names: Names
    p: Array  # (runs, count) parameters
    found: Trajectories
    outputs: Outputs
    derivatives: Derivatives | None  # of the model they came from

    def __len__(self) -> int:
        return len(self.found)

    @property
    def failures(self) -> Mapping[int, Exception]:
        """The errors of the runs that failed."""
        return self.found.failures

    def __getitem__(self, k: int) -> MomentHistory:
        """The history of one run; raises the error that it ended with."""
        run = self.found[k]
        names, (mean, covariance) = self.names, self.names.packing.unpack(run.y)
        for array in (mean, covariance):
            array.setflags(write=False)  # they are no one else's, and need not be copied
        return MomentHistory(
            model=names.model,
            states=names.states,
            outputs=names.outputs,
            time=run.time,
            state_mean=mean,
            state_covariance=covariance,
            output_mean=self.outputs.mean[k],
            output_variance=self.outputs.variance[k],
            provenance=names.provenance(run.engine, run.rtol, run.statistics, self.p[k]),
            derivatives=self.derivatives,
        )

    def __getstate__(self) -> dict[str, Any]:
        """The numbers alone: what is sent to another process leaves the model behind, and what failures hold."""
        failures = {k: SolverError(str(error)) for k, error in self.failures.items()}
        return {**self.__dict__, "derivatives": None, "found": replace(self.found, failures=failures)}


def run_all(
    made: Compiled,
    p: Array,
    grid: Array,
    *,
    rtol: float,
    engine: str,
    alike: bool,
    derivatives: Derivatives | None,
    workers: int = 1,
) -> Runs:
    """Run with parameters (runs, count) through the times of the grid.

    Parameters
    ----------
    alike : take the sizes of the moments from a run at the declared parameters.
    workers : threads that share the runs out among them.

    Raises
    ------
    ModelError
        If anything is wrong with the model, one of the parameters, the tolerance or the engine.
    SolverError
        If there is nothing to start from; what fails later is kept for the run that failed.
    """
    functions, names, end = made.functions, Names.of(made), float(grid[-1])
    starts = starts_of(made, p, end)
    declared = declared_start(made, end) if alike else None
    outputs, write = outputs_of(functions, grid, p)
    more = {"rtol": rtol, "engine": engine, "declared": declared, "team": Team(min(workers, len(p)) - 1), "then": write}
    found = integrate_all(functions, starts, grid, **more)
    _tell_lost(functions, found, p, outputs)
    if functions.facts.delay is not None:
        found = _with_wheel_errors(functions, found, p, end)
    for k, error in found.failures.items():
        if isinstance(error, SolverError) and isinstance(partial := error.details.get("partial"), Trajectory):
            error.partial = error.details["partial"] = _named(made, partial, p[k], derivatives)
    return Runs(names, p, found, outputs, derivatives)


def _tell_lost(functions: MomentFunctions, found: Trajectories, p: Array, outputs: Outputs) -> None:
    """Warn of outputs (runs, k, m) that are no numbers though their run is well: nobody else would."""
    if outputs.finite:
        return
    lost = ~(np.isfinite(outputs.mean) & np.isfinite(outputs.variance))
    lost[list(found.failures)] = False
    if lost.any():
        from cadet_sym.solve.seen import warn_of_lost_outputs  # late: it needs SymPy

        run, k, _ = (int(each) for each in np.argwhere(lost)[0])
        context = context_at(functions, p[run], float(found.time[k]))
        times, runs = int(lost[run].any(axis=1).sum()), int(lost.any(axis=(1, 2)).sum())
        others = [f"{times - 1} later times"] * (times > 1) + [f"{runs - 1} other runs"] * (runs > 1)
        when = f"at t = {context[0]:.6g}" + (f" (and in {' and '.join(others)})" if others else "")
        warn_of_lost_outputs(functions, p[run], context, found.y[run, k], lost[run, k], when)


def output_times(
    made: Compiled, times: npt.ArrayLike | None, duration: float | None = None, points: int | None = None
) -> Array:
    """The output times of a run: those given, or even ones over a duration, by default as declared."""
    if times is not None:
        return check_times(times)
    end = made.declaration.duration if duration is None else duration
    return _even_times(float(end), made.declaration.points if points is None else points)


@lru_cache(maxsize=16)
def _even_times(end: float, points: int) -> Array:
    return check_times(np.linspace(0.0, end, points))


def run_cycle(made: Compiled, p: Array, period: float, points: int) -> PeriodicMoments:
    """The cycle of moments that repeat with a period; see `CompiledModel.periodic`."""
    from cadet_sym.solve.periodic import find_cycle

    functions = made.functions
    begin = Start(initial_moments(functions, p[None])[0], p, breakpoints_of(functions, p[None], period)[0])
    cycle = find_cycle(functions, begin, period)
    grid = check_times(np.linspace(0.0, period, points))
    run = integrate(functions, Start(cycle.y, p, begin.breakpoints), grid, rtol=1e-9)
    more = {"newton steps": float(cycle.steps), "periods marched": float(cycle.periods)}
    run = run._replace(statistics={**run.statistics, **more})
    found = _named(made, run, p, derivatives=None)  # those of the run are not those of the cycle
    return PeriodicMoments(
        **{each.name: getattr(found, each.name) for each in fields(found)},
        period=period,
        stable=cycle.stable,
        multipliers=cycle.multipliers,
        residual=cycle.residual,
    )


def _named(made: Compiled, run: Trajectory, p: Array, derivatives: Derivatives | None) -> MomentHistory:
    """One run that was integrated, with its outputs."""
    outputs, write = outputs_of(made.functions, run.time, p[None])
    write(slice(0, 1), run.y[None])
    return Runs(Names.of(made), p[None], Trajectories.of(run), outputs, derivatives)[0]


def _with_wheel_errors(functions: MomentFunctions, found: Trajectories, p: Array, end: float) -> Trajectories:
    """Runs with the estimated error of the grid between the wheels at their end; a warning if it is coarse."""
    done, errors = [k for k in range(len(found)) if k not in found.failures], np.zeros(len(found))
    if done:
        errors[done] = present_errors(functions, p[done], found.y[done, -1, : functions.facts.packing.moments], end)
    if (worst := errors.max()) > COARSE:
        text = (
            f"the ground between the wheels may not be resolved (estimated error {worst:.1g}); "
            "compile the model with a finer grid, for example `cs.compile(model, grid=(8, 10))`"
        )
        warn(UserWarning(text))
    return replace(found, statistics={**found.statistics, "wheel grid error": errors})


def starts_of(made: Compiled, p: Array, duration: float) -> Starts:
    """Moments at the start and known breakpoints for parameters (runs, count); remembered for a single run."""

    def find() -> Starts:
        # a run is looked at as the declared one was when the model was made
        others = p if duration > made.declaration.duration else p[(p != made.declared).any(axis=1)]
        if len(others):
            refuse_senseless(made.functions, others, duration)
        return Starts(initial_moments(made.functions, p), p, breakpoints_of(made.functions, p, duration))

    return _starts(made.functions, (p.tobytes(), duration), find) if len(p) == 1 else find()


_starts: Memory[Starts] = Memory(128)


def declared_start(made: Compiled, duration: float) -> Callable[[], Start] | None:
    """The start at the declared parameters; None of a longer run than declared, in which they may make no sense."""
    return None if duration > made.declaration.duration else lambda: starts_of(made, made.declared[None], duration)[0]
