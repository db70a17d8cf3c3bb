"""The correlation with the ground between the wheels, collocated, as CasADi expressions (see `cadet_sym.delay`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import sympy as sp

from cadet_sym.delay import DelayGrid, Gap, TrackDelay, radau
from cadet_sym.language.expression import SPEED
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.moments import MomentEquations, gate_symbol

__all__ = ["ground_rates", "tracks_of", "transport", "wheel_forcing"]

_Environment = Mapping[sp.Symbol, ca.SX]


def wheel_forcing(equations: MomentEquations, g: ca.SX, env: _Environment) -> ca.SX:
    """What wheels that follow each other add to P' (n, n): V sum_(k>=2) (g_k Q b_k^T + b_k Q g_k^T)."""
    assert equations.delay is not None
    n = equations.packing.n
    forcing = ca.SX(n, n)
    for track, nodes in tracks_of(equations.delay, g):
        setbacks = _setbacks(equations, track)
        intensity, first = _intensity(equations, track, env), 0
        for k, gap in enumerate(track.gaps, start=1):
            first += gap.elements * gap.nodes
            gate = env.get(gate_symbol(setbacks[k]), ca.SX(1))
            cross = ca.mtimes([nodes[first - 1], intensity, _columns(equations, track.columns[k], env).T]) * gate
            forcing += env[SPEED] * (cross + cross.T)
    return forcing


def ground_rates(equations: MomentEquations, N: ca.SX, g: ca.SX, env: _Environment) -> ca.SX:
    """The rate of the packed correlation g: G_j' = N G_j - (V/h) (sum_i D_ji G_i + D_j0 G_in)."""
    assert equations.delay is not None
    rates, travel = [], iter(transport(equations, env))
    for track, nodes in tracks_of(equations.delay, g):
        first = 0
        for k, gap in enumerate(track.gaps):
            speed, entering = next(travel)
            inflow = entering if k == 0 else nodes[first - 1] + entering
            rates += _gap_rates(gap, N, speed, inflow, nodes[first : first + gap.elements * gap.nodes])
            first += gap.elements * gap.nodes
    return ca.vertcat(*(ca.vec(rate) for rate in rates))


def transport(equations: MomentEquations, env: _Environment) -> list[tuple[ca.SX, ca.SX]]:
    """For every gap of every track: elements passed a second V/h, and what the wheel before it adds, b_k (n, q)."""
    assert equations.delay is not None
    travel = []
    for track in equations.delay.tracks:
        setbacks = _setbacks(equations, track)
        for k, gap in enumerate(track.gaps):
            speed = env[SPEED] * gap.elements / to_casadi(setbacks[k + 1] - setbacks[k], env)
            travel.append((speed, _columns(equations, track.columns[k], env)))
    return travel


def tracks_of(grid: DelayGrid, g: ca.SX) -> Iterator[tuple[TrackDelay, list[ca.SX]]]:
    """Each track with its nodes, matrices (n, q), cut from the packed correlation."""
    first = 0
    for track in grid.tracks:
        q = len(track.columns[0])
        size = grid.states * q
        nodes = [
            ca.reshape(g[first + j * size : first + (j + 1) * size], grid.states, q)
            for j in range(track.nodes)
        ]
        first += size * track.nodes
        yield track, nodes


def _gap_rates(gap: Gap, N: ca.SX, speed: ca.SX, inflow: ca.SX, nodes: list[ca.SX]) -> list[ca.SX]:
    """Rates at the nodes of one gap; `speed` is that of travel, in elements."""
    _, D = radau(gap.nodes)
    rates = []
    starts = range(0, len(nodes), gap.nodes)
    for start, entry in zip(starts, [inflow, *(nodes[s - 1] for s in starts[1:])], strict=True):
        element = nodes[start : start + gap.nodes]
        for row, value in zip(D, element, strict=True):
            slope = row[0] * entry
            for weight, node in zip(row[1:], element, strict=True):
                slope += weight * node
            rates.append(ca.densify(ca.mtimes(N, value) - speed * slope))
    return rates


def _setbacks(equations: MomentEquations, track: TrackDelay) -> list[sp.Expr]:
    """How far behind the leading wheel each wheel of a track is."""
    behind = {copy.columns: copy.setback for copy in equations.quasi_linear.system.copies}
    return [behind[columns] for columns in track.columns]


def _columns(equations: MomentEquations, columns: tuple[int, ...], env: _Environment) -> ca.SX:
    """Noise input b_k (n, q) of the wheels at one setback."""
    source = equations.quasi_linear.system.noise_input
    matrix = ca.SX(source.rows, len(columns))
    for j, column in enumerate(columns):
        for i in range(source.rows):
            if source[i, column] != 0:
                matrix[i, j] = to_casadi(source[i, column], env)
    return matrix


def _intensity(equations: MomentEquations, track: TrackDelay, env: _Environment) -> ca.SX:
    """Intensity Q of the track's noises, as its first wheel meets them."""
    Q = equations.quasi_linear.system.intensity
    first = track.columns[0]
    return ca.vertcat(*(ca.horzcat(*(to_casadi(Q[i, j], env) for j in first)) for i in first))
