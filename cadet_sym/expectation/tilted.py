"""The normal distribution times exp(-t Q), Q a sum of squares, and integrals over t: what `quadratic` leaves to be added up.

In the principal axes of the covariance of y_1 .. y_r, where they are eta_k + s_k e_k, e_k independent standard normal, the
normal density times exp(-t Q) is normal again,

    E[exp(-t Q)] = exp(-t (c + sum eta_k^2/p_k)) / sqrt(prod p_k),    p_k = 1 + 2 t s_k^2,

with means eta_k/p_k and variances s_k^2/p_k, under which the mean of a monomial is known. What is added up is positive where f
is: nothing cancels, however far the mean lies from the origin and however unlike the axes are. The integral is taken in equal
steps of x (H. Takahasi and M. Mori, Publ. RIMS Kyoto Univ. 9 (1974), 721),

    log(t E[Q]) = x - exp(LOW - x) + exp(x - high),    exp(-high) = twice the least s_k^2, or part of c, over E[Q],

towards both ends of which the integrand falls like the exponential of an exponential.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import exp, gamma, log, nan
from operator import mul

from cadet_sym.expectation.algebra import Algebra, Number
from cadet_sym.expectation.gammafunction import digamma, reciprocal_gamma
from cadet_sym.expectation.quadratic import Row, Shape, Terms, less

LOW = -0.8  # of x, where t begins to fall as the exponential of an exponential
CLOSER = 0.03  # the part of c
NEGLIGIBLE = 30.0  # exponent of what is left out at either end
NARROW = 1e-20  # square of an axis over E[Q] that narrower ones are taken for
SWEEPS = 6  # of rotations into the principal axes
PLACES = 24  # at which it is looked how far the integrand reaches
FAR_BEYOND = 4.2  # of high, where with c the integrand is negligible
UNLIKE = 1e-6  # square of the ratio of axes up to which f may be one of the narrowest alone
ROUNDING = 1e-16  # of a variance, what is known of it where others are given
COUNTS = (24, 32, 40, 48, 64, 80, 104, 136, 176, 240)  # of nodes


@dataclass(frozen=True)
class Tilted:
    """N(m, S) times exp(-t Q), normalised, and its weight sqrt(width) exp(-exponent)."""

    m: list[Number]
    answers: list[list[Number]]  # dm/dm_j of what is not tilted, j <= r
    S: list[Number]  # lower triangle row by row
    exponent: Number
    width: Number


@dataclass(frozen=True)
class Frame:
    """A normal distribution of y in the principal axes of y_1 .. y_r; hats are lengths over the root of E[Q]."""

    first: Number  # x at the first node, and at the last
    last: Number
    high: Number
    scale: Number  # E[Q]
    c: Number  # hat, squared, as the next two
    eta: list[Number]
    s: list[Number]
    means: list[Number]  # eta, not over anything
    base: list[Number]  # means of y_i, i > r
    leans: list[list[Number]]  # what y_i is times eta_k/p_k, of i > r times t eta_k/p_k
    covariances: list[list[Number]]  # what the lower triangle of the covariance is times 1/p_k
    rest: list[Number]  # what is left of it whatever t is, of i, j > r

    @property
    def numbers(self) -> list[Number]:
        """All of them."""
        flat = [x for rows in (self.leans, self.covariances) for row in rows for x in row]
        head = [self.first, self.last, self.high, self.scale, self.c, *self.eta, *self.s, *self.means, *self.base]
        return [*head, *flat, *self.rest]

    @staticmethod
    def of_numbers(numbers: Sequence[Number], shape: Shape) -> Frame:
        """From what `numbers` gives."""
        n, r, m = shape.size, shape.rank, shape.size - shape.rank
        left = iter(numbers)

        def some(count: int) -> list[Number]:
            return [next(left) for _ in range(count)]

        first, last, high, scale, c = some(5)
        eta, s, means, base = some(r), some(r), some(r), some(m)
        leans = [some(r) for _ in range(n)]
        covariances = [some(r) for _ in range(n * (n + 1) // 2)]
        return Frame(first, last, high, scale, c, eta, s, means, base, leans, covariances, some(m * (m + 1) // 2))

    def tilted(self, t: Number) -> Tilted:
        """The distribution times exp(-t Q/E[Q])."""
        n, r = len(self.leans), len(self.s)
        inverse = [1 / (1 + 2 * t * s) for s in self.s]
        S = [_dot(row, inverse) for row in self.covariances]
        by_axis = [[x * each for x, each in zip(row, inverse, strict=True)] for row in self.leans]
        by_axis[r:] = [[t * x for x in row] for row in by_axis[r:]]
        m = [_dot(row, self.means) for row in by_axis]
        m[r:] = [base + x for base, x in zip(self.base, m[r:], strict=True)]
        answers = [[_dot(row, axis) for axis in self.leans[:r]] for row in by_axis]
        free = [i * (i + 1) // 2 + j for i in range(r, n) for j in range(r, i + 1)]
        for k, x in zip(free, self.rest, strict=True):
            S[k] = S[k] + x
        return Tilted(m, answers, S, t * (self.c + _dot(self.eta, inverse)), _product(inverse))


def frame_of(shape: Shape, m: Sequence[Number], S: Sequence[Number], c: Number, floor: float, xp: Algebra) -> Frame:
    """That of N(m, S), S given by its lower triangle row by row; every variance is larger by `floor`."""
    n, r = shape.size, shape.rank
    columns = _factor(n, S, floor, xp)
    _turn(columns, r, xp)
    squares = [_dot(column[:r], column[:r]) for column in columns[:r]]
    scale = c + _dot(m[:r], m[:r]) + sum(squares[1:], start=squares[0])
    axes = [[x / xp.sqrt(square) for x in column[:r]] for column, square in zip(columns, squares, strict=False)]
    eta = [_dot(axis, m[:r]) for axis in axes]
    wide = [square + NARROW * scale for square in squares]
    for column, axis, square in zip(columns, axes, wide, strict=False):
        column[:r] = [x * xp.sqrt(square) for x in axis]
    narrowest = 2 * wide[0] / scale
    for square in wide[1:]:
        narrowest = xp.fmin(narrowest, 2 * square / scale)
    if not shape.cone:
        narrowest = xp.fmin(narrowest, CLOSER * c / scale + NARROW)
    leans = [[axis[i] for axis in axes] for i in range(r)]
    slopes = [xp.sqrt(square) * (-2 / scale) for square in wide]
    leans += [[column[i] * slope for column, slope in zip(columns, slopes, strict=False)] for i in range(r, n)]
    pairs = [(i, j) for i in range(n) for j in range(i + 1)]
    covariances = [[column[i] * column[j] for column in columns[:r]] for i, j in pairs]
    free = [[[column[i] for column in columns[r:]] for i in pair] for pair in pairs if pair[1] >= r]
    rest = [_dot(*rows) for rows in free]
    eta_hat, s_hat = [e * e / scale for e in eta], [square / scale for square in wide]
    first, high = lower_end(shape), -xp.log(narrowest)
    frame = Frame(first, first, high, scale, c / scale, eta_hat, s_hat, eta, list(m[r:]), leans, covariances, rest)
    frame = replace(frame, last=_upper_end(shape, frame, first, xp))
    if not shape.exists(shape.rank - 1):  # with few axes it is infinite: no number then, rather than that of wider ones
        spare = next(k for k in reversed(range(shape.rank)) if shape.exists(k))  # axes that it does without
        narrow = sum(xp.where(square < NARROW * scale, 1.0, 0.0) for square in squares)
        near = xp.where(_exponent(frame, 1 / NARROW) < NEGLIGIBLE, narrow, 0.0)
        frame = replace(frame, scale=xp.where(near > spare, nan, scale))
    return frame


def _exponent(frame: Frame, t: Number) -> Number:
    """-log of what the mean leaves of exp(-t Q/E[Q])."""
    return t * (frame.c + _dot(frame.eta, [1 / (1 + 2 * t * s) for s in frame.s]))


def tilted(shape: Shape, m: Sequence[Number], S: Sequence[Number], c: Number, t: Number, xp: Algebra) -> Tilted:
    """N(m, S) times exp(-t Q) by elimination, smooth in m and S; narrow axes lose digits that the principal axes keep."""
    n, r = shape.size, shape.rank

    def entry(i: int, j: int) -> Number:
        return S[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)]

    K = [[2 * t * entry(i, j) + float(i == j) for j in range(r)] for i in range(r)]
    sides = [[m[i], *(entry(i, j) for j in range(n)), *(float(i == j) for j in range(r))] for i in range(r)]  # m, S, 1
    pivots, exponent = [], c
    for k in range(r):
        pivots.append(xp.where(K[k][k] >= 1, K[k][k], 1.0))
        exponent = exponent + sides[k][0] ** 2 / pivots[k]
        for i in range(k + 1, r):
            factor = K[i][k] / pivots[k]
            K[i] = [x - factor * y for x, y in zip(K[i], K[k], strict=True)]
            sides[i] = [x - factor * y for x, y in zip(sides[i], sides[k], strict=True)]
    for k in reversed(range(r)):  # (1 + 2 t S)^-1 times them
        for i in range(k + 1, r):
            sides[k] = [x - K[k][i] * y for x, y in zip(sides[k], sides[i], strict=True)]
        sides[k] = [x / pivots[k] for x in sides[k]]
    beside = [[-2 * t * entry(i, k) for k in range(r)] for i in range(r, n)]
    means = [side[0] for side in sides]
    means += [m[i] + _dot(row, means[:r]) for i, row in enumerate(beside, start=r)]
    answers = [side[1 + n :] for side in sides]
    answers += [[_dot(row, [side[1 + n + j] for side in sides]) for j in range(r)] for row in beside]
    covariances = []
    for i in range(n):
        for j in range(i + 1):
            if j < r:
                covariances.append(sides[j][1 + i])
            else:
                covariances.append(entry(i, j) + _dot(beside[j - r], [side[1 + i] for side in sides]))
    return Tilted(means, answers, covariances, t * exponent, 1 / _product(pivots))


def _dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    first, *others = (x * y for x, y in zip(a, b, strict=True))
    return sum(others, start=first)


def _product(factors: Sequence[Number]) -> Number:
    return reduce(mul, factors)


def _factor(n: int, S: Sequence[Number], floor: float, xp: Algebra) -> list[list[Number]]:
    """Columns of L, L L^T = S; where S is not positive semidefinite, by integration errors say, of one that nearly is S."""
    columns: list[list[Number]] = []
    variances = [S[i * (i + 1) // 2 + i] for i in range(n)]
    for k in range(n):
        left = [S[i * (i + 1) // 2 + k] - sum(c[i] * c[k] for c in columns) for i in range(k, n)]
        least = (ROUNDING * xp.fmax(variances[k], 0.0) if k else 0.0) + floor
        pivot = xp.sqrt(xp.fmax(left[0], 0.0) + least)
        column = [0.0 * pivot] * k + [pivot]
        for i, x in enumerate(left[1:], start=k + 1):
            most = xp.sqrt(xp.fmax(variances[i] - sum(c[i] * c[i] for c in columns), 0.0))  # what its variance allows
            column.append(xp.where(left[0] > least, xp.fmin(xp.fmax(x / pivot, -most), most), 0.0))
        columns.append(column)
    return columns


def _turn(columns: list[list[Number]], r: int, xp: Algebra) -> None:
    """Make columns orthogonal in their first rows, two by two (M. R. Hestenes, J. SIAM 6 (1958), 51)."""
    pairs = [(p, q) for q in range(1, r) for p in range(q)]
    for p, q in pairs * (SWEEPS if r > 2 else 1):
        a, b = columns[p], columns[q]
        gap, both = _dot(b[:r], b[:r]) - _dot(a[:r], a[:r]), 2 * _dot(a[:r], b[:r])
        length = xp.fabs(gap) + xp.sqrt(gap * gap + both * both)
        tangent = xp.where(gap < 0, -both, both) / xp.where(length > 0, length, 1.0)
        cosine = 1 / xp.sqrt(1 + tangent * tangent)
        sine = tangent * cosine
        columns[p] = [cosine * x - sine * y for x, y in zip(a, b, strict=True)]
        columns[q] = [sine * x + cosine * y for x, y in zip(a, b, strict=True)]


def lower_end(shape: Shape) -> float:
    """Where t^a is negligible."""
    x = LOW
    while shape.least * (exp(LOW - x) - x) < NEGLIGIBLE + 2 + 2 * shape.log:
        x -= 0.05
    return x


def spread_out(x: Number, high: Number, xp: Algebra) -> tuple[Number, Number]:
    """log(t E[Q]) and its derivative in x."""
    down, up = xp.exp(LOW - x), xp.exp(x - high)
    return x - down + up, 1 + down + up


def _upper_end(shape: Shape, frame: Frame, first: float, xp: Algebra) -> Number:
    """Beyond which the integrand is negligible, by its size at some places.

    A polynomial may be one of y along the narrowest axis: it is told from what it is at most and, nearly, at least.
    """
    length = frame.high + (log((NEGLIGIBLE + 3) / shape.falls) if shape.cone else FAR_BEYOND) - first
    gain = shape.gains[1].power
    half = (shape.degree + 2 * gain - shape.is_plain(1)) / 2  # of the degree of that derivative
    places, sizes, least = [first + length * (k / PLACES) for k in range(1, PLACES + 1)], [], []
    for x in places:
        log_t, _ = spread_out(x, frame.high, xp)
        t = xp.exp(log_t)
        inverse = [1 / (1 + 2 * t * s) for s in frame.s]
        squares = [(eta * each + s) * each for eta, s, each in zip(frame.eta, frame.s, inverse, strict=True)]
        exponent = t * (frame.c + _dot(frame.eta, inverse))
        square = frame.c + sum(squares[1:], start=squares[0])
        size = float(gain - shape.power) * log_t + xp.log(_product(inverse)) / 2 - exponent
        sizes.append(size + half * xp.log(square))
        least.append(size + half * xp.log(xp.fmax(frame.c + reduce(xp.fmin, squares), UNLIKE * square)))
    largest = reduce(xp.fmax, least)
    last = places[0]
    for size, x in zip(sizes[:-1], places[1:], strict=True):
        last = xp.where(size > largest - NEGLIGIBLE, x, last)
    return last


Factor = Callable[[Number, Number], Callable[[int], Number]]
"""Of a mean and a variance: E[g] and its derivatives in the mean, by their order."""


class Node:
    """What nodes at t/E[Q] add to rows."""

    def __init__(
        self,
        shape: Shape,
        at: Tilted,
        steps: tuple[Number, Number],
        scale: Number,
        c: Number,
        xp: Algebra,
        factor: Factor = lambda m, p: lambda order: 1.0,
        p: Number = None,
    ):
        self.shape, self.at, self.scale, self.c, self.xp = shape, at, scale, c, xp
        self.p = float(shape.power) if p is None else xp.where(shape.allows(p), p, nan)
        self.factor = factor(at.m[-1], at.S[-1])
        self.log_t, slope = steps
        self.t = xp.exp(self.log_t)
        self.weight = slope * xp.sqrt(at.width) * xp.exp(-at.exponent)
        self.known: dict[tuple[tuple[int, ...], int], Number] = {}

    def moment(self, powers: tuple[int, ...], order: int = 0) -> Number:
        """E[y^powers], times a derivative of g, of what is tilted, by Stein's lemma."""
        key = powers, order
        if key not in self.known:
            self.known[key] = self._by_stein(powers, order) if any(powers) else self.factor(order)
        return self.known[key]

    def _by_stein(self, powers: tuple[int, ...], order: int) -> Number:
        a = next(i for i, n in enumerate(powers) if n)
        rest = less(powers, a)
        value = self.at.m[a] * self.moment(rest, order)
        for b, n in enumerate(rest):
            covariance = self.at.S[max(a, b) * (max(a, b) + 1) // 2 + min(a, b)]
            if n:
                value = value + n * covariance * self.moment(less(rest, b), order)
            if self.shape.is_kinked_in(b):
                value = value + covariance * self.moment(rest, order + 1)
        return value

    def sums(self, rows: Sequence[Row], coefficients: Sequence[Number]) -> list[Number]:
        """What they add to every row, but for the step and its factor."""
        low = min(row.power for row in rows)
        weight = self.weight * self.xp.exp((low - self.p) * self.log_t)
        weights = {power: weight * self.t ** (power - low) for power in {row.power for row in rows}}
        if self.shape.given:
            weights = {power: each * self._factor(power) for power, each in weights.items()}
        return [weights[row.power] * self._mean(row, coefficients) for row in rows]

    def _factor(self, power: int) -> Number:
        """1/(Gamma(a) E[Q]^a), where p is no constant."""
        a, xp = power - self.p, self.xp
        return reciprocal_gamma(a, xp) * xp.exp(-a * xp.log(self.scale))

    def log(self, power: int) -> Number:
        """What stands for log Q beside Q^-a."""
        return digamma(float(power - self.shape.power)) - self.log_t + self.xp.log(self.scale)

    def size(self) -> Number:
        """A measure of |f|, all coefficients one."""
        row, lengths = self.shape.gains[0], [*self.at.m, self.c]
        for i, m in enumerate(self.at.m):
            lengths[i] = self.xp.sqrt(m * m + self.at.S[i * (i + 1) // 2 + i])
        moments = [
            factor * _product([x**n for x, n in zip(lengths, powers, strict=False)]) * self.p**of_p
            for terms in row.terms
            for (*powers, _, _, of_p), factor in terms.items()
        ]
        weight = self.weight * self.xp.exp((row.power - self.p) * self.log_t)
        weight = weight * self.xp.fabs(self.log(row.power)) if self.shape.log else weight
        return (weight * self._factor(row.power) if self.shape.given else weight) * sum(moments)

    def _mean(self, row: Row, coefficients: Sequence[Number]) -> Number:
        total: Number = 0.0
        for terms, coefficient in zip(row.terms, coefficients, strict=True):
            value = self._derived(terms, row.left, row.power)
            total = total + (value if row.plain else coefficient * value)
        return total

    def _derived(self, terms: Terms, left: tuple[int, ...], power: int) -> Number:
        """The derivative of E[P exp(-t Q)] in some means over E[exp(-t Q)]."""
        if not left:
            value: Number = 0.0
            for (*powers, of_c, order, log, of_p), factor in terms.items():
                term = factor * self.moment(tuple(powers), order)
                for number, exponent in ((self.c, of_c), (self.p, of_p)):
                    term = term * number**exponent if exponent else term
                value = value + (term * self.log(power) if log else term)
            return value
        (i, *rest), answers = left, self.at.answers
        steep = -2 * self.t / self.scale  # log E[exp(-t Q)] has the derivative -2 t m_i, m_i the tilted mean
        value = steep * self.at.m[i] * self._derived(terms, tuple(rest), power)
        for k, j in enumerate(rest):
            value = value + steep * answers[i][j] * self._derived(terms, tuple(rest[:k] + rest[k + 1 :]), power)
        for j in range(self.shape.size):
            if slope := _slope(terms, j, kinked=self.shape.is_kinked_in(j)):
                value = value + answers[j][i] * self._derived(slope, tuple(rest), power)
        return value


def _slope(terms: Terms, j: int, *, kinked: bool) -> Terms:
    """The derivative of a polynomial, perhaps times a function of what it is differentiated in."""
    found: Terms = defaultdict(float)
    for powers, factor in terms.items():
        if powers[j]:
            found[less(powers, j)] += factor * powers[j]
        if kinked:
            found[(*powers[:-3], powers[-3] + 1, *powers[-2:])] += factor
    return found


def factors(shape: Shape, rows: Sequence[Row], scale: Number, xp: Algebra) -> list[Number]:
    """1/(Gamma(a) E[Q]^a) of every row; one where p is no constant, for which `Node` has it."""
    if shape.given:
        return [1.0 + 0.0 * scale] * len(rows)
    exponents = [float(row.power - shape.power) for row in rows]
    return [xp.exp(-a * xp.log(scale)) / gamma(a) for a in exponents]
