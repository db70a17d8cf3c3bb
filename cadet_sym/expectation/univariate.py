"""A function of one Gaussian variable, made ready for its expectation: closed form, tables and integrals."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import sympy as sp
from sympy.logic.boolalg import Boolean

from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.closed_form import (
    PLAIN,
    Coefficients,
    Decomposition,
    PiecewiseForm,
    Term,
    about,
    decompose,
    jump_of,
    normal,
    piecewise_form,
    where,
)
from cadet_sym.expectation.errorfunction import ErrorFunction, error_functions_in
from cadet_sym.expectation.existence import require_expectation
from cadet_sym.expectation.pieces import Splitter
from cadet_sym.expectation.power import Power, powers_in
from cadet_sym.expectation.quadrature import Integral, Wish, integrals
from cadet_sym.expectation.steep import singular_at
from cadet_sym.expectation.tables import Table, tables_in

STEEP = 3
"""Degree from which on a polynomial between two kinks is taken by itself: below, a thousand widths away, 1e-10 is left."""

_Known = tuple[sp.Expr, sp.Expr, Boolean, Decomposition]


@dataclass(frozen=True)
class Jump:
    """By how much f changes at a kink: the terms of its closed part, and the pieces that have none, with their sign."""

    position: sp.Expr
    terms: tuple[Term, ...]
    pieces: tuple[tuple[int, sp.Expr], ...]
    argument: sp.Symbol
    is_singular: bool  # whether derivatives are infinite there

    @cache  # noqa: B019 (the records are few and live as long as the process needs them)
    def size(self, order: int) -> sp.Expr:
        """Jump of the derivative of that order; of derivatives that are infinite none is counted."""
        total = jump_of(self.terms, order)
        if self.pieces and not (order and self.is_singular):
            change = sp.Add(*(sign * value for sign, value in self.pieces))
            total += _value_at(sp.diff(change, self.argument, order), self.argument, self.position)
        return normal(total)


@dataclass(frozen=True)
class Bounded:
    """A polynomial between two kinks, zero elsewhere."""

    lower: sp.Expr
    upper: sp.Expr
    coefficients: Coefficients  # in powers of the distance from the middle
    closed: PiecewiseForm
    jumps: tuple[Jump, ...]


@dataclass(frozen=True)
class Apart:
    """The closed part and its jumps once more, for wide distributions: polynomials between two kinks each by itself.

    Seen from far away, what a polynomial is beyond its kinks is many times what it is between them, and sums of such
    numbers lose all digits.
    """

    closed: PiecewiseForm
    jumps: tuple[Jump, ...]
    bounded: tuple[Bounded, ...]


@dataclass(frozen=True)
class Univariate:
    """f(z) = closed + tables + error functions + powers + integrals; the jumps are those of closed and integrals."""

    closed: PiecewiseForm
    jumps: tuple[Jump, ...] = ()
    apart: Apart | None = None
    tables: tuple[Table, ...] = ()
    error_functions: tuple[ErrorFunction, ...] = ()
    powers: tuple[Power, ...] = ()
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

    def written_out(self) -> Univariate:
        """The same with measured curves of scalar operations alone."""
        return replace(self, tables=tuple(replace(table, written_out=True) for table in self.tables))

    def coarser(self) -> Univariate:
        """The same with as few nodes beside steep places as are enough where these are wide for the distribution."""
        return replace(self, integrals=tuple(part.coarser() for part in self.integrals))

    def kinks(self) -> tuple[sp.Expr, ...]:
        """Where the function or a derivative of it jumps, tables apart."""
        ends = (bound for part in self.integrals for bound in (part.lower, part.upper))
        positions = (part.position for part in (*self.closed.kinks, *self.powers))
        return tuple(dict.fromkeys(k for k in (*positions, *ends) if not k.is_infinite))

    def roots(self) -> tuple[sp.Expr, ...]:
        """The zeros of powers and the ends of pieces where some derivative is infinite."""
        ends = ((part.lower, part.upper)[part.singular[1]] for part in self.integrals if any(part.singular))
        return tuple(dict.fromkeys((*(power.position for power in self.powers), *ends)))

    @property
    def is_piecewise_polynomial(self) -> bool:
        """Whether f is made of polynomials between kinks; tables always are."""
        terms = [t for part in (*self.closed.segments, *self.closed.kinks) for t in part.terms]
        return not (self.error_functions or self.powers or self.integrals) and all(t.is_polynomial for t in terms)


def univariate(body: sp.Expr, z: sp.Symbol, where: str, wish: Wish) -> Univariate:
    """Cut a function of one variable at its kinks and find the expectation of every piece.

    Raises
    ------
    LinearisationError
        If a piece has no Gaussian expectation, or its bounds cannot be found.
    """
    splitter = Splitter(z, where, wish.outside)
    tables, rest = tables_in(body, z)
    known, parts_left, cells = [], [], []
    error_functions: list[ErrorFunction] = []
    powers, partition = powers_in(splitter.terms(rest), z)
    for cell, value in partition:
        require_expectation(value, cell, splitter)
        found, value = error_functions_in(value, cell, z)
        error_functions.extend(found)
        for summand in _apart_from_waves(value, z):
            parts = decompose(summand, z)
            if parts is not None and _is_summable(parts, cell):
                known.append((cell.lower, cell.upper, cell.condition, parts))
            else:
                cells.append((cell, summand))
                parts_left.extend(integrals(cell, summand, z, where, wish))
    closed = piecewise_form(known)
    jumps = tuple(_jumps(closed, cells, z))
    return Univariate(closed, jumps, _apart(known, cells, z), tables, tuple(error_functions), powers, tuple(parts_left))


def _apart_from_waves(value: sp.Expr, z: sp.Symbol) -> Iterator[sp.Expr]:
    """Summands in closed form that oscillate, which nodes for the rest do not see at large variance; the rest."""
    waves = [term for term in sp.Add.make_args(value) if term.has(sp.sin, sp.cos) and decompose(term, z) is not None]
    rest = value - sp.Add(*waves)
    yield from (each for each in (sp.Add(*waves), rest) if each != 0)


def _apart(known: Sequence[_Known], cells: Iterable[tuple[Cell, sp.Expr]], z: sp.Symbol) -> Apart | None:
    """The polynomials between two kinks that are steep enough to need it, apart; None if there are none."""
    steep = [part for part in known if _is_steep(*part)]
    if not steep:
        return None
    rest = piecewise_form(part for part in known if part not in steep)
    bounded = []
    for lower, upper, condition, parts in steep:
        form = piecewise_form([(lower, upper, condition, parts)])
        middle = (lower + upper) / 2
        coefficients = about(middle, tuple(where(condition, c) for c in parts[PLAIN]))
        bounded.append(Bounded(lower, upper, coefficients, form, tuple(_jumps(form, (), z))))
    return Apart(rest, tuple(_jumps(rest, cells, z)), tuple(bounded))


def _is_steep(lower: sp.Expr, upper: sp.Expr, _condition: Boolean, parts: Decomposition) -> bool:
    return not (lower.is_infinite or upper.is_infinite) and set(parts) == {PLAIN} and len(parts[PLAIN]) > STEEP


def _is_summable(parts: Iterable[tuple[sp.Expr, sp.Expr]], cell: Cell) -> bool:
    """Whether the closed form holds: between two kinks exp(b z^2), b > 0, has one at small variance only."""
    between = bool(cell.lowers and cell.uppers)
    return all(b == 0 or b.is_extended_nonpositive or not between for _, b in parts)


def _jumps(closed: PiecewiseForm, cells: Iterable[tuple[Cell, sp.Expr]], z: sp.Symbol) -> Iterator[Jump]:
    """The changes at all kinks and ends of pieces."""
    terms = {kink.position: kink.terms for kink in closed.kinks}
    pieces: dict[sp.Expr, list[tuple[int, sp.Expr]]] = defaultdict(list)
    singular: set[sp.Expr] = set()
    for cell, value in cells:
        for bound, sign in ((cell.lower, 1), (cell.upper, -1)):
            if not bound.is_infinite:
                pieces[bound].append((sign, cell.indicated(value)))
                places = bound.args if isinstance(bound, sp.Max | sp.Min) else (bound,)
                if any(singular_at(value, z, place) for place in places):
                    singular.add(bound)
    for position in dict.fromkeys((*terms, *pieces)):
        own = tuple(pieces.get(position, ()))
        yield Jump(position, terms.get(position, ()), own, z, position in singular)


def _is_root(expr: sp.Basic) -> bool:
    return isinstance(expr, sp.Pow) and not (expr.exp.is_integer or expr.exp.is_negative or expr.base.is_number)


def _value_at(expr: sp.Expr, z: sp.Symbol, position: sp.Expr) -> sp.Expr:
    """Value at an end, where a power of zero is zero: one that is not has no jump that could be counted.

    A cell may be empty for the numbers of the parameters: at its ends roots need not be real.
    """
    real = expr.replace(_is_root, lambda e: sp.Max(e.base, 0, evaluate=False) ** e.exp)
    value = real.subs(z, position).replace(lambda e: isinstance(e, sp.Pow) and e.base == 0, lambda e: sp.S.Zero)
    return sp.S.Zero if value.has(sp.zoo, sp.nan, sp.oo) else value
