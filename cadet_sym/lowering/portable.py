"""Turn the moment equations into functions that an exported program can carry: scalar operations and nothing else.

Besides the rate, its Jacobian and the outputs these are the rate at a held speed (whose zeros are the stationary
moments), the moments at the start, the motion, and the functions whose changes of sign are the breakpoints of a run.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.initial import initial_moments

__all__ = ["PortableFunctions", "portable"]

LARGEST_START = 20_000
"""Operations up to which the moments at the start are exported as a function of the parameters."""


@dataclass(frozen=True, eq=False)
class PortableFunctions:
    """Expanded CasADi functions; y is packed as in `packing.Packing`, p holds the parameters."""

    rate: ca.Function  # (t, y, p) -> dy/dt
    jacobian: ca.Function  # (t, y, p) -> d(dy/dt)/dy, sparse
    slope: ca.Function  # (t, y, p) -> d(dy/dt)/dt
    outputs: ca.Function  # (t, y, p) -> means, variances
    motion: ca.Function  # (t, p) -> [V, V', s where it is known, s at the start]
    held: ca.Function  # (t, s, V, y, p) -> dy/dt at a held speed
    held_jacobian: ca.Function  # (t, s, V, y, p) -> its Jacobian in y, with the sparsity of `jacobian`
    held_outputs: ca.Function  # (t, s, V, y, p) -> means, variances
    initial: ca.Function | None  # p -> y(0); None if it takes too many operations
    switches: ca.Function  # (t, s, p) -> functions whose sign changes at breakpoints: those of t alone first


def portable(lowered: MomentFunctions) -> PortableFunctions:
    """Make the functions that are exported; the same graphs as Python evaluates."""
    packing = lowered.facts.packing
    t, s, V = ca.SX.sym("t"), ca.SX.sym("s"), ca.SX.sym("V")
    y, p = ca.SX.sym("y", packing.size), ca.SX.sym("p", len(lowered.parameters))
    rate = lowered.rate(t, y, p)
    held = _held_rate(lowered, t, s, V, y, p)
    pattern = ca.jacobian_sparsity(rate, y) + ca.jacobian_sparsity(held, y)
    run, run_names = [t, y, p], ["t", "y", "p"]
    frozen, frozen_names = [t, s, V, y, p], ["t", "s", "V", "y", "p"]
    outputs = [ca.densify(part) for part in lowered.outputs(t, y, p)]
    still = [ca.densify(part) for part in lowered.outputs_at(y[: packing.moments], ca.vertcat(t, s, V, 0), p)]
    both = ["mean", "variance"]
    return PortableFunctions(
        rate=_function("rate", run, [rate], run_names, ["dy"]),
        jacobian=_function("jacobian", run, [_project(ca.jacobian(rate, y), pattern)], run_names, ["values"]),
        slope=_function("slope", run, [ca.densify(ca.jacobian(rate, t))], run_names, ["slope"]),
        outputs=_function("outputs", run, outputs, run_names, both),
        motion=_function("motion", [t, p], [ca.vertcat(*lowered.motion(t, p))], ["t", "p"], ["motion"]),
        held=_function("held_rate", frozen, [held], frozen_names, ["dy"]),
        held_jacobian=_function(
            "held_jacobian", frozen, [_project(ca.jacobian(held, y), pattern)], frozen_names, ["values"]
        ),
        held_outputs=_function("held_outputs", frozen, still, frozen_names, both),
        initial=_initial(lowered),
        switches=_function(
            "switches", [t, s, p], [ca.densify(ca.vertcat(*lowered.switches(t, s, p)))], ["t", "s", "p"], ["g"]
        ),
    )


def _held_rate(lowered: MomentFunctions, t: ca.SX, s: ca.SX, V: ca.SX, y: ca.SX, p: ca.SX) -> ca.SX:
    """The rate at a constant speed, all wheels on the ground; a distance that is integrated is drawn to s."""
    held = ca.SX(lowered.held_rate(t, s, V, y, p))
    packing = lowered.facts.packing
    if packing.distance:
        held[packing.moments] = s - y[packing.moments]
    return held


def _project(matrix: ca.SX, pattern: ca.Sparsity) -> ca.SX:
    """The entries of a matrix at the places of a pattern, also where they are zero."""
    return ca.project(matrix, pattern)


def _initial(lowered: MomentFunctions) -> ca.Function | None:
    expanded = initial_moments(lowered.symbolic, "symbolicqr").expand("initial")
    return expanded if expanded.n_instructions() <= LARGEST_START else None


def _function(
    name: str, inputs: list[ca.SX], results: list[ca.SX], input_names: list[str], output_names: list[str]
) -> ca.Function:
    return ca.Function(name, inputs, [ca.SX(result) for result in results], input_names, output_names)
