"""Derivatives with respect to parameters agree with central differences, forward and adjoint."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT, half
from reference_models import toml

import cadet_sym as cs
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.lowering.structured import structured_rate
from cadet_sym.solve import sensitivity, variational
from cadet_sym.solve.many import Start
from cadet_sym.solve.onset import Onset
from cadet_sym.solve.transient import integrate

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
[initial.covariance]
"z,z" = 0.01
"v,v" = 0.05
[run]
duration = 2.0
"""


THREE_WHEELS = """
name = "three wheels on ground of two noises, which varies along the road"
[parameters]
k = 60.0
between = 1.7
decay = 3.0
speed = 4.0
[rates]
x = "v"
v = "-k*x - 3*v - v*abs(v) + 20*(a + b + c)"
[contacts]
a = {}
b = { setback = "between" }
c = { setback = 3.0 }
[ground]
kind = "shaping_filter"
rates = { h = "p + 0.3*u", p = "-decay*p - 2*h + w*(1 + 0.5*sin(s))" }
noise = { w = 1e-3, u = 1e-4 }
height = "h"
[travel]
speed = "speed + t"
[initial]
ground = "smooth"
[run]
duration = 3.0
"""


PULSE = """
name = "a pulse whose time is a parameter"
[parameters]
k = 4.0
from = 1.0
length = 0.2
force = 3.0
x0 = 0.4
[rates]
x = "v"
v = "-k*x - 0.3*v - x**3 + (force if from < t < from + length else 0) + w"
[noise]
w = 1.0
[initial]
x = "x0"
[run]
duration = 3.0
"""

STEPS = """
name = "a road that changes where it changes"
[parameters]
k = 30.0
V = 6.0
a = 1.5
place = 7.0
rough = 2.0
[rates]
z = "v"
v = "-k*(z - h) - 2*(v - der(h)) - 0.5*(v - der(h))*abs(v - der(h))"
[contacts]
h = {}
[ground]
kind = "shaping_filter"
rates = { h = "p", p = "-3*p - 2*h + (rough if s > place else 1)*w" }
noise = { w = 0.01 }
height = "h"
[travel]
speed = "V + a*t"
[initial]
ground = "smooth"
[outputs]
closure = "z - h"
squared = "(z - h)**2"
[run]
duration = 2.0
"""

STIFF = """
name = "a stiff chain with friction"
[parameters]
k = 4.0
c = 2000.0
mu = 0.3
q = 0.5
[rates]
x = "v"
v = "-k*x - c*(v - u) - 0.2*x**3"
y = "u"
u = "-5*y - c*(u - v) - mu*tanh(20*u) - 8*z"
z = "-3e4*(z - y*abs(y)) + w"
[noise]
w = "q"
[initial.covariance]
"x,x" = 0.2
[run]
duration = 3.0
"""

MODELS = {"chain": CHAIN, "wheels": WHEELS, "three wheels": THREE_WHEELS, "pulse": PULSE, "steps": STEPS, "stiff": STIFF}


def compiled_model(which: str) -> cs.CompiledModel:
    return cs.compile(toml(MODELS[which]) if which in MODELS else f"models/{which}.toml")


@pytest.mark.parametrize("which", ["wheels", "three wheels", "half_car_acceleration", "oleo_acceleration"])
def test_derivatives_in_machine_code_have_the_rates_of_single_terms(which):
    """Of the ground between wheels, in loops: one gap or two, one noise or two, known in part or not at all."""
    compiled, columns = compiled_model(which), (0, -1, 2)
    p, y = compiled.parameter_vector(), compiled.initial()
    random = np.random.default_rng(0)
    z = np.concatenate([y, 0 * y, 0 * y, 0 * y]) + 1e-2 * random.normal(size=4 * len(y))
    made, found = variational._made(compiled.functions, columns), np.empty_like(z)
    run = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(made.rate)
    for t in (0.0, 1.7):
        run(np.array([t]).ctypes.data, z.ctypes.data, p.ctypes.data, found.ctypes.data)
        expected = np.asarray(variational.variational_rate(compiled.functions, columns)(t, z, p)).ravel()
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("times", [pytest.param([3.0], marks=pytest.mark.slow), [0.01, 0.4, 1.0]])
def test_derivatives_of_a_stiff_run_in_machine_code_are_those_of_sundials(times, monkeypatch):
    compiled, given = compiled_model("stiff"), []
    carry = sensitivity.march_slopes
    monkeypatch.setattr(sensitivity, "march_slopes", lambda *given_: given.append(given_[-1]) or carry(*given_))
    by_code = compiled.gradient("x", times=times, initial=[("x", "x"), "v"])
    assert set(given) == {"stiff"}
    monkeypatch.setattr(sensitivity, "march_slopes", lambda *_: None)
    by_cvodes = compiled.gradient("x", times=times, initial=[("x", "x"), "v"])
    scale = np.abs(by_cvodes).max(axis=0)
    assert np.abs(by_code - by_cvodes).max(axis=0) == pytest.approx(0 * scale, abs=1e-6 * scale.max())
    assert (np.abs(by_code - by_cvodes) <= 1e-6 * scale + 1e-9 * scale.max()).all()
    assert not np.array_equal(by_code, by_cvodes), "they were found in two ways"


@pytest.mark.parametrize("which", ["oleo_acceleration", "van_der_pol", "quarter_car_damper", "stiff", "chain"])
def test_derivatives_in_products_of_matrices_are_those_of_single_terms(which):
    """Of large models those."""
    compiled, columns = compiled_model(which), (1, -1, 0)
    functions, y = compiled.functions, compiled.initial()
    p = np.append(compiled.parameter_vector(), 0.0)
    z = np.concatenate([y, 0 * y, 0 * y, 0 * y]) + 1e-2 * np.random.default_rng(0).normal(size=4 * len(y))
    directions = variational._directions(functions, columns)
    code, found = structured_rate(functions.ingredients, None, "slopes", directions), np.full_like(z, np.nan)
    for t in (0.0, 1.7):
        code.function("slopes", *[ctypes.c_void_p] * 4)(*(each.ctypes.data for each in (np.array([t]), z, p, found)))
        expected = np.asarray(variational.variational_rate(functions, columns)(t, z, p[:-1])).ravel()
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(("damping", "kind"), [(0.2, "native"), (20_000, "stiff")])
@pytest.mark.slow
def test_derivatives_of_a_large_model_are_differences_of_runs(damping, kind, monkeypatch):
    """Without its terms being named: 40 masses in a row, the first on a cubic spring."""
    n = 40
    x, v, w, k = sp.symbols(f"x1:{n + 1}"), sp.symbols(f"v1:{n + 1}"), sp.Symbol("w"), sp.Symbol("k")
    rates: dict[sp.Symbol, sp.Expr] = {}
    for i in range(n):
        stretch = x[i] - (x[i - 1] if i else 0)
        after = x[i + 1] - x[i] if i + 1 < n else 0
        drag = sp.Float(damping if i > n // 2 else 0.2) * v[i]
        rates[x[i]], rates[v[i]] = v[i], k * (after - stretch) - drag + w - (x[0] ** 3 if i == 0 else 0)
    noise = cs.Noise(names=("w",), intensity=sp.eye(1))
    model = cs.Model(cs.Vehicle(rates=rates), noise=noise, parameters={"k": cs.Parameter(sp.Float(1.5))}, duration=2)
    compiled, kinds = cs.compile(model), []
    carry = sensitivity.march_slopes
    monkeypatch.setattr(sensitivity, "march_slopes", lambda *given: kinds.append(given[-1]) or carry(*given))
    found = compiled.gradient(("x1", "v2"), ["k"], times=[0.5, 2.0])[:, 0]
    assert compiled.functions.large
    assert kinds == [kind]
    assert "rate" not in vars(compiled.functions)
    pair = [compiled.propagate([0.5, 2.0], rtol=1e-11, parameters={"k": 1.5 + e}).covariance["x1", "v2"] for e in (-1e-4, 1e-4)]
    np.testing.assert_allclose(found, (pair[1] - pair[0]) / 2e-4, rtol=2e-6)


@pytest.mark.parametrize("which", ["chain", "wheels"])
def test_derivatives_of_some_at_a_time_are_those_of_all_at_once(which, monkeypatch):
    compiled = compiled_model(which)
    name = compiled.states[0]
    once = compiled.gradient(name, times=[0.7, 2.0], initial=[name, (name, name)])
    monkeypatch.setattr(sensitivity, "columns_at_once", lambda _: 2)
    parts = compiled.gradient(name, times=[0.7, 2.0], initial=[name, (name, name)])
    np.testing.assert_allclose(parts, once, rtol=1e-6, atol=1e-9 * np.abs(once).max())
    assert not np.array_equal(parts, once)


def differences(
    compiled: cs.CompiledModel, name: str | tuple[str, str], parameter: str, moment: str, times: list[float]
) -> np.ndarray:
    """Central differences of order 4."""
    declared = compiled.declaration.values[parameter]
    step = 2e-3 * declared
    total: np.ndarray = np.zeros(len(times))
    for k, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
        history = compiled.propagate(times, rtol=1e-11, parameters={parameter: declared + k * step})
        found = history.covariance[name] if isinstance(name, tuple) else getattr(history, moment)[name]
        total = total + weight * found / (12 * step)
    return total


CASES = [
    ("chain", "force", "variance", [1.0, 4.0]),
    ("chain", "force", "mean", [4.0]),
    ("chain", "x", "mean", [4.0]),
    ("chain", ("x", "u"), "variance", [1.0, 4.0]),
    ("wheels", "z", "variance", [0.5, 2.0]),
    ("three wheels", "x", "variance", [0.6, 2.0]),
    ("oleo_acceleration", "closure", "variance", [5.0]),
    ("oleo_acceleration", "damper_force", "mean", [5.0]),
    ("pulse", "x", "mean", [1.1, 3.0]),
    ("pulse", "v", "variance", [3.0]),
    ("steps", "closure", "variance", [0.5, 2.0]),
    ("steps", "squared", "variance", [2.0]),
]


@pytest.mark.parametrize(("which", "name", "moment", "times"), half(CASES))
def test_derivatives_are_central_differences(which, name, moment, times):
    compiled = compiled_model(which)
    history = compiled.propagate(times)
    expected = np.array([differences(compiled, name, each, moment, times) for each in compiled.parameters]).T
    # What a parameter brings, beside all that they bring: differences are no better than that.
    values = np.abs([compiled.declaration.values[each] for each in compiled.parameters])
    noise = 1e-7 * np.abs(expected * values).max() / values
    for method in ("forward", "adjoint"):
        found = history.gradient(name, moment=moment, method=method)
        np.testing.assert_array_less(np.abs(found - expected), 1e-5 * np.abs(expected) + noise, err_msg=method)


@pytest.mark.parametrize("method", ["forward", "adjoint"])
@pytest.mark.parametrize("count", range(1, 9))
def test_one_to_eight_parameters_give_the_same_columns(count, method):
    compiled = compiled_model("chain")
    names = compiled.parameters[:count]
    every = compiled.gradient("y", method="forward")
    np.testing.assert_allclose(compiled.gradient("y", names, method=method), every[:, :count], rtol=1e-5)


@pytest.mark.parametrize("method", ["forward", "adjoint"])
@pytest.mark.parametrize("which", ["wheels", "pulse"])
def test_derivatives_in_the_start_are_differences_of_starts(which, method):
    compiled, times = compiled_model(which), np.array([0.5, 2.0])
    first, second = compiled.states[:2]
    entries = [first, (second, second), (first, second)]
    found = compiled.gradient(first, [], times, initial=entries, method=method)
    start, p, n = compiled.initial(), compiled.parameter_vector(), compiled.packing.n
    breakpoints = compiled.breakpoints(p, 2.0)
    for k, entry in enumerate((0, 2 * n, n + 1)):
        ends = []
        for sign in (1, -1):
            y = start.copy()
            y[entry] += sign * 1e-4
            ends.append(integrate(compiled.functions, Start(y, p, breakpoints), times, rtol=1e-11).y[:, n])
        np.testing.assert_allclose(found[:, k], (ends[0] - ends[1]) / 2e-4, rtol=1e-5, atol=1e-5 * np.abs(found).max())


def test_a_parameter_of_the_start_alone():
    compiled = compiled_model("pulse")
    np.testing.assert_allclose(
        compiled.gradient("x", ["x0"], [2.0], moment="mean"),
        compiled.gradient("x", [], [2.0], moment="mean", initial=["x"]),
        rtol=1e-6,
    )


def test_where_the_adjoint_gives_up_forward_goes_on(monkeypatch):
    from cadet_sym.solve import gradient

    def gives_up(*_):
        raise SolverError("too much work")

    compiled = compiled_model("chain")
    expected = compiled.gradient("y", method="forward")
    monkeypatch.setattr(gradient, "adjoint", gives_up)
    monkeypatch.setattr(gradient, "MANY", 0)
    np.testing.assert_array_equal(compiled.gradient("y"), expected)
    with pytest.raises(SolverError, match="too much work"):
        compiled.gradient("y", method="adjoint")


HELD = """
name = "hysteresis and dry friction from rest"
[parameters]
k = 10.0
c = 1.0
A = 1.0
F = 0.5
q = 1.0
[elements.hysteresis]
arguments = ["v", "y"]
value = "A*v - 0.5*abs(v)*y - 0.5*v*abs(y)"
[rates]
x = "v"
v = "-k*(x + y) - c*v - F*sign(v) + w"
y = "hysteresis(v, y)"
[noise]
w = "q"
[run]
duration = 2.0
"""


@pytest.mark.parametrize("which", ["held", "quarter_car_linear", "quarter_car_damper", "road_class_change"])
def test_from_rest_both_ways_are_differences_of_runs(which):
    """Towards a start without variance the adjoint grows without bound; and implicit formulas may not begin there."""
    compiled = cs.compile(toml(HELD) if which == "held" else ROOT / "models" / f"{which}.toml")
    times = compiled.propagate().time[-1:] / 2
    history = compiled.propagate(times, rtol=1e-9)
    values, name = history.provenance.parameters, history.states[1]
    parameters = list(values)[:3]
    forward, adjoint = (history.gradient(name, parameters, times, method=way) for way in ("forward", "adjoint"))
    unit = np.array([values[each] for each in parameters])
    expected = np.empty_like(forward)
    for j, each in enumerate(parameters):
        low, high = (
            compiled.propagate(times, rtol=1e-10, parameters={each: values[each] * share}).variance[name]
            for share in (0.999, 1.001)
        )
        expected[:, j] = (high - low) / (2e-3 * values[each])
    size = np.abs(expected * unit).max()
    np.testing.assert_allclose(forward * unit, expected * unit, atol=1e-5 * size, rtol=0)
    np.testing.assert_allclose(adjoint * unit, expected * unit, atol=1e-5 * size, rtol=0)


def test_derivatives_of_another_run_are_refused(monkeypatch):
    """From rest implicit formulas take the friction's first gain, which has no bound, for that of the run."""
    compiled = cs.compile(toml(HELD))
    monkeypatch.setattr(sensitivity, "onset", lambda lowered, p, tolerance, begin, y, _: Onset(y[:0, None], begin, y, 0, True))
    with pytest.raises(SolverError, match="differ from those of the run"):
        compiled.gradient(compiled.states[1], compiled.parameters[:1], method="forward")


@pytest.mark.parametrize("method", [pytest.param("forward", marks=pytest.mark.slow), "adjoint"])
def test_derivatives_end_in_one_sentence_where_friction_brings_to_rest_without_noise(method):
    text = """
    name = "slide"
    [parameters]
    mu = 2.0
    v0 = 3.0
    [rates]
    x = "v"
    v = "-mu*sign(v)"
    [initial]
    v = "v0"
    [run]
    duration = 3.0
    """
    compiled = cs.compile(toml(text))
    before = compiled.gradient("x", times=[1.0], moment="mean", method=method)  # v0 t - mu t^2/2
    np.testing.assert_allclose(before, [[-0.5, 1.0]], rtol=1e-8)
    with pytest.raises(SolverError, match=r"break down between t = \S+ and 3: CVODES gives up .* differences of runs"):
        compiled.gradient("x", times=[3.0], moment="mean", method=method)


def test_a_breakpoint_that_comes_or_goes_is_said():
    compiled = compiled_model("pulse")
    with pytest.raises(SolverError, match="comes or goes"):
        compiled.gradient("x", ["from"], [3.0], moment="mean", values={"from": 2.99999})


def test_a_history_keeps_its_model_within_its_process():
    import pickle

    compiled = compiled_model("pulse")
    history = compiled.propagate([1.0, 2.0], parameters={"k": 5.0})
    found = history.gradient("x", ["k"])
    np.testing.assert_array_equal(found, compiled.gradient("x", ["k"], [1.0, 2.0], values={"k": 5.0}))
    with pytest.raises(ModelError, match="without its model"):
        pickle.loads(pickle.dumps(history)).gradient("x")


def test_unknown_names_are_refused():
    compiled = cs.compile(toml(CHAIN))
    wrong: tuple[dict[str, Any], ...] = (
        {"name": "nothing"},
        {"name": "x", "parameters": ["k9"]},
        {"name": "x", "method": "magic"},
        {"name": "x", "initial": ["q"]},
        {"name": "x", "initial": [("x", "q")]},
    )
    for arguments in wrong:
        with pytest.raises(ModelError):
            compiled.gradient(**arguments)


@pytest.mark.parametrize(
    "name", ["oleo_acceleration", pytest.param("half_car", marks=pytest.mark.slow), "steps", "van_der_pol"]
)
def test_machine_code_and_implicit_formulas_give_the_same_derivatives(name, monkeypatch):
    compiled = compiled_model(name)
    times, parameters = [0.3 * compiled.declaration.duration, compiled.declaration.duration], compiled.parameters[:3]
    asked: list[bool] = []
    monkeypatch.setattr(sensitivity, "engine_for", lambda *_: asked.append(True) or "native")
    by_code = compiled.gradient(compiled.outputs[0], parameters, times=times, method="forward")
    monkeypatch.setattr(sensitivity, "march_slopes", lambda *_: None)
    by_cvodes = compiled.gradient(compiled.outputs[0], parameters, times=times, method="forward")
    assert asked
    assert np.abs(by_code - by_cvodes).max() < 1e-6 * np.abs(by_cvodes).max()
    assert not np.array_equal(by_code, by_cvodes), "they were found in two ways"
