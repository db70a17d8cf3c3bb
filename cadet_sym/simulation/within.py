"""What the ground does within a step, beyond its values at both ends.

A filter state xi that passes quickly is rough: its mean over a step is not that of its ends, and a vehicle that adds up
the ends meets a ground with a false spectrum, off by (theta^2)/12 where the step is theta correlation lengths long. So
the chain of the ground carries the integrals of its states as well, sampled jointly with them, and a step knows

    e = (int xi ds)/ds - (xi_0 + xi_1)/2,        d = xi_1 - xi_0.

A function f of xi is then taken at the two places xi_0 + e + (1/2 - c) d and xi_1 + e - (1/2 - c) d. Their mean is the
mean of xi over the step, exactly, and c is such that their spread is that of xi within the step in the mean,

    c^2 E[d^2] = E[(1/ds) int (xi - mean)^2 ds]:        c = 1/sqrt(6) for a state that white noise drives on a short step,

so that second moments of xi are exact as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem, FilterCopy
from cadet_sym.simulation.laws import exact_law

__all__ = ["CopyRows", "copy_rows", "spread_within"]

_KNOTS = 48  # lengths at which c is worked out; between them it is interpolated
_STILL = 1.0 / np.sqrt(12.0)  # c of what moves in a straight line


@dataclass(frozen=True)
class CopyRows:
    """Where one copy of the filter stands in the rows of a node: its r states, then the integrals it carries."""

    first: int
    states: int
    carried: tuple[int, ...]  # states whose integral along the ground is carried
    sources: tuple[int, ...]  # for each state the row whose increment is its integral; -1 where nobody asks

    @property
    def size(self) -> int:
        """Rows."""
        return self.states + len(self.carried)


def copy_rows(system: AugmentedSystem, used: Iterable[sp.Basic]) -> tuple[CopyRows, ...]:
    """Rows of every copy; `used` are the filter states that the vehicle feels. Copies of one track carry the same."""
    used, found, first = set(used), [], 0
    felt: dict[str, set[int]] = {}
    for copy in system.copies:
        places = {a for a, s in enumerate(system.states[copy.states]) if s in used}
        felt[copy.track] = felt.get(copy.track, set()) | places
    for copy in system.copies:
        r = len(copy.filter.states)
        known = _integrals_of_others(copy)
        carried = tuple(a for a in sorted(felt[copy.track]) if a not in known)
        sources = [-1] * r
        for a in felt[copy.track]:
            sources[a] = first + (known[a] if a in known else r + carried.index(a))
        found.append(CopyRows(first, r, carried, tuple(sources)))
        first += found[-1].size
    return tuple(found)


def _integrals_of_others(copy: FilterCopy) -> dict[int, int]:
    """States a whose integral is the increment of a state b: xi_b' = xi_a and nothing else."""
    road, known = copy.filter, {}
    for b in range(len(road.states)):
        row = road.C.row(b)
        entries = [a for a in range(row.cols) if row[a] != 0]
        if len(entries) == 1 and row[entries[0]] == 1 and road.D.row(b).is_zero_matrix and road.offset[b] == 0:
            known.setdefault(entries[0], b)
    return known


def spread_within(C: np.ndarray, G: np.ndarray, P: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The numbers c of every state, (k, r), for steps of given lengths.

    With S(u) = E[(xi(u) - xi(0))^2], starting from the covariance P,

        c^2 = int_0^1 (1 - x) S(x d) dx / S(d).

    Parameters
    ----------
    C, G, P : (r, r) matrix of the filter, intensity of its noise, covariance of its states.
    lengths : (k,).
    """
    moving = lengths[lengths > 0.0]
    if not len(moving):
        return np.full((len(lengths), len(C)), _STILL)
    knots = np.geomspace(moving.min(), max(moving.max(), 1.001 * moving.min()), _KNOTS)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    nodes, weights = 0.5 * (1.0 + nodes), 0.5 * weights
    within = _strayed(C, G, P, np.outer(knots, nodes).ravel()).reshape(len(knots), len(nodes), -1)
    whole = _strayed(C, G, P, knots)
    square = np.einsum("j,kja->ka", weights * (1.0 - nodes), within)
    c = np.where(whole > 0.0, np.sqrt(square / np.where(whole > 0.0, whole, 1.0)), _STILL)
    at = np.log(np.maximum(lengths, knots[0]))
    return np.stack([np.interp(at, np.log(knots), c[:, a]) for a in range(c.shape[1])], axis=-1)


def _strayed(C: np.ndarray, G: np.ndarray, P: np.ndarray, d: np.ndarray) -> np.ndarray:
    """S(d) of every state, (k, r)."""
    phi, sigma = exact_law(C, G, d)
    left = phi - np.eye(len(C))
    return np.einsum("kab,bc,kac->ka", left, P, left) + np.diagonal(sigma, axis1=1, axis2=2)

