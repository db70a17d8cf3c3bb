"""Elements as the solvers see them: derivatives from rest, the library, expressions, and cost."""

from __future__ import annotations

import dataclasses
import time
import warnings

import casadi as ca
import numpy as np
import pytest
import sympy as sp

import cadet_sym as cs
from cadet_sym.errors import LinearisationError, ModelError
from cadet_sym.expectation import describing_function
from cadet_sym.language.element import written_out
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.library import LIBRARY, bouc_wen, coulomb, from_library, gas_spring, saturation
from cadet_sym.language.numeric import evaluate
from cadet_sym.lowering.check import check
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.expressions import to_casadi

NUMBERS = {
    "stiffness": 2.0, "force": 1.5, "gap": 0.3, "rebound_gap": 0.5, "bump_gap": 0.4, "length": 1.0, "stop": 0.9,
    "exponent": 1.4, "deflection": 0.5, "coefficient": 1.0, "r": 0.1, "rebound": 2.0, "bump": 1.0, "rebound_high": 1.0,
    "rebound_knee": 0.3, "bump_high": 0.5, "bump_knee": 0.2, "friction": 0.4, "kinetic": 0.5, "static": 1.0, "speed": 0.2,
    "A": 1.0, "beta": 0.5, "gamma": 0.5, "limit": 1.0, "free_length": 0.7, "level": 1.0, "dead_zone": 0.2,
}  # fmt: skip


def named(kind: str, **numbers) -> cs.Element:
    """The element with a parameter for each coefficient."""
    return LIBRARY[kind](**{key: numbers.get(key, key) for key in LIBRARY[kind].coefficients})


def compiled(element: cs.Element) -> tuple[ca.Function, list[float]]:
    free = sorted(element.value.free_symbols - set(element.arguments), key=str)
    values = [NUMBERS[s.name] for s in free]
    known = dict(zip(free, values, strict=True))
    df = describing_function(element.arguments, element.value, name=element.name, values=known)
    return element_function(df, tuple(free)), values


# -- the library ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", LIBRARY)
def test_every_element_of_the_library_has_derivatives_that_are_right_and_finite_from_rest(kind):
    function, values = compiled(named(kind))
    k = function.size1_in(0)
    m, S = ca.SX.sym("m", k), ca.SX.sym("S", k * (k + 1) // 2)
    moments = ca.vertcat(m, S)
    F = ca.vertcat(*function(m, S, values))
    both = ca.Function("both", [moments], [F, ca.jacobian(F, moments)])
    rng = np.random.default_rng(3)
    for scale in (0.3, 1.0):
        C = rng.normal(size=(k, k))
        P = scale**2 * (C @ C.T + 0.2 * np.eye(k))
        at = np.concatenate([rng.normal(size=k) * scale, P[np.tril_indices(k)]])
        J = np.asarray(both(at)[1])
        for i in range(len(at)):
            h = 1e-4 * scale
            up, down = (both(at + d * np.eye(len(at))[i])[0].full().ravel() for d in (h, -h))
            assert np.allclose(J[:, i], (up - down) / (2 * h), rtol=1e-6, atol=2e-6 * np.abs(J).max())
    for mean in (0.0, 0.3, -0.4):
        assert all(np.all(np.isfinite(np.asarray(v))) for v in both(np.concatenate([[mean] * k, [0.0] * len(at[k:])])))


@pytest.mark.parametrize("kind", [k for k, of in LIBRARY.items() if len(of.arguments) == 1])
def test_every_element_of_the_library_starts_as_it_is_written(kind):
    element = named(kind)
    function, values = compiled(element)
    free = sorted(element.value.free_symbols - set(element.arguments), key=str)
    for z in (-0.77, 0.123, 1.9):
        wanted = evaluate(element.value, {element.arguments[0]: z, **dict(zip(free, values, strict=True))})
        assert float(function(z, 0.0, values)[0]) == pytest.approx(wanted, rel=1e-12)


def test_the_library_is_used_by_name():
    assert from_library("coulomb", "seal", force="F_c") == coulomb("F_c", name="seal")
    assert coulomb(force=3).value == parse("3*sign(v)")
    assert saturation(limit="2*a").value == parse("clip(z, -2*a, 2*a)")
    assert bouc_wen(1, 0.5, 0.5).value == parse("v - 0.5*abs(v)*z - 0.5*v*abs(z)")
    assert "polytropic" in gas_spring.text.lower()


def test_a_coefficient_may_be_called_like_an_argument():
    element = coulomb(force="v*z")
    assert element.arguments != (symbol("v"),)
    assert element.value.has(symbol("v"), symbol("z"))


@pytest.mark.parametrize(
    ("kind", "coefficients", "message"),
    [
        ("coulom", {}, "coulomb"),
        ("coulomb", {}, "needs its coefficient `force`"),
        ("coulomb", {"forse": 1}, "has the coefficients force: `forse`"),
    ],
)
def test_a_wrong_name_or_coefficient_is_refused(kind, coefficients, message):
    with pytest.raises(ModelError, match=message):
        from_library(kind, "e", **coefficients)


# -- from rest --------------------------------------------------------------------------------------------------------


def propagated(rates: str, names: str, noise: str, elements: dict[str, cs.Element], duration: float = 10.0):
    states = [symbol(n) for n in names.split()]
    values = [parse(rate) for rate in rates.split(";")]
    vehicle = cs.Vehicle(rates=dict(zip(states, values, strict=True)), elements=elements)
    model = cs.Model(vehicle, noise=cs.Noise((noise,), sp.ImmutableMatrix([[1]])), duration=duration)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return cs.compile(model).propagate()


def test_dry_friction_starts_from_rest_without_variance():
    history = propagated("-f(v) + w", "v", "w", {"f": coulomb(1, name="f")})
    # stationary: 2 sqrt(2/pi) F sigma = Q
    assert float(history.std["v"][-1]) ** 2 == pytest.approx(np.pi / 8, rel=1e-5)


def test_hysteresis_starts_from_rest_without_variance():
    rates = "v;-0.2*v - 0.5*x - 0.5*z + w;h(v, z)"
    whole = propagated(rates, "x v z", "w", {"h": bouc_wen(1, 0.5, 0.5, name="h")})
    close = propagated(rates, "x v z", "w", {"h": bouc_wen(1, 0.5, 0.5, 1.0000001, name="h")}, 3.0)
    assert np.all(np.isfinite(whole.std["z"]))
    assert float(close.std["z"][-1]) == pytest.approx(float(np.interp(3.0, whole.time, whole.std["z"])), rel=1e-4)


# -- self-test --------------------------------------------------------------------------------------------------------


def test_an_element_is_checked_against_adaptive_integration_and_the_result_is_printed():
    result = check(cs.Element("stop", ["z"], parse("z + k*max(z - 0.3, 0)**2")), {"k": 5.0})
    assert result.error < 1e-9
    assert result.gain_error < 1e-9
    assert result.method == "closed form"
    assert str(result).startswith("stop: closed form\n    25 cases against adaptive integration good to ")


def test_the_check_finds_what_is_wrong():
    df = describing_function((symbol("z"),), parse("abs(z)"), name="wrong")
    wrong = type(df)(**{**df.__dict__, "body": parse("abs(z) + 0.001*z**2")})
    assert check(wrong).error > 1e-4


def test_an_element_of_two_arguments_is_checked():
    result = check(cs.Element("friction", ["v", "N"], parse("sign(v)*max(N, 0)")))
    assert result.error < 1e-8
    assert result.gain_error < 1e-8


def test_an_element_of_many_arguments_is_checked_on_planes():
    element = cs.Element("speed", list("abcdef"), parse("a*sqrt(a**2 + b**2 + c**2 + d**2 + 1) + e*f*abs(b)"))
    result = check(element)
    assert max(result.error, result.gain_error) < 1e-8
    assert result.cases == 3
    df = describing_function(element.arguments, element.value)
    assert check(dataclasses.replace(df, products=df.products[:1])).error > 1e-3


def test_the_check_needs_numbers_for_the_parameters():
    with pytest.raises(ModelError, match="needs numbers for its parameters: k"):
        check(cs.Element("stop", ["z"], parse("k*abs(z)")))


def test_elements_that_call_elements_are_written_out():
    inner = cs.Element("inner", ["z"], parse("abs(z)"))
    outer = cs.Element("outer", ["y"], inner(2 * symbol("y")) * symbol("y"))
    assert written_out(outer.value, outer.elements) == parse("abs(2*y)*y")


# -- expressions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "x**2*y - 3*x/y + x**(-3) + sqrt(y)",
        "abs(x)*sign(y) + heaviside(x - 1) + min(x, y, 1) + max(x, y)",
        "x if x > y else y if x < 0 and y < 5 or x == y else 2*x",
        "sin(x)*cos(y) + tan(x) + asin(x/5) + acos(x/5) + atan(y) + atan2(x, y)",
        "sinh(x) + cosh(x) + tanh(y) + exp(-x) + log(y) + erf(x) + pi*2**x",
        "x**1.7 + y**0.5 + y**(-0.5) + x**y",
        "clip(x, -1, 1)*0.1",
    ],
)
def test_an_expression_is_the_same_in_casadi(text):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    expression = parse(text)
    f = ca.Function("f", [x, y], [to_casadi(expression, {symbol("x"): x, symbol("y"): y})])
    for at in ((0.3, 1.7), (1.2, 1.2), (2.5, 0.4)):
        wanted = evaluate(expression, dict(zip((symbol("x"), symbol("y")), at, strict=True)))
        assert float(f(*at)) == pytest.approx(wanted, rel=1e-14)


def test_a_name_without_a_value_is_refused():
    with pytest.raises(LinearisationError, match="`q` has no value"):
        to_casadi(parse("q + 1"), {})


# -- cost -------------------------------------------------------------------------------------------------------------


def test_what_twenty_elements_cost():
    element_function.cache_clear()
    kinds = [k for k in LIBRARY if k != "bouc_wen"]
    start = time.process_time()
    sizes = {kind: compiled(named(kind))[0].n_instructions() for kind in kinds}
    spent = time.process_time() - start
    assert len(sizes) >= 19
    assert spent < 2.0  # about 0.5 s on an idle machine
    # some two nanoseconds an instruction; quadratures hold exponentials and powers, at ten times that
    one = {k: n for k, n in sizes.items() if k not in ("gas_spring", "power_law_damping", "coulomb_normal_load")}
    assert max(one.values()) < 800
    assert max(sizes.values()) < 4000


# -- nothing varies ---------------------------------------------------------------------------------------------------

SCALARS = [
    "tanh(z)", "atan(z)", "sqrt(1 + z**2)", "1/(1 + z**2)", "log(1 + z**2)", "exp(0.3*z)*tanh(z)", "tanh(50*z)",
    "sign(z)*abs(z)**1.5", "max(z, 0)**2.5", "tanh(z) if z > 0.3 else z", "erf(z)", "z*abs(z)", "exp(-z**2)",
]  # fmt: skip


@pytest.mark.parametrize("kind", [*LIBRARY, *SCALARS])
def test_the_slope_in_the_variance_is_half_the_curvature_where_nothing_varies(kind):
    if kind in LIBRARY:
        function, values = compiled(named(kind))
    else:
        function, values = element_function(describing_function((symbol("z"),), parse(kind)), ()), []
    k = function.size1_in(0)
    v = ca.SX.sym("v", k + k * (k + 1) // 2)
    both = ca.vertcat(*function(v[:k], v[k:], values))
    J = ca.Function("J", [v], [both, ca.jacobian(both, v)])
    still, h = np.zeros(k * (k + 1) // 2), 1e-4
    for mean in (np.array([0.77, -0.61, 0.3])[:k], np.array([-1.13, 0.47, -0.2])[:k]):
        slopes = np.array(J(np.concatenate([mean, still]))[1])
        for a in range(k):
            ahead, behind = (np.array(J(np.concatenate([mean + d * np.eye(k)[a], still]))[0]).ravel() for d in (h, -h))
            curvature = (ahead - behind)[1:] / (2 * h)  # of f, by the gains
            for b in range(a + 1):
                column = k + a * (a + 1) // 2 + b
                assert slopes[0, column] == pytest.approx(curvature[b] / (2 if a == b else 1), rel=1e-5, abs=1e-6)
                assert abs(slopes[1:, column]).max() < 1e5  # gains too: of third derivatives
