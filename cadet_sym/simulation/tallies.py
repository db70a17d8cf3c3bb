"""What is counted on the way, on demand: distributions, crossings of levels, averages over time.

A tally turns the records of a group of paths into sums; sums of all groups are added up, in the order of the paths,
and the tally makes its result of them. No path is stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cadet_sym.simulation.statistics import alive

__all__ = ["AverageTally", "CrossingTally", "Crossings", "Histogram", "HistogramTally", "Tally", "TimeAverage"]


class Tally(Protocol):
    """Sums over paths."""

    def sums(self, records: np.ndarray, first: int) -> np.ndarray:
        """Sums over records (times, rows, paths) of paths that begin with number `first`."""
        ...


@dataclass(frozen=True)
class Histogram:
    """Distribution of a quantity at every output time."""

    edges: np.ndarray  # (bins + 1,)
    counts: np.ndarray  # (times, bins + 2): below the first edge, in the bins, at or above the last edge

    @property
    def density(self) -> np.ndarray:
        """Probability density in the bins, (times, bins)."""
        total = np.maximum(self.counts.sum(axis=1, keepdims=True), 1.0)
        return self.counts[:, 1:-1] / total / np.diff(self.edges)


@dataclass(frozen=True)
class HistogramTally:
    """Counts the paths in every bin."""

    row: int
    edges: np.ndarray

    def sums(self, records: np.ndarray, first: int) -> np.ndarray:
        """(times, bins + 2)."""
        counts = np.zeros((len(records), len(self.edges) + 1))
        for k, (values, there) in enumerate(zip(records[:, self.row], alive(records), strict=True)):
            bins = np.searchsorted(self.edges, values[there], side="right")
            counts[k] = np.bincount(bins, minlength=len(self.edges) + 1)
        return counts

    def result(self, sums: np.ndarray) -> Histogram:
        """The distribution."""
        return Histogram(self.edges, sums)


@dataclass(frozen=True)
class Crossings:
    """Up-crossings of levels of a quantity, and the chance of having been there.

    Crossings are looked for at every step of the simulation, so excursions shorter than a step are missed.
    """

    levels: np.ndarray  # (levels,)
    rate: np.ndarray  # (times, levels) up-crossings per unit of time since the output time before; NaN at the first
    rate_standard_error: np.ndarray
    probability: np.ndarray  # (times, levels) of the quantity having been at or above the level since the start
    probability_standard_error: np.ndarray


@dataclass(frozen=True)
class CrossingTally:
    """Adds up the counts and marks that ride along with the paths (see `CrossingRider`)."""

    first_row: int
    levels: tuple[float, ...]
    time: np.ndarray

    def sums(self, records: np.ndarray, first: int) -> np.ndarray:
        """(4, times, levels): paths, crossings in the interval, their squares, marks."""
        there = alive(records)[:, None, :]
        rows = records[:, self.first_row : self.first_row + 2 * len(self.levels)]
        counts, marks = rows[:, 0::2], rows[:, 1::2]
        new = np.diff(counts, axis=0, prepend=counts[:1])
        parts = [np.broadcast_to(there, new.shape), *(np.where(there, part, 0.0) for part in (new, new**2, marks))]
        return np.stack([part.sum(axis=2) for part in parts])

    def result(self, sums: np.ndarray) -> Crossings:
        """Rates and probabilities with their standard errors."""
        n, total, square, marks = np.maximum(sums[0], 1.0), *sums[1:]
        length = np.diff(self.time, prepend=np.nan)[:, None]
        mean, p = total / n, marks / n
        spread = np.sqrt(np.maximum(square / n - mean**2, 0.0) / np.maximum(n - 1.0, 1.0))
        return Crossings(
            levels=np.array(self.levels),
            rate=mean / length,
            rate_standard_error=spread / length,
            probability=p,
            probability_standard_error=np.sqrt(p * (1.0 - p) / n),
        )


@dataclass(frozen=True)
class TimeAverage:
    """Moments of a stationary run, averaged over time as well as over paths.

    Standard errors come from the spread of the paths' own averages, so they allow for what output times close to each
    other have in common. `effective` is the number of independent values that would tell the mean as well.
    """

    since: float
    mean: np.ndarray  # (k,) of states, then outputs
    variance: np.ndarray
    mean_standard_error: np.ndarray
    variance_standard_error: np.ndarray
    effective: np.ndarray


@dataclass(frozen=True)
class AverageTally:
    """Sums of every path's averages a of x and b of x^2 from one output time on, x taken about `centre`."""

    start: int  # first output time that counts
    since: float
    centre: np.ndarray  # (k,)

    def sums(self, records: np.ndarray, first: int) -> np.ndarray:
        """(6, k): paths, a, b, a^2, a b, b^2."""
        there = alive(records)[self.start :].all(axis=0)
        x = records[self.start :, : len(self.centre), there] - self.centre[:, None]
        a, b = x.mean(axis=0), (x * x).mean(axis=0)
        return np.stack([part.sum(axis=1) for part in (np.ones_like(a), a, b, a * a, a * b, b * b)])

    def result(self, sums: np.ndarray) -> TimeAverage:
        """Var = E[b] - E[a]^2, its error from that of b - 2 E[a] a."""
        n = np.maximum(sums[0], 2.0)
        a, b, aa, ab, bb = sums[1:] / n
        variance = b - a * a
        of_mean = np.maximum(aa - a * a, 0.0) / (n - 1.0)
        of_variance = (bb - b * b) - 4.0 * a * (ab - a * b) + 4.0 * a * a * (aa - a * a)
        with np.errstate(divide="ignore", invalid="ignore"):
            effective = np.where(of_mean > 0.0, variance / of_mean, np.inf)
        return TimeAverage(
            since=self.since,
            mean=self.centre + a,
            variance=variance + of_mean,
            mean_standard_error=np.sqrt(of_mean),
            variance_standard_error=np.sqrt(np.maximum(of_variance, 0.0) / (n - 1.0)),
            effective=effective,
        )
