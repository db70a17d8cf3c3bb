"""Several wheels on one track: the correlation of the state with the ground between them, on a grid.

Contacts at setbacks L_1 < L_2 < ... meet the same noise one after the other: Z' = A Z + V sum_k b_k w(s - L_k).
With G(t, theta) = E[Z(t) w(s(t) - theta)] the covariance is exact at any speed history V(t) >= 0:

    G_t + V G_theta = N G,    G(t, L_1+) = b_1,    G(t, L_k+) = G(t, L_k-) + b_k
    P' = N P + P N^T + V sum_k b_k Q b_k^T + V sum_(k>=2) (g_k Q b_k^T + b_k Q g_k^T),   g_k = G(t, L_k-)

(theta counts from the track's first wheel). In nonlinear systems N is the equivalent gain matrix: by Stein's lemma
this is the same Gaussian closure as in P and brings no new approximation. Between two setbacks theta is cut into
elements, and G is collocated in each at the right-Radau nodes: at constant speed that is the [M-1/M] Pade approximant
of the exponential, whose modulus is at most one on the imaginary axis, so the covariance stays positive semidefinite.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError

if TYPE_CHECKING:
    from cadet_sym.augmentation import AugmentedSystem

__all__ = [
    "CHOICES",
    "STANDING",
    "DelayGrid",
    "Gap",
    "TrackDelay",
    "choose_grid",
    "delay_grid",
    "grid_error",
    "radau",
    "radau_stability",
]

Array = npt.NDArray[np.float64]

AT_REST = (6, 8)
"""The coarsest grid for a run that starts from rest or stops: a singularity then crosses the wheelbase, and convergence
is only algebraic while it does."""

CHOICES = ((1, 8), (1, 12), (2, 8), (4, 6), (4, 8), (6, 8), (8, 10))
"""Elements x nodes to choose from on every gap between wheels, cheapest first."""


STANDING = 1e-9
"""Speed below which a vehicle does not travel at all."""


@dataclass(frozen=True)
class Gap:
    """The stretch of ground between two setbacks that follow each other on one track."""

    elements: int
    nodes: int


@dataclass(frozen=True)
class TrackDelay:
    """The wheels of one track in the order in which they meet the ground."""

    columns: tuple[tuple[int, ...], ...]  # of the noise input, one tuple a setback
    gaps: tuple[Gap, ...]  # one fewer

    @property
    def nodes(self) -> int:
        """Nodes of all gaps."""
        return sum(gap.elements * gap.nodes for gap in self.gaps)


@dataclass(frozen=True)
class DelayGrid:
    """All tracks that have more than one wheel; G is packed track by track, node by node, column by column."""

    states: int
    tracks: tuple[TrackDelay, ...]

    @property
    def size(self) -> int:
        """Number of values of the packed correlation."""
        return sum(self.states * len(track.columns[0]) * track.nodes for track in self.tracks)


def delay_grid(system: AugmentedSystem, elements: int, nodes: int) -> DelayGrid | None:
    """Lay the grid between the wheels of every track that has several; None if no track has."""
    number = system.model.number
    tracks = []
    for name in dict.fromkeys(copy.track for copy in system.copies):
        copies = [copy for copy in system.copies if copy.track == name]
        if len(copies) < 2:
            continue
        copies.sort(key=lambda copy: number(copy.setback))
        for before, after in pairwise(copies):
            if number(after.setback) <= number(before.setback):
                raise ModelError(
                    f"contacts `{before.contact}` and `{after.contact}` on track `{name}` have equal setbacks "
                    "written in different ways; write them with the same expression."
                )
        gaps = (Gap(elements, nodes),) * (len(copies) - 1)
        tracks.append(TrackDelay(tuple(copy.columns for copy in copies), gaps))
    return DelayGrid(len(system.states), tuple(tracks)) if tracks else None


@cache
def radau(nodes: int) -> tuple[Array, Array]:
    """Right-Radau nodes c_1 < ... < c_M = 1 and differentiation (M, M + 1) on {0, c_1, ..., c_M}.

    The interior nodes are the roots of the Jacobi polynomial P^(1,0)_(M-1) mapped to [0, 1]. Row j of the
    matrix is the derivative at c_j of the polynomial through the inflow (column 0) and the nodes.
    """
    k = np.arange(nodes - 1, dtype=float)
    # Jacobi recurrence for weights (1 - x)^1 (1 + x)^0; the roots are eigenvalues (Golub & Welsch 1969).
    diagonal = -1.0 / ((2 * k + 1) * (2 * k + 3))
    k = k[1:]
    off = np.sqrt(k * (k + 1) / (2 * k + 1) ** 2)
    roots = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))
    points = np.concatenate([[0.0], (roots + 1) / 2, [1.0]])
    return points[1:], _differentiation(points)[1:]


def _differentiation(points: Array) -> Array:
    """Differentiation matrix of the polynomial through the points, by barycentric weights."""
    difference = points[:, None] - points[None, :]
    np.fill_diagonal(difference, 1.0)
    weights = 1.0 / difference.prod(axis=1)
    matrix = weights[None, :] / weights[:, None] / difference
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


def radau_stability(z: npt.NDArray[np.complexfloating], nodes: int) -> npt.NDArray[np.complexfloating]:
    """R(z), the [M-1/M] Pade approximant of exp(z): what one element does to G at constant speed."""
    _, D = radau(nodes)
    # D_1..M g + D_0 = z g at the nodes for inflow one; the outflow is the last node.
    operators = D[:, 1:] - np.asarray(z)[..., None, None] * np.eye(nodes)
    return np.linalg.solve(operators, np.broadcast_to(-D[:, :1], (*np.shape(z), nodes, 1)))[..., -1, 0]


def grid_error(exponents: npt.NDArray[np.complexfloating], elements: int, nodes: int) -> float:
    """Largest error of what a gap does to G at constant speed, max |R(z/elements)^elements - exp(z)|.

    z = l L/V for the eigenvalues l of N, the gaps L and the speeds V. Conservative for the covariances, by a factor
    of 1 to 100.
    """
    if not exponents.size:
        return 0.0
    discrete = radau_stability(exponents / elements, nodes) ** elements
    return float(np.max(np.abs(discrete - np.exp(exponents))))


def choose_grid(
    exponents: npt.NDArray[np.complexfloating], tolerance: float, *, rests: bool
) -> tuple[tuple[int, int], float]:
    """The cheapest grid of `CHOICES` whose error is below the tolerance, or the finest; and its error."""
    decaying = exponents[exponents.real <= 0]
    choices = CHOICES[CHOICES.index(AT_REST) :] if rests else CHOICES
    error = np.inf
    for choice in choices:
        error = grid_error(decaying, *choice)
        if error <= tolerance:
            return choice, error
    return choices[-1], error
