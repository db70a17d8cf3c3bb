"""Go on where friction holds something at rest: stiff formulas, elements seeing at least a least deviation of each state.

Where there is no variance, or none is left, a rate that jumps is met as it is, and a solution may slide along the jump: a
mass that dry friction holds. See `lowering.resting` for what is solved instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from cadet_sym.solve.evaluate import gains
from cadet_sym.solve.stiff import Stiff, bdf_compiles

__all__ = ["LEAST", "Resting"]

Array = npt.NDArray[np.float64]

LEAST = 1e-12
"""Least deviation that elements see, over the size of the state: below what any tolerance asks for. What rests creeps by no
more than a few of them a second ..."""

RELATIVE, ABSOLUTE = 1e-10, 1e-3
"""... if steps err by no more than this: with more, they are too coarse to find where in so narrow a layer it rests."""

NEARER, NEAR = 1e-6, 100.0
"""A deviation that tells whether something rests, at least, and how many times as large another is: for then ..."""

UNBOUNDED = 10.0
"""... the gains of the smaller are larger by more than this."""


HARDLY, WHILE = 1e-6, 1e-2
"""A state that stays below so much of what the jump of its rate would make of it in the whole time has rested; and then the
size of it is what that would make of it in this share of the time."""


@dataclass
class Resting(Stiff):
    """Backward differentiation formulas for what slides along a jump of its rate."""

    name = f"the same, elements seeing deviations of at least {LEAST:g} of the states' sizes"
    reacting = True
    stiff = False  # it needs no onset: no gain is without bound

    among: float = field(init=False)  # what the engine before erred by, over the sizes

    def __post_init__(self) -> None:
        self.among = self.tolerance.relative * self.tolerance.absolute
        relative, absolute = min(self.tolerance.relative, RELATIVE), min(self.tolerance.absolute, ABSOLUTE)
        self.tolerance = replace(self.tolerance, relative=relative, absolute=absolute)

    def is_wanted(self, t: float, y: Array, end: float) -> bool:
        """Whether at packed moments y some gain has no bound, and matters before the end."""
        if not (bdf_compiles(self.lowered) and self.lowered.machine("resting_rate") is not None):
            return False
        at = max(NEARER, 10 * self.among)
        nearer, near = (np.abs(gains(self.lowered, t, self._seen(y, each), self.p)) for each in (at, NEAR * at))
        deviation = self._deviations
        jumps = np.where(nearer > UNBOUNDED * near, nearer * at * deviation, 0.0)  # of the states' rates
        self._allow(jumps.max(axis=1, initial=0.0) * end)
        return bool(np.any(jumps / deviation[:, None] * (end - t) > at))

    def _allow(self, reach: Array) -> None:
        """Larger sizes for states that hardly ever moved when they were looked at: what their jumps would do in a while."""
        small = np.maximum(self._deviations, self.tolerance.size[: len(reach)]) < HARDLY * reach
        packing, size = self.lowered.facts.packing, self.tolerance.size.copy()
        size[: packing.n][small] = WHILE * reach[small]
        size[packing.diagonal[small]] = (WHILE * reach[small]) ** 2
        self.tolerance = replace(self.tolerance, size=size)

    @property
    def _deviations(self) -> Array:
        return np.sqrt(np.maximum(self.tolerance.size[self.lowered.facts.packing.diagonal], 1e-300))

    def _rate(self) -> int:
        code = self.lowered.machine("resting_rate")
        assert code is not None, "wanted only where there is machine code"
        return code.addresses["resting_rate"]

    def _given(self) -> Array:
        return np.concatenate([self.p, (LEAST * self._deviations) ** 2])

    def _seen(self, y: Array, least: float = LEAST) -> Array:
        seen = y.copy()
        seen[self.lowered.facts.packing.diagonal] += (least * self._deviations) ** 2
        return seen
