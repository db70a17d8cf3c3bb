"""What the user calls a parameter never meets a name that the program gave."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import half

import cadet_sym as cs
from cadet_sym.language.modelfile import loads

TOY = """
schema = 1
name = "toy"
[parameters]
STIFFNESS = 3.0
[rates]
x = "v"
v = "-STIFFNESS*x - 0.5*x**3 - 0.4*v - 0.1*abs(v)*v + w"
[noise]
w = 0.3
[outputs]
force = "STIFFNESS*x + 0.5*x**3"
[run]
duration = 4.0
points = 5
"""


@pytest.mark.parametrize("name", half(["k_1", "F_1", "k_2", "k_11", "m1", "S11", "m", "p", "u", "D", "N", "E", "Q"]))
def test_a_parameter_may_have_the_name_of_an_internal_quantity(name):
    plain = cs.compile(loads(TOY)).propagate()
    named = cs.compile(loads(TOY.replace("STIFFNESS", name))).propagate()
    np.testing.assert_allclose(named.state_covariance, plain.state_covariance, rtol=1e-12)
    np.testing.assert_allclose(named.output_variance, plain.output_variance, rtol=1e-12)
