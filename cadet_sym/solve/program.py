"""A nonlinear program whose functions are known together with their derivatives, solved by sequential quadratic steps.

    minimise f(x)   subject to   g_i(x) <= 0 or = 0,   low <= x <= high

SciPy's SLSQP (Kraft 1988) in variables from 0 to 1. What it calls a solution is judged by the conditions of Karush,
Kuhn and Tucker: multipliers by least squares over the active constraints, and what they leave of the gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cadet_sym.errors import SolverError

__all__ = ["Program", "ProgramEnd", "minimise"]

Array = np.ndarray

ACTIVE = 1e-7  # of its scale: a constraint or bound this close counts as active
OPTIMAL = 1e-6  # of the gradient, in scaled variables: what may be left of it
NEAR = 1e-8  # of the ranges: an optimum this close is reached
PROBE = 1e-6  # of the ranges: how far ahead the curvature is measured
STEPS = 300


@dataclass(frozen=True)
class Program:
    """Functions of x (c,): values (1 + q,) of the objective and q constraints, and their derivatives (1 + q, c)."""

    functions: Callable[[Array], tuple[Array, Array]]  # raises SolverError where they do not exist
    low: Array  # (c,)
    high: Array  # (c,)
    equal: Array  # (q,) bool: = 0 rather than <= 0
    scale: Array  # (q,) what a constraint's value is measured by


@dataclass(frozen=True)
class ProgramEnd:
    """Where a search ended. Multipliers are those of the functions as they are, not scaled."""

    x: Array  # (c,)
    values: Array  # (1 + q,)
    multipliers: Array  # (q,) decrease of the objective for a unit by which a constraint gives way
    bounds: Array  # (c,) the same of the bound a variable lies at; positive at the upper, negative at the lower one
    stationarity: float  # what the multipliers leave of the gradient, scaled
    infeasibility: float  # the largest violation, scaled
    iterations: int
    message: str
    distance: float = np.inf  # to the optimum by the curvature, of the ranges; only where nothing is active

    @property
    def optimal(self) -> bool:
        """Whether the first-order conditions hold, or would hold a hair's breadth away."""
        return (self.stationarity < OPTIMAL or self.distance < NEAR) and self.infeasibility < ACTIVE


def minimise(program: Program, start: Array) -> ProgramEnd:
    """Search from one start, (c,), within the bounds.

    Raises
    ------
    SolverError
        If the functions do not exist at the start.
    """
    from scipy.optimize import minimize

    width = program.high - program.low
    known: dict[bytes, tuple[Array, Array]] = {}

    def at(u: Array) -> tuple[Array, Array]:
        key = np.ascontiguousarray(u).tobytes()
        if key not in known:
            values, slopes = program.functions(np.clip(program.low + u * width, program.low, program.high))
            known[key] = (values / size, slopes * width / size[:, None])
        return known[key]

    size = np.ones(1 + len(program.scale))
    begin = np.clip((start - program.low) / width, 0.0, 1.0)
    first, slope = at(begin)
    size = np.concatenate([[abs(first[0]) or float(np.abs(slope[0]).max()) or 1.0], program.scale])
    known.clear()
    reached = [begin]

    def value(u: Array) -> Array:
        try:
            reached[0] = u.copy()
            return at(u)[0]
        except SolverError:  # the line search turns back from there
            return np.full(len(size), np.nan)

    def objective(u: Array) -> float:
        found = value(u)[0]
        return float(found) if np.isfinite(found) else 1e10

    def excess(u: Array, rows: Array) -> Array:
        found = value(u)[1:][rows]
        return -np.where(np.isfinite(found), found, 1e10)

    constraints = [
        {"type": kind, "fun": lambda u, r=rows: excess(u, r), "jac": lambda u, r=rows: -at(u)[1][1:][r]}
        for kind, rows in (("ineq", np.flatnonzero(~program.equal)), ("eq", np.flatnonzero(program.equal)))
        if rows.size
    ]
    result = minimize(
        objective,
        begin,
        jac=lambda u: at(u)[1][0].copy(),  # SLSQP works in the arrays it is given
        bounds=[(0.0, 1.0)] * len(begin),
        constraints=constraints,
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": STEPS},
    )
    u = np.clip(result.x, 0.0, 1.0)
    values, slopes = at(u)
    end = _judged(program, u, values, slopes, size, int(result.nit), str(result.message))
    if end.stationarity < OPTIMAL or end.multipliers.any() or end.bounds.any():
        return end
    return replace(end, distance=_distance(at, u, slopes[0]))


def _distance(at: Callable[[Array], tuple[Array, Array]], u: Array, slope: Array) -> float:
    """How far along the gradient its zero is, by the curvature there: a steep valley leaves a gradient at its floor."""
    along = -slope / np.linalg.norm(slope)
    try:
        ahead = np.clip(u + PROBE * along, 0.0, 1.0)
        curvature = (at(ahead)[1][0] - slope) @ along / max(float((ahead - u) @ along), 1e-3 * PROBE)
    except SolverError:
        return np.inf
    return float(np.linalg.norm(slope) / curvature) if curvature > 0 else np.inf


def _judged(
    program: Program, u: Array, values: Array, slopes: Array, size: Array, iterations: int, message: str
) -> ProgramEnd:
    """The end of a search with its multipliers, by non-negative least squares over what is active."""
    from scipy.optimize import lsq_linear

    width, c = program.high - program.low, len(u)
    active = program.equal | (values[1:] > -ACTIVE)
    rows = np.flatnonzero(active)
    ends = np.where(u < ACTIVE, -1.0, np.where(u > 1 - ACTIVE, 1.0, 0.0))
    sides = np.flatnonzero(ends)
    # grad f + sum lambda_i grad g_i + sum m_j (+-e_j) = 0
    columns = np.hstack([slopes[1:][rows].T, np.eye(c)[:, sides] * ends[sides]])
    lowest = np.concatenate([np.where(program.equal[rows], -np.inf, 0.0), np.zeros(len(sides))])
    found, rest = np.zeros(columns.shape[1]), slopes[0]
    if columns.shape[1]:
        found = lsq_linear(columns, -slopes[0], (lowest, np.inf), tol=1e-14).x
        rest = slopes[0] + columns @ found
    multipliers, bounds = np.zeros(len(program.scale)), np.zeros(c)
    multipliers[rows] = found[: len(rows)] * size[0] / size[1:][rows]
    bounds[sides] = ends[sides] * found[len(rows) :] * size[0] / width[sides]
    wrong = np.where(program.equal, np.abs(values[1:]), np.maximum(values[1:], 0.0))
    return ProgramEnd(
        x=program.low + u * width,
        values=values * size,
        multipliers=multipliers,
        bounds=bounds,
        stationarity=float(np.abs(rest).max(initial=0.0)),
        infeasibility=float(wrong.max(initial=0.0)),
        iterations=iterations,
        message=message,
    )
