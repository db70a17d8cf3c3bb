"""Where the ground's deterministic profile has brought the filters by the time the vehicle starts."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.augmentation import FilterCopy
from cadet_sym.language.expression import DISTANCE
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.lowering.initial import filter_matrices, vehicle_start
from cadet_sym.lowering.system import LoweredSystem

__all__ = ["profile_mean"]

Array = npt.NDArray[np.float64]

DECAY = 40.0
"""Decay lengths of the slowest mode that are looked back on: exp(-40) is below rounding."""


def profile_mean(lowered: LoweredSystem, p: Array) -> Array:
    """What the profile behind the start adds to the mean at t = 0, (n,).

    Each filter obeys xi' = C xi + o(s) in the mean; a profile that is zero behind every wheel adds nothing.
    """
    system = lowered.equations.quasi_linear.system
    mean = np.zeros(len(system.states))
    if system.model.ground is None or system.model.initial.ground == "smooth":
        return mean
    for copy in system.copies:
        if not copy.filter.offset.is_zero_matrix:
            mean[copy.states] = _response(lowered, copy, p)
    nv = system.vehicle_size
    linear = np.asarray(vehicle_start(lowered)(p)[1])
    mean[:nv] = linear @ mean[nv:]
    return mean


def _response(lowered: LoweredSystem, copy: FilterCopy, p: Array) -> npt.NDArray[np.floating]:
    """State of one filter where its wheel stands at the start, from all the profile behind it."""
    C = np.asarray(filter_matrices(lowered, copy)(p)[0])
    slowest = float(-np.linalg.eigvals(C).real.max())
    if not slowest > 1e-12 * np.abs(C).max():
        return np.zeros(len(C))
    matrices, here = _along(lowered, copy, p)
    behind = here - DECAY / slowest
    model = lowered.equations.quasi_linear.system.model
    assert model.ground is not None
    env = lowered.environment(ca.SX(4, 1), ca.SX(ca.DM(p)))
    edges = [float(ca.evalf(ca.SX(to_casadi(place, env)))) for place in model.ground.breakpoints]
    stops = [behind, *sorted(e for e in edges if behind < e < here), here]
    inside = np.concatenate([np.linspace(a, b, 42)[1:-1] for a, b in pairwise(stops)])
    offsets = np.asarray(matrices.map(len(inside))(inside[None, :])[1])
    if not np.any(offsets):
        return np.zeros(len(C))
    return _integrated(matrices, stops)


def _integrated(matrices: ca.Function, stops: list[float]) -> npt.NDArray[np.floating]:
    from scipy.integrate import solve_ivp

    def rate(s: float, xi: Array) -> Array:
        C, offset = matrices(s)
        return np.asarray(C) @ xi + np.asarray(offset).ravel()

    C, offset = (np.asarray(part) for part in matrices(stops[0]))
    xi: Array = np.asarray(np.linalg.solve(C, -offset.ravel()), dtype=float)
    for begin, end in pairwise(stops):
        inset = 1e-12 * (end - begin)  # on the stretch's own side of its edges
        found = solve_ivp(rate, (begin + inset, end - inset), xi, method="DOP853", rtol=1e-11, atol=1e-14)
        xi = np.asarray(found.y[:, -1], dtype=float)
    return xi


def _along(lowered: LoweredSystem, copy: FilterCopy, p: Array) -> tuple[ca.Function, float]:
    """Give s -> C(s), offset(s) of a filter, and the place of its wheel at the start."""
    s = ca.SX.sym("s")
    start = float(lowered.motion(0, p)[3])
    env = lowered.environment(ca.vertcat(0, s, 0, 0), ca.SX(ca.DM(p)))
    setback = float(ca.evalf(ca.SX(to_casadi(copy.setback, env))))
    env[DISTANCE] = s
    parts = [
        ca.densify(ca.vertcat(*(ca.horzcat(*(to_casadi(e, env) for e in row)) for row in matrix.tolist())))
        for matrix in (copy.filter.C, copy.filter.offset)
    ]
    return ca.Function("along", [s], parts, ["s"], ["C", "offset"]), start - setback
