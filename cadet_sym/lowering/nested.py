"""E[f] as an integral over one argument of the expectation over the others."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, reduce
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.crossings import Crossing
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Nested, Slice
from cadet_sym.expectation.panels import REACH, Nodes, lay_out
from cadet_sym.expectation.steep import Steep
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.bivariate import one_minus_square
from cadet_sym.lowering.expressions import Lowering
from cadet_sym.lowering.gaussian import Gaussian, beyond_reach, square_of_scale

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

SPREADS = (-4.0, -2.0, 0.0, 2.0, 4.0)
TOGETHER = 8  # nodes of one call, by which it is faster and larger
NARROW = 1e-2  # standard deviations: a smoothed kink that is wider need not be met to more digits than nodes need
NEAR = 1e-18  # of the square of the scale on which f changes: an outer variance in which it is expanded
LEFT = 1e-13  # of the variance of another argument, at full correlation: so little is not felt, and nodes see jumps then
LOOKED_AT, BISECTIONS = 65, 40  # points at which a line is looked at for where it passes a curve
NOWHERE = 1e3  # standard deviations: beyond the widest that nodes take notice of
PARALLEL = 1e-100  # a kink of the others that does not move with the outer argument is crossed nowhere


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
        self.scales = [pair.y.s for pair in pairs]
        self.lean = [pair.rho * pair.y.s for pair in pairs]  # L_i
        self.left = [pair.y.v * (one_minus_square(pair.rho) + LEFT) for pair in pairs]
        self.covariances = ca.vertcat(
            *(
                self.left[a] if a == b else joint.covariance(i, nested.others[b]) - self.lean[a] * self.lean[b]
                for a, i in enumerate(nested.others)
                for b in range(a + 1)
            )
        )

    def moments(self) -> tuple[ca.SX, dict[int, ca.SX]]:
        nested, outer = self.nested, self.outer
        F, gains = ca.SX(0), {i: ca.SX(0) for i in (nested.outer, *nested.others)}
        for piece in nested.slices:
            low, high = self._ends(piece)
            for nodes in self._nodes(piece, low, high):
                points = self._points(piece, nodes)
                weight = ca.if_else(high > low, nodes.weight, 0)
                turned = 1
                if (end := piece.part.singular_end) is not None:  # at which derivatives have no value
                    weight, turned = ca.if_else(points > 0, weight, 0), -end[1]
                points = ca.if_else(weight != 0, points, self._somewhere(piece))
                value, slope, inner = self._sums(piece.inner, piece.slope, points, nodes.u, weight, turned)
                F += value
                gains[nested.outer] += slope
                for a, i in enumerate(nested.others):
                    gains[i] += inner[a]
        for step in nested.steps:
            phi, u = outer.density(step.position)
            value, _, _ = self._sums(step.inner, step.inner, outer.value(step.position), -u, ca.SX(1))
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
            point, turned = m, 1
            if (end := piece.part.singular_end) is not None:
                point, turned = (upper - m, -1) if end[1] > 0 else (m - lower, 1)
            point = ca.if_else(inside, point, self._somewhere(piece))
            free = tuple(sorted(piece.inner.body.free_symbols - {self.symbol, *self.rest}, key=str))
            parameters = ca.vertcat(*map(self.outer.value, free))
            function = _expanded_function(piece.inner, (self.symbol, *free), turned)
            total += ca.if_else(inside, function(point, p, across, self.means, ca.vertcat(*covariances), parameters), 0)
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

    def _nodes(self, piece: Slice, low: ca.SX, high: ca.SX) -> list[Nodes]:
        part = piece.part
        crossings = self.nested.crossings
        steep = [self._crossing(crossing, low, high) for crossing in crossings]
        steep += [self._own_place(place) for place in part.steep[len(crossings) :]]
        return lay_out(part, low, high, steep, CasadiAlgebra())

    def _own_place(self, place: Steep) -> tuple[ca.SX, ca.SX]:
        """A steep place of f itself, as narrow as it gets for likely values of the others."""
        outer, widths, centre = self.outer, [], ca.SX(0)
        for spread in SPREADS if place.width.has(*self.rest) else (0.0,):
            likely = {z: self.means[a] + spread * self.scales[a] for a, z in enumerate(self.rest)}
            there = Lowering({**outer.env, **likely})
            widths.append(there.convert(place.width))
            centre = there.convert(place.centre) if spread == 0 else centre
        return (centre - outer.m) / outer.s, reduce(ca.fmin, widths) / outer.s

    def _crossing(self, crossing: Crossing, low: ca.SX, high: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Where the mean of another argument, given the outer one, passes its kink, and over what width."""
        a, outer = self.nested.others.index(crossing.argument), self.outer
        if crossing.curve is not None:
            return self._on_curve(crossing, a)
        if crossing.place is not None:
            return self._at_pass(crossing, a, low, high)
        slope = outer.value(crossing.slope)
        speed = self.lean[a] - slope * outer.s
        speed = ca.if_else(ca.fabs(speed) > PARALLEL, speed, PARALLEL)
        u = (outer.value(crossing.start) + slope * outer.m - self.means[a]) / speed
        square = self.left[a]
        if crossing.width is not None:
            there = Lowering({**outer.env, self.symbol: outer.m + outer.s * u})
            square = square + there.convert(crossing.width) ** 2
        width = ca.sqrt(square) / ca.fabs(speed)
        fixed, rounded = _frozen(u, width)
        return ca.if_else(width > NARROW, fixed, u), ca.if_else(width > NARROW, rounded, width)

    def _on_curve(self, crossing: Crossing, a: int) -> tuple[ca.SX, ca.SX]:
        """The same for a curve: where A u^2 + B u + C = +- i size along the means, without cancellation."""
        outer, z, y = self.outer, self.symbol, crossing.symbol
        curve = crossing.curve
        assert curve is not None
        assert y is not None
        s, lean, here = outer.s, self.lean[a], Lowering({**outer.env, z: outer.m, y: self.means[a]})
        C, across, rise = (here.convert(e) for e in (curve, sp.diff(curve, z), sp.diff(curve, y)))
        bends = [here.convert(sp.diff(curve, *pair)) for pair in ((z, z), (z, y), (y, y))]
        B = across * s + rise * lean
        A = (bends[0] * s * s + 2 * bends[1] * s * lean + bends[2] * lean * lean) / 2
        A = ca.if_else(ca.fabs(A) > PARALLEL, A, PARALLEL)
        real = B * B - 4 * A * C
        apart, sign = ca.sqrt(ca.fmax(real, 0)), ca.if_else(B >= 0, 1, -1)
        q = -(B + sign * apart) / 2
        q = ca.if_else(ca.fabs(q) > PARALLEL, q, PARALLEL)
        u = q / A if crossing.branch > 0 else ca.if_else(real > 0, C / q, q / A)
        there = Lowering({**outer.env, z: outer.m + s * u, y: self.means[a] + lean * u})
        square = self.left[a]
        if crossing.width is not None:
            square = square + there.convert(crossing.width) ** 2
        size = ca.fabs(there.convert(sp.diff(curve, y))) * ca.sqrt(square)
        # the square root of the complex discriminant real + 4 i A size
        absolute = ca.sqrt(real * real + (4 * A * size) ** 2)
        longer = ca.sqrt((absolute + ca.fabs(real)) / 2)
        longer = ca.if_else(longer > PARALLEL, longer, PARALLEL)
        return _frozen(u, ca.if_else(real > 0, size / longer, longer / ca.fabs(2 * A)))

    def _at_pass(self, crossing: Crossing, a: int, first: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The same for any curve: the n-th change of sign of its distance from the line through the means on a stretch."""
        outer, place = self.outer, crossing.place
        assert place is not None

        def is_above(u: ca.SX) -> ca.SX:
            there = Lowering({**outer.env, self.symbol: outer.m + outer.s * u}).convert(place)
            return there >= self.means[a] + self.lean[a] * u

        grid = [first + (last - first) * t for t in np.linspace(0, 1, LOOKED_AT)]
        sides = [is_above(u) for u in grid]
        passed, side, low, high = ca.SX(0), ca.SX(0), ca.SX(NOWHERE), ca.SX(NOWHERE)
        for k in range(len(grid) - 1):
            changes = sides[k] != sides[k + 1]
            here = ca.logic_and(changes, passed == crossing.branch)
            side, low, high = (ca.if_else(here, x, y) for x, y in ((sides[k], side), (grid[k], low), (grid[k + 1], high)))
            passed += changes
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            same = is_above(middle) == side
            low, high = ca.if_else(same, middle, low), ca.if_else(same, high, middle)
        u = (low + high) / 2
        there = Lowering({**outer.env, self.symbol: outer.m + outer.s * u})
        speed = ca.fabs(there.convert(sp.diff(place, self.symbol)) * outer.s - self.lean[a])
        width = ca.sqrt(self.left[a]) / ca.fmax(speed, PARALLEL)
        exists = passed > crossing.branch
        return _frozen(ca.if_else(exists, u, NOWHERE), ca.if_else(exists, width, 1))

    def _somewhere(self, piece: Slice) -> ca.SX:
        """One of the `_points` well within a slice: what has no weight must have derivatives all the same."""
        lower, upper = piece.part.lower, piece.part.upper
        if piece.part.singular_end is not None:
            return ca.SX(1) if lower.is_infinite or upper.is_infinite else self.outer.value((upper - lower) / 2)
        if lower.is_infinite or upper.is_infinite:
            return self.outer.value(upper - 1 if lower.is_infinite else lower + 1) if lower != -upper else ca.SX(0)
        return self.outer.value((lower + upper) / 2)

    def _points(self, piece: Slice, nodes: Nodes) -> ca.SX:
        """What the functions of a slice are taken at: the outer argument, or its distance from a singular end."""
        outer = self.outer
        if (place := piece.part.singular_end) is None or nodes.distance is None:
            return outer.m + outer.s * nodes.u
        end, side = place
        far = side * (outer.value(end) - outer.m) - side * outer.s * nodes.u
        return ca.if_else(beyond_reach(outer, end, side) > 0, far, outer.s * nodes.distance)

    def _sums(
        self, df: DescribingFunction, slope: DescribingFunction, z: ca.SX, u: ca.SX, weight: ca.SX, turned: int = 1
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Sums over nodes of the expectation of f, of the expectation of its slope, and of its gains."""
        symbols = (df.body.free_symbols | slope.body.free_symbols) - set(df.arguments) - {self.symbol}
        free = tuple(sorted(symbols, key=str))
        count = ca.SX(z).numel()
        together = next(k for k in range(min(TOGETHER, count), 0, -1) if count % k == 0)
        nodes = _inner_function(df, slope, (self.symbol, *free), together, turned)
        columns = [ca.reshape(ca.SX(x), together, count // together) for x in (z, u, weight + ca.SX.zeros(count))]
        same = [self.means, ca.vertcat(*self.lean), self.covariances, ca.vertcat(*(self.outer.value(s) for s in free))]
        if self.nested.written_out or count == together:
            totals = sum((nodes(*(x[:, k] for x in columns), *same) for k in range(count // together)), start=ca.SX(0))
        else:
            totals = _called(nodes, count // together)(*columns, *same)
        return totals[0], totals[1], totals[2:]


def _square_of_scale(nested: Nested, joint: Joint) -> ca.SX | None:
    """The square of the scale on which f changes in the outer argument; None if that depends on the others."""
    count = len(nested.crossings)
    parts = [replace(piece.part, steep=piece.part.steep[count:]) for piece in nested.slices]
    others = nested.slices[0].inner.arguments
    if any(place.width.has(*others) or place.centre.has(*others) for part in parts for place in part.steep):
        return None
    return square_of_scale(joint.marginal(nested.outer), parts)


def _no_narrower(joint: Joint, o: int, least: ca.SX) -> Joint:
    """The distribution with a variance that is at least so much."""
    S, p = ca.SX(joint.S), joint.marginal(o).p
    S[o * (o + 3) // 2] = ca.if_else(p >= least, p, least)
    return replace(joint, S=S, marginals={}, pairs={})


def _frozen(u: ca.SX, width: ca.SX) -> tuple[ca.SX, ca.SX]:
    """A place to a part of its width, and that to three digits, with no derivative: the integral does not depend on them."""
    width = ca.exp(ca.floor(ca.log(width + PARALLEL) * 2**10) / 2**10)
    return ca.floor(u / width * 2**10) / 2**10 * width, width


@lru_cache(maxsize=256)
def _inner_function(
    df: DescribingFunction, slope: DescribingFunction, free: tuple[sp.Symbol, ...], count: int, turned: int
) -> ca.Function:
    """What a few nodes add: (z, u, weights, means, lean, covariances, parameters) -> sums of F, E[slope] and gains.

    Functions under one distribution share what they need of it. z may be the distance from an end; `turned` is its derivative
    in the outer argument, 1 or -1.
    """
    from cadet_sym.lowering.joint import Joint

    size = len(df.means)
    z, u, weights = (ca.SX.sym(name, count) for name in ("z", "u", "weights"))
    m, lean, S = ca.SX.sym("m", size), ca.SX.sym("lean", size), ca.SX.sym("S", len(df.covariances))
    q, total = ca.SX.sym("q", len(free) - 1), ca.SX.zeros(2 + size)
    for k in range(count):
        joint = Joint(m + lean * u[k], S, dict(zip(free, (z[k], *ca.vertsplit(q)), strict=True)))
        F, gain = joint.expectation_and_gain(df)
        values = ca.vertcat(F, joint.expectation(slope) + turned * _moving_jumps(df, joint, free[0]), gain)
        total += weights[k] * ca.if_else(weights[k] != 0, values, 0)
    total = ca.densify(total)
    arguments = [z, u, weights, m, lean, S, q]
    function = ca.Function("nodes", arguments, [total])
    return function if function.find_functions() else ca.Function("nodes", arguments, [ca.cse(total)])


@lru_cache(maxsize=256)
def _expanded_function(df: DescribingFunction, free: tuple[sp.Symbol, ...], turned: int) -> ca.Function:
    """(z, S_zz, S_zi, means, covariances of the others, parameters) -> E[f], gains, to second order in the outer argument."""
    from cadet_sym.lowering.joint import Joint

    size = len(df.means)
    z, p, c = ca.SX.sym("z"), ca.SX.sym("p"), ca.SX.sym("c", size)
    m, S, q = ca.SX.sym("m", size), ca.SX.sym("S", len(df.covariances)), ca.SX.sym("q", len(free) - 1)
    F = Joint(m, S, dict(zip(free, (z, *ca.vertsplit(q)), strict=True))).expectation(df)

    def across(value: ca.SX) -> ca.SX:
        return ca.dot(c, ca.gradient(value, m))

    slope = turned * ca.jacobian(F, z)
    bend = turned * ca.jacobian(slope, z)
    value = F + across(slope) + (p * bend + across(across(bend))) / 2
    total = ca.vertcat(value, slope + across(bend), ca.gradient(value, m))
    return ca.Function("expanded", [z, p, c, m, S, q], [ca.densify(total)])


@lru_cache(maxsize=256)
def _called(nodes: ca.Function, calls: int) -> ca.Function:
    """The same of many columns of nodes, never put in line."""
    columns = [ca.MX.sym(name, nodes.size1_in(k), calls) for k, name in enumerate(("z", "u", "weights"))]
    same = [ca.MX.sym(f"same{k}", nodes.size1_in(k)) for k in range(3, 7)]
    total = nodes.map("many", "serial", calls, [3, 4, 5, 6], [0])(*columns, *same)
    return ca.Function("nested", [*columns, *same], [total], {"never_inline": True})


def _moving_jumps(df: DescribingFunction, joint: Joint, z: sp.Symbol) -> ca.SX:
    """E of what the derivative in z of jumps J 1(y > k(z)) adds to the slope: -J k'(z) times the density of y at k."""
    total = ca.SX(0)
    for product in df.products:
        if not isinstance(product, Product) or len(product.functions) != 1:
            continue
        ((i, function),) = product.functions
        y = joint.marginal(i)
        for jump in function.jumps if not any(product.powers) else ():
            size = jump.size(0) * sp.diff(jump.position, z)
            if size != 0:
                total -= y.complex_value(product.coefficient * size).real * y.impulse(jump.position, 0)
    return total
