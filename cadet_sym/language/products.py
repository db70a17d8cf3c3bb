"""Products of sums multiplied out."""

from __future__ import annotations

from collections.abc import Callable

import sympy as sp

__all__ = ["multiplied_out"]


def multiplied_out(expr: sp.Expr, expand: Callable[[sp.Expr], sp.Expr]) -> sp.Expr:
    """Expanded above the fraction bar alone: what is below it keeps its factors, by which terms separate.

    SymPy would make 1/((1 + x^2) sqrt(y)) one over x^2 sqrt(y) + sqrt(y).
    """
    terms: list[sp.Expr] = []
    for term in sp.Add.make_args(expr):
        factors = sp.Mul.make_args(term)
        below = [f for f in factors if isinstance(f, sp.Pow) and f.exp.could_extract_minus_sign()]
        above = expand(sp.Mul(*(f for f in factors if f not in below)))
        terms += (sp.Mul(each, *below) for each in sp.Add.make_args(above))
    return sp.Add(*terms)
