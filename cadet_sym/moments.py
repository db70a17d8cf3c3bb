"""Turn a quasi-linear system into the coupled equations of its mean and covariance (CADET).

    mu' = A mu + c + sum_j b_j F_j                    F_j = E[f_j(z_j)], z_j Gaussian
    P'  = N P + P N^T + D                             N = A + sum_j b_j k_j^T C_j,  k_j = dF_j/dm_j

(Harrison & Hammond 1986, equations 6-9; Gelb & Warren 1973). D = b_t Q b_t^T + V b_s Q b_s^T is the diffusion.
The order in which the moments are packed into one vector is that of `Packing`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from cadet_sym.delay import DelayGrid, delay_grid
from cadet_sym.language.expression import SPEED, symbol
from cadet_sym.linearisation import QuasiLinearSystem
from cadet_sym.packing import Packing

__all__ = ["MomentEquations", "gate_symbol", "moment_equations"]

@dataclass(frozen=True)
class MomentEquations:
    """The moment equations, in symbols: means E[x], and for element j its expectation and gains.

    `mean_rate` and `gain_matrix` hold the symbols of `means`, `expectations` and `gains`; every element's
    describing function says what the latter are. `diffusion` is what noise that is met once contributes; wheels
    that meet the same noise one after the other add the cross terms of `delay`.
    """

    quasi_linear: QuasiLinearSystem
    packing: Packing
    means: tuple[sp.Symbol, ...]
    expectations: tuple[sp.Symbol, ...]  # F_j
    gains: tuple[tuple[sp.Symbol, ...], ...]  # k_j, one an argument
    mean_rate: tuple[sp.Expr, ...]
    gain_matrix: sp.ImmutableSparseMatrix  # N
    diffusion: sp.ImmutableSparseMatrix  # D
    gates: Mapping[
        sp.Symbol, sp.Expr
    ]  # smooth start: a wheel's noise is 0 until `setback` has been travelled
    delay: DelayGrid | None = None

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the augmented states."""
        return tuple(state.name for state in self.quasi_linear.states)

    def _repr_latex_(self) -> str:
        states = self.quasi_linear.system.states
        names = {m: rf"\mu_{{{sp.latex(state)}}}" for m, state in zip(self.means, states, strict=True)}

        def latex(expression: Any) -> str:
            return sp.latex(expression, symbol_names=names)

        N, D = latex(sp.Matrix(self.gain_matrix)), latex(sp.Matrix(self.diffusion))
        rows = (rf"\dot{{{names[m]}}} &= {latex(r)}" for m, r in zip(self.means, self.mean_rate, strict=True))
        return (
            r"$$\begin{aligned}" + r" \\ ".join(rows) + r"\end{aligned}$$"
            rf"$$\dot P = N P + P N^T + D,\quad N = {N},\quad D = {D}$$"
        )


def moment_equations(quasi_linear: QuasiLinearSystem, grid: tuple[int, int] = (4, 6)) -> MomentEquations:
    """Write the mean and covariance equations of a quasi-linear system (Harrison & Hammond 1986, eqs 6-9).

    Parameters
    ----------
    quasi_linear : the system in Lur'e form.
    grid : elements and modes an element on every stretch of ground between two wheels of one track (see `delay`).
    """
    system = quasi_linear.system
    n = len(system.states)
    means = tuple(symbol(f"E[{state.name}]") for state in system.states)
    # Names with brackets: no parameter of the user can be called so.
    expectations = tuple(symbol(f"F[{j + 1}]") for j in range(len(quasi_linear.elements)))
    gains = tuple(_gain_symbols(j, len(e.forms)) for j, e in enumerate(quasi_linear.elements))
    delay = delay_grid(system, *grid)
    gates = _gates(quasi_linear)
    return MomentEquations(
        quasi_linear=quasi_linear,
        packing=Packing(
            n,
            distance=system.distance is None and (system.needs_distance or bool(gates)),
            ground=0 if delay is None else delay.carried + delay.known,
            known=0 if delay is None else delay.known,
            rows=1 if delay is None else delay.rows,
        ),
        means=means,
        expectations=expectations,
        gains=gains,
        mean_rate=_mean_rate(quasi_linear, means, expectations),
        gain_matrix=_gain_matrix(quasi_linear, gains),
        diffusion=_diffusion(quasi_linear, gates),
        gates=gates,
        delay=delay,
    )


def _gain_symbols(j: int, count: int) -> tuple[sp.Symbol, ...]:
    names = [f"k[{j + 1}]"] if count == 1 else [f"k[{j + 1},{a + 1}]" for a in range(count)]
    return tuple(symbol(name) for name in names)


def _mean_rate(
    quasi_linear: QuasiLinearSystem, means: Sequence[sp.Symbol], expectations: Sequence[sp.Symbol]
) -> tuple[sp.Expr, ...]:
    """Mu' = A mu + c + b F."""
    rates = list(quasi_linear.c)
    for (i, j), value in quasi_linear.A.todok().items():
        rates[i] += value * means[j]
    for (i, j), value in quasi_linear.b.todok().items():
        rates[i] += value * expectations[j]
    return tuple(rates)


def _gain_matrix(
    quasi_linear: QuasiLinearSystem, gains: Sequence[Sequence[sp.Symbol]]
) -> sp.ImmutableSparseMatrix:
    """N = A + sum_j b_j k_j^T C_j."""
    n = len(quasi_linear.states)
    N = dict(quasi_linear.A.todok())
    for (i, j), value in quasi_linear.b.todok().items():
        for gain, form in zip(gains[j], quasi_linear.elements[j].forms, strict=True):
            for column, coefficient in form.coefficients:
                N[i, column] = N.get((i, column), sp.S.Zero) + value * gain * coefficient
    return sp.ImmutableSparseMatrix(n, n, N)


def _gates(quasi_linear: QuasiLinearSystem) -> Mapping[sp.Symbol, sp.Expr]:
    """Ground that is flat behind the start reaches a wheel only when it has travelled its setback."""
    system = quasi_linear.system
    if system.model.initial.ground != "smooth":
        return {}
    setbacks = dict.fromkeys(copy.setback for copy in system.copies if copy.setback != 0)
    return {gate_symbol(setback): setback for setback in setbacks}


def _gate(setback: sp.Expr, gates: Mapping[sp.Symbol, sp.Expr]) -> sp.Expr:
    gate = gate_symbol(setback)
    return gate if gate in gates else sp.S.One


def gate_symbol(setback: sp.Expr) -> sp.Symbol:
    """The symbol that is 1 once the wheels at this setback feel the ground."""
    return symbol(f"gate({setback})")


def _diffusion(
    quasi_linear: QuasiLinearSystem, gates: Mapping[sp.Symbol, sp.Expr]
) -> sp.ImmutableSparseMatrix:
    """D = b_t Q b_t^T + V b_s Q b_s^T."""
    system = quasi_linear.system
    weight = [
        SPEED * _gate(source.setback, gates) if source.domain == "distance" else sp.S.One
        for source in system.sources
    ]
    columns = [
        {i: v for i in range(len(system.states)) if (v := system.noise_input[i, j]) != 0}
        for j in range(len(system.sources))
    ]
    D: dict[tuple[int, int], sp.Expr] = {}
    for a, first in enumerate(columns):
        for b, second in enumerate(columns):
            intensity = system.intensity[a, b]
            if intensity == 0:
                continue
            for i, x in first.items():
                for j, y in second.items():
                    D[i, j] = D.get((i, j), sp.S.Zero) + sp.expand(x * intensity * y * weight[a])
    n = len(system.states)
    return sp.ImmutableSparseMatrix(n, n, D)
