"""Stationary moments of problems made by hand: found, right, and refused where there are none."""

from dataclasses import replace

import numpy as np
import pytest
from reference_models import toml
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import brentq
from stationary_systems import (
    bilinear,
    coulomb,
    cubic,
    error_function,
    moment_jacobian,
    problem,
    quadratic_damper,
    random_system,
    saturation,
    sine,
)

import cadet_sym as cs
from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import FrozenProblem, WheelTrack, evaluate
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.rungs import follow, newton
from cadet_sym.solve.search import stationary_points
from cadet_sym.solve.stability import stability
from cadet_sym.solve.stationary import stationary_point


def oscillator(c=0.2, k=1.0, Q=0.4, load=0.0, stiffness=(), damping=()):
    """x'' + c x' + k x + elements = load + w."""
    elements = [*stiffness, *damping]
    C = [[1, 0]] * len(stiffness) + [[0, 1]] * len(damping)
    b = np.array([[0.0] * len(elements), [-1.0] * len(elements)])
    D = [[0, 0], [0, Q]]
    return problem([[0, 1], [-k, -c]], b, np.reshape(C, (-1, 2)), elements, D, c=[0, load])


def scalar(element, Q, a=0.0, load=0.0):
    """x' = a x - f(x) + load + w."""
    return problem([[a]], [[-1]], [[1]], [element], [[Q]], c=[load])


# -- closed forms ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("eps", [0.01, 0.5, 1.0, 10.0, 1000.0])
def test_duffing_oscillator(eps):
    point = stationary_point(oscillator(c=0.1, Q=0.2, stiffness=[cubic(eps)]))
    expected = [(np.sqrt(1 + 12 * eps) - 1) / (6 * eps), 1.0]
    np.testing.assert_allclose(np.diag(point.covariance), expected, rtol=1e-11)
    assert point.stable


def test_duffing_oscillator_under_load():
    point = stationary_point(oscillator(stiffness=[cubic(0.5)], load=2.0))
    np.testing.assert_allclose(point.mean, [1, 0], atol=1e-12)
    np.testing.assert_allclose(np.diag(point.covariance), [1 / 3, 1], rtol=1e-12)


def test_quadratic_damping_alone():
    point = stationary_point(oscillator(c=0.0, k=4.0, Q=0.5, damping=[quadratic_damper(0.3)]))
    v = (0.5 * np.sqrt(np.pi / 8) / 0.6) ** (2 / 3)
    np.testing.assert_allclose(np.diag(point.covariance), [v / 4, v], rtol=1e-12)


def test_friction_alone_holds_the_variance():
    point = stationary_point(oscillator(c=0.0, k=4.0, damping=[coulomb(0.5)]))
    v = np.pi * 0.4**2 / (8 * 0.5**2)
    np.testing.assert_allclose(np.diag(point.covariance), [v / 4, v], rtol=1e-12)


def test_saturating_spring_gives_the_golden_ratio():
    point = stationary_point(oscillator(k=0.0, stiffness=[error_function()]))
    np.testing.assert_allclose(point.covariance[0, 0], (1 + np.sqrt(5)) / 2, rtol=1e-12)


def test_no_linear_part_at_all():
    point = stationary_point(scalar(cubic(), 0.5))
    np.testing.assert_allclose(point.covariance, [[np.sqrt(0.5 / 6)]], rtol=1e-12)


def test_a_linear_system_is_a_lyapunov_equation():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((9, 9)) - 4 * np.eye(9)
    D = np.diag(rng.random(9))
    point = stationary_point(problem(A, np.zeros((9, 0)), np.zeros((0, 9)), [], D, c=np.ones(9)))
    np.testing.assert_allclose(point.covariance, solve_continuous_lyapunov(A, -D), atol=1e-13)
    np.testing.assert_allclose(point.mean, -np.linalg.solve(A, np.ones(9)), rtol=1e-12)


def test_without_noise_it_is_the_equilibrium():
    point = stationary_point(oscillator(Q=0.0, stiffness=[cubic()], load=1.0))
    np.testing.assert_allclose(point.mean, [brentq(lambda x: x + x**3 - 1, 0, 1), 0], atol=1e-12)
    assert not np.any(point.covariance > 1e-20)


def test_a_state_that_no_noise_reaches_stands_still():
    p = problem([[-1, 0], [0, -2]], [[-1], [0]], [[1, 1]], [cubic()], [[1, 0], [0, 0]], c=[0, 1])
    point = stationary_point(p)
    np.testing.assert_allclose([point.mean[1], point.covariance[1, 1]], [0.5, 0], atol=1e-12)


# -- any system -----------------------------------------------------------------------------------------------


def is_right(p: FrozenProblem, mean: np.ndarray, covariance: np.ndarray) -> bool:
    """The check that shares nothing with the solver but the problem's own numbers."""
    K, owner = len(p.C), p.owner
    spread = p.C @ covariance @ p.C.T
    pairs = [(a, o) for a in range(K) for o in range(a + 1) if owner[a] == owner[o]]
    F, gain, _, _ = p.elements(np.concatenate([p.C @ mean + p.d, [spread[a, o] for a, o in pairs]]))
    N = p.A + p.b @ np.array([[g if owner[i] == j else 0 for i, g in enumerate(gain)] for j in range(len(F))]) @ p.C
    sigma = np.sqrt(np.diag(covariance))
    r, r_terms = p.A @ mean + p.c + p.b @ F, np.abs(p.A) @ np.abs(mean) + np.abs(p.c) + np.abs(p.b) @ np.abs(F)
    R = N @ covariance + covariance @ N.T + p.D
    terms = np.outer(np.abs(N) @ sigma, sigma)
    return bool(
        np.isfinite(R).all()
        and np.all(np.abs(r) <= 1e-10 * (r_terms + np.abs(N) @ sigma))
        and np.all(np.abs(R) <= 1e-10 * (terms + terms.T + np.abs(p.D)))
        and np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))[0] > -1e-10
    )


def found_among(seeds, largest: int = 30) -> int:
    """How many random systems are solved; each answer is checked, and so is its stability."""
    count = 0
    for seed in seeds:
        p, _, _ = random_system(seed, largest)
        try:
            point = stationary_point(p)
        except SolverError:
            continue
        assert is_right(p, point.mean, point.covariance), seed
        assert point.stable, seed
        count += 1
    return count


def test_random_systems_are_solved():
    assert found_among(range(50), largest=12) == 50


@pytest.mark.slow
def test_a_thousand_random_systems_are_solved():
    assert found_among(range(1000)) >= 995


def test_units_do_not_matter():
    p, mean, covariance = random_system(4)
    units = 10.0 ** np.random.default_rng(0).uniform(-6, 6, p.n)
    scaled = p.transformed(np.diag(units), np.diag(1 / units))
    point = stationary_point(scaled)
    np.testing.assert_allclose(point.mean / units, mean, rtol=1e-8, atol=1e-9 * np.sqrt(np.diag(covariance).max()))
    np.testing.assert_allclose(
        point.covariance / np.outer(units, units), covariance, rtol=1e-7, atol=1e-9 * np.abs(covariance).max()
    )


def chain(states=16, seed=0):
    """Oscillators in a row with a cubic spring, an asymmetric damper and friction."""
    rng, m = np.random.default_rng(seed), states // 2
    K = np.diag(rng.uniform(0.5, 1.5, m)) + 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-K, -0.1 * K - 0.05 * np.eye(m)]])
    b, C = np.zeros((states, 3)), np.zeros((3, states))
    for j, place in enumerate((0, m + m // 2, states - 1)):
        C[j, place] = 1
        b[m + place % m, j] = -1
    D = np.diag(np.repeat([0.0, 1.0], m))
    elements = [cubic(0.5), quadratic_damper(0.3, 0.5), coulomb(0.3)]
    return problem(A, b, C, elements, D, c=np.repeat([0.0, 0.2], m))


def test_thirty_random_starts_on_a_chain_give_one_solution():
    p = chain()
    expected = stationary_point(p)
    rng = np.random.default_rng(0)
    for _ in range(30):
        M = rng.standard_normal((16, 16)) * 10 ** rng.uniform(-2, 1)
        point = stationary_point(p, (3 * rng.standard_normal(16), M @ M.T / 16))
        np.testing.assert_allclose(point.covariance, expected.covariance, atol=1e-10)


def test_every_rung_reaches_the_solution():
    p = chain(8)
    expected = stationary_point(p)
    small = 1e-8 * np.eye(8)
    for attempt in (
        newton(p, (np.zeros(8), np.eye(8))),
        follow(p, (np.zeros(8), small)),
        follow(p, (np.zeros(8), small), limit=600, tolerance=0.05),
    ):
        assert attempt.converged, str(attempt)
        np.testing.assert_allclose(attempt.best.covariance, expected.covariance, atol=1e-9)


def test_the_point_says_how_it_was_found():
    point = stationary_point(chain(8))
    assert "converged" in point.path[-1]
    assert point.residual < 1e-12
    assert point.error < 1e-10
    assert len(point.eigenvalues) == 8
    assert np.all(np.diff(np.real(point.eigenvalues)) <= 1e-12)


def test_stability_is_that_of_the_moment_equations():
    for p in (chain(8), oscillator(stiffness=[cubic()]), scalar(cubic(), 0.1, a=1.0)):
        for point in (stationary_point(p),):
            eigenvalues = np.linalg.eigvals(moment_jacobian(p, point.mean, point.covariance))
            assert point.stable == bool(eigenvalues.real.max() < 0)
            np.testing.assert_allclose(point.judgement.rightmost.real, eigenvalues.real.max(), rtol=1e-8)


# -- several solutions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("Q", "stable", "unstable"), [(0.1, 3, 2), (0.3, 3, 2), (0.4, 1, 0)])
def test_all_solutions_of_the_bistable_equation(Q, stable, unstable):
    points = stationary_points(scalar(cubic(), Q, a=1.0))
    assert [p.stable for p in points] == [True] * stable + [False] * unstable
    for point in points:
        m, s = point.mean[0], point.covariance[0, 0]
        np.testing.assert_allclose([m - m**3 - 3 * m * s, 2 * (1 - 3 * (m * m + s)) * s + Q], 0, atol=1e-12)


def test_the_start_decides_between_two_wells():
    p = scalar(cubic(), 0.1, a=1.0)
    for side in (-1.0, 1.0):
        point = stationary_point(p, (np.array([side]), np.zeros((1, 1))))
        np.testing.assert_allclose(point.mean, [0.958295368488775 * side], rtol=1e-11)


def test_solutions_a_period_apart_count_once():
    points = stationary_points(scalar(sine(), 0.5, load=0.2))
    assert [p.stable for p in points] == [True, False]
    assert abs(points[0].mean[0]) < np.pi


def test_all_solutions_of_a_linear_system_is_one():
    assert len(stationary_points(oscillator())) == 1


# -- none -----------------------------------------------------------------------------------------------------


def test_a_phase_locked_loop_above_its_threshold():
    held = scalar(sine(), 4 / np.e - 0.01)
    np.testing.assert_allclose(stationary_point(held).covariance[0, 0], 2, atol=0.3)
    lost = replace(scalar(sine(), 4 / np.e + 0.01), states=("phase",))
    with pytest.raises(SolverError, match=r"(?s)`phase`.* is undamped.*Tried: .*Best residual") as caught:
        stationary_point(lost)
    assert caught.value.details["residual"] > 1e-4
    assert len(caught.value.details["tried"]) > 5


def test_negative_damping_is_named():
    p = replace(oscillator(c=-0.1), states=("x", "v"))
    with pytest.raises(SolverError, match=r"growing eigenvalue 0\.05 ± 0\.999i.*negative damping"):
        stationary_point(p)
    p = replace(oscillator(c=-0.1, damping=[saturation(0.05)]), states=("x", "v"))
    with pytest.raises(SolverError, match="negative damping") as caught:
        stationary_point(p)
    assert caught.value.details["eigenvalue"].real > 0


def test_a_run_away_is_no_solution_however_small_its_residual():
    # The damper sees an undamped mass and acts on another one: the first one's variance grows for ever.
    p = problem(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 0], [0, -3, 0, -0.1]],
        np.array([[0, 0, 0, -1]]).T,
        [[0, 0, 1, 1]],
        [coulomb(1e-3)],
        np.diag([0, 0, 1.0, 1.0]),
    )
    with pytest.raises(SolverError):
        stationary_point(p)


# -- what drifts ----------------------------------------------------------------------------------------------

M_S, M_U, K_S, K_T, C_S = 250.0, 40.0, 16e3, 160e3, 1e3
ROAD = 2 * np.pi**2 * 0.01 * 256e-6 * 20


def quarter_car(damper=0.0, cutoff=0.0):
    """States zs, zu, vs, vu, h; the road is integrated white noise, or has a corner."""
    A = np.zeros((5, 5))
    A[0, 2] = A[1, 3] = 1
    A[2, :4] = np.array([-K_S, K_S, -C_S, C_S]) / M_S
    A[3] = np.array([K_S, -K_S - K_T, C_S, -C_S, K_T]) / M_U
    A[4, 4] = -cutoff
    b = damper * np.array([[0, 0, -1 / M_S, 1 / M_U, 0]]).T
    return problem(A, b, [[0, 0, 1, -1, 0]], [quadratic_damper(1, 0.3)], np.diag([0, 0, 0, 0, ROAD]))


@pytest.mark.parametrize("damper", [0.0, 500.0])
def test_what_does_not_drift_on_an_integrated_road_is_stationary(damper):
    point = stationary_point(quarter_car(damper))
    near = stationary_point(quarter_car(damper, cutoff=1e-5))
    assert list(point.drifting) == [True, True, False, False, True]
    assert point.stable
    for form in ([1, -1, 0, 0, 0], [0, 1, 0, 0, -1], [0, 0, 1, 0, 0]):
        form = np.array(form)
        np.testing.assert_allclose(form @ point.mean, form @ near.mean, rtol=1e-5, atol=1e-12)
        np.testing.assert_allclose(form @ point.covariance @ form, form @ near.covariance @ form, rtol=1e-5)


def test_the_place_of_a_mass_with_friction_alone_drifts():
    point = stationary_point(oscillator(c=0.0, k=0.0, damping=[coulomb(0.5)]))
    assert list(point.drifting) == [True, False]
    np.testing.assert_allclose(point.covariance[1, 1], np.pi * 0.4**2 / (8 * 0.5**2), rtol=1e-12)


def test_a_chain_of_integrators_drifts_and_what_drives_it_does_not():
    A = np.diag([1.0, 1.0, 1.0], 1)
    A[3, 3] = -1.0
    point = stationary_point(problem(A, np.zeros((4, 0)), np.zeros((0, 4)), [], np.diag([0, 0, 0, 1.0])))
    assert list(point.drifting) == [True, True, True, False]
    np.testing.assert_allclose(point.covariance[3, 3], 0.5)


def test_an_undamped_oscillation_drifts():
    A = [[0, 1, 0], [-4, 0, 0], [0, 0, -1]]
    p = problem(A, [[0], [0], [-1]], [[0, 0, 1]], [cubic()], np.diag([0, 1, 1.0]))
    point = stationary_point(p)
    assert list(point.drifting) == [True, True, False]


def test_a_slow_state_does_not_drift():
    point = stationary_point(problem([[-1e-7, 0], [1, -100]], np.zeros((2, 0)), np.zeros((0, 2)), [], np.eye(2)))
    assert not point.drifting.any()
    np.testing.assert_allclose(point.covariance[0, 0], 5e6, rtol=1e-8)


def test_nothing_stationary_is_an_error():
    p = problem([[0, 1], [0, 0]], np.zeros((2, 0)), np.zeros((0, 2)), [], np.diag([0, 1.0]))
    with pytest.raises(SolverError, match="No state has stationary moments"):
        stationary_point(p)


def test_an_element_that_sees_the_drift_is_an_error():
    p = problem([[0, 0], [0, -1]], [[0], [-1]], [[1, 1]], [cubic()], np.eye(2))
    with pytest.raises(SolverError):
        stationary_point(replace(p, states=("walk", "x")))


def test_a_frozen_state_keeps_its_value():
    p = problem([[-1, 1], [0, 0]], [[-1], [0]], [[1, 0]], [bilinear()], [[1, 0], [0, 0]])
    point = stationary_point(p, (np.array([0, 0.5]), np.zeros((2, 2))))
    loaded = stationary_point(scalar(bilinear(), 1.0, a=-1.0, load=0.5))
    np.testing.assert_allclose(point.mean, [loaded.mean[0], 0.5])
    np.testing.assert_allclose(point.covariance, [[loaded.covariance[0, 0], 0], [0, 0]], atol=1e-12)


def test_a_vehicle_whose_forces_are_all_elements_is_found_from_its_start():
    """The linear part alone passes none of the ground on: gas spring, oleo, friction and a tyre that lifts off."""
    model = toml("""
        name = "nose gear at constant speed"
        [parameters]
        M = 4000.0
        mu = 120.0
        g = 9.81
        [elements.gas]
        arguments = ["z"]
        value = "15000*(0.35/(0.35 - clip(z, -0.05, 0.30)))**1.3"
        [elements.oleo]
        arguments = ["w"]
        value = "9000*w**2 if w > 0 else -30000*w**2"
        [rates]
        zs = "vs"
        vs = "-g + (gas(zu - zs) + oleo(vu - vs) + 800*tanh(50*(vu - vs)))/M"
        zu = "vu"
        vu = "-g - (gas(zu - zs) + oleo(vu - vs) + 800*tanh(50*(vu - vs)))/mu + 1.2e6*max(h - zu, 0)/mu"
        [contacts]
        h = {}
        [ground]
        kind = "iso8608"
        gd = 16e-6
        cutoff = 0.05
        rolling_contact = 5.0
        [travel]
        speed = "20"
        [initial]
        zs = -0.25
        zu = -0.0337
        [run]
        duration = 40.0
    """)
    compiled = cs.compile(model)
    fixed, end = compiled.stationary(), compiled.propagate(times=[0.0, 40.0])
    assert fixed.stable
    assert len(fixed.path) == 1, "the first attempt finds it"
    sigma = np.sqrt(np.diag(fixed.state_covariance))
    assert np.abs((fixed.state_mean - end.state_mean[-1]) / sigma).max() < 1e-6
    assert np.abs((fixed.state_covariance - end.state_covariance[-1]) / np.outer(sigma, sigma)).max() < 1e-6


# -- wheels in one track --------------------------------------------------------------------------------------


def two_wheels(time: float, elements=(), A=None):
    """Two masses on one road, each with its own filter copy (states 0-1, 2-3; filters 4, 5)."""
    if A is None:
        A = np.zeros((6, 6))
        A[0, 1] = A[2, 3] = 1.0
        A[1, :4] = [-5.0, -0.6, 1.0, 0.1]
        A[3, :4] = [1.0, 0.1, -6.0, -0.5]
        A[1, 4] = A[3, 5] = 3.0
        A[4, 4] = A[5, 5] = -0.7
    inputs = np.eye(6)[:, 4:5], np.eye(6)[:, 5:6]
    V, Q = 2.0, np.array([[0.8]])
    D = V * sum(b @ Q @ b.T for b in inputs)
    b, C = np.zeros((6, len(elements))), np.zeros((len(elements), 6))
    for j in range(len(elements)):
        b[1, j], b[3, j] = -1.0, 1.0
        C[j, [0, 2] if j % 2 == 0 else [1, 3]] = 1.0, -1.0
    return problem(A, b, C, elements, D, tracks=(WheelTrack(V, (time,), inputs, Q),))


ELEMENTS = [cubic(0.5), quadratic_damper(0.4, 0.2)]


@pytest.mark.parametrize("elements", [[], ELEMENTS])
def test_wheels_at_one_place_feel_one_noise(elements):
    p = two_wheels(1e-12, elements)
    both = np.sum(p.tracks[0].inputs, axis=0)
    together = replace(p, tracks=(), D=2.0 * both @ p.tracks[0].intensity @ both.T)
    point, expected = stationary_point(p), stationary_point(together)
    np.testing.assert_allclose(point.covariance, expected.covariance, atol=1e-10)


def test_wheels_far_apart_are_not_correlated():
    p = two_wheels(200.0, ELEMENTS)
    np.testing.assert_allclose(stationary_point(p).covariance, stationary_point(replace(p, tracks=())).covariance, atol=1e-12)


def test_the_delay_is_that_of_the_spectral_integral():
    p = two_wheels(1.3)
    V, Q = p.tracks[0].speed, p.tracks[0].intensity[0, 0]
    omega = np.linspace(-400, 400, 160001)
    total = np.zeros((6, 6))
    for part in np.array_split(omega, 40):
        transfer = np.linalg.inv(1j * part[:, None, None] * np.eye(6) - p.A)
        h = transfer[:, :, 4] + transfer[:, :, 5] * np.exp(-1j * part * 1.3)[:, None]
        total += np.einsum("ka,kb->ab", h, h.conj()).real * (omega[1] - omega[0])
    found = stationary_point(p).covariance
    np.testing.assert_allclose(found[:4, :4], (V * Q / (2 * np.pi) * total)[:4, :4], atol=1e-5)


def test_the_delay_enters_the_equations_with_the_equivalent_gains():
    p = two_wheels(0.9, ELEMENTS)
    point = stationary_point(p)
    at = evaluate(replace(p, tracks=()), point.mean, point.covariance)
    track = p.tracks[0]
    half = track.speed * expm(at.N * 0.9) @ track.inputs[0] @ track.intensity @ track.inputs[1].T
    np.testing.assert_allclose(at.R + half + half.T, 0, atol=1e-11)
    assert point.stable
    assert np.linalg.eigvalsh(point.covariance)[0] > 0


def test_delayed_wheels_converge_quadratically():
    p = two_wheels(0.9, [cubic(5.0), quadratic_damper(2.0, 0.2)])
    attempt = newton(p, (np.zeros(6), np.eye(6)))
    assert attempt.converged
    assert attempt.iterations <= 8
    # a matrix without eigenvectors takes the derivative of one next to it
    A = two_wheels(0.9).A.copy()
    A[:4, :4] = [[-1, 1, 0, 0], [0, -1, 1, 0], [0, 0, -1, 1], [0, 0, 0, -1]]
    A[4, 4] = A[5, 5] = -1
    A[0, 4] = A[0, 5] = 0
    point = stationary_point(two_wheels(0.9, [cubic(0.1)], A))
    assert point.residual < 1e-13


def test_the_stability_of_delayed_wheels_is_that_of_the_whole_system():
    """The wheels' correlation on a grid, with the moments, as one big linear system: its rightmost eigenvalue."""
    p = two_wheels(0.6, [cubic(0.5)])
    point = stationary_point(p)
    at = evaluate(p, point.mean, point.covariance)
    at = replace(at, gain_slope=6.0 * at.gain_slope)
    judged = stability(LinearisedMoments(at))
    big = np.linalg.eigvals(_whole_jacobian(at, steps=12))
    assert judged.stable == bool(big.real.max() < 0)


def _whole_jacobian(at, steps: int) -> np.ndarray:
    """Jacobian of means, covariances and G at Chebyshev-Lobatto nodes between the wheels; the gains' slope as given."""
    p, track = at.problem, at.problem.tracks[0]
    n, K = p.n, len(p.C)
    k = np.arange(steps + 1)
    x = -np.cos(np.pi * k / steps)  # -1 at the first wheel
    weights = np.where((k == 0) | (k == steps), 2.0, 1.0) * (-1.0) ** k
    D = np.outer(weights, 1 / weights) / (x[:, None] - x + np.eye(steps + 1))
    D -= np.diag(D.sum(axis=1))
    D *= 2 / track.times[0]
    G = np.array([expm(at.N * track.times[0] * (xi + 1) / 2) @ track.inputs[0][:, 0] for xi in x])
    rows, columns = np.triu_indices(n)
    size = n + len(rows) + n * steps
    J = np.zeros((size, size))
    for j in range(size):
        y = np.zeros(size)
        y[j] = 1.0
        dmu, dP, dG = y[:n], np.zeros((n, n)), np.zeros((steps + 1, n))
        dP[rows, columns] = dP[columns, rows] = y[n : n + len(rows)]
        dG[1:] = y[n + len(rows) :].reshape(steps, n)
        spread = p.C @ dP @ p.C.T
        dtheta = np.concatenate([p.C @ dmu, spread[p.pairs[0], p.pairs[1]]])
        dN = p.columns @ ((at.gain_slope @ dtheta)[:, None] * p.C)
        half = at.N @ dP + dN @ at.covariance
        half = half + track.speed * track.intensity[0, 0] * np.outer(dG[-1], track.inputs[1][:, 0])
        flow = dG @ at.N.T + G @ dN.T - D @ dG
        J[:, j] = np.concatenate([p.A @ dmu + p.b @ (at.F_slope @ dtheta), (half + half.T)[rows, columns], flow[1:].ravel()])
    assert K
    return J


def half_car(cutoff=0.0, elements=()):
    """Heave and pitch in absolute coordinates (states z, theta, their rates, h1, h2), one track, speed 20."""
    M, J, k, c, front, back, V = 1000.0, 1500.0, 20e3, 2e3, 1.2, 1.5, 20.0
    A = np.zeros((6, 6))
    A[0, 2] = A[1, 3] = 1
    for arm, height in ((front, 4), (-back, 5)):
        force = np.array([-k, -k * arm, -c, -c * arm, 0, 0])
        force[height] = k
        A[2] += force / M
        A[3] += arm * force / J
    A[4, 4] = A[5, 5] = -cutoff * V
    inputs, Q = (np.eye(6)[:, 4:5], np.eye(6)[:, 5:6]), np.array([[ROAD / 20]])
    D = V * sum(b @ Q @ b.T for b in inputs)
    b, C = np.zeros((6, len(elements))), np.zeros((len(elements), 6))
    for j in range(len(elements)):
        b[2, j], C[j, 2] = -1.0, 1.0
    tracks = (WheelTrack(V, ((front + back) / V,), inputs, Q),)
    return problem(A, b, C, elements, D, tracks=tracks, states=("z", "theta", "w", "q", "h1", "h2"))


def pitch_by_the_spectrum(p):
    """V Q / pi times the integral of |theta / w|^2 over frequencies, in pieces short against 1 / delay."""
    V, Q, delay = p.tracks[0].speed, p.tracks[0].intensity[0, 0], p.tracks[0].times[0]
    edges = np.concatenate([[1e-9], np.geomspace(1e-4, 10, 60), np.linspace(10, 400, 800)[1:]])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    widths = np.diff(edges)
    omega = (edges[:-1, None] + widths[:, None] * (nodes + 1) / 2).ravel()
    both = np.zeros((len(omega), 6), dtype=complex)
    both[:, 4], both[:, 5] = 1, np.exp(-1j * omega * delay)
    answer = np.linalg.solve(1j * omega[:, None, None] * np.eye(6) - p.A, both[:, :, None])[:, 1, 0]
    return V * Q / np.pi * np.sum(np.abs(answer) ** 2 * (widths[:, None] * weights / 2).ravel())


def test_the_pitch_of_a_vehicle_on_an_integrated_road_does_not_drift():
    p = half_car()
    point = stationary_point(p)
    assert [name for name, drifts in zip(p.states, point.drifting, strict=True) if drifts] == ["z", "h1", "h2"]
    assert point.stable
    np.testing.assert_allclose(point.covariance[1, 1], pitch_by_the_spectrum(p), rtol=1e-6)
    between = np.array([0, 0, 0, 0, 1.0, -1.0])  # the road between the wheels: V tau Q
    np.testing.assert_allclose(between @ point.covariance @ between, ROAD / 20 * 2.7, rtol=1e-12)


@pytest.mark.parametrize("elements", [(), (quadratic_damper(300.0, 0.3),)])
def test_what_wheels_keep_together_is_the_limit_of_a_road_with_a_corner(elements):
    point, near = stationary_point(half_car(0.0, elements)), stationary_point(half_car(1e-7, elements))
    forms = np.array([[0, 1, 0, 0, 0, 0], [1, 0, 0, 0, -1, 0], [0, 0, 0, 1, 0, 0], [1, 1.2, 0, 0, -1, 0], [0, 0, 0, 0, 1, -1]])
    np.testing.assert_allclose(forms @ point.covariance @ forms.T, forms @ near.covariance @ forms.T, rtol=2e-5, atol=1e-12)
    np.testing.assert_allclose(forms @ point.mean, forms @ near.mean, atol=1e-6)


def test_the_heights_under_two_wheels_drift_apart_if_their_tracks_are_two():
    p = half_car()
    alone = replace(p, tracks=())
    assert list(stationary_point(alone).drifting) == [True, True, False, False, True, True]
