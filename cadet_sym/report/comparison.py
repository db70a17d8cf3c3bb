"""Set the moments by CADET against those by simulation: how far apart, and how sure is that.

    discrepancy of a variance   100 (P - S) / S           percent of the simulated variance
    discrepancy of a mean       100 (m - M) / sqrt(S)     percent of the simulated standard deviation

Both carry 99 % limits from the simulation's own sampling error; its step error is stated beside them. The hypothesis
itself, that what enters every nonlinearity is Gaussian, is checked by the skewness and kurtosis of the inputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cadet_sym.errors import ModelError
from cadet_sym.results import MomentHistory
from cadet_sym.tables import Shown, plain

if TYPE_CHECKING:
    from rich.table import Table

    from cadet_sym.simulation import Ensemble
    from cadet_sym.simulation.ensemble import InputShape

__all__ = ["Comparison", "Verdict", "compare"]


@dataclass(frozen=True)
class Verdict:
    """One state or output at the end of the run: discrepancies in percent, negative where CADET is low."""

    name: str
    discrepancy: float  # of the variance; NaN where the simulated one is zero
    limit: float  # its 99 % half-width
    mean_discrepancy: float  # of the mean, in percent of a standard deviation
    mean_limit: float
    step_error: float  # of the simulated variance, in percent
    skewness: float
    excess_kurtosis: float
    worst: tuple[float, float, float] | None = None  # discrepancy of the variance, limit and time, where it is surest
    inputs: str = ""  # what is to be said of the inputs of the elements

    @property
    def agrees(self) -> bool:
        """Neither mean nor variance can be told from the simulated one."""
        return not (abs(self.discrepancy) > self.limit or abs(self.mean_discrepancy) > self.mean_limit)

    @property
    def of_variance(self) -> str:
        """What is said of the variance: 'variance of closure is 6.1 ± 0.2 % low'."""
        return f"variance of {self.name} {_judged(self.discrepancy, self.limit, '%')}"

    @property
    def text(self) -> str:
        """The verdict in one sentence."""
        if math.isnan(self.discrepancy):
            return f"{self.name} does not vary at the end of the run, so there is nothing to compare."
        mean = _judged(self.mean_discrepancy, self.mean_limit, "% of a standard deviation")
        parts = [f"V{self.of_variance[1:]} at the end of the run{self._over_the_run}, its mean {mean}", self.inputs]
        return "; ".join(filter(None, parts)) + "."

    @property
    def _over_the_run(self) -> str:
        """' (6.6 ± 0.3 % low at t = 8.2)' where it is larger before the end, and beyond the luck of many times."""
        if self.worst is None or abs(self.worst[0]) <= max(SURE * self.worst[1], abs(self.discrepancy)):
            return ""
        number, half = rounded(abs(self.worst[0]), self.worst[1])
        return f" ({number} ± {half} % {_low_or_high(self.worst[0])} at t = {self.worst[2]:.4g})"

    def to_dict(self) -> dict[str, Any]:
        """The verdict as plain numbers and text."""
        return {
            "discrepancy": plain(self.discrepancy),
            "limit": plain(self.limit),
            "mean_discrepancy": plain(self.mean_discrepancy),
            "mean_limit": plain(self.mean_limit),
            "step_error": plain(self.step_error),
            "worst": None if self.worst is None else dict(zip(("discrepancy", "limit", "time"), self.worst, strict=True)),
            "skewness": plain(self.skewness),
            "excess_kurtosis": plain(self.excess_kurtosis),
            "text": self.text,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """Moments by CADET and by simulation of the same model at the same times."""

    history: MomentHistory
    simulation: Ensemble

    @property
    def names(self) -> tuple[str, ...]:
        """Outputs first, then states: the order of the tables."""
        return (*self.history.outputs, *self.history.states)

    @cached_property
    def verdict(self) -> Mapping[str, Verdict]:
        """Every output and state judged at the end of the run."""
        return {
            name: replace(self.at(name, -1), worst=self.worst(name), inputs=self.of_inputs) for name in self.names
        }

    def discrepancy(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Over the run: 100 (P - S)/S of a variance and its limits, (k,) each; NaN where S is zero, or round-off and P too."""
        P, S = np.asarray(self.history.variance[name]), np.asarray(self.simulation.variance[name])
        limit = np.asarray(self.simulation.limit("variance")[name])
        square = S.max() + np.square(np.asarray(self.simulation.mean[name])).max()
        there = (S > 0.0) & ((ROUND_OFF * square < S) | (KNOWN * square < P))
        with np.errstate(divide="ignore", invalid="ignore"):
            # (P - S)/S = P/S - 1: the error of S counts P/S times.
            return np.where(there, 100.0 * (P - S) / S, np.nan), np.where(there, 100.0 * limit / S * (P / S), np.nan)

    def worst(self, name: str) -> tuple[float, float, float] | None:
        """The discrepancy of a variance, its limit and time, where it exceeds its limit most."""
        found, limit = self.discrepancy(name)
        sure = np.abs(found) - limit
        if np.isnan(sure).all():
            return None
        k = int(np.nanargmax(sure))
        return float(found[k]), float(limit[k]), float(self.history.time[k])

    @property
    def of_inputs(self) -> str:
        """Of the elements' inputs the one that is least Gaussian at the end of the run: 'the oleo's input is skewed -0.19'."""
        inputs = self.simulation.inputs
        if not inputs:
            return ""
        text = max(inputs, key=lambda each: _unlike_gaussian(inputs[each]))
        shape = inputs[text]
        skewness, kurtosis = float(shape.skewness[-1]), float(shape.excess_kurtosis[-1])
        if math.isnan(skewness) or math.isnan(kurtosis):
            return ""
        owner = f"the {shape.elements[0]}'s input" if len(inputs) == 1 and shape.elements else _entering(text, shape.elements)
        return f"{owner} is skewed {skewness:+.2f}, its excess kurtosis {kurtosis:+.2f}"

    def at(self, name: str, at: int) -> Verdict:
        """Judge one output or state at the time numbered ``at``."""
        simulated = {
            moment: float(getattr(self.simulation, moment)[name][at])
            for moment in ("mean", "variance", "variance_step_error", "skewness", "excess_kurtosis")
        }
        limit = {moment: float(self.simulation.limit(moment)[name][at]) for moment in ("mean", "variance")}
        mean = float(self.history.mean[name][at])
        true = simulated["variance"]
        discrepancy, of_discrepancy = (float(each[at]) for each in self.discrepancy(name))
        varies = not math.isnan(discrepancy)
        percent = 100.0 / true if varies else math.nan
        percent_of_std = 100.0 / math.sqrt(true) if varies else math.nan
        return Verdict(
            name,
            discrepancy=discrepancy,
            limit=of_discrepancy,
            mean_discrepancy=percent_of_std * (mean - simulated["mean"]),
            mean_limit=percent_of_std * limit["mean"],
            step_error=percent * simulated["variance_step_error"],
            skewness=simulated["skewness"],
            excess_kurtosis=simulated["excess_kurtosis"],
        )

    @property
    def of_states(self) -> str:
        """How many states agree, and which does least, in one sentence."""
        verdicts = [self.verdict[name] for name in self.history.states]
        judged = [verdict for verdict in verdicts if not math.isnan(verdict.discrepancy)]
        agreeing = [verdict for verdict in judged if verdict.agrees]
        if len(agreeing) == len(judged):
            return "Every state that varies agrees with the simulation within its limits."
        worst = max(judged, key=lambda verdict: abs(verdict.discrepancy) - verdict.limit)
        return f"Of {len(judged)} states that vary {len(agreeing)} agree within the limits; {worst.of_variance}."

    def table(self, names: Sequence[str] = (), rows: int = 6) -> Table:
        """CADET against simulation with 99 % limits, at ``rows`` times: a table for the terminal."""
        from cadet_sym.report.terminal import comparison_table

        return comparison_table(self, names or self.history.outputs or self.history.states, rows)

    def plot(self, path: str | Path, names: Sequence[str] = ()) -> Path:
        """Draw both and write .png, .pdf or .svg."""
        from cadet_sym.plotting import moments_figure, save_figure

        return save_figure(moments_figure(self.history, self.simulation, names), path)

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym validate --json`` prints."""
        history, simulation = self.history, self.simulation
        return {
            "model": history.model,
            "states": list(history.states),
            "time": plain(history.time),
            "paths": int(simulation.paths),
            "cadet": {"mean": plain(history.mean.values), "variance": plain(history.variance.values)},
            "monte_carlo": {moment: plain(getattr(simulation, moment).values) for moment in SIMULATED},
            "outputs": {
                name: {
                    "cadet": {"mean": plain(history.mean[name]), "variance": plain(history.variance[name])},
                    "monte_carlo": {moment: plain(getattr(simulation, moment)[name]) for moment in SIMULATED},
                }
                for name in history.outputs
            },
            "verdict": {name: verdict.to_dict() for name, verdict in self.verdict.items()},
            "inputs": {text: _shape_dict(shape) for text, shape in simulation.inputs.items()},
            "method": simulation.method,
            "notes": list(simulation.notes),
        }

    def __str__(self) -> str:
        return "\n".join(verdict.text for verdict in self.verdict.values())


ROUND_OFF = 1e-24  # of an output's largest square: the variance left by its terms where they cancel, 0 at any path
KNOWN = 1e-9  # of the same: what E[y^2] - E[y]^2 leaves of a variance that is zero, either known to 1e-10
EXACT = 1e-10  # of a value: a limit that is rounding
SURE = 1.5  # limits: the largest of many discrepancies is beyond one of them by chance
SHORTEST, LONGEST = -4, 8  # powers of ten that are written out
SIMULATED = ("mean", "variance", "mean_standard_error", "variance_standard_error")


def compare(history: MomentHistory, simulation: Ensemble) -> Comparison:
    """Set a history against a simulation of the same model at the same times.

    Raises
    ------
    ModelError
        They are of different states and outputs, or at different times.
    """
    if (history.states, history.outputs) != (simulation.states, simulation.outputs):
        raise ModelError(
            f"compare: the history has {_listed(history)}, the simulation {_listed(simulation)}; "
            "simulate and propagate the same model"
        )
    ours, theirs = np.asarray(history.time), np.asarray(simulation.time)
    if ours.shape != theirs.shape or not np.allclose(ours, theirs, rtol=1e-9, atol=1e-12):
        raise ModelError(
            f"compare: the history has {len(ours)} times from {ours[0]:g} to {ours[-1]:g}, the simulation "
            f"{len(theirs)} from {theirs[0]:g} to {theirs[-1]:g}; use `propagate(times=simulation.time)`"
        )
    return Comparison(history, simulation)


def _listed(record: Any) -> str:
    return f"states {', '.join(record.states)} and outputs {', '.join(record.outputs) or 'none'}"


def _judged(discrepancy: float, limit: float, unit: str) -> str:
    """'is 6.1 ± 0.2 % low' or 'agrees within 3 %'."""
    number, half = rounded(abs(discrepancy), limit)
    if abs(discrepancy) <= limit:
        sign = "" if float(number) == 0.0 else "-" if discrepancy < 0 else "+"
        return f"agrees ({sign}{number} ± {half} {unit})"
    return f"is {number} ± {half} {unit} {_low_or_high(discrepancy)}"


def _low_or_high(discrepancy: float) -> str:
    return "low" if discrepancy < 0 else "high"


def _unlike_gaussian(shape: InputShape) -> float:
    """How far an input is from Gaussian at the end of the run, in the order of the Edgeworth series."""
    away = abs(float(shape.skewness[-1])) / 6.0 + abs(float(shape.excess_kurtosis[-1])) / 24.0
    return -1.0 if math.isnan(away) else away


def _entering(text: str, elements: Sequence[str]) -> str:
    """'stroke_1, an input of damper,'."""
    return f"{text}, which enters {', '.join(elements)}," if elements else f"{text}, which enters a nonlinearity,"


def _shape_dict(shape: InputShape) -> dict[str, Any]:
    return {
        "elements": list(shape.elements),
        "skewness": plain(shape.skewness),
        "excess_kurtosis": plain(shape.excess_kurtosis),
    }


def rounded(value: float, limit: float) -> tuple[str, str]:
    """A value and its limit, both to the first digit of the limit (to the second if the first is a 1); rounding is no limit."""
    if not (math.isfinite(limit) and limit > EXACT * abs(value)):
        return f"{value:.6g}", f"{limit:.2g}"
    first = math.floor(math.log10(limit))
    places = -first + (1 if limit / 10.0**first < 1.95 else 0)
    power = math.floor(math.log10(max(abs(value), limit)))
    if not SHORTEST <= power <= LONGEST:
        places = max(places + power, 0)
        return f"{value / 10.0**power:.{places}f}e{power:+03d}", f"{limit / 10.0**power:.{places}f}e{power:+03d}"
    return f"{value:.{max(places, 0)}f}", f"{limit:.{max(places, 0)}f}"
