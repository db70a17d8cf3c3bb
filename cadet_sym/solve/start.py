"""Where the ground's deterministic profile has brought the filters by the time the vehicle starts."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.evaluate import results_over

__all__ = ["profile_mean", "warn_of_uneven_start"]

Array = npt.NDArray[np.float64]

UNEVEN = 1e-9
"""Relative difference of the ground's equations under two wheels that is more than rounding."""

DECAY = 40.0
"""Decay lengths of the slowest mode that are looked back on: exp(-40) is below rounding."""


def profile_mean(functions: MomentFunctions, p: Array) -> Array:
    """What the profile behind the start adds to the mean at t = 0, (n,).

    Each filter obeys xi' = C xi + o(s) in the mean; a profile that is zero behind every wheel adds nothing.
    """
    facts = functions.facts
    mean = np.zeros(facts.packing.n)
    if facts.smooth or not any(place.profile for place in facts.filters):
        return mean
    for k, place in enumerate(facts.filters):
        if place.profile:
            mean[place.start : place.start + place.size] = _response(functions, k, p)
    linear = np.asarray(functions.vehicle_start(p)[1])
    mean[: facts.vehicle] = linear @ mean[facts.vehicle :]
    return mean


def warn_of_uneven_start(functions: MomentFunctions, p: Array) -> None:
    """Warn where the ground at the start is not one and the same under the wheels of a track, for parameters (k, count)."""
    (unlike,) = results_over(functions.unevenness, p)
    if not (unlike <= UNEVEN).all():
        warnings.warn(
            "the ground at the start is not the same under all wheels of a track; all of it is taken to be like that under "
            "the rearmost, until they have left it. Let the travel begin where the ground is the same over the wheelbase, "
            'or use `ground = "smooth"`',
            RuntimeWarning,
            stacklevel=4,
        )


_Along = Callable[[Array], tuple[Array, Array]]


def _response(functions: MomentFunctions, k: int, p: Array) -> npt.NDArray[np.floating]:
    """State of one filter where its wheel stands at the start, from all the profile behind it."""
    setbacks, edges = (np.asarray(part).ravel() for part in functions.places(p))
    here = float(functions.motion(0, p)[3]) - float(setbacks[k])

    def along(s: Array) -> tuple[Array, Array]:
        """C (m, r, r) and offset (m, r) at places (m,)."""
        m, r = len(s), functions.facts.filters[k].size
        found = functions.profiles.map(m)(s[None, :], np.tile(p[:, None], m))
        C, offset = (np.asarray(found[2 * k + i], dtype=float) for i in (0, 1))
        return C.reshape(r, m, r).transpose(1, 0, 2), offset.T

    C = along(np.array([here]))[0][0]
    slowest = float(-np.linalg.eigvals(C).real.max())
    if not slowest > 1e-12 * np.abs(C).max():
        return np.zeros(len(C))
    behind = here - DECAY / slowest
    stops = [behind, *sorted(e for e in edges.tolist() if behind < e < here), here]
    inside = np.concatenate([np.linspace(a, b, 42)[1:-1] for a, b in pairwise(stops)])
    if not np.any(along(inside)[1]):
        return np.zeros(len(C))
    return _integrated(along, stops)


def _integrated(along: _Along, stops: list[float]) -> npt.NDArray[np.floating]:
    from scipy.integrate import solve_ivp

    def rate(s: float, xi: Array) -> Array:
        C, offset = along(np.array([s]))
        return C[0] @ xi + offset[0]

    C, offset = along(np.array(stops[:1]))
    xi: Array = np.asarray(np.linalg.solve(C[0], -offset[0]), dtype=float)
    for begin, end in pairwise(stops):
        inset = 1e-12 * (end - begin)  # on the stretch's own side of its edges
        found = solve_ivp(rate, (begin + inset, end - inset), xi, method="DOP853", rtol=1e-11, atol=1e-14)
        xi = np.asarray(found.y[:, -1], dtype=float)
    return xi
