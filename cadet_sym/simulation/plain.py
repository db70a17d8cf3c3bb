"""The kernel without a compiler: the same paths by NumPy, all paths of a group at once, some five times slower."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from cadet_sym.simulation.curves import lookup
from cadet_sym.simulation.streams import Streams, start_values
from cadet_sym.simulation.tables import GroundTables, OutputTables, StartTables, StepTables

__all__ = ["run_paths"]

_UFUNCS = ("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "fabs", "sign", "minimum", "maximum")
_NAMESPACE: dict[str, Any] = {
    **{name: getattr(np, name) for name in (*_UFUNCS, "where", "power", "heaviside")},
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "erf": np.vectorize(math.erf, otypes=[float]),
    "not_": np.logical_not,
    "lookup": lookup,
    "nan": np.nan,
    "inf": np.inf,
}


@lru_cache(maxsize=64)
def _program(source: str) -> tuple[Any, Any]:
    scope = dict(_NAMESPACE)
    exec(compile(source, "<cadet_sym.simulation>", "exec"), scope)
    return scope["advance"], scope["record"]


class _Ground:
    """The ground under all wheels, node by node."""

    def __init__(self, tables: GroundTables, streams: list[Streams], behind: np.ndarray):
        self.t, self.streams, self.paths = tables, streams, behind.shape[1]
        self.rings = [np.zeros((n, r, self.paths)) for n, r in zip(tables.ring_room, tables.size, strict=True)]
        self.made = [0] * len(self.rings)
        self.sums = np.zeros((tables.noises, self.paths))
        for ring, first in zip(self.rings, np.split(behind, np.cumsum(tables.size)[:-1]), strict=False):
            ring[0] = first

    def node(self, node: int) -> np.ndarray:
        """Rows of one node; nodes are asked for in order."""
        t = self.t
        rows = np.zeros((t.width, self.paths))
        for track, ring in enumerate(self.rings):
            while self.made[track] < t.pick[t.leader[track], node]:
                self._extend(track, ring)
        for copy, track in enumerate(t.track_of):
            first = t.row_of[copy]
            rows[first : first + t.size[track]] = self.rings[track][t.pick[copy, node] % t.ring_room[track]]
        if t.has_mean:
            rows[: t.mean.shape[1]] += t.mean[node][:, None]
        if t.noises:
            if node > 0:
                deviates = self.streams[1].normals(t.noises)
                if len(t.mix):
                    self.sums = t.mix[t.mix_of[node - 1]] @ deviates
                else:
                    self.sums = self.sums + t.root_step[node - 1] * deviates
            rows[t.width - t.noises :] = self.sums
        return rows

    def _extend(self, track: int, ring: np.ndarray) -> None:
        t, r = self.t, self.t.size[track]
        self.made[track] += 1
        j = self.made[track]
        first = t.law_of[t.law_start[track] + j - 1]
        law = t.laws[first : first + 2 * r * r].reshape(r, 2 * r)
        ring[j % len(ring)] = law @ np.concatenate([ring[(j - 1) % len(ring)], self.streams[2 + track].normals(r)])


def run_paths(
    source: str,
    ground: GroundTables,
    start: StartTables,
    fine: StepTables,
    coarse: StepTables,
    out: OutputTables,
    streams: list[Streams],
) -> tuple[np.ndarray, np.ndarray]:
    """Records (times, rows, paths) of the paths whose streams are given, and of the same with steps twice as long."""
    advance, record = _program(source)
    paths, paired = len(streams[0].state), len(coarse.H) > 0
    R = np.empty((len(out.node), out.rows, paths))
    R2 = np.empty(R.shape if paired else (0, 0, 0))
    delta, behind = start_values(start, streams)
    road = _Ground(ground, streams, behind)
    G = np.zeros((3, ground.width, paths))  # the nodes of the last two steps
    G[0] = road.node(0)
    X = delta + start.map @ G[0, : start.map.shape[1]]
    Y, k = X.copy(), 0
    with np.errstate(all="ignore"):
        for i in range(len(fine.H) + 1):
            here = 0 if i == 0 else 2 if paired and i % 2 == 0 else 1
            if i > 0:
                G[here] = road.node(i)
                advance(X, G, 1, here - 1, i - 1, i, fine.S, fine.E, fine.K, fine.H, fine.q, fine.T)
                if paired and i % 2 == 0:
                    advance(Y, G, 2, 0, i // 2 - 1, i // 2, coarse.S, coarse.E, coarse.K, coarse.H, fine.q, fine.T)
            if k < len(out.node) and out.node[k] == i:
                record(X, G, here, out.C, out.q, out.T, R, k, 0)
                if paired:
                    record(Y, G, here, out.C, out.q, out.T, R2, k, 0)
                k += 1
            if i > 0 and (here == 2 or not paired):
                G[0] = G[here]
    return R, R2
