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

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.simulation.kicks import Kick, Separated
from cadet_sym.simulation.rules import Exponential, Heun, Linear
from cadet_sym.simulation.source import Emitter, Shared
from cadet_sym.simulation.step import LANES, Layout, Rider, StepBody
from cadet_sym.simulation.within import CopyRows

__all__ = ["LANES", "Program", "write_program"]


@dataclass(frozen=True)
class Program:
    """Source of `advance` and `record`, and the expressions whose values they read from tables.

    Rows of a node are those of the filter copies (see `CopyRows`), then those of the noise in time: by Heun's rule the
    noises that reach the vehicle, each made independent of the others, of unit intensity, and summed since the start.
    """

    numba_source: str
    numpy_source: str
    constants: tuple[sp.Expr, ...]  # q
    coefficients: tuple[sp.Expr, ...]  # c: one value at each end of a step
    record_constants: tuple[sp.Expr, ...]
    record_coefficients: tuple[sp.Expr, ...]  # one value an output time
    rule: Heun | Exponential  # its numbers are the first columns of the step's table
    kicks: tuple[Kick, ...]
    time_noises: tuple[int, ...]  # columns of the noise input, of those that reach the vehicle
    time_entries: tuple[tuple[int, int], ...]  # (vehicle state, place in time_noises)
    ground_rows: tuple[CopyRows, ...]  # of every copy of the filter
    places: tuple[int, ...]  # for every filter state its row of a node
    table: np.ndarray  # measured curves
    record_table: np.ndarray
    elements: Mapping[str, Any]
    starts: tuple[int, ...]  # for every row of a path the vehicle state that it starts from, or -1 for zero


def write_program(
    system: AugmentedSystem, separated: Separated, linear: Linear | None = None, riders: Sequence[Rider] = ()
) -> Program:
    """Write the vehicle's rates and all outputs of an augmented system as source.

    Parameters
    ----------
    separated : the vehicle's drift without derivatives of the ground.
    linear : the same with its linear terms apart, which are taken exactly; if not given, Heun's rule takes all of it.
    riders : what is carried along with every path; their rows are recorded after the outputs.
    """
    elements = system.model.vehicle.elements
    noises, entries = _time_noise(system)
    step, out = Shared(elements), Shared(elements)
    rule = Heun(separated, entries) if linear is None else Exponential(system, separated, linear, entries)
    body = StepBody(system, step, separated, rule, riders)
    texts = ["\n".join([_advance(body, step, layout), _record(body, out, layout), ""]) for layout in body.layouts]
    return Program(
        *texts,
        constants=tuple(step.constants),
        coefficients=tuple(step.coefficients),
        record_constants=tuple(out.constants),
        record_coefficients=tuple(out.coefficients),
        rule=rule,
        kicks=separated.kicks,
        time_noises=noises,
        time_entries=entries,
        ground_rows=body.ground_rows,
        places=body.places,
        table=step.table(),
        record_table=out.table(),
        elements=elements,
        starts=(*range(system.vehicle_size), *(row for rider in riders for row in rider.copied)),
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


def _advance(body: StepBody, shared: Shared, layout: Layout) -> str:
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


def _record(body: StepBody, shared: Shared, layout: Layout) -> str:
    """What is recorded: vehicle states, filter states, outputs, and the rows of the riders."""
    nv, system = body.states, body.system
    names = {s: f"x{k}" for k, s in enumerate(system.states[:nv])}
    names |= {s: f"u{k}" for k, s in enumerate(system.states[nv:])}
    emitter = Emitter(names, shared)
    outputs = [emitter.operand(value) for value in system.outputs.values()]
    results = [*names.values(), *outputs, *(layout.state(row) for row in range(nv, body.rows))]
    lines = ["def record(X, G, a, C, q, T, R, k, first):"]
    lines += [f"    q{k} = q[{k}]" for k in range(len(shared.constants))]
    lines += [f"    c{j} = C[k, {j}]" for j in range(len(shared.coefficients))]
    inner = [f"x{a} = {layout.state(a)}" for a in range(nv)]
    inner += [f"u{k} = {layout.ground(row, 'a')}" for k, row in enumerate(body.places)]
    inner += emitter.lines
    inner += [f"{layout.result(row)} = {result}" for row, result in enumerate(results)]
    lines += [f"    {layout.head}", *(f"        {line}" for line in inner), ""]
    return "\n".join(lines)
