"""Propagation beside its peers: the paper's Figure 3 and chains of masses; medians, spread and ratios of one run.

    python benchmarks/transient.py [--repeat 7] [--chains 8 32 64]

Times are processor time, so that other work on the machine disturbs them little; tolerance 1e-6 everywhere.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import chains
import numpy as np
from rich.console import Console
from rich.table import Table

import cadet_sym as cs

FIGURE_3 = Path(__file__).parent.parent / "models" / "oleo_acceleration.toml"


def measured(run: Callable[[], object], repeat: int) -> np.ndarray:
    """Milliseconds of every repetition, after one that is not counted."""
    run()
    found = []
    for _ in range(repeat):
        began = time.process_time()
        run()
        found.append(1e3 * (time.process_time() - began))
    return np.array(found)


def casadi_alone(compiled: cs.CompiledModel, times: np.ndarray) -> Callable[[], object]:
    """CasADi's CVODES as it comes, on the compiled rate, built beforehand."""
    rate, p, start = compiled.functions.rate, compiled.parameter_vector(), compiled.initial()
    t, x, q = ca.SX.sym("t"), ca.SX.sym("x", len(start)), ca.SX.sym("q", len(p))
    dae = {"x": x, "p": q, "t": t, "ode": rate(t, x, q)}
    run = ca.integrator("alone", "cvodes", dae, 0.0, times[1:].tolist(), {"reltol": 1e-6})
    return lambda: run(x0=start, p=p)


def numpy_rate(compiled: cs.CompiledModel) -> Callable[[float, np.ndarray], np.ndarray]:
    """The moment equations as a script would have them: NumPy matrices, elements through one call each."""
    functions, p, packing = compiled.functions, compiled.parameter_vector(), compiled.equations.packing

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        mean, P = packing.unpack(y)
        V, dV, s, _ = (float(part) for part in functions.motion(t, p))
        ctx = np.array([t, s, V, dV])
        A, c, b, C, d, D = (np.asarray(part) for part in functions.linear(ctx, p))
        spread = C @ P @ C.T
        theta = np.concatenate([C @ mean + d.ravel(), np.maximum(np.diag(spread), 0)])
        F, gain = (np.asarray(part).ravel() for part in functions.elements(theta, ctx, p)[:2])
        N = A + b @ (gain[:, None] * C)
        half = N @ P
        return packing.pack(A @ mean + c.ravel() + b @ F, half + half.T + D)

    return rate


def scipy_script(compiled: cs.CompiledModel, times: np.ndarray, method: str) -> Callable[[], object]:
    from scipy.integrate import solve_ivp

    rate, start = numpy_rate(compiled), compiled.initial()
    return lambda: solve_ivp(rate, times[[0, -1]], start, method=method, t_eval=times, rtol=1e-6, atol=1e-8)


def compare(table: Table, name: str, compiled: cs.CompiledModel, points: int, script: str | None, repeat: int) -> None:
    times = np.linspace(0, float(compiled.model.number(compiled.model.run.duration)), points)
    ours = measured(lambda: compiled.propagate(times, rtol=1e-6), repeat)
    rows = {compiled.propagate(times, rtol=1e-6).provenance.engine: ours}
    if compiled.equations.packing.size < 3000:
        rows["CasADi CVODES alone"] = measured(casadi_alone(compiled, times), repeat)
    if script:
        rows[f"SciPy {script}, NumPy rate"] = measured(scipy_script(compiled, times, script), max(1, repeat // 3))
    for who, found in rows.items():
        spread = f"{np.percentile(found, 10):.2f} - {np.percentile(found, 90):.2f}"
        table.add_row(name, who, f"{np.median(found):.2f}", spread, f"{np.median(found) / np.median(ours):.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--chains", type=int, nargs="*", default=[8, 32, 64])
    arguments = parser.parse_args()
    table = Table("problem", "engine", "ms", "10 - 90 %", "over ours", title="Propagation, rtol 1e-6")
    compare(table, "Figure 3", cs.compile(FIGURE_3), 101, "LSODA", 3 * arguments.repeat)
    compare(table, "car-like 30", cs.compile(chains.car(30)), 21, "RK45", 1)
    for n in arguments.chains:
        compare(table, f"masses {n}", cs.compile(chains.masses(n)), 21, None, arguments.repeat)
        compare(table, f"stiff {n}", cs.compile(chains.damped(n)), 21, None, arguments.repeat)
    console = Console(width=110)
    console.print(table)
    console.print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


if __name__ == "__main__":
    main()
