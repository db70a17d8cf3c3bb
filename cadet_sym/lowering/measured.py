"""Measure what integrals over one argument of functions of several leave, against adaptive integration of the function itself.

Their nodes follow from where kinks, poles and waves are met, not from a search as those of one argument: how good they are
depends on the function, and is looked at for the moments of a short grid.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import sympy as sp

from cadet_sym.errors import ExpectationWarning, LinearisationError
from cadet_sym.expectation.accuracy import WARNED
from cadet_sym.expectation.conditional import Part
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Nested
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.language.expression import DISTANCE, SPEED, TIME, symbol
from cadet_sym.linearisation import Nonlinearity
from cadet_sym.lowering.check import Truth
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.survey import with_elements
from cadet_sym.moments import MomentEquations
from cadet_sym.warning import warn

__all__ = ["measured", "measured_error", "numbers_at_start"]

GRID = {  # standard deviation, correlation
    2: ((0.1, 0.5), (1.0, -0.9), (1.0, 0.5), (1.0, 0.995), (10.0, 0.4), (10.0, -0.9)),
    3: ((1.0, -0.8), (10.0, 0.5)),
}
WIDEST = 10.0
RATIOS = (1.0, 1.4, 0.7)
MEANS = (0.6, -0.8, 0.4)
TOLERANCE = {2: 1e-9, 3: 1e-6}
MOST = {2: 500_000, 3: 1_500_000}  # evaluations for one case
UNSURE = 1e-6  # error of the reference at which it is of no use
SAFETY = 10.0  # moments between those of the grid may be worse
REFUSED = 5e-3  # of three arguments: no engineer waits a minute for less


def measured(equations: MomentEquations) -> MomentEquations:
    """The same equations with the errors of such integrals as they are; a warning names what is not accurate."""
    numbers = numbers_at_start(equations)

    def with_error(element: Nonlinearity, where: str) -> Nonlinearity:
        df = element.describing
        cores = list(_measurable(df))
        if not cores:
            return element
        scale = max(form.scale(numbers) for form in element.forms)
        errors = [(measured_error(core, numbers, scale), len(core.arguments)) for core in cores]
        error = max(error for error, _ in errors)
        if any(error > REFUSED and count == max(GRID) for error, count in errors):
            raise LinearisationError(
                f"{where}: no accurate expectation of `{df.body}` was found ({error:.0e} is left): split it, as a sum of "
                "products of functions of one or two linear forms each, or give a part of it a state of its own (a fast "
                "first-order filter)"
            )
        if error > WARNED:
            text = (
                f"{where}: the expectation of `{df.body}` and its gains are accurate to {error:.0e} only, at standard "
                f"deviations of its arguments up to {scale * WIDEST:g}: it switches or oscillates across several; write it as "
                "a sum of products of functions of one linear form each, or see with cs.check where it is worst"
            )
            warn(ExpectationWarning(text, where, error))
        return replace(element, describing=_with_error(df, error))

    return with_elements(equations, with_error)


def _measurable(df: DescribingFunction) -> Iterator[DescribingFunction]:
    """What holds such integrals: the function, or those that its terms are reduced to."""
    if any(isinstance(product, Nested) for product in df.products):
        yield df
        return
    for product in df.products:
        if isinstance(product, Reduced):
            yield from _measurable(product.core)


def _with_error(df: DescribingFunction, error: float) -> DescribingFunction:
    def changed(part: Part) -> Part:
        if isinstance(part, Reduced):
            return replace(part, core=_with_error(part.core, error))
        return replace(part, error=error) if isinstance(part, Nested) else part

    return replace(df, products=tuple(map(changed, df.products)))


def numbers_at_start(equations: MomentEquations) -> dict[sp.Symbol, float]:
    """The numbers of the parameters; t = s = 0 and speed 1 where a function depends on them."""
    values = equations.quasi_linear.system.model.parameter_values()
    return {**{symbol(name): float(value) for name, value in values.items()}, TIME: 0.0, DISTANCE: 0.0, SPEED: 1.0}


def measured_error(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], scale: float = 1.0) -> float:
    """The largest error found of E[f], relative to E|f|, and of the gains, relative to that over the standard deviation.

    Multiplied by `SAFETY`; where the reference itself is not sure, no less than what such rules leave.
    """
    count = len(df.arguments)
    free = tuple(sorted((s for s in df.body.free_symbols - set(df.arguments) if isinstance(s, sp.Symbol)), key=str))
    if count not in GRID or not set(free) <= numbers.keys():
        return df.error
    function, known = element_function(df, free), {s: numbers[s] for s in free}
    errors = [0.0]
    for spread, rho in GRID[count]:
        stds = spread * scale * np.array(RATIOS[:count])
        mean = stds * MEANS[:count]
        covariance = rho ** np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * np.outer(stds, stds)
        truth = Truth.of(df, known, mean, covariance, TOLERANCE[count], MOST[count])
        F, gain = (np.array(x).ravel() for x in function(mean, covariance[np.tril_indices(count)], list(known.values())))
        for found, wanted, unit, own in truth.rows(F, gain):
            errors.append(SAFETY * max(abs(found - wanted) / unit - own, 0.0))
            errors.append(min(own, df.error) if own > WARNED else 0.0)
        if np.max(truth.errors) > UNSURE:  # nor will it be at larger ones
            break
    return float(np.max(errors)) if np.all(np.isfinite(errors)) else np.inf
