"""The moments and their derivatives together, in machine code: the variational equations.

    y' = g(t, y, p),    S' = (dg/dy) S + dg/dp

They are as stiff as the moments by themselves, so that what suits these suits all: explicit formulas, or those of backward
differentiation, whose inverse for the moments serves each column of S.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.carried import carried_slopes_code, slopes_head
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.operations import size
from cadet_sym.memory import Memory
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.native import Made, made_ready, march_made, pairs_of
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.stiff import Stiff

__all__ = ["COMPILED", "columns_at_once", "march_slopes", "variational_rate"]

Array = npt.NDArray[np.float64]

COMPILED = ("native", "stiff")
"""Kinds of engine that carry derivatives too."""

OF_A_COLUMN = 1.5
"""Operations of a column's derivatives, those of the rate one."""

STEPS = 20_000
"""Between two output times; where more are needed, implicit formulas are cheaper."""


@lru_cache(maxsize=64)
def variational_rate(lowered: MomentFunctions, columns: tuple[int, ...]) -> ca.Function:
    """(t, z, p) -> the rate of the moments and of their derivatives, z = [y; columns of S].

    Parameters
    ----------
    columns : entries of p; -1 stands for a column that only the start depends on.
    """
    n, c, direction = lowered.facts.packing.size, len(columns), _directions(lowered, columns)
    t, z, p = ca.SX.sym("t"), ca.SX.sym("z", n * (1 + c)), ca.SX.sym("p", len(lowered.parameters))
    y, S = z[:n], ca.reshape(z[n:], n, c)
    g = lowered.rate(t, y, p)
    slopes = [ca.jtimes(g, y, S[:, k]) + ca.jtimes(g, p, direction[:, k]) for k in range(c)]
    return ca.Function("augmented", [t, z, p], [ca.densify(ca.vertcat(g, *slopes))])


def _directions(lowered: MomentFunctions, columns: tuple[int, ...]) -> ca.SX:
    direction = ca.SX(len(lowered.parameters), len(columns))
    for k, j in enumerate(columns):
        if j >= 0:
            direction[j, k] = 1
    return direction


def columns_at_once(lowered: MomentFunctions) -> int:
    """How many columns machine code carries at once, so that it is not too long; 0 where it is that without any."""
    function = lowered.ingredients if lowered.large else lowered.rate_head if lowered.in_loops else lowered.rate
    return int((lowered.longest(function) / size(function) - 1) / OF_A_COLUMN)


def march_slopes(
    lowered: MomentFunctions,
    p: Array,
    columns: tuple[int, ...],
    begin: float,
    z: Array,
    grid: Array,
    tolerance: Tolerance,
    kind: str,
) -> Array | None:
    """z (k, size) at the times of the grid, from z at `begin`; None where there is no machine code, or it gives up.

    Parameters
    ----------
    kind : of engine, "native" or "stiff".
    """
    made = _compiled(lowered, columns)
    if not made.rate:
        return None
    if kind == "stiff":
        with contextlib.suppress(Breakdown):
            return StiffSlopes(lowered, p, tolerance, columns=columns).advance(begin, z, grid)
        return None
    run = march_made(made, p[None], z[None], [(begin, float(grid[-1]))], grid, tolerance)
    return None if run.status[0] or not np.isfinite(run.y).all() else run.y[0]


@dataclass
class StiffSlopes(Stiff):
    """The moments and their derivatives under backward differentiation formulas."""

    columns: tuple[int, ...] = ()  # see `variational_rate`

    @property
    def blocks(self) -> int:
        """Of y: moments, and derivatives of them."""
        return 1 + len(self.columns)

    def _rate(self) -> int:
        return _compiled(self.lowered, self.columns).rate


_ready: Memory[Made] = Memory()


def _compiled(lowered: MomentFunctions, columns: tuple[int, ...]) -> Made:
    return _ready(lowered, columns, lambda: _made(lowered, columns))


def _made(lowered: MomentFunctions, columns: tuple[int, ...]) -> Made:
    name = "_".join(["variational", *(str(j) if j >= 0 else "start" for j in columns)])
    every = np.arange(lowered.facts.packing.size * (1 + len(columns)))
    if lowered.large:
        code = lowered.machine_in_products(name, _directions(lowered, columns))
    elif lowered.in_loops:
        head = slopes_head(lowered, _directions(lowered, columns))
        code = lowered.machine_of(head, name, lambda: carried_slopes_code(lowered, head, name))
    else:
        code = lowered.machine_of(variational_rate(lowered, columns), name)
    return made_ready(code, name, every, every[:0], pairs_of(lowered))
