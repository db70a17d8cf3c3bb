"""Backward differentiation formulas of order 1 to 5, written to run as machine code, for the moments of a stiff system.

The quasi-constant steps and the modified formulas (NDF) of Shampine & Reichelt, SIAM J. Sci. Comput. 18, 1 (1997). The
implicit equations of a step are solved by a simplified Newton method with the inverse of I - g L, where L is what the moment
equations do to a small change while the equivalent gains stay put (see `implicit`): products of n x n matrices, and no matrix
of n (n + 3) / 2 rows. What L leaves out, how the gains answer, Broyden's updates of the inverse learn from the iterations
(Math. Comp. 19, 577 (1965)): it is of low rank, and where friction holds two masses together as large as L itself.
For `lowering.kernel`.
"""

from __future__ import annotations

from cadet_sym.lowering.kernel import Function, Vector, isfinite, part, sqrt
from cadet_sym.solve.breakdown import STALLED, TOO_MANY
from cadet_sym.solve.improved import MATRICES, PAIRS, apply, improve, invert, learn, upper, weigh

__all__ = ["HEAD", "PROCEDURES", "REFRESH", "STATE", "carry", "room_of"]

HIGHEST = 5  # order
ROWS = HIGHEST + 3  # of backward differences
VECTORS = ROWS + 7 + 2 * PAIRS  # of working space, as long as y

HEAD, LINE = 16, 8
"""Numbers before them, the time and from the second line on sums; and in a line of the processor's cache."""

STATE = 15
"""Numbers that last from call to call: time, step, order, equal steps, then as `carry` says."""

REFRESH = 9
"""What `carry` returns where it wants another modal form of N."""

GAMMA = (0.0, 1.0, 1.5, 1.8333333333333333, 2.0833333333333335, 2.2833333333333333)
KAPPA = (0.0, -0.1850, -0.1111111111111111, -0.0823, -0.0415, 0.0)
"""The modification of the formula of each order; none is best for order 5."""

ITERATIONS = 5
"""Of Newton's method, at most ..."""

CONVERGED = 0.05
"""... until what is left is this share of what a step may err by."""

AGEING, QUICKEST = 10.0, 1e-5
"""What was seen of Newton's convergence, at best the second, is worth so many times less after each other length of step."""

STALE = 0.3
"""Where an iteration leaves more than this of what is wrong, the form of another place does not serve any longer."""


NEAR = 256
"""Entries of all differences that are worked on at once: as many as the nearest part of the processor's cache holds."""


def room_of(size: int, n: int) -> int:
    """Numbers of working space for vectors of a size and n states."""
    return HEAD + VECTORS * (-(-size // LINE) * LINE) + MATRICES * n * n + 2 * n + 152


def predict(differences: Vector, order: int, alpha: float, size: int, value: Vector, known: Vector) -> int:
    """Where the differences lead at the end of a step, and what the formula takes of them."""
    begin = 0
    while begin < size:
        end = min(begin + NEAR, size)
        for i in range(begin, end):
            value[i] = differences[i]
            known[i] = 0.0
        for k in range(1, order + 1):
            row = part(differences, k * size)
            weight = GAMMA[k] / alpha
            for i in range(begin, end):
                value[i] += row[i]
                known[i] += weight * row[i]
        begin = end
    return 0


def advance(differences: Vector, order: int, size: int, change: Vector) -> int:
    """The differences at the end of a step that was changed so from where they led; `change` is used up."""
    last = part(differences, (order + 1) * size)
    ahead = part(differences, (order + 2) * size)
    begin = 0
    while begin < size:
        end = min(begin + NEAR, size)
        for i in range(begin, end):
            ahead[i] = change[i] - last[i]
            last[i] = change[i]
        k = order
        while k >= 0:
            row = part(differences, k * size)
            for i in range(begin, end):
                change[i] += row[i]
                row[i] = change[i]
            k -= 1
        begin = end
    return 0


def rescale(differences: Vector, order: int, factor: float, size: int, small: Vector, room: Vector) -> int:
    """Backward differences of steps that are `factor` as long; room : for order + 1 of them."""
    across = order + 1
    change = small
    unit = part(small, 36)
    both = part(small, 72)
    for j in range(across):
        change[j] = 1.0
        unit[j] = 1.0
    for i in range(1, across):
        for j in range(across):
            change[i * across + j] = change[(i - 1) * across + j] * (float(i - 1) - factor * float(j)) / float(i)
            unit[i * across + j] = unit[(i - 1) * across + j] * (float(i - 1) - float(j)) / float(i)
    for i in range(across):
        for j in range(across):
            total = 0.0
            for k in range(across):
                total += change[i * across + k] * unit[k * across + j]
            both[i * across + j] = total
    for e in range(across * size):
        room[e] = differences[e]
        differences[e] = 0.0
    for j in range(across):
        row = part(differences, j * size)
        for i in range(across):
            weight = both[i * across + j]
            other = part(room, i * size)
            if weight != 0.0:
                for e in range(size):
                    row[e] += weight * other[e]
    return 0


def share(x: Vector, allowed: Vector, size: int, sums: Vector) -> float:
    """Root mean square of x over what it may be; `allowed` holds inverses."""
    for k in range(LINE):  # as many sums, none of which waits for another
        sums[k] = 0.0
    for block in range(size // LINE):
        these = part(x, block * LINE)
        weights = part(allowed, block * LINE)
        for k in range(LINE):
            sums[k] += (these[k] * weights[k]) * (these[k] * weights[k])
    total = 0.0
    for k in range(LINE):
        total += sums[k]
    for i in range(size // LINE * LINE, size):
        total += (x[i] * allowed[i]) * (x[i] * allowed[i])
    return sqrt(total / float(size))


NOISE = 1e-6
"""Less of what a step may err by is no matter of convergence any more."""

SHORTEST = 1e-14
"""First step over the time, at least: where rates are so large that none is short enough, one of them has to be tried."""

def carry(
    rate: Function, multiply: Function, grid: Vector, points: int, y: Vector, size: int, n: int, p: Vector, sizes: Vector,
    relative: float, absolute: float, latest: float, most: int, form: Vector, modes: Vector, pairs: int, work: Vector,
    found: Vector, state: Vector, blocks: int,
) -> int:
    """Carry y from the time in `state` through the times of the grid, of which the last ends the stretch.

    Parameters
    ----------
    y : (size,) where it starts; afterwards where it is: the packed moments of n states, and their derivatives along so many
        directions that there are `blocks` of them.
    sizes : (size,) of every entry; a step may err by relative (|y| + absolute sizes).
    latest : the last time at which the inputs are those of this stretch.
    form, modes, pairs : the modal form of N (see `weigh` and `invert`), and 1 if any of the modes is one of a pair.
    multiply : see `invert`.
    work : as many zeros as `room_of` says. found : (points, size), one after the other.
    state : (STATE,) time, step, order, equal steps, steps, steps refused, rates, points found, whether the form is of here,
        the g of the weights, how fast Newton's method converged, whether it has begun, updates of the inverse,
        whether gains react strongly, whether it was seen with these weights how fast Newton's method converges.

    Returns
    -------
    0; TOO_MANY steps; STALLED, where they shrink to nothing; or REFRESH: call again with another form.
    """
    wide = (size + LINE - 1) // LINE * LINE  # all vectors begin where a line does
    sums = part(work, LINE)
    differences = part(work, HEAD)
    change = part(differences, ROWS * wide)
    value = part(change, wide)
    slope = part(value, wide)
    move = part(slope, wide)
    known = part(move, wide)
    allowed = part(known, wide)
    earlier = part(allowed, wide)
    updates = part(earlier, wide)
    room = part(updates, 2 * PAIRS * wide)
    along_room = MATRICES * n * n + 2 * n + 3
    small = part(room, along_room)
    last = grid[points - 1]
    t = state[0]
    h = state[1]
    order = int(state[2])
    if state[11] == 0.0:
        work[0] = t
        rate(work, y, p, slope)
        state[6] += 1.0
        total = 0.0
        for i in range(size):
            one = slope[i] / (relative * (abs(y[i]) + absolute * sizes[i]))
            total += one * one
        steep = sqrt(total / float(size))
        h = last - t
        if steep * h > 0.1:
            h = max(0.1 / steep, SHORTEST * t)
        if not isfinite(steep):
            return STALLED
        order = 1
        for i in range(size):
            differences[i] = y[i]
            differences[wide + i] = h * slope[i]
        state[3] = 0.0
        state[9] = -1.0
        state[11] = 1.0
    while state[4] + state[5] < float(most):
        if t + h >= last or t + 1.0001 * h >= last:
            rescale(differences, order, (last - t) / h, wide, small, change)
            h = last - t
            state[3] = 0.0
        state[0] = t
        state[1] = h
        state[2] = float(order)
        if t + 0.1 * h <= t:
            return STALLED
        ends = t + 1.0001 * h >= last
        after = last if ends else t + h
        alpha = (1.0 - KAPPA[order]) * GAMMA[order]
        predict(differences, order, alpha, wide, value, known)
        for i in range(size):
            change[i] = 0.0
            allowed[i] = 1.0 / (relative * (abs(value[i]) + absolute * sizes[i]))
        g = h / alpha
        least = 1
        if g != state[9]:
            weigh(room, part(room, MATRICES * n * n), modes, n, g)
            if state[9] > 0.0:
                state[10] = min(1.0, AGEING * max(state[10], QUICKEST) * max(1.0, g / state[9]))
            else:
                state[10] = 1.0
                least = 2  # or what an outdated form calls small would pass for converged
            state[9] = g
            state[14] = 0.0
        work[0] = min(after, latest)
        before = 0.0
        converged = False
        tries = 0
        for k in range(ITERATIONS):
            rate(work, value, p, slope)
            state[6] += 1.0
            tries += 1
            for i in range(size):
                slope[i] = g * slope[i] - known[i] - change[i]
            for block in range(blocks):  # what moments do to their derivatives is left out
                at = block * (size // blocks)
                invert(multiply, part(slope, at), part(move, at), size // blocks, n, form, modes, pairs, room)
            improve(updates, int(state[12]), move, size)
            length = share(move, allowed, size, sums)
            if not isfinite(length):
                break
            left = 1.0
            if k > 0:
                left = min(1.0, length / before)
                if length > 2.0 * before:
                    break
                state[10] = max(0.3 * state[14] * state[10], length / before)
                state[14] = 1.0
                if length > STALE * before and before > NOISE:
                    if state[8] == 0.0 and (k > 1 or state[12] == 0.0):
                        break
                    if int(state[12]) < PAIRS:  # where a fresh form does no better
                        state[12] = float(learn(updates, int(state[12]), earlier, move, allowed, size))
                        length = share(move, allowed, size, sums)
            for i in range(size):
                value[i] += move[i]
                change[i] += move[i]
                earlier[i] = move[i]
            if state[13] + state[12] > 0.0:  # gains that react may be others by now: only this step's iterations tell
                if length < NOISE or (k > 0 and length * left < CONVERGED * (1.0 - left)):
                    converged = True
                    break
            elif tries >= least and length * min(1.0, state[10]) < CONVERGED:
                converged = True
                break
            before = length
        if not converged:
            if state[8] == 0.0:
                for i in range(size):
                    y[i] = differences[i]
                return REFRESH
            state[12] = 0.0
            state[5] += 1.0
            rescale(differences, order, 0.5, wide, small, change)
            h *= 0.5
            state[3] = 0.0
            continue
        safety = 0.9 * float(2 * ITERATIONS + 1) / float(2 * ITERATIONS + tries)
        constant = KAPPA[order] * GAMMA[order] + 1.0 / float(order + 1)
        wrong = constant * share(change, allowed, size, sums)
        wrong = abs(wrong)
        if wrong > 1.0:
            state[5] += 1.0
            factor = max(0.2, safety * wrong ** (-1.0 / float(order + 1)))
            rescale(differences, order, factor, wide, small, change)
            h *= factor
            state[3] = 0.0
            continue
        state[4] += 1.0
        state[3] += 1.0
        state[8] = 0.0
        t = after
        advance(differences, order, wide, change)
        point = int(state[7])
        while point < points and grid[point] <= t:
            row = part(found, point * size)
            for i in range(size):
                row[i] = differences[i]
            weight = 1.0
            for k in range(order):
                weight *= (grid[point] - (t - h * float(k))) / (h * float(k + 1))
                for i in range(size):
                    row[i] += weight * differences[(k + 1) * wide + i]
            point += 1
        state[7] = float(point)
        if point == points:
            state[0] = t
            for i in range(size):
                y[i] = differences[i]
            return 0
        if state[3] < float(order + 1):
            continue
        best = wrong ** (-1.0 / float(order + 1)) if wrong > 1e-10 else 1e3
        higher = order
        if order > 1:
            lower_wrong = abs(KAPPA[order - 1] * GAMMA[order - 1] + 1.0 / float(order)) * share(
                part(differences, order * wide), allowed, size, sums
            )
            lower = lower_wrong ** (-1.0 / float(order)) if lower_wrong > 1e-10 else 1e3
            if lower > best:
                best = lower
                higher = order - 1
        if order < HIGHEST:
            upper_wrong = abs(KAPPA[order + 1] * GAMMA[order + 1] + 1.0 / float(order + 2)) * share(
                part(differences, (order + 2) * wide), allowed, size, sums
            )
            upper = upper_wrong ** (-1.0 / float(order + 2)) if upper_wrong > 1e-10 else 1e3
            if upper > best:
                best = upper
                higher = order + 1
        order = higher
        factor = min(10.0, safety * best)
        rescale(differences, order, factor, wide, small, change)
        h *= factor
        state[3] = 0.0
    return TOO_MANY


PROCEDURES = (weigh, apply, upper, invert, predict, advance, rescale, share, improve, learn, carry)
"""What is compiled together."""
