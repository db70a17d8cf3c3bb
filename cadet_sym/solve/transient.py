"""Integrate the moment equations over a run: y' = rate(t, y, p) from y(0), at the times asked for.

The run is cut at every known breakpoint (a kink of the speed, an edge of the profile, a wheel that meets the
ground) and restarted there, for no integrator sees an input that is shorter than its step. Every moment is
integrated to its own size, so that one tolerance means the same for a displacement in metres and a force in newtons:
a step's error is held under local (|y| + size / 100). The sizes come from a rough run beforehand, the engine from the
number of states and the eigenvalues of N.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.packing import Packing
from cadet_sym.solve.breakdown import Breakdown, explain
from cadet_sym.solve.cvodes import Direct
from cadet_sym.solve.definite import lost, warn_of_loss
from cadet_sym.solve.evaluate import Rate, gains
from cadet_sym.solve.krylov import Stepping
from cadet_sym.solve.native import Native, has_machine_code
from cadet_sym.solve.onset import past_onset
from cadet_sym.solve.scales import Tolerance, fits, peaks

__all__ = ["ENGINES", "Start", "Trajectory", "check_times", "integrate"]

Array = npt.NDArray[np.float64]

ABSOLUTE = 1e-2
"""Absolute over relative tolerance, in units of each moment's own size, at rtol 1e-6 and above."""

ROUGH = 1e-2
"""Tolerance of the run that finds the sizes."""

SMALL = 100
"""Packed moments up to which CasADi's CVODES with its direct solver is the fastest (12 states) ..."""

SMALL_DELAYED = 700
"""The same where wheels follow each other: most of the Jacobian is the ground between them, and sparse."""

SPARSE = 600
"""The same where N has at most four entries a row (33 states)."""

BETWEEN = 100.0
"""How much more the correlation with the ground between two wheels may err: it is smoothed on its way to the wheel behind."""

QUICK = 20_000.0
"""Fastest rate of the covariance times duration up to which explicit formulas in machine code are the fastest."""

BUILT = 2500
"""Packed moments above which an integrator of CasADi's takes long to build (70 states)."""

FEW = 6
"""... unless the run has more stretches than this, each of which needs an integrator of its own."""

MILD = 500.0
"""Fastest decay of the covariance times duration up to which explicit formulas are the cheapest ..."""

SWINGING = 20_000.0
"""... and largest frequency: what swings and hardly decays keeps the steps of implicit formulas short as well."""

SWING = 0.5
"""Share of a step's tolerance that explicit formulas are given."""

ENGINES = ("auto", "direct", "implicit", "krylov", "explicit", "stepping", "native")


@dataclass(frozen=True)
class Trajectory:
    """Packed moments at the times asked for, and how they were integrated."""

    time: Array  # (k,)
    y: Array  # (k, size)
    engine: str
    rtol: float
    statistics: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Start:
    """Where a run starts and what it meets: packed moments at t = 0, parameters, times of known breakpoints."""

    y: Array
    p: Array
    breakpoints: tuple[float, ...] = ()
    beyond: tuple[float, Array] | None = None
    """Where the rate jumps at t = 0, the time and the packed moments on the far side (see `onset`)."""

    @property
    def first(self) -> tuple[float, Array]:
        """Time and packed moments from which to integrate."""
        return self.beyond or (0.0, self.y)


class Engine(Protocol):
    """One way to integrate a stretch."""

    @property
    def name(self) -> str:
        """The method, by its name in the literature."""
        ...

    @property
    def steps(self) -> int:
        """How much work it was."""
        ...

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`; raises Breakdown."""
        ...


def integrate(
    lowered: MomentFunctions,
    start: Start,
    times: npt.ArrayLike,
    *,
    rtol: float = 1e-8,
    engine: str = "auto",
    declared: Callable[[], Start] | None = None,
) -> Trajectory:
    """Integrate the packed moments from the start to the `times` (increasing, from 0 on).

    Parameters
    ----------
    engine : "auto", or "direct" (CasADi's CVODES), "implicit" or "krylov" (BDF with the Lyapunov inverse, by itself
        or as the preconditioner of GMRES), "explicit" (Adams, CasADi's CVODES), "stepping" (the same, restarted at no
        cost), "native" (explicit Runge-Kutta formulas in machine code, where LLVM is there).
    declared : the start at the model's own parameters. The sizes found there serve for other values unless they turn
        out not to suit: repeated runs find them once, and no result depends on what ran before.

    Raises
    ------
    SolverError
        If the integration fails or overflows: says at what time, for which state, and what was reached; `partial` is
        the Trajectory up to there.
    """
    grid = check_times(times)
    if not (np.isfinite(rtol) and 1e-13 <= rtol <= 0.1):
        raise ModelError(f"rtol is {rtol!r}; it must lie between 1e-13 and 0.1.")
    if engine not in ENGINES:
        raise ModelError(f"`{engine}` is not an engine; those are: {', '.join(ENGINES)}.")
    if engine == "native" and not has_machine_code(lowered, start.p, start.y):
        raise ModelError(
            'engine "native": there is no machine code of this model, for it is large (have it made with `jit=True`) or '
            "LLVM is not there; leave `engine` out."
        )
    began = time.perf_counter()
    packing = lowered.facts.packing
    kind = engine if engine != "auto" else _chosen(lowered, start, grid)
    size = _sizes(lowered, start, float(grid[-1]), kind, declared)
    start = replace(start, beyond=past_onset(lowered, start.y, start.p, float(grid[grid > 0].min(initial=grid[-1]))))
    y, used = _march(lowered, start, grid, kind, _tolerance(rtol, size, packing, kind), rtol)
    if not fits(size, y, packing):
        size = peaks(np.vstack([start.y, y]), packing)
        y, used = _march(lowered, start, grid, kind, _tolerance(rtol, size, packing, kind), rtol)
    if lost(y, packing).any():
        y, used = _march(lowered, start, grid, kind, _tolerance(rtol * 1e-3, size, packing, kind), rtol)
        warn_of_loss(grid, y, packing, lowered.facts.states)
    statistics = {"steps": float(used.steps), "stretches": len(_edges(start, grid)) - 1.0}
    return Trajectory(grid, y, used.name, rtol, statistics | {"seconds": time.perf_counter() - began})


def check_times(times: npt.ArrayLike) -> Array:
    """The times as an increasing array from zero on."""
    grid = np.atleast_1d(np.asarray(times, dtype=float))
    if grid.ndim != 1 or grid.size == 0 or not np.all(np.isfinite(grid)):
        raise ModelError("times must be a non-empty sequence of finite numbers.")
    if np.any(np.diff(grid) <= 0):
        row = int(np.argmax(np.diff(grid) <= 0))
        raise ModelError(f"times must increase, but {grid[row + 1]:g} follows {grid[row]:g}.")
    if grid[0] < 0:
        raise ModelError(f"times begin at {grid[0]:g}; the run begins at 0.")
    return grid


_known_choices: WeakKeyDictionary[MomentFunctions, dict[tuple[object, ...], str]] = WeakKeyDictionary()


def _chosen(lowered: MomentFunctions, start: Start, grid: Array) -> str:
    """The engine of a run, remembered for the next of the same."""
    kept = _known_choices.setdefault(lowered, {})
    key = (lowered.jit, start.p.tobytes(), start.y.tobytes(), start.breakpoints, float(grid[-1]))
    if key not in kept:
        if len(kept) > 256:
            kept.clear()
        kept[key] = _choose(lowered, start, grid)
    return kept[key]


def _choose(lowered: MomentFunctions, start: Start, grid: Array) -> str:
    """Direct while small; else by what explicit formulas would cost: the frequencies of P are sums of two of N's."""
    packing = lowered.facts.packing
    if np.abs(_modes(lowered, start, grid)).max(initial=0.0) <= QUICK and has_machine_code(lowered, start.p, start.y):
        return "native"
    few = len(_edges(start, grid)) - 1 <= FEW
    if few and packing.size <= (SMALL if lowered.facts.delay is None else SMALL_DELAYED):
        return "direct"
    modes = _modes(lowered, start, grid)
    if not np.isfinite(modes).all():
        return "implicit"
    if np.abs(modes).max(initial=0.0) <= SWINGING and np.abs(modes.real).max(initial=0.0) <= MILD:
        return "explicit" if few and packing.size <= BUILT else "stepping"
    sparse = packing.size <= SPARSE and lowered.gain_matrix.nnz_out(0) <= 4 * packing.n
    return "direct" if few and sparse and lowered.facts.delay is None else "implicit"


def _modes(lowered: MomentFunctions, start: Start, grid: Array) -> npt.NDArray[np.complex128]:
    """Eigenvalues of the covariance's rate over the run's length, from N at three times; NaN where it has none."""
    duration = float(grid[-1])
    matrices = np.array([gains(lowered, t, start.y, start.p) for t in (0.0, duration / 2, duration)])
    if not np.isfinite(matrices).all():
        return np.array([complex(np.nan)])
    return np.asarray(2 * duration * np.linalg.eigvals(matrices), dtype=complex)


def _tolerance(rtol: float, size: Array, packing: Packing, kind: str) -> Tolerance:
    """What a step may err by: errors add up, the more steps the more, and small values matter the more."""
    tight = min(1.0, max(rtol, 1e-13) / 1e-6)
    weighed = size.copy()
    weighed[len(size) - packing.ground :] *= BETWEEN
    if kind == "native":  # the errors of its order hardly add up
        return Tolerance(max(rtol, 1e-13), tight**0.5 * ABSOLUTE, weighed)
    return Tolerance(max(tight**0.75 * rtol, 2e-14), tight**0.5 * ABSOLUTE, weighed)


def _engine(lowered: MomentFunctions, p: Array, kind: str, tolerance: Tolerance) -> Engine:
    if kind == "native":
        return Native(lowered, p, tolerance)
    if kind in ("direct", "explicit"):
        if kind == "explicit":  # many small errors of one sign add up where moments swing
            tolerance = replace(tolerance, relative=tolerance.relative * SWING)
        return Direct(lowered, p, tolerance, stiff=kind == "direct")
    return Stepping(lowered, p, tolerance, stiff=kind != "stepping", full_newton=kind == "krylov")


# -- sizes ------------------------------------------------------------------------------------------------

_known_sizes: WeakKeyDictionary[MomentFunctions, dict[tuple[float, bytes], Array]] = WeakKeyDictionary()


def _sizes(
    lowered: MomentFunctions, start: Start, duration: float, kind: str, declared: Callable[[], Start] | None
) -> Array:
    """How large every moment becomes over the duration, at the declared parameters if those are known."""
    kept = _known_sizes.setdefault(lowered, {})
    key = (duration, b"" if declared else start.p.tobytes() + start.y.tobytes())
    if key not in kept:
        if len(kept) > 256:
            kept.clear()
        kept[key] = _rough_run(lowered, declared() if declared else start, duration, kind)
    return kept[key]


def _rough_run(lowered: MomentFunctions, start: Start, duration: float, kind: str) -> Array:
    """Sizes from a run with tolerances far below anything's size; guesses where that run fails."""
    packing = lowered.facts.packing
    rate, slopes = Rate(lowered, start.p), np.empty((3, packing.size))
    for t, slope in zip((0.0, duration / 2, duration), slopes, strict=True):
        rate(t, start.y, slope)
    largest = np.abs(start.y).max(initial=0.0) + np.abs(np.nan_to_num(slopes)).max() * max(duration, 1e-300)
    small = np.sqrt(largest) if largest > 0 else 1.0
    grid = np.linspace(0, duration, 34)[1:] if duration > 0 else np.zeros(1)
    for fraction in (1e-6, 1e-3):
        guess = Tolerance(ROUGH, ABSOLUTE, np.full(packing.size, fraction * small), 5_000)
        try:
            y, _ = _march(lowered, start, grid, kind, guess)
        except Breakdown:
            continue
        return peaks(np.vstack([start.y, y]), packing)
    return np.full(packing.size, 1e-3 * small)


# -- marching ---------------------------------------------------------------------------------------------


def _edges(start: Start, grid: Array) -> list[float]:
    first = start.first[0]
    return [first, *sorted(b for b in set(start.breakpoints) if first < b < grid[-1]), float(grid[-1])]


def _march(
    lowered: MomentFunctions,
    start: Start,
    grid: Array,
    kind: str,
    tolerance: Tolerance,
    asked: float | None = None,
) -> tuple[Array, Engine]:
    """Integrate stretch by stretch; returns the moments at the times, and the engine.

    A breakdown leaves as it is, or, where the tolerance asked for is given, explained to the user.
    """
    engine = _engine(lowered, start.p, kind, tolerance)
    y, found = start.first[1], [start.y] if grid[0] == 0 else []
    for begin, end in itertools.pairwise(_edges(start, grid)):
        if end <= begin:
            continue
        inside = grid[(grid > begin) & (grid <= end)]
        stretch = inside if inside.size and inside[-1] == end else np.append(inside, end)
        try:
            values = _advance(engine, begin, y, stretch)
        except Breakdown as breakdown:
            if asked is None:
                raise
            if breakdown.found is not None:
                found.extend(breakdown.found[: inside.size])
            kept = np.array(found).reshape(len(found), len(y))
            partial = Trajectory(grid[: len(kept)], kept, engine.name, asked)
            raise explain(lowered, start.p, breakdown, begin, y, partial) from None
        found.extend(values[: inside.size])
        y = values[-1]
    return np.array(found), engine


def _advance(engine: Engine, begin: float, y: Array, stretch: Array) -> Array:
    """One stretch; what the engine gives up, scikit-sundae's CVODE goes through, or it is said how far it came."""
    try:
        return engine.advance(begin, y, stretch)
    except Breakdown as first:
        if not isinstance(engine, Direct | Native):
            raise
        second = Stepping(engine.lowered, engine.p, engine.tolerance, stiff=True, full_newton=True)
        try:
            return second.advance(begin, y, stretch)
        except Breakdown:
            if first.found is None:
                raise
            raise first from None  # who knows to the last step where it was
