"""Exact laws of linear systems driven by white noise: transition, covariance, its factors, and what is stationary."""

from __future__ import annotations

import numpy as np

from cadet_sym.errors import ModelError

__all__ = ["covariance_factor", "exact_law", "stationary_covariance"]

_TERMS = 18  # of the Taylor series of a scaled step
_SCALE = 0.25  # norm of the scaled step


def exact_law(A: np.ndarray, G: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Transition and covariance of dx = A x ds + noise of intensity G, over lengths d.

        Phi(d) = exp(A d),    Sigma(d) = int_0^d exp(A u) G exp(A u)^T du

    Taylor series on a short piece, then doubling: Sigma(2 d) = Sigma + Phi Sigma Phi^T, Phi(2 d) = Phi^2. Sums of
    positive terms: nothing cancels however long the step is.

    Parameters
    ----------
    A, G : (k, n, n) or (n, n).
    d : (k,) lengths, not negative.

    Returns
    -------
    (k, n, n) each.
    """
    n = A.shape[-1]
    A = np.broadcast_to(A, (len(d), n, n))
    G = np.broadcast_to(G, (len(d), n, n))
    largest = np.abs(A).sum(axis=-1).max(initial=0.0) * d.max(initial=0.0)
    doublings = max(0, int(np.ceil(np.log2(max(largest, 1e-300) / _SCALE))))
    h = (d / 2.0**doublings)[:, None, None]
    term, moment = np.broadcast_to(np.eye(n), A.shape), G * h
    phi, sigma = term.copy(), moment.copy()
    for k in range(1, _TERMS):
        term = A @ term * (h / k)
        left = A @ moment
        moment = (left + np.swapaxes(left, -1, -2)) * (h / (k + 1))
        phi, sigma = phi + term, sigma + moment
    for _ in range(doublings):
        sigma = sigma + phi @ sigma @ np.swapaxes(phi, -1, -2)
        phi = phi @ phi
    return phi, sigma


def covariance_factor(sigma: np.ndarray) -> np.ndarray:
    """Lower L, (..., n, n), with L L^T = sigma positive semidefinite: a pivot lost in rounding counts as zero."""
    n = sigma.shape[-1]
    L = np.zeros(sigma.shape)
    for j in range(n):
        left = L[..., j, :j]
        pivot = sigma[..., j, j] - np.sum(left**2, axis=-1)
        pivot = np.where(pivot > 1e-14 * sigma[..., j, j], pivot, 0.0)
        L[..., j, j] = np.sqrt(pivot)
        with np.errstate(divide="ignore", invalid="ignore"):
            below = sigma[..., j + 1 :, j] - np.einsum("...ik,...k->...i", L[..., j + 1 :, :j], left)
            column = below / L[..., j, j, None]
        L[..., j + 1 :, j] = np.where(pivot[..., None] > 0.0, column, 0.0)
    return L


def stationary_covariance(C: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Covariance of the ground that has always been there: C P + P C^T + G = 0."""
    from scipy.linalg import solve_continuous_lyapunov

    if np.linalg.eigvals(C).real.max(initial=-1.0) >= 0.0:
        raise ModelError(
            'this ground has no stationary height, so no path can start on it; start with `ground = "smooth"` or '
            "give the road a `cutoff`"
        )
    P = solve_continuous_lyapunov(C, -G)
    return 0.5 * (P + P.T)
