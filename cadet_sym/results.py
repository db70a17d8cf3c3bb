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
from cadet_sym.tables import Shown, aligned, html, plain

if TYPE_CHECKING:
    import numpy.typing as npt
    import xarray as xr

__all__ = [
    "MomentHistory",
    "NamedMoments",
    "PeriodicMoments",
    "Provenance",
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


@dataclass(frozen=True, eq=False, repr=False)
class MomentHistory(Shown, NamedMoments):
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


@dataclass(frozen=True, eq=False, repr=False)
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
