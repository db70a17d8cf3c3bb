"""All solutions of small systems against a scan of the plane of mean and variance, which knows nothing of the search."""

from functools import cache

import numpy as np
import pytest
from conftest import half, one_in
from scipy.optimize import root
from stationary_systems import Scalar, bilinear, cubic, dead_zone, error_function, problem, saturation, sine

from cadet_sym.errors import SolverError
from cadet_sym.solve.search import stationary_points


def polynomial(*coefficients):
    """Sum of c_k z^k, ascending."""

    # E of a polynomial: sum over its even derivatives, p^j / (2^j j!)
    table = []
    for k in range(4):
        f = np.polynomial.Polynomial(coefficients).deriv(k) if k else np.polynomial.Polynomial(coefficients)
        even, j, weight = [], 0, 1.0
        while True:
            even.append((weight, j, f.coef[::-1].copy()))
            if f.degree() < 2:
                break
            f, j = f.deriv(2), j + 1
            weight /= 2 * j
        table.append(even)

    def derivatives(m, p, k):
        return float(sum(weight * p**j * np.polyval(coef, m) for weight, j, coef in table[k]))

    return Scalar("polynomial", derivatives)


def gas_spring(strength=1.0, length=3.0):
    """A stiffening spring, softer in rebound: a cubic and a square that never turn back over the range."""
    return polynomial(0.0, strength, -strength / length, strength / (2 * length**2) * 2)


def lift_off(stiffness=1.0):
    """A tyre that pulls nothing: k max(z, 0), and next to nothing beyond."""
    return bilinear(stiffness, 1e-3)


# f, linear part a, noise Q, load: x' = a x - f(x) + load + w
WELLS = {
    "double well": (cubic(), 1.0, 0.1, 0.0),
    "double well, louder": (cubic(), 1.0, 0.32, 0.0),
    "double well above its fold": (cubic(), 1.0, 0.36, 0.0),
    "double well, loaded": (cubic(), 1.0, 0.05, 0.1),
    "double well, tipped": (cubic(), 1.0, 0.02, 0.36),
    "narrow wells": (cubic(4.0), 1.0, 0.01, 0.0),
    "wide wells": (cubic(0.1), 1.0, 0.4, 0.2),
    "three wells": (polynomial(0, 1.0, 0, -2.5, 0, 1.0), 0.0, 0.02, 0.0),
    "three wells, loaded": (polynomial(0, 1.0, 0, -2.5, 0, 1.0), 0.0, 0.02, 0.05),
    "buckled with stops": (dead_zone(3.0, 1.0), 1.0, 0.1, 0.0),
    "buckled with stops, loaded": (dead_zone(3.0, 1.0), 1.0, 0.1, 0.2),
    "hysteresis": (saturation(-3.0, 1.0), -1.0, 0.1, 0.3),
    "smooth hysteresis": (error_function(-3.0, 0.5), -1.0, 0.1, -0.2),
    "gas spring": (gas_spring(), 0.0, 0.5, 0.4),
    "lift-off": (lift_off(), -0.01, 0.5, 0.3),
    "locked loop": (sine(), 0.0, 0.5, 0.2),
    "pendulum on a spring": (sine(2.0), -0.2, 0.1, 0.0),
}


@cache
def scan(name, low=-5.0, high=5.0):
    """Zeros of a m - F + load and of 2 (a - k) s + Q in mean m and s = exp(2 u): where both change sign in a cell."""
    f, a, Q, load = WELLS[name]

    def residuals(z):
        m, s = z[0], np.exp(2 * z[1])
        F, k = (f.derivatives(m, s, order) for order in (0, 1))
        return np.array([a * m - F + load, 2 * (a - k) * s + Q])

    means, logs = np.linspace(low, high, 161), np.linspace(-3.2, 1.2, 89)
    values = np.array([[residuals((m, u)) for u in logs] for m in means])
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    mixed = (corners.min(axis=0) <= 0) & (corners.max(axis=0) >= 0)
    found = []
    for i, j in np.argwhere(mixed.all(axis=2)):
        end = root(residuals, [means[i : i + 2].mean(), logs[j : j + 2].mean()], tol=1e-13)
        m, u = end.x
        if np.abs(end.fun).max() < 1e-10 and low < m < high and all(abs(m - o) + abs(u - v) > 1e-5 for o, v in found):
            found.append((m, u))
    return sorted((m, float(np.exp(2 * u))) for m, u in found)


@pytest.mark.parametrize("name", one_in(4, WELLS))
def test_every_solution_that_a_scan_finds_is_found(name):
    f, a, Q, load = WELLS[name]
    expected = scan(name)
    if f.name == "sine" and a == 0:  # those a period apart count once
        expected = [(m, s) for m, s in expected if -np.pi < m <= np.pi]
    found = stationary_points(problem([[a]], [[-1]], [[1]], [f], [[Q]], c=[load]))
    got = [(point.mean[0], point.covariance[0, 0]) for point in found]
    assert expected
    for m, s in expected:
        away = [m - o for o, _ in got]
        if f.name == "sine" and a == 0:
            away = [(each + np.pi) % (2 * np.pi) - np.pi for each in away]
        gap = min(abs(each) + abs(s - v) for each, (_, v) in zip(away, got, strict=True))
        assert gap < 1e-5, f"({m:.6g}, {s:.6g}) was missed; found {got}"
    assert len(got) >= len(expected)


@pytest.mark.parametrize("name", half(["double well", "three wells", "buckled with stops, loaded", "double well, tipped"]))
def test_the_same_wells_of_an_oscillator(name):
    """x'' + c x' = a x - f(x) + load + w: with 2 c Var(x') = Q the equations of x are those above, with 2 c = Q / Q0."""
    f, a, Q, load = WELLS[name]
    c = 0.2
    oscillator = problem([[0, 1], [a, -c]], [[0], [-1]], [[1, 0]], [f], [[0, 0], [0, c * Q]], c=[0, load])
    got = [(point.mean[0], point.covariance[0, 0]) for point in stationary_points(oscillator)]
    for m, s in scan(name):
        assert min(abs(m - o) + abs(s - v) for o, v in got) < 1e-5, (m, s, got)


@pytest.mark.parametrize(
    "system",
    [
        problem([[0]], [[-1]], [[1]], [sine()], [[4 / np.e + 0.02]]),  # beyond the threshold of a locked loop
        problem([[0]], [[-1]], [[1]], [sine()], [[0.5]], c=[1.2]),  # pulled faster than it can follow
        problem([[0]], [[-1]], [[1]], [saturation()], [[0.5]], c=[1.1]),  # a load beyond the stops
        problem([[0, 1], [-1, 0.1]], [[0], [-1]], [[0, 1]], [saturation(0.05)], [[0, 0], [0, 1.0]]),  # negative damping
    ],
)
def test_nothing_is_found_where_there_is_nothing(system):
    with pytest.raises(SolverError):
        stationary_points(system)
