"""What is asked of a simulation besides its moments, as tallies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cadet_sym.errors import ModelError
from cadet_sym.simulation.arguments import increasing, places_of
from cadet_sym.simulation.collect import Collected
from cadet_sym.simulation.control import ControlTally, Reference
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.riders import CrossingRider
from cadet_sym.simulation.statistics import Moments
from cadet_sym.simulation.steps import Chosen
from cadet_sym.simulation.tallies import AverageTally, CrossingTally, HistogramTally, Tally

__all__ = ["Demands"]

_REACH = 6.0  # standard deviations either side that a histogram covers if its edges are not given


class Demands:
    """Everything that is counted besides the moments."""

    def __init__(
        self,
        problem: Problem,
        chosen: Chosen,
        crossings: Mapping[str, CrossingRider],
        histograms: Mapping[str, int | Sequence[float] | np.ndarray],
        average_from: float | None,
        look: Callable[[], Reference],
    ):
        """`look` gives what some paths tell, where none were computed to measure the step's error."""
        places = dict(zip(histograms, places_of(list(histograms), problem.names[: problem.asked], "histograms"), strict=True))
        needed = problem.twin is not None or average_from is not None or bool(histograms)
        reference = chosen.reference if chosen.reference is not None else look() if needed else None
        controls: tuple[ControlTally, ...] = ()
        self.histograms: dict[str, HistogramTally] = {}
        self.average: AverageTally | None = None
        if reference is not None:
            controls = reference.controls
            for name, bins in histograms.items():
                self.histograms[name] = HistogramTally(places[name], _edges(name, bins, reference.moments, places[name]))
            if average_from is not None:
                self.average = _average(problem, average_from, reference.moments)
        self.crossings = {
            name: CrossingTally(problem.first_row(rider), rider.levels, problem.times) for name, rider in crossings.items()
        }
        self.controls = controls
        averages = [self.average] if self.average is not None else []
        self.all: tuple[Tally, ...] = (*controls, *self.histograms.values(), *self.crossings.values(), *averages)

    def results(self, found: Collected, of: Mapping[str, Any]) -> dict[str, Any]:
        """Results of some tallies by name."""
        sums = {id(tally): each for tally, each in zip(self.all, found.sums, strict=True)}
        return {name: tally.result(sums[id(tally)]) for name, tally in of.items()}


def _edges(name: str, bins: int | Sequence[float] | np.ndarray, reference: Moments, row: int) -> np.ndarray:
    if isinstance(bins, int | np.integer) and not isinstance(bins, bool):
        if bins < 1:
            raise ModelError(f"simulate: `histograms` of `{name}`: one bin or more is wanted; found {bins}")
        mean, std = reference.mean[:, row], np.sqrt(reference.variance[:, row])
        low, high = (mean - _REACH * std).min(), (mean + _REACH * std).max()
        return np.linspace(low, high if high > low else low + 1.0, int(bins) + 1)
    return np.array(increasing({name: bins}, "histograms")[name])


def _average(problem: Problem, since: float, reference: Moments) -> AverageTally:
    start = int(np.searchsorted(problem.times, since))
    if start >= len(problem.times):
        raise ModelError(
            f"simulate: `average_from` is {since:g}, beyond the last output time {problem.times[-1]:g}; give an earlier one"
        )
    return AverageTally(start, float(problem.times[start]), reference.mean[start:, : problem.asked].mean(axis=0))
