"""Run groups of paths and put their moments and tallies together, until there are enough of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import reduce
from time import perf_counter
from typing import Any

import numpy as np

from cadet_sym.simulation.control import BATCHES, FEWEST, Controlled, ControlTally
from cadet_sym.simulation.statistics import Estimates, Moments
from cadet_sym.simulation.workers import GroupResult, Task, run_groups

__all__ = ["Collected", "Goal", "collect", "estimates_of"]

_FIRST = 2048  # paths before the first look at how many it will take
_GROWTH, _SPARE = 8.0, 1.05  # most by which their number grows at a time, and margin for what is estimated


@dataclass
class Collected:
    """Everything that the paths so far have given."""

    paths: int = 0
    diverged: int = 0
    groups: list[Moments] = field(default_factory=list)
    kept: list[np.ndarray] = field(default_factory=list)
    sums: list[np.ndarray] = field(default_factory=list)

    def add(self, result: GroupResult) -> None:
        """Put the next group to it; moments are joined as binary numbers grow, which keeps them few and exact."""
        self.paths += result.paths
        self.diverged += result.diverged
        self.kept.append(result.kept)
        self.sums = [a + b for a, b in zip(self.sums, result.sums, strict=True)] if self.sums else list(result.sums)
        self.groups.append(result.moments)
        while len(self.groups) > 1 and self.groups[-2].count[0] <= self.groups[-1].count[0]:
            last = self.groups.pop()
            self.groups[-1] = self.groups[-1].joined(last)

    @property
    def moments(self) -> Moments:
        """Of all paths."""
        return reduce(Moments.joined, self.groups)

    def controlled(self, tallies: Sequence[Any]) -> tuple[Controlled, ...]:
        """Estimates by control variates, where there are any."""
        pairs = zip(tallies, self.sums, strict=True)
        return tuple(tally.estimate(sums) for tally, sums in pairs if isinstance(tally, ControlTally))


def estimates_of(moments: Moments, controls: Sequence[ControlTally], controlled: Sequence[Controlled]) -> Estimates:
    """The plain estimates, and those by control variates where a pilot sample preferred them and they are trusted."""
    names = ("mean", "variance", "mean_standard_error", "variance_standard_error")
    arrays = {name: np.array(getattr(moments, name)) for name in names}
    helped = {moment: np.zeros(moments.mean.shape, bool) for moment in names[:2]}
    for tally, found in zip(controls, controlled, strict=True):
        if not found.trusted or moments.count.min() < FEWEST:
            continue
        for moment, prefer in zip(names, tally.prefer, strict=False):
            helped[moment][prefer, tally.target] = True
            for name in (moment, f"{moment}_standard_error"):
                arrays[name][prefer, tally.target] = getattr(found, name)[prefer]
    return Estimates(**arrays, helped=helped, freedom=BATCHES - 1 if len(controls) else 0)


@dataclass(frozen=True)
class Goal:
    """When there are enough paths."""

    paths: int | None  # so many
    target: float  # else: limits of the quantities watched within this, of a variance and of a standard deviation
    rows: tuple[int, ...]  # quantities watched
    level: float  # of the limits
    seconds: float | None  # time there is

    def reached(self, estimates: Estimates) -> float:
        """Widest limit of the quantities watched, over the target."""
        rows = list(self.rows)
        variance = estimates.variance[:, rows]
        varies = variance > 1e-12 * variance.max(axis=0, initial=0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            of_mean = estimates.half_width("mean", self.level)[:, rows] / np.sqrt(variance)
            of_variance = estimates.half_width("variance", self.level)[:, rows] / variance
        worst = np.where(varies, np.maximum(of_mean, of_variance), 0.0).max(initial=0.0)
        return float(worst / self.target)


def collect(
    task: Task,
    goal: Goal,
    controls: Sequence[ControlTally],
    executor: Executor | None,
    threads: int | None,
    tell: Callable[[int], Any],
) -> tuple[Collected, float]:
    """Run paths until the goal is reached or the time is over; the widest limit over the target comes with them."""
    found, began = Collected(), perf_counter()
    wanted = goal.paths or _FIRST
    while True:
        for result in run_groups(task, range(found.paths, wanted), executor, threads):
            found.add(result)
            tell(result.paths)
        if goal.paths is not None:
            return found, 0.0
        over = goal.reached(estimates_of(found.moments, controls, found.controlled(task.tallies)))
        if over <= 1.0:
            return found, over
        taken, growth = perf_counter() - began, min(_GROWTH, _SPARE * over**2)
        if goal.seconds is not None and taken * max(growth, 1.01) > goal.seconds:
            return found, over
        wanted = -(-int(max(growth, 1.01) * found.paths) // _FIRST) * _FIRST
