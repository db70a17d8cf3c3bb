"""One Heun step as lines of source, and what rides along with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.simulation.kicks import Separated
from cadet_sym.simulation.rules import Rule
from cadet_sym.simulation.source import Emitter, Shared
from cadet_sym.simulation.within import copy_rows

__all__ = ["LANES", "Layout", "Rider", "StepBody"]

LANES = 16  # paths that one block of the numba kernel carries side by side


@dataclass(frozen=True)
class Lanes:
    """Arrays of the numba kernel: flat, `LANES` paths side by side, addressed by the offset of a node."""

    width: int
    head: str = "for l in range(LANES):"

    def state(self, row: int) -> str:
        return f"X[{row * LANES} + l]"

    old_state = state

    def ground(self, row: int, node: str) -> str:
        return f"G[{node} * {self.width * LANES} + {row * LANES} + l]"

    def result(self, row: int) -> str:
        return f"R[k, {row}, first + l]"


@dataclass(frozen=True)
class Rows:
    """Arrays of the NumPy kernel: a row holds the values of all paths."""

    width: int
    head: str = "if True:"

    def state(self, row: int) -> str:
        return f"X[{row}]"

    def old_state(self, row: int) -> str:
        return f"X[{row}].copy()"  # a view would change under the corrections of the rows before

    def ground(self, row: int, node: str) -> str:
        return f"G[{node}, {row}]"

    def result(self, row: int) -> str:
        return f"R[k, {row}]"


Layout = Lanes | Rows


class Rider(Protocol):
    """Something carried along with every path, in rows of its own after the vehicle's states."""

    @property
    def copied(self) -> Sequence[int]:
        """For each row the vehicle state that it starts from, or -1 for zero."""
        ...

    def write(self, body: StepBody, first: int) -> None:
        """Prepare the lines; `first` is the rider's first row."""
        ...

    def lines(self, layout: Layout) -> list[str]:
        """Lines at the end of the step; x are the states before it, m after it, n the noise in between."""
        ...


class StepBody:
    """The lines of one step by a rule, with the ground as it is within the step (see `within`).

    With g the increments of what kicks the vehicle, a and b what shifts them to the two places at which rates are taken,
    Heun's rule reads

        xs = x + K a,    p = x + h f(xs) + K (g + b) + dW,    m = x + h/2 (f(xs) + f(p)) + K g - dK e + dW,

    e = (a + b)/2 being the mean of what kicks over that of its ends, and dK how much K changes: int K dy = K g - dK e.
    """

    def __init__(
        self,
        system: AugmentedSystem,
        shared: Shared,
        separated: Separated,
        rule: Rule,
        riders: Sequence[Rider] = (),
    ):
        self.system, self.shared, self.separated, self.rule, self.riders = system, shared, separated, rule, riders
        self.states = nv = system.vehicle_size
        felt = set[sp.Basic]().union(*(e.free_symbols for e in (*separated.drift, *separated.heights)))
        self.ground_rows = copy_rows(system, felt)
        self.places = tuple(each.first + a for each in self.ground_rows for a in range(each.states))
        self.carried = tuple(each.first + a for each in self.ground_rows for a in range(each.states, each.size))
        self.noise_row = sum(each.size for each in self.ground_rows)
        self.layouts = (Lanes(self.noise_row + rule.noises), Rows(self.noise_row + rule.noises))
        self.columns = rule.columns
        self.within_lines = self._within()
        self.height_lines: list[str] = []
        self._heights()
        start, end = self.emitter("xs", "us", "s"), self.emitter("p", "vs", "e")
        self.start_rates, self.end_rates = ([e.operand(r) for r in rule.rest] for e in (start, end))
        self.start, self.end = start.lines, end.lines
        first = nv
        for rider in riders:
            rider.write(self, first)
            first += len(rider.copied)
        self.rows = first

    def _within(self) -> list[str]:
        """Where rates are taken: us and vs, sa and sb away from the ground at both ends, u and v."""
        lines, k = [], 0
        for each in self.ground_rows:
            inverse, half = self.columns, self.columns + 1
            self.columns += 2
            for source in each.sources:
                if source >= 0:
                    old, new = (self._row(source, end) for end in "uv")
                    lines += [
                        f"e{k}m = k{inverse} * ({new} - {old}) - k{half} * (u{k} + v{k})",
                        f"e{k}d = (0.5 - k{self.columns}) * (v{k} - u{k})",
                        f"sa{k} = e{k}m + e{k}d",
                        f"sb{k} = e{k}m - e{k}d",
                        f"us{k} = u{k} + sa{k}",
                        f"vs{k} = v{k} + sb{k}",
                    ]
                    self.columns += 1
                k += 1
        return lines

    def _row(self, row: int, end: str) -> str:
        """Name of what a row of the ground holds at the start ("u") or the end ("v") of the step."""
        return f"{end}{self.places.index(row)}" if row in self.places else f"{end}i{row}"

    def _heights(self) -> None:
        """Increments g of what kicks, and their shifts ag and bg."""
        lines, heights = self.height_lines, self.separated.heights
        ends = [self.emitter("x", name, suffix, "y", lines) for name, suffix in (("u", "s"), ("v", "e"))]
        before, after = ([e.operand(y) for y in heights] for e in ends)
        lines += [f"g{j} = {new} - {old}" for j, (new, old) in enumerate(zip(after, before, strict=True))]
        for letter, suffix in (("a", "s"), ("b", "e")):
            moved = self.emitter("x", f"s{letter}", suffix, f"y{letter}", lines)
            lines += [f"{letter}g{j} = {moved.operand(y)}" for j, y in enumerate(heights)]

    def emitter(self, vehicle: str, ground: str, suffix: str, letter: str = "e", lines: list[str] | None = None) -> Emitter:
        """Writer of expressions in states of the given names, at the start ("s") or the end ("e") of the step."""
        nv, states = self.states, self.system.states
        names = {s: f"{vehicle}{k}" for k, s in enumerate(states[:nv])}
        names |= {s: f"{ground}{k}" for k, s in enumerate(states[nv:])}
        return Emitter(names, self.shared, suffix, letter, lines)

    def taken_first(self, name: str, z: str) -> list[str]:
        """Lines of the states at which rates are taken first."""
        shifted = self.rule.shifted
        return [f"{name}{a} = {z}{a}" + (f" + na{a}" if a in shifted else "") for a in range(self.states)]

    def taken_last(self, name: str, z: str, rates: Sequence[str]) -> list[str]:
        """Lines of the states at which rates are taken last, by the rates taken first."""
        shifted, texts = self.rule.shifted, self.rule.predicted(z, rates)
        return [f"{name}{a} = {text}" + (f" + nb{a}" if a in shifted else "") for a, text in enumerate(texts)]

    def lines(self, layout: Layout) -> list[str]:
        """The step for the paths of one layout."""
        body = self.within_lines + self.height_lines + self.rule.pushes()
        body += self.taken_first("xs", "x") + self.start + self.taken_last("p", "x", self.start_rates) + self.end
        body += [f"m{a} = {m}" for a, m in enumerate(self.rule.corrected("x", self.start_rates, self.end_rates))]
        for rider in self.riders:
            body += rider.lines(layout)
        body += [f"{layout.state(a)} = m{a}" for a in range(self.states)]
        used = {word for line in body for word in _words(line)}
        lines = [f"x{a} = {layout.old_state(a)}" for a in range(self.states)]
        names = {f"{k}": row for k, row in enumerate(self.places)} | {f"i{row}": row for row in self.carried}
        for end, node in (("u", "a"), ("v", "b")):
            lines += [f"{end}{k} = {layout.ground(row, node)}" for k, row in names.items() if f"{end}{k}" in used]

        def noise(j: int, node: str) -> str:
            return layout.ground(self.noise_row + j, node)

        return lines + [self.rule.noise_line(j, noise) for j in range(self.rule.noises)] + body


def _words(line: str) -> set[str]:
    return set("".join(c if c.isalnum() else " " for c in line).split())
