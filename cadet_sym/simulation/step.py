"""One Heun step as lines of source, and what rides along with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.simulation.kicks import separate_kicks
from cadet_sym.simulation.source import Emitter, Shared

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
    """The lines of one Heun step: increments of noise, rates at the start, prediction, rates at the end, correction."""

    def __init__(
        self,
        system: AugmentedSystem,
        shared: Shared,
        noises: int,
        entries: tuple[tuple[int, int], ...],
        riders: Sequence[Rider] = (),
    ):
        self.system, self.shared, self.noises, self.riders = system, shared, noises, riders
        self.states = nv = system.vehicle_size
        self.filters = len(system.states) - nv
        self.layouts = (Lanes(self.filters + noises), Rows(self.filters + noises))
        self.separated = separate_kicks(system)
        self.height_lines: list[str] = []
        ends = []
        for vehicle, ground, suffix in (("x", "u", "s"), ("p", "v", "e")):
            above = self.emitter(vehicle, ground, suffix, "y", self.height_lines)
            rates = self.emitter(vehicle, ground, suffix, "e")
            heights = [above.operand(y) for y in self.separated.heights]
            ends.append((heights, [rates.operand(r) for r in self.separated.drift], rates.lines))
        (before, self.start_rates, self.start), (after, self.end_rates, self.end) = ends
        self.gains = [f"{b} - {a}" for a, b in zip(before, after, strict=True)]
        pushes = dict.fromkeys(range(nv), "")
        places = [(k.state, f"g{k.height}") for k in self.separated.kicks] + [(i, f"w{j}") for i, j in entries]
        for column, (state, increment) in enumerate(places):
            pushes[state] += f" + k{column} * {increment}"
        self.columns = len(places)
        self.pushes = {a: push[3:] for a, push in pushes.items() if push}
        first = nv
        for rider in riders:
            rider.write(self, first)
            first += len(rider.copied)
        self.rows = first

    def emitter(self, vehicle: str, ground: str, suffix: str, letter: str, lines: list[str] | None = None) -> Emitter:
        """Writer of expressions in states of the given names, at the start ("s") or the end ("e") of the step."""
        nv, states = self.states, self.system.states
        names = {s: f"{vehicle}{k}" for k, s in enumerate(states[:nv])}
        names |= {s: f"{ground}{k}" for k, s in enumerate(states[nv:])}
        return Emitter(names, self.shared, suffix, letter, lines)

    def noise(self, state: int) -> str:
        """The noise's increment of a vehicle state, as a term to be added."""
        return f" + n{state}" if state in self.pushes else ""

    def lines(self, layout: Layout) -> list[str]:
        """The step for the paths of one layout."""
        states = range(self.states)
        body = self.height_lines + [f"g{j} = {gain}" for j, gain in enumerate(self.gains)]
        body += [f"n{a} = {push}" for a, push in self.pushes.items()]
        body += self.start
        body += [f"p{a} = x{a} + dt * {self.start_rates[a]}{self.noise(a)}" for a in states]
        body += self.end
        body += [f"m{a} = x{a} + half * ({self.start_rates[a]} + {self.end_rates[a]}){self.noise(a)}" for a in states]
        for rider in self.riders:
            body += rider.lines(layout)
        body += [f"{layout.state(a)} = m{a}" for a in states]
        used = {word for line in body for word in _words(line)}
        lines = [f"x{a} = {layout.old_state(a)}" for a in states]
        for name, node in (("u", "a"), ("v", "b")):
            lines += [f"{name}{k} = {layout.ground(k, node)}" for k in range(self.filters) if f"{name}{k}" in used]
        for j in range(self.noises):
            row = self.filters + j
            lines.append(f"w{j} = {layout.ground(row, 'b')} - {layout.ground(row, 'a')}")
        return lines + body


def _words(line: str) -> set[str]:
    return set("".join(c if c.isalnum() else " " for c in line).split())
