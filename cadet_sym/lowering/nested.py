"""E[f] as an integral over one argument of the expectation over the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import reduce
from itertools import pairwise
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Nested, Slice
from cadet_sym.expectation.panels import REACH, Panel, lay_out, panels
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.bivariate import one_minus_square
from cadet_sym.lowering.crossings import MeanLine
from cadet_sym.lowering.gaussian import Gaussian
from cadet_sym.lowering.nodes import Frame, at_once, called, expanded, sums_at, sums_on, turned
from cadet_sym.lowering.panels import beyond_reach, square_of_scale
from cadet_sym.lowering.product_rule import around_mean, curve_sums, falling, is_narrow, read, square_of_row

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

Sums = tuple[ca.SX, ca.SX, ca.SX]
"""E[f], that of its derivative in the outer argument, and its gains in the others."""

NEAR = 1e-18  # of the square of the scale on which f changes: an outer variance in which it is expanded
LEFT = 1e-13  # of the variance of another argument, at full correlation: so little is not felt, and nodes see jumps then


def nested_moments(nested: Nested, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of every argument."""
    return _Conditioning(nested, joint).moments()


class _Conditioning:
    """The other arguments given the outer one: mean m_i + L_i u, covariance S_ij - L_i L_j, u = (z - m)/s.

    Nodes go by s, and so derivatives in the variance are lost to rounding where there is nearly none: there f is expanded.
    """

    def __init__(self, nested: Nested, joint: Joint):
        self.nested = nested
        stands = all(crossing.curve is None and crossing.place is None and crossing.slope == 0 for crossing in nested.crossings)
        square = _square_of_scale(nested, joint) if stands else None
        self.given, self.least = joint, None if square is None else NEAR * square
        self.joint = joint = joint if self.least is None else _no_narrower(joint, nested.outer, self.least)
        self.outer: Gaussian = joint.marginal(nested.outer)
        self.symbol = nested.slices[0].part.argument
        self.rest = nested.slices[0].inner.arguments
        self.means = ca.vertcat(*(joint.m[i] for i in nested.others))
        pairs = [joint.pair(nested.outer, i) for i in nested.others]
        scales = [pair.y.s for pair in pairs]
        lean = [pair.rho * pair.y.s for pair in pairs]
        left = [pair.y.v * (one_minus_square(pair.rho) + LEFT) for pair in pairs]
        self.line = MeanLine(self.outer, self.symbol, self.rest, self.means, lean, left, scales)
        self.covariances = ca.vertcat(
            *(
                left[a] if a == b else joint.covariance(i, nested.others[b]) - lean[a] * lean[b]
                for a, i in enumerate(nested.others)
                for b in range(a + 1)
            )
        )

    def moments(self) -> tuple[ca.SX, dict[int, ca.SX]]:
        nested, outer = self.nested, self.outer
        F, gains = ca.SX(0), {i: ca.SX(0) for i in (nested.outer, *nested.others)}
        for piece in nested.slices:
            for value, slope, inner in self._parts(piece):
                F += value
                gains[nested.outer] += slope
                for a, i in enumerate(nested.others):
                    gains[i] += inner[a]
        for step in nested.steps:
            phi, u = outer.density(step.position)
            value, _, _ = self._sums(step.inner, step.inner, self.symbol, 1, outer.value(step.position), -u, ca.SX(1))
            gains[nested.outer] += phi / outer.s * value
        return (F, gains) if self.least is None else self._or_expanded(self.least, F, gains)

    def _or_expanded(self, least: ca.SX, F: ca.SX, gains: dict[int, ca.SX]) -> tuple[ca.SX, dict[int, ca.SX]]:
        """The same where the outer argument varies, else the first terms of exp(S_zz d_z^2/2 + S_zi d_z d_i) E[f | z = m]."""
        nested, joint, o = self.nested, self.given, self.nested.outer
        m, p = joint.m[o], joint.marginal(o).p
        across = ca.vertcat(*(joint.covariance(o, i) for i in nested.others))
        covariances = [joint.covariance(i, nested.others[b]) for a, i in enumerate(nested.others) for b in range(a + 1)]
        total = ca.SX.zeros(2 + len(nested.others))
        for piece in nested.slices:
            lower, upper = self._bounds(piece)
            inside = ca.logic_and(p < least, ca.logic_and(m > lower, m < upper))
            end = piece.part.singular_end
            point = m if end is None else upper - m if end[1] > 0 else m - lower
            point = ca.if_else(inside, point, self._somewhere(piece))
            free, (means, _, _, parameters) = self._shared(piece.symbol, piece.inner)
            function = expanded(piece.inner, free, turned(piece), piece.table.degree if piece.table else 0)
            curve = around_mean(piece.table, self.outer) if piece.table else ca.SX(0, 1)
            total += ca.if_else(inside, function(point, p, across, means, ca.vertcat(*covariances), parameters, curve), 0)
        found = ca.if_else(p < least, total, ca.vertcat(F, *(gains[i] for i in (o, *nested.others))))
        return found[0], dict(zip((o, *nested.others), ca.vertsplit(found[1:]), strict=True))

    def _bounds(self, piece: Slice) -> tuple[ca.SX, ca.SX]:
        """Where a slice begins and ends."""
        ends = (piece.part.lower, -ca.inf), (piece.part.upper, ca.inf)
        lower, upper = (ca.SX(far) if end.is_infinite else self.outer.value(end) for end, far in ends)
        return lower, upper

    def _ends(self, piece: Slice) -> tuple[ca.SX, ca.SX]:
        part, outer = piece.part, self.outer
        low = ca.SX(-REACH) if part.lower.is_infinite else outer.within(part.lower)
        high = ca.SX(REACH) if part.upper.is_infinite else ca.fmax(low, outer.within(part.upper))
        return low, high

    def _parts(self, piece: Slice) -> Iterator[Sums]:
        """Sums over the panels of a slice."""
        part, outer, crossings = piece.part, self.outer, self.nested.crossings
        low, high = self._ends(piece)
        crossed = [(self.nested.others.index(crossing.argument), crossing) for crossing in crossings]
        steep = self.line.places(crossed, part.steep[len(crossings) :], low, high)
        beyond, gap = ca.SX(0), ca.SX(0)
        if (place := part.singular_end) is not None:
            end, side = place
            beyond, gap = side * (outer.value(end) - outer.m), beyond_reach(outer, end, side)
        frame = Frame(outer.m, outer.s, -high if part.singular[1] else low, beyond, gap, self._somewhere(piece))
        if piece.table is not None:
            free, shared = self._shared(piece.symbol, piece.inner, piece.slope)
            cuts = (panel.cuts(CasadiAlgebra()) for panel in panels(part, low, high, steep, CasadiAlgebra()))
            ends = [pair for several in cuts for pair in pairwise(several)]
            known, sums = read(piece.table, outer), curve_sums(piece, free, len(ends), self.nested.written_out)
            yield _parted(sums(falling(known, ends), is_narrow(piece, self.line), known, *shared))
            return
        if part.has_panels and not self.nested.written_out:
            for panel in panels(part, low, high, steep, CasadiAlgebra()):
                yield self._on_panel(piece, panel, frame, high > low)
            return
        for nodes in lay_out(part, low, high, steep, CasadiAlgebra()):
            nodes = replace(nodes, weight=ca.if_else(high > low, nodes.weight, 0))
            points, weight = frame.placed(piece, nodes)
            yield self._sums(piece.inner, piece.slope, piece.symbol, turned(piece), points, nodes.u, weight)

    def _somewhere(self, piece: Slice) -> ca.SX:
        """A point well within a slice, or its distance from the singular end."""
        lower, upper = piece.part.lower, piece.part.upper
        if piece.part.singular_end is not None:
            return ca.SX(1) if lower.is_infinite or upper.is_infinite else self.outer.value((upper - lower) / 2)
        if lower.is_infinite or upper.is_infinite:
            return self.outer.value(upper - 1 if lower.is_infinite else lower + 1) if lower != -upper else ca.SX(0)
        return self.outer.value((lower + upper) / 2)

    def _on_panel(self, piece: Slice, panel: Panel, frame: Frame, there: ca.SX) -> Sums:
        free, shared = self._shared(piece.symbol, piece.inner, piece.slope)
        known = ca.vertcat(*(getattr(frame, each.name) for each in fields(frame)))
        there = ca.logic_and(there, panel.length > 0)
        return _parted(sums_on(piece, panel, free)(there, ca.vertcat(*panel.numbers), known, *shared))

    def _sums(
        self, df: DescribingFunction, slope: DescribingFunction, symbol: sp.Symbol, turned: int, *nodes: ca.SX
    ) -> Sums:
        """Sums over nodes given one by one: what the symbol is at them, u, weights."""
        free, shared = self._shared(symbol, df, slope)
        z, u, weight = nodes
        count = ca.SX(z).numel()
        together = at_once(count)
        sums = sums_at(df, slope, free, together, turned)
        columns = [ca.reshape(ca.SX(x), together, count // together) for x in (z, u, weight + ca.SX.zeros(count))]
        if self.nested.written_out or count == together:
            return _parted(sum((sums(*(x[:, k] for x in columns), *shared) for k in range(count // together)), start=ca.SX(0)))
        return _parted(called(sums, count // together)(*columns, *shared))

    def _shared(self, z: sp.Symbol, *functions: DescribingFunction) -> tuple[tuple[sp.Symbol, ...], list[ca.SX]]:
        """The outer argument and the parameters of some functions; means, lean, covariances of the others, the parameters."""
        symbols = {s for df in functions for s in df.body.free_symbols} - {z, *self.rest}
        free = tuple(sorted(symbols, key=str))
        parameters = ca.vertcat(*map(self.outer.value, free))
        return (z, *free), [self.means, ca.vertcat(*self.line.lean), self.covariances, parameters]


def _parted(totals: ca.SX) -> Sums:
    return totals[0], totals[1], totals[2:]


def _square_of_scale(nested: Nested, joint: Joint) -> ca.SX | None:
    """The square of the scale on which f changes in the outer argument; None if that depends on the others."""
    count = len(nested.crossings)
    parts = [replace(piece.part, steep=piece.part.steep[count:]) for piece in nested.slices]
    others = nested.slices[0].inner.arguments
    if any(place.width.has(*others) or place.centre.has(*others) for part in parts for place in part.steep):
        return None
    outer = joint.marginal(nested.outer)
    squares = [square_of_row(piece.table, outer) for piece in nested.slices if piece.table]
    smooth = square_of_scale(outer, parts)
    return reduce(ca.fmin, squares if smooth is None else [smooth, *squares]) if smooth is not None or squares else None


def _no_narrower(joint: Joint, o: int, least: ca.SX) -> Joint:
    """The distribution with a variance that is at least so much."""
    S, p = ca.SX(joint.S), joint.marginal(o).p
    S[o * (o + 3) // 2] = ca.if_else(p >= least, p, least)
    return replace(joint, S=S, marginals={}, pairs={})
