"""The correlation with the ground between the wheels, in Legendre modes, as CasADi expressions (see `cadet_sym.delay`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import sympy as sp

from cadet_sym.delay import DelayGrid, Gap, TrackDelay
from cadet_sym.language.expression import SPEED
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.moments import MomentEquations, gate_symbol

__all__ = ["ground_rates", "transport", "wheel_forcing"]

_Environment = Mapping[sp.Symbol, ca.SX]

_Element = list[ca.SX]
"""The modes of one element, (n, q) each, what leaves it last; filters that are not reached yet have structural zeros."""


def wheel_forcing(equations: MomentEquations, g: ca.SX, env: _Environment) -> ca.SX:
    """What wheels that follow each other add to P' (n, n): V sum_(k>=2) (g_k Q b_k^T + b_k Q g_k^T)."""
    assert equations.delay is not None
    n = equations.packing.n
    forcing = ca.SX(n, n)
    for track, gaps in _tracks(equations.delay, n, g):
        setbacks = _setbacks(equations, track)
        for k, elements in enumerate(gaps, start=1):
            gate = env.get(gate_symbol(setbacks[k]), ca.SX(1))
            intensity = _intensity(equations, track.columns[k], env)
            cross = ca.mtimes([elements[-1][-1], intensity, _columns(equations, track.columns[k], env).T]) * gate
            forcing += env[SPEED] * (cross + cross.T)
    return forcing


def ground_rates(equations: MomentEquations, N: ca.SX, g: ca.SX, env: _Environment) -> ca.SX:
    """The rate of the packed correlation g; that of what is known is zero."""
    grid = equations.delay
    assert grid is not None
    rates, travel = [], iter(transport(equations, env))
    N = N[: grid.rows, :]
    for _, gaps in _tracks(grid, equations.packing.n, g):
        leaving = ca.SX(N.size2(), 1)
        for k, elements in enumerate(gaps):
            speed, entering = next(travel)
            inflow = entering if k == 0 else leaving + entering
            rates += _gap_rates(N, speed, inflow, elements)
            leaving = elements[-1][-1]
    return ca.vertcat(*(ca.vec(ca.densify(rate)) for rate in rates), ca.SX.zeros(grid.known, 1))


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


def _tracks(grid: DelayGrid, n: int, g: ca.SX) -> Iterator[tuple[TrackDelay, list[list[_Element]]]]:
    """Each track with the elements of its gaps, cut from the packed correlation."""
    carried, known = 0, grid.carried
    for track in grid.tracks:
        gaps = []
        for gap in track.gaps:
            here, there = (gap.elements * gap.modes * track.noises * r for r in (grid.rows, len(gap.known)))
            parts = g[carried : carried + here], g[known : known + there]
            gaps.append(_elements(grid, gap, track.noises, n, *parts))
            carried, known = carried + here, known + there
        yield track, gaps


def _elements(grid: DelayGrid, gap: Gap, q: int, n: int, carried: ca.SX, known: ca.SX) -> list[_Element]:
    def mode(j: int) -> ca.SX:
        matrix = ca.SX(n, q)
        for rows, values in ((list(range(grid.rows)), carried), (list(gap.known), known)):
            if rows:
                size = len(rows) * q
                matrix[rows, :] = ca.reshape(values[j * size : (j + 1) * size], len(rows), q)
        return matrix

    return [[mode(e * gap.modes + i) for i in range(gap.modes)] for e in range(gap.elements)]


def _gap_rates(N: ca.SX, speed: ca.SX, inflow: ca.SX, elements: list[_Element]) -> list[ca.SX]:
    """Rates of all modes of one gap, (rows, q) each; `speed` is that of travel, in elements.

    a_i' = N a_i - slope_i,    slope_i = 2 speed (2i + 1) half_i,    half_i = half_(i-2) - a_(i-1),
    half_(0,1) from (out -+ in) / 2,    out' = N out - sum_i slope_i
    """
    rates, rows = [], slice(N.size1())
    weights = [2 * (2 * i + 1) * speed for i in range(len(elements[0]))]
    for element in elements:
        entering, leaving = inflow[rows, :] / 2, element[-1][rows, :] / 2
        halves = [leaving - entering]
        for i, mode in enumerate(element[:-1], start=1):
            halves.append((halves[i - 2] if i > 1 else leaving + entering) - mode[rows, :])
        slopes = [weight * half for weight, half in zip(weights, halves, strict=True)]
        slopes[-1] = sum(slopes[1:], start=slopes[0])
        rates += [ca.mtimes(N, mode) - slope for mode, slope in zip(element, slopes, strict=True)]
        inflow = element[-1]
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


def _intensity(equations: MomentEquations, columns: tuple[int, ...], env: _Environment) -> ca.SX:
    """Intensity Q of the noises (q, q) as the wheels at one setback meet them: the ground's where they are."""
    Q = equations.quasi_linear.system.intensity
    return ca.vertcat(*(ca.horzcat(*(to_casadi(Q[i, j], env) for j in columns)) for i in columns))
