"""Monte Carlo of the paper's Figure 3: nanoseconds a path-step, and the error bought with them, beside a plain script.

    python benchmarks/monte_carlo.py [--paths 10000] [--memory]

The plain script is what one writes in numba in ten minutes: Heun's rule for filter and vehicle alike, one path a loop,
numba's own normal deviates. Errors of the time step come from each program's own finer steps, on the same noise.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
from collections.abc import Callable
from time import perf_counter, process_time

import numba
import numpy as np
import sympy as sp

import cadet_sym as cs
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.workers import Task, records_in_parts, run_groups

W_N, ZETA, GAMMA, R, ACCELERATION, ALPHA, BETA, END = 10.0, 0.01, 0.1, 0.1, 8.0, 0.2, 2.0, 10.0
STEPS = (1250, 2500, 5000, 10_000, 20_000)  # of a run


def undercarriage() -> cs.Model:
    """Harrison & Hammond (1986), Figure 3."""
    x, v, h, t, z = sp.symbols("x v h t z")
    oleo = cs.Element("oleo", [z], sp.Piecewise((z**2, z > 0), (-R * z**2, True)))
    return cs.Model(
        cs.Vehicle(
            rates={x: v, v: -(W_N**2) * x - 2 * ZETA * W_N * v - GAMMA * oleo(v) - cs.der(h, 2)},
            contacts={h: cs.Contact()},
        ),
        cs.exponential(sigma=1, cutoff=ALPHA).rolling_contact(cutoff=BETA),
        cs.Travel(speed=ACCELERATION * t),
        duration=END,
        points=3,
    )


@numba.njit(fastmath=True, inline="always")
def plain_step(x, v, u, q, V0, V1, h, kick):
    """One step of Heun's rule for all four states; `kick` is what the noise adds to the filter."""
    Vm = 0.5 * (V0 + V1)
    du, dq = V0 * q, V0 * (-ALPHA * BETA * u - (ALPHA + BETA) * q)
    dv = -(W_N**2) * x - 2 * ZETA * W_N * v - GAMMA * (v * v if v > 0 else -R * v * v) - ACCELERATION * q - V0 * dq
    xp, vp, up, qp = x + h * v, v + h * dv - Vm * kick, u + h * du, q + h * dq + kick
    du2, dq2 = V1 * qp, V1 * (-ALPHA * BETA * up - (ALPHA + BETA) * qp)
    dv2 = -(W_N**2) * xp - 2 * ZETA * W_N * vp - GAMMA * (vp * vp if vp > 0 else -R * vp * vp)
    dv2 += -ACCELERATION * qp - V1 * dq2
    x, v = x + 0.5 * h * (v + vp), v + 0.5 * h * (dv + dv2) - Vm * kick
    return x, v, u + 0.5 * h * (du + du2), q + 0.5 * h * (dq + dq2) + kick


@numba.njit(fastmath=True, inline="always")
def noise(V0, V1, h, z):
    """What a standard deviate adds to the filter in a step."""
    return BETA * math.sqrt(2 * ALPHA) * 0.5 * (math.sqrt(V0) + math.sqrt(V1)) * math.sqrt(h) * z


@numba.njit(parallel=True, fastmath=True)
def plain(paths: int, steps: int) -> np.ndarray:
    """Closure of every path at the end: Heun for all four states, the noise shared by filter and vehicle."""
    out, h = np.empty(paths), END / steps
    s_u, s_q = math.sqrt(BETA / (ALPHA + BETA)), math.sqrt(ALPHA * BETA * BETA / (ALPHA + BETA))
    for p in numba.prange(paths):
        x = v = 0.0
        u, q = s_u * np.random.normal(), s_q * np.random.normal()
        for i in range(steps):
            V0, V1 = ACCELERATION * i * h, ACCELERATION * (i + 1) * h
            x, v, u, q = plain_step(x, v, u, q, V0, V1, h, noise(V0, V1, h, np.random.normal()))
        out[p] = x
    return out


@numba.njit(parallel=True, fastmath=True)
def plain_pairs(paths: int, steps: int) -> np.ndarray:
    """The same with a step and with half of it, on the same noise: (2, paths), the finer first."""
    out, h = np.empty((2, paths)), END / (2 * steps)
    s_u, s_q = math.sqrt(BETA / (ALPHA + BETA)), math.sqrt(ALPHA * BETA * BETA / (ALPHA + BETA))
    for p in numba.prange(paths):
        x = v = 0.0
        u, q = s_u * np.random.normal(), s_q * np.random.normal()
        X, V, U, Q = x, v, u, q
        before = 0.0
        for i in range(2 * steps):
            V0, V1, z = ACCELERATION * i * h, ACCELERATION * (i + 1) * h, np.random.normal()
            x, v, u, q = plain_step(x, v, u, q, V0, V1, h, noise(V0, V1, h, z))
            if i % 2:
                V0, both = V0 - ACCELERATION * h, math.sqrt(0.5) * (before + z)
                X, V, U, Q = plain_step(X, V, U, Q, V0, V1, 2 * h, noise(V0, V1, 2 * h, both))
            before = z
        out[0, p], out[1, p] = x, X
    return out


def our_pairs(problem: Problem, paths: int, steps: int) -> np.ndarray:
    """Closure at the end with half a step and with the step, (2, paths)."""
    records = records_in_parts(problem.plan(END / steps, paired=True)[0], "numba", 1, paths)
    return np.stack([each[-1, 0] for each in records])


def step_errors(pairs: Callable[[int, int], np.ndarray], paths: int) -> dict[int, np.ndarray]:
    """Steps of a run -> error of mean (of the deviation) and variance (of itself), and their doubts, (2, 2).

    The difference to half the step, added up over all finer ones; below the finest a third of the last follows.
    """
    error, doubt, found = np.zeros(2), np.zeros(2), {}
    for steps in reversed(STEPS):
        fine, coarse = pairs(paths, steps)
        a, b = coarse - coarse.mean(), fine - fine.mean()
        size = np.array([b.std(), b.var()])
        parts = np.stack([coarse - fine, a**2 - b**2])
        last = 4 / 3 if steps == STEPS[-1] else 1.0
        error = error + last * parts.mean(axis=1) / size
        doubt = np.hypot(doubt, last * parts.std(axis=1) / math.sqrt(paths) / size)
        found[steps] = np.stack([error, doubt])
    return found


def step_for(errors: dict[int, np.ndarray], accuracy: float) -> float:
    """Step whose error in mean and variance is below the accuracy, error growing with its square (weighted fit)."""
    h2 = np.array([(END / steps) ** 2 for steps in errors])[:, None]
    error, doubt = np.moveaxis(np.stack(list(errors.values())), 1, 0)
    weight = h2 / (doubt**2 + (0.05 * error) ** 2)
    return float(np.sqrt(accuracy / np.abs((weight * error).sum(axis=0) / (weight * h2).sum(axis=0))).min())


def ours(problem: Problem, paths: int, steps: int) -> tuple[float, float, float]:
    """Seconds, mean and variance at the end."""
    plan, _ = problem.plan(END / steps)
    task = Task(plan, "numba", seed=1, states=4, quantities=problem.quantities, keep=0)
    began = perf_counter()
    results = list(run_groups(task, range(paths), None, None))
    seconds = perf_counter() - began
    total = results[0].moments
    for result in results[1:]:
        total = total.joined(result.moments)
    return seconds, float(total.mean[-1, 0]), float(total.variance[-1, 0])


def cost_of_paths() -> None:
    """The paper's cost claim: 2000 paths over CADET, both compiled, in processor time; and CADET's accuracy by paths."""
    compiled = cs.compile(undercarriage())
    exact = compiled.propagate(rtol=1e-10).variance["x"][-1]
    print("\nThe paper's cost claim, in processor time, numerical error of the variance at the end in brackets:")
    times = {}
    for rtol in (1e-3, 1e-6):
        compiled.propagate(rtol=rtol)
        began = process_time()
        for _ in range(20):
            history = compiled.propagate(rtol=rtol)
        times[rtol] = (process_time() - began) / 20
        off = abs(history.variance["x"][-1] / exact - 1)
        print(f"  CADET, rtol {rtol:.0e}: {1e3 * times[rtol]:.2f} ms ({100 * off:.1g} %)")
    for name, control in (("plain", False), ("control variates", True)):
        run = cs.simulate(compiled, 2000, control=control, seed=1)
        began = process_time()
        cs.simulate(compiled, 2000, control=control, seed=1, step=run.step, check_step=False)
        seconds, variance = process_time() - began, run.variance["x"][-1]
        half, own = run.limit("variance")["x"][-1] / variance, run.variance_step_error["x"][-1] / variance
        over = [seconds / times[rtol] for rtol in times]
        print(
            f"  2000 paths, {name}: {1e3 * seconds:.0f} ms with a step of {run.step:.1e} ({100 * own:+.2g} %), limits of the "
            f"variance at the end {100 * half:.1f} %: {over[0]:.0f} times CADET at 1e-3, {over[1]:.0f} at 1e-6; for limits of "
            f"1 % some {over[0] * (half / 0.01) ** 2:.0f} times"
        )


def main() -> None:
    """Print the table of steps, the cost at equal accuracy, and the paper's cost claim."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=10_000)
    parser.add_argument("--memory", action="store_true", help="10^6 paths of 5000 steps, and the most memory they took")
    given = parser.parse_args()
    paths = given.paths
    problem = Problem(cs.augment(undercarriage()), np.linspace(0.0, END, 3))
    plain(32, 16)
    plain_pairs(32, 16)
    ours(problem, 32, 16)
    if given.memory:
        seconds, _, variance = ours(problem, 1_000_000, 5000)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"10^6 paths of 5000 steps: {seconds:.0f} s, variance {variance:.4f}, at most {peak:.2f} GiB in memory")
        return
    print(f"{paths} paths, {os.cpu_count()} threads. Error of the step at t = 10, of mean (beside the deviation) and variance:")
    errors = {"plain": step_errors(plain_pairs, paths)}
    errors["ours"] = step_errors(lambda n, steps: our_pairs(problem, n, steps), paths)
    cost: dict[str, list[float]] = {"plain": [], "ours": []}
    for steps in STEPS:
        began = perf_counter()
        plain(paths, steps)
        cost["plain"].append(1e9 * (perf_counter() - began) / (paths * steps))
        cost["ours"].append(1e9 * ours(problem, paths, steps)[0] / (paths * steps))
        texts = []
        for name in ("plain", "ours"):
            (m, v), (dm, dv) = 100 * errors[name][steps]
            texts.append(f"{name} {m:+.2f} +- {dm:.2f} %, {v:+.2f} +- {dv:.2f} %, {cost[name][-1]:.0f} ns a path-step")
        print(f"  dt {END / steps:.1e}   {'   '.join(texts)}   {cost['ours'][-1] / cost['plain'][-1]:.2f} times plain")
    for accuracy in (0.02, 0.005):
        h = {name: step_for(errors[name], accuracy) for name in errors}
        ratio = float(np.median(cost["ours"]) / np.median(cost["plain"])) * h["plain"] / h["ours"]
        print(
            f"Error of the step below {100 * accuracy:g} %: plain with {h['plain']:.1e}, ours with {h['ours']:.1e}: "
            f"{ratio:.2f} times the time of plain"
        )
    cost_of_paths()


if __name__ == "__main__":
    main()
