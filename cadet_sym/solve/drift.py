"""What of a system has stationary moments at all: take out what is conserved and what drifts, and scale the rest.

A *conserved* form y^T x has y^T f = 0 and feels no noise: it stays what it was at the start. A *drifting* direction
is one along which nothing pulls back and that no element sees: C v = 0, and A v = 0 (or the chain A^k v = 0, or an
undamped oscillation). Its state wanders without bound, but what does not contain it may be stationary: the closures
and the accelerations of a vehicle on a road that is integrated white noise, whose heave has no variance.

With D the drifting subspace (A-invariant, unseen), x modulo D obeys a closed system of its own: that is what is solved.

Wheels in one track drift together. A form y^T x of what drifts with y^T A = 0 that the same noise enters under one wheel
and leaves under another, sum_k y^T b_k = 0, is the noise of the ground between the wheels and no more: the pitch of a
vehicle on an integrated road, whose heave has no variance. Its own is V sum_k (t_(k+1) - t_k) u_k Q u_k^T, with u_k the
sum of y^T b_j over the wheels j <= k, and its covariance with the rest follows from one linear equation (`Window`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import Evaluation, FrozenProblem, evaluate
from cadet_sym.solve.lyapunov import ModalForm, SchurForm, decompose

__all__ = ["Frame", "Window", "drifting_directions", "frame", "short_run_covariance"]

Array = np.ndarray

RANK = 1e-11  # of the largest singular value: less counts as zero
UNBOUNDED = 1e8  # of the largest entry of the linear part: gains of a jump that meets no variance are no rates


@dataclass(frozen=True)
class Window:
    """Forms y^T x that are the noise of the ground between the wheels of a track, and what they add to x.

    x = right z + directions (y^T x) but for what drifts. k wheels, q forms.
    """

    forms: Array  # (n, q) y
    directions: Array  # (n, q)
    inputs: tuple[tuple[Array, ...], ...]  # y^T b_k (q, w), for each track

    def follows(self, problem: FrozenProblem) -> bool:
        """Whether the forms feel the same noise in a problem with other numbers."""
        for track, known in zip(problem.tracks, self.inputs, strict=True):
            for b, u in zip(track.inputs, known, strict=True):
                if np.abs(self.forms.T @ b - u).max(initial=0.0) > 1e-9 * np.abs(u).max(initial=0.0):
                    return False
        return True

    def own(self, problem: FrozenProblem) -> Array:
        """Covariance of the forms, (q, q)."""
        q = self.directions.shape[1]
        total = np.zeros((q, q))
        for track, inputs in zip(problem.tracks, self.inputs, strict=True):
            sums = np.cumsum(inputs, axis=0)
            total += sum(time * track.speed * u @ track.intensity @ u.T for time, u in zip(track.times, sums, strict=False))
        return total

    def cross(self, at: Evaluation) -> Array:
        """Covariance of z with the forms, (m, q), at a solution: N P = -(what both feel of the noise)."""
        forcing = np.zeros((at.problem.n, self.directions.shape[1]))
        for track, inputs, found in zip(at.problem.tracks, self.inputs, at.correlations, strict=True):
            sums = np.cumsum(inputs, axis=0)
            before = [np.zeros_like(inputs[0]), *sums[:-1]]
            known = [np.zeros_like(track.inputs[0]), *found]
            for b, g, y, u in zip(track.inputs, known, inputs, before, strict=True):
                forcing += track.speed * ((b + g) @ track.intensity @ y.T + b @ track.intensity @ u.T)
        return -np.linalg.solve(at.N, forcing)


@dataclass(frozen=True)
class Frame:
    """The part of a problem that can be stationary, in coordinates z of the order of one: x = offset + right z."""

    problem: FrozenProblem  # in z
    spread: Array  # covariance that the noise builds up in a short run, in z: a start, and the scale of z
    left: Array  # (m, n): z = left (x - offset)
    right: Array  # (n, m)
    offset: Array  # (n,) what is conserved
    drift: Array  # (n, q) orthonormal: directions without stationary moments
    states: tuple[str, ...]  # names of x, for messages
    window: Window | None = None  # what drifts with the wheels of a track, but not apart

    def lift(self, at: Evaluation) -> tuple[Array, Array]:
        """Moments of x: (n,), (n, n). Linear forms l^T x with l^T drift = 0 get theirs from it; others have none."""
        mean, covariance = self.offset + self.right @ at.mean, self.right @ at.covariance @ self.right.T
        if self.window is not None:
            directions = self.window.directions
            cross = self.right @ self.window.cross(at) @ directions.T
            covariance = covariance + cross + cross.T + directions @ self.window.own(at.problem) @ directions.T
        return mean, covariance

    def follows(self, problem: FrozenProblem) -> bool:
        """Whether a problem with other numbers drifts in the same directions, so that this frame serves it too."""
        away = self.drift if self.window is None else np.hstack([self.drift, self.window.directions])
        if not away.size:
            return True
        size = np.ones_like(away) * np.abs(away).max()
        moved = np.abs(self.left @ problem.A @ away) > 1e-9 * (np.abs(self.left) @ np.abs(problem.A) @ size)
        seen = np.abs(problem.C @ away) > 1e-9 * (np.abs(problem.C) @ size)
        return not (moved.any() or seen.any()) and (self.window is None or self.window.follows(problem))

    def lower(self, mean: Array, covariance: Array) -> tuple[Array, Array]:
        """Moments of z from moments of x."""
        return self.left @ (mean - self.offset), self.left @ covariance @ self.left.T

    @property
    def drifting(self) -> Array:
        """(n,) bool: states that have a part in a drifting direction."""
        return np.abs(self.drift).max(axis=1, initial=0.0) > 1e-9


def frame(problem: FrozenProblem, start: Array | None = None) -> Frame:
    """Take out of a problem what is conserved (at its value in `start`, (n,)) and what drifts, and scale the rest.

    Raises
    ------
    SolverError
        If nothing is left.
    """
    n = problem.n
    unit = _balance(problem)
    rest = problem.transformed(np.diag(1 / unit), np.diag(unit))
    basis, drift, offset, shift = np.eye(n), np.zeros((n, 0)), np.zeros(n), 0.0
    window: Window | None = None
    form = decompose(rest.A)
    # Four integrators in a row have computed eigenvalues that are no smaller than this.
    if np.abs(np.real(form.eigenvalues)).min() <= 1e-3 * np.abs(form.eigenvalues).max():
        conserved = _conserved(rest)
        if start is not None:
            offset = conserved @ (conserved.T @ (start / unit))
        keep = _complement(conserved, n)
        rest = rest.transformed(keep.T, keep, offset)
        drift = drifting_directions(rest)
        stay = _complement(drift, rest.n)
        forms, directions, drift = _windowed(rest, drift)
        if not stay.shape[1]:
            raise SolverError(
                "No state has stationary moments: each one drifts (nothing pulls it back) or keeps its initial value."
            )
        if forms.shape[1]:
            inputs = tuple(tuple(forms.T @ b for b in track.inputs) for track in rest.tracks)
            window = Window(keep @ forms / unit[:, None], unit[:, None] * (keep @ directions), inputs)
        rest = rest.transformed(stay.T, stay)
        basis, drift = keep @ stay, keep @ drift
        shift = keep @ directions @ (forms.T @ stay)
        form = decompose(rest.A)
    begin = np.zeros(n) if start is None else start
    spread = _spread(rest, form, basis.T @ (begin / unit - offset))
    sigma = _powers(np.sqrt(np.maximum(np.diag(spread), 0.0)))
    return Frame(
        problem=rest.transformed(np.diag(1 / sigma), np.diag(sigma)),
        spread=spread / np.outer(sigma, sigma),
        left=basis.T / sigma[:, None] / unit,
        right=unit[:, None] * (basis - shift) * sigma,
        offset=unit * offset,
        drift=np.linalg.qr(unit[:, None] * drift)[0] if drift.size else drift,
        states=problem.states,
        window=window,
    )


def _windowed(problem: FrozenProblem, drift: Array) -> tuple[Array, Array, Array]:
    """Forms (n, q) that wheels in one track keep finite, directions (n, q) dual to them, and what drifts in truth.

    Raises
    ------
    SolverError
        If such a form is no part of what drifts: an element sees it.
    """
    n = problem.n
    nothing = np.zeros((n, 0))
    if not problem.tracks or not drift.shape[1]:
        return nothing, nothing, drift
    alone, parts = problem.D.copy(), [problem.A, problem.b, problem.c[:, None]]
    parts = [part / (np.linalg.norm(part, 2) or 1.0) for part in parts if part.size]
    for track in problem.tracks:
        size = max(float(np.linalg.norm(b, 2)) for b in track.inputs) or 1.0
        parts.append(np.sum(track.inputs, axis=0) / size)
        alone -= track.speed * sum(b @ track.intensity @ b.T for b in track.inputs)
    forms = _kernel(np.hstack([*parts, alone / (np.linalg.norm(problem.D, 2) or 1.0)]).T, 1.0)
    if not forms.shape[1]:
        return nothing, nothing, drift
    seen = forms.T @ drift
    if np.linalg.matrix_rank(seen, tol=1e-9) < forms.shape[1]:
        raise SolverError(
            "A nonlinear element sees the difference of the ground's heights under two wheels of a track, and the ground "
            "has no stationary height: its moments are finite but not found here. Give the road a low-frequency `cutoff`."
        )
    return forms, drift @ np.linalg.pinv(seen), drift @ _kernel(seen, 1.0)


def drifting_directions(problem: FrozenProblem) -> Array:
    """Orthonormal basis (n, q) of the directions that no element sees and along which nothing pulls back.

    The largest A-invariant subspace in the kernel of C with all its eigenvalues on the imaginary axis. Zero eigenvalues
    are found by ranks, which a chain of integrators does not upset as it does computed eigenvalues.
    """
    A, C, n = problem.A, problem.C, problem.n
    size = float(np.linalg.norm(A, 2)), float(np.linalg.norm(C, 2)) if C.size else 0.0
    marginal = np.zeros((n, 0))
    while marginal.shape[1] < n:  # ker A, ker A^2, ...: what A sends into what is already found
        rest = _complement(marginal, n)
        more = _kernel(rest.T @ A @ rest, size[0])
        if not more.shape[1]:
            break
        marginal = np.hstack([marginal, rest @ more])
    marginal = np.hstack([marginal, _oscillating(A, marginal)])
    return marginal @ _unseen(marginal.T @ A @ marginal, C @ marginal, size)


def _oscillating(A: Array, inside: Array) -> Array:
    """Basis of the undamped oscillations of A beyond an invariant subspace, as columns orthogonal to it."""
    from scipy.linalg import schur

    rest = _complement(inside, len(A))
    reduced = rest.T @ A @ rest
    if not len(reduced):
        return rest
    limit = 1e-11 * np.abs(reduced).max()
    _, basis, count = schur(reduced, sort=lambda re, im: abs(re) <= limit)
    return rest @ basis[:, :count]


def _unseen(A: Array, C: Array, size: tuple[float, float]) -> Array:
    """Orthonormal basis (n, q) of the largest subspace that A maps into itself and C to zero; `size` of A and of C."""
    basis, seen, scale = np.eye(len(A)), C, size[1]
    while basis.shape[1]:
        smaller = basis @ _kernel(seen @ basis, scale)
        if smaller.shape[1] == basis.shape[1]:
            return smaller
        basis = smaller
        # next: what A moves out of the subspace
        seen, scale = (np.eye(len(A)) - basis @ basis.T) @ A, size[0]
    return basis


def _conserved(problem: FrozenProblem) -> Array:
    """Orthonormal basis (n, q) of the forms y^T x that neither rates, elements nor noise ever change."""
    parts = [problem.A, problem.b, problem.D, problem.c[:, None]]
    parts += [b for track in problem.tracks for b in track.inputs]
    parts = [part / (np.linalg.norm(part, 2) or 1.0) for part in parts if part.size]
    return _kernel(np.hstack(parts).T, 1.0)


def _kernel(matrix: Array, size: float) -> Array:
    """Orthonormal basis of the kernel; singular values under RANK times `size` count as zero. Sparse if can be."""
    n = matrix.shape[1]
    zero = np.abs(matrix).max(axis=0, initial=0.0) <= RANK * size
    if zero.all():
        return np.eye(n)
    busy = np.flatnonzero(~zero)
    _, values, rows = np.linalg.svd(matrix[:, busy])
    rank = int(np.sum(values > RANK * size))
    basis = np.zeros((n, n - rank))
    basis[np.flatnonzero(zero), np.arange(zero.sum())] = 1.0
    basis[busy, int(zero.sum()) :] = rows[rank:].T
    return basis


def _complement(basis: Array, n: int) -> Array:
    """Orthonormal basis (n, n - q) of what is orthogonal to the columns, the unit vectors themselves where they are."""
    return _kernel(basis.T, 1.0) if basis.shape[1] else np.eye(n)


def _balance(problem: FrozenProblem) -> Array:
    """Powers of two that make rows and columns of the linear part and the elements alike in size, (n,)."""
    from scipy.linalg import matrix_balance

    coupling = np.abs(problem.A) + np.abs(problem.columns) @ np.abs(problem.C)
    _, (scale, _) = matrix_balance(coupling, permute=False, separate=True)
    return scale


def _spread(problem: FrozenProblem, form: ModalForm | SchurForm, mean: Array) -> Array:
    """Covariance that the noise builds up in a short run; where some elements alone pass it on, by their gains at a mean."""
    spread = short_run_covariance(form, problem.D)
    if spread.diagonal().all() or not len(problem.C):
        return spread
    at = evaluate(problem, mean, spread)
    if not at.finite or np.abs(at.N).max() > UNBOUNDED * np.abs(problem.A).max():
        return spread
    return short_run_covariance(decompose(at.N), problem.D)


def short_run_covariance(form: ModalForm | SchurForm, D: Array) -> Array:
    """P that the linear part builds up in a few of its shortest time constants, (n, n): positive semidefinite."""
    rates = form.eigenvalues
    fastest = np.abs(rates).max(initial=0.0)
    shift = max(0.0, float(np.real(rates).max(initial=0.0))) + (0.1 * fastest or 1.0)
    P = form.leave(form.divide(form.enter(D), 2 * shift))
    return 0.5 * (P + P.T)


def _powers(sigma: Array) -> Array:
    """The powers of two nearest to positive numbers; one for the rest."""
    positive = sigma > 1e-12 * sigma.max(initial=0.0)
    scale = np.ones(len(sigma))
    scale[positive] = 2.0 ** np.round(np.log2(sigma[positive]))
    return scale
