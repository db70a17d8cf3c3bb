"""What is written behind the options of the command line: ``NAME=VALUE``, ``T1,T2``, ``NAME=LO:HI:N``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

import numpy as np

from cadet_sym.errors import ModelError

__all__ = ["one_set_each", "parse_paths", "parse_range", "parse_setting", "parse_sweep", "parse_times"]

SETTING = re.compile(r"[^\W\d]\w*=.+")


def one_set_each(words: Iterable[str]) -> list[str]:
    """``--set r=1 a=2`` as ``--set r=1 --set a=2``."""
    spread: list[str] = []
    inside = False
    for word in words:
        if inside and spread[-1] != "--set" and SETTING.fullmatch(word) and not word.endswith(".toml"):
            spread.append("--set")
        inside = word == "--set" or word.startswith("--set=") or (inside and spread[-1] == "--set")
        spread.append(word)
    return spread


def parse_setting(text: str) -> tuple[str, str]:
    """Name and value of one ``--set``."""
    name, equals, value = text.partition("=")
    if not (equals and name.strip() and value.strip()):
        raise ModelError(f"--set {text}: expected NAME=VALUE, as in --set r=1")
    return name.strip(), value.strip()


def parse_paths(text: str, target: float | None, time_limit: float | None) -> int | Literal["auto"]:
    """A number of paths, or "auto", to which alone a target and a time limit belong."""
    if text == "auto":
        return "auto"
    for option, value in (("--target", target), ("--time-limit", time_limit)):
        if value is not None:
            raise ModelError(f"{option} {value:g}: it says when there are enough paths; give --paths auto with it")
    try:
        return int(text)
    except ValueError:
        raise ModelError(f"--paths {text}: expected a whole number or auto") from None


def parse_times(text: str) -> list[float]:
    """Numbers with commas between."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise ModelError(
            f"--times {text}: expected numbers with commas between, as in --times 1,5,10"
        ) from None


def parse_sweep(text: str, option: str = "--sweep") -> tuple[str, np.ndarray]:
    """Name and values of a sweep, behind the option named."""
    found = re.fullmatch(r"\s*([^=]+?)\s*=([^:]+):([^:]+):\s*(\d+)\s*", text)
    try:
        if not found:
            raise ValueError
        low, high, count = float(found[2]), float(found[3]), int(found[4])
        if count < 1 or not np.isfinite([low, high]).all():
            raise ValueError
    except ValueError:
        raise ModelError(f"{option} {text}: expected NAME=LO:HI:N, as in {option} r=0:1:11") from None
    return found[1], np.linspace(low, high, count)


def parse_range(text: str, option: str) -> tuple[str, tuple[float, float]]:
    """Name and ends of a range, behind the option named."""
    found = re.fullmatch(r"\s*([^=]+?)\s*=([^:]+):([^:]+)", text)
    try:
        if not found:
            raise ValueError
        low, high = float(found[2]), float(found[3])
        if not (np.isfinite([low, high]).all() and low < high):
            raise ValueError
    except ValueError:
        raise ModelError(f"{option} {text}: expected NAME=LO:HI with LO below HI, as in {option} r=0:1") from None
    return found[1], (low, high)
