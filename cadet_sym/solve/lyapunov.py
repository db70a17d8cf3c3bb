"""Solve N X + X N^T - shift X = -R for many right-hand sides with one decomposition of N.

Two decompositions, one interface. In the coordinates X~ of the decomposition (X = right X~ right^T, R~ = left R left^T)
the operator is diagonal (`ModalForm`, N = V diag(l) V^-1) or triangular (`SchurForm`, N = U T U^T; Bartels & Stewart,
Comm. ACM 15, 820, 1972). The modal form costs a third of the Schur form once there are several right-hand sides, and
loses as many digits as the eigenvectors' condition number has; `decompose` takes it while that is harmless.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadet_sym.errors import SolverError

__all__ = ["ModalForm", "SchurForm", "decompose", "modal_form", "nearby_modal_form", "schur_form"]

Array = np.ndarray

CONDITION_LIMIT = 1e5  # of the eigenvectors: a step in modal form is good to about 1e-16 times its square
NEARBY_LIMIT = 1e7
NEARBY = 1e-9  # of the norm of N: how far away a matrix with usable eigenvectors is looked for


@dataclass(frozen=True)
class ModalForm:
    """N = V diag(l) V^-1, held as LAPACK gives it: a real basis W, where a pair of columns spans a complex pair."""

    matrix: Array  # (n, n) N
    eigenvalues: Array  # (n,) complex l
    basis: Array  # (n, n) real W; V = W S with S the 2 x 2 blocks [[1, 1], [i, -i]]
    inverse: Array  # (n, n) real W^-1
    first: Array  # indices of the first member of each complex pair
    condition: float

    def enter(self, R: Array) -> Array:
        """V^-1 R V^-T of a matrix (n, n)."""
        return self._split(self._split(self.inverse @ R @ self.inverse.T).T).T

    def enter_vector(self, x: Array) -> Array:
        """V^-1 x of columns (n, k)."""
        return self._split(self.inverse @ x)

    def enter_form(self, C: Array) -> Array:
        """C V of rows (k, n), so that C X C^T = (C V) X~ (C V)^T."""
        rows = (C @ self.basis).astype(complex)
        first, second = rows[:, self.first], rows[:, self.first + 1]
        rows[:, self.first], rows[:, self.first + 1] = first + 1j * second, first - 1j * second
        return rows

    def leave(self, X: Array) -> Array:
        """V X~ V^T, real."""
        return self.basis @ np.real(self._join(self._join(X).T).T) @ self.basis.T

    def leave_vector(self, x: Array) -> Array:
        """V x~, real."""
        return self.basis @ np.real(self._join(x))

    def denominators(self, shift: complex = 0.0) -> Array:
        """l_p + l_q - shift (n, n); a vanishing one is replaced by the smallest that is safe to divide by."""
        return _floored(self.eigenvalues[:, None] + self.eigenvalues - shift, self._tiny)

    def divide(self, R: Array, shift: float = 0.0) -> Array:
        """X~ of N X + X N^T - shift X = -R, both in modal coordinates."""
        return R * self._inverses if shift == 0.0 else R / -self.denominators(shift)

    def divide_vector(self, x: Array, shift: complex = 0.0) -> Array:
        """(N - shift)^-1 x in modal coordinates, columns (n, k)."""
        return x / _floored(self.eigenvalues - shift, self._tiny)[:, None]

    def respond(self, C: Array, pairs: Array, b: Array, v: Array, shift: float = 0.0) -> Array:
        """C_a X_i C_b^T for all pairs (a, b) and all i, where X_i answers R_i = b_i v_i^T + v_i b_i^T.

        C (k, n), b and v (n, m) in modal coordinates, pairs (2, q). Returns (q, m); O(n^2 q m).
        """
        weights = self._inverses if shift == 0.0 else -1.0 / self.denominators(shift)
        answers = []
        for a, other in zip(C[pairs[0]], C[pairs[1]], strict=True):
            # sum_pq a_p c_q (b_p v_q + v_p b_q) / -(l_p + l_q)
            one = np.sum((a[:, None] * b) * (weights @ (other[:, None] * v)), axis=0)
            two = np.sum((a[:, None] * v) * (weights @ (other[:, None] * b)), axis=0)
            answers.append((one + two).real)
        return np.array(answers).reshape(pairs.shape[1], b.shape[1])

    def adjoint(self, R: Array) -> Array:
        """X of N^T X + X N = -R, (n, n) real."""
        inside = self._split_adjoint(self._split_adjoint(self.basis.T @ R @ self.basis).T).T
        X = inside * self._inverses
        return self.inverse.T @ np.real(self._join_adjoint(self._join_adjoint(X).T).T) @ self.inverse

    def adjoint_vector(self, x: Array) -> Array:
        """N^-T x of a vector (n,)."""
        inside = self._split_adjoint((self.basis.T @ x)[:, None])
        return (self.inverse.T @ np.real(self._join_adjoint(self.divide_vector(inside))))[:, 0]

    @cached_property
    def _inverses(self) -> Array:
        """-1 / (l_p + l_q), (n, n): every step divides by it several times."""
        return -1.0 / self.denominators()

    @cached_property
    def _tiny(self) -> float:
        return 1e-15 * float(np.abs(self.eigenvalues).max(initial=1e-300))

    def _split(self, x: Array) -> Array:
        """S^-1 x: rows of the real basis to rows of the complex one."""
        y = x.astype(complex)
        if not len(self.first):
            return y
        first, second = x[self.first], x[self.first + 1]
        y[self.first], y[self.first + 1] = 0.5 * (first - 1j * second), 0.5 * (first + 1j * second)
        return y

    def _join(self, y: Array) -> Array:
        """S y, real if the rows come in conjugate pairs."""
        if not len(self.first):
            return y
        x = y.copy()
        first, second = y[self.first], y[self.first + 1]
        x[self.first], x[self.first + 1] = first + second, 1j * (first - second)
        return x

    def _split_adjoint(self, x: Array) -> Array:
        """S^T x."""
        y = x.astype(complex)
        first, second = x[self.first], x[self.first + 1]
        y[self.first], y[self.first + 1] = first + 1j * second, first - 1j * second
        return y

    def _join_adjoint(self, y: Array) -> Array:
        """S^-T y."""
        x = y.copy()
        first, second = y[self.first], y[self.first + 1]
        x[self.first], x[self.first + 1] = 0.5 * (first + second), -0.5j * (first - second)
        return x


@dataclass(frozen=True)
class SchurForm:
    """N = U T U^T with T real, upper triangular but for 2 x 2 blocks, and U orthogonal."""

    matrix: Array
    triangle: Array  # (n, n) T
    basis: Array  # (n, n) U

    @cached_property
    def eigenvalues(self) -> Array:
        """Eigenvalues of N, (n,) complex."""
        return np.linalg.eigvals(self.triangle).astype(complex)

    def enter(self, R: Array) -> Array:
        """U^T R U."""
        return self.basis.T @ R @ self.basis

    def enter_vector(self, x: Array) -> Array:
        """U^T x."""
        return self.basis.T @ x

    def enter_form(self, C: Array) -> Array:
        """C U."""
        return C @ self.basis

    def leave(self, X: Array) -> Array:
        """U X~ U^T."""
        return self.basis @ X @ self.basis.T

    def leave_vector(self, x: Array) -> Array:
        """U x~."""
        return self.basis @ x

    def divide(self, R: Array, shift: float = 0.0) -> Array:
        """X~ of N X + X N^T - shift X = -R, both in Schur coordinates."""
        from scipy.linalg.lapack import dtrsyl

        shifted = self.triangle - 0.5 * shift * np.eye(len(self.triangle))
        X, scale, info = dtrsyl(shifted, shifted, -R, tranb="T")
        if info < 0 or scale == 0:
            raise SolverError("The Lyapunov equation could not be solved: it is singular to working precision.")
        return X / scale

    def divide_vector(self, x: Array, shift: float = 0.0) -> Array:
        """(N - shift)^-1 x in Schur coordinates."""
        shifted = self.triangle - shift * np.eye(len(self.triangle))
        try:
            return np.linalg.solve(shifted, x)
        except np.linalg.LinAlgError:
            return np.linalg.lstsq(shifted, x, rcond=None)[0]

    def adjoint(self, R: Array) -> Array:
        """X of N^T X + X N = -R, (n, n)."""
        from scipy.linalg.lapack import dtrsyl

        X, scale, _ = dtrsyl(self.triangle, self.triangle, -self.enter(R), trana="T")
        return self.leave(X / scale)

    def adjoint_vector(self, x: Array) -> Array:
        """N^-T x of a vector (n,)."""
        return np.linalg.solve(self.matrix.T, x)

    def respond(self, C: Array, pairs: Array, b: Array, v: Array, shift: float = 0.0) -> Array:
        """C_a X_i C_b^T for all pairs (a, b) and all i, where X_i answers R_i = b_i v_i^T + v_i b_i^T."""
        answers = np.empty((pairs.shape[1], b.shape[1]))
        for i in range(b.shape[1]):
            half = np.outer(b[:, i], v[:, i])
            X = self.divide(half + half.T, shift)
            answers[:, i] = np.einsum("qn,nm,qm->q", C[pairs[0]], X, C[pairs[1]])
        return answers


def decompose(N: Array) -> ModalForm | SchurForm:
    """The cheapest decomposition of N that is accurate enough: modal where the eigenvectors allow it, else Schur.

    Parameters
    ----------
    N : ndarray
        (n, n), finite.

    Raises
    ------
    SolverError
        If N is not finite or its eigenvalues do not converge.
    """
    form = modal_form(N)
    return form if form is not None and form.condition < CONDITION_LIMIT else schur_form(N)


def modal_form(N: Array) -> ModalForm | None:
    """N = V diag(l) V^-1, or None where N has no full set of eigenvectors."""
    from scipy.linalg.lapack import dgeev, dgeev_lwork

    if not np.isfinite(N).all():
        raise SolverError("The equivalent gain matrix N is not finite.")
    n = len(N)
    work = int(dgeev_lwork(n, compute_vl=0, compute_vr=1)[0])
    real, imaginary, _, basis, info = dgeev(N, compute_vl=0, compute_vr=1, lwork=work)
    if info > 0:
        raise SolverError("The eigenvalues of the equivalent gain matrix N did not converge.")
    try:
        inverse = np.linalg.inv(basis)
    except np.linalg.LinAlgError:
        return None
    condition = float(np.linalg.norm(basis, 1) * np.linalg.norm(inverse, 1) / n)
    if not np.isfinite(condition):
        return None
    return ModalForm(N, real + 1j * imaginary, basis, inverse, np.flatnonzero(imaginary > 0), condition)


def nearby_modal_form(N: Array) -> ModalForm:
    """Modal form of N, or where that is useless of a matrix next to N: for derivatives, never for residuals."""
    form = modal_form(N)
    if form is not None and form.condition < NEARBY_LIMIT:
        return form
    size = np.linalg.norm(N, 2) or 1.0
    wobble = np.random.default_rng(0).standard_normal(N.shape) / np.sqrt(len(N))
    found = modal_form(N + NEARBY * size * wobble)
    if found is None:
        raise SolverError("The equivalent gain matrix N has no usable eigenvectors.", matrix=N)
    return found


def schur_form(N: Array) -> SchurForm:
    """N = U T U^T with a real quasi-triangular T."""
    from scipy.linalg import schur

    if not np.isfinite(N).all():
        raise SolverError("The equivalent gain matrix N is not finite.")
    T, U = schur(N)
    return SchurForm(N, T, U)


def _floored(values: Array, tiny: float) -> Array:
    """Move what is closer to zero than tiny to tiny, keeping the sign of the real part."""
    small = np.abs(values) < tiny
    if small.any():
        values = np.where(small, np.where(np.real(values) > 0, tiny, -tiny), values)
    return values
