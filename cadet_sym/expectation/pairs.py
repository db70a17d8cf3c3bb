"""Complex numbers as pairs of a real and an imaginary part, in the arithmetic of `algebra`: NumPy's or CasADi's."""

from __future__ import annotations

from cadet_sym.expectation.algebra import Algebra, Number

Pair = tuple[Number, Number]

FAR = 1e60  # what is larger counts as no more
TINY = 1e-200


def times(a: Pair, b: Pair) -> Pair:
    """a b."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def over(a: Pair, b: Pair, xp: Algebra) -> Pair:
    """a/b, no larger than `FAR`, whatever overflows."""
    largest = xp.fmax(xp.fabs(b[0]), xp.fabs(b[1])) + TINY
    a, b = (a[0] / largest, a[1] / largest), (b[0] / largest, b[1] / largest)
    square = xp.fmax(b[0] * b[0] + b[1] * b[1], 0.5)
    real, imaginary = (x / square for x in times(a, (b[0], -b[1])))
    return xp.fmin(xp.fmax(real, -FAR), FAR), xp.fmin(xp.fmax(imaginary, -FAR), FAR)


def square_root(x: Number, y: Number, xp: Algebra) -> Pair:
    """Of x + i y, its real part not negative."""
    size = xp.sqrt((xp.sqrt(x * x + y * y) + xp.fabs(x)) / 2)
    other = y / (2 * xp.fmax(size, TINY))
    down = xp.where(y < 0, -size, size)
    return xp.where(x >= 0, size, xp.fabs(other)), xp.where(x >= 0, other, down)


def roots(a: Pair, b: Pair, c: Pair, xp: Algebra) -> tuple[Pair, Pair]:
    """Of a z^2 + b z + c, without cancellation; the one nearer to zero first."""
    squared, constant = times(b, b), times(a, c)
    root = square_root(squared[0] - 4 * constant[0], squared[1] - 4 * constant[1], xp)
    sign = xp.where(b[0] * root[0] + b[1] * root[1] >= 0, 1.0, -1.0)
    q = -(b[0] + sign * root[0]) / 2, -(b[1] + sign * root[1]) / 2
    return over(c, q, xp), over(q, a, xp)
