"""White noise of the ground in a vehicle's rate, written as the increments of what the ground does.

Let y(s) be the highest derivative of the height along the ground that has a finite variance: y = rho xi with
rho D = 0 for all before it, so that dy = (rho' + rho C) xi ds + rho o ds + rho D dW. A rate that asks for one
derivative more holds

    kappa V (rho' + rho C) xi + kappa V rho o   in its drift,      kappa rho D   in its noise input,

which together are kappa dy. Drift and noise nearly cancel when the ground's own modes pass quickly, and a step that
adds them up separately leaves a false white noise behind; the increment of y is known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from cadet_sym.augment import AugmentedSystem, FilterCopy
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, SPEED

__all__ = ["Kick", "separate_kicks"]


@dataclass(frozen=True)
class Kick:
    """A rate of the vehicle that holds kappa dy, y one of `heights`."""

    state: int
    height: int
    kappa: sp.Expr  # in time, distance, speed and parameters


def separate_kicks(system: AugmentedSystem) -> tuple[tuple[sp.Expr, ...], tuple[sp.Expr, ...], tuple[Kick, ...]]:
    """Split the vehicle's drift and noise into a drift without the ground's white noise, and kicks.

    Returns
    -------
    drift : (nv,) with kappa V (rho' + rho C) xi and kappa V rho o taken out.
    heights : y of every copy that kicks, in the filter states.
    kicks : which rate is kicked by which height.
    """
    nv = system.vehicle_size
    drift, heights, kicks = list(system.drift[:nv]), [], []
    for copy in system.copies:
        rows = [i for i in range(nv) if any(system.noise_input[i, j] != 0 for j in copy.columns)]
        if not rows:
            continue
        xi = sp.Matrix(system.states[copy.states])
        rho, noise = _last_smooth(copy)
        slope = rho.diff(DISTANCE) + rho * copy.filter.C
        along = _at_wheel((slope * xi)[0] + (rho * copy.filter.offset)[0], copy)
        for i in rows:
            kappa = _common_factor(system, i, copy, noise)
            drift[i] = _less(drift[i], kappa * SPEED * along, tuple(xi))
            kicks.append(Kick(i, len(heights), kappa))
        heights.append(_at_wheel((rho * xi)[0], copy))
    return tuple(drift), tuple(heights), tuple(kicks)


def _last_smooth(copy: FilterCopy) -> tuple[sp.Matrix, sp.Matrix]:
    """rho of the last derivative without white noise, and rho D, the noise in the next."""
    rho = sp.Matrix(copy.filter.F)
    for _ in range(len(copy.filter.states)):
        noise = (rho * copy.filter.D).applyfunc(sp.expand)
        if not noise.is_zero_matrix:
            return rho, noise.applyfunc(lambda e: _at_wheel(e, copy))
        rho = (rho.diff(DISTANCE) + rho * copy.filter.C).applyfunc(sp.expand)
    raise ModelError(f"the ground under `{copy.contact}` holds no noise; nothing can kick the vehicle")


def _common_factor(system: AugmentedSystem, row: int, copy: FilterCopy, noise: sp.Matrix) -> sp.Expr:
    """Kappa with noise_input[row, columns] = kappa rho D."""
    places = [k for k in range(noise.cols) if noise[k] != 0]
    kappa = sp.expand(system.noise_input[row, copy.columns[places[0]]] / noise[places[0]])
    for k, column in enumerate(copy.columns):
        if sp.expand(system.noise_input[row, column] - kappa * noise[k]) != 0:
            raise ModelError(
                f"rate of `{system.states[row].name}`: the ground's noises enter it otherwise than through the height "
                f"of `{copy.contact}`; the simulation has no rule for that"
            )
    return kappa


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
