"""Sweeps: the same numbers in any process, labelled, and whole although points fail."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from reference_models import toml

import cadet_sym as cs
from cadet_sym.errors import ModelError
from cadet_sym.sweeps import sweep

MODEL = """
name = "oscillator"
[parameters]
k = 4.0
e = 0.1
[rates]
x = "v"
v = "-k*x - 0.4*v - e*x**3 + w"
[noise]
w = 1.0
[run]
duration = 5.0
points = 6
"""


def test_a_grid_in_processes_gives_the_serial_numbers_bit_for_bit():
    values = {"k": [2.0, 4.0, 9.0], "e": [0.0, 0.5]}
    serial = sweep(toml(MODEL), values, workers=1)
    parallel = sweep(toml(MODEL), values, workers=2)
    reversed_ = sweep(toml(MODEL), {name: list(v)[::-1] for name, v in values.items()}, workers=1)
    for i, history in enumerate(serial.histories):
        assert history is not None
        for other in (parallel[i], reversed_[len(serial) - 1 - i]):
            assert other is not None
            np.testing.assert_array_equal(other.state_covariance, history.state_covariance)
    data = parallel.to_xarray()
    assert data["covariance"].dims == ("k", "e", "time", "state", "state_2")
    alone = cs.compile(toml(MODEL)).propagate(parameters={"k": 9.0, "e": 0.5})
    np.testing.assert_array_equal(data["mean"].sel(k=9.0, e=0.5), alone.state_mean)


def test_samples_and_an_executor_of_ones_own():
    with ThreadPoolExecutor(1) as executor:
        result = sweep(toml(MODEL), {"k": [2.0, 4.0], "e": [0.3, 0.1]}, kind="samples", executor=executor, points=3)
    assert result.to_xarray()["output_mean"].sizes["sample"] == 2
    assert result.to_xarray()["e"].values.tolist() == [0.3, 0.1]
    assert len(result) == 2


def test_a_point_that_fails_is_kept_as_such():
    result = sweep(toml(MODEL), {"e": [0.1, -50.0]}, workers=1)
    assert result[0] is not None
    assert result[1] is None
    assert "e = -50" in result.failures[1]
    assert result.to_xarray()["failed"].values.tolist() == [False, True]
    assert np.isnan(result.to_xarray()["mean"].sel(e=-50.0)).all()


def test_the_bar_goes_to_standard_error(capsys):
    sweep(toml(MODEL), {"e": [0.1, 0.2]}, workers=1, progress=True)
    assert capsys.readouterr().out == ""


def test_dask_takes_the_points_through_its_own_executor():
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        result = sweep(toml(MODEL), {"e": [0.1, 0.2]}, executor=client.get_executor())
    assert not result.failures


@pytest.mark.parametrize(
    ("values", "kind", "message"),
    [
        ({}, "grid", "at least one"),
        ({"k": [float("nan")]}, "grid", "finite"),
        ({"k": [1.0, 2.0], "e": [1.0]}, "samples", "as many"),
        ({"k": [1.0]}, "spiral", "grid, samples"),
        ({"q": [1.0]}, "grid", "`q`"),
    ],
)
def test_wrong_arguments_are_named(values, kind, message):
    with pytest.raises(ModelError, match=message):
        sweep(toml(MODEL), values, kind=kind)
