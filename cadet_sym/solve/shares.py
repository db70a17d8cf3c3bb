"""Share runs out among threads, which machine code leaves Python's lock to.

Whoever is ready takes a part of what is left, who asks as well as the others: the parts become smaller, so that all are done
at about the same time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["ALONE", "Team", "team_of"]

T = TypeVar("T")


@dataclass(frozen=True)
class Team:
    """Who asks, and other threads."""

    others: int
    pool: Executor | None

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

        helping = [self.pool.submit(work) for _ in range(min(self.others, len(parts) - 1))] if self.pool else []
        work()
        for each in helping:
            each.result()
        return [found[start] for start in sorted(found)]

    def _parts(self, count: int) -> Iterator[slice]:
        begin = 0
        while begin < count:
            end = begin + -(-(count - begin) // (2 * self.others + 2)) if self.others else count
            yield slice(begin, end)
            begin = end


ALONE = Team(0, None)
"""Whoever asks does all of it at once."""


@contextmanager
def team_of(workers: int) -> Iterator[Team]:
    """So many threads, for a while."""
    if workers <= 1:
        yield ALONE
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(workers - 1) as pool:
        yield Team(workers - 1, pool)
