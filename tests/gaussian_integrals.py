"""Gaussian expectations by brute force: composite Gauss-Legendre split at kinks, geometrically refined about them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
REACH = 9.0
FIXED = (-REACH, -6.0, -3.0, 0.0, 3.0, 6.0, REACH)
BESIDE = np.array([0.0] + [s * 1.5 * 0.2**j for j in range(7) for s in (-1, 1)])


def panels(kinks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights times the standard normal density, (..., kinks) -> (..., nodes)."""
    fixed = np.broadcast_to(np.array(FIXED), (*kinks.shape[:-1], len(FIXED)))
    edges = np.sort(np.concatenate([fixed, np.clip(kinks, -REACH, REACH)], axis=-1), axis=-1)
    half = np.diff(edges, axis=-1)[..., None] / 2
    x = (edges[..., :-1, None] + half * (1 + NODES)).reshape(*kinks.shape[:-1], -1)
    return x, (half * WEIGHTS).reshape(x.shape) * np.exp(-x * x / 2) / np.sqrt(2 * np.pi)


def one(f: Callable, m: float, s: float, kinks: ArrayLike = ()) -> tuple[float, float]:
    """E[f] and, by Stein's lemma, the gain."""
    u, w = panels(np.ravel([(k - m) / s + BESIDE for k in np.atleast_1d(kinks)]))
    values = f(m + s * u) * w
    return float(values.sum()), float((values * u).sum() / s)


def two(f: Callable, mean: Any, stds: Any, rho: float, kinks: Sequence[Sequence[float]]) -> float:
    """E[f(x, y)], any correlation; kinks in x and in y."""
    (mx, my), (sx, sy) = mean, stds
    breaks = [(k - mx) / sx + BESIDE for k in kinks[0]] + [(k - my) / (sy * rho) + BESIDE for k in kinks[1] if rho]
    u, w = panels(np.ravel(breaks))
    u, w = u[w > 1e-19], w[w > 1e-19]
    centre, spread = my + rho * sy * u[:, None], sy * np.sqrt(max(0.0, 1 - rho * rho))
    inner = (np.array(kinks[1]) - centre) / spread if spread else np.zeros((len(u), 0))
    v, p = panels(inner)
    return float(np.sum(w * np.sum(p * f(np.broadcast_to(mx + sx * u[:, None], v.shape), centre + spread * v), axis=1)))


def covariance(stds: Sequence[float], rho: float) -> list[float]:
    """Lower triangle of two arguments."""
    return [stds[0] ** 2, rho * stds[0] * stds[1], stds[1] ** 2]
