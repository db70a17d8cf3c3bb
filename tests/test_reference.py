"""The reference cases of kind i: what Gaussian statistical linearisation must give, computed elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from reference_models import bouc_wen, half_car, oleo, oscillator, params, quarter_car, toml, value

import cadet_sym as cs
from cadet_sym.language.ground import iso8608, second_order


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
    history = propagate(bouc_wen(expected["par"]), expected["t"])
    pairs = [("x", "x"), ("x", "v"), ("x", "z"), ("v", "v"), ("v", "z"), ("z", "z")]
    got = np.column_stack([history.covariance[pair] for pair in pairs])
    np.testing.assert_allclose(got, expected["Y"], rtol=1e-7, atol=1e-9)


def stationary(model: cs.Model, **held: object) -> cs.StationaryMoments:
    found = cs.compile(model).stationary(**held)
    assert found.stable
    assert found.residual < 1e-9
    return found


def close(got: object, expected: object, rtol: float = 1e-9, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(np.asarray(got, dtype=float), np.asarray(expected, dtype=float), rtol=rtol, atol=atol)


@pytest.mark.parametrize("key", value("R44"))
def test_the_undercarriage_settles_to_the_reference(key):
    expected = value("R44")[key]
    r, zeta = (float(part.lstrip("rzeta")) for part in key.split("_"))
    found = stationary(oleo("R41C").with_parameters({"r": r, "zeta": zeta}))
    close(found.mean["x"], expected["mean_x"], 1e-8)
    for name, pair in {
        "var_x": ("x", "x"),
        "var_v": ("v", "v"),
        "cov_xh": ("x", "h.height"),
        "cov_vh": ("v", "h.height"),
        "cov_xhp": ("x", "h.slope"),
        "cov_vhp": ("v", "h.slope"),
    }.items():
        close(found.covariance[pair], expected[name], 1e-8)


@pytest.mark.parametrize("row", value("R20"), ids=lambda row: row["eps"])
def test_a_duffing_oscillator_settles(row):
    found = stationary(oscillator(f"-0.1*v - x - {row['eps']}*x**3", Q=0.2))
    close([found.variance["x"], found.variance["v"]], [row["var_x"], row["var_v"]])


@pytest.mark.parametrize("row", value("R24"), ids=lambda row: row["b"])
def test_a_duffing_oscillator_under_a_constant_load_settles(row):
    found = stationary(oscillator(f"-0.2*v - x - 0.5*x**3 + {row['b']}", Q=0.4))
    close([found.mean["x"], found.variance["x"], found.variance["v"]], [row["mean"], row["var"], 1.0])


def test_quadratic_damping_settles():
    expected = value("R25")
    found = stationary(oscillator("-0.3*abs(v)*v - 4*x", Q=0.5))
    close([found.variance["v"], found.variance["x"]], [expected["var_v"], expected["var_x"]])
    close(stationary(oscillator("-0.3*abs(v)*v", Q=0.5, scalar=True)).variance["v"], expected["scalar_var"])


def test_coulomb_damping_settles():
    expected = value("R27")
    for letter, restoring in (("a", "-0.5*sign(v) - 4*x"), ("b", "-0.5*sign(v) - 4*x - 0.2*v")):
        found = stationary(oscillator(restoring, Q=0.4))
        close([found.variance["v"], found.variance["x"]], [expected[f"{letter}_var_v"], expected[f"{letter}_var_x"]])
    close(stationary(oscillator("-0.5*sign(v)", Q=0.4, scalar=True)).variance["v"], expected["c_var"])


def test_van_der_pol_oscillators_settle():
    expected = value("R28")
    for letter, restoring in (("a", "0.5*(1 - x**2)*v - x"), ("b", "0.5*(1 - x**2 - v**2)*v - x")):
        found = stationary(oscillator(restoring, Q=0.3))
        close([found.variance["x"], found.variance["v"]], [expected[letter]] * 2)


@pytest.mark.parametrize("row", value("R30"), ids=lambda row: row["Q"])
def test_all_solutions_of_a_bistable_system_are_found(row):
    found = cs.compile(oscillator("v - v**3", Q=row["Q"], scalar=True)).stationary(all=True)
    assert [each.stable for each in found] == sorted((each.stable for each in found), reverse=True)
    got = sorted((float(s.mean["v"]), float(s.variance["v"]), s.stable) for s in found)
    expected = sorted(
        (sign * float(s["mean"]), float(s["var"]), s["stable"])
        for s in row["solutions"]
        for sign in ((1, -1) if float(s["mean"]) else (1,))
    )
    assert [s[2] for s in got] == [s[2] for s in expected]
    close([s[:2] for s in got], [s[:2] for s in expected], 1e-8, 1e-10)


def test_saturating_springs_settle():
    expected = value("R31")
    close(stationary(oscillator("-0.2*v - sqrt(pi/2)*erf(x/sqrt(2))", Q=0.4)).variance["x"], expected["a"])
    close(stationary(oscillator("-0.2*v - tanh(x)", Q=0.4)).variance["x"], expected["b"])


def test_a_cubic_relaxation_settles():
    found = stationary(oscillator("-v**3", Q=0.5, scalar=True))
    close(found.variance["v"], value("R32")["sl_var"], 1e-8)


def test_a_chain_of_two_masses_settles():
    expected = value("R35")
    model = toml(
        """
        name = "chain"
        [rates]
        x1 = "v1"
        v1 = "-0.1*v1 - x1 - 0.5*x1**3 + 2*(x2 - x1) + (x2 - x1)**3 + w1"
        x2 = "v2"
        v2 = "-0.1*v2 - 2*(x2 - x1) - (x2 - x1)**3 + w2"
        [noise]
        w1 = 0.2
        w2 = 0.2
        [run]
        duration = 1.0
        """
    )
    found = stationary(model)
    close(found.covariance["x1", "x1"], expected["P11"])
    close(found.covariance["x1", "x2"], expected["P12"])
    close(found.covariance["x2", "x2"], expected["P22"])


@pytest.mark.parametrize("row", value("R36"), ids=lambda row: f"n{row['par']['n']}a{row['par']['alpha']:.2f}")
def test_bouc_wen_hysteresis_settles(row):
    found = stationary(bouc_wen(row["par"]))
    pairs = [("x", "x"), ("x", "v"), ("x", "z"), ("v", "v"), ("v", "z"), ("z", "z")]
    close([found.covariance[pair] for pair in pairs], row["stationary"], 1e-8, 1e-9)


@pytest.mark.parametrize("name", value("R12")["values"])
def test_closure_and_acceleration_of_a_quarter_car_on_an_integrated_road(name):
    expected = value("R12")["values"][name]
    p = {key: float(sp.Rational(number)) for key, number in expected["params"].items()}
    found = stationary(quarter_car(p, V=20, gd=256e-6, cutoff='[initial]\nground = "smooth"'))
    assert {"zs", "zu", "h.height"} <= set(found.drifting)
    assert np.isnan(found.variance["zs"])
    for output, key in {"stroke": "var_stroke", "tyre": "var_tyre", "acc": "var_acc", "vs": "var_vs"}.items():
        close(found.variance[output], expected[key])


def test_a_quarter_car_on_a_road_with_a_cut_off():
    expected, p = value("R14"), params("R14")
    car = {key: p[key] for key in ("ms", "mu", "ks", "cs", "kt")}
    found = stationary(quarter_car(car, V=20, gd=256e-6, cutoff=f"cutoff = {2 * np.pi * p['n00']!r}"))
    for name, key in {
        "stroke": "stroke",
        "tyre": "tyre",
        "acc": "acc",
        "zs": "zs",
        "h.height": "road_var",
    }.items():
        close(found.variance[name], expected[key], 1e-8)


@pytest.mark.parametrize("speed", [1, 3, 10, 20, 40])
def test_a_half_car_with_exactly_delayed_ground(speed):
    found = stationary(half_car(), speed=float(speed))
    for name, expected in value("W1")[f"halfcar V={speed}"].items():
        close(found.variance[name], expected)


def test_a_start_in_the_stationary_state_stays_there():
    expected = value("W1")["halfcar V=10"]
    history = propagate(half_car('whole = "stationary"'), [0.0, 0.5, 2.0], rtol=1e-9)
    for name in expected:
        np.testing.assert_allclose(history.variance[name], expected[name], rtol=1e-6)


def test_an_integrated_road_has_no_stationary_start_but_closures_settle_on_it():
    p = {key: float(sp.Rational(number)) for key, number in value("R12")["values"]["TurkayAkcay"]["params"].items()}
    compiled = cs.compile(quarter_car(p, V=20, gd=256e-6))
    close(compiled.stationary().variance["stroke"], value("R12")["values"]["TurkayAkcay"]["var_stroke"])
    with pytest.raises(cs.ModelError, match=r'ground = "smooth".*cutoff') as error:
        compiled.propagate()
    assert error.value.exit_status == 2


@pytest.mark.parametrize("letter", "ABCDEFGH")
def test_iso_roads_excite_as_the_reference_says(letter):
    """R50: the class's geometric mean at 0.1 cycle/m, and the intensity of its slope's white noise in time at 20 m/s."""
    expected = value("R50")["classes"][letter]
    road, V = iso8608(letter), 20.0
    assert 1e6 * float(road.settings["gd"]) == pytest.approx(expected["mean"], rel=1e-12)
    assert V * float(road.shaping_filter().Q[0]) == pytest.approx(expected["Q_V20"], rel=1e-12)
    h, x = sp.symbols("h x")
    vehicle = cs.Vehicle(rates={x: -3 * x + cs.der(h)}, contacts={h: cs.Contact()})
    found = cs.compile(cs.Model(vehicle, road, cs.Travel(speed=V))).stationary()
    assert found.variance["x"] == pytest.approx(expected["Q_V20"] / 6, rel=1e-10)  # Q/(2 k) of x' = -k x + w


def test_published_roads_have_the_autocovariance_of_the_reference():
    """R53: sigma^2 exp(-alpha d) cos(beta d); between two wheels d apart it is their covariance."""
    a, b, x = sp.symbols("a b x")
    for name, (sigma, alpha, beta) in params("R53")["table_b"].items():
        for k, d in enumerate((1.0, 3.0, 7.0), start=1):
            vehicle = cs.Vehicle(
                rates={x: -x}, contacts={a: cs.Contact(), b: cs.Contact(setback=d)}, outputs={"sum": a + b}
            )
            model = cs.Model(vehicle, second_order(sigma, alpha, beta), cs.Travel(speed=2.0), duration=1)
            history = cs.compile(model).propagate([0.0, 1.0])
            want = sigma**2 * np.exp(-alpha * d) * np.cos(beta * d)
            if name == "asphalt":
                assert value("R53")[k] == pytest.approx(want, rel=1e-10)
                assert value("R53")[0] == pytest.approx(sigma**2, rel=1e-10)
            found = (history.output_variance[:, 0] / 2 - sigma**2) / sigma**2
            assert found[0] == pytest.approx(want / sigma**2, abs=1e-10)
            assert found[1] == pytest.approx(want / sigma**2, abs=1e-7)  # the ground between the wheels is on a grid
