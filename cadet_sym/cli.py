"""The command line: ``cadet-sym COMMAND MODEL``. What a command does not need is not imported."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any

import typer

import cadet_sym as cs
from cadet_sym.arguments import one_set_each, parse_paths, parse_range, parse_setting, parse_sweep, parse_times
from cadet_sym.console import Stopwatch, computing, fail, print_json, print_written, show_warning, with_bar
from cadet_sym.errors import CadetError, ModelError, SolverError
from cadet_sym.files import DATA_SUFFIXES, FIGURE_SUFFIXES, check_target
from cadet_sym.results import PeriodicMoments
from cadet_sym.solutions import StationaryMoments, StationarySolutions, StationarySweep, search_along
from cadet_sym.version import VERSION

if TYPE_CHECKING:
    from cadet_sym.compiled import CompiledModel

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

ModelPath = Annotated[Path, typer.Argument(metavar="MODEL", help="The model file (TOML).")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE ...", help="Give a parameter another value."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Save = Annotated[Path | None, typer.Option(metavar="FILE", help="Write the moments: .nc, .csv or .mat.")]
Plot = Annotated[Path | None, typer.Option(metavar="FILE", help="Draw a figure: .png, .pdf or .svg.")]
Duration = Annotated[float | None, typer.Option(metavar="T", help="Length of the run.")]
Points = Annotated[int | None, typer.Option(metavar="N", min=2, help="Output times, both ends.")]
RelativeTolerance = Annotated[float | None, typer.Option("--rtol", metavar="R", help="Relative tolerance.")]


def _print_version(asked: bool) -> None:
    if asked:
        print(VERSION)
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="On an error show where in the program it arose.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Random vibration of nonlinear systems: a model file goes in, means and covariances come out."""


@app.command()
def moments(
    model: ModelPath,
    settings: Settings = None,
    duration: Duration = None,
    points: Points = None,
    times: Annotated[str | None, typer.Option(metavar="T1,T2,...", help="Output times instead.")] = None,
    period: Annotated[
        float | None, typer.Option(metavar="T", help="One period of moments that repeat with it, instead of the run.")
    ] = None,
    rtol: RelativeTolerance = None,
    jit: Annotated[bool, typer.Option("--jit", help="Take seconds to make good machine code of a large model.")] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Hold the describing functions against adaptive integration at the run's moments.")
    ] = False,
    as_json: Json = False,
    save: Save = None,
    plot: Plot = None,
) -> None:
    """Propagate mean and covariance over the model's run."""
    if period is not None and not (times is None and duration is None and rtol is None):
        raise ModelError("--period shows one period from 0 on; leave out --times, --duration and --rtol")
    _check_targets((save, DATA_SUFFIXES), (plot, FIGURE_SUFFIXES))
    grid = None if times is None else parse_times(times)
    if grid is not None and (duration is not None or points is not None):
        raise ModelError("--times gives all output times; leave out --duration and --points, or --times")
    if duration is not None and not 0.0 < duration < math.inf:
        raise ModelError(f"--duration {duration:g}: expected a length of time above zero")
    with computing():
        Thread(target=_prepare).start()  # while the model is read and its equations are written
        compiled = _compile(model, settings, jit=jit)
        if period is not None:
            history = compiled.periodic(period, points=points or 101)
        else:
            history = compiled.propagate(grid, duration=duration, points=points, rtol=rtol)
        checked = cs.check_run(compiled, history) if check else None
        if save:
            history.save(save)
        if plot:
            from cadet_sym.plotting import moments_figure, save_figure

            save_figure(moments_figure(history), plot)
    if as_json:
        print_json({**history.to_dict(), **({} if checked is None else {"check": checked.to_dict()})})
    else:
        from cadet_sym.report.terminal import print_history

        print_history(history)
        if isinstance(history, PeriodicMoments):
            print(str(history).splitlines()[-1])
        if checked is not None:
            print(f"\n{checked}")
        print_written(save, plot)


@app.command()
def stationary(
    model: ModelPath,
    settings: Settings = None,
    speed: Annotated[float | None, typer.Option(metavar="V", help="Speed; V(0) if not given.")] = None,
    at: Annotated[float | None, typer.Option(metavar="T", help="Freeze explicit time at T.")] = None,
    every: Annotated[bool, typer.Option("--all", help="Search for every solution, unstable ones too.")] = False,
    sweep: Annotated[
        str | None,
        typer.Option(metavar="NAME=LO:HI:N", help="Repeat for N values of a parameter."),
    ] = None,
    branches: Annotated[
        str | None,
        typer.Option(metavar="NAME=LO:HI", help="Follow every solution over a range, through folds; NAME may be speed."),
    ] = None,
    as_json: Json = False,
    save: Save = None,
    plot: Plot = None,
) -> None:
    """Find the stationary mean and covariance."""
    _check_targets((save, DATA_SUFFIXES), (plot, FIGURE_SUFFIXES))
    if plot and not (sweep or branches):
        raise ModelError("--plot draws stationary moments along a parameter; add --sweep NAME=LO:HI:N or --branches")
    if branches:
        if sweep or every:
            raise ModelError("--branches finds all solutions over a whole range; leave out --sweep and --all")
        parameter, limits = parse_range(branches, "--branches")
        with computing():
            curves = cs.branches(_compile(model, settings), parameter, limits, speed=speed, at=at)
            if save:
                curves.save(save)
            if plot:
                curves.plot(plot)
        if as_json:
            print_json(curves.to_dict())
        else:
            print(curves)
            print_written(save, plot)
        return
    with computing():
        compiled = _compile(model, settings)
        search = partial(_solutions, compiled, speed=speed, at=at, every=every)
        if sweep:
            parameter, values = parse_sweep(sweep)
            found = search_along(search, parameter, values, with_bar(values.tolist(), "sweep"))
        else:
            found = search()
        if save:
            found.save(save)
        if plot and isinstance(found, StationarySweep):
            from cadet_sym.plotting import save_figure, sweep_figure

            unit = compiled.model.parameters[found.parameter].unit
            save_figure(sweep_figure(found, unit=unit), plot)
    if as_json:
        print_json(found.to_dict())
    else:
        from cadet_sym.report.terminal import print_stationary, print_sweep

        if isinstance(found, StationarySweep):
            print_sweep(found)
        else:
            print_stationary(found)
        print_written(save, plot)


@app.command()
def optimise(
    model: ModelPath,
    minimise: Annotated[str, typer.Option(metavar="EXPRESSION", help="As variance(closure): what is to be least.")],
    over: Annotated[list[str], typer.Option(metavar="NAME=LO:HI", help="A parameter that is free; may be repeated.")],
    subject_to: Annotated[
        list[str] | None, typer.Option(metavar="COMPARISON", help="As 'std(stroke) <= 0.02'; may be repeated.")
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="EXPRESSION=LO:HI:N", help="Draw the trade-off: the least for N limits on this.")
    ] = None,
    starts: Annotated[int, typer.Option(metavar="N", min=1, help="Searches, from the declared and random values.")] = 1,
    settings: Settings = None,
    speed: Annotated[float | None, typer.Option(metavar="V", help="Speed; V(0) if not given.")] = None,
    at: Annotated[float | None, typer.Option(metavar="T", help="Freeze explicit time at T.")] = None,
    as_json: Json = False,
    save: Save = None,
    plot: Plot = None,
) -> None:
    """Choose parameters so that a statistic of the stationary state is least."""
    _check_targets((save, DATA_SUFFIXES), (plot, FIGURE_SUFFIXES))
    if plot and not against:
        raise ModelError("--plot draws a trade-off; add --against EXPRESSION=LO:HI:N")
    ranges = dict(parse_range(text, "--over") for text in over)
    with computing():
        task: dict[str, Any] = {"minimise": minimise, "over": ranges, "subject_to": subject_to or ()}
        task |= {"starts": starts, "speed": speed, "at": at}
        compiled = _compile(model, settings)
        if against:
            other, limits = parse_sweep(against, "--against")
            found = cs.trade_off(compiled, against=other, limits=limits, **task)
            if plot:
                found.plot(plot)
        else:
            found = cs.optimise(compiled, **task)
        if save:
            found.save(save)
    if as_json:
        print_json(found.to_dict())
    else:
        print(found)
        print_written(save, plot)


@app.command()
def validate(
    model: ModelPath,
    settings: Settings = None,
    paths: Annotated[str, typer.Option(metavar="N|auto", help="Realisations to simulate.")] = "2000",
    seed: Annotated[int, typer.Option(metavar="N", help="The same seed gives the same paths.")] = 0,
    control: Annotated[
        bool | None,
        typer.Option("--control/--plain", help="Use the quasi-linear system as control variate; if it helps, if not given."),
    ] = None,
    target: Annotated[
        float | None, typer.Option(metavar="R", help="With --paths auto: relative half-width of limits, 0.01.")
    ] = None,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="With --paths auto: seconds there are for it.")] = None,
    as_json: Json = False,
    plot: Plot = None,
) -> None:
    """Set the moments against a Monte Carlo simulation of the original nonlinear model."""
    _check_targets((plot, FIGURE_SUFFIXES))
    count = parse_paths(paths, target, time_limit)
    watch = Stopwatch()
    with computing():
        declared = _load(model, settings)
        compiled = cs.compile(declared)
        watch.lap("compiling")
        history = compiled.propagate()
        watch.lap("CADET")
        short = None
        try:
            simulation = cs.simulate(
                compiled, count, seed=seed, control=control, target=0.01 if target is None else target, time_limit=time_limit,
                progress=sys.stderr.isatty(),
            )  # fmt: skip
        except SolverError as error:
            short, simulation = error, error.details.get("partial")
            if simulation is None or simulation.diverged == simulation.paths:
                raise
        watch.lap("simulation")
        comparison = cs.compare(history, simulation)
        if plot:
            comparison.plot(plot)
            watch.lap("figure")
    if as_json:
        print_json(comparison.to_dict())
    else:
        from cadet_sym.report.terminal import print_comparison

        print_comparison(comparison, watch.laps)
        print_written(plot)
    if short is not None:  # what was obtained is told; the wish was not met
        raise short


@app.command()
def show(
    model: ModelPath,
    settings: Settings = None,
    latex: Annotated[bool, typer.Option("--latex", help="Print LaTeX.")] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Hold every describing function against adaptive integration.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Print the augmented equations, the describing functions and how each was obtained."""
    from cadet_sym.lowering.measured import measured
    from cadet_sym.report.listing import Listing

    with computing():
        listing = Listing(measured(cs.moment_equations(cs.linearise(cs.augment(_load(model, settings))))), checked=check)
        content = listing.to_dict() if as_json else listing.latex() if latex else "\n".join(listing.lines())
    if isinstance(content, str):
        print(content)
    else:
        print_json(content)


@app.command()
def export(
    model: ModelPath,
    to: Annotated[Path, typer.Option(metavar="DIRECTORY", help="The folder to write to.")],
    settings: Settings = None,
    prefix: Annotated[
        str | None, typer.Option(metavar="NAME", help="What names in C begin with; the model file's name if not given.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write to a folder that holds other files, too.")] = False,
    fmu: Annotated[bool, typer.Option("--fmu", help="Add mock-up units, FMI 3.0 and 2.0.")] = False,
    matlab: Annotated[bool, typer.Option("--matlab", help="Add the equations as a MATLAB function.")] = False,
) -> None:
    """Write the compiled equations as a C library."""
    with computing():
        compiled = _compile(model, settings)
        written = compiled.export_c(to, prefix=prefix or model.stem, force=force, fmu=fmu, matlab=matlab)
    print(written)


@app.command()
def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove all that is kept.")] = False,
) -> None:
    """Say where compiled models are kept, how many, and what they take."""
    from cadet_sym import cache as kept

    found = kept.clear() if clear else kept.contents()
    if found.path is None:
        print(f"No cache: {kept.VARIABLE} is `{kept.OFF}`")
    else:
        done = "Removed from" if clear else "Kept in"
        print(f"{done} {found.path}: {found.entries} entries, {found.bytes / 1e6:.1f} MB")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns 0, or 1 for a numerical failure, or 2 for a wrong model or arguments."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    words = ["--debug"] * debug + one_set_each(word for word in words if word != "--debug")
    warnings.showwarning = show_warning
    try:
        return app(words, prog_name="cadet-sym", standalone_mode=False) or 0
    except typer.Abort:
        return fail("stopped", 130)
    except CadetError as error:
        if debug:
            raise
        return fail("\n".join([str(error), *getattr(error, "__notes__", ())]), error.exit_status)
    except typer.TyperException as error:  # a wrong option
        message = error.format_message().rstrip(".")
        return fail(f"{message}; see `cadet-sym --help`", 2) if message else 2
    except Exception as error:
        if debug:
            raise
        kind = type(error).__name__
        return fail(f"unexpected {kind}: {error}; a fault of the program, not of the model; run again with --debug", 1)


def _prepare() -> None:
    from cadet_sym.solve.native import prepare

    prepare()


def _compile(path: Path, settings: Iterable[str] | None, *, jit: bool = False) -> CompiledModel:
    """The model in a file, with the parameters of ``--set`` in place, compiled now or before."""
    return cs.compile(path, parameters=_values(settings), jit=jit)


def _load(path: Path, settings: Iterable[str] | None) -> cs.Model:
    """The model in a file, with the parameters of ``--set`` in place."""
    model, values = cs.load(path), _values(settings)
    return model.with_parameters(values) if values else model


def _values(settings: Iterable[str] | None) -> dict[str, str]:
    return dict(parse_setting(setting) for setting in settings or ())


def _solutions(
    compiled: CompiledModel,
    *,
    every: bool,
    parameters: Mapping[str, float] | None = None,
    start: StationaryMoments | None = None,
    **held: float | None,
) -> StationarySolutions:
    found = compiled.stationary(all=every, parameters=parameters, start=start, **held)
    return found if isinstance(found, StationarySolutions) else StationarySolutions((found,))


def _check_targets(*targets: tuple[Path | None, Sequence[str]]) -> None:
    """Refuse a file that cannot be written before anything is computed."""
    for target, suffixes in targets:
        if target is not None:
            check_target(target, suffixes)
