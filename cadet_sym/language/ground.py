"""The ground along the track: random, by its shaping filter, and deterministic, by its profile.

Each constructor gives a `Ground`, which remembers how it was declared and makes its `ShapingFilter` in distance. One-sided road spectra
become two-sided intensities here, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.canonical import canonical
from cadet_sym.language.element import declared_name
from cadet_sym.language.frozen import FrozenDict
from cadet_sym.language.kinks import breakpoints
from cadet_sym.language.noise import Noise
from cadet_sym.language.shaping import ShapingFilter, filter_of_rates, make_filter, rolled, with_profile
from cadet_sym.language.vocabulary import DISTANCE, symbol

__all__ = ["Ground", "ShapingFilter", "exponential", "shaping_filter"]


@dataclass(frozen=True)
class Ground:
    """The ground under one track. Made by `exponential`, `iso8608`, `shaping_filter`, ...

    Parameters
    ----------
    kind : the declaration's kind, the same word as in a model file.
    settings : what that kind was given.
    rolling : cut-off of the rolling contact in rad per unit of length, or None.
    profile : deterministic height as an expression in `s`, or None.
    """

    kind: str
    settings: FrozenDict[str, Any] = field(default_factory=FrozenDict)
    rolling: sp.Expr | None = None
    profile: sp.Expr | None = None

    def rolling_contact(self, cutoff: Any) -> Ground:
        """The same ground under a rolling contact, a first-order low-pass in distance: u' = cutoff (h - u)."""
        return replace(self, rolling=_positive(cutoff, "rolling_contact"))

    def with_profile(self, profile: Any) -> Ground:
        """The same ground with a deterministic height, an expression in `s`, added; zero before s = 0 unless it says otherwise."""
        return replace(self, profile=canonical(profile))

    def shaping_filter(self) -> ShapingFilter:
        """The filter in distance, with rolling contact and profile: xi' = C xi + D w + offset, u = F xi + profile."""
        road = _FILTERS[self.kind](**self.settings)
        if self.profile is not None:
            road = with_profile(road, started(self.profile))
        return road if self.rolling is None else rolled(road, self.rolling)

    @property
    def breakpoints(self) -> tuple[sp.Expr, ...]:
        """Positions s, expressions in parameters, at which a coefficient or the profile has a kink or a step."""
        road = self.shaping_filter()
        parts = [*road.C, *road.D, *road.Q, *road.F, *road.offset, road.profile]
        return breakpoints(parts, DISTANCE)


def started(profile: sp.Expr) -> sp.Expr:
    """A profile that is zero before s = 0, unless it says itself what is there."""
    if profile == 0 or any(_speaks_of_the_start(test) for test in profile.atoms(sp.core.relational.Relational)):
        return profile
    return sp.Piecewise((sp.S.Zero, sp.StrictLessThan(DISTANCE, 0, evaluate=False)), (profile, sp.true), evaluate=False)


def _speaks_of_the_start(test: Any) -> bool:
    return DISTANCE in test.free_symbols and bool(test.rhs.is_Rational and test.rhs <= 0)


def exponential(sigma: Any, cutoff: Any) -> Ground:
    """Ground of autocovariance R(d) = sigma^2 exp(-cutoff |d|) (Harrison & Hammond 1986, eq 25).

    h' = -cutoff h + sigma sqrt(2 cutoff) w(s), E[w w'] = delta. State `height`; with rolling contact `height`, `slope`.

    Parameters
    ----------
    sigma : rms height, unit of length.
    cutoff : rad per unit of length.
    """
    return Ground("exponential", FrozenDict(sigma=canonical(sigma), cutoff=_positive(cutoff, "cutoff")))


def _exponential(sigma: sp.Expr, cutoff: sp.Expr) -> ShapingFilter:
    return make_filter(("height",), [[-cutoff]], [[sigma * sp.sqrt(2 * cutoff)]], [[1]], [[1]])


def shaping_filter(
    rates: Mapping[Any, Any], noise: Noise | Mapping[Any, Any] | None = None, height: Any = None
) -> Ground:
    """Ground by its own first-order equations in distance.

    Parameters
    ----------
    rates : state -> d(state)/ds, linear in states and noises; coefficients may depend on parameters and `s`.
    noise : `Noise`, or a mapping of noise to intensity; none: a ground without a random part.
    height : the height, linear in the states.
    """
    declared: dict[sp.Symbol, sp.Expr] = {}
    for key, rate in rates.items():
        name = declared_name(key, "state", table="ground", key="rates")
        try:
            declared[symbol(name)] = canonical(rate)
        except ModelError as error:
            raise error.placed(table="ground", key=f"rates.{name}") from None
    if not declared:
        raise ModelError("a shaping filter has at least one state", table="ground", key="rates")
    noise = noise if isinstance(noise, Noise) or noise is None else Noise.independent(noise)
    height = canonical(next(iter(declared)) if height is None else height)
    made = Ground("shaping_filter", FrozenDict(rates=FrozenDict(declared), noise=noise, height=height))
    made.shaping_filter()
    return made


def _shaping_filter(rates: Mapping[sp.Symbol, sp.Expr], noise: Noise | None, height: sp.Expr) -> ShapingFilter:
    return filter_of_rates(rates, noise or Noise(("w",), sp.S.Zero), height)


def _positive(value: Any, key: str) -> sp.Expr:
    value = canonical(value)
    if value.is_Rational and value <= 0:
        raise ModelError(f"a positive number is wanted, not {value}", table="ground", key=key)
    return value


_FILTERS: dict[str, Any] = {"exponential": _exponential, "shaping_filter": _shaping_filter}
