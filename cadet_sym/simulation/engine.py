"""Simulate the original nonlinear model: many paths, their moments, and the errors of these.

The judge of what the rest of the package computes: nothing of linearisation or expectation is used here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from time import perf_counter
from typing import Any, Literal

import numpy as np

from cadet_sym.augmentation import AugmentedSystem, augment
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.model import Model
from cadet_sym.simulation.arguments import check_numbers, checked_scheme, choose_engine, increasing, output_times, places_of
from cadet_sym.simulation.collect import Collected, Goal, collect, estimates_of
from cadet_sym.simulation.control import Reference, reference_of
from cadet_sym.simulation.demands import Demands
from cadet_sym.simulation.ensemble import Ensemble, shape_of
from cadet_sym.simulation.inputs import Input, inputs_of
from cadet_sym.simulation.plan import Plan, Problem
from cadet_sym.simulation.riders import CrossingRider
from cadet_sym.simulation.statistics import Moments, interval_factor
from cadet_sym.simulation.steps import Chosen, Precision, choose_step
from cadet_sym.simulation.twin import Twin
from cadet_sym.simulation.workers import Task, records_in_parts
from cadet_sym.warning import warn

__all__ = ["simulate"]

Progress = Callable[[int], Any]
_PART = 0.4  # of the time there is: what the choice of a step may take
_LOOK = 256  # paths from which places and sizes are taken where no step's error was measured


def simulate(
    model: Model | AugmentedSystem,
    paths: int | Literal["auto"] = 2000,
    *,
    seed: int = 0,
    times: Sequence[float] | np.ndarray | None = None,
    step: float | None = None,
    level: float = 0.99,
    keep: int = 20,
    run_in: float | None = None,
    check_step: bool = True,
    twin: Twin | None = None,
    insist: bool = True,
    target: float = 0.01,
    watch: Sequence[str] | None = None,
    time_limit: float | None = None,
    levels: Mapping[str, Sequence[float]] | None = None,
    histograms: Mapping[str, int | Sequence[float] | np.ndarray] | None = None,
    average_from: float | None = None,
    scheme: str | None = None,
    engine: str | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: bool | Progress = False,
) -> Ensemble:
    """Monte Carlo simulation of the original nonlinear model, with the errors of its moments.

    The ground is sampled exactly on the paths' own grid together with its mean over every step, wheels of one track meet
    the same ground, and the vehicle is stepped by Heun's rule, its rates taken at two places of the ground within the step
    (see `within`), which for a vehicle without ground are the ends,

        p = x + h f(x, t) + b dW,    x(t + h) = x + h/2 (f(x, t) + f(p, t + h)) + b dW.

    Results depend on `seed`, `times` and `step` only, not on threads, executors or engine (to rounding).

    Parameters
    ----------
    model : a model, or its augmented system.
    paths : realisations (the paper uses 2000), or "auto": as many as the `target` asks for.
    seed : a whole number, not negative; the same seed gives the same paths.
    times : (k,) output times, increasing, not negative; the model's own run if not given.
    step : longest time step. If not given, one is chosen from the fastest rates of vehicle and ground and shortened
        until its error, measured on pairs of paths, is below half of the sampling error.
    level : probability of the limits.
    keep : paths to be kept as they are, for plots.
    run_in : with `whole = "stationary"`, the time for which every path is run in at the initial speed before t = 0;
        seven time constants of the vehicle's slowest mode if not given.
    check_step : measure the step's error (some paths are computed with half the step as well).
    twin : the quasi-linear system along the run, for estimates by control variates (see `control`).
    insist : use the twin even where the paths that show the step's error tell that it saves less than it costs.
    target, watch, time_limit : with `paths="auto"`, the half-width wanted of the limits of a variance over the variance
        and of a mean over the standard deviation; of which states and outputs (all outputs, or all of the vehicle's
        states if there are none); and the time there is for it, s.
    levels : state or output -> levels whose up-crossings are counted, at every step.
    histograms : state or output -> edges of bins, or their number.
    average_from : average over the output times from here on as well, for stationary runs.
    scheme : "heun", or "exponential", which takes the vehicle's linear terms exactly however fast they are; if not given,
        exponential where these terms alone would keep the step short.
    engine : "numba" (compiled) or "numpy"; numba if it is installed.
    threads : threads to use; as many as there are processors if not given.
    executor : a `concurrent.futures` executor to work on instead of threads (processes, other machines).
    progress : True for a bar on standard error, or a function that is told how many more paths are finished.

    Raises
    ------
    ModelError : an argument or the model is wrong.
    SolverError : every path diverged, or the target was not reached in the time there was; `partial` holds the
        ensemble so far.
    """
    began = perf_counter()
    system = model if isinstance(model, AugmentedSystem) else augment(model)
    count = None if paths == "auto" else paths
    check_numbers(
        paths=count, seed=seed, step=step, level=level, keep=keep, run_in=run_in, threads=threads,
        target=target, time_limit=time_limit, average_from=average_from,
    )  # fmt: skip
    engine, scheme = choose_engine(engine), checked_scheme(scheme)
    crossings = _crossing_riders(system, increasing(levels or {}, "levels"))
    riders, at = list(crossings.values()), output_times(system.model, times)
    inputs = inputs_of(system)
    forms = [i.form for i in inputs]
    problem = Problem(system, at, riders, twin, forms, scheme)
    factor = interval_factor(level)
    goal = Goal(count, target, _watched(problem, watch), level, time_limit)
    seconds = {"preparing": perf_counter() - began}
    precision = Precision(goal.paths or 2048, target if count is None else None, factor, _PART * (time_limit or math.inf))
    chosen = choose_step(problem, precision, seed, step, run_in, engine, check_step, insist)
    if not chosen.worth:
        problem = Problem(system, at, riders, inputs=forms, scheme=scheme)
        chosen = choose_step(problem, precision, seed, step, run_in, engine, check_step)
    began = perf_counter()
    plan, grid = problem.plan(chosen.step, chosen.run_in)
    tallies = Demands(problem, chosen, crossings, histograms or {}, average_from, lambda: _look(plan, engine, seed, problem))
    task = Task(plan, engine, seed, len(system.states), problem.quantities, keep, tallies.all)
    with _telling(progress, goal.paths) as tell:
        found, over = collect(task, goal, tallies.controls, executor, threads, tell)
    seconds |= {**chosen.seconds, "paths": perf_counter() - began}
    known = {"step": float(grid.step.max()), "seed": seed, "level": level, "engine": engine, "seconds": seconds}
    known["scheme"] = problem.scheme
    ensemble = _ensemble(problem, chosen, found, tallies, inputs, known, twin is not None)
    if found.diverged == found.paths:
        raise SolverError(
            f"all {found.paths} paths diverged with a step of {chosen.step:.3g}: the model is unstable, or asks for a "
            "shorter step; check the parameters, or give `step`",
            partial=ensemble,
        )
    if found.diverged:
        warn(RuntimeWarning(ensemble.notes[-1]))
    if over > 1.0:
        raise SolverError(
            f"the limits wanted, {target:g}, were not reached in {time_limit:g} s: with {found.paths} paths the widest "
            f"is {over * target:.2g}; allow some {_time_needed(seconds['paths'], over):.2g} s, or a wider `target`",
            partial=ensemble,
        )
    return ensemble


def _time_needed(taken: float, over: float) -> float:
    return 1.1 * taken * over**2


def _watched(problem: Problem, names: Sequence[str] | None) -> tuple[int, ...]:
    if names is None:
        outputs = tuple(range(len(problem.system.states), problem.asked))
        return outputs or tuple(range(problem.system.vehicle_size))
    if not names:
        raise ModelError("simulate: `watch` names nothing; give the states and outputs whose limits count, or leave it out")
    return tuple(places_of(names, problem.names[: problem.asked], "watch"))


def _crossing_riders(system: AugmentedSystem, levels: Mapping[str, tuple[float, ...]]) -> dict[str, CrossingRider]:
    quantities = {s.name: s for s in system.states} | dict(system.outputs)
    places_of(list(levels), list(quantities), "levels")
    return {name: CrossingRider(quantities[name], values) for name, values in levels.items()}


def _look(plan: Plan, engine: str, seed: int, problem: Problem) -> Reference:
    return reference_of(problem, records_in_parts(plan, engine, seed, _LOOK)[0])


def _ensemble(
    problem: Problem,
    chosen: Chosen,
    found: Collected,
    tallies: Demands,
    inputs: Sequence[Input],
    known: Mapping[str, Any],
    twin_given: bool,
) -> Ensemble:
    system, moments, controlled = problem.system, found.moments, found.controlled(tallies.all)
    doubted = [problem.names[t.target] for t, c in zip(tallies.controls, controlled, strict=True) if not c.trusted]
    estimates, asked = estimates_of(moments, tallies.controls, controlled), problem.asked
    return Ensemble(
        model=system.model.name,
        states=tuple(s.name for s in system.states),
        outputs=tuple(system.outputs)[: asked - len(system.states)],
        time=problem.times,
        paths=found.paths,
        estimates=estimates,
        moments=moments,
        step_error=chosen.error,
        diverged=found.diverged,
        kept=np.concatenate(found.kept),
        histograms=tallies.results(found, tallies.histograms),
        crossings=tallies.results(found, tallies.crossings),
        average=None if tallies.average is None else tallies.results(found, {"": tallies.average})[""],
        inputs={each.text: shape_of(each, moments, row) for row, each in enumerate(inputs, asked)},
        run_in=chosen.run_in,
        notes=_notes(chosen, doubted, found, problem.twin is None and twin_given and _varies(moments)),
        **known,
    )


def _varies(moments: Moments) -> bool:
    """Whether there is anything in the paths but rounding."""
    return bool((moments.second > 1e-24 * moments.count[:, None] * moments.mean**2).any())


def _notes(chosen: Chosen, doubted: Sequence[str], found: Collected, given_up: bool) -> tuple[str, ...]:
    notes = []
    if given_up:
        notes.append("The quasi-linear system explains too little of these paths to save any: they were simulated without it.")
    if chosen.run_in > 0.0:
        notes.append(f"Every path was run in for {chosen.run_in:.3g} at the initial speed before t = 0.")
    if not chosen.reached:
        notes.append(
            f"The error of the time step {chosen.step:.2g} is not small beside the sampling error; look at the step "
            "errors, or give a shorter `step`."
        )
    if doubted:
        notes.append(
            f"The twin's simulated moments are not those given with it: without it are estimated {', '.join(doubted)}."
        )
    if found.diverged:
        notes.append(
            f"{found.diverged} of {found.paths} paths diverged and count only up to there: the moments are those of "
            "the paths that stayed finite."
        )
    return tuple(notes)


@contextmanager
def _telling(progress: bool | Progress, paths: int | None) -> Iterator[Progress]:
    """A function that is told how many more paths are finished."""
    if callable(progress):
        yield progress
    elif not progress:
        yield lambda _: None
    else:
        from rich.console import Console
        from rich.progress import Progress as Bar

        with Bar(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(f"{paths or ''} paths".strip(), total=paths)
            yield lambda finished: bar.advance(task, finished)
