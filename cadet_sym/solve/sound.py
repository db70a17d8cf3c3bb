"""Look over what runs gave, in one pass of machine code: most runs are sound, and short ones should not wait to hear it.

Who is found sound here is so beyond rounding; all others are judged by `scales.fits` and `definite.lost`. So no result
depends on whether there is machine code, and it is made only for who runs again and again.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.kernel import Vector, kernel, part
from cadet_sym.lowering.machine import address, available
from cadet_sym.packing import Packing
from cadet_sym.solve.definite import LIMIT, MANY, TINY
from cadet_sym.solve.scales import FEW_TIMES, MANY_TIMES

__all__ = ["are_sound", "look_over"]

Array = npt.NDArray[np.float64]

LANES = 8
"""Rows that are looked over at once."""

NAN = float("nan")

PAYS = 16
"""Runs after which the machine code is worth reading from the cache, or making for all processes to come."""

_looked = [0]
"""How many runs were to be looked over."""


def look_over(
    y: Vector, rows: int, size: int, n: int, sizes: Vector, least: float, above: float, below: float, block: Vector,
    lanes: Vector,
) -> int:
    """Whether every covariance is positive semidefinite, and the sizes suit means and variances.

    Parameters
    ----------
    y : (rows, size) packed moments, one time after the other.
    sizes : (size,) of every moment.
    least : added to a covariance's diagonal, as a share of its trace.
    above, below : by how much a mean or variance may exceed its size; and a size a variance.
    block : (LANES moments,) for so many rows side by side.
    lanes : (LANES (2 n + 2),).

    Returns
    -------
    1 if all is well, or 0.
    """
    moments = n + n * (n + 1) // 2
    column = part(lanes, LANES * n)
    shift = part(column, LANES * n)
    inverse = part(shift, LANES)
    for k in range(LANES * n):
        lanes[k] = 0.0  # the largest of the variances
    many = rows >= LANES
    for begin in range((rows + LANES - 1) // LANES if many else rows):
        first = min(LANES * begin, rows - LANES) if many else begin
        seen = part(y, first * size)
        step = size if many else 0
        for e in range(moments):
            entries = part(block, LANES * e)
            for k in range(LANES):
                entries[k] = seen[step * k + e]
        for k in range(LANES):
            shift[k] = 0.0
        at = n
        for j in range(n):  # the triangle stands column by column
            means = part(block, LANES * j)
            variances = part(block, LANES * at)
            largest = part(lanes, LANES * j)
            for k in range(LANES):  # what is wrong makes no number of all that follows
                shift[k] += 0.0 if abs(means[k]) <= above * sizes[j] else NAN
                shift[k] += variances[k] if abs(variances[k]) <= above * sizes[at] else NAN
            for k in range(LANES):
                largest[k] = max(largest[k], abs(variances[k]))
            at += n - j
        for k in range(LANES):
            shift[k] = least * max(shift[k], 0.0) + TINY
        pivots = shift
        at = n
        for j in range(n):  # P = L D L^T
            pivots = part(block, LANES * at)
            for k in range(LANES):
                pivots[k] += shift[k]
            for k in range(LANES):
                inverse[k] = 1.0 / pivots[k] if pivots[k] > 0.0 else NAN
            for k in range(LANES * (n - j)):
                column[k] = pivots[k]
            at += n - j
            entries = part(block, LANES * at)
            for m in range(1, n - j):
                upper = part(column, LANES * m)
                for i in range(m, n - j):
                    lower = part(column, LANES * i)
                    entry = part(entries, LANES * (i - m))
                    for k in range(LANES):
                        entry[k] -= lower[k] * inverse[k] * upper[k]
                entries = part(entries, LANES * (n - j - m))
        for k in range(LANES):
            if not pivots[k] > 0.0:
                return 0
    at = n
    for j in range(n):
        variance = 0.0
        for k in range(LANES):
            variance = max(variance, lanes[LANES * j + k])
        if variance > 0.0 and not sizes[at] <= below * variance:
            return 0
        at += n - j
    return 1


def look_over_all(
    y: Vector, runs: int, rows: int, size: int, n: int, sizes: Vector, stride: int, least: float, above: float, below: float,
    block: Vector, lanes: Vector, verdicts: Vector,
) -> int:
    """The verdict, 1 or 0, on each of many runs: y (runs, rows, size), the sizes of each `stride` after those of the last."""
    for run in range(runs):
        moments = part(y, run * rows * size)
        own = part(sizes, run * stride)
        verdicts[run] = float(look_over(moments, rows, size, n, own, least, above, below, block, lanes))
    return 0


def are_sound(y: Array, packing: Packing, size: Array) -> npt.NDArray[np.bool_]:
    """Which packed moments (runs, k, size), of sizes (size,) or (runs, size), are sound; False where that is not known."""
    (runs, rows, count), n = y.shape, packing.n
    _looked[0] += runs
    if n > MANY or _looked[0] < PAYS or not available():
        return np.zeros(runs, dtype=bool)
    y, size, verdicts = np.ascontiguousarray(y), np.ascontiguousarray(size), np.empty(runs)
    least = 0.5 * LIMIT  # so that no other way to round would find otherwise
    block, lanes = np.empty(LANES * packing.moments), np.empty(LANES * (2 * n + 2))
    given = runs, rows, count, n, address(size), count * (size.ndim - 1), least, FEW_TIMES, MANY_TIMES
    _look_over_all()(address(y), *given, address(block), address(lanes), address(verdicts))
    return np.asarray(verdicts == 1.0)


@cache
def _look_over_all() -> Any:
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    types = vector, *[integer] * 4, vector, integer, number, number, number, vector, vector, vector
    return kernel(look_over, look_over_all, lanes=LANES, plain=True).function("look_over_all", *types, returns=integer)
