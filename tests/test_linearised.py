"""The linearised moment equations against differences of the equations themselves."""

from dataclasses import replace

import numpy as np
import pytest
from stationary_systems import SquareTimes, coulomb, cubic, moment_jacobian, problem, quadratic_damper

from cadet_sym.solve import stability as stability_module
from cadet_sym.solve.frozen import Evaluation, WheelTrack, evaluate
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.lyapunov import modal_form, schur_form
from cadet_sym.solve.nyquist import Response, count_unstable, rightmost

RNG = np.random.default_rng(0)
n = 6
PLAIN = problem(
    0.3 * RNG.standard_normal((n, n)) - 1.5 * np.eye(n),
    0.03 * RNG.standard_normal((n, 4)),
    0.2 * RNG.standard_normal((5, n)),
    [cubic(), coulomb(), quadratic_damper(1, 0.3), SquareTimes()],
    np.eye(n),
    owner=[0, 1, 2, 3, 3],
    d=RNG.standard_normal(5),
)
TRACK = WheelTrack(
    2.0, (0.3, 0.2), tuple(RNG.standard_normal((n, 2)) for _ in range(3)), np.array([[1.0, 0.2], [0.2, 0.5]])
)
PROBLEMS = {"plain": PLAIN, "three wheels": replace(PLAIN, tracks=(TRACK,))}


def anywhere(p) -> Evaluation:
    rng = np.random.default_rng(1)
    M = rng.standard_normal((p.n, p.n))
    return evaluate(p, rng.standard_normal(p.n), M @ M.T / p.n)


def difference(at: Evaluation, step, h: float = 1e-6) -> tuple[np.ndarray, np.ndarray]:
    ends = [evaluate(at.problem, at.mean + s * h * step[0], at.covariance + s * h * step[1]) for s in (1, -1)]
    return (ends[0].r - ends[1].r) / (2 * h), (ends[0].R - ends[1].R) / (2 * h)


@pytest.fixture(params=PROBLEMS, name="at")
def _at(request):
    return anywhere(PROBLEMS[request.param])


@pytest.fixture(params=[modal_form, schur_form], name="lin")
def _lin(request, at):
    lin = LinearisedMoments(at)
    lin.__dict__["form"] = request.param(at.N)
    return lin


def sides(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    R = rng.standard_normal((n, n))
    return rng.standard_normal(n), R + R.T


def test_a_step_undoes_the_residuals_to_first_order(at, lin):
    r, R = sides(2)
    dr, dR = difference(at, lin.solve(r, R))
    np.testing.assert_allclose(dr, -r, atol=1e-8)
    np.testing.assert_allclose(dR, -R, atol=1e-8)


def test_a_shifted_step_is_an_implicit_one(at, lin):
    if at.problem.tracks:
        return  # there the shift leaves the delays alone: any step does for a pseudo-transient
    dmu, dP = lin.step(0.7)
    dr, dR = difference(at, (dmu, dP))
    np.testing.assert_allclose(dr - 0.7 * dmu, -at.r, atol=1e-8)
    np.testing.assert_allclose(dR - 0.7 * dP, -at.R, atol=1e-8)


def test_a_bordered_step_keeps_to_its_row(at, lin):
    r, R = sides(2)
    slope, row = sides(3), np.random.default_rng(4).standard_normal(len(at.theta))
    dmu, dP, dp, dtheta = lin.bordered(r, R, slope, row, 0.7, 0.3)
    dr, dR = difference(at, (dmu, dP))
    np.testing.assert_allclose(dr + dp * slope[0], -r, atol=1e-8)
    np.testing.assert_allclose(dR + dp * slope[1], -R, atol=1e-8)
    np.testing.assert_allclose(row @ dtheta + 0.7 * dp, 0.3, atol=1e-12)


def test_the_adjoint_is_the_transpose(lin):
    (r, R), (g, G) = sides(2), sides(5)
    dmu, dP = lin.solve(r, R)
    a, L = lin.adjoint(g, G)
    np.testing.assert_allclose(g @ dmu + np.sum(G * dP), -(a @ r + np.sum(L * R)), rtol=1e-11)


def test_the_dense_jacobian_is_the_one_by_definition():
    at = anywhere(PLAIN)
    found = stability_module.moment_jacobian(at)
    rows, columns = np.tril_indices(n)  # the reference is ordered row by row
    place = {pair: i for i, pair in enumerate(zip(rows, columns, strict=True))}
    order = [place[i, j] for j, i in zip(*np.triu_indices(n), strict=True)]
    order = np.concatenate([np.arange(n), n + np.array(order)])
    np.testing.assert_allclose(found, moment_jacobian(PLAIN, at.mean, at.covariance)[np.ix_(order, order)], atol=1e-12)


@pytest.mark.parametrize("amplification", [0.3, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("seed", range(4))
def test_nyquists_count_is_that_of_the_eigenvalues(seed, amplification):
    rng = np.random.default_rng(seed)
    A = 0.5 * rng.standard_normal((n, n)) - 1.5 * np.eye(n)
    p = replace(PLAIN, A=A, b=0.1 * rng.standard_normal((n, 4)))
    at = anywhere(p)
    at = replace(at, covariance=0.3 * at.covariance, gain_slope=amplification * at.gain_slope)
    if np.linalg.eigvals(at.N).real.max() > 0:
        return  # nothing to count: unstable already
    eigenvalues = np.linalg.eigvals(stability_module.moment_jacobian(at))
    form = modal_form(at.N)
    assert form is not None
    response = Response(at, form)
    assert count_unstable(response) == np.sum(eigenvalues.real > 0)
    found = rightmost(response, bool(eigenvalues.real.max() < 0))
    np.testing.assert_allclose(found.real, eigenvalues.real.max(), rtol=1e-6)
