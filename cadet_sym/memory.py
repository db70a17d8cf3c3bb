"""Remember what was found, for each model as long as it lives, and no more than so much of it.

Any number of threads may ask at once: what two of them find for one key at the same time is the same, and either is kept.
Nobody waits while something is found; making room and keeping is one step, or several threads would fill the same room.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any, Generic, TypeVar
from weakref import WeakKeyDictionary

__all__ = ["Memory"]

T = TypeVar("T")


class Memory(Generic[T]):
    """What was found for an owner and a key; where there are too many keys of one owner, the oldest quarter is forgotten."""

    def __init__(self, most: int = 256) -> None:
        self._most = most
        self._kept: WeakKeyDictionary[Any, dict[Hashable, T]] = WeakKeyDictionary()
        self._keeping = Lock()

    def __call__(self, owner: Any, key: Hashable, find: Callable[[], T]) -> T:
        """What is known for the key, or else is found now."""
        try:
            return self._kept[owner][key]
        except KeyError:
            pass
        found = find()
        self.keep(owner, key, found)
        return found

    def knows(self, owner: Any, key: Hashable) -> bool:
        """Whether something is known for the key."""
        return key in self._kept.get(owner, ())

    def keep(self, owner: Any, key: Hashable, found: T) -> None:
        """Remember what was found elsewhere."""
        with self._keeping:
            kept = self._kept.setdefault(owner, {})
            if key not in kept and len(kept) >= self._most:
                for old in list(kept)[: self._most // 4 + 1]:
                    del kept[old]
            kept[key] = found
