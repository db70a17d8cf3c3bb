"""What is counted on the way: crossings of levels, distributions, averages over time."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import oscillator, toml
from scipy import stats

from cadet_sym.errors import ModelError
from cadet_sym.simulation import simulate

# A lightly damped oscillator, stationary from the start: var x = 1, var v = 4.
STATIONARY = toml(
    """
    [rates]
    x = "v"
    v = "-4*x - 0.4*v + w"
    [noise]
    w = 3.2
    [initial.covariance]
    "x,x" = 1.0
    "v,v" = 4.0
    [outputs]
    size = "abs(x)"
    [run]
    duration = 6.0
    points = 13
    """
)


@pytest.fixture(scope="module")
def run():
    return simulate(
        STATIONARY,
        4000,
        step=0.01,
        check_step=False,
        levels={"x": [0.0, 1.0, 2.0], "size": [2.0]},
        histograms={"x": np.linspace(-3, 3, 13), "v": 20},
        average_from=1.0,
    )


def test_a_stationary_gaussian_crosses_levels_as_rice_says(run):
    """Up-crossing rate of level a: std(v)/std(x)/(2 pi) exp(-a^2/2)."""
    crossings = run.crossings["x"]
    assert np.isnan(crossings.rate[0]).all()
    rice = 2 / (2 * np.pi) * np.exp(-(np.array([0.0, 1.0, 2.0]) ** 2) / 2)
    for k in range(1, 13):
        assert (np.abs(crossings.rate[k] - rice) < 4 * crossings.rate_standard_error[k] + 0.01 * rice).all()
    outward = run.crossings["size"].rate[1:].mean()
    assert outward == pytest.approx(2 * crossings.rate[1:, 2].mean(), rel=0.1)


def test_the_chance_of_having_been_there_begins_with_the_start_and_grows(run):
    crossings = run.crossings["x"]
    start = stats.norm.sf([0.0, 1.0, 2.0])
    first = crossings.probability[1]
    assert (np.diff(crossings.probability, axis=0) >= 0).all()
    assert (first > start).all()
    assert crossings.probability[-1, 0] > 0.99
    assert crossings.probability_standard_error[3, 1] == pytest.approx(
        np.sqrt(crossings.probability[3, 1] * (1 - crossings.probability[3, 1]) / 4000)
    )


def test_histograms_count_every_path(run):
    of_x = run.histograms["x"]
    assert (of_x.counts.sum(axis=1) == 4000).all()
    expected = 4000 * np.diff(stats.norm.cdf(np.concatenate([[-np.inf], of_x.edges, [np.inf]])))
    for counts in of_x.counts:
        assert stats.chi2.sf(((counts - expected) ** 2 / expected).sum(), len(counts) - 1) > 1e-5
    assert np.allclose((of_x.density * np.diff(of_x.edges)).sum(axis=1), 1, atol=0.01)
    of_v = run.histograms["v"]
    assert len(of_v.edges) == 21
    assert of_v.edges[-1] > 8


def test_an_average_over_time_is_better_than_its_last_moment(run):
    average = run.average
    assert average.since == 1.0
    for k, truth in ((0, 1.0), (1, 4.0)):
        assert abs(average.mean[k]) < 4 * average.mean_standard_error[k]
        assert abs(average.variance[k] - truth) < 4 * average.variance_standard_error[k] + 0.01 * truth
        assert average.variance_standard_error[k] < 0.7 * run.moments.variance_standard_error[-1, k]
    assert 4000 < average.effective[0] < 4000 * 11 * 5


def test_standard_errors_of_time_averages_are_their_spread_over_seeds():
    runs = [
        simulate(oscillator("-v", Q=2.0, scalar=True), 200, times=np.linspace(4, 14, 41), step=0.1, seed=s,
                 check_step=False, average_from=4.0).average
        for s in range(60)
    ]  # fmt: skip
    for moment in ("mean", "variance"):
        claimed = np.mean([getattr(r, f"{moment}_standard_error")[0] for r in runs])
        assert claimed == pytest.approx(np.std([getattr(r, moment)[0] for r in runs], ddof=1), rel=0.35)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"levels": {"y": [1.0]}}, "`levels`: there is no state or output `y`"),
        ({"levels": {"x": [2.0, 1.0]}}, "`levels` of `x` are increasing"),
        ({"histograms": {"x": 0}}, "one bin or more"),
        ({"histograms": {"q": 5}}, "`histograms`: there is no"),
        ({"average_from": 9.0}, "beyond the last output time"),
        ({"watch": "x"}, r"a list of names"),
        ({"target": 0.0}, "`target` is a number greater than zero"),
        ({"time_limit": -1.0}, "`time_limit` is a time greater than zero"),
    ],
)
def test_wrong_demands_are_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        simulate(STATIONARY, 10, step=0.1, check_step=False, **arguments)
