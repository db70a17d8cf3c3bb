"""Where the known inputs of a run change abruptly: functions of t and s whose sign changes there.

A condition of a piecewise expression, the argument of abs, sign, heaviside, min and max: whatever depends on the
time and the distance alone is known before the run, so that the integration can be cut there. Integrators step over
an input that is shorter than their step.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.language.expression import DISTANCE, TIME, Lookup, symbol
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.lowering.system import LoweredSystem

__all__ = ["switch_functions"]

ROWS = 300
"""Rows of a measured profile up to which the run is cut at each; a longer one is as rough all along, and steps are short."""


def switch_functions(lowered: LoweredSystem) -> ca.Function:
    """(t, s, p) -> (functions of t alone, functions of s too): a change of sign of any is a breakpoint."""
    t, s, p = ca.SX.sym("t"), ca.SX.sym("s"), ca.SX.sym("p", len(lowered.parameters))
    env = lowered.environment(ca.vertcat(t, s, 0, 0), p)
    known = {TIME, DISTANCE, *(symbol(name) for name in _parameters(lowered))}
    switches: set[sp.Expr] = set()
    for expression in _inputs(lowered):
        for node in sp.preorder_traversal(expression):
            switches.update(g for g in _switches(node) if _is_known(g, known))
    found = sorted(switches, key=sp.default_sort_key)
    start = lowered.motion(0, p)[3]
    gates = [DISTANCE - setback for setback in lowered.equations.gates.values()]
    in_time = [to_casadi(g, env) for g in found if DISTANCE not in g.free_symbols]
    in_space = [to_casadi(g, env) for g in found if DISTANCE in g.free_symbols]
    in_space += [to_casadi(g, env) - start for g in gates]
    parts = [ca.SX(ca.vertcat(*in_time)), ca.SX(ca.vertcat(*in_space))]
    return ca.Function("switches", [t, s, p], parts, ["t", "s", "p"], ["time", "space"])


def _parameters(lowered: LoweredSystem) -> tuple[str, ...]:
    return tuple(lowered.equations.quasi_linear.system.model.parameters)


def _inputs(lowered: LoweredSystem) -> Iterator[sp.Basic]:
    """Every expression through which the time and the distance act."""
    system = lowered.equations.quasi_linear.system
    yield from system.drift
    yield from system.noise_input
    yield from system.intensity
    yield system.speed
    for element in lowered.equations.quasi_linear.elements:
        yield element.describing.body


def _switches(node: sp.Basic) -> Iterator[sp.Expr]:
    """The functions whose sign decides what a node is."""
    if isinstance(node, Relational):
        yield node.lhs - node.rhs
    elif isinstance(node, sp.Abs | sp.sign | sp.Heaviside):
        yield node.args[0]
    elif isinstance(node, sp.Max | sp.Min):
        first, *rest = sorted(node.args, key=sp.default_sort_key)  # SymPy keeps them in no order
        yield from (other - first for other in rest)
    elif isinstance(node, Lookup):
        knots = node.knots if len(node.knots) <= ROWS else (node.knots[0], node.knots[-1])
        yield from (node.argument - knot for knot in knots)


def _is_known(switch: sp.Expr, known: set[sp.Symbol]) -> bool:
    return switch.free_symbols <= known and not switch.free_symbols.isdisjoint({TIME, DISTANCE})
