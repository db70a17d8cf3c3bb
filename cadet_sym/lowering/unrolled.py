"""Moment equations for where no function is called, as in MATLAB.

An expectation that finds its order when it is called gets one for good, and sums over the rows of measured
curves are written out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import sympy as sp

from cadet_sym.errors import ExportError
from cadet_sym.expectation.conditional import Part, Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.homogeneous import with_one_rule
from cadet_sym.expectation.nested import Nested
from cadet_sym.expectation.planar import Planar
from cadet_sym.expectation.polar import Homogeneous
from cadet_sym.expectation.quadratic import QuadraticPower
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.expectation.smooth import with_counts
from cadet_sym.expectation.squares import with_count
from cadet_sym.expectation.switched import Switched
from cadet_sym.expectation.switching import with_order
from cadet_sym.expectation.waves import Waves
from cadet_sym.language.expression import symbol
from cadet_sym.linearisation import Nonlinearity
from cadet_sym.lowering.survey import with_elements
from cadet_sym.moments import MomentEquations

__all__ = ["in_line", "unrolled"]

MANY_PAIRS = 2000
"""Pairs of kinks of two measured curves that are too many to be written out."""

COUNTS = (40, 24)
"""Nodes on the outer and the inner line: enough for moments of the order of the functions' own scales."""

ORDER = 48
"""Nodes of a stretch of a conic: the same."""


def unrolled(equations: MomentEquations) -> MomentEquations:
    """The same equations with fixed numbers of nodes; themselves if all are fixed already."""
    values = equations.quasi_linear.system.model.parameter_values()
    numbers = {symbol(name): float(value) for name, value in values.items()}
    return with_elements(equations, lambda element, where: _element(element, where, numbers))


def in_line(df: DescribingFunction) -> DescribingFunction:
    """The same with sums over the nodes of one argument and over the rows of single curves as scalar operations.

    Where derivatives are wanted: those of many calls cost twice as much, for they are called again for every direction.
    """

    def changed(part: Part) -> Part:
        if isinstance(part, Nested) and part.has_curves:  # rows times nodes, which are too many
            return part
        if isinstance(part, Nested | Reduced):
            return part.written_with(in_line)
        return part.written_out() if isinstance(part, Product) and not part.pairs else part

    return replace(df, products=tuple(map(changed, df.products)))


def _element(element: Nonlinearity, where: str, numbers: Mapping[sp.Symbol, float]) -> Nonlinearity:
    describing = _function(element.describing, where, numbers)
    return element if describing is element.describing else replace(element, describing=describing)


def _function(df: DescribingFunction, where: str, numbers: Mapping[sp.Symbol, float]) -> DescribingFunction:
    products = tuple(_fixed(product, where, numbers) for product in df.products)
    return df if all(a is b for a, b in zip(products, df.products, strict=True)) else replace(df, products=products)


def _fixed(part: Part, where: str, numbers: Mapping[sp.Symbol, float]) -> Part:
    if isinstance(part, Planar):
        return with_counts(part, COUNTS, numbers)
    if isinstance(part, Homogeneous):
        return with_one_rule(part, numbers)
    if isinstance(part, QuadraticPower):
        return with_count(part)
    if isinstance(part, Nested | Reduced):
        return part.written_with(lambda df: _function(df, where, numbers))
    if isinstance(part, Switched):
        return with_order(part, ORDER, numbers)
    if isinstance(part, Waves):
        return part
    if part.pairs > MANY_PAIRS:
        raise ExportError(
            f"{where}: a product of two measured curves takes {part.pairs} pairs of their rows, too many to write out; "
            "leave it out, or give the curves fewer rows"
        )
    return part.written_out()
