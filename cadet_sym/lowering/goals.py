"""Objectives and constraints, and how they and the moment equations answer the parameters, as CasADi functions."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from cadet_sym.language.goal import Goal
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.lowering.system import LoweredSystem

__all__ = ["goal_values", "weighted_slopes"]


def goal_values(lowered: LoweredSystem, goals: Sequence[Goal], *, held: bool) -> ca.Function:
    """(y, ctx, p) -> the goals' values (q,) and their derivatives in the packed moments (q, m) and in p.

    With `held` the speed is that of ctx; without, it is the model's own at the time in ctx and varies with p.
    """
    equations = lowered.equations
    y, ctx, p = ca.SX.sym("y", equations.packing.moments), ca.SX.sym("ctx", 4), _parameters(lowered)
    context = _context(lowered, ctx, p, held)
    moments = _moments(lowered, y, context, p)
    env = lowered.environment(context, p)
    values = []
    for goal in goals:
        own = {name: moments(kind, names) for name, kind, names in goal.statistics}
        values.append(to_casadi(goal.expression, env | own))
    value = ca.SX(ca.vertcat(*values))
    parts = [value, ca.jacobian(value, y), ca.jacobian(value, p)]
    return ca.Function("goals", [y, ctx, p], [ca.densify(part) for part in parts])


def weighted_slopes(lowered: LoweredSystem, *, held: bool) -> ca.Function:
    """(w, y, ctx, p) -> derivative in p of w . dy/dt, the packed moments' rates; not for wheels in one track."""
    packing = lowered.equations.packing
    y, ctx, p = ca.SX.sym("y", packing.moments), ca.SX.sym("ctx", 4), _parameters(lowered)
    w = ca.SX.sym("w", packing.moments)
    context = _context(lowered, ctx, p, held)
    whole = ca.vertcat(y, context[1]) if packing.distance else y
    rate = lowered.held_rate(context[0], context[1], context[2], whole, p)
    slope = ca.gradient(ca.dot(w, rate[: packing.moments]), p)
    return ca.Function("weighted_slopes", [w, y, ctx, p], [ca.densify(slope)])


def _parameters(lowered: LoweredSystem) -> ca.SX:
    return ca.SX.sym("p", len(lowered.parameters))


def _context(lowered: LoweredSystem, ctx: ca.SX, p: ca.SX, held: bool) -> ca.SX:
    """[t, s, V, 0]: the speed held, or that of the model."""
    return ctx if held else ca.vertcat(ctx[0], ctx[1], lowered.motion(ctx[0], p)[0], ctx[3])


def _moments(lowered: LoweredSystem, y: ca.SX, context: ca.SX, p: ca.SX):
    """Statistic of names, by its kind."""
    equations = lowered.equations
    states, outputs = list(equations.states), list(equations.quasi_linear.outputs)
    n = equations.packing.n
    covariance = ca.tril2symm(ca.SX(ca.Sparsity.lower(n), y[n:]))
    of_outputs = lowered.outputs_at(y, context, p)

    def moment(kind: str, names: tuple[str, ...]) -> ca.SX:
        if kind == "std":
            return ca.sqrt(moment("variance", names))
        if names[0] in states:
            i, j = states.index(names[0]), states.index(names[-1])
            return y[i] if kind == "mean" else covariance[i, j]
        return of_outputs[0 if kind == "mean" else 1][outputs.index(names[0])]

    return moment
