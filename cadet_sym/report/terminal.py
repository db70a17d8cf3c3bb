"""Tables for the terminal."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from cadet_sym.report.comparison import Comparison, rounded
from cadet_sym.results import MomentHistory, provenance_line
from cadet_sym.solutions import StationaryMoments, StationarySweep

if TYPE_CHECKING:
    from cadet_sym.simulation import Ensemble

__all__ = [
    "comparison_table",
    "print_comparison",
    "print_history",
    "print_stationary",
    "print_sweep",
]

MOST_TIMES = 11  # of a run, in a table
MOST_NAMES = 3  # outputs side by side, in a table
WIDE = 200  # columns, where no terminal says how wide it is


def print_history(history: MomentHistory) -> None:
    """The outputs at some times, and everything at the end."""
    console = _console()
    console.print(f"{history.model}: {provenance_line(history.provenance)}", highlight=False)
    shown = history.outputs or history.states
    if len(shown) <= MOST_NAMES and len(history.time) > 1:
        console.print(history_table(history, shown))
        console.print()
    console.print(end_table(history, (*history.outputs, *history.states)))


def print_stationary(solutions: Sequence[StationaryMoments]) -> None:
    """Every solution with its stability and how it was found."""
    console = _console()
    for number, solution in enumerate(solutions, 1):
        which = f"solution {number} of {len(solutions)}, " if len(solutions) > 1 else ""
        console.print(f"{solution.model}: {which}{solution.judgement}", highlight=False)
        console.print(stationary_table(solution))
        if solution.drifting:
            console.print(f"drifting, no stationary moments: {', '.join(solution.drifting)}", highlight=False)
        console.print(f"{'; '.join(solution.path)}\n", highlight=False)


def print_sweep(sweep: StationarySweep) -> None:
    """Outputs along the swept parameter."""
    console = _console()
    console.print(f"{sweep.model}: stationary moments against {sweep.parameter}", highlight=False)
    first = sweep.found[0]
    console.print(sweep_table(sweep, first.outputs or first.states))


def print_comparison(comparison: Comparison, seconds: Mapping[str, float]) -> None:
    """The table, a sentence for every output, how many states agree, and the time each part took."""
    console = _console()
    simulation = comparison.simulation
    console.print(
        f"{comparison.history.model}: CADET against {simulation.paths} simulated paths, "
        f"{100 * simulation.level:g} % limits",
        highlight=False,
    )
    console.print(comparison.table())
    console.print(verdict_table(comparison))
    if simulation.inputs:
        console.print(input_table(simulation))
    shown = comparison.history.outputs or comparison.history.states
    for name in shown:
        console.print(comparison.verdict[name].text, highlight=False, soft_wrap=True)
    console.print(comparison.of_states, highlight=False, soft_wrap=True)
    for note in (simulation.method, *simulation.notes):
        console.print(note, highlight=False, soft_wrap=True)
    parts = ", ".join(f"{part} {value:.2f} s" for part, value in seconds.items())
    inner = ", ".join(f"{part} {value:.2f} s" for part, value in simulation.seconds.items())
    console.print(f"Time: {parts} (of the simulation: {inner}).", highlight=False)


def history_table(history: MomentHistory, names: Sequence[str]) -> Table:
    """Mean and variance of ``names`` at some times of a run."""
    table = _table("t", *(f"{moment} {name}" for name in names for moment in ("mean", "variance")))
    for k in _spread(len(history.time), MOST_TIMES):
        cells = (_at(history, moment, name, k) for name in names for moment in ("mean", "variance"))
        table.add_row(f"{history.time[k]:g}", *cells)
    return table


def end_table(history: MomentHistory, names: Sequence[str]) -> Table:
    """Mean, variance and standard deviation of ``names`` at the last time."""
    table = _table(f"t = {history.time[-1]:g}", "mean", "variance", "std")
    for name in names:
        table.add_row(name, *(_at(history, moment, name, -1) for moment in ("mean", "variance", "std")))
    return table


def stationary_table(solution: StationaryMoments) -> Table:
    """Mean, variance and standard deviation of everything that has them, outputs first."""
    table = _table("", "mean", "variance", "std")
    for name in (*solution.outputs, *solution.states):
        if name not in solution.drifting:
            table.add_row(name, *(_shown(solution, moment, name) for moment in ("mean", "variance", "std")))
    return table


def sweep_table(sweep: StationarySweep, names: Sequence[str]) -> Table:
    """One row a solution: the parameter, stability, and the moments of ``names``."""
    table = _table(sweep.parameter, "", *(f"{moment} {name}" for name in names for moment in ("mean", "variance")))
    for value, row in zip(sweep.values, sweep.solutions, strict=True):
        for solution in row:
            moments = (_shown(solution, m, name) for name in names for m in ("mean", "variance"))
            table.add_row(f"{value:g}", "stable" if solution.stable else "unstable", *moments)
        if not row:
            table.add_row(f"{value:g}", "none")
    return table


def comparison_table(comparison: Comparison, names: Sequence[str], rows: int) -> Table:
    """CADET beside the simulation with its 99 % limits, and the variance's discrepancy, at some times."""
    history, simulation = comparison.history, comparison.simulation
    table = _table("", "t", "mean", "simulated", "variance", "simulated", "discrepancy")
    table.columns[0].justify = "left"
    for name in names:
        for i, k in enumerate(_spread(len(history.time), rows)):
            verdict = comparison.at(name, k)
            table.add_row(
                name if i == 0 else "",
                f"{history.time[k]:g}",
                _at(history, "mean", name, k),
                _limited(simulation, "mean", name, k),
                _at(history, "variance", name, k),
                _limited(simulation, "variance", name, k),
                "" if np.isnan(verdict.discrepancy) else _percent(verdict.discrepancy, verdict.limit),
                end_section=i == rows - 1,
            )
    return table


def verdict_table(comparison: Comparison) -> Table:
    """Every output and state at the end of the run, and where its variance is surely furthest off."""
    end = f"t = {comparison.history.time[-1]:g}"
    table = _table(end, "variance", "simulated", "discrepancy", "step error", "over the run", "t", "mean")
    for name, verdict in comparison.verdict.items():
        if math.isnan(verdict.discrepancy):
            continue
        worst = verdict.worst or (math.nan, math.nan, math.nan)
        table.add_row(
            name,
            _at(comparison.history, "variance", name, -1),
            _limited(comparison.simulation, "variance", name, -1),
            _percent(verdict.discrepancy, verdict.limit),
            "" if math.isnan(verdict.step_error) else f"{verdict.step_error:.1g} %",
            _percent(worst[0], worst[1]),
            f"{worst[2]:.4g}",
            f"{_percent(verdict.mean_discrepancy, verdict.mean_limit)} of std",
        )
    return table


def input_table(simulation: Ensemble) -> Table:
    """What enters the nonlinearities: how far from Gaussian, at the end of the run and at most."""
    table = _table("input", "enters", "skewness", "excess kurtosis", "largest skewness", "largest kurtosis")
    for text, shape in simulation.inputs.items():
        cells = []
        for found, error in (
            (shape.skewness, shape.skewness_standard_error),
            (shape.excess_kurtosis, shape.excess_kurtosis_standard_error),
        ):
            number, half = rounded(float(found[-1]), 2.58 * float(error[-1]))
            extreme = found[np.nanargmax(np.abs(found))] if np.isfinite(found).any() else math.nan
            cells.append((f"{'0' if float(number) == 0.0 else number} ± {half}", f"{extreme:.2f}"))
        table.add_row(text, ", ".join(shape.elements), *(a for a, _ in cells), *(b for _, b in cells))
    return table


def _console() -> Console:
    """The terminal, or a wide page where the output goes to a file."""
    return Console() if sys.stdout.isatty() else Console(width=WIDE)


def _table(first: str, *columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def _spread(count: int, most: int) -> list[int]:
    """Evenly spread positions, both ends among them."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int)).tolist()


def _number(value: float) -> str:
    return f"{value:.6g}"


def _at(history: MomentHistory, moment: str, name: str, k: int) -> str:
    """One moment at one time; what is nothing but rounding beside the run's largest deviation is 0."""
    return _beside(getattr(history, moment)[name][k], history.std[name].max(), moment)


def _shown(solution: StationaryMoments, moment: str, name: str) -> str:
    return _beside(getattr(solution, moment)[name], solution.std[name], moment)


def _beside(value: float, deviation: float, moment: str) -> str:
    size = deviation**2 if moment == "variance" else deviation
    return _number(0.0 if abs(value) <= 1e-12 * size else value)


def _limited(simulation: Ensemble, moment: str, name: str, k: int) -> str:
    value, limit = float(getattr(simulation, moment)[name][k]), float(simulation.limit(moment)[name][k])
    return " ± ".join(rounded(value, limit)) if limit > 0.0 else _number(value)


def _percent(value: float, limit: float) -> str:
    number, half = rounded(value, limit)
    return f"{'0' if float(number) == 0.0 else number} ± {half} %"
