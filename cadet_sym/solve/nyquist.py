"""The feedback of the moment equations through their elements, as a function of the Laplace variable s.

    f(s) = det( 1 - (k_S + k_z m(s)) Y(s) )

Y, how the covariances of the elements' arguments answer the gains, has its poles at the sums l_p + l_q of two
eigenvalues of N; m, how the arguments' means answer their covariances, at the eigenvalues. Both are held as partial
fractions, which makes hundreds of values of f cheap. See `stability`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import Evaluation
from cadet_sym.solve.linearised import delay_directions
from cadet_sym.solve.lyapunov import ModalForm

__all__ = ["Response", "count_unstable", "rightmost"]

Array = np.ndarray

STRONG = 16  # poles round which the curve is looked at from the start; the rest is found by refinement
WEAK = 0.05  # what a pole adds to the feedback at most: less does not turn the curve by itself


@dataclass(frozen=True)
class Response:
    """The matrix 1 - (k_S + k_z m(s)) Y(s) as a function of s, by partial fractions over the modes of N."""

    at: Evaluation
    form: ModalForm

    @cached_property
    def pairs(self) -> tuple[Array, Array]:
        """Indices (p, q), p <= q, of the modes' covariances, in order."""
        return np.triu_indices(self.at.problem.n)

    @cached_property
    def kicks(self) -> Array:
        """What the gains add to the rates of the modes' covariances, (n (n + 1) / 2, K); without the delays."""
        p = self.at.problem
        upper, lower = self.pairs
        u = self.form.enter_vector(p.columns)
        v = self.form.enter_vector(self.at.covariance @ p.C.T)
        return u[upper] * v[lower] + v[upper] * u[lower]

    @cached_property
    def seen(self) -> Array:
        """What the modes' covariances add to those of the arguments, (n (n + 1) / 2, T - K)."""
        p = self.at.problem
        upper, lower = self.pairs
        C = self.form.enter_form(p.C)
        first, other = C[p.pairs[0]].T, C[p.pairs[1]].T
        both = first[upper] * other[lower]
        return np.where((upper == lower)[:, None], both, both + first[lower] * other[upper])

    @cached_property
    def sums(self) -> Array:
        """l_p + l_q, (n (n + 1) / 2,)."""
        upper, lower = self.pairs
        return self.form.eigenvalues[upper] + self.form.eigenvalues[lower]

    @cached_property
    def fractions(self) -> tuple[Array, Array]:
        """Poles of Y, (q,), and their residues, (q, 2 (T - K) K): real parts, then imaginary ones."""
        residues = self.seen[:, :, None] * self.kicks[:, None, :]
        return self.sums, _apart(residues.reshape(len(residues), -1))

    @cached_property
    def pushes(self) -> Array:
        """What the arguments' covariances add to the rates of the modes' means, (n, T - K)."""
        p = self.at.problem
        return self.form.enter_vector(p.b @ self.at.F_slope[:, len(p.C) :])

    @cached_property
    def singles(self) -> tuple[Array, Array]:
        """Poles l_p of m, (n,), and their residues, (n, 2 K (T - K)): real parts, then imaginary ones."""
        C = self.form.enter_form(self.at.problem.C)
        residues = C.T[:, :, None] * self.pushes[:, None, :]
        return self.form.eigenvalues, _apart(residues.reshape(len(residues), -1))

    def __call__(self, s: Array) -> Array:
        """The matrix at complex s (k,), as (k, K, K)."""
        K = len(self.at.problem.C)
        Y, m = self.parts(s)
        slope = self.at.gain_slope
        return np.eye(K) - (slope[:, K:] + slope[:, :K] @ m) @ Y

    def parts(self, s: Array) -> tuple[Array, Array]:
        """Y (k, T - K, K) and m (k, K, T - K) at complex s (k,)."""
        p = self.at.problem
        K, S = len(p.C), p.pairs.shape[1]
        Y = self._sum(*self.fractions, s).reshape(-1, S, K)
        if p.tracks:
            Y = Y + self._delayed(s)
        return Y, self._sum(*self.singles, s).reshape(-1, K, S)

    def _sum(self, poles: Array, residues: Array, s: Array) -> Array:
        """Sum of residues / (s - poles), (k, columns), in real arithmetic: many times faster than in complex."""
        real, imaginary = np.real(s)[:, None] - np.real(poles), np.imag(s)[:, None] - np.imag(poles)
        size = real * real
        size += imaginary * imaginary
        real /= size
        imaginary /= size
        columns = residues.shape[1] // 2
        one, other = real @ residues, imaginary @ residues
        return one[:, :columns] + other[:, columns:] + 1j * (one[:, columns:] - other[:, :columns])

    def _delayed(self, s: Array) -> Array:
        """What the gains do through the forcing of wheels in one track: a part of Y, (k, T - K, K)."""
        p, form = self.at.problem, self.form
        u, v = delay_directions(self.at, form, s)
        C = form.enter_form(p.C)
        weights = 1.0 / (s[:, None, None] - form.eigenvalues[:, None] - form.eigenvalues)
        v = form.enter_vector(v)
        first, other = C[p.pairs[0]], C[p.pairs[1]]
        # sum_pq a_p o_q (u_p v_q + v_p u_q) / (s - l_p - l_q): over the wheels' side first
        wheels = [np.einsum("spq,aq,qm->sapm", weights, a, v, optimize=True) for a in (other, first)]
        return np.einsum("ap,sapm,spim->sai", first, wheels[0], u, optimize=True) + np.einsum(
            "ap,sapm,spim->sai", other, wheels[1], u, optimize=True
        )

    def determinant(self, s: Array) -> Array:
        """Values of f at complex s (k,)."""
        return np.linalg.det(self(np.atleast_1d(s)))

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """What each pole can at most add along the imaginary axis to Y, (q, (T - K) K), and to m, (n, K (T - K))."""
        found = []
        for poles, residues in (self.fractions, self.singles):
            columns = residues.shape[1] // 2
            size = np.hypot(residues[:, :columns], residues[:, columns:])
            found.append(size / np.abs(np.real(poles))[:, None])
        return found[0], found[1]

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Entry by entry what k_S + k_z m, (K, T - K), and Y, (T - K, K), are at most along the imaginary axis."""
        slope, (Y, m) = np.abs(self.at.gain_slope), self.peaks
        K = slope.shape[0]
        return slope[:, K:] + slope[:, :K] @ m.sum(axis=0).reshape(K, -1), Y.sum(axis=0).reshape(-1, K)

    def bound(self) -> float:
        """An upper bound of the spectral radius of the feedback along the imaginary axis; below one it is stable."""
        if self.at.problem.tracks:
            return np.inf
        gain, Y = self.bounds
        return float(np.abs(np.linalg.eigvals(gain @ Y)).max(initial=0.0))

    def weights(self) -> Array:
        """What each pole, those of Y first, can at most add to an entry of the feedback along the imaginary axis."""
        gain, Y = self.bounds
        slope = np.abs(self.at.gain_slope[:, : len(gain)])
        of_Y, of_m = (part.max(axis=1, initial=0.0) for part in self.peaks)
        return np.concatenate([of_Y * gain.sum(axis=1).max(), of_m * slope.sum(axis=1).max() * Y.sum(axis=0).max()])

    def frequencies(self) -> Array:
        """Where to look at f(i omega) first: zero, around the poles that can turn it, and far out, ascending."""
        poles = np.concatenate([self.fractions[0], self.singles[0]])
        weights = self.weights()
        chosen = np.argsort(-weights)[:STRONG]
        near = poles[chosen[weights[chosen] > WEAK]]
        around = np.abs(np.imag(near)) + np.abs(np.real(near)) * np.array([-1.0, 0.0, 1.0])[:, None]
        rates = np.abs(np.real(self.form.eigenvalues)).min(), np.abs(self.form.eigenvalues).max()
        every = np.concatenate([[0.0], around.ravel(), np.geomspace(1e-2 * rates[0], 1e3 * rates[1], 16)])
        return np.unique(every[every >= 0])


def _apart(values: Array) -> Array:
    """Real parts beside imaginary parts."""
    return np.hstack([np.real(values), np.imag(values)])


def count_unstable(response: Response) -> int:
    """Number of eigenvalues of the moment equations in the right half-plane, where N has none there."""
    if response.bound() < 1:
        return 0
    _, value = _nyquist_curve(response)
    # f is real at zero and one at infinity: anticlockwise round the right half-plane is down the imaginary axis
    total = np.sum(np.angle(value[1:] / value[:-1])) + np.angle(1.0 / value[-1])
    return round(-float(total) / np.pi)


def _nyquist_curve(response: Response) -> tuple[Array, Array]:
    """f(i omega) at frequencies so close that its argument can be followed."""
    omega = response.frequencies()
    value = _evaluate(response, omega)
    for _ in range(40):
        turn = np.abs(np.angle(value[1:] / value[:-1]))
        change = np.abs(value[1:] - value[:-1]) / np.minimum(np.abs(value[1:]), np.abs(value[:-1]))
        gaps = np.flatnonzero(((turn > 0.8) | (change > 1.0)) & (np.diff(omega) > 1e-12 * omega[1:]))
        if not len(gaps):
            break
        middle = 0.5 * (omega[gaps] + omega[gaps + 1])
        omega = np.insert(omega, gaps + 1, middle)
        value = np.insert(value, gaps + 1, _evaluate(response, middle))
    return omega, value


def _evaluate(response: Response, omega: Array) -> Array:
    batch = max(1, 20_000 // max(len(response.sums), 1))
    parts = [response.determinant(1j * omega[i : i + batch]) for i in range(0, len(omega), batch)]
    value = np.concatenate(parts)
    if not np.isfinite(value).all():
        raise SolverError("The stability of the moment equations could not be judged: overflow in their response.")
    return np.where(value == 0, 1e-300, value)


@np.errstate(all="ignore")  # the search for zeros may stray
def rightmost(response: Response, stable: bool) -> complex:
    """The eigenvalue of the moment equations with the largest real part among those near zero and the slow modes.

    Shift-invert Lanczos-Arnoldi round zero and round the frequencies of the least damped modes, in the modes'
    coordinates: one application costs O(n^2). If the count says unstable and that finds nothing unstable, the zeros
    of f are looked for from the points where its curve comes closest to zero.
    """
    slow = response.form.eigenvalues[np.argsort(-np.real(response.form.eigenvalues))][:4]
    shifts = np.unique(np.round(np.concatenate([[0.0], np.abs(np.imag(slow)), 2 * np.abs(np.imag(slow))]), 12))
    found = [value for omega in shifts[:5] for value in _eigenvalues_near(response, 1j * omega)]
    if not stable:
        found += _real_zeros(response)
    if not found or not (stable or any(value.real > 0 for value in found)):
        found += _zeros(response)
    if stable:  # what the count has excluded is an artefact of the iteration
        found = [value for value in found if value.real < 0]
    return max(found or [complex(slow[0])], key=_real_part)


def _real_part(value: complex) -> float:
    return value.real


def _eigenvalues_near(response: Response, shift: complex) -> list[complex]:
    """A few eigenvalues of the moment equations near a point, by Arnoldi iteration with their inverse."""
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

    p, n = response.at.problem, response.at.problem.n
    if p.tracks:  # the shift enters exponentials: there is no linear eigenvalue problem to iterate with
        return []
    K, size = len(p.C), n + len(response.sums)
    shift = shift + 1e-7j * np.abs(response.form.eigenvalues).max()  # never on an eigenvalue
    C = response.form.enter_form(p.C)
    Y, m = (part[0] for part in response.parts(np.array([shift])))
    slope = response.at.gain_slope
    matrix = np.eye(K + len(Y), dtype=complex)
    matrix[:K, K:] -= m
    matrix[K:] -= Y @ slope
    means, covariances = 1.0 / (response.form.eigenvalues - shift), 1.0 / (response.sums - shift)

    def apply(y: Array) -> Array:
        mu, X = means * y[:n], covariances * y[n:]
        dtheta = np.linalg.solve(matrix, np.concatenate([C @ mu, response.seen.T @ X]))
        mu = mu - means * (response.pushes @ dtheta[K:])
        return np.concatenate([mu, X - covariances * (response.kicks @ (slope @ dtheta))])

    operator = LinearOperator((size, size), matvec=apply, dtype=complex)
    start = np.random.default_rng(0).standard_normal(size) + 0j
    try:
        inverse = eigs(operator, k=4, v0=start, return_eigenvectors=False, tol=1e-8, maxiter=30)
    except ArpackError:
        return []
    return [complex(shift + 1.0 / value) for value in np.atleast_1d(inverse)]


def _real_zeros(response: Response) -> list[complex]:
    """Real zeros of f to the right of the imaginary axis, between points where its sign changes."""
    from scipy.optimize import brentq

    rates = np.abs(response.form.eigenvalues)
    grid = np.geomspace(1e-6 * rates.min(), 1e3 * rates.max(), 400)
    value = np.real(response.determinant(grid + 0j))
    changes = np.flatnonzero(np.sign(value[1:]) != np.sign(value[:-1]))

    def f(s: float) -> float:
        return float(response.determinant(np.array([s + 0j]))[0].real)

    return [complex(brentq(f, grid[i], grid[i + 1], rtol=1e-12)) for i in changes]


def _zeros(response: Response) -> list[complex]:
    """Zeros of f by the secant method from the deepest dips along the imaginary axis, and from points beside them."""
    omega, value = _nyquist_curve(response)
    size = np.abs(value)
    dips = np.flatnonzero((size <= np.append(size[1:], np.inf)) & (size <= np.insert(size[:-1], 0, np.inf)))
    dips = dips[np.argsort(size[dips])][:6]
    scale = np.abs(np.real(response.form.eigenvalues)).min()
    starts = [1j * omega[i] + side * scale for i in dips for side in (0.3, 0.0, 3.0, -0.3)]
    found = (_secant(response, start, 1e-3 * scale) for start in starts)
    return [zero for zero in found if zero is not None]


def _secant(response: Response, start: complex, step: float) -> complex | None:
    s, previous = start, start + step
    limit = 100 * (abs(start) + float(np.abs(response.form.eigenvalues).max()))
    f, f_previous = response.determinant(np.array([s, previous]))
    for _ in range(30):
        if f == f_previous or not np.isfinite(f) or abs(s) > limit:
            return None
        new = s - f * (s - previous) / (f - f_previous)
        previous, f_previous, s = s, f, new
        f = complex(response.determinant(np.array([s]))[0])
        if abs(s - previous) < 1e-9 * abs(s) + 1e-300:
            return complex(s)
    return None
