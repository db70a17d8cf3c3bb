"""A measured curve times a smooth function of another argument: any number of rows, any correlation, one rule for all rows."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import half, one_in
from exported import build, sources
from gaussian_integrals import BESIDE, covariance, one, panels
from sympy.core.symbol import Str

import cadet_sym as cs
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.nested import Nested
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import Lookup
from cadet_sym.lowering.elements import element_function

X, Y, A = (symbol(name) for name in "xya")
RHOS = [0.0, 0.5, -0.95, 0.9999, -0.999999, 1.0, -1.0]
MOMENTS = [((0.0, 0.0), (1.0, 1.3)), ((0.4, -0.3), (0.2, 2.0)), ((-1.0, 1.0), (3.0, 0.6))]


def curve(argument: sp.Expr, rows: int, outside: str = "extrapolate", method: str = "linear") -> Lookup:
    """One row is at zero, where the means are at rest."""
    z = sorted({sp.Rational(round(1000 * (v + 0.13 * np.sin(7 * v))), 1000) for v in np.linspace(-2, 2.5, rows)} | {sp.S.Zero})
    f = [sp.Rational(round(1000 * (np.tanh(2 * float(v)) + 0.3 * np.cos(4 * float(v)))), 1000) for v in z]
    return Lookup(argument, sp.Tuple(*z), sp.Tuple(*f), Str(outside), Str(method))


FUNCTIONS = {  # a curve and what it is multiplied by, where that has kinks or is steep in the other argument
    "steep in the other": (curve(X, 60), parse("tanh(2*y)"), [0.0]),
    "held, with a kink of the other": (curve(X, 5, "hold"), parse("exp(-abs(y))"), [0.0]),
    "monotone, with a root of the other": (curve(X, 30, method="monotone"), parse("abs(y - 0.5)**1.5"), [0.5]),
    "read backwards, with a kink of its own": (curve(1 - 2 * X, 40), parse("abs(x - 0.2)*atan(y)"), [0.0]),
    "with a jump of its own": (curve(X, 25), parse("sign(x - 0.1)*tanh(y)"), [0.0]),
    "squared": (curve(X, 25) ** 2, parse("tanh(y)"), [0.0]),
    "monotone and squared": (curve(X, 40, "hold", "monotone") ** 2, parse("tanh(y)"), [0.0]),
    "scaled and shifted": (A * curve(A * X - 1, 20), parse("tanh(y)"), [0.0]),
    "two steep places": (curve(X, 40), parse("atan(5*y)*tanh(y - 1)"), [0.0, 1.0]),
    "across both": (curve(X, 40), parse("tanh(x*y)"), [0.0]),
    "smooth": (curve(X, 40), parse("sin(y)"), []),
}
A_IS = 1.3
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)


@cache
def compiled(name: str) -> tuple[ca.Function, ca.Function]:
    """E[f] and gains; these with their derivatives."""
    body = FUNCTIONS[name][0] * FUNCTIONS[name][1]
    parameters = (A,) if body.has(A) else ()
    function = element_function(describing_function((X, Y), body, name="f", values={A: A_IS}), parameters)
    v = ca.SX.sym("v", 5)
    moments = ca.vertcat(*function(v[:2], v[2:], [A_IS] if parameters else []))
    return ca.Function("moments", [v], [moments]), ca.Function("J", [v], [moments, ca.jacobian(moments, v)])


def values(expr: sp.Expr, *at: np.ndarray) -> np.ndarray:
    """An expression in x and perhaps y, the impulses of jumps left out."""
    smooth = expr.replace(sp.DiracDelta, lambda *_: sp.S.Zero)
    return np.broadcast_to(evaluate(smooth, {A: A_IS, **dict(zip((X, Y), at, strict=False))}), at[-1].shape)


def truth(name: str, mean: Sequence[float], stds: Sequence[float], rho: float) -> tuple[np.ndarray, float]:
    """E[f], E of its derivatives without impulses, E|f|: over x by Gauss's rule on every row, over y given x by brute force."""
    table, factor, special = FUNCTIONS[name]
    (mx, my), (sx, sy) = mean, stds
    (lookup,) = table.atoms(Lookup)
    a, b = (evaluate(e, {A: A_IS}) for e in (sp.diff(lookup.argument, X), lookup.argument.subs(X, 0)))
    edges = [(float(k) - b) / a for k in lookup.knots] + [0.1, 0.2] + list(mx + sx * np.linspace(-9, 9, 37))
    if rho:  # where the mean of y passes what is special of it, and around
        left = max(np.sqrt(1 - rho**2), 1e-9)
        spread = *(left * np.linspace(-9, 9, 19)), *BESIDE, *(50 * left * BESIDE)
        edges += [mx + sx * ((k - my) / sy + r) / rho for k in special for r in spread]
    edges = np.unique(np.clip(edges, mx - 9 * sx, mx + 9 * sx))
    half_length = np.diff(edges)[:, None] / 2
    x = (edges[:-1, None] + half_length * (1 + NODES)).ravel()
    u = (x - mx) / sx
    weight = (half_length * WEIGHTS).ravel() * np.exp(-u * u / 2) / np.sqrt(2 * np.pi) / sx
    centre, spread = my + rho * sy * u[:, None], sy * np.sqrt(1 - rho**2)
    places = [(k - centre) / spread + BESIDE for k in special] if spread else []
    v, p = panels(np.concatenate(places, axis=1) if places else np.zeros((len(x), 0)))
    y = centre + spread * v
    wanted = factor, factor.diff(X), factor.diff(Y), sp.Abs(factor)
    inner = [np.sum(p * values(e, x[:, None] + 0 * y, y), axis=1) for e in wanted]
    f, slope = values(table, x), values(table.diff(X), x)
    found = weight @ (f * inner[0]), weight @ (slope * inner[0] + f * inner[1]), weight @ (f * inner[2])
    return np.array(found), float(weight @ np.abs(f * inner[3]))


@pytest.mark.parametrize("rho", RHOS)
@pytest.mark.parametrize("name", one_in(3, FUNCTIONS))
def test_any_correlation_gives_the_integral_and_the_gains(name, rho):
    function, _ = compiled(name)
    for mean, stds in MOMENTS if name != "across both" else MOMENTS[1:2]:
        found = np.array(function([*mean, *covariance(stds, rho)])).ravel() * (1, *stds)
        wanted, size = truth(name, mean, stds, rho)
        wanted *= (1, *stds)
        known = slice(1) if "jump" in name else slice(None)
        assert found[known] == pytest.approx(wanted[known], abs=1e-8 * size), (mean, stds)


@pytest.mark.parametrize("rho", RHOS)
@pytest.mark.parametrize("name", one_in(5, FUNCTIONS))
def test_gains_are_slopes_and_the_variances_follow_the_heat_equation(name, rho):
    _, J = compiled(name)
    for mean, stds in MOMENTS:
        moments, jacobian = (np.array(each) for each in J([*mean, *covariance(stds, rho)]))
        assert np.all(np.isfinite(jacobian))
        scale = np.outer(stds, stds)
        H, size = jacobian[1:, :2] * scale, np.abs(jacobian[1:, :2] * scale).max() + abs(moments[0, 0])
        assert jacobian[0, :2] == pytest.approx(moments[1:, 0], abs=1e-7 * size / min(stds))
        if abs(rho) < 1:  # at it the derivative is one-sided
            heat = np.array([H[0, 0] / 2, H[1, 0], H[1, 1] / 2])
            assert jacobian[0, 2:] * scale[[0, 0, 1], [0, 1, 1]] == pytest.approx(heat, abs=2e-6 * size), (mean, stds)


@pytest.mark.parametrize("name", half(FUNCTIONS))
def test_without_variance_the_curve_is_evaluated_and_derivatives_are_its_own(name):
    function, J = compiled(name)
    table, factor, special = FUNCTIONS[name]
    for mean in ((0.41, -0.3), (-1.3, 0.7)):
        at = {X: mean[0], Y: mean[1], A: A_IS}
        f, slope = (evaluate(e.replace(sp.DiracDelta, lambda *_: sp.S.Zero), at) for e in (table, table.diff(X)))
        bends = [evaluate(sp.diff(factor, Y, k).replace(sp.DiracDelta, lambda *_: sp.S.Zero), at) for k in range(3)]
        for tiny in (0.0, 1e-300, 1e-24):
            moments, jacobian = (np.array(each) for each in J([*mean, tiny, 0.3 * tiny, tiny]))
            moved = evaluate(factor.diff(X).replace(sp.DiracDelta, lambda *_: sp.S.Zero), at)
            wanted = [f * bends[0], slope * bends[0] + f * moved, f * bends[1]]
            assert moments[:, 0] == pytest.approx(wanted, rel=1e-9, abs=1e-10)
            assert np.all(np.isfinite(jacobian))
            assert jacobian[0, 4] == pytest.approx(f * bends[2] / 2, rel=1e-6, abs=1e-8)
        wanted = f * one(lambda y, x=mean[0]: values(factor, x + 0 * y, y), mean[1], 0.8, special)[0]
        assert float(function([*mean, 0, 0, 0.64])[0]) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("method", ["linear", "monotone"])
def test_without_correlation_it_is_the_product_of_two_expectations_at_any_scale(method):
    table, factor = curve(X, 200, "hold", method), sp.tanh(Y)
    both = element_function(describing_function((X, Y), table * factor), ())
    one_of, other = (element_function(describing_function((z,), f), ()) for z, f in ((X, table), (Y, factor)))
    for sx, sy in ((1e-3, 1.0), (1.0, 0.3), (30.0, 3.0), (1e4, 1.0)):
        (E, slope), (G, rate) = one_of(0.3, sx**2, []), other(0.2, sy**2, [])
        value, gain = both([0.3, 0.2], [sx**2, 0, sy**2], [])
        assert float(value) == pytest.approx(float(E * G), rel=1e-9, abs=1e-10)
        wanted = [float(slope * G) * sx, float(E * rate) * sy]
        assert np.array(gain).ravel() * (sx, sy) == pytest.approx(wanted, rel=1e-8, abs=1e-9)


def test_a_curve_without_kinks_is_a_straight_line():
    straight = Lookup(X, sp.Tuple(0, 1), sp.Tuple(1, 3), Str("extrapolate"), Str("linear"))
    found, plain = (element_function(describing_function((X, Y), f * sp.tanh(Y)), ()) for f in (straight, 1 + 2 * X))
    for rho in RHOS:
        at = [0.3, -0.2], covariance((1.0, 2.0), rho), []
        for a, b in zip(found(*at), plain(*at), strict=True):
            assert np.array(a) == pytest.approx(np.array(b), rel=1e-12)


def test_the_cost_grows_with_the_rows_as_slowly_as_one_pass_over_them():
    """Nodes are as many whatever the rows: over the other argument, or cut at every row, they could not resolve them all."""
    few, many = (describing_function((X, Y), curve(X, rows) * sp.tanh(Y)) for rows in (10, 200))
    assert [type(part) for part in many.products] == [Nested]
    assert few.nodes == many.nodes < 20_000
    assert many.error <= 1e-8


MODEL = """
schema = 1
name = "Seat on a damper whose force fades with the stroke"
[elements.damper]
arguments = ["v"]
table = "damper.csv"
[rates]
x = "v"
v = "-30*x - 4*damper(v)*(1 + 0.5*tanh(3*x)) + u"
[noise]
u = 2.0
[run]
duration = 0.5
points = 3
"""


def at_rest(tmp_path: Path) -> cs.CompiledModel:
    rows = (f"{v:.2f},{np.tanh(2 * v) + 0.3 * np.sin(5 * v):.4f}" for v in np.linspace(-2, 2, 20))
    (tmp_path / "damper.csv").write_text("v,force\n" + "\n".join(rows) + "\n")
    (tmp_path / "model.toml").write_text(MODEL)
    return cs.compile(cs.load(tmp_path / "model.toml"))  # warnings are errors


def test_a_model_starts_at_rest_and_is_right_all_along(tmp_path):
    compiled = at_rest(tmp_path)
    moments = compiled.propagate()
    run = cs.check_run(compiled, moments)
    assert max(max(point.error, point.gain_error) for _, point in run.found) < 1e-8


@pytest.mark.slow
def test_c_agrees(tmp_path):
    folder = at_rest(tmp_path).export_c(tmp_path / "c", prefix="seat")
    made = build(folder, tmp_path / "test", [*sources(folder), folder / "test.c"])
    tested = subprocess.run([made], capture_output=True, text=True, timeout=60)
    assert tested.returncode == 0, tested.stdout
