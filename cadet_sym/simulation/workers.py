"""Groups of paths, worked out by threads or by a caller's executor, and joined in order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from cadet_sym.simulation.plan import Plan
from cadet_sym.simulation.statistics import Moments, alive, moments_of
from cadet_sym.simulation.streams import Streams
from cadet_sym.simulation.tallies import Tally

__all__ = ["GroupResult", "Task", "group_size", "records_in_parts", "records_of", "run_groups"]

_GROUP_VALUES = 1 << 20  # recorded numbers that a group may hold in memory
_LARGEST_GROUP = 1024
_APART = 1 << 40  # number of the first path of those that measure the step's error


@dataclass(frozen=True)
class GroupResult:
    """What is kept of a group of paths."""

    paths: int
    moments: Moments
    diverged: int
    kept: np.ndarray  # (kept paths, times, k)
    sums: tuple[np.ndarray, ...]  # of every tally


@dataclass(frozen=True)
class Task:
    """What is done with every group."""

    plan: Plan
    engine: str
    seed: int
    states: int
    quantities: int  # rows of the records that have moments: states and outputs
    keep: int
    tallies: tuple[Tally, ...] = ()

    def group(self, first: int, count: int) -> GroupResult:
        """Work out the paths first .. first + count - 1."""
        records, _ = records_of(self.plan, self.engine, self.seed, first, count)
        wanted = records[:, : self.quantities]
        lost = int(np.count_nonzero(~alive(wanted[-1:])))
        kept = np.moveaxis(wanted[:, :, : max(0, min(count, self.keep - first))], -1, 0).copy()
        sums = tuple(tally.sums(records, first) for tally in self.tallies)
        return GroupResult(count, moments_of(wanted, self.states), lost, kept, sums)


def group_size(times: int, rows: int) -> int:
    """Paths that are recorded together: a power of two that depends on the model and its output times alone.

    Moments are taken a group at a time and joined in order, so this is what fixes the last digits of a result.
    """
    size = _LARGEST_GROUP
    while size > 16 and size * times * rows > _GROUP_VALUES:
        size //= 2
    return size


def records_of(plan: Plan, engine: str, seed: int, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Records (times, rows, paths) of paths first .. first + count - 1, and of the same at twice the step."""
    streams = [Streams.of(seed, first, count, purpose) for purpose in range(plan.purposes)]
    tables = (plan.ground, plan.start, plan.fine, plan.coarse, plan.out)
    if engine == "numpy":
        from cadet_sym.simulation import plain

        return plain.run_paths(plan.numpy_source, *tables, streams)
    from cadet_sym.simulation import fast

    return fast.run_paths(plan.numba_source, *tables, streams)


def records_in_parts(plan: Plan, engine: str, seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Records of so many paths that no run has, worked out by threads."""
    parts = -(-count // _LARGEST_GROUP) if count > _LARGEST_GROUP else min(os.cpu_count() or 1, 4)
    bounds = [_APART + count * k // parts for k in range(parts + 1)]
    with ThreadPoolExecutor() as pool:
        jobs = [pool.submit(records_of, plan, engine, seed, a, b - a) for a, b in pairwise(bounds)]
        found = [job.result() for job in jobs]
    first, second = (np.concatenate([each[k] for each in found], axis=-1) for k in (0, 1))
    return first, second


def run_groups(task: Task, paths: range, executor: Executor | None, threads: int | None) -> Iterator[GroupResult]:
    """Yield the results of all groups in the order of their paths, with a bounded number under way."""
    size = group_size(len(task.plan.out.node), task.plan.out.rows)
    workers = threads or os.cpu_count() or 1
    held = nullcontext(executor) if executor is not None else ThreadPoolExecutor(workers)
    with held as pool:
        assert pool is not None
        submit: Callable[..., Any] = pool.submit
        under_way: deque[Any] = deque()
        for first in paths[::size]:
            under_way.append(submit(task.group, first, min(size, paths.stop - first)))
            if len(under_way) > 2 * workers:
                yield under_way.popleft().result()
        while under_way:
            yield under_way.popleft().result()
