"""CVODE through scikit-sundae: large systems, any output times, restarts that cost nothing.

Two ways to solve the implicit equations of a step. Where the run is stiff, by Newton's method with the inverse of
`implicit` (the equivalent gains held), which costs a few products of n x n matrices; where it is not, by fixed-point
iteration, with Adams formulas. SUNDIALS is told through its GMRES interface: the product of Jacobian and vector that it
asks for is the one that makes the inverse exact, so that one iteration of GMRES is one application of the inverse.
"""

from __future__ import annotations

import os
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from io import StringIO

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.evaluate import Rate, behind, gains
from cadet_sym.solve.ground import GroundInverse
from cadet_sym.solve.implicit import Inverse, PackedIndex, scaled_form
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.threads import one_thread

__all__ = ["Stepping"]

Array = npt.NDArray[np.float64]

FAR = 1e100
"""No moment is as large: it comes of a rate that is no number."""


@dataclass
class Stepping:
    """The moment equations of one run under scikit-sundae's CVODE."""

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    stiff: bool
    full_newton: bool = False  # let GMRES ask for true products of Jacobian and vector
    rate: Rate = field(init=False)
    refreshes: int = field(default=0, init=False)
    steps: int = field(default=0, init=False)  # evaluations of the rate: scikit-sundae counts no steps

    def __post_init__(self) -> None:
        self.rate = Rate(self.lowered, self.p)
        packing = self.lowered.facts.packing
        self._index = PackedIndex(packing)
        self._scale = np.sqrt(np.maximum(self._diagonal(self.tolerance.size), 1e-300))
        self._form, self._inverse, self._g = None, None, 0.0
        self._ground = None if self.lowered.facts.delay is None else GroundInverse(self.lowered, self.p)
        self._pending: Array | None = None

    @property
    def name(self) -> str:
        """The method in words."""
        if not self.stiff:
            return "CVODE (Adams, fixed-point)"
        return "CVODE (BDF, GMRES + Lyapunov)" if self.full_newton else "CVODE (BDF, Newton + Lyapunov)"

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`."""
        solver, before = self._solver(), self.rate.count
        end = float(grid[-1])
        found = np.empty((len(grid), len(y)))
        # What is not finite makes SUNDIALS shorten its step; scikit-sundae prints what it also returns.
        with np.errstate(all="ignore"), redirect_stdout(StringIO()), one_thread(self.lowered.facts.packing.n):
            solver.init_step(behind(begin), y)
            for k, t in enumerate(grid):
                if t <= behind(begin):  # next to the beginning: no step reaches it
                    found[k] = y
                    continue
                result = solver.step(float(t), "normal", end)
                self.steps, before = self.steps + self.rate.count - before, self.rate.count
                if not result.success or not np.abs(result.y).max(initial=0.0) < FAR:
                    reason = "Its steps shrink to nothing." if self.rate.stalled else str(result.message)
                    raise Breakdown(reason, found[:k], float(result.t), np.array(result.y))
                found[k] = result.y
        return found

    def _solver(self):
        # SUNDIALS would print warnings on standard output; what matters of them comes back as a message.
        for level in ("WARNING", "ERROR"):
            os.environ.setdefault(f"SUNLOGGER_{level}_FILENAME", os.devnull)
        from sksundae.cvode import CVODE, CVODEJacTimes, CVODEPrecond

        self._form = self._inverse = self._pending = None
        options = {
            "rtol": self.tolerance.relative,
            "atol": self.tolerance.absolute * self.tolerance.relative * self.tolerance.size,
            "linsolver": "gmres",
            "max_num_steps": self.tolerance.steps,
        }
        if not self.stiff:
            still = CVODEJacTimes(None, _no_feedback)
            return CVODE(self.rate, method="Adams", krylov_dim=1, jactimes=still, **options)
        options["precond"] = CVODEPrecond(self._refresh, self._solve, "left")
        if self.full_newton:
            return CVODE(self.rate, method="BDF", krylov_dim=10, **options)
        return CVODE(self.rate, method="BDF", krylov_dim=2, jactimes=CVODEJacTimes(None, self._remember), **options)

    def _refresh(self, t: float, y: Array, slope: Array, usable: int, renewed: list[int], g: float) -> None:
        renewed[0] = 0
        if self._form is None or not usable:
            N = gains(self.lowered, t, y, self.p)
            usual = np.isfinite(N).all() and np.abs(N).max() < 1e100
            N = N if usual else np.zeros_like(N)
            self._form = scaled_form(N, self._scale)
            if self._ground is not None:
                self._ground.decompose(N, self._scale)
            self._inverse, renewed[0] = None, 1
            self.refreshes += 1

    def _solve(
        self, t: float, y: Array, slope: Array, r: Array, z: Array, g: float, accuracy: float, side: int
    ) -> None:
        if self._pending is not None:  # the inverse of what `_remember` stood for
            z[:], self._pending = self._pending, None
            return
        if self._inverse is None or g != self._g:
            assert self._form is not None
            if self._ground is not None:
                self._ground.prepare(t, y, g)
            self._inverse, self._g = Inverse.build(self._index, self._scale, self._form, g, self._ground), g
        self._inverse.apply(r, z)

    def _remember(self, t: float, y: Array, slope: Array, v: Array, product: Array) -> None:
        """(I - g J) v is what the inverse turns into v: no need to form it."""
        self._pending = v.copy()
        product[:] = 0.0

    def _diagonal(self, packed: Array) -> Array:
        rows, columns = self._index.packing.triangle
        n = self._index.packing.n
        return packed[n : self._index.packing.moments][rows == columns]


def _no_feedback(t: float, y: Array, slope: Array, v: Array, product: Array) -> None:
    product[:] = 0.0
