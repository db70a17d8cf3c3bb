"""Roads of a waviness other than 2: (p + c)^(-w/2) by a cascade of real poles and zeros, fitted, with its error."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.names import exact

UPPER = 2 * np.pi * 10.0  # rad per metre: waves of 0.1 m, shorter than any contact feels
_POINTS = 240


@dataclass(frozen=True)
class FittedPower:
    """gain prod (p + z) / prod (p + q), and how far its squared gain is off the power law at worst."""

    zeros: tuple[sp.Expr, ...]
    poles: tuple[sp.Expr, ...]
    gain: sp.Expr
    error: float  # relative, of the density, between the cut-off and `UPPER`


@lru_cache(maxsize=64)
def fitted_power(waviness: float, cutoff: float, order: int) -> FittedPower:
    """Fit by least squares in the logarithm of the density, starting from interlaced poles and zeros.

    Raises
    ------
    ModelError : a waviness for which there is no filter of finite variance and one more pole than zeros.
    """
    where = {"table": "ground", "key": "waviness"}
    if not 1 < waviness < 3.9:
        raise ModelError(f"a waviness between 1 and 3.9 is wanted, not {waviness:g}", **where)
    if not 0 < cutoff < UPPER / 10:
        raise ModelError(
            f"a waviness other than 2 needs a `cutoff`, where the spectrum levels off, below {UPPER / 10:.3g} rad/m",
            **where,
        )
    if not 2 <= order <= 12:
        raise ModelError(f"a filter of order 2 to 12 is wanted, not {order}", table="ground", key="order")
    from scipy.optimize import least_squares

    kappa = np.geomspace(cutoff / 10, UPPER, _POINTS)
    target = -waviness / 2 * np.log(kappa**2 + cutoff**2)

    def log_density(theta: np.ndarray) -> np.ndarray:
        q, z = np.exp(theta[:order]), np.exp(theta[order:-1])
        poles = np.log(kappa[:, None] ** 2 + q**2).sum(axis=1)
        return np.log(kappa[:, None] ** 2 + z**2).sum(axis=1) - poles + theta[-1]

    start = _interlaced(waviness, cutoff, order)
    start[-1] = np.mean(target - log_density(start))
    theta = least_squares(lambda v: log_density(v) - target, start, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    band = kappa >= cutoff
    error = float(np.max(np.abs(np.expm1(log_density(theta) - target)[band])))
    poles, zeros = np.sort(np.exp(theta[:order])), np.sort(np.exp(theta[order:-1]))
    return FittedPower(tuple(map(exact, zeros)), tuple(map(exact, poles)), exact(float(np.exp(theta[-1] / 2))), error)


def _interlaced(waviness: float, cutoff: float, order: int) -> np.ndarray:
    """Logarithms of a pole at the cut-off, then poles and zeros in turn over the band; and of the gain."""
    fraction = waviness / 2 - 1
    centres = np.linspace(np.log(cutoff), np.log(UPPER), 2 * (order - 1) + 1)[1::2]
    half = (np.log(UPPER) - np.log(cutoff)) / (order - 1) / 2
    poles, zeros = centres - fraction * half, centres + fraction * half
    return np.concatenate([[np.log(cutoff)], poles, zeros, [0.0]])
