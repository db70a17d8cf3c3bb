"""Waves and exponentials of quadratic forms in closed form: at any correlation, without variance, and where there is none."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from conftest import one_in
from nested_integrals import function_of, truth

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation import describing_function
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.elements import element_function

X, Y, W, C = (symbol(name) for name in "xywc")
CASES = (
    ((0.3, 0.2), (1.0, 1.0), 1.0), ((0.5, -0.4), (2.0, 2.0), -0.999999), ((-1.0, 1.2), (3.0, 4.0), -1.0),
    ((0.4, 1.2), (3.0, 1.0), 0.0), ((0.5, -0.4), (0.6, 1.3), 0.5), ((0.5, 0.2), (0.0, 1.2), 0.0), ((0.5, 0.2), (1.2, 0.0), 0.0),
)  # fmt: skip


def moments_of(df, free=()) -> ca.Function:
    """E[f] and its gains, and their derivatives."""
    count = len(df.arguments)
    v = ca.SX.sym("v", count * (count + 3) // 2)
    both = ca.vertcat(*element_function(df, tuple(free))(v[:count], v[count:], list(free.values()) if free else []))
    return ca.Function("moments", [v], [both, ca.jacobian(both, v)])


@pytest.mark.parametrize(
    "text",
    one_in(4, [
        "sin(x*y - c)", "cos(x*y)*x", "sin(x*y)**2*y", "exp(-0.3*x)*sin(x*y)*y", "sin(x**2 + y)", "exp(-c*(x - 1.3*y)**2)*x*y",
        "exp(-x**2 - y**2 + x*y)",
    ]),
)  # fmt: skip
def test_it_is_the_integral_of_the_function(text):
    df = describing_function((X, Y), parse(text), values={C: 0.7})
    assert df.method == "closed form"
    moments, exact = moments_of(df, {C: 0.7}), function_of(text, ("x", "y"), {"c": 0.7})
    for mean, stds, rho in CASES:
        L = np.array([[stds[0], 0], [rho * stds[1], stds[1] * np.sqrt(1 - rho**2)]])
        found, slopes = (np.array(each) for each in moments([*mean, *(L @ L.T)[np.tril_indices(2)]]))
        wanted = truth(*exact, mean, L, 1e-10, nodes=48 if L[1, 1] else 24)  # waves are long where the inner line is short
        assert wanted.error < 1e-10
        assert found[0, 0] == pytest.approx(wanted.value, abs=1e-9 * wanted.size)
        assert L.T @ found[1:, 0] == pytest.approx(wanted.gains, abs=1e-9 * wanted.size)
        assert pytest.approx(wanted.bends, abs=1e-8 * wanted.size) == L.T @ slopes[1:, :2] @ L


def test_the_heat_equation_holds_for_three_arguments():
    moments = moments_of(describing_function((X, Y, W), parse("sin(x*y + w)*w - exp(-(x + y)**2)*w**2")))
    for corner in (1.0, 0.3):
        root = np.array([[1.0, 0.2, 0.1], [0.5, 0.4, -0.3], [0.2, -0.7, 0.6]]) * corner
        _, slopes = (np.array(each) for each in moments([0.3, -0.5, 0.8, *(root @ root.T)[np.tril_indices(3)]]))
        bends = slopes[1:, :3]
        half = (bends / np.where(np.eye(3) > 0, 2, 1))[np.tril_indices(3)]
        assert slopes[0, 3:] == pytest.approx(half, rel=1e-9, abs=1e-12)


def test_without_variance_it_is_the_function():
    moments = moments_of(describing_function((X, Y), parse("sin(x*y)*x")))
    found, slopes = (np.array(each) for each in moments([0.4, 0.7, 0, 0, 0]))
    assert found[:, 0] == pytest.approx([0.4 * np.sin(0.28), np.sin(0.28) + 0.28 * np.cos(0.28), 0.16 * np.cos(0.28)])
    assert np.all(np.isfinite(slopes))


@pytest.mark.parametrize("text", ["exp(x*y)", "exp(x*y - x**2/3 - y**2/3)*x", "abs(x)*exp(-x*y)", "tanh(y)*exp(x*y)"])
def test_what_grows_along_a_line_is_refused(text):
    with pytest.raises(LinearisationError, match=r"no Gaussian expectation: exp of .* clip the exponent"):
        describing_function((X, Y), parse(text))


def test_with_other_parameters_it_is_no_number_where_there_is_none():
    df = describing_function((X, Y), parse("exp(-c*x*y - x**2 - y**2)"), values={C: 1.0})
    at = [0.1, 0.2, 1.0, 0.0, 1.0]
    assert np.all(np.isfinite(np.array(moments_of(df, {C: 1.0})(at)[0])))
    assert np.all(np.isnan(np.array(moments_of(df, {C: -9.0})(at)[0])))
