"""Expectations without a closed form: Gauss-Legendre on panels between the moving kinks."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

REACH = 8.5  # standard deviations from the mean; 2e-17 of the probability lies beyond
PANELS = (0.0, 0.3, 0.5, 0.7, 1.0)  # of the stretch between two kinks within reach


@dataclass(frozen=True)
class Integral:
    """A smooth expression between two kinks, of which the expectation is taken by quadrature."""

    lower: sp.Expr
    upper: sp.Expr
    value: sp.Expr
    argument: sp.Symbol
    order: int

    @property
    def nodes(self) -> int:
        """Points at which the expression is evaluated."""
        return self.order * (len(PANELS) - 1)

    def derivative(self) -> Integral:
        """The same for the derivative of the expression."""
        return Integral(self.lower, self.upper, sp.diff(self.value, self.argument), self.argument, self.order)


def integral(lower: sp.Expr, upper: sp.Expr, value: sp.Expr, z: sp.Symbol) -> Integral:
    """Choose the panels and the order for one piece."""
    return Integral(lower, upper, value, z, 20)
