"""Expectations over one argument by quadrature: the nodes of a smooth piece of f, and what stands for them without variance."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.panels import REACH, lay_out
from cadet_sym.expectation.quadrature import Integral
from cadet_sym.expectation.steep import about_end, without_cancellation
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.expressions import Lowering
from cadet_sym.lowering.special import clipped, density, hermite

if TYPE_CHECKING:
    from cadet_sym.lowering.gaussian import Gaussian

NEAREST = 1e-14  # of a standard deviation, and of a place, that nodes keep from it
SMALLEST = 1e-100  # so that a wave without a slope changes over a length that is a number
NEAR = 1e-11  # of the square of the scale on which f changes: a variance in which f is expanded


class Panels:
    """A piece laid out once; its nodes and what is evaluated there are shared by the value and the derivatives.

    A piece with a singular end is taken in the distance from it, x = |z - k|, so that x^q is exact. Nodes go by a standard
    deviation, and so the derivative of their sum in the variance is lost to rounding where there is nearly none: there it is
    f + p f''/2.
    """

    def __init__(self, gaussian: Gaussian, part: Integral):
        self.ends, self.p = (part.lower, part.upper), gaussian.p
        self.square = square_of_scale(gaussian, [part])
        self.least = ca.SX(0) if self.square is None else NEAR * self.square
        g = self.gaussian = gaussian.of_variance(ca.if_else(self.p >= self.least, self.p, self.least))
        self.low = ca.SX(-REACH) if part.lower.is_infinite else g.within(part.lower)
        self.high = ca.SX(REACH) if part.upper.is_infinite else ca.fmax(self.low, g.within(part.upper))
        steep = [((g.value(p.centre) - g.m) / g.s, g.value(p.width) / g.s) for p in part.steep]
        self.nodes = lay_out(part, self.low, self.high, steep, CasadiAlgebra())
        self.side = part.singular[1] - part.singular[0]
        if self.side:
            end = part.upper if self.side > 0 else part.lower
            self.symbol = sp.Dummy("x", positive=True)
            self.value = about_end(part.value, part.argument, end, self.side, self.symbol)
            self.gap = beyond_reach(g, end, self.side)
            beyond = self.side * (g.value(end) - g.m)
            near = [(n.distance, beyond - self.side * g.s * n.u) for n in self.nodes if n.distance is not None]
            points = [ca.if_else(self.gap > 0, far, g.s * distance) for distance, far in near]
        else:
            self.symbol, self.value = part.argument, part.value
            points = [self._inside(part, g.m + g.s * n.u) for n in self.nodes]
        self.somewhere = points[0][0] if points else g.m  # no nodes: for the numbers at hand there is nothing of it
        self.lowerings = [Lowering({**g.env, self.symbol: z}, split_powers=True) for z in points]

    def _inside(self, part: Integral, points: ca.SX) -> ca.SX:
        """The points, none on an end at which a root of the function may be, that of several places being the last or first."""
        g = self.gaussian
        for end, side in ((part.lower, 1), (part.upper, -1)):
            if isinstance(end, sp.Max | sp.Min):
                bound = g.value(end)
                nearest = bound + side * NEAREST * (g.s + ca.fabs(bound))
                points = ca.fmax(points, nearest) if side > 0 else ca.fmin(points, nearest)
        return points

    def total(self, order: int) -> ca.SX:
        """E of the piece, or of its derivative."""
        expr = sp.diff(self.value, self.symbol, order) if order else self.value
        if self.side and order:
            value = sum((self._slope(i) for i in range(len(self.nodes))), start=ca.SX(0))
        else:
            value = sum((self._sum(i, expr) for i in range(len(self.nodes))), start=ca.SX(0))
            if order > 1 and self.square is not None and not any(isinstance(end, sp.Max | sp.Min) for end in self.ends):
                value = ca.if_else(self.p > self.square, self._by_parts(order), value)
        value = ca.if_else(self.high > self.low, value, 0)
        if self.least.is_zero():
            return value
        turned = (-self.side) ** order if self.side else 1  # the derivative of the distance in the mean
        return ca.if_else(self.p < self.least, turned * self._expanded(expr), value)

    def _expanded(self, expr: sp.Expr) -> ca.SX:
        """E of an expression without kinks within reach, to first order in the variance."""
        g, x = self.gaussian, ca.SX.sym("x")
        lower, upper = (ca.SX(-ca.inf if k == 0 else ca.inf) if e.is_infinite else g.value(e) for k, e in enumerate(self.ends))
        inside = ca.logic_and(self.p < self.least, ca.logic_and(g.m > lower, g.m < upper))
        mean = g.m if not self.side else upper - g.m if self.side > 0 else g.m - lower
        f = Lowering({**g.env, self.symbol: x}, split_powers=True).convert(expr)
        value = f + self.p / 2 * ca.jacobian(ca.jacobian(f, x), x)
        return ca.if_else(inside, ca.substitute(value, x, ca.if_else(inside, mean, self.somewhere)), 0)

    def _by_parts(self, order: int) -> ca.SX:
        """The derivatives taken by the density, which is smoother than f where f changes within a standard deviation."""
        g, total = self.gaussian, ca.SX(0)
        for i, nodes in enumerate(self.nodes):
            total += self._sum(i, self.value, hermite(nodes.u, order)) / g.s**order
        for end, side in zip(self.ends, (-1, 1), strict=True):
            if not end.is_infinite:
                u, there = clipped((g.value(end) - g.m) / g.s), Lowering({**g.env, self.symbol: g.value(end)})
                for j in range(order):
                    change = side * there.convert(sp.diff(self.value, self.symbol, order - 1 - j))
                    total += change * hermite(u, j) * density(u) / g.s ** (j + 1)
        return total

    def _sum(self, i: int, expr: sp.Expr, factor: ca.SX | float = 1.0) -> ca.SX:
        weight = self.nodes[i].weight * factor
        values = ca.SX(self.lowerings[i].convert(expr))
        return ca.dot(weight, values if values.shape == weight.shape else ca.repmat(values, *weight.shape))

    def _slope(self, i: int) -> ca.SX:
        """The derivative; where the singular end is within reach by parts, for f' may be infinite there."""
        g, nodes = self.gaussian, self.nodes[i]
        slope = without_cancellation(-self.side * sp.diff(self.value, self.symbol), self.symbol)
        plain = self._sum(i, slope)
        if nodes.length is None:
            return plain
        origin = self.value.subs(self.symbol, 0).replace(_is_zero_power, lambda _: sp.S.Zero)
        change = self.value - origin if origin.is_finite else self.value
        last = Lowering({**g.env, self.symbol: g.s * nodes.length}).convert(change)
        end = self.high if self.side > 0 else self.low
        boundary = last * density(end - self.side * nodes.length)
        parts = (self._sum(i, change, nodes.u) - self.side * boundary) / g.s
        return ca.if_else(self.gap > 0, plain, parts)


def _is_zero_power(expr: sp.Basic) -> bool:
    """0**q, q a parameter: zero for any q that leaves f finite there, and without a logarithm of 0 in its derivative in q."""
    return isinstance(expr, sp.Pow) and expr.base == 0


def square_of_scale(gaussian: Gaussian, parts: Iterable[Integral]) -> ca.SX | None:
    """The square of the least length over which f changes around the mean, or the distance to a kink if that is less."""
    squares = []
    for part in parts:
        for place in part.steep:
            width, distance = gaussian.value(place.width), gaussian.m - gaussian.value(place.centre)
            squares.append(ca.if_else(width > 0, width, distance) ** 2)
        squares += [(gaussian.m - gaussian.value(end)) ** 2 for end in (part.lower, part.upper) if not end.is_infinite]
        for wave in part.value.atoms(sp.sin, sp.cos):
            slope = sp.diff(wave.args[0], part.argument)
            if slope.free_symbols - gaussian.env.keys():
                return None
            squares.append(1 / (gaussian.value(slope) ** 2 + SMALLEST))
    return reduce(ca.fmin, squares) if squares else None


def beyond_reach(gaussian: Gaussian, end: sp.Expr, side: int) -> ca.SX:
    """How far an end is beyond reach; zero if it is within; `side` is 1 for an upper end, -1 for a lower one."""
    beyond = side * (gaussian.value(end) - gaussian.m) / gaussian.s - REACH
    return ca.if_else(beyond > 0, beyond, 0)
