"""The [ground] table of a model file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language import ground as grounds
from cadet_sym.language.element import declared_name
from cadet_sym.language.entries import CURVE_KEYS, Entries, noise_names, read_noise
from cadet_sym.language.ground import Ground
from cadet_sym.language.names import did_you_mean
from cadet_sym.language.places import Places
from cadet_sym.language.scope import Scope
from cadet_sym.language.vocabulary import DISTANCE, symbol

_COMMON = ("kind", "rolling_contact", "contact_patch", "profile", "coherence")
_TABLE = ("table", "columns", "units", "order")


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
    if "contact_patch" in entries.content:
        ground = ground.contact_patch(*_patch(entries, scope))
    if "rolling_contact" in entries.content:
        ground = ground.rolling_contact(entries.expression("rolling_contact", scope))
    if "coherence" in entries.content:
        ground = _coherent(ground, Entries("ground.coherence", entries.get("coherence", dict)), scope)
    return ground


def _coherent(ground: Ground, entries: Entries, scope: Scope) -> Ground:
    tracks = entries.get("tracks", list)
    if not all(isinstance(name, str) for name in tracks):
        raise ModelError("the names of two different tracks are wanted", table="ground.coherence", key="tracks")
    if "width" in entries.content:
        entries.only(["tracks", "width"])
        return ground.coherent(tracks, width=entries.expression("width", scope))
    entries.only(["tracks", "numerator", "denominator"])
    return ground.coherent(tracks, *(_coefficients(entries, key, scope) for key in ("numerator", "denominator")))


def _profile(entries: Entries, places: Places, curve: Callable[..., sp.Expr]) -> sp.Expr:
    written = entries.content["profile"]
    if isinstance(written, Mapping):
        inner = Entries("ground.profile", written).only(CURVE_KEYS)
        return curve(inner, DISTANCE, ("length", "length"), "hold", "linear")
    return entries.expression("profile", places.ground([], ()).ground_number())


def _patch(entries: Entries, scope: Scope) -> tuple[sp.Expr, int]:
    written = entries.content["contact_patch"]
    if not isinstance(written, Mapping):
        return entries.expression("contact_patch", scope), 2
    inner = Entries("ground.contact_patch", written).only(["length", "order"])
    inner.get("length", (str, int, float))
    return inner.expression("length", scope), inner.get("order", int, 2)


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


def _iso8608(entries: Entries, places: Places, curve: Any) -> Ground:
    scope = places.ground([], ()).ground_number()
    keys = [key for key in ("gd", "n0", "omega0", "waviness", "cutoff") if key in entries.content]
    given: dict[str, Any] = {key: entries.expression(key, scope) for key in keys}
    if "order" in entries.content:
        given["order"] = entries.get("order", int)
    return grounds.iso8608(entries.get("class", str, None), **given)


def _coefficients(entries: Entries, key: str, scope: Scope) -> list[Any]:
    """A list of numbers, or of pairs of numbers."""
    return [
        tuple(entries.expression(key, scope, part) for part in value)
        if isinstance(value, list)
        else entries.expression(key, scope, value)
        for value in entries.get(key, list)
    ]


def _spectrum(entries: Entries, places: Places, curve: Any) -> Ground:
    scope = places.ground([], ()).ground_number()
    if "table" not in entries.content:
        entries.only([*_COMMON, "numerator", "denominator", "sides"])
        numerator, denominator = (_coefficients(entries, key, scope) for key in ("numerator", "denominator"))
        return grounds.spectrum(numerator, denominator, entries.get("sides", int, 1))
    entries.only([*_COMMON, *_TABLE])
    units = entries.names("units") if "units" in entries.content else []
    if len(units) != 2 or not ({"cycle/m", "rad/m"} & {units[0]}):
        raise ModelError(
            'say what the spectrum is against: units = ["cycle/m", "m^3"] or ["rad/m", "m^3/rad"]',
            table="ground",
            key="units",
        )
    kappa, density = _columns(entries, curve, ("wavenumber", "spectrum"))
    if units[0] == "cycle/m":  # G(n) dn = G(kappa) dkappa, kappa = 2 pi n
        kappa, density = 2 * np.pi * kappa, density / (2 * np.pi)
    return _fitted(entries, "fit_spectrum", kappa, density)


def _profile_kind(entries: Entries, places: Places, curve: Any) -> Ground:
    entries.get("table", (str, list))
    return _fitted(entries, "fit_profile", *_columns(entries, curve, ("length", "length")))


def _columns(entries: Entries, curve: Callable[..., Any], kinds: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    measured = curve(entries, DISTANCE, kinds, "hold", "linear")
    return np.array([float(z) for z in measured.knots]), np.array([float(f) for f in measured.values])


def _fitted(entries: Entries, how: str, *columns: np.ndarray) -> Ground:
    from cadet_sym.language import roadfit

    try:
        return getattr(roadfit, how)(*columns, order=entries.get("order", int, 2)).ground
    except ModelError as error:
        raise error.placed(table="ground", key="table") from None


def _sections(entries: Entries, places: Places, curve: Any) -> Ground:
    scope = places.ground([], ()).ground_number()
    zeros, poles = (_coefficients(entries, key, scope) for key in ("zeros", "poles"))
    entries.get("gain", (str, int, float))
    return grounds.sections(zeros, poles, entries.expression("gain", scope))


# kind -> its keys, and what reads them
_READERS: dict[str, tuple[tuple[str, ...], Any]] = {
    "exponential": _numbers(grounds.exponential, "sigma", "cutoff"),
    "second_order": _numbers(grounds.second_order, "sigma", "cutoff", "wavenumber"),
    "iso8608": (("class", "gd", "n0", "omega0", "waviness", "cutoff", "order"), _iso8608),
    "shaping_filter": (("rates", "noise", "height"), _shaping_filter),
    "spectrum": (("numerator", "denominator", "sides", *_TABLE), _spectrum),
    "profile": (_TABLE, _profile_kind),
    "sections": (("zeros", "poles", "gain"), _sections),
}
