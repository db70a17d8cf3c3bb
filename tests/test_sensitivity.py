"""Derivatives with respect to parameters agree with central differences, forward and adjoint."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from reference_models import toml

import cadet_sym as cs
from cadet_sym.errors import ModelError

CHAIN = """
name = "eight parameters"
[parameters]
k1 = 4.0
k2 = 9.0
c1 = 0.4
c2 = 0.3
e1 = 0.5
e2 = 0.2
f0 = 0.3
q = 1.5
[rates]
x = "v"
v = "-k1*x - c1*v - e1*x**3 + k2*(y - x) + f0"
y = "u"
u = "-k2*(y - x) - c2*u - e2*u*abs(u) + w"
[noise]
w = "q"
[outputs]
force = "e2*u*abs(u)"
[run]
duration = 4.0
"""

WHEELS = """
name = "two wheels"
[parameters]
k = 30.0
c = 2.0
V = 8.0
[rates]
z = "v"
v = "-k*(z - f/2 - r/2) - c*v - 0.5*v*abs(v)"
[contacts]
f = { setback = 0.0 }
r = { setback = 2.0 }
[ground]
kind = "exponential"
sigma = 0.1
cutoff = 0.5
[travel]
speed = "V"
[run]
duration = 2.0
"""


def differences(compiled: cs.CompiledModel, name: str, parameter: str, moment: str, times: list[float]) -> np.ndarray:
    declared = compiled.model.parameter_values()[parameter]
    step = 1e-4 * declared
    ends = [compiled.propagate(times, rtol=1e-10, parameters={parameter: declared + s * step}) for s in (1, -1)]
    values = [getattr(each, moment)[name] for each in ends]
    return (values[0] - values[1]) / (2 * step)


@pytest.mark.parametrize(
    ("text", "name", "moment", "times"),
    [
        (CHAIN, "force", "variance", [1.0, 4.0]),
        (CHAIN, "x", "mean", [4.0]),
        (CHAIN, "y", "variance", [4.0]),
        (WHEELS, "z", "variance", [0.5, 2.0]),
    ],
)
def test_forward_derivatives_are_central_differences(text, name, moment, times):
    compiled = cs.compile(toml(text))
    found = compiled.gradient(name, times=times, moment=moment, method="forward")
    for j, parameter in enumerate(compiled.parameters):
        expected = differences(compiled, name, parameter, moment, times)
        np.testing.assert_allclose(found[:, j], expected, rtol=1e-5, atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("count", [1, 3, 8])
def test_the_adjoint_agrees_with_forward(count):
    compiled = cs.compile(toml(CHAIN))
    names = compiled.parameters[:count]
    forward = compiled.gradient("y", names, method="forward")
    np.testing.assert_allclose(compiled.gradient("y", names, method="adjoint"), forward, rtol=1e-5)


def test_an_oleo_that_starts_on_its_kink():
    compiled = cs.compile("models/oleo_acceleration.toml")
    found = compiled.gradient("closure", ["zeta", "a"], [5.0])
    for j, parameter in enumerate(["zeta", "a"]):
        np.testing.assert_allclose(
            found[0, j], differences(compiled, "closure", parameter, "variance", [5.0]), rtol=1e-5
        )


def test_unknown_names_are_refused():
    compiled = cs.compile(toml(CHAIN))
    wrong: tuple[dict[str, Any], ...] = (
        {"name": "nothing"},
        {"name": "x", "parameters": ["k9"]},
        {"name": "x", "method": "magic"},
    )
    for arguments in wrong:
        with pytest.raises(ModelError):
            compiled.gradient(**arguments)
