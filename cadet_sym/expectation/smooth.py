"""Find which functions of two arguments are integrated over both at once, with what step, and how accurate that is."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import sympy as sp

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.algebra import NumpyAlgebra
from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.closed_form import decompose, normal
from cadet_sym.expectation.pieces import Splitter, has_kinks
from cadet_sym.expectation.planar import INNER, OUTER, REACH, Layout, Moments, Number, Planar, density
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.steep import singular_at, steep_places
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import Lookup

STEPS = (0.36, 0.33, 0.31, 0.29, 0.27, 0.25, 0.22, 0.18)
FINEST, FARTHEST = 0.14, 7.8  # step and reach of the reference
BISECTIONS = 52
MOST_CELLS = 4
WANTED, WARNED = 5e-9, 1e-8
SPREADS = (0.1, 1.0, 10.0)  # of the moments at which the error is estimated
SHAPES = (  # ratio of the standard deviations, correlation, means in standard deviations
    (1.8, 0.0, (-1.6, 1.1)),
    (2.0, 0.5, (0.0, 0.0)),
    (0.5, -0.95, (0.0, 0.0)),
    (2.0, 0.999999, (-0.4, 0.9)),
    (1.4, 1 - 1e-12, (0.0, 0.0)),  # where two poles that the line passes are one
    (0.85, 0.3, (0.3, -0.4)),
    (0.6, -0.2, (0.9, 0.5)),
)
BEYOND = 8.0  # standard deviations from an end, which is then out of reach


def planar(arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, wish: Wish) -> tuple[Planar, ...]:
    """The function, in pieces between its kinks: none if it is not smooth in two arguments, but for kinks in one of them.

    Nor if it has a closed form in either argument, or is not integrated well enough so.
    """
    if len(used) != 2 or wish.plain or body.has(sp.erf, Lookup):
        return ()
    for outer, inner in (used, used[::-1]):
        cells = _cells(body, arguments[outer], arguments[inner])
        found = [_piece(outer, inner, arguments, cell, value, wish) for cell, value in cells]
        pieces = tuple(piece for piece in found if piece is not None)
        if pieces and len(pieces) == len(found):
            return pieces
    return ()


def _cells(body: sp.Expr, x: sp.Symbol, y: sp.Symbol) -> list[tuple[Cell, sp.Expr]]:
    """The function cut at kinks in x, through which it is continuous; nothing if it has others."""
    try:
        cells = Splitter(x, f"`{body}`").split(body, Cell())
    except LinearisationError:
        return []
    if len(cells) > MOST_CELLS or any(has_kinks(value, y) for _, value in cells):
        return []
    changes: dict[sp.Expr, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for cell, value in cells:
        if cell.conditions or cell.lower.has(y) or cell.upper.has(y):
            return []
        for end, sign in ((cell.lower, 1), (cell.upper, -1)):
            if not end.is_infinite:
                if singular_at(value, x, end):
                    return []
                changes[end] += sign * value.subs(x, end)
    if any(normal(change) != 0 for change in changes.values()):
        return []
    return [(cell, value) for cell, value in cells if value != 0]


def _piece(
    outer: int, inner: int, arguments: tuple[sp.Symbol, ...], cell: Cell, value: sp.Expr, wish: Wish
) -> Planar | None:
    x, y = arguments[outer], arguments[inner]
    if any(decompose(value, z) is not None for z in (x, y)):
        return None
    inside = tuple(steep_places(value, y, Cell(), (False, False)))
    if len(inside) > 1 or any(place.step for place in inside):
        return None
    own = tuple(steep_places(value, x, Cell(), (False, False)))
    pole = inside[0] if inside else None
    candidate = Planar(outer, inner, value, (x, y), own, pole, lower=cell.lower, upper=cell.upper)
    if candidate.pole is not None and candidate.curve is None:
        return None
    found = measured(candidate, wish)
    return found if found.error <= WARNED else None


def measured(planar: Planar, wish: Wish) -> Planar:
    """The function with the largest step that is accurate enough over a grid of moments, and the error found there."""
    cases, found = _cases(planar, wish.sample, SPREADS), replace(planar, error=np.inf)
    for step in STEPS:
        errors, counts = zip(*(case.error(step) for case in cases), strict=True)
        error = float(np.max(errors))
        found = replace(planar, step=step, error=error, nodes=int(np.median(counts)))
        if error <= WANTED:
            break
    return found


def error_of(planar: Planar, sample: Mapping[sp.Symbol, float]) -> float:
    """The error of the step that a function has, for other numbers of the parameters."""
    return max(case.error(planar.step)[0] for case in _cases(planar, sample, SPREADS))


def with_counts(planar: Planar, counts: tuple[int, int], sample: Mapping[sp.Symbol, float]) -> Planar:
    """The function with the same numbers of nodes always, and its error for moments of the order of its own scale."""
    cases = _cases(planar, sample, SPREADS[:-1])
    fixed = replace(planar, counts=counts, nodes=counts[0] * counts[1])
    return replace(fixed, error=max(replace(case, planar=fixed).error(fixed.step)[0] for case in cases))


def _cases(planar: Planar, sample: Mapping[sp.Symbol, float], spreads: tuple[float, ...]) -> list[_Case]:
    numbers = {s: float(sample.get(s, 1.0)) for s in planar.free}
    shapes = [*SHAPES, *((1.8, 0.3, (side * BEYOND, 0.5)) for _, side in planar.ends)]
    return [_Case.of(planar, numbers, spread, *shape) for spread, shape in product(spreads, shapes)]


@dataclass(frozen=True)
class _Case:
    """One set of moments, and the expectation under it by far more nodes than are needed."""

    planar: Planar
    numbers: Mapping[sp.Symbol, float]
    moments: Moments
    reference: np.ndarray  # E[f], the gains times standard deviations
    size: float  # E|f|

    @staticmethod
    def of(
        planar: Planar, numbers: Mapping[sp.Symbol, float], spread: float, ratio: float, rho: float, mean: tuple[float, float]
    ) -> _Case:
        """Standard deviations of that geometric mean and ratio; the means in standard deviations, from an end if it has one."""
        sd = spread * np.sqrt(ratio), spread / np.sqrt(ratio)
        left = sd[1] * np.sqrt(1 - rho * rho)
        origin = evaluate(planar.ends[0][0], numbers) if planar.ends else 0.0
        moments = Moments(origin + mean[0] * sd[0], sd[0], mean[1] * sd[1], rho * sd[1], left, sd[1])
        case = _Case(planar, numbers, moments, np.zeros(3), 1.0)
        reference, size, _ = case.sums(FINEST, FARTHEST)
        if planar.ends:  # errors are relative to what it would be without an end
            whole = replace(planar, lower=sp.S.NegativeInfinity, upper=sp.S.Infinity)
            size = np.fmax(size, replace(case, planar=whole).sums(FINEST, FARTHEST)[1])
        return replace(case, reference=reference, size=float(size))

    def error(self, step: float) -> tuple[float, int]:
        """Relative to E|f|, of E[f] and of the gains times standard deviations; and the number of nodes."""
        found, _, count = self.sums(step, REACH)
        with np.errstate(all="ignore"):
            error = float(np.max(np.abs(found - self.reference))) / self.size if self.size else 0.0
        return (error if np.isfinite(error) else np.inf), count

    def sums(self, step: float, reach: float) -> tuple[np.ndarray, float, int]:
        """E[f], the gains times standard deviations; E|f|; the number of nodes."""
        at, (outer, inner) = self.moments, self.planar.symbols
        layout = Layout(self.planar, self._evaluate, NumpyAlgebra(), reach, step)
        u, weight = self._outer_nodes(layout)
        line = layout.stretch(u, at)
        counts = np.array(INNER.counts)[INNER.index(layout.steps(u, *line[2:]), layout.xp).astype(int)]
        counts = np.full_like(counts, self.planar.counts[1]) if self.planar.counts else counts
        total, size, nodes = np.zeros(3), 0.0, 0
        for count in np.unique(counts):
            on = counts == count
            centre, width, first, last = (x[on] for x in line)
            v, w, factor = layout.inner_nodes((centre, width, first, (last - first) / (count - 1)), int(count))
            z = {outer: at.m + at.s * u[on] + 0 * v, inner: at.mean + at.lean * u[on] + at.left * v}
            weights = w * (factor * weight[on])
            f, *slopes = (np.broadcast_to(self._evaluate(e, z), v.shape) * weights for e in self.planar.slopes)
            total += np.array([np.sum(f), *(s * np.sum(slope) for s, slope in zip((at.s, at.spread), slopes, strict=True))])
            size, nodes = size + float(np.sum(np.abs(f))), nodes + v.size
        return total, size, nodes

    def _evaluate(self, expr: sp.Expr, known: Mapping[sp.Symbol, Number]) -> Number:
        return evaluate(expr, {**self.numbers, **known})

    def _outer_nodes(self, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
        places, ends = layout.places(self.moments), layout.ends(self.moments)
        first, last = (layout.tau(end, places) for end in ends)
        count = OUTER.counts[int(OUTER.index(layout.outer_steps(first, last, self.moments), layout.xp))]
        t, w = self.planar.outer_rule(self.planar.counts[0] if self.planar.counts else count)
        wanted = first + (last - first) * t
        low, high = (np.full(t.size, end) for end in ends)
        for _ in range(BISECTIONS):
            u = (low + high) / 2
            above = layout.tau(u, places) > wanted
            low, high = np.where(above, low, u), np.where(above, u, high)
        u = (low + high) / 2
        return u, (last - first) * w / layout.slope(u, places) * density(u, layout.xp)
