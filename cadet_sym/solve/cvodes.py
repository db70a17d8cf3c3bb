"""CVODES through CasADi: BDF with a direct solver, the fastest for small systems, or Adams formulas where none is needed.

Moments are integrated in units of their own size, for CasADi's absolute tolerance is one number. An integrator is built
for a grid of output times and a tolerance, and kept with the functions it belongs to.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.evaluate import give, take
from cadet_sym.solve.scales import Tolerance

__all__ = ["Direct"]

Array = npt.NDArray[np.float64]

KEPT = 64
"""Integrators kept for each model."""

_integrators: WeakKeyDictionary[MomentFunctions, OrderedDict[tuple[object, ...], ca.Function]] = WeakKeyDictionary()


@dataclass
class Direct:
    """The moment equations of one run under CasADi's CVODES."""

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    stiff: bool = True
    steps: int = field(default=0, init=False)

    @property
    def name(self) -> str:
        """The method in words."""
        return "CVODES (BDF, direct)" if self.stiff else "CVODES (Adams, fixed-point)"

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`."""
        integrator = self._integrator(tuple((grid - begin).tolist()))
        buffer, evaluate = integrator.buffer()
        size = self.tolerance.size
        inputs = np.concatenate([self.p, size, [begin]])
        start, found = y / size, np.empty((len(grid), len(y)))
        give(buffer, integrator.index_in("x0"), start)
        give(buffer, integrator.index_in("p"), inputs)
        take(buffer, integrator.index_out("xf"), found)
        try:
            evaluate()
        except RuntimeError as error:
            raise Breakdown(str(error)) from None
        if not np.isfinite(found).all():
            raise Breakdown("the result is not finite")
        self.steps += int(buffer.stats().get("nsteps", 0))
        return found * size

    def _integrator(self, grid: tuple[float, ...]) -> ca.Function:
        kept = _integrators.setdefault(self.lowered, OrderedDict())
        key = (grid, self.stiff, self.tolerance.relative, self.tolerance.absolute, self.tolerance.steps)
        if key not in kept:
            kept[key] = self._build(grid)
        kept.move_to_end(key)
        while len(kept) > KEPT:
            kept.popitem(last=False)
        return kept[key]

    def _build(self, grid: tuple[float, ...]) -> ca.Function:
        """CVODES over a stretch, time counted from its beginning, every moment in units of its size."""
        n, count = self.lowered.facts.packing.size, len(self.lowered.parameters)
        t, x = ca.SX.sym("t"), ca.SX.sym("x", n)
        p = ca.SX.sym("p", count + n + 1)
        size, begin = p[count : count + n], p[count + n]
        ode = self.lowered.rate(begin + t, size * x, p[:count]) / size
        ode = ode if self.lowered.calls else ca.cse(ode)
        options: dict[str, Any] = {
            "reltol": self.tolerance.relative,
            "abstol": self.tolerance.absolute * self.tolerance.relative,
            "max_num_steps": self.tolerance.steps,
            "show_eval_warnings": False,
            "disable_internal_warnings": True,
        }
        if not self.stiff:
            options |= {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
        return ca.integrator("run", "cvodes", {"x": x, "p": p, "t": t, "ode": ode}, 0.0, list(grid), options)
