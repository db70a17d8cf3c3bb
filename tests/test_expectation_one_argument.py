"""What one argument may be: kinks of any kind, exponentials, waves, powers, steep places, tables; and what it may not."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import half
from gaussian_integrals import one
from sympy.core.symbol import Str

import cadet_sym as cs
from cadet_sym.errors import ExpectationWarning, LinearisationError
from cadet_sym.expectation import describing_function
from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.pieces import Splitter
from cadet_sym.language.expression import Lookup, parse, symbol
from cadet_sym.language.numeric import evaluate
from cadet_sym.lowering.check import check
from cadet_sym.lowering.elements import element_function

Z = symbol("z")
MOMENTS = [(0.0, 1.0), (0.3, 0.7), (-1.2, 0.4), (2.0, 0.05), (0.1, 3.0)]


def values(pair) -> list[float]:
    return [float(x) for x in pair]


def expression(text: str) -> sp.Expr:
    return parse(text)


def compare(text: str, kinks=(), values: dict[str, float] | None = None, rel: float = 1e-9) -> None:
    body, numbers = expression(text), {symbol(n): v for n, v in (values or {}).items()}
    function = element_function(describing_function((Z,), body, values=numbers), tuple(numbers))
    for m, s in MOMENTS:
        wanted, slope = one(lambda z: np.broadcast_to(evaluate(body, {**numbers, Z: z}), z.shape), m, s, kinks)
        F, gain = (float(x) for x in function(m, s * s, list(numbers.values())))
        assert pytest.approx(wanted, rel=rel, abs=rel) == F, (m, s)
        assert gain == pytest.approx(slope, rel=10 * rel, abs=10 * rel / min(s, 1)), (m, s)
    for m in (0.0, 0.5, -1.0, 1.0):  # no variance: finite, also at kinks
        assert np.all(np.isfinite([float(x) for x in function(m, 0.0, list(numbers.values()))]))


CLOSED = {
    "abs(abs(z) - 1) - 1": [-1, 0, 1],
    "abs(abs(abs(z) - 2) - 1)*max(z, -1)": [-3, -2, -1, 0, 1, 2, 3],
    "min(z**3 - z, 1)": [1.3247179572447460],
    "sign(z**3 - 3*z + 1)": [-1.879385241571817, 0.347296355333861, 1.532088886237956],
    "z**2 if z < -1 or z > 2 else 4*z": [-1, 2],
    "z if -1 < z < 0.5 else 0": [-1, 0.5],
    "1 if not (z > 0.2 and z < 1) else z": [0.2, 1],
    "max(1 - z**2, 0)**2": [-1, 1],
    "sign(exp(z) - 2)": [np.log(2)],
    "exp(-abs(z))": [0],
    "z**2*exp(-2*z) if z > 0 else z": [0],
    "exp(-z**2)*abs(z)": [0],
    "sign(z)*(1 + exp(-(z/0.2)**2))": [0],
    "cosh(z/2)*z": [],
    "2**z": [],
    "z**2*sin(2*z)*cos(z)": [],
    "cos(2*z)*abs(z)": [0],
    "sign(z)*sin(5*z)*z": [0],
    "exp(-z)*sin(3*z)*heaviside(z)": [0],
    "sin(z) if abs(z) < pi/2 else sign(z)": [-np.pi / 2, np.pi / 2],
    "z*erf(2*z + 1) - erf(z)": [-0.5, 0],
    "abs(z)**7 + z**10/100": [0],
}


@pytest.mark.parametrize("text", CLOSED)
def test_a_closed_form_is_the_integral(text):
    assert describing_function((Z,), expression(text)).method == "closed form"
    compare(text, CLOSED[text], rel=1e-8)


INTEGRATED = {
    "tanh(3*z)": [0],
    "tanh(200*z)": [0],
    "atan(3*z)*z": [0],
    "z/(1 + z**2)": [0],
    "log(1 + z**2)": [0],
    "z/sqrt(z**2 + 0.0001)": [0],
    "1/(1 + exp(-4*z))": [0],
    "sqrt(1 + abs(z))": [0],
    "abs(tanh(z) - 0.5)": [0.5493061443340549],
    "asin(clip(z, -1, 1))": [-1, 1],
    "sqrt(max(1 - z**2, 0))": [-1, 1],
    "max(z, 0)**0.15 - 2*max(-z, 0)**0.5": [0],
    "sqrt(max(z, 0))": [0],
    "abs(z)**1.7*cos(z)": [0],
    "tan(clip(z, -1, 1))": [-1, 1],
    "(1 + max(z, -0.9))**(-1.4)": [-0.9],
}


@pytest.mark.parametrize("text", INTEGRATED)
def test_a_quadrature_is_the_integral_and_says_what_it_is(text):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        df = describing_function((Z,), expression(text))
    assert df.method == "quadrature"
    assert df.nodes <= 250
    assert 0 < df.error <= 1e-8
    compare(text, INTEGRATED[text], rel=2e-8 if "200" in text or "0.0001" in text else 1e-9)


PARAMETERS = {
    "clip(z, -a, a)": ({"a": 1.5}, [-1.5, 1.5]),
    "a*clip(b*z + c, -1, 1)": ({"a": 2.0, "b": -2.0, "c": -0.3}, [-0.65, 0.35]),
    "z if a < z < b else c": ({"a": -0.5, "b": 1.2, "c": 0.3}, [-0.5, 1.2]),
    "abs(z - a)**b*sign(z - a)": ({"a": 0.3, "b": 0.35}, [0.3]),
    "(1 + max(z, -c)/a)**(-b)": ({"a": 1.0, "b": 1.4, "c": 0.9}, [-0.9]),
    "a**z": ({"a": 1.5}, []),
    "exp(-(z/a)**2)*sign(z)": ({"a": 0.2}, [0]),
    "max(z**2 - a, b)": ({"a": 1.0, "b": 0.5}, [-(1.5**0.5), 1.5**0.5]),
    # pieces that are empty for these numbers, but not for others
    "log(1 + clip(a*z + 0.1, -1, b)**2)": ({"a": 0.6, "b": 0.5}, [-1.1 / 0.6, 0.4 / 0.6]),
    "(z - a)**5/(1 + abs(z - a))*abs(z)": ({"a": 0.7}, [0, 0.7]),
    # a pole at the end where the root is
    "(sqrt(z) if z > 0 else 0)*cosh(0.3*(2*z + 1))*erf(clip(z - 0.5, -1, 0.5))": ({}, [0, 1]),
    # waves between kinks, and of a phase, that are parameters
    "abs(a*z + 0.1)*cos(clip(z, -1, b))": ({"a": 0.6, "b": 0.5}, [-1, -0.1 / 0.6, 0.5]),
    "sin(min(a*z + 0.1, 1))**2": ({"a": 0.6}, [1.5]),
    "sin(z - a)*max(z - b, 0)": ({"a": 0.7, "b": 0.2}, [0.2]),
}


@pytest.mark.parametrize("text", half(PARAMETERS))
def test_parameters_stay_free(text):
    values, kinks = PARAMETERS[text]
    compare(text, kinks, values)


@pytest.mark.parametrize("text", ["atan(0.4/z)", "atan2(0.4 - 2*z, z)", "z*atan2(0.3, z)"])
def test_the_gain_of_an_angle_has_its_jump(text):
    function = element_function(describing_function((Z,), parse(text)), ())
    F = [float(function(0.3 + n * 1e-2, 0.5, [])[0]) for n in (-2, -1, 1, 2)]
    assert float(function(0.3, 0.5, [])[1]) == pytest.approx((F[0] - 8 * F[1] + 8 * F[2] - F[3]) / 12e-2, rel=1e-5)


def test_a_pole_beyond_an_end_takes_nodes_on_one_side_only():
    a, b = symbol("a"), symbol("b")
    body = parse("(1 + max(x, -a)/b)**(-1.4)")
    known, unknown = (describing_function((symbol("x"),), body, values=v) for v in ({a: 0.8, b: 1.0}, {}))
    (one_side,), (both,) = (df.products[0].functions[0][1].integrals for df in (known, unknown))
    assert [one_side.nodes, both.nodes] == [one_side.rule.order, 2 * both.rule.order]
    F, gain = element_function(known, (a, b))(0.1, 0.2, [0.8, 1.0])
    wanted = one(lambda z: (1 + np.maximum(z, -0.8)) ** -1.4, 0.1, np.sqrt(0.2), [-0.8])
    assert [float(F), float(gain)] == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("a", "b"), [(-0.5, 1.2), (1.2, -0.5), (0.3, 0.3)])
def test_the_order_of_two_kinks_need_not_be_known(a, b):
    df = describing_function((Z,), expression("z if a < z < b else 0.3"))
    function = element_function(df, (symbol("a"), symbol("b")))
    for m, s in MOMENTS:
        wanted, _ = one(lambda z: np.where((a < z) & (z < b), z, 0.3), m, s, [a, b])
        assert float(function(m, s * s, [a, b])[0]) == pytest.approx(wanted, abs=1e-10)


def test_cells_fill_the_line_once_with_what_the_function_is_there():
    for text in CLOSED:
        body = expression(text)
        cells = Splitter(Z, "f").split(body, Cell())
        for z in np.linspace(-3.37, 3.41, 41):
            inside = [v for c, v in cells if all(float(k) < z for k in c.lowers) and all(z < float(k) for k in c.uppers)]
            assert len(inside) == 1, (text, z)
            assert evaluate(inside[0], {Z: z}) == pytest.approx(evaluate(body, {Z: z}), abs=1e-12)


def test_a_continuous_function_has_no_jump_at_its_kinks():
    for text in ("clip(z, -1, 0.3)", "abs(z**2 - 2)", "exp(z) - 1 if z < 0 else z", "max(z, 0.1)**3*z"):
        df = describing_function((Z,), expression(text))
        (product,) = df.products
        assert isinstance(product, Product)
        ((_, function),) = product.functions
        assert [jump.size(0) for jump in function.jumps] == [0] * len(function.jumps)


# -- tables -----------------------------------------------------------------------------------------------------------


def table(rows: int, outside: str, method: str) -> Lookup:
    rng = np.random.default_rng(rows)
    z = np.round(np.cumsum(rng.uniform(0.02, 0.2, rows)), 4)
    f = np.round(np.tanh(z - z.mean()) * 3 + rng.normal(0, 0.05, rows), 4)
    exact = [sp.Tuple(*(sp.Rational(str(x)) for x in column)) for column in (z - z[rows // 2], f)]
    return Lookup(Z, *exact, Str(outside), Str(method))


@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
@pytest.mark.parametrize("method", ["linear", "monotone"])
@pytest.mark.parametrize("rows", [2, 3, 15])
def test_a_table_is_the_function_between_its_rows(rows, outside, method):
    curve = table(rows, outside, method)
    function = element_function(describing_function((Z,), curve), ())
    pieces = element_function(describing_function((Z,), curve.as_piecewise()), ())
    for m, s in [*MOMENTS, (float(curve.knots[1]), 1e-9), (0.05, 0.0), (-30.0, 0.1)]:
        assert np.allclose(values(function(m, s * s, [])), values(pieces(m, s * s, [])), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("text", ["sin(x)**2 - 1.3*atan(2*x)", "cos(3*x) + sqrt(1 + x**2)"])
def test_waves_beside_what_takes_nodes_keep_their_closed_form_at_any_variance(text):
    body, x = parse(text), symbol("x")
    whole, *alone = (element_function(describing_function((x,), part), ()) for part in (body, *sp.Add.make_args(body)))
    for s in (1.0, 15.0, 300.0):
        found, parts = whole(2.5, s * s, []), [each(2.5, s * s, []) for each in alone]
        for k in range(2):
            assert float(found[k]) == pytest.approx(sum(float(part[k]) for part in parts), rel=1e-8, abs=1e-12)


def test_a_curve_whose_slope_is_one_may_be_multiplied():
    unit = Lookup(Z, sp.Tuple(-1, sp.Rational(1, 3), 1, 2), sp.Tuple(-1, sp.Rational(1, 3), 3, 0), Str("hold"), Str("linear"))
    found, wanted = (element_function(describing_function((Z,), f * sp.sign(Z)), ()) for f in (unit, unit.as_piecewise()))
    for m, s in MOMENTS:
        assert float(found(m, s * s, [])[0]) == pytest.approx(float(wanted(m, s * s, [])[0]), rel=1e-12)
    assert float(found(0.5, 0, [])[0]) == pytest.approx(1.0, rel=1e-12)


def test_a_curve_may_be_scaled_shifted_multiplied_and_squared():
    curve, c = table(12, "hold", "linear"), symbol("c")
    for body in (c * curve.subs(Z, 2 * Z - c) + Z**2, Z * curve, curve**2, sp.Abs(curve), curve * sp.Abs(Z - 1)):
        function = element_function(describing_function((Z,), body), (c,))
        for m, s in MOMENTS[1:4]:
            wanted, slope = one(lambda z, f=body: evaluate(f, {Z: z, c: 0.7}), m, s, np.linspace(-3, 3, 300))
            F, gain = (float(x) for x in function(m, s * s, [0.7]))
            assert pytest.approx(wanted, rel=1e-6, abs=1e-6) == F
            assert gain == pytest.approx(slope, rel=1e-4, abs=1e-4)


CURVE, OTHER, LONG = table(9, "hold", "linear"), table(7, "extrapolate", "monotone"), table(200, "extrapolate", "linear")


@pytest.mark.parametrize(
    "body",
    [
        CURVE.subs(Z, LONG),
        LONG.subs(Z, CURVE),
        OTHER.subs(Z, 2 * CURVE - 1),
        CURVE.subs(Z, OTHER) * sp.Abs(Z),
        CURVE.subs(Z, expression("z if z > 0 else 0.4*z")),
        LONG.subs(Z, expression("clip(z**3, -1, 2)")),
        sp.Piecewise((OTHER, sp.Rational(3, 10) < CURVE), (sp.S.One, True)),
    ],
    ids=["long in short", "short in long", "monotone", "of a monotone one", "bilinear", "clipped", "condition"],
)
def test_a_curve_of_a_curve_or_of_pieces_is_cut_where_either_bends(body):
    function = element_function(describing_function((Z,), body), ())
    for m, s in MOMENTS[1:4]:
        wanted, slope = one(lambda z: np.asarray(evaluate(body, {Z: z})), m, s, np.linspace(-3, 3, 300))
        F, gain = (float(x) for x in function(m, s * s, []))
        assert pytest.approx(wanted, rel=1e-5, abs=1e-5) == F
        assert gain == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_a_conditional_within_a_condition_is_what_it_is_written_out():
    within = sp.Piecewise((Z, sp.Piecewise((Z, Z > 0), (Z**2 - 1, True)) > sp.S.Half), (0, True))
    assert within.has(sp.ITE)
    out = expression("z if (z > 0 and z > 1/2) or (z <= 0 and z**2 - 1 > 1/2) else 0")
    one_way, other = (element_function(describing_function((Z,), body), ()) for body in (within, out))
    for m, s in MOMENTS:
        assert values(one_way(m, s * s, [])) == pytest.approx(values(other(m, s * s, [])), rel=1e-12)


@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
@pytest.mark.parametrize("method", ["linear", "monotone"])
@pytest.mark.parametrize("power", [2, 3])
def test_a_power_of_a_curve_is_a_curve(power, outside, method):
    curve = table(7, outside, method)
    describing = describing_function((Z,), 3 * curve.subs(Z, 1 - 2 * Z) ** power)
    ((_, univariate),) = describing.products[0].functions
    assert bool(univariate.tables) == (method == "linear" or power < 3)  # beyond, every piece by itself
    function = element_function(describing, ())
    pieces = element_function(describing_function((Z,), sp.expand(3 * curve.as_piecewise().subs(Z, 1 - 2 * Z) ** power)), ())
    for m, s in [*MOMENTS[:4], (0.05, 0.0), (-3.0, 0.1)]:
        wanted = values(pieces(m, s * s, []))
        assert np.allclose(values(function(m, s * s, [])), wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("text", ["clip(z, -1, 1)**6", "z**5 if abs(z) < 1 else 0.5*z", "z**3 if abs(z) < 1 else z"])
def test_polynomials_between_kinks_keep_their_digits_from_far_away(text):
    """Beyond its kinks z^6 is a million times what it is between them: E[clip(z, -1, 1)^6] came out as -4096."""
    f = expression(text)
    function = element_function(describing_function((Z,), f), ())
    for m, s in [(0.1, 1.0), (-0.4, 10.0), (3.0, 100.0), (0.0, 1e3), (5e3, 1e3)]:
        wanted, slope = one(lambda z: evaluate(f, {Z: z}), m, s, [-1, 1])
        size = one(lambda z: abs(evaluate(f, {Z: z})), m, s, [-1, 0, 1])[0]
        F, gain = values(function(m, s * s, []))
        assert pytest.approx(wanted, abs=1e-12 * size) == F
        assert gain == pytest.approx(slope, abs=1e-11 * size / s)


def test_many_rows_cost_one_pass():
    curve = table(200, "extrapolate", "linear")
    for body, share in ((curve, 120), (curve**2, 150)):
        function = element_function(describing_function((Z,), body), ())
        assert function.n_instructions() < share * 200


# -- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1/z", "infinite at z = 0"),
        ("z**(-2)", "infinite at z = 0"),
        ("1/(z - a)", "infinite at z = a"),
        ("1/max(z, 0)", "infinite at z = 0"),
        ("1/sin(z)", "infinite where sin"),
        ("1/(exp(z) - 2)", "infinite where exp"),
        ("tan(z)", "odd multiples of pi/2"),
        ("log(z)", "not a real number where z < 0"),
        ("sqrt(z)", "not a real number where z < 0"),
        ("asin(z)", "not a real number"),
        ("(1 + z)**(-1.4)", "not a real number where z"),
        ("(1 + z/a)**(-b)", "infinite at z = -a"),
        ("(1 + max(z, -1))**(-1.4)", "infinite at z = -1"),
        ("exp(z**2)", "grows as fast"),
        ("exp(z**3)", "grows as fast"),
        ("exp(exp(z))", "grows as fast"),
        ("cosh(z**2)", "grows as fast"),
    ],
)
def test_what_has_no_expectation_is_refused_with_the_reason_and_the_remedy(text, reason):
    with pytest.raises(LinearisationError) as caught:
        describing_function((Z,), expression(text), name="gas")
    message = str(caught.value)
    assert message.startswith("the element `gas` has no Gaussian expectation:")
    assert reason in message
    assert "clip" in message


@pytest.mark.parametrize(
    ("text", "a"), [("(1 + max(z, -a))**(-1.4)", 1.0), ("(1 + max(z, -1)/a)**(-1.4)", 0.8), ("sqrt(1 - a*z**2)", 0.1)]
)
def test_a_function_that_is_no_number_for_the_numbers_of_its_parameters_is_refused_with_a_place(text, a):
    body = expression(text)
    with pytest.raises(LinearisationError, match="with the numbers of its parameters .* where `z` is -?[0-9.]+;.*clip"):
        describing_function((Z,), body, values={symbol("a"): a}, scale=2.0)
    describing_function((Z,), expression("(1 + max(z, -a))**(-1.4)"), values={symbol("a"): 0.9})


@pytest.mark.parametrize("text", ["sign(sin(z))", "abs(sin(z))", "1 if z*tanh(z) > 1 else 0"])
def test_a_kink_that_cannot_be_found_is_refused(text):
    with pytest.raises(LinearisationError, match="cannot find where"):
        describing_function((Z,), expression(text))


def test_an_inaccurate_quadrature_is_warned_of_by_name():
    with pytest.warns(UserWarning, match="the element `ripple`.*accurate to"):
        df = describing_function((Z,), expression("1/(1.01 + sin(40*z))"), name="ripple")
    assert df.error > 1e-8


@pytest.mark.parametrize("text", ["tanh(1000*z)", "atan(1e5*(z - 1))", "1/(1 + exp(-1e5*z))", "1/(2 + 3*exp(-z))**2"])
def test_a_smoothed_step_is_exact_however_steep(text):
    found = check(cs.Element("step", ["z"], parse(text)))
    assert max(found.error, found.gain_error) < 1e-8
    assert found.estimated < 1e-8


def test_what_is_too_steep_for_the_nodes_is_warned_of():
    with pytest.warns(ExpectationWarning, match="accurate to"):
        describing_function((Z,), parse("atan(1e9*z)"))


def test_a_soft_ramp_is_a_ramp_far_out():
    function = element_function(describing_function((Z,), parse("log(1 + exp(5*z))"), name="f"), ())
    for mean in (-1e4, 1e4):
        F, gain = function(mean, 1.0, [])
        assert (float(F), float(gain)) == pytest.approx((max(5 * mean, 0.0), 5.0 * (mean > 0)), abs=1e-9)


def test_a_wave_that_gets_shorter_is_integrated_with_a_warning():
    with pytest.warns(UserWarning, match="accurate to"):
        df = describing_function((Z,), parse("sin(z**2)"), name="f")
    # E[exp(i z^2)] = (1 - 2 i p)^-1/2 about zero
    assert float(element_function(df, ())(0, 0.25, [])[0]) == pytest.approx(((1 - 0.5j) ** -0.5).imag, rel=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "tanh(z)*exp(-z)",
        "erf(2*z - 1)*exp(-z)",
        "abs(z)**0.5*exp(z)",
        "tanh(z)*cosh(z)",
        "exp(z)/(1 + exp(z))",
        "exp(z)*sqrt(z**2 + 1) if z > 0 else 0",
    ],
)
def test_an_exponential_is_followed_to_where_its_weight_lies(text):
    df = describing_function((Z,), expression(text))
    found = check(df)  # at standard deviations up to 10, where exp(z) weighs most a hundred from the mean
    assert max(found.error, found.gain_error) < 1e-10
    m, p = ca.SX.sym("m"), ca.SX.sym("p")
    F, _ = element_function(df, ())(m, p, [])
    H, g = ca.hessian(F, ca.vertcat(m, p))
    slopes = ca.Function("slopes", [m, p], [H[0, 0] / 2, g[1]])
    for at in ((0.3, 0.5), (-1.0, 2.0), (0.7, 1e-6)):
        half, slope = (float(x) for x in slopes(*at))
        assert slope == pytest.approx(half, rel=1e-8)  # dF/dp = F''/2


def test_an_exponential_that_cannot_be_parted_is_warned_of():
    with pytest.warns(ExpectationWarning, match="accurate to"):
        describing_function((Z,), expression("(1 + exp(z))**1.5"))


def test_an_exponential_that_overflows_beside_its_stretch_leaves_derivatives_numbers():
    function = element_function(describing_function((Z,), parse("exp(-1.5*z) if z > 0.125 else 0.1*z")), ())
    m, p = ca.SX.sym("m"), ca.SX.sym("p")
    H, g = ca.hessian(function(m, p, [])[0], ca.vertcat(m, p))
    found = ca.Function("all", [m, p], [function(m, p, [])[0], g, H])(0.0, 900.0)
    assert all(np.all(np.isfinite(np.array(x))) for x in found)
    grows = element_function(describing_function((Z,), parse("exp(-1.5*z)")), ())
    assert float(grows(0.0, 900.0, [])[0]) == np.inf


@pytest.mark.parametrize(
    "text", ["abs(z - 0.5)**1.5*sign(z - 0.5)*tanh(6.5*z - 1.5)", "abs(z)**0.3*tanh(z - 0.3)", "sqrt(abs(z))*atan(4*z - 1)"]
)
def test_the_heat_equation_holds_far_from_a_root_beside_a_steep_place(text):
    m, p = ca.SX.sym("m"), ca.SX.sym("p")
    F, gain = element_function(describing_function((Z,), parse(text)), ())(m, p, [])
    slopes = ca.Function("slopes", [m, p], [F, ca.jacobian(gain, m) / 2, ca.jacobian(F, p)])
    for mean, s in ((4.1, 10.0), (-0.3, 2.0), (-300.0, 100.0)):
        value, half, slope = (float(x) for x in slopes(mean, s * s))
        assert half == pytest.approx(slope, abs=1e-8 * abs(value) / s**2)


def test_a_gain_is_differentiated_in_the_exponent_of_a_root():
    q = symbol("q")
    df = describing_function((Z,), parse("abs(2*z + 1)**q*sign(2*z + 1)"), values={q: 0.7})
    m, p, c = ca.SX.sym("m"), ca.SX.sym("p"), ca.SX.sym("c")
    both = ca.vertcat(*element_function(df, (q,))(m, p, c))
    slope, function = ca.Function("slope", [m, p, c], [ca.jacobian(both, c)]), ca.Function("both", [m, p, c], [both])
    for mean in (0.3, -0.5, 20.0):
        difference = (np.array(function(mean, 0.25, 0.7 + 1e-5)) - np.array(function(mean, 0.25, 0.7 - 1e-5))) / 2e-5
        assert np.array(slope(mean, 0.25, 0.7)) == pytest.approx(difference, rel=1e-6, abs=1e-8)
