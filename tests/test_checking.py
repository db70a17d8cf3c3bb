"""Describing functions at the moments of a run: what every shipped model's are, and what is said of wrong ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT, SHIPPED, half
from reference_models import toml

import cadet_sym as cs
from cadet_sym.errors import ExpectationWarning, LinearisationError, ModelError, SolverError
from cadet_sym.expectation import describing_function
from cadet_sym.lowering.check import check_at

TANGLED = """
name = "a switch on a curve"
[rates]
x = "v"
v = "-x - v - clip(x*v**2, -1, 1) + w"
[noise]
w = 200.0
[run]
duration = 6.0
"""
MANY = """
name = "drag along four axes"
[rates]
x = "-x - (1 + x)*sqrt((1 + x)**2 + y**2 + z**2 + u**2) + a"
y = "-y + a"
z = "-z + b"
u = "-2*u + a + b"
[noise]
a = 1.0
b = 2.0
[run]
duration = 2.0
"""
FOLLOWS = """
name = "a parameter that follows from another"
[parameters]
a = 1.0
b = "2*a"
[rates]
x = "-x - tanh(b*x)"
[initial]
x = 1.0
"""
LOST = """
name = "an exponential of a square"
[parameters]
a = 1.0
b = "a/2"
c = 0.0
g = 0.2
start = 0.0
[rates]
x = "v"
v = "-x - v - tanh(b*x) + c*exp(g*x**2) + w"
[noise]
w = 1.0
[outputs]
z = "exp(b*x**2)"
[initial.covariance]
"x,x" = "start"
[run]
duration = 6.0
points = 7
"""


@pytest.mark.parametrize("model_file", half(SHIPPED), ids=lambda path: path.stem)
def test_every_shipped_model_has_exact_expectations_at_the_moments_of_its_run(model_file):
    compiled = cs.compile(model_file)
    found = cs.check_run(compiled, compiled.propagate())
    assert len(found.times) == 5
    assert found.error < 1e-10
    assert all(each.sure < 1e-8 for _, each in found.found)


def test_what_is_not_exact_is_found_where_the_run_goes():
    with pytest.warns(ExpectationWarning, match="accurate to"):
        compiled = cs.compile(toml(TANGLED))
    history = compiled.propagate()
    found = cs.check_run(compiled, history)
    ((place, each),) = found.found
    assert (place.where, place.arguments) == ("rates", ("x", "v"))
    assert 1e-8 < found.error < each.estimated
    assert f"{found.error:.1e}" in str(found)


def test_singular_covariances_and_more_arguments_than_can_be_integrated_over_are_looked_at_on_their_axes():
    compiled = cs.compile(toml(MANY))
    found = cs.check_run(compiled, compiled.propagate())
    ((_, each),) = found.found
    assert each.cases == 5
    assert each.sure < 1e-8
    assert found.error < 1e-8


def test_a_wrong_describing_function_is_seen_at_any_rank():
    x, y = sp.symbols("x y", real=True)
    right = describing_function((x, y), abs(x) * y)
    wrong = replace(right, body=abs(x) * y + x / 1000)
    for covariance in (np.diag([1.0, 2.0]), np.array([[1.0, 2.0], [2.0, 4.0]]), np.diag([1.0, 0.0]), np.zeros((2, 2))):
        case = np.array([0.3, -0.4]), covariance, {}
        assert max(check_at(right, [case], 1_000_000).error, check_at(right, [case], 1_000_000).gain_error) < 1e-10
        assert check_at(wrong, [case], 1_000_000).error > 1e-5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: replace(h, states=("a", *h.states[1:])), "another model"),
        (lambda h: replace(h, time=h.time + 0.1), "output times of the history"),
    ],
)
def test_a_history_that_is_not_of_the_model_is_refused(change, message):
    compiled = cs.compile(ROOT / "models" / "duffing.toml")
    history = compiled.propagate(points=3)
    with pytest.raises(ModelError, match=message):
        cs.check_run(compiled, change(history), times=history.time.tolist())


def test_without_variance_a_function_is_measured_all_around_its_point():
    # nothing on the diagonal, and a jump across it: the size there and the mean of its sides are not seen along one line alone
    x, y = sp.symbols("x y", real=True)
    for body in (x**2 * abs(y) * abs(x - y), sp.Piecewise((x + 1, x > y), (0, True))):
        assert check_at(describing_function((x, y), body), [(np.zeros(2), np.zeros((2, 2)), {})], 1_000_000).error < 1e-12


def test_parameters_that_follow_from_others_follow_in_a_check():
    # without noise x is its mean, and what a check sees is what the model says
    compiled = cs.compile(toml(FOLLOWS))
    history = compiled.propagate([0.0, 1.0], parameters={"a": 3.0})
    ((place, each),) = cs.check_run(compiled, history, times=[0.0]).found
    assert place.arguments == ("b*x",)
    assert each.mean == (6.0,)


def test_outputs_without_an_expectation_are_told_of_and_no_check_finds_them_right():
    # E exp(q x^2) exists while 2 q var(x) < 1: of the output while var(x) < 1, of its square while var(x) < 1/2
    compiled = cs.compile(toml(LOST))
    assert np.isfinite(compiled.propagate(parameters={"a": 0.1}).output_variance).all()
    with pytest.warns(ExpectationWarning, match=r"`z` is no number at t = \d+ .*later times.*exp\(2\*b\*x\*\*2\)") as told:
        history = compiled.propagate(parameters={"a": 4.0})
    assert len(told) == 1
    found = cs.check_run(compiled, history)
    assert found.error == np.inf
    assert any(each["error"] is None for each in found.to_dict()["functions"])
    with pytest.warns(ExpectationWarning, match="in the stationary state"):
        compiled.stationary(parameters={"a": 4.0})
    with pytest.warns(ExpectationWarning, match="1 other runs"):
        cs.sweep(toml(LOST), {"a": [0.1, 4.0, 5.0]}, workers=1, progress=False)


def test_what_cannot_begin_names_its_nonlinearity_and_when():
    compiled = cs.compile(toml(LOST))
    with pytest.raises(SolverError, match=r"at t = 0: .*`exp\(g\*x\*\*2\)` .* variance 3: ") as failed:
        compiled.propagate(parameters={"a": 0.0, "c": 0.1, "start": 3.0})
    assert failed.value.details["time"] == 0


def test_what_is_no_real_number_somewhere_is_refused_and_where():
    text = TANGLED.replace("clip(x*v**2, -1, 1)", "sqrt(1 + x**2 + 0.3*x*v)")
    with pytest.raises(LinearisationError, match=r"no real number everywhere, for example where `x` is \S+ and `v` is"):
        cs.compile(toml(text))


def test_tails_in_which_nothing_of_a_function_is_left_are_no_errors():
    x, y = sp.symbols("x y", real=True)
    df = describing_function((x, y), sp.Max(0, x - 1) * sp.Max(0, y - 1))
    for mean in (-0.5, -3.0):  # 15 and 40 deviations from where the function begins
        assert check_at(df, [(np.full(2, mean), 0.01 * np.array([[1.0, 0.3], [0.3, 1.0]]), {})], 1_000_000).error < 1e-10
