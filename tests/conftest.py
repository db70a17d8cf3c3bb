"""What several test modules share: the shipped models, each compiled once."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import cadet_sym as cs

ROOT = Path(__file__).resolve().parent.parent
SHIPPED = sorted((ROOT / "models").glob("*.toml"))


def pytest_configure(config):
    """Compiled models of the tests are kept apart from the user's: processes that share the tests out share these too."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        return  # the variable is inherited
    place = tempfile.mkdtemp(prefix="cadet-sym-tests-")
    config.add_cleanup(lambda: shutil.rmtree(place, ignore_errors=True))
    os.environ["CADET_SYM_CACHE"] = place


@cache
def _compiled(name: str) -> cs.CompiledModel:
    return cs.compile(cs.load(ROOT / "models" / f"{name}.toml"))


@pytest.fixture(scope="session")
def shipped():
    """The shipped model of a name, compiled: ``shipped("duffing")``."""
    return _compiled


@pytest.fixture(params=SHIPPED, ids=lambda path: path.stem)
def model_file(request) -> Path:
    """Every model file that ships."""
    return request.param


def half(cases: Iterable[Any]) -> list[Any]:
    """The cases, every other one of them left to the slow tests."""
    return one_in(2, cases)


def one_in(few: int, cases: Iterable[Any]) -> list[Any]:
    """The cases, all but one in so many of them left to the slow tests."""
    several = ((case if isinstance(case, tuple) else (case,)) for case in cases)
    return [pytest.param(*case, marks=[pytest.mark.slow] * (k % few > 0)) for k, case in enumerate(several)]
