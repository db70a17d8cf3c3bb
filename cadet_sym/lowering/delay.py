"""The correlation with the ground between the wheels, collocated, as CasADi expressions (see `cadet_sym.delay`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import sympy as sp

from cadet_sym.delay import DelayGrid, Gap, TrackDelay, radau
from cadet_sym.language.expression import SPEED
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.moments import MomentEquations, gate_symbol

__all__ = ["delay_rates", "tracks_of"]

_Environment = Mapping[sp.Symbol, ca.SX]


def delay_rates(equations: MomentEquations, N: ca.SX, g: ca.SX, env: _Environment) -> tuple[ca.SX, ca.SX]:
    """What wheels that follow each other add to P' (n, n), and the rate of the packed correlation g.

    G_j' = N G_j - (V/h) (sum_i D_ji G_i + D_j0 G_in);   P' gets V sum_(k>=2) (g_k Q b_k^T + b_k Q g_k^T).
    """
    assert equations.delay is not None
    V = env[SPEED]
    forcing = ca.SX(N.size1(), N.size1())
    rates = []
    for track, nodes in tracks_of(equations.delay, g):
        inputs = [_columns(equations, columns, env) for columns in track.columns]
        setbacks = _setbacks(equations, track)
        intensity = _intensity(equations, track, env)
        inflow, first = inputs[0], 0
        for k, gap in enumerate(track.gaps, start=1):
            count = gap.elements * gap.nodes
            speed = V * gap.elements / to_casadi(setbacks[k] - setbacks[k - 1], env)
            rates += _gap_rates(gap, N, speed, inflow, nodes[first : first + count])
            first += count
            arriving = nodes[first - 1]
            gate = env.get(gate_symbol(setbacks[k]), ca.SX(1))
            cross = ca.mtimes([arriving, intensity, inputs[k].T]) * gate
            forcing += V * (cross + cross.T)
            inflow = arriving + inputs[k]
    return forcing, ca.vertcat(*(ca.vec(rate) for rate in rates))


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
