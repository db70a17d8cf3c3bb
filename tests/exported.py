"""A compiled export in this process: the C functions by ctypes, with arrays for arguments."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


def compiler(name: str = "gcc") -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"no {name} on this machine")
    return found


def sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.c") if path.name not in ("main.c", "test.c"))


def build(folder: Path, into: Path, files: Sequence[Path], *options: str, by: str = "gcc") -> Path:
    command = [compiler(by), *STRICT, *options, f"-I{folder}", "-o", str(into), *map(str, files), "-lm"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return into


def shared(folder: Path, into: Path, *options: str, by: str = "gcc") -> Path:
    """The library of an export folder, to which programs may be linked; not optimised: most time goes into compiling."""
    return build(folder, into, sources(folder), *options, "-shared", "-fPIC", by=by)


class Exported:
    """The shared library of an export folder, double precision."""

    def __init__(self, folder: Path, prefix: str, into: Path):
        self.prefix = prefix
        self.path = shared(folder, into / f"{prefix}.so")
        self.library = ctypes.CDLL(str(self.path))

    def call(self, name: str, *arguments: object, result: int | None = None) -> np.ndarray:
        """Call prefix_name with numbers and arrays; with `result` also an array of so many values, returned."""
        extra = [] if result is None else [np.full(max(result, 1), np.nan)]
        self.function(name)(*[_argument(a) for a in [*arguments, *extra]])
        return extra[0][:result] if extra else np.zeros(0)

    def function(self, name: str):
        found = getattr(self.library, f"{self.prefix}_{name}")
        found.restype = ctypes.c_int
        return found

    def integers(self, name: str, count: int) -> np.ndarray:
        return np.array((ctypes.c_int * count).in_dll(self.library, f"{self.prefix}_{name}"))


def _argument(value: object) -> object:
    if isinstance(value, np.ndarray):
        assert value.dtype == float
        assert value.flags.c_contiguous
        return value.ctypes.data_as(ctypes.c_void_p)
    return ctypes.c_double(value) if isinstance(value, float) else value
