"""One decomposition, many Lyapunov equations: modal and Schur form against the equation itself."""

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_continuous_lyapunov

from cadet_sym.errors import SolverError
from cadet_sym.solve.lyapunov import ModalForm, SchurForm, decompose, modal_form, nearby_modal_form, schur_form


def hurwitz(n: int, seed: int = 0) -> np.ndarray:
    M = np.random.default_rng(seed).standard_normal((n, n)) / np.sqrt(n)
    return M - (np.linalg.eigvals(M).real.max() + 0.3) * np.eye(n)


def symmetric(n: int, seed: int = 1) -> np.ndarray:
    R = np.random.default_rng(seed).standard_normal((n, n))
    return R + R.T


REAL = np.diag([-1.0, -2.0, -3.5]) + np.diag([0.5, 0.5], 1)
MATRICES = {"pairs": hurwitz(8), "odd": hurwitz(7, 3), "real": REAL, "one": np.array([[-0.7]])}
FORMS = {"modal": modal_form, "schur": schur_form}


@pytest.fixture(params=MATRICES, name="N")
def _matrix(request):
    return MATRICES[request.param]


@pytest.fixture(params=FORMS, name="form")
def _form(request, N):
    return FORMS[request.param](N)


def test_the_lyapunov_equation_is_solved(form, N):
    R = symmetric(len(N))
    X = form.leave(form.divide(form.enter(R)))
    np.testing.assert_allclose(X, solve_continuous_lyapunov(N, -R), atol=1e-11)
    assert np.isrealobj(X)


def test_the_adjoint_equation_is_solved(form, N):
    R = symmetric(len(N))
    X = form.adjoint(R)
    np.testing.assert_allclose(N.T @ X + X @ N, -R, atol=1e-11)
    x = np.arange(1.0, len(N) + 1)
    np.testing.assert_allclose(N.T @ form.adjoint_vector(x), x, atol=1e-11)


@pytest.mark.parametrize("shift", [0.0, 0.3, 25.0])
def test_a_shift_is_a_shift_of_the_operator(form, N, shift):
    R = symmetric(len(N))
    X = form.leave(form.divide(form.enter(R), shift))
    np.testing.assert_allclose(N @ X + X @ N.T - shift * X, -R, atol=1e-11)
    x = np.arange(1.0, len(N) + 1)[:, None]
    y = form.leave_vector(form.divide_vector(form.enter_vector(x), shift))
    np.testing.assert_allclose((N - shift * np.eye(len(N))) @ y, x, atol=1e-11)


def test_responses_are_forms_of_solutions(form, N):
    rng = np.random.default_rng(2)
    n = len(N)
    C, b, v = rng.standard_normal((3, n)), rng.standard_normal((n, 4)), rng.standard_normal((n, 4))
    pairs = np.array([[0, 1, 2, 2], [0, 0, 1, 2]])
    found = form.respond(form.enter_form(C), pairs, form.enter_vector(b), form.enter_vector(v))
    for i in range(4):
        half = np.outer(b[:, i], v[:, i])
        X = solve_continuous_lyapunov(N, -(half + half.T))
        np.testing.assert_allclose(found[:, i], (C @ X @ C.T)[pairs[0], pairs[1]], atol=1e-11)


def test_the_eigenvalues_are_those_of_the_matrix(form, N):
    np.testing.assert_allclose(
        np.sort_complex(form.eigenvalues), np.sort_complex(np.linalg.eigvals(N).astype(complex)), atol=1e-10
    )


def test_a_matrix_without_eigenvectors_goes_to_schur():
    jordan = block_diag(-np.eye(5) + np.eye(5, k=1), [[-2.0]])
    form = decompose(jordan)
    assert isinstance(form, SchurForm)
    R = symmetric(6)
    X = form.leave(form.divide(form.enter(R)))
    np.testing.assert_allclose(jordan @ X + X @ jordan.T, -R, atol=1e-10)


def test_a_matrix_with_eigenvectors_goes_to_modes():
    assert isinstance(decompose(hurwitz(12)), ModalForm)


def test_a_matrix_near_one_without_eigenvectors_has_some():
    jordan = -np.eye(5) + np.eye(5, k=1)
    form = nearby_modal_form(jordan)
    np.testing.assert_allclose(form.matrix, jordan, atol=1e-7)
    assert form.condition < 1e10


@pytest.mark.parametrize("form", FORMS.values())
def test_a_singular_equation_gives_large_numbers_and_no_infinite_ones(form):
    undamped = np.array([[0.0, 1.0], [-1.0, 0.0]])
    decomposition = form(undamped)
    with np.errstate(all="raise"):
        X = decomposition.leave(decomposition.divide(decomposition.enter(np.eye(2))))
    assert np.isfinite(X).all()
    assert np.abs(X).max() > 1e10


def test_what_is_not_finite_is_refused():
    with pytest.raises(SolverError, match="not finite"):
        decompose(np.array([[np.nan]]))
