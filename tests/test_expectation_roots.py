"""Roots, and jumps along curves, of two arguments up to full correlation, where one is steep in the integral over the other."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
import pytest
from conftest import half
from nested_integrals import function_of, truth

from cadet_sym.expectation import describing_function
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.elements import element_function

CASES = (((0.3, 0.2), (1.0, 1.0)), ((0.5, -0.4), (0.3, 0.4)))  # means, standard deviations
CORRELATIONS = (-1.0, 1.0, 0.999999, 0.0)


@pytest.mark.parametrize(
    "text",
    half([
        "sqrt(abs(x - 0.5))*sqrt(abs(y + 0.3))",
        "abs(x - 0.2)**1.5*sqrt(abs(y))",
        "abs(x)**0.3*sign(x)*max(y - 0.2, 0)",
        "abs(x)**0.7*sign(x)*tanh(y)",
    ]),
)
def test_a_root_is_right_at_any_correlation(text):
    compare(text, bends_at_full=1e-6)


def test_a_root_times_a_wave_is_right_where_no_variance_of_its_own_damps_the_wave():
    compare("sqrt(abs(x + 0.3))*sin(1.3*y)", bends_at_full=1e-6, cases=(((1.8, -3.4), (3.0, 4.2)), ((0.3, 0.2), (1.0, 1.0))))


@pytest.mark.parametrize("text", half(["sign(x*y - 0.7)*tanh(x)", "sign(x**2 + y**2 - 1)*tanh(x)", "sign(x*y + 0.4)*abs(x)"]))
def test_a_jump_along_a_curve_is_right_at_any_correlation(text):
    compare(text, bends_at_full=np.inf)


def test_a_small_function_is_as_right_as_a_large_one():
    cases = (((-1.87, 0.86), (1.0, 3.0)), ((0.6, -0.2), (3.0, 1.0)))  # the two kinks beside each other
    compare("max(0, min(x, c*y))", bends_at_full=1e-6, numbers={"c": 5e-4}, cases=cases)


def compare(text: str, bends_at_full: float, numbers: Mapping[str, float] = {}, cases=CASES) -> None:
    """Value, gains and slopes with the integral, in its standard deviations and relative to E|f|."""
    x, y, free = symbol("x"), symbol("y"), {symbol(name): value for name, value in numbers.items()}
    df = describing_function((x, y), parse(text), values=free)
    v = ca.SX.sym("v", 5)
    both = ca.vertcat(*element_function(df, tuple(free))(v[:2], v[2:], list(free.values())))
    function, exact = ca.Function("both", [v], [both, ca.jacobian(both, v)]), function_of(text, ("x", "y"), numbers)
    for rho in CORRELATIONS:
        for mean, stds in cases:
            L = np.array([[stds[0], 0], [rho * stds[1], stds[1] * np.sqrt(1 - rho**2)]])
            found, slopes = (np.array(each) for each in function([*mean, *(L @ L.T)[np.tril_indices(2)]]))
            wanted = truth(*exact, mean, L, 1e-10)
            size = max(wanted.size, 1e-8)  # which may be nothing where one argument falls as the other rises
            assert wanted.error < 1e-10 or not wanted.size
            assert np.all(np.isfinite(slopes))
            assert found[0, 0] == pytest.approx(wanted.value, abs=1e-8 * size)
            assert L.T @ found[1:, 0] == pytest.approx(wanted.gains, abs=1e-8 * size)
            within = 1e-6 if abs(rho) < 1 else bends_at_full
            assert pytest.approx(wanted.bends, abs=within * size) == L.T @ slopes[1:, :2] @ L
