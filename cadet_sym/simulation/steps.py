"""The time step: a first choice from the rates of vehicle and ground, then as short as its measured error asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from cadet_sym.simulation.control import Reference, controlled_step, reference_of
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.rates import SHORTEST
from cadet_sym.simulation.statistics import Moments, StepError, step_error_of
from cadet_sym.simulation.workers import records_in_parts, records_of

__all__ = ["Chosen", "Precision", "choose_step"]

_PAIRS = (256, 4096)  # least and most paths that are computed with a step and with half of it: else an eighth
_PART = 0.5  # of the sampling error: what the step's error may be
_TRIALS = 8
_HOPELESS = 1.4  # halving the step must shrink its error by this much, else pairs of paths do not stay together
_TOO_LONG = 0.5  # step times the vehicle's fastest rate: where most paths run away, they may do so for the step's sake
_STANDS_OUT = 4.0  # standard errors by which a step's error must differ from none to count as seen
_RUNAWAY = 300.0  # times the deviation that one path in ten exceeds
_TOGETHER = 0.5  # of its distance from the others: how far apart the two of a pair may be
_FLOOR = 1e-4  # of a quantity's own size: an error that is not looked into, however many paths there are
_WORTH = 2.0  # times fewer paths, for the quantity that gains most: with less the twin costs more time than it saves
_RUN_IN = 7.0  # time constants of the slowest mode


@dataclass(frozen=True)
class Precision:
    """How exact the moments will be: by the number of paths, or by the half-width wanted of their limits."""

    paths: int
    target: float | None = None  # half-width of a variance's limits over the variance, of a mean's over the std
    factor: float = 1.0  # half-width of the limits over the standard error
    seconds: float = math.inf  # for the choice of a step

    def pairs(self, needed: float) -> int:
        """How many pairs of paths show the step's error, where so many paths are needed: an eighth of them."""
        return int(min(max(needed / 8.0, _PAIRS[0]), _PAIRS[1]))

    def sampling(self, spread: np.ndarray, variance: np.ndarray) -> np.ndarray:
        """Standard errors to come (2, times, k) of mean and variance, from the spread of one path's part in them."""
        if self.target is None:
            return spread / math.sqrt(self.paths)
        return self.target / self.factor * np.stack([np.sqrt(variance), variance])


@dataclass(frozen=True)
class Chosen:
    """A time step with its error, and how it came about."""

    step: float
    run_in: float
    error: StepError | None = None
    reference: Reference | None = None  # from the paths that showed the error
    reached: bool = True  # whether the error is small beside the sampling error
    worth: bool = True  # whether the twin saves enough; if not, the step was not looked into
    seconds: Mapping[str, float] = field(default_factory=dict)


def choose_step(
    problem: Problem,
    precision: Precision,
    seed: int,
    step: float | None,
    run_in: float | None,
    engine: str,
    check: bool,
    insist: bool = True,
) -> Chosen:
    """Take the step given, or shorten the first choice until its error is below half of the sampling error.

    The error is measured on pairs of paths that share their noise; the run's own paths are others. Unless `insist`,
    the first of them also tell whether the twin is worth its time.
    """
    whole = problem.system.model.initial.whole
    before = 0.0 if not whole else problem.rates.relaxation_time(_RUN_IN) if run_in is None else float(run_in)
    fixed = step is not None
    step = step if step is not None else problem.first_step
    if not check:
        return Chosen(step, before)
    pairs = precision.pairs(precision.paths)
    seconds = {"compiling": _compile(problem, step, before, engine)}
    began = perf_counter()
    trials: list[_Trial] = []
    while True:
        started = perf_counter()
        trials.append(_try(problem, step, before, engine, seed, pairs, precision))
        last = trials[-1]
        if not insist and not last.lost and last.reference.gain < _WORTH:
            return Chosen(last.step, before, worth=False)
        hopeless = len(trials) > 1 and last.is_no_better_than(trials[-2])
        no_better = hopeless and not (last.died > 0.5 and last.step * problem.rates.fastest() > _TOO_LONG)
        enough = last.excess <= 1.0 or fixed or len(trials) == _TRIALS
        if enough or no_better or last.step < SHORTEST * problem.times[-1]:
            break
        # The error falls with the first or second power of the step.
        more, shorter = precision.pairs(last.needed), min(8.0, max(2.0, last.excess**0.75))
        now = perf_counter()
        if now - began + (now - started) * shorter * more / pairs > precision.seconds:
            break
        pairs, step = more, last.step / shorter
    # Where a shorter step makes pairs no closer, the longest will do whose error does not show.
    best = next((trial for trial in trials if min(trial.excess, trial.bias) <= 1.0), last) if no_better else last
    seconds["step"] = perf_counter() - began
    return Chosen(best.step, before, best.error, best.reference, min(best.excess, best.bias) <= 1.0, seconds=seconds)


@dataclass(frozen=True)
class _Trial:
    """A step, its error, and this over what is allowed: with its own doubt, and what stands out of it alone."""

    step: float
    error: StepError
    reference: Reference
    excess: float
    bias: float
    needed: float  # paths
    lost: int = 0  # pairs that run apart; where there are any, excess and bias are infinite
    died: float = 0.0  # share of pairs that run to infinity

    def is_no_better_than(self, longer: _Trial) -> bool:
        """Whether a shorter step has brought little: a model whose own paths run away does so with any step."""
        if self.lost and longer.lost:
            return self.lost > longer.lost / _HOPELESS
        return self.excess > longer.excess / _HOPELESS


def _try(problem: Problem, step: float, before: float, engine: str, seed: int, pairs: int, precision: Precision) -> _Trial:
    plan, grid = problem.plan(step, before, paired=True)
    records = records_in_parts(plan, engine, seed, pairs)
    fine, coarse = (each[:, : problem.quantities] for each in records)
    with np.errstate(over="ignore", invalid="ignore"):
        error, reference = step_error_of(coarse, fine), reference_of(problem, records[0])
    moments = reference.moments
    vehicle = problem.system.vehicle_size
    lost, died = _running_apart(coarse[:, :vehicle], fine[:, :vehicle]), 1.0 - error.paths / pairs
    if not np.isfinite(error.variance[:, :vehicle]).all():  # of what is too large to be squared there are no moments
        lost, died = pairs, 1.0
    if lost:
        return _Trial(float(grid.step.max()), error, reference, math.inf, math.inf, precision.paths, lost, died)
    spread = math.sqrt(pairs) * np.stack([moments.mean_standard_error, moments.variance_standard_error])
    if reference.controls:
        with np.errstate(over="ignore", invalid="ignore"):  # of the coarser of two, the twin may run away
            error, spread = controlled_step(reference.controls, records[1], records[0], error, spread)
    sampling = precision.sampling(spread, moments.variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = float(np.nanmax(np.where(sampling > 0.0, spread / sampling, 0.0), initial=0.0)) ** 2
    excess, bias = _excess(problem, error, moments, _PART * sampling)
    # A twin whose moments the step falsifies is not used in the end: keep its means within two of their standard errors.
    with np.errstate(over="ignore", invalid="ignore"):
        moved = max((float(tally.drift(records[1], records[0]).max()) for tally in reference.controls), default=0.0)
    moved *= 0.5 * math.sqrt(max(needed, precision.paths))
    excess, bias = max(excess, moved), max(bias, moved)
    return _Trial(float(grid.step.max()), error, reference, excess, bias, needed)


def _running_apart(coarse: np.ndarray, fine: np.ndarray) -> int:
    """Pairs that run away from the other paths and from each other, as they do where a step is too long for them.

    What is far from the others with either step alike, a rare blow of a stop, is the model's own.
    """
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        middle = np.median(fine, axis=2, keepdims=True)
        away = np.maximum(np.abs(coarse - middle), np.abs(fine - middle))
        usual = np.fmax.accumulate(np.quantile(away, 0.9, axis=2, keepdims=True))
        near = (away <= _RUNAWAY * usual) | (np.abs(coarse - fine) <= _TOGETHER * away) | (usual == 0.0)
    return int(np.count_nonzero(~(near & np.isfinite(coarse) & np.isfinite(fine)).all(axis=(0, 1))))


def _compile(problem: Problem, step: float, before: float, engine: str) -> float:
    """Have one path worked out, so that compiling is not counted as anything else; seconds."""
    began = perf_counter()
    records_of(problem.plan(step, before, paired=True)[0], engine, seed=0, first=0, count=1)
    return perf_counter() - began


def _excess(problem: Problem, error: StepError, moments: Moments, allowed: np.ndarray) -> tuple[float, float]:
    """Step error over what is allowed, for the worst quantity: with its doubt, and where it stands out of it.

    Doubt differs from time to time by chance, so its mean square over the run counts; what stands out of it counts
    wherever it is worst. Filter states are exact and not looked at.
    """
    n, vehicle = len(problem.system.states), problem.system.vehicle_size
    judged = np.r_[0:vehicle, n : problem.asked]
    size = np.sqrt(np.nanmean(moments.mean**2 + moments.variance, axis=0))
    excess = bias = 0.0
    for found, doubt, limit, floor in (
        (error.mean, error.mean_standard_error, allowed[0], size),
        (error.variance, error.variance_standard_error, allowed[1], size**2),
    ):
        limit = np.hypot(limit, _FLOOR * floor)[:, judged]
        there = limit > 0.0
        limit = np.where(there, limit, 1.0)
        found, doubt = (np.where(there, part[:, judged], 0.0) / limit for part in (np.abs(found), doubt))
        square = np.where(there, found**2 + doubt**2, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
        excess = max(excess, float(np.sqrt(square).max(initial=0.0)))
        bias = max(bias, float(np.where(found > _STANDS_OUT * doubt, found, 0.0).max(initial=0.0)))
    return max(excess, bias), bias
