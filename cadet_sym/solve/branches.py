"""Follow stationary solutions in a parameter, through folds, by pseudo-arclength continuation.

The curve is measured in what the nonlinear elements see, theta, and in the parameter: everything else follows from
these. So each step solves the structured equations of `linearised` with one more row, the tangent's, and is regular
at a fold, where the solutions turn back (Keller 1977; Doedel, Keller & Kernevez, Int. J. Bifurc. Chaos 1, 493, 1991).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cadet_sym.errors import CadetError, SolverError
from cadet_sym.solve.frozen import Evaluation, FrozenProblem, evaluate
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.rungs import RESIDUAL, STEP, newton, relative_size
from cadet_sym.solve.stability import stability
from cadet_sym.solve.stationary import StationaryPoint

__all__ = ["Branch", "Branches", "branches", "crossings", "trace"]

Array = np.ndarray

LARGEST = 0.04  # a step, of the parameter's range: a branch across it has at least 25 points
SMALLEST = 1e-7


@dataclass(frozen=True)
class Branch:
    """One curve of stationary solutions, in the order in which it was followed. k points, n states."""

    parameter: Array  # (k,)
    mean: Array  # (k, n); NaN for states that drift
    covariance: Array  # (k, n, n); NaN in the rows and columns of states that drift
    stable: Array  # (k,) bool, as fixed points of the moment equations
    rightmost: Array  # (k,) complex: eigenvalue of the moment equations with the largest real part
    residual: Array  # (k,)
    folds: tuple[int, ...]  # indices of the points at which the branch turns back in the parameter
    end: str  # why it ends where it does

    def __len__(self) -> int:
        return len(self.parameter)

    def pieces(self) -> list[tuple[slice, bool]]:
        """Stretches of equal stability, sharing their end points: (points, stable), to be drawn solid or dashed."""
        changes = np.flatnonzero(self.stable[1:] != self.stable[:-1]) + 1
        bounds = [0, *changes, len(self)]
        return [
            (slice(int(first), int(min(last + 1, len(self)))), bool(self.stable[first]))
            for first, last in pairwise(bounds)
        ]


@dataclass(frozen=True)
class Branches:
    """All curves of stationary solutions that were found over the range of one parameter."""

    parameter: str
    range: tuple[float, float]
    branches: tuple[Branch, ...]
    states: tuple[str, ...] = field(default=())

    @property
    def folds(self) -> Array:
        """Values of the parameter at which two solutions meet and vanish, ascending."""
        return np.sort([branch.parameter[i] for branch in self.branches for i in branch.folds])

    def at(self, value: float) -> list[tuple[int, float]]:
        """Where the branches cross a value of the parameter: (branch, position along its points, fractional)."""
        found = []
        for number, branch in enumerate(self.branches):
            past = branch.parameter - value
            for i in np.flatnonzero(past[:-1] * past[1:] <= 0):
                span = past[i + 1] - past[i]
                found.append((number, float(i - past[i] / span) if span else float(i)))
        return found


Family = Callable[[float], FrozenProblem]


@dataclass(frozen=True)
class _Place:
    """A point of a branch: the linearised equations there, the parameter, and the tangent (dtheta, dp) scaled."""

    lin: LinearisedMoments
    value: float
    slope: tuple[Array, Array]  # derivative of the residuals in the parameter
    tangent: Array  # (T + 1,), of unit length in scaled coordinates
    scale: Array  # (T + 1,) of theta and of the parameter


def trace(
    family: Family, start: StationaryPoint, value: float, limits: tuple[float, float], upward: bool, points: int = 400
) -> Branch:
    """Follow the branch through a solution at one value of the parameter in one direction, to the end of the range.

    Parameters
    ----------
    family : parameter to problem; all of one structure.
    start : solution of family(value).
    value, limits : the parameter where to begin, and the range to stay in.
    upward : whether the parameter grows at first.
    points : largest number of points.
    """
    walk = follow_curve(family, start, value, limits, upward, points, LARGEST)
    return _record(start, *walk)


def crossings(
    family: Family, start: StationaryPoint, value: float, limits: tuple[float, float], points: int = 60
) -> list[tuple[Array, Array]]:
    """Other solutions at the same value of the parameter to which the branch comes back: guesses, in the frame."""
    found = []
    for upward in (True, False):
        places, _, _ = follow_curve(family, start, value, limits, upward, points, 4 * LARGEST)
        for one, other in pairwise(places[1:]):
            if (one.value - value) * (other.value - value) <= 0 and one.value != other.value:
                part = (value - one.value) / (other.value - one.value)
                mean, covariance = _between(one.lin.at, other.lin.at)
                found.append((one.lin.at.mean + part * mean, one.lin.at.covariance + part * covariance))
    return found


def follow_curve(
    family: Family,
    start: StationaryPoint,
    value: float,
    limits: tuple[float, float],
    upward: bool,
    points: int,
    largest: float,
) -> tuple[list[_Place], tuple[int, ...], str]:
    """Points of the curve, the indices of its folds, and why it ends."""
    view = start.frame
    curve = _Curve(lambda p: family(p).transformed(view.left, view.right, view.offset), limits)
    place = curve.begin(start.evaluation, value, upward)
    places, folds = [place], []
    step = 0.25 * largest
    while len(places) < points:
        following, iterations = curve.forward(place, step)
        if following is None:
            step /= 4
            if step < SMALLEST:
                return places, tuple(folds), "no further solution near by"
            continue
        if place.tangent[-1] * following.tangent[-1] < 0:
            folds.append(len(places))
            places.append(curve.fold(place, following, step))
        if not limits[0] <= following.value <= limits[1]:
            last = curve.stop(places[-1], following, limits)
            return places + ([] if last is None else [last]), tuple(folds), "the end of the range"
        places.append(following)
        if len(places) > 4 and curve.closed(places[0], place, following):
            return places, tuple(folds), "a closed curve"
        place = following
        step = min(step * (1.6 if iterations <= 3 else 1.0), largest)
    return places, tuple(folds), "the number of points"


@dataclass(frozen=True)
class _Curve:
    """The moment equations with the parameter as one more unknown."""

    problem: Family
    limits: tuple[float, float]

    @property
    def width(self) -> float:
        return self.limits[1] - self.limits[0]

    def slope(self, at: Evaluation, value: float) -> tuple[Array, Array]:
        """Derivative of the residuals in the parameter, by central differences, one-sided at the ends of the range."""
        h = 1e-6 * self.width
        ends = min(value + h, max(self.limits[1], value)), max(value - h, min(self.limits[0], value))
        one, other = (evaluate(self.problem(end), at.mean, at.covariance) for end in ends)
        return (one.r - other.r) / (ends[0] - ends[1]), (one.R - other.R) / (ends[0] - ends[1])

    def begin(self, at: Evaluation, value: float, upward: bool) -> _Place:
        """The first point, with the tangent in the direction asked for."""
        at = evaluate(self.problem(value), at.mean, at.covariance)
        scale = self.scale(at)
        along = np.zeros(len(scale))
        along[-1] = 1.0 if upward else -1.0
        return self.place(at, value, along, scale)

    def scale(self, at: Evaluation) -> Array:
        """What counts as much as the parameter's range: the arguments' standard deviations and variances."""
        p = at.problem
        K = len(p.C)
        sigma = np.sqrt(np.maximum(at.theta[p.variances], 1e-300)) if K else np.zeros(0)
        means = np.maximum(sigma, np.abs(at.theta[:K]))
        return np.concatenate([means, sigma[p.pairs[0]] * sigma[p.pairs[1]], [self.width]])

    def place(self, at: Evaluation, value: float, along: Array, scale: Array) -> _Place:
        """A point with its own tangent, on the side of the one given."""
        lin, slope = LinearisedMoments(at), self.slope(at, value)
        zero = np.zeros_like(at.mean), np.zeros_like(at.covariance)
        row = along / scale
        _, _, dp, dtheta = lin.bordered(*zero, slope, row[:-1], row[-1], 1.0)
        tangent = np.append(dtheta, dp) / scale
        return _Place(lin, value, slope, tangent / np.linalg.norm(tangent), scale)

    def forward(self, place: _Place, step: float) -> tuple[_Place | None, int]:
        """The point one step along the curve, and the iterations it took; None if there is none to be found."""
        at, value, lin = place.lin.at, place.value, place.lin
        row = place.tangent / place.scale
        # predictor: the first iteration, whose right-hand side asks for the whole step
        ahead = step
        for iteration in range(1, 9):
            try:
                dmu, dP, dp, _ = lin.bordered(at.r, at.R, place.slope, row[:-1], row[-1], ahead)
            except SolverError:
                return None, iteration
            value = value + dp
            # beyond the range only as far as the last step needs
            if not self.limits[0] - self.width <= value <= self.limits[1] + self.width or not np.isfinite(dP).all():
                return None, iteration
            try:
                at = evaluate(self.problem(value), at.mean + dmu, at.covariance + dP)
            except (CadetError, ValueError):  # the family ends here
                return None, iteration
            if not at.finite:
                return None, iteration
            size = max(relative_size(at, (dmu, dP)), abs(dp) / self.width)
            if iteration == 1 and size > 1.0:
                return None, iteration
            if at.residual < RESIDUAL and size < STEP:
                return self._accepted(place, at, value, step), iteration
            ahead = step - float(row @ np.append(at.theta - place.lin.at.theta, value - place.value))
            lin = LinearisedMoments(at)
        return None, 9

    def _accepted(self, place: _Place, at: Evaluation, value: float, step: float) -> _Place | None:
        """The point, unless its covariance is no covariance or the curve bends too much for the step."""
        if np.linalg.eigvalsh(at.covariance)[0] < -1e-9 * np.trace(at.covariance):
            return None
        scale = self.scale(at)
        following = self.place(at, value, place.tangent * place.scale / scale, scale)
        bend = float(following.tangent @ place.tangent)
        return following if bend > 0.8 or step < 1e-4 else None

    def fold(self, before: _Place, after: _Place, step: float) -> _Place:
        """The point between two at which the tangent has no part along the parameter."""
        low, high, best = 0.0, step, after
        f_low, f_high = before.tangent[-1], after.tangent[-1]
        for _ in range(25):
            middle = (low * f_high - high * f_low) / (f_high - f_low)
            middle = min(max(middle, low + 0.05 * (high - low)), high - 0.05 * (high - low))
            found, _ = self.forward(before, middle)
            if found is None:
                break
            best = found
            if abs(found.tangent[-1]) < 1e-8 or high - low < 1e-10 * step:
                break
            if found.tangent[-1] * f_low < 0:
                high, f_high = middle, found.tangent[-1]
            else:
                low, f_low = middle, found.tangent[-1]
        return best

    def stop(self, before: _Place, after: _Place, limits: tuple[float, float]) -> _Place | None:
        """The point at which the curve leaves the range."""
        end = limits[1] if after.value > limits[1] else limits[0]
        if before.value == end:
            return None
        part = (end - before.value) / (after.value - before.value)
        one, other = before.lin.at, after.lin.at
        guess = (
            one.mean + part * (other.mean - one.mean),
            one.covariance + part * (other.covariance - one.covariance),
        )
        found = newton(self.problem(end), guess)
        if not found.converged or relative_size(other, _between(found.best, other)) > 2 * relative_size(
            other, _between(one, other)
        ):
            return None
        return self.place(found.best, end, after.tangent, after.scale)

    def closed(self, first: _Place, before: _Place, now: _Place) -> bool:
        """Whether the curve has come back to where it began."""
        scale = now.scale
        gap = (_coordinates(now) - _coordinates(first)) / scale
        step = (_coordinates(now) - _coordinates(before)) / scale
        return bool(np.linalg.norm(gap) < np.linalg.norm(step) and gap @ step > 0)


def _coordinates(place: _Place) -> Array:
    return np.append(place.lin.at.theta, place.value)


def _between(one: Evaluation, other: Evaluation) -> tuple[Array, Array]:
    return other.mean - one.mean, other.covariance - one.covariance


def _record(start: StationaryPoint, places: Sequence[_Place], folds: tuple[int, ...], end: str) -> Branch:
    judged = [stability(place.lin) for place in places]
    lifted = [start.frame.lift(place.lin.at.mean, place.lin.at.covariance) for place in places]
    mean, covariance = np.array([m for m, _ in lifted]), np.array([P for _, P in lifted])
    mean[:, start.drifting] = np.nan
    covariance[:, start.drifting, :] = covariance[:, :, start.drifting] = np.nan
    return Branch(
        parameter=np.array([place.value for place in places]),
        mean=mean,
        covariance=covariance,
        stable=np.array([each.stable for each in judged]),
        rightmost=np.array([each.rightmost for each in judged]),
        residual=np.array([place.lin.at.residual for place in places]),
        folds=folds,
        end=end,
    )


def branches(
    family: Family,
    limits: tuple[float, float],
    starts: Iterable[tuple[float, StationaryPoint]],
    parameter: str = "",
) -> Branches:
    """Follow every solution given, in both directions, and keep each curve once.

    Parameters
    ----------
    family : parameter to problem.
    limits : range of the parameter.
    starts : solutions to begin with and the values of the parameter they belong to: all that are known at both ends of
        the range and in its middle are a good choice (`stationary_points`).
    parameter : its name.
    """
    found: list[Branch] = []
    states: tuple[str, ...] = ()
    for value, point in starts:
        states = point.frame.states
        if any(_passes(branch, value, point) for branch in found):
            continue
        halves = [trace(family, point, value, limits, upward) for upward in (False, True)]
        found.append(halves[0] if halves[0].end == "a closed curve" else _joined(*halves))
    return Branches(parameter, limits, tuple(found), states)


def _joined(down: Branch, up: Branch) -> Branch:
    """Two halves that begin at one point, as one branch from the far end of the first to that of the second."""

    def join(name: str) -> Array:
        return np.concatenate([getattr(down, name)[:0:-1], getattr(up, name)])

    turn = len(down) - 1
    folds = (*sorted(turn - i for i in down.folds), *(turn + i for i in up.folds))
    names = ("parameter", "mean", "covariance", "stable", "rightmost", "residual")
    return Branch(**{name: join(name) for name in names}, folds=folds, end=f"{down.end}; {up.end}")


def _passes(branch: Branch, value: float, point: StationaryPoint) -> bool:
    """Whether a branch goes through a solution: between two of its points, close to the line that joins them."""
    stay = ~point.drifting
    mean, P = point.mean[stay], point.covariance[np.ix_(stay, stay)]
    sigma = np.sqrt(np.maximum(np.diag(P), 1e-300))
    past = branch.parameter - value
    for i in np.flatnonzero(past[:-1] * past[1:] <= 0):
        span = past[i + 1] - past[i]
        part = -past[i] / span if span else 0.0
        means, covariances = branch.mean[:, stay], branch.covariance[:, stay][:, :, stay]
        change = np.abs(means[i + 1] - means[i]), np.abs(covariances[i + 1] - covariances[i])
        off = (
            np.abs(means[i] + part * (means[i + 1] - means[i]) - mean),
            np.abs(covariances[i] + part * (covariances[i + 1] - covariances[i]) - P),
        )
        room = 0.2 * np.max(change[0] / sigma) + 1e-6, 0.2 * np.max(change[1] / np.outer(sigma, sigma)) + 1e-6
        if np.max(off[0] / sigma) < room[0] and np.max(off[1] / np.outer(sigma, sigma)) < room[1]:
            return True
    return False
