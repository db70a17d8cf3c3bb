"""Augmentation: the ground in distance becomes a system in time, whatever the speed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_models import toml

import cadet_sym as cs
from cadet_sym.language.expression import SPEED, SPEED_RATE

VEHICLE = """
name = "mass on a spring"
[parameters]
k = 40.0
c = 1.5
a = 2.0
[rates]
{rates}
[contacts]
{contacts}
[ground]
{ground}
[travel]
{travel}
[initial]
{initial}
{rest}
[run]
duration = 4.0
"""
ROLLING = 'kind = "exponential"\nsigma = 0.02\ncutoff = 0.4\nrolling_contact = 3.0'


def vehicle(
    rates: str = 'x = "v"\nv = "-k*x - c*v - der(h, 2)"',
    contacts: str = "h = {}",
    ground: str = ROLLING,
    travel: str = 'speed = "1 + a*t"',
    initial: str = 'ground = "stationary"',
    rest: str = "",
) -> cs.Model:
    return toml(VEHICLE.format(**locals()))


def test_states_are_the_vehicles_then_the_filters():
    system = cs.augment(vehicle(contacts='h = {}\ng = { setback = 1.5, track = "left" }\nf = { setback = 1.5 }'))
    names = [state.name for state in system.states]
    assert names == ["x", "v", "h.height", "h.slope", "g.height", "g.slope", "f.height", "f.slope"]
    assert [copy.track for copy in system.copies] == ["main", "left", "main"]


def test_contacts_at_one_place_share_one_copy_of_the_filter():
    system = cs.augment(vehicle(contacts="h = {}\ng = {}"))
    assert [state.name for state in system.states] == ["x", "v", "h.height", "h.slope"]


def test_derivatives_of_the_height_follow_the_chain_rule():
    system = cs.augment(vehicle(rates='x = "der(h)"\nv = "der(h, 2)"'))
    slope = sp.Symbol("h.slope", real=True)
    height = sp.Symbol("h.height", real=True)
    assert sp.expand(system.drift[0] - SPEED * slope) == 0
    second = sp.Rational(-12, 10) * height - sp.Rational(34, 10) * slope
    assert sp.expand(system.drift[1] - SPEED_RATE * slope - SPEED**2 * second) == 0


def test_the_third_derivative_knows_the_rate_of_the_acceleration():
    rates = 'rates = { h = "p", p = "q", q = "-h - 3*p - 3*q + w" }'
    twice = f'kind = "shaping_filter"\n{rates}\nnoise = {{ w = 1.0 }}\nheight = "h"'
    model = vehicle(rates='x = "der(h, 3)"\nv = "-x"', ground=twice, travel='speed = "t**3"')
    h, p, q = (sp.Symbol(f"h.{name}", real=True) for name in "hpq")
    t = sp.Symbol("t", real=True)
    expected = 6 * t * p + 3 * SPEED * SPEED_RATE * q + SPEED**3 * (-h - 3 * p - 3 * q)
    system = cs.augment(model)
    assert sp.expand(system.drift[0] - expected) == 0
    assert system.noise_input[0, 0] == SPEED**2  # V^3 w dt = V^2 dW


@pytest.mark.parametrize(
    ("order", "ground", "message"),
    [
        (2, 'kind = "exponential"\nsigma = 1\ncutoff = 1', "one more filter stage"),
        (3, 'kind = "exponential"\nsigma = 1\ncutoff = 1', "2 more filter stages"),
        (3, ROLLING, "one more filter stage"),
    ],
)
def test_ground_that_is_too_rough_is_refused_with_the_remedy(order, ground, message):
    with pytest.raises(cs.ModelError, match=message) as error:
        cs.augment(vehicle(rates=f'x = "v"\nv = "-k*x - der(h, {order})"', ground=ground))
    assert "rolling_contact" in str(error.value)
    assert "`v`" in str(error.value)


def test_white_noise_may_enter_a_rate_but_nothing_else():
    rough = 'kind = "exponential"\nsigma = 1\ncutoff = 1'
    system = cs.augment(vehicle(rates='x = "v"\nv = "-k*x - der(h)"', ground=rough))
    assert system.noise_input[1, 0] == -sp.sqrt(2)
    with pytest.raises(cs.ModelError, match="infinite"):
        cs.augment(vehicle(rates='x = "v"\nv = "-k*x - abs(der(h))"', ground=rough))
    with pytest.raises(cs.ModelError, match=r"output `acc`.*infinite variance"):
        cs.augment(vehicle(rates='x = "v"\nv = "-k*x - der(h)"', ground=rough, rest='[outputs]\nacc = "der(v)"'))
    with pytest.raises(cs.ModelError, match="initial value of `v`"):
        cs.augment(vehicle(rates='x = "v"\nv = "-k*x"', ground=rough, initial='v = "-der(h)"'))


def test_relative_and_absolute_coordinates_agree():
    relative = vehicle(
        rates='x = "v"\nv = "-k*x - c*v - 3*x**3 - der(h, 2)"',
        initial='x = "-h"\nv = "-der(h)"',
        rest='[outputs]\nclosure = "x"\ny = "x + h"\nspring = "k*x + 3*x**3"',
    )
    absolute = vehicle(
        rates='y = "w"\nw = "-k*(y - h) - c*(w - der(h)) - 3*(y - h)**3"',
        rest='[outputs]\nclosure = "y - h"\nheight = "y"\nspring = "k*(y - h) + 3*(y - h)**3"',
    )
    times = np.linspace(0, 4, 9)
    one, other = (cs.compile(model).propagate(times, rtol=1e-11) for model in (relative, absolute))
    for pair in (("closure", "closure"), ("y", "height"), ("spring", "spring")):
        np.testing.assert_allclose(one.variance[pair[0]], other.variance[pair[1]], rtol=1e-9, atol=1e-15)


@settings(max_examples=15, deadline=None)
@given(
    poles=st.lists(st.floats(0.05, 5.0), min_size=1, max_size=3),
    speeds=st.tuples(st.floats(0, 10), st.floats(0, 5), st.floats(0, 3)),
)
def test_the_filters_covariance_does_not_depend_on_the_speed(poles, speeds):
    rates = [f'h{i} = "-{p!r}*h{i} + {"w" if i == 0 else f"h{i - 1}"}"' for i, p in enumerate(poles)]
    last = f"h{len(poles) - 1}"
    ground = f'kind = "shaping_filter"\nrates = {{ {", ".join(rates)} }}\nnoise = {{ w = 0.3 }}\nheight = "{last}"'
    a, b, c = speeds
    model = vehicle(rates='x = "-x + h"', ground=ground, travel=f'speed = "{a!r} + {b!r}*t + {c!r}*sin(t)**2"')
    history = cs.compile(model).propagate([0.0, 1.0, 4.0], rtol=1e-10)
    covariance = history.state_covariance[:, 1:, 1:]
    scale = np.sqrt(np.diagonal(covariance[0]))
    np.testing.assert_allclose(
        covariance / np.outer(scale, scale),
        np.broadcast_to(covariance[0] / np.outer(scale, scale), covariance.shape),
        atol=1e-10,
    )


def test_a_wheel_behind_meets_the_ground_where_it_stands():
    wavy = (
        'kind = "shaping_filter"\nrates = { h = "-(1 + 0.5*sin(s))*h + w" }\nnoise = { w = "1 + 0.1*s" }\nheight = "h"'
    )
    system = cs.augment(vehicle(rates='x = "-x + h + g"', contacts="h = {}\ng = { setback = 2.0 }", ground=wavy))
    s = sp.Symbol("s", real=True)
    front, back = system.drift[1:]
    states = system.states
    assert sp.expand(back.xreplace({states[2]: states[1]}) - front.xreplace({s: s - 2})) == 0
    assert system.intensity[1, 1] == system.intensity[0, 0].xreplace({s: s - 2})


STEP = ROLLING + '\nprofile = "0.1 if s > 2 else 0"'


def test_an_impulse_from_a_profile_that_jumps_is_refused():
    cs.augment(vehicle(rates='x = "v"\nv = "-k*x - c*v - der(h)"', ground=STEP))
    with pytest.raises(cs.ModelError, match=r"jumps at s = 2"):
        cs.augment(vehicle(ground=STEP))


def test_an_impulse_from_a_speed_that_jumps_is_refused():
    jump = 'speed = "1 if t < 3 else 2"'
    cs.augment(vehicle(rates='x = "v"\nv = "-k*x - c*v - der(h)"', travel=jump))
    with pytest.raises(cs.ModelError, match=r"jumps at t = 3"):
        cs.augment(vehicle(travel=jump))


ROADS = (
    'kind = "exponential"\nsigma = 0.03\ncutoff = 0.2',
    'kind = "iso8608"\nclass = "D"\ncutoff = 0.05\nrolling_contact = 8.0',
    'kind = "second_order"\nsigma = 0.02\ncutoff = 0.1\nwavenumber = 0.6',
    'kind = "exponential"\nsigma = 0.03\ncutoff = 0.2\ncontact_patch = { length = 0.2, order = 2 }',
    'kind = "spectrum"\nnumerator = [1e-4, 0, 2e-4]\ndenominator = [0.02, 0, 0.9, 0, 1.0]',
)


@cache
def riding(road: str) -> cs.CompiledModel:
    return cs.compile(
        toml(
            f"""
            name = "one wheel"
            [rates]
            x = "v"
            v = "-90*(x - h) - 3*v"
            [contacts]
            h = {{}}
            [ground]
            {road}
            [travel]
            speed = 7
            [run]
            duration = 1.0
            """
        )
    )


@settings(deadline=None)
@given(st.sampled_from(ROADS), st.floats(1e-3, 150.0))
def test_the_variance_of_the_ground_does_not_depend_on_the_speed(road, speed):
    functions = riding(road).functions
    p, y, packing = riding(road).parameter_vector(), riding(road).initial(), functions.facts.packing
    rows, columns = packing.triangle
    ground = packing.n + np.flatnonzero((rows >= functions.facts.vehicle) & (columns >= functions.facts.vehicle))
    bare = y.copy()
    bare[ground] = 0.0
    # P' = V (C P + P C^T + D Q D^T): what is left of it, over its forcing
    rate, forcing = (np.asarray(functions.held_rate(0, 0, speed, at, p)).ravel()[ground] for at in (y, bare))
    assert np.abs(rate).max() <= 1e-12 * np.abs(forcing).max()
