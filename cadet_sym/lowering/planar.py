"""E[f] of a smooth function of two arguments, as a function that CasADi calls: it chooses its order when it is called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.planar import INNER, OUTER, REACH, TOGETHER, Layout, Moments, Planar, density
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.called import given, moments_of_two, with_derivative
from cadet_sym.lowering.expressions import Lowering

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

FINER = 0.75  # the step for derivatives of f, which are steeper, over that for f


def planar_moments(planar: Planar, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of either argument."""
    return moments_of_two(planar, joint, _unrolled if planar.counts else _expectation)


@lru_cache(maxsize=256)
def _expectation(planar: Planar, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """(m_o, m_i, S_oo, S_oi, S_ii, parameters) -> E[f] and its gains, with derivatives that are expectations again.

    By the heat equation dF/dS_oo = E[f_oo]/2, dF/dS_oi = E[f_oi], dF/dS_ii = E[f_ii]/2: finite without variance.
    """
    f, rows = _derivatives(planar), ((0, 0), (1, 0), (0, 1))
    v, out = ca.MX.sym("v", 5 + len(free)), ca.MX.sym("out", len(rows))
    in_parameters = [sp.diff(f[row], symbol) for row in rows for symbol in free]
    flat = list(dict.fromkeys([*(f[k] for k in f if k != (0, 0)), *in_parameters]))
    finer = replace(planar, step=FINER * planar.step)
    found = ca.vertsplit(_Sums(finer, free, flat, every=2).function()(v))
    E = {k: found[flat.index(f[k])] for k in f if k != (0, 0)}
    moved = ca.vertcat(*(found[flat.index(e)] for e in in_parameters)).reshape((len(free), len(rows))).T
    in_moments = [[E[i + 1, j], E[i, j + 1], E[i + 2, j] / 2, E[i + 1, j + 1], E[i, j + 2] / 2] for i, j in rows]
    jacobian = ca.horzcat(ca.vertcat(*(ca.horzcat(*row) for row in in_moments)), moved)
    for end, side in planar.ends:
        jacobian += side * _at_end(finer, free, end)(v)
    derivative = ca.Function("jac_called", [v, out], [jacobian], ["v", "out_F"], ["jac_F_v"])
    return with_derivative(v, _Sums(planar, free, planar.slopes).function()(v), derivative)


def _at_end(planar: Planar, free: tuple[sp.Symbol, ...], end: sp.Expr) -> ca.Function:
    """What the derivatives of f in the outer argument, which jump at an end, add there to the derivatives of E[f] and gains.

    E[delta(x - k) g] = B[g] = E[g | x = k] phi(u)/s, u = (k - m)/s, and dB/dm = (u B[g] - lean B[dg/dy])/s.
    """
    (x, y), slope = planar.symbols, planar.slopes[1]
    sums = _Sums(planar, free, [slope, sp.diff(slope, x), sp.diff(slope, y)], every=4)
    q, at = sums.q, sums.moments
    k = Lowering(sums.env).convert(end)
    u = (k - at.m) / at.s
    within = ca.fmin(ca.fmax(u, -REACH), REACH)
    line = sums.layout.stretch(within, at)
    rung = sums.inner_rungs.index(sums.layout.steps(within, *line[2:]), CasadiAlgebra())
    start = ca.Function("start", [sums.at, q], [within, rung, density(u, CasadiAlgebra()) / at.s, ca.vertcat(*line)])
    B, moves = ca.SX.sym("B", 3), ca.jacobian(k, q)
    change = (u * B[0] - at.lean * B[2]) / at.s
    none, along = ca.SX(1, 2), [-B[0] * moves[i] for i in range(len(free))]
    rows = [
        ca.horzcat(none, B[0] / 2, ca.SX(1, 2), ca.SX(1, len(free))),
        ca.horzcat(B[0], 0, (B[1] + change) / 2, B[2], 0, *along),
        ca.horzcat(none, B[2] / 2, ca.SX(1, 2), ca.SX(1, len(free))),
    ]
    added = ca.Function("added", [B, sums.at, q], [ca.densify(ca.vertcat(*rows))])
    v = ca.MX.sym("v", 5 + len(free))
    where = given()(v[:5])
    place, number, weight, stretch = start(where, v[5:])
    found = sums.lines()(number, place, weight, stretch, where, v[5:])
    return ca.Function("end", [v], [added(found, where, v[5:])])


def _derivatives(planar: Planar) -> dict[tuple[int, int], sp.Expr]:
    """The function differentiated (i, j) times by its outer and inner argument, i + j up to three, each from one before."""
    (x, y), (f, f_x, f_y) = planar.symbols, planar.slopes
    found = {(0, 0): f, (1, 0): f_x, (0, 1): f_y}
    for i, j in ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)):
        found[i, j] = sp.diff(found[i - 1, j], x) if i else sp.diff(found[i, j - 1], y)
    return found


@lru_cache(maxsize=256)
def _unrolled(planar: Planar, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """The same of scalar operations alone, with the numbers of nodes in `counts`."""
    sums = _Sums(planar, free, planar.slopes)
    v, xp = ca.SX.sym("v", 5 + len(free)), CasadiAlgebra()
    q, at = v[5:], given()(v[:5])
    fixed, fixed_q = xp.frozen(at), xp.frozen(q)  # what the nodes depend on, with no derivative
    places, u, first, last, _ = sums.setup()(fixed, fixed_q)
    (outer, inner), total = planar.counts or (2, 2), ca.SX(0)
    advance, line, length, before = sums.advance(), sums.line(inner).expand(), last - first, 0.0
    for t, w in zip(*planar.outer_rule(outer), strict=True):
        u, _, weight, stretch = advance(u, first + length * t, length * (t - before), places, fixed, fixed_q)
        total, before = total + line(u, w * weight, stretch, at, q), t
    return ca.Function("planar", [v], [length * total])


class _Sums:
    """Expectations of several expressions at the same nodes."""

    def __init__(self, planar: Planar, free: Sequence[sp.Symbol], expressions: Sequence[sp.Expr], every: int = 1):
        self.planar, self.free, self.expressions = planar, free, expressions
        self.outer_rungs, self.inner_rungs = replace(OUTER, every=max(1, every // 2)), replace(INNER, every=every)
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
        places, low, first, last, rung = self.setup()(at, q)
        line, advance = self.lines(), self.advance()
        sums = [self._outer(count, advance, line) for count in self.outer_rungs.counts]
        outer = ca.Function.conditional("outer", sums[:-1], sums[-1])
        return ca.Function("sums", [v], [outer(rung, at, q, places, low, first, last)])

    def lines(self) -> ca.Function:
        """`line` with the number of nodes as its first argument: which of `inner_rungs` it is."""
        known = {count: self.line(count) for count in self.inner_rungs.counts}
        lines = [known[count] for count in self.inner_rungs.counts]
        return ca.Function.conditional("line", lines[:-1], lines[-1])

    def setup(self) -> ca.Function:
        """(moments, parameters) -> poles on the outer line, its lower end, tau at both, which number of nodes it takes."""
        places = self.layout.places(self.moments)
        flat = ca.vertcat(*(x for place in places for x in place)) if places else ca.SX(0, 1)
        low, high = (ca.SX(end) for end in self.layout.ends(self.moments))
        first, last = self.layout.tau(low, places), self.layout.tau(high, places)
        rung = self.outer_rungs.index(self.layout.outer_steps(first, last, self.moments), CasadiAlgebra())
        return _constant("setup", [self.at, self.q], [flat, low, first, last, rung])

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
        low, first, last = ca.MX.sym("low"), ca.MX.sym("first"), ca.MX.sym("last")
        t, w = (ca.DM(x).T for x in self.planar.outer_rule(count))
        taus, more = first + (last - first) * t, (last - first) * ca.horzcat(t[0], ca.diff(t, 1, 1))
        same = [ca.repmat(x, 1, count) for x in (places, at, q)]
        u, rungs, weights, stretches = advance.mapaccum("marched", count, {"base": 2})(low, taus, more, *same)
        total = line.map("lines", "serial", count, [4, 5], [0])(rungs, u, w * weights, stretches, at, q)
        return ca.Function(f"outer{count}", [at, q, places, low, first, last], [(last - first) * total])

    def line(self, count: int) -> ca.Function:
        """The inner line with that many nodes: (u, weight, stretch, moments, parameters) -> its part of the expectations."""
        assert count % TOGETHER == 0
        u, weight, line = ca.MX.sym("u"), ca.MX.sym("weight"), ca.MX.sym("line", 4)
        at, q = ca.MX.sym("at", 6), ca.MX.sym("q", len(self.free))
        calls, step = count // TOGETHER, (line[3] - line[2]) / (count - 1)
        begins = line[2] + step * ca.DM(range(0, count, TOGETHER)).T
        same = [u, line[:2], step, at, q]
        nodes = self.nodes.map("nodes", "serial", calls, list(range(1, 6)), [0])
        options = {"is_diff_in": [False, False, False, True, True]}
        return ca.Function(f"line{count}", [u, weight, line, at, q], [weight * nodes(begins, *same)], options)

    @cached_property
    def nodes(self) -> ca.Function:
        """What a few nodes add: (tau at the first, u, centre and width of the pole, step, moments, parameters) -> sums."""
        begin, u, pole, step = ca.SX.sym("begin"), ca.SX.sym("u"), ca.SX.sym("pole", 2), ca.SX.sym("step")
        at = self.moments
        v, w, factor = self.layout.inner_nodes((pole[0], pole[1], begin, step), TOGETHER)
        outer, inner = self.planar.symbols
        lowering = Lowering({**self.env, outer: at.m + at.s * u, inner: at.mean + at.lean * u + at.left * v})
        sums = []
        for expression in self.expressions:
            values = ca.SX(lowering.convert(expression))
            sums.append(ca.dot(w, values) if values.numel() > 1 else values * ca.sum1(w))
        arguments = [begin, u, pole, step, self.at, self.q]
        options = {"is_diff_in": [False] * 4 + [True, True]}
        return ca.Function("nodes", arguments, [factor * ca.vertcat(*sums)], options)


def _constant(name: str, arguments: list[ca.SX], results: list[ca.SX]) -> ca.Function:
    """A function whose results are taken as constants: the integral does not depend on where its nodes are."""
    options = {"is_diff_in": [False] * len(arguments), "is_diff_out": [False] * len(results)}
    return ca.Function(name, arguments, results, options)

