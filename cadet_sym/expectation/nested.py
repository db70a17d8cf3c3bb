"""Integration over one argument, given which the expectation over the others is known."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import sympy as sp

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.existence import require_expectation
from cadet_sym.expectation.pieces import Cell, Splitter
from cadet_sym.expectation.quadrature import Integral, Rule, Wish, stretches
from cadet_sym.expectation.steep import Steep, steep_places
from cadet_sym.expectation.tables import written_out
from cadet_sym.language.vocabulary import Lookup

if TYPE_CHECKING:
    from cadet_sym.expectation.describing import DescribingFunction

WITH_STEPS = Rule(2, 10, straight=24)
TRAPEZOIDAL = Rule(order=80)
WITHOUT_STEPS = Rule(order=56, straight=40)
MAX_CROSSINGS = 4
INNER_ERROR = 1e-9


@dataclass(frozen=True)
class Slice:
    """A stretch of the outer argument, and on it the expectation over the others, of f and of its derivative.

    Steep places of `part` are those of the crossings, then its own; these may depend on the other arguments.
    """

    part: Integral
    inner: DescribingFunction
    slope: DescribingFunction


@dataclass(frozen=True)
class Step:
    """A jump of f where the outer argument passes a point: a function of the others."""

    position: sp.Expr
    inner: DescribingFunction


@dataclass(frozen=True)
class Crossing:
    """A kink or a pole of f in another argument, at start + slope z, z the outer argument."""

    argument: int
    start: sp.Expr
    slope: sp.Expr
    width: sp.Expr | None  # of a pole, perhaps a function of z; None for a kink


@dataclass(frozen=True)
class Nested:
    """E[f] as an integral over argument `outer` of the expectation over the arguments `others`."""

    outer: int
    others: tuple[int, ...]
    slices: tuple[Slice, ...]
    steps: tuple[Step, ...]
    crossings: tuple[Crossing, ...]
    error: float

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of kinks."""
        for piece in self.slices:
            for bound in (piece.part.lower, piece.part.upper):
                if not bound.is_infinite:
                    yield self.outer, bound
        for crossing in self.crossings:
            if crossing.slope == 0 and crossing.width is None:
                yield crossing.argument, crossing.start

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """Arguments, centres and widths of poles off the line."""
        for piece in self.slices:
            for place in piece.part.steep[len(self.crossings) :]:
                yield self.outer, place.centre, place.width
        for crossing in self.crossings:
            if crossing.slope == 0 and crossing.width is not None:
                yield crossing.argument, crossing.start, crossing.width

    @property
    def nodes(self) -> int:
        """Points at which the inner expectation is evaluated, times the points of that."""
        return sum(s.part.nodes * max(1, s.inner.nodes) for s in self.slices)


def nested(
    arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, where: str, wish: Wish
) -> Nested:
    """Choose the argument to integrate over: one that leaves a closed form for the others, if there is one."""
    body = written_out(body) if _curves_mix(body, [arguments[i] for i in used]) else body
    best: Nested | None = None
    reason: LinearisationError | None = None
    for outer in used:
        try:
            candidate = _over(arguments, used, outer, body, where, wish)
        except LinearisationError as error:
            reason = error
            continue
        if candidate is not None and (best is None or candidate.nodes < best.nodes):
            best = candidate
    if best is None:
        raise reason or LinearisationError(
            f"{where}: in `{body}` the kinks of every argument depend on the others in a way that cannot be solved; "
            "write it with one linear form of the state in each comparison"
        )
    return best


def _curves_mix(body: sp.Expr, symbols: list[sp.Symbol]) -> bool:
    return any(sum(curve.has(z) for z in symbols) > 1 for curve in body.atoms(Lookup))


def _over(
    arguments: tuple[sp.Symbol, ...],
    used: tuple[int, ...],
    outer: int,
    body: sp.Expr,
    where: str,
    wish: Wish,
) -> Nested | None:
    from cadet_sym.expectation.describing import describe

    z = arguments[outer]
    others = tuple(i for i in used if i != outer)
    rest = tuple(arguments[i] for i in others)

    def inner(expr: sp.Expr) -> DescribingFunction:
        return describe(rest, expr, where, Wish({z: 0.37, **wish.sample}, INNER_ERROR))

    splitter = Splitter(z, where)
    own = body.replace(lambda e: isinstance(e, Lookup) and e.has(z), lambda e: e.as_piecewise())
    cells = splitter.terms(own)
    if any(bound.has(*rest) for cell, _ in cells for bound in (*cell.lowers, *cell.uppers)):
        return None
    slices = []
    for cell, value in _joined(cells):
        require_expectation(value, cell, splitter)
        expectations = inner(value), inner(sp.diff(value, z))
        for lower, upper, singular in stretches(cell, value, z):
            steep = tuple(steep_places(value, z, cell, singular))
            part = Integral(lower, upper, value, z, steep, singular)
            slices.append(Slice(part, *expectations))
    steps = (Step(position, inner(change)) for position, change in _steps(slices, z))
    crossings = tuple(_crossings(slices, z, others))
    return Nested(outer, others, tuple(_ruled(s, crossings) for s in slices), tuple(steps), crossings, 1e-10)


def _ruled(piece: Slice, crossings: tuple[Crossing, ...]) -> Slice:
    """The slice with a place kept for every crossing, whose centre and width follow from the moments."""
    places = (Steep(sp.S.Zero, sp.S.One, step=crossing.width is None) for crossing in crossings)
    part = replace(piece.part, steep=(*places, *piece.part.steep))
    rule = WITHOUT_STEPS
    if part.is_trapezoidal:
        rule = TRAPEZOIDAL
    elif any(place.step for place in part.steep) or any(part.singular):
        rule = WITH_STEPS
    return replace(piece, part=replace(part, rule=rule))


def _joined(cells: list[tuple[Cell, sp.Expr]]) -> Iterator[tuple[Cell, sp.Expr]]:
    """Cells with the same bounds as one, their values added; conditions go into the value."""
    sums: dict[tuple[tuple[sp.Expr, ...], tuple[sp.Expr, ...]], sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for cell, value in cells:
        sums[cell.lowers, cell.uppers] += cell.indicated(value)
    for (lowers, uppers), value in sums.items():
        yield Cell(lowers, uppers), value


def _steps(slices: list[Slice], z: sp.Symbol) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    changes: dict[sp.Expr, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for piece in slices:
        if not piece.part.lower.is_infinite:
            changes[piece.part.lower] += piece.part.value
        if not piece.part.upper.is_infinite:
            changes[piece.part.upper] -= piece.part.value
    for position, change in changes.items():
        size = normal(change.subs(z, position))
        if size != 0 and size.is_finite is not False:
            yield position, size


def _crossings(slices: list[Slice], z: sp.Symbol, others: tuple[int, ...]) -> Iterator[Crossing]:
    """Kinks and poles in the inner arguments, as straight lines in the outer one."""
    found: dict[tuple[int, sp.Expr], sp.Expr | None] = {}
    for piece in slices:
        for product in piece.inner.products:
            for argument, position in product.kinks():
                found[others[argument], position] = None
            for argument, position, width in product.poles():
                found.setdefault((others[argument], position), width)
    for (argument, position), width in list(found.items())[:MAX_CROSSINGS]:
        if position.is_polynomial(z) and sp.degree(position, z) <= 1:
            slope = position.coeff(z, 1) if position.has(z) else sp.S.Zero
            yield Crossing(argument, sp.expand(position - slope * z), slope, width)
