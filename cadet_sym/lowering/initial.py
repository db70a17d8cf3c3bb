"""The moments at the start as a CasADi function of the parameters.

Standing on stationary ground, the filter's covariance obeys C P + P C^T + D Q D^T = 0, and two wheels at
setbacks L_i <= L_j on one track are correlated by E[xi_i xi_j^T] = exp(C (L_j - L_i)) P. The vehicle starts at
x(0) = offset + map xi(0) + delta. Ground that is smooth behind the start has no covariance at all.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem, FilterCopy
from cadet_sym.delay import STANDING, DelayGrid, Gap, TrackDelay, transport_matrix
from cadet_sym.language.expression import DISTANCE, SPEED, SPEED_RATE, TIME
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.lowering.system import LoweredSystem

__all__ = ["filter_matrices", "filters", "initial_moments", "places", "profiles", "unevenness", "vehicle_start"]

_Environment = Mapping[sp.Symbol, ca.SX]

def initial_moments(lowered: LoweredSystem, linear_solver: str = "qr") -> ca.Function:
    """p -> y(0), packed; the caller has made sure that the filter has a stationary covariance.

    Differentiable in p: the Lyapunov equation and the matrix exponential are written as linear solves. With
    "symbolicqr" for `linear_solver` the function can be expanded into scalar operations.
    """
    equations = lowered.equations
    system, packing = equations.quasi_linear.system, equations.packing
    p = ca.MX.sym("p", len(lowered.parameters))
    nf = packing.n - system.vehicle_size
    offset, linear, delta = vehicle_start(lowered)(p)
    mean = ca.vertcat(offset, ca.MX.zeros(nf, 1))
    ground = _GroundStart(lowered, p, mean, linear_solver)
    P_ground = ground.covariance(nf)
    cross = ca.mtimes(linear, P_ground)
    P = ca.blockcat([[ca.mtimes(cross, linear.T) + delta, cross], [cross.T, P_ground]])
    triangle = ca.densify(P)[ca.Sparsity.lower(packing.n)].nz[:]
    parts = [mean, triangle]
    if packing.distance:
        parts.append(lowered.motion(0, p)[3])
    if equations.delay is not None:
        parts += ground.correlation(equations.delay)
    return ca.Function("initial", [p], [ca.densify(ca.vertcat(*parts))], ["p"], ["y"])


def filter_matrices(lowered: LoweredSystem, copy: FilterCopy) -> ca.Function:
    """p -> C, D Q D^T, D of one filter copy at the start: where the rearmost wheel of its track stands.

    Were each copy taken at its own place, where coefficients vary, the wheels would not meet one and the same ground.
    """
    system = lowered.equations.quasi_linear.system
    behind = [other.setback for other in system.copies if other.track == copy.track]
    return _matrices_behind(lowered, copy, max(behind, key=system.model.number))


def _matrices_behind(lowered: LoweredSystem, copy: FilterCopy, setback: sp.Expr) -> ca.Function:
    """p -> C, D Q D^T, D of a filter copy where a wheel of that setback stands at the start."""
    p, env = _start_environment(lowered)
    here = {DISTANCE: env[DISTANCE] - to_casadi(setback, env)}
    C, D, Q = (_dense(m, {**env, **here}) for m in (copy.filter.C, copy.filter.D, copy.filter.Q))
    return ca.Function("filter", [p], [C, ca.mtimes([D, Q, D.T]), D], ["p"], ["C", "DQD", "D"])


def unevenness(lowered: LoweredSystem) -> ca.Function:
    """p -> by how much the ground under a wheel at the start is other than under the rearmost of its track, relative."""
    p = ca.SX.sym("p", len(lowered.parameters))
    worst = ca.SX(0)
    for copy in lowered.equations.quasi_linear.system.copies:
        there, own = filter_matrices(lowered, copy)(p), _matrices_behind(lowered, copy, copy.setback)(p)
        for a, b in zip(there[:2], own[:2], strict=True):
            size = ca.norm_fro(a) + ca.norm_fro(b)
            worst = ca.fmax(worst, ca.if_else(size > 0, ca.norm_fro(a - b) / size, 0))
    return ca.Function("unevenness", [p], [worst])


def filters(lowered: LoweredSystem) -> ca.Function:
    """P -> C of every filter copy where it stands at the start."""
    p = ca.SX.sym("p", len(lowered.parameters))
    copies = lowered.equations.quasi_linear.system.copies
    return ca.Function("filters", [p], [filter_matrices(lowered, copy)(p)[0] for copy in copies])


def profiles(lowered: LoweredSystem) -> ca.Function:
    """(s, p) -> C(s), offset(s) of every filter copy, one after the other."""
    s, p = ca.SX.sym("s"), ca.SX.sym("p", len(lowered.parameters))
    env = lowered.environment(ca.vertcat(0, s, 0, 0), p)
    copies = lowered.equations.quasi_linear.system.copies
    parts = [_dense(matrix, env) for copy in copies for matrix in (copy.filter.C, copy.filter.offset)]
    return ca.Function("profiles", [s, p], parts)


def places(lowered: LoweredSystem) -> ca.Function:
    """P -> setback of every filter copy, places of the edges of the ground's profile."""
    p = ca.SX.sym("p", len(lowered.parameters))
    env = lowered.environment(ca.SX(4, 1), p)
    system = lowered.equations.quasi_linear.system
    ground = system.model.ground
    setbacks = [to_casadi(copy.setback, env) for copy in system.copies]
    edges = [] if ground is None else [to_casadi(place, env) for place in ground.breakpoints]
    return ca.Function("places", [p], [ca.SX(ca.vertcat(*setbacks)), ca.SX(ca.vertcat(*edges))])


class _GroundStart:
    """Covariances of the filter copies at the start."""

    def __init__(self, lowered: LoweredSystem, p: ca.MX, mean: ca.MX, linear_solver: str) -> None:
        self.lowered, self.p, self.mean, self.linear_solver = lowered, p, mean, linear_solver
        self.system: AugmentedSystem = lowered.equations.quasi_linear.system
        self.smooth = self.system.model.initial.ground == "smooth"
        self.setback = lowered.noise(ca.MX.zeros(4), p)[2]
        self.known: dict[int, ca.MX] = {}

    def filter(self, copy: FilterCopy) -> tuple[ca.MX, ca.MX, ca.MX]:
        """C, D Q D^T and D of a copy."""
        C, forcing, D = filter_matrices(self.lowered, copy)(self.p)
        return C, forcing, D

    def stationary(self, copy: FilterCopy) -> ca.MX:
        """Stationary covariance of a copy."""
        if copy.start not in self.known:
            C, forcing, _ = self.filter(copy)
            self.known[copy.start] = _lyapunov(C, forcing, self.linear_solver)
        return self.known[copy.start]

    def covariance(self, nf: int) -> ca.MX:
        """Covariance of all filter states, copies on one track correlated over the distance between them."""
        if self.smooth or nf == 0:
            return ca.MX.zeros(nf, nf)
        copies = self.system.copies
        rows = []
        for a in copies:
            row = []
            for b in copies:
                size = len(a.filter.states), len(b.filter.states)
                row.append(self._between(a, b) if a.track == b.track else ca.MX.zeros(*size))
            rows.append(row)
        return ca.blockcat(rows)

    def _between(self, a: FilterCopy, b: FilterCopy) -> ca.MX:
        if a is b:
            return self.stationary(a)
        distance = self.setback[b.columns[0]] - self.setback[a.columns[0]]
        behind = float(self.system_value(b.setback) - self.system_value(a.setback))
        if behind > 0:  # b is behind a: xi_a = exp(C d) xi_b + what the noise between them brought
            C = self.filter(b)[0]
            return ca.mtimes(_expm(C * distance, self._squarings(b, behind), self.linear_solver), self.stationary(b))
        return self._between(b, a).T

    def system_value(self, expression: sp.Expr) -> float:
        values = self.system.model.parameter_values()
        return float(expression.subs({sp.Symbol(k, real=True): v for k, v in values.items()}))

    def _squarings(self, copy: FilterCopy, distance: float) -> int:
        """Halvings that bring |C d| below 1/16 at the declared parameters; it may grow 16-fold without harm."""
        values = self.system.model.parameter_values()
        C = filter_matrices(self.lowered, copy)(ca.DM([values[k] for k in self.lowered.parameters]))[0]
        norm = float(np.abs(np.asarray(C)).sum(axis=1).max()) * abs(distance)
        return max(0, int(np.ceil(np.log2(max(norm, 1e-300) * 16))))

    def correlation(self, grid: DelayGrid) -> list[ca.MX]:
        """G behind each wheel as it is packed, what is carried and what is known."""
        carried, known = [], []
        for track in grid.tracks:
            standing = self._standing(track)
            modes_of_gaps = self._behind_smooth(track, standing) if self.smooth else standing
            for gap, modes in zip(track.gaps, modes_of_gaps, strict=True):
                carried += [ca.vec(mode[: grid.rows, :]) for mode in modes]
                known += [ca.vec(mode[list(gap.known), :]) for mode in modes]
        return carried + known

    def _standing(self, track: TrackDelay) -> list[list[ca.MX]]:
        """Modes (n, q) of exp(C (theta - L_k)) D in the rows of each filter copy, mapped to the vehicle, gap by gap.

        Solved in the discrete form itself, so that its equations start without a transient.
        """
        copies = [next(c for c in self.system.copies if c.columns == columns) for columns in track.columns]
        nv, n = self.system.vehicle_size, self.lowered.equations.packing.n
        linear = vehicle_start(self.lowered)(self.p)[1]
        tails = [ca.MX.zeros(len(c.filter.states), track.noises) for c in copies]
        found = []
        for k, gap in enumerate(track.gaps):
            tails[k] = self.filter(copies[k])[2]
            length = self.setback[copies[k + 1].columns[0]] - self.setback[copies[k].columns[0]]
            modes = []
            for _ in range(gap.elements):
                columns = [
                    _travelled(self.filter(c)[0] * (length / gap.elements), tail, gap, self.linear_solver)
                    for c, tail in zip(copies, tails, strict=True)
                ]
                tails = [values[-1] for values in columns]
                for j in range(gap.modes):
                    ground = ca.MX.zeros(n - nv, track.noises)
                    for copy, values in zip(copies, columns, strict=True):
                        ground[copy.start - nv : copy.start - nv + values[j].size1(), :] = values[j]
                    modes.append(ca.vertcat(ca.mtimes(linear, ground), ground))
            found.append(modes)
        return found

    def _behind_smooth(self, track: TrackDelay, standing: list[list[ca.MX]]) -> list[list[ca.MX]]:
        """Ground that is flat is not read before its gate opens: any smooth data will do, those of steady travel do best.

        From rest these are constants, but what is known does not depend on the speed.
        """
        packing = self.lowered.equations.packing
        V, dV, _, start = self.lowered.motion(0, self.p)
        context = ca.vertcat(0, start, V, dV)
        b = self.lowered.noise(context, self.p)[0]
        rest = ca.MX.zeros(packing.moments - packing.n, 1)
        N = self.lowered.gain_matrix(ca.vertcat(self.mean, rest), context, self.p)
        moving = self.speed_at_start() > STANDING
        tail, found = ca.MX.zeros(packing.n, track.noises), []
        for k, gap in enumerate(track.gaps):
            tail += b[:, list(track.columns[k])]
            if not moving:
                count = gap.elements * gap.modes
                level = [tail if (j + 1) % gap.modes < 2 else ca.MX.zeros(*tail.shape) for j in range(count)]
                steady = packing.rows if packing.known else packing.n
                pairs = zip(level, standing[k], strict=True)
                found.append([ca.vertcat(flat[:steady, :], known[steady:, :]) for flat, known in pairs])
                continue
            length = self.setback[track.columns[k + 1][0]] - self.setback[track.columns[k][0]]
            modes = []
            for _ in range(gap.elements):
                values = _travelled(N * (length / gap.elements / V), tail, gap, self.linear_solver)
                modes += values
                tail = values[-1]
            found.append(modes)
        return found

    def speed_at_start(self) -> float:
        """V(0) at the declared parameters."""
        values = self.system.model.parameter_values()
        return float(self.lowered.motion(0, ca.DM([values[k] for k in self.lowered.parameters]))[0])


def _start_environment(lowered: LoweredSystem) -> tuple[ca.SX, dict[sp.Symbol, ca.SX]]:
    """Parameters, t = 0, and the speed and place there."""
    p = ca.SX.sym("p", len(lowered.parameters))
    V, dV, _, start = lowered.motion(0, p)
    env = lowered.environment(ca.vertcat(0, start, V, dV), p)
    assert {TIME, DISTANCE, SPEED, SPEED_RATE} <= env.keys()
    return p, env


def vehicle_start(lowered: LoweredSystem) -> ca.Function:
    """p -> offset (nv), map (nv, nf), covariance (nv, nv) of the vehicle's initial state."""
    p, env = _start_environment(lowered)
    system = lowered.equations.quasi_linear.system
    parts = [
        _dense(matrix, env)
        for matrix in (system.initial_offset, system.initial_map, system.initial_covariance)
    ]
    return ca.Function("vehicle", [p], parts, ["p"], ["offset", "map", "delta"])


def _travelled(operator: ca.MX, inflow: ca.MX, gap: Gap, linear_solver: str) -> list[ca.MX]:
    """Modes in one element of G_theta = operator G / h, from the inflow."""
    T, e = transport_matrix(gap.modes)
    r = operator.size1()
    matrix = ca.kron(ca.DM(T), ca.MX.eye(r)) - ca.kron(ca.MX.eye(gap.modes), ca.densify(operator))
    values = ca.solve(ca.densify(matrix), ca.densify(-ca.kron(ca.DM(e), inflow)), linear_solver)
    return [values[j * r : (j + 1) * r, :] for j in range(gap.modes)]


def _dense(matrix: sp.ImmutableMatrix, env: _Environment) -> ca.SX:
    result = ca.SX.zeros(matrix.rows, matrix.cols)
    for (i, j), value in matrix.todok().items():
        result[i, j] = to_casadi(value, env)
    return result


def _lyapunov(C: ca.MX, forcing: ca.MX, linear_solver: str) -> ca.MX:
    """P of C P + P C^T + forcing = 0, as one linear system over the r^2 entries."""
    r = C.size1()
    identity = ca.MX.eye(r)
    operator = ca.densify(ca.kron(identity, C) + ca.kron(C, identity))
    P = ca.reshape(ca.solve(operator, -ca.densify(ca.vec(forcing)), linear_solver), r, r)
    return (P + P.T) / 2


def _expm(matrix: ca.MX, squarings: int, linear_solver: str) -> ca.MX:
    """exp(matrix) by the [7/7] Pade approximant with scaling and squaring (Higham 2005)."""
    coefficients = (17297280, 8648640, 1995840, 277200, 25200, 1512, 56, 1)
    A = ca.densify(matrix) / 2.0**squarings
    power, even, odd = ca.MX.eye(A.size1()), ca.MX.zeros(*A.shape), ca.MX.zeros(*A.shape)
    for k, coefficient in enumerate(coefficients):
        if k % 2 == 0:
            even += coefficient * power
        else:
            odd += coefficient * power
        power = ca.mtimes(power, A)
    result = ca.solve(ca.densify(even - odd), ca.densify(even + odd), linear_solver)
    for _ in range(squarings):
        result = ca.mtimes(result, result)
    return result
