"""What a run gives: moments with names, how they were obtained, and the ways to take them elsewhere.

Shapes: k times, n augmented states (the vehicle's as declared, then the ground filters'), m outputs.
Arrays are read-only; a value that does not exist is NaN here and ``null`` in JSON.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cadet_sym.errors import ModelError
from cadet_sym.files import save_as
from cadet_sym.labelled import Labelled, LabelledCovariance
from cadet_sym.tables import aligned, html, plain

if TYPE_CHECKING:
    import numpy.typing as npt
    import xarray as xr

__all__ = [
    "MomentHistory",
    "NamedMoments",
    "PeriodicMoments",
    "Provenance",
    "StationaryMoments",
    "StationarySolutions",
    "StationarySweep",
    "coordinates",
    "freeze",
    "provenance_line",
]


@dataclass(frozen=True)
class Provenance:
    """How a result was obtained."""

    engine: str  # the integrator or rootfinder, by its name in the literature
    rtol: float  # relative tolerance asked for; 0 where there was none to ask
    statistics: Mapping[str, float] = field(default_factory=dict)  # steps, evaluations, seconds, ...
    parameters: Mapping[str, float] = field(default_factory=dict)  # the values used
    model_hash: str = ""
    version: str = ""  # of cadet-sym

    def attributes(self) -> dict[str, Any]:
        """The same as flat attributes of a file: text and numbers only."""
        return {
            "engine": self.engine,
            "rtol": self.rtol,
            "model_hash": self.model_hash,
            "cadet_sym_version": self.version,
            "units": "SI unless the model declares others",
            **{f"parameter {name}": float(value) for name, value in self.parameters.items()},
            **{f"statistic {name}": float(value) for name, value in self.statistics.items()},
        }


class NamedMoments:
    """Names for the moments of one record: what a history, a stationary solution and a branch share."""

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    state_mean: np.ndarray
    state_covariance: np.ndarray
    output_mean: np.ndarray
    output_variance: np.ndarray

    @property
    def mean(self) -> Labelled:
        """Means of states and outputs, by name; the array (..., n) of the states by ``.values``."""
        return Labelled(self.states, self.state_mean, self.outputs, self.output_mean)

    @property
    def variance(self) -> Labelled:
        """Variances of states and outputs, by name."""
        diagonal = np.diagonal(self.state_covariance, axis1=-2, axis2=-1)
        return Labelled(self.states, diagonal, self.outputs, self.output_variance)

    @property
    def std(self) -> Labelled:
        """Standard deviations of states and outputs, by name; rounding below zero counts as zero."""
        variance = self.variance
        roots = [np.sqrt(np.maximum(part, 0.0)) for part in (variance.values, variance.outputs)]
        return Labelled(self.states, roots[0], self.outputs, roots[1])

    @property
    def covariance(self) -> LabelledCovariance:
        """Zero-lag covariances of states by pairs of names, and variances of outputs."""
        return LabelledCovariance(self.states, self.state_covariance, self.outputs, self.output_variance)

    def seal(self, *leading: int) -> None:
        """Take the arrays as they are to stay: floats, of the shape that the names say, read-only."""
        n, m = len(self.states), len(self.outputs)
        shapes = {
            "state_mean": (n,),
            "state_covariance": (n, n),
            "output_mean": (m,),
            "output_variance": (m,),
        }
        for name, shape in shapes.items():
            freeze(self, name, (*leading, *shape))

    def columns(self) -> dict[str, np.ndarray]:
        """Every moment once, by a name a spreadsheet can show."""
        n = len(self.states)
        columns = {f"mean {name}": self.mean[name] for name in (*self.states, *self.outputs)}
        for i, row in enumerate(self.states):
            for j in range(i, n):
                title = f"variance {row}" if i == j else f"covariance {row} {self.states[j]}"
                columns[title] = self.state_covariance[..., i, j]
        return columns | {f"variance {name}": self.variance[name] for name in self.outputs}


@dataclass(frozen=True, eq=False)
class MomentHistory(NamedMoments):
    """Mean and zero-lag covariance of every state, mean and variance of every output, against time."""

    model: str
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    time: np.ndarray  # (k,)
    state_mean: np.ndarray  # (k, n)
    state_covariance: np.ndarray  # (k, n, n), products of the states' units; symmetric
    output_mean: np.ndarray  # (k, m)
    output_variance: np.ndarray  # (k, m)
    provenance: Provenance
    derivatives: Callable[..., np.ndarray] | None = field(default=None, repr=False)  # of the model it came from

    def __post_init__(self) -> None:
        freeze(self, "time", (len(self.time),))
        self.seal(len(self.time))

    def __getstate__(self) -> dict[str, Any]:
        """The numbers alone: a history that is sent to another process leaves its model behind."""
        return {**self.__dict__, "derivatives": None}

    def gradient(
        self,
        name: str | tuple[str, str],
        parameters: Sequence[str] | None = None,
        times: npt.ArrayLike | None = None,
        *,
        initial: Sequence[str | tuple[str, str]] = (),
        moment: str = "variance",
        method: str = "auto",
    ) -> np.ndarray:
        """Derivatives (k, c) of a mean or variance at the history's times, or at others.

        Parameters
        ----------
        name : a state, an output, or a pair of states (their covariance).
        parameters : names; by default all that have a number of their own, in the order of the provenance's.
        initial : states, whose mean at the start, and pairs of states, whose covariance at the start adds a column each.
        moment : "variance" or "mean".
        method : "forward", "adjoint" or "auto"; see `CompiledModel.gradient`.

        Raises
        ------
        ModelError
            Unknown names, or a history that came from another process without its model.
        SolverError
            If the derivatives break down, or do not exist.
        """
        if self.derivatives is None:
            raise ModelError("this history came without its model; use `gradient` of the compiled model.")
        at = self.time if times is None else times
        values = self.provenance.parameters
        return self.derivatives(name, parameters, at, initial=initial, moment=moment, method=method, values=values)

    def to_dict(self) -> dict[str, Any]:
        """The history as plain lists and numbers: what ``cadet-sym moments --json`` prints."""
        outputs = {
            name: {"mean": plain(self.mean[name]), "variance": plain(self.variance[name])}
            for name in self.outputs
        }
        return {
            "model": self.model,
            "states": list(self.states),
            "time": plain(self.time),
            "mean": plain(self.state_mean),
            "covariance": plain(self.state_covariance),
            "outputs": outputs,
        }

    def to_xarray(self) -> xr.Dataset:
        """The history as a data set with dimensions time, state, state_2, output."""
        import xarray as xr

        return xr.Dataset(
            {
                "mean": (("time", "state"), self.state_mean),
                "covariance": (("time", "state", "state_2"), self.state_covariance),
                "output_mean": (("time", "output"), self.output_mean),
                "output_variance": (("time", "output"), self.output_variance),
            },
            coords=coordinates(self.states, self.outputs) | {"time": ("time", self.time, {"units": "s"})},
            attrs={"model": self.model, **self.provenance.attributes()},
        )

    def save(self, path: str | Path) -> Path:
        """Write .nc (netCDF), .csv (a column a moment) or .mat, by the suffix; whole or not at all.

        Raises
        ------
        ModelError
            Unknown suffix.
        ExportError
            A folder that cannot be written to.
        """
        return save_as(path, self.to_xarray, lambda: {"time": self.time, **self.columns()})

    def __str__(self) -> str:
        k = len(self.time)
        span = f"{self.time[0]:g} to {self.time[-1]:g}" if k else "no times"
        title = f"Moments of {self.model}: {k} times, {span}"
        if not k:
            return title
        header = [f"t = {self.time[-1]:g}", "mean", "variance", "std"]
        return "\n".join([title, *aligned(header, self._last_rows()), provenance_line(self.provenance)])

    def _last_rows(self) -> list[list[str]]:
        names = (*self.outputs, *self.states)
        return [
            [name, *(f"{moment[name][-1]:.6g}" for moment in (self.mean, self.variance, self.std))]
            for name in names
        ]

    def _repr_html_(self) -> str:
        title = f"Moments of {self.model}, at the end of {len(self.time)} times"
        rows = self._last_rows() if len(self.time) else []
        return html(title, ["", "mean", "variance", "std"], rows, provenance_line(self.provenance))


@dataclass(frozen=True, eq=False)
class PeriodicMoments(MomentHistory):
    """One period of moments that repeat, from t = 0 on."""

    _: KW_ONLY
    period: float
    stable: bool  # whether the moments return to the cycle from near by
    multipliers: np.ndarray  # complex Floquet multipliers of the moment equations, the largest first
    residual: float  # by how much a period changes the moments, over their sizes

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym moments --period --json`` prints."""
        largest = plain(np.abs(self.multipliers[0]))
        more = {"period": self.period, "stable": self.stable, "largest_multiplier": largest, "residual": self.residual}
        return super().to_dict() | more

    def to_xarray(self) -> xr.Dataset:
        """The period as a data set; see `MomentHistory.to_xarray`."""
        more = {"period": self.period, "stable": int(self.stable), "largest multiplier": abs(self.multipliers[0])}
        return super().to_xarray().assign_attrs(more)

    def __str__(self) -> str:
        largest = abs(self.multipliers[0])
        state = f"{'stable' if self.stable else 'unstable'}, largest Floquet multiplier {largest:.4g}"
        return f"{super().__str__()}\none period of {self.period:g}; {state}"


@dataclass(frozen=True, eq=False)
class StationaryMoments(NamedMoments):
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
        outputs = {
            name: {"mean": plain(self.mean[name]), "variance": plain(self.variance[name])}
            for name in self.outputs
        }
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


@dataclass(frozen=True, eq=False)
class StationarySolutions(Sequence[StationaryMoments]):
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


@dataclass(frozen=True, eq=False)
class StationarySweep:
    """Stationary solutions along the values of one parameter; where none was found, an empty list."""

    model: str
    parameter: str
    values: np.ndarray  # (l,)
    solutions: tuple[tuple[StationaryMoments, ...], ...]  # one tuple a value
    failures: Mapping[float, str]  # value: why there is no solution

    def __post_init__(self) -> None:
        freeze(self, "values", (len(self.solutions),))

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


def coordinates(states: Sequence[str], outputs: Sequence[str]) -> dict[str, Any]:
    """Coordinates of a data set with dimensions state, state_2 and output."""
    names = np.array(states, dtype=str), np.array(outputs, dtype=str)
    return {"state": names[0], "state_2": names[0], "output": names[1]}


def freeze(record: Any, name: str, shape: tuple[int, ...]) -> None:
    """Make an array of a record floats of the shape asked for, read-only: a copy, unless it can be written by nobody."""
    array = getattr(record, name)
    if not isinstance(array, np.ndarray) or array.dtype != np.float64 or array.flags.writeable or array.base is not None:
        array = np.array(array, dtype=float)
    if array.shape != shape:
        kind = type(record).__name__
        raise ValueError(f"{name} of {kind} has shape {array.shape}; its names ask for {shape}")
    array.setflags(write=False)
    object.__setattr__(record, name, array)


def provenance_line(provenance: Provenance) -> str:
    """How a result was obtained, on one line."""
    parts = [provenance.engine]
    if provenance.rtol > 0.0:
        parts.append(f"rtol {provenance.rtol:g}".replace("e-0", "e-"))
    if "seconds" in provenance.statistics:
        parts.append(f"{provenance.statistics['seconds']:.3g} s")
    return ", ".join(parts)
