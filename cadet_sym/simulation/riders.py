"""What can be carried along with a path: crossings of levels, and the quasi-linear twin.

The twin y is what statistical linearisation makes of the vehicle, driven by the path's own noise from the path's own
start,

    dy = (N y + g) dt + b dW,

and q is what the nonlinearity does to it to first order, the first step of Picard's iteration for x - y:

    dq = (N q + r(y)) dt,    r(y) = f(y) - N y - g.

N and g are those for which E[r(y)] = 0 and E[r(y) (y - m)^T] = 0, y being Gaussian of mean m and covariance P. So
E[q] = 0 and E[(y - m) q^T] = 0 at all times, exactly, while y + q follows the path closely: controls of known mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.language.expression import ElementCall
from cadet_sym.simulation.step import Layout, StepBody

__all__ = ["CrossingRider", "TwinRider", "is_affine"]


@dataclass
class CrossingRider:
    """For every level of a quantity: its up-crossings so far, and 1 once the quantity has been at or above it."""

    quantity: sp.Expr  # in the augmented states
    levels: tuple[float, ...]
    _lines: list[str] = field(default_factory=list)
    _first: int = 0

    @property
    def copied(self) -> Sequence[int]:
        """Counts and marks begin at zero."""
        return (-1,) * (2 * len(self.levels))

    def write(self, body: StepBody, first: int) -> None:
        """Evaluate the quantity before and after the step."""
        before, after = body.emitter("x", "u", "s", f"b{first}_"), body.emitter("m", "v", "e", f"b{first}_")
        old, new = before.operand(self.quantity), after.operand(self.quantity)
        self._first = first
        self._lines = [*before.lines, *after.lines, f"o{first} = {old}", f"i{first} = {new}"]

    def lines(self, layout: Layout) -> list[str]:
        """Count where it was below and is no longer."""
        lines, old, new = list(self._lines), f"o{self._first}", f"i{self._first}"
        for k, level in enumerate(self.levels):
            count, mark = layout.state(self._first + 2 * k), layout.state(self._first + 2 * k + 1)
            lines.append(f"{count} = {count} + where(({old} < {level!r}) & ({new} >= {level!r}), 1.0, 0.0)")
            lines.append(f"{mark} = where(({old} >= {level!r}) | ({new} >= {level!r}), 1.0, {mark})")
        return lines


@dataclass
class TwinRider:
    """Rows y, then rows q. Gains are given where a rate is not linear; linear rates are their own."""

    system: AugmentedSystem
    entries: dict[tuple[int, int], sp.Dummy] = field(default_factory=dict)  # N[a, b]; b = -1 for g[a]
    _nonlinear: tuple[int, ...] = ()
    _lines: list[str] = field(default_factory=list)
    _ends: list[str] = field(default_factory=list)
    _first: int = 0

    @property
    def copied(self) -> Sequence[int]:
        """The twin starts where the path starts, q at zero."""
        nv = self.system.vehicle_size
        return (*range(nv), *(-1,) * nv)

    def write(self, body: StepBody, first: int) -> None:
        """The path's own steps of y with the path's noise, and of q with what the nonlinearity leaves at both places."""
        nv, states = self.system.vehicle_size, self.system.states
        self._first = first
        drift = body.separated.drift
        self._nonlinear = tuple(a for a in range(nv) if not is_affine(drift[a], states))
        linear = [self._linear(a, drift[a], body.separated.taken[a]) for a in range(nv)]
        body.shared.along_run |= set(self.entries.values())
        own = [{b: f for b in range(nv) if (f := sp.diff(rate, states[b])) != 0} for rate in linear]

        start, ahead = body.emitter("zs", "us", "s", "t"), body.emitter("zp", "vs", "e", "t")
        rates = [[end.operand(rate) for rate in linear] for end in (start, ahead)]
        true = [{a: end.operand(drift[a]) for a in self._nonlinear} for end in (start, ahead)]
        lines = [f"zs{a} = z{a}{body.shift(a, 'a')}" for a in range(nv)] + start.lines
        lines += [f"zp{a} = z{a} + dt * {rates[0][a]}{body.noise(a)}{body.shift(a, 'b')}" for a in range(nv)]
        lines += ahead.lines
        lines += [f"zn{a} = z{a} + half * ({rates[0][a]} + {rates[1][a]}){body.noise(a)}" for a in range(nv)]
        pushed = [dict.fromkeys(range(nv), ""), dict.fromkeys(range(nv), "")]
        residuals: list[str] = []
        for a in self._nonlinear:
            residuals.append(f"ra{a} = {true[0][a]} - {rates[0][a]}")
            residuals.append(f"rb{a} = {true[1][a]} - {rates[1][a]}")
            pushed[0][a], pushed[1][a] = f" + ra{a}", f" + rb{a}"
        lines += residuals
        for end, (name, suffix, into) in enumerate((("d", "s", "fa"), ("dp", "e", "fb"))):
            gains = body.emitter("x", "u", suffix, f"j{suffix}")
            for a in range(nv):
                terms = [f"{gains.operand(f)} * {name}{b}" for b, f in own[a].items()]
                lines.append(f"{into}{a} = {' + '.join(terms) or '0.0'}{pushed[end][a]}")
            if end == 0:
                lines += [f"dp{a} = d{a} + dt * fa{a}" for a in range(nv)]
        self._lines = lines

    def lines(self, layout: Layout) -> list[str]:
        """Rows y and q after the step."""
        nv, first = self.system.vehicle_size, self._first
        lines = [f"z{a} = {layout.old_state(first + a)}" for a in range(nv)]
        lines += [f"d{a} = {layout.old_state(first + nv + a)}" for a in range(nv)]
        lines += self._lines
        lines += [f"{layout.state(first + a)} = zn{a}" for a in range(nv)]
        lines += [f"{layout.state(first + nv + a)} = d{a} + half * (fa{a} + fb{a})" for a in range(nv)]
        return lines

    def _linear(self, a: int, rate: sp.Expr, taken: sp.Expr) -> sp.Expr:
        """The twin's rate: N y + g less what the step takes as kicks; a linear rate as it is."""
        if a not in self._nonlinear:
            return rate
        states = self.system.states
        seen = [b for b, s in enumerate(states) if s in rate.free_symbols]  # of others N is what the kicks hold
        gain = {b: self.entries.setdefault((a, b), sp.Dummy(f"N{a}_{b}", real=True)) for b in seen}
        rest = self.entries.setdefault((a, -1), sp.Dummy(f"g{a}", real=True))
        kicked = sp.expand(taken)
        terms = [(gain[b] - kicked.coeff(states[b])) * states[b] for b in seen]
        return sp.Add(*terms, rest - kicked.xreplace(dict.fromkeys(states, sp.S.Zero)))


def is_affine(rate: sp.Expr, states: Sequence[sp.Symbol]) -> bool:
    """Whether a rate is linear in the states, but for a part that does not depend on them."""
    known = set(states)
    if rate.has(ElementCall):
        return False
    slopes = (sp.diff(rate, s) for s in states if s in rate.free_symbols)
    return not any(slope.free_symbols & known for slope in slopes)
