"""Explicit Runge-Kutta in machine code: the whole integrator is compiled, for small systems the fastest of all.

One function carries the moments over one stretch of time, whose beginning and length are inputs, so that it serves for
any output times; only the tolerance is compiled in.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.evaluate import give, take
from cadet_sym.solve.scales import Tolerance

__all__ = ["Native"]

Array = npt.NDArray[np.float64]

EASIER = 2.0
"""A pair of order 5(4) errs less over a run than formulas of varying order with the same tolerance: about this much."""


@dataclass
class Native:
    """The moment equations of one run under a compiled Runge-Kutta pair of order 5(4)."""

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    steps: int = field(default=0, init=False)
    name = "Runge-Kutta 5(4), machine code"

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`."""
        size, n = self.tolerance.size, len(y)
        buffer, evaluate = self.lowered.machine_code(self._key(), self._integrator).buffer()
        inputs = np.concatenate([self.p, size, [0.0, 0.0]])
        start, end, found = y / size, np.empty(n), np.empty((len(grid), n))
        give(buffer, 0, start)
        give(buffer, 2, inputs)
        take(buffer, 0, end)
        for k, (before, after) in enumerate(itertools.pairwise([begin, *grid.tolist()])):
            inputs[-2:] = before, after - before
            try:
                evaluate()
            except RuntimeError as error:
                raise Breakdown(str(error), found[:k] * size, before, start * size) from None
            start[:] = found[k] = end
        self.steps += len(grid)
        if not np.isfinite(found).all():
            raise Breakdown("the result is not finite")
        return found * size

    def _key(self) -> tuple[float, float]:
        return self.tolerance.relative, self.tolerance.absolute

    def _integrator(self) -> ca.Function:
        """[y over size], [p, size, begin, length] -> the same at the end of the stretch."""
        n, count = self.lowered.facts.packing.size, len(self.lowered.parameters)
        t, x, p = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("p", count + n + 2)
        size, begin, length = p[count : count + n], p[count + n], p[count + n + 1]
        ode = ca.cse(length * self.lowered.rate(begin + length * t, size * x, p[:count]) / size)
        options = {
            "reltol": min(EASIER * self.tolerance.relative, 1e-3),
            "abstol": min(EASIER * self.tolerance.absolute * self.tolerance.relative, 1e-3),
            "max_num_steps": self.tolerance.steps,
        }
        return ca.integrator("run", "erk", {"x": x, "p": p, "t": t, "ode": ode}, 0.0, [1.0], options)
