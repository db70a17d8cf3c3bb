"""Products of measured curves of two arguments: any number of rows, any correlation, in closed form."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from functools import cache
from itertools import product

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import half, one_in
from exported import build, sources
from gaussian_integrals import covariance, two
from sympy.core.symbol import Str

import cadet_sym as cs
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.conditional import Product
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import Lookup
from cadet_sym.lowering import columns
from cadet_sym.lowering.elements import element_function

X, Y, W, A = (symbol(name) for name in "xywa")
RHOS = [0.0, 0.5, -0.95, 0.999999, 1.0, -1.0]
MOMENTS = [((0.3, -0.2), (0.7, 1.5)), ((1.0, 1.0), (1.0, 1.0)), ((-4.0, 40.0), (0.2, 3.0))]


def curve(argument: sp.Expr, rows: int = 6, outside: str = "extrapolate", method: str = "linear") -> Lookup:
    z = [sp.Rational(round(1000 * (v + 0.13 * np.sin(7 * v))), 1000) for v in np.linspace(-2, 2.5, rows)]
    f = [sp.Rational(round(1000 * (np.tanh(2 * float(v)) + 0.3 * float(v) ** 2)), 1000) for v in z]
    return Lookup(argument, sp.Tuple(*z), sp.Tuple(*f), Str(outside), Str(method))


def kinks(expr: sp.Expr, z: sp.Symbol, values: dict) -> list[float]:
    """Of curves affine in z, and of what else has one at 0 or 1."""
    found = [0.0, 1.0]
    for each in expr.atoms(Lookup):
        if each.has(z):
            a, b = (evaluate(e, values) for e in (sp.diff(each.argument, z), each.argument.subs(z, 0)))
            found += [(float(k) - b) / a for k in each.knots]
    return found


MODEL = """
schema = 1
name = "Body on two measured dampers"
[elements.damper]
arguments = ["v"]
table = "damper.csv"
units = ["mm/s", "N"]
[rates]
z = "w"
q = "p"
w = "-20*z - (damper(w + p) + damper(w - p))/300 + u_1"
p = "-30*q - (damper(w + p) - damper(w - p))/200 + u_2"
[noise]
u_1 = 0.5
u_2 = 0.3
[outputs]
acceleration = "z - damper(w + p) - damper(w - p)"
[run]
duration = 0.5
points = 3
"""
CASES = {
    "linear": curve(X) * curve(Y),
    "held": curve(X, outside="hold") * curve(Y, 9),
    "monotone": curve(X, method="monotone") * curve(Y, 5, "hold"),
    "stop": curve(X) * parse("max(y - 1, 0)"),
    "jump": curve(X) * parse("sign(y)*(2 + y)"),
    "of another slope": A * curve(1 - 2 * X) * (curve(A * Y) + parse("3*abs(y)*y")),
    "many rows": curve(X, 14, method="monotone") * curve(Y, 14),
}


@cache
def function_of(expr: sp.Expr) -> ca.Function:
    df = describing_function((X, Y), expr, name="f")
    assert all(isinstance(part, Product) for part in df.products)
    assert df.error == 0
    return element_function(df, (A,))


def found(expr: sp.Expr, mean, stds, rho: float) -> np.ndarray:
    F, gain = function_of(expr)(mean, covariance(stds, rho), 1.7)
    return np.array([float(F), *np.array(gain).ravel()])


@pytest.mark.parametrize(
    ("name", "rho"), one_in(4, product([*CASES][:-1], RHOS)) + half([("many rows", 1.0), ("many rows", 0.5)])
)
def test_it_is_the_integral(name, rho):
    expr, values = CASES[name], {A: 1.7}
    breaks = [kinks(expr, z, values) for z in (X, Y)]

    def f(x, y):
        return evaluate(expr, {X: x, Y: y, **values})

    for mean, stds in MOMENTS:
        exact, (F, *gains) = two(f, mean, stds, rho, breaks), found(expr, mean, stds, rho)
        size = abs(f(*mean)) + stds[0] * stds[1]
        assert pytest.approx(exact, abs=1e-10 * size) == F
        step = 1e-4
        for i, gain in enumerate(gains):
            ahead, behind = (
                found(expr, tuple(m + sign * step * (j == i) for j, m in enumerate(mean)), stds, rho)[0] for sign in (1, -1)
            )
            assert gain == pytest.approx((ahead - behind) / (2 * step), rel=1e-5, abs=1e-6 * size / min(stds))


@pytest.mark.parametrize("name", CASES)
def test_without_variance_it_is_the_product_itself(name):
    expr = CASES[name]
    F, *gains = found(expr, (0.31, -0.4), (0.0, 0.0), 0.0)
    assert pytest.approx(evaluate(expr, {X: 0.31, Y: -0.4, A: 1.7}), rel=1e-12) == F
    assert np.isfinite(gains).all()


@pytest.mark.parametrize(
    ("text", "alone"),
    [
        ("max(x - a, 0)*max(y - a, 0)", "max(x - a, 0)**2"),
        ("max(x - a, 0)*sign(y - a)", "max(x - a, 0)"),
        ("abs(x - a)*min(y - a, 1)", "abs(x - a)*min(x - a, 1)"),
        ("heaviside(x - a)*abs(y)", "heaviside(x - a)*abs(x)"),
    ],
)
def test_of_two_arguments_that_are_one_only_one_is_left(text, alone):
    """At correlation one, kinks at the same place: a rounding must not tell on which side of each other they are."""
    both, one = describing_function((X, Y), parse(text), name="f"), describing_function((X,), parse(alone), name="f")
    rng = np.random.default_rng(5)
    m, s, kink = rng.normal(0, 1, 200), rng.uniform(0.1, 2, 200), rng.normal(0, 1, 200)
    p = s * s
    F, gain = element_function(both, (A,))(np.array([m, m]), np.array([p, p, p]), kink[None])
    exact, slope = element_function(one, (A,))(m[None], p[None], kink[None])
    size = np.abs(np.array(exact)) + p
    assert np.array(F) == pytest.approx(np.array(exact), abs=1e-12 * size.max())
    assert np.array(gain).sum(0) == pytest.approx(np.array(slope)[0], rel=1e-9, abs=1e-9)


def test_series_and_pairs_agree_and_so_do_their_jacobians(monkeypatch):
    """Mehler's series up to correlations near one, pairs of kinks beyond: the same numbers, from no variance on."""
    df = describing_function((X, Y), curve(X, 30, method="monotone") * curve(Y, 30, "hold"), name="f")
    m, S = ca.SX.sym("m", 2), ca.SX.sym("S", 3)

    def function() -> ca.Function:
        columns._called.cache_clear()
        element_function.cache_clear()
        F, gain = element_function(df, ())(m, S, ca.SX(0, 1))
        found = ca.vertcat(F, gain)
        return ca.Function("f", [m, S], [found, ca.jacobian(found, ca.vertcat(m, S))])

    series = function()
    monkeypatch.setattr(columns, "TERMS", (32,))
    monkeypatch.setattr(columns, "LEFT", 0.0)
    pairs = function()
    columns._called.cache_clear()
    rng = np.random.default_rng(1)
    for spread in (0.0, 0.02, 0.5, 5.0):
        for rho in (0.0, -0.3, 0.7, -0.9, 0.97, 0.999):
            mean, stds = rng.normal(0, 1, 2), spread * rng.uniform(0.5, 2, 2)
            (value, slopes), (other, others) = (fn(mean, covariance(tuple(stds), rho)) for fn in (series, pairs))
            size = np.abs(np.array(other)[0]) + stds[0] * stds[1]
            scale = np.array([[1.0], [stds[0]], [stds[1]]])
            assert np.abs((np.array(value) - np.array(other)) * scale).max() <= 1e-12 * size
            assert np.array(slopes) == pytest.approx(np.array(others), rel=1e-8, abs=1e-8 * np.abs(np.array(others)).max())


def test_a_half_car_with_long_tables_runs_is_exported_and_says_why_it_is_no_matlab(tmp_path):
    rows = [f"{1000 * z:.6g},{1500 * np.tanh(2 * z):.6g}" for z in np.linspace(-1.5, 1.5, 60)]
    (tmp_path / "damper.csv").write_text("velocity [mm/s],force [N]\n" + "\n".join(rows))
    (tmp_path / "half.toml").write_text(MODEL)
    compiled = cs.compile(cs.load(tmp_path / "half.toml"))
    history = compiled.propagate()
    assert history.std["acceleration"][-1] > 0
    with pytest.raises(cs.ExportError, match="output `acceleration`: a product of two measured curves takes 3364 pairs"):
        compiled.export_c(tmp_path / "m", matlab=True)
    folder = compiled.export_c(tmp_path / "c", prefix="half")
    assert sum(path.stat().st_size for path in sources(folder)) < 1.5e6
    made = build(folder, tmp_path / "test", [*sources(folder), folder / "test.c"])
    run = subprocess.run([made], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize("method", ["linear", "monotone"])
@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
def test_a_curve_of_many_rows_is_called_and_the_same_as_written_out(method, outside):
    body = 3 * curve(2 * X - 1, 60, outside, method) + X**2
    df = describing_function((X,), body)
    alone = replace(df, products=tuple(product.written_out() for product in df.products))
    m, S = ca.SX.sym("m"), ca.SX.sym("S")
    both = []
    for each in (df, alone):
        moments = ca.vertcat(*element_function(each, ())(m, S, []))
        both.append(ca.Function("both", [m, S], [moments, ca.jacobian(moments, ca.vertcat(m, S))]))
    called, written = both
    assert max(each.info()["n"] for each in called.find_functions() if each.class_name() == "Map") <= 61  # once a row
    assert not written.find_functions()
    for mean, variance in product((0.3, -1.0, 5.0, -40.0), (0, 1e-300, 1e-6, 0.01, 0.5, 1e3, 1e6)):
        for found, wanted in zip(called(mean, variance), written(mean, variance), strict=True):
            wanted = np.array(wanted)
            np.testing.assert_allclose(np.array(found), wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
