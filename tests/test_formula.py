"""An expectation written out is the expectation: against the paper, integrals and Isserlis moments."""

from __future__ import annotations

import mpmath as mp
import pytest
import sympy as sp

from cadet_sym.expectation import describing_function
from cadet_sym.report.listing import written_out

z, z1, z2, z3 = (sp.Symbol(name, real=True) for name in ("z", "z1", "z2", "z3"))
r, g, k = (sp.Symbol(name, real=True) for name in "rgk")
m, p = sp.symbols("m p", real=True)
AT = {m: sp.Rational(3, 10), p: sp.Rational(7, 10)}
VALUES = {r: sp.Rational(1, 10), g: sp.Rational(1, 2), k: 2}


def test_the_gain_of_the_papers_appendix():
    oleo = describing_function((z,), sp.Piecewise((z**2, z > 0), (-r * z**2, True)))
    _, (gain,) = written_out(oleo)
    paper = (1 + r) * sp.sqrt(2 * p / sp.pi) * sp.exp(-(m**2) / (2 * p)) + m * (
        (1 - r) + (1 + r) * sp.erf(m / sp.sqrt(2 * p))
    )
    assert float((gain - paper).subs({**AT, **VALUES})) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    "body",
    [
        z**3 - 2 * z,
        z * sp.Abs(z),
        sp.sign(z),
        sp.Min(sp.Max(z, -1), 1),
        sp.Piecewise((0, z < g), (k * (z - g) ** 3, True)),
        sp.sin(z) + z * sp.cos(2 * z),
        sp.exp(-z) * z,
        sp.Piecewise((sp.exp(z), z < 0), (1 + z, True)),
    ],
    ids=str,
)
def test_one_argument_is_the_integral_over_the_normal_density(body):
    formula, gains = written_out(describing_function((z,), body))
    assert formula is not None
    f = sp.lambdify(z, body.subs(VALUES), "mpmath")
    mean, variance = mp.mpf("0.3"), mp.mpf("0.7")
    edges = [-12, -1, 0, mp.mpf("0.5"), 1, 12]

    def integral(weight):
        return mp.quad(lambda x: weight(x) * f(x) * mp.npdf(x, mean, mp.sqrt(variance)), edges)

    at = {**AT, **VALUES}
    assert float(formula.subs(at)) == pytest.approx(float(integral(lambda x: 1)), rel=1e-10)
    # Stein: the gain is E[f (z - m)] / p.
    assert float(gains[0].subs(at)) == pytest.approx(float(integral(lambda x: (x - mean) / variance)), rel=1e-10)


def test_polynomials_of_several_arguments_are_isserlis_moments():
    describing = describing_function((z1, z2, z3), z1**2 * z2 * z3)
    formula = describing.formula()
    S = describing.covariances  # S11; S21, S22; S31, S32, S33
    centred = formula.subs(dict.fromkeys(describing.means, 0))
    assert sp.expand(centred - (S[0] * S[4] + 2 * S[1] * S[3])) == 0


def test_what_has_no_short_form_has_none():
    assert describing_function((z,), sp.tanh(z)).formula() is None
    assert written_out(describing_function((z,), sp.tanh(z))) == (None, ())


def test_a_formula_of_many_pieces_is_not_for_reading():
    def knees(count):
        return sum((sp.Max(z - i, 0) for i in range(count)), sp.S.Zero)

    assert describing_function((z,), knees(5)).formula() is not None
    assert describing_function((z,), knees(20)).formula() is None
