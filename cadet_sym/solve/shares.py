"""Share runs out among threads, which machine code leaves Python's lock to.

Whoever is ready takes a part of what is left, who asks as well as the others: the parts become smaller, so that all are done
at about the same time. The other threads stay, and wait for whoever asks next; nobody waits for one that did not come.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["ALONE", "Team", "Then", "Which", "among", "nothing"]

T = TypeVar("T")
Which = slice | npt.NDArray[np.intp]
Then = Callable[[Which, npt.NDArray[np.float64]], None]
"""What a thread does with runs while it has them at hand: which they are, and their packed moments (runs, k, size)."""

MOST = 256
"""Threads that are kept for all teams."""


@dataclass(frozen=True)
class Team:
    """Who asks, and other threads."""

    others: int

    def share(self, count: int, some: Callable[[slice], T]) -> list[T]:
        """What `some` gives for parts of so many runs, in their order."""
        parts, found = deque(self._parts(count)), dict[int, T]()

        def work() -> None:
            while True:
                try:
                    part = parts.popleft()  # by one thread at a time
                except IndexError:
                    return
                try:
                    found[part.start] = some(part)
                except BaseException:
                    parts.clear()
                    raise

        asked = [_others().submit(work) for _ in range(min(self.others, len(parts) - 1))]
        try:
            work()
        finally:
            helping = [each for each in asked if not each.cancel()]
            for each in helping:
                each.exception()  # once it is done
        for each in helping:
            each.result()
        return [found[start] for start in sorted(found)]

    def _parts(self, count: int) -> Iterator[slice]:
        begin = 0
        while begin < count:
            end = begin + -(-(count - begin) // (2 * self.others + 2)) if self.others else count
            yield slice(begin, end)
            begin = end


def nothing(which: Which, y: npt.NDArray[np.float64]) -> None:
    """There is no more to be done with runs."""


def among(places: npt.NDArray[np.intp], then: Then, which: Which, y: npt.NDArray[np.float64]) -> None:
    """The same with some of the runs that stand at these places."""
    then(places[which], y)


ALONE = Team(0)
"""Whoever asks does all of it at once."""


@cache
def _others() -> Executor:
    """Threads that begin when they are wanted."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(MOST)


if hasattr(os, "register_at_fork"):  # a process that was forked has none of them
    os.register_at_fork(after_in_child=_others.cache_clear)
