"""Curves of stationary moments over the range of a parameter: how many there are, where they fold, which are stable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cadet_sym.compiled import CompiledModel, compile
from cadet_sym.errors import ModelError
from cadet_sym.files import save_as
from cadet_sym.language.model import Model
from cadet_sym.results import NamedMoments, Provenance, coordinates, freeze, provenance_line
from cadet_sym.solve.branches import Branch, find_branches, stable_pieces
from cadet_sym.solve.freeze import Conditions, conditions
from cadet_sym.solve.freeze import freeze as hold
from cadet_sym.solve.named import name_moments
from cadet_sym.stationary import rest
from cadet_sym.tables import Shown, aligned, plain

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["SolutionBranch", "SolutionBranches", "branches"]

SPEED = "speed"
"""What the speed held is called where a parameter's name is wanted."""


@dataclass(frozen=True, eq=False)
class SolutionBranch(NamedMoments):
    """One curve of stationary moments, in the order in which it was followed: k points."""

    values: np.ndarray  # (k,) of the parameter
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    state_mean: np.ndarray  # (k, n), NaN for a state that drifts
    state_covariance: np.ndarray  # (k, n, n), NaN in the rows and columns of a state that drifts
    output_mean: np.ndarray  # (k, m)
    output_variance: np.ndarray  # (k, m)
    stable: np.ndarray  # (k,) bool, as fixed points of the moment equations
    growth: np.ndarray  # (k,) largest real part of the moment equations' eigenvalues; NaN where it was not needed
    residual: np.ndarray  # (k,) the largest of the moment equations over the size of their own terms
    folds: tuple[int, ...]  # points at which the curve turns back in the parameter
    end: str  # why it ends where it does

    def __post_init__(self) -> None:
        for name in ("values", "growth", "residual"):
            freeze(self, name, (len(self.values),))
        self.seal(len(self.values))

    def __len__(self) -> int:
        return len(self.values)

    def pieces(self) -> list[tuple[slice, bool]]:
        """Stretches of equal stability, sharing their end points: (points, stable)."""
        return stable_pieces(self.stable)

    def to_dict(self) -> dict[str, Any]:
        """The branch as plain lists and numbers."""
        outputs = {n: {"mean": plain(self.mean[n]), "variance": plain(self.variance[n])} for n in self.outputs}
        return {
            "values": plain(self.values),
            "mean": plain(self.state_mean),
            "covariance": plain(self.state_covariance),
            "outputs": outputs,
            "stable": self.stable.tolist(),
            "growth": plain(self.growth),
            "residual": plain(self.residual),
            "folds": plain(self.values[list(self.folds)]),
            "end": self.end,
        }


@dataclass(frozen=True, eq=False, repr=False)
class SolutionBranches(Shown, Sequence[SolutionBranch]):
    """All curves of stationary moments that were found over the range of one parameter."""

    model: str
    parameter: str
    unit: str
    range: tuple[float, float]
    branches: tuple[SolutionBranch, ...]
    drifting: tuple[str, ...]  # states and outputs without stationary moments
    provenance: Provenance

    def __getitem__(self, index: Any) -> Any:
        return self.branches[index]

    def __len__(self) -> int:
        return len(self.branches)

    @property
    def folds(self) -> np.ndarray:
        """Values of the parameter at which two solutions meet and vanish, ascending."""
        return np.sort([branch.values[i] for branch in self.branches for i in branch.folds])

    def count(self, value: float) -> tuple[int, int]:
        """How many stable and how many unstable solutions there are at a value of the parameter."""
        found = {True: 0, False: 0}
        for branch in self.branches:
            past = branch.values - value
            for i in np.flatnonzero((past[:-1] < 0) != (past[1:] < 0)):
                found[bool(branch.stable[i] if abs(past[i]) < abs(past[i + 1]) else branch.stable[i + 1])] += 1
        return found[True], found[False]

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym stationary --branches --json`` prints."""
        return {
            "model": self.model,
            "states": list(self.branches[0].states),
            "drifting": list(self.drifting),
            "parameter": self.parameter,
            "range": list(self.range),
            "folds": plain(self.folds),
            "branches": [branch.to_dict() for branch in self.branches],
        }

    def to_xarray(self) -> xr.Dataset:
        """All points along one dimension, with the number of their branch and the parameter's value as coordinates."""
        import xarray as xr

        parts = {
            "mean": (("point", "state"), "state_mean"),
            "covariance": (("point", "state", "state_2"), "state_covariance"),
            "output_mean": (("point", "output"), "output_mean"),
            "output_variance": (("point", "output"), "output_variance"),
            "stable": ("point", "stable"),
            "growth": ("point", "growth"),
            "residual": ("point", "residual"),
        }
        data = {title: (where, self._joined(name)) for title, (where, name) in parts.items()}
        fold = np.concatenate([np.isin(np.arange(len(branch)), branch.folds) for branch in self.branches])
        places = {"branch": ("point", self._numbers()), self.parameter: ("point", self._joined("values"))}
        first = self.branches[0]
        attributes = {"model": self.model, "drifting": " ".join(self.drifting), **self.provenance.attributes()}
        attributes.pop(f"parameter {self.parameter}", None)
        return xr.Dataset(
            data | {"fold": ("point", fold)},
            coords=coordinates(first.states, first.outputs) | places,
            attrs=attributes,
        )

    def save(self, path: str | Path) -> Path:
        """Write .nc, .csv (a row a point) or .mat, by the suffix; see `MomentHistory.save`."""
        return save_as(path, self.to_xarray, self._columns)

    def plot(self, path: str | Path, names: Sequence[str] = ()) -> Path:
        """Draw mean and variance of outputs (or states) along the branches: stable solid, unstable dashed, folds marked.

        Raises
        ------
        ModelError
            Unknown suffix.
        ExportError
            A folder that cannot be written to.
        """
        from cadet_sym.plotting import branches_figure, save_figure

        return save_figure(branches_figure(self, names), path)

    def _joined(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(branch, name) for branch in self.branches])

    def _numbers(self) -> np.ndarray:
        return np.repeat(np.arange(len(self.branches)), [len(branch) for branch in self.branches])

    def _columns(self) -> dict[str, np.ndarray]:
        head = {"branch": self._numbers(), self.parameter: self._joined("values")}
        head |= {"stable": self._joined("stable").astype(int), "growth": self._joined("growth")}
        tables = [branch.columns() for branch in self.branches]
        return head | {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}

    def __str__(self) -> str:
        low, high = self.range
        lines = [f"Stationary moments of {self.model} for {self.parameter} from {low:g} to {high:g}"]
        names = [n for n in (self.branches[0].outputs or self.branches[0].states) if n not in self.drifting][:3]
        header = ["branch", "from", "to", "", *(f"variance {name}" for name in names)]
        rows = []
        for number, branch in enumerate(self.branches, 1):
            for points, stable in branch.pieces():
                ends = branch.values[points][[0, -1]]
                spans = ["{:.4g} .. {:.4g}".format(*branch.variance[name][points][[0, -1]]) for name in names]
                rows.append([str(number), *(f"{end:.6g}" for end in ends), "stable" if stable else "unstable", *spans])
        lines += aligned(header, rows)
        folds = ", ".join(f"{fold:.9g}" for fold in self.folds)
        lines.append(f"folds at {self.parameter} = {folds}" if folds else "no folds")
        if self.drifting:
            lines.append(f"drifting, without stationary moments: {', '.join(self.drifting)}")
        return "\n".join([*lines, provenance_line(self.provenance)])


def branches(
    model: Model | CompiledModel | str | Path,
    parameter: str,
    range: tuple[float, float],
    *,
    speed: float | None = None,
    at: float | None = None,
    parameters: Mapping[str, float] | None = None,
) -> SolutionBranches:
    """Follow the stationary moments over the range of a parameter, through the folds where solutions meet and vanish.

    Pseudo-arclength continuation (Keller 1977) from every solution that is found at both ends and in the middle.

    Parameters
    ----------
    model : a model, compiled or not, or the path of a model file.
    parameter : name of a parameter with a number of its own; "speed" for the speed held.
    range : its lowest and highest value.
    speed, at, parameters : what else is held, as for `CompiledModel.stationary`.

    Raises
    ------
    ModelError
        An unknown parameter, a range that is none, or a model about which nothing is stationary.
    SolverError
        If there is no solution at either end nor in the middle.
    """
    compiled = model if isinstance(model, CompiledModel) else compile(model)
    low, high = (float(end) for end in range)
    if not (np.isfinite([low, high]).all() and low < high):
        raise ModelError(f"the range of `{parameter}` is {low:g} to {high:g}; it must be finite and ascending.")
    held = _family(compiled, parameter, speed, at, dict(parameters or {}))
    found = find_branches(
        lambda value: hold(compiled.functions, held(value)),
        (low, high),
        parameter,
        start=rest(compiled.functions, held(low).p),
    )
    known = compiled.model.parameters.get(parameter)
    named = [_named(compiled, branch, held) for branch in found.branches]
    return SolutionBranches(
        model=compiled.declaration.name,
        parameter=parameter,
        unit=known.unit if known is not None else "",
        range=(low, high),
        branches=tuple(branch for branch, _ in named),
        drifting=tuple(dict.fromkeys(name for _, names in named for name in names)),
        provenance=compiled.provenance("pseudo-arclength continuation", 0.0, {}, held(low).p),
    )


def _family(
    compiled: CompiledModel, parameter: str, speed: float | None, at: float | None, fixed: dict[str, float]
) -> Callable[[float], Conditions]:
    """Value of the parameter to what is held there."""
    if parameter == SPEED and SPEED not in compiled.parameters:
        if speed is not None:
            raise ModelError("the speed is what varies along the branches; leave out the one to hold.")
        p = compiled.parameter_vector(fixed)
        return lambda value: conditions(compiled.functions, p, value, at)
    compiled.parameter_vector({**fixed, parameter: 0.0})  # an unknown name
    return lambda value: conditions(
        compiled.functions, compiled.parameter_vector({**fixed, parameter: value}), speed, at
    )


def _named(
    compiled: CompiledModel, branch: Branch, held: Callable[[float], Conditions]
) -> tuple[SolutionBranch, tuple[str, ...]]:
    """A branch with names, and the names of what drifts along it."""
    rows = [
        name_moments(compiled.functions, mean, covariance, branch.drift, held(value))
        for value, mean, covariance in zip(branch.parameter.tolist(), *branch.lifted, strict=True)
    ]
    made = SolutionBranch(
        values=branch.parameter,
        states=compiled.states,
        outputs=compiled.outputs,
        state_mean=np.array([row.state_mean for row in rows]),
        state_covariance=np.array([row.state_covariance for row in rows]),
        output_mean=np.array([row.output_mean for row in rows]),
        output_variance=np.array([row.output_variance for row in rows]),
        stable=branch.stable,
        growth=np.real(branch.rightmost),
        residual=branch.residual,
        folds=branch.folds,
        end=branch.end,
    )
    return made, rows[0].drifting
