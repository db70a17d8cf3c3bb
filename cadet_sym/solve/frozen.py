"""The stationary moment equations with everything but the moments fixed: plain numbers, any source.

    0 = r = A mu + c + b F(theta)
    0 = R = N P + P N^T + D + W(N),         N = A + b K(theta) C

theta holds what the nonlinear elements see: the means C mu + d of their arguments and, element by element, the lower
triangle (row by row) of the arguments' covariance C_j P C_j^T. W is what wheels in one track add: they meet the same
noise one after the other, which at constant speed V gives (Harrison & Hammond's equations with a delay)

    W = V sum_(k>=2) (g_k Q b_k^T + b_k Q g_k^T),    g_1 = 0,    g_k = exp(N (L_k - L_(k-1))/V) (g_(k-1) + b_(k-1)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

__all__ = ["Elements", "Evaluation", "FrozenProblem", "WheelTrack", "evaluate"]

Array = np.ndarray

Elements = Callable[[Array], tuple[Array, Array, Array, Array]]
"""theta (T,) to F (J,), gain (K,), dF/dtheta (J, T), dgain/dtheta (K, T)."""


@dataclass(frozen=True)
class WheelTrack:
    """Wheels in one track at constant speed: what the ground's white noise does under each of them, and when."""

    speed: float  # V > 0
    times: tuple[float, ...]  # from wheel k to wheel k + 1: (L_(k+1) - L_k) / V, one fewer than wheels
    inputs: tuple[Array, ...]  # b_k (n, w), the leading wheel first
    intensity: Array  # (w, w) Q, per unit distance

    def correlations(self, N: Array) -> list[Array]:
        """g_k of the second wheel and those behind it: E[x w(s - L_k)] just before wheel k meets w, (n, w) each."""
        from scipy.linalg import expm

        g, found = np.zeros_like(self.inputs[0]), []
        for time, b in zip(self.times, self.inputs, strict=False):
            g = expm(N * time) @ (g + b)
            found.append(g)
        return found

    def forcing(self, correlations: list[Array]) -> Array:
        """W = V sum_k (g_k Q b_k^T + b_k Q g_k^T), (n, n)."""
        half = sum(g @ self.intensity @ b.T for g, b in zip(correlations, self.inputs[1:], strict=True))
        return self.speed * (half + np.transpose(half))


@dataclass(frozen=True)
class FrozenProblem:
    """Stationary moment equations at one speed, one set of parameters, one instant. n states, J elements, K arguments.

    `elements` must accept variances of zero. A row of C belongs to the element `owner` names; the rows of one
    element follow each other.
    """

    A: Array  # (n, n)
    c: Array  # (n,)
    b: Array  # (n, J)
    C: Array  # (K, n)
    d: Array  # (K,)
    D: Array  # (n, n) diffusion, without what the delays add
    owner: Array  # (K,) element of each argument
    elements: Elements
    tracks: tuple[WheelTrack, ...] = ()
    states: tuple[str, ...] = field(default=())  # names, for messages

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @cached_property
    def pairs(self) -> Array:
        """(2, T - K) rows of C whose covariance is an entry of theta, in theta's order."""
        owner = np.asarray(self.owner, dtype=int)
        found = [(a, o) for a in range(len(owner)) for o in range(a + 1) if owner[a] == owner[o]]
        return np.array(found, dtype=int).reshape(-1, 2).T

    @cached_property
    def variances(self) -> Array:
        """Indices into theta of the arguments' variances, (K,), in the order of the rows of C."""
        return len(self.C) + np.flatnonzero(self.pairs[0] == self.pairs[1])

    @cached_property
    def columns(self) -> Array:
        """(n, K): the column of b through which each argument acts."""
        return self.b[:, np.asarray(self.owner, dtype=int)]

    def theta(self, mean: Array, covariance: Array) -> Array:
        """What the elements see, (T,); rounding below zero in a variance counts as zero."""
        K = len(self.C)
        spread = (self.C @ covariance) @ self.C.T
        theta = np.concatenate([self.C @ mean + self.d, spread[self.pairs[0], self.pairs[1]]])
        theta[self.variances] = np.maximum(theta[self.variances], 0.0)
        return theta if K else np.zeros(0)

    def transformed(self, left: Array, right: Array, offset: Array | None = None) -> FrozenProblem:
        """The same problem in coordinates z, where x = offset + right z and z = left (x - offset).

        left (m, n) and right (n, m) with left right = 1. For m < n what is left out must not act on the rest: it is
        where z = 0 stays z = 0 (a conserved quantity), or what neither the rest nor an element sees (a drift).
        """
        shift = np.zeros(self.n) if offset is None else offset
        tracks = tuple(replace(track, inputs=tuple(left @ b for b in track.inputs)) for track in self.tracks)
        return replace(
            self,
            A=left @ self.A @ right,
            c=left @ (self.c + self.A @ shift),
            b=left @ self.b,
            C=self.C @ right,
            d=self.d + self.C @ shift,
            D=left @ self.D @ left.T,
            tracks=tracks,
            states=self.states if len(left) == self.n else (),
        )

    def gain_matrix(self, gain: Array) -> Array:
        """N = A + b K C, (n, n)."""
        return self.A + self.columns @ (gain[:, None] * self.C)


@dataclass(frozen=True)
class Evaluation:
    """The moment equations and their derivatives in theta at one point (mean, covariance)."""

    problem: FrozenProblem
    mean: Array  # (n,)
    covariance: Array  # (n, n)
    theta: Array  # (T,)
    F: Array  # (J,)
    gain: Array  # (K,)
    F_slope: Array  # (J, T) dF/dtheta
    gain_slope: Array  # (K, T) dgain/dtheta
    N: Array  # (n, n)
    correlations: tuple[list[Array], ...]  # of the wheels, one list a track
    r: Array  # (n,) rate of the mean
    R: Array  # (n, n) rate of the covariance

    @cached_property
    def scale(self) -> Array:
        """Standard deviation of each state, (n,); where there is next to none, a rounding error of what there is."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return np.maximum(sigma, 1e-10 * np.abs(self.mean).max(initial=0.0) + 1e-13 * sigma.max(initial=0.0))

    @cached_property
    def mean_scale(self) -> Array:
        """What a change of a mean is measured by, (n,): the standard deviation, or part of the largest mean."""
        return np.maximum(self.scale, 1e-4 * np.abs(self.mean).max(initial=0.0))

    @cached_property
    def finite(self) -> bool:
        """Whether every equation and derivative is a number."""
        return bool(np.isfinite(self.r).all() and np.isfinite(self.R).all() and np.isfinite(self.gain_slope).all())

    @cached_property
    def terms(self) -> tuple[Array, Array]:
        """Size of the terms that make up r, (n,), and R, (n, n): what rounding is relative to.

        A correlation enters with the standard deviations that bound it, so that an equation whose terms vanish by
        symmetry is measured by what its state's rate fluctuates by.
        """
        p, sigma = self.problem, self.scale
        gains = np.abs(self.N)
        first = np.abs(p.A) @ np.abs(self.mean) + np.abs(p.c) + np.abs(p.b) @ np.abs(self.F) + gains @ self.mean_scale
        spread = np.outer(gains @ sigma, sigma)
        tiny = np.finfo(float).tiny
        return first + tiny, spread + spread.T + np.abs(p.D) + tiny

    @cached_property
    def residual(self) -> float:
        """The largest residual over the size of its own terms."""
        if not self.finite:
            return np.inf
        first, second = self.terms
        return float(max(np.max(np.abs(self.r) / first), np.max(np.abs(self.R) / second)))


def evaluate(problem: FrozenProblem, mean: Array, covariance: Array) -> Evaluation:
    """Evaluate the moment equations at a mean (n,) and a covariance (n, n)."""
    p = problem
    theta = p.theta(mean, covariance)
    with np.errstate(all="ignore"):
        F, gain, F_slope, gain_slope = (np.asarray(part, dtype=float) for part in p.elements(theta))
        N = p.gain_matrix(gain)
        r = p.A @ mean + p.c + p.b @ F
        flow = N @ covariance
        R = flow + flow.T + p.D
    correlations: tuple[list[Array], ...] = ()
    if p.tracks and np.isfinite(N).all():
        correlations = tuple(track.correlations(N) for track in p.tracks)
        R = R + sum(track.forcing(g) for track, g in zip(p.tracks, correlations, strict=True))
    return Evaluation(p, mean, covariance, theta, F, gain, F_slope, gain_slope, N, correlations, r, R)
