"""The time step: a first choice from the rates of vehicle and ground, then as short as its measured error asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from cadet_sym.simulate.plan import Problem
from cadet_sym.simulate.statistics import StepError, moments_of, step_error_of
from cadet_sym.simulate.workers import records_of

__all__ = ["Chosen", "choose_step"]

PAIRS = 256  # paths that are computed with a step and with half of it
_APART = 1 << 40  # their numbers, beyond those of any run
_VEHICLE, _GROUND = 0.05, 0.1  # first choice: step times the fastest rate of each
_LEAST = 64  # steps of a run
_PART = 0.25  # of the sampling error: what the step's error may be
_TRIALS = 8
_SHORTEST = 1e-7  # of the run
_FLOOR = 1e-4  # of a quantity's own size: an error that is not looked into, however many paths there are
_RUN_IN = 7.0  # time constants of the slowest mode


@dataclass(frozen=True)
class Chosen:
    """A time step with its error, and how it came about."""

    step: float
    error: StepError | None
    run_in: float
    reached: bool  # whether the error is small beside the sampling error
    seconds: dict[str, float]


def choose_step(
    problem: Problem,
    paths: int,
    seed: int,
    step: float | None,
    run_in: float | None,
    engine: str,
    check: bool,
) -> Chosen:
    """Take the step given, or shorten the first choice until its error is below a quarter of the sampling error.

    The error is measured on pairs of paths that share their noise; the run's own paths are others.
    """
    whole = problem.system.model.initial.whole
    before = 0.0 if not whole else problem.relaxation_time(_RUN_IN) if run_in is None else float(run_in)
    fixed = step is not None
    step = step if step is not None else first_step(problem)
    if not check:
        return Chosen(step, None, before, True, {})
    seconds: dict[str, float] = {}
    for trial in range(1 if fixed else _TRIALS):
        began = perf_counter()
        plan, grid = problem.plan(step, before, paired=True)
        if trial == 0:
            records_of(plan, engine, seed, _APART, 1)
            seconds["compiling"] = perf_counter() - began
            began = perf_counter()
        fine, coarse = records_of(plan, engine, seed, _APART, PAIRS)
        error = step_error_of(coarse, fine)
        excess = _excess(fine, error, paths, len(problem.system.states), problem.system.vehicle_size)
        seconds["step"] = seconds.get("step", 0.0) + perf_counter() - began
        step = float(grid.step.max())
        if excess <= 1.0 or step < _SHORTEST * problem.times[-1]:
            break
        if trial < _TRIALS - 1 and not fixed:
            # Second order would ask for the square root; at least half, at most a sixteenth.
            step /= min(16.0, max(2.0, math.sqrt(excess))) if math.isfinite(excess) else 8.0
    return Chosen(step, error, before, excess <= 1.0, seconds)


def first_step(problem: Problem) -> float:
    """Step from the fastest rates: h = min(0.05 / vehicle's, 0.1 / ground's, a sixty-fourth of the run)."""
    limits = [problem.times[-1] / _LEAST]
    for part, rate in ((_VEHICLE, problem.rate_scale()), (_GROUND, problem.ground_scale())):
        if rate > 0.0:
            limits.append(part / rate)
    return max(min(limits), 10.0 * _SHORTEST * problem.times[-1])


def _excess(records: np.ndarray, error: StepError, paths: int, n: int, vehicle: int) -> float:
    """Step error over what is allowed: the worst quantity, root mean square over time; 1 is just right.

    Filter states are exact and not looked at. An error that its own standard error explains counts as none.
    """
    if error.paths < 0.5 * records.shape[2]:
        return math.inf
    moments = moments_of(records, n)
    variance = moments.variance
    size = np.sqrt(np.nanmean(moments.mean**2 + variance, axis=0))
    spread = moments.variance_standard_error * math.sqrt(records.shape[2] / paths)
    worst = 0.0
    judged = np.r_[0:vehicle, n : records.shape[1]]
    for found, own, sampling, floor in (
        (error.mean, error.mean_standard_error, np.sqrt(variance / paths), size),
        (error.variance, error.variance_standard_error, spread, size**2),
    ):
        allowed = np.sqrt((_PART * sampling) ** 2 + (_FLOOR * floor) ** 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio, doubt = (np.where(allowed > 0.0, part / allowed, 0.0)[:, judged] for part in (found, own))
        ratio, doubt = (np.sqrt(np.nanmean(part**2, axis=0)) for part in (ratio, doubt))
        worst = max(worst, float(np.where(ratio > 3.0 * doubt, ratio, 0.0).max(initial=0.0)))
    return worst
