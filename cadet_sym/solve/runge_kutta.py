"""Embedded explicit Runge-Kutta pairs with control of the step, written to run as machine code.

Steps end at the output times: where stability, not accuracy, limits the step, no interpolation within it would be as good as
its end. Of two pairs, one of high order and one that is stable for long, the run is carried by the one that comes further for
the same number of rates: from time to time the other has a few steps to show what it can do. For `lowering.kernel`.
"""

from __future__ import annotations

from cadet_sym.lowering.kernel import Function, Vector, isfinite, part, sqrt
from cadet_sym.solve.breakdown import NOT_FINITE, STALLED, TOO_MANY
from cadet_sym.solve.tableaux import BEGINS, GROUP, LONG, MOST_STAGES, PLACES

__all__ = ["HEAD", "LANES", "PROCEDURES", "REPORT", "WORK", "march", "march_all"]

LANES = 4
"""Vectors are as long as a multiple of this, and worked on so many numbers at a time; more, once compiled for long ones."""

WORK = MOST_STAGES + 4
"""Vectors of working space ..."""

SUMS, CONTEST, HEAD = 8, 16, 32
"""... behind so many numbers: the time, what is summed up lane by lane, and how the pairs compete."""

REPORT = 6
"""What is reported: time reached, steps, steps refused, rates, output times reached, and how it ended."""

HOLDER, PLAYER, RATES, LENGTH, WAIT, CAME, COUNTED, BEST, KEPT, CHALLENGER = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
"""How the pairs compete: who carries the run, whose turn it is, its rates in this turn of how many, how many the holder has
undisturbed; how far it came with so many rates in the second half of the turn, which counts; what there is to beat, and the
step to go back to."""

FIRST_WAIT, LONGEST_WAIT, TRIAL = 384.0, 3072.0, 96.0
"""Rates of the holder's turn at first and at most, and of a challenger's."""

BETTER = 1.05
"""How much further a challenger must come."""


def combine(out: Vector, share: float, y: Vector, slopes: Vector, table: Vector, row: int, h: float, n: int) -> int:
    """Set out = share y + h sum of the slopes by the weights of a row of the pair; returns 0 if there are none."""
    first = int(table[BEGINS + row])
    last = int(table[BEGINS + row + 1])
    at = first
    while at < last:
        group = part(table, at)
        a = part(slopes, int(group[0]) * n)
        b = part(slopes, int(group[1]) * n)
        c = part(slopes, int(group[2]) * n)
        d = part(slopes, int(group[3]) * n)
        wa = h * group[GROUP]
        wb = h * group[GROUP + 1]
        wc = h * group[GROUP + 2]
        wd = h * group[GROUP + 3]
        for block in range(n // LANES):
            i = LANES * block
            some = part(out, i)
            before = part(y, i)
            sa = part(a, i)
            sb = part(b, i)
            sc = part(c, i)
            sd = part(d, i)
            if at == first:
                for k in range(LANES):
                    some[k] = share * before[k] + ((wa * sa[k] + wb * sb[k]) + (wc * sc[k] + wd * sd[k]))
            else:
                for k in range(LANES):
                    some[k] += (wa * sa[k] + wb * sb[k]) + (wc * sc[k] + wd * sd[k])
        at += 2 * GROUP
    return last - first


def squares(
    x: Vector, y: Vector, end: Vector, size: Vector, relative: float, absolute: float, lanes: Vector, n: int
) -> float:
    """Sum of the squares of x over what a step from y to `end` may err by."""
    for k in range(LANES):
        lanes[k] = 0.0
    for block in range(n // LANES):
        i = LANES * block
        wrong = part(x, i)
        before = part(y, i)
        after = part(end, i)
        large = part(size, i)
        for k in range(LANES):
            share = wrong[k] / (relative * (max(abs(before[k]), abs(after[k])) + absolute * large[k]))
            lanes[k] += share * share
    total = 0.0
    for k in range(LANES):
        total += lanes[k]
    return total


def error(
    y: Vector, end: Vector, slopes: Vector, size: Vector, relative: float, absolute: float, table: Vector, h: float,
    wrong: Vector, lanes: Vector, n: int, entries: int,
) -> float:
    """Error of a step over what it may be (see `tableaux.Pair`)."""
    row = int(table[0])
    combine(wrong, 0.0, y, slopes, table, row, 1.0, n)
    first = squares(wrong, y, end, size, relative, absolute, lanes, n)
    damped = first
    if combine(wrong, 0.0, y, slopes, table, row + 1, 1.0, n) > 0:
        damped += 0.01 * squares(wrong, y, end, size, relative, absolute, lanes, n)
    if damped == 0.0:
        return 0.0
    return h * first / sqrt(damped * float(entries))


def first_step(
    rate: Function, t: float, y: Vector, p: Vector, size: Vector, relative: float, absolute: float, longest: float,
    power: float, clock: Vector, trial: Vector, change: Vector, slope: Vector, lanes: Vector, n: int, entries: int,
) -> float:
    """Length of a first step, from the rate and its change (Hairer, Norsett & Wanner, section II.4)."""
    value = sqrt(squares(y, y, y, size, relative, absolute, lanes, n) / float(entries))
    steep = sqrt(squares(slope, y, y, size, relative, absolute, lanes, n) / float(entries))
    h = 1e-6 * longest
    if value > 1e-5 and steep > 1e-5:
        h = min(0.01 * value / steep, longest)
    for i in range(n):
        trial[i] = y[i] + h * slope[i]
    clock[0] = t + h
    rate(clock, trial, p, change)
    for i in range(n):
        change[i] -= slope[i]
    steep = max(steep, sqrt(squares(change, y, y, size, relative, absolute, lanes, n) / float(entries)) / h)
    if not isfinite(steep):
        return 1e-6 * longest
    if steep <= 1e-15:
        return min(100.0 * h, longest)
    return min(min(100.0 * h, (0.01 / steep) ** power), longest)


def compete(contest: Vector, pairs: int, taken: float, spent: float, h: float) -> float:
    """The step to go on with, and whose it is, after one of length `taken` that took `spent` rates."""
    contest[RATES] += spent
    if contest[RATES] > 0.5 * contest[LENGTH]:
        contest[CAME] += taken
        contest[COUNTED] += spent
    if contest[RATES] < contest[LENGTH]:
        return h
    speed = contest[CAME] / contest[COUNTED]
    if contest[PLAYER] == contest[HOLDER]:
        contest[BEST] = speed
        contest[KEPT] = h
        following = (int(contest[CHALLENGER]) + 1) % pairs
        if following == int(contest[HOLDER]):
            following = (following + 1) % pairs
        contest[CHALLENGER] = float(following)
        contest[PLAYER] = contest[CHALLENGER]
        contest[LENGTH] = TRIAL
    else:
        if speed > BETTER * contest[BEST]:
            contest[HOLDER] = contest[PLAYER]
            contest[WAIT] = FIRST_WAIT
        else:
            contest[PLAYER] = contest[HOLDER]
            contest[WAIT] = min(2.0 * contest[WAIT], LONGEST_WAIT)
            h = contest[KEPT]
        contest[LENGTH] = contest[WAIT]
    contest[RATES] = 0.0
    contest[CAME] = 0.0
    contest[COUNTED] = 0.0
    return h


def march(
    rate: Function, begin: float, end: float, grid: Vector, points: int, y: Vector, n: int, entries: int, p: Vector,
    size: Vector, relative: float, absolute: float, latest: float, most: int, tables: Vector, pairs: int, work: Vector,
    found: Vector, whole: int, places: Vector, report: Vector,
) -> int:
    """Carry y from `begin` to `end` through the times of the grid, which lie between.

    Parameters
    ----------
    rate : writes dy/dt at (t, y, p); of the entries, and leaves what is behind them.
    y : (n,) where it starts; where it arrived, afterwards. n is the next multiple of LANES, the rest is zero.
    entries : of y.
    size : (n,) of every entry; a step may err by relative (|y| + absolute size). Not zero.
    latest : the last time at which the inputs are those of this stretch.
    most : steps.
    tables, pairs : one packed pair, or two that compete, of which the first begins.
    work : (WORK n + HEAD,) of which what is behind the entries of a vector is zero.
    found : (points, whole), one after the other. places : (entries,) in a row of it.
    report : (REPORT,) that goes on.

    Returns
    -------
    0; TOO_MANY steps; STALLED, where they shrink to nothing; or NOT_FINITE.
    """
    lanes = part(work, SUMS)
    contest = part(work, CONTEST)
    slopes = part(work, HEAD)
    ahead = part(slopes, (MOST_STAGES + 1) * n)
    trial = part(ahead, n)
    table = tables
    for k in range(HEAD):
        work[k] = 0.0
    contest[WAIT] = FIRST_WAIT
    contest[LENGTH] = FIRST_WAIT
    t = begin
    known = 0
    work[0] = t
    rate(work, y, p, slopes)
    longest = end - begin
    h = first_step(
        rate, t, y, p, size, relative, absolute, longest, table[1], work, ahead, trial, slopes, lanes, n, entries
    )
    report[3] += 2.0
    before = 1.0
    spent = 0.0
    for _step in range(most + 1):  # the last only to write down where the steps led
        report[0] = t
        goal = end
        while known < points and t + 0.1 * (grid[known] - t) <= t:  # here, or nearer than a step can be
            row = part(found, known * whole)
            for i in range(entries):
                row[int(places[i])] = y[i]
                if not isfinite(y[i]):
                    return NOT_FINITE
            known += 1
            report[4] += 1.0
        if known < points:
            goal = grid[known]
        elif t + 0.1 * (end - t) <= t:
            for i in range(entries):
                if not isfinite(y[i]):
                    return NOT_FINITE
            return 0
        if _step == most:  # or y would be a step ahead of the time that is reported
            break
        rest = goal - t
        taken = h
        if h >= rest:
            taken = rest
        elif 2.0 * h > rest:
            taken = 0.5 * rest
        if t + 0.1 * taken <= t:
            return STALLED
        stages = int(table[0])
        power = table[1]
        for stage in range(1, stages):
            combine(trial, 1.0, y, slopes, table, stage - 1, taken, n)
            work[0] = min(t + table[PLACES + stage - 1] * taken, latest)
            rate(work, trial, p, part(slopes, stage * n))
        combine(ahead, 1.0, y, slopes, table, stages - 1, taken, n)
        after = goal if taken == rest else t + taken
        work[0] = min(after, latest)
        last = part(slopes, stages * n)
        rate(work, ahead, p, last)
        report[3] += float(stages)
        spent += float(stages)
        wrong = error(y, ahead, slopes, size, relative, absolute, table, taken, trial, lanes, n, entries)
        if not wrong <= 1.0:  # or no number
            report[2] += 1.0
            h = taken * (max(0.2, 0.9 * wrong**-power) if isfinite(wrong) else 0.1)
            continue
        factor = 6.0
        if wrong > 1e-10:
            factor = min(6.0, max(0.2, 0.9 * wrong ** (-0.7 * power) * before ** (0.4 * power)))
        before = max(wrong, 1e-4)
        t = after
        report[1] += 1.0
        for i in range(n):
            y[i] = ahead[i]
            slopes[i] = last[i]
        if taken == h or factor * taken > h:  # a step cut short says little about the next
            h = factor * taken
        if pairs > 1:
            h = compete(contest, pairs, taken, spent, h)
            table = part(tables, int(contest[PLAYER]) * LONG)
        spent = 0.0
    return TOO_MANY


def march_all(
    rate: Function, runs: int, grid: Vector, points: int, y: Vector, whole: int, places: Vector, entries: int, n: int,
    p: Vector, numbers: int, size: Vector, stride: int, relative: float, absolute: float, travel: Vector, most: int,
    tables: Vector, pairs: int, work: Vector, found: Vector, reports: Vector,
) -> int:
    """Carry many runs through the same times, each stretch by stretch.

    Parameters
    ----------
    rate : as `march` takes it, with [p; what does not move] for p.
    grid : (points,) of the outputs, from 0 on.
    y : (runs, whole) where each starts; where it arrived, afterwards.
    places : (whole,) in a row of y of the entries that move, then of those that stay as they are.
    p : (runs, numbers).
    size : (whole,) of every moment, those of the next run `stride` numbers further.
    travel : of one run after the other the number of its stretches, then begin, end and latest time of each.
    work : (WORK n + HEAD + n + numbers + whole,) of zeros.
    found : (runs, points, whole). reports : (runs, REPORT) of zeros; what is found of a run that is given up ends there.

    Returns
    -------
    0; how every run ended is in its report.
    """
    state = part(work, HEAD + (WORK - 1) * n)
    own = part(state, n)
    given = part(own, n)
    for i in range(n):
        own[i] = 1.0
    at = 0
    for run in range(runs):
        start = part(y, run * whole)
        rows = part(found, run * points * whole)
        report = part(reports, run * REPORT)
        for i in range(entries):
            state[i] = start[int(places[i])]
            own[i] = size[run * stride + int(places[i])]
        for i in range(numbers):
            given[i] = p[run * numbers + i]
        for i in range(entries, whole):
            held = int(places[i])
            given[numbers + i - entries] = start[held]
            for k in range(points):
                rows[k * whole + held] = start[held]
        known = 0
        if grid[0] == 0.0:
            for i in range(whole):
                rows[i] = start[i]
            known = 1
            report[4] = 1.0
        status = 0
        stretches = int(travel[at])
        at += 1
        for _stretch in range(stretches):
            stretch = part(travel, at)
            inside = known
            while inside < points and grid[inside] <= stretch[1]:
                inside += 1
            if status == 0 and stretch[1] > stretch[0]:
                status = march(
                    rate, stretch[0], stretch[1], part(grid, known), inside - known, state, n, entries, given, own, relative,
                    absolute, stretch[2], most, tables, pairs, work, part(rows, known * whole), whole, places, report,
                )  # fmt: skip
            known = inside
            at += 3
        report[5] = float(status)
        for i in range(entries):
            start[int(places[i])] = state[i]
    return 0


PROCEDURES = (combine, squares, error, first_step, compete, march, march_all)
"""What is compiled together."""
