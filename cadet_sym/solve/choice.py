"""Choose the engine of a run by what it would cost: from the number of moments and the eigenvalues of N along the run."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.course import edges
from cadet_sym.solve.evaluate import gains_over
from cadet_sym.solve.many import Start, Starts
from cadet_sym.solve.native import has_machine_code, have_machine_code
from cadet_sym.solve.scales import most_steps
from cadet_sym.solve.stiff import bdf_compiles

__all__ = ["Modes", "choose", "compiles", "modes", "rings", "stands_still"]

Array = npt.NDArray[np.float64]
Modes = npt.NDArray[np.complex128]

SMALL = 100
"""Packed moments up to which CasADi's CVODES with its direct solver is the fastest (12 states) ..."""

SMALL_DELAYED = 700
"""The same where wheels follow each other: most of the Jacobian is the ground between them, and sparse."""

SPARSE = 600
"""The same where N has at most four entries a row (33 states)."""

QUICK = 6_000.0
"""Fastest rate of the covariance times duration up to which explicit formulas in machine code are the fastest ..."""

QUICK_DELAYED = 20_000.0
"""... and the same where wheels follow each other, for which there are no implicit ones in machine code."""

RINGING, LASTING = 0.7, 40.0
"""Up to the first times the steps that there may be, if what is faster only swings, and decays in the whole run by no more than
the second: implicit formulas of low order have to follow it all along, with many more steps."""

BUILT = 2500
"""Packed moments above which an integrator of CasADi's takes long to build (70 states)."""

FEW = 6
"""... unless the run has more stretches than this, each of which needs an integrator of its own."""

MILD = 500.0
"""Fastest decay of the covariance times duration up to which explicit formulas are the cheapest ..."""

SWINGING = 20_000.0
"""... and largest frequency: what swings and hardly decays keeps the steps of implicit formulas short as well."""


def choose(lowered: MomentFunctions, starts: Starts, grid: Array, found: Modes) -> list[str]:
    """The engines for runs, of which the modes (runs, m) are known.

    Machine code where there is any: explicit while steps are limited by accuracy, for the frequencies of P are sums of two
    of N's. Else CVODES, direct while small.
    """
    quick = (np.abs(found).max(axis=1, initial=0.0) <= _quick(lowered)) | rings(lowered, found)
    if quick.any():
        quick &= have_machine_code(lowered, starts.p, starts.y)
    return [
        "native" if each else _implicit_or_casadis(lowered, starts[k], grid, found[k])
        for k, each in enumerate(quick.tolist())
    ]


def _quick(lowered: MomentFunctions) -> float:
    return QUICK if lowered.facts.delay is None else QUICK_DELAYED


def rings(lowered: MomentFunctions, found: Modes) -> npt.NDArray[np.bool_]:
    """Of which runs with modes (runs, m) something too fast for few steps swings all along, (runs,)."""
    fastest = np.abs(found).max(axis=1, initial=0.0)
    lasting = (np.abs(found) <= QUICK) | (np.abs(found.real) <= LASTING)
    within = (fastest > _quick(lowered)) & (fastest <= RINGING * most_steps(lowered.facts.packing.size))
    return np.asarray(within & lasting.all(axis=1))


def _implicit_or_casadis(lowered: MomentFunctions, start: Start, grid: Array, found: Modes) -> str:
    packing, delayed = lowered.facts.packing, lowered.facts.delay is not None
    fastest = np.abs(found).max(initial=0.0)
    if np.isfinite(fastest) and compiles(lowered, start, "stiff"):
        return "stiff"
    few = len(edges(start.breakpoints, grid)) - 1 <= FEW
    if few and packing.size <= (SMALL_DELAYED if delayed else SMALL):
        return "direct"
    if not np.isfinite(fastest):
        return "implicit"
    if fastest <= SWINGING and np.abs(found.real).max(initial=0.0) <= MILD:
        return "explicit" if few and packing.size <= BUILT else "stepping"
    sparse = packing.size <= SPARSE and lowered.gain_matrix.nnz_out(0) <= 4 * packing.n
    return "direct" if few and sparse and not delayed else "implicit"


def compiles(lowered: MomentFunctions, start: Start, engine: str) -> bool:
    """Whether a run can be machine code."""
    if engine == "native":
        return has_machine_code(lowered, start.p, start.y)
    return bdf_compiles(lowered)


def modes(lowered: MomentFunctions, p: Array, duration: float, along: Array, enough: float = 0.0) -> Modes:
    """Eigenvalues of the covariance's rate over a run's length, from N at even times with the moments `along`; or NaN.

    Parameters
    ----------
    p : (k, count) parameters of k runs.
    along : (m, size) packed moments that are known roughly.
    enough : what is surely slower than this need not be known: a bound stands for it.

    Returns
    -------
    (k, m n); (k, n) where N is the same at all times.
    """
    if stands_still(lowered):
        along = along[:1]
    runs, m = len(p), len(along)
    times = duration * np.arange(m) / max(m - 1, 1)
    N = gains_over(lowered, np.tile(times, runs), np.tile(along, (runs, 1)), np.repeat(p, m, axis=0)).reshape(runs, m, -1)
    if (N[:, :1] == N).all():  # as that of a model that happens to be linear
        N = N[:, :1]
    found = np.full((runs, N.shape[1] * lowered.facts.packing.n), complex(np.nan))
    matrices = 2 * duration * N.reshape(*N.shape[:2], lowered.facts.packing.n, -1)
    rest = np.flatnonzero(np.isfinite(N).all(axis=(1, 2)))
    if runs > 1 and enough:  # of one run nothing is cheaper than its modes
        bounds = _bounds(matrices[rest])
        found[rest] = bounds[:, None]
        rest = rest[bounds > enough]
    found[rest] = np.linalg.eigvals(matrices[rest]).reshape(-1, found.shape[1])
    return found


def stands_still(lowered: MomentFunctions) -> bool:
    """Whether N is surely the same all along every run: that of a linear model at a constant speed."""
    facts, motion = lowered.facts, lowered.motion
    moves = facts.arguments or facts.explicit or facts.needs_distance or facts.gated or facts.delay is not None
    return not moves and not motion.jac_sparsity(0, 0).nnz() and not motion.jac_sparsity(1, 0).nnz()


def _bounds(matrices: Array) -> Array:
    """Bounds (k,) of the eigenvalues of matrices (k, m, n, n): max_i (|M| x)_i / x_i for any x > 0 (Collatz, Wielandt)."""
    M, x = np.abs(matrices), np.ones((*matrices.shape[:-1], 1))
    for _ in range(4):  # x comes near Perron's vector, for which there is no lower bound
        ahead = M @ x
        least = 1e-9 * ahead.max(axis=-2, keepdims=True, initial=0.0)
        x = np.sqrt(x * (ahead + np.where(least > 0, least, 1.0)))
    return np.asarray((M @ x / x).max(axis=(1, 2, 3)))
