"""The describing function of a nonlinearity for Gaussian input: which rule gives it, and what it is made of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.closed_form import (
    Kink,
    PiecewiseForm,
    bounded,
    decompose,
    jumps,
    normal,
    piecewise_form,
)
from cadet_sym.expectation.pieces import split
from cadet_sym.expectation.quadrature import Integral, integral


@dataclass(frozen=True)
class DescribingFunction:
    """F(m, S) = E[f(z)], z ~ N(m, S), and how it is obtained; the equivalent gain is dF/dm.

    `closed` is the part of f of which the expectation is known, `integrals` are the pieces taken by quadrature; f is
    their sum. Symbols of `body` other than the arguments are parameters or the time: F depends on them too.
    """

    name: str
    arguments: tuple[sp.Symbol, ...]
    body: sp.Expr
    means: tuple[sp.Symbol, ...]
    covariances: tuple[sp.Symbol, ...]  # lower triangle row by row: S11; S21, S22; ...
    closed: PiecewiseForm
    integrals: tuple[Integral, ...]
    error: float  # estimated, relative; 0 for a closed form

    @property
    def method(self) -> str:
        """How the expectation is obtained: "closed form" or "quadrature"."""
        return "quadrature" if self.integrals else "closed form"

    @property
    def nodes(self) -> int:
        """Points at which the function is evaluated, 0 for a closed form."""
        return sum(part.nodes for part in self.integrals)


def describing_function(
    arguments: tuple[sp.Symbol, ...], body: sp.Expr, *, name: str = ""
) -> DescribingFunction:
    """Turn a nonlinearity into its random-input describing function F(m, S) = E[f(z)], z ~ N(m, S).

    Parameters
    ----------
    arguments : the Gaussian arguments of f.
    body : f, in its arguments, parameters and the time.
    name : what to call it in messages.

    Raises
    ------
    LinearisationError
        If no expectation exists, or there is no rule for it.
    """
    where = f"element `{name}`" if name else f"`{body}`"
    if len(arguments) != 1:
        raise LinearisationError(f"{where}: {len(arguments)} arguments; split it into terms of fewer")
    (z,) = arguments
    known, integrals, cells = [], [], []
    for lower, upper, value in bounded(split(body, z, where)):
        parts = decompose(value, z)
        if parts is None:
            cells.append((lower, upper, value))
            integrals.append(integral(lower, upper, value, z))
        else:
            known.append((lower, upper, parts))
    return DescribingFunction(
        name=name,
        arguments=arguments,
        body=body,
        means=tuple(sp.Symbol(f"m{i + 1}", real=True) for i in range(len(arguments))),
        covariances=tuple(
            sp.Symbol(f"S{i + 1}{j + 1}", real=True) for i in range(len(arguments)) for j in range(i + 1)
        ),
        closed=_with_jumps(piecewise_form(known), jumps(cells, z)),
        integrals=tuple(integrals),
        error=0.0,
    )


def _with_jumps(form: PiecewiseForm, found: dict[sp.Expr, list[sp.Expr]]) -> PiecewiseForm:
    kinks = []
    for kink in form.kinks:
        more = found.pop(kink.position, [sp.S.Zero] * len(kink.jumps))
        kinks.append(replace(kink, jumps=tuple(normal(a + b) for a, b in zip(kink.jumps, more, strict=True))))
    kinks.extend(Kink(position, (), tuple(sizes)) for position, sizes in found.items())
    return PiecewiseForm(form.segments, tuple(kinks))
