"""Travel: the distance is the integral of the speed, kinks are known, and a vehicle does not reverse."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cadet_sym.errors import ModelError
from cadet_sym.language.expression import TIME, evaluate, parse, symbol
from cadet_sym.language.kinks import breakpoints, jump, sides
from cadet_sym.language.model import Model
from cadet_sym.language.modelfile import loads
from cadet_sym.language.travel import Travel
from cadet_sym.language.vehicle import Vehicle

VALUES = {symbol("a"): 2.0, symbol("b"): 3.0, symbol("V"): 6.0, symbol("T"): 4.0}
POSITION = 3.0

SPEEDS = [
    "20",
    "a*t",
    "V + a*t**2",
    "a*t if t < 3 else 6",
    "a*t if t < T else a*T",
    "2*t if t < 3 else 6 if t < 5 else 6 - 3*(t - 5) if t < 7 else 0",
    "0 if t > 8 else 16 - 2*t if t > 5 else 6",
    "V*(1 if t < 2 else 0.5) + t",
    "max(V - 2*t, 0)*0 + max(10 - 2*t, 0)",
    "min(2*t, 6)",
    "clip(2*t, 1, 5)",
    "abs(t - 3)",
    "abs((t - 3)*(t - 5))",
    "3*heaviside(t - 2) + 1 + sign(t - 4)",
    "V*(1 - 0.1*t) if t <= 5 else V/2",
]


@pytest.mark.parametrize("speed", SPEEDS)
def test_the_closed_distance_is_the_integral_of_the_speed(speed):
    travel = Travel(speed=parse(speed), start=POSITION)
    distance = travel.closed_distance()
    assert distance is not None
    kinks = [evaluate(k, VALUES) for k in travel.breakpoints]
    times = np.union1d(np.linspace(0, 10, 40), [k for k in kinks if 0 < k < 10])
    found = evaluate(distance, {**VALUES, TIME: times})
    nodes, weights = np.polynomial.legendre.leggauss(6)
    want = POSITION
    for a, b, s in zip(times, times[1:], found[1:], strict=False):
        t = (a + b) / 2 + (b - a) / 2 * nodes
        want += (b - a) / 2 * weights @ np.broadcast_to(evaluate(travel.speed, {**VALUES, TIME: t}), t.shape)
        assert s == pytest.approx(want, abs=1e-10)
    assert found[0] == POSITION


@pytest.mark.parametrize("speed", ["sin(t) + 1", "exp(-t)", "max(V - a*t, 0)", "sqrt(t)", "a*t if sin(t) > 0 else 0"])
def test_a_distance_without_closed_form_is_left_to_the_solver(speed):
    assert Travel(speed=parse(speed)).closed_distance() is None


def test_a_given_distance_is_its_own():
    travel = Travel(distance=parse("3 + a*t**2/2"))
    assert travel.closed_distance() == parse("3 + a*t**2/2")
    assert travel.speed_expression() == parse("a*t")


@settings(max_examples=50, deadline=None)
@given(
    edges=st.lists(st.integers(-2, 12), min_size=1, max_size=4),
    levels=st.lists(st.integers(0, 9), min_size=5, max_size=5),
    rising=st.booleans(),
)
def test_branches_in_any_order_integrate_as_they_are_taken(edges, levels, rising):
    """Sequential conditions, also those that can never be reached."""
    sign = "<" if rising else ">"
    text = " else ".join(f"{level} + t if t {sign} {edge}" for level, edge in zip(levels, edges, strict=False))
    speed = parse(f"{text} else {levels[-1]}")
    distance = Travel(speed=speed).closed_distance()
    grid = np.linspace(0, 13, 130 * 8 + 1)
    middle = (grid[1:] + grid[:-1]) / 2
    want = np.cumsum(np.broadcast_to(evaluate(speed, {TIME: middle}), middle.shape) * np.diff(grid))
    np.testing.assert_allclose(np.broadcast_to(evaluate(distance, {TIME: grid[1:]}), middle.shape), want, atol=1e-9)


def test_a_measured_speed_goes_through_its_rows_and_stays_between_them():
    table = "[[0, 0], [2, 10], [4, 10], [6, 0], [8, 0]]"
    text = f'schema = 1\n[rates]\nx = "-x"\n[travel]\nspeed = {{ table = {table}, outside = "hold" }}'
    travel = loads(text).travel
    assert travel is not None
    t = np.linspace(-1, 10, 500)
    speed = evaluate(travel.speed, {TIME: t})
    assert speed.min() >= -1e-15
    assert speed.max() <= 10 + 1e-12
    assert evaluate(travel.speed, {TIME: np.array([0, 2, 3, 4, 6, 7, 9])}) == pytest.approx([0, 10, 10, 10, 0, 0, 0])
    assert travel.breakpoints == (0, 2, 4, 6, 8)
    distance = travel.closed_distance()
    assert distance is not None
    slope = (evaluate(distance, {TIME: t + 1e-6}) - evaluate(distance, {TIME: t - 1e-6})) / 2e-6
    inside = t > 0.01
    np.testing.assert_allclose(slope[inside], speed[inside], atol=1e-5)


def test_a_long_measured_run_is_read_in_no_time():
    import time

    rows = ", ".join(f"[{k}, {5 + (k * 7) % 11}]" for k in range(2000))
    began = time.perf_counter()
    model = loads(f'schema = 1\n[rates]\nx = "-x"\n[travel]\nspeed = {{ table = [{rows}] }}\n[run]\nduration = 1999')
    assert model.travel is not None
    assert time.perf_counter() - began < 10


def test_kinks_are_found_by_what_switches():
    t = TIME
    cases = {
        "1 if t < 2 else 3": (2,),
        "abs(2*t - 1)": (sp.Rational(1, 2),),
        "max(t, a)": (symbol("a"),),
        "sign(t - 1)*heaviside(a*t - 3)": (1, 3 / symbol("a")),
        "1 if t**2 > 9 else 0": (-3, 3),
        "1 if 1 < t < 2 else 0": (1, 2),
        "sin(t)": (),
    }
    for text, want in cases.items():
        assert breakpoints([parse(text)], t) == want


def test_both_sides_of_a_kink_are_told_apart():
    step = parse("a if t < 2 else t**2")
    assert sides(step, TIME, 2.0, {symbol("a"): 1.0}) == (1.0, 4.0)
    assert jump(step, TIME, [1.0, 2.0], {symbol("a"): 1.0}) == 2.0
    assert jump(step, TIME, [1.0, 2.0], {symbol("a"): 4.0}) is None
    assert sides(parse("max(t, 1)*sign(t - 1) + abs(t - 1)"), TIME, 1.0, {}) == (-1.0, 1.0)


def moving(speed: str, duration: float = 10, rate: str = "-x", **values: float) -> Model:
    return Model(
        Vehicle({sp.Symbol("x"): parse(rate)}),
        travel=Travel(speed=parse(speed)),
        parameters=values,
        duration=duration,
    )


@pytest.mark.parametrize(
    ("speed", "words"),
    [
        ("5 - t", "-5 at t = 10"),
        ("(t - 3.00001)*(t - 3.00002)*1e6", None),
        ("abs(t - 5) - 1", "-1 at t = 5"),
        ("1 if t < 9.9999 else -1", "-1 at t"),
        ("-1e-12 + t", None),
        ("log(t)", "not a finite number at t = 0"),
        ("sqrt(t - 1)", "not a finite number at t = 0"),
    ],
)
def test_a_speed_is_never_negative_within_the_run(speed, words):
    if words is None:
        assert moving(speed)
        return
    with pytest.raises(ModelError) as caught:
        moving(speed)
    assert words in str(caught.value)
    assert (caught.value.table, caught.value.key) == ("travel", "speed")


def test_after_the_run_the_speed_is_nobodys_business():
    assert moving("5 - t", duration=5)


def test_the_distance_may_be_named_where_there_is_travel():
    assert moving("1", rate="-x + sin(s)")
    with pytest.raises(ModelError, match="distance, `s`"):
        Model(Vehicle({sp.Symbol("x"): parse("-x + sin(s)")}))
