"""The stationary moment equations linearised at a point, solved in O(n^3) whatever n (n + 3) / 2 is.

With theta what the elements see (see `frozen`), k their gains, v_i = P C_i^T, b_i the column through which argument i
acts, and L(X) = N X + X N^T, a change (dmu, dP) changes the residuals by

    dr = N dmu + b F_S dS                            F_S = dF/dS: the derivative in the means is in N already
    dR = L(dP) + sum_i dk_i (b_i v_i^T + v_i b_i^T + W_i),   dk = (dk/dtheta) dtheta,   dtheta = (C dmu, C dP C^T)

so that dP = X_0 + sum_i dk_i X_i with L(X_0) = -R and L(X_i) = -(b_i v_i^T + v_i b_i^T + W_i), and a dense system in
dtheta, as small as the elements are few, closes it. W_i is the derivative of the forcing of wheels in one track.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import Evaluation
from cadet_sym.solve.lyapunov import ModalForm, SchurForm, decompose, nearby_modal_form

__all__ = ["LinearisedMoments", "delay_directions"]

Array = np.ndarray


@dataclass(frozen=True)
class SmallSystem:
    """The equations of a change dtheta in what the elements see: matrix dtheta = what it would be without them."""

    matrix: Array  # (T, T)
    response: Array  # (T - K, K): how the arguments' covariances answer the gains
    mean_response: Array  # (K, T - K): how their means answer their covariances
    push: Array  # (n, T - K): N^-1 b F_S


@dataclass(frozen=True)
class LinearisedMoments:
    """The Jacobian of the moment equations at one evaluation, as one decomposition and a few small matrices."""

    at: Evaluation

    @cached_property
    def form(self) -> ModalForm | SchurForm:
        """The decomposition of N."""
        return decompose(self.at.N)

    def step(self, shift: float = 0.0) -> tuple[Array, Array]:
        """Newton's step (dmu, dP); a positive shift 1/h makes it one implicit step of length h (pseudo-transient)."""
        return self.solve(self.at.r, self.at.R, shift)

    def solve(self, r: Array, R: Array, shift: float = 0.0) -> tuple[Array, Array]:
        """(dmu, dP) with (J - shift) (dmu, dP) = -(r, R): r (n,), R (n, n) symmetric."""
        small, R_in = self.small(shift), self.form.enter(R)
        dtheta = _solve_small(small.matrix, self._known(r, R_in, shift)) if len(small.matrix) else np.zeros(0)
        return self._expand(r, R_in, dtheta, small, shift)

    def bordered(
        self, r: Array, R: Array, slope: tuple[Array, Array], row: Array, corner: float, value: float
    ) -> tuple[Array, Array, float, Array]:
        """Newton's step with one parameter free: J (dmu, dP) + slope dp = -(r, R), row dtheta + corner dp = value.

        Regular at a fold of the solutions in the parameter, where J is singular. `slope` is the derivative of the
        residuals (r, R) in the parameter. Returns dmu, dP, dp, dtheta.
        """
        small, R_in, slope_in = self.small(0.0), self.form.enter(R), self.form.enter(slope[1])
        T = len(small.matrix)
        matrix = np.empty((T + 1, T + 1))
        matrix[:T, :T], matrix[T, :T], matrix[T, T] = small.matrix, row, corner
        matrix[:T, T] = -self._known(slope[0], slope_in, 0.0)
        solution = _solve_small(matrix, np.append(self._known(r, R_in, 0.0), value))
        dtheta, dp = solution[:T], float(solution[T])
        dmu, dP = self._expand(r + dp * slope[0], R_in + dp * slope_in, dtheta, small)
        return dmu, dP, dp, dtheta

    def adjoint(self, g_mean: Array, g_covariance: Array) -> tuple[Array, Array]:
        """(a, L) with J^T (a, L) = (g_mean, g_covariance), covariances paired by their Frobenius product."""
        form, p, small = self.form, self.at.problem, self.small(0.0)
        K = len(p.C)
        q = np.zeros(K)
        s = np.zeros(p.pairs.shape[1])
        if K:
            k_z, k_S = self.at.gain_slope[:, :K], self.at.gain_slope[:, K:]
            L = form.adjoint(-g_covariance)
            u, v = (form.leave_vector(part.reshape(p.n, -1)).reshape(part.shape) for part in self._directions)
            q0 = 2.0 * np.einsum("nkm,nkm->k", u, np.tensordot(L, v, 1))
            s0 = small.push.T @ g_mean
            feedback = small.mean_response.T @ k_z.T + k_S.T
            q = _solve_small(np.eye(K) - small.response.T @ feedback, q0 + small.response.T @ s0)
            s = s0 + feedback @ q
        rows, others = p.C[p.pairs]
        half = (rows.T * s) @ others
        L = form.adjoint(0.5 * (half + half.T) - g_covariance)
        a = form.adjoint_vector(g_mean - p.C.T @ (self.at.gain_slope[:, :K].T @ q))
        return a, _symmetric(L)

    def small(self, shift: float) -> SmallSystem:
        """The equations of dtheta, with all that makes them up."""
        return self._unshifted if shift == 0.0 else self._small(shift)

    @cached_property
    def _unshifted(self) -> SmallSystem:
        return self._small(0.0)

    def _small(self, shift: float) -> SmallSystem:
        p, form = self.at.problem, self.form
        K, S = len(p.C), p.pairs.shape[1]
        u, v = self._directions
        answers = form.respond(self._C, p.pairs, u.reshape(p.n, -1), v.reshape(p.n, -1), shift)
        response = answers.reshape(S, *u.shape[1:]).sum(axis=2)
        push = self._through(p.b @ self.at.F_slope[:, K:], shift)
        matrix = np.eye(K + S)
        matrix[:K, K:] += p.C @ push
        matrix[K:] -= response @ self.at.gain_slope
        return SmallSystem(matrix, response, -p.C @ push, push)

    def _known(self, r: Array, R_in: Array, shift: float) -> Array:
        """What the elements see of the answer that leaves the gains alone, (T,)."""
        X = self.form.divide(R_in, shift)
        rows, others = self._C[self.at.problem.pairs]
        seen = np.sum((rows @ X) * others, axis=1).real
        return np.concatenate([-self.at.problem.C @ self._through(r, shift), seen])

    def _expand(
        self, r: Array, R_in: Array, dtheta: Array, small: SmallSystem, shift: float = 0.0
    ) -> tuple[Array, Array]:
        """(dmu, dP) from what the elements see of it."""
        K = len(self.at.problem.C)
        dmu = -self._through(r, shift)
        if K:
            dmu = dmu - small.push @ dtheta[K:]
            R_in = R_in + self._gain_forcing(self.at.gain_slope @ dtheta)
        return dmu, _symmetric(self.form.leave(self.form.divide(R_in, shift)))

    def _through(self, x: Array, shift: float) -> Array:
        """(N - shift)^-1 x, of a vector or of columns."""
        form = self.form
        columns = x.reshape(len(x), -1)
        return form.leave_vector(form.divide_vector(form.enter_vector(columns), shift)).reshape(x.shape)

    def _gain_forcing(self, dk: Array) -> Array:
        """sum_i dk_i (b_i v_i^T + v_i b_i^T + W_i) in the decomposition's coordinates, (n, n)."""
        u, v = self._directions
        half = (u * dk[:, None]).reshape(len(u), -1) @ v.reshape(len(v), -1).T
        return half + half.T

    @cached_property
    def _directions(self) -> tuple[Array, Array]:
        """u, v (n, K, m) with dR/dk_i = sum_m (u_im v_im^T + v_im u_im^T), in the decomposition's coordinates."""
        p, form = self.at.problem, self.form
        u, v = form.enter_vector(p.columns)[:, :, None], form.enter_vector(self.at.covariance @ p.C.T)[:, :, None]
        if not p.tracks:
            return u, v
        modal = form if isinstance(form, ModalForm) else nearby_modal_form(self.at.N)
        changes, wheels = delay_directions(self.at, modal, np.zeros(1))
        changes = changes[0]
        if modal is not form:
            changes = form.enter_vector(modal.leave_vector(changes.reshape(p.n, -1))).reshape(changes.shape)
        wheels = np.broadcast_to(form.enter_vector(wheels)[:, None], changes.shape)
        return np.concatenate([u, changes], axis=2), np.concatenate([v, wheels], axis=2)

    @cached_property
    def _C(self) -> Array:
        return self.form.enter_form(self.at.problem.C)


def delay_directions(at: Evaluation, modal: ModalForm, shifts: Array) -> tuple[Array, Array]:
    """What the gains do to the forcing of wheels in one track: sum_m (u_im v_m^T + v_m u_im^T) for each argument i.

    The columns of all g_k change by dg_k = exp((N - shift) tau) dg_(k-1) + E_i (g_(k-1) + b_(k-1)), where E_i is the
    derivative of the exponential in the direction b_i c_i^T. A shift gives the Laplace transform of the answer to
    gains that vary in time.

    Returns
    -------
    u : (s, n, K, m) changes for each shift, in modal coordinates.
    v : (n, m) inputs of the wheel concerned, times V Q.
    """
    p = at.problem
    b, C = modal.enter_vector(p.columns), modal.enter_form(p.C)
    shifted = modal.eigenvalues - shifts[:, None]
    changes, wheels = [], []
    for track, found in zip(p.tracks, at.correlations, strict=True):
        before = [np.zeros_like(track.inputs[0]), *found[:-1]]
        dg = np.zeros((len(shifts), p.n, len(p.C), track.inputs[0].shape[1]), dtype=complex)
        for k, time in enumerate(track.times):
            start = modal.enter_vector(before[k] + track.inputs[k])
            divided = _divided_exponential(shifted[:, :, None], modal.eigenvalues, time)
            kicks = np.einsum("spq,qiw->spiw", divided, C.T[:, :, None] * start[:, None, :])
            dg = np.exp(shifted * time)[:, :, None, None] * dg + b[:, :, None] * kicks
            changes.append(dg)
            wheels.append(track.speed * track.inputs[k + 1] @ track.intensity)
    return np.concatenate(changes, axis=3), np.concatenate(wheels, axis=1)


def _divided_exponential(a: Array, b: Array, time: float) -> Array:
    """(exp(a t) - exp(b t)) / (a - b), broadcast, accurate where the two are close."""
    difference = (a - b) * time
    larger = np.where(difference.real > 0, a, b) * time
    x = np.where(difference.real > 0, -difference, difference)
    small = np.abs(x) < 1e-8
    quotient = np.where(small, 1 + x / 2, np.expm1(x) / np.where(small, 1.0, x))
    return time * np.exp(larger) * quotient


def _solve_small(matrix: Array, known: Array) -> Array:
    """Solve the dense system over what the elements see; by least squares where it is singular (a fold)."""
    if not (np.isfinite(matrix).all() and np.isfinite(known).all()):
        raise SolverError("The linearised moment equations are not finite.")
    try:
        return np.linalg.solve(matrix, known)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, known, rcond=None)[0]


def _symmetric(X: Array) -> Array:
    return 0.5 * (X + X.T)
