"""Write functions that overflow, or jump where it does not show, as what they are in pieces."""

from __future__ import annotations

from collections.abc import Iterator

import sympy as sp

from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.pieces import affine


def tamed(body: sp.Expr, arguments: tuple[sp.Symbol, ...]) -> sp.Expr:
    """Logistic functions by tanh, log(b + c e^a) by what grows and what is left, angles cut where they jump."""

    def moving(expr: sp.Basic) -> int:
        return sum(expr.has(z) for z in arguments)

    body = body.replace(lambda e: isinstance(e, sp.Mul), _turned).replace(_is_logistic, _by_tanh)
    body = body.replace(lambda e: _is_soft_ramp(e) and moving(e) == 1, _by_ramp)
    body = body.replace(lambda e: isinstance(e, sp.atan2) and moving(e.args[1]) > 0, _by_half)
    return body.replace(lambda e: isinstance(e, sp.atan) and moving(_quotient(e)[1]) > 0, _by_quotient)


def growing(value: sp.Expr, cell: Cell, z: sp.Symbol) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    """Terms exp(rate z) x rest, as (rate, rest), where such a factor moves what is to be seen beyond reach of the mean.

    On the whole line it does either way, on half of it where it grows; if the rest has exponentials of its own it may not.
    """
    found: dict[sp.Expr, sp.Expr] = {}
    whole = value.replace(lambda e: isinstance(e, sp.sinh | sp.cosh) and e.has(z), lambda e: e.rewrite(sp.exp))
    for term in sp.Add.make_args(sp.expand(whole, deep=False, power_base=False, log=False)):
        powers = [f for f in sp.Mul.make_args(term) if isinstance(f, sp.exp) and affine(f.args[0], z) is not None]
        rest = sp.Mul(*(f for f in sp.Mul.make_args(term) if f not in powers))
        slope, offset = affine(sp.Add(*(f.args[0] for f in powers)), z) or (sp.S.Zero, sp.S.Zero)
        seen = not (cell.lowers and cell.uppers) and not (cell.lowers and not slope.is_positive)
        seen = seen and not (cell.uppers and not slope.is_negative)
        if not powers or not seen or any(f.has(z) for f in rest.atoms(sp.exp, sp.sinh, sp.cosh)):
            slope, rest = sp.S.Zero, term
        else:
            rest = rest * sp.exp(offset)
        found[slope] = found.get(slope, sp.S.Zero) + rest
    if set(found) == {sp.S.Zero}:
        yield sp.S.Zero, value
    else:
        yield from found.items()


def _turned(product: sp.Mul) -> sp.Expr:
    """e^a/(b + c e^a) as 1/(c + b e^-a): of the difference that is left of the one nothing is left times e^a."""
    for factor in product.args:
        if _is_logistic(factor) and factor.exp == -1:
            constant, rest = factor.base.as_coeff_Add()
            scale, power = rest.as_coeff_Mul()
            if power in product.args:
                others = sp.Mul(*(f for f in product.args if f not in (factor, power)))
                return others / (scale + constant * sp.exp(-power.args[0]))
    return product


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


def _by_half(angle: sp.Expr) -> sp.Expr:
    """atan2(y, x) = 2 atan(y/(x + r)) where x > 0, r^2 = x^2 + y^2; where it is not, what does not cancel."""
    y, x = angle.args
    r = sp.sqrt(x**2 + y**2)
    return sp.Piecewise((2 * sp.atan(y / (x + r)), x > 0), (2 * sp.atan(y / (x - r)) + sp.pi * sp.sign(y), sp.true))


def _quotient(angle: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    return sp.fraction(sp.together(angle.args[0]))


def _by_quotient(angle: sp.Expr) -> sp.Expr:
    """atan(p/q) in two pieces that have values where q = 0: by half the angle, as above."""
    p, q = _quotient(angle)
    if q.is_positive or not (p.is_polynomial() and q.is_polynomial()):
        return angle
    r = sp.sqrt(p**2 + q**2)
    return sp.Piecewise((2 * sp.atan(p / (q + r)), q > 0), (2 * sp.atan(p / (q - r)), sp.true))
