"""Where the line through the means of several arguments meets kinks and poles of a function: there nodes are needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import groupby

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.crossings import Crossing
from cadet_sym.expectation.steep import Steep
from cadet_sym.lowering.expressions import Lowering
from cadet_sym.lowering.gaussian import Gaussian

SPREADS = (-4.0, -2.0, 0.0, 2.0, 4.0)
NARROW = 1e-2  # standard deviations: a smoothed kink that is wider need not be met to more digits than nodes need
LOOKED_AT, BISECTIONS, NEWTONS = 65, 14, 4  # points at which a line is looked at for where it passes a curve; steps to there
BESIDE = 1e-9  # of a stretch: how near to its ends it is looked at, for at them there may be a pole
NOWHERE = 1e3  # standard deviations: beyond the widest that nodes take notice of
PARALLEL = 1e-100  # a kink of the others that does not move with the outer argument is crossed nowhere

Place = tuple[ca.SX, ca.SX]
"""Centre and width of a steep place, in standard deviations of the outer argument."""


@dataclass(frozen=True)
class MeanLine:
    """Means of other arguments given the outer one, m_i + L_i u, u = (z - m)/s, and the variances that they are left."""

    outer: Gaussian
    symbol: sp.Symbol  # the outer argument
    rest: tuple[sp.Symbol, ...]  # the others
    means: ca.SX
    lean: Sequence[ca.SX]  # L_i
    left: Sequence[ca.SX]
    scales: Sequence[ca.SX]  # their standard deviations

    def places(self, crossings: Sequence[tuple[int, Crossing]], own: Sequence[Steep], low: ca.SX, high: ca.SX) -> list[Place]:
        """Those of crossings, each with which of the others has it, and steep places of f itself, on a stretch of the line."""
        found: list[Place] = []
        for (a, place), same in groupby(crossings, lambda crossing: (crossing[0], crossing[1].place)):
            if place is not None:
                found += self._passes(place, a, low, high, len(list(same)))
                continue
            found += [self._on_curve(each, a) if each.curve is not None else self._straight(each, a) for _, each in same]
        return [*found, *map(self._own, own)]

    def _own(self, place: Steep) -> Place:
        """A steep place of f itself, as narrow as it gets for likely values of the others."""
        outer, widths, centre = self.outer, [], ca.SX(0)
        for spread in SPREADS if place.width.has(*self.rest) else (0.0,):
            likely = {z: self.means[a] + spread * self.scales[a] for a, z in enumerate(self.rest)}
            there = Lowering({**outer.env, **likely})
            widths.append(there.convert(place.width))
            centre = there.convert(place.centre) if spread == 0 else centre
        return (centre - outer.m) / outer.s, reduce(ca.fmin, widths) / outer.s

    def _straight(self, crossing: Crossing, a: int) -> Place:
        """Where the mean of another argument, given the outer one, passes its kink, and over what width."""
        outer = self.outer
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

    def _on_curve(self, crossing: Crossing, a: int) -> Place:
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

    def _passes(self, place: sp.Expr, a: int, first: ca.SX, last: ca.SX, count: int) -> Iterator[Place]:
        """The same for any curve: the first changes of sign of its distance from the line on a stretch.

        It is looked at more closely near the ends, where it may go to infinity.
        """
        outer, slope = self.outer, sp.diff(place, self.symbol)

        def point(k: ca.SX | int) -> ca.SX:
            share = ca.sin(np.pi / 2 / (LOOKED_AT - 1) * k) ** 2
            return first + (last - first) * ca.fmin(ca.fmax(share, BESIDE), 1 - BESIDE)

        def distance(u: ca.SX) -> tuple[ca.SX, Lowering]:
            there = Lowering({**outer.env, self.symbol: outer.m + outer.s * u})
            return there.convert(place) - (self.means[a] + self.lean[a] * u), there

        def is_above(u: ca.SX) -> ca.SX:
            return distance(u)[0] >= 0

        sides = [is_above(point(k)) for k in range(LOOKED_AT)]
        passed, at = ca.SX(0), [ca.SX(-1)] * count
        for k in range(LOOKED_AT - 1):
            changes = sides[k] != sides[k + 1]
            at = [ca.if_else(ca.logic_and(changes, passed == branch), k, found) for branch, found in enumerate(at)]
            passed += changes
        for found in at:
            low, high = point(found), point(found + 1)
            side, begin, end = is_above(low), low, high
            for _ in range(BISECTIONS):
                middle = (low + high) / 2
                same = is_above(middle) == side
                low, high = ca.if_else(same, middle, low), ca.if_else(same, high, middle)
            u = (low + high) / 2
            for _ in range(NEWTONS):
                left, there = distance(u)
                speed = there.convert(slope) * outer.s - self.lean[a]
                u = ca.fmin(ca.fmax(u - left / ca.if_else(speed != 0, speed, PARALLEL), begin), end)
            speed = ca.fabs(distance(u)[1].convert(slope) * outer.s - self.lean[a])
            width = ca.sqrt(self.left[a]) / ca.fmax(speed, PARALLEL)
            yield _frozen(ca.if_else(found >= 0, u, NOWHERE), ca.if_else(found >= 0, width, 1))


def _frozen(u: ca.SX, width: ca.SX) -> tuple[ca.SX, ca.SX]:
    """A place to a part of its width, and that to three digits, with no derivative: the integral does not depend on them."""
    width = ca.exp(ca.floor(ca.log(width + PARALLEL) * 2**10) / 2**10)
    return ca.floor(u / width * 2**10) / 2**10 * width, width
