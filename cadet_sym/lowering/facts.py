"""What the numeric stages know of a model besides its functions: names, counts and numbers, no symbols.

Both records are kept as text beside the functions, so that a model that was compiled before needs no SymPy.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cadet_sym.delay import DelayGrid, Gap, TrackDelay
from cadet_sym.packing import Packing

if TYPE_CHECKING:
    from cadet_sym.language.model import Model

__all__ = ["Declaration", "Facts", "FilterPlace", "declaration"]


@dataclass(frozen=True)
class Declaration:
    """The numbers that a model declares."""

    name: str
    hash: str
    values: Mapping[str, float]  # every parameter, expressions worked out
    duration: float
    points: int
    rtol: float


def declaration(model: Model) -> Declaration:
    """The numbers of a model."""
    run = model.run
    return Declaration(
        model.name, model.hash, model.parameter_values(), model.number(run.duration), run.points, run.rtol
    )


@dataclass(frozen=True)
class FilterPlace:
    """One copy of the ground's filter: whose wheel it is under, and where its states are."""

    contact: str
    start: int
    size: int
    profile: bool  # whether it has a deterministic height


@dataclass(frozen=True)
class Facts:
    """A model's structure, as far as numbers are made of it."""

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]  # those with a number of their own: the entries of p
    packing: Packing
    vehicle: int  # how many of the states are the vehicle's own
    arguments: tuple[int, ...]  # of every element
    ground: bool  # whether there is any
    smooth: bool  # whether it is flat behind the start
    whole: bool  # whether the run starts in the stationary state
    known_distance: bool  # s(t) in closed form
    needs_distance: bool  # whether anything depends on s itself
    gated: bool  # whether wheels meet the ground one after the other
    explicit: str  # what depends on t or s explicitly, in words; empty if nothing does
    filters: tuple[FilterPlace, ...]
    delay: DelayGrid | None
    general: bool  # whether the functions serve for any numbers of the parameters
    speed_ends: float | None = None  # the last time at which a measured speed is known
    integrated: tuple[str, ...] = ()  # parameters whose numbers the order of a quadrature was chosen for
    doubts: tuple[str, ...] = ()  # what is warned of whenever the model is compiled, though it comes from the cache

    def to_json(self) -> bytes:
        """The facts as text."""
        return json.dumps(dataclasses.asdict(self)).encode()

    @classmethod
    def from_json(cls, text: bytes) -> Facts:
        """The facts from the text that `to_json` gives."""
        found: dict[str, Any] = json.loads(text)
        found["packing"] = Packing(**found["packing"])
        found["filters"] = tuple(FilterPlace(**each) for each in found["filters"])
        found["delay"] = _delay(found["delay"])
        for name in ("states", "outputs", "parameters", "arguments", "integrated", "doubts"):
            found[name] = tuple(found[name])
        return cls(**found)


def _delay(found: Mapping[str, Any] | None) -> DelayGrid | None:
    if found is None:
        return None
    tracks = tuple(
        TrackDelay(
            tuple(map(tuple, track["columns"])),
            tuple(Gap(gap["elements"], gap["modes"], tuple(gap["known"])) for gap in track["gaps"]),
        )
        for track in found["tracks"]
    )
    return DelayGrid(found["rows"], tracks)
