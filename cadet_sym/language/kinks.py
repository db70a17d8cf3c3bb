"""Where an expression of one variable switches: the edges of its conditionals, the zeros under abs, sign and steps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.language.parser import exact
from cadet_sym.language.vocabulary import Lookup


def switching_functions(expr: sp.Basic, variable: sp.Symbol) -> list[sp.Expr]:
    """Functions of the variable at whose zeros `expr` may have a kink or a step."""
    found: dict[sp.Expr, None] = {}
    for node in sp.preorder_traversal(expr):
        if variable not in node.free_symbols:
            continue
        if isinstance(node, Relational):
            found[node.lhs - node.rhs] = None
        elif isinstance(node, sp.Abs | sp.sign | sp.Heaviside):
            found[node.args[0]] = None
        elif isinstance(node, sp.Min | sp.Max):
            arguments = node.args
            found.update({a - b: None for i, a in enumerate(arguments) for b in arguments[:i]})
        elif isinstance(node, Lookup):
            knots = node.knots if node.outside == "hold" else node.knots[1:-1]
            found.update({node.argument - knot: None for knot in knots})
    return list(found)


def breakpoints(expressions: Iterable[sp.Basic], variable: sp.Symbol) -> tuple[sp.Expr, ...]:
    """Positions of the variable at which the expressions switch, sorted where they are numbers; expressions in parameters.

    A switching function that is neither affine in the variable nor a polynomial with numbers is left out.
    """
    places: dict[sp.Expr, None] = {}
    for expr in expressions:
        for function in switching_functions(expr, variable):
            places.update(dict.fromkeys(_zeros(function, variable)))
    return tuple(sorted(places, key=lambda p: (not p.is_Rational, float(p) if p.is_Rational else 0.0, str(p))))


def _zeros(function: sp.Expr, variable: sp.Symbol) -> list[sp.Expr]:
    slope = sp.diff(function, variable)
    if variable not in slope.free_symbols:
        return [sp.expand(-function.xreplace({variable: sp.S.Zero}) / slope)] if slope != 0 else []
    if function.free_symbols == {variable} and function.is_polynomial(variable):
        roots = np.roots([float(c) for c in sp.Poly(function, variable).all_coeffs()])
        return [exact(float(r.real)) for r in roots if abs(r.imag) <= 1e-9 * max(1.0, abs(r))]
    return []
