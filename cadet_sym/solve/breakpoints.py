"""Find the times at which the known inputs of a run change abruptly."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.solve.evaluate import depends_on, results_over, results_shared

__all__ = ["breakpoints_of", "find_breakpoints"]

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

CELLS = 2048
"""Cells of the grid on which signs are compared: inputs that switch back within one are missed."""

HALVES = 60
"""How often a cell is halved."""


_which: Memory[Places] = Memory()
_known: Memory[tuple[float, ...]] = Memory()


def find_breakpoints(lowered: MomentFunctions, p: Array, duration: float) -> tuple[float, ...]:
    """Times in (0, duration) at which a kink or jump of the speed, the ground or an input lies, increasing."""
    return breakpoints_of(lowered, p[None], duration)[0]


def breakpoints_of(lowered: MomentFunctions, p: Array, duration: float) -> list[tuple[float, ...]]:
    """The same of runs with parameters (runs, count); looked for once for all that travel alike."""
    switches = lowered.switches
    if not duration > 0 or switches.size1_out(0) + switches.size1_out(1) == 0:
        return [()] * len(p)
    used = _which(lowered, 0, lambda: depends_on(*_dependences(lowered)))
    keys = [(own.tobytes(), duration) for own in p[:, used]]
    new = {key: own for key, own in zip(keys, p, strict=True) if not _known.knows(lowered, key)}
    found = dict(zip(new, _look(lowered, np.array(list(new.values())), duration), strict=True)) if new else {}
    return [_known(lowered, key, lambda key=key: found[key]) for key in keys]


def _dependences(lowered: MomentFunctions) -> list[ca.Sparsity]:
    return [lowered.switches.jac_sparsity(k, 2) for k in (0, 1)] + [lowered.motion.jac_sparsity(k, 1) for k in range(4)]


def _look(lowered: MomentFunctions, p: Array, duration: float) -> list[tuple[float, ...]]:
    grids = [np.linspace(0.0, duration, CELLS + 1)] * len(p)
    found: list[set[float]] = [set() for _ in p]
    for which, distance in enumerate((_Nowhere, _Distance)):
        if lowered.switches.size1_out(which):
            grids = [np.unique([*grid, *own]) if own else grid for grid, own in zip(grids, found, strict=True)]
            for own, roots in zip(found, _roots(lowered, which, p, grids, distance(lowered, p, grids)), strict=True):
                own.update(roots.tolist())
    margin = 1e-12 * duration
    return [_apart(sorted(t for t in own if margin < t < duration - margin), margin) for own in found]


def _roots(lowered: MomentFunctions, which: int, p: Array, grids: Sequence[Array], distance: _Nowhere) -> list[Array]:
    """Where, in every run, a switch function changes sign or leaves zero: by bisection in every cell of all runs at once."""
    switches, places, lefts = lowered.switches, [], []
    for k, (grid, own) in enumerate(zip(grids, p, strict=True)):
        sign = np.sign(results_shared(switches, len(grid), grid, distance.along(k), own)[which])
        cells, rows = np.nonzero(sign[:-1] != sign[1:])
        places.append(np.stack([np.full(len(rows), k), cells, rows]))
        lefts.append(sign[cells, rows])
    runs, cells, rows = np.concatenate(places, axis=1)
    left, every = np.concatenate(lefts), np.arange(len(rows))
    low = np.array([grids[k][cell] for k, cell in zip(runs, cells, strict=True)])
    high = np.array([grids[k][cell + 1] for k, cell in zip(runs, cells, strict=True)])
    for _ in range(HALVES if len(rows) else 0):
        middle = (low + high) / 2
        values = results_over(switches, middle, distance.within(middle, runs, cells), p[runs])[which]
        same = np.sign(values[every, rows]) == left
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return [high[runs == k] for k in range(len(p))]


class _Nowhere:
    """The distance where nothing depends on it."""

    def __init__(self, lowered: MomentFunctions, p: Array, grids: Sequence[Array]) -> None:
        self.lowered, self.p, self.grids = lowered, p, grids

    def along(self, run: int) -> Array:
        """At the times of a run's grid."""
        return np.zeros(len(self.grids[run]))

    def within(self, t: Array, runs: Places, cells: Places) -> Array:
        """At times (k,) in cells of the grids of runs."""
        return np.zeros(len(t))


class _Distance(_Nowhere):
    """s(t): in closed form, or the speed integrated over cells that end at its kinks (Gauss, 8 points)."""

    def __init__(self, lowered: MomentFunctions, p: Array, grids: Sequence[Array]) -> None:
        super().__init__(lowered, p, grids)
        self.nodes, self.weights = np.polynomial.legendre.leggauss(8)
        self.known = [self._along(grid, own) for grid, own in zip(grids, p, strict=True)]

    def along(self, run: int) -> Array:
        """At the times of a run's grid."""
        return self.known[run]

    def within(self, t: Array, runs: Places, cells: Places) -> Array:
        """At times (k,) in cells of the grids of runs."""
        p = self.p[runs]
        if self.lowered.facts.known_distance:
            return results_over(self.lowered.motion, t, p)[2][:, 0]
        begin = np.array([self.grids[k][cell] for k, cell in zip(runs, cells, strict=True)])
        known = np.array([self.known[k][cell] for k, cell in zip(runs, cells, strict=True)])
        times, half = self._times(begin, t)
        return known + results_over(self.lowered.motion, times, p.repeat(8, axis=0))[0].reshape(-1, 8) @ self.weights * half

    def _along(self, grid: Array, p: Array) -> Array:
        motion = self.lowered.motion
        if self.lowered.facts.known_distance:
            return results_shared(motion, len(grid), grid, p)[2][:, 0]
        times, half = self._times(grid[:-1], grid[1:])
        travelled = results_shared(motion, len(times), times, p)[0].reshape(-1, 8) @ self.weights * half
        start = results_shared(motion, 1, grid[:1], p)[3][0, 0]
        return start + np.concatenate([[0.0], np.cumsum(travelled)])

    def _times(self, begin: Array, end: Array) -> tuple[Array, Array]:
        """Nodes between times, one row after the other, and half of what lies between."""
        half = (end - begin) / 2
        return (begin[:, None] + half[:, None] * (1 + self.nodes)).ravel(), half


def _apart(times: list[float], margin: float) -> tuple[float, ...]:
    """Times that lie closer than rounding are one."""
    kept = times[:1]
    kept += [after for before, after in pairwise(times) if after - before > margin]
    return tuple(kept)
