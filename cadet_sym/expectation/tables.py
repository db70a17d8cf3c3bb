"""Measured curves: a table as pieces of numbers, so that its expectation costs one pass over the rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy as sp

from cadet_sym.expectation.pieces import affine
from cadet_sym.language.curve import coefficients
from cadet_sym.language.numeric import quotient
from cadet_sym.language.vocabulary import Lookup

HIGHEST = 6
"""Degree of the polynomials between the knots of a power of a curve that is still taken as a curve."""

LONG = 24

DEGREE = {"linear": 1, "monotone": 3}


@dataclass(frozen=True)
class Table:
    """factor * curve(slope z + offset), the curve (or a power of it) a polynomial in each interval between its knots.

    `segments[i]` holds the polynomial below knot i, the last one that above the last knot; in powers of the distance from
    `centres[i]`. `changes[i]` is by how much the polynomial changes at knot i, in powers of the distance from it.
    """

    factor: sp.Expr
    slope: sp.Expr
    offset: sp.Expr
    knots: tuple[float, ...]
    centres: tuple[float, ...]
    segments: tuple[tuple[float, ...], ...]
    changes: tuple[tuple[float, ...], ...]
    written_out: bool = False  # scalar operations alone, however many knots

    @property
    def is_long(self) -> bool:
        """Whether there are so many knots that what they add is better called than put in line."""
        return len(self.knots) > LONG

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return len(self.segments[0]) - 1

    def places(self) -> Iterator[sp.Expr]:
        """The knots in z."""
        return ((sp.Rational(knot) - self.offset) / self.slope for knot in self.knots)

    def ends(self) -> Table:
        """The same before the first knot and beyond the last, zero between them."""
        knots, centres = (self.knots[0], self.knots[-1]), (self.centres[0], self.knots[0], self.centres[-1])
        first, last = self.segments[0], self.segments[-1]
        nothing = (0.0,) * len(first)
        before = [-c for c in _moved(first, knots[0] - centres[0])]
        after = _moved(last, knots[1] - centres[2])
        return replace(
            self, knots=knots, centres=centres, segments=(first, nothing, last), changes=(tuple(before), tuple(after))
        )


def tables_in(body: sp.Expr, z: sp.Symbol) -> tuple[tuple[Table, ...], sp.Expr]:
    """Take the terms `factor * curve(affine in z)**n` out of a sum: the tables, and what is left."""
    tables, rest = [], []
    for term in sp.Add.make_args(body):
        if not term.has(Lookup):
            rest.append(term)
            continue
        factor, varying = term.as_independent(z, as_Add=False)
        curve, power = varying.as_base_exp()
        line = affine(curve.argument, z) if isinstance(curve, Lookup) else None
        if line is None or factor.has(Lookup) or power not in range(1, HIGHEST // DEGREE[curve.method] + 1):
            rest.append(term)
        else:
            tables.append(_table(curve, factor, *line, int(power)))
    return tuple(tables), sp.Add(*rest)


def curve_factors(body: sp.Expr, z: sp.Symbol) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    """Curves read in z, or powers of them, that weights of an integral over z can hold, each with what it multiplies.

    What is left is times one.
    """
    sums: dict[sp.Expr, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for term in sp.Add.make_args(body):
        curve = next((factor for factor in sp.Mul.make_args(term) if _is_held(factor, z)), sp.S.One)
        sums[curve] += term / curve
    yield from sums.items()


def _is_held(factor: sp.Expr, z: sp.Symbol) -> bool:
    if not isinstance(factor.as_base_exp()[0], Lookup) or not factor.has(z):
        return False
    tables, rest = tables_in(factor, z)
    return rest == 0 and bool(tables[0].knots)


def rows_in(body: sp.Expr, z: sp.Symbol) -> int:
    """Rows of curves read in z."""
    return sum(len(curve.knots) for curve in body.atoms(Lookup) if curve.has(z))


def written_out(expr: sp.Expr) -> sp.Expr:
    """The expression with every curve as a conditional."""
    return expr.replace(lambda e: isinstance(e, Lookup), lambda e: e.as_piecewise())


def lookup_table(curve: Lookup) -> Table:
    """The curve itself, in numbers."""
    return _table(curve, sp.S.One, sp.S.One, sp.S.Zero)


def _table(curve: Lookup, factor: sp.Expr, slope: sp.Expr, offset: sp.Expr, power: int = 1) -> Table:
    pieces = [_power(piece, power) for piece in coefficients(curve)]
    knots = list(curve.knots)
    size = len(pieces[0])
    centres = knots[:-1]
    if curve.outside == "hold":
        flat = [sp.S.Zero] * (size - 1)
        pieces = [[curve.values[0] ** power, *flat], *pieces, [curve.values[-1] ** power, *flat]]
        centres = [knots[0], *centres, knots[-1]]
        bends = knots
    else:
        bends = knots[1:-1]
    changes = [_difference(pieces[i + 1], _moved(pieces[i], knot - centres[i])) for i, knot in enumerate(bends)]
    return Table(
        factor, slope, offset, _floats(bends), _floats(centres),
        tuple(map(_floats, pieces)), tuple(map(_floats, changes)),
    )  # fmt: skip


def _power(polynomial: Sequence[sp.Expr], n: int) -> list[sp.Expr]:
    """Coefficients of the n-th power."""
    result = list(polynomial)
    for _ in range(n - 1):
        product = [sp.S.Zero] * (len(result) + len(polynomial) - 1)
        for i, a in enumerate(result):
            for j, b in enumerate(polynomial):
                product[i + j] += a * b
        result = product
    return result


def _moved(polynomial: Sequence[Any], by: Any) -> list[Any]:
    """Coefficients about a centre further on."""
    result = list(polynomial)
    for start in range(len(result) - 1):  # Horner's rule, repeated
        for n in reversed(range(start, len(result) - 1)):
            result[n] += by * result[n + 1]
    return result


def _difference(after: Sequence[sp.Expr], before: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Change at a knot; the curve has no jumps, and a monotone one no bends, beyond the rounding of its slopes."""
    change = [a - b for a, b in zip(after, before, strict=True)]
    return [sp.S.Zero if abs(c) < abs(a) * sp.Rational(1, 10**14) else c for c, a in zip(change, after, strict=True)]


def _floats(numbers: Sequence[sp.Expr]) -> tuple[float, ...]:
    return tuple(quotient(number) for number in numbers)
