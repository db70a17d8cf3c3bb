"""Procedures as machine code do what they do as Python; steps by Runge-Kutta formulas, and what may stay as it is."""

from __future__ import annotations

import ctypes
import dataclasses
import math
from math import sqrt

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT
from reference_models import toml

import cadet_sym as cs
from cadet_sym.delay import transport_matrix
from cadet_sym.lowering.blas import multiplication
from cadet_sym.lowering.kernel import Vector, kernel, kernel_text, part
from cadet_sym.packing import Packing
from cadet_sym.solve import backward, improved, native, runge_kutta
from cadet_sym.solve import stiff as stiff_runs
from cadet_sym.solve.breakdown import Breakdown
from cadet_sym.solve.implicit import Inverse, PackedIndex, scaled_form
from cadet_sym.solve.native import FEW, MANY, Native, _march_all, _rest
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.stiff import Stiff, modal_arrays
from cadet_sym.solve.tableaux import DORMAND_PRINCE, RANOCHA_3, RANOCHA_5, Pair

TABLE = (0.5, 2.0, -1.0)
SCALE = 3.0


def helper(x: Vector, n: int) -> float:
    """Sum of squares of what is not negative."""
    total = 0.0
    for i in range(n):
        if x[i] < 0.0:
            continue
        total += x[i] * x[i]
    return total


def everything(x: Vector, n: int, a: float, out: Vector) -> int:
    """A bit of all that is understood."""
    second = part(x, 1)
    out[0] = sqrt(helper(x, n)) * SCALE - second[0]
    k = 0
    while True:
        k += 1
        if (k > 3 and k < n) or k >= 10:
            break
    out[1] = float(k) / 4 + k % 3 + k // 2
    out[2] = min(a, x[0]) + max(a, 1.5) ** 2.0 + abs(-a)
    out[3] = 1.0 if 0.0 <= a <= 1.0 and not a > 0.9 else -TABLE[n - 4]
    out[4] = float(min(k, n) - max(k, 2))
    j = int(a * 10.0)
    for i in range(1, n):
        j += i
        if j > 12:
            return j
    return -j


@pytest.mark.parametrize("a", [-2.0, 0.0, 0.5, 0.7, 1.3])
@pytest.mark.parametrize("n", [4, 5, 6])
def test_a_procedure_does_what_it_does_as_python(a, n):
    x = np.array([0.3, -1.0, 2.0, 0.1, -0.2, 0.9])
    as_python, as_code = np.zeros(5), np.zeros(5)
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    code = kernel(helper, everything).function("everything", vector, integer, number, vector, returns=integer)
    expected = everything(x, n, a, as_python)
    assert code(x.ctypes.data, n, a, as_code.ctypes.data) == expected
    np.testing.assert_array_equal(as_code, as_python)


def stranger(x: Vector) -> int:
    """Steps outside."""
    return sum([x[0], 1.0])


def changeling(n: int) -> int:
    """Changes a type."""
    for k in range(n):
        n = k + 0.5
    return n


@pytest.mark.parametrize("procedure", [stranger, changeling])
def test_what_is_not_understood_is_refused(procedure):
    with pytest.raises(SyntaxError, match="is not understood"):
        kernel_text(procedure)


PAIRS = {
    "one": (DORMAND_PRINCE,),
    "another": (RANOCHA_5,),
    "all": (RANOCHA_3, DORMAND_PRINCE, RANOCHA_5),
}


@pytest.mark.parametrize("lanes", [FEW, MANY])
@pytest.mark.parametrize("pairs", PAIRS)
def test_steps_as_machine_code_are_those_of_python(shipped, monkeypatch, pairs, lanes):
    """Two runs, one with an edge between the output times; what is not integrated stays."""
    monkeypatch.setattr(runge_kutta, "LANES", lanes)
    compiled = shipped("oleo_acceleration")
    functions, p = compiled.functions, compiled.parameter_vector()
    entries, grid = len(compiled.initial()), np.array([0.0, 0.5, 1.0])
    n, whole = -(-entries // lanes) * lanes, entries + 1
    tables = np.array([pair.packed for pair in PAIRS[pairs]])
    y, places = np.insert(compiled.initial(), 2, 7.0), np.append(np.delete(np.arange(whole), 2), 2).astype(float)
    travel = np.array([1.0, 0.0, 1.0, 1.0, 2.0, 0.0, 0.7, 0.7, 0.7, 1.0, 1.0])

    def rate(clock, state, values, slope):
        slope[:entries] = np.array(functions.rate(clock[0], state[:entries], values[: len(p)])).ravel()

    def run(how):
        vectors = {
            "y": np.array([y, y]), "p": np.array([p, p]), "size": np.ones(whole), "found": np.zeros((2, 3, whole)),
            "work": np.zeros((runge_kutta.WORK + 1) * n + runge_kutta.HEAD + len(p) + whole),
            "reports": np.zeros(2 * runge_kutta.REPORT),
        }  # fmt: skip
        own = {name: each.ravel() for name, each in vectors.items()}
        given = (
            2, grid, 3, own["y"], whole, places, entries, n, own["p"], len(p), own["size"], 0, 1e-7, 1e-2, travel, 1000,
            tables.ravel(), len(tables), own["work"], own["found"], own["reports"],
        )  # fmt: skip
        if how == "python":
            runge_kutta.march_all(rate, *given)
        else:
            code = functions.machine("rate").addresses["rate"]
            _march_all(lanes)(code, *(each.ctypes.data if isinstance(each, np.ndarray) else each for each in given))
        return vectors

    python, code = run("python"), run("code")
    for name in ("found", "y", "reports"):
        np.testing.assert_array_equal(python[name], code[name])
    np.testing.assert_array_equal(code["found"][:, 0], code["found"][0, :1].repeat(2, axis=0))
    np.testing.assert_array_equal(code["found"][:, :, 2], 7.0)
    np.testing.assert_array_equal(code["found"][:, -1], code["y"])
    np.testing.assert_allclose(code["found"][0], code["found"][1], rtol=1e-3, atol=1e-6)
    assert (code["found"][0, 2] != code["found"][1, 2]).any()
    assert code["reports"].reshape(2, -1)[:, 4:].tolist() == [[3.0, 0.0], [3.0, 0.0]]


@pytest.mark.parametrize(("pair", "order"), [(DORMAND_PRINCE, 8), (RANOCHA_5, 5), (RANOCHA_3, 3)])
def test_a_pair_is_of_its_order(pair, order):
    """Every sum over a path or over a comb of stages is what the exact solution has: those of the trees of either kind."""
    stages = len(pair.stages)
    A = np.array([np.pad(row, (0, stages + 1 - len(row))) for row in ((), *pair.stages)])
    b, c = A[-1], A.sum(axis=1)
    powers, paths = np.ones(stages + 1), np.ones(stages + 1)
    for k in range(1, order + 1):
        assert b @ powers == pytest.approx(1 / k, rel=1e-12)
        assert b @ paths == pytest.approx(1 / math.factorial(k), rel=1e-12)
        powers, paths = powers * c, A @ paths
    for row in pair.errors:  # of a lower order, but of one: without it an error that grows with h^0 would be taken for none
        assert sum(row) == pytest.approx(0, abs=1e-14)
    assert c[stages] == pytest.approx(1, abs=1e-14)
    assert ((c > -1e-14) & (c < 1 + 1e-14)).all()  # no stage outside the step: there the inputs may be others


def rates_of(pairs: tuple[Pair, ...], rtol: float) -> tuple[int, float]:
    """Rates that a signal's way through six elements takes, and its error at the end: it enters, and stays."""
    T, e = transport_matrix(8)
    chain = np.kron(np.eye(6), -T)
    for k in range(1, 6):
        chain[8 * k : 8 * k + 8, 8 * k - 1] = -e
    inflow = np.zeros(48)
    inflow[:8] = -e
    functions = ctypes.CFUNCTYPE(None, *[ctypes.POINTER(ctypes.c_double)] * 4)

    @functions
    def rate(clock, y, p, slope):
        signal = 1 + 0.3 * math.sin(clock[0]) * math.exp(-clock[0])
        np.ctypeslib.as_array(slope, (48,))[:] = chain @ np.ctypeslib.as_array(y, (48,)) + signal * inflow

    tables, travel = np.array([pair.packed for pair in pairs]), np.array([1.0, 0.0, 60.0, 60.0])
    places, p, size, y, found = np.arange(48.0), np.zeros(1), np.ones(48), np.zeros(48), np.zeros(48)
    report, work = np.zeros(runge_kutta.REPORT), np.zeros((runge_kutta.WORK + 2) * 48 + runge_kutta.HEAD + 1)
    _march_all(MANY)(
        ctypes.cast(rate, ctypes.c_void_p).value, 1, travel[2:].ctypes.data, 1, y.ctypes.data, 48, places.ctypes.data, 48, 48,
        p.ctypes.data, 1, size.ctypes.data, 0, rtol, 1e-2, travel.ctypes.data, 100_000, tables.ctypes.data, len(tables),
        work.ctypes.data, found.ctypes.data, report.ctypes.data,
    )  # fmt: skip
    assert report[5] == 0
    return int(report[3]), abs(found[-1] - 1.0)


@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_the_pair_that_comes_further_carries_the_run(rtol):
    alone = {pair.name: rates_of((pair,), rtol) for pair in (DORMAND_PRINCE, RANOCHA_5, RANOCHA_3)}
    rates, error = rates_of((DORMAND_PRINCE, RANOCHA_5, RANOCHA_3), rtol)
    assert rates < min(each for each, _ in alone.values())  # each has its part of the way
    assert rates < 0.85 * alone[DORMAND_PRINCE.name][0]
    assert max(error, *(each for _, each in alone.values())) < rtol


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_errors_stay_within_the_tolerance(shipped, rtol):
    compiled = shipped("oleo_acceleration")
    reference = compiled.propagate(points=11, rtol=1e-12)
    history = compiled.propagate(points=11, rtol=rtol)
    size = np.sqrt(reference.variance.values.max(axis=0))
    assert history.provenance.engine == Native.name
    assert (np.abs(history.state_covariance - reference.state_covariance) / np.outer(size, size)).max() < rtol


def test_errors_stay_within_the_tolerance_where_pairs_compete(shipped):
    compiled, times = shipped("half_car"), np.linspace(0.0, 5.0, 26)
    reference = compiled.propagate(times, rtol=1e-11).state_covariance
    size = np.sqrt(np.diagonal(reference, axis1=1, axis2=2).max(axis=0))
    for rtol in (1e-4, 1e-5, 1e-7, 1e-8):
        history = compiled.propagate(times, rtol=rtol)
        assert history.provenance.engine.startswith("Runge-Kutta 8(5,3), 5(4), 3(2)")
        assert (np.abs(history.state_covariance - reference) / np.outer(size, size)).max() < rtol


def still_count(compiled: cs.CompiledModel) -> int:
    """How many moments are held at their start, and found to rest there."""
    lowered, y = compiled.functions, compiled.initial()
    rests = _rest(lowered, compiled.parameter_vector()[None], y[None])
    return len(y) - lowered.free_entries()["free"].numel() if rests[0] else 0


def test_stationary_ground_under_a_wheel_is_not_integrated(shipped):
    assert still_count(shipped("oleo_acceleration")) == 5  # two means, three covariances
    assert still_count(shipped("duffing")) == 0  # no ground
    assert still_count(shipped("road_class_change")) <= 2  # its means alone: the covariance changes along the road
    compiled = shipped("oleo_acceleration")
    native = Native(compiled.functions, compiled.parameter_vector(), Tolerance(1e-11, 1e-2, np.ones(14)))
    grid, y = np.linspace(1, 10, 10), compiled.initial()
    found = native.advance(0.0, y, grid)
    everything_moves = compiled.propagate([0, *grid], engine="direct", rtol=1e-11)
    np.testing.assert_allclose(
        compiled.packing.unpack(found)[1], everything_moves.state_covariance[1:], rtol=1e-7, atol=1e-8
    )


def test_runs_of_which_some_hold_moments_are_each_what_it_is_alone(shipped, monkeypatch):
    compiled = shipped("oleo_acceleration")
    values = [{"zeta": zeta} for zeta in (0.01, 0.05, 0.1, 0.2)]
    p, y = (np.array([of(each) for each in values]) for of in (compiled.parameter_vector, compiled.initial))
    rests = dict(zip((own.tobytes() for own in p), (False, True, True, False), strict=True))
    monkeypatch.setattr(native, "_rest", lambda _, p, y: np.array([rests[own.tobytes()] for own in p]))
    grid, edges = np.array([0.0, 1.0, 2.5]), [(0.0, 2.5), (0.0, 2.0, 2.5), (0.0, 2.5), (0.0, 1.5, 2.5)]
    size = np.random.default_rng(0).uniform(0.5, 2.0, y.shape)
    together = native.march_all(compiled.functions, p, y, edges, grid, Tolerance(1e-7, 1e-2, size))
    for k in range(len(p)):
        own = Tolerance(1e-7, 1e-2, size[k])
        alone = native.march_all(compiled.functions, p[k : k + 1], y[k : k + 1], edges[k : k + 1], grid, own)
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one[0], other[k])
    np.testing.assert_array_equal(together.y[:, 0], y)
    assert not together.status.any()


def test_ground_that_starts_smooth_is_integrated():
    model = cs.load(ROOT / "models" / "oleo_acceleration.toml")
    smooth = dataclasses.replace(model, initial=cs.Initial(ground="smooth"))
    assert still_count(cs.compile(smooth)) == 0


def test_a_moment_that_runs_away_is_told_with_what_was_reached():
    x, w = sp.symbols("x w")
    model = cs.Model(cs.Vehicle(rates={x: x**3 + w}), noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=10)
    with pytest.raises(cs.SolverError) as caught:
        cs.compile(model).propagate(points=1001)
    partial = caught.value.details["partial"]
    assert 0 < len(partial.time) < 1001
    assert "x" in str(caught.value)
    assert np.isfinite(partial.state_covariance).all()


def test_where_too_many_steps_led_is_told_with_the_moments_there(shipped):
    """Another engine goes on from there."""
    compiled = shipped("oleo_acceleration")
    functions, y, p = compiled.functions, compiled.initial(), compiled.parameter_vector()
    size = np.ones(len(y))
    with pytest.raises(Breakdown) as caught:
        Native(functions, p, Tolerance(1e-9, 1e-3, size, steps=7)).advance(0.0, y, np.array([10.0]))
    told = caught.value
    assert told.time is not None
    again = Native(functions, p, Tolerance(1e-11, 1e-3, size)).advance(0.0, y, np.array([told.time]))
    np.testing.assert_allclose(told.y, again[0], rtol=1e-6, atol=1e-9)


# -- the implicit formulas ------------------------------------------------------------------------------------


def multiplied(shape: Vector, A: Vector, B: Vector, out: Vector) -> None:
    """What machine code has the library do."""
    n, rows, columns = (int(each) for each in shape[:3])
    A = A[: rows * n].reshape(rows, n)
    for i in range(rows):
        for j in range(columns):
            out[i * n + j] = A[i] @ B[j : j + (n - 1) * n + 1 : n]


@pytest.mark.parametrize("n", [1, 3, 8, 70])
def test_machine_code_multiplies_by_rows(n):
    rng, out, expected = np.random.default_rng(n), np.empty(n * n), np.empty(n * n)
    A, B = rng.normal(size=n * n), rng.normal(size=n * n)
    multiply = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(multiplication(n))
    for shape in (np.array([n, n, n], dtype=float), np.array([n, (n + 1) // 2, (n + 2) // 3], dtype=float)):
        out[:] = expected[:] = 7.0
        multiply(shape.ctypes.data, A.ctypes.data, B.ctypes.data, out.ctypes.data)
        multiplied(shape, A, B, expected)
        np.testing.assert_allclose(out, expected, rtol=1e-12, atol=1e-13 * n)


@pytest.mark.parametrize("n", [1, 2, 5, 8, 13, 33])
@pytest.mark.parametrize("g", [1e-3, 0.7])
def test_the_inverse_in_loops_is_the_one_of_arrays(n, g):
    rng = np.random.default_rng(n)
    N, scale, packing = rng.normal(size=(n, n)) - 2 * np.eye(n), rng.uniform(0.1, 10, n), Packing(n, distance=True)
    form = scaled_form(N, scale)
    expected, r = np.empty(packing.size), rng.normal(size=packing.size)
    Inverse.build(PackedIndex(packing), scale, form, g).apply(r, expected)
    given = modal_arrays(form, scale)
    work, found = np.zeros(improved.MATRICES * n * n + 2 * n + 3), np.empty(packing.size)
    improved.weigh(work, work[improved.MATRICES * n * n :], given.modes, n, g)
    improved.invert(multiplied, r, found, packing.size, n, given.matrices, given.modes, given.pairs, work)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("order", range(1, 6))
def test_backward_differences_of_another_step_are_those_of_the_same_polynomial(order):
    polynomial, t, h, factor = np.polynomial.Polynomial(np.arange(1.0, order + 2)), 0.7, 0.1, 0.37

    def differences(h):
        values = [polynomial(t - k * h) for k in range(order + 1)]
        rows = []
        for _ in range(order + 1):
            rows.append(values[0])
            values = list(-np.diff(values))
        return np.array(rows)

    found = differences(h)
    backward.rescale(found, order, factor, 1, np.zeros(150), np.zeros(order + 1))
    np.testing.assert_allclose(found, differences(factor * h), rtol=1e-9, atol=1e-12)


def test_a_stiff_run_as_machine_code_is_the_one_of_python():
    x, w = sp.symbols("x w")
    vehicle = cs.Vehicle(rates={x: -50 * x - x**3 + w})
    model = cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=1)
    compiled = cs.compile(model)
    functions, y, grid = compiled.functions, compiled.initial(), np.array([0.2, 1.0])
    stiff = Stiff(functions, compiled.parameter_vector(), Tolerance(1e-5, 1e-2, np.array([0.1, 0.01])))
    expected = stiff.advance(0.0, y, grid)

    def rate(clock, state, values, slope):
        slope[:2] = np.array(functions.rate(clock[0], state[:2], values[:0])).ravel()

    form, state = stiff._form(0.0, y), np.zeros(backward.STATE)
    state[8], state[9] = 1.0, -1.0
    work, found = np.zeros(backward.room_of(2, 1)), np.zeros(4)
    tolerance, inverse = (stiff.tolerance.size, 1e-5, 1e-2), (form.matrices, form.modes, form.pairs)
    status = backward.carry(
        rate, multiplied, grid, 2, y.copy(), 2, 1, np.zeros(1), *tolerance, 1.0, 1000, *inverse, work, found, state, 1
    )
    assert status == 0
    assert state[4] == stiff.steps
    np.testing.assert_allclose(found.reshape(2, 2), expected, rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(expected[-1, 1], compiled.stationary().state_covariance[0, 0], rtol=1e-4)


@pytest.mark.parametrize("friction", [50.0, 500.0, 5000.0])
def test_friction_is_integrated_from_rest(friction):
    """Without variance its gain has no bound: what is taken there as the inverse of a step turns everything into nothing."""
    x, v, w = sp.symbols("x v w")
    sign = cs.Element("friction", [x], sp.sign(x))
    vehicle = cs.Vehicle(rates={x: v, v: -1e4 * x - friction * sign(v) - 50 * v + 30 * w})
    model = cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=20)
    compiled = cs.compile(model)
    found = [compiled.propagate([0.01, 20.0], rtol=1e-8, engine=engine) for engine in ("auto", "stiff", "native")]
    for history in found[1:]:
        np.testing.assert_allclose(history.variance.values, found[0].variance.values, rtol=2e-4)
    np.testing.assert_allclose(found[0].variance["v"][-1], compiled.stationary().state_covariance[1, 1], rtol=1e-5)


def test_the_choice_goes_by_stiffness():
    x, w, k = sp.symbols("x w k")
    vehicle = cs.Vehicle(rates={x: -k * x - x**3 / 10 + w})
    noise = cs.Noise(names=("w",), intensity=sp.eye(1))
    names = {}
    for value in (1.0, 1e6):
        model = cs.Model(vehicle, noise=noise, parameters={k: value}, duration=20)
        names[value] = cs.compile(model).propagate(points=3).provenance.engine
    assert names == {1.0: Native.name, 1e6: Stiff.name}


def test_a_stiff_run_takes_hardly_more_rates_than_steps(monkeypatch):
    """How Newton's method converges is looked at anew only when what was seen of it has aged; and nothing is lost by that."""
    rates = {f"x{i}": f"{10.0**i}*(-x{i} - x{i}**3/100{f' + x{i - 1}/4' if i else ''}) + w{i}" for i in range(6)}
    lines = "\n".join(f'{name} = "{rate}"' for name, rate in rates.items())
    noises = "\n".join(f"w{i} = 1.0" for i in range(6))
    compiled = cs.compile(toml(f'name = "lags"\n[rates]\n{lines}\n[noise]\n{noises}\n[run]\nduration = 20.0\npoints = 21'))
    carry, seen = stiff_runs._carry(), []

    def watched(*given):
        status = carry(*given)
        seen.append(np.ctypeslib.as_array(ctypes.cast(given[-2], ctypes.POINTER(ctypes.c_double)), (backward.STATE,)).copy())
        return status

    monkeypatch.setattr(stiff_runs, "_carry", lambda: watched)
    found = compiled.propagate(rtol=1e-6, engine="stiff")
    steps, rates_taken = seen[-1][4], seen[-1][6]
    assert steps < rates_taken < 1.15 * steps
    precise = compiled.propagate(rtol=1e-10, engine="stiff")
    scale = np.sqrt(precise.variance.values.max(axis=0))
    assert (np.abs(found.state_covariance - precise.state_covariance) / np.outer(scale, scale)).max() < 1e-5
