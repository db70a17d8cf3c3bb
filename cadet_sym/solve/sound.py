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

from cadet_sym.lowering.kernel import Vector, kernel, part
from cadet_sym.lowering.machine import address, available
from cadet_sym.packing import Packing
from cadet_sym.solve.definite import LIMIT, MANY, TINY
from cadet_sym.solve.scales import FEW_TIMES, MANY_TIMES
from cadet_sym.solve.shares import ALONE, Team

__all__ = ["are_sound", "look_over"]

Array = npt.NDArray[np.float64]

LANES = 8
"""Rows that are looked over at once."""

PAYS = 16
"""Runs after which the machine code is worth reading from the cache, or making for all processes to come."""

_runs = itertools.count()


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
    lanes : (LANES (2 n + 3),).

    Returns
    -------
    1 if all is well, or 0.
    """
    moments = n + n * (n + 1) // 2
    column = part(lanes, LANES * n)
    trace = part(column, LANES * n)
    inverse = part(trace, LANES)
    wrong = part(inverse, LANES)  # how often something was
    for k in range(LANES * n):
        lanes[k] = 0.0  # the largest of the variances
    for k in range(LANES):
        wrong[k] = 0.0
    for begin in range((rows + LANES - 1) // LANES):
        for four in range(LANES // 4):
            at = LANES * begin + 4 * four
            a = part(y, min(at, rows - 1) * size)  # the last again where there are no more
            b = part(y, min(at + 1, rows - 1) * size)
            c = part(y, min(at + 2, rows - 1) * size)
            d = part(y, min(at + 3, rows - 1) * size)
            side = part(block, 4 * four)
            for e in range(moments):
                side[LANES * e] = a[e]
                side[LANES * e + 1] = b[e]
                side[LANES * e + 2] = c[e]
                side[LANES * e + 3] = d[e]
        for k in range(LANES):
            trace[k] = 0.0
        for j in range(n):
            means = part(block, LANES * j)
            high = above * sizes[j]
            for k in range(LANES):
                wrong[k] += 0.0 if abs(means[k]) <= high else 1.0  # or no number
        at = n
        for j in range(n):  # the triangle stands column by column
            diagonal = part(block, LANES * at)
            largest = part(lanes, LANES * j)
            high = above * sizes[at]
            for k in range(LANES):
                wrong[k] += 0.0 if abs(diagonal[k]) <= high else 1.0
            for k in range(LANES):
                largest[k] = max(largest[k], abs(diagonal[k]))
            for k in range(LANES):
                trace[k] += diagonal[k]
            at += n - j
        at = n
        for j in range(n):
            diagonal = part(block, LANES * at)
            for k in range(LANES):
                diagonal[k] += least * max(trace[k], 0.0) + TINY
            at += n - j
        at = n
        for j in range(n):  # P = L D L^T
            pivots = part(block, LANES * at)
            for k in range(LANES):
                wrong[k] += 0.0 if pivots[k] > 0.0 else 1.0
            for k in range(LANES):
                inverse[k] = 1.0 / pivots[k] if pivots[k] > 0.0 else 0.0
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
            if wrong[k] > 0.0:
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


def are_sound(y: Array, packing: Packing, size: Array, team: Team = ALONE) -> npt.NDArray[np.bool_]:
    """Which packed moments (runs, k, size), of sizes (size,) or (runs, size), are sound; False where that is not known."""
    (runs, rows, count), n = y.shape, packing.n
    if n > MANY or max(runs, next(_runs)) < PAYS or not available():
        return np.zeros(runs, dtype=bool)
    y, size, verdicts = np.ascontiguousarray(y), np.ascontiguousarray(size), np.empty(runs)
    least = 0.5 * LIMIT  # so that no other way to round would find otherwise

    def some(part: slice) -> None:
        block, lanes = np.empty(LANES * packing.moments), np.empty(LANES * (2 * n + 3))
        sizes = size[part] if size.ndim > 1 else size
        given = part.stop - part.start, rows, count, n, address(sizes), count * (size.ndim - 1), least, FEW_TIMES, MANY_TIMES
        _look_over_all()(address(y[part]), *given, address(block), address(lanes), address(verdicts[part]))

    team.share(runs, some)
    return np.asarray(verdicts == 1.0)


@cache
def _look_over_all() -> Any:
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    types = vector, *[integer] * 4, vector, integer, number, number, number, vector, vector, vector
    return kernel(look_over, look_over_all, lanes=LANES, plain=True).function("look_over_all", *types, returns=integer)
