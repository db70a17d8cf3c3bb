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
from cadet_sym.lowering.gaussian import Gaussian, beyond_reach, resolved

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

SPREADS = (-4.0, -2.0, 0.0, 2.0, 4.0)
TOGETHER = 8  # nodes of one call, by which it is faster and larger
NARROW = 1e-2  # standard deviations: a smoothed kink that is wider need not be met to more digits than nodes need
LEFT = 1e-13  # of the variance of another argument, at full correlation: so little is not felt, and nodes see jumps then
LOOKED_AT, BISECTIONS = 65, 40  # points at which a line is looked at for where it passes a curve
NOWHERE = 1e3  # standard deviations: beyond the widest that nodes take notice of
PARALLEL = 1e-100  # a kink of the others that does not move with the outer argument is crossed nowhere


def nested_moments(nested: Nested, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of every argument."""
    return _Conditioning(nested, joint).moments()


class _Conditioning:
    """The other arguments given the outer one: mean m_i + L_i u, covariance S_ij - L_i L_j, u = (z - m)/s."""

    def __init__(self, nested: Nested, joint: Joint):
        self.nested = nested
        stands = all(crossing.curve is None and crossing.place is None and crossing.slope == 0 for crossing in nested.crossings)
        self.joint = joint = _resolved(nested, joint) if stands else joint
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
        return F, gains

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


def _resolved(nested: Nested, joint: Joint) -> Joint:
    """The distribution with an outer variance whose derivatives are not lost to rounding."""
    count = len(nested.crossings)
    parts = [replace(piece.part, steep=piece.part.steep[count:]) for piece in nested.slices]
    others = nested.slices[0].inner.arguments
    if any(place.width.has(*others) or place.centre.has(*others) for part in parts for place in part.steep):
        return joint
    o, S = nested.outer, ca.SX(joint.S)
    S[o * (o + 3) // 2] = resolved(joint.marginal(o), parts)
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
