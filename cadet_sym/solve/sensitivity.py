"""Derivatives of the moments at given times with respect to parameters and initial values, forward and adjoint.

    S' = (dg/dy) S + dg/dp,    S(0) = dy0/dp          forward: one column a parameter, with the moments themselves
    l' = -(dg/dy)^T l                                 adjoint: one run backwards, whatever the number of parameters

where y' = g(t, y, p). The start depends on the parameters too: through the ground's stationary covariance and the
initial values of the vehicle. Quadratures of the adjoint are under error control: without it CasADi's derivatives can
be wrong in silence from three parameters on.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from functools import lru_cache
from io import StringIO
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ModelError, SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.evaluate import behind
from cadet_sym.solve.many import Start
from cadet_sym.solve.onset import onset
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.transient import engine_for
from cadet_sym.solve.variational import COMPILED, STEPS, columns_at_once, march_slopes, variational_rate

__all__ = ["METHODS", "adjoint", "check_method", "forward", "head", "quantity"]

Array = npt.NDArray[np.float64]

METHODS = ("auto", "forward", "adjoint")

RTOL = 1e-9
"""Of the moments and their derivatives together."""

BACKWARDS = ((1e-10, RTOL / 10), (1e-9, 1e-8), (1e-8, 1e-7))
"""Absolute and relative tolerances to try for the run backwards, where the largest entry is one: what is read between the
steps of the run forwards is smooth only so far."""

STOPS = 8
"""The run backwards has no more than 500 steps between two times, which are a stretch's in so many parts."""

HEAD = 1e-2
"""Share of the first stretch that is left to the derivatives forwards where there is a state without variance: the adjoint
of its variance grows without bound towards such a start."""

EDGE = 1e-9
"""How far before and after a breakpoint its two sides are looked at, relative to its time."""


@dataclass(frozen=True)
class _Stretch:
    """One stretch of the run between breakpoints, and the grid of output times in it that ends with its end."""

    begin: float
    grid: Array
    outputs: int  # how many of the grid are asked for


def forward(
    lowered: MomentFunctions,
    start: Start,
    start_slope: Array,
    columns: Sequence[int],
    size: Array,
    times: Array,
    moved: Mapping[float, Array],
) -> tuple[Array, Array]:
    """Packed moments (k, size) and their derivatives (k, size, c) in the chosen entries of p.

    Parameters
    ----------
    start_slope : (size, c) derivative of the start.
    columns : the entries of p; -1 stands for a column that only the start depends on.
    size : (size,) how large every moment becomes.
    moved : how every breakpoint moves with the columns, (c,) each.
    """
    n, c = len(start.y), len(columns)
    kind = engine_for(lowered, start, times)
    if kind == "implicit" and lowered.large:  # others would factorise a matrix of all moments and derivatives
        kind = "stiff"
    if kind in COMPILED and 0 < (most := columns_at_once(lowered)) < c:
        groups = [slice(k, k + most) for k in range(0, c, most)]
        parts = [
            forward(lowered, start, start_slope[:, k], columns[k], size, times, {t: each[k] for t, each in moved.items()})
            for k in groups
        ]
        return parts[0][0], np.concatenate([S for _, S in parts], axis=2)
    y, S = start.y, start_slope
    moments, slopes = [], []
    if times[0] == 0:
        moments.append(y)
        slopes.append(S)
    # A column's unit is what makes it as large as the moments.
    unit = np.maximum(np.abs(S).max(axis=0, initial=0.0) / size.max(), 0.0)
    unit = np.where(unit > 0, unit, [1 / max(abs(start.p[j]), 1e-3) if j >= 0 else 1.0 for j in columns])
    scale = np.concatenate([size, (size[:, None] * unit).ravel(order="F")])
    for stretch in _stretches(start, times):
        if stretch.begin in moved:
            S = S + np.outer(_jump(lowered, start.p, stretch.begin, y), moved[stretch.begin])
        z = np.concatenate([y, S.ravel(order="F")])
        found = _over(lowered, start.p, tuple(columns), stretch, z, scale, kind)
        for row in found[: stretch.outputs]:
            moments.append(row[:n])
            slopes.append(row[n:].reshape(n, c, order="F"))
        y, S = found[-1, :n], found[-1, n:].reshape(n, c, order="F")
    return np.array(moments), np.array(slopes)


_Way = tuple[tuple[str, Any], ...]


def _run_forward(
    lowered: MomentFunctions, p: Array, columns: tuple[int, ...], stretch: _Stretch, z: Array, scale: Array, way: _Way
) -> Array:
    run = _integrator(lowered, columns, tuple((stretch.grid - stretch.begin).tolist()), way)
    return np.asarray(run(x0=z, p=ca.vertcat(p, scale, stretch.begin))["xf"]).T * scale


def _over(
    lowered: MomentFunctions, p: Array, columns: tuple[int, ...], stretch: _Stretch, z: Array, scale: Array, kind: str
) -> Array:
    """Moments and derivatives at the times of a stretch.

    Implicit formulas begin where the gains are those of the run (see `onset`): until there, explicit ones lead.
    """
    tolerance = Tolerance(RTOL / 10, 1e-3, scale, STEPS)
    if kind == "native":
        found = march_slopes(lowered, p, columns, stretch.begin, z, stretch.grid, tolerance, kind)
        if found is not None:
            return found
    n = lowered.facts.packing.size
    first = onset(lowered, p, replace(tolerance, size=scale[:n]), stretch.begin, z[:n], stretch.grid)
    passed, begin, head = len(first.found), stretch.begin, np.empty((0, len(z)))
    if passed == len(stretch.grid):
        return _lead(lowered, p, columns, begin, z, stretch.grid, tolerance)
    if first.steps:
        head, begin = _lead(lowered, p, columns, begin, z, np.append(stretch.grid[:passed], first.time), tolerance), first.time
        head, z = head[:-1], head[-1]
    rest = _Stretch(begin, stretch.grid[passed:], stretch.outputs)
    found = None
    if kind == "stiff":
        found = march_slopes(lowered, p, columns, begin, z, rest.grid, tolerance, kind)
    if found is None:
        found = _first_success(lambda way: _run_forward(lowered, p, columns, rest, z / scale, scale, way), rest)
    return np.vstack([head, found])


def _lead(
    lowered: MomentFunctions, p: Array, columns: tuple[int, ...], begin: float, z: Array, grid: Array, tolerance: Tolerance
) -> Array:
    """Moments and derivatives by explicit formulas: in machine code, or SciPy's."""
    found = march_slopes(lowered, p, columns, begin, z, grid, tolerance, "native")
    if found is not None:
        return found
    from scipy.integrate import solve_ivp

    rate, scale = variational_rate(lowered, columns), tolerance.size
    with np.errstate(all="ignore"):  # what is not finite makes it shorten its step
        led = solve_ivp(
            lambda t, x: np.asarray(rate(t, x * scale, p)).ravel() / scale,
            (behind(begin), float(grid[-1])), z / scale, "DOP853", grid, rtol=RTOL, atol=RTOL * 1e-4,
        )  # fmt: skip
    if not led.success:
        raise _failure(_Stretch(begin, grid, 0), led.message)
    return led.y.T * scale


def _first_success(attempt: Callable[[_Way], Array], stretch: _Stretch) -> Array:
    """BDF may not start where an element sits on its kink without variance: its slope in the variance has no bound."""
    reason: object = "the result is not finite"
    length = float(stretch.grid[-1] - stretch.begin)
    for way in ((), (("step0", 1e-7 * length),), EXPLICIT):
        try:
            found = attempt(way)
        except RuntimeError as error:
            reason = error
            continue
        if np.isfinite(found).all():
            return found
    raise _failure(stretch, reason)


EXPLICIT: _Way = (("linear_multistep_method", "adams"), ("nonlinear_solver_iteration", "functional"))


def head(start: Start, diagonal: npt.NDArray[np.intp], time: float) -> float:
    """Where runs backwards from a time may end."""
    if np.all(start.y[diagonal] > 0):
        return 0.0
    return HEAD * min([time, *(b for b in start.breakpoints if b > 0)])


def adjoint(
    lowered: MomentFunctions,
    start: Start,
    size: Array,
    time: float,
    weight: Array,
    moved: Mapping[float, Array],
    begin: float = 0.0,
) -> tuple[Array, Array, Array]:
    """Derivatives of weight . y(time) in p (parameters,) and in the start (size,), by one run backwards; and y(time).

    Parameters
    ----------
    start : of which the moments are those at `begin`.
    weight : (size,) derivative of the quantity wanted in the packed moments at that time.
    moved : how every breakpoint moves with the parameters, (parameters,) each.
    """
    bar, slope = weight.astype(float), np.zeros(len(start.p))
    stretches = list(_stretches(start, np.array([time]), begin))
    states = [start.y]
    for stretch in stretches:
        run = _plain(lowered, float(stretch.grid[-1] - stretch.begin), *BACKWARDS[0])
        try:
            found = run(x0=states[-1] / size, p=ca.vertcat(start.p, size, stretch.begin))["xf"]
        except RuntimeError as error:
            raise _failure(stretch, error) from None
        states.append(np.asarray(found)[:, -1] * size)
    for stretch, y in zip(reversed(stretches), reversed(states[:-1]), strict=True):
        bar, gained = _backwards(lowered, start.p, stretch, y, size, bar)
        slope += gained
        if stretch.begin in moved:
            slope += bar @ _jump(lowered, start.p, stretch.begin, y) * moved[stretch.begin]
    return slope, bar, states[-1]


def _backwards(
    lowered: MomentFunctions, p: Array, stretch: _Stretch, y: Array, size: Array, bar: Array
) -> tuple[Array, Array]:
    """What a weight at the end of a stretch is at its beginning, and what it has gathered in p on the way."""
    unit = np.abs(bar * size).max(initial=0.0) or 1.0
    weights = np.zeros((len(bar), STOPS))
    weights[:, -1] = bar * size / unit
    seeds = [weights, [], [], [], [], [], []]
    inputs = [y / size, [], ca.vertcat(p, size, stretch.begin), [], [], [], []]
    reason: object = "the adjoint is not finite"
    for tolerances in BACKWARDS:
        run = _plain(lowered, float(stretch.grid[-1] - stretch.begin), *tolerances)
        try:
            with redirect_stderr(StringIO()):  # CasADi prints the inputs of what fails
                found = run.reverse(1)(*inputs, *run.call(inputs), *seeds)
        except RuntimeError as error:
            reason = error
            continue
        weight, gained = (np.asarray(found[k]).ravel() * unit for k in (0, 2))
        if np.isfinite(weight).all() and np.isfinite(gained).all():
            return weight / size, gained[: len(p)]
    raise _failure(stretch, reason)


def _jump(lowered: MomentFunctions, p: Array, t: float, y: Array) -> Array:
    """y'(t-) - y'(t+) at a breakpoint, whose distance may be one of the moments."""
    rate = np.asarray(lowered.rate(t, y, p)).ravel()
    inset = EDGE * t
    before, after = (np.asarray(lowered.rate(t + e, y + e * rate, p)).ravel() for e in (-inset, inset))
    return before - after


def _stretches(start: Start, times: Array, begin: float = 0.0) -> Iterator[_Stretch]:
    edges = [begin, *(b for b in start.breakpoints if begin < b < times[-1]), float(times[-1])]
    for begin, end in itertools.pairwise(edges):
        if end <= begin:
            continue
        inside = times[(times > begin) & (times <= end)]
        grid = inside if inside.size and inside[-1] == end else np.append(inside, end)
        yield _Stretch(begin, grid, inside.size)


_OPTIONS = {
    "reltol": RTOL / 10,
    "abstol": RTOL * 1e-4,
    "max_num_steps": 100_000,
    "quad_err_con": True,
    "show_eval_warnings": False,
    "disable_internal_warnings": True,
}


@lru_cache(maxsize=64)
def _integrator(lowered: MomentFunctions, columns: tuple[int, ...], grid: tuple[float, ...], way: _Way) -> ca.Function:
    function = variational_rate(lowered, columns)
    count, size = len(lowered.parameters), function.size1_in(1)
    return _scaled("forward", function, count, size, list(grid), way)


@lru_cache(maxsize=64)
def _plain(lowered: MomentFunctions, length: float, absolute: float, relative: float) -> ca.Function:
    way = (("augmented_options", {"abstol": absolute, "reltol": relative}),)
    stops = [length * k / STOPS for k in range(1, STOPS + 1)]
    return _scaled("plain", lowered.rate, len(lowered.parameters), lowered.facts.packing.size, stops, way)


def _scaled(name: str, rate: ca.Function, count: int, size: int, grid: list[float], way: _Way = ()) -> ca.Function:
    """CVODES in units of the sizes; p holds the parameters, the sizes and the time at the beginning."""
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", size), ca.SX.sym("p", count + size + 1)
    scale, begin = p[count : count + size], p[count + size]
    ode = rate(begin + t, scale * x, p[:count]) / scale
    options: Any = _OPTIONS | dict(way)
    return ca.integrator(name, "cvodes", {"x": x, "p": p, "t": t, "ode": ode}, 0.0, grid, options)


def _failure(stretch: _Stretch, reason: object) -> SolverError:
    said = re.search(r'CVode\w* returned "(\w+)"', str(reason))
    what = f"CVODES gives up ({said[1]})" if said else str(reason).splitlines()[0][:200].rstrip(".")
    return SolverError(
        f"the derivatives break down between t = {stretch.begin:.6g} and {stretch.grid[-1]:.6g}: {what}. Try the other "
        "method (forward, adjoint) or an earlier time. Where friction brings something to rest without noise, take "
        "differences of runs.",
        time=stretch.begin,
    )


def check_method(method: str) -> None:
    """Refuse a method that does not exist."""
    if method not in METHODS:
        raise ModelError(f"`{method}` is not a way to find derivatives; those are: {', '.join(METHODS)}.")


def quantity(lowered: MomentFunctions, name: str | tuple[str, str], moment: str) -> ca.Function:
    """(t, y, p) -> value, d/dy, d/dp of one mean, variance or covariance of states, or of an output's moments."""
    packing, states = lowered.facts.packing, list(lowered.facts.states)
    outputs = list(lowered.facts.outputs)
    t, y, p = ca.SX.sym("t"), ca.SX.sym("y", packing.size), ca.SX.sym("p", len(lowered.parameters))
    pair = name if isinstance(name, tuple) else (name, name)
    if moment not in ("mean", "variance"):
        raise ModelError(f"`{moment}` is not a moment of a quantity; ask for mean or variance.")
    if all(each in states for each in pair):
        i, j = sorted(states.index(each) for each in pair)
        index = np.flatnonzero((packing.triangle[0] == j) & (packing.triangle[1] == i))[0]
        value = y[i] if moment == "mean" and i == j else y[packing.n + int(index)]
    elif isinstance(name, str) and name in outputs:
        value = lowered.outputs(t, y, p)[0 if moment == "mean" else 1][outputs.index(name)]
    else:
        raise ModelError(f"`{name}` is neither a state nor an output; those are: {', '.join([*states, *outputs])}.")
    return ca.Function("quantity", [t, y, p], [value, ca.jacobian(value, y), ca.jacobian(value, p)])
