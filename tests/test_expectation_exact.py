"""Random piecewise polynomial-exponentials against exact arithmetic in many digits, from no variance to a huge one."""

from __future__ import annotations

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cadet_sym.expectation import describing_function
from cadet_sym.lowering.elements import element_function

Z = sp.Symbol("z", real=True)
Piece = tuple[tuple[int, ...], int]  # polynomial coefficients and rate, in tenths
Case = tuple[list[sp.Rational], list[Piece], list[sp.Rational]]  # kinks, pieces, constants added to them


def eighth(n: int) -> sp.Rational:
    """A kink that a double holds exactly: the rounding of another would move it by more than a tiny standard deviation."""
    return sp.Rational(n, 8)


def tenth(n: int) -> sp.Rational:
    return sp.Rational(n, 10)


def expression(piece: Piece) -> sp.Expr:
    coefficients, rate = piece
    return sp.Add(*(tenth(c) * Z**n for n, c in enumerate(coefficients))) * sp.exp(tenth(rate) * Z)


@st.composite
def functions(draw) -> Case:
    """Kinks, pieces, and a constant for each piece, which may make the function continuous."""
    kinks = sorted(draw(st.sets(st.integers(-40, 40), max_size=6)))
    coefficients = st.lists(st.integers(-30, 30), min_size=1, max_size=6).map(tuple)
    piece = st.tuples(coefficients, st.sampled_from([0, 0, 0, -15, -5, 5, 10]))
    pieces = draw(st.lists(piece, min_size=len(kinks) + 1, max_size=len(kinks) + 1))
    shifts = [sp.S.Zero]
    continuous = draw(st.booleans())
    for i, kink in enumerate(kinks):
        gap = (expression(pieces[i]) - expression(pieces[i + 1])).subs(Z, eighth(kink)) if continuous else 0
        shifts.append(shifts[-1] + gap if continuous else sp.S.Zero)
    return [eighth(k) for k in kinks], pieces, shifts


def body(case: Case) -> sp.Expr:
    kinks, pieces, shifts = case
    values = [expression(piece) + shift for piece, shift in zip(pieces, shifts, strict=True)]
    if not kinks:
        return values[0]
    conditions = [kink > Z for kink in kinks] + [sp.true]
    return sp.Piecewise(*zip(values, conditions, strict=True), evaluate=False)


def number(x: sp.Expr) -> mp.mpf:
    return mp.mpf(str(sp.N(x, mp.mp.dps)))


def truncated(n: int, rate: mp.mpf, low, high, m: mp.mpf, p: mp.mpf) -> mp.mpf:
    """E[z^n e^(rate z) 1(low < z < high)] by the recursion of the truncated moments."""
    s, shifted = mp.sqrt(p), m + rate * p
    a, b = ((end - shifted) / s for end in (low, high))
    J = [mp.ncdf(b) - mp.ncdf(a) if a < 0 else mp.ncdf(-a) - mp.ncdf(-b)]

    def edge(x, k):
        return x**k * mp.npdf(x) if mp.isfinite(x) else mp.mpf(0)

    for k in range(1, n + 1):
        J.append((k - 1) * (J[k - 2] if k > 1 else 0) - edge(b, k - 1) + edge(a, k - 1))
    total = mp.fsum(mp.binomial(n, k) * shifted ** (n - k) * s**k * J[k] for k in range(n + 1))
    return mp.exp(rate * m + rate**2 * p / 2) * total


def exact(case: Case, m: mp.mpf, p: mp.mpf) -> mp.mpf:
    kinks, pieces, shifts = case
    bounds = [mp.ninf, *map(number, kinks), mp.inf]
    total = mp.mpf(0)
    for i, ((coefficients, rate), shift) in enumerate(zip(pieces, shifts, strict=True)):
        low, high = bounds[i], bounds[i + 1]
        total += number(shift) * truncated(0, mp.mpf(0), low, high, m, p)
        for n, c in enumerate(coefficients):
            if c:
                total += mp.mpf(c) / 10 * truncated(n, mp.mpf(rate) / 10, low, high, m, p)
    return total


def plain(case: Case, z: mp.mpf) -> mp.mpf:
    """f itself; at a kink the mean of its sides."""
    kinks, pieces, shifts = case
    values = []
    for side in (-1, 1):
        i = sum(1 for k in kinks if number(k) < z or (number(k) == z and side > 0))
        coefficients, rate = pieces[i]
        polynomial = mp.fsum(mp.mpf(c) / 10 * z**n for n, c in enumerate(coefficients))
        values.append(polynomial * mp.exp(mp.mpf(rate) / 10 * z) + number(shifts[i]))
    return (values[0] + values[1]) / 2


def compiled(case: Case) -> ca.Function:
    """(m, p) -> E[f], gain, its derivative in the mean, gradient and Hessian of E[f]."""
    function = element_function(describing_function((Z,), body(case)), ())
    m, p = ca.SX.sym("m"), ca.SX.sym("p")
    F, gain = function(m, p, [])
    H, g = ca.hessian(F, ca.vertcat(m, p))
    return ca.Function("all", [m, p], [F, gain, ca.jacobian(gain, m), ca.jacobian(gain, p), g, H])


def places(case: Case) -> st.SearchStrategy[tuple[float, float]]:
    """Means and standard deviations: at kinks, near them, far away; from nothing to a thousand."""
    kinks = [float(k) for k in case[0]] or [0.0]
    spreads = st.sampled_from([0.0, 1e-300, 1e-40, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 1.0, 3.0, 30.0, 1e3])
    offsets = st.sampled_from([0.0, 0.0, 0.5, -1.0, 5.0, -8.0, 30.0, -1e3, 1e8])

    def mean(kink: float, offset: float, s: float) -> tuple[float, float]:
        return max(min(kink + offset * s, 40.0), -40.0), s

    return st.builds(mean, st.sampled_from(kinks), offsets, spreads)


def compare(function: ca.Function, case: Case, m: float, s: float) -> None:
    found = [np.asarray(v).ravel() for v in function(m, s * s)]
    with mp.workdps(60):
        mean, p = mp.mpf(m), mp.mpf(s) ** 2
        within = [k for k in map(number, case[0]) if abs(k - mean) < 3 * mp.mpf(s)]
        places = [*(mean + d * mp.mpf(s) for d in (-3, -1, 0, 1, 3)), *within]
        size = max(*(abs(plain(case, z)) for z in places), mp.mpf("1e-3"))
        if s > 1 and abs(exact(case, mean, p)) > 1e200:  # exponentials of a wide distribution
            return
        assert all(np.all(np.isfinite(v)) for v in found), (m, s, found)
        if s < 1e-30:
            if any(0 < abs(mean - number(k)) < 1e-20 for k in case[0]):  # no variance can tell the sides of a jump so near
                sides = [plain(case, mean + d) for d in (mp.mpf("-1e-20"), mp.mpf("1e-20"))]
                assert min(sides) - 1e-9 * size <= found[0][0] <= max(sides) + 1e-9 * size
                return
            assert abs(found[0][0] - plain(case, mean)) <= 1e-9 * size
            return
        F = [mp.diff(lambda x: exact(case, x, p), mean, k, h=mp.mpf(s) * mp.mpf("1e-12")) for k in range(3)]
        # the second derivative from the gain, and twice the slope of E[f] in the variance, by the heat equation
        for k, value in ((0, found[0][0]), (1, found[1][0]), (2, found[2][0]), (1, found[4][0]), (2, 2 * found[4][1])):
            assert abs(value - F[k]) <= 1e-9 * max(size / mp.mpf(s) ** k, abs(F[k])), (k, m, s, value, F[k])


@settings(max_examples=6, deadline=None)
@given(st.data())
def test_a_random_function_is_exact_wherever_it_is_asked(data):
    case = data.draw(functions())
    function = compiled(case)
    for m, s in data.draw(st.lists(places(case), min_size=2, max_size=4)):
        compare(function, case, m, s)


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(st.data())
def test_many_random_functions_are_exact_wherever_they_are_asked(data):
    case = data.draw(functions())
    function = compiled(case)
    for m, s in data.draw(st.lists(places(case), min_size=2, max_size=6)):
        compare(function, case, m, s)


def test_at_a_huge_variance_a_bounded_function_keeps_its_digits():
    case = ([sp.S(-1), sp.S(1)], [((-10,), 0), ((0, 10), 0), ((10,), 0)], [sp.S.Zero] * 3)  # saturation
    function = compiled(case)
    for m, s in ((0.0, 1e3), (1e8, 1.0), (-1e8, 1e-3), (3e3, 1e3), (0.3, 1e3), (-1.0, 1e-8)):
        F, gain = (float(v) for v in function(m, s * s)[:2])
        with mp.workdps(50):
            mean, p = mp.mpf(m), mp.mpf(s) ** 2
            assert pytest.approx(float(exact(case, mean, p)), rel=1e-12, abs=1e-15 * max(s, 1.0)) == F
            slope = mp.ncdf((1 - mean) / mp.sqrt(p)) - mp.ncdf((-1 - mean) / mp.sqrt(p))
            assert gain == pytest.approx(float(slope), rel=1e-10, abs=1e-15)
