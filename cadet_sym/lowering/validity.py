"""Look again at quadratures whose order was chosen for other numbers of the parameters than a run has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from cadet_sym.errors import ExpectationWarning
from cadet_sym.expectation import accuracy, homogeneous, smooth, squares, switching
from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.planar import Planar
from cadet_sym.expectation.polar import Homogeneous
from cadet_sym.expectation.quadratic import QuadraticPower
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.expectation.switched import Switched
from cadet_sym.expectation.univariate import Univariate
from cadet_sym.language.expression import symbol
from cadet_sym.lowering.survey import describing_functions
from cadet_sym.warning import warn

if TYPE_CHECKING:
    from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["Validity"]


class Validity:
    """The range of parameters over which the quadratures of a model were looked at."""

    def __init__(self, functions: MomentFunctions, declared: Mapping[str, float]) -> None:
        self._functions = functions
        self._low = {name: declared[name] for name in functions.facts.integrated}
        self._high = dict(self._low)
        self._lock = Lock()

    def include(self, values: Mapping[str, float]) -> None:
        """Warn if a quadrature is not accurate enough for these numbers; what lies between numbers seen is not looked at."""
        own = {name: float(value) for name, value in values.items() if name in self._low}
        with self._lock:
            self._look_at(own, values)

    def _look_at(self, own: Mapping[str, float], values: Mapping[str, float]) -> None:
        if all(self._low[name] <= value <= self._high[name] for name, value in own.items()):
            return
        for name, value in own.items():
            self._low[name], self._high[name] = min(self._low[name], value), max(self._high[name], value)
        model = self._functions.equations.quasi_linear.system.model.with_parameters(dict(values))
        numbers = {symbol(name): float(value) for name, value in model.parameter_values().items()}
        for df in describing_functions(self._functions.equations):
            error = max(_errors(df, numbers), default=0.0)
            if error > max(accuracy.WARNED, 2 * df.error):
                listed = ", ".join(f"{name} = {value:g}" for name, value in own.items())
                text = (
                    f"the element `{df.name}`: with {listed} its quadrature is accurate to {error:.0e} only, for its order was "
                    "chosen for the declared numbers; compile the model with these (`model.with_parameters`, `--set`)"
                )
                warn(ExpectationWarning(text))


def _errors(df: DescribingFunction, numbers: Mapping[sp.Symbol, float]) -> Iterator[float]:
    for product in df.products:
        if isinstance(product, Planar):
            yield smooth.error_of(product, numbers)
        elif isinstance(product, Homogeneous):
            yield homogeneous.error_of(product, numbers)
        elif isinstance(product, QuadraticPower):
            yield squares.error_of(product, numbers)
            yield from _of_integrals(product.factor, numbers) if product.factor is not None else ()
        elif isinstance(product, Switched):
            yield switching.error_of(product, numbers)
        elif isinstance(product, Reduced):
            yield from _errors(product.core, numbers)
        elif isinstance(product, Product):
            for _, function in product.functions:
                yield from _of_integrals(function, numbers)


def _of_integrals(function: Univariate, numbers: Mapping[sp.Symbol, float]) -> Iterator[float]:
    for part in function.integrals:
        found = accuracy.error_of(part, numbers, 1.0)
        yield found if np.isfinite(found) else np.inf
