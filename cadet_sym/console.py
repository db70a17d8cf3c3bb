"""What the commands say and where: results on standard output; progress, warnings and failures on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from time import perf_counter
from typing import Any

__all__ = ["Stopwatch", "computing", "fail", "print_json", "print_written", "show_warning", "with_bar"]


@contextmanager
def computing() -> Iterator[None]:
    """Keep standard output for the result: whatever a library prints goes to standard error."""
    with redirect_stdout(sys.stderr):
        yield


def with_bar(values: Iterable[float], title: str) -> Iterable[float]:
    """The values, with a bar on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        return values
    from rich.console import Console
    from rich.progress import track

    return track(list(values), description=title, console=Console(stderr=True))


class Stopwatch:
    """The seconds that each part of a command took."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, part: str) -> None:
        """Write down how long it took from the last lap to here."""
        now = perf_counter()
        self.laps[part], self._last = now - self._last, now


def print_json(content: Mapping[str, Any]) -> None:
    """One object on a line of its own; what is no number is an error."""
    print(json.dumps(content, allow_nan=False))


def print_written(*files: Path | None) -> None:
    """Name the files that were asked for."""
    for file in files:
        if file is not None:
            print(f"Wrote {file}")


def fail(message: str, status: int) -> int:
    """Say what went wrong; returns the exit status."""
    print(f"cadet-sym: {message}", file=sys.stderr)
    return status


def show_warning(message: Warning | str, category: type[Warning], *where: object, **more: object) -> None:
    """A warning as a line, without the place in the program that it came from."""
    print(f"cadet-sym: warning: {message}", file=sys.stderr)
