"""Choose the engine of a run by what it would cost: from the number of moments and the eigenvalues of N along the run."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.course import Start, edges
from cadet_sym.solve.evaluate import Gains
from cadet_sym.solve.native import has_machine_code
from cadet_sym.solve.stiff import MANY_STATES

__all__ = ["choose", "compiles", "modes"]

Array = npt.NDArray[np.float64]

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

BUILT = 2500
"""Packed moments above which an integrator of CasADi's takes long to build (70 states)."""

FEW = 6
"""... unless the run has more stretches than this, each of which needs an integrator of its own."""

MILD = 500.0
"""Fastest decay of the covariance times duration up to which explicit formulas are the cheapest ..."""

SWINGING = 20_000.0
"""... and largest frequency: what swings and hardly decays keeps the steps of implicit formulas short as well."""


def choose(lowered: MomentFunctions, start: Start, grid: Array, along: Array) -> str:
    """The engine for a run, of which the moments are known roughly, `along` (k, size).

    Machine code where there is any: explicit while steps are limited by accuracy, for the frequencies of P are sums of two
    of N's. Else CVODES, direct while small.
    """
    packing, delayed = lowered.facts.packing, lowered.facts.delay is not None
    found = modes(lowered, start, float(grid[-1]), along)
    fastest = np.abs(found).max(initial=0.0)
    if fastest <= (QUICK_DELAYED if delayed else QUICK) and compiles(lowered, start, "native"):
        return "native"
    if np.isfinite(fastest) and compiles(lowered, start, "stiff"):
        return "stiff"
    few = len(edges(start, grid)) - 1 <= FEW
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
    facts = lowered.facts
    return facts.delay is None and facts.packing.n <= MANY_STATES and lowered.machine("rate") is not None


def modes(lowered: MomentFunctions, start: Start, duration: float, along: Array) -> npt.NDArray[np.complex128]:
    """Eigenvalues of the covariance's rate over a run's length, from N at even times with the moments `along`; or NaN."""
    times, gains = np.linspace(0, duration, len(along)), Gains(lowered, start.p)
    matrices = np.array([gains(t, y) for t, y in zip(times, along, strict=True)])
    if not np.isfinite(matrices).all():
        return np.array([complex(np.nan)])
    return np.asarray(2 * duration * np.linalg.eigvals(matrices), dtype=complex)
