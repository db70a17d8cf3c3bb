"""Curves of stationary solutions over the range of one parameter: where they are stable, where they fold.

See `continuation` for how one is followed, `search` for where the first points come from.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.continuation import Family, Place, Walk, walk
from cadet_sym.solve.rungs import newton, relative_size
from cadet_sym.solve.search import SAME, stationary_points
from cadet_sym.solve.stability import stability
from cadet_sym.solve.stationary import StationaryPoint

__all__ = ["Branch", "Branches", "find_branches", "follow_branches", "stable_pieces"]

Array = np.ndarray

POINTS = 400  # of one half of a branch, at most
LARGEST = 0.04  # a step, of the parameter's range: a branch across it has at least 25 points


@dataclass(frozen=True)
class Branch:
    """One curve of stationary solutions, in the order in which it was followed. k points, n states."""

    parameter: Array  # (k,)
    mean: Array  # (k, n); NaN for states that drift
    covariance: Array  # (k, n, n); NaN in the rows and columns of states that drift
    stable: Array  # (k,) bool, as fixed points of the moment equations
    rightmost: Array  # (k,) complex: eigenvalue of the moment equations with the largest real part; NaN for many states
    residual: Array  # (k,)
    folds: tuple[int, ...]  # indices of the points at which the branch turns back in the parameter
    end: str  # why it ends where it does
    drift: Array = field(repr=False)  # (n, q) orthonormal: directions without stationary moments
    lifted: tuple[Array, Array] = field(repr=False)  # mean and covariance for forms that contain no drift: no NaN

    def __len__(self) -> int:
        return len(self.parameter)

    def pieces(self) -> list[tuple[slice, bool]]:
        """Stretches of equal stability, sharing their end points: (points, stable), to be drawn solid or dashed."""
        return stable_pieces(self.stable)


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


def stable_pieces(stable: Array) -> list[tuple[slice, bool]]:
    """Stretches of equal stability (k,) along a curve, sharing their end points: (points, stable)."""
    changes = np.flatnonzero(stable[1:] != stable[:-1]) + 1
    bounds = [0, *changes, len(stable)]
    return [
        (slice(int(first), int(min(last + 1, len(stable)))), bool(stable[first])) for first, last in pairwise(bounds)
    ]


def find_branches(
    family: Family, limits: tuple[float, float], parameter: str = "", *, start: tuple[Array, Array] | None = None
) -> Branches:
    """Find the stationary solutions at both ends and in the middle of a range, and follow each over all of it.

    Parameters
    ----------
    family : value of the parameter to problem; all of one structure.
    limits : lowest and highest value.
    parameter : its name.
    start : as for `stationary_point`.

    Raises
    ------
    SolverError
        If there is no solution at any of the three values.
    """
    points: list[tuple[float, StationaryPoint]] = []
    failures: list[SolverError] = []
    for value in (limits[0], limits[1], 0.5 * (limits[0] + limits[1])):
        try:
            found = stationary_points(family(value), start, starts=12, louder=False)
            points += [(value, point) for point in found]
        except SolverError as error:
            failures.append(error)
    if not points:
        raise failures[0]
    return follow_branches(family, limits, points, parameter)


def follow_branches(
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
    found: list[tuple[StationaryPoint, Walk]] = []
    for value, point in starts:
        if any(_passes(family, value, origin, path, point) for origin, path in found):
            continue
        view, at = point.frame, point.evaluation
        if not all(view.follows(family(end)) for end in limits):
            raise SolverError(
                f"what drifts changes its direction with {parameter or 'the parameter'}, so that its solutions cannot be "
                "followed: declare the model in closures and deflections, or solve for single values."
            )
        down, up = (walk(family, view, at, value, limits, side, POINTS, LARGEST) for side in (False, True))
        found.append((point, down if down.end == "a closed curve" else _joined(down, up)))
    states = found[0][0].frame.states if found else ()
    return Branches(parameter, limits, tuple(_record(*each) for each in found), states)


def _joined(down: Walk, up: Walk) -> Walk:
    """Two halves that begin at one point, as one walk from the far end of the first to that of the second."""
    turn = len(down.places) - 1
    return Walk(
        places=[*down.places[:0:-1], *up.places],
        folds=(*sorted(turn - i for i in down.folds), *(turn + i for i in up.folds)),
        end=f"{down.end}; {up.end}",
    )


def _passes(family: Family, value: float, origin: StationaryPoint, path: Walk, point: StationaryPoint) -> bool:
    """Whether a curve goes through a solution: between two of its places Newton's method finds the same one."""
    view = origin.frame
    target = view.lower(point.mean, point.covariance)
    for one, other in pairwise(path.places):
        if (one.value - value) * (other.value - value) > 0 or one.value == other.value:
            continue
        part = (value - one.value) / (other.value - one.value)
        ends = one.lin.at, other.lin.at
        mean = ends[0].mean + part * (ends[1].mean - ends[0].mean)
        covariance = ends[0].covariance + part * (ends[1].covariance - ends[0].covariance)
        there = newton(family(value).transformed(view.left, view.right, view.offset), (mean, covariance), limit=10)
        gap = target[0] - there.best.mean, target[1] - there.best.covariance
        if there.converged and relative_size(there.best, gap) < SAME:
            return True
    return False


def _record(start: StationaryPoint, path: Walk) -> Branch:
    places: Sequence[Place] = path.places
    judged = [stability(place.lin) for place in places]
    lifted = [start.frame.lift(place.lin.at) for place in places]
    means, covariances = np.array([m for m, _ in lifted]), np.array([P for _, P in lifted])
    mean, covariance = means.copy(), covariances.copy()
    mean[:, start.drifting] = np.nan
    covariance[:, start.drifting, :] = covariance[:, :, start.drifting] = np.nan
    return Branch(
        parameter=np.array([place.value for place in places]),
        mean=mean,
        covariance=covariance,
        stable=np.array([each.stable for each in judged]),
        rightmost=np.array([each.moments[0] if len(each.moments) else complex("nan") for each in judged]),
        residual=np.array([place.lin.at.residual for place in places]),
        folds=path.folds,
        end=path.end,
        drift=start.drift,
        lifted=(means, covariances),
    )
