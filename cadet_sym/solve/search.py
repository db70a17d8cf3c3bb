"""All stationary solutions that can be found: many starts, continuation, each answer judged, equal ones merged.

There is no method that finds all solutions for certain. Starts come from the ladder of `stationary`, from the
equilibria of the drift without noise, from random means and covariances, and from mirror images of what is found; then
each solution is followed while the noise grows and fades: where that curve folds it comes back to the noise asked for
at another solution, which is how unstable ones are found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import SolverError
from cadet_sym.solve.continuation import crossings
from cadet_sym.solve.drift import Frame
from cadet_sym.solve.frozen import Evaluation, FrozenProblem, WheelTrack, evaluate
from cadet_sym.solve.rungs import Attempt, newton
from cadet_sym.solve.stationary import StationaryPoint, accept, ladder, scattered, stationary_point

__all__ = ["stationary_points"]

Array = npt.NDArray[np.float64]

SAME = 1e-6
"""Two solutions whose means and covariances differ by less, relative to the standard deviations, are one."""

DECADES = (-2.0, 1.0)
"""Powers of ten over which the noise fades and grows."""

MARCHES = 5
"""Random starts from which the moments are followed in time as well: they lead to stable solutions, found by then."""

PATIENCE = 15
"""Attempts from random starts in a row that find nothing new, after which there are no further ones."""

FOLLOWED = 40
"""States up to which solutions are followed in the noise: a hundred solutions for each that is found."""


def stationary_points(
    problem: FrozenProblem, start: tuple[Array, Array] | None = None, *, starts: int = 30, louder: bool = True
) -> tuple[StationaryPoint, ...]:
    """Look for all stationary solutions; stable ones first, then by the size of their covariance.

    Parameters
    ----------
    problem : the moment equations with everything else fixed.
    start : as for `stationary_point`.
    starts : random starts, and as many equilibria to look for; the same each time.
    louder : whether to follow what is found while the noise grows and fades.

    Raises
    ------
    SolverError
        If none was found.
    """
    first = stationary_point(problem, start)
    if not len(problem.C):  # a linear system has one
        return (first,)
    view = first.frame
    found = _Found(view, [first])
    for attempt in _attempts(view, start, starts):
        found.add(attempt)
    quiet = 0
    for attempt in scattered(view, starts, marches=MARCHES):
        known = len(found.points)
        found.add(attempt)
        quiet = quiet + 1 if len(found.points) == known else 0
        if quiet == PATIENCE:
            break
    covered: set[int] = set()  # solutions on a curve that has been followed
    place = 0
    while place < len(found.points):
        point = found.points[place]
        mirror = found.add(newton(view.problem, _mirrored(point.evaluation), name="mirrored"))
        for other in found.points[:place]:
            for guess in _between_two(point.evaluation, other.evaluation):
                found.add(newton(view.problem, guess, name="between two solutions"))
        if louder and place not in covered and problem.n <= FOLLOWED:
            guesses = _followed(problem, point)
            if mirror >= 0 and mirror != place and _are_mirrored(point.evaluation, found.points[mirror].evaluation):
                covered.add(mirror)  # the curve through a mirror image is the mirror image of the curve
                guesses += [(-mean, covariance) for mean, covariance in guesses]
            covered |= {found.add(newton(view.problem, guess, name="followed in the noise")) for guess in guesses}
        place += 1
    return tuple(sorted(found.points, key=lambda p: (not p.stable, p is not first, float(np.trace(p.covariance)))))


def _mirrored(at: Evaluation) -> tuple[Array, Array]:
    return -at.mean, at.covariance


def _are_mirrored(one: Evaluation, other: Evaluation) -> bool:
    sigma = np.maximum(one.scale, other.scale) + 1e-300
    return bool(
        np.max(np.abs(one.mean + other.mean) / sigma, initial=0.0) < SAME
        and np.max(np.abs(one.covariance - other.covariance) / np.outer(sigma, sigma), initial=0.0) < SAME
    )


def _between_two(one: Evaluation, other: Evaluation) -> Iterator[tuple[Array, Array]]:
    """States that are spread over two solutions: what separates two wells is one of these, as a rule."""
    half = 0.5 * (one.mean - other.mean)
    for share in (0.3, 1.0):
        yield (
            0.5 * (one.mean + other.mean),
            0.5 * (one.covariance + other.covariance) + share * np.outer(half, half),
        )


class _Found:
    """The solutions found so far, each once."""

    def __init__(self, view: Frame, points: list[StationaryPoint]) -> None:
        self.view, self.points = view, points

    def add(self, attempt: Attempt) -> int:
        """Keep the solution of an attempt if it is a new one; its place among the solutions, -1 if it is none."""
        if not attempt.converged:
            return -1
        for place, known in enumerate(self.points):
            if _same(attempt.best, known.evaluation):
                return place
        point, _ = accept(self.view, attempt)
        if point is None:
            return -1
        for place, known in enumerate(self.points):  # a start that stopped close to one
            if _same(point.evaluation, known.evaluation):
                return place
        self.points.append(point)
        return len(self.points) - 1


def _attempts(view: Frame, start: tuple[Array, Array] | None, starts: int) -> Iterator[Attempt]:
    for attempt in ladder(view, start):
        if attempt.rung.startswith("march"):
            break  # the ladder's last resort: something is found already
        yield attempt
    yield from _from_equilibria(view, starts)


def _from_equilibria(view: Frame, starts: int) -> Iterator[Attempt]:
    """Newton from the equilibria of the drift, with little noise and with what the noise builds up in a short run."""
    p = view.problem
    rng = np.random.default_rng(1)
    sigma = np.sqrt(np.maximum(np.diag(view.spread), 0.0))
    known: list[Array] = []
    quiet = 0
    for _ in range(starts):
        quiet += 1
        if quiet > PATIENCE:
            break
        mean = _equilibrium(p, sigma * rng.standard_normal(p.n) * 10.0 ** rng.uniform(-1, 3), 1e-8 * view.spread)
        if mean is None or any(np.max(np.abs(mean - other) / (sigma + np.abs(mean))) < 1e-4 for other in known):
            continue
        known.append(mean)
        quiet = 0
        for factor in (1e-4, 0.1, 1.0):
            yield newton(p, (mean, factor * view.spread), name="Newton from an equilibrium")


def _equilibrium(p: FrozenProblem, mean: Array, covariance: Array) -> Array | None:
    """Zero of the mean's rate at a small fixed covariance, by damped Newton steps."""
    at = evaluate(p, mean, covariance)
    for _ in range(40):
        size = np.linalg.norm(at.r)
        if not at.finite:
            return None
        if size <= 1e-9 * np.linalg.norm(at.terms[0]):
            return at.mean
        try:
            step = -np.linalg.solve(at.N, at.r)
        except np.linalg.LinAlgError:
            return None
        for fraction in (1.0, 0.5, 0.1, 0.01):
            trial = evaluate(p, at.mean + fraction * step, covariance)
            if trial.finite and np.linalg.norm(trial.r) < (1 - 0.1 * fraction) * size:
                break
        else:
            return None
        at = trial
    return None


def _followed(problem: FrozenProblem, point: StationaryPoint) -> list[tuple[Array, Array]]:
    """Where the branch through a solution comes back to, as the noise fades and grows."""

    def family(decades: float) -> FrozenProblem:
        factor = 10.0**decades
        tracks = tuple(_louder(track, factor) for track in problem.tracks)
        return replace(problem, D=factor * problem.D, tracks=tracks)

    try:
        return crossings(family, point.frame, point.evaluation, 0.0, DECADES)
    except SolverError:
        return []


def _louder(track: WheelTrack, factor: float) -> WheelTrack:
    return replace(track, intensity=factor * track.intensity)


def _same(one: Evaluation, other: Evaluation) -> bool:
    """Whether two solutions are one, up to what the iterations leave and to a period of the whole system."""
    sigma = np.maximum(one.scale, other.scale) + 1e-300
    if np.max(np.abs(one.covariance - other.covariance) / np.outer(sigma, sigma), initial=0.0) > SAME:
        return False
    shift = one.mean - other.mean
    return bool(np.max(np.abs(shift) / sigma, initial=0.0) < SAME) or _is_period(one, shift)


def _is_period(at: Evaluation, shift: Array) -> bool:
    """Whether the equations are the same a shift of the mean away, wherever they are looked at."""
    p = at.problem
    if np.max(np.abs(p.A @ shift), initial=0.0) > 1e-6 * np.max(np.abs(p.A) @ np.abs(shift), initial=1e-300):
        return False
    rng = np.random.default_rng(2)
    for _ in range(3):
        mean = at.mean + at.scale * rng.standard_normal(p.n)
        covariance = rng.uniform(0.1, 1.0) * at.covariance
        here, there = evaluate(p, mean, covariance), evaluate(p, mean + shift, covariance)
        if not (here.finite and there.finite):
            return False
        first, second = here.terms
        if np.max(np.abs(here.r - there.r) / first) > 1e-6 or np.max(np.abs(here.R - there.R) / second) > 1e-6:
            return False
    return True
