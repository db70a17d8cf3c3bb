"""What an optimisation gives: the best parameters with their moments, or the curve of what one statistic costs another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cadet_sym.files import save_as
from cadet_sym.solutions import StationaryMoments
from cadet_sym.tables import Shown, aligned, plain

__all__ = ["ConstraintState", "Optimum", "TradeOff"]


@dataclass(frozen=True)
class ConstraintState:
    """A constraint at the optimum."""

    text: str
    excess: float  # how far it is violated; negative where there is room
    multiplier: float  # decrease of the objective for a unit by which the constraint gives way

    @property
    def active(self) -> bool:
        """Whether it holds the optimum back."""
        return self.multiplier != 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(Shown):
    """The best parameters found, and the stationary moments with them."""

    minimise: str
    objective: float
    parameters: Mapping[str, float]  # those that were free
    bounds: Mapping[str, tuple[float, float]]
    bound_multipliers: Mapping[str, float]  # positive at the upper bound, negative at the lower one
    constraints: tuple[ConstraintState, ...]
    moments: StationaryMoments
    stationarity: float  # what the multipliers leave of the scaled gradient
    iterations: int
    evaluations: int  # stationary states solved for
    others: tuple[tuple[float, Mapping[str, float]], ...]  # further local optima from other starts, best first
    message: str

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym optimise --json`` prints."""
        return {
            "model": self.moments.model,
            "minimise": self.minimise,
            "objective": plain(self.objective),
            "parameters": dict(self.parameters),
            "bound_multipliers": dict(self.bound_multipliers),
            "constraints": [
                {"text": each.text, "excess": plain(each.excess), "multiplier": plain(each.multiplier)}
                for each in self.constraints
            ],
            "stationarity": plain(self.stationarity),
            "iterations": self.iterations,
            "evaluations": self.evaluations,
            "others": [{"objective": value, "parameters": dict(where)} for value, where in self.others],
            "message": self.message,
            **{key: value for key, value in self.moments.to_dict().items() if key != "model"},
        }

    def save(self, path: str | Path) -> Path:
        """Write the moments at the optimum as .nc, .csv or .mat; the parameters are among the attributes."""
        return self.moments.save(path)

    def __str__(self) -> str:
        rows = [
            [name, f"{value:.9g}", "at its bound" if self.bound_multipliers[name] else ""]
            for name, value in self.parameters.items()
        ]
        lines = [f"{self.moments.model}: least {self.minimise} = {self.objective:.9g}", *aligned(["", "", ""], rows)[1:]]
        for each in self.constraints:
            state = f"active, multiplier {each.multiplier:.6g}" if each.active else f"room {-each.excess:.6g}"
            lines.append(f"{each.text}: {state}")
        for value, where in self.others:
            place = ", ".join(f"{name} = {number:.6g}" for name, number in where.items())
            lines.append(f"another local optimum: {value:.9g} at {place}")
        return "\n".join([*lines, self.message])


@dataclass(frozen=True, eq=False, repr=False)
class TradeOff(Shown):
    """The least of one statistic for each limit on another."""

    minimise: str
    against: str
    limits: np.ndarray  # (k,)
    optima: tuple[Optimum | None, ...]  # None where no parameters satisfy the limit
    failures: Mapping[float, str]  # limit: why there is none

    @property
    def objective(self) -> np.ndarray:
        """The least value at each limit, (k,); NaN where there is none."""
        return np.array([np.nan if each is None else each.objective for each in self.optima])

    def parameter(self, name: str) -> np.ndarray:
        """The best value of a parameter at each limit, (k,); NaN where there is none."""
        return np.array([np.nan if each is None else each.parameters[name] for each in self.optima])

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that were free."""
        return next((tuple(each.parameters) for each in self.optima if each is not None), ())

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym optimise --against --json`` prints."""
        return {
            "minimise": self.minimise,
            "against": self.against,
            "limits": plain(self.limits),
            "objective": plain(self.objective),
            "parameters": {name: plain(self.parameter(name)) for name in self.names},
            "failures": [{"limit": limit, "text": text} for limit, text in self.failures.items()],
        }

    def columns(self) -> dict[str, np.ndarray]:
        """Limit, objective and parameters, a row a limit."""
        return {"limit": self.limits, "objective": self.objective, **{n: self.parameter(n) for n in self.names}}

    def to_xarray(self) -> Any:
        """The curve as a data set along the limit."""
        import xarray as xr

        columns = self.columns()
        data = {name: ("limit", values) for name, values in columns.items() if name != "limit"}
        attributes = {"minimise": self.minimise, "against": self.against}
        return xr.Dataset(data, coords={"limit": columns["limit"]}, attrs=attributes)

    def save(self, path: str | Path) -> Path:
        """Write .nc, .csv (a row a limit) or .mat, by the suffix."""
        return save_as(path, self.to_xarray, self.columns)

    def plot(self, path: str | Path) -> Path:
        """Draw the curve, and the parameters along it."""
        from cadet_sym.plotting import save_figure, trade_off_figure

        return save_figure(trade_off_figure(self), path)

    def __str__(self) -> str:
        rows = [[f"{value:.6g}" for value in row] for row in zip(*self.columns().values(), strict=True)]
        header = [f"{self.against} <=", self.minimise, *self.names]
        return "\n".join([*aligned(header, rows), *(f"{limit:g}: {text}" for limit, text in self.failures.items())])
