"""Propagation beside its peers, one after the other in one run: a table of ratios, medians and spread.

    python benchmarks/run.py [--repeat 7] [--chains 8 32 64] [--large 200] [--no-monte-carlo]

The paper's Figure 3 and chains of masses, tolerance 1e-6, against (a) a script with a NumPy rate written by hand,
(b) SciPy's BDF with the compiled rate and its sparse Jacobian, (c) CasADi's CVODES with its defaults, and its Adams
formulas, (d) 2000 paths of Monte Carlo; then the seconds to a first result in a process of its own, and the peak memory.
Times are processor time, so that other work on the machine disturbs them little. The error is that of the covariances,
over the states' standard deviations, against a run at 1e-9.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import chains
import numpy as np
import scripts
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp
from scipy.sparse import csc_matrix

import cadet_sym as cs
from cadet_sym.solve.evaluate import Rate
from cadet_sym.solve.native import march_all
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.shares import Team

ROOT = Path(__file__).resolve().parent.parent
FIGURE_3 = ROOT / "models" / "oleo_acceleration.toml"
RTOL = 1e-6
MOMENTS = ("state_mean", "state_covariance", "output_mean", "output_variance")

Run = Callable[[], np.ndarray]  # gives the covariances (k, n, n)


def measured(run: Run, repeat: int) -> tuple[np.ndarray, np.ndarray]:
    """Milliseconds of every repetition, after one that is not counted where there are several; and what was found."""
    result, found = run() if repeat > 1 else np.empty(0), []
    for _ in range(repeat):
        began = time.process_time()
        result = run()
        found.append(1e3 * (time.process_time() - began))
    return np.array(found), result


def ours(compiled: cs.CompiledModel, times: np.ndarray) -> Run:
    return lambda: compiled.propagate(times, rtol=RTOL).state_covariance


def casadi_alone(compiled: cs.CompiledModel, times: np.ndarray, **options: str) -> Run:
    """CasADi's CVODES as it comes, on the compiled rate, built beforehand."""
    rate, p, start = compiled.functions.rate, compiled.parameter_vector(), compiled.initial()
    t, x, q = ca.SX.sym("t"), ca.SX.sym("x", len(start)), ca.SX.sym("q", len(p))
    dae = {"x": x, "p": q, "t": t, "ode": rate(t, x, q)}
    settings = {"reltol": RTOL, "max_num_steps": 100_000, **options}
    run = ca.integrator("alone", "cvodes", dae, 0.0, times[1:].tolist(), settings)
    return lambda: compiled.packing.unpack(np.vstack([start, np.asarray(run(x0=start, p=p)["xf"]).T]))[1]


def sparse_bdf(compiled: cs.CompiledModel, times: np.ndarray) -> Run:
    """SciPy's BDF with the compiled rate and the compiled sparse Jacobian."""
    p, start, jacobian = compiled.parameter_vector(), compiled.initial(), compiled.functions.jacobian
    fast, slope = Rate(compiled.functions, p), np.empty(len(start))

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        fast(t, np.ascontiguousarray(y), slope)
        return slope.copy()

    def sparse(t: float, y: np.ndarray) -> csc_matrix:
        J = jacobian(t, y, p)
        colind, row = J.sparsity().get_ccs()
        return csc_matrix((np.array(J.nonzeros()), row, colind), shape=J.shape)

    def run() -> np.ndarray:
        found = solve_ivp(rate, times[[0, -1]], start, method="BDF", t_eval=times, rtol=RTOL, atol=1e-8, jac=sparse)
        return compiled.packing.unpack(found.y.T)[1]

    return run


def script(by_hand: scripts.Script, times: np.ndarray, method: str) -> Run:
    """A script of NumPy and SciPy alone."""
    rows, columns = np.tril_indices(by_hand.n)

    def run() -> np.ndarray:
        found = solve_ivp(
            by_hand.rate, times[[0, -1]], by_hand.start, method=method, t_eval=times, rtol=RTOL, atol=1e-8
        )
        packed = found.y[by_hand.n :].T
        if packed.shape[1] == by_hand.n**2:
            return packed.reshape(-1, by_hand.n, by_hand.n)
        P = np.empty((len(times), by_hand.n, by_hand.n))
        P[:, rows, columns] = P[:, columns, rows] = packed
        return P

    return run


def rows_of(compiled: cs.CompiledModel, name: str, times: np.ndarray, runs: dict[str, tuple[Run, int]], table: Table) -> None:
    """Measure every run; the first is what the others are compared with.

    What is repeated is so in turn with the others: a machine that is slower for some seconds is so for all of them.
    """
    reference = compiled.propagate(times, rtol=1e-9).state_covariance
    size = np.sqrt(np.diagonal(reference, axis1=1, axis2=2).max(axis=0))
    base, rounds = 0.0, max(1, min((repeat for _, repeat in runs.values() if repeat > 1), default=1))
    seconds: dict[str, list[float]] = {who: [] for who in runs}
    results = {}
    for k in range(rounds):
        for who, (run, repeat) in runs.items():
            if repeat > 1 or k == 0:
                found, results[who] = measured(run, -(-repeat // rounds))
                seconds[who] += found.tolist()
    for who, found in seconds.items():
        middle, result = float(np.median(found)), results[who]
        base = base or middle
        known = result.shape == reference.shape
        error = float((np.abs(result - reference) / np.outer(size, size)).max()) if known else np.nan
        spread = f"{np.percentile(found, 10):.2f} - {np.percentile(found, 90):.2f}"
        table.add_row(name, who, f"{middle:.2f}", spread, f"{middle / base:.2f}", f"{error:.0e}")
        print(f"{name:12} {who:34} {middle:10.2f} ms  {middle / base:8.2f}  error {error:.0e}", file=sys.stderr, flush=True)


def figure_3(table: Table, repeat: int, monte_carlo: bool) -> None:
    compiled, times, by_hand = cs.compile(FIGURE_3), np.linspace(0, 10, 101), scripts.figure_3()
    runs = {"cadet-sym": (ours(compiled, times), 30 * repeat)}  # as in a loop: less than a millisecond each
    runs["CasADi CVODES"] = (casadi_alone(compiled, times), 30 * repeat)
    runs["plain script, LSODA"] = (script(scripts.figure_3_plain(), times, "LSODA"), max(2, repeat // 2))
    # math.erf on numbers, matrices filled in place, a triangle of P: what a careful user makes of it
    runs["script, LSODA"] = (script(by_hand, times, "LSODA"), max(2, repeat // 2))
    runs["script, DOP853"] = (script(by_hand, times, "DOP853"), 2)
    if monte_carlo:
        import monte_carlo as paths

        model = paths.undercarriage()
        paths.plain(32, 16)
        runs["Monte Carlo, 2000 paths"] = (lambda: np.asarray(cs.simulate(model, paths=2000).time), 1)
        runs["numba script, 2000 paths"] = (lambda: paths.plain(2000, 2500), 1)
    rows_of(compiled, "Figure 3", times, runs, table)


def growth(console: Console, kinds: tuple[str, ...], sizes: tuple[int, ...] = (32, 64, 100, 200)) -> None:
    """How the time of a run grows with the number of states: the exponent between the first size and the last."""
    times = np.linspace(0, 20, 21)
    for kind in kinds:
        found = []
        for n in sizes:
            compiled = cs.compile(getattr(chains, kind)(n))
            found.append(float(np.median(measured(ours(compiled, times), 3)[0])))
        exponent = np.log(found[-1] / found[0]) / np.log(sizes[-1] / sizes[0])
        milliseconds = ", ".join(f"{n}: {each:.1f}" for n, each in zip(sizes, found, strict=True))
        console.print(f"{kind}, ms at n = {milliseconds}; grows as n^{exponent:.2f}")


def sweep_on_two_cores(console: Console, points: int = 200, pairs: int = 15) -> None:
    """Wall milliseconds of a sweep of the quarter car, in one thread and in two: the least, and the median of pairs.

    Pairs stand close together and take turns in which comes first: a machine that is slower for some seconds is so for both.
    Beside them the same of the integrator's machine code alone: two cores that share a processor's units give no two.
    """
    model, found = cs.load(ROOT / "models" / "quarter_car_linear.toml"), {}
    declared = model.parameter_values()["c_s"]

    def swept(workers: int, k: int) -> None:
        values = {"c_s": np.linspace(0.5, 2.0, points) * declared * (1 + 1e-9 * k)}  # of its own: what was found is known
        found[workers] = cs.sweep(model, values, workers=workers, progress=False, points=501)

    began = time.perf_counter()
    swept(1, 0)
    console.print(f"sweep of {points} points, compiled with it: {1e3 * (time.perf_counter() - began):.0f} ms")
    alone = integrator_alone(cs.compile(model), points)
    tasks = {"sweep": swept, "machine code alone": lambda workers, _: alone(workers)}
    seconds = {what: np.empty((pairs + 1, 2)) for what in tasks}
    for k in range(pairs + 1):
        for what, task in tasks.items():
            for workers in (1, 2) if k % 2 else (2, 1):
                began = time.perf_counter()
                task(workers, k + 1)
                seconds[what][k, workers - 1] = time.perf_counter() - began
    for what, taken in seconds.items():
        one, two = 1e3 * taken[1:].min(axis=0)
        low, middle, high = np.percentile(taken[1:, 0] / taken[1:, 1], (25, 50, 75))
        both = f"{one:.0f} ms in one thread, {two:.0f} ms in two: {one / two:.2f} times"
        console.print(f"  {what}: {both}, median of {pairs} pairs {middle:.2f} (quartiles {low:.2f}, {high:.2f})")
    same = all(
        a is not None and b is not None and all(np.array_equal(getattr(a, each), getattr(b, each)) for each in MOMENTS)
        for a, b in zip(found[1].histories, found[2].histories, strict=True)
    )
    console.print(f"  {'the same' if same else 'OTHER'} numbers")


def integrator_alone(compiled: cs.CompiledModel, runs: int) -> Callable[[int], None]:
    """What carries so many runs, shared out among threads, in the integrator and nowhere else."""
    end = compiled.declaration.duration
    y, p = (np.repeat(each[None], runs, axis=0) for each in (compiled.initial(), compiled.parameter_vector()))
    grid, tolerance = np.linspace(0.0, end, 501), Tolerance(1e-8, 1e-3, np.ones(y.shape[1]))

    def all_of_them(workers: int) -> None:
        march_all(compiled.functions, p, y, [(0.0, end)] * runs, grid, tolerance, Team(workers - 1))

    return all_of_them


def chain(table: Table, kind: str, n: int, repeat: int) -> None:
    compiled, times = cs.compile(getattr(chains, kind)(n)), np.linspace(0, 20, 21)
    repeat = repeat if n < 100 else 2
    runs = {"cadet-sym": (ours(compiled, times), repeat)}
    if n < 100:
        runs["CasADi CVODES"] = (casadi_alone(compiled, times), min(repeat, 2))
    if kind == "masses":
        formulas = {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
        runs["CasADi CVODES, Adams"] = (casadi_alone(compiled, times, **formulas), repeat)
    if kind in ("damped", "relaxations"):
        runs["SciPy BDF, sparse Jacobian"] = (sparse_bdf(compiled, times), 1)
    if kind == "car":
        runs["script, RK45"] = (script(scripts.car(n), times, "RK45"), 1)
    rows_of(compiled, f"{kind} {n}", times, runs, table)


FIRST = """
import time
began = time.perf_counter()
from cadet_sym.cli import main
import casadi
imported = time.perf_counter()
import cadet_sym as cs
compiled = cs.compile({path!r})
loaded = time.perf_counter()
for name in ("rate", "outputs", "initial", "switches"):
    getattr(compiled.functions, name)
made = time.perf_counter()
compiled.propagate().to_dict()
solved = time.perf_counter()
print(imported - began, loaded - imported, made - loaded, solved - made)
"""


def first_result(console: Console) -> None:
    """Seconds of a process of its own, from model file to JSON, without and with what is in the cache."""

    def seconds(*words: str, **more: str) -> float:
        found = []
        for _ in range(5):
            began = time.perf_counter()
            subprocess.run(words, check=True, capture_output=True, env={**os.environ, **more}, cwd=ROOT)
            found.append(time.perf_counter() - began)
        return float(np.median(found))

    command = [sys.executable, "-m", "cadet_sym", "moments", str(FIGURE_3), "--json"]
    with tempfile.TemporaryDirectory() as folder:
        imports = seconds(sys.executable, "-c", "import sympy, casadi")
        cold = seconds(*command, CADET_SYM_CACHE="off")
        seconds(*command, CADET_SYM_CACHE=folder)
        warm = seconds(*command, CADET_SYM_CACHE=folder)
        ratios = f"cold {cold:.2f} s ({cold / imports:.2f}), warm {warm:.2f} s ({warm / imports:.2f})"
        console.print(f"first result: SymPy and CasADi alone {imports:.2f} s; {ratios}")
        for kind, place in (("cold", "off"), ("warm", folder)):
            words = [sys.executable, "-c", FIRST.format(path=str(FIGURE_3))]
            run = subprocess.run(
                words, check=True, capture_output=True, text=True, env={**os.environ, "CADET_SYM_CACHE": place}, cwd=ROOT
            )
            parts = zip(("import", "load and write equations", "functions", "solve"), run.stdout.split(), strict=True)
            console.print(f"  {kind}: " + ", ".join(f"{name} {float(part):.2f}" for name, part in parts))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--chains", type=int, nargs="*", default=[8, 32, 64])
    parser.add_argument("--large", type=int, nargs="*", default=[200])
    parser.add_argument("--no-monte-carlo", action="store_true")
    arguments = parser.parse_args()
    table = Table("problem", "who", "ms", "10 - 90 %", "over ours", "error", title="Propagation, rtol 1e-6")
    figure_3(table, arguments.repeat, not arguments.no_monte_carlo)
    chain(table, "car", 30, 3)
    for n in (*arguments.chains, *arguments.large):
        chain(table, "masses", n, arguments.repeat)
        chain(table, "damped", n, arguments.repeat)
    chain(table, "relaxations", 64, arguments.repeat)
    console = Console(width=120)
    console.print(table)
    growth(console, ("masses", "damped"))
    console.print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")
    sweep_on_two_cores(console)
    first_result(console)


if __name__ == "__main__":
    main()
