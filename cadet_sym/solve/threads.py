"""Keep products of matrices on one core.

Matrices of a few hundred rows gain little from more, and where others want the cores too, a sweep's processes among them,
threads that wait for each other cost twenty times what they do.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["one_thread"]

SINGLE = 60
"""Rows up to which a product of matrices is not worth a second thread to any library."""

_lock = Lock()
_inside: list[Any] = []  # one for each thread that wants it so: the limit is the whole process's, and lasts until the last


@contextmanager
def one_thread(rows: int) -> Iterator[None]:
    """A context in which linear algebra uses one thread for matrices of so many rows."""
    if rows <= SINGLE:
        yield
        return
    with _lock:
        _inside.append(_inside[0] if _inside else _libraries().limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            limit = _inside.pop()
            if not _inside:
                limit.restore_original_limits()


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  (with a library of its own, which is to be found too)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
