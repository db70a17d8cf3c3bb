"""What a run gave is looked over in one pass where that pays, and judged no other way than it is without."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import SHIPPED
from hypothesis import given, settings
from hypothesis import strategies as st

import cadet_sym as cs
from cadet_sym.lowering import functions
from cadet_sym.memory import Memory
from cadet_sym.packing import Packing
from cadet_sym.solve import sound
from cadet_sym.solve.definite import LIMIT, lost
from cadet_sym.solve.outputs import outputs_of
from cadet_sym.solve.scales import FEW_TIMES, MANY_TIMES, fits


@pytest.fixture(autouse=True)
def always(monkeypatch):
    monkeypatch.setattr(sound, "_looked", [sound.PAYS])


def run(seed: int, n: int, rows: int) -> tuple[np.ndarray, Packing, np.ndarray]:
    """Packed moments of full rank, and sizes that suit them."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(rows, n, n)) * np.exp(rng.normal(size=n))[:, None]
    packing = Packing(n)
    y = np.array([packing.pack(m, F @ F.T) for m, F in zip(rng.normal(size=(rows, n)), factor, strict=True)])
    return y, packing, np.abs(y).max(axis=0)


@given(
    st.integers(0, 10_000), st.integers(1, 7), st.sampled_from([1, 2, sound.LANES, sound.LANES + 1, 2 * sound.LANES + 3]),
    st.sampled_from(["whole", "rank", "indefinite", "size"]), st.floats(-13, -5), st.sampled_from([0.5, 0.99, 1.01, 3.0]),
)  # fmt: skip
@settings(deadline=None, max_examples=150)
def test_who_is_found_sound_is_judged_sound_without_machine_code(seed, n, rows, what, exponent, near):
    y, packing, size = run(seed, n, rows)
    at = seed % rows
    P = packing.unpack(y)[1][at]
    if what in ("rank", "indefinite"):  # an eigenvalue of zero, or a share of the trace below
        values, vectors = np.linalg.eigh(P)
        values[0] = 0.0 if what == "rank" else -(10.0**exponent) * values.sum()
        y[at, n:] = packing.pack(y[at, :n], vectors * values @ vectors.T)[n:]
    elif what == "size":
        size = size.copy()
        place = (seed % n, packing.diagonal[seed % n])[seed % 2]
        size[place] = (np.abs(y[:, place]).max() / (FEW_TIMES * near), MANY_TIMES * np.abs(y[:, place]).max() * near)[
            seed % 3 == 0
        ]
    judged = fits(size, y, packing) and not lost(y, packing).any()
    (found,) = sound.are_sound(y[None], packing, size[None])
    assert not found or judged
    if what == "whole":
        assert found
    work = np.empty(sound.LANES * packing.moments), np.empty(sound.LANES * (2 * n + 2))
    arguments = (y.ravel(), rows, y.shape[1], n, size, 0.5 * LIMIT, FEW_TIMES, MANY_TIMES, *work)
    assert bool(sound.look_over(*arguments)) == found


def test_no_number_is_not_sound():
    y, packing, size = run(0, 3, 4)
    for place in range(y.shape[1]):
        broken = y.copy()
        broken[2, place] = np.nan
        assert sound.are_sound(np.array([y, broken, y]), packing, size).tolist() == [True, False, True]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_outputs_as_machine_code_are_the_first_to_the_last_bit(path, shipped, monkeypatch):
    """CasADi's own until machine code pays, unless that has other last digits: then it comes at once."""
    compiled = shipped(path.stem)
    trajectory = compiled.propagate(points=9)
    monkeypatch.setattr(functions, "PAYS", -1)
    assert compiled.functions.machine_outputs(1) is not None or not compiled.outputs or compiled.functions.calls
    again = compiled.propagate(points=9)
    np.testing.assert_array_equal(trajectory.output_mean, again.output_mean)
    np.testing.assert_array_equal(trajectory.output_variance, again.output_variance)


@pytest.mark.parametrize("pays", [-1, 10**9])
def test_outputs_that_are_no_numbers_are_noticed_whoever_evaluates_them(pays, shipped, monkeypatch):
    monkeypatch.setattr(functions, "PAYS", pays)
    compiled = shipped("quarter_car_linear")
    p = np.tile(compiled.parameter_vector(), (5, 1))
    y, time = np.tile(compiled.initial(), (5, 3, 1)), np.arange(3.0)
    outputs, write = outputs_of(compiled.functions, time, p)
    write(slice(0, 5), y)
    assert outputs.finite
    for run in range(5):
        for entry in (0, compiled.packing.diagonal[0]):  # of the mean and of the variance of the stroke
            broken = y.copy()
            broken[run, 2, entry] = np.nan
            outputs, write = outputs_of(compiled.functions, time, p)
            write(np.array([4, 3]), broken[[4, 3]])
            assert outputs.finite == (run < 3)
            write(slice(0, 3), broken[:3])
            assert not outputs.finite


def test_many_runs_are_the_first_to_the_last_bit():
    compiled = cs.compile("models/oleo_acceleration.toml")
    first = compiled.propagate(rtol=1e-6)
    for _ in range(40):  # on the way machine code takes over
        again = compiled.propagate(rtol=1e-6)
        np.testing.assert_array_equal(again.state_covariance, first.state_covariance)
        np.testing.assert_array_equal(again.output_variance, first.output_variance)


def test_what_is_remembered_is_there_for_every_thread():
    class Owner:
        pass

    memory = Memory(most=3)
    owner = Owner()

    def ask(i: int) -> bool:
        return memory(owner, i % 7, lambda: i % 7) == i % 7

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(ask, range(5000)))
    assert len(memory._kept[owner]) <= 3
    owner = None
    assert not len(memory._kept)
