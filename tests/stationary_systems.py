"""Stationary problems made by hand, and random ones with a known solution: nothing of the compiler is involved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.special import ndtr

from cadet_sym.solve.frozen import FrozenProblem

Array = np.ndarray


def density(u):
    return np.exp(-0.5 * u * u) / np.sqrt(2 * np.pi)


def _ramp(m, p, derivative):
    """E of max(z, 0) and its derivatives in the mean."""
    s = np.sqrt(max(p, 1e-300))
    u = m / s
    phi = density(u) / s
    return (m * ndtr(u) + p * phi, ndtr(u), phi, -m / max(p, 1e-300) * phi)[derivative]


def _step(m, p, derivative):
    if derivative < 3:
        return _ramp(m, p, derivative + 1)
    s2 = max(p, 1e-300)
    return (m * m / s2 - 1) / s2 * density(m / np.sqrt(s2)) / np.sqrt(s2)


def _half_square(m, p, derivative):
    """E of max(z, 0)^2."""
    if derivative == 0:
        s = np.sqrt(max(p, 1e-300))
        return (m * m + p) * ndtr(m / s) + m * s * density(m / s)
    return 2 * _ramp(m, p, derivative - 1)


@dataclass(frozen=True)
class Scalar:
    """f of one argument by F_k(m, p) = E of its k-th derivative, k = 0..3."""

    name: str
    derivatives: Callable[[float, float, int], float]

    def __call__(self, theta):
        m, p = theta
        F = [self.derivatives(m, p, k) for k in range(4)]
        return F[0], [F[1]], [F[1], F[2] / 2], [[F[2], F[3] / 2]]


def linear_combination(name, *terms):
    """Sum of weight * base(z - kink) or of the mirrored base."""

    def derivatives(m, p, k):
        return sum(w * sign**k * base(sign * (m - kink), p, k) for w, base, kink, sign in terms)

    return Scalar(name, derivatives)


def cubic(a=1.0):
    return Scalar("cubic", lambda m, p, k: a * (m**3 + 3 * m * p, 3 * (m * m + p), 6 * m, 6.0)[k])


def square(a=1.0):
    return Scalar("square", lambda m, p, k: a * (m * m + p, 2 * m, 2.0, 0.0)[k])


def coulomb(a=1.0):
    return linear_combination("coulomb", (a, _step, 0, 1), (-a, _step, 0, -1))


def saturation(a=1.0, limit=1.0):
    def derivatives(m, p, k):
        value = _ramp(m + limit, p, k) - _ramp(m - limit, p, k)
        return a * (value - (limit if k == 0 else 0))

    return Scalar("saturation", derivatives)


def dead_zone(a=1.0, gap=1.0):
    return linear_combination("dead zone", (a, _ramp, gap, 1), (-a, _ramp, -gap, -1))


def quadratic_damper(a=1.0, r=1.0):
    """a z^2 for z > 0, -a r z^2 below."""
    return linear_combination("quadratic damper", (a, _half_square, 0, 1), (-a * r, _half_square, 0, -1))


def bilinear(a=1.0, r=0.5):
    return linear_combination("bilinear", (a, _ramp, 0, 1), (-a * r, _ramp, 0, -1))


def sine(a=1.0):
    def derivatives(m, p, k):
        e = np.exp(-p / 2)
        return a * e * (np.sin(m), np.cos(m), -np.sin(m), -np.cos(m))[k]

    return Scalar("sine", derivatives)


def error_function(a=1.0, width=1.0):
    """a sqrt(pi/2) width erf(z / (width sqrt 2)), slope a at the origin: reference R31."""

    def derivatives(m, p, k):
        s2 = width * width + p
        s = np.sqrt(s2)
        u = m / s
        g = np.sqrt(2 * np.pi) * density(u)
        scale = a * width
        if k == 0:
            return scale * np.sqrt(np.pi / 2) * (2 * ndtr(u) - 1)
        return scale * g * (1 / s, -u / s2, (u * u - 1) / (s2 * s))[k - 1]

    return Scalar("error function", derivatives)


@dataclass(frozen=True)
class Product:
    """a x y: theta = (mx, my, xx, yx, yy)."""

    a: float = 1.0
    name: str = "product"

    def __call__(self, theta):
        mx, my, _, yx, _ = theta
        a = self.a
        return (
            a * (mx * my + yx),
            [a * my, a * mx],
            [a * my, a * mx, 0, a, 0],
            [[0, a, 0, 0, 0], [a, 0, 0, 0, 0]],
        )


@dataclass(frozen=True)
class SquareTimes:
    """a x^2 y: theta = (mx, my, xx, yx, yy); van der Pol damping if y = x'."""

    a: float = 1.0
    name: str = "square times"

    def __call__(self, theta):
        mx, my, xx, yx, _ = theta
        a = self.a
        gain = [2 * a * (mx * my + yx), a * (mx * mx + xx)]
        return (
            a * ((mx * mx + xx) * my + 2 * mx * yx),
            gain,
            [gain[0], gain[1], a * my, 2 * a * mx, 0],
            [[2 * a * my, 2 * a * mx, 0, 2 * a, 0], [2 * a * mx, 0, a, 0, 0]],
        )


def elements_of(functions: Sequence[Callable], owner: Array) -> Callable[[Array], tuple[Array, Array, Array, Array]]:
    """Join elements, each a function of its own part of theta, into one function of theta."""
    K, J = len(owner), len(functions)
    means = [np.flatnonzero(owner == j) for j in range(J)]
    index, start = [], K
    for j in range(J):
        size = len(means[j]) * (len(means[j]) + 1) // 2
        index.append(np.concatenate([means[j], np.arange(start, start + size)]))
        start += size
    T = start

    def elements(theta):
        F, gain, dF, dgain = np.zeros(J), np.zeros(K), np.zeros((J, T)), np.zeros((K, T))
        for j, f in enumerate(functions):
            F[j], gain[means[j]], dF[j, index[j]], slopes = f(theta[index[j]])
            dgain[np.ix_(means[j], index[j])] = slopes
        return F, gain, dF, dgain

    return elements


def problem(A, b, C, functions, D, c=None, d=None, owner=None, **more) -> FrozenProblem:
    """A FrozenProblem from array-likes; each element has one argument unless `owner` says otherwise."""
    A, b, C, D = (np.array(x, dtype=float) for x in (A, b, C, D))
    owner = np.arange(len(C)) if owner is None else np.array(owner)
    c = np.zeros(len(A)) if c is None else np.array(c, dtype=float)
    d = np.zeros(len(C)) if d is None else np.array(d, dtype=float)
    return FrozenProblem(A, c, b, C, d, D, owner, elements_of(functions, owner), **more)


def _gain_matrix(rng, n) -> Array:
    """A random Hurwitz matrix: dense, a chain of oscillators, or a cascade of filters."""
    kind = rng.integers(3)
    if kind == 0 or n < 4:
        M = rng.standard_normal((n, n)) / np.sqrt(n)
        return M - (np.linalg.eigvals(M).real.max() + 10 ** rng.uniform(-1.5, 0)) * np.eye(n)
    if kind == 1:
        m = n // 2
        K = np.diag(rng.uniform(1, 4, m)) + 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
        N = np.zeros((n, n))
        N[:m, m : 2 * m] = np.eye(m)
        N[m : 2 * m, :m] = -K
        N[m : 2 * m, m : 2 * m] = -(10 ** rng.uniform(-2, 0)) * K
        if n % 2:
            N[-1, -1], N[m, -1] = -1.0, 1.0
        return N
    rates = 10 ** rng.uniform(-1, 1, n)
    return -np.diag(rates) + np.diag(rates[1:] * rng.uniform(0.2, 1, n - 1), -1) + 0.05 * rng.standard_normal((n, n))


def _random_element(rng):
    a = 1.0
    choice = rng.integers(10)
    makers = (
        lambda: cubic(a),
        lambda: quadratic_damper(a, rng.uniform(-0.5, 1)),
        lambda: coulomb(a),
        lambda: saturation(a, rng.uniform(0.3, 2)),
        lambda: dead_zone(a, rng.uniform(0.3, 2)),
        lambda: bilinear(a, rng.uniform(0, 0.9)),
        lambda: square(a),
        lambda: error_function(a, rng.uniform(0.3, 2)),
        lambda: Product(a),
        lambda: SquareTimes(a),
    )
    return makers[choice]()


def moment_jacobian(p: FrozenProblem, mean: Array, covariance: Array) -> Array:
    """Jacobian of the packed moment equations (n (n + 3) / 2 square), column by column, from the definition."""
    n = p.n
    theta = p.theta(mean, covariance)
    _, gain, dF, dgain = (np.asarray(x) for x in p.elements(theta))
    K = len(p.C)
    columns = p.b[:, p.owner]
    N = p.A + columns @ (gain[:, None] * p.C)
    rows, cols = np.tril_indices(n)
    J = []
    for k in range(n + len(rows)):
        dmu, dP = np.zeros(n), np.zeros((n, n))
        if k < n:
            dmu[k] = 1
        else:
            dP[rows[k - n], cols[k - n]] = dP[cols[k - n], rows[k - n]] = 1
        dtheta = np.concatenate([p.C @ dmu, (p.C @ dP @ p.C.T)[p.pairs[0], p.pairs[1]]])
        dN = columns @ ((dgain @ dtheta)[:, None] * p.C) if K else 0 * N
        dR = N @ dP + dN @ covariance
        J.append(np.concatenate([p.A @ dmu + p.b @ (dF @ dtheta), (dR + dR.T)[rows, cols]]))
    return np.array(J).T


def random_system(seed: int, largest: int = 30) -> tuple[FrozenProblem, Array, Array]:
    """A random problem of 2 to `largest` states and 1 to 6 elements with a stable solution, and that solution.

    The linearised system is drawn first, the elements are put in, and the linear part and the loads are what is
    left: so the solution is known exactly, and the linear part alone may well be unstable.
    """
    rng = np.random.default_rng(seed)
    while True:
        n, J = int(rng.integers(2, largest + 1)), int(rng.integers(1, 7))
        N = _gain_matrix(rng, n)
        if np.linalg.eigvals(N).real.max() > -1e-3:
            continue
        G = rng.standard_normal((n, int(rng.integers(1, n + 1))))
        D = G @ G.T
        P = solve_continuous_lyapunov(N, -D)
        mean = rng.standard_normal(n) * np.sqrt(np.diag(P)) * rng.choice([0.0, 0.3, 1.0])
        functions = [_random_element(rng) for _ in range(J)]
        owner = np.concatenate(
            [[j] * (2 if isinstance(f, Product | SquareTimes) else 1) for j, f in enumerate(functions)]
        )
        C = rng.standard_normal((len(owner), n)) * (rng.random((len(owner), n)) < max(0.3, 1.5 / n))
        C[np.arange(len(C)), rng.integers(0, n, len(C))] = 1.0
        C *= (10 ** rng.uniform(-0.5, 0.5, len(C)) / np.sqrt(np.einsum("in,nm,im->i", C, P, C)))[:, None]
        d = -C @ mean + rng.standard_normal(len(C)) * rng.choice([0.0, 0.5])
        b = rng.standard_normal((n, J)) * (rng.random((n, J)) < max(0.3, 1.5 / n))
        trial = problem(N, b, C, functions, D, d=d, owner=owner)
        F, gain, _, _ = trial.elements(trial.theta(mean, P))
        # The elements' part of N: between a hundredth of N and as much as N
        part = trial.columns @ (gain[:, None] * C)
        size = np.linalg.norm(part, 2)
        if size == 0:
            continue
        factor = np.linalg.norm(N, 2) / size * 10 ** rng.uniform(-2, 0)
        units = 10.0 ** rng.integers(-3, 4, n) if rng.random() < 0.3 else np.ones(n)
        b, part = factor * b, factor * part
        A = N - part
        c = -A @ mean - b @ F
        S, T = units[:, None], 1 / units
        p = problem(S * A * T, S * b, C * T, functions, S * D * units, S[:, 0] * c, d, owner)
        mean, P = units * mean, S * P * units
        stable = np.linalg.eigvals(_unitless(moment_jacobian(p, mean, P), units)).real.max() < 0
        if stable:
            return p, mean, P


def _unitless(J: Array, units: Array) -> Array:
    rows, cols = np.tril_indices(len(units))
    scale = np.concatenate([units, units[rows] * units[cols]])
    return J * scale / scale[:, None]
