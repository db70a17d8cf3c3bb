"""Several wheels on one track: the correlation of the state with the ground between them, on a grid.

Contacts at setbacks L_1 < L_2 < ... meet the same noise one after the other: Z' = A Z + V sum_k b_k w(s - L_k).
With G(t, theta) = E[Z(t) w(s(t) - theta)] the covariance is exact at any speed history V(t) >= 0:

    G_t + V G_theta = N G,    G(t, L_1+) = b_1,    G(t, L_k+) = G(t, L_k-) + b_k
    P' = N P + P N^T + V sum_k b_k Q b_k^T + V sum_(k>=2) (g_k Q b_k^T + b_k Q g_k^T),   g_k = G(t, L_k-)

(theta counts from the track's first wheel). In nonlinear systems N is the equivalent gain matrix: by Stein's lemma
this is the same Gaussian closure as in P and brings no new approximation. Between two setbacks theta is cut into
elements of length h, and in each G is a sum of M Legendre polynomials, sum_i a_i P_i(2 x - 1), 0 <= x <= 1:

    a_i' = N a_i - (V/h) (2i + 1) (out - (-1)^i in - 2 (a_(i-1) + a_(i-3) + ...)),    out = sum_i a_i

(Galerkin with upwind flux, which is collocation at the right-Radau nodes.) At constant speed `out` is the [M-1/M] Pade
approximant of the exponential times `in`, whose modulus is at most one on the imaginary axis: the covariance stays
positive semidefinite. What is integrated is a_0, ..., a_(M-2) and `out`: elements then couple through one value a row,
and a rate costs O(M), not O(M^2). Where the ground is the same all along, the rows of G that belong to the filter copies do not
change: E[xi_k(t) w(s - theta)] = exp(C (theta - L_k)) D behind wheel k and zero before it, in discrete form the steady
state of the same equations, whatever V is. Only the vehicle's rows are then integrated.
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
    "grid_errors",
    "pade",
    "radau_nodes",
    "transport_matrix",
]

Array = npt.NDArray[np.float64]

AT_REST = (6, 8)
"""The coarsest grid for a run that starts from rest or stops: a singularity then crosses the wheelbase, and convergence
is only algebraic while it does."""

CHOICES = ((1, 8), (1, 12), (2, 8), (4, 6), (4, 8), (6, 8), (8, 10))
"""Elements x modes to choose from on every gap between wheels, cheapest first."""


STANDING = 1e-9
"""Speed below which a vehicle does not travel at all."""


@dataclass(frozen=True)
class Gap:
    """The stretch of ground between two setbacks that follow each other on one track."""

    elements: int
    modes: int  # of each element, M: the first M - 1 Legendre coefficients and what leaves the element
    known: tuple[int, ...]  # states of filter copies whose rows of G stay what they are; those not reached yet are zero


@dataclass(frozen=True)
class TrackDelay:
    """The wheels of one track in the order in which they meet the ground."""

    columns: tuple[tuple[int, ...], ...]  # of the noise input, one tuple a setback
    gaps: tuple[Gap, ...]  # one fewer

    @property
    def noises(self) -> int:
        """Number of noises of the track's ground, q."""
        return len(self.columns[0])

    @property
    def modes(self) -> int:
        """Modes of all elements of all gaps."""
        return sum(gap.elements * gap.modes for gap in self.gaps)


@dataclass(frozen=True)
class DelayGrid:
    """All tracks that have more than one wheel.

    G is packed track by track, element by element, mode by mode, column by column: first what is carried along, the
    rows of the first `rows` states, then in the same order what is known.
    """

    rows: int  # the vehicle's states, or all where the ground is not the same all along
    tracks: tuple[TrackDelay, ...]

    @property
    def carried(self) -> int:
        """Number of values that are integrated."""
        return sum(self.rows * track.noises * track.modes for track in self.tracks)

    @property
    def known(self) -> int:
        """Number of values that stay what they are."""
        return sum(
            len(gap.known) * track.noises * gap.elements * gap.modes for track in self.tracks for gap in track.gaps
        )


def delay_grid(system: AugmentedSystem, elements: int, modes: int) -> DelayGrid | None:
    """Lay the grid between the wheels of every track that has several; None if no track has."""
    number = system.model.number
    tracks, steady = [], all(copy.filter.is_homogeneous for copy in system.copies)
    for name in dict.fromkeys(copy.track for copy in system.copies):
        copies = [copy for copy in system.copies if copy.track == name]
        if len(copies) < 2:
            continue
        copies.sort(key=lambda copy: number(copy.setback))
        gaps, met = [], ()
        for before, after in pairwise(copies):
            if number(after.setback) <= number(before.setback):
                raise ModelError(
                    f"contacts `{before.contact}` and `{after.contact}` on track `{name}` have equal setbacks "
                    "written in different ways; write them with the same expression."
                )
            met = (*met, *range(before.states.start, before.states.stop)) if steady else ()
            gaps.append(Gap(elements, modes, met))
        tracks.append(TrackDelay(tuple(copy.columns for copy in copies), tuple(gaps)))
    return DelayGrid(system.vehicle_size if steady else len(system.states), tuple(tracks)) if tracks else None


@cache
def transport_matrix(modes: int) -> tuple[Array, Array]:
    """T (M, M) and e (M,) of one element: a' = N a - (V/h) (T a + e in), a = (a_0, ..., a_(M-2), out)."""
    i = np.arange(modes)
    odd_below = (i[:, None] > i) & ((i[:, None] - i) % 2 == 1)
    weights = 2.0 * i + 1
    T, e = weights[:, None] * (1.0 - 2.0 * odd_below), -weights * (-1.0) ** i
    to_out = np.eye(modes)
    to_out[-1] = 1.0
    return to_out @ T @ np.linalg.inv(to_out), to_out @ e


@cache
def radau_nodes(count: int) -> Array:
    """Right-Radau nodes c_1 < ... < c_M = 1: the roots of the Jacobi polynomial P^(1,0)_(M-1) mapped to [0, 1], and 1."""
    k = np.arange(count - 1, dtype=float)
    # Jacobi recurrence for weights (1 - x)^1 (1 + x)^0; the roots are eigenvalues (Golub & Welsch 1969).
    diagonal = -1.0 / ((2 * k + 1) * (2 * k + 3))
    k = k[1:]
    off = np.sqrt(k * (k + 1) / (2 * k + 1) ** 2)
    roots = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))
    return np.append((roots + 1) / 2, 1.0)


def pade(z: npt.NDArray[np.complexfloating], modes: int) -> npt.NDArray[np.complexfloating]:
    """R(z), the [M-1/M] Pade approximant of exp(z): what one element does to G at constant speed."""
    T, e = transport_matrix(modes)
    # T a + e = z a for inflow one; the outflow comes last.
    operators = T - np.asarray(z)[..., None, None] * np.eye(modes)
    return np.linalg.solve(operators, np.broadcast_to(-e[:, None], (*np.shape(z), modes, 1)))[..., -1, 0]


def grid_error(exponents: npt.NDArray[np.complexfloating], elements: int, modes: int) -> float:
    """The largest of `grid_errors`, or zero."""
    return float(grid_errors(exponents, elements, modes).max(initial=0.0))


def grid_errors(
    exponents: npt.NDArray[np.complexfloating], elements: int, modes: int
) -> npt.NDArray[np.float64]:
    """Errors of what a gap does to G at constant speed, |R(z/elements)^elements - exp(z)|.

    z = l L/V for the eigenvalues l of N, the gaps L and the speeds V. Conservative for the covariances, by a factor
    of 1 to 100.
    """
    return np.abs(pade(exponents / elements, modes) ** elements - np.exp(exponents))


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
