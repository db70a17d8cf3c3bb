"""Judge whether a stationary point is a stable fixed point of the moment equations, and how fast they return to it.

Near a stationary point mean and covariance obey a linear system of n (n + 3) / 2 equations (more with wheels in one
track). If N has an eigenvalue in the right half-plane, so has that system. If not, what can still be unstable is the
feedback through the few nonlinear elements: with Y(s) the answer of the arguments' covariances to the gains, and m(s)
that of their means to their covariances (see `linearised`), the eigenvalues are the zeros of

    f(s) = det( 1 - (k_S + k_z m(s)) Y(s) ),     k_z, k_S derivatives of the gains in the arguments' means, covariances

which are counted by the argument principle along the imaginary axis (Nyquist): exact for any n, and with wheels in one
track, where s enters through exponentials, too (`nyquist`). Small systems are asked for all their eigenvalues instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadet_sym.solve.frozen import Evaluation
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.lyapunov import ModalForm, nearby_modal_form
from cadet_sym.solve.nyquist import Response, count_unstable, rightmost

__all__ = ["Stability", "from_the_right", "moment_jacobian", "stability"]

Array = np.ndarray

DENSE = 14  # states up to which all eigenvalues of the moment equations are computed
MARGIN = 1e-13  # of the fastest rate: an eigenvalue of N closer to the imaginary axis counts as on it
DOUBT = 1e-8  # the same for the moment equations' own eigenvalues, which rounding touches more: then Nyquist decides


@dataclass(frozen=True)
class Stability:
    """What the linearised moment equations do."""

    stable: bool
    eigenvalues: Array  # (n,) complex, of N
    how: str  # "all eigenvalues", "eigenvalues of N" or "Nyquist"
    moments: Array  # complex: eigenvalues of the moment equations that are known, from the right; all or none
    _response: Response | None = None

    @cached_property
    def rightmost(self) -> complex:
        """The eigenvalue of the moment equations with the largest real part that can be found."""
        if len(self.moments) or self._response is None:
            return complex(self.moments[0]) if len(self.moments) else complex(self.eigenvalues[0])
        return rightmost(self._response, self.stable)


def stability(lin: LinearisedMoments) -> Stability:
    """Judge the stationary point at which the moment equations were linearised."""
    at = lin.at
    eigenvalues = from_the_right(lin.form.eigenvalues)
    slow = eigenvalues[0].real
    fastest = np.abs(eigenvalues).max(initial=0.0)
    moments = np.zeros(0)
    if at.problem.n <= DENSE and not at.problem.tracks:
        moments = from_the_right(np.linalg.eigvals(moment_jacobian(at)))
        if abs(moments[0].real) > DOUBT * fastest:
            return Stability(bool(moments[0].real < 0), eigenvalues, "all eigenvalues", moments)
    if slow >= -MARGIN * fastest or not len(at.problem.C):
        known = moments if len(moments) else eigenvalues[:1]
        return Stability(bool(slow < -MARGIN * fastest), eigenvalues, "eigenvalues of N", known)
    response = Response(at, lin.form if isinstance(lin.form, ModalForm) else nearby_modal_form(at.N))
    return Stability(count_unstable(response) == 0, eigenvalues, "Nyquist", moments, response)


def from_the_right(values: Array) -> Array:
    """Eigenvalues in descending order of their real parts."""
    return values[np.argsort(-np.real(values), kind="stable")].astype(complex)


def moment_jacobian(at: Evaluation) -> Array:
    """Jacobian of [rate of the mean (n); rate of the lower triangle of P, column by column], for few states."""
    p, n = at.problem, at.problem.n
    columns, rows = np.triu_indices(n)
    size = len(rows)
    basis = np.zeros((size, n, n))
    basis[np.arange(size), rows, columns] = basis[np.arange(size), columns, rows] = 1.0
    K = len(p.C)
    seen = np.zeros((K + p.pairs.shape[1], n + size))  # dtheta/dy
    seen[:K, :n] = p.C
    first, other = p.C[p.pairs]
    # the lower triangle of P holds both P_ij and P_ji
    pairs = first[:, rows] * other[:, columns]
    seen[K:, n:] = np.where(rows == columns, pairs, pairs + first[:, columns] * other[:, rows])
    flow = at.N @ basis
    J = np.zeros((n + size, n + size))
    J[:n, :n] = p.A
    J[n:, n:] = (flow + flow.transpose(0, 2, 1))[:, rows, columns].T
    v = at.covariance @ p.C.T
    kick = p.columns[:, None, :] * v[None, :, :]
    kick = (kick + kick.transpose(1, 0, 2))[rows, columns]
    J[:n] += p.b @ (at.F_slope @ seen)
    J[n:] += kick @ (at.gain_slope @ seen)
    return J
