"""The model as two functions in Python source: one that advances paths by Heun steps, one that records them.

`advance` and `record` are written twice from the same lines: for numba, which loops over a block of `LANES` paths
held in flat arrays so that the loop becomes vector instructions, and for NumPy, where a row holds all paths.

Where the ground is so rough that its white noise w enters a vehicle rate, der(u, k) = ... + kappa V (y' + noise) with
y = u^(k-1) in distance, the rate is not added up from drift and noise, which nearly cancel at speed: it is the
increment of y itself, known exactly at both ends of the step. `Kick` holds such a term.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.augment import AugmentedSystem
from cadet_sym.language.expression import ElementCall, evaluate
from cadet_sym.simulate.kicks import Kick, separate_kicks
from cadet_sym.simulate.source import Emitter, Shared

__all__ = ["LANES", "Program", "numeric", "write_program"]

LANES = 16  # paths that one block of the numba kernel carries side by side


@dataclass(frozen=True)
class Program:
    """Source of `advance` and `record`, and the expressions whose values they read from tables.

    Rows of a node are the filter states in the order of the system, then the noises in time that reach the vehicle,
    each made independent of the others, of unit intensity, and summed since the start.
    """

    numba_source: str
    numpy_source: str
    constants: tuple[sp.Expr, ...]  # q
    coefficients: tuple[sp.Expr, ...]  # c: one value at each end of a step
    record_constants: tuple[sp.Expr, ...]
    record_coefficients: tuple[sp.Expr, ...]  # one value an output time
    kicks: tuple[Kick, ...]  # their factors are the first columns of the noise table
    time_noises: tuple[int, ...]  # columns of the noise input, of those that reach the vehicle
    time_entries: tuple[tuple[int, int], ...]  # (vehicle state, place in time_noises): the other columns
    table: np.ndarray  # measured curves
    record_table: np.ndarray
    elements: Mapping[str, Any]


def numeric(expressions: Sequence[sp.Expr], values: Mapping[sp.Symbol, Any], elements: Mapping[str, Any]) -> np.ndarray:
    """Values of expressions that do not depend on the path: (times, expressions) where values are arrays over time."""
    shape = np.broadcast_shapes(*(np.shape(v) for v in values.values())) if values else ()
    rows = [np.broadcast_to(evaluate(_written_out(e, elements), values), shape) for e in expressions]
    return np.stack(rows, axis=-1) if rows else np.zeros((*shape, 0))


def _written_out(expression: sp.Expr, elements: Mapping[str, Any]) -> sp.Expr:
    """The bodies of declared elements in place of their calls, elements inside elements too."""
    while calls := expression.atoms(ElementCall):
        bodies = {}
        for call in calls:
            element = elements[call.name]
            bodies[call] = element.value.xreplace(dict(zip(element.arguments, call.arguments, strict=True)))
        expression = expression.xreplace(bodies)
    return expression


def write_program(system: AugmentedSystem) -> Program:
    """Write the vehicle's rates and all outputs of an augmented system as source."""
    elements = system.model.vehicle.elements
    noises, entries = _time_noise(system)
    step, out = Shared(elements), Shared(elements)
    body = _StepBody(system, step, len(noises), entries)
    rows = _record_rows(system, out)
    texts = ["\n".join([_advance(body, step, layout), _record(rows, out, layout), ""]) for layout in body.layouts]
    return Program(
        *texts,
        constants=tuple(step.constants),  # type: ignore[arg-type]
        coefficients=tuple(step.coefficients),  # type: ignore[arg-type]
        record_constants=tuple(out.constants),  # type: ignore[arg-type]
        record_coefficients=tuple(out.coefficients),  # type: ignore[arg-type]
        kicks=body.kicks,
        time_noises=noises,
        time_entries=entries,
        table=step.table(),
        record_table=out.table(),
        elements=elements,
    )


def _time_noise(system: AugmentedSystem) -> tuple[tuple[int, ...], tuple[tuple[int, int], ...]]:
    """Noises in time that reach the vehicle, and the entries of its noise input that can differ from zero.

    Correlated noises are replaced by independent ones through the Cholesky factor of their intensity, which fills
    the input to the left.
    """
    time = [j for j, source in enumerate(system.sources) if source.domain == "time"]
    coupled = any(system.intensity[i, j] != 0 for i in time for j in time if i != j)
    entries: set[tuple[int, int]] = set()
    for i in range(system.vehicle_size):
        for j in (j for j in time if system.noise_input[i, j] != 0):
            entries |= {(i, k) for k in time if k <= j} if coupled else {(i, j)}
    noises = tuple(sorted({j for _, j in entries}))
    return noises, tuple((i, noises.index(j)) for i, j in sorted(entries))


@dataclass(frozen=True)
class _Lanes:
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
class _Rows:
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


class _StepBody:
    """The lines of one Heun step: increments of noise, rates at the start, prediction, rates at the end, correction."""

    def __init__(self, system: AugmentedSystem, shared: Shared, noises: int, entries: tuple[tuple[int, int], ...]):
        self.states = nv = system.vehicle_size
        self.filters = len(system.states) - nv
        self.layouts = (_Lanes(self.filters + noises), _Rows(self.filters + noises))
        drift, heights, self.kicks = separate_kicks(system)
        used = set().union(*(e.free_symbols for e in (*drift, *heights)), set())
        self.ground_rows = [k for k in range(self.filters) if system.states[nv + k] in used]
        self.noises = noises
        self.height_lines: list[str] = []
        ends = []
        for vehicle, ground, suffix in (("x", "u", "s"), ("p", "v", "e")):
            names = {s: f"{vehicle}{k}" for k, s in enumerate(system.states[:nv])}
            names |= {s: f"{ground}{k}" for k, s in enumerate(system.states[nv:])}
            above = Emitter(names, shared, suffix, "y", self.height_lines)
            rates = Emitter(names, shared, suffix)
            ends.append(([above.operand(y) for y in heights], [rates.operand(r) for r in drift], rates.lines))
        (before, self.start_rates, self.start), (after, self.end_rates, self.end) = ends
        self.gains = [f"{b} - {a}" for a, b in zip(before, after, strict=True)]
        self.pushes = dict.fromkeys(range(nv), "")
        places = [(k.state, f"g{k.height}") for k in self.kicks] + [(i, f"w{j}") for i, j in entries]
        for column, (state, increment) in enumerate(places):
            self.pushes[state] += f" + k{column} * {increment}"
        self.columns = len(places)

    def lines(self, layout: _Lanes | _Rows) -> list[str]:
        """The step for the paths of one layout."""
        states = range(self.states)
        noise = {a: f" + n{a}" if push else "" for a, push in self.pushes.items()}
        lines = [f"x{a} = {layout.old_state(a)}" for a in states]
        lines += [f"u{k} = {layout.ground(k, 'a')}" for k in self.ground_rows]
        lines += [f"v{k} = {layout.ground(k, 'b')}" for k in self.ground_rows]
        for j in range(self.noises):
            row = self.filters + j
            lines.append(f"w{j} = {layout.ground(row, 'b')} - {layout.ground(row, 'a')}")
        lines += self.height_lines
        lines += [f"g{j} = {gain}" for j, gain in enumerate(self.gains)]
        lines += [f"n{a} = {push[3:]}" for a, push in self.pushes.items() if push]
        lines += self.start
        lines += [f"p{a} = x{a} + dt * {self.start_rates[a]}{noise[a]}" for a in states]
        lines += self.end
        for a in states:
            both = f"half * ({self.start_rates[a]} + {self.end_rates[a]})"
            lines.append(f"{layout.state(a)} = x{a} + {both}{noise[a]}")
        return lines


def _advance(body: _StepBody, shared: Shared, layout: _Lanes | _Rows) -> str:
    coefficients = range(len(shared.coefficients))
    lines = ["def advance(X, G, stride, node, first, last, S, E, K, H, q, T):"]
    lines += [f"    q{k} = q[{k}]" for k in range(len(shared.constants))]
    lines += ["    for i in range(first, last):", "        a = node + (i - first) * stride", "        b = a + stride"]
    lines += ["        dt = H[i]", "        half = 0.5 * dt"]
    lines += [f"        c{k}s = S[i, {k}]" for k in coefficients]
    lines += [f"        c{k}e = E[i, {k}]" for k in coefficients]
    lines += [f"        k{k} = K[i, {k}]" for k in range(body.columns)]
    lines += [f"        {layout.head}", *(f"            {line}" for line in body.lines(layout)), ""]
    return "\n".join(lines)


def _record_rows(system: AugmentedSystem, shared: Shared) -> tuple[list[str], list[str], int, int]:
    """Lines and operands of everything that is recorded: vehicle states, filter states, outputs."""
    nv, n = system.vehicle_size, len(system.states)
    names = {s: f"x{k}" for k, s in enumerate(system.states[:nv])}
    names |= {s: f"u{k}" for k, s in enumerate(system.states[nv:])}
    emitter = Emitter(names, shared)
    outputs = [emitter.operand(value) for value in system.outputs.values()]
    return emitter.lines, [*names.values(), *outputs], nv, n - nv


def _record(rows: tuple[list[str], list[str], int, int], shared: Shared, layout: _Lanes | _Rows) -> str:
    body, operands, vehicle, filters = rows
    lines = ["def record(X, G, a, C, q, T, R, k, first):"]
    lines += [f"    q{k} = q[{k}]" for k in range(len(shared.constants))]
    lines += [f"    c{j} = C[k, {j}]" for j in range(len(shared.coefficients))]
    inner = [f"x{a} = {layout.state(a)}" for a in range(vehicle)]
    inner += [f"u{k} = {layout.ground(k, 'a')}" for k in range(filters)]
    inner += body
    inner += [f"{layout.result(row)} = {operand}" for row, operand in enumerate(operands)]
    lines += [f"    {layout.head}", *(f"        {line}" for line in inner), ""]
    return "\n".join(lines)
