"""The reference cases of kind i, transients: what Gaussian statistical linearisation must give, computed elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import oleo, oscillator, params, toml, value

import cadet_sym as cs


def propagate(model: cs.Model, times: object, rtol: float = 1e-10) -> cs.MomentHistory:
    return cs.compile(model).propagate(np.asarray(times, dtype=float), rtol=rtol)


OLEO = {
    "mean_x": lambda h: h.mean["x"],
    "var_x": lambda h: h.variance["x"],
    "mean_v": lambda h: h.mean["v"],
    "var_v": lambda h: h.variance["v"],
    "cov_xv": lambda h: h.covariance["x", "v"],
    "cov_xh": lambda h: h.covariance["x", "h.height"],
}


@pytest.mark.parametrize("case", ["R40A", "R40B", "R41A", "R41B", "R41C", "R43A", "R43C"])
def test_the_papers_undercarriage_gives_the_reference_moments(case):
    expected = value(case)
    history = propagate(oleo(case, duration=expected["t"][-1]), expected["t"])
    compared = [key for key in OLEO if key in expected]
    assert len(compared) >= 5
    for key in compared:
        np.testing.assert_allclose(OLEO[key](history), expected[key], rtol=1e-6, atol=1e-7, err_msg=key)


@pytest.mark.parametrize(("case", "position"), [("R41C", ("var_h", "var_hp")), ("R43C", ("F3_var_h", "F3_var_hp"))])
def test_the_ground_filter_keeps_its_variance_at_any_speed(case, position):
    history = propagate(oleo(case), [0.0, 3.0, 10.0], rtol=1e-8)
    for state, key in zip(("h.height", "h.slope"), position, strict=True):
        np.testing.assert_allclose(history.variance[state], value("R45")[key], rtol=1e-10)


def test_time_and_speed_scale_together():
    times = np.array([1.0, 5.0, 20.0])
    slow = propagate(oleo("R41C"), times)
    fast = cs.compile(oleo("R41C").with_parameters({"omega_n": 10.0, "V0": 10.0})).propagate(times / 10, rtol=1e-10)
    np.testing.assert_allclose(fast.variance["x"], slow.variance["x"], rtol=1e-8)
    np.testing.assert_allclose(fast.mean["x"], slow.mean["x"], rtol=1e-8)


def test_a_linear_vehicle_accelerating_over_the_ground():
    expected, p = value("R16"), params("R16")
    history = propagate(
        oleo("R43C").with_parameters({"gamma": 0, "zeta": p["zeta"], "omega_n": p["wn"]}), expected["t"]
    )
    np.testing.assert_allclose(history.variance["x"], expected["var_x"], rtol=1e-8)
    np.testing.assert_allclose(history.variance["v"], expected["var_v"], rtol=1e-8)


def test_an_oscillator_from_rest_under_white_noise():
    rows = value("R10")["transient"]
    history = propagate(oscillator("-4*x - 0.2*v", Q=1.5), [float(r["t"]) for r in rows])
    for i, row in enumerate(rows):
        for key, pair in {"Pxx": ("x", "x"), "Pvv": ("v", "v"), "Pxv": ("x", "v")}.items():
            np.testing.assert_allclose(history.covariance[pair][i], float(row[key]), rtol=1e-9)


@pytest.mark.parametrize("start", ["transient_filter_zero", "transient_filter_stationary"])
def test_an_oscillator_under_coloured_noise(start):
    expected = value("R11")
    rows = next(v for k, v in expected.items() if k.startswith("transient") and ("zero" in k) == ("zero" in start))
    covariance = "" if "zero" in start else '[initial.covariance]\n"u,u" = 1.0\n'
    model = toml(
        f"""
        name = "coloured"
        [rates]
        x = "v"
        v = "-4*x - 0.2*v + u"
        u = "-1.5*u + w"
        [noise]
        w = 3.0
        {covariance}
        [run]
        duration = 20.0
        """
    )
    history = propagate(model, [float(row["t"]) for row in rows])
    for i, row in enumerate(rows):
        for key in ("Pxx", "Pvv", "Pxv", "Pxu", "Pvu", "Puu"):
            got = history.covariance[key[1], key[2]][i]
            np.testing.assert_allclose(got, float(row[key]), rtol=1e-9, atol=1e-11, err_msg=f"{key} at {row['t']}")


def _compare(history: cs.MomentHistory, rows: list[list[float]]) -> None:
    got = np.column_stack(
        [history.mean["x"], history.mean["v"]]
        + [history.covariance[pair] for pair in (("x", "x"), ("x", "v"), ("v", "v"))]
    )
    np.testing.assert_allclose(got, rows, rtol=1e-7, atol=1e-9)


def test_a_duffing_oscillator_from_rest():
    expected = value("R21")
    _compare(propagate(oscillator("-0.1*v - x - x**3", Q=0.2), expected["t"]), expected["rows"])


def test_a_van_der_pol_oscillator():
    expected = value("R28")["transient"]
    model = oscillator("0.5*(1 - x**2)*v - x", Q=0.3, start="[initial]\nx = 0.1")
    _compare(propagate(model, expected["t"]), expected["rows"])


def test_a_cubic_relaxation_from_rest():
    rows = value("R32")["transient"]
    history = propagate(oscillator("-v**3", Q=0.5, scalar=True), [float(row["t"]) for row in rows])
    np.testing.assert_allclose(history.variance["v"], [float(row["P"]) for row in rows], rtol=1e-8)


@pytest.mark.parametrize("number", range(len(value("R36"))))
def test_bouc_wen_hysteresis_from_rest(number):
    expected = value("R36")[number]
    p = expected["par"]
    model = toml(
        f"""
        name = "Bouc-Wen"
        [rates]
        x = "v"
        v = "-2*{p["zeta"]}*v - {p["alpha"]}*x - (1 - {p["alpha"]})*z + w"
        z = "{p["A"]}*v - {p["beta"]}*abs(v)*abs(z)**{p["n"] - 1}*z - {p["gamma"]}*v*abs(z)**{p["n"]}"
        [noise]
        w = {p["Q"]}
        [run]
        duration = 50.0
        """
    )
    history = propagate(model, expected["t"])
    pairs = [("x", "x"), ("x", "v"), ("x", "z"), ("v", "v"), ("v", "z"), ("z", "z")]
    got = np.column_stack([history.covariance[pair] for pair in pairs])
    np.testing.assert_allclose(got, expected["Y"], rtol=1e-7, atol=1e-9)
