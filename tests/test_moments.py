"""The moment equations: packing, linear systems against closed forms, positive semidefinite throughout."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_models import toml
from scipy.linalg import expm, solve_continuous_lyapunov

import cadet_sym as cs
from cadet_sym.packing import Packing


@given(st.integers(1, 6), st.integers(0, 50))
def test_packing_is_undone_by_unpacking(n, seed):
    rng = np.random.default_rng(seed)
    mean, half = rng.normal(size=n), rng.normal(size=(n, n))
    packing = Packing(n)
    y = packing.pack(mean, half + half.T)
    assert y.shape == (packing.size,)
    again = packing.unpack(y)
    np.testing.assert_array_equal(again[0], mean)
    np.testing.assert_array_equal(again[1], half + half.T)
    for times in (0, 3):  # none, where a run breaks down before its first output time
        many = packing.unpack(np.tile(y, (times, 1)))
        assert [part.shape for part in many] == [(times, n), (times, n, n)]


def linear(A: np.ndarray, b: np.ndarray, x0: np.ndarray) -> cs.Model:
    n = len(A)
    rates = "\n".join(
        f'x{i} = "{" + ".join(f"({float(A[i, j])!r})*x{j}" for j in range(n))} + ({float(b[i])!r})*w"' for i in range(n)
    )
    start = "\n".join(f"x{i} = {float(x0[i])!r}" for i in range(n))
    return toml(f'name = "linear"\n[rates]\n{rates}\n[noise]\nw = 1.0\n[initial]\n{start}\n[run]\nduration = 3.0\n')


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 4), st.integers(0, 10_000))
def test_a_linear_model_obeys_lyapunovs_equation(n, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    b, x0 = rng.normal(size=n), rng.normal(size=n)
    times = np.array([0.4, 3.0])
    history = cs.compile(linear(A, b, x0)).propagate(times, rtol=1e-11)
    stationary = solve_continuous_lyapunov(A, -np.outer(b, b))
    for k, t in enumerate(times):
        flow = expm(A * t)
        scale = np.abs(stationary).max()
        np.testing.assert_allclose(history.state_mean[k], flow @ x0, atol=1e-8 * np.abs(x0).max())
        np.testing.assert_allclose(
            history.state_covariance[k], stationary - flow @ stationary @ flow.T, atol=1e-8 * scale
        )


def test_correlated_noises_that_vary_in_time():
    model = toml(
        """
        name = "two noises"
        [parameters]
        q = 2.0
        [rates]
        x = "w1"
        y = "3*w2"
        [noise]
        names = ["w1", "w2"]
        intensity = [["q", "0.5*t"], ["0.5*t", "1"]]
        [run]
        duration = 1.0
        """
    )
    history = cs.compile(model).propagate([2.0], rtol=1e-10)
    np.testing.assert_allclose(history.state_covariance[0], [[4.0, 3.0], [3.0, 18.0]], rtol=1e-9)


@pytest.mark.parametrize("restoring", ["-x - x**3 - 0.1*v", "-x - 0.5*sign(v)", "-x - abs(v)*v", "-sin(x) - 0.2*v"])
def test_the_covariance_stays_positive_semidefinite(restoring):
    model = toml(f'name = "psd"\n[rates]\nx = "v"\nv = "{restoring} + w"\n[noise]\nw = 0.3\n[run]\nduration = 20.0\n')
    history = cs.compile(model).propagate(rtol=1e-6)
    covariance = history.state_covariance
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    lowest = np.linalg.eigvalsh(covariance)[:, 0]
    assert (lowest >= -1e-9 * np.maximum(np.trace(covariance, axis1=1, axis2=2), 1e-300)).all()


def test_the_rate_is_what_the_symbols_say():
    model = toml('name = "d"\n[rates]\nx = "v"\nv = "-x - x**3 - v + w"\n[noise]\nw = 0.5\n[run]\nduration = 1.0\n')
    equations = cs.moment_equations(cs.linearise(cs.augment(model)))
    assert equations.states == ("x", "v")
    assert "dot P" in equations._repr_latex_()
    compiled = cs.compile(model)
    mean, P = np.array([0.2, -0.1]), np.array([[0.5, 0.1], [0.1, 0.8]])
    y = equations.packing.pack(mean, P)
    rate = np.asarray(compiled.functions.rate(0.0, y, np.zeros(0))).ravel()
    gain = 3 * (mean[0] ** 2 + P[0, 0])
    N = np.array([[0.0, 1.0], [-1.0 - gain, -1.0]])
    covariance_rate = N @ P + P @ N.T + np.diag([0.0, 0.5])
    third = mean[0] ** 3 + 3 * mean[0] * P[0, 0]
    expected = equations.packing.pack(np.array([mean[1], -mean[0] - third - mean[1]]), covariance_rate)
    np.testing.assert_allclose(rate, expected, rtol=1e-13)
