"""Derivatives of the ground height in the vehicle's rates, written as the increments of what the ground does.

Let y(s) = u^(k-1) be a derivative of the height along the ground that has a finite variance, y = rho xi, so that

    dy = (rho' + rho C) xi ds + rho o ds + rho D dW.

A rate that holds c der(u, k) = c V^k u^(k) + ... therefore holds kappa dy with kappa = c V^(k-1): in its drift
kappa V ((rho' + rho C) xi + rho o), in its noise input kappa rho D. Where the ground's own modes pass quickly the drift
is rough, and where white noise enters, drift and noise nearly cancel; a step that adds them up from its two ends leaves
a false noise behind. The increment of y is known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from cadet_sym.augmentation import AugmentedSystem, FilterCopy
from cadet_sym.language.expression import DISTANCE, SPEED, ElementCall, der

__all__ = ["Kick", "Separated", "separate_kicks"]


@dataclass(frozen=True)
class Kick:
    """A rate of the vehicle that holds kappa dy, y one of `heights`."""

    state: int
    height: int
    kappa: sp.Expr  # in time, distance, speed and parameters


@dataclass(frozen=True)
class Separated:
    """The vehicle's drift and noise as a drift without derivatives of the ground, and kicks."""

    drift: tuple[sp.Expr, ...]  # (nv,)
    taken: tuple[sp.Expr, ...]  # (nv,) kappa V ((rho' + rho C) xi + rho o), which was taken out of it
    heights: tuple[sp.Expr, ...]  # all y that kick, in the filter states
    kicks: tuple[Kick, ...]


def separate_kicks(system: AugmentedSystem) -> Separated:
    """Take the derivatives of the ground out of the vehicle's drift."""
    nv = system.vehicle_size
    drift, taken, heights, kicks = list(system.drift[:nv]), [sp.S.Zero] * nv, [], []
    for copy in system.copies:
        xi = sp.Matrix(system.states[copy.states])
        for order, rho in _smooth_derivatives(copy):
            factors = {i: c for i in range(nv) if (c := _factor_of(system, i, copy, order)) != 0}
            slope = rho.diff(DISTANCE) + rho * copy.filter.C
            along = _at_wheel((slope * xi)[0] + (rho * copy.filter.offset)[0], copy)
            for i, factor in factors.items():
                kappa = factor * SPEED ** (order - 1)
                drift[i] = _less(drift[i], kappa * SPEED * along, tuple(xi))
                taken[i] += kappa * SPEED * along
                kicks.append(Kick(i, len(heights), kappa))
            heights += [_at_wheel((rho * xi)[0], copy)] if factors else []
    return Separated(tuple(drift), tuple(taken), tuple(heights), tuple(kicks))


def _smooth_derivatives(copy: FilterCopy) -> list[tuple[int, sp.Matrix]]:
    """Rows rho of u, u', ... as long as their variance is finite, each with the order of the derivative after it."""
    rows = []
    rho = sp.Matrix(copy.filter.F)
    for order in range(1, len(copy.filter.states) + 1):
        rows.append((order, rho))
        if not (rho * copy.filter.D).applyfunc(sp.expand).is_zero_matrix:
            break
        rho = (rho.diff(DISTANCE) + rho * copy.filter.C).applyfunc(sp.expand)
    return rows


def _factor_of(system: AugmentedSystem, row: int, copy: FilterCopy, order: int) -> sp.Expr:
    """What der(u, order) of the copy's own height u is multiplied by in a rate, through all contacts that hold it.

    Only terms count in which the factor depends on time and parameters; white noise enters no other.
    """
    vehicle = system.model.vehicle
    derivative = sp.Dummy()
    heights = {der(contact, order): weight * derivative for contact, weight in copy.contacts.items()}
    rate = vehicle.rates[system.states[row]].xreplace(heights)
    if derivative not in rate.free_symbols:
        return sp.S.Zero
    moving = {derivative, *vehicle.rates, *vehicle.contacts}
    factors = (sp.diff(term, derivative) for term in sp.Add.make_args(sp.expand_mul(rate)))
    return sp.Add(*(f for f in factors if not f.free_symbols & moving and not f.has(ElementCall, sp.Subs, sp.Derivative)))


def _less(rate: sp.Expr, taken: sp.Expr, xi: tuple[sp.Symbol, ...]) -> sp.Expr:
    """The rate less the terms taken out of it, with what is linear in the filter states put together."""
    known = set(xi)
    kept, linear = [], [-taken]
    for term in sp.Add.make_args(rate):
        straight = term.is_polynomial(*xi) and not any(sp.diff(term, x).free_symbols & known for x in xi)
        (linear if straight and term.free_symbols & known else kept).append(term)
    together = sp.expand(sp.Add(*linear))
    gathered = [together.coeff(x) * x for x in xi]
    return sp.Add(*kept, *gathered, together.xreplace(dict.fromkeys(xi, sp.S.Zero)))


def _at_wheel(expression: sp.Expr, copy: FilterCopy) -> sp.Expr:
    return expression.xreplace({DISTANCE: DISTANCE - copy.setback}) if copy.setback != 0 else expression
