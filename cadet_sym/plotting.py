"""Draw moments as the paper draws them: CADET a smooth line, the simulation points with 99 % limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cadet_sym.files import FIGURE_SUFFIXES, whole_file
from cadet_sym.results import MomentHistory
from cadet_sym.solutions import StationarySweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cadet_sym.bifurcation import SolutionBranch, SolutionBranches
    from cadet_sym.optima import TradeOff
    from cadet_sym.simulation import Ensemble

__all__ = ["branches_figure", "moments_figure", "save_figure", "sweep_figure", "trade_off_figure"]

LINE, POINTS, FAINT = "#14446e", "#c8541b", "#d9d9d9"

STYLE: Any = {
    "font.family": "serif",
    "mathtext.fontset": "dejavuserif",
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.4,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}

ROW_HEIGHT, WIDTH = 2.3, 7.0  # inches; the width of a page's text
MOST_POINTS = 26  # of the simulation, drawn along a run


def moments_figure(history: MomentHistory, simulation: Ensemble | None = None, names: Sequence[str] = ()) -> Figure:
    """Mean and variance of each of ``names`` against time, and the simulation's beside them if there is one.

    Parameters
    ----------
    history : the moments by CADET, drawn as lines.
    simulation : an ``Ensemble`` of the same model: points, with 99 % limits as bars.
    names : outputs or states, a row of panels each; the model's outputs, or its states if it has none.
    """
    rows = tuple(names) or history.outputs or history.states
    with _style():
        figure, panels = _panels(rows, "time  t")
        for name, (left, right) in zip(rows, panels, strict=True):
            for axes, moment in ((left, "mean"), (right, "variance")):
                axes.plot(history.time, getattr(history, moment)[name], color=LINE, label="CADET", zorder=3)
                if simulation is not None:
                    _draw_simulation(axes, simulation, name, moment)
                axes.set_xlim(history.time[0], history.time[-1])
        _finish(figure, panels, history.model, legend=simulation is not None)
    return figure


def cases_figure(title: str, name: str, cases: Mapping[str, tuple[MomentHistory, Ensemble | None]]) -> Figure:
    """Mean and variance of one state or output against time, a row of panels for each case.

    Parameters
    ----------
    name : an output or a state of all cases.
    cases : what each is called, the moments by CADET and the simulation.
    """
    with _style():
        figure, panels = _panels([name] * len(cases), "time  t")
        for (case, (history, simulation)), pair in zip(cases.items(), panels, strict=True):
            for axes, moment in zip(pair, ("mean", "variance"), strict=True):
                axes.plot(history.time, getattr(history, moment)[name], color=LINE, label="CADET", zorder=3)
                if simulation is not None:
                    _draw_simulation(axes, simulation, name, moment)
                axes.set_xlim(history.time[0], history.time[-1])
                axes.set_title(case)
            low, high = pair[0].get_ylim()
            least = 0.05 * float(np.asarray(history.std[name]).max())  # a mean that is zero is drawn as zero
            pair[0].set_ylim(min(low, -least), max(high, least))
        _finish(figure, panels, title, legend=True)
    return figure


def sweep_figure(sweep: StationarySweep, names: Sequence[str] = (), unit: str = "") -> Figure:
    """Stationary mean and variance of each of ``names`` against the swept parameter; unstable ones hollow."""
    found = sweep.found
    rows = tuple(names) or found[0].outputs or found[0].states
    stable = np.array([each.stable for each in found])
    with _style():
        figure, panels = _panels(rows, f"{sweep.parameter} ({unit})" if unit else sweep.parameter)
        for name, pair in zip(rows, panels, strict=True):
            for axes, moment in zip(pair, ("mean", "variance"), strict=True):
                values = np.array([getattr(each, moment)[name] for each in found])
                _draw_branches(axes, sweep.values_found, values, stable, joined=len(found) == len(sweep.values))
        _finish(figure, panels, f"{sweep.model}: stationary moments", legend=not stable.all())
    return figure


def branches_figure(branches: SolutionBranches, names: Sequence[str] = ()) -> Figure:
    """Stationary mean and variance of each of ``names`` along the branches: stable solid, unstable dashed, folds dots."""
    first = branches.branches[0]
    shown = tuple(name for name in (first.outputs or first.states) if name not in branches.drifting)
    rows = tuple(names) or shown or first.states
    unit = f" ({branches.unit})" if branches.unit else ""
    with _style():
        figure, panels = _panels(rows, f"{branches.parameter}{unit}")
        for name, pair in zip(rows, panels, strict=True):
            for axes, moment in zip(pair, ("mean", "variance"), strict=True):
                for branch in branches.branches:
                    _draw_branch(axes, branch, getattr(branch, moment)[name])
        panels[0, 0].set_xlim(*branches.range)
        several = len(branches.folds) or not all(branch.stable.all() for branch in branches.branches)
        _finish(figure, panels, f"{branches.model}: stationary moments", legend=bool(several))
    return figure


def trade_off_figure(*curves: TradeOff, names: Sequence[str] = ()) -> Figure:
    """The least of one statistic against the limit on another, and the parameters that give it; several curves at once.

    Parameters
    ----------
    curves : of the same two statistics.
    names : of the curves, for the legend.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    free = tuple(dict.fromkeys(name for curve in curves for name in curve.names))
    with _style():
        figure = Figure(figsize=(WIDTH, 0.5 + ROW_HEIGHT * max(1, len(free) / 2 + 0.5)), layout="constrained")
        FigureCanvasAgg(figure)
        places = figure.subplots((len(free) + 2) // 2, 2, squeeze=False).ravel()
        for number, curve in enumerate(curves):
            look: Any = {"color": (LINE, POINTS)[number % 2], "label": names[number] if names else "", "marker": "."}
            places[0].plot(curve.limits, curve.objective, **look)
            for name, axes in zip(free, places[1:], strict=False):
                if name in curve.names:
                    axes.plot(curve.limits, curve.parameter(name), **look)
        for title, axes in zip((f"least {_printed(curves[0].minimise)}", *free), places, strict=False):
            axes.set_ylabel(title)
            axes.set_xlabel(f"limit on {_printed(curves[0].against)}")
        for axes in places[1 + len(free) :]:
            axes.set_visible(False)
        _finish(figure, places.reshape(-1, 2), "Trade-off", legend=bool(names))
    return figure


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as .png, .pdf or .svg, by the suffix; whole or not at all.

    Raises
    ------
    ModelError
        Unknown suffix.
    ExportError
        A folder that cannot be written to.
    """
    with whole_file(path, FIGURE_SUFFIXES) as temporary, _style():
        figure.savefig(temporary, dpi=200)
    return Path(path)


def _style() -> Any:
    from matplotlib import rc_context

    return rc_context(STYLE)


def _panels(rows: Sequence[str], horizontal: str) -> tuple[Figure, Any]:
    """One row of panels a name: its mean on the left, its variance on the right."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 0.5 + ROW_HEIGHT * len(rows)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(rows), 2, squeeze=False, sharex=True)
    for name, (left, right) in zip(rows, panels, strict=True):
        left.set_ylabel(f"mean of {_printed(name)}")
        right.set_ylabel(f"variance of {_printed(name)}")
    for axes in panels[-1]:
        axes.set_xlabel(horizontal)
    return figure, panels


def _finish(figure: Figure, panels: Any, title: str, *, legend: bool) -> None:
    """Title on top, and one legend for all panels under it."""
    if legend:
        handles, labels = panels[0, 0].get_legend_handles_labels()
        known = dict(zip(labels, handles, strict=True))  # each once
        handles, labels = list(known.values()), list(known)
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.suptitle(title, fontsize=10.5)


def _draw_simulation(axes: Axes, simulation: Ensemble, name: str, moment: str) -> None:
    time = np.asarray(simulation.time)
    shown = np.unique(np.linspace(0, len(time) - 1, min(MOST_POINTS, len(time))).round().astype(int))
    axes.errorbar(
        time[shown],
        np.asarray(getattr(simulation, moment)[name])[shown],
        yerr=np.asarray(simulation.limit(moment)[name])[shown],
        fmt="o",
        markersize=3,
        color=POINTS,
        elinewidth=0.9,
        capsize=1.8,
        label=f"simulation, {simulation.paths} paths, {100 * simulation.level:g} % limits",
        zorder=2,
        clip_on=False,
    )


def _draw_branches(axes: Axes, at: np.ndarray, values: np.ndarray, stable: np.ndarray, *, joined: bool) -> None:
    if joined:
        axes.plot(at, values, color=LINE, zorder=2)
    axes.plot(at[stable], values[stable], "o", color=LINE, markersize=3.5, label="stable", zorder=3)
    axes.plot(at[~stable], values[~stable], "o", color=POINTS, mfc="white", markersize=4, label="unstable", zorder=3)


def _draw_branch(axes: Axes, branch: SolutionBranch, values: np.ndarray) -> None:
    for points, stable in branch.pieces():
        color, style, label = (LINE, "-", "stable") if stable else (POINTS, "--", "unstable")
        axes.plot(branch.values[points], values[points], style, color=color, label=label, zorder=3 if stable else 2)
    if branch.folds:
        at = list(branch.folds)
        axes.plot(branch.values[at], values[at], "o", color="black", markersize=3, label="fold", zorder=4)


def _printed(name: str) -> str:
    """A name as text: underscores as spaces."""
    return name.replace("_", " ")
