"""A verdict says how far off CADET is, and how sure that is; figures show both."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from cadet_sym.errors import ModelError
from cadet_sym.labelled import Labelled
from cadet_sym.plotting import moments_figure, sweep_figure
from cadet_sym.report import Comparison, compare
from cadet_sym.report.comparison import rounded
from cadet_sym.results import MomentHistory, Provenance
from cadet_sym.simulation.ensemble import InputShape
from cadet_sym.solutions import StationaryMoments, StationarySweep

HOW = Provenance("CVODES", 1e-8)
TIME = np.array([0.0, 1.0, 2.0])


@dataclass(frozen=True)
class Simulated:
    """What a comparison asks of an ensemble: a Gaussian state that starts at rest, and an output twice as large."""

    variance_at_end: float = 4.0
    paths: int = 4000
    states: tuple[str, ...] = ("x",)
    outputs: tuple[str, ...] = ("y",)
    time: np.ndarray = field(default_factory=TIME.copy)
    level: float = 0.99
    skewed: bool = False

    def _both(self, value: float, power: int) -> Labelled:
        x = np.array([0.0, value, value])[:, None]
        return Labelled(self.states, x, self.outputs, 2**power * x)

    @property
    def mean(self) -> Labelled:
        return self._both(1.0, 1)

    @property
    def variance(self) -> Labelled:
        return self._both(self.variance_at_end, 2)

    @property
    def mean_standard_error(self) -> Labelled:
        return self._both(math.sqrt(self.variance_at_end / self.paths), 1)

    @property
    def variance_standard_error(self) -> Labelled:
        return self._both(self.variance_at_end * math.sqrt(2 / self.paths), 2)

    @property
    def inputs(self) -> dict:
        shape = InputShape(("oleo",), *(np.array([math.nan, v, v]) for v in (-0.19, 0.12, 0.04, 0.08)))
        return {"v": shape} if self.skewed else {}

    variance_step_error = skewness = excess_kurtosis = property(lambda self: self._both(0.0, 0))

    def limit(self, moment: str) -> Labelled:
        errors = getattr(self, f"{moment}_standard_error")
        return Labelled(self.states, 2.576 * errors.values, self.outputs, 2.576 * errors.outputs)


ensemble: Any = Simulated


def history(variance: float, mean: float = 1.0) -> MomentHistory:
    spread = np.array([0.0, variance, variance])
    middle = np.array([0.0, mean, mean])
    return MomentHistory(
        model="toy",
        states=("x",),
        outputs=("y",),
        time=TIME,
        state_mean=middle[:, None],
        state_covariance=spread[:, None, None],
        output_mean=2.0 * middle[:, None],
        output_variance=4.0 * spread[:, None],
        provenance=HOW,
    )


def test_a_discrepancy_is_in_percent_of_the_simulated_moment_with_its_own_limits():
    verdict = compare(history(3.0, mean=1.5), ensemble()).verdict["x"]
    assert verdict.discrepancy == pytest.approx(-25.0)
    # 2.576 sqrt(2/n) of a Gaussian variance, carried over to the ratio 3/4.
    assert verdict.limit == pytest.approx(100 * 0.75 * 2.576 * math.sqrt(2 / 4000), rel=1e-6)
    assert verdict.mean_discrepancy == pytest.approx(25.0)
    assert verdict.mean_limit == pytest.approx(100 * 2.576 / math.sqrt(4000), rel=1e-6)
    assert not verdict.agrees


def test_a_verdict_is_one_plain_sentence():
    assert compare(history(3.0), ensemble()).verdict["y"].text == (
        "Variance of y is 25 ± 4 % low at the end of the run, its mean agrees (0 ± 4 % of a standard deviation)."
    )


def test_a_verdict_says_whether_the_inputs_are_gaussian():
    comparison = compare(history(3.0), ensemble(skewed=True))
    assert comparison.verdict["y"].text.endswith("; the oleo's input is skewed -0.19, its excess kurtosis +0.12.")


def test_a_verdict_names_the_time_at_which_the_discrepancy_is_largest():
    worse = replace(history(3.0), state_covariance=np.array([0.0, 2.0, 3.0])[:, None, None])
    verdict = compare(worse, ensemble()).verdict["x"]
    assert verdict.worst == pytest.approx((-50.0, 2.88, 1.0), rel=1e-2)
    assert "is 25 ± 4 % low at the end of the run (50 ± 3 % low at t = 1), its mean" in verdict.text
    assert verdict.to_dict()["worst"]["time"] == 1.0


def test_what_cannot_be_told_apart_agrees():
    comparison = compare(history(4.05), ensemble())
    assert comparison.verdict["x"].agrees
    assert "agrees (+1 ± 6 %)" in comparison.verdict["x"].text
    assert comparison.of_states == "Every state that varies agrees with the simulation within its limits."


def test_the_state_that_agrees_least_is_named():
    assert (
        "Of 1 states that vary 0 agree within the limits; variance of x is 50 ± 9 % high."
        in compare(history(6.0), ensemble()).of_states
    )


def test_what_does_not_vary_is_not_compared():
    verdict = compare(history(4.0), ensemble()).at("x", 0)
    assert math.isnan(verdict.discrepancy)
    assert "does not vary" in verdict.text
    assert verdict.to_dict()["discrepancy"] is None


@pytest.mark.parametrize("ours", [0.0, -1e-33, 2e-33, 1e-10, -1e-10])
def test_round_off_of_an_output_that_stands_still_is_not_compared(ours):
    """A sum of springs cancels at the start but for its last bits; E[y^2] - E[y]^2 but for what a quadrature leaves."""
    still, small = history(4.0), np.array([ours, 4.0, 4.0])
    with_round_off = np.array([3e-33, 4.0, 4.0])[:, None]
    nearly = replace(still, state_covariance=small[:, None, None])

    class RoundedOff(Simulated):
        variance = property(lambda self: Labelled(self.states, with_round_off, self.outputs, 4 * with_round_off))

    comparison = compare(nearly, RoundedOff())
    assert math.isnan(comparison.at("x", 0).discrepancy)
    assert comparison.worst("x") is not None
    assert comparison.worst("x")[2] > 0.0
    unlike = replace(still, state_covariance=np.array([1.0, 4.0, 4.0])[:, None, None])
    assert compare(unlike, RoundedOff()).at("x", 0).discrepancy > 1e30


def test_only_the_same_names_and_times_are_compared():
    other = ensemble()
    with pytest.raises(ModelError, match=r"states x and outputs y, the simulation states x and outputs z"):
        compare(history(4.0), replace(other, outputs=("z",)))
    with pytest.raises(ModelError, match=r"propagate\(times=simulation.time\)"):
        compare(history(4.0), replace(other, time=2 * TIME))


@pytest.mark.parametrize(
    ("value", "limit", "shown"),
    [
        (6.13, 0.21, ("6.1", "0.2")),
        (6.13, 0.14, ("6.13", "0.14")),
        (61.3, 21.0, ("61", "21")),
        (0.00123, 0.00047, ("0.0012", "0.0005")),
        (3.25, 0.0, ("3.25", "0")),
        (3.29234093368538749, 1.8e-16, ("3.29234", "1.8e-16")),
        (0.000284, 0.000002, ("0.000284", "0.000002")),
        (1.9e-5, 8e-7, ("1.90e-05", "0.08e-05")),
        (-2.3e-33, 1.2e-32, ("-0.2e-32", "1.2e-32")),
        (4.62782e18, 1.5e17, ("4.63e+18", "0.15e+18")),
    ],
)
def test_a_value_is_rounded_to_its_limit(value, limit, shown):
    assert rounded(value, limit) == shown


def test_the_table_holds_a_row_a_time_and_name():
    comparison: Comparison = compare(history(3.0), ensemble())
    assert comparison.table(rows=3).row_count == 3
    assert comparison.table(names=("x", "y"), rows=2).row_count == 4


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_a_comparison_is_drawn_and_written_whole(suffix, tmp_path):
    path = compare(history(3.0), ensemble()).plot(tmp_path / f"figure{suffix}")
    assert path.stat().st_size > 1000
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    with pytest.raises(ModelError, match="end the name in .png or .pdf or .svg"):
        compare(history(3.0), ensemble()).plot(tmp_path / "figure.gif")


def test_the_figure_shows_cadet_as_a_line_and_simulation_as_bars():
    figure = moments_figure(history(3.0), ensemble(), names=["x"])
    left, right = figure.axes
    assert (left.get_ylabel(), right.get_ylabel()) == ("mean of x", "variance of x")
    np.testing.assert_array_equal(right.get_lines()[0].get_ydata(), [0.0, 3.0, 3.0])
    (bars,) = right.containers
    np.testing.assert_allclose(bars.lines[0].get_ydata(), [0.0, 4.0, 4.0])
    assert "4000 paths, 99 % limits" in bars.get_label()


def test_the_figure_of_a_sweep_tells_stable_from_unstable():
    def at(mean: float, stable: bool) -> StationaryMoments:
        one = np.ones((1, 1))
        return StationaryMoments(
            "toy", ("x",), (), np.array([mean]), one, np.zeros(0), np.zeros(0), stable, 0.0, -one[0], (), (), HOW
        )

    sweep = StationarySweep("toy", "k", np.array([1.0, 2.0]), ((at(0.0, True), at(1.0, False)), (at(2.0, True),)), {})
    left, _ = sweep_figure(sweep, unit="N/m").axes
    assert left.get_xlabel() == "k (N/m)"
    stable, unstable = left.get_lines()
    np.testing.assert_array_equal(stable.get_xydata(), [[1.0, 0.0], [2.0, 2.0]])
    np.testing.assert_array_equal(unstable.get_xydata(), [[1.0, 1.0]])
