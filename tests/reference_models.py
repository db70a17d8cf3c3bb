"""The reference cases as model files: what a user would write for each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cadet_sym.language.model import Model
from cadet_sym.language.modelfile import loads

CASES = json.loads((Path(__file__).parent / "data" / "reference_cases.json").read_text())["cases"]
BY_ID: Mapping[str, Any] = {case["id"]: case for case in CASES}


def value(case: str) -> Any:
    return BY_ID[case]["value"]


def params(case: str) -> Mapping[str, Any]:
    return BY_ID[case]["params"]


@cache
def toml(text: str) -> Model:
    return loads("schema = 1\n" + text)


def oscillator(restoring: str, *, Q: object, start: str = "", scalar: bool = False) -> Model:
    """x' = v, v' = restoring + w, or only the latter."""
    position = "" if scalar else 'x = "v"\n'
    return toml(
        f'name = "case"\n[rates]\n{position}v = "{restoring} + w"\n[noise]\nw = {Q}\n{start}\n[run]\nduration = 10.0\n'
    )


SMOOTH = 'ground = "smooth"'
DROPPED = 'x = "-h"\nv = "-der(h)"'
START = {"A": SMOOTH, "B": DROPPED, "C": 'ground = "stationary"'}


def oleo(case: str, *, duration: float = 10.0) -> Model:
    """Harrison & Hammond's undercarriage in relative coordinates; the letter names the initial condition."""
    p = params(case)
    return toml(
        f"""
        name = "oleo {case}"
        [parameters]
        omega_n = {p["wn"]}
        zeta = {p["zeta"]}
        gamma = {p["gs"]}
        r = {p["r"]}
        V0 = {p["V0"]}
        a = {p["a"]}
        [elements.oleo]
        arguments = ["z"]
        value = "z**2 if z > 0 else -r*z**2"
        [rates]
        x = "v"
        v = "-omega_n**2*x - 2*zeta*omega_n*v - gamma*oleo(v) - der(h, 2)"
        [contacts]
        h = {{}}
        [ground]
        kind = "exponential"
        sigma = 1.0
        cutoff = {p["alpha"]}
        rolling_contact = {p["beta"]}
        [travel]
        speed = "V0 + a*t"
        [initial]
        {START[p["ic"][0] if "ic" in p else "C"]}
        [outputs]
        closure = "x"
        damper_force = "gamma*oleo(v)"
        [run]
        duration = {duration}
        """
    )


QUARTER_CAR = """
name = "quarter car"
[parameters]
ms = {ms}
mu = {mu}
ks = {ks}
cs = {cs}
kt = {kt}
[rates]
zs = "vs"
zu = "vu"
vs = "(-ks*(zs - zu) - cs*(vs - vu))/ms"
vu = "(ks*(zs - zu) + cs*(vs - vu) - kt*(zu - h))/mu"
[contacts]
h = {{}}
[ground]
kind = "iso8608"
gd = {gd}
{cutoff}
[travel]
speed = {V}
[outputs]
stroke = "zs - zu"
tyre = "zu - h"
acc = "der(vs)"
[run]
duration = 1.0
"""


def quarter_car(p: Mapping[str, Any], *, V: float, gd: float, cutoff: str = "") -> Model:
    return toml(QUARTER_CAR.format(V=V, gd=gd, cutoff=cutoff, **p))


def bouc_wen(p: Mapping[str, Any]) -> Model:
    """x'' + 2 zeta x' + alpha x + (1 - alpha) z = w with Bouc and Wen's hysteresis."""
    return toml(
        f"""
        name = "Bouc-Wen"
        [rates]
        x = "v"
        v = "-2*{p["zeta"]}*v - {p["alpha"]}*x - (1 - {p["alpha"]})*z + w"
        z = "{p["A"]}*v - {p["beta"]}*abs(v)*abs(z)**{p["n"] - 1}*z - {p["gamma"]}*v*abs(z)**{p["n"]}"
        [noise]
        w = {p["Q"]}
        [run]
        duration = 50.0
        """
    )


HALF_CAR = """
name = "half car"
[parameters]
M = 690
J = 1222
a1 = 1.25
a2 = 1.51
k1 = 17000
k2 = 22000
c1 = {c}
c2 = {c}
m1 = 40.5
m2 = 45.4
kt = 192000
gam = {gam}
r = 0.25
[elements.damper]
arguments = ["z"]
value = "z**2 if z > 0 else -r*z**2"
[rates]
zb = "vb"
th = "q"
z1 = "v1"
z2 = "v2"
vb = "-({front} + {rear})/M"
q = "-(a2*({rear}) - a1*({front}))/J"
v1 = "({front} - kt*(z1 - u1))/m1"
v2 = "({rear} - kt*(z2 - u2))/m2"
[contacts]
u1 = {{}}
u2 = {{ setback = "a1 + a2" }}
[ground]
kind = "exponential"
sigma = {sigma}
cutoff = 0.1
rolling_contact = 8
[travel]
speed = "{speed}"
[initial]
{initial}
[outputs]
stroke0 = "zb - a1*th - z1"
strokev0 = "vb - a1*q - v1"
stroke1 = "zb + a2*th - z2"
strokev1 = "vb + a2*q - v2"
heave_v = "vb"
pitch_v = "q"
tyre0 = "z1 - u1"
tyre1 = "z2 - u2"
[run]
duration = {duration}
"""


def half_car(initial: str = "", *, speed: str = "10", c: float = 1500, gam: float = 0, duration: float = 5.0) -> Model:
    """Half car of reference W1: two wheels on one track."""
    front = "k1*(zb - a1*th - z1) + c1*(vb - a1*q - v1)"
    rear = "k2*(zb + a2*th - z2) + c2*(vb + a2*q - v2)"
    if gam:
        front += " + gam*damper(vb - a1*q - v1)"
        rear += " + gam*damper(vb + a2*q - v2)"
    sigma = float((5.0532374533577515e-05 / 0.2) ** 0.5)
    return toml(HALF_CAR.format(**locals()))
