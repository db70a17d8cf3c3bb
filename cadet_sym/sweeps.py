"""Run a model at many values of its parameters, in parallel, and label what comes back.

Every point is a run of its own from declared starts: results are the same bit for bit, whoever computes them and in
whatever order. A point that fails is kept as such, with its message; the others are not touched by it.

Runs in machine code leave Python's lock to others: threads share many of them out among the cores at once. Other runs need
other processes, which take seconds to start.
"""

from __future__ import annotations

import itertools
import os
import pickle
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from cadet_sym.compiled import CompiledModel, compile
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.model import Model
from cadet_sym.language.modelfile import load
from cadet_sym.memory import Memory
from cadet_sym.results import MomentHistory
from cadet_sym.runs import Runs
from cadet_sym.tables import Shown, aligned

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

__all__ = ["Sweep", "sweep"]

Array = npt.NDArray[np.float64]
Place = tuple[Runs, int] | str  # where a run is, or why there is none

TRIAL = 0.5
"""Seconds of work, of every thread, between two looks at how far a sweep has come and how long the rest would take ..."""

START_UP = 6.0
"""... and seconds of that which other processes are worth: each imports and reads the model for one or two."""

SHARE = 8
"""Points of every thread between two looks, at least: at the last of them, the others wait."""

CHUNK = 25
"""Points handed over to another process at once, at most."""

LISTED = 10
"""Runs of which a sweep prints something, at most."""

ROOM = 10_000_000
"""Numbers that the runs done at once may hold."""


class Histories(Sequence["MomentHistory | None"]):
    """The runs of a sweep, each made of the numbers of many when it is asked for; None where one failed."""

    def __init__(self, places: Sequence[Place]) -> None:
        self._places = places

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return tuple(map(_history, self._places[index]))
        return _history(self._places[index])


def _history(place: Place) -> MomentHistory | None:
    if isinstance(place, str):
        return None
    runs, k = place
    return runs[k]


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Shown):
    """The runs of a sweep in the order of its points; None where one failed."""

    model: str
    parameters: tuple[str, ...]
    points: Array  # (k, parameters) values at every point
    axes: tuple[Array, ...]  # values along every axis of a grid; empty for samples
    histories: Sequence[MomentHistory | None]
    failures: Mapping[int, str]  # point: why there is no run

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: int) -> MomentHistory | None:
        return self.histories[index]

    def __str__(self) -> str:
        """The last of every run, of the first and last few where they are many."""
        count, edge = len(self), LISTED // 2
        found = next((history for history in self.histories if history is not None), None)
        names = (found.outputs or found.states)[:3] if found is not None else ()
        rows = []
        for i in range(count) if count <= LISTED else (*range(edge), *range(count - edge, count)):
            history = self[i]
            numbers = ["failed"] * len(names) if history is None else [f"{history.std[name][-1]:.6g}" for name in names]
            rows.append([*(f"{value:g}" for value in self.points[i]), *numbers])
        if count > LISTED:
            rows.insert(edge, ["..."] + [""] * (len(rows[0]) - 1))
        title = f"Sweep of {self.model} over {', '.join(self.parameters)}: {count} runs"
        title += f", {len(self.failures)} of them failed" if self.failures else ""
        end = f", t = {found.time[-1]:g}" if found is not None and len(found.time) else ""
        header = [*self.parameters, *(f"std {name}{end}" for name in names)]
        return "\n".join([title, *aligned(header, rows), *list(self.failures.values())[:3]])

    def to_xarray(self) -> xr.Dataset:
        """All moments in one data set: a dimension a parameter, or `sample` for samples; NaN where a run failed."""
        import xarray as xr

        places = [i for i in range(len(self)) if i not in self.failures]
        if not places:
            raise SolverError(f"no point of the sweep has a result; the first failed so: {self.failures[0]}")
        known = self.histories[places[0]]
        assert known is not None
        parts = {
            "mean": (("time", "state"), known.state_mean),
            "covariance": (("time", "state", "state_2"), known.state_covariance),
            "output_mean": (("time", "output"), known.output_mean),
            "output_variance": (("time", "output"), known.output_variance),
        }
        leading = self.parameters if self.axes else ("sample",)
        shape = tuple(len(axis) for axis in self.axes) if self.axes else (len(self.points),)
        numbers = [np.full((len(self), *one.shape), np.nan) for _, one in parts.values()]
        for i in places:
            each = self.histories[i]
            assert each is not None
            found = each.state_mean, each.state_covariance, each.output_mean, each.output_variance
            for column, values in zip(numbers, found, strict=True):
                column[i] = values
        data: dict[str, Any] = {
            title: ((*leading, *dimensions), column.reshape(*shape, *one.shape))
            for (title, (dimensions, one)), column in zip(parts.items(), numbers, strict=True)
        }
        failed = np.array([i in self.failures for i in range(len(self))]).reshape(shape)
        data["failed"] = (leading, failed)
        coordinates: dict[str, Any] = {"time": known.time, "state": list(known.states), "state_2": list(known.states)}
        coordinates["output"] = list(known.outputs)
        if self.axes:
            coordinates |= dict(zip(self.parameters, self.axes, strict=True))
        else:
            coordinates |= {name: ("sample", self.points[:, j]) for j, name in enumerate(self.parameters)}
        attributes = {"model": self.model, "failures": "\n".join(self.failures.values())}
        return xr.Dataset(data, coords=coordinates, attrs=attributes)


def sweep(
    model: Model | str | Path,
    values: Mapping[str, Sequence[float]],
    *,
    kind: Literal["grid", "samples"] = "grid",
    executor: Executor | Any | None = None,
    workers: int | None = None,
    progress: bool | None = None,
    **run: Any,
) -> Sweep:
    """Propagate the moments at every point of a grid of parameters, or at every sample.

    Parameters
    ----------
    values : values by parameter. A grid is their product, the last varying fastest; samples stand side by side.
    executor : anything with the `submit` of `concurrent.futures`: a Dask client's or MPI's executor spreads the sweep
        over many machines. By default threads where runs are machine code, or this process, and others on this machine
        if there are seconds of work left.
    workers : so many threads, or processes, at once.
    progress : show a bar on standard error; by default if that is a terminal.
    run : arguments of `CompiledModel.propagate` (times, duration, points, rtol, engine).

    Raises
    ------
    ModelError
        If the model or a name is wrong. A point at which the numbers go wrong is kept as a failure.
    """
    if workers is not None and workers < 1:
        raise ModelError(f"`workers` is {workers}; it must be at least 1.")
    if isinstance(model, CompiledModel):
        raise ModelError("A sweep compiles its model in every process it uses: hand over the model, `compiled.model`.")
    model = model if isinstance(model, Model) else load(model)
    names, points, axes = _points(values, kind)
    task = _Task(model, names, run)
    task.compiled.parameter_vector(dict(zip(names, points[0].tolist(), strict=True)))
    results = dict(_shown(_results(task, points, executor, workers), len(points), progress))
    places = [results[i] for i in range(len(points))]
    failures = {i: each for i, each in enumerate(places) if isinstance(each, str)}
    return Sweep(model.name, names, points, axes, Histories(places), failures)


def _points(values: Mapping[str, Sequence[float]], kind: str) -> tuple[tuple[str, ...], Array, tuple[Array, ...]]:
    names, columns = tuple(values), [np.atleast_1d(np.asarray(v, dtype=float)) for v in values.values()]
    if not names or any(column.ndim != 1 or not column.size or not np.isfinite(column).all() for column in columns):
        raise ModelError("a sweep needs at least one parameter, and finite values for each.")
    if kind == "grid":
        return names, np.stack(np.meshgrid(*columns, indexing="ij"), axis=-1).reshape(-1, len(columns)), tuple(columns)
    if kind != "samples":
        raise ModelError(f"`{kind}` is not a kind of sweep; those are: grid, samples.")
    if len({column.size for column in columns}) > 1:
        sizes = ", ".join(f"{name}: {column.size}" for name, column in zip(names, columns, strict=True))
        raise ModelError(f"samples need as many values for each parameter, but there are {sizes}.")
    return names, np.column_stack(columns), ()


_here: Memory[CompiledModel] = Memory(4)


def _compiled(model: Model) -> CompiledModel:
    """Compiled once in each process, to which copies of a model may come."""
    return _here(compile, (model.name, model.content(numbers=True)), lambda: compile(model))


@dataclass(frozen=True)
class _Task:
    """What is the same at every point."""

    model: Model
    names: Sequence[str]
    run: Mapping[str, Any]

    @cached_property
    def compiled(self) -> CompiledModel:
        """The model, compiled."""
        return _compiled(self.model)

    def __getstate__(self) -> dict[str, Any]:
        """What is sent to another process, which compiles for itself."""
        return {name: value for name, value in self.__dict__.items() if name != "compiled"}

    def some(self, first: int, rows: Array, threads: int = 1) -> list[tuple[int, Place]]:
        """Several points from one on, in whatever process; a numerical failure comes back as its message."""
        try:
            runs = self.compiled.propagate_all(dict(zip(self.names, rows.T, strict=True)), workers=threads, **self.run)
        except (SolverError, ArithmeticError) as error:  # nothing to start from
            if len(rows) > 1:
                return [pair for k in range(len(rows)) for pair in self.some(first + k, rows[k : k + 1])]
            return [(first, self._message(rows[0], error))]
        failures = {k: self._message(rows[k], error) for k, error in runs.failures.items()}
        return [(first + k, failures.get(k, (runs, k))) for k in range(len(rows))]

    def _message(self, row: Array, error: Exception) -> str:
        return f"{', '.join(f'{name} = {value:g}' for name, value in zip(self.names, row, strict=True))}: {error}"


def _results(task: _Task, points: Array, executor: Any, workers: int | None) -> Iterator[tuple[int, Place]]:
    """The points' results with their numbers, as they come: here while that is soon done, then wherever there is room."""
    done, count = 0, len(points)
    if executor is None:
        asked, began = pickle.dumps(sorted(task.run.items())), perf_counter()
        like = _likes(task.compiled, asked, lambda: UNKNOWN)
        while done < count:
            threads, before = (workers or os.cpu_count() or 1) if like.shared else 1, perf_counter()
            found = task.some(done, points[done : done + like.at_once(threads)], threads)
            yield from found
            done, pace = done + len(found), (perf_counter() - before) / len(found)
            like = _like(task.compiled, [place for _, place in found], pace)
            _likes.keep(task.compiled, asked, like)
            elsewhere = workers is None and perf_counter() - began > TRIAL and pace * (count - done) > START_UP
            if not like.shared and (elsewhere or workers not in (None, 1)):
                break
    if done == count:
        return
    with _pool(executor, workers) as pool:
        most = workers or os.cpu_count() or 1
        chunks = most * max(4, -(-(count - done) // (most * CHUNK)))  # as much for each
        edges = sorted({done + (count - done) * k // chunks for k in range(chunks + 1)})
        with _apart_from_script(task) if executor is None else nullcontext():
            futures = [pool.submit(task.some, a, points[a:b]) for a, b in itertools.pairwise(edges)]
        try:
            for future in _completed(futures):
                yield from future.result()
        except BaseException:  # who stops a sweep does not wait for what has not begun
            for future in futures:
                future.cancel()
            raise


@dataclass(frozen=True)
class _Like:
    """What the runs of a sweep are like, as those tell that were done."""

    seconds: float  # that one takes
    room: int  # how many may be done at once
    shared: bool  # whether they leave Python's lock to other threads

    def at_once(self, threads: int) -> int:
        """How many to do until the next look at how far the sweep has come."""
        return min(max(int(TRIAL * threads / self.seconds), SHARE * threads if threads > 1 else 1), self.room)


UNKNOWN = _Like(TRIAL, 1, shared=False)
"""With the first run, all is there that threads are to share."""

_likes: Memory[_Like] = Memory()


def _like(compiled: CompiledModel, places: Sequence[Place], seconds: float) -> _Like:
    """What those at some places are like, which took so long each."""
    run = next((runs.found[k] for runs, k in (place for place in places if not isinstance(place, str))), None)
    if run is None:
        return _Like(seconds, CHUNK, shared=False)
    if len(places) == 1:  # of what was done for one alone, others need nothing
        seconds = min(seconds, run.statistics["seconds"])
    shared = run.engine.endswith("machine code") and not compiled.functions.facts.whole
    return _Like(seconds, max(1, ROOM // max(run.y.size, 1)), shared)


@contextmanager
def _pool(executor: Any, workers: int | None) -> Iterator[Any]:
    """The executor handed in, left open; or processes of our own, started afresh so that no lock is inherited."""
    from concurrent.futures import ProcessPoolExecutor

    if executor is not None:
        yield executor
    else:
        from multiprocessing import get_context

        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            yield pool


@contextmanager
def _apart_from_script(task: _Task) -> Iterator[None]:
    """Processes that start meanwhile do not run the user's script again, which need not be guarded by `__name__` then.

    What they are sent is made of this package's classes; if one of the script's own is among it they need the script.
    """
    script = sys.modules["__main__"]
    if b"__main__" not in pickle.dumps(task):
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def _completed(waiting: Sequence[Any]) -> Iterator[Any]:
    """Futures as they finish; those of other executors than the standard library's in order."""
    from concurrent.futures import Future, as_completed

    if all(isinstance(future, Future) for future in waiting):
        yield from as_completed(waiting)
    else:
        yield from waiting


def _shown(items: Any, total: int, progress: bool | None) -> Iterator[Any]:
    """The items, with a bar on standard error."""
    if not (sys.stderr.isatty() if progress is None else progress):
        yield from items
        return
    from rich.console import Console
    from rich.progress import track

    yield from track(items, description="sweep", total=total, console=Console(stderr=True))
