"""Polynomials times the error function of an affine argument: their expectation on the whole line is known."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.pieces import affine


@dataclass(frozen=True)
class ErrorFunction:
    """sum_n coefficients[n] z^n erf(slope z + offset)."""

    coefficients: tuple[sp.Expr, ...]
    slope: sp.Expr
    offset: sp.Expr


def error_functions_in(value: sp.Expr, cell: Cell, z: sp.Symbol) -> tuple[tuple[ErrorFunction, ...], sp.Expr]:
    """Take the terms polynomial x erf(affine) out of a smooth expression on the whole line."""
    if not value.has(sp.erf) or cell.lowers or cell.uppers or cell.conditions:
        return (), value
    found, rest = [], []
    for term in sp.Add.make_args(sp.expand(value)):
        error = _error_function(term, z)
        if error is None:
            rest.append(term)
        else:
            found.append(error)
    return tuple(found), sp.Add(*rest)


def _error_function(term: sp.Expr, z: sp.Symbol) -> ErrorFunction | None:
    functions = [f for f in sp.Mul.make_args(term) if isinstance(f, sp.erf) and f.has(z)]
    if len(functions) != 1:
        return None
    polynomial = sp.Mul(*(f for f in sp.Mul.make_args(term) if f != functions[0]))
    line = affine(functions[0].args[0], z)
    if line is None or not polynomial.is_polynomial(z):
        return None
    return ErrorFunction(tuple(reversed(sp.Poly(polynomial, z).all_coeffs())), *line)
