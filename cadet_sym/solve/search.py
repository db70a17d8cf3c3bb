"""All stationary solutions that can be found: many starts, each answer judged, equal ones merged."""

from __future__ import annotations

from itertools import chain

import numpy as np
import numpy.typing as npt

from cadet_sym.solve.drift import frame
from cadet_sym.solve.frozen import FrozenProblem
from cadet_sym.solve.stationary import StationaryPoint, accept, ladder, scattered, stationary_point

__all__ = ["stationary_points"]

Array = npt.NDArray[np.float64]

SAME = 1e-6
"""Two solutions whose means and covariances differ by less, relative to the standard deviations, are one."""


def stationary_points(
    problem: FrozenProblem, start: tuple[Array, Array] | None = None, *, starts: int = 60
) -> tuple[StationaryPoint, ...]:
    """Look for all stationary solutions; stable ones first, then by the size of their covariance.

    Parameters
    ----------
    problem : the moment equations with everything else fixed.
    start : as for `stationary_point`.
    starts : random starts besides the ladder's own; the same each time.

    Raises
    ------
    SolverError
        If none was found.
    """
    first = stationary_point(problem, start)
    found = [first]
    if len(problem.C):  # a linear system has one
        view = frame(problem, None if start is None else start[0])
        for attempt in chain(ladder(view, start), scattered(view, starts)):
            point = accept(view, attempt, [attempt]) if attempt.converged else None
            if point is not None and not any(_same(point, other) for other in found):
                found.append(point)
    return tuple(sorted(found, key=lambda p: (not p.stable, p is not first, float(np.trace(p.covariance)))))


def _same(one: StationaryPoint, other: StationaryPoint) -> bool:
    """Whether two solutions are one, up to what the iterations leave."""
    sigma = np.sqrt(np.maximum(np.diag(one.covariance), np.diag(other.covariance)))
    sigma = np.maximum(sigma, 1e-12 * max(float(sigma.max(initial=0.0)), 1e-300))
    means = np.abs(one.mean - other.mean) / sigma
    covariances = np.abs(one.covariance - other.covariance) / np.outer(sigma, sigma)
    return bool(means.max(initial=0.0) < SAME and covariances.max(initial=0.0) < SAME)
