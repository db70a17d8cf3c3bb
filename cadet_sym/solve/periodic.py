"""Moments that repeat: where rates depend on time with a period, the stationary state is a cycle of that period.

With y(T) = Phi(y(0)) the moments a period later, the cycle's start solves Phi(y) = y. Newton's method (shooting; Stoer &
Bulirsch, Introduction to Numerical Analysis, section 7.3) takes its derivative M = dPhi/dy, the monodromy matrix, from
the moments' own sensitivities; its eigenvalues are the Floquet multipliers of the moment equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cadet_sym.errors import ModelError, SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.many import Start
from cadet_sym.solve.scales import peaks
from cadet_sym.solve.sensitivity import forward
from cadet_sym.solve.transient import integrate

__all__ = ["Cycle", "find_cycle"]

Array = np.ndarray

LARGEST = 12  # states: the monodromy matrix has n (n + 3) / 2 columns, each integrated with the moments
CLOSE = 1e-7  # of the moments' sizes: what may be left of Phi(y) - y
SETTLED = 0.05  # the same after which Newton's method takes over from the march
PERIODS = 64  # of the march, at most
STEPS = 12
TRIED = 7  # instants at which the rates are compared with those a period later
ROUNDING = 1e-9
NEAR_ONE = 1e-6  # a multiplier this close to one is a drift


@dataclass(frozen=True)
class Cycle:
    """The start of a periodic solution."""

    y: Array  # (m,) packed moments at t = 0
    multipliers: Array  # (m,) complex, the largest first
    residual: float  # what is left of Phi(y) - y, over the moments' sizes
    steps: int  # of Newton's method
    periods: int  # marched before

    @property
    def stable(self) -> bool:
        """Whether the moments return to the cycle from near by."""
        return bool(abs(self.multipliers[0]) < 1)


def find_cycle(lowered: MomentFunctions, start: Start, period: float) -> Cycle:
    """Find the moments that are the same a period later.

    Parameters
    ----------
    start : packed moments to begin with, parameters, and the breakpoints within one period.
    period : T > 0 with which every coefficient repeats.

    Raises
    ------
    ModelError
        If the rates do not repeat, or the system is too large.
    SolverError
        If there is no cycle to be found, or a state drifts.
    """
    _check(lowered, start.p, period)
    y: Array  # of what type arrays in loops are takes long to find out
    M: Array
    y, periods, size = _march(lowered, start, period)
    left, M = np.inf, np.eye(len(y))
    for step in range(STEPS + 1):
        end, M = _period(lowered, start, y, period, size)
        gap: Array = end - y
        left = float(np.abs(gap / size).max())
        if left < CLOSE:
            return _accepted(lowered, Cycle(y, _multipliers(M), left, step, periods))
        _refuse_drift(lowered, M, size)
        y = y - np.linalg.solve(M - np.eye(len(y)), gap)
        _, covariance = lowered.facts.packing.unpack(np.asarray(y, dtype=np.float64))
        if not np.isfinite(y).all() or np.any(np.diag(covariance) < 0):
            break
    raise _failure(M, left)


def _check(lowered: MomentFunctions, p: Array, period: float) -> None:
    facts = lowered.facts
    if not (np.isfinite(period) and period > 0):
        raise ModelError(f"the period is {period:g}; it must be finite and above zero.")
    if len(facts.states) > LARGEST:
        raise ModelError(f"periodic moments are found for up to {LARGEST} states; there are {len(facts.states)}.")
    if facts.delay is not None or facts.packing.distance:
        what = "wheels follow each other on one track" if facts.delay is not None else "a rate depends on the distance"
        raise ModelError(f"{what}: periodic moments are not found for such a model; run it long with `propagate`.")
    rng = np.random.default_rng(0)
    y = rng.uniform(0.5, 1.5, facts.packing.size)
    for t in period * rng.random(TRIED):
        now, later = (np.asarray(lowered.rate(time, y, p)).ravel() for time in (t, t + period))
        wrong = np.abs(now - later) > ROUNDING * (np.abs(now) + np.abs(later)).max(initial=1e-300) * (1 + t / period)
        if wrong.any():
            n = facts.packing.n
            place = int(np.argmax(wrong))
            index = {place} if place < n else {int(k[place - n]) for k in facts.packing.triangle}
            names = " and ".join(f"`{facts.states[i]}`" for i in sorted(index))
            raise ModelError(
                f"the moments of {names} do not have the period {period:g}: their rates at t = {t:.4g} "
                "are others a period later."
            )


def _march(lowered: MomentFunctions, start: Start, period: float) -> tuple[Array, int, Array]:
    """Follow the moments until a period changes them little: where, after how many periods, and their sizes."""
    packing = lowered.facts.packing
    y, periods = start.y, 0
    size = np.ones(len(y))
    grid = np.linspace(0.0, period, 17)
    while periods < PERIODS:
        path = integrate(lowered, Start(y, start.p, start.breakpoints), grid, rtol=1e-6).y
        periods += 1
        size = peaks(path, packing)
        gap = np.abs((path[-1] - y) / size).max()
        y = path[-1]
        if gap < SETTLED:
            break
    return y, periods, size


def _period(lowered: MomentFunctions, start: Start, y: Array, period: float, size: Array) -> tuple[Array, Array]:
    """Phi(y) and M."""
    begin = Start(y, start.p, start.breakpoints)
    ends, slopes = forward(lowered, begin, np.diag(size), [-1] * len(y), size, np.array([period]), {})
    return ends[0], slopes[0] / size


def _multipliers(M: Array) -> Array:
    values = np.linalg.eigvals(M).astype(complex)
    return values[np.argsort(-np.abs(values), kind="stable")]


def _refuse_drift(lowered: MomentFunctions, M: Array, size: Array) -> None:
    """A multiplier of one: what it moves keeps its start, or wanders without bound."""
    values, vectors = np.linalg.eig(M)
    place = int(np.argmin(np.abs(values - 1)))
    if abs(values[place] - 1) > NEAR_ONE:
        return
    packing, states = lowered.facts.packing, lowered.facts.states
    worst = int(np.argmax(np.abs(vectors[:, place]) / size))
    index = {worst} if worst < packing.n else {int(k[worst - packing.n]) for k in packing.triangle}
    names = " and ".join(f"`{states[i]}`" for i in sorted(index))
    raise SolverError(
        f"the moments of {names} have a Floquet multiplier of one: they drift or keep their initial value, so that no "
        "cycle is their own. Take a road with a low-frequency `cutoff`, or leave the state out.",
        multipliers=values,
    )


def _accepted(lowered: MomentFunctions, cycle: Cycle) -> Cycle:
    _, P = lowered.facts.packing.unpack(cycle.y)
    lowest = float(np.linalg.eigvalsh(P)[0])
    if lowest < -1e-8 * max(float(np.trace(P)), 1e-300):
        raise SolverError(
            f"the only cycle found has a covariance that is not positive semidefinite (eigenvalue {lowest:.3g}); the "
            f"largest Floquet multiplier of the moments is {abs(cycle.multipliers[0]):.4g}.",
            multipliers=cycle.multipliers,
        )
    return cycle


def _failure(M: Array, left: float) -> SolverError:
    multipliers = _multipliers(M)
    largest = abs(multipliers[0])
    grows = "the moments grow from period to period: parametric resonance or negative damping"
    why = grows if largest > 1 else "start nearer to the cycle, by [initial]"
    return SolverError(
        f"No periodic moments were found: after {STEPS} steps of shooting they change by {left:.1e} of their size in a "
        f"period. The largest Floquet multiplier there is {largest:.4g}; {why}.",
        multipliers=multipliers,
        residual=left,
    )
