"""Several jointly Gaussian arguments: write f as a sum of products that Stein's lemma and conditioning can do."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.quadrature import Sample
from cadet_sym.expectation.univariate import Univariate, univariate


@dataclass(frozen=True)
class Product:
    """coefficient * prod_i z_i^powers[i] * prod f_i(z_i): a monomial times functions of single arguments."""

    coefficient: sp.Expr
    powers: tuple[int, ...]
    functions: tuple[tuple[int, Univariate], ...]  # (index of the argument, function of it)

    @property
    def nodes(self) -> int:
        """Points at which functions are evaluated; 0 in closed form."""
        return sum(function.nodes for _, function in self.functions)

    @property
    def error(self) -> float:
        """Estimated relative error; 0 in closed form."""
        return max((function.error for _, function in self.functions), default=0.0)


def products(arguments: tuple[sp.Symbol, ...], body: sp.Expr, where: str, sample: Sample) -> tuple[Product, ...]:
    """Write a function as a sum of products whose expectation is known."""
    if len(arguments) == 1:
        return (Product(sp.S.One, (0,), ((0, univariate(body, arguments[0], where, sample)),)),)
    raise LinearisationError(f"{where}: {len(arguments)} arguments; split it into terms of fewer")
