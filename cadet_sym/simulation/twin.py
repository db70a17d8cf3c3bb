"""The quasi-linear system along a run, as numbers: what the control variate needs of statistical linearisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["Twin"]


@dataclass(frozen=True)
class Twin:
    """The vehicle's rates replaced by f ~ N x + g, x the augmented state, and the moments which that implies.

    Handed in by the caller, so that the simulation shares no code with what it judges. It is checked: where the twin's
    own simulated moments differ from those given here, it is not used.
    """

    linearised: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # times (k,) -> N (k, nv, n), g (k, nv)
    mean: np.ndarray  # (times, n) of the augmented state at the output times
    covariance: np.ndarray  # (times, n, n)
