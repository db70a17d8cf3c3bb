"""The rate of the moments where every element sees at least a least deviation of each state.

Friction that holds a mass leaves it no deviation at all: E[sign(v)] jumps, its gain has no bound, and the solution (in the
sense of Filippov) slides along the jump. Seen with a deviation far below all tolerances, the same friction is smooth, and
what slides creeps by no more than a few such deviations. With F = diag(d^2) added where elements look, and nowhere else,

    mu' = E[f](mu, P + F),    P' = N P + P N' + B Q B' / V,    N = E[df/dx](mu, P + F)

which is the rate at P + F less N F + F N'.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["resting_rate"]


def resting_rate(lowered: MomentFunctions) -> ca.Function:
    """(t, y, [p; d^2]) -> dy/dt, with the squares of the least deviations (n,) behind the parameters."""
    packing, count = lowered.facts.packing, len(lowered.parameters)
    n = packing.n
    t, y, given = ca.SX.sym("t"), ca.SX.sym("y", packing.size), ca.SX.sym("p", count + n)
    p, least = given[:count], given[count:]
    seen = ca.SX(y)
    for k, place in enumerate(packing.diagonal.tolist()):
        seen[place] += least[k]
    V, dV, s, _ = lowered.motion(t, p)
    distance = y[packing.moments] if packing.distance else s
    N = lowered.gain_matrix(seen[: packing.moments], ca.vertcat(t, distance, V, dV), p)
    extra = N @ ca.diag(least)
    extra += extra.T
    rate = ca.densify(lowered.rate(t, seen, p))
    rows, columns = (part.tolist() for part in packing.triangle)
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        rate[n + k] -= extra[i, j]
    return ca.Function("resting_rate", [t, y, given], [rate if lowered.calls else ca.cse(rate)], ["t", "y", "p"], ["dy"])
