"""The [ground] table of a model file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language import ground as grounds
from cadet_sym.language.element import declared_name
from cadet_sym.language.ground import Ground
from cadet_sym.language.parser import did_you_mean
from cadet_sym.language.places import Places
from cadet_sym.language.vocabulary import DISTANCE, symbol

if TYPE_CHECKING:
    from cadet_sym.language.modelfile import Entries

_COMMON = ("kind", "rolling_contact", "profile")


def read_ground(entries: Entries, places: Places, curve: Callable[..., sp.Expr]) -> Ground:
    """A ground of one of the kinds, with its rolling contact and its profile."""
    kind = entries.get("kind", str)
    if kind not in _READERS:
        known = did_you_mean(kind, _READERS) or f"; there are {', '.join(_READERS)}"
        raise ModelError(
            f"there is no ground of kind `{kind}`{known}",
            table="ground",
            key="kind",
            token=kind,
        )
    keys, read = _READERS[kind]
    entries.only([*_COMMON, *keys])
    scope = places.ground([], ()).ground_number()
    ground = read(entries, places, curve)
    if "profile" in entries.content:
        ground = ground.with_profile(_profile(entries, places, curve))
    if "rolling_contact" in entries.content:
        ground = ground.rolling_contact(entries.expression("rolling_contact", scope))
    return ground


def _profile(entries: Entries, places: Places, curve: Callable[..., sp.Expr]) -> sp.Expr:
    from cadet_sym.language.modelfile import CURVE_KEYS, Entries

    written = entries.content["profile"]
    if isinstance(written, Mapping):
        inner = Entries("ground.profile", written).only(CURVE_KEYS)
        return curve(inner, DISTANCE, ("length", "length"), "hold", "linear")
    return entries.expression("profile", places.ground([], ()).ground_number())


def _numbers(make: Callable[..., Ground], *keys: str, optional: tuple[str, ...] = ()) -> tuple[tuple[str, ...], Any]:
    """A reader for a kind that is given by numbers only."""

    def read(entries: Entries, places: Places, curve: Any) -> Ground:
        scope = places.ground([], ()).ground_number()
        for key in keys:
            entries.get(key, (str, int, float))
        given = [key for key in (*keys, *optional) if key in entries.content]
        return make(**{key: entries.expression(key, scope) for key in given})

    return (*keys, *optional), read


def _shaping_filter(entries: Entries, places: Places, curve: Any) -> Ground:
    from cadet_sym.language.modelfile import Entries, noise_names, read_noise

    rates = Entries("ground.rates", entries.get("rates", dict))
    states = [declared_name(name, "state", table="ground.rates", key=name) for name in rates.content]
    noise = Entries("ground.noise", entries.get("noise", dict, {}))
    noises = [declared_name(name, "noise", table="ground.noise", key=name) for name in noise_names(noise)]
    own = places.ground(states, noises)
    equations = {symbol(name): rates.expression(name, own.ground_rate()) for name in states}
    height = entries.expression("height", own.ground_height()) if "height" in entries.content else None
    if height is None:
        raise ModelError("`height` is missing: say which of the states is the height", table="ground")
    intensity = read_noise(noise, own.ground_number()) if noises else None
    return grounds.shaping_filter(equations, intensity, height)


_READERS: dict[str, tuple[tuple[str, ...], Any]] = {
    "exponential": _numbers(grounds.exponential, "sigma", "cutoff"),
    "shaping_filter": (("rates", "noise", "height"), _shaping_filter),
}
