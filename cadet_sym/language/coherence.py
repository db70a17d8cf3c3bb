"""Two tracks on one ground: what their heights share, as a common and a difference filter.

Left and right heights of equal spectrum G and real coherence gamma (the cross spectrum over G) are

    u_left = c + d,    u_right = c - d,    G_c = G (1 + gamma)/2,    G_d = G (1 - gamma)/2,

with c and d independent. For a rational gamma both factors are rational, and each is realised by a filter that colours
the white noise of the ground's own filter: w = H(d/ds) w_0, |H(i kappa)|^2 = (1 +- gamma)/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.names import exact
from cadet_sym.language.shaping import ShapingFilter
from cadet_sym.language.spectrum import dip, even, left_roots

__all__ = ["ISOTROPIC_ERROR", "Coherence", "coloured"]

_ISOTROPIC = (0.99518896, 1.93307788, 0.34596911, 0.05360714)
ISOTROPIC_ERROR = 0.01
"""Largest error of the rational stand-in for x K_1(x), the coherence of isotropic ground of waviness 2 (x = kappa W).

(1 + n1 x^2) / (1 + d1 x^2 + d2 x^4 + d3 x^6), least squares over 0 < x < 12.
"""


@dataclass(frozen=True)
class Coherence:
    """Coherence of two tracks, a rational function of wavenumber.

    Parameters
    ----------
    tracks : names of the two tracks.
    numerator, denominator : coefficients of kappa^0, kappa^1, ... (rad per length); the odd ones are zero.
    """

    tracks: tuple[str, str]
    numerator: tuple[sp.Expr, ...]
    denominator: tuple[sp.Expr, ...]

    def __post_init__(self) -> None:
        where = {"table": "ground.coherence", "key": "tracks"}
        if len(self.tracks) != 2 or len(set(self.tracks)) != 2:
            raise ModelError("the names of two different tracks are wanted", **where)
        poles = np.roots(self.factors()[0][1][::-1])
        if (real := poles[(poles.imag == 0) & (poles.real >= 0)].real).size:
            raise ModelError(
                f"a coherence is finite, and the denominator of this one is 0 at the wavenumber {np.sqrt(real.min()):.4g}",
                table="ground.coherence",
                key="denominator",
            )
        for sign, (numerator, denominator) in zip((-1, 1), self.factors(), strict=True):
            if numerator.any() and (found := dip(numerator, strictly=False)) is not None:
                kappa, value = found  # of D (1 - sign gamma) / 2
                gamma = sign * (1 - 2 * value / np.polynomial.Polynomial(denominator)(kappa**2))
                raise ModelError(
                    f"a coherence lies between -1 and 1, and this one is {gamma:.4g} at the wavenumber {kappa:.4g}",
                    table="ground.coherence",
                    key="numerator",
                )

    @classmethod
    def isotropic(cls, tracks: Sequence[str], width: Any) -> Coherence:
        """Two tracks at a distance `width` on isotropic ground of waviness 2: gamma = x K_1(x), x = kappa width.

        A rational function stands for it, at most 0.01 off (`ISOTROPIC_ERROR`). Source: the cross spectrum of parallel
        tracks on isotropic ground, Dodds & Robson, J. Sound Vib. 31(2), 1973.
        """
        W = float(width)
        if not (np.isfinite(W) and W > 0):
            raise ModelError(f"a positive width is wanted, not {width}", table="ground.coherence", key="width")
        n1, *d = _ISOTROPIC
        numerator = (1.0, 0.0, n1 * W**2)
        denominator = (1.0, 0.0, d[0] * W**2, 0.0, d[1] * W**4, 0.0, d[2] * W**6)
        return cls((tracks[0], tracks[1]), tuple(map(exact, numerator)), tuple(map(exact, denominator)))

    def factors(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Numerator and denominator, in kappa^2, of (1 + gamma)/2 and of (1 - gamma)/2."""
        top, D = [float(c) for c in self.numerator], even([float(c) for c in self.denominator], "coherence")
        N = even(top, "coherence") if any(top) else np.zeros(1)
        size = max(len(N), len(D))
        N, D = (np.pad(part, (0, size - len(part))) for part in (N, D))
        return [(np.trim_zeros((D + sign * N) / 2, "b"), D) for sign in (1, -1)]

    def parts(self, road: ShapingFilter) -> tuple[tuple[str, ShapingFilter], tuple[str, ShapingFilter]]:
        """The common and the difference filter, each with the name of its virtual track."""
        pair = "+".join(self.tracks)
        common, difference = (coloured(road, *factor) for factor in self.factors())
        flat = replace(difference, offset=sp.ImmutableMatrix(sp.zeros(len(difference.states), 1)), profile=sp.S.Zero)
        return (pair, _prefixed(common, "common")), (f"{pair} difference", _prefixed(flat, "difference"))


def coloured(road: ShapingFilter, numerator: np.ndarray, denominator: np.ndarray) -> ShapingFilter:
    """The road driven by w = H w_0, |H(i kappa)|^2 = N(kappa^2)/D(kappa^2) of degrees deg N <= deg D.

    H = h + b(p)/a(p) in controllable form: g' = companion(a) g + e w_0, w = b g + h w_0; one copy for each noise.
    """
    if not numerator.any():
        return replace(road, D=sp.ImmutableMatrix(sp.zeros(*road.D.shape)))
    zeros, poles = left_roots(numerator), left_roots(denominator)
    lead = np.sqrt(abs(numerator[-1] / denominator[-1]))
    b, a = (np.atleast_1d(np.real(np.poly(roots))) for roots in (zeros, poles))
    b = lead * np.pad(b, (len(a) - len(b), 0))
    through, rest = b[0], (b - b[0] * a)[1:]
    order, r, m = len(a) - 1, len(road.states), road.D.cols
    C, D = sp.zeros(r + m * order), sp.zeros(r + m * order, m)
    C[:r, :r], D[:r, :] = road.C, exact(float(through)) * road.D
    names = list(road.states)
    for j in range(m):
        first = r + j * order
        for k in range(order):
            C[:r, first + k] = exact(float(rest[order - 1 - k])) * road.D[:, j]
            C[first + order - 1, first + k] = -exact(float(a[order - k]))
            if k + 1 < order:
                C[first + k, first + k + 1] = 1
            names.append(f"colour{k + 1}" if m == 1 else f"colour{j + 1}{k + 1}")
        if order:
            D[first + order - 1, j] = 1
    matrix = sp.ImmutableMatrix
    F = sp.zeros(1, r + m * order)
    F[0, :r] = road.F
    offset = sp.Matrix.vstack(sp.Matrix(road.offset), sp.zeros(m * order, 1))
    return ShapingFilter(tuple(names), matrix(C), matrix(D), road.Q, matrix(F), matrix(offset), road.profile)


def _prefixed(road: ShapingFilter, prefix: str) -> ShapingFilter:
    return replace(road, states=tuple(f"{prefix}_{name}" for name in road.states))
