"""Travel: how the leading wheel moves along the ground."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.canonical import canonical
from cadet_sym.language.curve import travelled
from cadet_sym.language.element import set_field
from cadet_sym.language.integral import integral
from cadet_sym.language.kinks import breakpoints
from cadet_sym.language.vocabulary import TIME, Lookup


@dataclass(frozen=True)
class Travel:
    """Speed, or distance, as a function of time.

    Parameters
    ----------
    speed : expression in `t` and parameters, never negative; a `Lookup` in `t` for a measured one.
    distance : expression in `t` and parameters, in place of the speed.
    start : where the leading wheel stands at t = 0; with a distance it is distance(0).
    table : the measured curve that `speed` was made of, if it was.
    """

    speed: sp.Expr | None = None
    distance: sp.Expr | None = None
    start: sp.Expr = sp.S.Zero
    table: Lookup | None = None

    def __post_init__(self):
        if (self.speed is None) == (self.distance is None):
            what = "neither" if self.speed is None else "both"
            raise ModelError(f"either `speed` or `distance` is wanted, {what} given", table="travel")
        for key in ("speed", "distance", "start"):
            value = getattr(self, key)
            if value is not None:
                try:
                    set_field(self, key, canonical(value))
                except ModelError as error:
                    raise error.placed(table="travel", key=key) from None
        if isinstance(self.speed, Lookup):
            set_field(self, "table", self.speed)
            set_field(self, "speed", self.speed.as_piecewise())
        if self.distance is not None and self.start != 0:
            raise ModelError(
                "with `distance` given, the start is distance(0): leave `start` out", table="travel", key="start"
            )

    @property
    def breakpoints(self) -> tuple[sp.Expr, ...]:
        """Times, expressions in parameters, at which the speed may have a kink or a step."""
        if self.table is not None:
            return self.table.knots
        return breakpoints([e for e in (self.speed, self.distance) if e is not None], TIME)

    def speed_expression(self) -> sp.Expr:
        """V(t)."""
        return self.speed if self.speed is not None else sp.diff(self.distance, TIME)

    def closed_distance(self) -> sp.Expr | None:
        """s(t) where it has a closed form: given, or the integral of a piecewise polynomial; else None."""
        return self._closed_distance

    @cached_property
    def _closed_distance(self) -> sp.Expr | None:
        if self.distance is not None:
            return self.distance
        if self.table is not None and self.table.outside != "extrapolate" and self.table.knots[0] >= 0:
            return self.start + travelled(self.table)
        way = integral(self.speed)
        return None if way is None else self.start + way
