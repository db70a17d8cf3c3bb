"""Write functions that overflow, or jump where it does not show, as what they are in pieces."""

from __future__ import annotations

import sympy as sp


def tamed(body: sp.Expr, arguments: tuple[sp.Symbol, ...]) -> sp.Expr:
    """Logistic functions by tanh, log(b + c e^a) by what grows and what is left, atan2 cut where it jumps."""

    def moving(expr: sp.Basic) -> int:
        return sum(expr.has(z) for z in arguments)

    body = body.replace(_is_logistic, _by_tanh)
    body = body.replace(lambda e: _is_soft_ramp(e) and moving(e) == 1, _by_ramp)
    return body.replace(lambda e: isinstance(e, sp.atan2) and all(map(moving, e.args)), _by_quotient)


def _is_logistic(expr: sp.Expr) -> bool:
    if not (isinstance(expr, sp.Pow) and expr.exp.is_negative and isinstance(expr.base, sp.Add)):
        return False
    constant, rest = expr.base.as_coeff_Add()
    factor, power = rest.as_coeff_Mul()
    return bool(constant > 0 and factor > 0 and isinstance(power, sp.exp))


def _by_tanh(logistic: sp.Expr) -> sp.Expr:
    """1/(b + c e^a) as (1 - tanh((a + log(c/b))/2))/(2 b), whose derivatives do not overflow."""
    constant, rest = logistic.base.as_coeff_Add()
    factor, power = rest.as_coeff_Mul()
    return ((1 - sp.tanh((power.args[0] + sp.log(factor / constant)) / 2)) / (2 * constant)) ** -logistic.exp


def _is_soft_ramp(expr: sp.Expr) -> bool:
    if not (isinstance(expr, sp.log) and isinstance(expr.args[0], sp.Add)):
        return False
    constant, rest = expr.args[0].as_coeff_Add()
    factor, power = rest.as_coeff_Mul()
    return bool(constant > 0 and factor > 0 and isinstance(power, sp.exp))


def _by_ramp(soft: sp.Expr) -> sp.Expr:
    """log(b + c e^a) = log(b) + max(w, 0) + log(1 + e^-|w|), w = a + log(c/b)."""
    constant, rest = soft.args[0].as_coeff_Add()
    factor, power = rest.as_coeff_Mul()
    w = power.args[0] + sp.log(factor / constant)
    return sp.log(constant) + sp.Piecewise((w + sp.log(1 + sp.exp(-w)), w > 0), (sp.log(1 + sp.exp(w)), sp.true))


def _by_quotient(angle: sp.Expr) -> sp.Expr:
    y, x = angle.args
    return sp.Piecewise((sp.atan(y / x), x > 0), (sp.atan(y / x) + sp.pi * sp.sign(y), sp.true))
