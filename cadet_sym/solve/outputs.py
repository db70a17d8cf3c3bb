"""Means and variances of the outputs, from the packed moments of many runs."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.kernel import Function, Vector, isfinite, kernel, part
from cadet_sym.lowering.machine import address
from cadet_sym.solve.evaluate import results_shared
from cadet_sym.solve.shares import ALONE, Team

__all__ = ["Outputs", "outputs_over"]

Array = npt.NDArray[np.float64]


class Outputs(NamedTuple):
    """The outputs of many runs."""

    mean: Array  # (runs, k, m)
    variance: Array  # (runs, k, m)
    finite: bool  # whether all of them are numbers


def outputs_over(lowered: MomentFunctions, time: Array, y: Array, p: Array, team: Team = ALONE) -> Outputs:
    """The outputs of many runs with parameters (runs, count), from the packed moments (runs, k, size) at all times (k,)."""
    runs, times, size = y.shape
    m = len(lowered.facts.outputs)
    mean, variance = np.empty((runs, times, m)), np.empty((runs, times, m))
    if not mean.size:
        return Outputs(mean, variance, finite=True)
    time, y, p = (np.ascontiguousarray(each, dtype=float) for each in (time, y, p))
    if (code := lowered.machine_outputs(runs * times)) is not None:
        outputs, whole = code.addresses["outputs"], _outputs_of_all()

        def some(part: slice) -> bool:
            found = address(mean[part]), address(variance[part])
            count = part.stop - part.start
            given = address(time), address(y[part]), size, address(p[part]), p.shape[1], m
            return whole(outputs, count, times, *given, *found) == 0

        return Outputs(mean, variance, all(team.share(runs, some)))
    for k in range(runs):
        mean[k], variance[k] = results_shared(lowered.outputs, times, time, y[k], p[k])
    return Outputs(mean, variance, bool(np.isfinite(mean).all() and np.isfinite(variance).all()))


def outputs_of_all(
    outputs: Function, runs: int, times: int, time: Vector, y: Vector, size: int, p: Vector, numbers: int, m: int, mean: Vector,
    variance: Vector,
) -> int:
    """Write means and variances (runs, times, m) of the outputs of y (runs, times, size), with p (runs, numbers).

    Returns how many are no numbers.
    """
    lost = 0
    for run in range(runs):
        given = part(p, run * numbers)
        for k in range(times):
            at = run * times + k
            means = part(mean, at * m)
            variances = part(variance, at * m)
            outputs(part(time, k), part(y, at * size), given, means, variances)
            for i in range(m):
                if not isfinite(means[i]) or not isfinite(variances[i]):
                    lost += 1
    return lost


@cache
def _outputs_of_all() -> Any:
    vector, integer = ctypes.c_void_p, ctypes.c_int64
    types = vector, integer, integer, vector, vector, integer, vector, integer, integer, vector, vector
    return kernel(outputs_of_all).function("outputs_of_all", *types, returns=integer)
