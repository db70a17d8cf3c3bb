"""Where an expression of one variable switches: the edges of its conditionals, the zeros under abs, sign and steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.language.names import exact
from cadet_sym.language.numeric import NUMPY, evaluate
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
            knots = node.knots if node.outside != "extrapolate" else node.knots[1:-1]
            found.update({node.argument - knot: None for knot in knots})
    return list(found)


def breakpoints(expressions: Iterable[sp.Basic], variable: sp.Symbol) -> tuple[sp.Expr, ...]:
    """Positions of the variable, numbers or expressions in parameters, at which the expressions switch; numbers sorted.

    A switching function that is neither affine in the variable nor a polynomial with numbers is left out.
    """
    places: dict[sp.Expr, None] = {}
    for expr in expressions:
        for function in switching_functions(expr, variable):
            places.update(dict.fromkeys(zeros(function, variable) or []))
    return tuple(sorted(places, key=lambda p: (not p.is_Rational, float(p) if p.is_Rational else 0.0, str(p))))


def zeros(function: sp.Expr, variable: sp.Symbol) -> list[sp.Expr] | None:
    """Where a switching function, or one of its branches, is zero; None if that is not to be said."""
    found: list[sp.Expr] = []
    for branch in _branches(function):
        part = _smooth_zeros(branch, variable)
        if part is None:
            return None
        found += part
    return found


def _branches(expr: sp.Expr) -> list[sp.Expr]:
    """What an expression may be, its conditionals, extremes and absolute values taken either way."""
    waiting, done = [expr], []
    while waiting and len(waiting) + len(done) <= _MOST_BRANCHES:
        expr = waiting.pop()
        inner = next((node for node in sp.preorder_traversal(expr) if isinstance(node, _SWITCHES)), None)
        if inner is None:
            done.append(expr)
            continue
        if isinstance(inner, sp.Piecewise):
            choices = [branch.args[0] for branch in inner.args]
        elif isinstance(inner, sp.Abs):
            choices = [inner.args[0], -inner.args[0]]
        else:
            choices = list(inner.args)
        waiting += [expr.xreplace({inner: choice}) for choice in choices]
    return done


def _smooth_zeros(function: sp.Expr, variable: sp.Symbol) -> list[sp.Expr] | None:
    slope = sp.diff(function, variable)
    if variable not in slope.free_symbols:
        return [sp.expand(-function.xreplace({variable: sp.S.Zero}) / slope)] if slope != 0 else []
    if function.free_symbols == {variable} and function.is_polynomial(variable):
        roots = np.roots([float(c) for c in sp.Poly(function, variable).all_coeffs()])
        # roots are good to 14 digits or so, and 2 should be 2
        return [exact(float(f"{r.real:.14g}")) for r in roots if abs(r.imag) <= 1e-9 * max(1.0, abs(r))]
    return None


_SWITCHES = (sp.Piecewise, sp.Abs, sp.Min, sp.Max)
_MOST_BRANCHES = 64
_STEP = 1e-7  # beside a breakpoint, relative to its position


def sides(
    expr: sp.Expr, variable: sp.Symbol, position: float, values: Mapping[sp.Symbol, float]
) -> tuple[float, float]:
    """Limits of `expr` from below and from above at a position of the variable."""
    at = {**values, variable: position}
    step = _STEP * max(1.0, abs(position))
    below, above = ({**values, variable: position + sign * step} for sign in (-1, 1))
    with np.errstate(all="ignore"):
        return _limit(expr, at, below), _limit(expr, at, above)


def _limit(expr: sp.Basic, at: Mapping[sp.Symbol, float], beside: Mapping[sp.Symbol, float]) -> float:
    """Value at a point of the branch that is taken beside it."""
    if isinstance(expr, sp.Piecewise):
        branch = next(b for b in expr.args if b.args[1] == sp.true or evaluate(b.args[1], beside))
        return _limit(branch.args[0], at, beside)
    if isinstance(expr, sp.Abs):
        return evaluate(sp.sign(expr.args[0]), beside) * _limit(expr.args[0], at, beside)
    if isinstance(expr, sp.sign | sp.Heaviside):
        return evaluate(expr, beside)
    if isinstance(expr, sp.Min | sp.Max):
        choose: Any = min if isinstance(expr, sp.Min) else max
        return _limit(choose(expr.args, key=lambda a: evaluate(a, beside)), at, beside)
    if not expr.args or isinstance(expr, Lookup):
        return evaluate(expr, at)
    return float(NUMPY[type(expr)](*(_limit(argument, at, beside) for argument in expr.args)))


def jump(
    expr: sp.Expr, variable: sp.Symbol, positions: Iterable[float], values: Mapping[sp.Symbol, float]
) -> float | None:
    """First of the positions at which `expr` has a step, or None."""
    for position in positions:
        below, above = sides(expr, variable, position, values)
        if not abs(below - above) <= 1e-9 * max(abs(below), abs(above)):
            return position
    return None
