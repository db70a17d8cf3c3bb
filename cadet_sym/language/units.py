"""Units of a table's columns: what a declared unit is worth in SI, exactly, and of what kind it is."""

from __future__ import annotations

import re

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.names import did_you_mean

Dimension = tuple[int, int, int]  # powers of length, mass, time

_R = sp.Rational
# unit -> value in SI, powers of (m, kg, s)
UNITS: dict[str, tuple[sp.Expr, Dimension]] = {
    "1": (_R(1), (0, 0, 0)),
    "-": (_R(1), (0, 0, 0)),
    "%": (_R(1, 100), (0, 0, 0)),
    "rad": (_R(1), (0, 0, 0)),
    "deg": (_R("0.017453292519943295"), (0, 0, 0)),
    "cycle": (_R(1), (0, 0, 0)),
    "mm": (_R(1, 1000), (1, 0, 0)),
    "cm": (_R(1, 100), (1, 0, 0)),
    "dm": (_R(1, 10), (1, 0, 0)),
    "m": (_R(1), (1, 0, 0)),
    "km": (_R(1000), (1, 0, 0)),
    "um": (_R(1, 10**6), (1, 0, 0)),
    "in": (_R("0.0254"), (1, 0, 0)),
    "ft": (_R("0.3048"), (1, 0, 0)),
    "mi": (_R("1609.344"), (1, 0, 0)),
    "g": (_R(1, 1000), (0, 1, 0)),
    "kg": (_R(1), (0, 1, 0)),
    "t": (_R(1000), (0, 1, 0)),
    "lb": (_R("0.45359237"), (0, 1, 0)),
    "ms": (_R(1, 1000), (0, 0, 1)),
    "s": (_R(1), (0, 0, 1)),
    "min": (_R(60), (0, 0, 1)),
    "h": (_R(3600), (0, 0, 1)),
    "Hz": (_R(1), (0, 0, -1)),
    "kph": (_R(5, 18), (1, 0, -1)),
    "mph": (_R("0.44704"), (1, 0, -1)),
    "kn": (_R(1852, 3600), (1, 0, -1)),
    "N": (_R(1), (1, 1, -2)),
    "kN": (_R(1000), (1, 1, -2)),
    "MN": (_R(10**6), (1, 1, -2)),
    "kgf": (_R("9.80665"), (1, 1, -2)),
    "lbf": (_R("0.45359237") * _R("9.80665"), (1, 1, -2)),
    "Nm": (_R(1), (2, 1, -2)),
    "J": (_R(1), (2, 1, -2)),
    "W": (_R(1), (2, 1, -3)),
    "Pa": (_R(1), (-1, 1, -2)),
    "kPa": (_R(1000), (-1, 1, -2)),
    "MPa": (_R(10**6), (-1, 1, -2)),
    "bar": (_R(10**5), (-1, 1, -2)),
}
KINDS: dict[str, Dimension] = {
    "length": (1, 0, 0),
    "time": (0, 0, 1),
    "speed": (1, 0, -1),
    "wavenumber": (-1, 0, 0),
    "spectrum": (3, 0, 0),
}
_FACTOR = re.compile(r"([A-Za-zµ%1-]+?)(?:(?:\^|\*\*)?(-?[1-9]))?")
_POWERS = str.maketrans({"²": "2", "³": "3", "·": "*", "μ": "µ"})


def unit_value(text: str) -> tuple[sp.Expr, Dimension]:
    """Value in SI and dimension of a unit such as `mm/s`, `N*s/m`, `m/s^2`.

    Raises
    ------
    ModelError : a unit that is not known, with near ones.
    """
    value, dimension = sp.S.One, (0, 0, 0)
    for position, group in enumerate(text.translate(_POWERS).replace(" ", "").replace("**", "^").split("/")):
        for part in group.replace("(", "").replace(")", "").split("*"):
            match = _FACTOR.fullmatch(part)
            name = match.group(1).replace("µ", "u") if match else part
            if match is None or name not in UNITS:
                raise ModelError(f"the unit `{text}` is not known{did_you_mean(name, UNITS)}", token=text)
            power = int(match.group(2) or 1) * (-1 if position else 1)
            value *= UNITS[name][0] ** power
            length, mass, time = (d + power * u for d, u in zip(dimension, UNITS[name][1], strict=True))
            dimension = length, mass, time
    return value, dimension


def conversion(text: str, kind: str = "") -> sp.Expr:
    """Factor from a unit to SI; ModelError if it is not of the kind wanted ("length", "time", "speed", or anything)."""
    value, dimension = unit_value(text)
    if kind and dimension != KINDS[kind]:
        raise ModelError(f"the units do not fit: a {kind} is wanted, and `{text}` is none", token=text)
    return value
