"""The exported propagator leaves out of its steps what does not move: moments of the ground's own filters."""

from __future__ import annotations

import subprocess
import tracemalloc

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import SHIPPED
from exported import build, sources

import cadet_sym as cs
from cadet_sym.language.modelfile import loads
from cadet_sym.lowering.portable import _settling, portable
from cadet_sym.solve.many import Start
from cadet_sym.solve.transient import integrate

NAMES = [path.stem for path in SHIPPED]

CAR = """
schema = 1
name = "One mass on two tracks"
[parameters]
rough = 0.1
V = 20.0
[rates]
x = "v"
v = "-30*(x - h) - 20*(x - g) - 2*v - v**3"
[contacts]
h = { track = "left" }
g = { track = "right" }
[ground]
kind = "exponential"
sigma = "rough"
cutoff = 0.5
rolling_contact = 4.0
[travel]
speed = "V"
[run]
duration = 4.0
points = 2
"""

PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#include "car.h"
int main(int count, char **words)
{
    if (count != 5)
        return 3;
    static car_run run;
    static car_stiff stiff;
    car_real p[CAR_PARAMETERS], y[CAR_SIZE];
    for (int i = 0; i < CAR_PARAMETERS; i++)
        p[i] = car_default_parameters[i];
    car_initial(p, y);
    y[CAR_STATES + CAR_STATES * (CAR_STATES + 1) / 2 - 1] *= atof(words[1]);
    car_begin(&run, 0, y);
    run.rtol = atof(words[4]);
    run.stiff = atoi(words[3]) ? &stiff : 0;
    if (car_propagate(&run, p, 2) != CAR_OK)
        return 1;
    const long steps = run.steps;
    p[CAR_PARAMETER_rough] *= atof(words[2]);
    if (car_propagate(&run, p, 4) != CAR_OK)
        return 2;
    printf("%ld\n", steps);
    for (int i = 0; i < CAR_SIZE; i++)
        printf("%.17g\n", run.y[i]);
    return 0;
}
"""


@pytest.mark.parametrize("name", NAMES)
def test_only_the_distance_moves_what_may_settle(name, shipped):
    compiled = shipped(name)
    functions, packing = portable(compiled.functions), compiled.equations.packing
    places = [each.place for each in functions.settling]
    if packing.ground or compiled.model.ground is None:
        assert not places
        return
    for each in functions.settling:
        assert each.place == each.row or packing.triangle[0][each.place - packing.n] == each.row
    rng, p = np.random.default_rng(1), compiled.parameter_vector()

    def rates(t, s, V, y):
        return np.asarray(functions.held(t, s, V, y, p)).ravel()[places]

    y = np.abs(rng.normal(size=packing.size))
    other = np.abs(rng.normal(size=packing.size))
    other[places] = y[places]
    once = rates(1.0, 2.0, 1.0, y)
    np.testing.assert_allclose(rates(0.3, -5.0, 7.0, other), 7.0 * once, rtol=1e-12, atol=1e-14)
    if compiled.model.initial.ground == "smooth":
        return
    start = rates(0.0, 0.0, 1.0, compiled.initial())
    assert np.abs(start).max(initial=0.0) <= 1e-13 * max(np.abs(once).max(initial=0.0), 1.0)


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    compiled = cs.compile(loads(CAR))
    folder = compiled.export_c(tmp_path_factory.mktemp("car") / "c", prefix="car")
    program = tmp_path_factory.mktemp("car") / "check.c"
    program.write_text(PROGRAM)
    return compiled, build(folder, program.with_suffix(""), [*sources(folder), program])


def run(program, start: float, change: float, stiff: int, rtol: float) -> tuple[int, np.ndarray]:
    """Steps of the first half, moments at the end."""
    command = [program, str(start), str(change), str(stiff), str(rtol)]
    numbers = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split()
    return int(numbers[0]), np.array(numbers[1:], dtype=float)


@pytest.mark.parametrize("stiff", [0, 1])
@pytest.mark.parametrize(("start", "change"), [(1.0, 1.0), (1.0, 2.0), (1.5, 1.0)])
def test_what_no_longer_stands_still_moves_again(start, change, stiff, car):
    """A run whose ground becomes rougher on the way, or starts away from its own stationary moments, is Python's."""
    compiled, program = car
    _, found = run(program, start, change, stiff, 1e-9)
    y, moments = compiled.initial(), compiled.equations.packing.moments
    y[moments - 1] *= start
    for parameters in ({}, {"rough": 0.1 * change}):
        y = integrate(compiled.functions, Start(y, compiled.parameter_vector(parameters)), np.array([2.0]), rtol=1e-10).y[-1]
    np.testing.assert_allclose(found, y, rtol=1e-6, atol=1e-7 * np.abs(y).max())


def test_settled_ground_sets_no_limit_to_the_step(car):
    # once the vehicle has settled, too, half the filter's fastest rate is left, that of covariances with the vehicle
    settled, _ = run(car[1], 1.0, 1.0, 0, 1e-3)
    moving, _ = run(car[1], 1.0 + 1e-9, 1.0, 0, 1e-3)
    assert settled < 0.8 * moving

def test_what_settles_is_found_without_a_matrix_of_all_moments():
    """That of 200 states took 20 GB."""
    n = 40
    x, w = sp.symbols(f"x1:{n + 1}"), sp.Symbol("w")
    rates = {x[i]: -x[i] + (x[i - 1] / 3 if i else w) for i in range(n)}
    model = cs.Model(cs.Vehicle(rates=rates), noise=cs.Noise(names=("w",), intensity=sp.eye(1)))
    lowered = cs.compile(model).functions.symbolic
    size = lowered.equations.packing.size
    t, s, V, y, p = (ca.SX.sym("a", k) for k in (1, 1, 1, size, len(lowered.parameters)))
    held = lowered.held_rate(t, s, V, y, p)
    tracemalloc.start()
    _settling(lowered, held, y, ca.vertcat(t, s))
    assert tracemalloc.get_traced_memory()[1] < size**2
    tracemalloc.stop()
