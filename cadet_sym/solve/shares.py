"""Share runs out among threads, which machine code leaves Python's lock to.

Whoever is ready takes a part of what is left: the parts become smaller, so that all are done at about the same time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

__all__ = ["ALONE", "Team", "team_of"]

T = TypeVar("T")


@dataclass(frozen=True)
class Team:
    """So many threads, and how they are given parts of some work."""

    workers: int
    each: Callable[[Callable[[slice], Any], Iterable[slice]], Iterable[Any]]

    def share(self, count: int, some: Callable[[slice], T]) -> list[T]:
        """What `some` gives for parts of so many runs, in their order."""
        edges = [0]
        while edges[-1] < count:
            left = count - edges[-1]
            edges.append(edges[-1] + (left if self.workers == 1 else -(-left // (2 * self.workers))))
        return list(self.each(some, [slice(a, b) for a, b in pairwise(edges)]))


ALONE = Team(1, map)
"""Whoever asks does all of it at once."""


@contextmanager
def team_of(workers: int) -> Iterator[Team]:
    """So many threads, for a while."""
    if workers <= 1:
        yield ALONE
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(workers) as pool:
        yield Team(workers, pool.map)
