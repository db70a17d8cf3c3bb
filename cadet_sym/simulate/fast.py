"""The compiled kernel: paths in blocks of `LANES`, ground and vehicle by turns in windows that stay in the cache.

Imported only when it is wanted, because numba is slow to import. What it computes is what `plain` computes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numpy as np

from cadet_sym.simulate.curves import PIECE
from cadet_sym.simulate.tables import GroundTables, OutputTables, StartTables, StepTables
from cadet_sym.simulate.program import LANES
from cadet_sym.simulate.streams import BASE, GOLDEN, HEIGHT, MIX, TAIL, WIDTH

__all__ = ["compile_program", "run_paths"]

WINDOW = 128  # steps whose ground is held at a time; even, so that a pair of steps is never cut
_SCALED = WIDTH * BASE
_MIX_1, _MIX_2 = MIX


def _jit(function: Callable[..., Any], *, cache: bool = True) -> Any:
    """Compile without the interpreter's lock; keep the machine code on disk where there is a place for it."""
    options = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(function, cache=cache, **options)
    except RuntimeError:  # no folder can be written to
        return numba.njit(function, **options)


def _mix(z):
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))


_mix = _jit(_mix)


def _unit(bits):
    return (np.float64(np.int64(bits >> np.uint64(11))) + 0.5) * BASE


_unit = _jit(_unit)


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


_resume = _jit(_resume)


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


_draw = _jit(_draw)


def _combine(matrix, rows, columns, vector, out, place):
    """out[place:] = matrix @ vector for all lanes."""
    for a in range(rows):
        o = place + a * LANES
        for l in range(LANES):
            out[o + l] = 0.0
        for b in range(columns):
            m = matrix[a, b]
            if m != 0.0:
                for l in range(LANES):
                    out[o + l] += m * vector[b * LANES + l]


_combine = _jit(_combine)


def _fill(g, n0, n1, G, ring, made, sums, state, gamma, work, bits, late):
    """Rows of the nodes n0 .. n1: filter states under each wheel, and noises in time summed since the start."""
    r, noises = g.size, g.noises
    for node in range(n0, n1 + 1):
        top = (node - n0) * g.width * LANES
        for track in range(made.shape[0]):
            base, room = g.ring_start[track] * r * LANES, g.ring_room[track]
            while made[track] < g.pick[g.leader[track], node]:
                made[track] += 1
                j = made[track]
                before = base + ((j - 1) % room) * r * LANES
                for l in range(r * LANES):
                    work[l] = ring[before + l]
                _draw(state[2 + track], gamma[2 + track], work, r * LANES, r, bits, late)
                law = g.laws[g.law_of[g.law_start[track] + j - 1]]
                _combine(law, r, 2 * r, work, ring, base + (j % room) * r * LANES)
        for copy in range(g.pick.shape[0]):
            track = g.track_of[copy]
            o = (g.ring_start[track] + g.pick[copy, node] % g.ring_room[track]) * r * LANES
            for a in range(r):
                shift = g.mean[copy, node, a] if g.has_mean else 0.0
                for l in range(LANES):
                    G[top + (copy * r + a) * LANES + l] = ring[o + a * LANES + l] + shift
        if noises > 0:
            if node > n0:
                _draw(state[1], gamma[1], work, 0, noises, bits, late)
                for l in range(noises * LANES):
                    sums[l] += g.root_step[node - 1] * work[l]
            o = top + (g.width - noises) * LANES
            for l in range(noises * LANES):
                G[o + l] = sums[l]


_fill = _jit(_fill)


def _begin(g, start, G, X, ring, made, sums, state, gamma, work, bits, late):
    """Draw the ground behind the start and the vehicle's initial state; leave node 0 in G."""
    nv = start.offset.shape[0]
    made[:] = 0
    sums[:] = 0.0
    for track in range(made.shape[0]):
        _draw(state[2 + track], gamma[2 + track], work, 0, g.size, bits, late)
        _combine(g.root, g.size, g.size, work, ring, g.ring_start[track] * g.size * LANES)
    _fill(g, 0, 0, G, ring, made, sums, state, gamma, work, bits, late)
    _draw(state[0], gamma[0], work, 0, nv, bits, late)
    _combine(start.root, nv, nv, work, X, 0)
    for a in range(nv):
        for l in range(LANES):
            x = X[a * LANES + l] + start.offset[a]
            for b in range(start.map.shape[1]):
                x += start.map[a, b] * G[b * LANES + l]
            X[a * LANES + l] = x


_begin = _jit(_begin)


def _run(advance, record, g, start, fine, coarse, out, state, gamma, R, R2):
    """All paths of a group; `coarse` tables have half the steps of `fine` ones, or none if no pair is wanted."""
    nv, width, paired = start.offset.shape[0], g.width, coarse.H.shape[0] > 0
    ring = np.empty(max(1, g.ring_total * g.size * LANES))
    made, sums = np.zeros(g.ring_start.shape[0], np.int64), np.zeros(max(1, g.noises) * LANES)
    G = np.zeros((WINDOW + 1) * width * LANES)
    X, Y = np.zeros(nv * LANES), np.zeros(nv * LANES)
    work = np.zeros(max(2 * g.size, nv, g.noises, 1) * LANES)
    bits, late = np.zeros(LANES, np.uint64), np.zeros(LANES + 1, np.int64)
    for first in range(0, R.shape[2], LANES):
        own, step = state[:, first : first + LANES].copy(), gamma[:, first : first + LANES].copy()
        _begin(g, start, G, X, ring, made, sums, own, step, work, bits, late)
        Y[:] = X
        k = 0
        if out.node[0] == 0:
            record(X, G, 0, out.C, out.q, out.T, R, 0, first)
            if paired:
                record(Y, G, 0, out.C, out.q, out.T, R2, 0, first)
            k = 1
        for n0 in range(0, fine.H.shape[0], WINDOW):
            n1 = min(n0 + WINDOW, fine.H.shape[0])
            _fill(g, n0, n1, G, ring, made, sums, own, step, work, bits, late)
            i = n0
            while i < n1:
                stop = min(n1, out.node[k]) if k < out.node.shape[0] else n1
                here = G[(i - n0) * width * LANES :]
                advance(X, here, 1, fine.S[i:stop], fine.E[i:stop], fine.K[i:stop], fine.H[i:stop], fine.q, fine.T)
                if paired:
                    a, b = i // 2, stop // 2
                    advance(Y, here, 2, coarse.S[a:b], coarse.E[a:b], coarse.K[a:b], coarse.H[a:b], fine.q, fine.T)
                i = stop
                if k < out.node.shape[0] and out.node[k] == i:
                    record(X, G, i - n0, out.C, out.q, out.T, R, k, first)
                    if paired:
                        record(Y, G, i - n0, out.C, out.q, out.T, R2, k, first)
                    k += 1


_run = _jit(_run, cache=False)


def _where(condition, a, b):
    return a if condition else b


def _minimum(a, b):
    return a if a < b or a != a else b


def _maximum(a, b):
    return a if a > b or a != a else b


def _sign(z):
    return 1.0 if z > 0.0 else (-1.0 if z < 0.0 else 0.0 * z)


def _heaviside(z, at_zero):
    return 1.0 if z > 0.0 else (0.0 if z < 0.0 else (at_zero if z == 0.0 else z))


def _power(a, b):
    return math.pow(a, b)


def _not(condition):
    return not condition


def _lookup(z, table, first, count):
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if z < table[first + middle]:
            high = middle
        else:
            low = middle + 1
    p = first + count + PIECE * low
    d = z - table[p]
    return table[p + 1] + d * (table[p + 2] + d * (table[p + 3] + d * table[p + 4]))


_NAMES = ("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "erf")
NAMESPACE: dict[str, Any] = {
    **{name: getattr(math, name) for name in (*_NAMES, "fabs", "nan", "inf")},
    "LANES": LANES,
    **{
        name: numba.njit(function, error_model="numpy")
        for name, function in {
            "where": _where,
            "minimum": _minimum,
            "maximum": _maximum,
            "sign": _sign,
            "heaviside": _heaviside,
            "power": _power,
            "not_": _not,
            "lookup": _lookup,
        }.items()
    },
}


@lru_cache(maxsize=64)
def compile_program(source: str) -> tuple[Any, Any]:
    """`advance` and `record` of a program, compiled (at their first call)."""
    scope = dict(NAMESPACE)
    exec(compile(source, "<cadet_sym.simulate>", "exec"), scope)
    return _jit(scope["advance"], cache=False), _jit(scope["record"], cache=False)


def run_paths(
    source: str,
    ground: GroundTables,
    start: StartTables,
    fine: StepTables,
    coarse: StepTables,
    out: OutputTables,
    state: np.ndarray,
    gamma: np.ndarray,
    paired: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Records (times, rows, paths) of the paths whose streams are given, and of the same with steps twice as long."""
    count = state.shape[1]
    lanes = -(-count // LANES) * LANES
    if lanes > count:  # the last block is filled up with paths that nobody reads
        state, gamma = (np.pad(s, ((0, 0), (0, lanes - count)), mode="edge") for s in (state, gamma))
    R = np.empty((out.node.shape[0], out.rows, lanes))
    R2 = np.empty(R.shape if paired else (0, 0, 0))
    _run(*compile_program(source), ground, start, fine, coarse, out, state, gamma, R, R2)
    return R[:, :, :count], R2[:, :, :count]
