"""Several wheels on one track: exact at any speed history, also through the quasi-linear gains."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_models import toml, value

import cadet_sym as cs
from cadet_sym.delay import choose_grid, grid_error, pade, radau_nodes, transport_matrix

ROAD = 'kind = "exponential"\nsigma = 1.0\ncutoff = 0.2\nrolling_contact = 2.0'


def two_wheels(
    speed: str, *, setback: float = 2.5, initial: str = "", rates: str = "", duration: float = 5.0
) -> cs.Model:
    rates = rates or 'x = "v"\nv = "-100*x - 2*v - (der(h1, 2) + der(h2, 2))/2"'
    return toml(
        f"""
        name = "two wheels"
        [rates]
        {rates}
        [contacts]
        h1 = {{}}
        h2 = {{ setback = {setback} }}
        [ground]
        {ROAD}
        [travel]
        speed = "{speed}"
        {initial}
        [run]
        duration = {duration}
        """
    )


def test_right_radau_nodes_integrate_polynomials_exactly():
    for count in range(2, 11):
        c = radau_nodes(count)
        assert c[-1] == 1.0
        powers = np.arange(count)
        weights = np.linalg.solve(c[None, :] ** powers[:, None], 1 / (powers + 1.0))
        for degree in range(2 * count - 1):
            assert weights @ c**degree == pytest.approx(1 / (degree + 1), rel=1e-11)


@pytest.mark.parametrize("modes", range(2, 11))
def test_an_element_is_collocated_at_the_right_radau_nodes(modes):
    # The polynomial of degree M through the inflow and the values at the nodes has the derivative T a + e in there.
    T, e = transport_matrix(modes)
    c = radau_nodes(modes)
    rng = np.random.default_rng(modes)
    a, inflow = rng.standard_normal(modes), rng.standard_normal()

    def at_nodes(x: np.ndarray) -> np.ndarray:
        return np.polynomial.legendre.legval(2 * c - 1, np.append(x[:-1], x[-1] - x[:-1].sum()))

    through = np.polynomial.Polynomial.fit(np.append(0.0, c), np.append(inflow, at_nodes(a)), modes, domain=[0, 1])
    np.testing.assert_allclose(at_nodes(T @ a + e * inflow), through.deriv()(c), rtol=1e-8, atol=1e-8 * modes**2)
    assert at_nodes(a)[-1] == pytest.approx(a[-1])


def test_one_element_is_the_pade_approximant_below_the_diagonal():
    z = np.array([-0.3 + 0.2j, 2.0j, -5.0 + 0j])
    # [1/2] Pade of the exponential: (1 + z/3) / (1 - 2z/3 + z^2/6)
    np.testing.assert_allclose(pade(z, 2), (1 + z / 3) / (1 - 2 * z / 3 + z**2 / 6), rtol=1e-12)


@given(st.integers(2, 10), st.floats(0, 1e4))
def test_the_modulus_never_exceeds_one_on_the_imaginary_axis(nodes, y):
    assert abs(pade(np.array([1j * y]), nodes)[0]) <= 1 + 1e-12


def test_the_cheapest_grid_that_resolves_the_modes_is_chosen():
    fast, slow = np.array([-0.1 + 0.5j]), np.array([-5.0 + 60.0j])
    assert choose_grid(fast, 1e-6, rests=False)[0] == (1, 8)
    grid, error = choose_grid(slow, 1e-6, rests=False)
    assert grid[0] * grid[1] > 8
    assert error == grid_error(slow, *grid)
    assert choose_grid(fast, 1e-6, rests=True)[0] == (6, 8)


def test_two_wheels_from_rest_against_the_double_integral_over_the_autocovariance():
    expected = value("R16")
    history = cs.compile(two_wheels("8*t")).propagate(expected["t"], rtol=1e-9)
    reference = np.array(expected["var_x_two_wheel"])
    np.testing.assert_allclose(history.variance["x"], reference, atol=1e-6 * reference.max())
    np.testing.assert_allclose(history.variance["x"][1:], reference[1:], rtol=1e-6)


def test_wheels_that_almost_coincide_are_one():
    one = two_wheels("3 + t", rates='x = "v"\nv = "-100*x - 2*v - der(h1, 2)"', setback=0.5)
    two = two_wheels("3 + t", setback=1e-4)
    times = [0.5, 2.0, 5.0]
    first, second = (cs.compile(model).propagate(times, rtol=1e-9) for model in (one, two))
    np.testing.assert_allclose(first.variance["x"], second.variance["x"], rtol=2e-3)


@pytest.mark.filterwarnings("ignore:the ground between the wheels")
@settings(max_examples=8, deadline=None)
@given(
    nodes=st.integers(2, 7),
    speed=st.tuples(st.floats(0, 8), st.floats(0, 8), st.floats(0.5, 6)),
    smooth=st.booleans(),
)
def test_the_covariance_stays_positive_semidefinite_on_any_grid(nodes, speed, smooth):
    a, b, w = speed
    initial = '[initial]\nground = "smooth"' if smooth else ""
    model = two_wheels(f"{a!r} + {b!r}*sin({w!r}*t)**2", initial=initial, duration=3.0)
    history = cs.compile(model, grid=(1, nodes)).propagate(np.linspace(0, 3, 13), rtol=1e-7)
    P = history.state_covariance
    lowest = np.linalg.eigvalsh(P)[:, 0] / np.maximum(np.trace(P, axis1=1, axis2=2), 1e-300)
    assert (lowest >= -1e-9).all()


def test_the_wheel_behind_has_the_variance_of_the_ground_it_stands_on():
    history = cs.compile(two_wheels("4*t")).propagate(np.linspace(0, 4, 9), rtol=1e-9)
    for wheel in ("h1", "h2"):
        np.testing.assert_allclose(history.variance[f"{wheel}.height"], 1 / 1.1, rtol=1e-8)


def test_over_smooth_ground_the_wheel_behind_waits_for_its_setback():
    model = two_wheels("2", setback=3.0, initial='[initial]\nground = "smooth"')
    history = cs.compile(model).propagate([1.0, 1.4999, 2.0, 4.0], rtol=1e-9)
    np.testing.assert_allclose(history.variance["h2.height"][:2], 0.0, atol=1e-30)
    front = cs.compile(model).propagate([0.5, 2.5], rtol=1e-9).variance["h1.height"]
    np.testing.assert_allclose(history.variance["h2.height"][2:], front, rtol=1e-7)


def test_correlation_of_the_wheels_is_that_of_the_ground_between_them():
    history = cs.compile(two_wheels("3 + sin(t)**2")).propagate([0.0, 2.0, 5.0], rtol=1e-9)
    d, a, b = 2.5, 0.2, 2.0
    between = b * (b * np.exp(-a * d) - a * np.exp(-b * d)) / (b**2 - a**2)
    np.testing.assert_allclose(history.covariance["h1.height", "h2.height"], between, rtol=1e-7)


STOP = "6*clip(1 - t, 0, 1) + 6*clip(t - 3, 0, 1)"


def test_stop_and_go_keeps_the_ground_under_a_standing_vehicle():
    times = np.linspace(0, 6, 61)
    history = cs.compile(two_wheels(STOP, duration=6.0)).propagate(times, rtol=1e-8)
    P = history.state_covariance
    assert np.isfinite(P).all()
    lowest = np.linalg.eigvalsh(P)[:, 0] / np.trace(P, axis1=1, axis2=2)
    assert (lowest >= -1e-9).all()
    np.testing.assert_allclose(history.variance["h1.height"], 1 / 1.1, rtol=1e-6)
    standing = (times > 1.01) & (times < 2.99)
    ground = history.covariance["h1.height", "h2.height"][standing]
    np.testing.assert_allclose(ground, ground[0], rtol=1e-6)


def test_equal_setbacks_written_in_two_ways_are_refused():
    model = toml(
        f"""
        name = "twice"
        [parameters]
        L = 2.0
        M = 2.0
        [rates]
        x = "-x + a + b + c"
        [contacts]
        a = {{}}
        b = {{ setback = "L" }}
        c = {{ setback = "M" }}
        [ground]
        {ROAD}
        [travel]
        speed = 1
        [run]
        duration = 1.0
        """
    )
    with pytest.raises(cs.ModelError, match="equal setbacks"):
        cs.compile(model)


def test_the_automatic_grid_resolves_what_it_should_and_says_how_well():
    history = cs.compile(two_wheels("12")).propagate([0.0, 2.0], rtol=1e-8)
    assert history.provenance.statistics["wheel grid error"] <= 1e-6
    with pytest.warns(UserWarning, match="finer grid") as told:
        cs.compile(two_wheels("0.3"), grid=(1, 2)).propagate([0.0, 2.0], rtol=1e-8)
    assert told[0].filename == __file__  # where it was asked for
