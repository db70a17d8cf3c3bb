"""The whole moment system at rest: a stationary point as packed moments, with the ground between the wheels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cadet_sym.delay import Gap, radau
from cadet_sym.errors import ModelError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.freeze import conditions, freeze
from cadet_sym.solve.frozen import WheelTrack
from cadet_sym.solve.stationary import stationary_point

__all__ = ["steady_start"]

Array = npt.NDArray[np.float64]


def steady_start(lowered: MomentFunctions, p: Array) -> Array:
    """Packed moments of the stationary state at the initial speed, the speed held, t = 0.

    Raises
    ------
    ModelError
        If a state drifts, so that the whole has no stationary state.
    SolverError
        If there is no stationary solution.
    """
    facts = lowered.facts
    held = conditions(lowered, p, at=0.0)
    problem = freeze(lowered, held)
    point = stationary_point(problem)
    if point.drifting.any():
        names = ", ".join(f"`{n}`" for n, drifts in zip(facts.states, point.drifting, strict=True) if drifts)
        raise ModelError(
            f'[initial] whole = "stationary": {names} drift{"s" if point.drifting.sum() == 1 else ""} without bound, '
            "so that the whole has no stationary state. Give the states their initial values one by one."
        )
    parts = [facts.packing.pack(point.mean, point.covariance)]
    if facts.packing.distance:
        parts.append(np.array([held.context[1]]))
    if facts.delay is not None:
        y = parts[0]
        N = np.asarray(lowered.gain_matrix(y, held.context, p))
        for track, wheels in zip(facts.delay.tracks, problem.tracks, strict=True):
            parts.append(_correlation(track.gaps, wheels, N))
    return np.concatenate(parts)


def _correlation(gaps: tuple[Gap, ...], wheels: WheelTrack, N: Array) -> Array:
    """G at the nodes in steady travel: V G_theta = N G, solved with the collocation itself."""
    tail, nodes = np.zeros_like(wheels.inputs[0]), []
    for gap, time, b in zip(gaps, wheels.times, wheels.inputs, strict=False):
        tail = tail + b
        _, D = radau(gap.nodes)
        n = len(N)
        matrix = np.kron(D[:, 1:], np.eye(n)) - np.kron(np.eye(gap.nodes), N * (time / gap.elements))
        for _ in range(gap.elements):
            values = np.linalg.solve(matrix, -np.kron(D[:, :1], tail))
            nodes.append(values.reshape(gap.nodes, n, -1).transpose(0, 2, 1).ravel())
            tail = values[-n:]
    return np.concatenate(nodes)
