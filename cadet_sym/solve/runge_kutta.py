"""An explicit Runge-Kutta pair of order 8 with error estimates of order 5 and 3, written to run as machine code.

DOP853 of Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, section II.10 (the pair of
Prince & Dormand, J. Comput. Appl. Math. 7, 67, 1981). Steps end at the output times: where stability, not accuracy, limits
the step, no interpolation within it would be as good as its end. For `lowering.kernel`.
"""

from __future__ import annotations

from cadet_sym.lowering.kernel import Function, Vector, isfinite, part, sqrt

__all__ = ["PROCEDURES", "REPORT", "STALLED", "TOO_MANY", "WORK", "march"]

STAGES = 12

WORK = STAGES + 3
"""Vectors of working space."""

REPORT = 4
"""What is reported: time reached, steps, steps refused, rates."""

TOO_MANY, STALLED = 1, 2
"""What `march` returns where it gives up."""

PLACES = (
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333,
    0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0,
)
"""Where in the step each stage is."""

WEIGHTS = (
    0.05260015195876773, 0.0197250569845379, 0.0591751709536137, 0.02958758547680685, 0.0, 0.08876275643042054,
    0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792, 0.037037037037037035, 0.0, 0.0,
    0.17082860872947386, 0.12546768756682242, 0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596,
    -0.017578125, 0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328,
    -0.015319437748624402, 0.008273789163814023, 0.6241109587160757, 0.0, 0.0, -3.3608926294469414,
    -0.868219346841726, 27.59209969944671, 20.154067550477894, -43.48988418106996, 0.47766253643826434, 0.0,
    0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423, -33.28821096898486,
    -0.020331201708508627, -0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295,
    -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196,
    2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996,
    -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636, 0.054293734116568765, 0.0,
    0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199,
    -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
)
"""Of the stages before it, stage after stage: those of stage k begin at k (k - 1) / 2; last, those of the result."""

FIFTH = (
    0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
    -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294,
)
"""What the result of order 5 differs by, for each stage."""

THIRD = (
    -0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
    -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082,
)
"""The same of order 3."""



def combine(out: Vector, y: Vector, slopes: Vector, stage: int, h: float, n: int) -> int:
    """Set out = y + h sum of the slopes before a stage, by their weights."""
    first = stage * (stage - 1) // 2
    for i in range(n):
        out[i] = y[i]
    for j in range(stage):
        weight = h * WEIGHTS[first + j]
        if weight != 0.0:
            slope = part(slopes, j * n)
            for i in range(n):
                out[i] += weight * slope[i]
    return 0


def error(
    y: Vector, end: Vector, slopes: Vector, size: Vector, relative: float, absolute: float, h: float, n: int
) -> float:
    """Error of a step over what it may be: Hairer's mean of those of order 5 and of order 3."""
    fifth = 0.0
    third = 0.0
    for i in range(n):
        a = 0.0
        b = 0.0
        for j in range(STAGES):
            a += FIFTH[j] * slopes[j * n + i]
            b += THIRD[j] * slopes[j * n + i]
        allowed = relative * (max(abs(y[i]), abs(end[i])) + absolute * size[i])
        fifth += (a / allowed) * (a / allowed)
        third += (b / allowed) * (b / allowed)
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return h * fifth / sqrt((fifth + 0.01 * third) * float(n))


def norm(x: Vector, y: Vector, size: Vector, relative: float, absolute: float, n: int) -> float:
    """Root mean square of x over what a step from y may err by."""
    total = 0.0
    for i in range(n):
        share = x[i] / (relative * (abs(y[i]) + absolute * size[i]))
        total += share * share
    return sqrt(total / float(n))


def first_step(
    rate: Function, t: float, y: Vector, p: Vector, size: Vector, relative: float, absolute: float, longest: float,
    clock: Vector, trial: Vector, slope: Vector, n: int,
) -> float:
    """Length of a first step, from the rate and its change (Hairer, Norsett & Wanner, section II.4)."""
    value = norm(y, y, size, relative, absolute, n)
    steep = norm(slope, y, size, relative, absolute, n)
    h = 1e-6 * longest
    if value > 1e-5 and steep > 1e-5:
        h = min(0.01 * value / steep, longest)
    for i in range(n):
        trial[i] = y[i] + h * slope[i]
    clock[0] = t + h
    change = part(trial, n)
    rate(clock, trial, p, change)
    for i in range(n):
        change[i] -= slope[i]
    steep = max(steep, norm(change, y, size, relative, absolute, n) / h)
    if not isfinite(steep):
        return 1e-6 * longest
    if steep <= 1e-15:
        return min(100.0 * h, longest)
    return min(min(100.0 * h, (0.01 / steep) ** 0.125), longest)


def march(
    rate: Function, begin: float, grid: Vector, points: int, y: Vector, n: int, p: Vector, size: Vector,
    relative: float, absolute: float, latest: float, most: int, work: Vector, found: Vector, report: Vector,
) -> int:
    """Carry y from `begin` through the times of the grid, of which the last ends the stretch.

    Parameters
    ----------
    rate : writes dy/dt at (t, y, p).
    y : (n,) where it starts; where it arrived, afterwards.
    size : (n,) of every entry; a step may err by relative (|y| + absolute size).
    latest : the last time at which the inputs are those of this stretch.
    most : steps.
    work : (WORK n + 1,). found : (points, n), one after the other. report : (REPORT,).

    Returns
    -------
    0; TOO_MANY steps; or STALLED, where they shrink to nothing.
    """
    slopes = part(work, 1)
    end = part(slopes, (STAGES + 1) * n)
    trial = part(end, n)
    t = begin
    known = 0
    work[0] = t
    rate(work, y, p, slopes)
    h = first_step(rate, t, y, p, size, relative, absolute, grid[points - 1] - begin, work, end, slopes, n)
    report[3] += 2.0
    before = 1.0
    for _step in range(most + 1):  # the last only to write down where the steps led
        report[0] = t
        while t + 0.1 * (grid[known] - t) <= t:  # here, or nearer than a step can be
            row = part(found, known * n)
            for i in range(n):
                row[i] = y[i]
            known += 1
            if known == points:
                return 0
        rest = grid[known] - t
        taken = h
        if h >= rest:
            taken = rest
        elif 2.0 * h > rest:
            taken = 0.5 * rest
        if t + 0.1 * taken <= t:
            return STALLED
        for stage in range(1, STAGES):
            combine(trial, y, slopes, stage, taken, n)
            work[0] = min(t + PLACES[stage] * taken, latest)
            rate(work, trial, p, part(slopes, stage * n))
        combine(end, y, slopes, STAGES, taken, n)
        report[3] += float(STAGES - 1)
        wrong = error(y, end, slopes, size, relative, absolute, taken, n)
        if not wrong <= 1.0:  # or no number
            report[2] += 1.0
            h = taken * (max(0.2, 0.9 * wrong**-0.125) if isfinite(wrong) else 0.1)
            continue
        factor = 6.0
        if wrong > 1e-10:
            factor = min(6.0, max(0.2, 0.9 * wrong**-0.0875 * before**0.05))
        before = max(wrong, 1e-4)
        t = grid[known] if taken == rest else t + taken
        work[0] = min(t, latest)
        rate(work, end, p, part(slopes, STAGES * n))
        report[1] += 1.0
        report[3] += 1.0
        for i in range(n):
            y[i] = end[i]
            slopes[i] = slopes[STAGES * n + i]
        if taken == h or factor * taken > h:  # a step cut short says little about the next
            h = factor * taken
    return TOO_MANY


PROCEDURES = (combine, error, norm, first_step, march)
"""What is compiled together."""
