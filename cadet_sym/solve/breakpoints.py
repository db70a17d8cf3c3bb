"""Find the times at which the known inputs of a run change abruptly."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["find_breakpoints"]

Array = npt.NDArray[np.float64]

CELLS = 2048
"""Cells of the grid on which signs are compared: inputs that switch back within one are missed."""


def find_breakpoints(lowered: MomentFunctions, p: Array, duration: float) -> tuple[float, ...]:
    """Times in (0, duration) at which a kink or jump of the speed, the ground or an input lies, increasing."""
    if not duration > 0:
        return ()
    switches = lowered.switches
    in_time, in_space = switches.size1_out(0), switches.size1_out(1)
    if in_time + in_space == 0:
        return ()
    grid = np.linspace(0.0, duration, CELLS + 1)
    found: set[float] = set()
    if in_time:
        found |= _roots(lambda t: _evaluate(switches, 0, t, np.zeros_like(t), p), grid)
    if in_space:
        grid = np.unique(np.concatenate([grid, sorted(found)]))
        distance = _distance(lowered, p, grid)
        found |= _roots(lambda t: _evaluate(switches, 1, t, distance(t), p), grid)
    margin = 1e-12 * duration
    return _apart(sorted(t for t in found if margin < t < duration - margin), margin)


def _evaluate(switches: ca.Function, which: int, t: Array, s: Array, p: Array) -> Array:
    """Values of the switch functions, (functions, times)."""
    mapped = switches.map(len(t))
    return np.asarray(mapped(t[None, :], s[None, :], np.tile(p[:, None], len(t)))[which])


def _roots(g: Callable[[Array], Array], grid: Array) -> set[float]:
    """Where a function changes sign or leaves zero, by bisection in every cell at once."""
    values = g(grid)
    sign = np.sign(values)
    rows, cells = np.nonzero(sign[:, :-1] != sign[:, 1:])
    low, high, left = grid[cells].copy(), grid[cells + 1].copy(), sign[rows, cells]
    for _ in range(60):
        if not len(rows):
            break
        middle = (low + high) / 2
        same = np.sign(g(middle)[rows, np.arange(len(rows))]) == left
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return set(high.tolist())


def _distance(lowered: MomentFunctions, p: Array, grid: Array) -> Callable[[Array], Array]:
    """s(t): in closed form, or the speed integrated over cells that end at its kinks (Gauss, 8 points)."""

    def motion(t: Array) -> tuple[Array, Array, Array]:
        V, _, s, start = lowered.motion.map(t.size)(t.ravel()[None, :], np.tile(p[:, None], t.size))
        V, s, start = (np.asarray(part, dtype=float).reshape(t.shape) for part in (V, s, start))
        return V, s, start

    if lowered.facts.known_distance:
        return lambda t: motion(t)[1]
    nodes, weights = np.polynomial.legendre.leggauss(8)

    def travelled(begin: Array, end: Array) -> Array:
        half = (end - begin)[:, None] / 2
        return (motion(begin[:, None] + half * (1 + nodes))[0] @ weights) * half[:, 0]

    start = float(motion(grid[:1])[2][0])
    known = start + np.concatenate([[0.0], np.cumsum(travelled(grid[:-1], grid[1:]))])

    def distance(t: Array) -> Array:
        cell = np.clip(np.searchsorted(grid, t, side="right") - 1, 0, len(grid) - 2)
        return known[cell] + travelled(grid[cell], t)

    return distance


def _apart(times: list[float], margin: float) -> tuple[float, ...]:
    """Times that lie closer than rounding are one."""
    kept = times[:1]
    kept += [after for before, after in pairwise(times) if after - before > margin]
    return tuple(kept)
