"""Choose the order of a quadrature by its error over a grid of means and variances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ExpectationWarning, LinearisationError, ModelError
from cadet_sym.expectation.algebra import NumpyAlgebra
from cadet_sym.expectation.panels import REACH, lay_out
from cadet_sym.expectation.pieces import affine
from cadet_sym.expectation.quadrature import Integral, Rule, Wish
from cadet_sym.language.numeric import evaluate
from cadet_sym.warning import warn

WARNED = 1e-8
FLOOR = 1e-3  # of the largest value at the same variance: what an error is relative to at least
SMOOTH = tuple(Rule(straight=order) for order in (16, 24, 32, 40, 64, 128))
POLES = tuple(Rule(panels, order) for panels, order in ((1, 24), (1, 32), (1, 40), (1, 48), (2, 32), (4, 32)))
TRAPEZOIDAL = tuple(Rule(order=order) for order in (32, 48, 64, 80, 96, 128, 160, 200))
SINGULAR = (
    *(Rule(graded=order, power=power, whole=True) for power, order in ((2, 40), (2, 48), (3, 56))),
    Rule(straight=40),
    Rule(straight=80, graded=40),
)
SINGULAR_POLES = (Rule(2, 16, 40), Rule(2, 16, 40, 40), Rule(3, 24, 64, 32), Rule(4, 32, 64, 48))
UNCHECKED = 3  # which rule is taken where no numbers are known to check it with
SPREADS = (0.03, 0.3, 1.0, 3.0, 10.0, 100.0)  # standard deviations, on the scale of the function
FAR = 1e3  # beyond these a function is nearly a kink, and an error of FAR_ERROR will do
FAR_ERROR = 1e-9
WAVE_SPREADS = SPREADS[:-1]  # ten times their length is as far as nodes go
WIDE = 10.0  # standard deviation, in the units of the states, up to which steep places are looked at whatever their width
MOST = 1e12  # widths of a steep place in a standard deviation
PLACES = (-9.0, -7.5, -6.0, -2.5, -1.0, 0.0, 0.7, 2.0, 5.0, 7.0, 8.5)
UNKNOWN = (1.0, 1.2, 0.8)  # numbers tried for a parameter whose value is not known


def rules(part: Integral) -> tuple[Rule, ...]:
    """The rules for a piece, the cheapest first."""
    if any(part.singular):
        return SINGULAR_POLES if part.steep else SINGULAR
    if part.is_trapezoidal:
        return TRAPEZOIDAL
    return POLES if part.steep else SMOOTH


def _reference(part: Integral) -> Rule:
    """A rule that is far more accurate than any of those tried."""
    return Rule(order=320) if part.is_trapezoidal else Rule(6, 32, 150, 60)


def chosen(part: Integral, where: str, wish: Wish) -> Integral:
    """The piece with the cheapest rule that is accurate enough; a warning if none is.

    Where the number of a parameter is not known, numbers near one stand for it and nothing is warned of; nor where for the
    numbers known the piece is empty, which it may not be for others.
    """
    free = (part.value.free_symbols | part.lower.free_symbols | part.upper.free_symbols) - {part.argument}
    sample = wish.sample if free <= wish.sample.keys() and not _is_empty(part, wish.sample) else {}
    known = free <= sample.keys()
    best = replace(part, rule=rules(part)[min(UNCHECKED, len(rules(part)) - 1)], error=np.inf)
    for guess in UNKNOWN[: 1 if known else None]:
        numbers = {s: float(sample.get(s, guess**i)) for i, s in enumerate(sorted(free, key=str))}
        if _is_finite(part, numbers):
            found = _cheapest(part, numbers, wish)
            best = found if found.error < best.error else best
        if best.error <= wish.error:
            return best
    if known and WARNED < best.error < np.inf:
        text = (
            f"{where}: quadrature of `{part.value}` is accurate to {best.error:.0e} only; "
            "write it in steps that are less steep, or check it with cs.check"
        )
        warn(ExpectationWarning(text, where, best.error))
    if known and best.error == np.inf:
        raise LinearisationError(
            f"{where}: no finite value was found for the expectation of `{part.value}`: it may be infinite somewhere, or "
            "grow too fast; clip its argument (max, min, clip, or a stop in a conditional)"
        )
    return best if known else replace(best, error=min(best.error, WARNED))


def error_of(part: Integral, sample: Mapping[sp.Symbol, float], scale: float) -> float:
    """The error of the rule that a piece has, for other numbers of the parameters; its own if these are not all known."""
    free = (part.value.free_symbols | part.lower.free_symbols | part.upper.free_symbols) - {part.argument}
    numbers = {s: float(sample[s]) for s in free if s in sample}
    if len(numbers) < len(free) or not _is_finite(part, numbers):
        return part.error
    return _cheapest(part, numbers, Wish(sample, scale=scale), (part.rule,)).error


def _cheapest(part: Integral, numbers: dict[sp.Symbol, float], wish: Wish, among: tuple[Rule, ...] = ()) -> Integral:
    checked, wanted = [part, part.derivative()], wish.error
    if any(part.singular):  # its gain is taken by parts, which multiplies the error by the distance from the mean
        checked, wanted = [part, *_away_from_end(part)], wanted / REACH
    near = _Reference(checked, numbers, *_grid(part, numbers))
    far = _Reference(checked, numbers, *_grid(part, numbers, WIDE * wish.scale)) if part.steep else None
    found = part
    for rule in among or rules(part):
        here, beyond = near.error(rule), far.error(rule) if far else 0.0
        found = replace(part, rule=rule, error=max(here, beyond))
        if here <= wanted and beyond <= max(wanted, FAR_ERROR):
            break
    return found


def _away_from_end(part: Integral) -> Iterator[Integral]:
    """The derivative times the distance from a singular end, at which it may be infinite, where anything else is steep."""
    if part.steep:
        distance = part.upper - part.argument if part.singular[1] else part.argument - part.lower
        slopes = sp.Add.make_args(sp.diff(part.value, part.argument))
        yield replace(part, value=sp.Add(*(distance * slope for slope in slopes)))


class _Reference:
    """Accurate expectations over a grid, against which rules are held, of expressions that have their nodes in common."""

    def __init__(self, parts: Sequence[Integral], numbers: dict[sp.Symbol, float], means: np.ndarray, spreads: np.ndarray):
        self.parts, self.case = parts, (numbers, means, spreads)
        estimates = _estimates(parts, _reference(parts[0]), *self.case)
        _, group = np.unique(spreads, return_inverse=True)
        self.values, self.scales = [], []
        for value, sizes in estimates:
            sizes = np.where(np.isfinite(sizes), sizes, 0.0)
            largest = np.zeros(group.max() + 1)
            np.maximum.at(largest, group, sizes)
            self.values.append(value)
            self.scales.append(sizes + FLOOR * largest[group])

    def error(self, rule: Rule) -> float:
        """Largest error, relative to E|f| at the mean or to a part of its largest value at any mean."""
        worst = 0.0
        for (found, _), value, scale in zip(_estimates(self.parts, rule, *self.case), self.values, self.scales, strict=True):
            with np.errstate(all="ignore"):
                errors = np.abs(found - value) / scale
            errors = errors[np.isfinite(errors) & (scale > 0)]
            worst = max(worst, float(errors.max()) if errors.size else 0.0)
        return worst


def _is_empty(part: Integral, numbers: Mapping[sp.Symbol, float]) -> bool:
    """Whether the upper end is not above the lower one."""
    low, high = _ends(part, numbers)
    return not low < high


def _is_finite(part: Integral, numbers: Mapping[sp.Symbol, float]) -> bool:
    """Whether the expression has finite values within its cell."""
    low, high = _ends(part, numbers)
    if _is_empty(part, numbers):
        return False
    points = np.array([0.5 * (low + high), low + 0.1 * (high - low), low + 0.9 * (high - low)])
    return bool(np.all(np.isfinite(_value(part, numbers, points))))


def _ends(part: Integral, numbers: Mapping[sp.Symbol, float]) -> tuple[float, float]:
    low = -np.inf if part.lower.is_infinite else evaluate(part.lower, numbers)
    high = np.inf if part.upper.is_infinite else evaluate(part.upper, numbers)
    return (low if np.isfinite(low) else min(high, 0.0) - 3.0), (high if np.isfinite(high) else max(low, 0.0) + 3.0)


def _value(part: Integral, numbers: Mapping[sp.Symbol, float], z: np.ndarray) -> np.ndarray:
    try:
        value = evaluate(part.value, {**numbers, part.argument: z})
    except ModelError:
        return np.full_like(z, np.nan)
    return np.broadcast_to(value, z.shape)


def _grid(part: Integral, numbers: dict[sp.Symbol, float], far: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations around the kinks and steep places, on their scales, or beyond these as `far` as that."""
    low, high = _ends(part, numbers)
    points = [b for b, bound in ((low, part.lower), (high, part.upper)) if not bound.is_infinite]
    points += [evaluate(place.centre, numbers) for place in part.steep]
    widths = [evaluate(place.width, numbers) for place in part.steep]
    waves = _wave_lengths(part, numbers)
    scales = {abs(a - b) for a in points for b in points} | set(widths) | set(waves)
    scales = sorted({s for s in scales if np.isfinite(s) and s > 1e-9}) or [1.0]
    points = sorted({p for p in points if np.isfinite(p)}) or [0.0]
    wide = sorted({FAR, min(max(far / scales[0], FAR), MOST)})
    of_scale = WAVE_SPREADS if waves else wide if far else SPREADS
    cells = [
        (p + place * spread * scale, spread * scale)
        for scale in (scales[0], scales[-1])
        for spread in of_scale
        for p in points[:3]
        for place in PLACES
    ]
    means, spreads = np.array(cells).T
    return means, spreads


def _wave_lengths(part: Integral, numbers: dict[sp.Symbol, float]) -> list[float]:
    """Lengths, over 2 pi, of the waves in the expression that go on for ever."""
    if not (part.lower.is_infinite or part.upper.is_infinite):
        return []
    inner = [wave.args[0] for wave in part.value.atoms(sp.sin, sp.cos) if wave.has(part.argument)]
    lines = [affine(expr, part.argument) for expr in inner]
    return [1 / max(abs(evaluate(line[0], numbers)), 1e-9) for line in lines if line is not None]


def _estimates(
    parts: Sequence[Integral], rule: Rule, numbers: dict[sp.Symbol, float], means: np.ndarray, spreads: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """E[f] and E|f| over the grid, of expressions that differ in their values alone."""
    part = replace(parts[0], rule=rule)
    low = np.full_like(means, -REACH)
    high = np.full_like(means, REACH)
    if not part.lower.is_infinite:
        low = np.clip((evaluate(part.lower, numbers) - means) / spreads, -REACH, REACH)
    if not part.upper.is_infinite:
        high = np.clip((evaluate(part.upper, numbers) - means) / spreads, -REACH, REACH)
    steep: list[tuple[Any, Any]] = [
        ((evaluate(s.centre, numbers) - means) / spreads, evaluate(s.width, numbers) / spreads) for s in part.steep
    ]
    found = []
    with np.errstate(all="ignore"):
        pieces = lay_out(part, low, np.maximum(low, high), steep, NumpyAlgebra())
        nodes = [(means + spreads * n.u, n.weight) for n in pieces]
        for each in parts:
            values = [(np.where(w == 0, 0, _value(each, numbers, z)), w) for z, w in nodes]
            total = sum(np.sum(v * w, axis=0) for v, w in values)
            size = sum(np.sum(np.abs(v) * w, axis=0) for v, w in values)
            found.append((np.asarray(total), np.asarray(size)))
    return found
