"""The inverse that the implicit engine uses where wheels follow each other: exact for a linear model."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import half_car, toml

import cadet_sym as cs
from cadet_sym.solve.evaluate import gains
from cadet_sym.solve.ground import GroundInverse
from cadet_sym.solve.implicit import Inverse, PackedIndex, scaled_form


def three_axles() -> cs.Model:
    return toml(
        """
        name = "three axles"
        [rates]
        x = "v"
        v = "-50*(x - (a + b + c)/3) - 3*(v - (der(a) + der(b) + der(c))/3)"
        [contacts]
        a = {}
        b = { setback = 1.3 }
        c = { setback = 3.1 }
        [ground]
        kind = "exponential"
        sigma = 0.01
        cutoff = 0.3
        rolling_contact = 4.0
        [travel]
        speed = "4 + t"
        [run]
        duration = 2.0
        """
    )


@pytest.mark.parametrize("model", [half_car(speed="5 + 2*t"), three_axles()], ids=["half car", "three axles"])
def test_it_inverts_the_jacobian_of_a_linear_model(model):
    compiled = cs.compile(model, grid=(2, 4))
    lowered, t, g = compiled.functions, 0.7, 0.003
    p, y = compiled.parameter_vector(), compiled.initial()
    n = lowered.equations.packing.n
    scale = np.geomspace(0.5, 2.0, n)
    N = gains(lowered, t, y, p)
    ground = GroundInverse(lowered, p)
    ground.decompose(N, scale)
    ground.prepare(t, y, g)
    inverse = Inverse.build(PackedIndex(lowered.equations.packing), scale, scaled_form(N, scale), g, ground)
    matrix = np.eye(len(y)) - g * np.asarray(lowered.jacobian(t, y, p))
    r = np.random.default_rng(0).standard_normal(len(y))
    r[len(y) - lowered.facts.packing.known :] = 0.0  # does not change: no residual either
    z = np.empty_like(r)
    inverse.apply(r, z)
    np.testing.assert_allclose(matrix @ z, r, atol=1e-8 * np.abs(matrix).max())


def test_the_engines_agree_on_three_axles():
    compiled = cs.compile(three_axles())
    found = [compiled.propagate([1.0, 2.0], rtol=1e-8, engine=engine) for engine in ("direct", "implicit", "explicit")]
    for other in found[1:]:
        np.testing.assert_allclose(other.variance["x"], found[0].variance["x"], rtol=1e-6)
