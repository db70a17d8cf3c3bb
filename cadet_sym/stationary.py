"""Find stationary moments of a compiled model, and give them its names."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cadet_sym.compilation import Compiled
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.runs import Names
from cadet_sym.solutions import StationaryMoments, StationarySolutions
from cadet_sym.solve.freeze import Conditions, conditions, freeze
from cadet_sym.solve.named import name_moments
from cadet_sym.solve.search import stationary_points
from cadet_sym.solve.stationary import StationaryPoint, stationary_point

__all__ = ["find_stationary", "rest"]

Array = npt.NDArray[np.float64]


def find_stationary(
    made: Compiled, p: Array, speed: float | None, at: float | None, all: bool, start: StationaryMoments | None
) -> StationarySolutions:
    """One stationary solution at the parameters p, or all; see `CompiledModel.stationary`."""
    held = conditions(made.functions, p, speed, at)
    problem, begin = freeze(made.functions, held), rest(made.functions, p)
    if start is not None:  # what drifts has no value to begin with
        begin = np.where(np.isnan(start.state_mean), begin[0], start.state_mean), np.nan_to_num(start.state_covariance)
    points = stationary_points(problem, begin) if all else (stationary_point(problem, begin),)
    return StationarySolutions(tuple(_with_names(made, point, held) for point in points))


def rest(functions: MomentFunctions, p: Array) -> tuple[Array, Array]:
    """Mean and covariance from which stationary moments are looked for: the declared start, without any spread."""
    n = functions.facts.packing.n
    offset = np.asarray(functions.vehicle_start(p)[0]).ravel()
    return np.concatenate([offset, np.zeros(n - len(offset))]), np.zeros((n, n))


def _with_names(made: Compiled, point: StationaryPoint, held: Conditions) -> StationaryMoments:
    found = name_moments(made.functions, point.mean, point.covariance, point.drift, held)
    names = Names.of(made)
    return StationaryMoments(
        model=names.model,
        states=names.states,
        outputs=names.outputs,
        state_mean=found.state_mean,
        state_covariance=found.state_covariance,
        output_mean=found.output_mean,
        output_variance=found.output_variance,
        stable=point.stable,
        residual=point.residual,
        eigenvalues=point.eigenvalues,
        drifting=found.drifting,
        path=point.path,
        provenance=names.provenance(f"exact Newton ({point.path[-1]})", 0.0, {}, held.p),
    )
