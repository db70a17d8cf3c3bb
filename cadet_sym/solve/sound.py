"""Look over what runs gave, in one pass of machine code: most runs are sound, and short ones should not wait to hear it.

Who is found sound here is so beyond rounding; all others are judged by `scales.fits` and `definite.lost`. So no result
depends on whether there is machine code, and it is made only for who runs again and again.
"""

from __future__ import annotations

import ctypes
import itertools
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.kernel import Vector, kernel, part, sqrt
from cadet_sym.lowering.machine import address, available
from cadet_sym.packing import Packing
from cadet_sym.solve.definite import LIMIT, MANY, TINY
from cadet_sym.solve.scales import FEW_TIMES, MANY_TIMES
from cadet_sym.solve.shares import ALONE, Team

__all__ = ["are_sound", "look_over"]

Array = npt.NDArray[np.float64]

PAYS = 16
"""Runs after which the machine code is worth reading from the cache, or making for all processes to come."""

_runs = itertools.count()


def look_over(
    y: Vector, rows: int, size: int, n: int, sizes: Vector, least: float, above: float, below: float, work: Vector
) -> int:
    """Whether every covariance is positive semidefinite, and the sizes suit means and variances.

    Parameters
    ----------
    y : (rows, size) packed moments, one time after the other.
    sizes : (size,) of every moment.
    least : added to a covariance's diagonal, as a share of its trace.
    above, below : by how much a mean or variance may exceed its size; and a size a variance.
    work : (n n + n,).

    Returns
    -------
    1 if all is well, or 0.
    """
    largest = part(work, n * n)  # of the variances
    for j in range(n):
        largest[j] = 0.0
    for k in range(rows):
        row = part(y, k * size)
        at = n
        trace = 0.0
        for j in range(n):  # the triangle stands column by column
            if not (abs(row[j]) <= above * sizes[j] and abs(row[at]) <= above * sizes[at]):  # or no number
                return 0
            largest[j] = max(largest[j], abs(row[at]))
            trace += row[at]
            for i in range(j, n):
                work[i * n + j] = row[at]
                at += 1
        shift = least * max(trace, 0.0) + TINY
        for j in range(n):  # P = L L^T
            pivot = work[j * n + j] + shift
            for m in range(j):
                pivot -= work[j * n + m] * work[j * n + m]
            if not pivot > 0.0:
                return 0
            root = sqrt(pivot)
            for i in range(j + 1, n):
                entry = work[i * n + j]
                for m in range(j):
                    entry -= work[i * n + m] * work[j * n + m]
                work[i * n + j] = entry / root
    at = n
    for j in range(n):
        if largest[j] > 0.0 and not sizes[at] <= below * largest[j]:
            return 0
        at += n - j
    return 1


def look_over_all(
    y: Vector, runs: int, rows: int, size: int, n: int, sizes: Vector, stride: int, least: float, above: float, below: float,
    work: Vector, verdicts: Vector,
) -> int:
    """The verdict, 1 or 0, on each of many runs: y (runs, rows, size), the sizes of each `stride` after those of the last."""
    for run in range(runs):
        moments = part(y, run * rows * size)
        verdicts[run] = float(look_over(moments, rows, size, n, part(sizes, run * stride), least, above, below, work))
    return 0


def are_sound(y: Array, packing: Packing, size: Array, team: Team = ALONE) -> list[bool]:
    """Which packed moments (runs, k, size), of sizes (size,) or (runs, size), are sound; False where that is not known."""
    (runs, rows, count), n = y.shape, packing.n
    if n > MANY or max(runs, next(_runs)) < PAYS or not available():
        return [False] * runs
    y, size, verdicts = np.ascontiguousarray(y), np.ascontiguousarray(size), np.empty(runs)
    least = 0.5 * LIMIT  # so that no other way to round would find otherwise

    def some(part: slice) -> None:
        work, sizes = np.empty(n * n + n), size[part] if size.ndim > 1 else size
        given = part.stop - part.start, rows, count, n, address(sizes), count * (size.ndim - 1), least, FEW_TIMES, MANY_TIMES
        _look_over_all()(address(y[part]), *given, address(work), address(verdicts[part]))

    team.share(runs, some)
    return (verdicts == 1.0).tolist()


@cache
def _look_over_all() -> Any:
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    types = vector, *[integer] * 4, vector, integer, number, number, number, vector, vector
    return kernel(look_over, look_over_all, plain=True).function("look_over_all", *types, returns=integer)
