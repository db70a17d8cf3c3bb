"""Spectral factorisation: a rational spectrum to the stable filter that makes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cadet_sym.errors import ModelError

_TOUCH = 1e-9  # of its size: how far a numerator may dip below zero by rounding


def spectral_factor(
    numerator: Sequence[float], denominator: Sequence[float], sides: int = 1
) -> tuple[list[float], list[float]]:
    """H(p) = b(p) / a(p), stable, with |H(i kappa)|^2 = pi G(kappa), for noise of unit intensity.

    Parameters
    ----------
    numerator, denominator : coefficients of kappa^0, kappa^1, ... (rad per length); the odd ones are zero.
    sides : 1: G is one-sided, variance = integral over kappa > 0; 2: over all kappa (then |H|^2 = 2 pi G).

    Returns
    -------
    b, a : coefficients of p^0, p^1, ...; a without its leading 1.

    Raises
    ------
    ModelError : a spectrum that is odd, negative somewhere, infinite at a wavenumber other than 0, or not proper.
    """
    N, D = even(numerator, "numerator"), even(denominator, "denominator")
    if N[-1] < 0 and D[-1] < 0:
        N, D = -N, -D
    if len(N) >= len(D):
        raise ModelError(
            "the spectrum is not proper: its denominator must be of a higher degree than its numerator, "
            f"by 2 or more, and the degrees are {2 * (len(D) - 1)} and {2 * (len(N) - 1)}",
            table="ground",
            key="denominator",
        )
    not_negative(N, "numerator", strictly=False)
    not_negative(D, "denominator", strictly=True)
    zeros, poles = left_roots(N), left_roots(D)
    gain = np.sqrt(np.pi * sides * N[-1] / D[-1])
    b, a = (np.atleast_1d(np.real(np.poly(roots))) for roots in (zeros, poles))
    b = b * gain
    return [float(c) for c in b[::-1]], [float(c) for c in a[:0:-1]]


def even(coefficients: Sequence[float], key: str) -> np.ndarray:
    """Coefficients in kappa^2, without leading zeros."""
    given = np.asarray(coefficients, float)
    where = {"table": "ground", "key": key}
    if given.ndim != 1 or given.size == 0 or not np.isfinite(given).all() or not given.any():
        raise ModelError("a list of finite numbers, not all zero, is wanted", **where)
    if given[1::2].any():
        power = 1 + 2 * int(np.flatnonzero(given[1::2])[0])
        raise ModelError(
            f"a spectrum is even: the coefficient of kappa^{power} must be 0, and it is {given[power]:g}", **where
        )
    return np.trim_zeros(given[::2], "b")


def not_negative(c: np.ndarray, key: str, *, strictly: bool) -> None:
    """Refuse a polynomial in x = kappa^2 that is negative for some x >= 0 (or zero for some x > 0)."""
    if (found := dip(c, strictly=strictly)) is not None:
        kappa, value = found
        what = "infinite" if strictly and abs(value) <= _TOUCH * np.abs(c).max() else "negative"
        raise ModelError(
            f"the spectrum is {what} at the wavenumber {kappa:.4g}: the {key} is {value:.4g} there", table="ground", key=key
        )


def dip(c: np.ndarray, *, strictly: bool) -> tuple[float, float] | None:
    """Where a polynomial in x = kappa^2, x >= 0, is negative (or, strictly, zero but at 0): kappa and its value there."""
    polynomial, size = np.polynomial.Polynomial(c), np.polynomial.Polynomial(np.abs(c))
    slopes = polynomial.deriv().roots() if len(c) > 1 else np.array([])
    places = [0.0, *(x.real for x in slopes if abs(x.imag) < 1e-7 * max(1.0, abs(x)) and x.real > 0)]
    if c[-1] < 0 and len(c) > 1:
        places.append(2 * max(1.0, *(abs(x) for x in polynomial.roots())))  # beyond its last root
    for x in places:
        value, scale = float(polynomial(x)), float(size(x))
        if value < -_TOUCH * scale or (strictly and x > 0 and abs(value) <= _TOUCH * scale):
            return float(np.sqrt(x)), value
    return None


def left_roots(c: np.ndarray) -> np.ndarray:
    """Roots p, Re p <= 0, of the polynomial in x = kappa^2 = -p^2; one of each pair +-p."""
    x: Any = np.polynomial.Polynomial(c).roots().astype(complex)
    positive = np.sort(x[(np.abs(x.imag) < 1e-7 * np.abs(x)) & (x.real > 0)].real)
    others = x[~((np.abs(x.imag) < 1e-7 * np.abs(x)) & (x.real > 0))]
    p: Any = np.sqrt(-others)
    p = np.where(p.real > 0, -p, p)
    # a numerator that touches zero has positive roots in equal pairs: +i kappa and -i kappa
    touching = 1j * np.sqrt(positive) * np.resize([1, -1], positive.size)
    return np.concatenate([p, touching])
