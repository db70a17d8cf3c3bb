"""Optima against closed forms, gradients against differences, the trade-off of comfort against working space."""

import json

import numpy as np
import pytest
import sympy as sp

import cadet_sym as cs
from cadet_sym.cli import main
from cadet_sym.language.goal import read_constraint, read_goal
from cadet_sym.optimisation import _Search
from cadet_sym.solve.program import Program, minimise

LINEAR = "models/quarter_car_linear.toml"
M_S, M_U, K_S, K_T = 240.0, 36.0, 16e3, 160e3
Q = 2 * np.pi**2 * 0.01 * 256e-6 * 20  # of the road's slope in time: E[h' h'] = Q delta
ACCELERATION = "variance(body_acceleration)"


@pytest.fixture(scope="module", name="linear")
def _linear():
    return cs.compile(LINEAR)


def comfort(c, k=K_S):
    """Variance of the body's acceleration: the residues of |H|^2, see the next test for where it comes from."""
    return Q / 2 * ((M_S + M_U) * k**2 / c + K_T * c) / M_S**2


def test_the_closed_forms_are_solutions_of_the_lyapunov_equation():
    """In symbols: what the optimum is compared with does not come from the solver."""
    ms, mu, k, kt, c, S = sp.symbols("m_s m_u k k_t c S", positive=True)
    A = sp.Matrix([[0, 0, 1, -1], [0, 0, 0, 1], [-k / ms, 0, -c / ms, c / ms], [k / mu, -kt / mu, c / mu, -c / mu]])
    D = sp.zeros(4)
    D[1, 1] = S
    entries = sp.symbols("p:10")
    P = sp.zeros(4)
    for entry, place in zip(entries, [(i, j) for i in range(4) for j in range(i + 1)], strict=True):
        P[place] = P[place[::-1]] = entry
    solution = sp.solve(list(sp.Matrix(A * P + P * A.T + D).vec()), entries, dict=True)[0]
    P = P.subs(solution)
    force = sp.Matrix([[k, 0, c, -c]])
    expected = S / 2 * ((ms + mu) * k**2 / c + kt * c) / ms**2
    assert sp.simplify(P[0, 0] - S * (ms + mu) / (2 * c)) == 0
    assert sp.simplify((force * P * force.T)[0] / ms**2 - expected) == 0


def test_the_most_comfortable_damper_is_that_of_the_closed_form(linear):
    best = cs.optimise(linear, minimise=ACCELERATION, over={"c_s": (100, 5000)})
    np.testing.assert_allclose(best.parameters["c_s"], K_S * np.sqrt((M_S + M_U) / K_T), rtol=1e-6)
    np.testing.assert_allclose(best.objective, Q * K_S * np.sqrt((M_S + M_U) * K_T) / M_S**2, rtol=1e-9)
    assert best.stationarity < 1e-6
    assert best.moments.stable
    np.testing.assert_allclose(best.moments.variance["body_acceleration"], best.objective, rtol=1e-9)


def test_a_limit_on_the_stroke_sets_the_damper_and_has_its_price(linear):
    best = cs.optimise(linear, minimise=ACCELERATION, over={"c_s": (100, 5000)}, subject_to="std(stroke) <= 0.01")
    c = Q * (M_S + M_U) / (2 * 0.01**2)
    np.testing.assert_allclose(best.parameters["c_s"], c, rtol=1e-6)
    (limit,) = best.constraints
    assert limit.active
    step = 1e-6
    price = (comfort(Q * (M_S + M_U) / (2 * (0.01 - step) ** 2)) - comfort(c)) / step
    np.testing.assert_allclose(limit.multiplier, price, rtol=1e-3)


def test_a_weighted_sum_is_balanced_where_the_closed_form_says(linear):
    best = cs.optimise(linear, minimise=f"{ACCELERATION} + 1e4*variance(stroke)", over={"c_s": (100, 5000)})
    expected = np.sqrt((M_S + M_U) * (K_S**2 + 1e4 * M_S**2) / K_T)
    np.testing.assert_allclose(best.parameters["c_s"], expected, rtol=1e-6)


def test_the_trade_off_of_the_linear_car_is_the_closed_form(linear):
    limits = np.linspace(0.008, 0.018, 6)
    curve = cs.trade_off(
        linear, minimise=ACCELERATION, against="std(stroke)", limits=limits, over={"c_s": (50, 5000), "k_s": (8e3, 3e4)}
    )
    c = np.maximum(Q * (M_S + M_U) / (2 * limits**2), 8e3 * np.sqrt((M_S + M_U) / K_T))
    np.testing.assert_allclose(curve.parameter("k_s"), 8e3, rtol=1e-6)
    np.testing.assert_allclose(curve.parameter("c_s"), c, rtol=1e-6)
    np.testing.assert_allclose(curve.objective, comfort(c, 8e3), rtol=1e-6)
    assert all(best.bound_multipliers["k_s"] < 0 for best in curve.optima)


def test_an_asymmetric_damper_costs_comfort(tmp_path):
    curve = cs.trade_off(
        "models/quarter_car_damper.toml",
        minimise=ACCELERATION,
        against="std(stroke)",
        limits=[0.012],
        over={"c_s": (100, 5000), "a": (0, 0.8)},
    )
    np.testing.assert_allclose(curve.parameter("a"), 0.0, atol=1e-9)
    compiled = cs.compile("models/quarter_car_damper.toml")
    for best in curve.optima:
        assert best.constraints[0].excess < 1e-9
        for c in (0.99, 1.01):  # a stiffer damper is less comfortable, a softer one breaks the limit
            near = compiled.stationary(parameters={"c_s": c * best.parameters["c_s"], "a": 0.0})
            assert near.variance["body_acceleration"] > best.objective or near.std["stroke"] > best.moments.std["stroke"]
    assert curve.save(tmp_path / "curve.csv").read_text().startswith("limit,objective,c_s,a")
    assert curve.plot(tmp_path / "curve.png").stat().st_size > 10_000
    assert curve.to_xarray().sizes == {"limit": 1}


MODELS = {
    "linear": (LINEAR, {"c_s": (100, 5000), "k_s": (1e3, 5e4), "V": (1, 50)}, "std(dynamic_tyre_force)*c_s"),
    "nonlinear": ("models/quarter_car_damper.toml", {"c_s": (100, 5000), "a": (0, 0.8), "V": (1, 50)}, "mean(stroke)"),
    "wheels in one track": ("models/half_car.toml", {}, None),
}


@pytest.mark.parametrize("case", MODELS)
def test_gradients_are_those_of_differences(case):
    path, over, text = MODELS[case]
    compiled = cs.compile(path)
    if text is None:
        text = f"variance({compiled.outputs[0]}) + std({compiled.outputs[-1]})**2"
        declared = compiled.model.parameter_values()
        names = [name for name in compiled.parameters if declared[name] > 0][::4]
        over = {name: (0.5 * declared[name], 2 * declared[name]) for name in names}
    goal = read_goal(text, compiled.model, compiled.states)
    search = _Search(compiled, goal, (), {n: (float(a), float(b)) for n, (a, b) in over.items()}, {}, None, None)
    x = np.array([compiled.model.parameter_values()[name] for name in over])
    _, slopes = search.values(x)
    for j, step in enumerate(1e-3 * x):
        ends = [search.values(x + k * step * np.eye(len(x))[j])[0][0] for k in (-2, -1, 1, 2)]
        difference = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
        size = np.abs(slopes * x).max() / x[j]
        np.testing.assert_allclose(slopes[0, j], difference, rtol=1e-6, atol=1e-6 * size, err_msg=list(over)[j])


HALF_CAR = """
schema = 1
name = "Half car in absolute coordinates"
[parameters]
L = 2.7
V = 20.0
c = 2e3
[rates]
z = "w_z"
theta = "q"
w_z = "(-2e4*(z + L/2*theta - h_1) - c*(w_z + L/2*q) - 2e4*(z - L/2*theta - h_2) - c*(w_z - L/2*q))/1000"
q = "L/2*(-2e4*(z + L/2*theta - h_1) - c*(w_z + L/2*q) + 2e4*(z - L/2*theta - h_2) + c*(w_z - L/2*q))/1500"
[contacts]
h_1 = { setback = 0.0, track = "a" }
h_2 = { setback = "L", track = "a" }
[ground]
kind = "iso8608"
class = "C"
[travel]
speed = "V"
[initial]
ground = "smooth"
"""


@pytest.mark.parametrize("text", ["variance(theta)", "variance(q)"])
def test_gradients_of_what_wheels_keep_from_drifting(text, tmp_path):
    """Pitch on an integrated road: the wheelbase turns the direction in which heave and heights drift."""
    path = tmp_path / "half_car.toml"
    path.write_text(HALF_CAR, encoding="utf-8")
    compiled = cs.compile(path)
    search = _Search(
        compiled, read_goal(text, compiled.model, compiled.states), (), {"L": (2.0, 4.0), "c": (1e3, 4e3)}, {}, None, None
    )
    x = np.array([2.7, 2e3])
    _, slopes = search.values(x)
    for j, name in enumerate(("L", "c")):
        ends = [
            compiled.stationary(parameters={name: x[j] * (1 + e)}).variance[text[9:-1]] for e in (1e-4, -1e-4)
        ]
        np.testing.assert_allclose(slopes[0, j], (ends[0] - ends[1]) / (2e-4 * x[j]), rtol=1e-6)
    best = cs.optimise(compiled, minimise="variance(theta)", over={"L": (2.0, 4.0)})
    assert best.moments.stable


def test_more_starts_find_the_better_of_two_valleys():
    """A mean that follows a parameter through a double well of the objective."""
    x, w, a = sp.symbols("x w a")
    model = cs.Model(cs.Vehicle(rates={x: a - x + w}), parameters={a: 0.9}, noise={w: 0.1}, name="valleys")
    task = {"minimise": "(mean(x)**2 - 1)**2 + 0.3*mean(x)", "over": {"a": (-2, 2)}}
    near, far = cs.optimise(model, **task), cs.optimise(model, **task, starts=6)
    assert near.parameters["a"] > 0 > far.parameters["a"]
    assert far.objective < near.objective
    np.testing.assert_allclose(far.others[0][1]["a"], near.parameters["a"], rtol=1e-5)
    for value in (near.parameters["a"], far.parameters["a"]):
        np.testing.assert_allclose(4 * value * (value**2 - 1) + 0.3, 0, atol=1e-5)


def test_a_region_without_a_stationary_state_is_kept_out_of():
    """x' = -(1 - a) x + ...: the search may look at a > 1, where there is none, and comes back."""
    x, w, a = sp.symbols("x w a")
    model = cs.Model(cs.Vehicle(rates={x: -(1 - a) * x + w}), parameters={a: 0.0}, noise={w: 2}, name="edge")
    best = cs.optimise(model, minimise="(variance(x) - 50)**2", over={"a": (-1, 3)})
    np.testing.assert_allclose(best.parameters["a"], 0.98, rtol=1e-6)


def test_the_program_knows_its_multipliers():
    """Minimise x^2 + y^2 with x + y = 2, x <= 0.5: at (0.5, 1.5), multipliers 3 and 2 by hand."""

    def functions(z):
        x, y = z
        return np.array([x * x + y * y, x + y - 2, x - 0.5]), np.array([[2 * x, 2 * y], [1.0, 1.0], [1.0, 0.0]])

    low, high = np.array([-3.0, -3.0]), np.array([3.0, 3.0])
    end = minimise(Program(functions, low, high, np.array([True, False]), np.ones(2)), np.array([0.0, 0.0]))
    np.testing.assert_allclose(end.x, [0.5, 1.5], atol=1e-9)
    np.testing.assert_allclose(end.multipliers, [-3, 2], atol=1e-7)
    assert end.optimal


# -- what is refused ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("variance(nothing)", "undeclared name `nothing`"),
        ("stroke", "varies at random"),
        ("variance(2*stroke)", "declare an output"),
        ("covariance(stroke, d)", "two states"),
        ("variance(stroke) <= 1", "condition is not a number"),
        ("__import__('os')", "no place in an expression|not a number"),
        ("variance(stroke, d)", "takes 1 argument"),
        ("entropy(stroke)", "undeclared function"),
        ("variance(c_s)", "is none"),
    ],
)
def test_wrong_objectives_are_refused(linear, text, message):
    with pytest.raises(cs.ModelError, match=message):
        read_goal(text, linear.model, linear.states)


def test_a_chain_of_comparisons_is_several_constraints(linear):
    found = read_constraint("0.001 <= std(stroke) <= 0.02", linear.model, linear.states)
    assert len(found) == 2
    (equal,) = read_constraint("mean(stroke) == 0", linear.model, linear.states)
    assert equal.equal
    with pytest.raises(cs.ModelError, match="comparison is wanted"):
        read_constraint("std(stroke)", linear.model, linear.states)


def test_what_drifts_cannot_be_an_objective():
    x, v, w = sp.symbols("x v w")
    model = cs.Model(cs.Vehicle(rates={x: v, v: -v + w}), noise={w: 1}, parameters={"c": 1}, name="walk")
    with pytest.raises(cs.ModelError, match="`x` drifts"):
        cs.optimise(model, minimise="variance(x)", over={"c": (0, 1)})


def test_constraints_that_cannot_be_met_are_named(linear):
    with pytest.raises(cs.SolverError, match=r"std\(stroke\) <= 0.0001 is not met"):
        cs.optimise(linear, minimise=ACCELERATION, over={"c_s": (100, 5000)}, subject_to="std(stroke) <= 0.0001")


# -- the command ----------------------------------------------------------------------------------------------


def test_the_command_prints_the_optimum(capsys):
    words = ["optimise", LINEAR, "--minimise", ACCELERATION, "--over", "c_s=100:5000"]
    assert main([*words, "--subject-to", "std(stroke) <= 0.01", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(content["parameters"]["c_s"], Q * (M_S + M_U) / (2 * 0.01**2), rtol=1e-6)
    assert content["constraints"][0]["multiplier"] > 0
    assert content["solutions"][0]["stable"]
    assert main(words) == 0
    assert "c_s  664.529909" in capsys.readouterr().out


def test_the_command_draws_a_trade_off(capsys, tmp_path):
    words = ["optimise", LINEAR, "--minimise", ACCELERATION, "--over", "c_s=100:5000"]
    figure = tmp_path / "curve.png"
    assert main([*words, "--against", "std(stroke)=0.01:0.02:3", "--plot", str(figure)]) == 0
    assert figure.exists()
    assert main([*words, "--plot", str(figure)]) == 2
    assert "--against" in capsys.readouterr().err
    assert main([*words[:-1], "c_s=5:1"]) == 2
