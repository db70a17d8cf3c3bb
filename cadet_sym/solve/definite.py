"""Check that covariances are positive semidefinite, and say along which state one is not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cadet_sym.packing import Packing
from cadet_sym.solve.threads import one_thread
from cadet_sym.warning import warn

__all__ = ["LIMIT", "lost", "warn_of_loss"]

Array = npt.NDArray[np.float64]

LIMIT = 1e-9
"""Smallest eigenvalue of P over its trace: below minus this, P is no covariance."""

LOOKED_AT = 64
"""Times at which large covariances are checked ..."""

MANY = 24
"""... those of more states than this."""

EPSILON, TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)


def lost(y: Array, packing: Packing) -> npt.NDArray[np.bool_]:
    """At which rows of packed moments (k, size) the covariance is not positive semidefinite, within rounding."""
    n, result = packing.n, np.zeros(len(y), dtype=bool)
    rows = slice(None) if n <= MANY else np.unique(np.linspace(0, len(y) - 1, LOOKED_AT).astype(int))
    looked_at = y[rows]
    P = looked_at.take(packing.square, axis=1).reshape(-1, n, n)
    diagonal = np.einsum("kii->ki", P)
    diagonal += (LIMIT * np.maximum(np.add.reduce(diagonal, axis=1), 0.0) + TINY)[:, None]
    with one_thread(n):
        try:
            np.linalg.cholesky(P)
        except np.linalg.LinAlgError:
            rounding = EPSILON * np.abs(looked_at[:, :n]).max(axis=1, initial=0.0)  # of a system without any noise
            diagonal += (rounding**2)[:, None]
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
    text = (
        f"the covariance is not positive semidefinite at t = {time[bad[worst]]:.6g}: its smallest eigenvalue is "
        f"{ratio[worst]:.2g} of its trace, mostly along `{state}`. Differences between states that move together are "
        "lost in the integration error there; ask for a smaller rtol, or measure one state relative to the other."
    )
    warn(RuntimeWarning(text))
