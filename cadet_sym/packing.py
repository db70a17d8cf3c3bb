"""The order in which the moments stand in one vector."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

__all__ = ["Packing"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Packing:
    """y = [mean (n); lower triangle of P, column by column; what else is integrated alongside]."""

    n: int
    distance: bool = False  # the distance travelled is integrated too
    ground: int = 0  # values of the correlation with the ground between the wheels (see `delay`)
    known: int = 0  # how many of these, the last ones, stay what they are
    rows: int = 1  # of every mode of those before them: neighbours that belong to one state each

    @property
    def moments(self) -> int:
        """Number of means and covariances."""
        return self.n + self.n * (self.n + 1) // 2

    @property
    def size(self) -> int:
        """Number of all values in y."""
        return self.moments + int(self.distance) + self.ground

    @cached_property
    def triangle(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Rows and columns of the packed covariances, in order."""
        columns, rows = np.triu_indices(self.n)
        return rows, columns

    @cached_property
    def diagonal(self) -> npt.NDArray[np.intp]:
        """Where the variances stand in y."""
        rows, columns = self.triangle
        return self.n + np.flatnonzero(rows == columns)

    @cached_property
    def square(self) -> npt.NDArray[np.intp]:
        """Where the entries of the whole covariance stand in y, row by row, (n n,)."""
        rows, columns = self.triangle
        places = np.empty((self.n, self.n), dtype=np.intp)
        places[rows, columns] = places[columns, rows] = np.arange(self.n, self.moments)
        return places.ravel()

    def pack(self, mean: Array, covariance: Array) -> Array:
        """Means (n,) and covariance (n, n) as one vector of `moments` values."""
        rows, columns = self.triangle
        return np.concatenate([mean, covariance[rows, columns]])

    def unpack(self, y: Array) -> tuple[Array, Array]:
        """Mean (..., n) and symmetric covariance (..., n, n) of packed moments (..., size)."""
        covariance = np.empty((*y.shape[:-1], self.n, self.n))
        flat = covariance.reshape(*y.shape[:-1], self.n * self.n)
        y.take(self.square, axis=-1, out=flat, mode="clip")  # else NumPy copies it once more
        return y[..., : self.n].copy(), covariance
