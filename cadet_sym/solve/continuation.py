"""Follow a curve of stationary solutions in a parameter, round its folds, by pseudo-arclength continuation.

The curve is measured in what the nonlinear elements see, theta, and in the parameter: everything else follows from
these. So each step solves the structured equations of `linearised` with one more row, the tangent's, and is regular
at a fold, where the solutions turn back (Keller 1977; Doedel, Keller & Kernevez, Int. J. Bifurc. Chaos 1, 493, 1991).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cadet_sym.errors import CadetError, SolverError
from cadet_sym.solve.drift import Frame
from cadet_sym.solve.frozen import Evaluation, FrozenProblem, evaluate
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.rungs import RESIDUAL, STEP, newton, relative_size

__all__ = ["Family", "Place", "Walk", "crossings", "walk"]

Array = np.ndarray

SMALLEST = 1e-7  # a step, of the parameter's range
NEAR = 1e-2  # residual and size of a Newton step after which a rough place is near enough to the curve


Family = Callable[[float], FrozenProblem]


@dataclass(frozen=True)
class Place:
    """A point of a curve: the linearised equations there, the parameter, and the tangent (dtheta, dp) scaled."""

    lin: LinearisedMoments
    value: float
    slope: tuple[Array, Array]  # derivative of the residuals in the parameter
    tangent: Array  # (T + 1,), of unit length in scaled coordinates
    scale: Array  # (T + 1,) of theta and of the parameter


@dataclass(frozen=True)
class Walk:
    """A curve followed in one direction."""

    places: list[Place]
    folds: tuple[int, ...]  # indices of the places at which it turns back in the parameter
    end: str  # why it ends where it does


def crossings(
    family: Family, view: Frame, start: Evaluation, value: float, limits: tuple[float, float], points: int = 60
) -> list[tuple[Array, Array]]:
    """Other solutions at the same value of the parameter to which the curve comes back: guesses, in the frame."""
    found = []
    for upward in (True, False):
        path = walk(family, view, start, value, limits, upward, points, largest=0.16, rough=True)
        for one, other in pairwise(path.places[1:]):
            if (one.value - value) * (other.value - value) <= 0 and one.value != other.value:
                part = (value - one.value) / (other.value - one.value)
                mean, covariance = _between(one.lin.at, other.lin.at)
                found.append((one.lin.at.mean + part * mean, one.lin.at.covariance + part * covariance))
    return found


def walk(
    family: Family,
    view: Frame,
    start: Evaluation,
    value: float,
    limits: tuple[float, float],
    upward: bool,
    points: int,
    largest: float,
    rough: bool = False,
) -> Walk:
    """Follow the curve through a solution in one direction, to the end of the range.

    Parameters
    ----------
    family : parameter to problem; all of one structure.
    view : coordinates in which to follow it.
    start : solution of family(value), in these coordinates.
    value, limits : the parameter where to begin, and the range to stay in.
    upward : whether the parameter grows at first.
    points : largest number of points.
    largest : a step, of the parameter's range.
    rough : whether places near the curve will do, for one who only wants to know where it leads.
    """
    curve = _Curve(lambda p: family(p).transformed(view.left, view.right, view.offset), limits, rough)
    place = curve.begin(start, value, upward)
    places, folds = [place], []
    step = 0.25 * largest
    while len(places) < points:
        following, iterations = curve.forward(place, step)
        if following is None:
            step /= 4
            if step < SMALLEST:
                return Walk(places, tuple(folds), "no further solution near by")
            continue
        if place.tangent[-1] * following.tangent[-1] < 0:
            folds.append(len(places))
            if not rough:
                places.append(curve.fold(place, following, step))
        if not limits[0] <= following.value <= limits[1]:
            last = curve.stop(places[-1], following, limits)
            return Walk(places + ([] if last is None else [last]), tuple(folds), "the end of the range")
        places.append(following)
        if len(places) > 4 and curve.closed(places[0], place, following):
            return Walk(places, tuple(folds), "a closed curve")
        place = following
        step = min(step * (1.6 if iterations <= 4 else 1.0 if iterations <= 6 else 0.6), largest)
    return Walk(places, tuple(folds), "the number of points")


@dataclass(frozen=True)
class _Curve:
    """The moment equations with the parameter as one more unknown."""

    problem: Family
    limits: tuple[float, float]
    rough: bool = False

    @property
    def width(self) -> float:
        return self.limits[1] - self.limits[0]

    def slope(self, at: Evaluation, value: float) -> tuple[Array, Array]:
        """Derivative of the residuals in the parameter, by central differences, one-sided at the ends of the range."""
        h = 1e-6 * self.width
        ends = min(value + h, max(self.limits[1], value)), max(value - h, min(self.limits[0], value))
        one, other = (evaluate(self.problem(end), at.mean, at.covariance) for end in ends)
        return (one.r - other.r) / (ends[0] - ends[1]), (one.R - other.R) / (ends[0] - ends[1])

    def begin(self, at: Evaluation, value: float, upward: bool) -> Place:
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

    def place(self, at: Evaluation, value: float, along: Array, scale: Array) -> Place:
        """A point with its own tangent, on the side of the one given."""
        lin, slope = LinearisedMoments(at), self.slope(at, value)
        zero = np.zeros_like(at.mean), np.zeros_like(at.covariance)
        row = along / scale
        _, _, dp, dtheta = lin.bordered(*zero, slope, row[:-1], row[-1], 1.0)
        tangent = np.append(dtheta, dp) / scale
        return Place(lin, value, slope, tangent / np.linalg.norm(tangent), scale)

    def forward(self, place: Place, step: float) -> tuple[Place | None, int]:
        """The point one step along the curve, and the iterations it took; None if there is none to be found."""
        at, value, lin, slope = place.lin.at, place.value, place.lin, place.slope
        row = place.tangent / place.scale
        # predictor: the first iteration, whose right-hand side asks for the whole step
        ahead = step
        for iteration in range(1, 9):
            try:
                dmu, dP, dp, _ = lin.bordered(at.r, at.R, slope, row[:-1], row[-1], ahead)
            except SolverError:
                return None, iteration
            value = value + dp
            # beyond the range only as far as the last step needs
            if not self.limits[0] - self.width <= value <= self.limits[1] + self.width or not np.isfinite(dP).all():
                return None, iteration
            try:
                at = evaluate(self.problem(value), at.mean + dmu, at.covariance + dP)
                if not at.finite:
                    return None, iteration
                size = max(relative_size(at, (dmu, dP)), abs(dp) / self.width)
                if iteration == 1 and size > 1.0:
                    return None, iteration
                if (at.residual < RESIDUAL and size < STEP) or (self.rough and at.residual < NEAR and size < NEAR):
                    return self._accepted(place, at, value, step), iteration
                slope = slope if self.rough else self.slope(at, value)
            except (CadetError, ValueError):  # the family ends here
                return None, iteration
            ahead = step - float(row @ np.append(at.theta - place.lin.at.theta, value - place.value))
            lin = LinearisedMoments(at)
        return None, 9

    def _accepted(self, place: Place, at: Evaluation, value: float, step: float) -> Place | None:
        """The point, unless its covariance is no covariance or the curve bends too much for the step."""
        if np.linalg.eigvalsh(at.covariance)[0] < -1e-9 * np.trace(at.covariance):
            return None
        scale = self.scale(at)
        following = self.place(at, value, place.tangent * place.scale / scale, scale)
        bend = float(following.tangent @ place.tangent)
        return following if bend > 0.8 or step < 1e-4 else None

    def fold(self, before: Place, after: Place, step: float) -> Place:
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

    def stop(self, before: Place, after: Place, limits: tuple[float, float]) -> Place | None:
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

    def closed(self, first: Place, before: Place, now: Place) -> bool:
        """Whether the curve has come back to where it began."""
        scale = now.scale
        gap = (_coordinates(now) - _coordinates(first)) / scale
        step = (_coordinates(now) - _coordinates(before)) / scale
        return bool(np.linalg.norm(gap) < np.linalg.norm(step) and gap @ step > 0)


def _coordinates(place: Place) -> Array:
    return np.append(place.lin.at.theta, place.value)


def _between(one: Evaluation, other: Evaluation) -> tuple[Array, Array]:
    return other.mean - one.mean, other.covariance - one.covariance
