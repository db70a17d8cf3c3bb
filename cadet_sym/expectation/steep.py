"""Where a smooth expression is steep: the points of the complex plane at which it stops being analytic, nearest the line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import sympy as sp

from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.pieces import affine, factored

MAX_STEEP = 4

# A function of an affine argument w: its nearest singularity, or the scale on which it changes, at w = 0 +- i width.
_WIDTHS: dict[type, sp.Expr] = {
    sp.tanh: sp.pi / 2,
    sp.atan: sp.S.One,
    sp.erf: sp.Integer(2),
    sp.exp: sp.Integer(3),
    sp.sinh: sp.Integer(3),
    sp.cosh: sp.pi / 2,  # where it is zero
}


@dataclass(frozen=True)
class Steep:
    """A steep place: its centre and width, and the sides of it on which the function is used."""

    centre: sp.Expr
    width: sp.Expr
    left: bool = True
    right: bool = True
    step: bool = False  # a smoothed kink instead of a pole
    root: bool = False  # a smoothed root
    joined: bool = False  # a pole that is not a place of its own: it lies at the step before it

    @property
    def sides(self) -> int:
        """How many sides are used."""
        return int(self.left) + int(self.right)


def singular_at(value: sp.Expr, z: sp.Symbol, end: sp.Expr) -> bool:
    """Whether the expression has a power that is no integer, a logarithm or the like of something that vanishes at the end."""
    if end.is_infinite:
        return False
    for node in value.atoms(sp.Pow, sp.log, sp.asin, sp.acos):
        inner = _inner(node)
        if inner.has(z) and not _is_regular(node) and sp.expand(inner.subs(z, end)) == 0:
            return True
    return False


def about_end(value: sp.Expr, z: sp.Symbol, end: sp.Expr, side: int, distance: sp.Symbol) -> sp.Expr:
    """The expression in the distance from an end, so that what vanishes there does so without cancellation."""
    near = value.subs(z, end - side * distance)
    near = near.replace(lambda e: isinstance(e, sp.asin | sp.acos), lambda e: _arc(e, distance))
    return without_cancellation(near, distance)


def _arc(node: sp.Expr, distance: sp.Symbol) -> sp.Expr:
    """asin or acos of a cosine by the sine of half the angle, or half of what is left to pi, if that vanishes at the end."""
    for sign in (1, -1):
        left = sp.expand(1 - sign * node.args[0])
        if left.is_polynomial(distance) and left.has(distance) and left.subs(distance, 0) == 0:
            angle = sp.pi * (1 - sign) / 2 + sign * 2 * sp.asin(sp.sqrt(left / 2))
            return angle if isinstance(node, sp.acos) else sp.pi / 2 - angle
    return node


def without_cancellation(value: sp.Expr, distance: sp.Symbol) -> sp.Expr:
    """The expression with what stands under powers multiplied out: 1 - (1 - x)^2 becomes 2 x - x^2."""
    return value.replace(
        lambda e: isinstance(e, sp.Pow | sp.log) and not _is_regular(e) and e.args[0].is_polynomial(distance),
        lambda e: e.func(sp.expand(e.args[0]), *e.args[1:]),
    )


def _inner(node: sp.Expr) -> sp.Expr:
    return 1 - node.args[0] ** 2 if isinstance(node, sp.asin | sp.acos) else node.args[0]


def _is_regular(node: sp.Expr) -> bool:
    return isinstance(node, sp.Pow) and bool(node.args[1].is_integer and node.args[1].is_nonnegative)


def steep_places(value: sp.Expr, z: sp.Symbol, cell: Cell, singular: tuple[bool, bool]) -> Iterator[Steep]:
    """Steep places of a smooth expression on a cell, those at its singular ends left out."""
    found: dict[sp.Expr, sp.Expr] = {}
    for node in sorted(value.atoms(sp.Function, sp.Pow), key=sp.default_sort_key):  # the same in every process
        for centre, width in _of(node, z):
            found[centre] = _narrower(width, found.get(centre, width))
    ends = [bound for bound, is_singular in zip((cell.lower, cell.upper), singular, strict=True) if is_singular]
    places = [(c, w) for c, w in found.items() if not any(sp.expand(c - end) == 0 for end in ends) and not _is_far(c, cell)]
    for centre, width in places[:MAX_STEEP]:
        right_only = not cell.lower.is_infinite and (cell.lower - centre).is_nonnegative
        left_only = not cell.upper.is_infinite and (centre - cell.upper).is_nonnegative
        alone = len(places) == 1
        yield Steep(centre, width, not (alone and right_only), not (alone and left_only))


def _is_far(centre: sp.Expr, cell: Cell) -> bool:
    """Whether a point is farther from a cell between two kinks than the cell is long."""
    if cell.lower.is_infinite or cell.upper.is_infinite:
        return False
    length = cell.upper - cell.lower
    return bool((centre - cell.upper - length).is_nonnegative or (cell.lower - centre - length).is_nonnegative)


def _narrower(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """Of two widths the smaller, if need be for the numbers at hand."""
    difference = b - a
    return a if difference.is_nonnegative else b if difference.is_nonpositive else sp.Min(a, b)


def _of(node: sp.Expr, z: sp.Symbol) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    if not node.has(z) or _is_regular(node) or isinstance(node, sp.Piecewise):
        return
    inner = _inner(node) if node.args else node
    if isinstance(node, sp.Pow) and node.args[1].has(z):
        inner = node.args[1] * sp.log(node.args[0])
    if not inner.is_polynomial(z):
        if isinstance(node, sp.atan):  # of p/q: poles where p = +- i q
            p, q = sp.fraction(sp.together(inner))
            yield from _zeros(sp.expand(p**2 + q**2), z) if p.is_polynomial(z) and q.is_polynomial(z) else ()
        return
    if type(node) in _WIDTHS:
        yield from _of_function(inner, z, _WIDTHS[type(node)])
    elif isinstance(node, sp.Pow | sp.log | sp.asin | sp.acos):
        yield from _zeros(inner, z)


def _of_function(inner: sp.Expr, z: sp.Symbol, width: sp.Expr) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    line = affine(inner, z)
    if line is not None:
        slope, offset = line
        yield -offset / slope, width / sp.Abs(slope)
        return
    polynomial = sp.Poly(inner, z)
    if polynomial.degree() == 2:
        a, b, _ = polynomial.all_coeffs()
        yield -b / (2 * a), width / sp.sqrt(sp.Abs(a))
        return
    for centre, _ in _zeros(inner, z):
        slope = sp.diff(inner, z).subs(z, centre)
        yield centre, width / (sp.Abs(slope) + 1)


def _zeros(inner: sp.Expr, z: sp.Symbol) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    """Real part and size of the imaginary part of the zeros of a polynomial."""
    for factor, _ in factored(inner)[1]:
        if not factor.has(z):
            continue
        polynomial = sp.Poly(factor, z)
        if polynomial.degree() == 1:
            slope, offset = polynomial.all_coeffs()
            yield -offset / slope, sp.S.Zero
        elif polynomial.degree() == 2:
            a, b, c = polynomial.all_coeffs()
            root = sp.sqrt(sp.Abs(b**2 - 4 * a * c)) / (2 * sp.Abs(a))
            if (b**2 - 4 * a * c).is_nonnegative:
                yield -b / (2 * a) - root, sp.S.Zero
                yield -b / (2 * a) + root, sp.S.Zero
            else:
                yield -b / (2 * a), root
        elif all(coefficient.is_number for coefficient in polynomial.all_coeffs()):
            for root in np.roots([float(coefficient) for coefficient in polynomial.all_coeffs()]):
                if root.imag >= 0:
                    yield sp.Rational(str(root.real)), sp.Rational(str(root.imag))
