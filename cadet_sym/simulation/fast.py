"""The compiled kernel: paths in blocks of `LANES`, ground and vehicle by turns in windows that stay in the cache.

Imported only when it is wanted, because numba is slow to import. What it computes is what `plain` computes.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numba
import numpy as np
from numba import types

from cadet_sym.simulation.step import LANES
from cadet_sym.simulation.streams import BASE, GOLDEN, HEIGHT, MIX, TAIL, WIDTH, Streams, start_values
from cadet_sym.simulation.tables import GroundTables, OutputTables, StartTables, StepTables
from cadet_sym.simulation.translated import ADVANCE, BOX, INT, RECORD, TABLE, VECTOR, compile_program, jit

__all__ = ["run_paths"]

WINDOW = 128  # steps whose ground is held at a time; even, so that a pair of steps is never cut
_SCALED = WIDTH * BASE
_MIX_1, _MIX_2 = MIX


def _mix(z):
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))


_mix = jit(_mix)


def _unit(bits):
    return (np.float64(np.int64(bits >> np.uint64(11))) + 0.5) * BASE


_unit = jit(_unit)


def _resume(bits):
    """What a draw that missed its layer's inner rectangle becomes (see `streams`)."""
    while True:
        layer = np.int64(bits & np.uint64(255))
        x = np.float64(np.int64(bits >> np.uint64(11))) * _SCALED[layer]
        sign = -1.0 if bits & np.uint64(256) else 1.0
        if x < WIDTH[layer + 1]:
            return sign * x
        if layer == 0:
            while True:
                bits = _mix(bits + GOLDEN)
                a = -math.log(_unit(bits)) / TAIL
                bits = _mix(bits + GOLDEN)
                if -2.0 * math.log(_unit(bits)) > a * a:
                    return sign * (TAIL + a)
        u = _unit(_mix(bits ^ GOLDEN))
        if HEIGHT[layer] + u * (HEIGHT[layer + 1] - HEIGHT[layer]) < math.exp(-0.5 * x * x):
            return sign * x
        bits = _mix(bits + GOLDEN)


_resume = jit(_resume)


def _draw(state, gamma, out, place, count, bits, late):
    """Draw `count` normal deviates for each of the lanes into out[place:], without a branch but for rejects."""
    for k in range(count):
        o = place + k * LANES
        for l in range(LANES):
            moved = state[l] + gamma[l]
            state[l] = moved
            bits[l] = _mix(moved)
        waiting = 0
        for l in range(LANES):
            b = bits[l]
            layer = np.int64(b & np.uint64(255))
            x = np.float64(np.int64(b >> np.uint64(11))) * _SCALED[layer]
            out[o + l] = x * (1.0 - 2.0 * np.float64(np.int64((b >> np.uint64(8)) & np.uint64(1))))
            late[waiting] = l
            waiting += x >= WIDTH[layer + 1]
        for j in range(waiting):
            out[o + late[j]] = _resume(bits[late[j]])


_draw = jit(_draw)


def _follow(laws, first, r, work, ring, place):
    """Next node of a chain, ring[place:] = law @ work for all lanes; work holds the node before and deviates.

    Eight lanes at a time in registers; the deviates' part is lower triangular.
    """
    for a in range(r):
        for h in range(0, LANES, 8):
            s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
            for b in range(r + a + 1):
                m, w = laws[first + 2 * r * a + b], b * LANES + h
                s0 += m * work[w]
                s1 += m * work[w + 1]
                s2 += m * work[w + 2]
                s3 += m * work[w + 3]
                s4 += m * work[w + 4]
                s5 += m * work[w + 5]
                s6 += m * work[w + 6]
                s7 += m * work[w + 7]
            o = place + a * LANES + h
            ring[o], ring[o + 1], ring[o + 2], ring[o + 3] = s0, s1, s2, s3
            ring[o + 4], ring[o + 5], ring[o + 6], ring[o + 7] = s4, s5, s6, s7


_follow = jit(_follow)


def _fill(g, n0, n1, G, ring, made, sums, state, gamma):
    """Rows of the nodes n0 .. n1: filter states under each wheel, and noises in time summed since the start."""
    largest = g.noises
    for r in g.size:
        largest = max(largest, 2 * r)
    work = np.zeros((largest + 1) * LANES)
    bits, late = np.zeros(LANES, np.uint64), np.zeros(LANES + 1, np.int64)
    for node in range(n0, n1 + 1):
        top = (node - n0) * g.width
        for track in range(made.shape[0]):
            r, base, room = g.size[track], g.ring_start[track], g.ring_room[track]
            while made[track] < g.pick[g.leader[track], node]:
                made[track] += 1
                j = made[track]
                before = (base + ((j - 1) % room) * r) * LANES
                for l in range(r * LANES):
                    work[l] = ring[before + l]
                _draw(state[2 + track], gamma[2 + track], work, r * LANES, r, bits, late)
                law = g.law_of[g.law_start[track] + j - 1]
                _follow(g.laws, law, r, work, ring, (base + (j % room) * r) * LANES)
        for copy in range(g.pick.shape[0]):
            track = g.track_of[copy]
            r, first = g.size[track], g.row_of[copy]
            o = (g.ring_start[track] + (g.pick[copy, node] % g.ring_room[track]) * r) * LANES
            for l in range(r * LANES):
                G[(top + first) * LANES + l] = ring[o + l]
        if g.has_mean:
            for a in range(g.mean.shape[1]):
                for l in range(LANES):
                    G[(top + a) * LANES + l] += g.mean[node, a]
        if g.noises > 0:
            if node > n0:
                _draw(state[1], gamma[1], work, 0, g.noises, bits, late)
                if g.mix.shape[0] > 0:
                    law = g.mix_of[node - 1]
                    for a in range(g.noises):
                        for l in range(LANES):
                            s = 0.0
                            for b in range(a + 1):
                                s += g.mix[law, a, b] * work[b * LANES + l]
                            sums[a * LANES + l] = s
                else:
                    for l in range(g.noises * LANES):
                        sums[l] += g.root_step[node - 1] * work[l]
            o = (top + g.width - g.noises) * LANES
            for l in range(g.noises * LANES):
                G[o + l] = sums[l]


def _run(advance, record, fill, g, map_, fine, coarse, out, state, gamma, behind, delta, R, R2):
    """All paths of a group; `coarse` tables have half the steps of `fine` ones, or none if no pair is wanted."""
    width, paired = g.width, coarse.H.shape[0] > 0
    ring = np.empty(max(1, g.ring_rows) * LANES)
    made, sums = np.zeros(g.ring_start.shape[0], np.int64), np.zeros(max(1, g.noises) * LANES)
    G = np.zeros((WINDOW + 1) * width * LANES)
    X, Y = np.zeros(delta.shape[0] * LANES), np.zeros(delta.shape[0] * LANES)
    own, step = np.empty((state.shape[0], LANES), np.uint64), np.empty((state.shape[0], LANES), np.uint64)
    for first in range(0, R.shape[2], LANES):
        for purpose in range(state.shape[0]):
            for l in range(LANES):
                own[purpose, l], step[purpose, l] = state[purpose, first + l], gamma[purpose, first + l]
        for l in range(sums.shape[0]):
            sums[l] = 0.0
        row = 0
        for track in range(made.shape[0]):
            made[track] = 0
            for a in range(g.size[track]):
                for l in range(LANES):
                    ring[(g.ring_start[track] + a) * LANES + l] = behind[row, first + l]
                row += 1
        k = 0
        for n0 in range(0, fine.H.shape[0], WINDOW):
            n1 = min(n0 + WINDOW, fine.H.shape[0])
            fill(g, n0, n1, G, ring, made, sums, own, step)
            if n0 == 0:
                for a in range(delta.shape[0]):
                    for l in range(LANES):
                        x = delta[a, first + l]
                        for b in range(map_.shape[1]):
                            x += map_[a, b] * G[b * LANES + l]
                        X[a * LANES + l] = x
                        Y[a * LANES + l] = x
            i = n0
            while True:
                if k < out.node.shape[0] and out.node[k] == i:
                    record(X, G, i - n0, out.C, out.q, out.T, R, k, first)
                    if paired:
                        record(Y, G, i - n0, out.C, out.q, out.T, R2, k, first)
                    k += 1
                if i == n1:
                    break
                stop = min(n1, out.node[k]) if k < out.node.shape[0] else n1
                advance(X, G, 1, i - n0, i, stop, fine.S, fine.E, fine.K, fine.H, fine.q, fine.T)
                if paired:
                    advance(Y, G, 2, i - n0, i // 2, stop // 2, coarse.S, coarse.E, coarse.K, coarse.H, fine.q, fine.T)
                i = stop


@lru_cache(maxsize=1)
def _compiled() -> tuple[Any, Any]:
    """`_run` and `_fill`, compiled once for all models: what differs between these is called through a pointer."""
    vector, table = np.zeros(0), np.zeros((0, 0))
    ints, box = np.zeros(0, np.int64), np.zeros((0, 0, 0))
    ground = numba.typeof(
        GroundTables(
            0, ints, vector, ints, ints, ints.reshape(0, 0), ints, ints, ints, ints, ints, 0, False, table, 0, vector, box, ints
        )
    )
    steps = numba.typeof(StepTables(table, table, table, vector, vector, vector))
    out = numba.typeof(OutputTables(ints, 0, table, vector, vector))
    streams, whole = types.Array(types.uint64, 2, "C"), types.Array(INT, 1, "C")
    filling = types.void(ground, INT, INT, VECTOR, VECTOR, whole, VECTOR, streams, streams)
    calls = (types.FunctionType(s) for s in (ADVANCE, RECORD, filling))
    running = types.void(*calls, ground, TABLE, steps, steps, out, streams, streams, TABLE, TABLE, BOX, BOX)
    return jit(_run, running), jit(_fill, filling)


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
    paths = len(streams[0].state)
    delta, behind = start_values(start, streams)
    # The last block is filled up with paths that nobody reads.
    lanes = -(-paths // LANES) * LANES
    delta, behind, state, gamma = (
        np.ascontiguousarray(np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, lanes - paths)], mode="edge"))
        for values in (delta, behind, *(np.stack([getattr(s, n) for s in streams]) for n in ("state", "gamma")))
    )
    R = np.empty((len(out.node), out.rows, lanes))
    R2 = np.empty(R.shape if len(coarse.H) else (0, 0, 0))
    run, fill = _compiled()
    run(*compile_program(source), fill, ground, start.map, fine, coarse, out, state, gamma, behind, delta, R, R2)
    return R[:, :, :paths], R2[:, :, :paths]
