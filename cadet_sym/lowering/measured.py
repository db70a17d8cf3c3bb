"""Measure what integrals over one argument of functions of several leave, against adaptive integration of the function itself.

Their nodes follow from where kinks, poles and waves are met, not from a search as those of one argument: how good they are
depends on the function, and is looked at for the moments of a short grid. Where adaptive integration is not sure in the
evaluations that it has, as of functions of three arguments that change fast or of curves of many rows, the same rules with
twice the nodes stand for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.errors import ExpectationWarning, LinearisationError
from cadet_sym.expectation.accuracy import WARNED
from cadet_sym.expectation.conditional import Part
from cadet_sym.expectation.crossings import LEAN_ERROR
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.existence import gap
from cadet_sym.expectation.nested import Nested
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.expectation.tables import rows_in
from cadet_sym.language.expression import DISTANCE, SPEED, TIME, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.linearisation import Nonlinearity, shown
from cadet_sym.lowering.check import Truth
from cadet_sym.lowering.elements import element_function, parameters_of
from cadet_sym.lowering.survey import with_elements
from cadet_sym.moments import MomentEquations
from cadet_sym.warning import warn

__all__ = ["measured", "measured_error", "numbers_at_start"]

GRID = {  # standard deviation, correlation
    2: ((0.1, 0.5), (1.0, -0.9), (1.0, 0.5), (1.0, 0.995), (10.0, 0.4), (10.0, -0.9), (10.0, -0.9999)),
    3: ((0.1, 0.3), (1.0, -0.8), (10.0, 0.5)),
}
WIDEST = 10.0
RATIOS = (1.0, 1.4, 0.7)
MEANS = (0.6, -0.8, 0.4)
TOLERANCE = {2: 1e-9, 3: 1e-6}
MOST = {2: 500_000, 3: 600_000}  # evaluations for one case
MOST_ROWS = 24  # of a measured curve, at every one of which it would have to be cut
UNSURE = 1e-6  # error of the reference at which it is of no use
SAFETY = 10.0  # moments between those of the grid may be worse
SAMPLES = 4000
MOST_NODES = 200  # of three arguments from which on nodes are not doubled any more
REFUSED = 0.1  # of three arguments, at deviations of their own size: an approximation of an approximation


def measured(equations: MomentEquations) -> MomentEquations:
    """The same equations with the errors of such integrals as they are; a warning names what is not accurate."""
    numbers, states = numbers_at_start(equations), equations.quasi_linear.system.states

    @cache
    def of_its_scale(core: DescribingFunction, scale: float) -> tuple[DescribingFunction, dict[float, float]]:
        return refined(core, numbers, scale)

    def with_error(element: Nonlinearity, where: str) -> Nonlinearity:
        df = element.describing
        scale = max((form.scale(numbers) for form in element.forms), default=1.0)
        better = {core: of_its_scale(core, scale) for core in _measurable(df)}
        if not better:
            return element
        found = [(errors, len(core.arguments)) for core, (_, errors) in better.items()]
        of_what = f"`{shown(element.of(states))}`"
        error = max(max(errors.values()) for errors, _ in found)
        if not np.isfinite(error):
            _refuse_gaps(element, states, numbers, scale, f"{where} has no Gaussian expectation: {of_what}")
        if any(_within(errors, scale) > REFUSED and count == max(GRID) for errors, count in found):
            raise LinearisationError(
                f"{where}: no accurate expectation of {of_what} was found ({error:.0e} is left): split it, as a sum of "
                "products of functions of one or two linear forms each, or give a part of it a state of its own (a fast "
                "first-order filter)"
            )
        if error > WARNED:
            widest, as_far = max(max(errors) for errors, _ in found), _as_far([errors for errors, _ in found])
            text = (
                f"{where}: the expectation of {of_what} and its gains are accurate to {error:.0e} only, at standard "
                f"deviations of its arguments up to {widest:g}{as_far}: it switches or oscillates across several; write it "
                "as a sum of products of functions of one linear form each, or see with cs.check where it is worst"
            )
            warn(ExpectationWarning(text, where, error))
        return replace(element, describing=_exchanged(df, {core: new for core, (new, _) in better.items()}))

    return with_elements(equations, with_error)


def _refuse_gaps(
    element: Nonlinearity, states: Sequence[sp.Symbol], numbers: Mapping[sp.Symbol, float], scale: float, what: str
) -> None:
    """No function that is no number, or a complex one, in a part of its arguments' range."""
    nearest = gap(element.describing.arguments, element.describing.body, numbers, scale)
    if nearest is not None:
        at = zip(element.forms, nearest, strict=True)
        place = " and ".join(f"`{shown(form.of(states))}` is {z:.3g}" for form, z in at)
        raise LinearisationError(
            f"{what} is no real number everywhere, for example where {place}; keep "
            "what is in its roots, logarithms and powers from becoming negative (max, clip)"
        )


def _measurable(df: DescribingFunction) -> Iterator[DescribingFunction]:
    """What holds such integrals: the function, or those that its terms are reduced to."""
    if any(isinstance(product, Nested) for product in df.products):
        yield df
        return
    for product in df.products:
        if isinstance(product, Reduced):
            yield from _measurable(product.core)


def _exchanged(df: DescribingFunction, better: Mapping[DescribingFunction, DescribingFunction]) -> DescribingFunction:
    """With other functions instead of those that its terms are reduced to, or of itself."""
    if df in better:
        return replace(better[df], name=df.name)
    parts = (replace(p, core=_exchanged(p.core, better)) if isinstance(p, Reduced) else p for p in df.products)
    return replace(df, products=tuple(parts))


def numbers_at_start(equations: MomentEquations) -> dict[sp.Symbol, float]:
    """The numbers of the parameters; t = s = 0 and speed 1 where a function depends on them."""
    values = equations.quasi_linear.system.model.parameter_values()
    return {**{symbol(name): float(value) for name, value in values.items()}, TIME: 0.0, DISTANCE: 0.0, SPEED: 1.0}


def measured_error(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], scale: float = 1.0) -> float:
    """The largest error found of E[f], relative to E|f|, and of the gains, relative to that over the standard deviation.

    Multiplied by `SAFETY`; where the reference itself is not sure, no less than what such rules leave.
    """
    cases = _cases(df, numbers, scale)
    return max(_errors(df, cases).values()) if cases else df.error


def refined(
    df: DescribingFunction, numbers: Mapping[sp.Symbol, float], scale: float = 1.0
) -> tuple[DescribingFunction, dict[float, float]]:
    """The function, of three arguments with as many nodes as it needs; its errors by the standard deviation of those."""
    cases = _cases(df, numbers, scale)
    if not cases:
        return df, {WIDEST * scale: df.error}
    best, errors = df, _errors(df, cases)
    while len(df.arguments) == max(GRID) and _within(errors, scale) > WARNED and df.nodes < MOST_NODES:
        df = _finer(df)
        found = _errors(df, cases)
        if _within(found, scale) < _within(errors, scale):
            best, errors = df, found
    return _with_error(best, max(errors.values())), errors


def _within(errors: Mapping[float, float], scale: float) -> float:
    return max(error for std, error in errors.items() if std <= scale)


def _with_error(df: DescribingFunction, error: float) -> DescribingFunction:
    return replace(df, products=tuple(replace(p, error=error) if isinstance(p, Nested) else p for p in df.products))


@dataclass(frozen=True)
class _Case:
    """One set of moments, the numbers of the parameters, and the expectation by adaptive integration where that is sure."""

    std: float
    at: tuple[np.ndarray, np.ndarray, list[float]]
    truth: Truth | None
    units: np.ndarray  # of errors


def _cases(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], scale: float) -> list[_Case]:
    """None if the function is not one of two or three arguments with numbers for its parameters."""
    count, free, found = len(df.arguments), parameters_of(df), list[_Case]()
    if count not in GRID or not set(free) <= numbers.keys():
        return found
    rows = max(rows_in(df.body, z) for z in df.arguments)
    for spread, rho in GRID[count]:
        stds = spread * scale * np.array(RATIOS[:count])
        mean = stds * MEANS[:count]
        covariance = rho ** np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * np.outer(stds, stds)
        known, truth = {s: numbers[s] for s in free}, None
        if rows <= MOST_ROWS and (not found or found[-1].truth is not None):  # else it will be no surer of larger ones
            truth = Truth.of(df, known, mean, covariance, TOLERANCE[count], MOST[count])
        units = _units(df, known, mean, covariance) if truth is None else truth.units
        at = mean, covariance[np.tril_indices(count)], list(known.values())
        found.append(_Case(spread * scale, at, truth if truth and truth.own <= UNSURE else None, units))
    return found


def _errors(df: DescribingFunction, cases: Sequence[_Case]) -> dict[float, float]:
    """The largest error by standard deviation; where it is known to be larger elsewhere, no less than that."""
    function = element_function(df, parameters_of(df))
    finer = None if all(case.truth for case in cases) else element_function(_finer(df), parameters_of(df))
    least = LEAN_ERROR if any(isinstance(product, Nested) and product.lean for product in df.products) else 0.0
    errors: dict[float, float] = {}
    for case in cases:
        found, own = _row(function, case), np.zeros(1)
        if case.truth is not None:
            wanted, own = case.truth.values, case.truth.errors
        else:
            wanted = found if finer is None else _row(finer, case)
        left = SAFETY * np.maximum(np.abs(found - wanted) / case.units - own, 0.0)
        doubt = min(float(own.max()), df.error) if own.max() > WARNED else 0.0
        worst = max(float(left.max()), doubt) if np.all(np.isfinite(left)) else np.inf
        errors[case.std] = max(worst, least, errors.get(case.std, 0.0))
    return errors


def _units(
    df: DescribingFunction, numbers: Mapping[sp.Symbol, float], mean: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """E|f| by sampling, and that over every standard deviation."""
    points = np.random.default_rng(0).multivariate_normal(mean, covariance, SAMPLES)
    values = np.abs(evaluate(df.body, {**numbers, **dict(zip(df.arguments, points.T, strict=True))}))
    size = float(np.mean(values[np.isfinite(values)]))
    return np.array([size, *(size / np.sqrt(np.diag(covariance)))])


def _row(function: ca.Function, case: _Case) -> np.ndarray:
    """E[f], then every gain."""
    return np.concatenate([np.array(x).ravel() for x in function(*case.at)])


def _finer(df: DescribingFunction) -> DescribingFunction:
    """The same with twice the nodes in every integral over one of several arguments."""

    def finer(part: Part) -> Part:
        if isinstance(part, Reduced):
            return replace(part, core=_finer(part.core))
        if not isinstance(part, Nested):
            return part
        slices = (replace(s, part=s.part.finer(), inner=_finer(s.inner), slope=_finer(s.slope)) for s in part.slices)
        return replace(part, slices=tuple(slices), steps=tuple(replace(s, inner=_finer(s.inner)) for s in part.steps))

    return replace(df, products=tuple(map(finer, df.products)))


def _as_far(found: list[dict[float, float]]) -> str:
    """Up to which standard deviations nothing is to be said against them."""
    good = [std for std in found[0] if all(error <= WARNED for errors in found for s, error in errors.items() if s <= std)]
    return f" (to {WARNED:.0e} up to {max(good):g})" if good else ""
