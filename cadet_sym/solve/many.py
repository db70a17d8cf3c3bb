"""Many runs side by side: where each starts, and what was found of them, as columns; a run of its own when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import SolverError

__all__ = ["Start", "Starts", "Trajectories", "Trajectory"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Start:
    """Where a run starts and what it meets: packed moments at t = 0, parameters, times of known breakpoints."""

    y: Array
    p: Array
    breakpoints: tuple[float, ...] = ()

    @cached_property
    def alone(self) -> Starts:
        """The same as the only one of many."""
        return Starts(self.y[None], self.p[None], (self.breakpoints,))


@dataclass(frozen=True, eq=False)
class Starts:
    """Where runs start and what each meets."""

    y: Array  # (runs, size)
    p: Array  # (runs, count)
    breakpoints: Sequence[tuple[float, ...]]

    def __len__(self) -> int:
        return len(self.y)

    def __getitem__(self, k: int) -> Start:
        return Start(self.y[k], self.p[k], self.breakpoints[k])

    def of(self, runs: Sequence[int]) -> Starts:
        """Those of some of the runs."""
        return Starts(self.y[runs], self.p[runs], [self.breakpoints[k] for k in runs])


class Trajectory(NamedTuple):
    """Packed moments at the times asked for, and how they were integrated."""

    time: Array  # (k,)
    y: Array  # (k, size)
    engine: str
    rtol: float
    statistics: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Runs through the same times: each a Trajectory, or the error that it ended with."""

    time: Array  # (k,)
    y: Array  # (runs, k, size); NaN where there is none
    engines: Sequence[str]
    rtol: float
    statistics: Mapping[str, Array]  # (runs,) each
    failures: Mapping[int, SolverError | ArithmeticError]

    @classmethod
    def of(cls, run: Trajectory) -> Trajectories:
        """One alone."""
        statistics = {name: np.array([number]) for name, number in run.statistics.items()}
        return cls(run.time, run.y[None], (run.engine,), run.rtol, statistics, {})

    def __len__(self) -> int:
        return len(self.y)

    def __getitem__(self, k: int) -> Trajectory:
        """One run; raises the error that it ended with."""
        k = range(len(self))[k]
        if k in self.failures:
            raise self.failures[k]
        statistics = {name: float(column[k]) for name, column in self.statistics.items()}
        return Trajectory(self.time, self.y[k], self.engines[k], self.rtol, statistics)
