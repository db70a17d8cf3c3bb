"""Invert I - g L for the ground between the wheels: what a small change of G and N P + P N^T do, advection included.

    L da_i = N da_i - (V/h) (sum_j T_ij da_j + e_i din),    L dP gets V sum_(k>=2) (dg_k Q b_k^T + b_k Q dg_k^T)

Of G only what is carried changes, and of N only the rows of those states count. In the eigenvectors of that part the
modes of one element couple to each other alone, and to what leaves the element before: a small inverse
for each eigenvalue and one sweep along the ground. G does not feel P while the gains stay put, so that G is solved first
and its forcing is carried into the equation of P.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cadet_sym.delay import Gap, TrackDelay, transport_matrix
from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["GroundInverse"]

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray


@dataclass
class GroundInverse:
    """(I - g L)^-1 on the correlation with the ground, for one model and one set of parameters."""

    lowered: MomentFunctions
    p: Array

    def __post_init__(self) -> None:
        delay = self.lowered.facts.delay
        assert delay is not None
        self.tracks: tuple[TrackDelay, ...] = delay.tracks
        self._rows, self._carried = delay.rows, delay.carried
        self._modes: tuple[npt.NDArray, npt.NDArray, npt.NDArray] | None = None

    def decompose(self, N: Array, scale: Array) -> None:
        """Take the eigenvectors of N, in units of the states' sizes; held until the next call."""
        N, scale = N[: self._rows, : self._rows], scale[: self._rows]
        values, vectors = np.linalg.eig(N * scale / scale[:, None])
        vectors = scale[:, None] * vectors
        try:
            self._modes = values, vectors, np.linalg.inv(vectors)
        except np.linalg.LinAlgError:  # defective: a matrix next to it has a full set
            rng = np.random.default_rng(0)
            values, vectors = np.linalg.eig(N + 1e-9 * np.abs(N).max() * rng.standard_normal(N.shape))
            self._modes = values, vectors, np.linalg.inv(vectors)

    def prepare(self, t: float, y: Array, g: float) -> None:
        """Make the inverses of the elements for one g, at the speed and place of time t."""
        assert self._modes is not None
        V, dV, s, start = (float(part) for part in self.lowered.motion(t, self.p))
        packing = self.lowered.facts.packing
        if packing.distance:
            s = float(y[packing.moments])
        b, Q, setbacks = (np.asarray(part) for part in self.lowered.noise(np.array([t, s, V, dV]), self.p))
        gated = self.lowered.facts.gated
        self._speed, self._g = V, g
        self._wheels, self._elements = [], []
        for track in self.tracks:
            places = [float(setbacks[columns[0], 0]) for columns in track.columns]
            first = list(track.columns[0])
            open_ = [not gated or s - start >= place for place in places]
            self._wheels.append([(Q[np.ix_(first, first)] @ b[:, list(c)].T) for c in track.columns[1:]])
            self._wheels[-1] = [w * gate for w, gate in zip(self._wheels[-1], open_[1:], strict=True)]
            lengths = np.diff(places)
            self._elements.append([self._element(gap, length) for gap, length in zip(track.gaps, lengths, strict=True)])

    def _element(self, gap: Gap, length: float) -> tuple[ComplexArray, Array]:
        """Inverse of one element for every eigenvalue (rows, M, M), and what its inflow does to its modes (M,)."""
        assert self._modes is not None
        T, e = transport_matrix(gap.modes)
        rate = self._g * self._speed * gap.elements / length
        matrix = (1 - self._g * self._modes[0])[:, None, None] * np.eye(gap.modes) + rate * T
        return np.linalg.inv(matrix), rate * e

    def apply(self, r: Array) -> tuple[Array, Array]:
        """(change of the packed G, (n, n) forcing of the covariance that comes with it, times g)."""
        assert self._modes is not None
        _, vectors, inverse = self._modes
        n, states = len(vectors), self.lowered.facts.packing.n
        found, forcing, first = [], np.zeros((states, states)), 0
        for track, wheels, elements in zip(self.tracks, self._wheels, self._elements, strict=True):
            q = track.noises
            size = n * q * track.modes
            # (eigenvectors, modes of the ground, noises)
            modal = (inverse @ r[first : first + size].reshape(-1, n).T).reshape(n, track.modes, q)
            solved, arrivals = _sweep(track, elements, modal)
            found.append(np.real(vectors @ solved.reshape(n, -1)).T.ravel())
            for arriving, weight in zip(arrivals, wheels, strict=True):
                half = self._g * self._speed * np.real(vectors @ arriving) @ weight
                forcing[:n] += half
                forcing[:, :n] += half.T
            first += size
        return np.concatenate([*found, r[self._carried :]]), forcing


def _sweep(
    track: TrackDelay, elements: list[tuple[ComplexArray, Array]], modal: ComplexArray
) -> tuple[ComplexArray, list[ComplexArray]]:
    """Solve element after element along the ground; what arrives at each wheel behind, (n, q) each."""
    solved, arrivals = np.empty_like(modal), []
    inflow, at = np.zeros((modal.shape[0], modal.shape[2]), dtype=complex), 0
    for gap, (inverse, entry) in zip(track.gaps, elements, strict=True):
        for _ in range(gap.elements):
            known = modal[:, at : at + gap.modes] - entry[None, :, None] * inflow[:, None, :]
            solved[:, at : at + gap.modes] = inverse @ known
            at += gap.modes
            inflow = solved[:, at - 1]
        arrivals.append(inflow)
    return solved, arrivals
