"""Three ways from a start to a stationary point, each surer and slower than the one before.

`newton`: exact Newton steps on mean and covariance, damped by the natural monotonicity test (Deuflhard 2004, section
3.3), which does not depend on the units of the residuals. `follow`: pseudo-transient continuation (Kelley & Keyes,
SIAM J. Numer. Anal. 35, 508, 1998), implicit steps of length h along the moment equations, (1/h - J) dy = rate, with h
growing while the step predicts the new rate well; with a tight tolerance on that prediction it is a march in time.
Neither decides what is a solution: see `stationary`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import Evaluation, FrozenProblem, evaluate
from cadet_sym.solve.linearised import LinearisedMoments

__all__ = ["Attempt", "follow", "newton", "polish", "relative_size"]

Array = np.ndarray

RESIDUAL = 1e-10  # of the equations over the size of their own terms
RUNAWAY = 1e30  # variances larger than this, in the coordinates of a frame, do not come back
ROUNDING = 1e-14  # a residual that further steps cannot lower
CHORD = 0.2  # relative size of a Newton step after which its derivatives serve for further ones
STEP = 1e-6  # of the last Newton step over the standard deviations: its square is the error left


@dataclass(frozen=True)
class Attempt:
    """Where one run of a rung ended."""

    rung: str
    converged: bool
    iterations: int
    best: Evaluation  # the point with the smallest residual; the solution if converged
    last: Evaluation  # the point reached
    step: float = np.inf  # relative size of the last Newton step
    reason: str = ""  # why it stopped, if it did not converge

    def __str__(self) -> str:
        if self.converged:  # the residual of the solution is that after polishing, and reported there
            return f"{self.rung}: converged after {self.iterations} iterations"
        return f"{self.rung}: {self.reason} after {self.iterations} iterations, residual {self.best.residual:.1e}"


@np.errstate(all="ignore")  # what overflows is seen in the evaluation, and refused
def newton(
    problem: FrozenProblem,
    start: tuple[Array, Array],
    limit: int = 30,
    name: str = "Newton",
    close: float = 0.0,
) -> Attempt:
    """Damped exact Newton iteration on the mean (n,) and the covariance (n, n).

    Parameters
    ----------
    problem : the equations.
    start : mean and covariance to begin with.
    limit : largest number of steps.
    name : of the attempt.
    close : relative size of a step at which to stop already, for one who goes on with `polish`.
    """
    at = best = evaluate(problem, *start)
    for iteration in range(1, limit + 1):
        if not at.finite:
            return Attempt(name, False, iteration - 1, best, at, reason="not finite")
        try:
            lin = LinearisedMoments(at)
            found, size = _damped_step(lin)
            if found is not None and size < CHORD:
                found, size = _chord_steps(lin, found, size, close)
        except SolverError as error:
            return Attempt(name, False, iteration, best, at, reason=str(error))
        if found is None:
            return Attempt(name, False, iteration, best, at, reason="no step reduces the residual")
        at = found
        best = min(best, at, key=_residual)
        if size < close or (at.residual < RESIDUAL and size < STEP):
            return Attempt(name, True, iteration, at, at, size)
    return Attempt(name, False, limit, best, at, reason="no convergence")


def _chord_steps(lin: LinearisedMoments, at: Evaluation, size: float, close: float) -> tuple[Evaluation, float]:
    """Go on with the old derivatives while each step gains a digit: they cost a fraction of new ones."""
    for _ in range(3):
        if size < close or (at.residual < RESIDUAL and size < STEP):
            break
        step = lin.solve(at.r, at.R)
        if not _finite(step):
            break
        trial = evaluate(at.problem, at.mean + step[0], at.covariance + step[1])
        length = relative_size(at, step)
        if not trial.residual < 0.1 * at.residual or not length < 0.1 * size:
            break
        at, size = trial, length
    return at, size


def polish(lin: LinearisedMoments) -> tuple[Evaluation, float]:
    """One exact Newton step, and further ones with the same derivatives as far as they help; size of the last."""
    at, size = lin.at, np.inf
    for _ in range(5):
        step = lin.solve(at.r, at.R)
        length = relative_size(at, step)
        if not length < 0.5 * size:
            break
        trial = evaluate(at.problem, at.mean + step[0], at.covariance + step[1])
        size = length
        if not trial.residual < at.residual:
            break
        at = trial
        if at.residual < ROUNDING and size < STEP:
            break
    return at, size


def _damped_step(lin: LinearisedMoments) -> tuple[Evaluation | None, float]:
    """The evaluation after the longest acceptable part of Newton's step, and the step's relative size."""
    at = lin.at
    step = lin.step()
    if not _finite(step):
        return None, np.inf
    length = relative_size(at, step, step)
    if at.residual < RESIDUAL and length < STEP:
        return at, length
    fraction = 1.0
    while fraction > 1e-2:
        trial = evaluate(at.problem, at.mean + fraction * step[0], at.covariance + fraction * step[1])
        if trial.finite and (
            trial.residual < max(0.1 * at.residual, 1e-13)
            or relative_size(at, lin.solve(trial.r, trial.R), step) <= (1 - fraction / 4) * length
        ):
            return trial, fraction * relative_size(trial, step)
        fraction /= 2
    return None, np.inf


@np.errstate(all="ignore")
def follow(
    problem: FrozenProblem,
    start: tuple[Array, Array],
    limit: int = 100,
    tolerance: float = 0.5,
    name: str = "pseudo-transient",
) -> Attempt:
    """Implicit steps of growing length along the moment equations, finished by Newton's method.

    Parameters
    ----------
    problem : the equations.
    start : mean (n,) and covariance (n, n).
    limit : largest number of steps, refused ones included.
    tolerance : largest difference between the rate a step predicts and the one found, over the size of its terms.
    """
    at = best = evaluate(problem, *start)
    if not at.finite:
        return Attempt(name, False, 0, best, at, reason="not finite")
    lin, polished_at = LinearisedMoments(at), np.inf
    fastest = np.abs(lin.form.eigenvalues).max() + 1e-300
    h, bound = 1.0 / fastest, RUNAWAY * (1.0 + float(np.trace(at.covariance)))
    for iteration in range(1, limit + 1):
        trial, difference = _implicit_step(lin, h)
        # where the rates are small, a step may not change them beyond their own size: it would jump over a bottleneck
        difference /= min(1.0, 10 * at.residual)
        if trial is None or difference > tolerance:
            h /= 4
            if h * fastest < 1e-7:
                return Attempt(name, False, iteration, best, at, reason="no step is short enough")
            continue
        at, lin = trial, LinearisedMoments(trial)
        if np.trace(at.covariance) > bound:
            return Attempt(name, False, iteration, best, at, reason="the variances leave every bound")
        best = min(best, at, key=_residual)
        if at.residual < 1e-2 * polished_at and at.residual < 1e-4:
            # Close enough for Newton? Tried again only after the residual has fallen a hundredfold.
            polished_at = at.residual
            finish = newton(problem, (at.mean, at.covariance), limit=8)
            if finish.converged and relative_size(finish.best, _difference(at, finish.best)) < 0.5:
                return Attempt(name, True, iteration + finish.iterations, finish.best, finish.best, finish.step)
        fastest = max(np.abs(lin.form.eigenvalues).max(), 1e-12 * fastest)
        h = min(h * (4 if difference < tolerance / 5 else 2 if difference < tolerance / 2 else 1), 1e12 / fastest)
    return Attempt(name, False, limit, best, at, reason="no convergence")


def _implicit_step(lin: LinearisedMoments, h: float) -> tuple[Evaluation | None, float]:
    """One linearly implicit Euler step of length h, and how far the rate there is from the one it predicts."""
    at = lin.at
    try:
        dmu, dP = lin.step(1.0 / h)
    except SolverError:
        return None, np.inf
    variances = np.diag(at.covariance + dP)
    if not _finite((dmu, dP)) or variances.min() < -ROUNDING * variances.max():
        return None, np.inf
    trial = evaluate(at.problem, at.mean + dmu, at.covariance + dP)
    if not trial.finite:
        return None, np.inf
    first, second = trial.terms
    wrong = np.max(np.abs(trial.r - dmu / h) / first), np.max(np.abs(trial.R - dP / h) / second)
    return trial, float(max(wrong))


def relative_size(at: Evaluation, step: tuple[Array, Array], ahead: tuple[Array, Array] | None = None) -> float:
    """Size of a step (dmu, dP) over the standard deviations at a point, or ahead of it where those are larger."""
    scale, means = at.scale, at.mean_scale
    if ahead is not None:
        sigma = np.sqrt(np.maximum(np.diag(at.covariance + ahead[1]), 0.0))
        scale = np.maximum(scale, sigma)
        means = np.maximum(np.maximum(means, sigma), 1e-4 * np.abs(at.mean + ahead[0]).max())
    tiny = np.finfo(float).tiny ** 0.25
    scale, means = scale + tiny, means + tiny
    return float(max(np.max(np.abs(step[0]) / means), np.max(np.abs(step[1]) / scale / scale[:, None])))


def _difference(one: Evaluation, other: Evaluation) -> tuple[Array, Array]:
    return other.mean - one.mean, other.covariance - one.covariance


def _finite(step: tuple[Array, Array]) -> bool:
    return bool(np.isfinite(step[0]).all() and np.isfinite(step[1]).all())


def _residual(at: Evaluation) -> float:
    return at.residual
