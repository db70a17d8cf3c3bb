"""Refuse a run that makes no sense: with other parameters, or longer, than the model was declared, and looked at, with."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.solve.evaluate import depends_on, results, results_shared

__all__ = ["refuse_senseless"]

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

TIMES = 501
"""Times of a run at which the speed is looked at."""

BACKWARDS = 1e-9
"""Share of the largest speed by which it may be negative: a rounding."""

_which: Memory[Places] = Memory()
_sensible: Memory[bool] = Memory()


def refuse_senseless(lowered: MomentFunctions, p: Array, duration: float) -> None:
    """Raise ModelError if a vehicle reverses, wheels change their order, or a measured speed ends before a run does.

    Of runs with parameters (runs, count).
    """
    if not lowered.facts.ground and lowered.facts.speed_ends is None and not lowered.facts.needs_distance:
        return
    ends = lowered.facts.speed_ends
    if ends is not None and duration > ends:
        raise ModelError(
            f"the rows of the speed end at t = {ends:g}, and the run at {duration:g}: shorten it, or say in the model what "
            'the speed is beyond its rows, as outside = "hold"',
            table="travel",
            key="speed",
        )
    used = _which(lowered, 0, lambda: depends_on(lowered.motion.jac_sparsity(0, 1), lowered.places.jac_sparsity(0, 0)))
    for travel, own in {travel.tobytes(): own for travel, own in zip(p[:, used], p, strict=True)}.items():
        _sensible(lowered, (travel, duration), lambda own=own: _look(lowered, own, duration))


def _look(lowered: MomentFunctions, p: Array, duration: float) -> bool:
    times = np.linspace(0.0, duration, TIMES)
    speeds = results_shared(lowered.motion, TIMES, times, p)[0][:, 0]
    wrong = ~(speeds >= -BACKWARDS * np.abs(speeds).max())
    if wrong.any():
        k = int(np.argmax(wrong)) if not np.isfinite(speeds).all() else int(np.argmin(speeds))
        raise ModelError(
            f"the speed is {speeds[k]:.6g} at t = {times[k]:.6g}, within the run: it must be a number that is not negative. A "
            "vehicle may stand but not reverse: shorten the run, or limit the speed, as in max(..., 0)",
            table="travel",
            key="speed",
        )
    setbacks = results(lowered.places, p)[0]
    if (setbacks < 0).any():
        raise ModelError(
            f"a setback is a distance behind the leading wheel and not negative: {setbacks.min():g} found", table="contacts"
        )
    grid = lowered.facts.delay
    behind = results(lowered.noise, np.zeros(4), p)[2]
    for track in () if grid is None else grid.tracks:
        order = behind[[columns[0] for columns in track.columns]]
        if (np.diff(order) <= 0).any():
            raise ModelError(
                "the wheels of a track come in another order than they were compiled in, or two at one place: setbacks "
                f"{', '.join(f'{L:g}' for L in order)}; compile the model with these parameters (`with_parameters`)",
                table="contacts",
            )
    return True
