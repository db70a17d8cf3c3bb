"""Wheels that follow each other on one track: what their exact delay costs, and how the grids between them converge.

    python benchmarks/wheels.py [--repeat 15] [--rtol 1e-6 1e-8]

The half car of models/half_car.toml, its wheels on one track, over the same car with its wheels on tracks of their own (no
delay at all): processor time of a run of 5 s, medians of runs one after the other, at constant speed, braking and
accelerating from rest. Then the error of the stationary covariances on each grid against the exact answer (which knows no
grid), over the states' standard deviations, and the grid that is chosen where none is named.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import cadet_sym as cs
from cadet_sym.delay import CHOICES
from cadet_sym.language.modelfile import loads

HALF_CAR = (Path(__file__).resolve().parent.parent / "models" / "half_car.toml").read_text()
TRAVEL = {"20 m/s": "V", "braking 20 to 4 m/s": "20*(1 - 0.16*t)", "from rest, 4 m/s^2": "4*t"}
COARSE, FINE = (4, 6), (6, 8)


def half_car(speed: str, *, one_track: bool = True, start: str = "") -> cs.Model:
    text = HALF_CAR.replace('speed = "V"', f'speed = "{speed}"')
    if not one_track:
        text = text.replace('setback = "L", track = "main"', 'setback = "L", track = "other"')
    return loads(text.replace('ground = "stationary"', start) if start else text)


def cost(console: Console, tolerances: list[float], repeat: int) -> None:
    table = Table("travel", "rtol", "wheels", "values", "steps", "ms", "10 - 90 %", "ratio", title="Cost of the exact delay")
    times = np.linspace(0.0, 5.0, 11)
    for name, speed in TRAVEL.items():
        cars = {"two tracks": cs.compile(half_car(speed, one_track=False))}
        for grid in (COARSE, FINE):
            cars[f"one track, {grid[0]} x {grid[1]}"] = cs.compile(half_car(speed), grid=grid)
        cars["one track, chosen"] = cs.compile(half_car(speed))
        for rtol in tolerances:
            seconds: dict[str, list[float]] = {car: [] for car in cars}
            steps = {car: compiled.propagate(times, rtol=rtol).provenance.statistics["steps"] for car, compiled in cars.items()}
            for _ in range(repeat):
                for car, compiled in cars.items():
                    began = time.process_time()
                    compiled.propagate(times, rtol=rtol)
                    seconds[car].append(1e3 * (time.process_time() - began))
            base = float(np.median(seconds["two tracks"]))
            for car, found in seconds.items():
                spread = f"{np.percentile(found, 10):.2f} - {np.percentile(found, 90):.2f}"
                size, middle = cars[car].packing.size, float(np.median(found))
                row = (name, f"{rtol:g}", car, str(size), f"{steps[car]:.0f}", f"{middle:.2f}", spread, f"{middle / base:.2f}")
                table.add_row(*row)
    console.print(table)


def grid_error(speed: float, grid: tuple[int, int] | None) -> tuple[float, tuple[int, int]]:
    """Error of the stationary covariances on a grid, and which it was: the end of a run that starts at the exact ones."""
    compiled = cs.compile(half_car(str(speed), start='whole = "stationary"'), grid=grid)
    exact = compiled.stationary(speed=speed).covariance.values
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a coarse grid is what is looked at
        found = compiled.propagate([4.0], rtol=1e-11).state_covariance[-1]
    size = np.sqrt(np.diag(exact))
    delay = compiled.functions.facts.delay
    assert delay is not None
    gap = delay.tracks[0].gaps[0]
    return float((np.abs(found - exact) / np.outer(size, size)).max()), (gap.elements, gap.modes)


def convergence(console: Console) -> None:
    table = Table("speed, m/s", *(f"{a} x {b}" for a, b in CHOICES), "chosen", title="Error of the grids, stationary")
    for speed in (2.0, 5.0, 10.0, 20.0, 40.0):
        errors = [f"{grid_error(speed, grid)[0]:.0e}" for grid in CHOICES]
        error, chosen = grid_error(speed, None)
        table.add_row(f"{speed:g}", *errors, f"{chosen[0]} x {chosen[1]}: {error:.0e}")
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description="Cost and convergence of the exact delay between wheels")
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--rtol", type=float, nargs="*", default=[1e-6, 1e-8])
    arguments = parser.parse_args()
    console = Console(width=120)
    convergence(console)
    cost(console, arguments.rtol, arguments.repeat)


if __name__ == "__main__":
    main()
