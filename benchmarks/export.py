"""The exported C against a program written by hand for the same equations: Figure 3 of Harrison & Hammond (1986).

Both are adaptive Dormand & Prince programs with the same measure of the error, at one output time. Run with
``python benchmarks/export.py``; needs gcc. Prints processor time a run, rates, and the results; how many times longer 2000
compiled plain paths take, with the error of their step beside that of chance; then what large models take to export and to
compile at -O1.
"""

from __future__ import annotations

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # one core each

import re
import subprocess
import tempfile
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from time import process_time

import numpy as np
from chains import car
from monte_carlo import plain, plain_pairs, step_errors

import cadet_sym as cs

ROOT = Path(__file__).resolve().parent.parent

# x' = v; v' = -wn^2 x - 2 zeta wn v - gamma f(v) - h''; h' = V s; s' = V (-c1 s - c0 h) + V k w. States x, v, h, s.
HAND = r"""
#include <math.h>
#include <stdio.h>
#include <time.h>
#define N 14
static long rates;
static const double wn = 10, zeta = 0.01, gam = 0.1, r = 0.1, a = 8, c0 = 0.4, c1 = 2.2, k = 1.264911064067352;

static void rate(double t, const double *y, double *d)
{
    const double V = a * t, m = y[1], p = y[8] > 0 ? y[8] : 0, s = sqrt(p) + 1e-150, u = m / s;
    const double phi = exp(-0.5 * u * u) * 0.3989422804014327, Phi = 0.5 * (1 + erf(u * 0.7071067811865476));
    const double F = (m * m + p) * (Phi - r * (1 - Phi)) + (1 + r) * m * s * phi;
    const double g = 2 * m * (Phi - r * (1 - Phi)) + 2 * (1 + r) * s * phi;
    /* h'' = a s + V s': rates of v in x, v, h, s, and what the noise adds */
    const double vx = -wn * wn, vv = -2 * zeta * wn - gam * g, vh = V * V * c0, vs = V * V * c1 - a;
    const double b2 = -V * k, b4 = k; /* b_v = -V^2 k, b_s = V k; intensity 1/V */
    const double *P = y + 4; /* xx xv xh xs vv vh vs hh hs ss */
    rates++;
    d[0] = m;
    d[1] = vx * y[0] - 2 * zeta * wn * m - gam * F + vh * y[2] + vs * y[3];
    d[2] = V * y[3];
    d[3] = -V * (c1 * y[3] + c0 * y[2]);
    d[4] = 2 * P[1];
    d[5] = P[4] + vx * P[0] + vv * P[1] + vh * P[2] + vs * P[3];
    d[6] = P[5] + V * P[3];
    d[7] = P[6] - V * (c1 * P[3] + c0 * P[2]);
    d[8] = 2 * (vx * P[1] + vv * P[4] + vh * P[5] + vs * P[6]) + V * b2 * b2;
    d[9] = vx * P[2] + vv * P[5] + vh * P[7] + vs * P[8] + V * P[6];
    d[10] = vx * P[3] + vv * P[6] + vh * P[8] + vs * P[9] - V * (c1 * P[6] + c0 * P[5]) + V * b2 * b4;
    d[11] = 2 * V * P[8];
    d[12] = V * P[9] - V * (c1 * P[8] + c0 * P[7]);
    d[13] = -2 * V * (c1 * P[9] + c0 * P[8]) + V * b4 * b4;
}

static long run(double end, double rtol, double *y)
{
    double q[7][N], z[N], size[N] = {0}, t = 0, h = 1e-3;
    long steps = 0;
    static const int diagonal[4] = {4, 8, 11, 13}, row[10] = {0, 1, 2, 3, 1, 2, 3, 2, 3, 3},
                     column[10] = {0, 0, 0, 0, 1, 1, 1, 2, 2, 3};
    rate(t, y, q[0]);
    while (t < end) {
        double sum = 0, error;
        if (t + h > end)
            h = end - t;
        for (int i = 0; i < N; i++) z[i] = y[i] + h * 0.2 * q[0][i];
        rate(t + 0.2 * h, z, q[1]);
        for (int i = 0; i < N; i++) z[i] = y[i] + h * (3 / 40. * q[0][i] + 9 / 40. * q[1][i]);
        rate(t + 0.3 * h, z, q[2]);
        for (int i = 0; i < N; i++) z[i] = y[i] + h * (44 / 45. * q[0][i] - 56 / 15. * q[1][i] + 32 / 9. * q[2][i]);
        rate(t + 0.8 * h, z, q[3]);
        for (int i = 0; i < N; i++)
            z[i] = y[i] + h * (19372 / 6561. * q[0][i] - 25360 / 2187. * q[1][i] + 64448 / 6561. * q[2][i]
                               - 212 / 729. * q[3][i]);
        rate(t + 8 / 9. * h, z, q[4]);
        for (int i = 0; i < N; i++)
            z[i] = y[i] + h * (9017 / 3168. * q[0][i] - 355 / 33. * q[1][i] + 46732 / 5247. * q[2][i]
                               + 49 / 176. * q[3][i] - 5103 / 18656. * q[4][i]);
        rate(t + h, z, q[5]);
        for (int i = 0; i < N; i++)
            z[i] = y[i] + h * (35 / 384. * q[0][i] + 500 / 1113. * q[2][i] + 125 / 192. * q[3][i]
                               - 2187 / 6784. * q[4][i] + 11 / 84. * q[5][i]);
        rate(t + h, z, q[6]);
        for (int i = 0; i < N; i++) {
            const double e = h * (71 / 57600. * q[0][i] - 71 / 16695. * q[2][i] + 71 / 1920. * q[3][i]
                                  - 17253 / 339200. * q[4][i] + 22 / 525. * q[5][i] - 1 / 40. * q[6][i]);
            const double w = rtol * (fmax(fabs(y[i]), fabs(z[i])) + 1e-4 * size[i]) + 1e-150;
            sum += e / w * (e / w);
        }
        error = sqrt(sum / N);
        const double factor = fmin(8, fmax(0.1, 0.9 * pow(error, -0.2)));
        if (error <= 1) {
            double deviation[4];
            t += h;
            steps++;
            for (int i = 0; i < N; i++) { y[i] = z[i]; q[0][i] = q[6][i]; }
            for (int i = 0; i < 4; i++) deviation[i] = sqrt(fmax(y[diagonal[i]], 0));
            for (int i = 0; i < 4; i++) size[i] = fmax(size[i], fmax(fabs(y[i]), deviation[i]));
            for (int i = 0; i < 10; i++) size[4 + i] = fmax(size[4 + i], deviation[row[i]] * deviation[column[i]]);
        }
        h *= factor;
    }
    return steps;
}

int main(void)
{
    double y[N];
    long steps = 0;
    const int repeats = 2000;
    const clock_t begin = clock();
    for (int k = 0; k < repeats; k++) {
        for (int i = 0; i < N; i++) y[i] = 0;
        y[11] = 1 / 1.1;
        y[13] = c0 / 1.1;
        steps = run(10, RTOL, y);
    }
    printf("%g %ld %ld %.15g %.15g\n", (double)(clock() - begin) / CLOCKS_PER_SEC / repeats, steps,
           rates / repeats, y[0], y[4]);
    return 0;
}
"""

EXPORTED = r"""
#include <stdio.h>
#include <time.h>
#include "oleo.h"
int main(void)
{
    static oleo_run run;
    double y[OLEO_SIZE];
    const int repeats = 2000;
    const clock_t begin = clock();
    for (int k = 0; k < repeats; k++) {
        oleo_initial(oleo_default_parameters, y);
        oleo_begin(&run, 0, y);
        run.rtol = RTOL;
        if (oleo_propagate(&run, oleo_default_parameters, 10) != OLEO_OK)
            return 1;
    }
    printf("%g %ld %ld %.15g %.15g\n", (double)(clock() - begin) / CLOCKS_PER_SEC / repeats, run.steps,
           run.rates, run.y[0],
           run.y[OLEO_STATES]);
    return 0;
}
"""


def measured(folder: Path, name: str, sources: list[Path], rtol: str) -> list[float]:
    """Seconds a run, steps, rates, mean and variance of x at the end; the fastest of five."""
    command = ["gcc", "-O2", "-std=c99", f"-DRTOL={rtol}", f"-I{folder}", "-o", folder / name, *sources, "-lm"]
    subprocess.run(command, check=True)
    runs = [subprocess.run([folder / name], capture_output=True, text=True, check=True).stdout for _ in range(5)]
    return min([float(number) for number in re.split(r"\s+", run.strip())] for run in runs)


PATHS = 2000
STEPS = (2500, 5000, 10_000)
"""Of a plain path: the ratio depends on them. At the end of the run the ground's filter has 160 a second to follow."""


def paths_seconds(steps: int) -> float:
    """Processor time of plain paths (see `monte_carlo.plain`), compiled before: the least of three."""
    plain(32, steps)
    runs = []
    for _ in range(3):
        begin = process_time()
        plain(PATHS, steps)
        runs.append(process_time() - begin)
    return min(runs)


def paths_table() -> dict[int, float]:
    """Seconds of the paths; prints what their step and what chance makes of the mean and the variance."""
    chance = np.array([PATHS**-0.5, (2 / PATHS) ** 0.5])  # of the deviation, and of the variance
    found = {}
    print(f"{PATHS} plain paths; error of mean (beside the deviation) and variance: of the step, of chance")
    for steps, (error, _) in step_errors(plain_pairs, 2 * PATHS).items():
        if steps in STEPS:
            found[steps] = paths_seconds(steps)
            (m, v), (cm, cv) = 100 * error, 100 * chance
            much = "below" if (abs(error) < chance).all() else "ABOVE"
            print(f"  {steps} steps {found[steps]:.3f} s: {m:+.1f} %, {v:+.1f} %; {cm:.1f} %, {cv:.1f} %: {much} chance")
    return dict(sorted(found.items()))


def figure_3(place: Path) -> None:
    """By hand and exported at two tolerances, and the paths beside them."""
    compiled = cs.compile(ROOT / "models" / "oleo_acceleration.toml")
    exact = compiled.propagate(rtol=1e-11)
    folder = compiled.export_c(place / "c", prefix="oleo")
    library = [path for path in folder.glob("*.c") if path.name not in ("main.c", "test.c")]
    (folder / "hand_main.c").write_text(HAND)
    (folder / "exported_main.c").write_text(EXPORTED)
    paths = paths_table()
    for rtol in ("1e-6", "1e-3"):
        hand = measured(folder, "hand", [folder / "hand_main.c"], rtol)
        exported = measured(folder, "exported", [*library, folder / "exported_main.c"], rtol)
        for name, (seconds, steps, rates, mean, variance) in (("by hand", hand), ("exported", exported)):
            off = [abs(mean / exact.mean["x"][-1] - 1), abs(variance / exact.variance["x"][-1] - 1)]
            work = f"{1e3 * seconds:.3f} ms  {steps:.0f} steps  {rates:.0f} rates"
            print(f"rtol {rtol}  {name:10} {work}  error of mean {off[0]:.1e}, of variance {off[1]:.1e}")
            ratios = ", ".join(f"{each / seconds:.0f} ({n} steps)" for n, each in paths.items())
            print(f"    {PATHS} paths / run: {ratios}")
        print(f"rtol {rtol}  exported / by hand {exported[0] / hand[0]:.2f}")


def large(place: Path) -> None:
    """Seconds of the processor to export, and to compile at -O1."""
    for name, model in (("half car", ROOT / "models" / "half_car_acceleration.toml"), ("30 states", car(30))):
        compiled = cs.compile(model)
        begin = process_time()
        folder = compiled.export_c(place / name.replace(" ", "_"), prefix="large")
        exported = process_time() - begin
        sources = sorted(path for path in folder.glob("*.c") if path.name != "test.c")
        begin = getrusage(RUSAGE_CHILDREN).ru_utime
        subprocess.run(["gcc", "-O1", "-std=c99", f"-I{folder}", "-o", folder / "large", *sources, "-lm"], check=True)
        text = sum(path.stat().st_size for path in folder.iterdir() if path.suffix in (".c", ".h")) / 1e6
        size = f"{len(compiled.states)} states, {compiled.packing.size} equations, {text:.1f} MB"
        print(f"{name}: {size}; export {exported:.1f} s, compile {getrusage(RUSAGE_CHILDREN).ru_utime - begin:.1f} s")


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        figure_3(Path(place))
        large(Path(place))


if __name__ == "__main__":
    main()
