"""Roots, and jumps along curves, of two arguments up to full correlation, where one is steep in the integral over the other."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from nested_integrals import function_of, truth

from cadet_sym.expectation import describing_function
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.elements import element_function

CASES = (((0.3, 0.2), (1.0, 1.0)), ((0.5, -0.4), (0.3, 0.4)))  # means, standard deviations
CORRELATIONS = (-1.0, 1.0, 0.999999, 0.0)


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(abs(x - 0.5))*sqrt(abs(y + 0.3))",
        "abs(x - 0.2)**1.5*sqrt(abs(y))",
        "abs(x)**0.3*sign(x)*max(y - 0.2, 0)",
        "abs(x)**0.7*sign(x)*tanh(y)",
    ],
)
def test_a_root_is_right_at_any_correlation(text):
    compare(text, bends_at_full=1e-4)  # of full correlation a part of 1e-12 is left out, on which a root is steep


@pytest.mark.parametrize("text", ["sign(x*y - 0.7)*tanh(x)", "sign(x*y + 0.4)*abs(x)", "sign(x**2 + y**2 - 1)*tanh(x)"])
def test_a_jump_along_a_curve_is_right_at_any_correlation(text):
    compare(text, bends_at_full=np.inf)


def compare(text: str, bends_at_full: float) -> None:
    """Value, gains and slopes with the integral, in its standard deviations and relative to E|f|."""
    x, y = symbol("x"), symbol("y")
    df = describing_function((x, y), parse(text))
    v = ca.SX.sym("v", 5)
    both = ca.vertcat(*element_function(df, ())(v[:2], v[2:], []))
    function, exact = ca.Function("both", [v], [both, ca.jacobian(both, v)]), function_of(text, ("x", "y"), {})
    for rho in CORRELATIONS:
        for mean, stds in CASES:
            L = np.array([[stds[0], 0], [rho * stds[1], stds[1] * np.sqrt(1 - rho**2)]])
            found, slopes = (np.array(each) for each in function([*mean, *(L @ L.T)[np.tril_indices(2)]]))
            wanted = truth(*exact, mean, L, 1e-10)
            assert wanted.error < 1e-10
            assert np.all(np.isfinite(slopes))
            assert found[0, 0] == pytest.approx(wanted.value, abs=1e-8 * wanted.size)
            assert L.T @ found[1:, 0] == pytest.approx(wanted.gains, abs=1e-8 * wanted.size)
            within = 1e-6 if abs(rho) < 1 else bends_at_full
            assert pytest.approx(wanted.bends, abs=within * wanted.size) == L.T @ slopes[1:, :2] @ L
