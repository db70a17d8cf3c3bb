"""Turn a CasADi function into machine code, with the C compiler that is there, and keep it in the cache.

The code is found by the digest of its own C, so that it is never out of date; it is loaded only if it is, to the last
byte, what the compiler wrote.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import casadi as ca

from cadet_sym.cache import Shelf
from cadet_sym.errors import ModelError

__all__ = ["LARGEST", "find_compiler", "machine_code"]

LARGEST = 40_000
"""Operations of a function up to which compiling it takes seconds, not minutes."""

COMPILERS = ("cc", "gcc", "clang")


def find_compiler() -> str:
    """The C compiler: `CC` of the environment, or the first that is there.

    Raises
    ------
    ModelError
        If there is none.
    """
    wanted = [os.environ["CC"]] if os.environ.get("CC") else list(COMPILERS)
    for name in wanted:
        if found := shutil.which(name):
            return found
    raise ModelError(f"machine code needs a C compiler, but there is no {' or '.join(wanted)}; leave `jit` out.")


def machine_code(function: ca.Function, shelf: Shelf | None) -> ca.Function:
    """The same function, compiled; what was compiled before is loaded.

    Raises
    ------
    ModelError
        If there is no compiler, or it fails.
    """
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    text = generator.dump()
    name = f"{function.name()}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.so"
    place = _temporary() if shelf is None else shelf.path
    library = place / name
    if shelf is None or not library.is_file() or shelf.read(f"{name}.sum") != _sum(library):
        code = _compile(text)
        library = _keep(code, place, name)
        if shelf is not None and library.parent == shelf.path:
            shelf.write(f"{name}.sum", _sum(library))
    return ca.external(function.name(), str(library))


def _compile(text: str) -> bytes:
    compiler = find_compiler()
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "code.c", Path(folder) / "code.so"
        source.write_text(text)
        flags = ["-O2", "-ffp-contract=off", "-fPIC", "-shared"]
        command = [compiler, *flags, str(source), "-o", str(library), *([] if sys.platform == "win32" else ["-lm"])]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["no reason given"])[0]
            raise ModelError(f"`{compiler}` cannot compile the moment equations: {reason}; leave `jit` out.")
        return library.read_bytes()


def _keep(code: bytes, place: Path, name: str) -> Path:
    """Whole into its place; where that cannot be written to, into one that lasts as long as this process."""
    for folder in (place, _temporary()):
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            handle, beside = tempfile.mkstemp(prefix=".writing-", dir=folder)
            with os.fdopen(handle, "wb") as file:
                file.write(code)
            os.replace(beside, folder / name)
            return folder / name
    raise ModelError("machine code cannot be written anywhere; leave `jit` out.")


def _sum(library: Path) -> bytes:
    return hashlib.sha256(library.read_bytes()).digest()


@cache
def _temporary() -> Path:
    import atexit

    folder = tempfile.mkdtemp(prefix="cadet-sym-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
