"""A run that makes no sense is refused, also with other parameters or of another length than was declared."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import toml

import cadet_sym as cs
from cadet_sym.language.expression import TIME, evaluate
from cadet_sym.language.modelfile import loads

CAR = """
    name = "car"
    [parameters]
    V = 10.0
    A = 1.0
    B = 2.0
    [rates]
    x = "v"
    v = "-100*x - 2*v + 30*(a + b + c)"
    [contacts]
    a = {{}}
    b = {{ setback = "A" }}
    c = {{ setback = "B" }}
    [ground]
    {ground}
    [travel]
    speed = {speed}
    [run]
    duration = 5.0
    points = 6
    """

ROAD = 'kind = "exponential"\nsigma = 0.01\ncutoff = 0.2\nrolling_contact = 5.0'


def car(speed: str = '"V - t"', ground: str = ROAD) -> cs.Model:
    return toml(CAR.format(speed=speed, ground=ground))


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"parameters": {"V": 3.0}}, r"the speed is -2 at t = 5"),
        ({"parameters": {"V": float("nan")}}, "nan"),
        ({"duration": 12.0}, r"the speed is -2 at t = 12"),
        ({"times": [1.0, 15.0]}, r"the speed is -5 at t = 15"),
        ({"parameters": {"A": -1.0}}, r"not negative: -1 found"),
        ({"parameters": {"A": 2.5}}, r"another order than they were compiled in.*0, 2.5, 2"),
        ({"parameters": {"A": 2.0}}, r"two at one place"),
    ],
)
def test_other_parameters_and_longer_runs_are_looked_at_as_the_declared_are(asked, words):
    compiled = cs.compile(car())
    with pytest.raises(cs.ModelError, match=words):
        compiled.propagate(**asked)


def test_what_makes_sense_is_left_alone():
    compiled = cs.compile(car())
    found = compiled.propagate(parameters={"A": 1.5, "V": 30.0}, duration=11.0)
    again = cs.compile(car().with_parameters({"A": 1.5, "V": 30.0})).propagate(duration=11.0)
    np.testing.assert_allclose(found.variance["x"], again.variance["x"], rtol=1e-6)


def test_a_simulation_longer_than_declared_is_looked_at_too():
    with pytest.raises(cs.ModelError, match="-5 at t = 15"):
        cs.simulate(car(), paths=10, times=[1.0, 15.0])


ROWS = "[[0, 1], [2, 10], [{last}, 12]]"


@pytest.mark.parametrize(("last", "words"), [(4, "from t = 0 to t = 4, and the run from 0 to 5"), (5, None), (9, None)])
def test_a_measured_speed_covers_the_run(last, words):
    speed = f"{{ table = {ROWS.format(last=last)} }}"
    if words is None:
        assert car(speed)
        return
    with pytest.raises(cs.ModelError, match=words) as caught:
        car(speed)
    assert (caught.value.table, caught.value.key) == ("travel", "speed")
    assert 'outside = "hold"' in str(caught.value)


def test_a_measured_speed_that_begins_late_is_refused():
    with pytest.raises(cs.ModelError, match="from t = 1 to t = 9"):
        car("{ table = [[1, 1], [9, 2]] }")


def test_what_a_measured_speed_is_beyond_its_rows_may_be_said():
    held = car(f'{{ table = {ROWS.format(last=4)}, outside = "hold" }}')
    assert evaluate(held.travel.speed, {TIME: 5.0}) == 12.0
    assert cs.compile(held).propagate(duration=8.0).time[-1] == 8.0
    with pytest.raises(cs.ModelError, match="negative within the run"):  # its last piece falls
        car('{ table = [[0, 10], [4, 1]], outside = "extrapolate" }')


def test_a_run_longer_than_a_measured_speed_is_refused():
    model = car(f"{{ table = {ROWS.format(last=9)} }}")
    compiled = cs.compile(model)
    assert compiled.propagate(duration=9.0).time[-1] == 9.0
    for run in (compiled.propagate, lambda times: cs.simulate(model, paths=10, times=times)):
        with pytest.raises(cs.ModelError, match=r'9.*outside = "hold"'):
            run(times=[1.0, 10.0])


def test_a_measured_speed_is_written_as_it_was_read():
    for more in ("", ', outside = "hold"'):
        model = car(f"{{ table = {ROWS.format(last=9)}{more} }}")
        assert loads(model.to_toml()) == model
        assert ("outside" in model.to_toml()) == bool(more)


@pytest.mark.parametrize(
    ("ground", "words"),
    [
        ('kind = "exponential"\nsigma = -0.01\ncutoff = 0.2', r"sigma.*not negative is wanted, not -0.01"),
        ('kind = "exponential"\nsigma = "0.01*(1 - s/20)"\ncutoff = 0.2', r"sigma.*at s = 20\.\d"),
        ('kind = "exponential"\nsigma = 0.01\ncutoff = "0.2 - s/100"', r"cutoff.*positive number is wanted.*at s = 20"),
        ('kind = "iso8608"\ngd = -1e-6\ncutoff = 0.1', r"gd.*not -1e-06"),
        ('kind = "iso8608"\ngd = "1e-6*(1 - s/20)"\ncutoff = 0.1', r"gd.*at s = 20\.\d"),
        (
            'kind = "shaping_filter"\nrates = { h = "-h + w" }\nnoise = { w = "1 - s/20" }\nheight = "h"',
            r"noise.*not -0.\d+ at s = 20\.\d",
        ),
        (
            'kind = "shaping_filter"\nrates = { h = "p", p = "2*p - 2*h + w" }\nnoise = { w = 1 }\nheight = "h"',
            r"filter is unstable: its eigenvalue 1 \+- 1i",
        ),
    ],
)
def test_numbers_of_the_road_make_sense_all_along_it(ground, words):
    with pytest.raises(cs.ModelError, match=words) as caught:
        car('"V"', ground)
    assert caught.value.table == "ground"


def test_what_lies_beyond_the_road_that_is_travelled_is_nobodys_business():
    assert car('"V - t"', 'kind = "exponential"\nsigma = "0.01*(1 - s/40)"\ncutoff = 0.2')


def test_a_wave_that_does_not_decay_has_no_stationary_height():
    wave = 'kind = "shaping_filter"\nrates = { h = "p", p = "-h + w" }\nnoise = { w = 1e-3 }\nheight = "h"'
    with pytest.raises(cs.ModelError, match=r"no stationary height: its filter has the eigenvalue .*1j .*does not decay"):
        cs.compile(car('"V"', wave)).propagate()


def test_wheels_may_be_further_apart_than_the_whole_run_is_long():
    """Stationary ground has no end behind the start; on ground that is flat behind it the wheel feels nothing."""
    far = CAR.format(speed='"V"', ground=ROAD).replace("B = 2.0", "B = 1000.0")
    apart = far.replace('c = { setback = "B" }', 'c = { track = "other" }')
    together, alone = (cs.compile(toml(text)).propagate() for text in (far, apart))
    np.testing.assert_allclose(together.variance["x"], alone.variance["x"], rtol=1e-6)
