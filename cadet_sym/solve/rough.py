"""A rough run beforehand: how large every moment becomes, and what it is on the way.

Every moment is integrated to its own size, so that one tolerance means the same for a displacement in metres and a force in
newtons. The sizes come from here; so do the moments at which the equivalent gains are looked at to choose an engine: at the
start, without variance, those of friction have no bound and say nothing of the run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.packing import Packing
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.choice import choose, compiles, modes
from cadet_sym.solve.course import march
from cadet_sym.solve.evaluate import HUGE, Rate, results_over
from cadet_sym.solve.many import Start
from cadet_sym.solve.scales import Tolerance, peaks

__all__ = ["ABSOLUTE", "Outline", "outline"]

Array = npt.NDArray[np.float64]

ABSOLUTE = 1e-2
"""Absolute over relative tolerance, in units of each moment's own size, at rtol 1e-6 and above."""

ROUGH, FINER = 1e-2, 1e-5
"""Tolerance of the rough run; and of another where that fails: strong friction leaves so little of a difference of two
velocities that errors as large as the first make it negative."""

PATIENCE = 20_000.0
"""Fastest rate of the covariance times duration up to which the rough run is explicit."""

STEPS = 5_000

GROWS, FASTEST = 10.0, 1e10
"""Times by which a variance grows in the second half of a run, from which on it is taken to have grown so in the first too:
an error early in the run then grows with it, and is to be small beside what there is early. More makes no difference."""


@dataclass(frozen=True)
class Outline:
    """What is known of a run before it is integrated."""

    size: Array  # (size,) of every moment
    along: Array  # (3, size) moments at the start, half-way and at the end

    def growth(self, packing: Packing) -> float:
        """How many times larger a variance becomes than it begins where it grows all along, as those of unstable systems do."""
        half, end = (np.abs(y[packing.diagonal]) for y in self.along[1:])
        later = float((end[half > 0] / half[half > 0]).max(initial=1.0))
        return min(later, FASTEST) ** 2 if later > GROWS else 1.0


_known: Memory[Outline] = Memory()


def outline(lowered: MomentFunctions, start: Start, duration: float, declared: Callable[[], Start] | None) -> Outline:
    """What a run is like, at the declared parameters if those are known."""
    key = (duration, b"" if declared else start.p.tobytes() + start.y.tobytes())
    return _known(lowered, key, lambda: _rough_run(lowered, declared() if declared else start, duration))


def _rough_run(lowered: MomentFunctions, start: Start, duration: float) -> Outline:
    """A run with tolerances far below anything's size; guesses where it fails."""
    packing, slopes = lowered.facts.packing, _slopes(lowered, start, duration)
    largest = np.abs(start.y).max(initial=0.0) + np.abs(np.nan_to_num(slopes)).max() * max(duration, 1e-300)
    small = np.sqrt(largest) if largest > 0 else 1.0
    grid = np.linspace(0, duration, 35)[1:] if duration > 0 else np.zeros(1)
    kind = _first_engine(lowered, start, grid, largest)
    second = "stiff" if compiles(lowered, start, "stiff") else kind
    for engine, rtol, fraction in ((kind, ROUGH, 1e-6), (second, FINER, 1e-3)):
        guess = Tolerance(rtol, ABSOLUTE, np.full(packing.size, fraction * small), STEPS)
        try:
            y = march(lowered, start, grid, engine, guess, alone=rtol == ROUGH).y
        except Breakdown:
            continue
        return Outline(peaks(np.vstack([start.y, y]), packing), np.array([start.y, y[len(y) // 2 - 1], y[-1]]))
    return Outline(np.full(packing.size, 1e-3 * small), np.repeat(start.y[None], 3, axis=0))


def _slopes(lowered: MomentFunctions, start: Start, duration: float) -> Array:
    """The rates (3, size) at the start's moments, at the beginning, half-way and at the end of a run."""
    times = np.array([0.0, duration / 2, duration])
    if not lowered.large:  # machine code of it may be wanted by nobody else
        found = results_over(lowered.rate, times, *(np.repeat(each[None], 3, axis=0) for each in (start.y, start.p)))[0]
        return np.where(np.isfinite(found), found, HUGE)
    rate, slopes = Rate(lowered, start.p), np.empty((3, len(start.y)))
    for t, slope in zip(times.tolist(), slopes, strict=True):
        rate(t, start.y, slope)
    return slopes


def _first_engine(lowered: MomentFunctions, start: Start, grid: Array, largest: float) -> str:
    """Explicit unless the run is stiff without any variance and with as much as it can have."""
    packing, duration = lowered.facts.packing, float(grid[-1])
    wide = start.y.copy()
    wide[: packing.moments] += packing.pack(np.zeros(packing.n), largest * np.eye(packing.n))
    found = [modes(lowered, start.p[None], duration, np.repeat(y[None], 3, axis=0))[0] for y in (start.y, wide)]
    fastest = min(float(np.nan_to_num(np.abs(each).max(initial=0.0), nan=np.inf)) for each in found)
    if fastest <= PATIENCE and compiles(lowered, start, "native"):
        return "native"
    return choose(lowered, start.alone, grid, found[0][None])[0]
