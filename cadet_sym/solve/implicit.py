"""Invert I - g L, where L is what the moment equations do to a small change while the equivalent gains stay put.

    L (dmu, dP) = (N dmu, N dP + dP N^T)

With N = W B W^-1 (B of 2 x 2 blocks, one for each pair of eigenvalues a +- ib) the inverse costs four products of
matrices, whatever n (n + 3) / 2 is: dP = W Z W^T with Z - g (B Z + Z B^T) = W^-1 R W^-T, which couples each entry only
to those of the same two pairs. All is held in units of the states' own sizes; single precision is not enough, for its
rounding keeps Newton's method from converging where the rates differ widely. Where N has no full set of eigenvectors, a
matrix next to it has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cadet_sym.packing import Packing
from cadet_sym.solve.ground import GroundInverse
from cadet_sym.solve.lyapunov import ModalForm, modal_form

__all__ = ["Inverse", "PackedIndex"]

Array = npt.NDArray[np.float64]

CONDITION_LIMIT = 1e10
"""Of the eigenvectors; beyond it a neighbouring matrix is taken."""


class PackedIndex:
    """Where the entries of a full covariance stand in the packed one, and the other way round."""

    def __init__(self, packing: Packing) -> None:
        n = packing.n
        rows, columns = packing.triangle
        full = np.empty((n, n), dtype=np.intp)
        full[rows, columns] = full[columns, rows] = np.arange(len(rows))
        self.packing, self.full, self.triangle = packing, full, rows * n + columns


@dataclass
class Inverse:
    """(I - g L)^-1 for one N and one g, applied to packed vectors."""

    index: PackedIndex
    scale: Array  # (n,) size of every state
    form: ModalForm
    weights: tuple[Array, ...]  # (n, n) each: entry, row partner, column partner, both
    partner: npt.NDArray[np.intp]
    along: tuple[Array, Array]  # (n,) the same for a vector
    ground: GroundInverse | None = None  # of the ground between the wheels, where there is any

    @classmethod
    def build(
        cls, index: PackedIndex, scale: Array, form: ModalForm, g: float, ground: GroundInverse | None = None
    ) -> Inverse:
        """The weights of every entry and its partners; see the module."""
        n = len(form.eigenvalues)
        partner, sign = np.arange(n), np.zeros(n)
        partner[form.first], partner[form.first + 1] = form.first + 1, form.first
        sign[form.first], sign[form.first + 1] = 1.0, -1.0
        upper = np.real(form.eigenvalues) + 1j * np.abs(np.imag(form.eigenvalues))
        same = 1 / (1 - g * (upper[:, None] + upper))
        mixed = 1 / (1 - g * (upper[:, None] + upper.conj()))
        row, column = sign[:, None], sign[None, :]
        weights = (
            (same.real + mixed.real) / 2,
            (same.imag + mixed.imag) / 2 * row,
            (same.imag - mixed.imag) / 2 * column,
            (mixed.real - same.real) / 2 * row * column,
        )
        single = 1 / (1 - g * upper)
        kept = weights if sign.any() else weights[:1]
        return cls(index, scale, form, kept, partner, (single.real, single.imag * sign), ground)

    def apply(self, r: Array, z: Array) -> None:
        """Z = (I - g L)^-1 r; a distance integrated alongside passes as it is."""
        n, moments = self.index.packing.n, self.index.packing.moments
        z[:n] = self._vectors(r[:n, None])[:, 0]
        R = r[n:moments].take(self.index.full)
        z[moments:] = r[moments:]
        if self.ground is not None:
            z[-self.index.packing.ground :], forcing = self.ground.apply(r[-self.index.packing.ground :])
            R = R + forcing
        z[n:moments] = self._matrix(R).take(self.index.triangle)

    def _vectors(self, x: Array) -> Array:
        m = self._inverse @ (x / self.scale[:, None])
        direct, crossed = self.along
        return self.scale[:, None] * (self._basis @ (direct[:, None] * m + crossed[:, None] * m[self.partner]))

    def _matrix(self, R: Array) -> Array:
        M = self._left @ R @ self._left.T
        Z = self.weights[0] * M
        if len(self.weights) > 1:
            turned = M[self.partner]
            Z += self.weights[1] * turned
            Z += self.weights[2] * M[:, self.partner]
            Z += self.weights[3] * turned[:, self.partner]
        return self._right @ Z @ self._right.T

    def __post_init__(self) -> None:
        self._basis, self._inverse = self.form.basis, self.form.inverse
        self._left = self._inverse / self.scale
        self._right = self.scale[:, None] * self._basis


def scaled_form(N: Array, scale: Array) -> ModalForm:
    """Modal form of N in units of the states' sizes, or of a matrix next to it that has usable eigenvectors."""
    scaled = N * scale / scale[:, None]
    rows = np.abs(scaled).max(axis=1, initial=0.0)[:, None]
    wobble = np.random.default_rng(0).standard_normal(N.shape) * np.where(rows > 0, rows, rows.max(initial=0.0) or 1.0)
    best: ModalForm | None = None
    for distance in (0.0, 1e-9, 1e-6, 1e-4):
        form = modal_form(scaled + distance / np.sqrt(max(len(N), 1)) * wobble if distance else scaled)
        if form is not None and (best is None or form.condition < best.condition):
            best = form
        if best is not None and best.condition < CONDITION_LIMIT:
            break
    assert best is not None, "a random matrix has a full set of eigenvectors"
    return best
