"""Keep what was compiled on disk, so that another process need not make it again.

Everything is found by the digest of all that it follows from: the model's content, the sources of this package, the
versions of SymPy and CasADi. So nothing in the cache is ever out of date, and nothing is ever changed there: a file is
written beside its place and moved into it, whole, whoever else does the same. Each begins with a digest of its own
content; one that was cut off or written by someone else counts as missing. Where nothing can be written, nothing is
kept, and all else works as it does.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

__all__ = ["OFF", "VARIABLE", "Contents", "Shelf", "clear", "contents", "digest", "folder", "shelf"]

VARIABLE = "CADET_SYM_CACHE"
"""Environment variable that names the cache's folder ..."""

OFF = "off"
"""... or, with this value, says that there shall be none."""

MOST = 400
"""Entries kept; of more, those unused for the longest time go."""

_MAGIC = b"cadet-sym 1\n"
_DIGEST = 32


def folder() -> Path | None:
    """The cache's folder, whether it is there or not; None if there shall be none."""
    named = os.environ.get(VARIABLE, "")
    if named == OFF:
        return None
    if named:
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("cadet-sym", appauthor=False)


def digest(*parts: str | bytes) -> str:
    """What an entry is found by: of the parts and of the programs that make something of them."""
    found = hashlib.sha256(_programs())
    for part in parts:
        text = part.encode() if isinstance(part, str) else part
        found.update(len(text).to_bytes(8, "little") + text)
    return found.hexdigest()


@cache
def _programs() -> bytes:
    """All that decides what is made of a model besides the model: this package's sources, SymPy, CasADi, the machine."""
    from importlib.util import find_spec

    found = hashlib.sha256(platform.machine().encode())
    for name, inside in (("sympy", "release.py"), ("casadi", "casadi.py")):
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            found.update(_look(Path(spec.origin).with_name(inside)))
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        found.update(_look(source))
    return found.digest()


def _look(path: Path) -> bytes:
    with contextlib.suppress(OSError):
        seen = path.stat()
        return f"{path}:{seen.st_size}:{seen.st_mtime_ns}\n".encode()
    return b""


@dataclass(frozen=True)
class Shelf:
    """One entry: files that belong together."""

    path: Path

    def read(self, name: str) -> bytes | None:
        """What was written under a name; None if it is not there, or not whole."""
        try:
            text = (self.path / name).read_bytes()
        except OSError:
            return None
        head, body = text[: len(_MAGIC) + _DIGEST], text[len(_MAGIC) + _DIGEST :]
        return body if head == _MAGIC + hashlib.sha256(body).digest() else None

    def write(self, name: str, body: bytes) -> None:
        """Keep it, or do not where that is not possible; a reader sees all of it or nothing."""
        with contextlib.suppress(OSError):
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            handle, beside = tempfile.mkstemp(prefix=".writing-", dir=self.path)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(_MAGIC + hashlib.sha256(body).digest() + body)
                os.replace(beside, self.path / name)
            except BaseException:
                Path(beside).unlink(missing_ok=True)
                raise

    def use(self) -> None:
        """Note that the entry was of use."""
        with contextlib.suppress(OSError):
            os.utime(self.path)


def shelf(key: str) -> Shelf | None:
    """The entry of a digest; None if there is no cache."""
    place = folder()
    return None if place is None else Shelf(place / key)


@dataclass(frozen=True)
class Contents:
    """What a cache holds."""

    path: Path | None
    entries: int
    bytes: int


def contents() -> Contents:
    """Count the entries and what they take."""
    place = folder()
    entries = _entries(place)
    return Contents(place, len(entries), sum(_size(file) for entry in entries for file in _inside(entry)))


def clear() -> Contents:
    """Remove all entries, and nothing else; returns what there was."""
    found = contents()
    for entry in _entries(found.path):
        shutil.rmtree(entry, ignore_errors=True)
    return found


def trim() -> None:
    """Remove the entries that were not used for the longest time, where there are too many."""
    entries = _entries(folder())
    if len(entries) > MOST:
        oldest = sorted(entries, key=_age)[: len(entries) - MOST * 9 // 10]
        for entry in oldest:
            shutil.rmtree(entry, ignore_errors=True)


def _entries(place: Path | None) -> list[Path]:
    """Folders of the cache that are named by a digest."""
    return [] if place is None else [path for path in _inside(place) if _is_key(path.name) and path.is_dir()]


def _is_key(name: str) -> bool:
    return len(name) == 2 * _DIGEST and set(name) <= set("0123456789abcdef")


def _inside(place: Path) -> Iterable[Path]:
    try:
        return list(place.iterdir())
    except OSError:
        return []


def _size(path: Path) -> int:
    with contextlib.suppress(OSError):
        return path.stat().st_size
    return 0


def _age(path: Path) -> float:
    with contextlib.suppress(OSError):
        return path.stat().st_mtime
    return 0.0
