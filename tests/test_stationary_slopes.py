"""Derivatives of stationary moments against differences of solutions."""

from dataclasses import replace

import numpy as np
import pytest
from test_stationary import ELEMENTS, chain, quarter_car, two_wheels

from cadet_sym.solve.slopes import moment_slopes, objective_slopes, residual_slope
from cadet_sym.solve.stationary import stationary_point


def stronger(p, strength):
    return replace(p, b=p.b * strength)


def louder(p, factor):
    return replace(p, D=p.D * factor, tracks=tuple(replace(t, intensity=t.intensity * factor) for t in p.tracks))


FAMILIES = {
    "elements of a chain": (lambda s: stronger(chain(8), s), 1.0),
    "noise on a chain": (lambda s: louder(chain(8), s), 0.5),
    "elements with wheels in one track": (lambda s: stronger(two_wheels(0.9, ELEMENTS), s), 1.0),
    "time between wheels": (lambda time: two_wheels(time, ELEMENTS), 0.9),
}


@pytest.fixture(params=FAMILIES, name="case")
def _case(request):
    family, value = FAMILIES[request.param]
    return family, value, stationary_point(family(value))


def test_slopes_of_all_moments_are_those_of_the_solutions(case):
    family, value, point = case
    h = 1e-4 * value
    ends = [stationary_point(family(value + s * h)) for s in (1, -1)]
    means, covariances = moment_slopes(point, [residual_slope(family, value, point)])
    size = np.sqrt(np.diag(point.covariance))
    np.testing.assert_allclose(means[0] / size, (ends[0].mean - ends[1].mean) / (2 * h) / size, atol=1e-6)
    difference = (ends[0].covariance - ends[1].covariance) / (2 * h)
    np.testing.assert_allclose(covariances[0] / np.outer(size, size), difference / np.outer(size, size), atol=1e-6)


def test_one_adjoint_solve_gives_the_same(case):
    family, value, point = case
    residuals = [residual_slope(family, value, point), residual_slope(family, value, point, 2e-3)]
    means, covariances = moment_slopes(point, residuals)
    rng = np.random.default_rng(0)
    g, G = rng.standard_normal(means.shape[1]), rng.standard_normal(covariances.shape[1:])
    expected = means @ g + np.sum(covariances * G, axis=(1, 2))
    np.testing.assert_allclose(objective_slopes(point, (g, G), residuals), expected, rtol=1e-9)


def test_what_does_not_drift_has_slopes_too():
    def closure(damper):
        point = stationary_point(quarter_car(damper))
        return point, np.array([1.0, -1.0, 0, 0, 0])

    point, form = closure(500.0)
    slope = residual_slope(quarter_car, 500.0, point)
    ends = [closure(500.0 + s)[0].covariance for s in (0.05, -0.05)]
    expected = form @ (ends[0] - ends[1]) @ form / 0.1
    found = objective_slopes(point, (np.zeros(5), np.outer(form, form)), [slope])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
