"""Hold a compiled model still: its moment equations at one speed, one instant and one set of parameters."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError, SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.frozen import FrozenProblem, WheelTrack

__all__ = ["Conditions", "conditions", "context_at", "freeze"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Conditions:
    """What is held still: the context [t, s, V, V'] and the parameters."""

    context: Array  # (4,)
    p: Array


def conditions(
    lowered: MomentFunctions, p: Array, speed: float | None = None, at: float | None = None
) -> Conditions:
    """The speed asked for, or that of the model at the start (or at the instant `at`), held constant (V' = 0).

    Raises
    ------
    ModelError
        If the vehicle stands still, or a rate depends on t or s and no instant is named.
    """
    facts = lowered.facts
    context = context_at(lowered, p, 0.0 if at is None else at)
    V = float(context[2])
    if not facts.ground:
        V = 0.0
        if speed is not None:
            raise ModelError(f"a speed of {speed:g} was given, but the model has no ground to travel on.")
    elif speed is not None:
        if not (np.isfinite(speed) and speed > 0):
            raise ModelError(f"the speed is {speed:g}; stationary moments need a positive one.")
        V = float(speed)
    elif V <= 0:
        raise ModelError(
            f"the vehicle's speed is {V:g} at t = {0 if at is None else at:g}, where nothing excites it: "
            "name the speed to hold with --speed V (in Python `stationary(speed=V)`)."
        )
    if at is None and facts.explicit:
        raise ModelError(
            f"{facts.explicit} explicitly, so that there is no stationary state. "
            "Freeze it at an instant with --at T (in Python `stationary(at=T)`)."
        )
    context[2:] = V, 0.0
    return Conditions(context, p)


def freeze(lowered: MomentFunctions, held: Conditions) -> FrozenProblem:
    """The stationary moment equations in plain numbers.

    Raises
    ------
    SolverError
        If a coefficient is not finite there.
    """
    A, c, b, C, d, D = (np.asarray(part, dtype=float) for part in lowered.linear(held.context, held.p))
    for name, part in zip(("A", "c", "b", "C", "d", "D"), (A, c, b, C, d, D), strict=True):
        if not np.isfinite(part).all():
            raise SolverError(f"the coefficients {name} of the model are not finite; check the parameters.")
    n = len(A)
    counts = lowered.facts.arguments
    return FrozenProblem(
        A=A,
        c=c.ravel(),
        b=b.reshape(n, -1),
        C=C.reshape(-1, n),
        d=d.ravel(),
        D=D,
        owner=np.repeat(np.arange(len(counts)), counts),
        elements=_Elements(lowered.elements, held),
        tracks=_tracks(lowered, held),
        states=lowered.facts.states,
    )


class _Elements:
    """theta -> F, gain and their derivatives, evaluated in buffers."""

    def __init__(self, function: ca.Function, held: Conditions) -> None:
        self.buffer: Any  # by its types the size is to be said too
        self.buffer, self.trigger = function.buffer()
        self.inputs = [
            np.zeros(function.nnz_in(0)),
            np.ascontiguousarray(held.context, dtype=float),
            np.ascontiguousarray(held.p, dtype=float),
        ]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(4)]
        for k, value in enumerate(self.inputs):
            self.buffer.set_arg(k, memoryview(value))
        for k, value in enumerate(self.results):
            self.buffer.set_res(k, memoryview(value.data))
        self.slopes = [_placement(function.sparsity_out(k)) for k in (2, 3)]
        self.shapes = [function.size_out(k) for k in (2, 3)]

    def __call__(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        self.inputs[0][:] = theta
        self.trigger()
        F, gain, *values = self.results
        slopes = []
        for (rows, columns), shape, value in zip(self.slopes, self.shapes, values, strict=True):
            slope = np.zeros(shape)
            slope[rows, columns] = value
            slopes.append(slope)
        return F.copy(), gain.copy(), slopes[0], slopes[1]


def _placement(sparsity: ca.Sparsity) -> tuple[list[int], list[int]]:
    rows, columns = sparsity.get_triplet()
    return list(rows), list(columns)


def _tracks(lowered: MomentFunctions, held: Conditions) -> tuple[WheelTrack, ...]:
    """The wheels that follow each other, at the speed held."""
    delay = lowered.facts.delay
    if delay is None:
        return ()
    inputs, intensity, setbacks = (
        np.asarray(part, dtype=float) for part in lowered.noise(held.context, held.p)
    )
    V = float(held.context[2])
    found = []
    for track in delay.tracks:
        places = [float(setbacks.ravel()[columns[0]]) for columns in track.columns]
        first = list(track.columns[0])
        found.append(
            WheelTrack(
                speed=V,
                times=tuple((b - a) / V for a, b in itertools.pairwise(places)),
                inputs=tuple(inputs[:, list(columns)] for columns in track.columns),
                intensity=intensity[np.ix_(first, first)],
            )
        )
    return tuple(found)


def context_at(lowered: MomentFunctions, p: Array, t: float) -> Array:
    """[t, s, V, V'] of a run at time t; the distance s only where anything depends on it, or it is known in closed form."""
    V, dV, s, start = (float(value) for value in lowered.motion(t, p))
    if lowered.facts.needs_distance and not lowered.facts.known_distance:
        from scipy.integrate import quad

        s = start + quad(lambda at: float(lowered.motion(at, p)[0]), 0.0, t, limit=500)[0]
    return np.array([t, s, V, dV])
