"""Quadratures under other numbers of the parameters than their order was chosen for."""

from __future__ import annotations

import warnings

import pytest

import cadet_sym as cs
from cadet_sym.errors import ExpectationWarning

MODEL = """
schema = 1
name = "a wave"
[parameters]
k = 1.0
c = 0.5
[rates]
x = "v"
v = "-x - c*v - cos(k*x)*tanh(x) + w"
[noise]
w = "1.0"
[run]
duration = 1.0
points = 2
"""


@pytest.fixture
def compiled(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(MODEL)
    return cs.compile(cs.load(path))


def test_the_parameters_of_quadratures_are_known(compiled):
    assert compiled.functions.facts.integrated == ("k",)


def test_numbers_far_from_those_an_order_was_chosen_for_are_warned_of(compiled):
    with pytest.warns(ExpectationWarning, match=r"with k = 300 its quadrature is accurate to .*compile the model with these"):
        compiled.propagate(parameters={"k": 300.0})


def test_numbers_for_which_it_serves_are_not_warned_of(compiled):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled.propagate(parameters={"k": 1.1, "c": 5.0})
        compiled.propagate(parameters={"k": 1.05})
