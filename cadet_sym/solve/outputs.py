"""Means and variances of the outputs, from the packed moments of many runs."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.kernel import Function, Vector, isfinite, kernel, part
from cadet_sym.lowering.machine import address
from cadet_sym.solve.evaluate import results_shared
from cadet_sym.solve.shares import Then, Which, nothing

__all__ = ["Outputs", "outputs_of"]

Array = npt.NDArray[np.float64]


@dataclass(eq=False)
class Outputs:
    """The outputs of many runs."""

    mean: Array  # (runs, k, m)
    variance: Array  # (runs, k, m)
    finite: bool = True  # whether all of them are numbers


def outputs_of(lowered: MomentFunctions, time: Array, p: Array) -> tuple[Outputs, Then]:
    """Room for the outputs of runs with parameters (runs, count) at times (k,), and what writes those of some runs there."""
    runs, times, m = len(p), len(time), len(lowered.facts.outputs)
    outputs = Outputs(np.empty((runs, times, m)), np.empty((runs, times, m)))
    if not outputs.mean.size:
        return outputs, nothing
    time, p = (np.ascontiguousarray(each, dtype=float) for each in (time, p))
    code = lowered.machine_outputs(runs * times)

    def write(which: Which, y: Array) -> None:
        if not isinstance(which, slice):
            for k, own in zip(which.tolist(), y, strict=True):
                write(slice(k, k + 1), own[None])
            return
        mean, variance = outputs.mean[which], outputs.variance[which]
        if code is not None:
            y = np.ascontiguousarray(y)
            given = address(time), address(y), y.shape[2], address(p[which]), p.shape[1], m
            lost = _outputs_of_all()(code.addresses["outputs"], len(y), times, *given, address(mean), address(variance))
        else:
            for k, (own, numbers) in enumerate(zip(y, p[which], strict=True)):
                mean[k], variance[k] = results_shared(lowered.outputs, times, time, own, numbers)
            lost = not (np.isfinite(mean).all() and np.isfinite(variance).all())
        if lost:
            outputs.finite = False

    return outputs, write


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
