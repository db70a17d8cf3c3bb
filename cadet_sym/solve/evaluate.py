"""Evaluate compiled functions at the pace of an integrator: through buffers, without copies."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from math import isfinite
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions

__all__ = [
    "HUGE", "Gains", "Rate", "behind", "depends_on", "gains", "gains_over", "give", "results", "results_over", "results_shared",
    "take",
]  # fmt: skip

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

STALLED = 500
"""Evaluations at one time after which an integrator stands still."""

HUGE = 1e150
"""Stands for a rate that is not finite."""


def give(buffer: Any, i: int, memory: Any) -> None:
    """Let a function's buffer read its i-th argument from the caller's memory."""
    buffer.set_arg(i, memoryview(memory))


def take(buffer: Any, i: int, memory: Any) -> None:
    """Let a function's buffer write its i-th result into the caller's memory."""
    buffer.set_res(i, memoryview(memory))


def results(function: ca.Function, *arguments: Array) -> list[Array]:
    """Each of a function's results as one vector, column by column: in a third of the time of a call of CasADi's."""
    buffer, evaluate = function.buffer()
    for i, argument in enumerate(arguments):
        give(buffer, i, argument)
    shapes = _shapes(function)
    found = [np.zeros(size) if places is None else np.empty(len(places)) for size, places in shapes]
    for i, result in enumerate(found):
        take(buffer, i, result)
    evaluate()
    for i, (size, places) in enumerate(shapes):
        if places is not None:
            entries, found[i] = found[i], np.zeros(size)
            found[i][places] = entries
    return found


def results_over(function: ca.Function, *arguments: Array) -> list[Array]:
    """The same at many places: arguments (k, size), results (k, size)."""
    k = len(arguments[0])
    many = _roomy(k)
    if many > k:  # once more at the last place, to no end
        arguments = tuple(np.concatenate([each, each[-1:].repeat(many - k, axis=0)]) for each in arguments)
    found = results(_mapped(function, many), *map(np.ascontiguousarray, arguments))
    return [result.reshape(many, -1)[:k] for result in found]


def results_shared(function: ca.Function, k: int, *arguments: Array) -> list[Array]:
    """The same at k places, which share the last argument."""
    return results_over(function, *arguments[:-1], arguments[-1][None].repeat(k, axis=0))


def _roomy(k: int) -> int:
    """A number of places that is not less, at most a quarter more, and one of few: for each a function is made."""
    step = 1 << max(k.bit_length() - 3, 0)
    return -(-k // step) * step


def depends_on(*dependences: ca.Sparsity) -> Places:
    """Entries of an argument on which results depend, from the patterns of their derivatives."""
    return np.unique(np.concatenate([np.array(each.get_col(), dtype=np.intp) for each in dependences]))


@lru_cache(maxsize=256)
def _shapes(function: ca.Function) -> list[tuple[int, Places | None]]:
    """Of every result its size and, unless it is dense, where its entries stand."""
    patterns = [function.sparsity_out(i) for i in range(function.n_out())]
    return [(s.numel(), None if s.is_dense() else np.array(s.find(), dtype=np.intp)) for s in patterns]


@lru_cache(maxsize=64)
def _mapped(function: ca.Function, k: int) -> ca.Function:
    """The function at k places."""
    return function if k == 1 else function.map(k)


class Rate:
    """dy/dt written into the caller's memory; counts its evaluations."""

    def __init__(self, lowered: MomentFunctions, p: Array) -> None:
        self.time, self.p = np.zeros(1), np.ascontiguousarray(p, dtype=float)
        self._into = _machine(lowered, self.time, self.p) or _virtual(lowered, self.time, self.p)
        self.count, self._last, self._same = 0, -1.0, 0

    @property
    def stalled(self) -> bool:
        """Whether time stands still: the steps have shrunk to nothing, as they do where a moment runs away."""
        return self._same > STALLED

    def __call__(self, t: float, y: Array, slope: Array) -> None:
        """Write dy/dt at (t, y) into `slope`."""
        self._same = self._same + 1 if abs(t - self._last) <= 1e-13 * abs(t) else 0
        if self.stalled:
            slope.fill(np.nan)
            return
        self.time[0] = t
        self._last = self._last if self._same else t
        self._into(y, slope)
        self.count += 1
        if not isfinite(slope.sum()):  # SUNDIALS shortens its step for what is huge, and trips over what is no number
            slope[~np.isfinite(slope)] = HUGE


def _machine(lowered: MomentFunctions, time: Array, p: Array) -> Callable[[Array, Array], None] | None:
    """The rate as machine code, where that is to be had."""
    code = lowered.machine("rate")
    if code is None:
        return None
    run = code.function("rate", *[ctypes.c_void_p] * 4)
    at, given = time.ctypes.data, p.ctypes.data
    return lambda y, slope: run(at, y.ctypes.data, given, slope.ctypes.data)


def _virtual(lowered: MomentFunctions, time: Array, p: Array) -> Callable[[Array, Array], None]:
    """The rate in CasADi's virtual machine."""
    buffer, evaluate = lowered.rate.buffer()
    give(buffer, 0, time)
    give(buffer, 2, p)

    def run(y: Array, slope: Array) -> None:
        give(buffer, 1, y)
        take(buffer, 0, slope)
        evaluate()

    return run


def behind(begin: float) -> float:
    """A time on a stretch's own side of its beginning: where an input jumps there, the rate at `begin` is that before it."""
    return begin + 4 * float(np.spacing(begin)) if begin > 0 else begin


class Gains:
    """N = E[df/dx] (n, n) at a time and packed moments, through buffers."""

    def __init__(self, lowered: MomentFunctions, p: Array) -> None:
        packing = self._packing = lowered.facts.packing
        given, N = np.ascontiguousarray(p, dtype=float), lowered.gain_matrix.sparsity_out(0)
        self._time, self._motion = np.zeros(1), np.zeros(4)  # V, V', s and where it starts
        self._y, self._context, self._entries = np.zeros(packing.moments), np.zeros(4), np.zeros(N.nnz())
        self._rows, self._columns = (np.array(part, dtype=np.intp) for part in N.get_triplet())
        self._kept = given  # the buffers read from it
        motion, self._move = lowered.motion.buffer()
        give(motion, 0, self._time)
        give(motion, 1, given)
        for i in range(4):
            take(motion, i, self._motion[i : i + 1])
        gain, self._evaluate = lowered.gain_matrix.buffer()
        for i, part in enumerate((self._y, self._context, given)):
            give(gain, i, part)
        take(gain, 0, self._entries)
        self._buffers = motion, gain

    def __call__(self, t: float, y: Array) -> Array:
        """N at one time and the moments there."""
        self._time[0] = t
        self._move()
        V, dV, s, _ = self._motion
        self._context[:] = t, y[self._packing.moments] if self._packing.distance else s, V, dV
        self._y[:] = y[: self._packing.moments]
        self._evaluate()
        N = np.zeros((self._packing.n, self._packing.n))
        N[self._rows, self._columns] = self._entries
        return N


def gains(lowered: MomentFunctions, t: float, y: Array, p: Array) -> Array:
    """N (n, n) at packed moments y."""
    return Gains(lowered, p)(t, y)


def gains_over(lowered: MomentFunctions, time: Array, y: Array, p: Array) -> Array:
    """N (k, n, n) at times (k,), packed moments (k, size) and parameters (k, count)."""
    packing = lowered.facts.packing
    V, dV, s, _ = (part[:, 0] for part in results_over(lowered.motion, time, p))
    context = np.stack([time, y[:, packing.moments] if packing.distance else s, V, dV], axis=1)
    (N,) = results_over(lowered.gain_matrix, y[:, : packing.moments], context, p)
    return N.reshape(-1, packing.n, packing.n).transpose(0, 2, 1)
