"""Run a model at many values of its parameters, in parallel, and label what comes back.

Every point is a run of its own from declared starts: results are the same bit for bit, whoever computes them and in
whatever order. A point that fails is kept as such, with its message; the others are not touched by it.

Runs in machine code leave Python's lock to others: threads share them out among the cores at once. Other runs need other
processes, which take seconds to start.
"""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from cadet_sym.compiled import CompiledModel, compile
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.model import Model
from cadet_sym.language.modelfile import load
from cadet_sym.memory import Memory
from cadet_sym.results import MomentHistory

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

__all__ = ["Sweep", "sweep"]

Array = npt.NDArray[np.float64]

TRIAL = 0.5
"""Seconds after which it is looked at how long the rest of a sweep would take ..."""

START_UP = 6.0
"""... and seconds of that which other processes are worth: each imports and reads the model for one or two."""

CHUNK = 25
"""Points handed over at once, at most ..."""

TOGETHER = 12
"""... and points begun together in one thread, so that it needs Python's lock for a third of the time, and seldom."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """The runs of a sweep in the order of its points; None where one failed."""

    model: str
    parameters: tuple[str, ...]
    points: Array  # (k, parameters) values at every point
    axes: tuple[Array, ...]  # values along every axis of a grid; empty for samples
    histories: tuple[MomentHistory | None, ...]
    failures: Mapping[int, str]  # point: why there is no run

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: int) -> MomentHistory | None:
        return self.histories[index]

    def to_xarray(self) -> xr.Dataset:
        """All moments in one data set: a dimension a parameter, or `sample` for samples; NaN where a run failed."""
        import xarray as xr

        known = next((each for each in self.histories if each is not None), None)
        if known is None:
            raise SolverError(f"no point of the sweep has a result; the first failed so: {self.failures[0]}")
        parts = {
            "mean": (("time", "state"), "state_mean"),
            "covariance": (("time", "state", "state_2"), "state_covariance"),
            "output_mean": (("time", "output"), "output_mean"),
            "output_variance": (("time", "output"), "output_variance"),
        }
        leading = self.parameters if self.axes else ("sample",)
        shape = tuple(len(axis) for axis in self.axes) if self.axes else (len(self.points),)
        data = {}
        for title, (dimensions, attribute) in parts.items():
            nothing = np.full_like(getattr(known, attribute), np.nan)
            rows = [nothing if each is None else getattr(each, attribute) for each in self.histories]
            data[title] = ((*leading, *dimensions), np.stack(rows).reshape(*shape, *nothing.shape))
        failed = np.array([each is None for each in self.histories]).reshape(shape)
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
    model = model if isinstance(model, Model) else load(model)
    names, points, axes = _points(values, kind)
    task = _Task(model, names, run)
    for row in points[:1]:
        task.compiled.parameter_vector(dict(zip(names, row.tolist(), strict=True)))
    pairs = _results(task, points, executor, workers)
    results = dict(_shown(pairs, len(points), progress))
    histories = [results[i] for i in range(len(points))]
    failures = {i: each for i, each in enumerate(histories) if isinstance(each, str)}
    kept = tuple(None if isinstance(each, str) else each for each in histories)
    return Sweep(model.name, names, points, axes, kept, failures)


def _points(values: Mapping[str, Sequence[float]], kind: str) -> tuple[tuple[str, ...], Array, tuple[Array, ...]]:
    names, columns = tuple(values), [np.atleast_1d(np.asarray(v, dtype=float)) for v in values.values()]
    if not names or any(column.ndim != 1 or not column.size or not np.isfinite(column).all() for column in columns):
        raise ModelError("a sweep needs at least one parameter, and finite values for each.")
    if kind == "grid":
        return names, np.array(list(itertools.product(*columns))), tuple(columns)
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

    def some(self, rows: Sequence[tuple[int, Array]]) -> list[tuple[int, MomentHistory | str]]:
        """Several points, in whatever process; a numerical failure comes back as its message."""
        values = [dict(zip(self.names, row.tolist(), strict=True)) for _, row in rows]
        if len(rows) > 1:
            self.compiled.prepare(values, **self.run)
        return [(i, self._at(each)) for (i, _), each in zip(rows, values, strict=True)]

    def _at(self, values: Mapping[str, float]) -> MomentHistory | str:
        try:
            return self.compiled.propagate(parameters=values, **self.run)
        except (SolverError, ArithmeticError) as error:
            return f"{', '.join(f'{name} = {value:g}' for name, value in values.items())}: {error}"


def _results(
    task: _Task, points: Array, executor: Any, workers: int | None
) -> Iterator[tuple[int, MomentHistory | str]]:
    """The points' results with their numbers, as they come: here while that is soon done, then wherever there is room."""
    waiting, most, threads = list(enumerate(points)), workers or os.cpu_count() or 1, False
    if executor is None:
        began = perf_counter()
        ((_, first),) = pairs = task.some(waiting[:1])  # with it, all is there that threads are to share
        waiting = waiting[1:]
        yield from pairs
        threads = most > 1 and _leaves_the_lock(task.compiled, first)
        while waiting and not threads and workers in (None, 1):
            spent, done = perf_counter() - began, len(points) - len(waiting)
            if workers is None and spent > TRIAL and spent / done * len(waiting) > START_UP:
                break
            length = max(1, min(TOGETHER, int(TRIAL * done / spent)))
            some, waiting = waiting[:length], waiting[length:]
            yield from task.some(some)
    if not waiting:
        return
    with _pool(executor, workers, most if threads else 0) as pool:
        count = most * max(4, -(-len(waiting) // (most * (TOGETHER if threads else CHUNK))))  # as much for each
        edges = [len(waiting) * k // count for k in range(count + 1)]
        chunks = [waiting[a:b] for a, b in itertools.pairwise(edges) if a < b]
        futures = [pool.submit(task.some, chunk) for chunk in chunks]
        try:
            for future in _completed(futures):
                yield from future.result()
        except BaseException:  # who stops a sweep does not wait for what has not begun
            for future in futures:
                future.cancel()
            raise


def _leaves_the_lock(compiled: CompiledModel, run: MomentHistory | str) -> bool:
    """Whether runs like this one leave Python's lock to other threads, and nothing that they share is changed."""
    machine = isinstance(run, MomentHistory) and run.provenance.engine.endswith("machine code")
    return machine and not compiled.functions.facts.whole


@contextmanager
def _pool(executor: Any, workers: int | None, threads: int) -> Iterator[Any]:
    """The executor handed in, left open; threads; or processes of our own, started afresh so that no lock is inherited."""
    from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

    if executor is not None:
        yield executor
    elif threads:
        with ThreadPoolExecutor(threads) as pool:
            yield pool
    else:
        from multiprocessing import get_context

        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            yield pool


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
