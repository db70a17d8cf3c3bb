"""White noise: names and the intensity that joins them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.canonical import canonical
from cadet_sym.language.element import declared_name, set_field


@dataclass(frozen=True)
class Noise:
    """Gaussian white noises with E[w w'^T] = Q delta, Q two-sided.

    Parameters
    ----------
    names : of the noises.
    intensity : (m, m), symmetric, in (unit of the rate)^2 times the unit of time (of distance, in a ground);
        expressions in parameters and t (s, in a ground). One number for all, m numbers for the diagonal, or the matrix.

    `Noise({"w": "Q"})`-like mappings are for independent noises: `Noise.independent({w: Q})`.
    """

    names: Any  # tuple of texts
    intensity: Any  # (m, m) ImmutableMatrix

    def __post_init__(self):
        given: Any = self.names
        names = [given] if isinstance(given, sp.Symbol | str) else list(given)
        names = tuple(declared_name(name, "noise", table="noise") for name in names)
        if not names or len(set(names)) != len(names):
            what = "no noise is named" if not names else "a noise is named twice"
            raise ModelError(what, table="noise", key="names")
        set_field(self, "names", names)
        set_field(self, "intensity", _matrix(self.intensity, names))

    @classmethod
    def independent(cls, intensities: Mapping[Any, Any]) -> Noise:
        """Noises that know nothing of each other, each with its intensity."""
        return cls(tuple(intensities), _diagonal(list(intensities.values())))

    @property
    def is_diagonal(self) -> bool:
        """Whether the noises are independent."""
        return self.intensity.is_diagonal()


def _matrix(given: Any, names: Sequence[str]) -> sp.ImmutableMatrix:
    size = len(names)
    if isinstance(given, sp.MatrixBase):
        rows = given.tolist()
    elif isinstance(given, Sequence) or hasattr(given, "tolist"):
        rows = [
            list(row) if isinstance(row, Sequence) else row for row in list(getattr(given, "tolist", lambda: given)())
        ]
        if rows and not isinstance(rows[0], list):
            rows = _diagonal(rows)
    else:
        rows = _diagonal([given] * size)
    if len(rows) != size or any(len(row) != size for row in rows):
        shape = f"{len(rows)} rows of {sorted({len(row) for row in rows})}"
        raise ModelError(
            f"the intensity of {size} noises is a {size} x {size} matrix, not {shape}",
            table="noise",
            key="intensity",
        )
    matrix = sp.ImmutableMatrix([[canonical(entry) for entry in row] for row in rows])
    if matrix != matrix.T:
        i, j = next(pair for pair in matrix.todok() if matrix[pair] != matrix.T[pair])
        raise ModelError(
            f"the intensity is not symmetric: `{names[i]},{names[j]}` is {matrix[i, j]} and "
            f"`{names[j]},{names[i]}` is {matrix[j, i]}",
            table="noise",
            key="intensity",
        )
    return matrix


def _diagonal(values: Sequence[Any]) -> list[list[Any]]:
    return [[value if i == j else sp.S.Zero for j in range(len(values))] for i, value in enumerate(values)]
