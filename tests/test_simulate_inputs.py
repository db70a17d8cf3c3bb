"""What enters the nonlinearities is found in the rates as they are written, and its shape is told."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from reference_models import oleo, oscillator, toml

import cadet_sym as cs
from cadet_sym.augmentation import augment
from cadet_sym.simulation import simulate
from cadet_sym.simulation.inputs import inputs_of


def found(rates: str) -> dict[str, tuple[str, ...]]:
    spring = '[elements.spring]\narguments = ["d"]\nvalue = "d + d**3"\n'
    mixed = '[elements.mixed]\narguments = ["a", "b"]\nvalue = "a*abs(b)"\n'
    model = toml(f'[parameters]\nk = 2.0\nm = 3.0\n{spring}{mixed}[rates]\nx = "v"\n{rates}\n[run]\nduration = 1.0')
    return {each.text: each.elements for each in inputs_of(augment(model))}


@pytest.mark.parametrize(
    ("rates", "inputs"),
    [
        ('v = "-k*x - v"', {}),
        ('v = "-k*x - abs(v)*v"', {"v": ()}),
        ('v = "-(k*x + spring(x - 2*v) + v)/m"', {"x - 2*v": ("spring",)}),
        ('v = "-spring(x) - mixed(x, v)"', {"x": ("spring", "mixed"), "v": ("mixed",)}),
        ('v = "-spring(-3*x + 1)"', {"x": ("spring",)}),
        ('v = "-spring(x + v**3)"', {"x": ("spring",), "v": ("spring",)}),
        ('v = "-(v if x > 1 else 2*v)"', {"x": (), "v": ()}),
    ],
)
def test_inputs_are_the_largest_linear_parts_of_what_is_not_linear(rates, inputs):
    assert found(rates) == inputs


def test_half_a_car_has_an_input_a_damper():
    inputs = inputs_of(augment(cs.load(ROOT / "models" / "half_car_acceleration.toml")))
    assert [each.elements for each in inputs] == [("damper",), ("damper",)]


def test_the_shape_of_an_input_is_that_of_its_quantity():
    run = simulate(oleo("R41C"), 3000, times=[5.0], step=0.05, check_step=False)
    (shape,) = run.inputs.values()
    assert shape.elements == ("oleo",)
    assert shape.skewness[0] == run.skewness["v"][0]
    assert shape.excess_kurtosis[0] == run.excess_kurtosis["v"][0]
    assert run.outputs == ("closure", "damper_force")
    assert run.kept.shape == (20, 1, len(run.states) + len(run.outputs) + 1)
    assert run.to_xarray()["path_outputs"].shape == (20, 1, 2)


def test_coulomb_friction_is_found_to_be_far_from_gaussian():
    """Its speed is Laplace's, of excess kurtosis 3."""
    model = oscillator("-2*sign(v)", Q=1.0, start='[initial.covariance]\n"v,v" = 0.125', scalar=True)
    run = simulate(model, 4000, times=[20.0], step=0.01, check_step=False)
    (shape,) = run.inputs.values()
    assert abs(shape.skewness[0]) < 0.5
    assert 2.0 < shape.excess_kurtosis[0] < 4.5
    assert shape.excess_kurtosis_standard_error[0] == pytest.approx(np.sqrt(24 / 4000))
