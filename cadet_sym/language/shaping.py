"""Shaping filters: the ground as a linear system in distance driven by white noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.noise import Noise
from cadet_sym.language.vocabulary import DISTANCE, symbol


@dataclass(frozen=True)
class ShapingFilter:
    """xi'(s) = C xi + D w + offset(s), height u = F xi + profile(s), E[w(s) w(s')^T] = Q delta(s - s').

    Parameters
    ----------
    states : names of the r states.
    C : (r, r), 1/length.  D : (r, m).  Q : (m, m), two-sided intensity.  F : (1, r).  offset : (r, 1).
    profile : deterministic height. All may depend on `DISTANCE` and on parameters.
    """

    states: tuple[str, ...]
    C: sp.ImmutableMatrix
    D: sp.ImmutableMatrix
    Q: sp.ImmutableMatrix
    F: sp.ImmutableMatrix
    offset: sp.ImmutableMatrix
    profile: sp.Expr = sp.S.Zero

    @property
    def is_flat(self) -> bool:
        """Whether there is neither a random height nor a deterministic one."""
        return bool(self.D.is_zero_matrix and self.offset.is_zero_matrix and self.profile == 0)

    @property
    def is_homogeneous(self) -> bool:
        """Whether the filter is the same all along the road; the deterministic part may vary."""
        return not any(DISTANCE in m.free_symbols for m in (self.C, self.D, self.Q, self.F))


def make_filter(
    states: tuple[str, ...], C: list, D: list, Q: list, F: list, offset: list | None = None
) -> ShapingFilter:
    """A filter from nested lists."""
    matrix = sp.ImmutableMatrix
    zero = [[0]] * len(states)
    return ShapingFilter(states, matrix(C), matrix(D), matrix(Q), matrix(F), matrix(offset or zero))


def filter_of_rates(rates: Mapping[sp.Symbol, sp.Expr], noise: Noise, height: sp.Expr) -> ShapingFilter:
    """The filter that first-order equations in distance declare; they must be linear."""
    states, noises = list(rates), [symbol(name) for name in noise.names]
    unknowns = {*states, *noises}
    C, D = sp.zeros(len(states), len(states)), sp.zeros(len(states), len(noises))
    offset = sp.zeros(len(states), 1)
    for i, (state, rate) in enumerate(rates.items()):
        for j, unknown in enumerate([*states, *noises]):
            slope = sp.expand(sp.diff(rate, unknown)) if unknown in rate.free_symbols else sp.S.Zero
            if slope.free_symbols & unknowns:
                raise ModelError(
                    f"the equations of the ground are linear; the rate of `{state}` is not linear in `{unknown}`",
                    table="ground",
                    key=f"rates.{state}",
                    token=unknown.name,
                )
            target, column = (C, j) if j < len(states) else (D, j - len(states))
            target[i, column] = slope
        offset[i] = rate.xreplace(dict.fromkeys(unknowns, sp.S.Zero))
    F = [sp.diff(height, state) for state in states]
    if any(f.free_symbols & unknowns for f in F):
        raise ModelError("the height is linear in the states of the ground", table="ground", key="height")
    profile = height.xreplace(dict.fromkeys(states, sp.S.Zero))
    matrix = sp.ImmutableMatrix
    return ShapingFilter(
        tuple(s.name for s in states),
        matrix(C),
        matrix(D),
        noise.intensity,
        matrix([F]),
        matrix(offset),
        profile,
    )


def rolled(road: ShapingFilter, cutoff: sp.Expr) -> ShapingFilter:
    """The height under a rolling contact: u' = cutoff (F xi + profile - u).

    Where the road's height is a state of its own, that state gives way to `height` = u and `slope` = cutoff (F xi - u),
    which is u' where there is no profile; else, and where the cut-off varies, `height` joins the states.
    """
    names = [n if n not in ("height", "slope") else f"road_{n}" for n in road.states]
    unit = [j for j, f in enumerate(road.F) if f == 1]
    b = cutoff
    if len(unit) == 1 and sum(f != 0 for f in road.F) == 1 and DISTANCE not in b.free_symbols:
        return _rolled_state(road, b, unit[0], names)
    return cascade(road, make_filter(("height",), [[-b]], [[b]], [[1]], [[1]]))


def cascade(road: ShapingFilter, second: ShapingFilter) -> ShapingFilter:
    """The road's height, profile included, as the input of a second filter; its states come first."""
    taken = {*second.states}
    names = [n if n not in taken else f"road_{n}" for n in road.states]
    B, m = second.D, road.D.cols
    C = sp.Matrix(sp.BlockMatrix([[second.C, B * road.F], [sp.zeros(len(names), len(second.states)), road.C]]))
    D = sp.Matrix.vstack(sp.zeros(len(second.states), m), sp.Matrix(road.D))
    offset = sp.Matrix.vstack(sp.Matrix(B * road.profile), sp.Matrix(road.offset))
    F = sp.Matrix.hstack(sp.Matrix(second.F), sp.zeros(1, len(names)))
    matrix = sp.ImmutableMatrix
    return ShapingFilter((*second.states, *names), matrix(C), matrix(D), road.Q, matrix(F), matrix(offset))


def _rolled_state(road: ShapingFilter, b: sp.Expr, j: int, names: list[str]) -> ShapingFilter:
    """States (u, q = b (h - u), the others), h = u + q / b; then u' = q + b g and q' = b (h' - u')."""
    others = [k for k in range(len(names)) if k != j]
    n, m = len(names) + 1, road.D.cols
    C, D, offset = sp.zeros(n, n), sp.zeros(n, m), sp.zeros(n, 1)
    C[0, 1] = sp.S.One
    C[1, 0] = b * road.C[j, j]
    C[1, 1] = sp.expand(road.C[j, j] - b)
    offset[0] = b * road.profile
    offset[1] = b * (road.offset[j] - b * road.profile)
    D[1, :] = b * road.D[j, :]
    for row, k in enumerate(others, start=2):
        C[1, row] = b * road.C[j, k]
        C[row, 0], C[row, 1] = road.C[k, j], road.C[k, j] / b
        D[row, :] = road.D[k, :]
        offset[row] = road.offset[k]
        for column, other in enumerate(others, start=2):
            C[row, column] = road.C[k, other]
    return _filter(("height", "slope", *(names[k] for k in others)), C, D, road, offset)


def _filter(
    states: tuple[str, ...], C: sp.Matrix, D: sp.Matrix, road: ShapingFilter, offset: sp.Matrix
) -> ShapingFilter:
    matrix = sp.ImmutableMatrix
    F = sp.zeros(1, len(states))
    F[0] = 1
    return ShapingFilter(states, matrix(C), matrix(D), road.Q, matrix(F), matrix(offset))


def with_profile(road: ShapingFilter, profile: sp.Expr) -> ShapingFilter:
    """The road with a deterministic height added."""
    return replace(road, profile=road.profile + profile)
