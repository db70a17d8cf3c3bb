"""A function of one Gaussian variable, made ready for its expectation: closed form, tables and integrals."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import sympy as sp

from cadet_sym.expectation.closed_form import (
    JUMPS_KEPT,
    PLAIN,
    PiecewiseForm,
    decompose,
    jumps_of,
    normal,
    piecewise_form,
)
from cadet_sym.expectation.existence import require_expectation
from cadet_sym.expectation.pieces import Cell, Splitter
from cadet_sym.expectation.quadrature import Integral, Wish, integrals
from cadet_sym.expectation.steep import singular_at
from cadet_sym.expectation.tables import Table, tables_in


@dataclass(frozen=True)
class Jump:
    """Jumps of f, f', f'', .. at a kink."""

    position: sp.Expr
    sizes: tuple[sp.Expr, ...]


@dataclass(frozen=True)
class Univariate:
    """f(z) = closed + tables + integrals; the jumps are those of closed and integrals."""

    closed: PiecewiseForm
    jumps: tuple[Jump, ...] = ()
    tables: tuple[Table, ...] = ()
    integrals: tuple[Integral, ...] = ()

    @property
    def error(self) -> float:
        """Estimated relative error; 0 in closed form."""
        return max((part.error for part in self.integrals), default=0.0)

    @property
    def nodes(self) -> int:
        """Points at which f is evaluated; 0 in closed form."""
        return sum(part.nodes for part in self.integrals)

    @property
    def is_singular(self) -> bool:
        """Whether some derivative of a piece is infinite at its end."""
        return any(any(part.singular) for part in self.integrals)

    def kinks(self) -> tuple[sp.Expr, ...]:
        """Where the function or a derivative of it jumps, tables apart."""
        ends = (bound for part in self.integrals for bound in (part.lower, part.upper))
        positions = (kink.position for kink in self.closed.kinks)
        return tuple(dict.fromkeys(k for k in (*positions, *ends) if not k.is_infinite))

    @property
    def is_piecewise_polynomial(self) -> bool:
        """Whether f is made of polynomials between kinks, tables apart."""
        terms = [t for part in (*self.closed.segments, *self.closed.kinks) for t in part.terms]
        return not self.tables and not self.integrals and all(t.is_polynomial for t in terms)


def univariate(body: sp.Expr, z: sp.Symbol, where: str, wish: Wish) -> Univariate:
    """Cut a function of one variable at its kinks and find the expectation of every piece.

    Raises
    ------
    LinearisationError
        If a piece has no Gaussian expectation, or its bounds cannot be found.
    """
    splitter = Splitter(z, where)
    tables, rest = tables_in(body, z)
    known, parts_left, cells = [], [], []
    for cell, value in splitter.terms(rest):
        require_expectation(value, cell, splitter)
        parts = decompose(value, z)
        if parts is not None and _is_summable(parts, cell):
            known.append((cell.lower, cell.upper, cell.condition, parts))
        else:
            cells.append((cell, value))
            parts_left.extend(integrals(cell, value, z, where, wish))
    closed = piecewise_form(known)
    found = {kink.position: jumps_of(kink.terms) for kink in closed.kinks}
    for position, sizes in _jumps(cells, z).items():
        before = found.get(position, [sp.S.Zero] * JUMPS_KEPT)
        found[position] = [normal(a + b) for a, b in zip(before, sizes, strict=True)]
    jumps = (Jump(k, tuple(sizes)) for k, sizes in found.items() if any(size != 0 for size in sizes))
    return Univariate(closed, tuple(jumps), tables, tuple(parts_left))


def _is_summable(parts: Iterable[tuple[sp.Expr, sp.Expr]], cell: Cell) -> bool:
    """Whether the closed form holds: exp(b z^2) with b > 0 has one at small variance only."""
    whole = not cell.lowers and not cell.uppers
    return all(b == PLAIN[1] or b.is_nonpositive or (whole and not b.is_positive) for _, b in parts)


def _jumps(cells: Iterable[tuple[Cell, sp.Expr]], z: sp.Symbol) -> dict[sp.Expr, list[sp.Expr]]:
    """Jumps of the function and its derivatives at the ends of cells; of derivatives not at a singular end."""
    at: dict[sp.Expr, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    singular: set[sp.Expr] = set()
    for cell, value in cells:
        for bound, sign in ((cell.lower, 1), (cell.upper, -1)):
            if not bound.is_infinite:
                at[bound] += sign * cell.indicated(value)
                if singular_at(value, z, bound):
                    singular.add(bound)
    result = {}
    for position, change in at.items():
        sizes = [_value_at(change, z, position)]
        while len(sizes) < JUMPS_KEPT:
            change = sp.diff(change, z)
            sizes.append(sp.S.Zero if position in singular else _value_at(change, z, position))
        result[position] = sizes
    return result


def _value_at(expr: sp.Expr, z: sp.Symbol, position: sp.Expr) -> sp.Expr:
    """Value at an end, where a power of zero is zero: one that is not has no jump that could be counted."""
    value = expr.subs(z, position).replace(lambda e: isinstance(e, sp.Pow) and e.base == 0, lambda e: sp.S.Zero)
    value = normal(value)
    return sp.S.Zero if value.has(sp.zoo, sp.nan, sp.oo) else value
