"""Monte Carlo of the paper's Figure 3: nanoseconds a path-step, and the error bought with them, beside a plain script.

    python benchmarks/monte_carlo.py [--paths 20000] [--memory]

The plain script is what one writes in numba in ten minutes: Heun's rule for filter and vehicle alike, one path a loop,
numba's own normal deviates. Errors of the time step come from each program's own finer steps.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
from time import perf_counter

import numba
import numpy as np
import sympy as sp

import cadet_sym as cs
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.workers import Task, run_groups

W_N, ZETA, GAMMA, R, ACCELERATION, ALPHA, BETA, END = 10.0, 0.01, 0.1, 0.1, 8.0, 0.2, 2.0, 10.0


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


@numba.njit(parallel=True, fastmath=True)
def plain(paths: int, steps: int) -> np.ndarray:
    """Closure of every path at the end: Heun for all four states, the noise shared by filter and vehicle."""
    out, h = np.empty(paths), END / steps
    k, root = BETA * math.sqrt(2 * ALPHA), math.sqrt(h)
    s_u, s_q = math.sqrt(BETA / (ALPHA + BETA)), math.sqrt(ALPHA * BETA * BETA / (ALPHA + BETA))
    for p in numba.prange(paths):
        x = v = 0.0
        u, q = s_u * np.random.normal(), s_q * np.random.normal()
        for i in range(steps):
            V0, V1 = ACCELERATION * i * h, ACCELERATION * (i + 1) * h
            kick = k * 0.5 * (math.sqrt(V0) + math.sqrt(V1)) * root * np.random.normal()
            Vm = 0.5 * (V0 + V1)
            du, dq = V0 * q, V0 * (-ALPHA * BETA * u - (ALPHA + BETA) * q)
            dv = -(W_N**2) * x - 2 * ZETA * W_N * v - GAMMA * (v * v if v > 0 else -R * v * v) - ACCELERATION * q - V0 * dq
            xp, vp, up, qp = x + h * v, v + h * dv - Vm * kick, u + h * du, q + h * dq + kick
            du2, dq2 = V1 * qp, V1 * (-ALPHA * BETA * up - (ALPHA + BETA) * qp)
            dv2 = -(W_N**2) * xp - 2 * ZETA * W_N * vp - GAMMA * (vp * vp if vp > 0 else -R * vp * vp)
            dv2 += -ACCELERATION * qp - V1 * dq2
            x, v = x + 0.5 * h * (v + vp), v + 0.5 * h * (dv + dv2) - Vm * kick
            u, q = u + 0.5 * h * (du + du2), q + 0.5 * h * (dq + dq2) + kick
        out[p] = x
    return out


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
    """The paper's cost claim: 2000 paths over CADET, both compiled; and CADET's accuracy bought by paths."""
    compiled = cs.compile(undercarriage())
    compiled.propagate(rtol=1e-4)
    began = perf_counter()
    for _ in range(5):
        history = compiled.propagate(rtol=1e-4)
    cadet = (perf_counter() - began) / 5
    off = abs(history.variance["x"][-1] / compiled.propagate(rtol=1e-10).variance["x"][-1] - 1)
    print(f"CADET {cadet:.4f} s, numerical error of the variance at the end {100 * off:.2g} %")
    for name, control in (("plain", False), ("control variates", True)):
        run = cs.simulate(compiled, 2000, control=control, seed=1)
        seconds, half = run.seconds["paths"], run.limit("variance")["x"][-1] / run.variance["x"][-1]
        times = seconds / cadet
        print(
            f"2000 paths, {name}: {seconds:.2f} s with a step of {run.step:.1e}, {times:.0f} times CADET; limits of the "
            f"variance at the end {100 * half:.1f} %; for limits of 1 % some {times * (half / 0.01) ** 2:.0f} times"
        )


def main() -> None:
    """Print one line a program and step."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=20_000)
    parser.add_argument("--memory", action="store_true", help="10^6 paths of 5000 steps, and the most memory they took")
    given = parser.parse_args()
    paths = given.paths
    problem = Problem(cs.augment(undercarriage()), np.linspace(0.0, END, 3))
    plain(32, 16)
    ours(problem, 32, 16)
    if given.memory:
        seconds, _, variance = ours(problem, 1_000_000, 5000)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"10^6 paths of 5000 steps: {seconds:.0f} s, variance {variance:.4f}, at most {peak:.2f} GiB in memory")
        return
    print(f"{paths} paths, {os.cpu_count()} threads; exact variance of closure at the end 1.544")
    for steps in (2500, 5000, 10_000):
        began = perf_counter()
        x = plain(paths, steps)
        seconds = perf_counter() - began
        each = 1e9 / (paths * steps)
        plain_each = seconds * each
        found = f"mean {x.mean():+.4f} variance {x.var():.4f}"
        print(f"dt {END / steps:.0e}  plain {seconds * each:6.1f} ns a path-step, {found}", end="   ")
        seconds, mean, variance = ours(problem, paths, steps)
        ratio = seconds * each / plain_each
        print(f"cadet-sym {seconds * each:6.1f} ns, mean {mean:+.4f} variance {variance:.4f}, {ratio:.2f} times plain")
    cost_of_paths()


if __name__ == "__main__":
    main()
