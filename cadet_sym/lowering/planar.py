"""E[f] of a smooth function of two arguments, as a function that CasADi calls: it chooses its order when it is called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.planar import INNER, OUTER, REACH, Layout, Moments, Planar, density
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.called import given, moments_of_two, with_derivative
from cadet_sym.lowering.expressions import Lowering

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint


def planar_moments(planar: Planar, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of either argument."""
    return moments_of_two(planar, joint, _unrolled if planar.counts else _expectation)


@lru_cache(maxsize=256)
def _expectation(planar: Planar, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """(m_o, m_i, S_oo, S_oi, S_ii, parameters) -> E[f] and its gains, with derivatives that are expectations again.

    By the heat equation dF/dS_oo = E[f_oo]/2, dF/dS_oi = E[f_oi], dF/dS_ii = E[f_ii]/2: finite without variance.
    """
    x, y = planar.symbols
    rows = planar.slopes
    slopes = [
        [sp.diff(r, x), sp.diff(r, y), *_half_hessian(r, x, y), *(sp.diff(r, symbol) for symbol in free)] for r in rows
    ]
    v, out = ca.MX.sym("v", 5 + len(free)), ca.MX.sym("out", len(rows))
    flat = list(dict.fromkeys(e for row in slopes for e in row))
    sums = _Sums(planar, free, flat, every=2).function()(v)
    jacobian = ca.vertcat(*(ca.horzcat(*(sums[flat.index(e)] for e in row)) for row in slopes))
    derivative = ca.Function("jac_called", [v, out], [jacobian], ["v", "out_F"], ["jac_F_v"])
    return with_derivative(v, _Sums(planar, free, rows).function()(v), derivative)


def _half_hessian(f: sp.Expr, x: sp.Symbol, y: sp.Symbol) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    return sp.diff(f, x, 2) / 2, sp.diff(f, x, y), sp.diff(f, y, 2) / 2


@lru_cache(maxsize=256)
def _unrolled(planar: Planar, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """The same of scalar operations alone, with the numbers of nodes in `counts`."""
    sums = _Sums(planar, free, planar.slopes)
    v, xp = ca.SX.sym("v", 5 + len(free)), CasadiAlgebra()
    q, at = v[5:], given()(v[:5])
    fixed, fixed_q = xp.frozen(at), xp.frozen(q)  # what the nodes depend on, with no derivative
    places, first, last, _ = sums.setup()(fixed, fixed_q)
    (outer, inner), total, u = planar.counts or (1, 1), ca.SX(0), ca.SX(-REACH)
    step, advance, line = (last - first) / (outer - 1), sums.advance(), sums.line(inner)
    for k in range(outer):
        u, _, weight, stretch = advance(u, first + step * k, step if k else 0, places, fixed, fixed_q)
        total += line(u, weight, stretch, at, q)
    return ca.Function("planar", [v], [step * total])


class _Sums:
    """Expectations of several expressions at the same nodes."""

    def __init__(self, planar: Planar, free: Sequence[sp.Symbol], expressions: Sequence[sp.Expr], every: int = 1):
        self.planar, self.free, self.expressions = planar, free, expressions
        self.outer_rungs, self.inner_rungs = replace(OUTER, every=every), replace(INNER, every=every)
        self.q = ca.SX.sym("q", len(free))
        self.env = {symbol: self.q[k] for k, symbol in enumerate(free)}
        self.at = ca.SX.sym("at", 6)
        self.moments = Moments(*ca.vertsplit(self.at))
        self.layout = Layout(planar, lambda e, known: Lowering({**self.env, **known}).convert(e), CasadiAlgebra())
        self.count = len(planar.own) + self._passed()
        self.flat = ca.SX.sym("places", 2 * self.count)
        self.places = [(self.flat[2 * k], self.flat[2 * k + 1]) for k in range(self.count)]

    def _passed(self) -> int:
        return len(self.layout.passed(self.moments)) if self.planar.pole else 0

    def function(self) -> ca.Function:
        """(m_o, m_i, S_oo, S_oi, S_ii, parameters) -> the expectations."""
        v = ca.MX.sym("v", 5 + len(self.free))
        q, at = v[5:], given()(v[:5])
        places, first, last, rung = self.setup()(at, q)
        lines = [self.line(count) for count in self.inner_rungs.counts]
        line, advance = ca.Function.conditional("line", lines[:-1], lines[-1]), self.advance()
        sums = [self._outer(count, advance, line) for count in self.outer_rungs.counts]
        outer = ca.Function.conditional("outer", sums[:-1], sums[-1])
        return ca.Function("sums", [v], [outer(rung, at, q, places, first, last)])

    def setup(self) -> ca.Function:
        """(moments, parameters) -> poles on the outer line, tau at its two ends, which number of nodes it takes."""
        places = self.layout.places(self.moments)
        flat = ca.vertcat(*(x for place in places for x in place)) if places else ca.SX(0, 1)
        first, last = self.layout.tau(ca.SX(-REACH), places), self.layout.tau(ca.SX(REACH), places)
        rung = self.outer_rungs.index(self.layout.outer_steps(first, last, self.moments), CasadiAlgebra())
        return _constant("setup", [self.at, self.q], [flat, first, last, rung])

    def advance(self) -> ca.Function:
        """From an outer node to the next: (u, tau there, by how much more, poles, moments, parameters) -> u, the inner line."""
        layout, places = self.layout, self.places
        u, tau, more = ca.SX.sym("u"), ca.SX.sym("tau"), ca.SX.sym("more")
        # du/dtau = 1/slope by the classical rule of Runge and Kutta, then a step of Newton
        first = more / layout.slope(u, places)
        second = more / layout.slope(u + first / 2, places)
        third = more / layout.slope(u + second / 2, places)
        fourth = more / layout.slope(u + third, places)
        there = u + (first + 2 * second + 2 * third + fourth) / 6
        there = there - (layout.tau(there, places) - tau) / layout.slope(there, places)
        weight = density(there, CasadiAlgebra()) / layout.slope(there, places)
        line = layout.stretch(there, self.moments)
        rung = self.inner_rungs.index(layout.steps(there, *line[2:]), CasadiAlgebra())
        results = [there, rung, weight, ca.vertcat(*line)]
        return _constant("advance", [u, tau, more, self.flat, self.at, self.q], results)

    def _outer(self, count: int, advance: ca.Function, line: ca.Function) -> ca.Function:
        """The whole double sum with that many outer nodes."""
        at, q, places = ca.MX.sym("at", 6), ca.MX.sym("q", len(self.free)), ca.MX.sym("places", 2 * self.count)
        first, last = ca.MX.sym("first"), ca.MX.sym("last")
        step = (last - first) / (count - 1)
        taus, more = first + step * ca.DM(range(count)).T, step * ca.DM([0] + [1] * (count - 1)).T
        same = [ca.repmat(x, 1, count) for x in (places, at, q)]
        u, rungs, weights, stretches = advance.mapaccum(count)(ca.MX(-REACH), taus, more, *same)
        total = line.map("lines", "serial", count, [4, 5], [0])(rungs, u, weights, stretches, at, q)
        return ca.Function(f"outer{count}", [at, q, places, first, last], [step * total])

    def line(self, count: int) -> ca.Function:
        """The inner line with that many nodes: (u, weight, stretch, moments, parameters) -> its part of the expectations."""
        u, weight, line = ca.SX.sym("u"), ca.SX.sym("weight"), ca.SX.sym("line", 4)
        at = self.moments
        centre, width, first, last = ca.vertsplit(line)
        v, w, factor = self.layout.inner_nodes((centre, width, first, last), count)
        outer, inner = self.planar.symbols
        env = {**self.env, outer: at.m + at.s * u, inner: at.mean + at.lean * u + at.left * v}
        lowering = Lowering(env)
        sums = []
        for expression in self.expressions:
            values = ca.SX(lowering.convert(expression))
            sums.append(ca.dot(w, values) if values.numel() > 1 else values * ca.sum1(w))
        arguments = [u, weight, line, self.at, self.q]
        options = {"is_diff_in": [False, False, False, True, True]}
        return ca.Function(f"line{count}", arguments, [weight * factor * ca.vertcat(*sums)], options)


def _constant(name: str, arguments: list[ca.SX], results: list[ca.SX]) -> ca.Function:
    """A function whose results are taken as constants: the integral does not depend on where its nodes are."""
    options = {"is_diff_in": [False] * len(arguments), "is_diff_out": [False] * len(results)}
    return ca.Function(name, arguments, results, options)

