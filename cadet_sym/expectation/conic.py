"""Conics in the plane of two Gaussian arguments, and where the nodes of an integral along one go.

With z = m + L w, w standard normal, phi = exp(-|w|^2/2)/2 pi, a curve is run through by w(t). What is integrated is phi times
polynomials, and phi times theta' = (w1 w2' - w2 w1')/|w|^2, the rate of the angle under which the mean sees it. In coordinates
p, q the curve is a parabola q = a p^2 + b p + c, a branch of the hyperbola p q = c, or the circle p^2 + q^2 = c, and t is
(p - m)/s, log |p| or the angle: phi is an entire function of it. theta' has two poles, where w1 + i w2 = 0, in closed form:
near to the line where the curve comes near to the mean, or crosses the long axis of a distribution of nearly full correlation.
Either side of both is run through by t = c +- l sinh(tau), with as many nodes of Gauss and Legendre as its length in tau asks
for; l is the distance of the pole, or what |w| takes to change by one if that is shorter.

All is written in distances from these two places, so that nothing is lost however narrow the distribution is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import ClassVar

from cadet_sym.expectation.algebra import Algebra, Number
from cadet_sym.expectation.pairs import FAR, TINY, Pair, over, roots, times
from cadet_sym.expectation.planar import Moments

REACH = 8.0  # standard deviations; 1e-14 of the density lies beyond
NARROWEST = 1e-12  # standard deviations from the curve that the mean keeps
NEARER = 0.2  # than the scale of all else a pole is to have a stretch of its own
EACH, BY_A_POLE = 5.5, 1.8  # nodes for a unit of tau; the same where all that changes is how far the pole is
STRAIGHT = 0.6  # of its slope, that a bend takes off it at most
ALMOST = 1e-5  # of the distance to a pole, what the bend of the curve makes of it
LOST = 1e-13  # relative distances that rounding leaves nothing of
LEAST = 3e-10  # of what a curve rises over a standard deviation, the least standard deviation across
TWO_SIDED, STEEPEST = 40.0, 1e-12


@dataclass(frozen=True)
class Point:
    """A point of a curve, and its derivatives in t."""

    p: Number
    q: Number
    w: Pair
    slopes: Pair  # of w
    turning: Number  # theta'


@dataclass(frozen=True)
class Side:
    """A stretch of a curve near to a place where it is steep: t = t_c + sign l sinh(tau), first < tau < last."""

    first: Number
    last: Number
    length: Number  # l
    sign: Number
    centre: tuple[Number, ...]  # what `point` needs of t_c
    each: float  # nodes for a unit of its length in tau

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All of them."""
        return self.first, self.last, self.length, self.sign, *self.centre


@dataclass(frozen=True)
class Course:
    """A curve under one distribution."""

    is_left: Number  # whether the mean lies on the left hand of it
    there: Number  # one, or zero if there is no such curve within reach
    numbers: tuple[Number, ...]  # what `point` needs
    sides: tuple[Side, ...]


class Parabola:
    """q = a p^2 + b p + c, run through from the left to the right: above it is on the left hand."""

    known: ClassVar[int] = 9
    centre: ClassVar[int] = 5
    spaced: ClassVar[float] = math.inf
    each: ClassVar[float] = 10.0  # exp(-u^4) asks for more

    @staticmethod
    def course(at: Moments, shape: Sequence[Number], _branch: int, xp: Algebra) -> Course:
        """The curve under a distribution."""
        a, b, c = shape
        A = a * at.s * at.s  # left w2 = A u^2 + B u + C along it, u = w1
        B = (2 * a * at.m + b) * at.s - at.lean
        C = (a * at.m + b) * at.m + c - at.mean
        found = roots((A, 0.0 * A), (B, -at.left + 0.0 * A), (C, 0.0 * A), xp)
        places, poles = [], []
        for number, (real, imaginary) in enumerate(found):
            u = xp.fmin(xp.fmax(real, -REACH), REACH)
            rise = (2 * A * u + B) / at.left
            speed = xp.sqrt(1 + rise * rise)
            sign = -_sign(C, xp) if number == 0 else _sign(imaginary, xp)
            imaginary = _apart(imaginary, sign, NARROWEST / speed, xp)
            poles.append((real, imaginary))
            places.append((u, _least(speed, xp.sqrt(imaginary**2 + (real - u) ** 2), xp), 1 / speed))
        low, high = _in_order(places[0], places[1], places[0][0] > places[1][0], xp)
        first, last = _within(A, B + at.lean, C, at.spread, xp)
        down = xp.fmin(xp.fmax(low[0] - xp.fmax(first, -REACH), REACH * low[2]), low[0] + REACH)
        up = xp.fmin(xp.fmax(xp.fmin(last, REACH) - high[0], REACH * high[2]), REACH - high[0])
        between = (high[0] - low[0]) / 2
        apart = xp.sqrt((poles[0][0] - poles[1][0]) ** 2 + (poles[0][1] - poles[1][1]) ** 2)
        sides = []
        low[1], high[1] = _seen(low[1], high[1], 2 * between, xp), _seen(high[1], low[1], 2 * between, xp)
        for (u, wide, scale), length, sign in ((low, down, -1.0), (low, between, 1.0), (high, between, -1.0), (high, up, 1.0)):
            about = _about(u, A, B, C, at.left, [real for real, _ in poles])
            sides += _sides(length, wide, xp.fmin(scale, apart), sign, about, Parabola, xp)
        numbers = (at.m, at.s, at.left, A, a, b, c, *(imaginary for _, imaginary in poles))
        return Course(C <= 0, xp.where(first <= last, 1.0, 0.0), numbers, tuple(sides))

    @staticmethod
    def point(numbers: Sequence[Number], centre: Sequence[Number], d: Number, xp: Algebra) -> Point:
        """The point at t_c + d."""
        m, s, left, A, a, b, c, *heights = numbers
        u, height, rise, *away = centre
        u, bend = u + d, A / left * d
        p = m + s * u
        turning = sum(im / ((d + off) ** 2 + im**2) for im, off in zip(heights, away, strict=True))
        w = u, height + (rise + bend) * d
        return Point(p, (a * p + b) * p + c, w, (1.0 + 0.0 * u, rise + 2 * bend), turning)


class Hyperbola:
    """The branch of p q = c with p > 0 or p < 0, away from p = 0: where p q > c is on its left hand."""

    known: ClassVar[int] = 6
    centre: ClassVar[int] = 7
    spaced: ClassVar[float] = 1.0  # of log |p|, beyond which nodes are equally spaced: there phi is exp(-exp(2 t))
    each: ClassVar[float] = EACH

    @staticmethod
    def course(at: Moments, shape: Sequence[Number], branch: int, xp: Algebra) -> Course:
        """The curve under a distribution."""
        c = xp.where(xp.fabs(shape[0]) > TINY, shape[0], TINY)
        over, m = at.m * at.mean - c, branch * at.m
        # p s left (w1 + i w2) = s (s (left - i lean) u^2 + (m (left - i lean) - i s m_q) u - i over)
        linear = at.m * at.left, -at.m * at.lean - at.s * at.mean
        found = roots((at.s * at.left, -at.s * at.lean), linear, (0.0 * c, -over), xp)
        least, most, there = Hyperbola._extent(at, c, m, branch, xp)
        places, poles = [], []
        for number, (x, y) in enumerate(found):
            real, imaginary = at.m + at.s * x, at.s * y
            size = xp.sqrt(real**2 + imaginary**2) + TINY
            inside = xp.fmin(xp.fmax(size, least), most)
            own, p = inside == size, branch * inside
            near = (2 * at.m * x + at.s * (x * x + y * y)) / (xp.fabs(size + m) * branch + branch * TINY)
            u = xp.where(xp.where(own, m, -1.0) > 0, near, (p - at.m) / at.s)
            slopes = p / at.s, (-c / p - at.lean * (p / at.s)) / at.left
            speed = xp.sqrt(slopes[0] ** 2 + slopes[1] ** 2)
            sign = _sign(over, xp) * branch if number == 0 else _sign(imaginary, xp)
            ahead = branch * real
            angle = xp.atan2(xp.fabs(imaginary), ahead)
            imaginary = xp.where(angle < NARROWEST / speed, sign * size * NARROWEST / speed, imaginary)
            wide = xp.sqrt(xp.atan2(xp.fabs(imaginary), ahead) ** 2 + xp.log(inside / size) ** 2)
            rest = xp.where(ahead > 0, imaginary**2 / (size + xp.fabs(real)), size - ahead)
            poles.append((real, imaginary, branch * rest, own))
            lost = xp.where(own, xp.fmin(REACH / speed, 1.0), 0.0)
            places.append((p, u, _least(speed, wide, xp), 1.0 * number, lost, 1 / speed))
        low, high = _in_order(places[0], places[1], branch * places[0][0] > branch * places[1][0], xp)
        gap = xp.log1p(xp.fmax((high[1] - low[1]) * at.s / low[0], -0.5)) / 2
        between = [xp.where(xp.where(xp.fmin(low[4], high[4]) > 0, 1.0, gap) > LOST, gap, x[4]) for x in (low, high)]
        down, up = xp.log(branch * low[0] / least), xp.log(most / (branch * high[0]))
        low[2], high[2] = _seen(low[2], high[2], 2 * gap, xp), _seen(high[2], low[2], 2 * gap, xp)
        angles = (xp.atan2(imaginary, branch * real) for real, imaginary, _, _ in poles)
        apart = xp.sqrt(4 * gap**2 + (next(angles) - next(angles)) ** 2)
        lengths = xp.fmax(down, low[4]), *between, xp.fmax(up, high[4])  # ends may be lost to rounding
        sides = []
        for place, length, sign in zip((low, low, high, high), lengths, (-1.0, 1.0, -1.0, 1.0), strict=True):
            p, u, wide, which, _, scale = place
            away = []
            for number, (real, _, rest, own) in enumerate(poles):
                away.append(xp.where(xp.where(own, which, -1.0) == number, rest, p - real))
            height = ((-over - at.mean * at.s * u) / p - at.lean * u) / at.left
            centre = p, u, height, c / p, p / at.s, *away
            sides += _sides(length, wide, xp.fmin(scale, apart), sign, centre, Hyperbola, xp)
        numbers = (at.s, at.lean, at.left, c, poles[0][1], poles[1][1])
        return Course(over > 0, xp.where(there, 1.0, 0.0), numbers, tuple(sides))

    @staticmethod
    def _extent(at: Moments, c: Number, m: Number, branch: int, xp: Algebra) -> tuple[Number, Number, Number]:
        """The least and the largest |p| within reach; whether there is any."""
        along = branch * _sign(c, xp) * at.mean
        size = xp.fabs(c)
        nearest = xp.fmax(along - REACH * at.spread, TINY)
        most = xp.fmin(m + REACH * at.s, size / nearest)
        least = xp.fmax(m - REACH * at.s, size / xp.fmax(along + REACH * at.spread, TINY))
        there = most >= least
        return xp.where(there, least, 1.0), xp.where(there, most, 2.0), there

    @staticmethod
    def point(numbers: Sequence[Number], centre: Sequence[Number], d: Number, xp: Algebra) -> Point:
        """The point at t_c + d."""
        s, lean, left, c, *heights = numbers
        start, u, height, other, ratio, *away = centre
        change = xp.expm1(d)
        p, u = start * (1 + change), u + ratio * change
        q, slope = c / p, p / s
        w = u, height - change * (other / (1 + change) + lean * ratio) / left
        turning = sum(p * im / ((start * change + off) ** 2 + im**2) for im, off in zip(heights, away, strict=True))
        return Point(p, q, w, (slope, (-q - lean * slope) / left), turning)


class Circle:
    """p^2 + q^2 = c, run through from p to q: within is on its left hand."""

    known: ClassVar[int] = 9
    centre: ClassVar[int] = 6
    spaced: ClassVar[float] = math.inf
    each: ClassVar[float] = EACH

    @staticmethod
    def course(at: Moments, shape: Sequence[Number], _branch: int, xp: Algebra) -> Course:
        """The curve under a distribution."""
        c = xp.fmax(shape[0], TINY)
        radius, over = xp.sqrt(c), at.m * at.m + at.mean * at.mean - c
        found = roots(  # of p + i q, from the mean on
            ((at.left + at.s) / 2, -at.lean / 2),
            (at.s * at.m + at.lean * at.mean, at.left * at.mean),
            (-over / 2 * (at.left - at.s), over / 2 * at.lean),
            xp,
        )
        places, poles = [], []
        for number, (x, y) in enumerate(found):
            real, imaginary = at.m + x, at.mean + y
            size = xp.sqrt(real**2 + imaginary**2)
            angle = xp.atan2(imaginary, real)
            beyond = over + 2 * (at.m * x + at.mean * y) + x * x + y * y  # |root|^2 - c
            p, q = radius * xp.cos(angle), radius * xp.sin(angle)
            shrink, is_far = beyond / (size + radius) / xp.fmax(size, TINY), size < radius / 10
            across = xp.where(is_far, p - at.m, x - real * shrink), xp.where(is_far, q - at.mean, y - imaginary * shrink)
            slopes = -q / at.s, (p + at.lean * (q / at.s)) / at.left
            speed = xp.sqrt(slopes[0] ** 2 + slopes[1] ** 2)
            w1, bend = across[0] / at.s, p / at.s
            w, bends = (w1, (across[1] - at.lean * w1) / at.left), (bend, (q - at.lean * bend) / at.left)
            rest, is_near = _step(w, slopes, bends, xp)
            depth = xp.where(is_near, -rest[1], xp.log1p(xp.fmax(beyond / c, -1 + STEEPEST)) / 2)
            sign = _sign(over, xp) if number == 0 else _sign(depth, xp)
            depth = xp.fmax(xp.fmin(_apart(depth, sign, NARROWEST / speed, xp), TWO_SIDED), -TWO_SIDED)
            grow = xp.exp(depth / 2)
            half = xp.where(xp.fabs(depth) < 1e-3, depth / 2 + depth**3 / 48, (grow - 1 / grow) / 2)
            poles.append((angle, xp.where(is_near, -rest[0], 0.0), half * (grow + 1 / grow), 2 * half * half))
            reach = _reach(w, slopes, bends, xp)
            places.append((angle, _least(speed, xp.fabs(depth), xp), 1 / speed, reach, p, q, *across))
        turn = places[1][0] - places[0][0]
        turn = turn - 2 * math.pi * xp.floor(turn / (2 * math.pi) + 0.5)
        sign, turn = _sign(turn, xp), xp.fabs(turn)
        widest = REACH * xp.sqrt(at.s**2 + at.spread**2)
        sides = []
        one, two = (place[1] for place in places)
        widths = _seen(one, two, turn, xp), _seen(two, one, turn, xp)
        for (angle, _, scale, farthest, *rest), wide, ahead in zip(places, widths, (sign, -sign), strict=True):
            reach = 2 * xp.asin(xp.fmin((widest + xp.sqrt(rest[2] ** 2 + rest[3] ** 2)) / (2 * radius), 1.0))
            reach = xp.fmin(reach, farthest)
            away = [own if own_angle is angle else angle - own_angle for own_angle, own, _, _ in poles]
            for length, side in ((turn / 2, ahead), (math.pi - turn / 2, -ahead)):
                sides += _sides(xp.fmin(length, reach), wide, scale, side, (*rest, *away), Circle, xp)
        numbers = (at.m, at.mean, at.s, at.lean, at.left, *(x for _, _, *own in poles for x in own))
        return Course(over <= 0, xp.where(shape[0] > TINY, 1.0, 0.0), numbers, tuple(sides))

    @staticmethod
    def point(numbers: Sequence[Number], centre: Sequence[Number], d: Number, xp: Algebra) -> Point:
        """The point at t_c + d."""
        m, mean, s, lean, left, *own = numbers
        p, q, x, y, *away = centre
        sine, half = xp.sin(d), xp.sin(d / 2)
        fall = 2 * half * half  # 1 - cos(d)
        right, up = -p * fall - q * sine, p * sine - q * fall
        w = (x + right) / s, (y - lean * (x / s)) / left + (up - lean * (right / s)) / left
        p, q = m + x + right, mean + y + up
        turning = 0.0
        for steep, depth, off in zip(own[::2], own[1::2], away, strict=True):
            turning = turning - steep / (2 * (depth + 2 * xp.sin((off + d) / 2) ** 2))
        return Point(p, q, w, (-q / s, (p + lean * (q / s)) / left), turning)


def widened(at: Moments, kind: str, shapes: Sequence[Sequence[Number]], xp: Algebra) -> Moments:
    """The same, no narrower in one direction than rounding in the other leaves of where a curve passes the mean.

    That is `LEAST` of by how much the curve rises over a standard deviation of p: what has so little variance has none.
    """
    rises: list[Number] = [0.0 * at.s]
    for shape in shapes:
        if kind == "parabola":
            a, b, _ = shape
            rises.append((xp.fabs(2 * a * at.m + b) + xp.fabs(a) * at.s) * at.s)
        else:
            rises.append(xp.fabs(at.mean) if kind == "hyperbola" else at.s)
    least = LEAST * reduce(xp.fmax, rises)
    s = xp.fmax(at.s, LEAST * at.spread) if kind == "circle" else at.s
    return replace(at, s=s, left=xp.fmax(at.left, least), spread=xp.fmax(at.spread, least))


Curve = type[Parabola] | type[Hyperbola] | type[Circle]
CURVES: dict[str, Curve] = {"parabola": Parabola, "hyperbola": Hyperbola, "circle": Circle}


# -- in small ---------------------------------------------------------------------------------------------------------


def _sign(x: Number, xp: Algebra) -> Number:
    return xp.where(x > 0, 1.0, -1.0)


def _apart(x: Number, sign: Number, least: Number, xp: Algebra) -> Number:
    """The number, no smaller than that in size."""
    return xp.where(xp.fabs(x) < least, sign * least, x)


def _least(speed: Number, distance: Number, xp: Algebra) -> Number:
    """The shorter one of 1/speed and a distance, roughly."""
    return 1 / xp.sqrt(speed**2 + 1 / distance**2)


def _step(w: Pair, slopes: Pair, bends: Pair, xp: Algebra) -> tuple[Pair, Number]:
    """From a point very near to the zero of w1 + i w2 to that; whether it is that near. The second derivatives are -`bends`."""
    step = over((-w[0], -w[1]), slopes, xp)
    half = times(step, over((bends[0] / 2, bends[1] / 2), slopes, xp))
    bent = times(step, (1 + half[0], half[1]))
    return bent, xp.fabs(half[0]) + xp.fabs(half[1]) < ALMOST


def _reach(w: Pair, slopes: Pair, bends: Pair, xp: Algebra) -> Number:
    """How far along a curve one of w has surely left reach, if it moves straight for so long; else for ever."""
    found: Number = FAR
    for x, slope, bend in zip(w, slopes, bends, strict=True):
        length = 2 * (REACH + xp.fabs(x)) / (xp.fabs(slope) + TINY)
        found = xp.fmin(found, xp.where(length * xp.fabs(bend) < STRAIGHT * xp.fabs(slope), length, FAR))
    return found


def _seen(wide: Number, other: Number, gap: Number, xp: Algebra) -> Number:
    """The width of a place, or how far the other one is from it if that is less."""
    return xp.fmin(wide, xp.sqrt(gap**2 + other**2))


def _in_order(a: tuple[Number, ...], b: tuple[Number, ...], swap: Number, xp: Algebra) -> tuple[list[Number], list[Number]]:
    return [xp.where(swap, y, x) for x, y in zip(a, b, strict=True)], [xp.where(swap, x, y) for x, y in zip(a, b, strict=True)]


def _sides(
    length: Number, wide: Number, scale: Number, sign: Number, centre: tuple[Number, ...], curve: Curve, xp: Algebra
) -> list[Side]:
    """A stretch from a place on, cut where it has come as far as the `scale` of all else, if the pole is much nearer."""
    length = xp.fmax(length, 0.0)
    cut = xp.where(wide < NEARER * scale, xp.fmin(scale, length), 0.0)
    sign, far = sign + 0.0 * wide, xp.where(cut > 0, scale, wide)
    near = Side(0.0 * wide, inner(cut, wide, curve.spaced, xp), wide, sign, centre, BY_A_POLE)
    return [near, Side(inner(cut, far, curve.spaced, xp), inner(length, far, curve.spaced, xp), far, sign, centre, curve.each)]


def inner(distance: Number, wide: Number, spaced: float, xp: Algebra) -> Number:
    """tau at a distance from a place: l sinh(tau), or spaced sinh(distance/spaced)."""
    if spaced < math.inf:
        grown = xp.expm1(distance / spaced)
        distance = spaced * (grown + grown / (1 + grown)) / 2
    return xp.asinh(distance / wide)


def outer(tau: Number, wide: Number, spaced: float, xp: Algebra) -> tuple[Number, Number]:
    """The distance, and its derivative in tau."""
    grow = xp.exp(tau)
    distance, slope = wide * (grow - 1 / grow) / 2, wide * (grow + 1 / grow) / 2
    if spaced < math.inf:
        ratio = distance / spaced
        distance, slope = spaced * xp.asinh(ratio), slope / xp.sqrt(ratio * ratio + 1)
    return distance, slope


def _about(u: Number, A: Number, B: Number, C: Number, left: Number, poles: Sequence[Number]) -> tuple[Number, ...]:
    """A place on a parabola: u, w2 and its slope there, and how far it is from the poles."""
    return (u, ((A * u + B) * u + C) / left, (2 * A * u + B) / left, *(u - pole for pole in poles))


def _within(A: Number, B: Number, C: Number, spread: Number, xp: Algebra) -> Pair:
    """Ends of where |A u^2 + B u + C| is within reach of the inner argument, not given the outer one; in no order: nowhere."""
    C = C - _sign(A, xp) * REACH * spread
    real = B * B - 4 * A * C
    q = -(B + _sign(B, xp) * xp.sqrt(xp.fmax(real, 0.0))) / 2
    ends = q / xp.where(xp.fabs(A) > TINY, A, TINY), C / xp.where(xp.fabs(q) > TINY, q, TINY)
    low, high = xp.fmin(*ends), xp.fmax(*ends)
    return low, xp.where(real >= 0, high, low - 1.0)
