"""The ground along the track: random, by its shaping filter, and deterministic, by its profile.

Each constructor gives a `Ground`, which remembers how it was declared and makes its `ShapingFilter` in distance.
Numbers may be expressions in parameters; where it makes sense (sigma, gd, cut-offs, intensities) also in `s`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.canonical import canonical
from cadet_sym.language.coherence import Coherence
from cadet_sym.language.element import declared_name
from cadet_sym.language.frozen import FrozenDict
from cadet_sym.language.kinks import breakpoints
from cadet_sym.language.names import did_you_mean
from cadet_sym.language.noise import Noise
from cadet_sym.language.patch import patched
from cadet_sym.language.roadfilters import CLASSES, CYCLE, FILTERS, RADIAN
from cadet_sym.language.shaping import ShapingFilter, rolled, with_profile
from cadet_sym.language.vocabulary import DISTANCE, symbol

__all__ = [
    "Ground",
    "ShapingFilter",
    "exponential",
    "iso8608",
    "second_order",
    "sections",
    "shaping_filter",
    "spectrum",
]


@dataclass(frozen=True)
class Ground:
    """The ground under one track. Made by `exponential`, `iso8608`, `shaping_filter`, ...

    Parameters
    ----------
    kind : the declaration's kind, the same word as in a model file.
    settings : what that kind was given.
    rolling : cut-off of the rolling contact in rad per unit of length, or None.
    profile : deterministic height as an expression in `s`, or None.
    patch : (length, order) of the contact patch, or None.
    coherence : what two of the tracks share, or None; tracks are independent otherwise.
    """

    kind: str
    settings: FrozenDict[str, Any] = field(default_factory=FrozenDict)
    rolling: sp.Expr | None = None
    profile: sp.Expr | None = None
    patch: tuple[sp.Expr, int] | None = None
    coherence: Coherence | None = None

    def rolling_contact(self, cutoff: Any) -> Ground:
        """The same ground under a rolling contact, a first-order low-pass in distance: u' = cutoff (h - u)."""
        return replace(self, rolling=_positive(cutoff, "rolling_contact"))

    def with_profile(self, profile: Any) -> Ground:
        """The same ground with a deterministic height added, an expression in `s`.

        It is zero before s = 0 unless it says otherwise, by a condition on an `s` of 0 or less.
        """
        return replace(self, profile=canonical(profile))

    def contact_patch(self, length: Any, order: int = 2) -> Ground:
        """The same ground averaged over a contact patch of a length: u = mean of the height from s - length to s.

        A filter of that order stands for the moving average (Pade approximant), before any rolling contact.
        """
        if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= 12:
            raise ModelError(f"a filter of order 1 to 12 is wanted, not {order!r}", table="ground", key="contact_patch")
        return replace(self, patch=(_positive(length, "contact_patch"), order))

    def coherent(
        self,
        tracks: Sequence[str],
        numerator: Sequence[Any] = (),
        denominator: Sequence[Any] = (),
        *,
        width: Any = None,
    ) -> Ground:
        """The same ground with two coherent tracks.

        Parameters
        ----------
        tracks : their names.
        numerator, denominator : coherence as a rational function: coefficients of kappa^0, kappa^1, ... (rad/length).
        width : in their place, the distance of the tracks on isotropic ground (see `Coherence.isotropic`).
        """
        if width is not None:
            return replace(self, coherence=Coherence.isotropic(tracks, width))
        top, bottom = (tuple(canonical(c) for c in part) for part in (numerator, denominator))
        pair: Any = (*tracks,)  # that they are two is looked at there
        return replace(self, coherence=Coherence(pair, top, bottom))

    def filters(self, track: str) -> tuple[tuple[str, ShapingFilter, int], ...]:
        """What the height along a track is the sum of: (virtual track, filter, weight); one, itself, if it is alone."""
        road = self.shaping_filter()
        if self.coherence is None or track not in self.coherence.tracks:
            return ((track, road, 1),)
        (pair, common), (apart, difference) = self.coherence.parts(road)
        parts = (pair, common, 1), (apart, difference, 1 if track == self.coherence.tracks[0] else -1)
        return tuple(part for part in parts if not part[1].is_flat) or parts[:1]  # of full coherence one is

    def shaping_filter(self) -> ShapingFilter:
        """The filter in distance, profile, patch and rolling contact included: xi' = C xi + D w + offset."""
        return self._filter

    @cached_property
    def _filter(self) -> ShapingFilter:
        road = FILTERS[self.kind](**self.settings)
        if self.profile is not None:
            road = with_profile(road, started(self.profile))
        if self.patch is not None:
            road = patched(road, *self.patch)
        return road if self.rolling is None else rolled(road, self.rolling)

    @property
    def breakpoints(self) -> tuple[sp.Expr, ...]:
        """Positions s, expressions in parameters, at which a coefficient or the profile has a kink or a step."""
        road = self.shaping_filter()
        parts = [*road.C, *road.D, *road.Q, *road.F, *road.offset, road.profile]
        return breakpoints(parts, DISTANCE)

    @property
    def note(self) -> str:
        """How the filter was obtained, where it is not exact: order, band and error of a fit."""
        waviness = self.settings.get("waviness", 2) if self.kind == "iso8608" else 2
        notes = []
        if waviness != 2:
            from cadet_sym.language.waviness import UPPER, fitted_power

            cutoff, order = float(self.settings["cutoff"]), self.settings["order"]
            error = fitted_power(float(waviness), cutoff, order).error
            notes.append(
                f"waviness {float(waviness):g} by a fitted filter of order {order}, at most {100 * error:.2g} % off "
                f"between {cutoff:.3g} and {UPPER:.3g} rad/m"
            )
        if self.patch is not None:
            notes.append(f"contact patch by a Pade approximant of order {self.patch[1]}")
        return "; ".join(notes)


def started(profile: sp.Expr) -> sp.Expr:
    """A profile that is zero before s = 0, unless it says itself what is there."""
    tests = profile.atoms(sp.core.relational.Relational)
    if profile == 0 or any(_speaks_of_the_start(test) for test in tests):
        return profile
    before = sp.StrictLessThan(DISTANCE, 0, evaluate=False)
    return sp.Piecewise((sp.S.Zero, before), (profile, sp.true), evaluate=False)


def _speaks_of_the_start(test: Any) -> bool:
    return DISTANCE in test.free_symbols and bool(test.rhs.is_Rational and test.rhs <= 0)


# --------------------------------------------------------------------------- kinds


def exponential(sigma: Any, cutoff: Any) -> Ground:
    """Ground of autocovariance R(d) = sigma^2 exp(-cutoff |d|) (Harrison & Hammond 1986, eq 25).

    h' = -cutoff h + sigma sqrt(2 cutoff) w(s), E[w w'] = delta. State `height`; with rolling contact also `slope`.

    Parameters
    ----------
    sigma : rms height, unit of length.
    cutoff : rad per unit of length.
    """
    return _ground("exponential", sigma=_number(sigma, "sigma"), cutoff=_positive(cutoff, "cutoff"))


def second_order(sigma: Any, cutoff: Any, wavenumber: Any) -> Ground:
    """Ground of autocovariance R(d) = sigma^2 exp(-cutoff |d|) cos(wavenumber d): roads with a dominant wave.

    States `height` and `slope` (its derivative less the noise in it).

    Parameters
    ----------
    sigma : rms height, unit of length.
    cutoff, wavenumber : rad per unit of length.
    """
    return _ground(
        "second_order",
        sigma=_number(sigma, "sigma"),
        cutoff=_positive(cutoff, "cutoff"),
        wavenumber=_number(wavenumber, "wavenumber"),
    )


def iso8608(
    road_class: str | None = None,
    *,
    gd: Any = None,
    n0: Any = None,
    omega0: Any = None,
    waviness: Any = 2,
    cutoff: Any = None,
    order: int = 6,
) -> Ground:
    """Road of ISO 8608: one-sided spectrum G(n) = gd (n / n0)^-waviness.

    h' = -cutoff h + w(s) with the two-sided intensity Q = 2 pi^2 n0^2 gd: half of the one-sided one. State `height`.

    Parameters
    ----------
    road_class : "A" to "H": the geometric mean of the class.
    gd : degree of roughness in its place: m^3 against cycle/m at n0, or m^3 against rad/m at omega0.
    n0 : reference in cycle/m, 0.1 if none is given.
    omega0 : reference in rad/m in its place, as 1.0; classes are then 1, 4, 16, ... in 1e-6 m^3.
    waviness : exponent; one other than 2 needs a `cutoff` and is fitted by a filter of that `order` (`Ground.note`).
    cutoff : rad/m; none: integrated white noise, which has no stationary height.
    """
    if (road_class is None) == (gd is None):
        what = "neither" if gd is None else "both"
        raise ModelError(f"either a `class`, A to H, or `gd` is wanted, {what} given", table="ground")
    if n0 is not None and omega0 is not None:
        raise ModelError("either `n0` in cycle/m or `omega0` in rad/m is wanted, both given", table="ground")
    key = "omega0" if omega0 is not None else "n0"
    usual = RADIAN if omega0 is not None else CYCLE
    at = _positive(omega0 if omega0 is not None else usual if n0 is None else n0, key)
    if road_class is not None:
        gd = _class_density(road_class, at, usual, key)
    settings: dict[str, Any] = {"gd": _number(gd, "gd"), key: at}
    if cutoff is not None:
        settings["cutoff"] = _positive(cutoff, "cutoff")
    waviness = canonical(waviness)
    if waviness != 2:
        settings |= {"waviness": _literal(waviness, "waviness"), "order": order}
        _literal(settings.get("cutoff", sp.S.Zero), "cutoff")
    made = _ground("iso8608", **settings)
    made.shaping_filter()
    return made


def _class_density(road_class: str, at: sp.Expr, usual: sp.Expr, key: str) -> sp.Expr:
    if road_class not in CLASSES:
        raise ModelError(f"the classes of ISO 8608 are A to H, not {road_class!r}", table="ground", key="class")
    if at != usual:
        raise ModelError(
            f"a class is stated at {key} = {float(usual):g}: leave `{key}` out, or give `gd`", table="ground", key=key
        )
    factor = 16 if key == "n0" else 1
    return sp.Rational(factor * CLASSES[road_class], 10**6)


def spectrum(numerator: Sequence[Any], denominator: Sequence[Any], sides: int = 1) -> Ground:
    """Ground of a rational spectrum G(kappa) = numerator / denominator, by spectral factorisation.

    Parameters
    ----------
    numerator, denominator : coefficients of kappa^0, kappa^1, ... (kappa in rad per length): numbers, odd ones zero.
    sides : 1: one-sided, the variance is the integral over kappa > 0; 2: over all kappa.
    """
    if sides not in (1, 2):
        raise ModelError(f"a spectrum has 1 or 2 sides, not {sides!r}", table="ground", key="sides")
    given: dict[str, Any] = {}
    for key, coefficients in (("numerator", numerator), ("denominator", denominator)):
        if isinstance(coefficients, str) or not hasattr(coefficients, "__iter__"):
            raise ModelError("a list of coefficients is wanted", table="ground", key=key)
        given[key] = tuple(_literal(canonical(c), key) for c in coefficients)
    made = _ground("spectrum", **given, sides=sides)
    made.shaping_filter()
    return made


def sections(zeros: Sequence[Any], poles: Sequence[Any], gain: Any) -> Ground:
    """Ground h = gain prod (p + z) / prod (p + q) w, E[w w'] = delta: what a fit to a measured road gives.

    Parameters
    ----------
    zeros, poles : break wavenumbers in rad per length, or (wavenumber, damping) for a pair; fewer zeros than poles.
    gain : of the highest power.
    """
    given: dict[str, tuple[Any, ...]] = {}
    degrees = {}
    for key, roots in (("zeros", zeros), ("poles", poles)):
        given[key] = tuple(_root(root, key) for root in roots)
        degrees[key] = sum(2 if isinstance(root, tuple) else 1 for root in given[key])
    if degrees["zeros"] >= degrees["poles"]:
        raise ModelError(
            f"a road has more poles than zeros: {degrees['poles']} and {degrees['zeros']} found",
            table="ground",
            key="zeros",
        )
    return _ground("sections", **given, gain=_number(gain, "gain"))


def _root(root: Any, key: str) -> Any:
    if isinstance(root, Sequence) and not isinstance(root, str):
        if len(root) != 2:
            raise ModelError("a pair is [wavenumber, damping]", table="ground", key=key)
        return tuple(_positive(part, key) for part in root)
    value = _number(root, key)
    if value.is_Rational and value < 0:
        raise ModelError(f"a wavenumber that is not negative is wanted, not {value}", table="ground", key=key)
    return value


def shaping_filter(
    rates: Mapping[Any, Any], noise: Noise | Mapping[Any, Any] | None = None, height: Any = None
) -> Ground:
    """Ground by its own first-order equations in distance.

    Parameters
    ----------
    rates : state -> d(state)/ds, linear in states and noises; coefficients may depend on parameters and `s`.
    noise : `Noise`, or a mapping of noise to intensity; none: a ground without a random part.
    height : the height, linear in the states; the first state if none is given.
    """
    declared: dict[sp.Symbol, sp.Expr] = {}
    for key, rate in rates.items():
        name = declared_name(key, "state", table="ground.rates")
        try:
            declared[symbol(name)] = canonical(rate)
        except ModelError as error:
            raise error.placed(table="ground.rates", key=name) from None
    if not declared:
        raise ModelError("a shaping filter has at least one state", table="ground", key="rates")
    noise = noise if isinstance(noise, Noise) or noise is None else Noise.independent(noise)
    height = canonical(next(iter(declared)) if height is None else height)
    made = _ground("shaping_filter", rates=FrozenDict(declared), noise=noise, height=height)
    made.shaping_filter()
    return made


# --------------------------------------------------------------------------- numbers


def _ground(kind: str, **settings: Any) -> Ground:
    if kind not in FILTERS:
        raise ModelError(
            f"there is no ground of kind `{kind}`{did_you_mean(kind, FILTERS)}", table="ground", key="kind"
        )
    return Ground(kind, FrozenDict(settings))


def _number(value: Any, key: str) -> sp.Expr:
    try:
        return canonical(value)
    except ModelError as error:
        raise error.placed(table="ground", key=key) from None


def _positive(value: Any, key: str) -> sp.Expr:
    value = _number(value, key)
    if value.is_number and not value > 0:
        raise ModelError(f"a positive number is wanted, not {value}", table="ground", key=key)
    return value


def _literal(value: sp.Expr, key: str) -> sp.Expr:
    """A number: where the filter is found numerically, it cannot depend on parameters."""
    if value.free_symbols:
        raise ModelError(
            f"a number is wanted here, not an expression in parameters ({value}): the filter is found numerically",
            table="ground",
            key=key,
        )
    return value
