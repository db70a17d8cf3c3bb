"""How large every moment becomes in a run: the units in which its errors are measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cadet_sym.packing import Packing

__all__ = ["STEPS", "Tolerance", "fits", "most_steps", "peaks"]

Array = npt.NDArray[np.float64]


NOTHING = 1e-70
ROUNDING = 1e-13  # of a mean: a deviation that sums over nodes leave, and no integrator can follow
"""Less than this is zero: its square underflows."""

FEW_TIMES = 100.0
"""By how much a mean or variance may exceed the size it was given ..."""

MANY_TIMES = 1e4
"""... and that size a variance."""


STEPS = 100_000
"""Of a stretch, unless it is known to ask for more."""


@dataclass(frozen=True)
class Tolerance:
    """What a step may err by: relative (|y| + absolute size)."""

    relative: float
    absolute: float  # over relative, in units of the sizes
    size: Array  # (size,) of every packed moment; or (runs, size)
    steps: int = STEPS  # of a stretch at most: where a moment runs away, steps shrink without end

    def of(self, runs: npt.NDArray[np.intp]) -> Tolerance:
        """That of some of the runs."""
        return self if self.size.ndim == 1 else replace(self, size=self.size[runs])


def most_steps(size: int) -> int:
    """Explicit steps of so many moments that are worth it where they are known to be needed: a few seconds of them."""
    return int(min(max(1e8 / size**2, STEPS), 3e6))


def peaks(y: Array, packing: Packing) -> Array:
    """Largest size of every moment over a run (k, size): standard deviations, and their products for covariances.

    A mean counts at least as large as its state's standard deviation. What has no deviation, as without any noise, or the one
    that rounding leaves where a gain is zero, counts as large as its mean; what stays at zero gets a size from its fellows.
    """
    n = packing.n
    deviation, means = np.sqrt(np.abs(y[:, packing.diagonal]).max(axis=0)), np.abs(y[:, :n]).max(axis=0)
    deviation = np.where(deviation > np.maximum(NOTHING, ROUNDING * means), deviation, means)
    deviation = np.where(deviation > NOTHING, deviation, np.max(deviation, initial=0.0) * 1e-3)
    deviation = np.where(deviation > NOTHING, deviation, 1.0)
    mean = np.maximum(means, deviation)
    distance = np.abs(y[:, packing.moments : packing.moments + packing.distance]).max(axis=0, initial=0.0)
    alongside = np.concatenate([distance, _of_ground(y, packing)])
    alongside = np.where(alongside > NOTHING, alongside, 1.0)
    rows, columns = packing.triangle
    return np.concatenate([mean, deviation[rows] * deviation[columns], alongside])


def _of_ground(y: Array, packing: Packing) -> Array:
    """Sizes of the correlation with the ground between the wheels: what leaves an element, a sum of its modes, sets those."""
    first, last = packing.size - packing.ground, packing.size - packing.known
    found = np.abs(y[:, first:]).max(axis=0, initial=0.0)
    carried = found[: last - first].reshape(-1, packing.rows)
    found[: last - first] = np.tile(carried.max(axis=0, initial=0.0), len(carried))
    return np.maximum(found, 1e-3 * found.max(initial=0.0))


def fits(size: Array, y: Array, packing: Packing) -> bool:
    """Whether sizes found beforehand suit what a run (k, size) reaches: no mean or variance far larger.

    A size that is too large is harmless until it is far too large: errors are held to a share of it.
    """
    n, diagonal = packing.n, packing.diagonal
    means, variances = (np.maximum.reduce(np.abs(part)) for part in (y[:, :n], y.take(diagonal, axis=1)))
    sizes = size[diagonal]
    near = (means <= FEW_TIMES * size[:n]) & (variances <= FEW_TIMES * sizes)
    near &= (sizes <= MANY_TIMES * variances) | (variances == 0)
    return bool(near.all())
