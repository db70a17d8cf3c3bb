"""Say why an integration broke down: when, in which state, with which eigenvalue, and what was reached."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.evaluate import gains
from cadet_sym.solve.freeze import context_at

__all__ = ["NOT_FINITE", "STALLED", "TOO_MANY", "Breakdown", "explain", "moment_name", "settled"]

Array = npt.NDArray[np.float64]


class Breakdown(Exception):  # noqa: N818 - an event that the caller handles; users see a SolverError
    """An engine gave up: its reason, what it had found on the grid, and the last time and moments it reached."""

    def __init__(
        self, reason: str, found: Array | None = None, time: float | None = None, y: Array | None = None
    ) -> None:
        super().__init__(reason)
        self.reason, self.found, self.time, self.y = reason, found, time, y


TOO_MANY, STALLED, NOT_FINITE = 1, 2, 3
"""What machine code returns where it gives a run up ..."""

REASONS = {
    TOO_MANY: "It took too many steps.",
    STALLED: "Its steps shrink to nothing.",
    NOT_FINITE: "The result is not finite.",
}
"""... and why."""


def settled(found: Array, status: int, known: int, time: float, y: Array) -> Array:
    """What machine code found (k, size), or Breakdown: with the rows known, and the last time and moments."""
    if status:
        raise Breakdown(REASONS[status], found[:known], time, y)
    if not np.isfinite(found).all():
        raise Breakdown(REASONS[NOT_FINITE])
    return found


def explain(
    lowered: MomentFunctions, p: Array, breakdown: Breakdown, begin: float, y: Array, partial: Any
) -> SolverError:
    """The error a user sees, for a stretch that began at `begin` with moments y."""
    reached = begin if breakdown.time is None else breakdown.time
    last = y if breakdown.y is None or not np.isfinite(breakdown.y).all() else breakdown.y
    if not np.isfinite(np.asarray(lowered.rate(begin, y, p))).all():  # and what is beyond means nothing
        reached, last = begin, y
    rate = np.asarray(lowered.rate(reached, last, p)).ravel()
    if np.isfinite(rate).all():  # the end of where it exists may lie just ahead
        beyond = np.asarray(lowered.rate(reached + 1e-6 * (reached or 1.0), last, p)).ravel()
        rate = rate if np.isfinite(beyond).all() else beyond
    packing, names = lowered.facts.packing, lowered.facts.states
    eigenvalues = _eigenvalues(lowered, p, reached, last)
    kept = f"{len(partial.time)} output times up to there are kept in `partial` of this error"
    details = {"time": reached, "eigenvalues": eigenvalues, "partial": partial}
    if not np.isfinite(rate).all():
        bad = int(np.flatnonzero(~np.isfinite(rate))[0])
        return SolverError(
            f"the moment equations are not finite at t = {reached:.6g}: {moment_name(bad, lowered)} has the rate "
            f"{rate[bad]}. {_lost(lowered, p, reached, last)}Check the parameters and the initial state; {kept}.",
            state=moment_name(bad, lowered),
            **details,
        )
    mean, covariance = packing.unpack(last)
    variances = np.diag(covariance)
    # The state that runs away is the one that grows fastest for its size; the largest where none does.
    growth = rate[packing.n : packing.moments][packing.triangle[0] == packing.triangle[1]]
    worst = int(np.argmax(growth / np.maximum(np.abs(variances), 1e-3 * np.abs(variances).max(initial=1e-300))))
    return SolverError(
        f"the integration breaks down at t = {reached:.6g}: the variance of `{names[worst]}` is "
        f"{variances[worst]:.3g} there and its rate {growth[worst]:.3g} (mean {mean[worst]:.3g}); "
        f"{_judgement(eigenvalues)}. The integrator says: {breakdown.reason.splitlines()[0][:160]} "
        f"What was found, {kept}.",
        state=names[worst],
        **details,
    )


def _lost(lowered: MomentFunctions, p: Array, t: float, y: Array) -> str:
    """Which nonlinearity is no number; empty if none is."""
    from cadet_sym.solve.seen import instant, tell_lost  # late: it needs SymPy, which a model from the cache does without

    text = tell_lost(instant(lowered, p, context_at(lowered, p, t), *lowered.facts.packing.unpack(y)), "rates")
    return f"{text}. " if text else ""


def _eigenvalues(lowered: MomentFunctions, p: Array, t: float, y: Array) -> npt.NDArray[np.complex128]:
    N = gains(lowered, t, y, p)
    if not np.isfinite(N).all():
        return np.full(len(N), np.nan, dtype=complex)
    found = np.linalg.eigvals(N).astype(complex)
    return found[np.argsort(-np.real(found))]


def _judgement(eigenvalues: npt.NDArray[np.complex128]) -> str:
    if not np.isfinite(eigenvalues).all():
        return "the equivalent gains are not finite there"
    first = eigenvalues[0]
    value = (
        f"{first.real:.4g}" if abs(first.imag) < 1e-12 * abs(first) else f"{first.real:.4g} +- {abs(first.imag):.4g}i"
    )
    if first.real > 0:
        return f"N has the eigenvalue {value} there: the system is unstable and grows without bound"
    return f"the eigenvalue of N with the largest real part is {value}"


def moment_name(index: int, lowered: MomentFunctions) -> str:
    """What an entry of the packed moments is, in words."""
    packing, names = lowered.facts.packing, lowered.facts.states
    if index < packing.n:
        return f"the mean of `{names[index]}`"
    if index < packing.moments:
        rows, columns = packing.triangle
        k = index - packing.n
        if rows[k] == columns[k]:
            return f"the variance of `{names[rows[k]]}`"
        return f"the covariance of `{names[rows[k]]}` and `{names[columns[k]]}`"
    if packing.distance and index == packing.moments:
        return "the distance travelled"
    return "the ground between the wheels"
