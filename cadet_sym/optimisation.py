"""Choose parameters so that a statistic of the stationary state is least, under constraints on others.

Derivatives are exact, by one adjoint solve for each function (see `solve.slopes`); every value comes from an accepted,
stable stationary point, and what the optimiser ends with is judged by the first-order conditions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.compiled import CompiledModel, compile
from cadet_sym.errors import ModelError, SolverError
from cadet_sym.language.goal import Constraint, Goal, read_constraint, read_goal
from cadet_sym.language.model import Model
from cadet_sym.lowering.goals import goal_values, weighted_slopes
from cadet_sym.optima import ConstraintState, Optimum, TradeOff
from cadet_sym.solve.freeze import Conditions, conditions, freeze
from cadet_sym.solve.named import loose_outputs
from cadet_sym.solve.program import ACTIVE, Program, ProgramEnd, minimise
from cadet_sym.solve.slopes import adjoint_weights, residual_slope, sees_window
from cadet_sym.solve.stationary import StationaryPoint, stationary_point
from cadet_sym.stationary import rest

__all__ = ["optimise", "trade_off"]

Array = npt.NDArray[np.float64]


def optimise(
    model: Model | CompiledModel | str | Path,
    *,
    minimise: str,
    over: Mapping[str, tuple[float, float]],
    subject_to: str | Sequence[str] = (),
    starts: int = 1,
    speed: float | None = None,
    at: float | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Optimum:
    """Find the parameters with the least value of an expression in stationary moments.

    Sequential quadratic programming (SciPy's SLSQP) with exact derivatives. It finds a local optimum; more starts look
    for others.

    Parameters
    ----------
    model : a model, compiled or not, or the path of a model file.
    minimise : expression in parameters and `mean(x)`, `variance(x)`, `std(x)`, `covariance(x, y)` of states and outputs.
    over : lowest and highest value by parameter.
    subject_to : comparisons of such expressions, as "std(stroke) <= 0.02".
    starts : searches; the first from the declared values, the others from random ones, the same each time.
    speed, at, parameters : what is held, as for `CompiledModel.stationary`.

    Raises
    ------
    ModelError
        A wrong expression, parameter or range.
    SolverError
        If no search ends at an optimum: there is no stable stationary state, or the constraints cannot be met.
    """
    compiled = model if isinstance(model, CompiledModel) else compile(model)
    texts = [subject_to] if isinstance(subject_to, str) else list(subject_to)
    constraints = [each for text in texts for each in read_constraint(text, compiled.model, compiled.states)]
    goal = read_goal(minimise, compiled.model, compiled.states)
    search = _Search(compiled, goal, tuple(constraints), _ranges(compiled, over), dict(parameters or {}), speed, at)
    return search.best(starts)


def trade_off(
    model: Model | CompiledModel | str | Path,
    *,
    minimise: str,
    against: str,
    limits: Sequence[float] | npt.ArrayLike,
    over: Mapping[str, tuple[float, float]],
    subject_to: str | Sequence[str] = (),
    starts: int = 1,
    **held: Any,
) -> TradeOff:
    """Find the least of one statistic for each limit on another: each search starts from the last optimum.

    Parameters
    ----------
    against : expression to be kept under each of the `limits`.
    model, minimise, over, subject_to, starts, held : as for `optimise`.

    Raises
    ------
    SolverError
        If there is no optimum at any limit. A single limit that cannot be met leaves a gap.
    """
    compiled = model if isinstance(model, CompiledModel) else compile(model)
    values = np.atleast_1d(np.asarray(limits, dtype=float))
    texts = [subject_to] if isinstance(subject_to, str) else list(subject_to)
    optima: list[Optimum | None] = []
    failures: dict[float, str] = {}
    last: dict[str, float] = {}
    for limit in values.tolist():
        try:
            found = optimise(
                compiled,
                minimise=minimise,
                over=over,
                subject_to=[*texts, f"{against} <= {limit!r}"],
                starts=starts,
                **{**held, "parameters": {**(held.get("parameters") or {}), **last}},
            )
            last = dict(found.parameters)
            optima.append(found)
        except SolverError as error:
            failures[limit] = str(error)
            optima.append(None)
    if not any(optima):
        raise SolverError(f"no limit on {against} can be met: {failures[float(values[0])]}")
    return TradeOff(minimise, against, values, tuple(optima), failures)


def _ranges(compiled: CompiledModel, over: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    if not over:
        raise ModelError("an optimum is looked for over at least one parameter; name it with its range.")
    found = {}
    for name, (low, high) in over.items():
        compiled.parameter_vector({name: float(low)})  # an unknown name
        if not (np.isfinite([low, high]).all() and low < high):
            raise ModelError(f"the range of `{name}` is {low:g} to {high:g}; it must be finite and ascending.")
        found[name] = float(low), float(high)
    return found


@dataclass(frozen=True, eq=False)
class _Search:
    """One problem: what is minimised, over what, under which constraints, what else is held."""

    compiled: CompiledModel
    goal: Goal
    constraints: tuple[Constraint, ...]
    over: dict[str, tuple[float, float]]
    fixed: dict[str, float]
    speed: float | None
    at: float | None

    def best(self, starts: int) -> Optimum:
        """The best end of several searches."""
        low, high = (np.array(ends) for ends in zip(*self.over.values(), strict=True))
        declared = dict(zip(self.compiled.parameters, self.compiled.parameter_vector(self.fixed), strict=True))
        rng = np.random.default_rng(0)
        begins = [np.array([declared[name] for name in self.over])]
        begins += [low + (high - low) * rng.random(len(low)) for _ in range(starts - 1)]
        program = Program(self.values, low, high, np.array([c.equal for c in self.constraints], dtype=bool), self._scale)
        ends: list[ProgramEnd] = []
        reason = ""
        for begin in begins:
            try:
                end = minimise(program, begin)
            except SolverError as error:
                reason = reason or str(error)
                continue
            if end.optimal:
                ends.append(end)
            else:
                reason = reason or self._complaint(end)
        if not ends:
            raise SolverError(f"No optimum was found from {starts} start{'s' * (starts > 1)}: {reason}")
        ends.sort(key=lambda end: end.values[0])
        return self._optimum(ends)

    def values(self, x: Array) -> tuple[Array, Array]:
        """Objective and constraints at parameters x (c,), and their derivatives."""
        held, point, y = self._solved(x)
        value, in_y, in_p = (np.asarray(part) for part in self._functions[0](y, held.context, held.p))
        columns = [self.compiled.parameters.index(name) for name in self.over]
        if self._exact(x, point, in_y):
            slopes = np.array([self._through_moments(point, held, y, row) for row in in_y])[:, columns] + in_p[:, columns]
        else:
            slopes = self._differences(x)
        if not (np.isfinite(value).all() and np.isfinite(slopes).all()):
            raise SolverError(f"{self.goal.text} or a constraint has no value or no slope at {self._shown(x)}.")
        return value.ravel(), slopes

    def _solved(self, x: Array) -> tuple[Conditions, StationaryPoint, Array]:
        held = self._held(x)
        point = self._point(x, held)
        return held, point, self.compiled.packing.pack(point.mean, point.covariance)

    def _exact(self, x: Array, point: StationaryPoint, in_y: Array) -> bool:
        """Whether the adjoint gives the slopes: what drifts keeps its direction, and is not seen."""
        if not point.drift.size and point.frame.window is None:
            return True
        if any(sees_window(point, self.compiled.packing.unpack(row)[1]) for row in in_y):
            return False
        return all(point.frame.follows(freeze(self.compiled.functions, self._held(x * q))) for q in (1.001, 0.998))

    def _differences(self, x: Array) -> Array:
        """Derivatives by differences of solutions, of fourth order."""
        columns = []
        for j, step in enumerate(1e-3 * np.maximum(np.abs(x), 1e-3)):
            ends = []
            for k in (-2, -1, 1, 2):
                held, _, y = self._solved(x + k * step * np.eye(len(x))[j])
                ends.append(np.asarray(self._functions[0](y, held.context, held.p)[0]).ravel())
            columns.append((ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step))
        return np.array(columns).T

    def _through_moments(self, point: StationaryPoint, held: Conditions, y: Array, row: Array) -> Array:
        """Derivative in all parameters of a function of the moments, whose derivative in them is given."""
        if not row.any():
            return np.zeros(len(held.p))
        packing = self.compiled.packing
        g, G = packing.unpack(row)
        G = 0.5 * (G + np.diag(np.diag(G)))  # an entry of the triangle stands for two of the matrix
        a, L = adjoint_weights(point, (g, G))
        if self._functions[1] is None:
            return np.array([-(a @ r + np.sum(L * R)) for r, R in self._residual_slopes(point, held)])
        weights = packing.pack(a, 2 * L - np.diag(np.diag(L)))
        return -np.asarray(self._functions[1](weights, y, held.context, held.p)).ravel()

    def _residual_slopes(self, point: StationaryPoint, held: Conditions) -> list[tuple[Array, Array]]:
        """Derivatives of the rates by differences of fourth order, where the wheels' delays vary with parameters."""
        n, free = len(point.mean), {self.compiled.parameters.index(name) for name in self.over}
        found = []
        for j, value in enumerate(held.p):
            move = np.eye(len(held.p))[j]

            def problem(v: float, j: int = j, move: Array = move):
                q = held.p + (v - held.p[j]) * move
                return freeze(self.compiled.functions, conditions(self.compiled.functions, q, self.speed, self.at))

            found.append(residual_slope(problem, value, point) if j in free else (np.zeros(n), np.zeros((n, n))))
        return found

    def _held(self, x: Array) -> Conditions:
        p = self.compiled.parameter_vector({**self.fixed, **dict(zip(self.over, x.tolist(), strict=True))})
        return conditions(self.compiled.functions, p, self.speed, self.at)

    def _point(self, x: Array, held: Conditions) -> StationaryPoint:
        """The stable stationary point, from the last one if there was one."""
        problem = freeze(self.compiled.functions, held)
        self._count[0] += 1
        last = self._count[1]
        begin = rest(self.compiled.functions, held.p) if last is None else (last.mean, last.covariance)
        point = stationary_point(problem, begin)
        if not point.stable:
            raise SolverError(f"the stationary state is unstable at {self._shown(x)}.")
        self._refuse_drift(point, held)
        self._count[1] = point
        return point

    @cached_property
    def _count(self) -> list[Any]:
        """Stationary states solved for, and the last one."""
        return [0, None]

    def _refuse_drift(self, point: StationaryPoint, held: Conditions) -> None:
        loose = loose_outputs(self.compiled.functions, point.drift, held)
        flags = zip((*self.compiled.states, *self.compiled.outputs), (*point.drifting, *loose), strict=True)
        drifting = {name for name, drifts in flags if drifts}
        for goal in (self.goal, *(each.goal for each in self.constraints)):
            for name in sorted(goal.names & drifting):
                raise ModelError(f"`{name}` drifts without bound: it has no stationary moments to stand in {goal.text}.")

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function | None]:
        lowered, held = self.compiled.functions.symbolic, self.speed is not None
        goals = [self.goal, *(each.goal for each in self.constraints)]
        delayed = self.compiled.functions.facts.delay is not None
        return goal_values(lowered, goals, held=held), None if delayed else weighted_slopes(lowered, held=held)

    @cached_property
    def _scale(self) -> Array:
        """Size of each constraint's terms at the declared values."""
        if not self.constraints:
            return np.zeros(0)
        low, high = (np.array(ends) for ends in zip(*self.over.values(), strict=True))
        declared = dict(zip(self.compiled.parameters, self.compiled.parameter_vector(self.fixed), strict=True))
        x = np.clip([declared[name] for name in self.over], low, high)
        values, slopes = self.values(x)
        size = np.abs(values[1:]) + np.abs(slopes[1:]) @ (high - low)
        return np.where(size > 0, size, 1.0)

    def _complaint(self, end: ProgramEnd) -> str:
        if end.infeasibility >= ACTIVE:
            worst = self.constraints[int(np.argmax(end.values[1:] / self._scale))]
            return f"the constraint {worst.text} is not met; nearest at {self._shown(end.x)}."
        return f"{end.message} at {self._shown(end.x)}, where the gradient is not balanced ({end.stationarity:.1e} left)."

    def _shown(self, x: Array) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.over, x, strict=True))

    def _optimum(self, ends: list[ProgramEnd]) -> Optimum:
        best = ends[0]
        width = np.array([high - low for low, high in self.over.values()])
        others: list[ProgramEnd] = []
        for end in ends[1:]:
            if all(np.abs((end.x - known.x) / width).max() > 1e-4 for known in (best, *others)):
                others.append(end)
        free = dict(zip(self.over, best.x.tolist(), strict=True))
        moments = self.compiled.stationary(speed=self.speed, at=self.at, parameters={**self.fixed, **free})
        states = zip(self.constraints, best.values[1:].tolist(), best.multipliers.tolist(), strict=True)
        message = f"SLSQP, {best.iterations} iterations, first-order conditions to {best.stationarity:.1e}"
        return Optimum(
            minimise=self.goal.text,
            objective=float(best.values[0]),
            parameters=free,
            bounds=self.over,
            bound_multipliers=dict(zip(self.over, best.bounds.tolist(), strict=True)),
            constraints=tuple(ConstraintState(each.text, excess, m) for each, excess, m in states),
            moments=replace(moments, provenance=replace(moments.provenance, engine=f"{moments.provenance.engine}; {message}")),
            stationarity=best.stationarity,
            iterations=best.iterations,
            evaluations=self._count[0],
            others=tuple((float(e.values[0]), dict(zip(self.over, e.x.tolist(), strict=True))) for e in others),
            message=message,
        )
