"""Everything numeric that a run of paths needs, worked out once and shared by all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import TIME, evaluate
from cadet_sym.simulation.grid import Grid, Motion, make_grid
from cadet_sym.simulation.ground import ground_tables, within_tables
from cadet_sym.simulation.kicks import separate_kicks
from cadet_sym.simulation.laws import covariance_factor
from cadet_sym.simulation.numbers import matrices, numeric
from cadet_sym.simulation.program import Program, write_program
from cadet_sym.simulation.rates import Rates, choose_scheme
from cadet_sym.simulation.riders import TwinRider
from cadet_sym.simulation.rules import Exponential, Linear, Numbers, split_linear
from cadet_sym.simulation.step import Rider
from cadet_sym.simulation.tables import GroundTables, OutputTables, StartTables, StepTables
from cadet_sym.simulation.twin import Twin

__all__ = ["Plan", "Problem"]

_SLACK = 1e-10  # of the largest entry: how far below zero rounding may put an eigenvalue of a covariance


@dataclass(frozen=True)
class Plan:
    """One grid's worth of tables: all that a group of paths is computed from, and all that travels to a worker."""

    numba_source: str
    numpy_source: str
    ground: GroundTables
    start: StartTables
    fine: StepTables
    coarse: StepTables  # twice the step of `fine`; no rows unless pairs of paths are wanted
    out: OutputTables
    purposes: int  # random streams a path

    @property
    def paired(self) -> bool:
        """Whether paths are computed with both steps."""
        return len(self.coarse.H) > 0


class Problem:
    """An augmented system with its parameters as numbers, ready to be put on a grid.

    Parameters
    ----------
    times : (k,) output times, increasing from 0 or later.
    riders : what is carried along with every path.
    twin : the quasi-linear system along the run, if it is to be carried along, after the other riders.
    inputs : linear forms in the states that have moments as well, after the outputs.
    scheme : "heun" or "exponential" (see `rules`); chosen by the rates of the problem if not given.
    """

    def __init__(
        self,
        system: AugmentedSystem,
        times: np.ndarray,
        riders: Sequence[Rider] = (),
        twin: Twin | None = None,
        inputs: Sequence[sp.Expr] = (),
        scheme: str | None = None,
    ):
        self.asked = len(system.states) + len(system.outputs)  # quantities whose moments were asked for
        hidden = {f"input {k}": form for k, form in enumerate(inputs)}  # no name of a model holds a space
        system = replace(system, outputs={**system.outputs, **hidden})
        self.system, self.times, self.twin = system, times, twin
        self.twin_rider = None if twin is None else TwinRider(system)
        self.riders: list[Rider] = [*riders, *([] if self.twin_rider is None else [self.twin_rider])]
        self.values: dict[sp.Symbol, float] = {
            sp.Symbol(name, real=True): float(value) for name, value in system.model.parameter_values().items()
        }
        self.elements = system.model.vehicle.elements
        self.motion = Motion(system, self.values, float(times[-1]))
        self.rates = Rates(system, self.values, self.motion, float(times[-1]))
        separated = separate_kicks(system)
        if scheme is None:  # crossings are looked for at every step: with them steps stay short beside the vehicle's swing
            scheme = "heun" if riders else choose_scheme(self.rates, separated)
        linear = split_linear(separated.drift, system.states) if scheme == "exponential" else None
        self.program: Program = write_program(system, separated, linear, self.riders)
        self.scheme, self.first_step = self.program.rule.name, self.rates.first_step(linear, separated)
        self.names = [s.name for s in system.states] + list(system.outputs)
        self._check_tracks()

    def plan(self, step: float, run_in: float = 0.0, paired: bool = False) -> tuple[Plan, Grid]:
        """Tables for steps no longer than `step`; with `paired`, of that grid and of the one with halved steps."""
        grid = make_grid(self.motion, self.times, step, self._kinks(), run_in)
        finest = grid.halved() if paired else grid
        program, numbers = self.program, self._numbers(finest)
        ground, roots = ground_tables(self.system, self.values, finest, program.ground_rows, program.rule.noises)
        if isinstance(program.rule, Exponential) and program.rule.noises:
            mix, mix_of = program.rule.noise_laws(numbers)
            ground = ground._replace(mix=mix, mix_of=mix_of)
        fine = self._steps(finest, numbers)
        plan = Plan(
            program.numba_source,
            program.numpy_source,
            ground,
            self._start(roots),
            fine,
            self._coarse(grid, numbers)
            if paired
            else StepTables(fine.S[:0], fine.E[:0], fine.K[:0], fine.H[:0], fine.q, fine.T),
            self._outputs(finest),
            purposes=2 + len({c.track for c in self.system.copies}),
        )
        return plan, grid

    @property
    def quantities(self) -> int:
        """States, outputs and inputs: the first rows of the records; riders follow."""
        return len(self.names)

    def first_row(self, rider: Rider | None) -> int:
        """First of a rider's rows in the records."""
        row = self.quantities
        for other in self.riders:
            if other is rider:
                break
            row += len(other.copied)
        return row

    def run_values(self, time: np.ndarray) -> dict[sp.Symbol, np.ndarray]:
        """Time, distance, speed and its rate."""
        return self.motion.values(time)

    def _kinks(self) -> np.ndarray:
        """When a wheel passes a kink or an edge of the ground."""
        ground = self.system.model.ground
        if ground is None or not self.system.copies:
            return np.zeros(0)
        edges = [evaluate(b, self.values) for b in ground.breakpoints]
        setbacks = {float(evaluate(c.setback, self.values)) for c in self.system.copies}
        return self.motion.times_at([e + L for e in edges for L in setbacks])

    def _steps(self, grid: Grid, numbers: Numbers) -> StepTables:
        program = self.program
        runs = [grid.run_values(end) for end in (False, True)]
        ends = [self._at(program.coefficients, {**run, **self._gains(run[TIME])}) for run in runs]
        within = within_tables(self.system, self.values, grid, program.ground_rows)
        return StepTables(
            S=np.ascontiguousarray(ends[0]),
            E=np.ascontiguousarray(ends[1]),
            K=np.column_stack([program.rule.table(numbers), within]),
            H=np.ascontiguousarray(grid.step),
            q=numeric(program.constants, self.values, self.elements),
            T=program.table,
        )

    def _coarse(self, grid: Grid, fine: Numbers) -> StepTables:
        """Of the steps that are two of the finer grid's."""
        steps, rule = self._steps(grid, self._numbers(grid)), self.program.rule
        if isinstance(rule, Exponential):
            rule.carry_on(steps.K, fine.A[1::2], fine.H[1::2])
        return steps

    def _numbers(self, grid: Grid) -> Numbers:
        """What the rule's tables are made of."""
        program = self.program
        runs = [grid.run_values(end) for end in (False, True)]
        kicks = [self._at([kick.kappa for kick in program.kicks], run) for run in runs]
        noises = [self._noise(run) for run in runs]
        linear = program.rule.linear if isinstance(program.rule, Exponential) else Linear({}, {}, ())
        middle = grid.values_at(0.5 * (grid.time[1:] + grid.time[:-1]))
        nv, nf, n = self.system.vehicle_size, len(program.places), len(grid.step)
        at = [{**self.values, **run} for run in (*runs, middle)]
        M = tuple(matrices(linear.ground, (nv, nf), known, self.elements, n) for known in at[:2])
        A = matrices(linear.vehicle, (nv, nv), at[2], self.elements, n)
        return Numbers(grid.step, (kicks[0], kicks[1]), 0.5 * (noises[0] + noises[1]), A, (M[0], M[1]))

    def _gains(self, time: np.ndarray) -> dict[sp.Symbol, np.ndarray]:
        """Gains of the twin at given times, by the symbols that stand for them."""
        if self.twin is None or self.twin_rider is None:
            return {}
        N, g = self.twin.linearised(time)
        return {s: g[:, a] if b < 0 else N[:, a, b] for (a, b), s in self.twin_rider.entries.items()}

    def _at(self, expressions: Any, run: Mapping[sp.Symbol, np.ndarray]) -> np.ndarray:
        return numeric(expressions, {**self.values, **run}, self.elements)

    def _noise(self, run: Mapping[sp.Symbol, np.ndarray]) -> np.ndarray:
        """What independent unit noises in time do to the vehicle, (times, nv, those that reach it)."""
        system = self.system
        time = [j for j, source in enumerate(system.sources) if source.domain == "time"]
        shape = (len(run[TIME]), system.vehicle_size, len(time))
        Q = self._at(list(system.intensity.extract(time, time)) if time else [], run)
        root = _factor(Q.reshape(shape[0], len(time), len(time)), "[noise] intensity")
        entering = self._at([system.noise_input[i, j] for i in range(shape[1]) for j in time], run).reshape(shape)
        return (entering @ root)[:, :, [time.index(j) for j in self.program.time_noises]]

    def _start(self, ground: tuple[np.ndarray, ...] = ()) -> StartTables:
        system, nv = self.system, self.system.vehicle_size
        run = self.run_values(np.zeros(1))
        known = {**self.values, **{symbol: float(value[0]) for symbol, value in run.items()}}
        spread = numeric(list(system.initial_covariance), known, self.elements).reshape(1, nv, nv)
        linear = numeric(list(system.initial_map), known, self.elements).reshape(nv, -1)
        starts = np.array(self.program.starts, dtype=np.int64)
        places = self.program.places
        spread_out = np.zeros((len(starts), max(places, default=-1) + 1))
        spread_out[:, list(places)] = np.where(starts[:, None] >= 0, linear[starts], 0.0)
        return StartTables(
            offset=numeric(list(system.initial_offset), known, self.elements),
            map=spread_out,
            root=_factor(spread, "[initial.covariance]")[0],
            rows=starts,
            ground=ground,
        )

    def _outputs(self, grid: Grid) -> OutputTables:
        program = self.program
        run = self.run_values(grid.time[grid.output])
        return OutputTables(
            node=grid.output.astype(np.int64),
            rows=len(self.names) + len(program.starts) - self.system.vehicle_size,
            C=np.ascontiguousarray(self._at(program.record_coefficients, run)),
            q=numeric(program.record_constants, self.values, self.elements),
            T=program.record_table,
        )

    def _check_tracks(self) -> None:
        """Tracks are simulated independently of each other: refuse an intensity that says otherwise."""
        system = self.system
        owner = {j: (c.track, c.contact) for c in system.copies for j in c.columns}
        for i in range(len(system.sources)):
            for j in range(i):
                if owner.get(i) != owner.get(j) and system.intensity[i, j] != 0:
                    raise ModelError(
                        f"the noises `{system.sources[j].name}` and `{system.sources[i].name}` are correlated; the "
                        "simulation takes tracks, and noise in time and the ground, as independent of each other"
                    )


def _factor(sigma: np.ndarray, what: str) -> np.ndarray:
    """Lower triangular factors of (k, n, n) covariances, refused where one is not positive semidefinite."""
    if sigma.shape[-1] == 0:
        return sigma
    scale = np.abs(sigma).max(axis=(-1, -2))
    lowest = np.linalg.eigvalsh(sigma)[:, 0] if np.isfinite(sigma).all() else np.array([np.nan])
    if not (lowest >= -_SLACK * np.maximum(scale, 1e-300)).all():
        raise ModelError(
            f"{what} is not positive semidefinite: its smallest eigenvalue is {np.min(lowest):.3g}; "
            "lower the covariances off the diagonal or raise the variances"
        )
    return covariance_factor(sigma)
