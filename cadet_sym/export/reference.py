"""Numbers that Python computed, for an exported library to compare itself with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import SolverError
from cadet_sym.export.tables import array
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.packing import Packing
from cadet_sym.solve.breakpoints import find_breakpoints
from cadet_sym.solve.many import Start
from cadet_sym.solve.transient import integrate

__all__ = ["Sample", "reference_text", "sample"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sample:
    """A time in the model's own run, the moments there, rounded, and the size of each to one digit."""

    t: float
    y: Array
    size: Array


def sample(lowered: MomentFunctions, p: Array, y0: Array, duration: float) -> Sample:
    """Find moments such as a run has: `p` and `y0` are the parameters, and the packed moments at the start."""
    end, y = _reached(lowered, p, y0, duration)
    size = _sizes(lowered.facts.packing, y)
    # five digits of its size: no other integrator or machine gives another text
    rounded = np.round(y / (1e-5 * size)) * (1e-5 * size)
    return Sample(end, np.array([float(f"{value:.9g}") for value in rounded]), size)


def reference_text(lowered: MomentFunctions, p: Array, y0: Array, duration: float, at: Sample) -> str:
    """The header of the test program, rounded so that another machine's libm gives the same text."""
    end, y, size = at.t, at.y, at.size
    mean, variance = lowered.outputs(end, y, p)
    numbers: dict[str, Iterable[float]] = {
        "initial": y0,
        "sample_y": y,
        "final": y,
        "size": size,
        "rate": np.asarray(lowered.rate(end, y, p)).ravel(),
        # the Jacobian times the sizes
        "jacobian": np.asarray(ca.mtimes(lowered.jacobian(end, y, p), size)).ravel(),
        "output_mean": np.asarray(mean).ravel(),
        "output_variance": np.asarray(variance).ravel(),
    }
    lines = [
        "/* What cadet-sym computed; see test.c. */",
        f"static const double sample_t = {end!r};",
        f"static const double run_end = {end!r};",
        f"static const int breakpoint_count = {len(find_breakpoints(lowered, p, duration))};",
    ]
    for key, values in numbers.items():
        lines.append(array(f"static const double {key}", [f"{float(value) + 0.0:.12g}" for value in values]))
    return "\n".join(lines) + "\n"


def _reached(lowered: MomentFunctions, p: Array, y0: Array, duration: float) -> tuple[float, Array]:
    """A time in the run and the moments there; the start itself if the run breaks down."""
    packing = lowered.facts.packing
    # whole runs of larger models take long; the comparison needs only a part
    end = float(f"{duration / (1 if packing.size <= 20 else 20):.6g}")
    if not end > 0:
        return 0.0, y0
    edges = find_breakpoints(lowered, p, end)
    if packing.ground and not len(edges):
        return end, _explicit(lowered, p, y0, end)
    engine = "auto" if lowered.large else "direct"  # the same on every machine, but for the large slow
    try:
        found = integrate(lowered, Start(y0, p, edges), np.array([end]), rtol=1e-9, engine=engine)
    except SolverError:
        return 0.0, y0
    return end, found.y[-1]


def _explicit(lowered: MomentFunctions, p: Array, y0: Array, end: float) -> Array:
    """Moments at `end` by an explicit method: a thousand equations that are not stiff need no decomposition."""
    from scipy.integrate import solve_ivp

    def reached(rtol: float, atol: Array | float) -> Array:
        rate = lambda t, y: np.asarray(lowered.rate(t, y, p)).ravel()  # noqa: E731
        found = solve_ivp(rate, (0.0, end), y0, method="DOP853", rtol=rtol, atol=atol)
        return np.asarray(found.y[:, -1], dtype=float)

    # Covariances that grow from nothing are held to their own size, as the comparison holds them.
    rough = reached(1e-6, 1e-12 * float(np.abs(y0).max(initial=1e-9)))
    return reached(1e-9, 1e-9 * _sizes(lowered.facts.packing, rough))


def _sizes(packing: Packing, y: Array) -> Array:
    """The size of every moment, to one digit: standard deviations and their products."""
    mean, covariance = packing.unpack(y)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # what an integrator leaves where nothing is random is no size
    deviation[deviation < 1e-25 * np.abs(mean).max(initial=0.0)] = 0.0
    rows, columns = packing.triangle
    alongside = y[packing.moments :]
    size = np.concatenate(
        [
            np.maximum(np.abs(mean), deviation),
            deviation[rows] * deviation[columns],
            np.full(len(alongside), np.abs(alongside).max(initial=0.0)),
        ]
    )
    return np.array([10.0 ** np.floor(np.log10(s)) if s > 0 else 1.0 for s in size])
