"""Find the moments that stay what they are at the start: those of the ground under the wheels, where it is stationary.

Seen from a wheel, homogeneous ground has the same covariance at any speed, P' = V (C P + P C^T + D Q D^T) = 0, yet it has the
fastest rates of all. Whoever integrates by explicit formulas does well to leave it out: what is left, the correlation of
the vehicle with the ground, is half as fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

if TYPE_CHECKING:
    from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["free_entries", "free_rate", "opened"]


def free_entries(lowered: MomentFunctions) -> ca.Function:
    """() -> the packed moments that are to be integrated; the others may stay if their rates vanish at the start.

    Left out is what depends, in its rate, on nothing but itself, the speed and the parameters: the covariance of each
    copy of the ground's filter, and its mean; and what is known of the ground between wheels.
    """
    packing = lowered.facts.packing
    ground = {i for place in lowered.facts.filters for i in range(place.start, place.start + place.size)}
    rows, columns = packing.triangle
    means = [i for i in range(packing.n) if i in ground]
    pairs = [packing.n + k for k, pair in enumerate(zip(rows, columns, strict=True)) if ground.issuperset(pair)]
    held = set(range(packing.size - packing.known, packing.size))
    if not lowered.facts.smooth:
        held |= {i for group in (means, pairs) if group and _alone(lowered, group) for i in group}
    free = [i for i in range(packing.size) if i not in held]
    return ca.Function("free", [], [ca.DM(free)], [], ["free"])


def _alone(lowered: MomentFunctions, group: list[int]) -> bool:
    """Whether the rates of a group depend on its own moments, the speed and the parameters alone."""
    t, s, V = ca.SX.sym("t"), ca.SX.sym("s"), ca.SX.sym("V")
    y, p = ca.SX.sym("y", lowered.facts.packing.size), ca.SX.sym("p", len(lowered.parameters))
    rates = lowered.held_rate(t, s, V, y, p)[group]
    others = [i for i in range(y.numel()) if i not in set(group)]
    return not ca.depends_on(rates, ca.vertcat(t, s, y[others]))


def opened(lowered: MomentFunctions, kept: np.ndarray) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """t, x, p and y: moments y of which those kept are x, and the others stand behind the parameters in p."""
    size, count = lowered.facts.packing.size, len(lowered.parameters)
    held = np.delete(np.arange(size), kept)
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", len(kept)), ca.SX.sym("p", count + len(held))
    y = ca.SX(size, 1)
    y[kept.tolist()] = x
    if len(held):
        y[held.tolist()] = p[count:]
    return t, x, p, y


def free_rate(lowered: MomentFunctions) -> ca.Function:
    """(t, y free, [p; y held]) -> rate of the free ones."""
    free = np.array(lowered.free_entries()["free"], dtype=int).ravel()
    t, x, p, y = opened(lowered, free)
    rates = ca.densify(lowered.rate(t, y, p[: len(lowered.parameters)])[free.tolist()])
    rates = rates if lowered.calls else ca.cse(rates)
    return ca.Function("free_rate", [t, x, p], [rates], ["t", "x", "p"], ["dx"])
