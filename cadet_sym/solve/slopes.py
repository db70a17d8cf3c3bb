"""Derivatives of stationary moments in parameters, by the implicit function theorem.

At a stationary point F(y, p) = 0 with y = (mean, covariance), so that dy/dp = -J^-1 dF/dp; and for one number g(y) of
interest dg/dp = -(J^-T dg/dy) . dF/dp: a single adjoint solve whatever the number of parameters (see `linearised`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import FrozenProblem, evaluate
from cadet_sym.solve.linearised import LinearisedMoments
from cadet_sym.solve.stationary import StationaryPoint

__all__ = ["adjoint_weights", "moment_slopes", "objective_slopes", "residual_slope", "sees_window"]

Array = np.ndarray

Residuals = tuple[Array, Array]
"""Derivative of the rates of mean (n,) and covariance (n, n) in one parameter, the moments held."""


def moment_slopes(point: StationaryPoint, residuals: list[Residuals]) -> tuple[Array, Array]:
    """Derivatives of all moments in each parameter: (m, n) and (m, n, n).

    Parameters
    ----------
    point : where to differentiate.
    residuals : for each of m parameters, the derivative of the moments' rates in it (see `residual_slope`).
    """
    view, lin = point.frame, LinearisedMoments(point.evaluation)
    means, covariances = [], []
    for r, R in residuals:
        dmu, dP = lin.solve(view.left @ r, view.left @ R @ view.left.T)
        means.append(view.right @ dmu)
        covariances.append(view.right @ dP @ view.right.T)
    n = len(point.mean)
    return np.reshape(means, (-1, n)), np.reshape(covariances, (-1, n, n))


def objective_slopes(point: StationaryPoint, gradient: Residuals, residuals: list[Residuals]) -> Array:
    """Derivatives (m,) in each parameter of one function g(mean, covariance), through the moments alone.

    Parameters
    ----------
    point : where to differentiate.
    gradient : of g in the mean (n,) and in the covariance (n, n): dg = g_mean . dmean + sum_ij g_cov_ij dcov_ij. It must
        not see what drifts.
    residuals : as for `moment_slopes`.
    """
    a, L = adjoint_weights(point, gradient)
    return np.array([-(a @ r + np.sum(L * R)) for r, R in residuals])


def adjoint_weights(point: StationaryPoint, gradient: Residuals) -> Residuals:
    """Weights (a, L) of the rates of mean and covariance: dg/dp = -(a . dr/dp + sum_ij L_ij dR_ij/dp).

    Parameters
    ----------
    point, gradient : as for `objective_slopes`.
    """
    view, lin = point.frame, LinearisedMoments(point.evaluation)
    g_mean, g_covariance = gradient
    if sees_window(point, g_covariance):
        raise SolverError("what the ground between two wheels adds has no derivatives here: take differences of solutions.")
    symmetric = 0.5 * (g_covariance + g_covariance.T)
    a, L = lin.adjoint(view.right.T @ g_mean, view.right.T @ symmetric @ view.right)
    return view.left.T @ a, view.left.T @ L @ view.left


def sees_window(point: StationaryPoint, g_covariance: Array) -> bool:
    """Whether a function of the covariance depends on what the ground between two wheels adds (see `drift.Window`)."""
    window = point.frame.window
    if window is None:
        return False
    size = np.abs(g_covariance).max(initial=0.0) * np.abs(window.directions).max()
    return bool(np.abs(g_covariance @ window.directions).max() > 1e-9 * size)


def residual_slope(
    family: Callable[[float], FrozenProblem], value: float, point: StationaryPoint, step: float | None = None
) -> Residuals:
    """Derivative of the moments' rates in the parameter of a family, by differences of fourth order.

    Parameters
    ----------
    family : value of the parameter to problem.
    value : the parameter at the point.
    point : the stationary point, whose moments are held.
    step : of the parameter; default a thousandth of it (1e-3 where it is zero).
    """
    h = step or 1e-3 * abs(value) or 1e-3
    ends = {k: evaluate(family(value + k * h), point.mean, point.covariance) for k in (-2, -1, 1, 2)}

    def slope(name: str) -> Array:
        part = {k: getattr(at, name) for k, at in ends.items()}
        return (8 * (part[1] - part[-1]) - (part[2] - part[-2])) / (12 * h)

    return slope("r"), slope("R")
