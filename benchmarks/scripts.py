"""What a user would write with NumPy and SciPy alone: the moment equations by hand, nothing compiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import erf, exp, pi, sqrt

import numpy as np
from scipy import special

Rate = Callable[[float, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Script:
    """Rate of the mean and the lower triangle of the covariance, row by row, and their start."""

    rate: Rate
    start: np.ndarray
    n: int


def normal(m: float, p: float) -> tuple[float, float, float]:
    """Standard deviation, density and distribution at m / s."""
    s = sqrt(p) + 1e-150
    u = m / s
    return s, exp(-0.5 * u * u) / sqrt(2 * pi), 0.5 * (1 + erf(u / sqrt(2)))


def figure_3() -> Script:
    """The oleo undercarriage accelerating from rest: states x, v, h, h'."""
    wn, zeta, gamma, r, a, c0, c1, k = 10.0, 0.01, 0.1, 0.1, 8.0, 0.4, 2.2, 1.264911064067352
    rows, columns = np.tril_indices(4)
    A, N, P = np.zeros((4, 4)), np.zeros((4, 4)), np.empty((4, 4))
    A[0, 1], A[1, :2] = 1, (-(wn**2), -2 * zeta * wn)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        V, mean = a * t, y[:4]
        P[rows, columns] = P[columns, rows] = y[4:]
        m, p = mean[1], max(P[1, 1], 0.0)
        s, density, below = normal(m, p)
        F = (m * m + p) * (below - r * (1 - below)) + (1 + r) * m * s * density
        gain = 2 * m * (below - r * (1 - below)) + 2 * (1 + r) * s * density
        A[1, 2], A[1, 3], A[2, 3], A[3, 2], A[3, 3] = V * V * c0, V * V * c1 - a, V, -V * c0, -V * c1
        slope = A @ mean
        slope[1] -= gamma * F
        N[:] = A
        N[1, 1] -= gamma * gain
        half = N @ P
        D = half + half.T
        D[1, 1] += V * V * V * k * k
        D[1, 3] -= V * V * k * k
        D[3, 1] = D[1, 3]
        D[3, 3] += V * k * k
        return np.concatenate([slope, D[rows, columns]])

    start = np.zeros(14)
    start[4 + 5], start[4 + 9] = 1 / 1.1, c0 / 1.1
    return Script(rate, start, 4)


def figure_3_plain() -> Script:
    """The same as most would write it: matrices by np.array at every call, scipy.special.erf, the covariance whole."""
    wn, zeta, gamma, r, a, c0, c1, k = 10.0, 0.01, 0.1, 0.1, 8.0, 0.4, 2.2, 1.264911064067352

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        V, mean, P = a * t, y[:4], y[4:].reshape(4, 4)
        m, p = mean[1], max(P[1, 1], 0.0)
        s = np.sqrt(p) + 1e-150
        density = np.exp(-0.5 * (m / s) ** 2) / np.sqrt(2 * np.pi)
        below = 0.5 * (1 + special.erf(m / s / np.sqrt(2)))
        F = (m**2 + p) * (below - r * (1 - below)) + (1 + r) * m * s * density
        gain = 2 * m * (below - r * (1 - below)) + 2 * (1 + r) * s * density
        A = np.array(
            [
                [0, 1, 0, 0],
                [-(wn**2), -2 * zeta * wn, V**2 * c0, V**2 * c1 - a],
                [0, 0, 0, V],
                [0, 0, -V * c0, -V * c1],
            ]
        )
        N = A - gamma * gain * np.outer([0, 1, 0, 0], [0, 1, 0, 0])
        b = np.array([0, -V * k, 0, k])
        slope = A @ mean - np.array([0, gamma * F, 0, 0])
        return np.concatenate([slope, (N @ P + P @ N.T + V * np.outer(b, b)).ravel()])

    start = np.zeros((5, 4))
    start[3, 2], start[4, 3] = 1 / 1.1, c0 / 1.1
    return Script(rate, start.ravel(), 4)


def car(n: int) -> Script:
    """The car-like chain of `chains.car`: states x_1, v_1, x_2, v_2, ..., dampers z + z|z|/2 between the first four."""
    count = n // 2
    stiffness = np.array([round(40 + 2000 * (i / (count - 1)) ** 2, 3) for i in range(count)])
    A = np.zeros((n, n))
    dampers = []  # (mass before, mass after)
    for i in range(count):
        x, v = 2 * i, 2 * i + 1
        A[x, v] = 1
        A[v, x] -= stiffness[i]
        if i:
            A[v, x] -= stiffness[i - 1]
            A[v, x - 2] += stiffness[i - 1]
            A[v, v] -= 2
            A[v, v - 2] += 2
        if i + 1 < count:
            A[v, x + 2] += stiffness[i]
            A[v, v] -= 2
            A[v, v + 2] += 2
            if i < 3:
                dampers.append((v, v + 2))
    rows, columns = np.tril_indices(n)
    P, Q = np.empty((n, n)), np.zeros((n, n))
    Q[n - 1, n - 1] = 1.0

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        mean = y[:n]
        P[rows, columns] = P[columns, rows] = y[n:]
        N, slope = A.copy(), A @ mean
        for i, j in dampers:
            m, p = mean[j] - mean[i], max(P[i, i] + P[j, j] - 2 * P[i, j], 0.0)
            s, density, below = normal(m, p)
            force = (m * m + p) * (2 * below - 1) + 2 * m * s * density  # E[z|z|]
            gain = 2 * m * (2 * below - 1) + 4 * s * density
            slope[i] += force
            slope[j] -= force
            N[i, j] += gain
            N[i, i] -= gain
            N[j, i] += gain
            N[j, j] -= gain
        half = N @ P
        return np.concatenate([slope, (half + half.T + Q)[rows, columns]])

    return Script(rate, np.zeros(n * (n + 3) // 2), n)
