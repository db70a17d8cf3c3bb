"""The whole moment system at rest: a stationary point as packed moments, with the ground between the wheels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cadet_sym.delay import DelayGrid, Gap, transport_matrix
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
        parts += _packed(facts.delay, problem.tracks, N)
    return np.concatenate(parts)


def _packed(grid: DelayGrid, tracks: tuple[WheelTrack, ...], N: Array) -> list[Array]:
    """G in steady travel as it is packed: what is carried, then what is known."""
    carried, known = [], []
    for track, wheels in zip(grid.tracks, tracks, strict=True):
        for gap, modes in zip(track.gaps, _correlation(track.gaps, wheels, N), strict=True):
            carried.append(modes[:, :, : grid.rows].ravel())
            known.append(modes[:, :, list(gap.known)].ravel())
    return carried + known


def _correlation(gaps: tuple[Gap, ...], wheels: WheelTrack, N: Array) -> list[Array]:
    """Modes (all of a gap, q, n) of G in steady travel: V G_theta = N G, solved in the discrete form itself."""
    tail, found, n = np.zeros_like(wheels.inputs[0]), [], len(N)
    for gap, time, b in zip(gaps, wheels.times, wheels.inputs, strict=False):
        tail = tail + b
        T, e = transport_matrix(gap.modes)
        matrix = np.kron(T, np.eye(n)) - np.kron(np.eye(gap.modes), N * (time / gap.elements))
        modes = []
        for _ in range(gap.elements):
            values = np.linalg.solve(matrix, -np.kron(e[:, None], tail)).reshape(gap.modes, n, -1)
            modes.append(values.transpose(0, 2, 1))
            tail = values[-1]
        found.append(np.concatenate(modes))
    return found
