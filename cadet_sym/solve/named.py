"""Give stationary moments the names of states and outputs; what drifts has none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.freeze import Conditions

__all__ = ["Named", "loose_outputs", "name_moments"]

Array = np.ndarray


@dataclass(frozen=True)
class Named:
    """Moments of states and outputs at one stationary point; NaN for what drifts."""

    state_mean: Array  # (n,)
    state_covariance: Array  # (n, n)
    output_mean: Array  # (m,)
    output_variance: Array  # (m,)
    drifting: tuple[str, ...]  # states and outputs without stationary moments


def name_moments(lowered: MomentFunctions, mean: Array, covariance: Array, drift: Array, held: Conditions) -> Named:
    """Turn the moments of a stationary point into those of states and outputs.

    Parameters
    ----------
    mean, covariance : (n,), (n, n) for forms of the state that do not contain a drifting direction.
    drift : (n, q) directions without stationary moments.
    held : the conditions of the point.
    """
    facts = lowered.facts
    packed = facts.packing.pack(mean, covariance)
    pair = lowered.outputs_at(packed, held.context, held.p)
    output_mean, output_variance = (np.asarray(part).ravel() for part in pair)
    loose = loose_outputs(lowered, drift, held)
    if (lost := ~np.isfinite(output_mean + output_variance) & ~loose).any():
        from cadet_sym.solve.seen import warn_of_lost_outputs  # late: it needs SymPy

        warn_of_lost_outputs(lowered, held.p, held.context, packed, lost, "in the stationary state")
    output_mean[loose] = output_variance[loose] = np.nan
    drifting = np.abs(drift).max(axis=1, initial=0.0) > 1e-9
    state_mean, state_covariance = mean.copy(), covariance.copy()
    state_mean[drifting] = np.nan
    state_covariance[drifting, :] = state_covariance[:, drifting] = np.nan
    names = (*facts.states, *facts.outputs)
    who = tuple(name for name, drifts in zip(names, (*drifting, *loose), strict=True) if drifts)
    return Named(state_mean, state_covariance, output_mean, output_variance, who)


def loose_outputs(lowered: MomentFunctions, drift: Array, held: Conditions) -> Array:
    """Which outputs depend on a drifting direction, (m,) bool."""
    count = len(lowered.facts.outputs)
    if not drift.size:
        return np.zeros(count, dtype=bool)
    rows = lowered.output_rows(held.context, held.p)
    rows = rows if isinstance(rows, tuple | list) else (rows,)[:count]
    return np.array([_sees(np.asarray(row), drift) for row in rows], dtype=bool)


def _sees(rows: Array, drift: Array) -> bool:
    """Whether linear forms of the state have a part in a drifting direction."""
    parts = np.abs(rows @ drift).max(initial=0.0)
    return bool(parts > 1e-9 * np.abs(rows).max(initial=1e-300))
