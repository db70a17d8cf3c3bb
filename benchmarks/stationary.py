"""Stationary moments against SciPy: ratios to one Lyapunov equation of the same size, measured in one run.

    python benchmarks/stationary.py [--big] [--start]

A chain of n/2 masses with a cubic spring, an asymmetric quadratic damper and friction, under white noise and a load.
`root` is scipy.optimize.root (hybr) on the packed equations with the elements' variances clipped at zero; it is run
where it ends within minutes. --big adds n = 512; --start repeats the table of thirty random starts on 16 states.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import root

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from test_stationary import chain

from cadet_sym.errors import SolverError
from cadet_sym.solve.frozen import FrozenProblem, evaluate
from cadet_sym.solve.stationary import stationary_point


def median_seconds(function: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def packed(p: FrozenProblem, clipped: bool = True) -> Callable[[np.ndarray], np.ndarray]:
    """The stationary equations as SciPy wants them; unclipped, an element has no value at a negative variance."""
    rows, columns = np.tril_indices(p.n)

    def residual(y: np.ndarray) -> np.ndarray:
        covariance = np.zeros((p.n, p.n))
        covariance[rows, columns] = covariance[columns, rows] = y[p.n :]
        if not clipped and np.min(np.einsum("kn,nm,km->k", p.C, covariance, p.C)) < 0:
            return np.full(len(y), np.nan)
        at = evaluate(p, y[: p.n], covariance)
        return np.concatenate([at.r, at.R[rows, columns]])

    return residual


def scipy_root(
    p: FrozenProblem, mean: np.ndarray, covariance: np.ndarray, clipped: bool = True
) -> np.ndarray | None:
    """Covariance that scipy.optimize.root (hybr, that is fsolve) finds, if it is one."""
    rows, columns = np.tril_indices(p.n)
    found = root(packed(p, clipped), np.concatenate([mean, covariance[rows, columns]]), tol=1e-10)
    P = np.zeros((p.n, p.n))
    P[rows, columns] = P[columns, rows] = found.x[p.n :]
    return P if found.success and np.linalg.eigvalsh(P)[0] > -1e-10 else None


def sizes(big: bool) -> None:
    print("  n    ours (ms)   Lyapunov (ms)   ratio   scipy root (ms)   how")
    for n in (16, 64, 128, 256, *([512] if big else [])):
        p = chain(n)
        repeats = 15 if n <= 64 else 5 if n <= 256 else 1
        point = stationary_point(p)  # warm
        ours = median_seconds(lambda p=p: stationary_point(p), repeats)
        N = evaluate(p, point.mean, point.covariance).N
        one = median_seconds(lambda N=N, p=p: solve_continuous_lyapunov(N, -p.D), repeats)
        peer = ""
        if n <= 64:
            peer = f"{1e3 * median_seconds(lambda p=p: scipy_root(p, np.zeros(p.n), 0.1 * np.eye(p.n)), 1):.0f}"
        print(f"{n:4d} {1e3 * ours:11.1f} {1e3 * one:14.2f} {ours / one:9.1f} {peer:>14}      {point.path[-1]}")


def random_starts() -> None:
    p, rng = chain(), np.random.default_rng(0)
    expected = stationary_point(p).covariance
    found = {"ours": 0, "scipy fsolve raw": 0, "scipy fsolve clipped": 0}
    for _ in range(30):
        M = rng.standard_normal((16, 16)) * 10 ** rng.uniform(-2, 1)
        start = 3 * rng.standard_normal(16), M @ M.T / 16
        for name in ("raw", "clipped"):
            P = scipy_root(p, *start, clipped=name == "clipped")
            found[f"scipy fsolve {name}"] += P is not None and np.allclose(P, expected, atol=1e-6)
        try:
            found["ours"] += np.allclose(stationary_point(p, start).covariance, expected, atol=1e-9)
        except SolverError:
            continue
    print("thirty random starts on 16 states:", ", ".join(f"{name} {count}" for name, count in found.items()))


if __name__ == "__main__":
    sizes("--big" in sys.argv)
    if "--start" in sys.argv:
        random_starts()
