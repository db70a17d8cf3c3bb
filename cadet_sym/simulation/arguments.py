"""What `simulate` is asked for, checked: each refusal is one sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from cadet_sym.errors import ModelError
from cadet_sym.language import sense
from cadet_sym.language.model import Model

__all__ = ["CHECKED", "check_numbers", "checked_scheme", "choose_engine", "increasing", "output_times", "places_of"]

_LEAST = {"paths": 2, "seed": 0, "keep": 0, "threads": 1}
_FROM_ZERO = ("run_in", "average_from")
# Numbers among the options.
CHECKED = ("seed", "step", "level", "keep", "run_in", "average_from", "threads", "target", "time_limit")


def check_numbers(**given: Any) -> None:
    """Refuse arguments that no simulation can be run with; None is left alone."""
    for name, value in given.items():
        if value is None:
            continue
        if name in _LEAST:
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            if not whole or value < _LEAST[name]:
                other = ', or "auto"' if name == "paths" else ""
                raise ModelError(f"simulate: `{name}` is a whole number, {_LEAST[name]} or more{other}; found {value!r}")
        elif name == "level":
            if not _is_number(value) or not 0.0 < value < 1.0:
                raise ModelError(f"simulate: `level` is a probability between 0 and 1; found {value!r}")
        elif not _is_number(value) or value < 0.0 or (value == 0.0 and name not in _FROM_ZERO):
            what = "not negative" if name in _FROM_ZERO else "greater than zero"
            kind = "number" if name == "target" else "time"
            raise ModelError(f"simulate: `{name}` is a {kind} {what}; found {value!r}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def output_times(model: Model, times: Sequence[float] | np.ndarray | None) -> np.ndarray:
    """The times asked for, or those of the model's run."""
    if times is None:
        return np.linspace(0.0, model.number(model.run.duration), model.run.points)
    time = np.array(times, dtype=float)
    if time.ndim != 1 or not len(time) or not np.isfinite(time).all() or time[0] < 0.0 or (np.diff(time) <= 0).any():
        raise ModelError(
            f"simulate: `times` are increasing numbers, the first not negative; found {np.asarray(times).tolist()!r}"
        )
    if time[-1] == 0.0:
        raise ModelError("simulate: `times` hold nothing but 0; the moments there are the initial ones")
    if time[-1] > model.number(model.run.duration):
        sense.travels(model, float(time[-1]))
    return time


def choose_engine(engine: str | None) -> str:
    """The engine asked for if it is there; numba if it is installed."""
    if engine not in (None, "numba", "numpy"):
        raise ModelError(f'simulate: `engine` is "numba" or "numpy"; found {engine!r}')
    there = find_spec("numba") is not None
    if engine == "numba" and not there:
        raise ModelError('simulate: `engine="numba"` needs numba, which is not installed; take "numpy" or install it')
    return engine or ("numba" if there else "numpy")


def checked_scheme(scheme: str | None) -> str | None:
    """The scheme asked for, if there is such a one."""
    if scheme not in (None, "heun", "exponential"):
        raise ModelError(f'simulate: `scheme` is "heun" or "exponential"; found {scheme!r}')
    return scheme


def places_of(names: Sequence[str], known: Sequence[str], argument: str) -> list[int]:
    """Where states and outputs asked for by name are among the quantities."""
    if isinstance(names, str):
        raise ModelError(f"simulate: `{argument}` is a list of names, as [{names!r}]")
    for name in names:
        if name not in known:
            raise ModelError(f"simulate: `{argument}`: there is no state or output `{name}`; there are {', '.join(known)}")
    return [list(known).index(name) for name in names]


def increasing(values: Mapping[str, Any], argument: str) -> dict[str, tuple[float, ...]]:
    """Lists of increasing numbers by the name of a state or output."""
    found = {}
    for name, numbers in values.items():
        row = np.atleast_1d(np.asarray(numbers, dtype=float))
        if row.ndim != 1 or not len(row) or not np.isfinite(row).all() or (np.diff(row) <= 0.0).any():
            raise ModelError(f"simulate: `{argument}` of `{name}` are increasing numbers; found {numbers!r}")
        found[name] = tuple(row.tolist())
    return found
