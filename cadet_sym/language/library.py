"""Elements by the names of the field, each an expression in the language of the model file: to use, and to learn from.

In Python, `coulomb(force="F_c")` is an `Element`; in a model file,

    [elements.friction]
    library = "coulomb"
    force = "F_c"

Displacements and speeds are positive in extension (rebound), and values are forces that act against them, so that they
enter a rate with a minus sign. Coefficients are numbers or expressions in parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.element import Element
from cadet_sym.language.names import did_you_mean
from cadet_sym.language.parser import parse
from cadet_sym.language.vocabulary import symbol

LIBRARY: dict[str, Kind] = {}


@dataclass(frozen=True)
class Kind:
    """A kind of element: calling it with its coefficients gives an `Element`.

    Parameters
    ----------
    name : what it is called in the field.
    arguments : of the element.
    coefficients : their names, with a default or None.
    value : the expression, as it would stand in a model file.
    text : what it is for.
    """

    name: str
    arguments: tuple[str, ...]
    coefficients: Mapping[str, str | None]
    value: str
    text: str

    def __call__(self, *values: Any, name: str = "", **named: Any) -> Element:
        """The element with these coefficients, in order or by name; `name` is its own, else that of its kind.

        Raises
        ------
        ModelError
            If a coefficient is missing, unknown or given twice.
        """
        given = dict(zip(self.coefficients, values, strict=False))
        unknown = [key for key in named if key not in self.coefficients or key in given]
        if unknown or len(values) > len(self.coefficients):
            what = f"`{unknown[0]}` is not one, or twice there" if unknown else f"{len(values)} given"
            raise ModelError(f"the library's `{self.name}` has the coefficients {self._wanted()}: {what}", key="library")
        given |= named
        chosen: dict[sp.Basic, sp.Expr] = {}
        for key, default in self.coefficients.items():
            value = given.get(key, default)
            if value is None:
                raise ModelError(f"the library's `{self.name}` needs its coefficient `{key}`", key=key)
            chosen[symbol(key)] = parse(value) if isinstance(value, str) else sp.sympify(value, strict=True)
        # the arguments are set aside, for a coefficient may hold a parameter of the same name
        aside = {symbol(a): sp.Dummy(a, real=True) for a in self.arguments}
        body = parse(self.value).xreplace(aside).xreplace(chosen)
        arguments = tuple(symbol(a if not _holds(chosen, a) else f"{a}_") for a in self.arguments)
        back = dict(zip(aside.values(), arguments, strict=True))
        return Element(name or self.name, arguments, body.xreplace(back), self.text)

    def _wanted(self) -> str:
        return ", ".join(key if default is None else f"{key} (= {default})" for key, default in self.coefficients.items())


def _holds(chosen: Mapping[sp.Basic, sp.Expr], name: str) -> bool:
    return any(symbol(name) in value.free_symbols for value in chosen.values())


def from_library(kind: str, name: str = "", **coefficients: Any) -> Element:
    """An element of the library, `from_library("coulomb", "seal", force="F_c")`, to be called in rates.

    Parameters
    ----------
    kind : one of the names in `LIBRARY`.
    name : of the element, in messages and listings; that of its kind if not given.
    coefficients : numbers or expressions in parameters and `t`.

    Raises
    ------
    ModelError
        If there is no such kind, or its coefficients are others.
    """
    return known_kind(kind)(name=name, **coefficients)


def known_kind(kind: str) -> Kind:
    """The kind of that name, or ModelError with the nearest ones."""
    if kind not in LIBRARY:
        near = did_you_mean(kind, list(LIBRARY)) or f"; known: {', '.join(LIBRARY)}"
        raise ModelError(f"there is no `{kind}` in the library of elements{near}", key="library")
    return LIBRARY[kind]


def _kind(name: str, arguments: str, coefficients: str, value: str, text: str) -> Kind:
    pairs = (c.partition("=") for c in coefficients.split())
    kind = Kind(name, tuple(arguments.split()), {key: default or None for key, _, default in pairs}, value, text)
    LIBRARY[name] = kind
    return kind


# -- springs ----------------------------------------------------------------------------------------------------------

cubic_stiffness = _kind(
    "cubic_stiffness",
    "z",
    "stiffness",
    "stiffness*z**3",
    "Hardening (or, negative, softening) spring, the nonlinear part of Duffing's oscillator: k z^3.",
)
quintic_stiffness = _kind(
    "quintic_stiffness",
    "z",
    "stiffness",
    "stiffness*z**5",
    "The next odd power: k z^5.",
)
preload = _kind(
    "preload",
    "z",
    "force stiffness=0",
    "force*sign(z) + stiffness*z",
    "Preloaded spring: it moves only beyond its preload, F sign(z) + k z.",
)
dead_zone = _kind(
    "dead_zone",
    "z",
    "gap stiffness=1",
    "stiffness*(max(z - gap, 0) - max(-z - gap, 0))",
    "Free play: no force within +-gap, a linear spring beyond.",
)
bump_stop = _kind(
    "bump_stop",
    "z",
    "gap stiffness",
    "-stiffness*max(-z - gap, 0)",
    "One-sided stop in compression: a linear spring once z is below -gap.",
)
two_sided_bump_stop = _kind(
    "two_sided_bump_stop",
    "z",
    "rebound_gap bump_gap stiffness",
    "stiffness*(max(z - rebound_gap, 0) - max(-z - bump_gap, 0))",
    "Stops at both ends of the travel: a linear spring beyond either gap.",
)
hardening_beyond_gap = _kind(
    "hardening_beyond_gap",
    "z",
    "gap stiffness",
    "stiffness*(max(z - gap, 0)**3 - max(-z - gap, 0)**3)",
    "Rubber stop: no force within +-gap, cubic in the distance beyond it.",
)
gas_spring = _kind(
    "gas_spring",
    "z",
    "force length stop exponent=1.4",
    "-force*((1 + max(z, -stop)/length)**(-exponent) - 1)",
    "Polytropic gas spring less its static force F at z = 0: gas column of that length, stopped at z = -stop, "
    "stop < length. Without the stop no Gaussian expectation exists.",
)
lateral_spring = _kind(
    "lateral_spring",
    "x y",
    "stiffness length free_length",
    "stiffness*x*(1 - free_length/sqrt(length**2 + x**2 + y**2))",
    "Large deflections x, y across a spring of that length: its force along x. Taut if its free length is less (a string, a "
    "guy rope), snapping through if it is more; the force along y is `lateral_spring(y, x)`.",
)
tyre_lift_off = _kind(
    "tyre_lift_off",
    "z",
    "stiffness deflection",
    "-stiffness*(max(deflection - z, 0) - deflection)",
    "Tyre that cannot pull: linear in z, the height of wheel over ground from rest, until the static deflection is used up.",
)

# -- dampers ----------------------------------------------------------------------------------------------------------

quadratic_damping = _kind(
    "quadratic_damping",
    "v",
    "coefficient",
    "coefficient*abs(v)*v",
    "Orifice or drag: c |v| v.",
)
asymmetric_quadratic = _kind(
    "asymmetric_quadratic",
    "z",
    "r",
    "z**2 if z > 0 else -r*z**2",
    "Oleo-pneumatic undercarriage of Harrison & Hammond (1986): z^2 in rebound, -r z^2 in bump.",
)
power_law_damping = _kind(
    "power_law_damping",
    "v",
    "coefficient exponent",
    "coefficient*abs(v)**exponent*sign(v)",
    "Fluid viscous damper of civil engineering: c |v|^q sign(v), q commonly 0.15 to 2.",
)
bilinear_damper = _kind(
    "bilinear_damper",
    "v",
    "rebound bump",
    "rebound*v if v > 0 else bump*v",
    "Different coefficients in rebound and in bump.",
)
multi_slope_damper = _kind(
    "multi_slope_damper",
    "v",
    "rebound rebound_high rebound_knee bump bump_high bump_knee",
    "rebound*v + (rebound_high - rebound)*max(v - rebound_knee, 0) if v > 0"
    " else bump*v - (bump_high - bump)*max(-v - bump_knee, 0)",
    "Blow-off valves: in each direction one slope up to a knee, another beyond it.",
)

drag_in_plane = _kind(
    "drag_in_plane",
    "u v",
    "coefficient",
    "coefficient*u*sqrt(u**2 + v**2)",
    "Fluid drag against a velocity (u, v), its component along u: c u |(u, v)|; that along v is `drag_in_plane(v, u)`.",
)
drag_in_space = _kind(
    "drag_in_space",
    "u v w",
    "coefficient",
    "coefficient*u*sqrt(u**2 + v**2 + w**2)",
    "The same of a velocity (u, v, w), relative to the wind if there is any; for another component put that first.",
)

# -- friction ---------------------------------------------------------------------------------------------------------

coulomb = _kind(
    "coulomb",
    "v",
    "force",
    "force*sign(v)",
    "Coulomb friction of constant normal load.",
)
coulomb_normal_load = _kind(
    "coulomb_normal_load",
    "v N",
    "friction",
    "friction*sign(v)*max(N, 0)",
    "Coulomb friction under a varying normal load N, which cannot pull: mu sign(v) max(N, 0).",
)
coulomb_in_plane = _kind(
    "coulomb_in_plane",
    "u v",
    "force speed=0",
    "force*u/sqrt(u**2 + v**2 + speed**2)",
    "Coulomb friction against sliding at a velocity (u, v), its component along u; that along v is `coulomb_in_plane(v, u)`. "
    "Below a `speed`, if one is given, it creeps.",
)
stribeck = _kind(
    "stribeck",
    "v",
    "kinetic static speed",
    "sign(v)*(kinetic + (static - kinetic)*exp(-(v/speed)**2))",
    "Friction that falls from its static to its kinetic value over the Stribeck speed.",
)
bouc_wen = _kind(
    "bouc_wen",
    "v z",
    "A beta gamma exponent=1",
    "A*v - beta*abs(v)*abs(z)**(exponent - 1)*z - gamma*v*abs(z)**exponent",
    "Rate of the hysteretic displacement z at speed v (Wen 1976, J. Eng. Mech. Div. 102, 249): z' = bouc_wen(v, z), "
    "exponent >= 1; closed form for whole exponents.",
)

# -- control ----------------------------------------------------------------------------------------------------------

saturation = _kind(
    "saturation",
    "z",
    "limit",
    "clip(z, -limit, limit)",
    "Linear with slope one up to +-limit, then constant.",
)
relay = _kind(
    "relay",
    "z",
    "level dead_zone=0",
    "level if z > dead_zone else -level if z < -dead_zone else 0",
    "On-off control: +-level outside a dead zone, zero inside.",
)
