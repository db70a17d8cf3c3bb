"""The beginning of a stretch, where what an implicit method goes by would mislead it.

Without variance the equivalent gain of dry friction has no bound, for it is as one over the standard deviation. Newton's
method, given such a gain for that of a whole step, turns every correction into nothing and takes that for convergence. And
the expectation of a function of two arguments that jumps depends on their correlation, which is there as soon as noise has
acted, however small the variances: E[sign(x) sign(y)] is 2 asin(r)/pi for zero means. The rate jumps then, and its
derivatives in the covariance have no bound either.

Explicit formulas go by rates alone, and the larger a gain without variance, the smaller the variance it stops at: until then
steps as long as the time that has passed are short enough. So they go first, to where the gains are those of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.evaluate import Rate, behind, gains
from cadet_sym.solve.native import Native, has_machine_code
from cadet_sym.solve.scales import Tolerance

__all__ = ["Onset", "onset"]

Array = npt.NDArray[np.float64]

BEYOND = 10.0
"""Gains that are so many times those ..."""

VARIANCE = 1e-2
"""... at this share more of the variances that the run reaches say nothing of it ..."""

SETTLED = 1.1
"""... until they are hardly more: what changes fast is followed at the least cost by explicit formulas."""

STEPS = 100
"""Explicit steps after which the gains are looked at again ..."""

CHEAP = 200_000
"""... or as many as carry so many moments, where they are machine code and cost no more than the look ..."""

MOST = 2_000
"""... and at most: what has not left its first gains by then is stiff with them."""

HELD = 0.1
"""Change of a gain that was held ..."""

TIMES_OF_DECAY = 10.0
"""... so many times as long as what is stiff with it takes to settle: it goes with the run from there on."""

FIRST = 1e-15  # of the stretch: the first of the steps that look for a jump
LAST = 1e-9  # of the stretch: how far they look
JUMP = 0.01  # of a rate: a larger change from the beginning, and none since, is a jump
STEADY = 0.01  # of a rate: what it may change by while the time doubles


class Onset(NamedTuple):
    """How far explicit steps led."""

    found: Array  # (k, size) at the times that were passed
    time: float
    y: Array  # (size,) there
    steps: int
    honest: bool  # whether the gains there are those of the run


def onset(lowered: MomentFunctions, p: Array, tolerance: Tolerance, begin: float, y: Array, times: Array) -> Onset:
    """Where an implicit method may begin on a stretch, from packed moments y at its beginning.

    Parameters
    ----------
    tolerance : of which the sizes are those that the moments reach.
    times : (k,) of outputs, the last of which ends the stretch.
    """
    here = Onset(np.empty((0, len(y))), begin, y, 0, honest=True)
    begin, end = behind(begin), float(times[-1])
    if not end > begin:
        return here
    if not (_misleads(lowered, p, tolerance, begin, y, end) or _jumps(lowered, p, begin, y, end)):
        return here
    before = here
    for here in _stretched(lowered, p, tolerance, begin, y, times):
        if len(here.found) == len(times) or not _misleads(lowered, p, tolerance, here.time, here.y, end, SETTLED):
            return here
        if _settled(lowered, p, before, here):
            return here
        before = here
    return here._replace(honest=False)


def _misleads(
    lowered: MomentFunctions, p: Array, tolerance: Tolerance, t: float, y: Array, end: float, times: float = BEYOND
) -> bool:
    """Whether some gain, large enough to matter before the end, would be `times` smaller with a little more variance."""
    usual, diagonal = y.copy(), lowered.facts.packing.diagonal
    variances = tolerance.size[diagonal]
    usual[diagonal] += VARIANCE * variances
    here, there = (np.abs(gains(lowered, t, at, p)) for at in (y, usual))
    deviation = np.sqrt(np.maximum(variances, 1e-300))
    matters = here * deviation / deviation[:, None] * (end - t) > 1.0
    return not np.all((here <= times * there) | ~matters) if np.isfinite(here).all() else True


def _settled(lowered: MomentFunctions, p: Array, before: Onset, here: Onset) -> bool:
    """Whether the gains have hardly changed for long, by the time in which what is stiff with them decays.

    Friction so strong that two masses hardly move against each other has gains far beyond those of masses that do, and keeps
    them all along the run.
    """
    if not before.steps:  # there the gains had no bound
        return False
    earlier, now = (gains(lowered, at.time, at.y, p) for at in (before, here))
    fastest = np.abs(np.linalg.eigvals(now)).max(initial=0.0) if np.isfinite(now).all() else 0.0
    held = np.abs(now - earlier) <= HELD * np.abs(now)
    return bool(held.all() and fastest * (here.time - before.time) >= TIMES_OF_DECAY)


def _jumps(lowered: MomentFunctions, p: Array, begin: float, y: Array, end: float) -> bool:
    """Whether a rate jumps as functions of two arguments learn of their correlation."""
    if max(lowered.facts.arguments, default=0) < 2 or np.all(y[lowered.facts.packing.diagonal] > 0):
        return False
    rate, duration = _rate(lowered, p), end - begin
    rates, passed, step = [rate(begin, y)], 0.0, max(FIRST * duration, 4 * float(np.spacing(begin)))
    with np.errstate(all="ignore"):  # what runs away is not steady
        while passed < LAST * duration or len(rates) < 3:
            y, passed = _step(rate, begin + passed, y, step), passed + step
            rates.append(rate(begin + passed, y))
            step = passed
        first, late, last = rates[0], rates[-2], rates[-1]
        # a rate that grows from zero, or is fast, changes as the time doubles
        steady = np.abs(last - late) <= STEADY * np.abs(last)
        return bool(np.any(steady & (np.abs(last - first) > JUMP * np.abs(last))))


def _step(rate: Callable[[float, Array], Array], time: float, y: Array, h: float) -> Array:
    """One step of the classical Runge-Kutta formula."""
    k1 = rate(time, y)
    k2 = rate(time + h / 2, y + h / 2 * k1)
    k3 = rate(time + h / 2, y + h / 2 * k2)
    k4 = rate(time + h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _stretched(
    lowered: MomentFunctions, p: Array, tolerance: Tolerance, begin: float, y: Array, times: Array
) -> Iterator[Onset]:
    """Where explicit steps lead, `STEPS` after `STEPS`, as long as they do."""
    machine = has_machine_code(lowered, p, y)
    lead, most = (_by_machine, CHEAP // len(y)) if machine else (_by_arrays, 0)
    few = replace(tolerance, steps=min(MOST, max(STEPS, most)))
    here = Onset(np.empty((0, len(y))), begin, y, 0, honest=True)
    while here.steps < MOST and len(here.found) < len(times):
        more = lead(lowered, p, few, here.time, here.y, times[len(here.found) :])
        if not (more.time > here.time and np.isfinite(more.y).all()):
            return
        here = more._replace(found=np.vstack([here.found, more.found]), steps=here.steps + more.steps)
        yield here


def _by_machine(lowered: MomentFunctions, p: Array, tolerance: Tolerance, begin: float, y: Array, times: Array) -> Onset:
    explicit = Native(lowered, p, tolerance)
    try:
        found = explicit.advance(begin, y, times)
    except Breakdown as told:
        if told.found is None or told.time is None or told.y is None:
            return Onset(np.empty((0, len(y))), begin, y, 0, honest=True)
        return Onset(told.found, told.time, told.y, explicit.steps, honest=True)
    return Onset(found, float(times[-1]), found[-1], explicit.steps, honest=True)


def _by_arrays(lowered: MomentFunctions, p: Array, tolerance: Tolerance, begin: float, y: Array, times: Array) -> Onset:
    """The same formulas where there is no machine code."""
    from scipy.integrate import DOP853

    relative, end = max(tolerance.relative, 3e-14), float(times[-1])
    absolute = tolerance.absolute * tolerance.relative * tolerance.size
    found: list[Array] = []
    with np.errstate(all="ignore"):  # what is not finite makes it shorten its step
        explicit = DOP853(_rate(lowered, p), begin, y, end, rtol=relative, atol=absolute)
        for _ in range(tolerance.steps):
            explicit.step()
            if explicit.status == "failed":
                break
            within = explicit.dense_output()
            passed = times[len(found) :]
            found.extend(within(t) for t in passed[passed <= explicit.t])
            if explicit.status == "finished":
                break
    return Onset(np.array(found).reshape(-1, len(y)), float(explicit.t), explicit.y, tolerance.steps, honest=True)


def _rate(lowered: MomentFunctions, p: Array) -> Callable[[float, Array], Array]:
    into = Rate(lowered, p)

    def rate(t: float, y: Array) -> Array:
        slope = np.empty(len(y))
        into(t, np.ascontiguousarray(y), slope)
        return slope

    return rate
