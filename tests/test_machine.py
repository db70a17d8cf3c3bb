"""Machine code gives CasADi's numbers, is made once, kept on disk, and can be done without.

To the last bit, but where exponentials are taken several at a time (see test_vectors.py).
"""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import SHIPPED, half
from hypothesis import given, settings
from hypothesis import strategies as st

import cadet_sym as cs
from cadet_sym import cache
from cadet_sym.cli import main
from cadet_sym.lowering import functions, llvm, machine, scalars
from cadet_sym.lowering.structured import structured_rate
from cadet_sym.solve.many import Start
from cadet_sym.solve.native import Native
from cadet_sym.solve.transient import integrate

OLEO = "models/oleo_acceleration.toml"


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def compiled_function(function: ca.Function, effort: int = 1) -> Callable[..., list[np.ndarray]]:
    """The function as machine code."""
    code = machine.machine_code(llvm.intermediate(function, "tested"), "tested", effort=effort)
    call = code.function("tested", *[ctypes.c_void_p] * (function.n_in() + function.n_out()))

    def run(*arguments: np.ndarray) -> list[np.ndarray]:
        results = [np.full(function.numel_out(i), np.nan) for i in range(function.n_out())]
        call(*(v.ctypes.data for v in [*map(np.ascontiguousarray, arguments), *results]))
        return results

    return run


def virtual(function: ca.Function, arguments: list) -> list[np.ndarray]:
    return [np.array(ca.densify(part)).ravel(order="F") for part in function.call(arguments)]


ONE = [
    *("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("fabs", "floor", "ceil", "sign", "erf", "log1p", "expm1", "logic_not"),
]
TWO = [
    *("plus", "minus", "times", "rdivide", "power", "fmin", "fmax", "atan2", "fmod", "remainder", "hypot", "copysign"),
    *("lt", "le", "eq", "ne", "logic_and", "logic_or"),
]
SPECIAL = [0.0, -0.0, 0.3, -0.3, 1.0, 2.5, -7.0, 1e-300, 1e300, np.inf, -np.inf, np.nan]


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_every_operation_is_casadis_to_the_last_bit(name):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    value = getattr(ca, name)(x, y) if name in TWO else getattr(ca, name)(x)
    # C leaves open which of two zeros is the smaller one
    inverse = value if name in ("fmin", "fmax") else 1 / value
    function = ca.Function("f", [x, y], [value, ca.if_else(x, value, -y), value * value + inverse])
    run = compiled_function(function)
    for a, b in itertools.product(SPECIAL, SPECIAL if name in TWO else [0.5]):
        np.testing.assert_array_equal(np.ravel(run(a, b)), np.ravel(virtual(function, [a, b])))


@pytest.mark.parametrize("path", half(SHIPPED), ids=lambda path: path.stem)
def test_the_rate_of_every_model_is_casadis_to_the_last_bit(path, shipped):
    compiled = shipped(path.stem)
    rate, p, y = compiled.functions.rate, compiled.parameter_vector(), compiled.initial()
    y = y + np.random.default_rng(0).normal(size=len(y)) * 1e-2
    for t in (0.0, 1.7):
        arguments = [np.array([t]), y, p]
        for effort in (0, 1) if rate.n_instructions() < 10_000 else (0,):
            np.testing.assert_array_equal(compiled_function(rate, effort)(*arguments)[0], virtual(rate, arguments)[0])


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_rate_in_loops_is_the_one_of_single_terms(path, shipped):
    compiled = shipped(path.stem)
    if compiled.functions.facts.delay is not None:
        pytest.skip("the ground between wheels is not written in loops")
    p, y = np.append(compiled.parameter_vector(), 0.0), compiled.initial()
    y = y + np.random.default_rng(0).normal(size=len(y)) * 1e-2
    code = structured_rate(compiled.functions.ingredients, None).function("rate", *[ctypes.c_void_p] * 4)
    for t in (0.0, 1.7):
        found = np.full(len(y), np.nan)
        code(np.array([t]).ctypes.data, y.ctypes.data, p.ctypes.data, found.ctypes.data)
        expected = virtual(compiled.functions.rate, [t, y, p[:-1]])[0]
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14 * np.abs(expected).max())


def test_a_large_model_is_integrated_without_its_terms_being_named():
    n = 62
    x, w = sp.symbols(f"x1:{n + 1}"), sp.Symbol("w")
    rates = {x[i]: -x[i] + (x[i - 1] ** 3 / 10 if i else w) + x[(i + 1) % n] / 3 for i in range(n)}
    rates |= {x[0]: rates[x[0]] + sum(x) / 100}
    model = cs.Model(cs.Vehicle(rates=rates), noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=2)
    compiled = cs.compile(model)
    assert compiled.functions.large
    history = compiled.propagate([0.5, 2.0], rtol=1e-8)
    assert history.provenance.engine == Native.name
    assert "rate" not in vars(compiled.functions)
    other = compiled.propagate([0.5, 2.0], rtol=1e-8, engine="stepping")
    np.testing.assert_allclose(history.state_covariance, other.state_covariance, rtol=1e-6, atol=1e-9)


def test_long_functions_are_cut_into_blocks_that_pass_values_on(monkeypatch):
    x = ca.SX.sym("x", 40)
    values, total = [ca.sinh(x[i]) for i in range(40)], ca.SX(0)
    for k in range(200):
        total = ca.cos(total + values[k % 40]) * values[(7 * k) % 40]
    function = ca.Function("long", [x], [total, ca.vertcat(*values)])
    at = [np.linspace(0.1, 2.0, 40)]
    for length in (3, 50, 10_000):
        monkeypatch.setattr(scalars, "BLOCK", length)
        for found, expected in zip(compiled_function(function)(*at), virtual(function, at), strict=True):
            np.testing.assert_array_equal(found, expected)


@settings(max_examples=30, deadline=None)
@given(
    st.recursive(
        st.sampled_from(["x", "y"]) | st.floats(-3, 3),
        lambda inner: st.tuples(st.sampled_from(["plus", "times", "fmin", "atan2", "lt"]), inner, inner)
        | st.tuples(st.sampled_from(["sin", "tanh", "erf", "sign"]), inner),
        max_leaves=12,
    )
)
def test_random_expressions_are_casadis_to_the_last_bit(tree):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")

    def build(node):
        if isinstance(node, tuple):
            return getattr(ca, node[0])(*map(build, node[1:]))
        return {"x": x, "y": y}.get(node, node) if isinstance(node, str) else ca.SX(node)

    function = ca.Function("f", [x, y], [build(tree)])
    at = [np.array([0.7]), np.array([-1.3])]
    np.testing.assert_array_equal(compiled_function(function)(*at)[0], virtual(function, at)[0])


def test_code_is_made_once_and_again_where_it_was_cut_off(place, monkeypatch):
    made = []
    original = machine._compiled
    monkeypatch.setattr(machine, "_compiled", lambda text, effort: made.append(1) or original(text, effort))
    first = cs.compile(OLEO).propagate(points=5)
    kept = [path for path in place.rglob("*.o") if path.name.startswith("free_rate")]
    assert len(kept) == 1
    before = len(made)
    again = cs.compile(OLEO).propagate(points=5)
    assert len(made) == before
    kept[0].write_bytes(kept[0].read_bytes()[:1000])
    mended = cs.compile(OLEO).propagate(points=5)
    assert len(made) == before + 1
    for history in (again, mended):
        np.testing.assert_array_equal(history.state_covariance, first.state_covariance)


def test_large_models_are_compiled_only_on_request(monkeypatch):
    monkeypatch.setattr(functions, "LARGE", 200)
    plain, thorough = cs.compile(OLEO), cs.compile(OLEO, jit=True)
    assert plain.functions.machine("rate") is None
    assert thorough.functions.machine("rate") is not None
    found = [compiled.propagate(points=5, rtol=1e-9) for compiled in (plain, thorough)]
    assert [each.provenance.engine for each in found] == ["CVODES (BDF, direct)", Native.name]
    np.testing.assert_allclose(found[0].state_covariance, found[1].state_covariance, rtol=1e-6, atol=1e-7)
    with pytest.raises(cs.ModelError, match="jit=True"):
        plain.propagate(engine="native")


def test_without_llvm_everything_works(monkeypatch):
    monkeypatch.setattr(functions, "available", lambda: False)
    compiled = cs.compile(OLEO)
    history = compiled.propagate(points=5)
    assert history.provenance.engine == "CVODES (BDF, direct)"
    start = Start(compiled.initial(), compiled.parameter_vector(), compiled.breakpoints(compiled.parameter_vector(), 10.0))
    found = integrate(compiled.functions, start, np.array([5.0]), rtol=1e-8, engine="implicit")
    np.testing.assert_allclose(found.y[0, :4], compiled.propagate([5.0]).state_mean[0], rtol=1e-5, atol=1e-7)


def test_without_a_cache_it_works(monkeypatch, capsys):
    monkeypatch.setenv(cache.VARIABLE, cache.OFF)
    assert main(["moments", OLEO, "--points", "3", "--jit", "--json"]) == 0
    assert capsys.readouterr().out
