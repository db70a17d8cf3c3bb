"""The describing function of a nonlinearity for Gaussian input: which rule gives it, and what it is made of."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from cadet_sym.errors import ExpectationWarning, LinearisationError
from cadet_sym.expectation.conditional import Part, products
from cadet_sym.expectation.existence import gap, may_have_gaps
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.tame import tamed
from cadet_sym.language.canonical import canonical
from cadet_sym.language.element import harvest, written_out
from cadet_sym.language.vocabulary import symbol


@dataclass(frozen=True)
class DescribingFunction:
    """F(m, S) = E[f(z)], z ~ N(m, S), and how it is obtained; the equivalent gain is dF/dm.

    f is the sum of `products`. Symbols of `body` other than the arguments are parameters or the time: F depends on them
    too.
    """

    name: str = field(compare=False)  # those that differ in it alone are made once
    arguments: tuple[sp.Symbol, ...]
    body: sp.Expr
    means: tuple[sp.Symbol, ...]
    covariances: tuple[sp.Symbol, ...]  # lower triangle row by row: S11; S21, S22; ...
    products: tuple[Part, ...]

    def formula(self) -> sp.Expr | None:
        """E[f] written out in `means` and `covariances`, for reading; None if that would be too long."""
        from cadet_sym.expectation.formula import expectation_formula

        return expectation_formula(self)

    @property
    def method(self) -> str:
        """How the expectation is obtained: "closed form" or "quadrature"."""
        return "quadrature" if self.nodes else "closed form"

    @property
    def nodes(self) -> int:
        """Points at which the function is evaluated, 0 for a closed form."""
        return sum(product.nodes for product in self.products)

    @property
    def error(self) -> float:
        """Estimated relative error of a quadrature; 0 for a closed form."""
        return max((product.error for product in self.products), default=0.0)


def describing_function(
    arguments: sp.Symbol | Sequence[sp.Symbol],
    body: Any,
    *,
    name: str = "",
    values: Mapping[Any, float] | None = None,
    scale: float = 1.0,
) -> DescribingFunction:
    """Turn a nonlinearity into its random-input describing function F(m, S) = E[f(z)], z ~ N(m, S).

    Parameters
    ----------
    arguments : the Gaussian arguments of f, or the only one.
    body : f, an expression in its arguments, parameters, the time and elements.
    name : what to call it in messages.
    values : numbers of the parameters, if known: a quadrature chooses its order and estimates its error there.
    scale : a typical size of the arguments over ten: how far a quadrature is looked at.

    Raises
    ------
    ModelError
        If it is not an expression of the language of models.
    LinearisationError
        If no expectation exists, or there is no rule for it.
    """
    given = (arguments,) if isinstance(arguments, sp.Symbol) else arguments
    own = tuple(symbol(str(argument)) for argument in given)
    numbers = {symbol(str(parameter)): float(value) for parameter, value in (values or {}).items()}
    settled = written_out(canonical(body), harvest([body]))
    return described(own, settled, name, f"the element `{name}`" if name else f"`{settled}`", numbers, scale)


def described(
    arguments: tuple[sp.Symbol, ...], body: sp.Expr, name: str, where: str, numbers: Mapping[sp.Symbol, float], scale: float
) -> DescribingFunction:
    """The same of what is in the language of models already; `where` is what messages call it. See `describing_function`."""
    place = None
    if numbers and body.free_symbols - set(arguments) <= numbers.keys() and may_have_gaps(body):
        place = gap(arguments, body, numbers, scale)
    with warnings.catch_warnings():
        if place is not None:  # what follows may know the reason; how accurate it would be is of no interest
            warnings.simplefilter("ignore", ExpectationWarning)
        found = describe(arguments, body, where, Wish(numbers, scale=scale), name)
    if place is not None:
        at = " and ".join(f"`{z}` is {value:.3g}" for z, value in zip(arguments, place, strict=True))
        raise LinearisationError(
            f"{where} has no Gaussian expectation: with the numbers of its parameters `{body}` is infinite or not a real "
            f"number, for example where {at}; clip what is in its roots, logarithms and powers (max, min, clip, or a stop in a "
            "conditional), or change the parameters"
        )
    return found


def describe(arguments: tuple[sp.Symbol, ...], body: sp.Expr, where: str, wish: Wish, name: str = "") -> DescribingFunction:
    """Make the describing function; `where` is what messages call it."""
    count = len(arguments)
    return DescribingFunction(
        name=name,
        arguments=arguments,
        body=body,
        means=tuple(sp.Symbol(f"m{i + 1}", real=True) for i in range(count)),
        covariances=tuple(sp.Symbol(f"S{i + 1}{j + 1}", real=True) for i in range(count) for j in range(i + 1)),
        products=products(arguments, tamed(body, arguments), where, wish),
    )
