"""Functions in Python as machine code without the interpreter's lock, by numba; kept on disk where there is a place for it.

Among them the two of a program, in which the model's own formulas stand: `advance` and `record`.
"""

from __future__ import annotations

import hashlib
import math
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.core import config

from cadet_sym.simulation.curves import PIECE
from cadet_sym.simulation.step import LANES

__all__ = ["ADVANCE", "BOX", "INT", "NAMESPACE", "RECORD", "TABLE", "VECTOR", "compile_program", "jit"]

_OPTIONS = {"nogil": True, "error_model": "numpy"}
INT, VECTOR, TABLE, BOX = types.int64, *(types.Array(types.float64, n, "C") for n in (1, 2, 3))
ADVANCE = types.void(VECTOR, VECTOR, INT, INT, INT, INT, TABLE, TABLE, TABLE, VECTOR, VECTOR, VECTOR)
RECORD = types.void(VECTOR, VECTOR, INT, TABLE, VECTOR, VECTOR, BOX, INT, INT)


_KEPT: list[Any] = []  # functions whose machine code may be on disk


def jit(function: Callable[..., Any], *signature: Any, on_disk: bool = True) -> Any:
    """Compile without the interpreter's lock; keep the machine code on disk where there is a place for it.

    numba compiles again when the file has changed. What it finds on disk and cannot read (an index written before a
    module was renamed, half a file) is thrown away and written anew, or else done without.
    """
    for attempt in range(2 if on_disk else 0):
        try:
            dispatcher = numba.njit(*signature, cache=True, **_OPTIONS)(function)
        except RuntimeError:  # no folder can be written to
            break
        except Exception:
            if attempt or not _forget(function):
                break
        else:
            _KEPT.append(dispatcher)
            return dispatcher
    return numba.njit(*signature, **_OPTIONS)(function)


def _forget(function: Callable[..., Any]) -> bool:
    """Empty the indices on disk of a function and of all that it may call; whether that could be done."""
    try:
        fresh: Any = numba.njit(cache=True, **_OPTIONS)(function)
        for dispatcher in (*_KEPT, fresh):
            dispatcher._cache.flush()
    except Exception:
        return False
    return True


def _where(condition, a, b):
    return a if condition else b


def _minimum(a, b):
    return a if a < b or a != a else b


def _maximum(a, b):
    return a if a > b or a != a else b


def _sign(z):
    return 1.0 if z > 0.0 else (-1.0 if z < 0.0 else 0.0 * z)


def _heaviside(z, at_zero):
    return 1.0 if z > 0.0 else (0.0 if z < 0.0 else (at_zero if z == 0.0 else z))


def _power(a, b):
    return math.pow(a, b)


def _not(condition):
    return not condition


def _lookup(z, table, first, count):
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if z < table[first + middle]:
            high = middle
        else:
            low = middle + 1
    p = first + count + PIECE * low
    d = z - table[p]
    return table[p + 1] + d * (table[p + 2] + d * (table[p + 3] + d * table[p + 4]))


_NAMES = ("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "erf")
NAMESPACE: dict[str, Any] = {
    **{name: getattr(math, name) for name in (*_NAMES, "fabs", "nan", "inf")},
    "LANES": LANES,
    **{
        name: numba.njit(function, error_model="numpy")
        for name, function in {
            "where": _where,
            "minimum": _minimum,
            "maximum": _maximum,
            "sign": _sign,
            "heaviside": _heaviside,
            "power": _power,
            "not_": _not,
            "lookup": _lookup,
        }.items()
    },
}


@cache
def compile_program(source: str) -> tuple[Any, Any]:
    """`advance` and `record` of a program, compiled, or taken from disk if they were compiled before.

    Their names end in a digest of all that the machine code is made from: source, this module, versions. Machine code
    is found by the names of functions, so two programs must never share one.
    """
    made_from = (source, Path(__file__).read_text(encoding="utf-8"), numba.__version__, sys.version)
    digest = hashlib.sha256("\n".join(made_from).encode()).hexdigest()[:32]
    for name in ("advance", "record"):
        source = source.replace(f"def {name}(", f"def {name}_{digest}(")
    place = _file_for(source, digest)
    scope = {**NAMESPACE, "__name__": __name__}
    exec(compile(source, place or "<cadet_sym.simulation>", "exec"), scope)
    advance, record = (
        jit(scope[f"{name}_{digest}"], signature, on_disk=place is not None)
        for name, signature in (("advance", ADVANCE), ("record", RECORD))
    )
    return advance, record


def _file_for(source: str, digest: str) -> str | None:
    """A file that holds the source, beside which numba keeps the machine code; None where none can be written.

    The file itself is never run, what was just written is.
    """
    folder = Path(getattr(config, "CACHE_DIR", "") or _cache_folder()) / "cadet-sym"
    path = folder / f"program_{digest}.py"
    try:
        if not path.exists():
            folder.mkdir(parents=True, exist_ok=True)
            fresh = folder / f".{digest}.{os.getpid()}"
            fresh.write_text(source, encoding="utf-8")
            fresh.replace(path)
        (folder / "__pycache__").mkdir(exist_ok=True)
        return str(path) if os.access(folder / "__pycache__", os.W_OK) else None
    except OSError:
        return None


def _cache_folder() -> str:
    """Where this user's caches are."""
    home = os.environ.get("LOCALAPPDATA") or os.environ.get("XDG_CACHE_HOME")
    return home or os.path.join(os.path.expanduser("~"), ".cache")
