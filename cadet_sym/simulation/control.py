"""Control variates: the moments of the paths with the help of the quasi-linear twin's, which are known.

For a quantity X along the direction w of the augmented state, X = w.x or nearly, the twin gives u = w.(y - m),
Gaussian of known variance p, and q (see `riders`). These have mean zero:

    u,   q,   u^2 - p,   u q,   u^3 - 3 p u,   u^4 - 6 p u^2 + 3 p^2,

and X - E[X] is close to u + q. X and X^2 are regressed on them, and

    E[X] = mean(X) - beta . mean(controls),      E[X^2] likewise,      Var[X] = E[X^2] - E[X]^2.

Paths are dealt out to `BATCHES` batches in turn; standard errors, and the bias of the regression, come from leaving out
one batch at a time (jackknife), never from the regression itself. Whether the estimate with or without the twin is taken
was decided before, on other paths (`Reference`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
import sympy as sp

from cadet_sym.simulation.numbers import numeric
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.riders import is_affine
from cadet_sym.simulation.statistics import Moments, StepError, alive, moments_of

__all__ = ["BATCHES", "FEWEST", "ControlTally", "Controlled", "Reference", "controlled_step", "reference_of"]

BATCHES = 40
FEWEST = 4 * BATCHES  # paths: with fewer the standard errors say nothing
_WORTH = 1.2  # times by which other paths' variance must fall for the estimate with the twin to be taken
_PER_DIRECTION = 6
_OWN_DIRECTIONS = 3  # states of an output that is not linear, up to which each is a direction of its own
_RANK = 1e-10  # of the largest eigenvalue of the controls' correlation: smaller ones carry nothing
_KNOWN = 1e-7  # relative: how well the moments of the twin are known; a linear system is its own twin
_SHOWS = 4.0  # standard errors by which a step must move a control's mean to be seen
_UNLIKELY = 6.0  # standard errors by which a control's mean may differ from zero
_ALARM = 0.2  # of a plain standard error: what controls of an unlikely mean may move an estimate by


@dataclass(frozen=True)
class Direction:
    """A direction of the augmented state along which a quantity follows its twin."""

    weights: np.ndarray  # (times, n)
    mean: np.ndarray  # (times,) w.m
    spread: np.ndarray  # (times,) sqrt(w P w)


@dataclass(frozen=True)
class Controlled:
    """Estimates of one quantity by control variates, (times,) each."""

    mean: np.ndarray
    variance: np.ndarray
    mean_standard_error: np.ndarray
    variance_standard_error: np.ndarray
    alarm: float  # how far controls of an unlikely mean move an estimate, in its plain standard errors

    @property
    def trusted(self) -> bool:
        """Whether the controls have the means that they should have."""
        return self.alarm < _ALARM


@dataclass(frozen=True)
class ControlTally:
    """Sums of products of (1, X, X^2, controls), a batch and a time each: all that the estimates need.

    X is taken about `centre` in units of `unit`, near the mean and the standard deviation, so that nothing cancels.
    """

    target: int  # row of the records
    directions: tuple[Direction, ...]
    centre: np.ndarray  # (times,)
    unit: np.ndarray  # (times,)
    states: int  # augmented states: the first rows of the records
    vehicle: int
    twin: int  # first row of the twin's y; q follows
    gain: np.ndarray = field(default_factory=lambda: np.full((2, 1), np.inf))  # (2, times): see `gains`

    @property
    def prefer(self) -> np.ndarray:
        """Where the estimates of mean and variance are those with the twin, (2, times)."""
        return np.broadcast_to(self.gain > _WORTH, (2, len(self.centre)))

    def gains(self, records: np.ndarray) -> np.ndarray:
        """How many times smaller the twin makes the variance of the estimates of mean and variance, (2, times)."""
        there = alive(records)
        runs_away = np.abs(records[:, self.twin : self.twin + 2 * self.vehicle]).max(initial=0.0, where=there[:, None]) > _AWAY
        if runs_away or (there.sum(axis=1) < 0.5 * there.shape[1]).any():
            return np.ones((2, len(there)))
        left = self.left_over(records, records)[:, 0]
        X = (records[:, self.target] - self.centre[:, None]) / self.unit[:, None]
        plain, rest = (np.nanvar(np.where(there, part, np.nan), axis=-1) for part in (np.stack([X, X * X]), left))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(plain > 0.0, plain / rest, 1.0)

    @property
    def size(self) -> int:
        """Entries of the vector whose products are summed."""
        return 3 + _PER_DIRECTION * len(self.directions)

    def sums(self, records: np.ndarray, first: int) -> np.ndarray:
        """(batches, times, size, size), from records (times, rows, paths) that begin with path number `first`."""
        v = self._vectors(records)
        total = np.zeros((BATCHES, len(v), self.size, self.size))
        for lag in range(min(BATCHES, v.shape[2])):
            part = v[:, :, lag::BATCHES]
            total[(first + lag) % BATCHES] = np.einsum("tap,tbp->tab", part, part)
        return total

    def _vectors(self, records: np.ndarray) -> np.ndarray:
        """(times, size, paths): 1, X, X^2 and the controls, zero for paths that diverged."""
        there = alive(records)[:, None, :]
        records = np.where(there, records, 0.0)
        X = (records[:, self.target] - self.centre[:, None]) / self.unit[:, None]
        rows = [np.ones_like(X), X, X * X]
        ground = records[:, self.vehicle : self.states]
        y, q = (records[:, self.twin + k * self.vehicle :][:, : self.vehicle] for k in (0, 1))
        for d in self.directions:
            scale = np.where(d.spread > 0.0, d.spread, np.inf)[:, None]
            of_vehicle, of_ground = d.weights[:, : self.vehicle], d.weights[:, self.vehicle :]
            u = np.einsum("ta,tap->tp", of_vehicle, y) + np.einsum("ta,tap->tp", of_ground, ground)
            u = (u - d.mean[:, None]) / scale
            v = np.einsum("ta,tap->tp", of_vehicle, q) / scale
            one = np.where(np.isfinite(scale), 1.0, 0.0)
            rows += [u, v, u * u - one, u * v, u**3 - 3.0 * u, u**4 - 6.0 * u * u + 3.0 * one]
        vectors = np.stack(rows, axis=1)
        return np.where(there, vectors, 0.0)

    def left_over(self, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
        """What the controls leave of one path's part in mean and variance, for two records of the same paths.

        Returns
        -------
        (2, 2, times, paths) : of mean and variance, of coarse and fine; in units of `unit` and its square.
        """
        means, beta = _regression(self.sums(fine, 0).sum(axis=0))
        left = []
        for records in (coarse, fine):
            v = self._vectors(records)
            first, second = np.moveaxis(v[:, 1:3] - np.einsum("tac,tap->tcp", beta, v[:, 3:]), 1, 0)
            left.append(np.stack([first, second - 2.0 * means[:, :1] * first]))
        return np.stack(left, axis=1)

    def drift(self, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
        """What the step adds to the controls' means where it shows, in standard deviations of one path's control.

        From two records of the same paths; (times,) the worst control of each.
        """
        if not self.prefer.any():
            return np.zeros(len(self.centre))
        a, b = (self._vectors(records)[:, 3:] for records in (coarse, fine))
        added, n = a - b, max(a.shape[2], 2)
        shift, doubt = np.abs(added.mean(axis=2)), added.std(axis=2) / math.sqrt(n)
        spread = b.std(axis=2)
        shows = (shift > _SHOWS * doubt) & (spread > 0.0)
        return np.where(shows, 2.0 * shift / np.where(spread > 0.0, spread, 1.0), 0.0).max(axis=1)

    def estimate(self, sums: np.ndarray) -> Controlled:
        """Mean and variance with their standard errors, from the sums of all paths."""
        whole = sums.sum(axis=0)
        together = np.concatenate([whole[None], whole[None] - sums])
        theta = _estimates(together)  # (1 + batches, 2, times)
        rest = theta[1:]
        centre = rest.mean(axis=0)
        error = np.sqrt((BATCHES - 1) / BATCHES * np.sum((rest - centre) ** 2, axis=0))
        best = BATCHES * theta[0] - (BATCHES - 1) * centre
        unlikely, alarm = self._unlikely(whole)
        error = np.hypot(error, unlikely)
        mean, variance = self.centre + self.unit * best[0], self.unit**2 * best[1]
        return Controlled(
            mean=mean,
            variance=variance,
            mean_standard_error=np.hypot(self.unit * error[0], _KNOWN * (np.abs(mean) + np.sqrt(np.abs(variance)))),
            variance_standard_error=np.hypot(self.unit**2 * error[1], _KNOWN * np.abs(variance)),
            alarm=alarm,
        )

    def _unlikely(self, whole: np.ndarray) -> tuple[np.ndarray, float]:
        """By how much controls of an unlikely mean move the estimates, (2, times), and the largest part of a plain error.

        Either the twin is not what it is said to be, or the control is one that hardly any path feels, as a stop that is
        out of reach: then the little that it moves is an error that the paths themselves do not tell.
        """
        n = np.maximum(whole[:, 0, 0], 2.0)[:, None]
        means = whole[:, 0, 1:] / n
        squares = np.diagonal(whole, axis1=1, axis2=2)[:, 1:] / n
        spreads = np.sqrt(np.maximum(squares - means**2, 0.0) / n)
        _, beta = _regression(whole)
        unlikely = np.abs(means[:, 2:]) > _UNLIKELY * spreads[:, 2:]
        moved = np.where(unlikely[..., None], np.abs(beta * means[:, 2:, None]), 0.0).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where((moved > 0.0) & self.prefer.T, moved / spreads[:, :2], 0.0)
        return moved.T, float(part.max(initial=0.0))


def _regression(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (..., times, size - 1) and coefficients (..., times, controls, 2) of X and X^2 on the controls."""
    n = np.maximum(sums[..., 0, 0], 1.0)
    means = sums[..., 0, 1:] / n[..., None]
    covariance = sums[..., 1:, 1:] / n[..., None, None] - means[..., :, None] * means[..., None, :]
    spread = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    scale = np.where(spread > 0.0, spread, 1.0)
    correlation = covariance / scale[..., :, None] / scale[..., None, :]
    lead, vectors = np.linalg.eigh(correlation[..., 2:, 2:])
    usable = lead > _RANK * np.maximum(lead[..., -1:], 1e-300)
    inverse = np.where(usable, 1.0 / np.where(usable, lead, 1.0), 0.0)
    along = np.einsum("...ak,...ac->...kc", vectors, correlation[..., 2:, :2])
    beta = np.einsum("...ak,...kc->...ac", vectors, inverse[..., None] * along)
    return means, beta * scale[..., None, :2] / scale[..., 2:, None]


def _estimates(sums: np.ndarray) -> np.ndarray:
    """E[X] and Var[X], (..., 2, times), from sums (..., times, size, size)."""
    means, beta = _regression(sums)
    first, second = np.moveaxis(means[..., :2] - np.einsum("...ac,...a->...c", beta, means[..., 2:]), -1, 0)
    return np.stack([first, second - first**2], axis=-2)


@dataclass(frozen=True)
class Reference:
    """What some paths tell beforehand: places and sizes, and how much of each quantity the twin explains."""

    moments: Moments
    controls: tuple[ControlTally, ...]  # of every vehicle state and output, if there is a twin

    @property
    def gain(self) -> float:
        """What the twin saves: the geometric mean over the run of its gain, for the quantity that gains most."""
        gains = [np.exp(np.log(np.clip(tally.gain, 1.0, 1e12)).mean(axis=1)).max() for tally in self.controls]
        return float(max(gains, default=1.0))


def reference_of(problem: Problem, records: np.ndarray) -> Reference:
    """From records (times, rows, paths) of some paths."""
    n, states = len(problem.system.states), problem.system.states
    weights: dict[int, np.ndarray] = {}
    if problem.twin is not None:
        for row, expression in enumerate(problem.system.outputs.values(), n):
            if not is_affine(expression, states):
                seen = [b for b, s in enumerate(states) if s in expression.free_symbols]
                weights[row] = _slopes(records, row, seen, n)
    moments = moments_of(records[:, : problem.quantities], n)
    controls = (replace(each, gain=each.gains(records)) for each in _control_tallies(problem, moments, weights))
    return Reference(moments, tuple(controls))


def _slopes(records: np.ndarray, row: int, seen: list[int], n: int) -> np.ndarray:
    """Regression of one row on some states at each time, (times, n)."""
    slopes, living = np.zeros((len(records), n)), alive(records).all(axis=0)
    if living.sum() < 2:
        return slopes
    for k, values in enumerate(records[:, :, living]):
        x, y = (values[rows] - values[rows].mean(axis=-1, keepdims=True) for rows in (seen, row))
        size = np.maximum(x.std(axis=1), 1e-300)
        slopes[k, seen] = np.linalg.lstsq((x / size[:, None]).T, y, rcond=1e-9)[0] / size
    return slopes


def _control_tallies(
    problem: Problem, moments: Moments, slopes: Mapping[int, np.ndarray]
) -> tuple[ControlTally, ...]:
    """A tally for every vehicle state and output, taken about the moments of some paths.

    Parameters
    ----------
    slopes : row of an output that is not linear -> direction (times, n) along which it follows the states.
    """
    twin, system = problem.twin, problem.system
    if twin is None:
        return ()
    n, nv = len(system.states), system.vehicle_size
    shape = (len(problem.times), n)
    units = [np.broadcast_to(row, shape) for row in np.eye(n)]
    along = [(k, [units[k]]) for k in range(nv)]
    known = {**problem.values, **problem.run_values(problem.times)}
    for row, expression in enumerate(islice(system.outputs.values(), problem.asked - n), n):
        seen = [b for b, s in enumerate(system.states) if s in expression.free_symbols]
        if is_affine(expression, system.states):
            weights = np.zeros(shape)
            weights[:, seen] = numeric([sp.diff(expression, system.states[b]) for b in seen], known, problem.elements)
            along.append((row, [weights]))
        else:
            own = seen if len(seen) <= _OWN_DIRECTIONS else []
            along.append((row, [units[b] for b in own] or [slopes[row]]))
    std = np.sqrt(moments.variance)
    return tuple(
        ControlTally(
            target=row,
            directions=tuple(_direction(w, twin.mean, twin.covariance) for w in weights),
            centre=moments.mean[:, row],
            unit=np.where(std[:, row] > 0.0, std[:, row], 1.0),
            states=n,
            vehicle=nv,
            twin=problem.first_row(problem.twin_rider),
        )
        for row, weights in along
    )


def _direction(weights: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> Direction:
    spread = np.einsum("ta,tab,tb->t", weights, covariance, weights)
    return Direction(weights, np.einsum("ta,ta->t", weights, mean), np.sqrt(np.maximum(spread, 0.0)))


def controlled_step(
    tallies: tuple[ControlTally, ...], coarse: np.ndarray, fine: np.ndarray, error: StepError, spread: np.ndarray
) -> tuple[StepError, np.ndarray]:
    """Step error and spread of what the controls leave, where they are preferred, in the place of the plain records'.

    Parameters
    ----------
    spread : (2, times, k) standard deviations of one path's part in a mean and in a variance.
    """
    parts = {name: getattr(error, name).copy() for name in _PARTS}
    spread = spread.copy()
    for tally in tallies:
        if not tally.prefer.any():
            continue
        left = tally.left_over(coarse, fine)  # (2 of mean and variance, 2 of coarse and fine, times, pairs)
        there = np.isfinite(left).all(axis=(0, 1, 2))
        difference = (left[:, 0] - left[:, 1])[..., there]
        per = 2.0 / math.sqrt(max(int(there.sum()), 1))
        for k, at in enumerate(tally.prefer):
            unit = tally.unit[at] ** (k + 1)
            parts[_PARTS[k]][at, tally.target] = 2.0 * unit * difference[k][at].mean(axis=-1)
            parts[_PARTS[2 + k]][at, tally.target] = per * unit * difference[k][at].std(axis=-1)
            spread[k, at, tally.target] = unit * left[k, 1][..., there][at].std(axis=-1)
    return StepError(**parts, paths=error.paths), spread


_AWAY = 1e25  # a twin that far has no moments: its gains are too stiff for the step. Eighth powers are still finite
_PARTS = ("mean", "variance", "mean_standard_error", "variance_standard_error")
