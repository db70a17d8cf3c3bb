"""Check that covariances are positive semidefinite, and say along which state one is not."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cadet_sym.packing import Packing

__all__ = ["LIMIT", "lost", "warn_of_loss"]

Array = npt.NDArray[np.float64]

LIMIT = 1e-9
"""Smallest eigenvalue of P over its trace: below minus this, P is no covariance."""

LOOKED_AT = 64
"""Times at which large covariances are checked."""


def lost(y: Array, packing: Packing) -> npt.NDArray[np.bool_]:
    """At which rows of packed moments (k, size) the covariance is not positive semidefinite, within rounding."""
    n = packing.n
    rows = np.arange(len(y)) if n <= 24 else np.unique(np.linspace(0, len(y) - 1, LOOKED_AT).astype(int))
    mean, P = packing.unpack(y if len(rows) == len(y) else y[rows])
    trace = np.einsum("kii->k", P)
    rounding = (np.finfo(float).eps * np.abs(mean).max(axis=1, initial=0.0)) ** 2  # of a system without any noise
    P[:, range(n), range(n)] += (LIMIT * np.maximum(trace, 0.0) + rounding + np.finfo(float).tiny)[:, None]
    result = np.zeros(len(y), dtype=bool)
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        result[rows] = np.linalg.eigvalsh(P)[:, 0] < 0
    return result


def warn_of_loss(time: Array, y: Array, packing: Packing, states: Sequence[str]) -> None:
    """Name the time, the state and the eigenvalue where a covariance is not positive semidefinite."""
    bad = np.flatnonzero(lost(y, packing))
    if not len(bad):
        return
    _, P = packing.unpack(y[bad])
    values, vectors = np.linalg.eigh(P)
    ratio = values[:, 0] / np.maximum(np.einsum("kii->k", P), np.finfo(float).tiny)
    worst = int(np.argmin(ratio))
    state = states[int(np.argmax(np.abs(vectors[worst, :, 0])))]
    warnings.warn(
        f"the covariance is not positive semidefinite at t = {time[bad[worst]]:.6g}: its smallest eigenvalue is "
        f"{ratio[worst]:.2g} of its trace, mostly along `{state}`. Differences between states that move together are "
        "lost in the integration error there; ask for a smaller rtol, or measure one state relative to the other.",
        RuntimeWarning,
        stacklevel=4,
    )
