"""Simulate the original nonlinear model: many paths, their moments, and the errors of these.

The judge of what the rest of the package computes: nothing of linearisation or expectation is used here.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import reduce
from time import perf_counter
from typing import Any

import numpy as np

from cadet_sym.augment import AugmentedSystem, augment
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.model import Model
from cadet_sym.simulate.ensemble import Ensemble
from cadet_sym.simulate.plan import Problem
from cadet_sym.simulate.statistics import Moments
from cadet_sym.simulate.steps import Chosen, choose_step
from cadet_sym.simulate.workers import run_groups

__all__ = ["simulate"]

Progress = Callable[[int], Any]


def simulate(
    model: Model | AugmentedSystem,
    paths: int = 2000,
    *,
    seed: int = 0,
    times: Sequence[float] | np.ndarray | None = None,
    step: float | None = None,
    level: float = 0.99,
    keep: int = 20,
    run_in: float | None = None,
    check_step: bool = True,
    engine: str | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: bool | Progress = False,
) -> Ensemble:
    """Monte Carlo simulation of the original nonlinear model, with the errors of its moments.

    The ground is sampled exactly on the paths' own grid, wheels of one track meet the same ground, and the vehicle
    is stepped by Heun's rule with the exact ground at both ends of a step,

        p = x + h f(x, t) + b dW,    x(t + h) = x + h/2 (f(x, t) + f(p, t + h)) + b dW.

    Results depend on `seed`, `times` and `step` only, not on threads, executors or engine (to rounding).

    Parameters
    ----------
    model : a model, or its augmented system.
    paths : realisations; the paper uses 2000.
    seed : a whole number, not negative; the same seed gives the same paths.
    times : (k,) output times, increasing, not negative; the model's own run if not given.
    step : longest time step. If not given, one is chosen from the fastest rates of vehicle and ground and halved
        until its error, measured on pairs of paths, is well below the sampling error.
    level : probability of the limits.
    keep : paths to be kept as they are, for plots.
    run_in : with `whole = "stationary"`, the time for which every path is run in at the initial speed before t = 0;
        chosen from the slowest rate of the vehicle if not given.
    check_step : measure the step's error (some paths are computed with half the step as well).
    engine : "numba" (compiled) or "numpy"; numba if it is installed.
    threads : threads to use; as many as there are processors if not given.
    executor : a `concurrent.futures` executor to work on instead of threads (processes, other machines).
    progress : True for a bar on standard error, or a function that is told how many more paths are finished.

    Raises
    ------
    ModelError : an argument or the model is wrong.
    SolverError : every path diverged.
    """
    began = perf_counter()
    system = model if isinstance(model, AugmentedSystem) else augment(model)
    _check(paths, seed, step, level, keep, run_in, threads)
    engine = _engine(engine)
    problem = Problem(system, _times(system.model, times))
    seconds = {"preparing": perf_counter() - began}
    chosen = choose_step(problem, paths, seed, step, run_in, engine, check_step)
    seconds |= chosen.seconds
    began = perf_counter()
    plan, grid = problem.plan(chosen.step, chosen.run_in)
    n = len(system.states)
    groups: list[Moments] = []
    kept, diverged = [], 0
    with _telling(progress, paths) as tell:
        for result in run_groups(plan, engine, seed, paths, n, keep, executor, threads):
            groups.append(result.moments)
            kept.append(result.kept)
            diverged += result.diverged
            tell(result.paths)
    moments = reduce(Moments.joined, groups)
    seconds["paths"] = perf_counter() - began
    notes = _notes(chosen, diverged, paths)
    if diverged == paths:
        raise SolverError(
            f"all {paths} paths diverged with a step of {chosen.step:.3g}: the model is unstable, or asks for a "
            "shorter step; check the parameters, or give `step`",
            partial=moments,
        )
    if diverged:
        warnings.warn(notes[-1], RuntimeWarning, stacklevel=2)
    return Ensemble(
        model=system.model.name,
        states=tuple(s.name for s in system.states),
        outputs=tuple(system.outputs),
        time=problem.times,
        paths=paths,
        seed=seed,
        step=float(grid.step.max()),
        moments=moments,
        step_error=chosen.error,
        diverged=diverged,
        kept=np.concatenate(kept),
        level=level,
        run_in=chosen.run_in,
        engine=engine,
        seconds=seconds,
        notes=notes,
    )


def _check(
    paths: int, seed: int, step: float | None, level: float, keep: int, run_in: float | None, threads: int | None
) -> None:
    """Refuse arguments that no simulation can be run with."""
    for name, value, least in (("paths", paths, 2), ("seed", seed, 0), ("keep", keep, 0), ("threads", threads, 1)):
        if value is None and name == "threads":
            continue
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise ModelError(f"simulate: `{name}` is a whole number, {least} or more; found {value!r}")
    for name, number, above in (("step", step, "greater than zero"), ("run_in", run_in, "not negative")):
        if number is None:
            continue
        wrong = not math.isfinite(number) or number < 0.0 or (number == 0.0 and name == "step")
        if wrong:
            raise ModelError(f"simulate: `{name}` is a time {above}; found {number!r}")
    if not 0.0 < level < 1.0:
        raise ModelError(f"simulate: `level` is a probability between 0 and 1; found {level!r}")


def _times(model: Model, times: Sequence[float] | np.ndarray | None) -> np.ndarray:
    if times is None:
        return np.linspace(0.0, model.number(model.run.duration), model.run.points)
    time = np.array(times, dtype=float)
    if time.ndim != 1 or not len(time) or not np.isfinite(time).all() or time[0] < 0.0 or (np.diff(time) <= 0).any():
        raise ModelError(
            f"simulate: `times` are increasing numbers, the first not negative; found {np.asarray(times).tolist()!r}"
        )
    if time[-1] == 0.0:
        raise ModelError("simulate: `times` hold nothing but 0; the moments there are the initial ones")
    return time


def _engine(engine: str | None) -> str:
    from importlib.util import find_spec

    if engine not in (None, "numba", "numpy"):
        raise ModelError(f'simulate: `engine` is "numba" or "numpy"; found {engine!r}')
    there = find_spec("numba") is not None
    if engine == "numba" and not there:
        raise ModelError('simulate: `engine="numba"` needs numba, which is not installed; take "numpy" or install it')
    return engine or ("numba" if there else "numpy")


def _notes(chosen: Chosen, diverged: int, paths: int) -> tuple[str, ...]:
    notes = []
    if chosen.run_in > 0.0:
        notes.append(f"Every path was run in for {chosen.run_in:.3g} at the initial speed before t = 0.")
    if not chosen.reached:
        notes.append(
            f"The error of the time step {chosen.step:.2g} is not small beside the sampling error; look at the step "
            "errors, or give a shorter `step`."
        )
    if diverged:
        notes.append(
            f"{diverged} of {paths} paths diverged and count only up to there: the moments are those of the paths "
            "that stayed finite."
        )
    return tuple(notes)


@contextmanager
def _telling(progress: bool | Progress, paths: int) -> Iterator[Progress]:
    """A function that is told how many more paths are finished."""
    if callable(progress):
        yield progress
    elif not progress:
        yield lambda _: None
    else:
        from rich.console import Console
        from rich.progress import Progress as Bar

        with Bar(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(f"{paths} paths", total=paths)
            yield lambda finished: bar.advance(task, finished)
