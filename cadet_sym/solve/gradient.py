"""Derivatives of one mean, variance or covariance of a run, at any times, in parameters and in the start.

What depends on a parameter: the start (the ground's stationary covariance, initial values), the equations, and the times
at which known inputs change abruptly. The moments are continuous there but their derivatives jump: where a breakpoint
t_b(p) moves, S gains (y'(t_b-) - y'(t_b+)) dt_b/dp.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import SolverError
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.solve.many import Start
from cadet_sym.solve.scales import peaks
from cadet_sym.solve.sensitivity import adjoint, forward, head
from cadet_sym.solve.transient import engine_for, integrate
from cadet_sym.solve.variational import COMPILED

__all__ = ["Gradient", "start_entry"]

Array = npt.NDArray[np.float64]

MANY = 20
"""Parameters, above the number of times, from which on one run backwards a time is cheaper than a column a parameter, where
those are not carried in machine code."""

ANOTHER = 1e-3
"""Of a moment's size: more is another run."""

STEP = 1e-5
"""Of central differences, relative: of what is found by iteration."""


def start_entry(functions: MomentFunctions, pair: tuple[str, str] | str) -> int:
    """Where the mean of a state, or the covariance of two, stands in the packed moments; -1 if there is no such state."""
    facts, packing = functions.facts, functions.facts.packing
    names = [pair] if isinstance(pair, str) else list(pair)
    if len(names) not in (1, 2) or any(name not in facts.states for name in names):
        return -1
    if len(names) == 1:
        return facts.states.index(names[0])
    low, high = sorted(facts.states.index(name) for name in names)
    rows, columns = packing.triangle
    return packing.n + int(np.flatnonzero((rows == high) & (columns == low))[0])


def _refuse_another_run(y: Array, known: Array, size: Array) -> None:
    """Raise SolverError if moments that were carried along with derivatives are not those of the run, known roughly."""
    change = float((np.abs(y - known) / size).max(initial=0.0))
    if not change <= ANOTHER:
        raise SolverError(
            "the derivatives break down: the moments carried along with them differ from those of the run by "
            f"{change:.2g} of their size. Start with a little variance, or take differences of runs."
        )


@dataclass(frozen=True)
class Gradient:
    """The derivatives of a run in all that it starts from.

    Parameters
    ----------
    start : gives the start of a run at parameters p.
    """

    functions: MomentFunctions
    start: Callable[[Array], Start]

    def __call__(
        self, wanted: ca.Function, p: Array, columns: Sequence[int], entries: Sequence[int], times: Array, method: str
    ) -> Array:
        """Derivatives (k, parameters + entries) at the times (k,).

        Parameters
        ----------
        wanted : (t, y, p) -> value, d/dy, d/dp; see `sensitivity.quantity`.
        columns, entries : of p, and of the packed moments at the start.
        method : "forward", "adjoint" or "auto".

        Raises
        ------
        SolverError
            If the derivatives break down.
        """
        start = self.start(p)
        units = np.zeros((len(start.y), len(entries)))
        units[list(entries), range(len(entries))] = 1.0
        slope = np.hstack([self._start_slope(start), units])
        size, known = self._run(start, times)
        chosen = [*columns, *range(len(p), len(p) + len(entries))]
        many = len(chosen) > MANY + len(times) and engine_for(self.functions, start, times) not in COMPILED
        if method == "adjoint" or (method == "auto" and many):
            try:
                return self._adjoint(wanted, start, times, size, slope)[:, chosen]
            except SolverError:
                if method == "adjoint":
                    raise
        own = [*columns, *([-1] * len(entries))]
        moved = {t: np.append(each[list(columns)], [0.0] * len(entries)) for t, each in self._moved(start).items()}
        y, S = forward(self.functions, start, slope[:, chosen], own, size, times, moved)
        _refuse_another_run(y, known, size)
        rows = []
        for t, moments, part in zip(times, y, S, strict=True):
            _, in_y, in_p = (np.asarray(each) for each in wanted(t, moments, p))
            rows.append(in_y[0] @ part + np.append(in_p[0, list(columns)], [0.0] * len(entries)))
        return np.array(rows)

    def _adjoint(self, wanted: ca.Function, start: Start, times: Array, size: Array, slope: Array) -> Array:
        y = integrate(self.functions, start, times, rtol=1e-9).y
        moved, rows = self._moved(start), []
        begin, begun, slope_there = self._headed(start, times, size, slope)
        for t, moments in zip(times, y, strict=True):
            _, in_y, in_p = (np.asarray(each) for each in wanted(t, moments, start.p))
            if t > 0:
                direct, at_begin, reached = adjoint(self.functions, begun, size, float(t), in_y[0], moved, begin)
                _refuse_another_run(reached, moments, size)
                row = at_begin @ slope_there
                row[: len(direct)] += direct
            else:
                row = in_y[0] @ slope
            row[: len(start.p)] += in_p[0]
            rows.append(row)
        return np.array(rows)

    def _headed(self, start: Start, times: Array, size: Array, slope: Array) -> tuple[float, Start, Array]:
        """Where runs backwards end, and the moments and their derivatives there."""
        later = times[times > 0]
        begin = head(start, self.functions.facts.packing.diagonal, float(later[0])) if len(later) else 0.0
        if begin == 0:
            return 0.0, start, slope
        count = len(start.p)
        own = [*range(count), *([-1] * (slope.shape[1] - count))]
        y, S = forward(self.functions, start, slope, own, size, np.array([begin]), {})
        return begin, replace(start, y=y[0]), S[0]

    def _run(self, start: Start, times: Array) -> tuple[Array, Array]:
        """How large every moment becomes, (size,), and the moments at the times."""
        grid = np.union1d(np.linspace(0, times[-1], 33), times)
        y = integrate(self.functions, start, grid, rtol=1e-6).y
        return peaks(y, self.functions.facts.packing), y[np.searchsorted(grid, times)]

    def _start_slope(self, start: Start) -> Array:
        """Derivative (size, parameters) of the start: central differences where a stationary state is solved for."""
        p, initial = start.p, self.functions.initial
        if np.allclose(np.asarray(initial(p)).ravel(), start.y, rtol=1e-12, atol=0):
            q = ca.MX.sym("q", len(p))
            return np.asarray(ca.Function("slope", [q], [ca.jacobian(initial(q), q)])(p))
        return self._differences(p, lambda q: self.start(q).y, len(start.y))

    def _moved(self, start: Start) -> Mapping[float, Array]:
        """How every known breakpoint moves with the parameters, (parameters,) each."""
        count = len(start.breakpoints)
        if not count:
            return {}

        def breakpoints(q: Array) -> Array:
            found = np.array(self.start(q).breakpoints)
            if len(found) != count:
                raise SolverError(
                    "the derivatives do not exist: with the parameters an abrupt change of speed, ground or input comes "
                    "or goes. Move the parameter, or the end of the run, a little."
                )
            return found

        slopes = self._differences(start.p, breakpoints, count)
        return dict(zip(start.breakpoints, slopes, strict=True))

    def _differences(self, p: Array, value: Callable[[Array], Array], size: int) -> Array:
        """Derivative (size, parameters) by central differences."""
        found = np.empty((size, len(p)))
        for j, step in enumerate(STEP * np.maximum(np.abs(p), 1e-3)):
            move = step * np.eye(len(p))[j]
            found[:, j] = (value(p + move) - value(p - move)) / (2 * step)
        return found
