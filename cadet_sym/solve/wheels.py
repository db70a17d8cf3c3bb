"""How finely the ground between two wheels must be resolved, from the modes that travel across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cadet_sym.delay import STANDING, choose_grid, grid_error
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory

__all__ = ["present_error", "suitable_grid"]

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-6
"""Error accepted in what the ground between two wheels does, when the grid there is chosen automatically."""

SLOWEST = 0.05
"""Speeds below this share of the highest are left out: the ground hardly excites anything there."""

SPEEDS = 8
"""Number of a run's speeds that are looked at."""


def suitable_grid(lowered: MomentFunctions, p: Array, moments: Array, duration: float) -> tuple[int, int]:
    """The cheapest grid that resolves the modes of N at these moments over the speeds of a run (see `choose_grid`)."""
    exponents, rests = _exponents(lowered, p, moments, duration)
    return choose_grid(exponents, TOLERANCE, rests=rests)[0]


def present_error(lowered: MomentFunctions, p: Array, moments: Array, duration: float) -> float:
    """Estimated error of the grid that the equations have, for the gains at these moments."""
    delay = lowered.facts.delay
    assert delay is not None
    exponents, _ = _exponents(lowered, p, moments, duration)
    grids = {(gap.elements, gap.modes) for track in delay.tracks for gap in track.gaps}
    return max(grid_error(exponents[exponents.real <= 0], *grid) for grid in grids)


@dataclass(frozen=True)
class _Travel:
    """What a run's travel asks of the grids: speeds, lengths of the gaps, and whether the vehicle stands somewhere."""

    speeds: tuple[float, ...]
    lengths: Array
    rests: bool


_known: Memory[_Travel] = Memory()


def _travel(lowered: MomentFunctions, p: Array, duration: float) -> _Travel:
    """The travel of a run, remembered for the next of the same."""
    return _known(lowered, (duration, p.tobytes()), lambda: _look_along(lowered, p, duration))


def _look_along(lowered: MomentFunctions, p: Array, duration: float) -> _Travel:
    delay = lowered.facts.delay
    assert delay is not None
    times = np.linspace(0.0, duration, 257)
    speeds = np.asarray(lowered.motion.map(len(times))(times[None, :], np.tile(p[:, None], len(times)))[0]).ravel()
    fastest = float(speeds.max(initial=0.0))
    scale = fastest if fastest > STANDING else 1.0
    moving = np.unique((speeds[speeds >= SLOWEST * fastest] / scale).round(6)) * scale if scale == fastest else np.ones(1)
    setbacks = np.asarray(lowered.noise(np.zeros(4), p)[2]).ravel()
    places = [[float(setbacks[columns[0]]) for columns in track.columns] for track in delay.tracks]
    chosen = np.unique(np.linspace(0, len(moving) - 1, SPEEDS).round().astype(int))
    return _Travel(
        tuple(moving[chosen].tolist()),
        np.concatenate([np.diff(place) for place in places]),
        bool(np.any(speeds <= max(1e-9 * fastest, STANDING))),
    )


def _exponents(
    lowered: MomentFunctions, p: Array, moments: Array, duration: float
) -> tuple[npt.NDArray[np.complexfloating], bool]:
    """L l/V of all gaps L, speeds V of the run and eigenvalues l of N; and whether the vehicle stands somewhere."""
    travel = _travel(lowered, p, duration)
    found = []
    for V in travel.speeds:
        N = np.asarray(lowered.gain_matrix(moments, np.array([0.0, 0.0, V, 0.0]), p))
        # A friction without any motion yet has a gain without bound: its mode dies out within any distance.
        modes = np.linalg.eigvals(np.clip(np.nan_to_num(N), -1e12, 1e12))
        found.append(np.outer(travel.lengths / V, modes).ravel())
    return np.concatenate(found), travel.rests
