"""How finely the ground between two wheels must be resolved, from the modes that travel across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cadet_sym.delay import STANDING, choose_grid, grid_errors
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.solve.evaluate import depends_on, results, results_over, results_shared

__all__ = ["present_errors", "suitable_grid"]

Array = npt.NDArray[np.float64]
Exponents = npt.NDArray[np.complex128]
Places = npt.NDArray[np.intp]

TOLERANCE = 1e-6
"""Error accepted in what the ground between two wheels does, when the grid there is chosen automatically."""

SLOWEST = 0.05
"""Speeds below this share of the highest are left out: the ground hardly excites anything there."""

SPEEDS = 8
"""Number of a run's speeds that are looked at."""


def suitable_grid(lowered: MomentFunctions, p: Array, moments: Array, duration: float) -> tuple[int, int]:
    """The cheapest grid that resolves the modes of N at these moments over the speeds of a run (see `choose_grid`)."""
    exponents, _ = _exponents(lowered, p[None], moments[None], duration)
    return choose_grid(exponents, TOLERANCE, rests=_travel(lowered, p, duration).rests)[0]


def present_errors(lowered: MomentFunctions, p: Array, moments: Array, duration: float) -> Array:
    """Estimated errors (runs,) of the grid that the equations have, for parameters (runs, count) and the gains at moments."""
    delay = lowered.facts.delay
    assert delay is not None
    exponents, owners = _exponents(lowered, p, moments, duration)
    errors, decaying = np.zeros(len(p)), exponents.real <= 0
    for grid in {(gap.elements, gap.modes) for track in delay.tracks for gap in track.gaps}:
        np.maximum.at(errors, owners[decaying], grid_errors(exponents[decaying], *grid))
    return errors


@dataclass(frozen=True)
class _Travel:
    """What a run's travel asks of the grids: speeds, lengths of the gaps, and whether the vehicle stands somewhere."""

    speeds: tuple[float, ...]
    lengths: Array
    rests: bool


_which: Memory[Places] = Memory()
_known: Memory[_Travel] = Memory()


def _travel(lowered: MomentFunctions, p: Array, duration: float) -> _Travel:
    """The travel of a run, remembered for the next that travels alike."""
    used = _which(lowered, 0, lambda: depends_on(lowered.motion.jac_sparsity(0, 1), lowered.noise.jac_sparsity(2, 1)))
    return _known(lowered, (duration, p[used].tobytes()), lambda: _look_along(lowered, p, duration))


def _look_along(lowered: MomentFunctions, p: Array, duration: float) -> _Travel:
    delay = lowered.facts.delay
    assert delay is not None
    times = np.linspace(0.0, duration, 257)
    speeds = results_shared(lowered.motion, len(times), times, p)[0][:, 0]
    fastest = float(speeds.max(initial=0.0))
    scale = fastest if fastest > STANDING else 1.0
    moving = np.unique((speeds[speeds >= SLOWEST * fastest] / scale).round(6)) * scale if scale == fastest else np.ones(1)
    setbacks = results(lowered.noise, np.zeros(4), p)[2]
    places = [[float(setbacks[columns[0]]) for columns in track.columns] for track in delay.tracks]
    chosen = np.unique(np.linspace(0, len(moving) - 1, SPEEDS).round().astype(int))
    return _Travel(
        tuple(moving[chosen].tolist()),
        np.concatenate([np.diff(place) for place in places]),
        bool(np.any(speeds <= max(1e-9 * fastest, STANDING))),
    )


def _exponents(lowered: MomentFunctions, p: Array, moments: Array, duration: float) -> tuple[Exponents, Places]:
    """L l/V of all gaps L, speeds V of runs and eigenvalues l of N there; and whose run they are."""
    travels, n = [_travel(lowered, own, duration) for own in p], lowered.facts.packing.n
    owners = np.repeat(np.arange(len(p)), [len(travel.speeds) for travel in travels])
    context = np.zeros((len(owners), 4))
    context[:, 2] = np.concatenate([travel.speeds for travel in travels])
    N = results_over(lowered.gain_matrix, moments[owners], context, p[owners])[0].reshape(-1, n, n).transpose(0, 2, 1)
    # A friction without any motion yet has a gain without bound: its mode dies out within any distance.
    modes = np.linalg.eigvals(np.clip(np.nan_to_num(N), -1e12, 1e12))
    times = np.array([travels[k].lengths for k in owners]) / context[:, 2:3]
    exponents = np.asarray(times[:, :, None] * modes[:, None, :], dtype=np.complex128)
    return exponents.ravel(), np.repeat(owners, exponents[0].size)
