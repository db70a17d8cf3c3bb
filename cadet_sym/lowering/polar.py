"""E[f] of a homogeneous function of two arguments, as a function that CasADi calls, with derivatives where nothing varies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from itertools import groupby
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.panels import Panel
from cadet_sym.expectation.planar import Moments
from cadet_sym.expectation.polar import (
    FIXED,
    NARROW,
    NEAR,
    Arc,
    Evaluate,
    Frame,
    Homogeneous,
    Layout,
    Node,
    Piece,
)
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.called import given, moments_of_two, with_derivative
from cadet_sym.lowering.expressions import Lowering

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

TOGETHER = 8  # nodes of one call, by which it is faster and larger; the orders of all rules are multiples of it
FRAME = 14  # numbers of a frame
ROUNDING = 1e-8  # what is left of a standard deviation at full correlation, which is known to 1e-16
CROSS = 1e-20  # of the variance of one argument added to that of the other: nearer poles than 1e-10 are not told apart
LEAST, SMALLEST = 1e-14, 1e-60  # the same where derivatives are taken, and a variance added there
DECIMALS = 12  # of the places of poles
DISTANT = 100.0  # standard deviations of the mean from the origin: 1e-16 times the square is lost before


def polar_moments(function: Homogeneous, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of either argument."""
    return moments_of_two(function, joint, _inline if function.fixed else _expectation)


@lru_cache(maxsize=256)
def _expectation(function: Homogeneous, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """(m_x, m_y, S_xx, S_xy, S_yy, parameters) -> E[f] and its gains.

    Derivatives in the means are those of the density, or, where the mean is so many deviations away that digits would be
    lost, those of the sums. By the heat equation dF/dS_xx = (1/2) d2F/dm_x^2, dF/dS_xy = d2F/dm_x dm_y, so that nothing is
    divided by a standard deviation that may be zero.
    """
    x, out = ca.MX.sym("v", 5 + len(free)), ca.MX.sym("out", 3)
    gentle, sharp = (function, TOGETHER), (replace(function, rule=NARROW), 1)
    narrow, far = _which(function, free)(x)
    value = ca.Function.if_else("either", _sums(*sharp, free), _sums(*gentle, free))
    curved = ca.Function.if_else("either", _curvature(*sharp, free), _curvature(*gentle, free))
    distant = _curvature_of_sums(replace(function, rule=FIXED), free)
    H, third = ca.vertsplit(ca.Function.if_else("which", distant, curved)(far, narrow, _moved(x)), [0, 3, 7])
    half = ca.vertcat(H[0] / 2, H[1], H[2] / 2)
    F = value(narrow, x)
    slopes = ca.vertcat(
        ca.horzcat(out[1:].T, half.T),
        ca.horzcat(H[0], H[1], third[0] / 2, third[1], third[2] / 2),
        ca.horzcat(H[1], H[2], third[1] / 2, third[2], third[3] / 2),
    )
    slopes = ca.horzcat(slopes, ca.jacobian(F, x)[:, 5:])
    return with_derivative(x, F, ca.Function("jac_called", [x, out], [slopes], ["v", "out_F"], ["jac_F_v"]))


@lru_cache(maxsize=256)
def _inline(function: Homogeneous, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """The same of scalar operations alone, by one rule."""
    return _sums(function, 1, free).expand()


def _which(function: Homogeneous, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """Whether a pole is so near to the line that more nodes are needed; whether the mean is far from the origin."""
    v = ca.SX.sym("v", 5 + len(free))
    layout = _layout(function, free, v)
    results = [layout.nearest() < NEAR, layout.frames[1].d > DISTANT]
    return ca.Function("which", [v], results, {"is_diff_in": [False], "is_diff_out": [False, False]})


def _sums(function: Homogeneous, together: int, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """E[f] and the gains."""
    v, x = ca.SX.sym("v", 5 + len(free)), ca.MX.sym("v", 5 + len(free))
    jumps = ca.Function("jumps", [v], [ca.vertcat(0, *_layout(function, free, v).jumps())])
    over_arcs = (terms for _, terms in _over_arcs(function, free, together, x, lambda node: node.sums()[:3]))
    return ca.Function("sums", [x], [sum(over_arcs, start=ca.MX(jumps(x)))])


def _curvature(function: Homogeneous, together: int, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """Second derivatives of E[f] in the means, xx, xy, yy, and third, xxx, xxy, xyy, yyy: of the density."""
    v, x = ca.SX.sym("v", 5 + len(free)), ca.MX.sym("v", 5 + len(free))
    total = ca.MX(_curvature_of_jumps(function, free)(x))
    terms = ca.SX.sym("terms", 10)
    layout = _layout(function, free, v)
    for side, sums in _over_arcs(function, free, together, x, lambda node: node.derivatives()):
        at = layout.at[side]
        inverse = ca.vertcat(ca.horzcat(side / at.s, -side * at.lean / (at.s * at.left)), ca.horzcat(0, 1 / at.left))  # L^-T
        rows = []
        for slope in (terms[:5], terms[5:]):
            second = inverse @ slope[:2]
            third = inverse @ ca.vertcat(ca.horzcat(slope[2], slope[3]), ca.horzcat(slope[3], slope[4])) @ inverse.T
            rows.append((second, third))
        (xs, xss), (ys, yss) = rows
        found = ca.vertcat(xs[0], xs[1], ys[1], xss[0, 0], xss[0, 1], yss[0, 1], yss[1, 1])
        total += ca.Function("curvature", [v, terms], [found])(x, sums)
    return ca.Function("curvature", [x], [total])


def _curvature_of_jumps(function: Homogeneous, free: tuple[sp.Symbol, ...]) -> ca.Function:
    m, rest = ca.SX.sym("m", 2), ca.SX.sym("rest", 3 + len(free))
    jumps = ca.SX(ca.vertcat(*_layout(function, free, ca.vertcat(m, rest)).jumps()))
    return ca.Function("curvature", [ca.vertcat(m, rest)], [_twice(jumps, m)])


def _curvature_of_sums(function: Homogeneous, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """The same derivatives, of the sums."""
    x, m, rest = ca.MX.sym("v", 5 + len(free)), ca.MX.sym("m", 2), ca.MX.sym("rest", 3 + len(free))
    gain = _sums(function, 1, free)(ca.vertcat(m, rest))[1:]
    found = ca.Function("curvature", [m, rest], [_twice(gain, m)])
    return ca.Function("curvature", [ca.MX.sym("narrow"), x], [found(x[:2], x[2:])])


def _twice(gain: Any, m: Any) -> Any:
    """Derivatives of the gains in the means, SX or MX: xx, xy, yy, xxx, xxy, xyy, yyy."""
    H = ca.jacobian(gain, m)
    second = ca.vertcat(H[0, 0], H[0, 1], H[1, 1])
    third = ca.jacobian(second, m)
    return ca.densify(ca.vertcat(second, third[0, 0], third[0, 1], third[2, 0], third[2, 1]))


def _over_arcs(
    function: Homogeneous, free: tuple[sp.Symbol, ...], together: int, x: ca.MX, terms: Callable[[Node], list[ca.SX]]
) -> Iterator[tuple[int, ca.MX]]:
    """Sums over the nodes of all arcs, with the side they lie on; a few nodes are a function, mapped over all of them."""
    v = ca.SX.sym("v", 5 + len(free))
    layout = _layout(function, free, v)
    for arc in function.arcs:
        frame = ca.vertcat(*_flat(layout.frames[arc.side]))
        for piece in layout.pieces(arc):
            for _, same in groupby(piece.panels, lambda panel: panel.run):
                like = list(same)
                numbers = ca.horzcat(*(ca.vertcat(*panel.numbers) for panel in like))
                known = ca.vertcat(frame, piece.end, piece.beyond, piece.there)
                numbers, known = ca.Function("panels", [v], [numbers, known])(x)
                rules = [np.reshape(panel.rule, (2, -1, together)) for panel in like]
                calls = [rule.shape[1] for rule in rules]
                t, w = (ca.DM(np.concatenate([rule[k] for rule in rules]).ravel()).T for k in (0, 1))
                each = ca.horzcat(*(ca.repmat(numbers[:, k], 1, count) for k, count in enumerate(calls)))
                node = _nodes(function, arc, piece, like[0], free, together, terms)
                yield arc.side, node.map("nodes", "serial", sum(calls), [3, 4], [0])(t, w, each, known, x[5:])


def _nodes(
    function: Homogeneous,
    arc: Arc,
    piece: Piece,
    panel: Panel,
    free: tuple[sp.Symbol, ...],
    together: int,
    terms: Callable[[Node], list[ca.SX]],
) -> ca.Function:
    """(t, w, numbers of the panel, of its arc, parameters) -> what a few nodes, one a column, add to the sums."""
    xp, t, w = CasadiAlgebra(), ca.SX.sym("t", 1, together), ca.SX.sym("w", 1, together)
    own, known, q = ca.SX.sym("own", len(panel.numbers)), ca.SX.sym("known", FRAME + 3), ca.SX.sym("q", len(free))
    *numbers, end, beyond, there = ca.vertsplit(known)
    pairs = [(numbers[k], numbers[k + 1]) for k in range(0, 10, 2)]
    nodes = replace(panel, numbers=tuple(ca.vertsplit(own))).nodes(t, w, xp)
    evaluate = _evaluate({symbol: q[k] for k, symbol in enumerate(free)})
    here = Piece(piece.part, [], end, beyond, there)
    node = Node(function, arc, here, Frame(*pairs, *numbers[10:]), nodes, evaluate, xp, more=2)
    return ca.Function("nodes", [t, w, own, known, q], [ca.sum2(ca.vertcat(*terms(node)))])


def _flat(frame: Frame) -> list[ca.SX]:
    """Its numbers, pair by pair."""
    parts = (getattr(frame, each.name) for each in fields(frame))
    return [ca.SX(x) for part in parts for x in (part if isinstance(part, tuple) else (part,))]


def _moved(x: ca.MX) -> ca.MX:
    """The moments at which derivatives are taken: with so much variance that they are numbers."""
    return ca.vertcat(x[:2], x[2] + LEAST * x[4] + SMALLEST, x[3], x[4] + LEAST * x[2] + SMALLEST, x[5:])


def _layout(function: Homogeneous, free: tuple[sp.Symbol, ...], v: ca.SX) -> Layout:
    if any(arc.poles for arc in function.arcs):
        v = ca.vertcat(v[:2], v[2] + CROSS * v[4], v[3], v[4] + CROSS * v[2], v[5:])
    m, s, mean, lean, left, spread = ca.vertsplit(given()(v[:5]))
    at = Moments(m, s, mean, lean, ca.sqrt(left**2 + (ROUNDING * spread) ** 2), spread)
    evaluate = _evaluate({symbol: v[5 + k] for k, symbol in enumerate(free)})
    return Layout(function, at, evaluate, CasadiAlgebra(decimals=DECIMALS))


def _evaluate(env: Mapping[sp.Symbol, ca.SX]) -> Evaluate:
    def evaluate(exprs: Sequence[sp.Expr], known: Mapping[sp.Symbol, ca.SX]) -> list[ca.SX]:
        lowering = Lowering({**env, **known}, split_powers=True)
        return [lowering.convert(expr) for expr in exprs]

    return evaluate
