"""Arrays whose last axis has names: ``mean["x"]``, ``covariance["x", "v"]``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

__all__ = ["Labelled", "LabelledCovariance"]


class Labelled:
    """An array with names along its last axis, and outputs beside it: ``mean["x"]``, ``mean["closure"]``.

    ``values`` (also ``numpy.asarray``) is the array of the states alone, ``outputs`` that of the outputs.
    """

    def __init__(
        self, states: Sequence[str], values: np.ndarray, outputs: Sequence[str], of_outputs: np.ndarray
    ):
        self.names = (*states, *outputs)
        self.values = values
        self.outputs = of_outputs

    def __getitem__(self, name: str) -> Any:
        position = _position(name, self.names)
        n = self.values.shape[-1]
        return self.values[..., position] if position < n else self.outputs[..., position - n]

    def keys(self) -> tuple[str, ...]:
        """The names, states first: ``dict(mean)`` works."""
        return self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        return f"Labelled({', '.join(self.names)}; states {self.values.shape}, outputs {self.outputs.shape})"


class LabelledCovariance:
    """Zero-lag covariances by pairs of names: ``covariance["x", "v"]``; ``values`` is the whole (..., n, n).

    Of an output only the variance is known: ``covariance["closure", "closure"]``.
    """

    def __init__(
        self, states: Sequence[str], values: np.ndarray, outputs: Sequence[str], of_outputs: np.ndarray
    ):
        self.states = tuple(states)
        self.values = values
        self._variance = Labelled(states, np.diagonal(values, axis1=-2, axis2=-1), outputs, of_outputs)

    def __getitem__(self, pair: tuple[str, str]) -> Any:
        if not (isinstance(pair, tuple) and len(pair) == 2):
            raise KeyError(f'covariance takes two names, as covariance["x", "v"]; found {pair!r}')
        if pair[0] == pair[1]:
            return self._variance[pair[0]]
        row, column = (_position(name, self._variance.names) for name in pair)
        if max(row, column) >= len(self.states):
            raise KeyError(
                f"no covariance of {pair[0]!r} and {pair[1]!r}: of outputs only variances are kept"
            )
        return self.values[..., row, column]

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        return f"LabelledCovariance({', '.join(self.states)}; {self.values.shape})"


def _position(name: str, names: Sequence[str]) -> int:
    try:
        return names.index(name)
    except ValueError:
        from difflib import get_close_matches

        near = get_close_matches(str(name), names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise KeyError(f"no state or output {name!r}; there are {', '.join(names)}{hint}") from None
