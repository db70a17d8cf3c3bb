"""E[f] of a polynomial that switches along conics, as a function that CasADi calls: it chooses its order when it is called."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.conic import CURVES, widened
from cadet_sym.expectation.panels import legendre
from cadet_sym.expectation.planar import Moments
from cadet_sym.expectation.switched import (
    ORDERS,
    Border,
    Evaluate,
    Row,
    Sums,
    Switched,
    around,
    courses_of,
    order_index,
    side_points,
)
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.called import given, with_derivative
from cadet_sym.lowering.expressions import Lowering

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

TOGETHER = 8  # nodes of one call; all orders are multiples of it
ROUNDING = 1e-6  # of a standard deviation is left at full correlation: with less, second derivatives lose their digits
STEEPER = 1.25  # times the nodes that E[f] takes: derivatives of the density are steeper


def switched_moments(function: Switched, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of either argument."""
    free = tuple(sorted(function.free, key=str))
    o, i = function.outer, function.inner
    m = ca.vertcat(joint.m[o], joint.m[i])
    S = [joint.covariance(o, o), joint.covariance(o, i), joint.covariance(i, i)]
    value = joint.marginal(o).value
    (a, b, e), (c, d, f) = ([value(x) for x in form] for form in function.forms)
    L = ca.vertcat(ca.horzcat(a, b), ca.horzcat(c, d))
    covariance = [
        a * a * S[0] + 2 * a * b * S[1] + b * b * S[2],
        a * c * S[0] + (a * d + b * c) * S[1] + b * d * S[2],
        c * c * S[0] + 2 * c * d * S[1] + d * d * S[2],
    ]
    moments = ca.vertcat(L @ m + ca.vertcat(e, f), *covariance, *(value(symbol) for symbol in free))
    found = (_unrolled if function.order else _expectation)(function, free)(moments)
    gains = L.T @ found[1:]
    return found[0], {o: gains[0], i: gains[1]}


@lru_cache(maxsize=256)
def _expectation(function: Switched, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """(m_p, m_q, S_pp, S_pq, S_qq, parameters) -> E[f] and its gains, with derivatives that are expectations again.

    By the heat equation dF/dS_pp = E[f_pp]/2, dF/dS_pq = E[f_pq], dF/dS_qq = E[f_qq]/2: finite without variance.
    """
    p, q = function.coordinates
    v, out = ca.MX.sym("v", 5 + len(free)), ca.MX.sym("out", 3)
    curved = [Row(each) for each in ((p, p), (p, q), (q, q), (p, p, p), (p, p, q), (p, q, q), (q, q, q))]
    finer = replace(function, finer=STEEPER * function.finer)
    found = _Engine(finer, free, (*curved, *function.rows(*free))).function()(v)
    H, third = ca.vertsplit(found[:7], [0, 3, 7])
    slopes = ca.vertcat(
        ca.horzcat(out[1:].T, H[0] / 2, H[1], H[2] / 2),
        ca.horzcat(H[0], H[1], third[0] / 2, third[1], third[2] / 2),
        ca.horzcat(H[1], H[2], third[1] / 2, third[2], third[3] / 2),
    )
    if free:
        slopes = ca.horzcat(slopes, ca.reshape(found[7:], 3, len(free)))
    derivative = ca.Function("jac_called", [v, out], [slopes], ["v", "out_F"], ["jac_F_v"])
    return with_derivative(v, _Engine(function, free, function.rows()).function()(v), derivative)


@lru_cache(maxsize=256)
def _unrolled(function: Switched, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """The same of scalar operations alone, with as many nodes on every side."""
    return _Engine(function, free, function.rows()).function().expand()


class _Engine:
    """Some rows of expectations under one distribution."""

    def __init__(self, function: Switched, free: tuple[sp.Symbol, ...], rows: Sequence[Row]):
        self.switched, self.free, self.rows = function, free, rows
        self.v = ca.SX.sym("v", 5 + len(free))
        self.xp = CasadiAlgebra()
        self.evaluate = _evaluate({symbol: self.v[5 + k] for k, symbol in enumerate(free)})
        self.moments = self._moments()
        self.at = Moments(*ca.vertsplit(self.moments(self.v)))

    def function(self) -> ca.Function:
        """v -> the rows."""
        borders, xp = self.switched.borders, self.xp
        courses = [courses_of(border, self.at, self.evaluate, xp) for border in borders]
        middle = around(self.switched, self.rows, self.at, [own[0] for own in courses], self.evaluate, xp)
        results: list[ca.SX] = [ca.vertcat(*middle)]
        calls: list[Callable[..., ca.MX]] = []
        for border, own in zip(borders, courses, strict=True):
            sums = Sums(self.switched, border, self.rows, self.evaluate, xp)
            shared = ca.vertcat(ca.SX(0, 1), *sums.coefficients(self.at))
            call = self._side(border)
            for course, side in ((each, side) for each in own for side in each.sides):
                rung = 1 + order_index(side, self.switched.finer, xp)
                rung = ca.if_else(course.there * sums.acts * (side.last > side.first) > 0, rung, 0)
                results += [rung, ca.vertcat(*side.numbers), ca.vertcat(*course.numbers), shared]
                calls.append(call)
        v = ca.MX.sym("v", 5 + len(self.free))
        total, *rest = ca.Function("courses", [self.v], results)(v)
        at = self.moments(v)
        for k, call in enumerate(calls):
            total += call(*rest[4 * k : 4 * k + 4], at, v[5:])
        return ca.Function("switched", [v], [total])

    def _moments(self) -> ca.Function:
        """(m_p, m_q, S_pp, S_pq, S_qq, parameters) -> `Moments`."""
        m, s, mean, lean, left, spread = ca.vertsplit(given()(self.v[:5]))
        at = Moments(m, s, mean, lean, ca.sqrt(left**2 + (ROUNDING * spread) ** 2), spread)
        shapes = [self.evaluate(border.shape, {}) for border in self.switched.borders]
        at = widened(at, self.switched.borders[0].kind, shapes, self.xp)
        return ca.Function("moments", [self.v], [ca.vertcat(*astuple(at))])

    def _side(self, border: Border) -> ca.Function:
        """(which order, numbers of the side, of the course, b_ij, moments, parameters) -> what a side adds to the rows."""
        node, count = self._nodes(border), len(self.rows)
        if self.switched.order:
            return self._of_order(node, self.switched.order)
        none = ca.Function("none", [ca.MX.sym(f"x{k}", *node.size_in(2 + k)) for k in range(5)], [ca.MX.zeros(count)])
        sides = [none, *(self._of_order(node, order) for order in ORDERS)]
        return ca.Function.conditional("side", sides[:-1], sides[-1])

    def _of_order(self, node: ca.Function, order: int) -> ca.Function:
        t, w = (ca.DM(x).T for x in legendre(order))
        same = [ca.MX.sym(f"x{k}", *node.size_in(2 + k)) for k in range(5)]
        total = node.map("nodes", "serial", order // TOGETHER, [2, 3, 4, 5, 6], [0])(t, w, *same)
        ahead = [ca.MX.sym("rung")] if self.switched.order else []
        return ca.Function(f"side{order}", [*ahead, *same], [total])

    def _nodes(self, border: Border) -> ca.Function:
        """(t, w, numbers of the side, of the course, b_ij, moments, parameters) -> what a few nodes add."""
        kind = CURVES[border.kind]
        t, w = ca.SX.sym("t", 1, TOGETHER), ca.SX.sym("w", 1, TOGETHER)
        side, course = ca.SX.sym("side", 4 + kind.centre), ca.SX.sym("course", kind.known)
        at, q = ca.SX.sym("at", 6), ca.SX.sym("q", len(self.free))
        evaluate = _evaluate({symbol: q[k] for k, symbol in enumerate(self.free)})
        sums = Sums(self.switched, border, self.rows, evaluate, self.xp)
        shared = ca.SX.sym("b", sums.count)
        point, weight = side_points(border, ca.vertsplit(course), ca.vertsplit(side), t, w, self.xp)
        terms = sums.terms(Moments(*ca.vertsplit(at)), ca.vertsplit(shared), point, weight)
        rows = [ca.sum2(ca.SX(term) + ca.SX.zeros(1, TOGETHER)) for term in terms]
        return ca.Function("nodes", [t, w, side, course, shared, at, q], [ca.vertcat(*rows)])


def _evaluate(env: Mapping[sp.Symbol, ca.SX]) -> Evaluate:
    def evaluate(exprs: Sequence[sp.Expr], known: Mapping[sp.Symbol, ca.SX]) -> list[ca.SX]:
        lowering = Lowering({**env, **known})
        return [lowering.convert(expr) for expr in exprs]

    return evaluate
