"""Find which functions of two arguments are integrated over both at once, with what step, and how accurate that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import sympy as sp

from cadet_sym.expectation.closed_form import decompose
from cadet_sym.expectation.pieces import Cell, has_kinks
from cadet_sym.expectation.planar import INNER, OUTER, REACH, Layout, Moments, Number, Planar, density
from cadet_sym.expectation.quadrature import NumpyAlgebra, Wish
from cadet_sym.expectation.steep import steep_places
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import Lookup

STEPS = (0.36, 0.33, 0.31, 0.29, 0.27, 0.25, 0.22, 0.18)
FINEST, FARTHEST = 0.14, 7.8  # step and reach of the reference
BISECTIONS = 52
WANTED, WARNED = 5e-9, 1e-8
SPREADS = (0.1, 1.0, 10.0)  # of the moments at which the error is estimated
SHAPES = (  # ratio of the standard deviations, correlation, means in standard deviations
    (1.8, 0.0, (-1.6, 1.1)),
    (2.0, 0.5, (0.0, 0.0)),
    (0.5, -0.95, (0.0, 0.0)),
    (2.0, 0.999999, (-0.4, 0.9)),
)


def planar(arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, wish: Wish) -> Planar | None:
    """The function, if it is smooth in two arguments, has no closed form in either, and is integrated well enough so."""
    if len(used) != 2 or wish.plain or body.has(Lookup) or any(has_kinks(body, arguments[i]) for i in used):
        return None
    if any(decompose(body, arguments[i]) is not None or body.has(sp.erf) for i in used):
        return None
    for outer, inner in (used, used[::-1]):
        x, y = arguments[outer], arguments[inner]
        inside = tuple(steep_places(body, y, Cell(), (False, False)))
        if len(inside) > 1 or any(place.step for place in inside):
            continue
        own = tuple(steep_places(body, x, Cell(), (False, False)))
        candidate = Planar(outer, inner, body, (x, y), own, inside[0] if inside else None)
        if candidate.pole is None or candidate.curve is not None:
            found = measured(candidate, wish)
            if found.error <= WARNED:
                return found
    return None


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
    free = sorted(planar.value.free_symbols - set(planar.symbols), key=str)
    numbers = {s: float(sample.get(s, 1.0)) for s in free}
    return [_Case.of(planar, numbers, spread, *shape) for spread, shape in product(spreads, SHAPES)]


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
        """Standard deviations of that geometric mean and ratio; the means in standard deviations."""
        sd = spread * np.sqrt(ratio), spread / np.sqrt(ratio)
        left = sd[1] * np.sqrt(1 - rho * rho)
        moments = Moments(mean[0] * sd[0], sd[0], mean[1] * sd[1], rho * sd[1], left, sd[1])
        case = _Case(planar, numbers, moments, np.zeros(3), 1.0)
        reference, size, _ = case.sums(FINEST, FARTHEST)
        return replace(case, reference=reference, size=size)

    def error(self, step: float) -> tuple[float, int]:
        """Relative to E|f|, of E[f] and of the gains times standard deviations; and the number of nodes."""
        found, _, count = self.sums(step, REACH)
        with np.errstate(all="ignore"):
            error = float(np.max(np.abs(found - self.reference))) / self.size if self.size else 0.0
        return (error if np.isfinite(error) else np.inf), count

    def sums(self, step: float, reach: float) -> tuple[np.ndarray, float, int]:
        """E[f], the gains times standard deviations; E|f|; the number of nodes."""
        at, (outer, inner) = self.moments, self.planar.symbols
        layout = Layout(replace(self.planar, step=step), self._evaluate, NumpyAlgebra(), reach)
        u, weight = self._outer_nodes(layout)
        line = layout.stretch(u, at)
        counts = np.array(INNER.counts)[INNER.index(layout.steps(u, *line[2:]), layout.xp).astype(int)]
        counts = np.full_like(counts, self.planar.counts[1]) if self.planar.counts else counts
        total, size, nodes = np.zeros(3), 0.0, 0
        for count in np.unique(counts):
            on = counts == count
            v, w, factor = layout.inner_nodes(tuple(x[on] for x in line), int(count))
            z = {outer: at.m + at.s * u[on] + 0 * v, inner: at.mean + at.lean * u[on] + at.left * v}
            weights = w * (factor * weight[on])
            f, *slopes = (np.broadcast_to(self._evaluate(e, z), v.shape) * weights for e in self.planar.slopes)
            total += np.array([np.sum(f), *(s * np.sum(slope) for s, slope in zip((at.s, at.spread), slopes, strict=True))])
            size, nodes = size + float(np.sum(np.abs(f))), nodes + v.size
        return total, size, nodes

    def _evaluate(self, expr: sp.Expr, known: Mapping[sp.Symbol, Number]) -> Number:
        return evaluate(expr, {**self.numbers, **known})

    def _outer_nodes(self, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
        places = layout.places(self.moments)
        first, last = layout.tau(-layout.reach, places), layout.tau(layout.reach, places)
        count = OUTER.counts[int(OUTER.index(layout.outer_steps(first, last, self.moments), layout.xp))]
        count = self.planar.counts[0] if self.planar.counts else count
        step = (last - first) / (count - 1)
        wanted = first + step * np.arange(count)
        low, high = np.full(count, -layout.reach), np.full(count, layout.reach)
        for _ in range(BISECTIONS):
            u = (low + high) / 2
            above = layout.tau(u, places) > wanted
            low, high = np.where(above, low, u), np.where(above, u, high)
        u = (low + high) / 2
        return u, step / layout.slope(u, places) * density(u, layout.xp)
