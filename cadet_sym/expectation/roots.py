"""Zeros of many functions at once, each of one variable and between two points.

T. R. Chandrupatla, "A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without using
derivatives", Advances in Engineering Software 28, 145-149, 1997.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def roots(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray],
    ends: tuple[np.ndarray, np.ndarray],
    values: tuple[np.ndarray, np.ndarray],
    fineness: float,
) -> np.ndarray:
    """Where functions change their signs, each between two ends at which it has these values.

    By inverse quadratic interpolation, and bisection where that is unsafe: at jumps and poles too.

    Parameters
    ----------
    function : numbers of some of the functions, a point for each -> their values.
    ends, values : at the two sides, (functions,) each.
    fineness : to which they are found, relative to the distance of the ends.
    """
    a: np.ndarray  # the newest point, on the other side of b
    b: np.ndarray
    c: np.ndarray
    fa: np.ndarray
    fb: np.ndarray
    fc: np.ndarray
    t: np.ndarray
    least: np.ndarray
    some: np.ndarray
    (b, a), (fb, fa) = ends, values
    c, fc, t = b, fb, np.full(len(a), 0.5)
    least = np.maximum(fineness * np.abs(b - a), 4 * np.spacing(np.maximum(np.abs(a), np.abs(b))))
    found, some = (a + b) / 2, np.arange(len(a))
    while len(some):
        x = a + t * (b - a)
        fx = function(some, x)
        same = (fx >= 0) == (fa >= 0)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        with np.errstate(all="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            share = least / np.abs(b - a)
            t = np.where((phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi) & np.isfinite(t), t, 0.5)
            t = np.clip(t, share, 1 - share)
        found[some] = (a + b) / 2
        left = share < 0.5
        some, a, b, c, fa, fb, fc, t, least = (each[left] for each in (some, a, b, c, fa, fb, fc, t, least))
    return found
