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
    _first: int = 0

    @property
    def copied(self) -> Sequence[int]:
        """The twin starts where the path starts, q at zero."""
        nv = self.system.vehicle_size
        return (*range(nv), *(-1,) * nv)

    def write(self, body: StepBody, first: int) -> None:
        """The path's own steps of y with the path's noise, and of q with what the nonlinearity leaves at both places."""
        nv, states, rule = self.system.vehicle_size, self.system.states, body.rule
        self._first = first
        self._nonlinear = tuple(a for a in range(nv) if not is_affine(rule.rest[a], states))
        linear = [self._linear(a, rule.rest[a], body.separated.taken[a] + rule.removed[a]) for a in range(nv)]
        body.shared.along_run |= set(self.entries.values())

        start, ahead = body.emitter("zs", "us", "s", "t"), body.emitter("zp", "vs", "e", "t")
        rates = [[end.operand(rate) for rate in linear] for end in (start, ahead)]
        true = [{a: end.operand(rule.rest[a]) for a in self._nonlinear} for end in (start, ahead)]
        lines = body.taken_first("zs", "z") + start.lines + body.taken_last("zp", "z", rates[0]) + ahead.lines
        lines += [f"zn{a} = {text}" for a, text in enumerate(rule.corrected("z", rates[0], rates[1]))]
        for end, left in enumerate(("ra", "rb")):
            lines += [f"{left}{a} = {rate} - {rates[end][a]}" for a, rate in true[end].items()]
        own = [{b: f for b in range(nv) if (f := sp.diff(rate, states[b])) != 0} for rate in linear]
        first_rates = self._pushed(body, own, "d", "s", "ra", lines)
        lines += [f"dp{a} = {text}" for a, text in enumerate(rule.predicted("d", first_rates, noisy=False))]
        last_rates = self._pushed(body, own, "dp", "e", "rb", lines)
        lines += [f"dn{a} = {text}" for a, text in enumerate(rule.corrected("d", first_rates, last_rates, noisy=False))]
        self._lines = lines

    def _pushed(
        self, body: StepBody, own: Sequence[dict[int, sp.Expr]], q: str, suffix: str, residual: str, lines: list[str]
    ) -> list[str]:
        """Rates of q at one end of the step; writes the lines they need."""
        gains, rates = body.emitter("x", "u", suffix, f"j{suffix}", lines), []
        for a, slopes in enumerate(own):
            terms = [f"{gains.operand(f)} * {q}{b}" for b, f in slopes.items()]
            terms += [f"{residual}{a}"] if a in self._nonlinear else []
            if terms:
                lines.append(f"f{residual}{a} = {' + '.join(terms)}")
            rates.append(f"f{residual}{a}" if terms else "0.0")
        return rates

    def lines(self, layout: Layout) -> list[str]:
        """Rows y and q after the step."""
        nv, first = self.system.vehicle_size, self._first
        lines = [f"z{a} = {layout.old_state(first + a)}" for a in range(nv)]
        lines += [f"d{a} = {layout.old_state(first + nv + a)}" for a in range(nv)]
        lines += self._lines
        lines += [f"{layout.state(first + a)} = zn{a}" for a in range(nv)]
        lines += [f"{layout.state(first + nv + a)} = dn{a}" for a in range(nv)]
        return lines

    def _linear(self, a: int, rate: sp.Expr, taken: sp.Expr) -> sp.Expr:
        """The twin's rate: N y + g less what the step takes as kicks or exactly; a linear rate as it is."""
        if a not in self._nonlinear:
            return rate
        states = self.system.states
        seen = [b for b, s in enumerate(states) if s in rate.free_symbols]  # of others N is all in `taken`
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
