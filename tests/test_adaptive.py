"""Adaptive integration of a function itself: right, as sure as it says, and at an end in bounded time."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import stats

import cadet_sym as cs
from cadet_sym.expectation.adaptive import easiest_order, integrate
from cadet_sym.expectation.roots import roots
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.check import check

ARGUMENTS = tuple(symbol(n) for n in "xyw")
MEAN = np.array([0.4, -0.7, 0.3])


def root(n: int, rho: float) -> np.ndarray:
    stds = 1 + 0.4 * np.arange(n)
    return np.linalg.cholesky(rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * np.outer(stds, stds))


def found(text: str, n: int, rho: float, tolerance: float = 1e-10, most: int = 4_000_000, spread: float = 1.0):
    return integrate(ARGUMENTS[:n], parse(text), {}, MEAN[:n], spread * root(n, rho), tolerance=tolerance, most=most)


def step(m, S):
    return stats.norm.cdf(m[0] / np.sqrt(S[0, 0]))


def exponential(m, S):
    return np.exp(m[0] - m[1] + (S[0, 0] + S[1, 1] - 2 * S[0, 1]) / 2)


def quadrants(m, S):
    """P(x y > 0) - P(x y < 0) by the bivariate normal distribution."""
    u = m / np.sqrt(np.diag(S))
    rho = S[0, 1] / np.sqrt(S[0, 0] * S[1, 1])
    both = stats.multivariate_normal(np.zeros(2), [[1, rho], [rho, 1]]).cdf(u)
    return 4 * both - 2 * stats.norm.cdf(u).sum() + 1


def waves(m, S):
    return sum(np.sin(m[0] + k * m[1]) * np.exp(-(S[0, 0] + S[1, 1] + 2 * k * S[0, 1]) / 2) / 2 for k in (-1, 1))


def lesser(m, S):
    """C. E. Clark (1961), Oper. Res. 9, 145."""
    d = np.sqrt(S[0, 0] + S[1, 1] - 2 * S[0, 1])
    u = (m[1] - m[0]) / d
    return m[0] * stats.norm.cdf(u) + m[1] * stats.norm.cdf(-u) - d * stats.norm.pdf(u)


@pytest.mark.parametrize("rho", [-0.95, 0.0, 0.5, 0.9999])
@pytest.mark.parametrize(
    ("text", "n", "known"),
    [
        ("heaviside(x)", 1, step),
        ("exp(x - y)", 2, exponential),
        ("sign(x)*sign(y)", 2, quadrants),
        ("sin(x)*cos(y)", 2, waves),
        ("min(x, y)", 2, lesser),
    ],
)
def test_it_agrees_with_what_is_known(text, n, known, rho):
    L = root(n, rho)
    result = found(text, n, rho)
    assert result.converged
    assert result.value == pytest.approx(known(MEAN[:n], L @ L.T), abs=1e-9 * result.size)


@pytest.mark.parametrize("text", ["abs(abs(x) - abs(y))", "sign(x*y - 1)*x", "abs(x*y)**0.5", "tanh(100*x*y)"])
def test_it_does_not_depend_on_the_order_of_the_arguments(text):
    L = root(2, 0.6)
    S = L @ L.T
    turned = np.linalg.cholesky(S[::-1, ::-1])
    a = integrate(ARGUMENTS[:2], parse(text), {}, MEAN[:2], L, tolerance=1e-10, most=4_000_000)
    b = integrate(ARGUMENTS[1::-1], parse(text), {}, MEAN[1::-1], turned, tolerance=1e-10, most=4_000_000)
    assert abs(a.value - b.value) <= a.error + b.error + 1e-13
    gains = np.linalg.solve(L.T, a.moments), np.linalg.solve(turned.T, b.moments)[::-1]
    assert gains[0] == pytest.approx(gains[1], abs=1e-8)


def test_three_arguments_and_one_without_variance():
    whole = found("x*abs(y)*w", 3, 0.5, tolerance=1e-7)
    flat = root(3, 0.5)
    flat[:, 1] = 0.0
    flat[1, 0] = 0.0
    pinned = integrate(ARGUMENTS, parse("x*abs(y)*w"), {}, MEAN, flat, tolerance=1e-7, most=4_000_000)
    S = flat @ flat.T
    assert whole.converged
    assert pinned.value == pytest.approx(0.7 * (MEAN[0] * MEAN[2] + S[0, 2]), abs=1e-9)
    assert pinned.moments[1] == 0


@pytest.mark.parametrize("text", ["x if x**2 + y**2 < 1 else y", "sin(40*x*y)", "sign(sin(40*x) - y)"])
def test_an_integration_that_does_not_converge_stops_and_says_how_far_it_got(text):
    rough = found(text, 2, 0.5, most=30_000)
    better = found(text, 2, 0.5, tolerance=1e-6, most=10_000_000)
    assert not rough.converged
    assert rough.evaluations < 2_000_000  # it ends when the round does
    assert abs(rough.value - better.value) <= rough.error + better.error


def test_the_check_is_right_and_ends_where_kinks_cross():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = check(cs.Element("f", ["x", "y"], parse("max(x**2 - y, 0)")))
    assert result.unsettled == 0
    assert result.sure < 1e-10
    assert max(result.error, result.gain_error) < 1e-6
    assert "against adaptive integration good to" in str(result)


def test_the_check_says_where_its_own_integration_did_not_converge(monkeypatch):
    monkeypatch.setattr("cadet_sym.lowering.check.BUDGET", dict.fromkeys((1, 2, 3), 100_000))
    result = check(cs.Element("f", ["x", "y"], parse("abs(x*y)**0.5")))
    assert result.unsettled > 0
    assert "the integration itself did not converge" in str(result)
    assert max(result.error, result.gain_error) < 1e-6  # what its own error explains is no error of the element


@pytest.mark.parametrize(
    ("text", "order"),
    [
        ("x*abs(20*y*cos(w) - x)", (1, 2, 0)),  # linear in x, and with a number there: in y it goes to infinity with cos(w) = 0
        ("max(y**2 - x, 0)*w", (1, 0, 2)),
        ("sin(x*y*w)", (0, 1, 2)),  # nothing switches: as it stands
    ],
)
def test_what_switches_is_integrated_over_last_where_it_is_linear(text, order):
    found = easiest_order(ARGUMENTS, parse(text))
    assert [k for k in found if k < 2 or "w" in text] == list(order)


def test_zeros_are_found_at_jumps_steep_places_and_double_roots_alike():
    functions = [lambda x: x**3 - 0.1, lambda x: np.where(x > 0.3, 1.0, -1.0), lambda x: np.tanh(1e9 * (x - 0.7))]
    functions += [lambda x: x - 0.2, lambda x: np.where(x < 0.6, -1.0, 0.0), lambda x: 1 / (x - 0.55), lambda x: (x - 0.4) ** 9]

    def at(some, x):
        return np.array([functions[k](each) for k, each in zip(some, x, strict=True)])

    count = len(functions)
    low, high = np.full(count, 0.05), np.full(count, 0.95)
    every = np.arange(count)
    found = roots(at, (low, high), (at(every, low), at(every, high)), 1e-12)
    assert found == pytest.approx([0.1 ** (1 / 3), 0.3, 0.7, 0.2, 0.6, 0.55, 0.4], abs=2e-12)
