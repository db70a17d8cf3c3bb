"""The inverse of I - g L as machine code, and what Broyden's updates make of it; see `implicit` and `backward`.

For `lowering.kernel`.
"""

from __future__ import annotations

from cadet_sym.lowering.kernel import Function, Vector, part

__all__ = ["MATRICES", "PAIRS", "improve", "invert", "learn", "weigh"]

PAIRS = 6
"""Updates at most."""

MATRICES = 7
"""Matrices of working space, n x n."""

UNLIKE = 0.1
"""Least share of a move by which the next must differ from it for an update."""


def weigh(weights: Vector, along: Vector, modes: Vector, n: int, g: float) -> int:
    """What each entry, and its partners, contribute to (I - g L)^-1 in the coordinates of the modes.

    modes : (4 n,) real parts, absolute imaginary parts, +1 and -1 for the two of a pair (else 0), places of the partners.
    """
    real = modes
    imaginary = part(modes, n)
    sign = part(modes, 2 * n)
    square = n * n
    for i in range(n):
        for j in range(n):
            x = 1.0 - g * (real[i] + real[j])
            y = g * (imaginary[i] + imaginary[j])
            z = g * (imaginary[i] - imaginary[j])
            same = 1.0 / (x * x + y * y)
            mixed = 1.0 / (x * x + z * z)
            weights[i * n + j] = 0.5 * x * (same + mixed)
            weights[square + i * n + j] = 0.5 * (y * same + z * mixed) * sign[i]
            weights[2 * square + i * n + j] = 0.5 * (y * same - z * mixed) * sign[j]
            weights[3 * square + i * n + j] = 0.5 * x * (mixed - same) * sign[i] * sign[j]
        x = 1.0 - g * real[i]
        y = g * imaginary[i]
        along[i] = x / (x * x + y * y)
        along[n + i] = y / (x * x + y * y) * sign[i]
    return 0


def invert(
    multiply: Function, r: Vector, z: Vector, size: int, n: int, form: Vector, modes: Vector, pairs: int, work: Vector
) -> int:
    """Set z = (I - g L)^-1 r for packed moments; what is integrated alongside passes as it is.

    multiply : writes the product of two matrices, of as many rows as it is told first.
    form : (4 n^2,) W^-1, its transpose, W and its transpose, in units of the states.
    work : (MATRICES n^2 + 2 n + 1,) the weights, and room for three matrices and n.
    """
    square = n * n
    left = form
    left_turned = part(form, square)
    right = part(form, 2 * square)
    right_turned = part(form, 3 * square)
    weights = work
    full = part(work, 4 * square)
    half = part(work, 5 * square)
    inner = part(work, 6 * square)
    along = part(work, 7 * square)
    rows = part(along, 2 * n)
    rows[0] = float(n)
    partner = part(modes, 3 * n)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += left[i * n + j] * r[j]
        half[i] = total
    for i in range(n):
        inner[i] = along[i] * half[i] + along[n + i] * half[int(partner[i])]
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += right[i * n + j] * inner[j]
        z[i] = total
    k = n
    for j in range(n):
        for i in range(j, n):
            full[j * n + i] = r[k]
            full[i * n + j] = r[k]
            k += 1
    multiply(rows, left, full, half)
    multiply(rows, half, left_turned, inner)
    for i in range(square):
        full[i] = weights[i] * inner[i]
    if pairs == 1:
        for i in range(n):
            other = int(partner[i])
            turned = part(inner, other * n)
            one = part(weights, square + i * n)
            two = part(weights, 2 * square + i * n)
            three = part(weights, 3 * square + i * n)
            row = part(full, i * n)
            for j in range(n):
                across = int(partner[j])
                row[j] += one[j] * turned[j] + two[j] * inner[i * n + across] + three[j] * turned[across]
    multiply(rows, right, full, half)
    multiply(rows, half, right_turned, inner)
    k = n
    for j in range(n):
        for i in range(j, n):
            z[k] = inner[i * n + j]
            k += 1
    for i in range(k, size):
        z[i] = r[i]
    return 0


def improve(updates: Vector, count: int, z: Vector, size: int) -> int:
    """Apply the updates of the inverse, z = (1 + u_k w_k') ... (1 + u_1 w_1') z."""
    for k in range(count):
        weights = part(updates, 2 * k * size)
        along = part(updates, (2 * k + 1) * size)
        total = 0.0
        for i in range(size):
            total += weights[i] * z[i]
        for i in range(size):
            z[i] += total * along[i]
    return 0


def learn(updates: Vector, count: int, before: Vector, z: Vector, allowed: Vector, size: int) -> int:
    """From a move and what the inverse finds next, z, one more update; z becomes what it would have found with that.

    Returns the number of updates: without the new one where both are so alike that nothing follows.
    """
    across = 0.0
    length = 0.0
    for i in range(size):
        weight = allowed[i] * allowed[i] * before[i]
        across += weight * z[i]
        length += weight * before[i]
    kept = 1.0 - across / length
    if not kept > UNLIKE:
        return count
    weights = part(updates, 2 * count * size)
    along = part(updates, (2 * count + 1) * size)
    for i in range(size):
        z[i] /= kept
        weights[i] = allowed[i] * allowed[i] * before[i] / length
        along[i] = z[i]
    return count + 1
