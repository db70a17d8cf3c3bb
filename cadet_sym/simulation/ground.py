"""The ground under the wheels, sampled exactly on the paths' own grid.

Between two positions a distance d apart the filter states and the noise obey one Gaussian law, whatever d is:

    xi(p + d) = exp(C d) xi(p) + zeta,     zeta ~ N(0, Sigma(d)),     Sigma(d) = int_0^d exp(C u) D Q D^T exp(C u)^T du

Wheels of one track share one chain over the union of the positions of all of them, so that what one meets is what
the other met, and each position is sampled once.

Where the filter's coefficients vary along the road they are frozen at the middle of each step of the chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem, FilterCopy
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, evaluate
from cadet_sym.simulation.grid import Grid
from cadet_sym.simulation.tables import GroundTables

__all__ = ["covariance_factor", "exact_law", "ground_tables", "stationary_covariance"]

_TERMS = 18  # of the Taylor series of a scaled step
_SCALE = 0.25  # norm of the scaled step
_FORGOTTEN, _LOOK_BACK = 40.0, 4001  # lengths of the slowest mode that are looked back on, and places on them


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


@dataclass(frozen=True)
class _Filter:
    """The shaping filter as numbers at given positions."""

    copy: FilterCopy
    values: Mapping[sp.Symbol, float]

    @property
    def size(self) -> int:
        """Filter states."""
        return len(self.copy.filter.states)

    def matrices(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """C and D Q D^T, (k, r, r) each."""
        f = self.copy.filter
        C, D, Q = (self._matrix(m, places) for m in (f.C, f.D, f.Q))
        return C, D @ Q @ np.swapaxes(D, -1, -2)

    def forcing(self, places: np.ndarray) -> np.ndarray:
        return self._matrix(self.copy.filter.offset, places)[..., 0]

    def _matrix(self, matrix: sp.ImmutableMatrix, places: np.ndarray) -> np.ndarray:
        known = {**self.values, DISTANCE: places}
        entries = [np.broadcast_to(evaluate(entry, known), places.shape) for entry in matrix]
        return np.stack(entries, axis=-1).reshape(*places.shape, *matrix.shape)


def ground_tables(
    system: AugmentedSystem, values: Mapping[sp.Symbol, float], grid: Grid, noises: int
) -> tuple[GroundTables, tuple[np.ndarray, ...]]:
    """Work out the chains of all tracks and where each wheel stands in them; `noises` counts those in time.

    Returns
    -------
    The tables, and for each track a factor of the covariance at its chain's first node.
    """
    nv, copies = system.vehicle_size, system.copies
    smooth = system.model.initial.ground == "smooth"
    setbacks = [float(evaluate(c.setback, values)) for c in copies]
    tracks = list(dict.fromkeys(c.track for c in copies))
    track_of = np.array([tracks.index(c.track) for c in copies], dtype=np.int64)
    pick = np.zeros((len(copies), len(grid.time)), dtype=np.int64)
    leader, room, sizes, roots, laws, law_of = [], [], [], [], [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    for track in range(len(tracks)):
        members = np.flatnonzero(track_of == track)
        leader.append(members[np.argmin([setbacks[c] for c in members])])
        road = _Filter(copies[leader[-1]], values)
        chain = _chain(grid, [setbacks[c] for c in members], smooth)
        pick[members] = chain.pick
        matrices, which = _laws(road, np.diff(chain.places), 0.5 * (chain.places[:-1] + chain.places[1:]))
        law_of.append(sum(map(len, laws)) + which * (2 * road.size**2))
        laws.append(matrices.ravel())
        sizes.append(road.size)
        roots.append(_start_factor(road, grid.motion.start, smooth))
        room.append(int((chain.pick.max(axis=0) - chain.pick.min(axis=0)).max()) + 2)
    ring_rows = [n * r for n, r in zip(room, sizes, strict=True)]
    mean = _mean(system, values, grid, setbacks, smooth)
    tables = GroundTables(
        width=len(system.states) - nv + noises,
        size=np.array(sizes, dtype=np.int64),
        laws=np.concatenate(laws),
        law_of=np.concatenate(law_of),
        law_start=_starts([len(w) for w in law_of[1:]]),
        pick=pick,
        track_of=track_of,
        row_of=np.array([c.start - nv for c in copies], dtype=np.int64),
        leader=np.array(leader, dtype=np.int64),
        ring_start=_starts(ring_rows),
        ring_room=np.array(room, dtype=np.int64),
        ring_rows=sum(ring_rows),
        has_mean=len(mean) > 0,
        mean=mean,
        noises=noises,
        root_step=np.sqrt(grid.step),
    )
    return tables, tuple(roots)


@dataclass(frozen=True)
class _Chain:
    places: np.ndarray  # (J + 1,) increasing
    pick: np.ndarray  # (wheels, time nodes)


def _chain(grid: Grid, setbacks: Sequence[float], smooth: bool) -> _Chain:
    """Union of the positions of all wheels of a track, and the chain node under each wheel at each time.

    On a smooth start everything up to the leading wheel's first position is one node: flat, and free of noise.
    """
    under = grid.place - np.array(setbacks)[:, None]
    begin = grid.place[0] if smooth else under.min()
    under = np.maximum(under, begin)
    span = max(float(under.max()) - begin, 1e-300)
    # Positions that differ by rounding only are one.
    places = np.unique(under)
    keep = np.concatenate([[True], np.diff(places) > 1e-13 * (span + abs(begin))])
    index = np.cumsum(keep) - 1
    return _Chain(places[keep], index[np.searchsorted(places, under)].astype(np.int64))


def _laws(road: _Filter, lengths: np.ndarray, middles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step matrices (law, r, 2 r) = [transition, noise factor], and the law of every step."""
    if road.copy.filter.is_homogeneous:
        # At constant speed a thousand steps share one law; lengths that differ by rounding count as one.
        unit = 1e-10 * max(float(lengths.max(initial=0.0)), 1e-300)
        _, first, law_of = np.unique(np.round(lengths / unit), return_index=True, return_inverse=True)
        lengths, middles = lengths[first], middles[first]
    else:
        law_of = np.arange(len(lengths))
    A, G = road.matrices(middles)
    phi, sigma = exact_law(A, G, lengths)
    return np.concatenate([phi, covariance_factor(sigma)], axis=-1), law_of.astype(np.int64)


def _start_factor(road: _Filter, place: float, smooth: bool) -> np.ndarray:
    if smooth:
        return np.zeros((road.size, road.size))
    A, G = road.matrices(np.array([place]))
    return covariance_factor(stationary_covariance(A[0], G[0]))


def _starts(counts: Sequence[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)])[:-1].astype(np.int64)


def _mean(
    system: AugmentedSystem,
    values: Mapping[sp.Symbol, float],
    grid: Grid,
    setbacks: Sequence[float],
    smooth: bool,
) -> np.ndarray:
    """What the ground's deterministic part adds to the filter states under each wheel: m' = C m + offset in distance.

    It begins at rest on a smooth start; else with what the ground behind the wheel has brought about. Empty if there
    is nothing to add.
    """
    if all(copy.filter.offset.is_zero_matrix for copy in system.copies):
        return np.zeros((0, 0))
    ground = system.model.ground
    edges = [] if ground is None else [float(evaluate(b, values)) for b in ground.breakpoints]
    means = []
    for setback, copy in zip(setbacks, system.copies, strict=True):
        road = _Filter(copy, values)
        under = np.where(grid.time < 0.0, grid.motion.start, grid.place) - setback
        means.append(_forced(road, under, np.zeros(road.size) if smooth else _behind(road, under[0], edges)))
    return np.concatenate(means, axis=1)


def _behind(road: _Filter, here: float, edges: Sequence[float]) -> np.ndarray:
    """Filter state at a place from all the deterministic ground behind it."""
    C, _ = road.matrices(np.array([here]))
    slowest = -np.linalg.eigvals(C[0]).real.max()
    if slowest <= 1e-12 * np.abs(C).max():
        return np.zeros(C.shape[-1])
    far = here - _FORGOTTEN / slowest
    places = np.union1d(np.linspace(far, here, _LOOK_BACK), [e for e in edges if far < e < here])
    return _forced(road, places, np.linalg.solve(C[0], -road.forcing(places[:1])[0]))[-1]


def _forced(road: _Filter, places: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Filter states along places: every step by exp(C d), two Gauss points for what is added within it."""
    d, middle = np.diff(places), 0.5 * (places[:-1] + places[1:])
    A, G = road.matrices(middle)
    phi, _ = exact_law(A, G, d)
    push = np.zeros((len(d), len(begin)))
    for gauss in (-1.0, 1.0):
        at = 0.5 * d * (1.0 + gauss / np.sqrt(3.0))
        onward, _ = exact_law(A, G, d - at)
        push += 0.5 * d[:, None] * np.einsum("kab,kb->ka", onward, road.forcing(places[:-1] + at))
    states = np.empty((len(places), len(begin)))
    states[0] = begin
    for i in range(len(d)):
        states[i + 1] = phi[i] @ states[i] + push[i]
    return states
