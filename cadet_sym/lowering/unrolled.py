"""Moment equations for where no function is called: an expectation that finds its order when it is called gets one for good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import sympy as sp

from cadet_sym.expectation.planar import Planar
from cadet_sym.expectation.smooth import with_counts
from cadet_sym.language.expression import symbol
from cadet_sym.linearisation import Nonlinearity, OutputForm
from cadet_sym.moments import MomentEquations

__all__ = ["unrolled"]

COUNTS = (40, 24)
"""Nodes on the outer and the inner line: enough for moments of the order of the functions' own scales."""


def unrolled(equations: MomentEquations) -> MomentEquations:
    """The same equations with fixed numbers of nodes; themselves if all are fixed already."""
    quasi = equations.quasi_linear
    numbers = {symbol(name): float(value) for name, value in quasi.system.model.parameter_values().items()}
    elements = tuple(_element(element, numbers) for element in quasi.elements)
    outputs = {name: _output(form, numbers) for name, form in quasi.outputs.items()}
    if all(a is b for a, b in zip(elements, quasi.elements, strict=True)) and outputs == dict(quasi.outputs):
        return equations
    return replace(equations, quasi_linear=replace(quasi, elements=elements, outputs=outputs))


def _element(element: Nonlinearity, numbers: Mapping[sp.Symbol, float]) -> Nonlinearity:
    df = element.describing
    if not any(isinstance(product, Planar) for product in df.products):
        return element
    products = tuple(with_counts(p, COUNTS, numbers) if isinstance(p, Planar) else p for p in df.products)
    return replace(element, describing=replace(df, products=products))


def _output(form: OutputForm, numbers: Mapping[sp.Symbol, float]) -> OutputForm:
    return replace(
        form,
        elements=tuple(_element(element, numbers) for element in form.elements),
        products={key: _output(product, numbers) for key, product in form.products.items()},
    )
