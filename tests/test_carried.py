"""Machine code of wheels on one track: the numbers of CasADi's own graph, on every kind of ground and start."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from conftest import half
from reference_models import toml

import cadet_sym as cs

ROADS = {
    "homogeneous": 'kind = "exponential"\nsigma = 0.02\ncutoff = 0.3\nrolling_contact = 3.0',
    "inhomogeneous": """kind = "shaping_filter"
        rates = { h = "p", p = "-3*p - 2*h + w*(1 + 0.5*sin(s))" }
        noise = { w = 1e-3 }
        height = "h" """,
}
WHEELS = {
    "two": ('a = {}\nb = { setback = "L" }', "30*(a + b) + 2*(der(a) + der(b))"),
    "three": ('a = {}\nb = { setback = "L" }\nc = { setback = 3.0 }', "20*(a + b + c) + der(a) + der(c)"),
    "tracks": ('a = {}\nb = { setback = "L" }\nc = { track = "r" }\nd = { track = "r", setback = "L" }', "9*(a + b + c + d)"),
    "white": ('a = {}\nb = { setback = "L" }', "30*(a + b) + (der(a, 2) + der(b, 2))/2"),
}


@pytest.mark.parametrize("start", ["stationary", "smooth"])
@pytest.mark.parametrize("wheels", WHEELS)
@pytest.mark.parametrize("road", half(ROADS))
def test_machine_code_is_the_graph_to_the_last_bit(road, wheels, start):
    contacts, force = WHEELS[wheels]
    model = toml(
        f"""
        [parameters]
        L = 1.7
        [elements.damper]
        arguments = ["z"]
        value = "z*abs(z)"
        [rates]
        x = "v"
        v = "-60*x - 3*v - damper(v) + {force}"
        [contacts]
        {contacts}
        [ground]
        {ROADS[road]}
        [travel]
        speed = "4 + t"
        [initial]
        ground = "{start}"
        [run]
        duration = 1.0
        """
    )
    compiled = cs.compile(model, grid=(2, 5))
    functions, p = compiled.functions, compiled.parameter_vector()
    packing, rng = functions.facts.packing, np.random.default_rng(3)
    covariance = np.eye(packing.n) + 0.1
    y = 0.1 * rng.standard_normal(packing.size)
    y[: packing.moments] = packing.pack(y[: packing.n], covariance)
    wanted = np.asarray(functions.rate(0.3, y, p)).ravel()
    free = np.array(functions.free_entries()["free"], dtype=int).ravel()
    held = np.setdiff1d(np.arange(packing.size), free)
    assert set(range(packing.size - packing.known, packing.size)) <= set(held)
    for name, x, q, kept in (
        ("rate", y, p, slice(None)),
        ("free_rate", np.ascontiguousarray(y[free]), np.concatenate([p, y[held]]), free),
    ):
        code = functions.machine(name)
        if code is None:
            pytest.skip("LLVM is not there")
        found = np.full(len(x), np.nan)
        code.function(name, *[ctypes.c_void_p] * 4)(*(a.ctypes.data for a in (np.array([0.3]), x, q, found)))
        np.testing.assert_array_equal(found, wanted[kept])
