"""Moments of many paths, joined from groups without loss, and how far from the truth they may be.

Groups are joined in the order of their paths by the formulas of Chan, Golub & LeVeque (1983) and Pebay (2008), so
that the result does not depend on who worked out which group, or when.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np

__all__ = [
    "Estimates",
    "Moments",
    "StepError",
    "alive",
    "interval_factor",
    "moments_of",
    "step_error_of",
    "student_factor",
]

_BEYOND = 1e60  # a path that goes so far has diverged; fourth powers are still finite


@dataclass(frozen=True)
class Moments:
    """Sums of powers about the mean, for k quantities of which the first n are states.

    A path counts as long as it has not diverged.
    """

    count: np.ndarray  # (times,)
    mean: np.ndarray  # (times, k)
    second: np.ndarray  # (times, k): sum of (x - mean)^2
    third: np.ndarray  # (times, k)
    fourth: np.ndarray  # (times, k)
    product: np.ndarray  # (times, n, n): sum of products of the states' deviations

    def joined(self, other: Moments) -> Moments:
        """Moments of both sets of paths together."""
        a, b = self.count[:, None], other.count[:, None]
        n = np.maximum(a + b, 1.0)
        d = other.mean - self.mean
        d = np.where(a == 0, 0.0, np.where(b == 0, 0.0, d))
        mean = np.where(a == 0, other.mean, self.mean + d * (b / n))
        second = self.second + other.second + d**2 * (a * b / n)
        third = (
            self.third + other.third + d**3 * (a * b * (a - b) / n**2)
            + 3.0 * d * (a * other.second - b * self.second) / n
        )  # fmt: skip
        fourth = (
            self.fourth + other.fourth + d**4 * (a * b * (a * a - a * b + b * b) / n**3)
            + 6.0 * d**2 * (a * a * other.second + b * b * self.second) / n**2
            + 4.0 * d * (a * other.third - b * self.third) / n
        )  # fmt: skip
        s = d[:, : self.product.shape[1]]
        product = self.product + other.product + (a * b / n)[:, :, None] * s[:, :, None] * s[:, None, :]
        return Moments(self.count + other.count, mean, second, third, fourth, product)

    @property
    def variance(self) -> np.ndarray:
        """Unbiased, (times, k)."""
        return self._per(self.second, 1)

    @property
    def covariance(self) -> np.ndarray:
        """Of the states, (times, n, n)."""
        return self._per(self.product, 1)

    @property
    def mean_standard_error(self) -> np.ndarray:
        """Sqrt(variance / count)."""
        return np.sqrt(self._per(self.variance, 0))

    @property
    def variance_standard_error(self) -> np.ndarray:
        """se^2 = (m4 - var^2 (n - 3)/(n - 1)) / n: a variance is the less certain, the heavier the tails."""
        n = self.count[:, None]
        spread = self._per(self.fourth, 0) - self.variance**2 * (n - 3.0) / np.maximum(n - 1.0, 1.0)
        return np.sqrt(self._per(np.maximum(spread, 0.0), 0))

    @property
    def skewness(self) -> np.ndarray:
        """Third central moment over std^3."""
        return self._standardised(self.third, 1.5)

    @property
    def kurtosis(self) -> np.ndarray:
        """Fourth central moment over the variance squared; 3 for a Gaussian."""
        return self._standardised(self.fourth, 2.0)

    def _standardised(self, total: np.ndarray, power: float) -> np.ndarray:
        spread = self._per(self.second, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(spread > 0.0, self._per(total, 0) / spread**power, np.nan)

    def _per(self, total: np.ndarray, lost: int) -> np.ndarray:
        n = (self.count - lost).reshape(-1, *[1] * (total.ndim - 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(n > 0, total / n, np.nan)


def alive(records: np.ndarray) -> np.ndarray:
    """Which paths have not diverged, (times, paths), of records (times, k, paths)."""
    return np.asarray((np.abs(records) < _BEYOND).all(axis=1))


def moments_of(records: np.ndarray, states: int) -> Moments:
    """Moments of records (times, k, paths), the first `states` rows being states."""
    finite = alive(records)
    if finite.all():
        count = np.full(len(records), float(records.shape[2]))
    else:
        count = finite.sum(axis=1).astype(float)
        records = np.where(finite[:, None, :], records, 0.0)
    n = np.maximum(count, 1.0)[:, None]
    mean = records.sum(axis=2) / n
    d = records - mean[:, :, None]
    if not finite.all():
        d *= finite[:, None, :]
    square = d * d
    # einsum without BLAS: the order of the sums is always the same.
    s = d[:, :states]
    return Moments(
        count=count,
        mean=mean,
        second=square.sum(axis=2),
        third=(square * d).sum(axis=2),
        fourth=(square * square).sum(axis=2),
        product=np.einsum("tap,tbp->tab", s, s),
    )


@dataclass(frozen=True)
class Estimates:
    """Mean and variance of k quantities with their standard errors, (times, k) each."""

    mean: np.ndarray
    variance: np.ndarray
    mean_standard_error: np.ndarray
    variance_standard_error: np.ndarray
    helped: Mapping[str, np.ndarray]  # "mean" and "variance": (times, k) bool, where they are by control variates
    freedom: int = 0  # degrees of freedom of the standard errors there

    def half_width(self, moment: str, level: float) -> np.ndarray:
        """Half-widths of limits, (times, k): normal, or Student's where the standard error is one of few batches."""
        plain = interval_factor(level)
        factor = np.where(self.helped[moment], student_factor(level, self.freedom), plain) if self.freedom else plain
        return np.asarray(factor * getattr(self, f"{moment}_standard_error"))


@dataclass(frozen=True)
class StepError:
    """What the time step does to mean and variance, from pairs of paths on the same noise.

    `mean` and `variance` are twice the difference between the step used and half of it: the error itself for a
    scheme of first order, more than it for a higher order. Standard errors are those of the paired difference.
    """

    mean: np.ndarray  # (times, k)
    variance: np.ndarray  # (times, k)
    mean_standard_error: np.ndarray
    variance_standard_error: np.ndarray
    paths: int


def step_error_of(coarse: np.ndarray, fine: np.ndarray) -> StepError:
    """Step error from records (times, k, pairs) of the same paths with a step and with half of it."""
    both = alive(coarse).all(axis=0) & alive(fine).all(axis=0)
    coarse, fine = coarse[:, :, both], fine[:, :, both]
    pairs = int(both.sum())
    if pairs < 2:
        missing = np.full(coarse.shape[:2], np.nan)
        return StepError(missing, missing, missing, missing, pairs)
    difference = coarse - fine
    a, b = coarse - coarse.mean(axis=2, keepdims=True), fine - fine.mean(axis=2, keepdims=True)
    of_variance = (a**2 - b**2) * (pairs / (pairs - 1.0))
    per = 2.0 / math.sqrt(pairs)
    return StepError(
        mean=2.0 * difference.mean(axis=2),
        variance=2.0 * of_variance.mean(axis=2),
        mean_standard_error=per * difference.std(axis=2, ddof=1),
        variance_standard_error=per * of_variance.std(axis=2, ddof=1),
        paths=pairs,
    )


@lru_cache(maxsize=32)
def interval_factor(level: float) -> float:
    """How many standard errors either way hold the truth with probability `level`: 2.576 for 0.99."""
    return NormalDist().inv_cdf(0.5 + 0.5 * level)


@lru_cache(maxsize=32)
def student_factor(level: float, freedom: int) -> float:
    """The same for a standard error that is itself an estimate: 2.708 for 0.99 and 39 degrees of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 + 0.5 * level))
