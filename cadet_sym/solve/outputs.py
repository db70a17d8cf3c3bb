"""Means and variances of the outputs, from the packed moments of many runs."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.kernel import Function, Vector, kernel, part
from cadet_sym.lowering.machine import address
from cadet_sym.solve.evaluate import results_shared
from cadet_sym.solve.shares import ALONE, Team

__all__ = ["outputs_over"]

Array = npt.NDArray[np.float64]


def outputs_over(
    lowered: MomentFunctions, time: Array, y: Array, p: Array, team: Team = ALONE
) -> tuple[Array, Array]:
    """Means and variances (runs, k, m) of the outputs of many runs with parameters (runs, count).

    From the packed moments (runs, k, size) at all times (k,).
    """
    runs, times, size = y.shape
    m = len(lowered.facts.outputs)
    mean, variance = np.empty((runs, times, m)), np.empty((runs, times, m))
    if not mean.size:
        return mean, variance
    time, y, p = (np.ascontiguousarray(each, dtype=float) for each in (time, y, p))
    if (code := lowered.machine_outputs(runs * times)) is not None:
        outputs, whole = code.addresses["outputs"], _outputs_of_all()

        def some(part: slice) -> None:
            found = address(mean[part]), address(variance[part])
            count = part.stop - part.start
            whole(outputs, count, times, address(time), address(y[part]), size, address(p[part]), p.shape[1], m, *found)

        team.share(runs, some)
        return mean, variance
    for k in range(runs):
        mean[k], variance[k] = results_shared(lowered.outputs, times, time, y[k], p[k])
    return mean, variance


def outputs_of_all(
    outputs: Function, runs: int, times: int, time: Vector, y: Vector, size: int, p: Vector, numbers: int, m: int, mean: Vector,
    variance: Vector,
) -> int:
    """Write means and variances (runs, times, m) of the outputs of y (runs, times, size), with p (runs, numbers)."""
    for run in range(runs):
        for k in range(times):
            at = run * times + k
            given = part(p, run * numbers)
            outputs(part(time, k), part(y, at * size), given, part(mean, at * m), part(variance, at * m))
    return 0


@cache
def _outputs_of_all() -> Any:
    vector, integer = ctypes.c_void_p, ctypes.c_int64
    types = vector, integer, integer, vector, vector, integer, vector, integer, integer, vector, vector
    return kernel(outputs_of_all).function("outputs_of_all", *types, returns=integer)
