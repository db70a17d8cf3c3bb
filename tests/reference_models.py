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
