"""Integration over one argument, given which the expectation over the others is known."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.cells import Cell, Partition
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.crossings import CURVED_ERROR, LEAN_ERROR, LOST_ERROR, Crossing, crossings_of, ruled
from cadet_sym.expectation.existence import require_expectation
from cadet_sym.expectation.pieces import SAME, TINY, Splitter, affine, factored, has_kinks
from cadet_sym.expectation.quadrature import PLAIN_ERROR, Integral, Wish, stretches
from cadet_sym.expectation.steep import Steep, about_end, steep_places
from cadet_sym.expectation.tables import Table, curve_factors, rows_in, tables_in, written_out
from cadet_sym.language.kinks import switching_functions
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import Lookup

if TYPE_CHECKING:
    from cadet_sym.expectation.describing import DescribingFunction

FEWEST = 16  # points that a slice takes at the least
WHOLE = Cell()
DISTANCE = sp.Symbol("distance from an end", positive=True)  # so that what depends on its sign is decided
INSIDE = 0.37  # how far within a cell it is looked at
INNER_ERROR = 1e-9
MAX_NODES = 120_000
MAX_ROWS = 12  # of such a curve that is cut into its rows instead
SINGULAR_EFFORT, WAVES_EFFORT, ROOT_EFFORT = 3, 4, 8


@dataclass(frozen=True)
class Slice:
    """A stretch of the outer argument, and on it the expectation over the others, of f and of its derivative.

    A measured curve of the outer argument that multiplies f is kept apart. Steep places of `part` are those of the crossings,
    then its own; these may depend on the other arguments. Where an end is singular, `inner` and `slope` are functions of the
    distance from that end, which is exact however small.
    """

    part: Integral
    inner: DescribingFunction
    slope: DescribingFunction
    curve: sp.Expr = sp.S.One

    @cached_property
    def table(self) -> Table | None:
        """The curve in numbers."""
        return None if self.curve == 1 else tables_in(self.curve, self.part.argument)[0][0]

    @property
    def symbol(self) -> sp.Symbol:
        """What the outer argument is called in `inner` and `slope`, or its distance from a singular end."""
        return self.part.argument if self.part.singular_end is None else DISTANCE


@dataclass(frozen=True)
class Step:
    """A jump of f where the outer argument passes a point: a function of the others."""

    position: sp.Expr
    inner: DescribingFunction


@dataclass(frozen=True)
class Nested:
    """E[f] as an integral over argument `outer` of the expectation over the arguments `others`."""

    outer: int
    others: tuple[int, ...]
    slices: tuple[Slice, ...]
    steps: tuple[Step, ...]
    crossings: tuple[Crossing, ...]
    error: float = field(compare=False)  # as such rules leave; `lowering.measured` knows more of this one
    lean: bool = False  # nodes at kinks alone
    written_out: bool = False  # scalar operations alone, however many nodes

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of kinks."""
        for piece in self.slices:
            for bound in (piece.part.lower, piece.part.upper):
                if not bound.is_infinite:
                    yield self.outer, bound
        for crossing in self.crossings:
            if crossing.slope == 0 and crossing.width is None:
                yield crossing.argument, crossing.start

    def knots(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of the kinks of measured curves."""
        for piece in self.slices:
            if piece.table is not None:
                yield from ((self.outer, place) for place in piece.table.places())

    def expressions(self) -> Iterator[sp.Expr]:
        """Whatever depends on parameters."""
        for piece in self.slices:
            yield from (piece.part.lower, piece.part.upper)

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """Arguments, centres and widths of poles off the line."""
        for piece in self.slices:
            for place in piece.part.steep[len(self.crossings) :]:
                gone = dict.fromkeys(piece.inner.arguments, sp.S.Zero)
                yield self.outer, place.centre.xreplace(gone), place.width.xreplace(gone)
        for crossing in self.crossings:
            if crossing.slope == 0 and crossing.width is not None:
                symbol = self.slices[0].part.argument
                yield crossing.argument, crossing.start, crossing.width.xreplace({symbol: sp.S.Zero})

    @property
    def has_curves(self) -> bool:
        """Whether weights hold measured curves."""
        return any(piece.curve != 1 for piece in self.slices)

    def written_with(self, change: Callable[[DescribingFunction], DescribingFunction]) -> Nested:
        """The same of scalar operations alone, its expectations over the others changed."""
        slices = tuple(replace(s, inner=change(s.inner), slope=change(s.slope)) for s in self.slices)
        steps = tuple(replace(step, inner=change(step.inner)) for step in self.steps)
        return replace(self, slices=slices, steps=steps, written_out=True)

    @property
    def nodes(self) -> int:
        """Points at which the inner expectation is evaluated, times the points of that."""
        return sum(s.part.nodes * max(1, s.inner.nodes) for s in self.slices)

    @property
    def effort(self) -> int:
        """Points that it would take for the same accuracy: singular ends need more, and waves that variance makes many.

        Roots of other arguments are steep at full correlation, of which a part is left out: rather the integral is over these.
        """
        singular = any(any(s.part.singular) for s in self.slices)
        waves = any(wave.has(s.part.argument) for s in self.slices for wave in s.part.value.atoms(sp.sin, sp.cos))
        root = any(crossing.root for crossing in self.crossings)
        return self.nodes * (ROOT_EFFORT if root else SINGULAR_EFFORT if singular else 1) * (WAVES_EFFORT if waves else 1)


def nested(arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, where: str, wish: Wish) -> Nested:
    """Choose the argument to integrate over: one that leaves a closed form for the others, if there is one."""
    _refuse_surfaces([arguments[i] for i in used], body, where)
    body = written_out(body) if _curves_mix(body, [arguments[i] for i in used]) else body
    best: Nested | None = None
    reason: LinearisationError | None = None
    rows = {i: sum(rows_in(factor, arguments[i]) for _, factor in curve_factors(body, arguments[i])) for i in used}
    inside = {i: sum(rows_in(body, arguments[j]) for j in used if j != i) for i in used}
    for outer in sorted(used, key=lambda i: (rows[i], inside[i])):
        if best is not None and rows[outer] * FEWEST > best.effort:  # a slice for every row takes more, and long to make
            continue
        if best is not None and inside[outer] and best.error < LOST_ERROR:  # of which rows are not followed
            continue
        try:
            candidate = _over(arguments, used, outer, body, where, wish)
        except LinearisationError as error:
            reason = error
            continue
        if candidate is not None and (best is None or _worth(candidate) < _worth(best)):
            best = candidate
    if best is None:
        raise reason or LinearisationError(
            f"{where}: in `{body}` the kinks of every argument depend on the others in a way that cannot be solved; "
            "write it with one linear form of the state in each comparison"
        )
    if best.nodes > MAX_NODES and not wish.plain:
        return nested(arguments, used, body, where, replace(wish, lean=True, plain=wish.lean))
    if best.nodes > MAX_NODES:
        raise LinearisationError(
            f"{where}: the expectation of `{body}` takes {best.nodes} evaluations at every call, more than {MAX_NODES}: it is "
            f"an integral over {len(used)} arguments at once. Split it: write it as a sum of products of functions of fewer "
            "arguments, or give a part of it a state of its own (a fast first-order filter)"
        )
    return best


def _worth(candidate: Nested) -> tuple[bool, int]:
    """To be least: whether kinks are lost, the effort."""
    return candidate.error >= LOST_ERROR, candidate.effort


def _refuse_surfaces(symbols: list[sp.Symbol], body: sp.Expr, where: str) -> None:
    """No switch of three arguments that is on a curve of the other two whichever of them is given."""
    if len(symbols) < 3:
        return
    for switch in dict.fromkeys(e for z in symbols for e in switching_functions(body, z)):
        if not all(switch.has(z) for z in symbols) or has_kinks(switch, symbols[0]):  # what is within switches by itself
            continue
        others = (set(symbols) - {z} for z in symbols)
        if all(not switch.is_polynomial(*rest) or sp.total_degree(switch, *rest) > 1 for rest in others):
            names = ", ".join(map(str, symbols))
            raise LinearisationError(
                f"{where}: the term `{body}` switches where `{switch}` is zero, a surface curved in all of {names}: an "
                "integral over three arguments at once would not be accurate. Split it: give a product or a square of two of "
                "them a state of its own (a fast first-order filter), so that the switch is one of two arguments"
            )


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

    def inner(expr: sp.Expr, cell: Cell = WHOLE, place: tuple[sp.Expr, int] | None = None) -> DescribingFunction:
        symbol, at, ends = z, _inside(cell, wish), (cell.lower, cell.upper)
        if place is not None:
            end, side = place
            at = abs(evaluate(end, wish.sample) - at) if end.free_symbols <= wish.sample.keys() else INSIDE
            symbol, expr = DISTANCE, about_end(expr, z, end, side, DISTANCE)
            ends = sp.S.Zero, cell.upper - cell.lower
        sample, outside = {symbol: at, **wish.sample}, {**wish.outside, symbol: ends}
        return describe(rest, expr, where, replace(wish, sample=sample, error=INNER_ERROR, outside=outside))

    splitter = Splitter(z, where, wish.outside)
    met: list[DescribingFunction] = []

    def slices_of(curve: sp.Expr, factor: sp.Expr) -> list[Slice] | None:
        found = list[Slice]()
        own = factor.replace(lambda e: isinstance(e, Lookup) and e.has(z), lambda e: e.as_piecewise())
        cells = _cells(splitter, own, rest, inner, wish)
        for cell, value in _joined(cells or []):
            require_expectation(value, cell, splitter)
            expressions = value, _slope(value, z)
            whole = [inner(expr, cell) for expr in expressions]
            met.append(whole[0])
            for lower, upper, singular in stretches(cell, value, z, rough=_is_rough(whole[0], z)):
                steep = () if wish.plain or wish.lean else tuple(steep_places(value, z, Cell.between(lower, upper), singular))
                steep = steep if wish.plain or any(singular) else (*steep, *_waves(value, z, rest))
                part = Integral(lower, upper, value, z, steep, singular)
                near = [inner(expr, cell, part.singular_end) for expr in expressions] if part.singular_end else whole
                found.append(Slice(part, near[0], near[1], curve))
        if curve != 1 and any(any(piece.part.singular) for piece in found):  # there nodes go by the distance from an end
            return slices_of(sp.S.One, curve * factor) if rows_in(curve, z) <= MAX_ROWS else None
        return None if cells is None else found

    slices: list[Slice] = []
    for pair in curve_factors(body, z):
        found = slices_of(*pair)
        if found is None:
            return None
        slices += found
    steps = (Step(position, inner(change)) for position, change in _steps(slices, z))
    crossed, error = crossings_of(met, z, others)
    inside = max((piece.inner.error for piece in slices), default=0.0)
    error = max(error, inside) if inside >= CURVED_ERROR else error
    crossings = tuple(c for c in crossed if c.width is None or not (wish.plain or wish.lean))
    oscillates = any(wave.has(*rest, z) for wave in body.atoms(sp.sin, sp.cos))
    kinds = [
        {"sums": s.inner.nodes > 0, "plain": wish.plain, "lean": wish.lean, "waves": oscillates, "curved": s.curve != 1}
        for s in slices
    ]
    ready = tuple(replace(s, part=ruled(s.part, crossings, **kind)) for s, kind in zip(slices, kinds, strict=True))
    error = PLAIN_ERROR if wish.plain else max(error, LEAN_ERROR) if wish.lean else error
    return Nested(outer, others, ready, tuple(steps), crossings, error, lean=wish.lean and not wish.plain)


def _waves(value: sp.Expr, z: sp.Symbol, rest: tuple[sp.Symbol, ...]) -> Iterator[Steep]:
    """Where waves in another argument are long: averaged over it, they are seen near there only."""
    for wave in sorted(value.atoms(sp.sin, sp.cos), key=sp.default_sort_key):
        for y in rest:
            line = affine(sp.diff(wave.args[0], y), z)
            if line is not None and line[0].is_number and line[0] != 0:
                yield Steep(-line[1] / line[0], 1 / sp.Abs(line[0] * y))
                return


def _inside(cell: Cell, wish: Wish) -> float:
    """A number for the outer argument that lies in a cell."""
    bounds = (cell.lower, cell.upper)
    known = [not b.is_infinite and b.free_symbols <= wish.sample.keys() for b in bounds]
    low, high = (evaluate(b, wish.sample) if k else 0.0 for b, k in zip(bounds, known, strict=True))
    if all(known):
        return low + INSIDE * (high - low)
    return high - INSIDE if known[1] else low + INSIDE


def _cells(
    splitter: Splitter,
    body: sp.Expr,
    rest: tuple[sp.Symbol, ...],
    inner: Callable[[sp.Expr], DescribingFunction],
    wish: Wish,
) -> Partition | None:
    """The function cut at its kinks in the outer argument; where these depend on the others, cut where theirs meet."""
    try:
        cells = splitter.terms(body)
        if not any(bound.has(*rest) for cell, _ in cells for bound in (*cell.lowers, *cell.uppers)):
            return cells
    except LinearisationError:
        pass
    z, cells = splitter.z, []
    for whole, value in _settled(splitter, body, Cell(), rest):
        own = {factor for expr in switching_functions(value, z) for factor in _factors(expr) if not factor.has(*rest)}
        points = _ordered(_meetings(own | _differences(inner(value), z), z))
        if points is None:
            return None
        for low, high in pairwise([None, *points, None]):
            cell = whole if low is None else whole.above(low)
            cell = cell if high is None or cell is None else cell.below(high)
            if cell is None:
                continue
            decided = _decided(value, z, rest, {**wish.sample, z: _inside(cell, wish)})
            if decided != value and _is_empty(cell, wish):  # for other numbers of the parameters it may not be so
                return None
            cells.append((cell, decided))
    return cells


def _settled(splitter: Splitter, body: sp.Expr, cell: Cell, rest: tuple[sp.Symbol, ...]) -> Partition:
    """The function cut where switches of the outer argument alone turn, without these; others stay."""
    kinds = (Relational, sp.sign, sp.Heaviside, sp.Abs, sp.Max, sp.Min)
    own = [e for e in body.atoms(*kinds) if e.has(splitter.z) and not e.has(*rest)]
    if not own:
        return [(cell, body)]
    switch = min(own, key=lambda e: (sp.count_ops(e), sp.default_sort_key(e)))  # one that holds no other
    if isinstance(switch, Relational):
        parts = [(c, sp.true if holds else sp.false) for c, holds in splitter.region(switch, cell)]
    else:
        parts = splitter.split(switch, cell)
    return [piece for c, value in parts for piece in _settled(splitter, body.xreplace({switch: value}), c, rest)]


def _is_empty(cell: Cell, wish: Wish) -> bool:
    """Whether there is nothing in a cell for the declared numbers of the parameters."""
    if not all(bound.free_symbols <= wish.sample.keys() for bound in (*cell.lowers, *cell.uppers)):
        return False
    low = max((evaluate(bound, wish.sample) for bound in cell.lowers), default=-np.inf)
    return bool(low >= min((evaluate(bound, wish.sample) for bound in cell.uppers), default=np.inf))


def _factors(expr: sp.Expr) -> list[sp.Expr]:
    """Those of a polynomial; anything else is one."""
    return [factor for factor, _ in factored(expr)[1]] if expr.is_polynomial(*expr.free_symbols) else [expr]


def _ordered(points: set[sp.Expr]) -> list[sp.Expr] | None:
    """From the least to the largest, of those that differ by rounding the simplest; None where the order is not known."""
    found: list[sp.Expr] = []
    for point in sorted((p for p in points if p.is_number), key=float):
        if found and abs(float(point) - float(found[-1])) <= SAME * (1 + abs(float(point))):
            found[-1] = min(found[-1], point, key=lambda p: len(str(p)))
        else:
            found.append(point)
    for point in points - set(found):
        if point.is_number:
            continue
        sides = [False if (other - point).is_nonnegative else (point - other).is_nonnegative for other in found]
        if None in sides:
            return None
        found.insert(sum(sides), point)
    return found


def _meetings(differences: set[sp.Expr], z: sp.Symbol) -> set[sp.Expr]:
    """Where a difference is zero: of any that are straight lines or parabolas, and of polynomials in numbers."""
    found: set[sp.Expr] = set()
    for difference in differences:
        line = affine(difference, z)
        if line is not None:
            found.add(-line[1] / line[0])
        elif difference.is_polynomial(z) and difference.free_symbols == {z}:
            roots = np.roots([float(c) for c in sp.Poly(difference, z).all_coeffs()])
            found |= {sp.Rational(str(float(root.real))) for root in roots if abs(root.imag) < 1e-12}
        elif difference.is_polynomial(z) and sp.degree(difference, z) == 2:
            a, b, c = sp.Poly(difference, z).all_coeffs()
            root = sp.sqrt(sp.factor(b**2 - 4 * a * c))
            found |= {(-b - root) / (2 * a), (-b + root) / (2 * a)} if root.is_real else set()
    return found


def _decided(body: sp.Expr, z: sp.Symbol, rest: tuple[sp.Symbol, ...], numbers: Mapping[sp.Symbol, float]) -> sp.Expr:
    """The function on a cell of the outer argument, on which a factor of a switch that holds it alone has one sign."""

    def is_mixed(expr: sp.Basic) -> bool:
        return isinstance(expr, sp.sign | sp.Heaviside | sp.Abs | Relational) and expr.has(z) and expr.has(*rest)

    def parted(expr: sp.Basic) -> sp.Basic:
        whole = expr.lhs - expr.rhs if isinstance(expr, Relational) else expr.args[0]
        own = sp.Mul(*(f for f in _factors(whole) if not f.has(*rest) and f.has(z) and f.free_symbols <= numbers.keys()))
        if own == 1:
            return expr
        side, others = (1 if evaluate(own, numbers) > 0 else -1), sp.cancel(whole / own)
        if isinstance(expr, Relational):
            return expr.func(side * others, sp.S.Zero)
        if isinstance(expr, sp.Heaviside):
            return sp.Heaviside(side * others, *expr.args[1:])
        return side * sp.sign(others) if isinstance(expr, sp.sign) else side * own * sp.Abs(others)

    return body.replace(is_mixed, parted)


def _differences(df: DescribingFunction, z: sp.Symbol) -> set[sp.Expr]:
    """What changes sign where kinks of the inner arguments meet, or a condition on the outer one turns."""
    found: set[sp.Expr] = set()
    for product in df.products:
        for expr in product.expressions():
            for node in expr.atoms(sp.Max, sp.Min, Relational):
                sides = [side for side in node.args if side != TINY]
                found.update(sp.expand(a - b) for a, b in combinations(sides, 2))
                found.update(side for side in sides if len(sides) < len(node.args))
        found.update(sp.expand(a - b) for (_, a), (_, b) in combinations(product.kinks(), 2))
    return {difference for difference in found if difference.has(z)}


def _is_rough(df: DescribingFunction, z: sp.Symbol) -> bool:
    """Whether kinks of the inner argument move like roots or poles: those of a circle, of a product of both arguments."""
    positions = (position for product in df.products for _, position in product.kinks())
    powers = (power for position in positions for power in position.atoms(sp.Pow) if power.has(z))
    return any(not (power.exp.is_integer and power.exp.is_nonnegative) for power in powers)


def _slope(value: sp.Expr, z: sp.Symbol) -> sp.Expr:
    """The derivative in the outer argument, but for jumps along lines across both, of which `lowering.nested` knows."""
    derivative = sp.diff(value, z).replace(sp.DiracDelta, lambda *_: sp.S.Zero)
    if not derivative.has(sp.Derivative, sp.DiracDelta, sp.Subs):
        return derivative
    raise LinearisationError(f"`{value}` cannot be differentiated in `{z}`")


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
        for end, side in ((piece.part.lower, 1), (piece.part.upper, -1)):
            if not end.is_infinite:
                curve = written_out(piece.curve).subs(z, end) if piece.curve != 1 else 1
                changes[end] += side * curve * piece.part.value
    for position, change in changes.items():
        size = normal(change.subs(z, position))
        if size != 0 and size.is_finite is not False:
            yield position, size
