"""When paths are stepped: nodes in time, and where the leading wheel is and how fast it goes there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, SPEED, SPEED_RATE, TIME, evaluate

__all__ = ["Grid", "Motion", "make_grid"]

_PANELS = 2048  # of the run, for the integral of the speed
_ONE_SIDED = 1e-9  # of a step: how far inside it a coefficient that may jump is taken


class Motion:
    """Distance, speed and its rate as numbers; before t = 0 the speed is that of the start.

    The distance is what the model gives in closed form, or the integral of the speed by Gauss-Legendre panels
    between its breakpoints.
    """

    def __init__(self, system: AugmentedSystem, values: Mapping[sp.Symbol, float], duration: float):
        self._system, self._values = system, dict(values)
        travel = system.model.travel
        self.start = float(evaluate(system.start, values))
        kinks = () if travel is None else travel.breakpoints
        self.breakpoints = _inside([evaluate(b, values) for b in kinks], 0.0, duration)
        self._nodes = np.unique(np.concatenate([np.linspace(0.0, duration, _PANELS + 1), self.breakpoints]))
        self._reached = np.zeros(len(self._nodes))
        if system.distance is None:
            self._reached[1:] = np.cumsum(self._travelled(self._nodes[:-1], self._nodes[1:]))

    def speed(self, time: Any) -> np.ndarray:
        """V(t)."""
        return self._of(self._system.speed, time)

    def rate(self, time: Any) -> np.ndarray:
        """dV/dt; none while the state is run in before t = 0."""
        return np.where(np.asarray(time) < 0.0, 0.0, self._of(self._system.speed_rate, time))

    def distance(self, time: Any) -> np.ndarray:
        """Position of the leading wheel."""
        time = np.asarray(time, dtype=float)
        after = np.maximum(time, 0.0)
        if self._system.distance is not None:
            place = self._of(self._system.distance, after)
        else:
            k = np.clip(np.searchsorted(self._nodes, after, side="right") - 1, 0, len(self._nodes) - 2)
            place = self.start + self._reached[k] + self._travelled(self._nodes[k], after)
        return np.where(time < 0.0, place + self.speed(0.0) * time, place)

    def values(self, time: np.ndarray) -> dict[sp.Symbol, np.ndarray]:
        """Time, distance, speed and its rate by the symbols that stand for them."""
        return {TIME: time, DISTANCE: self.distance(time), SPEED: self.speed(time), SPEED_RATE: self.rate(time)}

    def times_at(self, places: Sequence[float]) -> np.ndarray:
        """When the leading wheel passes places inside the run (bisection; the distance never falls)."""
        first, last = self.distance(self._nodes[[0, -1]])
        wanted = _inside(places, first, last)
        low, high = np.zeros(len(wanted)), np.full(len(wanted), self._nodes[-1])
        for _ in range(80):
            middle = 0.5 * (low + high)
            behind = self.distance(middle) < wanted
            low, high = np.where(behind, middle, low), np.where(behind, high, middle)
        return high

    def check(self, time: np.ndarray) -> None:
        """Refuse a vehicle that goes backwards."""
        speed = self.speed(time)
        if not np.isfinite(speed).all():
            at = time[~np.isfinite(speed)][0]
            raise ModelError(f"the speed has no value at t = {at:g}; mend [travel] or shorten the run")
        if speed.min() < -1e-9 * max(1.0, abs(speed).max()):
            at = time[speed.argmin()]
            raise ModelError(
                f"the speed is negative, {speed.min():g} at t = {at:g}; a vehicle does not go backwards over its "
                "ground: change [travel] or end the run before"
            )

    def _of(self, expression: sp.Expr, time: Any) -> np.ndarray:
        time = np.maximum(np.asarray(time, dtype=float), 0.0)
        return np.broadcast_to(evaluate(expression, {**self._values, TIME: time}), time.shape)

    def _travelled(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Integral of the speed from a to b, no breakpoint between them."""
        nodes, weights = np.polynomial.legendre.leggauss(6)
        middle, half = 0.5 * (a + b), 0.5 * (b - a)
        return half * np.tensordot(self.speed(middle[..., None] + half[..., None] * nodes), weights, 1)


def _inside(places: Any, first: float, last: float) -> np.ndarray:
    found = np.unique(np.asarray(places, dtype=float))
    return found[(found > first) & (found < last)]


@dataclass(frozen=True)
class Grid:
    """Nodes t_0 < ... < t_N; steps end at every output time and at every breakpoint of speed and ground."""

    time: np.ndarray  # (N + 1,) s; negative while the state is run in
    place: np.ndarray  # (N + 1,) position of the leading wheel
    output: np.ndarray  # (times,) int: node of each output
    motion: Motion

    @property
    def step(self) -> np.ndarray:
        """Duration of every step, (N,)."""
        return np.diff(self.time)

    def halved(self) -> Grid:
        """The grid with every step cut in two."""
        time = np.empty(2 * len(self.time) - 1)
        time[::2], time[1::2] = self.time, 0.5 * (self.time[:-1] + self.time[1:])
        return Grid(time, self.motion.distance(time), 2 * self.output, self.motion)

    def run_values(self, end: bool) -> dict[sp.Symbol, np.ndarray]:
        """Time, distance, speed and its rate just inside the start, or the end, of every step."""
        nudge = _ONE_SIDED * self.step
        time = self.time[1:] - nudge if end else self.time[:-1] + nudge
        return self.values_at(time)

    def values_at(self, time: np.ndarray) -> dict[sp.Symbol, np.ndarray]:
        """The run's own symbols at given times; before t = 0 everything stands as at the start but the wheels turn."""
        m = self.motion
        return {
            TIME: np.maximum(time, 0.0),
            DISTANCE: m.distance(np.maximum(time, 0.0)),
            SPEED: m.speed(time),
            SPEED_RATE: m.rate(time),
        }


def make_grid(motion: Motion, output: np.ndarray, step: float, kinks: np.ndarray, run_in: float = 0.0) -> Grid:
    """Divide the time between outputs and breakpoints evenly into steps no longer than `step`.

    Parameters
    ----------
    output : (times,) increasing, s.
    kinks : times, other than the motion's own breakpoints, at which a coefficient has a kink or a jump.
    run_in : time before t = 0 for which the state is run in at the initial speed.
    """
    last = float(output[-1])
    inner = _inside(np.concatenate([motion.breakpoints, kinks]), 0.0, last)
    gap = 1e-9 * max(last, step)
    inner = inner[np.abs(inner[:, None] - output).min(axis=1) > gap] if len(inner) else inner
    fixed = np.unique(np.concatenate([[-run_in, 0.0], output, inner]))
    counts = np.maximum(1, np.ceil(np.diff(fixed) / step - 1e-9)).astype(int)
    parts = (np.linspace(a, b, n + 1)[1:] for a, b, n in zip(fixed[:-1], fixed[1:], counts, strict=True))
    time = np.concatenate([fixed[:1], *parts])
    ends = np.concatenate([[0], np.cumsum(counts)])
    motion.check(np.maximum(time, 0.0))
    return Grid(time, motion.distance(time), ends[np.searchsorted(fixed, output)], motion)
