"""The first instant of a run from rest, where the rate may jump.

The expectation of a function of two arguments that jumps depends on their correlation: E[sign(x) sign(y)] is
2 asin(r)/pi for zero means. Without variance there is no correlation; as soon as noise has acted there is one, however
small the variances. The rate then jumps at t = 0, its derivatives in the covariance have no bound, and an implicit
method's Newton iteration goes wrong there without noticing. So the first instant is taken by explicit steps that double
in length: they start on the far side of the jump, and reproduce the powers of t, up to the fourth, in which
covariances leave zero.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["past_onset"]

Array = npt.NDArray[np.float64]

FIRST = 1e-15  # of the duration: the first step
LAST = 1e-9  # of the duration: where the run proper begins
JUMP = 0.01  # of a rate: a larger change from t = 0, and none since, is a jump
ROUNDING = 1e-6  # of correlations
STEADY = 0.01  # of a rate: what it may change by while the time doubles


def past_onset(lowered: MomentFunctions, y: Array, p: Array, duration: float) -> tuple[float, Array] | None:
    """Time and packed moments just after the start, if the rate jumps there; else None.

    Parameters
    ----------
    y, p : packed moments at t = 0, and parameters.
    duration : of the run, or up to the first output.
    """
    if not duration > 0 or max(lowered.facts.arguments, default=0) < 2 or np.all(y[lowered.facts.packing.diagonal] > 0):
        return None  # no function of two arguments, or its correlation is known from the start

    def rate(time: float, at: Array) -> Array:
        return np.asarray(lowered.rate(time, at, p)).ravel()

    rates = [rate(0.0, y)]
    time, step = 0.0, FIRST * duration
    while time < LAST * duration:
        y, time = _step(rate, time, y, step), time + step
        rates.append(rate(time, y))
        step = time
    before, late, last = rates[0], rates[-2], rates[-1]
    # a rate that grows from zero, or is fast, changes as the time doubles
    steady = np.abs(last - late) <= STEADY * np.abs(last)
    jumps = np.any(steady & (np.abs(last - before) > JUMP * np.abs(last)))
    return (time, y) if jumps and _is_covariance(lowered.facts.packing.unpack(y)[1]) else None


def _is_covariance(P: Array) -> bool:
    """Whether the correlations are possible ones, however small the variances."""
    if not np.all(np.diag(P) >= 0):
        return False
    size = np.sqrt(np.diag(P))
    unit = np.where(size > 0, size, 1.0)
    return bool(np.linalg.eigvalsh(P / np.outer(unit, unit))[0] > -ROUNDING)


def _step(rate: Callable[[float, Array], Array], time: float, y: Array, h: float) -> Array:
    """One step of the classical Runge-Kutta formula."""
    k1 = rate(time, y)
    k2 = rate(time + h / 2, y + h / 2 * k1)
    k3 = rate(time + h / 2, y + h / 2 * k2)
    k4 = rate(time + h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
