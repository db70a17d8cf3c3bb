"""Moment equations for where no function is called.

An expectation that finds its order when it is called gets one for good, and sums over the rows of measured
curves are written out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import sympy as sp

from cadet_sym.errors import ExportError
from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.nested import Nested
from cadet_sym.expectation.planar import Planar
from cadet_sym.expectation.smooth import with_counts
from cadet_sym.language.expression import symbol
from cadet_sym.linearisation import Nonlinearity, OutputForm
from cadet_sym.moments import MomentEquations

__all__ = ["unrolled"]

MANY_PAIRS = 2000
"""Pairs of kinks of two measured curves that are too many to be written out."""

COUNTS = (40, 24)
"""Nodes on the outer and the inner line: enough for moments of the order of the functions' own scales."""


def unrolled(equations: MomentEquations) -> MomentEquations:
    """The same equations with fixed numbers of nodes; themselves if all are fixed already."""
    quasi = equations.quasi_linear
    numbers = {symbol(name): float(value) for name, value in quasi.system.model.parameter_values().items()}
    elements = tuple(_element(element, element.describing.name, numbers) for element in quasi.elements)
    outputs = {name: _output(form, f"output `{name}`", numbers) for name, form in quasi.outputs.items()}
    if all(a is b for a, b in zip(elements, quasi.elements, strict=True)) and outputs == dict(quasi.outputs):
        return equations
    return replace(equations, quasi_linear=replace(quasi, elements=elements, outputs=outputs))


def _element(element: Nonlinearity, where: str, numbers: Mapping[sp.Symbol, float]) -> Nonlinearity:
    df = element.describing
    products = tuple(_fixed(product, where, numbers) for product in df.products)
    if all(a is b for a, b in zip(products, df.products, strict=True)):
        return element
    return replace(element, describing=replace(df, products=products))


def _fixed(part: Product | Nested | Planar, where: str, numbers: Mapping[sp.Symbol, float]) -> Product | Nested | Planar:
    if isinstance(part, Planar):
        return with_counts(part, COUNTS, numbers)
    if not isinstance(part, Product) or not part.pairs:
        return part
    if part.pairs > MANY_PAIRS:
        raise ExportError(
            f"{where}: a product of two measured curves takes {part.pairs} pairs of their rows, too many to write out; "
            "leave it out, or give the curves fewer rows"
        )
    return replace(part, written_out=True)


def _output(form: OutputForm, where: str, numbers: Mapping[sp.Symbol, float]) -> OutputForm:
    return replace(
        form,
        elements=tuple(_element(element, where, numbers) for element in form.elements),
        products={key: _output(product, where, numbers) for key, product in form.products.items()},
    )
