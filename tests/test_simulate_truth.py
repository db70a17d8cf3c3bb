"""The judge judged: simulation against exact solutions and against independent simulations of the paper's example."""

from __future__ import annotations

import numpy as np
import pytest
from reference_models import oleo, oscillator, params, toml, value

from cadet_sym.simulation import Ensemble, simulate

SEVERAL = 4.0  # standard errors


def close(run: Ensemble, name: str, truth: float, moment: str = "variance", own: float = 0.0, at: int = -1) -> bool:
    """Within four joint standard errors, the step's error allowed for as far as it is known."""
    se = np.hypot(getattr(run, f"{moment}_standard_error")[name][at], own)
    found = getattr(run, moment)[name][at]
    print(f"{moment} of {name}: {found:.6g}, true {truth:.6g}, {(found - truth) / se:+.2f} standard errors")
    return abs(found - truth) < SEVERAL * se


PATHS = [
    pytest.param(4000, id="few"),
    pytest.param(100_000, id="many", marks=pytest.mark.slow),
    pytest.param(1_000_000, id="very-many", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("paths", PATHS)
def test_duffing_is_the_solution_of_its_fokker_planck_equation(paths):
    exact = next(row for row in value("R20x") if row["eps"] == "1")
    var = float(exact["var_x"])
    start = f'[initial.covariance]\n"x,x" = {var}\n"v,v" = 1.0'
    model = oscillator("-0.1*v - x - x**3", Q=0.2, start=start)
    # Paths that share their noise part soon, so that a step's error is hard to see; at 0.02 it is 1e-4.
    run = simulate(model, paths, times=[60.0], seed=1, step=0.02, check_step=False)
    assert close(run, "x", var)
    assert close(run, "v", 1.0)
    assert abs(run.kurtosis["x"][0] - float(exact["kurt"])) < 0.25 * np.sqrt(4000 / paths)


@pytest.mark.parametrize("paths", PATHS)
def test_quadratic_damping_is_exact(paths):
    p, exact = params("R25x"), value("R25x")
    var = float(exact["scalar_exact_var"])
    start = f'[initial.covariance]\n"v,v" = {var}'
    model = oscillator(f"-{p['c']}*abs(v)*v", Q=p["Q"], start=start, scalar=True)
    run = simulate(model, paths, times=[30.0], seed=1)
    assert close(run, "v", var)
    assert close(run, "v", 0.0, "mean")
    assert abs(run.kurtosis["v"][0] - float(exact["scalar_exact_kurt"])) < 0.25 * np.sqrt(4000 / paths)


@pytest.mark.parametrize("paths", PATHS)
def test_coulomb_friction_is_exact(paths):
    p, var = params("R27"), float(value("R27x")["c_exact"])
    start = f'[initial.covariance]\n"v,v" = {var}'
    model = oscillator(f"-{p['F']}*sign(v)", Q=p["Q"], start=start, scalar=True)
    run = simulate(model, paths, times=[30.0], seed=1)
    assert close(run, "v", var)
    assert abs(run.kurtosis["v"][0] - 6.0) < 1.5 * np.sqrt(4000 / paths) + 0.1


@pytest.mark.parametrize("paths", PATHS)
def test_a_chain_of_two_masses_is_exact(paths):
    p = {name: float(text) for name, text in params("R35").items()}
    exact = {name: float(text) for name, text in value("R35x").items()}
    restoring = f"-{p['k1']}*a - {p['e1']}*a**3 + {p['k2']}*(b - a) + {p['e2']}*(b - a)**3"
    model = toml(
        f"""
        [rates]
        a = "u"
        b = "v"
        u = "{restoring} - {p["c"]}*u + w1"
        v = "-{p["k2"]}*(b - a) - {p["e2"]}*(b - a)**3 - {p["c"]}*v + w2"
        [noise]
        w1 = {p["Q"]}
        w2 = {p["Q"]}
        [initial.covariance]
        "a,a" = {exact["P11"]}
        "a,b" = {exact["P12"]}
        "b,b" = {exact["P22"]}
        "u,u" = 1.0
        "v,v" = 1.0
        [outputs]
        stretch = "b - a"
        [run]
        duration = 60.0
        points = 2
        """
    )
    run = simulate(model, paths, seed=1)
    assert close(run, "a", exact["P11"])
    assert close(run, "b", exact["P22"])
    assert close(run, "u", 1.0)
    assert close(run, "stretch", exact["P11"] + exact["P22"] - 2 * exact["P12"])
    covariance, n = run.covariance["a", "b"][-1], paths
    spread = np.sqrt((exact["P11"] * exact["P22"] + exact["P12"] ** 2) / n)
    assert abs(covariance - exact["P12"]) < SEVERAL * spread


PAPER = ["R40Ax", "R40Bx", "R41Ax", "R41Bx", "R41Cx", "R43Cx"]


@pytest.mark.parametrize("paths", PATHS[:2])
@pytest.mark.parametrize("case", PAPER)
def test_the_papers_undercarriage_agrees_with_an_independent_simulation(case, paths):
    last = 25.0 if paths > 4000 else 10.0
    rows = [row for row in value(case)["rows"] if row["t"] <= last]
    run = simulate(oleo(case.removesuffix("x")), paths, times=[row["t"] for row in rows], seed=2)
    for at, row in enumerate(rows):
        assert close(run, "x", row["mean"], "mean", row["se_mean"], at)
        assert close(run, "x", row["var"], "variance", row["se_var"], at)


@pytest.mark.parametrize("paths", PATHS[:2])
def test_a_linear_system_has_the_covariance_of_its_lyapunov_equation(paths):
    """A stiff wheel on a soft body over ground of one exponential, relative to the closed form of the whole."""
    from scipy.linalg import solve_continuous_lyapunov

    model = toml(
        """
        [rates]
        zs = "vs"
        zu = "vu"
        vs = "-20*(zs - zu) - 2*(vs - vu)"
        vu = "100*(zs - zu) + 10*(vs - vu) - 900*(zu - h) + w"
        [noise]
        w = 0.4
        [contacts]
        h = {}
        [ground]
        kind = "exponential"
        sigma = 0.5
        cutoff = 0.3
        [travel]
        speed = "10"
        [outputs]
        tyre = "zu - h"
        [run]
        duration = 10.0
        points = 3
        """
    )
    A = np.array([[0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [-20, 20, -2, 2, 0], [100, -1000, 10, -10, 900], [0, 0, 0, 0, -3.0]])
    P = solve_continuous_lyapunov(A, -np.diag([0, 0, 0, 0.4, 2 * 3.0 * 0.25]))
    run = simulate(model, paths, seed=1)
    for k, name in enumerate(run.states):
        assert close(run, name, P[k, k])
        assert close(run, name, 0.0, "mean")
    assert close(run, "tyre", P[1, 1] + P[4, 4] - 2 * P[1, 4])


@pytest.mark.parametrize("paths", PATHS[:2])
def test_noise_that_changes_with_time_and_is_correlated(paths):
    """Brownian motions of intensities t and 1, correlated: covariances are the integrals of the intensities."""
    model = toml(
        """
        [rates]
        a = "u"
        b = "2*v - u"
        [noise]
        names = ["u", "v"]
        intensity = [["t", "t/2"], ["t/2", "1 + t"]]
        [run]
        duration = 2.0
        points = 5
        """
    )
    run = simulate(model, paths, seed=4, step=0.05)
    for at, t in enumerate(run.time):
        uu, uv, vv = t**2 / 2, t**2 / 4, t + t**2 / 2
        for pair, truth in ((("a", "a"), uu), (("a", "b"), 2 * uv - uu), (("b", "b"), 4 * vv - 4 * uv + uu)):
            other = np.sqrt(uu * (4 * vv - 4 * uv + uu))
            assert abs(run.covariance[pair][at] - truth) < SEVERAL * np.sqrt(2 / paths) * max(other, uu, 4 * vv) + 1e-3


@pytest.mark.slow
def test_limits_of_99_percent_hold_the_truth_in_97_to_100_percent_of_200_seeds():
    exact = float(value("R25x")["scalar_exact_var"])
    p = params("R25x")
    start = f'[initial.covariance]\n"v,v" = {exact}'
    model = oscillator(f"-{p['c']}*abs(v)*v", Q=p["Q"], start=start, scalar=True)
    inside = {"mean": 0, "variance": 0}
    for seed in range(200):
        run = simulate(model, 2000, times=[30.0], seed=seed, step=0.02, check_step=False)
        for moment, truth in (("mean", 0.0), ("variance", exact)):
            low, high = getattr(run, f"{moment}_limits")("v")
            inside[moment] += bool(low[0] < truth < high[0])
    print(f"of 200 seeds inside: {inside}")
    assert all(194 <= count <= 200 for count in inside.values()), inside
