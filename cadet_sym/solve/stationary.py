"""Stationary moments of a frozen problem: found from nothing, judged, and never given out when they are wrong.

The ladder of `rungs` is climbed until a stable solution is found; an unstable one is kept in case there is no other.
What a rung calls converged is a solution only if the moments are finite, the residual is small against the equations'
own terms, a further Newton step would change nothing (which tells a solution from a run-away, whose residual becomes
small too as its terms grow), and the covariance is positive semidefinite.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.drift import Frame, frame
from cadet_sym.solve.frozen import Evaluation, FrozenProblem
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.lyapunov import ModalForm
from cadet_sym.solve.rungs import RESIDUAL, STEP, Attempt, follow, newton, polish, relative_size
from cadet_sym.solve.stability import Stability, from_the_right, stability

__all__ = ["StationaryPoint", "accept", "stationary_point"]

Array = np.ndarray

CLOSE = 1e-3  # relative size of a Newton step after which the solution is near enough to be judged
EXACT = 40  # states up to which stability is judged at the very solution, and not a CLOSE step squared away
ROUNDING = 1e-6  # of the standard deviations: moments that rounding of the equations moves by more are refused
MARGINAL = 1e-11  # of the fastest rate: nearer to the imaginary axis is undamped
HARMLESS = 1e6  # condition up to which rounding needs no closer look
NEGATIVE = 1e-10  # of the largest: a smaller negative eigenvalue of the correlations is rounding


@dataclass(frozen=True)
class StationaryPoint:
    """One fixed point of the moment equations, accepted and judged."""

    mean: Array  # (n,)
    covariance: Array  # (n, n); for forms of the states that do not contain a drifting direction
    drift: Array  # (n, q) orthonormal: directions without stationary moments
    drifting: Array  # (n,) bool: states that have a part in one
    judgement: Stability
    residual: float  # the largest of the equations over the size of their own terms
    error: float  # estimate of what rounding and the last iteration leave wrong, over the standard deviations
    path: tuple[str, ...]  # a line for each attempt
    frame: Frame = field(repr=False)
    evaluation: Evaluation = field(repr=False)  # in the frame's coordinates

    @property
    def stable(self) -> bool:
        """Whether the moments return to this point from near by."""
        return self.judgement.stable

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues of N, from the right, (n - q,) complex."""
        return self.judgement.eigenvalues


def stationary_point(problem: FrozenProblem, start: tuple[Array, Array] | None = None) -> StationaryPoint:
    """Find a stationary point, a stable one if there is one to be found.

    Parameters
    ----------
    problem : the moment equations with everything else fixed.
    start : mean (n,) and covariance (n, n) to begin with; also the values of what is conserved. Default: rest.

    Raises
    ------
    SolverError
        If no acceptable solution was found: what was tried, the best residual, and the eigenvalue to blame.
    """
    view = frame(problem, None if start is None else start[0])
    attempts: list[Attempt] = []
    fallback: StationaryPoint | None = None
    for attempt in ladder(view, start):
        point, refusal = accept(view, attempt, attempts)
        attempts.append(replace(attempt, reason=refusal, converged=point is not None))
        if point is not None and point.stable:
            return point
        fallback = fallback or point
        if not len(problem.C):
            break  # linear: there is only one candidate
    if fallback is not None:
        return fallback
    raise _failure(view, attempts)


def ladder(view: Frame, start: tuple[Array, Array] | None) -> Iterator[Attempt]:
    """Attempts at a solution, cheapest first; the caller stops when it has what it wants."""
    p, spread = view.problem, view.spread
    rest = np.zeros(p.n)
    if start is not None:
        mean, covariance = view.lower(*start)
        if np.any(covariance):
            yield newton(p, (mean, covariance), name="Newton from the given start", close=CLOSE)
        rest = mean
    yield newton(p, (rest, spread), name="Newton from a short run", close=CLOSE)
    yield follow(p, (rest, 1e-8 * spread), name="pseudo-transient from rest")
    yield newton(p, (rest, 1e-8 * spread), name="Newton from rest", close=CLOSE)
    yield follow(p, (rest, spread), name="pseudo-transient from a short run")
    yield follow(p, (rest, 1e-8 * spread), limit=600, tolerance=0.05, name="march from rest")
    yield from scattered(view, 8)


def scattered(view: Frame, count: int, marches: int | None = None) -> Iterator[Attempt]:
    """Attempts from random means, equal each time it is run; from the first `marches` of them (all) in time as well."""
    p, spread = view.problem, view.spread
    rng = np.random.default_rng(0)
    sigma = np.sqrt(np.maximum(np.diag(spread), 0.0))
    for k in range(count):
        mean = 3.0 * sigma * rng.standard_normal(p.n) * rng.random()
        begin = mean, 10.0 ** rng.uniform(-4, 1) * spread
        yield newton(p, begin, name=f"Newton from random start {k + 1}", close=CLOSE)
        if marches is None or k < marches:
            yield follow(p, begin, limit=60, name=f"pseudo-transient from random start {k + 1}")


@np.errstate(all="ignore")
def accept(view: Frame, attempt: Attempt, before: Sequence[Attempt] = ()) -> tuple[StationaryPoint | None, str]:
    """The solution at which an attempt converged, or None and why it is not one."""
    if not attempt.converged:
        return None, attempt.reason
    lin = LinearisedMoments(attempt.best)
    try:
        at, step = polish(lin)
        if not at.finite or not at.residual < RESIDUAL:
            return None, "the residual does not become small"
        if not step < STEP:
            return None, "the moments run away"
        if not _positive(at.covariance):
            return None, "its covariance is not positive semidefinite"
        lin = lin if lin.at.problem.n > EXACT else LinearisedMoments(at)
        error = _rounding(lin)
        if not error < ROUNDING:
            return None, f"rounding alone moves the moments by {error:.0e}"
        judgement = replace(stability(lin), eigenvalues=_eigenvalues(lin, at))
    except SolverError as problem:
        return None, str(problem)
    mean, covariance = view.lift(at)
    point = StationaryPoint(
        mean=mean,
        covariance=covariance,
        drift=view.drift,
        drifting=view.drifting,
        judgement=judgement,
        residual=at.residual,
        error=max(step**2, error),
        path=tuple(str(each) for each in (*before, attempt)),
        frame=view,
        evaluation=at,
    )
    return point, ""


def _eigenvalues(lin: LinearisedMoments, at: Evaluation) -> Array:
    """Eigenvalues of N at a point next to the one of the decomposition, to first order, from the right."""
    form = lin.form
    if lin.at is at or not isinstance(form, ModalForm):
        return from_the_right(form.eigenvalues if lin.at is at else np.linalg.eigvals(at.N))
    p = at.problem
    change = form.enter_vector(p.columns * (at.gain - lin.at.gain)) * form.enter_form(p.C).T
    return from_the_right(form.eigenvalues + change.sum(axis=1))


def _rounding(lin: LinearisedMoments) -> float:
    """How far rounding errors in the terms of the equations move the solution, over the standard deviations."""
    eps = np.finfo(float).eps
    rates = lin.form.eigenvalues
    condition = np.abs(rates).max() / np.abs(np.real(rates)).min()
    if len(lin.at.problem.C):
        condition += np.linalg.cond(lin.small(0.0).matrix)
    if condition < HARMLESS:
        return float(eps * condition)
    first, second = lin.at.terms
    signs = np.sign(np.random.default_rng(0).standard_normal(second.shape))
    noise = np.triu(signs) + np.triu(signs, 1).T
    return relative_size(lin.at, lin.solve(eps * signs[0] * first, eps * noise * second))


def _positive(P: Array) -> bool:
    """Whether a covariance is positive semidefinite but for rounding, whatever the units of its states."""
    if not np.isfinite(P).all():
        return False
    sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
    sigma = np.where(sigma > 1e-9 * sigma.max(initial=0.0), sigma, np.inf)
    correlation = P / np.outer(sigma, sigma)
    floor = NEGATIVE * np.eye(len(P))
    try:
        np.linalg.cholesky(P + (np.trace(P) + np.finfo(float).tiny) * floor)
        np.linalg.cholesky(correlation + len(P) * floor)
    except np.linalg.LinAlgError:
        return False
    return True


def _failure(view: Frame, attempts: list[Attempt]) -> SolverError:
    """What was tried, how close it came, and which eigenvalue is to blame."""
    positive = [each.best for each in attempts if np.min(np.diag(each.best.covariance)) >= 0]
    best = min(positive, key=lambda at: at.residual, default=attempts[0].best)
    # the march goes where the moments go; without one, the longest search
    last = max(attempts, key=lambda each: (each.rung.startswith("march"), each.iterations)).last
    tried = "; ".join(str(each) for each in attempts if "from random" not in each.rung)
    count = sum("from random" in each.rung for each in attempts)
    if count:
        tried += f"; {count} attempts from random starts"
    blame, eigenvalue = _blame(view, last)
    return SolverError(
        f"No stationary moments were found. {blame} Tried: {tried}. Best residual {best.residual:.1e}.",
        residual=best.residual,
        eigenvalue=eigenvalue,
        tried=tuple(str(each) for each in attempts),
    )


def _blame(view: Frame, at: Evaluation) -> tuple[str, complex]:
    """The slowest or growing mode where the search ended, in words, and its eigenvalue."""
    N = at.N if np.isfinite(at.N).all() else view.problem.A
    values, vectors = np.linalg.eig(N)
    worst = int(np.argmax(np.real(values)))
    value = complex(values[worst])
    names = view.states
    share = np.abs(view.right @ (vectors[:, worst] * np.sqrt(np.maximum(np.diag(at.covariance), 1e-300))))
    share = np.abs(view.right @ vectors[:, worst]) if not np.isfinite(share).all() else share
    scale = np.sqrt(np.maximum(np.diag(view.right @ view.spread @ view.right.T), 1e-300))
    main = np.argsort(-share / scale)[: 2 if value.imag else 1]
    who = " and ".join(f"`{names[i]}`" for i in main if i < len(names))
    number = f"{value.real:.3g}" + (f" ± {abs(value.imag):.3g}i" if value.imag else "")
    where = f" (mostly {who})" if who else ""
    limit = MARGINAL * np.abs(values).max()
    if value.real > limit:
        verdict = f"N has the growing eigenvalue {number}{where}: negative damping or stiffness."
    elif value.real >= -limit:
        verdict = f"the eigenvalue {number} of N{where} is undamped: its variance grows without bound."
    else:
        verdict = f"the least damped eigenvalue of N was {number}{where}"
        growth = _growth(at)
        if growth.real > 0:
            value = growth
            verdict += f", but the moments run away at {growth.real:.3g}: the elements lose gain as they grow"
        verdict += "."
    return f"Where the search ended {verdict}", value


def _growth(at: Evaluation) -> complex:
    """The eigenvalue of the moment equations with the largest real part, or zero where that is no number."""
    try:
        return stability(LinearisedMoments(at)).rightmost
    except (SolverError, np.linalg.LinAlgError):
        return 0j
