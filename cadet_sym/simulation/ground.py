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
from cadet_sym.language.expression import DISTANCE, evaluate
from cadet_sym.simulation.grid import Grid
from cadet_sym.simulation.laws import covariance_factor, exact_law, stationary_covariance
from cadet_sym.simulation.tables import GroundTables
from cadet_sym.simulation.within import CopyRows, spread_within

__all__ = ["ground_tables", "within_tables"]

_RESTS = 1e-9  # of the way: a wheel that goes no farther in a step stands
_FORGOTTEN, _LOOK_BACK = 40.0, 4001  # lengths of the slowest mode that are looked back on, and places on them


@dataclass(frozen=True)
class _Filter:
    """The shaping filter as numbers at given positions, with the integrals of some of its states as further states."""

    copy: FilterCopy
    values: Mapping[sp.Symbol, float]
    carried: tuple[int, ...] = ()

    @property
    def own(self) -> _Filter:
        """The filter without integrals."""
        return _Filter(self.copy, self.values)

    @property
    def size(self) -> int:
        """Filter states and integrals."""
        return len(self.copy.filter.states) + len(self.carried)

    def matrices(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """C and D Q D^T, (k, r, r) each."""
        f, r = self.copy.filter, len(self.copy.filter.states)
        C, D, Q = (self._matrix(m, places) for m in (f.C, f.D, f.Q))
        whole = np.zeros((2, len(places), self.size, self.size))
        whole[0, :, :r, :r], whole[1, :, :r, :r] = C, D @ Q @ np.swapaxes(D, -1, -2)
        for row, a in enumerate(self.carried, r):
            whole[0, :, row, a] = 1.0
        return whole[0], whole[1]

    def forcing(self, places: np.ndarray) -> np.ndarray:
        own = self._matrix(self.copy.filter.offset, places)[..., 0]
        return np.concatenate([own, np.zeros((len(places), len(self.carried)))], axis=1)

    def _matrix(self, matrix: sp.ImmutableMatrix, places: np.ndarray) -> np.ndarray:
        known = {**self.values, DISTANCE: places}
        entries = [np.broadcast_to(evaluate(entry, known), places.shape) for entry in matrix]
        return np.stack(entries, axis=-1).reshape(*places.shape, *matrix.shape)


def ground_tables(
    system: AugmentedSystem,
    values: Mapping[sp.Symbol, float],
    grid: Grid,
    rows: Sequence[CopyRows],
    noises: int,
) -> tuple[GroundTables, tuple[np.ndarray, ...]]:
    """Work out the chains of all tracks and where each wheel stands in them; `noises` counts those in time.

    Returns
    -------
    The tables, and for each track a factor of the covariance at its chain's first node.
    """
    copies = system.copies
    smooth = system.model.initial.ground == "smooth"
    setbacks = [float(evaluate(c.setback, values)) for c in copies]
    tracks = list(dict.fromkeys(c.track for c in copies))
    track_of = np.array([tracks.index(c.track) for c in copies], dtype=np.int64)
    pick = np.zeros((len(copies), len(grid.time)), dtype=np.int64)
    leader, room, sizes, roots, laws, law_of = [], [], [], [], [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    for track in range(len(tracks)):
        members = np.flatnonzero(track_of == track)
        leader.append(members[np.argmin([setbacks[c] for c in members])])
        road = _Filter(copies[leader[-1]], values, rows[leader[-1]].carried)
        chain = _chain(grid, [setbacks[c] for c in members], smooth)
        pick[members] = chain.pick
        matrices, which = _laws(road, np.diff(chain.places), 0.5 * (chain.places[:-1] + chain.places[1:]))
        law_of.append(sum(map(len, laws)) + which * (2 * road.size**2))
        laws.append(matrices.ravel())
        sizes.append(road.size)
        roots.append(_start_factor(road, float(chain.places[0]), smooth))
        room.append(int((chain.pick.max(axis=0) - chain.pick.min(axis=0)).max()) + 2)
    ring_rows = [n * r for n, r in zip(room, sizes, strict=True)]
    mean = _mean(system, values, grid, rows, setbacks, smooth)
    tables = GroundTables(
        width=sum(each.size for each in rows) + noises,
        size=np.array(sizes, dtype=np.int64),
        laws=np.concatenate(laws),
        law_of=np.concatenate(law_of),
        law_start=_starts([len(w) for w in law_of[1:]]),
        pick=pick,
        track_of=track_of,
        row_of=np.array([each.first for each in rows], dtype=np.int64),
        leader=np.array(leader, dtype=np.int64),
        ring_start=_starts(ring_rows),
        ring_room=np.array(room, dtype=np.int64),
        ring_rows=sum(ring_rows),
        has_mean=len(mean) > 0,
        mean=mean,
        noises=noises,
        root_step=np.sqrt(grid.step),
        mix=np.zeros((0, noises, noises)),
        mix_of=np.zeros(0, dtype=np.int64),
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
    root = np.zeros((road.size, road.size))
    if not smooth:
        A, G = road.own.matrices(np.array([place]))
        root[: len(A[0]), : len(A[0])] = covariance_factor(stationary_covariance(A[0], G[0]))
    return root


def _starts(counts: Sequence[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)])[:-1].astype(np.int64)


def within_tables(
    system: AugmentedSystem, values: Mapping[sp.Symbol, float], grid: Grid, rows: Sequence[CopyRows]
) -> np.ndarray:
    """What a step needs to know of the ground within it, (steps, columns): see `CopyRows`.

    For every copy 1/ds and 1/2, zero where the wheel stands or its ground is held still while the state is run in, and
    the numbers c of the states whose integrals are known.
    """
    smooth, columns = system.model.initial.ground == "smooth", []
    span = max(float(grid.place[-1] - grid.place[0]), 1e-300)
    for copy, each in zip(system.copies, rows, strict=True):
        road, setback = _Filter(copy, values), float(evaluate(copy.setback, values))
        under = grid.place - setback
        ds = np.diff(np.maximum(under, grid.place[0]) if smooth else under)
        held = (grid.time[:-1] < 0.0) & (not copy.filter.offset.is_zero_matrix)
        moving = (ds > _RESTS * span) & ~held
        (C,), (G,) = road.matrices(grid.place[:1] - setback)
        stable = np.linalg.eigvals(C).real.max(initial=-1.0) < 0.0
        c = spread_within(C, G, stationary_covariance(C, G) if stable else np.zeros_like(C), np.where(moving, ds, 0.0))
        columns += [np.where(moving, 1.0 / np.where(moving, ds, 1.0), 0.0), np.where(moving, 0.5, 0.0)]
        columns += [c[:, a] for a, source in enumerate(each.sources) if source >= 0]
    return np.stack(columns, axis=1) if columns else np.zeros((len(grid.step), 0))


def _mean(
    system: AugmentedSystem,
    values: Mapping[sp.Symbol, float],
    grid: Grid,
    rows: Sequence[CopyRows],
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
    for setback, copy, each in zip(setbacks, system.copies, rows, strict=True):
        road = _Filter(copy, values, each.carried)
        under = np.where(grid.time < 0.0, grid.motion.start, grid.place) - setback
        begin = np.zeros(road.size)
        if not smooth:
            begin[: each.states] = _behind(road.own, under[0], edges)
        means.append(_forced(road, under, begin))
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
