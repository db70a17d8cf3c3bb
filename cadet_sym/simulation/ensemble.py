"""What a simulation gives: moments of the true nonlinear model, and how far from the truth they may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cadet_sym.errors import ModelError
from cadet_sym.labelled import Labelled, LabelledCovariance
from cadet_sym.simulation.inputs import Input
from cadet_sym.simulation.statistics import Estimates, Moments, StepError
from cadet_sym.simulation.tallies import Crossings, Histogram, TimeAverage
from cadet_sym.tables import Shown

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Ensemble", "InputShape", "shape_of"]

_EXACT = 1e6  # times fewer paths: the system is linear, and nothing is left to chance


@dataclass(frozen=True)
class InputShape:
    """How far from Gaussian is what enters a nonlinearity: 0 and 0 is what statistical linearisation takes it for."""

    elements: tuple[str, ...]  # declared elements that it enters; none if all are written out in the rates
    skewness: np.ndarray  # (k,)
    excess_kurtosis: np.ndarray  # (k,)
    skewness_standard_error: np.ndarray  # sqrt(6/n), as for a Gaussian
    excess_kurtosis_standard_error: np.ndarray  # sqrt(24/n)


def shape_of(entering: Input, moments: Moments, row: int) -> InputShape:
    """The shape of one row of moments."""
    n = np.maximum(moments.count, 1.0)
    return InputShape(
        entering.elements, moments.skewness[:, row], moments.kurtosis[:, row] - 3.0, np.sqrt(6.0 / n), np.sqrt(24.0 / n)
    )


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(Shown):
    """Moments of simulated paths at k times, of n states and m outputs, with their errors.

    Three errors are kept apart: sampling (`mean_standard_error`, `variance_standard_error`, `limit`), the time step
    (`mean_step_error`, `variance_step_error`), and what is not a path's error at all, the paths that `diverged`.
    Arrays are labelled: ``truth.mean["x"]``, ``truth.covariance["x", "v"]``.
    """

    model: str
    states: tuple[str, ...]  # the vehicle's in the order declared, then the ground filters'
    outputs: tuple[str, ...]
    time: np.ndarray  # (k,)
    paths: int
    seed: int
    step: float  # longest step of time
    estimates: Estimates  # mean and variance of states, then outputs: by control variates where there are any
    moments: Moments  # of the paths alone
    step_error: StepError | None  # None if it was not asked for
    diverged: int  # paths that stopped being finite before the end
    kept: np.ndarray  # (kept paths, k, n + m and inputs): the first paths as they were recorded
    histograms: Mapping[str, Histogram]
    crossings: Mapping[str, Crossings]
    average: TimeAverage | None  # over time as well, of states, then outputs
    inputs: Mapping[str, InputShape]  # of all nonlinearities of the rates, by the linear form that enters
    level: float  # of the limits, 0.99
    run_in: float  # time for which every path was run in before t = 0, s
    scheme: str  # "heun" or "exponential"
    engine: str  # "numba" or "numpy"
    seconds: Mapping[str, float]  # wall time of: the twin, preparing, compiling, step, paths
    notes: tuple[str, ...]  # what the user should know, in sentences

    @property
    def mean(self) -> Labelled:
        """Means, in the units of the quantity."""
        return self._labelled(self.estimates.mean)

    @property
    def variance(self) -> Labelled:
        """Unbiased variances."""
        return self._labelled(self.estimates.variance)

    @property
    def std(self) -> Labelled:
        """Square roots of the variances."""
        return self._labelled(np.sqrt(np.maximum(self.estimates.variance, 0.0)))

    @cached_property
    def covariance(self) -> LabelledCovariance:
        """Zero-lag covariances of the states, (k, n, n); of outputs the variance."""
        n = len(self.states)
        covariance = self.moments.covariance.copy()
        covariance[:, range(n), range(n)] = self.estimates.variance[:, :n]
        return LabelledCovariance(self.states, covariance, self.outputs, self.variance.outputs)

    @property
    def mean_standard_error(self) -> Labelled:
        """Standard deviation of the mean as an estimate."""
        return self._labelled(self.estimates.mean_standard_error)

    @property
    def variance_standard_error(self) -> Labelled:
        """Standard deviation of the variance as an estimate; the fourth moment is in it."""
        return self._labelled(self.estimates.variance_standard_error)

    @property
    def skewness(self) -> Labelled:
        """Third central moment over std^3: 0 for a Gaussian."""
        return self._labelled(self.moments.skewness)

    @property
    def kurtosis(self) -> Labelled:
        """Fourth central moment over variance^2: 3 for a Gaussian."""
        return self._labelled(self.moments.kurtosis)

    @property
    def excess_kurtosis(self) -> Labelled:
        """Kurtosis less 3."""
        return self._labelled(self.moments.kurtosis - 3.0)

    @property
    def mean_step_error(self) -> Labelled:
        """Bound on what the time step does to the mean (see `StepError`); NaN if it was not asked for."""
        return self._labelled(self._of_step("mean"))

    @property
    def variance_step_error(self) -> Labelled:
        """Bound on what the time step does to the variance (see `StepError`); NaN if it was not asked for."""
        return self._labelled(self._of_step("variance"))

    def limit(self, moment: str, level: float | None = None) -> Labelled:
        """Half-widths of the limits of "mean" or "variance", at the ensemble's level or another.

        The truth lies within them with that probability, sampling error alone considered.
        """
        if moment not in ("mean", "variance"):
            raise ModelError(f'limits are of "mean" or "variance", not {moment!r}')
        return self._labelled(self.estimates.half_width(moment, _checked_level(self.level if level is None else level)))

    def mean_limits(self, name: str, level: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the mean of one state or output."""
        half = self.limit("mean", level)[name]
        return self.mean[name] - half, self.mean[name] + half

    def variance_limits(self, name: str, level: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the variance of one state or output."""
        half = self.limit("variance", level)[name]
        return self.variance[name] - half, self.variance[name] + half

    def saved(self, moment: str) -> Labelled:
        """How many times more paths plain simulation would need for the same standard error of "mean" or "variance"."""
        name = f"{moment}_standard_error"
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._labelled((getattr(self.moments, name) / getattr(self.estimates, name)) ** 2)

    @property
    def controlled(self) -> tuple[str, ...]:
        """Outputs and states whose mean or variance is, at some time, estimated with the quasi-linear system's help."""
        helped = np.any([self.estimates.helped[moment].any(axis=0) for moment in ("mean", "variance")], axis=0)
        names = (*self.states, *self.outputs)
        return tuple(name for name in (*self.outputs, *self.states) if helped[names.index(name)])

    def plain_paths(self, name: str) -> float:
        """How many paths plain simulation needs for limits as narrow, for one state or output.

        Counted where they are widest: a variance's beside the variance, a mean's beside the standard deviation.
        """
        k = (*self.states, *self.outputs).index(name)
        size, worst = self.estimates.variance[:, k], []
        there = size > 1e-12 * size.max(initial=0.0)
        if not there.any():
            return float(self.paths)
        for found in (self.moments, self.estimates):
            of_mean = found.mean_standard_error[there, k] / np.sqrt(size[there])
            worst.append(max(of_mean.max(), (found.variance_standard_error[there, k] / size[there]).max()))
        return float(self.paths * (worst[0] / worst[1]) ** 2) if worst[1] > 0.0 else math.inf

    @property
    def method(self) -> str:
        """How the limits were obtained, and what that saved, in a sentence."""
        limits = f"{100 * self.level:g} % limits"
        if not self.controlled:
            return f"{limits.capitalize()} from the second and fourth moments of {self.paths} paths."
        name = self.controlled[0]
        times = self.plain_paths(name) / self.paths
        linear = "nothing is left to chance, the system being linear"
        worth = f"as from {float(f'{times:.2g}'):g} times as many plain paths" if times < _EXACT else linear
        return (
            f"{limits.capitalize()} by control variates: {self.paths} paths with the quasi-linear system on the same noise, "
            f"standard errors from {self.estimates.freedom + 1} batches; for {name}, {worth}."
        )

    def path(self, name: str) -> np.ndarray:
        """The kept paths of one state or output, (kept paths, k)."""
        return self._labelled(self.kept)[name]

    def to_xarray(self) -> xr.Dataset:
        """Everything as a data set with dimensions time, state, state_2, output, path."""
        import xarray as xr

        n, data = len(self.states), {}
        for name in ("mean", "variance", "mean_standard_error", "variance_standard_error", "skewness", "kurtosis",
                     "mean_step_error", "variance_step_error"):  # fmt: skip
            values = getattr(self, name)
            data[name] = (("time", "state"), values.values)
            data[f"output_{name}"] = (("time", "output"), values.outputs)
        data["covariance"] = (("time", "state", "state_2"), self.covariance.values)
        data["path_states"] = (("path", "time", "state"), self.kept[:, :, :n])
        data["path_outputs"] = (("path", "time", "output"), self.kept[:, :, n : n + len(self.outputs)])
        names = np.array(self.states, dtype=object)
        return xr.Dataset(
            data,
            coords={
                "time": self.time,
                "state": names,
                "state_2": names,
                "output": np.array(self.outputs, dtype=object),
            },
            attrs={
                "model": self.model,
                "paths": self.paths,
                "seed": self.seed,
                "step": self.step,
                "diverged": self.diverged,
                "scheme": self.scheme,
                "engine": self.engine,
            },
        )

    def __str__(self) -> str:
        lines = [f"{self.paths} paths of {self.model or 'the model'}, step {self.step:.3g} ({self.scheme}), seed {self.seed}"]
        for name in (*self.outputs, *self.states):
            mean, variance = self.mean[name][-1], self.variance[name][-1]
            lines.append(
                f"  {name}: mean {mean:.5g} +- {self.limit('mean')[name][-1]:.2g}, variance {variance:.5g} "
                f"+- {self.limit('variance')[name][-1]:.2g} at t = {self.time[-1]:g}"
            )
        return "\n".join([*lines, self.method, *self.notes])

    def _labelled(self, values: np.ndarray) -> Labelled:
        n = len(self.states)
        return Labelled(self.states, values[..., :n], self.outputs, values[..., n : n + len(self.outputs)])

    def _of_step(self, moment: str) -> np.ndarray:
        if self.step_error is None:
            return np.full(self.moments.mean.shape, np.nan)
        return getattr(self.step_error, moment)


def _checked_level(level: float) -> float:
    if not 0.0 < level < 1.0:
        raise ModelError(f"the level of limits is a probability between 0 and 1, not {level!r}; 0.99 is usual")
    return float(level)
