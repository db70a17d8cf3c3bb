"""The moments at t = 0, and where the ground's deterministic profile has brought the filters by then."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.memory import Memory
from cadet_sym.solve.evaluate import depends_on, results, results_over, results_shared
from cadet_sym.warning import warn

__all__ = ["initial_moments", "profile_mean"]

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

UNEVEN = 1e-9
"""Relative difference of the ground's equations under two wheels that is more than rounding."""

DECAY = 40.0
"""Decay lengths of the slowest mode that are looked back on: exp(-40) is below rounding."""

_which: Memory[Places] = Memory()


def initial_moments(functions: MomentFunctions, p: Array) -> Array:
    """The packed moments (runs, size) at t = 0 for parameters (runs, count).

    Raises
    ------
    ModelError
        If the ground has no stationary state to start from, or a covariance is not positive semidefinite.
    """
    facts = functions.facts
    if facts.whole:
        from cadet_sym.solve.steady import steady_start

        return np.array([steady_start(functions, each) for each in p])
    if facts.filters and not facts.smooth:
        _refuse_drifting_ground(functions, p)
        if facts.delay is not None:
            _warn_of_uneven_start(functions, p)
    distinct = p[:1] if _start_alike(functions, p) else p
    (y,) = results_over(functions.initial, distinct)
    if _has_profile(functions):
        y[:, : facts.packing.n] += [profile_mean(functions, each) for each in distinct]
    _, covariance = facts.packing.unpack(y)
    lowest = np.linalg.eigvalsh(covariance)[:, 0] if facts.packing.n else np.zeros(len(y))
    good = lowest >= -1e-9 * np.maximum(np.einsum("kii->k", covariance), 1e-300)
    if not good.all():
        raise ModelError(
            f"[initial]: the covariance at the start is not positive semidefinite (smallest eigenvalue "
            f"{lowest[~good][0]:.3g}); check [initial.covariance]: |cov(a, b)| may not exceed std(a) std(b)."
        )
    return y if len(y) == len(p) else y.repeat(len(p), axis=0)


def _start_alike(functions: MomentFunctions, p: Array) -> bool:
    """Whether runs that differ in their parameters surely start from the same moments."""
    if len(p) == 1 or _has_profile(functions):
        return False
    used = _which(functions, 0, lambda: depends_on(functions.initial.jac_sparsity(0, 0)))
    return bool((p[:, used] == p[:1, used]).all())


def _refuse_drifting_ground(functions: MomentFunctions, p: Array) -> None:
    matrices = results_over(functions.filters, p)
    for place, entries in zip(functions.facts.filters, matrices, strict=True):
        C = entries.reshape(len(p), place.size, place.size).transpose(0, 2, 1)
        decay = np.linalg.eigvals(C)
        lasting = decay.real > -1e-12 * np.abs(entries).max(axis=1, initial=1e-300)[:, None]
        if lasting.any():
            slowest = decay[lasting][0]
            raise ModelError(
                f'[initial] ground = "stationary": the ground under `{place.contact}` has no stationary height: its '
                f"filter has the eigenvalue {slowest:.3g} per unit of length, which does not decay (an integrated road "
                'wanders without bound). Start with `ground = "smooth"`, or give the road a low-frequency `cutoff`.'
            )


def _warn_of_uneven_start(functions: MomentFunctions, p: Array) -> None:
    """Warn where the ground at the start is not one and the same under the wheels of a track, for parameters (k, count)."""
    (unlike,) = results_over(functions.unevenness, p)
    if not (unlike <= UNEVEN).all():
        text = (
            "the ground at the start is not the same under all wheels of a track; all of it is taken to be like that under "
            "the rearmost, until they have left it. Let the travel begin where the ground is the same over the wheelbase, "
            'or use `ground = "smooth"`'
        )
        warn(RuntimeWarning(text))


def profile_mean(functions: MomentFunctions, p: Array) -> Array:
    """What the profile behind the start adds to the mean at t = 0, (n,).

    Each filter obeys xi' = C xi + o(s) in the mean; a profile that is zero behind every wheel adds nothing.
    """
    facts = functions.facts
    mean = np.zeros(facts.packing.n)
    if not _has_profile(functions):
        return mean
    for k, place in enumerate(facts.filters):
        if place.profile:
            mean[place.start : place.start + place.size] = _response(functions, k, p)
    linear = np.asarray(functions.vehicle_start(p)[1])
    mean[: facts.vehicle] = linear @ mean[facts.vehicle :]
    return mean


def _has_profile(functions: MomentFunctions) -> bool:
    return not functions.facts.smooth and any(place.profile for place in functions.facts.filters)


_Along = Callable[[Array], tuple[Array, Array]]


def _response(functions: MomentFunctions, k: int, p: Array) -> npt.NDArray[np.floating]:
    """State of one filter where its wheel stands at the start, from all the profile behind it."""
    setbacks, edges = results(functions.places, p)
    here = float(results(functions.motion, np.zeros(1), p)[3][0]) - float(setbacks[k])

    def along(s: Array) -> tuple[Array, Array]:
        """C (m, r, r) and offset (m, r) at places (m,)."""
        m, r = len(s), functions.facts.filters[k].size
        C, offset = results_shared(functions.profiles, m, s, p)[2 * k : 2 * k + 2]
        return C.reshape(m, r, r).transpose(0, 2, 1), offset

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
