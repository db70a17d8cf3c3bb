"""Keep products of matrices on one core.

Matrices of a few hundred rows gain little from more, and where others want the cores too, a sweep's processes among them,
threads that wait for each other cost twenty times what they do.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["one_thread"]


def one_thread() -> AbstractContextManager[object]:
    """A context in which linear algebra uses one thread."""
    return _libraries().limit(limits=1, user_api="blas")


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  (with a library of its own, which is to be found too)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
