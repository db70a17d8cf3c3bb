"""The inverse of I - g L as machine code, and what Broyden's updates make of it; see `implicit` and `backward`.

For `lowering.kernel`.
"""

from __future__ import annotations

from cadet_sym.lowering.kernel import Function, Vector, part

__all__ = ["MATRICES", "PAIRS", "apply", "improve", "invert", "learn", "upper", "weigh"]

PAIRS = 6
"""Updates at most."""

MATRICES = 7
"""Matrices of working space, n x n."""

HALVED = 32
"""Rows from which on a quarter of a symmetric product is worth a call more."""

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


def apply(turned: Vector, x: Vector, out: Vector, n: int) -> int:
    """Set out = A x, from the transpose of A: no sum waits for the one before it."""
    for i in range(n):
        out[i] = 0.0
    for j in range(n):
        row = part(turned, j * n)
        weight = x[j]
        for i in range(n):
            out[i] += row[i] * weight
    return 0


def upper(multiply: Function, A: Vector, B: Vector, out: Vector, n: int, shape: Vector) -> int:
    """Set out = A B, which is symmetric: all but the last rows of the first columns; returns how many columns these are."""
    half = n // 2 if n >= HALVED else 0
    if half > 0:
        shape[1] = float(half)
        multiply(shape, A, B, out)
    shape[1] = float(n - half)
    shape[2] = float(n - half)
    multiply(shape, part(A, half * n), part(B, half), part(out, half * n + half))
    return half


def invert(
    multiply: Function, r: Vector, z: Vector, size: int, n: int, form: Vector, modes: Vector, pairs: int, work: Vector
) -> int:
    """Set z = (I - g L)^-1 r for packed moments; what is integrated alongside passes as it is.

    multiply : writes rows and columns of the product of two matrices: (n, rows, columns) is what it is told first.
    form : (4 n^2,) W^-1, its transpose, W and its transpose, in units of the states.
    work : (MATRICES n^2 + 2 n + 3,) the weights, and room for three matrices and what `multiply` is told.
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
    shape = part(along, 2 * n)
    shape[0] = float(n)
    shape[1] = float(n)
    shape[2] = float(n)
    partner = part(modes, 3 * n)
    apply(left_turned, r, half, n)
    for i in range(n):
        inner[i] = along[i] * half[i] + along[n + i] * half[int(partner[i])]
    apply(right_turned, inner, z, n)
    k = n
    for j in range(n):
        row = part(full, j * n)
        column = part(r, k - j)
        for i in range(j, n):
            row[i] = column[i]
        for i in range(j + 1, n):
            full[i * n + j] = column[i]
        k += n - j
    multiply(shape, left, full, half)
    first = upper(multiply, half, left_turned, inner, n, shape)
    for i in range(first, n):
        for j in range(first):
            inner[i * n + j] = inner[j * n + i]
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
    shape[1] = float(n)
    shape[2] = float(n)
    multiply(shape, right, full, half)
    upper(multiply, half, right_turned, inner, n, shape)
    k = n
    for j in range(n):
        row = part(inner, j * n)  # which is the column, and stands in one piece
        for i in range(j, n):
            z[k] = row[i]
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
