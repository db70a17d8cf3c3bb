"""Turn the moment equations into functions that an exported program can carry: scalar operations, and calls of functions.

Besides the rate, its Jacobian and the outputs these are the rate at a held speed (whose zeros are the stationary
moments), the motion, what the moments at the start are made of, and the functions whose changes of sign are the
breakpoints of a run. The correlation with the ground between wheels on one track is left to a loop: of its rate these
functions give N and the transport (see `delay`), which are the same for hundreds of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.delay import DelayGrid
from cadet_sym.errors import ExportError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.initial import filter_matrices, vehicle_start
from cadet_sym.lowering.operations import size
from cadet_sym.lowering.switches import switch_functions
from cadet_sym.lowering.system import LoweredSystem

__all__ = ["PortableFunctions", "Settling", "StartParts", "portable"]


@dataclass(frozen=True, eq=False)
class PortableFunctions:
    """CasADi functions of scalars; y is packed as in `packing.Packing`, p holds the parameters.

    With wheels that follow each other on one track, rates are those of what goes before the ground between them, and
    `parts` follow: the entries of N by `gain`, V/h and b of every gap. Jacobians come with that of the parts.
    """

    rate: ca.Function  # (t, y, p) -> dy/dt[, parts]
    jacobian: ca.Function  # (t, y, p) -> d(dy/dt)/dy at `pattern`[, d(parts)/dy at `parts_pattern`]
    slope: ca.Function  # (t, y, p) -> d(dy/dt)/dt[, d(parts)/dt]
    outputs: ca.Function  # (t, y, p) -> means, variances
    motion: ca.Function  # (t, p) -> [V, V', s where it is known, s at the start]
    held: ca.Function  # (t, s, V, y, p) -> dy/dt[, parts] at a held speed
    held_jacobian: ca.Function  # (t, s, V, y, p) -> its Jacobian, at the same patterns
    held_outputs: ca.Function  # (t, s, V, y, p) -> means, variances
    start: ca.Function  # p -> the numbers that make the moments at the start, as `start_parts` has them
    switches: ca.Function  # (t, s, p) -> functions whose sign changes at breakpoints: those of t alone first
    pattern: ca.Sparsity  # of the Jacobian of `rate`
    parts_pattern: ca.Sparsity  # of the Jacobian of the parts
    gain: ca.Sparsity  # of N among the parts; empty without wheels that follow each other
    start_parts: StartParts
    settling: tuple[Settling, ...]  # moments that stay as they are once they are stationary


@dataclass(frozen=True)
class Settling:
    """One moment of the ground's own filters that nothing moves but the distance, the same everywhere."""

    place: int  # in y
    row: int  # the states it belongs to; of a mean both are the same
    column: int


@dataclass(frozen=True)
class StartParts:
    """Where the results of `PortableFunctions.start` are: sizes, in order."""

    vehicle: int  # nv: offset (nv), map (nv, nf), covariance (nv, nv)
    ground: int  # nf, all filters together
    copies: tuple[tuple[int, int, int], ...]  # first state among the filters', number of states and noises: C, DQD, D
    tracks: tuple[tuple[int, ...], ...]  # copies of one track, front to back: distances between them
    delayed: DelayGrid | None  # how the correlation with the ground between wheels is packed
    smooth: bool  # then: N (n, n), V, the noise inputs (n, q) of every delayed wheel


LARGEST = 200_000
"""Operations of a rate that is exported, with those of what it calls: its Jacobian has four times as many."""


def portable(functions: MomentFunctions) -> PortableFunctions:
    """Make the functions that are exported; the same graphs as Python evaluates.

    Raises
    ------
    ExportError
        If the rate takes more operations than a compiler of C is to be given.
    """
    lowered = functions.symbolic
    packing = lowered.equations.packing
    t, s, V = ca.SX.sym("t"), ca.SX.sym("s"), ca.SX.sym("V")
    y, p = ca.SX.sym("y", packing.size), ca.SX.sym("p", len(lowered.parameters))
    run, frozen = {"t": t, "y": y, "p": p}, {"t": t, "s": s, "V": V, "y": y, "p": p}
    rate, gain = _parts(lowered.parts if packing.ground else lowered.rate, list(run.values()))
    _check_size(functions, _function("rate", run, ("dy", "parts"), rate))
    held, _ = _parts(lowered.held_parts if packing.ground else lowered.held_rate, list(frozen.values()))
    if packing.distance:  # at a held speed the distance is drawn to s
        held[0][packing.moments] = s - y[packing.moments]
    patterns = [ca.jacobian_sparsity(a, y) + ca.jacobian_sparsity(b, y) for a, b in zip(rate, held, strict=True)]
    outputs = [ca.densify(part) for part in lowered.outputs(t, y, p)]
    still = [ca.densify(part) for part in lowered.outputs_at(y[: packing.moments], ca.vertcat(t, s, V, 0), p)]
    slope = [ca.densify(ca.jacobian(part, t)) for part in rate]
    start, start_parts = _start(lowered, p)
    switches = [ca.densify(ca.vertcat(*switch_functions(lowered)(t, s, p)))]
    return PortableFunctions(
        rate=_function("rate", run, ("dy", "parts"), rate),
        jacobian=_function("jacobian", run, ("values", "parts"), _entries(rate, y, patterns)),
        slope=_function("slope", run, ("slope", "parts"), slope),
        outputs=_function("outputs", run, ("mean", "variance"), outputs),
        motion=_function("motion", {"t": t, "p": p}, ("motion",), [ca.vertcat(*lowered.motion(t, p))]),
        held=_function("held_rate", frozen, ("dy", "parts"), held),
        held_jacobian=_function("held_jacobian", frozen, ("values", "parts"), _entries(held, y, patterns)),
        held_outputs=_function("held_outputs", frozen, ("mean", "variance"), still),
        start=_function("start_parts", {"p": p}, ("parts",), [start]),
        switches=_function("switches", {"t": t, "s": s, "p": p}, ("g",), switches),
        pattern=patterns[0],
        parts_pattern=patterns[1] if packing.ground else ca.Sparsity(0, packing.size),
        gain=gain,
        start_parts=start_parts,
        settling=_settling(lowered, held[0], y, ca.vertcat(t, s)),
    )


def _check_size(functions: MomentFunctions, rate: ca.Function) -> None:
    count = size(rate)
    if count <= LARGEST:
        return
    nodes, name = max(((e.describing.nodes or 0, e.name) for e in functions.equations.quasi_linear.elements), default=(0, ""))
    blame = f"; most go into the nodes by which the expectation of `{name}` is computed" if nodes else ""
    raise ExportError(
        f"the rate of this model takes {count:,} operations, and no more than {LARGEST:,} are written as C{blame}: "
        "write it with functions of one argument"
    )


def _settling(lowered: LoweredSystem, held: ca.SX, y: ca.SX, explicit: ca.SX) -> tuple[Settling, ...]:
    """Moments of the filters whose rates are V times a function of such moments alone: the larger V, the stiffer."""
    packing, vehicle = lowered.equations.packing, lowered.equations.quasi_linear.system.vehicle_size
    if packing.ground:
        return ()
    rows, columns = (np.concatenate([range(packing.n), part]) for part in packing.triangle)
    chosen = np.pad(columns >= vehicle, (0, packing.size - packing.moments))
    chosen[_dependence(held, explicit)[0]] = False
    rates, by = _dependence(held, y)
    while chosen[outside := rates[~chosen[by]]].any():
        chosen[outside] = False
    return tuple(Settling(int(k), int(rows[k]), int(columns[k])) for k in np.flatnonzero(chosen))


def _dependence(results: ca.SX, arguments: ca.SX) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Pairs of a result and an argument that it depends on."""
    rows, columns = ca.jacobian_sparsity(results, arguments).get_triplet()
    return np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)


def _parts(function: ca.Function, arguments: Sequence[ca.SX]) -> tuple[list[ca.SX], ca.Sparsity]:
    """The rate, and what moves the ground between the wheels as one vector; and where the entries of N belong."""
    results = function.call(list(arguments))
    if len(results) == 1:
        return results, ca.Sparsity(0, 0)
    head, N, speed, entering = results
    return [head, ca.densify(ca.vertcat(N.nz[:], speed, entering))], N.sparsity()


def _entries(results: Sequence[ca.SX], y: ca.SX, patterns: Sequence[ca.Sparsity]) -> list[ca.SX]:
    """The entries of Jacobians at the places of a pattern, also where they are zero."""
    pairs = zip(results, patterns, strict=True)
    return [ca.vertcat(*ca.project(ca.jacobian(result, y), pattern).nz) for result, pattern in pairs]


def _start(lowered: LoweredSystem, p: ca.SX) -> tuple[ca.SX, StartParts]:
    """What the moments at the start are made of (see `initial`), for a program that solves and loops."""
    equations = lowered.equations
    system = equations.quasi_linear.system
    nv, nf = system.vehicle_size, equations.packing.n - system.vehicle_size
    offset, linear, delta = vehicle_start(lowered)(p)
    parts = [offset, linear, delta]
    smooth = system.model.initial.ground == "smooth"
    setback = lowered.noise(ca.SX.zeros(4), p)[2]
    tracks, values = [], system.model.parameter_values()
    numbers = lowered.noise([0.0] * 4, [values[name] for name in lowered.parameters])[2] if system.sources else ca.DM()
    for copy in system.copies:
        parts += filter_matrices(lowered, copy)(p)
    for name in dict.fromkeys(copy.track for copy in system.copies):
        members = [k for k, copy in enumerate(system.copies) if copy.track == name]
        members.sort(key=lambda k: float(numbers[system.copies[k].columns[0]]))
        places = [setback[system.copies[k].columns[0]] for k in members]
        parts += [behind - before for before, behind in pairwise(places)]
        tracks.append(tuple(members))
    delayed = equations.delay
    if smooth and delayed is not None:
        V, dV, _, begin = lowered.motion(0, p)
        context = ca.vertcat(0, begin, V, dV)
        rest = ca.SX.zeros(equations.packing.moments - len(equations.states), 1)
        mean = ca.vertcat(offset, ca.SX.zeros(nf, 1))
        b = lowered.noise(context, p)[0]
        parts += [lowered.gain_matrix(ca.vertcat(mean, rest), context, p), V]
        parts += [b[:, list(columns)] for track in delayed.tracks for columns in track.columns[:-1]]
    return ca.vertcat(*(ca.vec(ca.densify(part)) for part in parts)), StartParts(
        vehicle=nv,
        ground=nf,
        copies=tuple((c.start - nv, len(c.filter.states), len(c.columns)) for c in system.copies),
        tracks=tuple(tracks),
        delayed=delayed,
        smooth=smooth,
    )


def _function(
    name: str, inputs: dict[str, ca.SX], names: Sequence[str], results: Sequence[ca.SX]
) -> ca.Function:
    dense = [ca.SX(result) for result in results]
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(names[: len(dense)]))
