"""What a search for a stationary state gives: one fixed point of the moment equations, several, or some along a parameter.

Shapes as in `results`: n augmented states, m outputs; arrays are read-only, and what drifts is NaN here and ``null`` in JSON.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.files import save_as
from cadet_sym.results import NamedMoments, Provenance, coordinates, freeze, provenance_line
from cadet_sym.tables import Shown, aligned, html, plain
from cadet_sym.warning import warn

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["StationaryMoments", "StationarySolutions", "StationarySweep", "search_along"]


@dataclass(frozen=True, eq=False, repr=False)
class StationaryMoments(Shown, NamedMoments):
    """One fixed point of the moment equations: mean and covariance that stay as they are."""

    model: str
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    state_mean: np.ndarray  # (n,), NaN for a state that drifts
    state_covariance: np.ndarray  # (n, n), NaN in the rows and columns of a state that drifts; symmetric
    output_mean: np.ndarray  # (m,), NaN for an output that drifts
    output_variance: np.ndarray  # (m,)
    stable: bool  # as a fixed point of the whole moment system, delayed wheels included
    residual: float  # the largest of the moment equations over the size of their own terms
    eigenvalues: np.ndarray  # (n,) complex, of N = E[df/dx]
    drifting: tuple[str, ...]  # states and outputs without a stationary mean and variance
    path: tuple[str, ...]  # how it was found, a line a step
    provenance: Provenance

    def __post_init__(self) -> None:
        self.seal()

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym stationary --json`` prints for this one solution."""
        return StationarySolutions((self,)).to_dict()

    def to_xarray(self) -> xr.Dataset:
        """The solution as a data set with dimensions state, state_2, output."""
        return StationarySolutions((self,)).to_xarray().isel(solution=0)

    def save(self, path: str | Path) -> Path:
        """Write .nc, .csv or .mat, by the suffix; see `MomentHistory.save`."""
        return StationarySolutions((self,)).save(path)

    def solution(self) -> dict[str, Any]:
        """One entry of the list of solutions in JSON."""
        outputs = {name: {"mean": plain(self.mean[name]), "variance": plain(self.variance[name])} for name in self.outputs}
        return {
            "mean": plain(self.state_mean),
            "covariance": plain(self.state_covariance),
            "stable": bool(self.stable),
            "residual": plain(np.float64(self.residual)),
            "outputs": outputs,
        }

    def __str__(self) -> str:
        title = f"Stationary moments of {self.model}: {self.judgement}"
        lines = aligned(["", "mean", "variance", "std"], self._rows())
        drift = [f"drifting, without stationary moments: {', '.join(self.drifting)}"] if self.drifting else []
        return "\n".join([title, *lines, *drift, provenance_line(self.provenance)])

    @property
    def judgement(self) -> str:
        """Stability and residual in words."""
        return f"{'stable' if self.stable else 'unstable'}, residual {self.residual:.1e}"

    def _rows(self) -> list[list[str]]:
        return [
            [name, *(f"{moment[name]:.6g}" for moment in (self.mean, self.variance, self.std))]
            for name in (*self.outputs, *self.states)
            if name not in self.drifting
        ]

    def _repr_html_(self) -> str:
        title = f"Stationary moments of {self.model}, {self.judgement}"
        return html(title, ["", "mean", "variance", "std"], self._rows(), provenance_line(self.provenance))


@dataclass(frozen=True, eq=False, repr=False)
class StationarySolutions(Shown, Sequence[StationaryMoments]):
    """The stationary solutions found at one setting of the parameters, stable ones first."""

    solutions: tuple[StationaryMoments, ...]

    def __getitem__(self, index: Any) -> Any:
        return self.solutions[index]

    def __len__(self) -> int:
        return len(self.solutions)

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym stationary --json`` prints."""
        first = self.solutions[0]
        return {
            "model": first.model,
            "states": list(first.states),
            "drifting": list(first.drifting),
            "solutions": [each.solution() for each in self.solutions],
        }

    def to_xarray(self) -> xr.Dataset:
        """The solutions as a data set with dimensions solution, state, state_2, output."""
        return _stationary_set(self.solutions)

    def save(self, path: str | Path) -> Path:
        """Write .nc, .csv (a row a solution) or .mat, by the suffix; see `MomentHistory.save`."""
        return save_as(path, self.to_xarray, lambda: _stationary_columns(self.solutions))

    def __str__(self) -> str:
        return "\n\n".join(str(each) for each in self.solutions)

    def _repr_html_(self) -> str:
        return "".join(each._repr_html_() for each in self.solutions)


@dataclass(frozen=True, eq=False, repr=False)
class StationarySweep(Shown):
    """Stationary solutions along the values of one parameter; where none was found, an empty list."""

    model: str
    parameter: str
    values: np.ndarray  # (l,)
    solutions: tuple[tuple[StationaryMoments, ...], ...]  # one tuple a value
    failures: Mapping[float, str]  # value: why there is no solution

    def __post_init__(self) -> None:
        freeze(self, "values", (len(self.solutions),))

    def __str__(self) -> str:
        title = f"Stationary moments of {self.model} for {self.parameter} from {self.values[0]:g} to {self.values[-1]:g}"
        rows, names = [], (self.found[0].outputs or self.found[0].states)[:3] if self.found else ()
        for value, each in zip(self.values_found, self.found, strict=True):
            numbers = (f"{each.std[name]:.6g}" for name in names)
            rows.append([f"{value:g}", each.judgement.partition(",")[0], *numbers])
        header = [self.parameter, "", *(f"std {name}" for name in names)]
        return "\n".join([title, *aligned(header, rows), *(f"{value:g}: {text}" for value, text in self.failures.items())])

    @property
    def found(self) -> tuple[StationaryMoments, ...]:
        """All solutions, in the order of the values."""
        return tuple(each for row in self.solutions for each in row)

    @property
    def values_found(self) -> np.ndarray:
        """The parameter's value of each of `found`."""
        return np.repeat(self.values, [len(row) for row in self.solutions])

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym stationary --sweep --json`` prints."""
        found = self.found
        return {
            "model": self.model,
            "states": list(found[0].states) if found else [],
            "drifting": sorted({name for each in found for name in each.drifting}),
            "parameter": self.parameter,
            "values": plain(self.values),
            "solutions": [[each.solution() for each in row] for row in self.solutions],
        }

    def to_xarray(self) -> xr.Dataset:
        """All solutions along one dimension, with the parameter's value as a coordinate."""
        dataset = _stationary_set(self.found).assign_coords({self.parameter: ("solution", self.values_found)})
        dataset.attrs.pop(f"parameter {self.parameter}", None)
        return dataset

    def save(self, path: str | Path) -> Path:
        """Write .nc, .csv (a row a solution) or .mat, by the suffix; see `MomentHistory.save`."""
        return save_as(
            path,
            self.to_xarray,
            lambda: {self.parameter: self.values_found, **_stationary_columns(self.found)},
        )


def search_along(
    search: Callable[..., StationarySolutions], parameter: str, values: np.ndarray, passed: Iterable[float]
) -> StationarySweep:
    """Search at every value (l,), each from where the one before ended; where there is no solution, a place stays empty.

    Parameters
    ----------
    search : with `parameters`, their values by name, and `start`, a solution near by or None.
    passed : the same values, by one who tells how far it came.

    Raises
    ------
    SolverError
        If there is none at any value.
    """
    rows, failures = [], {}
    last = None
    for value in passed:
        try:
            rows.append(tuple(search(parameters={parameter: value}, start=last)))
            last = rows[-1][0]
        except SolverError as error:
            failures[value] = str(error)
            rows.append(())
    if not any(rows):
        raise SolverError(f"no stationary solution at any value of {parameter}: {failures[float(values[0])]}")
    for value, reason in failures.items():
        warn(UserWarning(f"{parameter} = {value:g}: {reason}"))
    model = next(row[0].model for row in rows if row)
    return StationarySweep(model, parameter, values, tuple(rows), failures)


def _stationary_set(solutions: Sequence[StationaryMoments]) -> xr.Dataset:
    import xarray as xr

    first = solutions[0]
    return xr.Dataset(
        {
            "mean": (("solution", "state"), np.stack([each.state_mean for each in solutions])),
            "covariance": (
                ("solution", "state", "state_2"),
                np.stack([each.state_covariance for each in solutions]),
            ),
            "output_mean": (("solution", "output"), np.stack([each.output_mean for each in solutions])),
            "output_variance": (
                ("solution", "output"),
                np.stack([each.output_variance for each in solutions]),
            ),
            "stable": ("solution", np.array([each.stable for each in solutions])),
            "residual": ("solution", np.array([each.residual for each in solutions])),
        },
        coords=coordinates(first.states, first.outputs),
        attrs={"model": first.model, "drifting": " ".join(first.drifting), **first.provenance.attributes()},
    )


def _stationary_columns(solutions: Sequence[StationaryMoments]) -> dict[str, np.ndarray]:
    columns = {
        "stable": np.array([int(each.stable) for each in solutions]),
        "residual": np.array([each.residual for each in solutions]),
    }
    tables = [each.columns() for each in solutions]
    return columns | {name: np.array([table[name] for table in tables]) for name in tables[0]}
