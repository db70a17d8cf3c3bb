"""How fast things go: what a time step is first chosen from, and whether linear terms are worth taking exactly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.language.expression import SPEED
from cadet_sym.simulation.grid import Motion
from cadet_sym.simulation.kicks import Separated
from cadet_sym.simulation.numbers import matrices, numeric
from cadet_sym.simulation.rules import Linear, closure, split_linear

__all__ = ["SHORTEST", "Rates", "choose_scheme"]

_VEHICLE, _GROUND = 0.05, 0.5  # first choice: step times the fastest rate of each
_SLOW, _NOTHING = 0.1, 1e-6  # step times the slowest linear rate; of the fastest: what is no rate
_LEAST = 64  # steps of a run
SHORTEST = 1e-7  # of the run
_STIFF = 8.0  # times longer steps, for which the linear terms are taken exactly


class Rates:
    """Rates, 1/s, of a vehicle and its ground along a run."""

    def __init__(self, system: AugmentedSystem, values: Mapping[sp.Symbol, Any], motion: Motion, duration: float):
        self.system, self.values, self.motion, self.duration = system, values, motion, duration
        self.elements = system.model.vehicle.elements

    def vehicle(self, linear: Linear | None = None) -> float:
        """Largest rate of the vehicle's equations about the start; with `linear`, of what these terms leave.

        From differences of three sizes, of which the one that asks for the least is taken: a friction's jump is
        no rate, and a stop that is far away none either. The step's error, measured, has the last word.
        """
        return min(self._scales(linear), default=0.0)

    def fastest(self) -> float:
        """The same where the most is asked for: what none of the vehicle's paths is likely to exceed but at a jump."""
        return max(self._scales(), default=0.0)

    def _scales(self, linear: Linear | None = None) -> list[float]:
        """Largest rates (1/s) by differences of each size."""
        run = np.array([0.0, 0.5 * self.duration, self.duration])
        return [float(np.abs(modes).max()) for modes in self._modes(run, linear)]

    def linear(self, linear: Linear, begin: Iterable[int] | None = None) -> float:
        """Largest rate of the vehicle's linear terms alone; of the states that are reached from some of them, if given."""
        return float(np.abs(self._linear_modes(linear, begin)).max(initial=0.0))

    def slowest(self, linear: Linear) -> float:
        """Least rate of the vehicle's linear terms that is not nothing; 0 if there is none."""
        rates = np.abs(self._linear_modes(linear))
        return float(min(rates[rates > _NOTHING * rates.max(initial=0.0)], default=0.0))

    def _linear_modes(self, linear: Linear, begin: Iterable[int] | None = None) -> np.ndarray:
        nv, run = self.system.vehicle_size, np.array([0.0, 0.5 * self.duration, self.duration])
        reach = closure(nv, linear.vehicle)[:, list(range(nv) if begin is None else begin)]
        reached = np.flatnonzero(reach.any(axis=1))
        A = self._linear(linear, run)[:, reached][:, :, reached]
        return np.linalg.eigvals(A)

    def _roughly_kicked(self, separated: Separated) -> set[int]:
        """States that are kicked by what white noise drives."""
        system, rough = self.system, set()
        for copy in system.copies:
            D = copy.filter.D
            rough |= {s for i, s in enumerate(system.states[copy.states]) if not D.row(i).is_zero_matrix}
        return {k.state for k in separated.kicks if separated.heights[k.height].free_symbols & rough}

    def ground(self) -> float:
        """Largest rate at which the ground comes by: its filters' fastest mode at the highest speed."""
        run = self.motion.values(np.linspace(0.0, self.duration, 501))
        fastest = 0.0
        for C in {copy.filter.C for copy in self.system.copies}:
            matrices = numeric(list(C), {**self.values, **run}, self.elements).reshape(-1, *C.shape)
            modes = np.abs(np.linalg.eigvals(matrices)).max(axis=-1)
            fastest = max(fastest, float((modes * run[SPEED]).max()))
        return fastest

    def relaxation_time(self, constants: float) -> float:
        """Time in which the slowest mode that decays at the start falls by exp(-constants)."""
        modes = np.concatenate([m.ravel() for m in self._modes(np.zeros(1))] or [np.zeros(0)])
        decay = -modes.real[-modes.real > 1e-6 * np.abs(modes).max(initial=0.0)]
        return constants / float(decay.min()) if len(decay) else self.duration

    def first_step(self, linear: Linear | None, separated: Separated) -> float:
        """Step from the fastest rates: h = min(0.05 / vehicle's, 0.5 / ground's, a sixty-fourth of the run).

        Linear terms that are taken exactly ask for 0.1 / the slowest of them, the others having to do with the nonlinear
        ones as well; and for 1 / the fastest of those that a rough ground kicks: its parabola holds back what is rougher.
        """
        rates = [(_VEHICLE, self.vehicle(linear)), (_GROUND, self.ground())]
        if linear is not None:
            rates += [(_SLOW, self.slowest(linear)), (1.0, self.linear(linear, self._roughly_kicked(separated)))]
        limits = [self.duration / _LEAST, *(part / rate for part, rate in rates if rate > 0.0)]
        return max(min(limits), 10.0 * SHORTEST * self.duration)

    def _modes(self, time: np.ndarray, linear: Linear | None = None) -> list[np.ndarray]:
        """Eigenvalues (times, nv) of the vehicle's rates about its initial mean, from differences of several sizes."""
        system, nv, found = self.system, self.system.vehicle_size, []
        run = self.motion.values(time)
        begin = {**self.values, **self.motion.values(np.zeros(1))}
        offset = numeric(list(system.initial_offset), begin, self.elements)[0]
        for size in (1e-3, 1e-1, 1e1):
            at = np.zeros((len(system.states), 2 * nv, len(time)))
            at[:nv] = offset[:, None, None]
            for k in range(nv):
                at[k, 2 * k] += size
                at[k, 2 * k + 1] -= size
            known = {**self.values, **dict(zip(system.states, at, strict=True)), **run}
            rates = numeric(system.drift[:nv], known, self.elements)
            jacobian = np.moveaxis((rates[0::2] - rates[1::2]) / (2.0 * size), 0, -1)
            if linear is not None:
                jacobian = jacobian - self._linear(linear, time)
            if np.isfinite(jacobian).all():
                found.append(np.linalg.eigvals(jacobian))
        return found

    def _linear(self, linear: Linear, time: np.ndarray) -> np.ndarray:
        """A at given times, (times, nv, nv)."""
        known, nv = {**self.values, **self.motion.values(time)}, self.system.vehicle_size
        return matrices(linear.vehicle, (nv, nv), known, self.elements, len(time))


def choose_scheme(rates: Rates, separated: Separated) -> str:
    """The exponential rule where the fastest of the vehicle's linear terms alone would keep steps short."""
    linear = split_linear(separated.drift, rates.system.states)
    fastest = rates.linear(linear)
    if fastest == 0.0 or not np.isfinite(fastest):
        return "heun"
    return "exponential" if rates.first_step(linear, separated) > _STIFF * _VEHICLE / fastest else "heun"
