"""Describing functions as CasADi functions of mean, covariance and parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.closed_form import Exponent, Kink, PiecewiseForm, Segment, Term
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.quadrature import PANELS, REACH, Integral
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.lowering.special import FAR, density, magnitude, mills_moments, positive_part

# Added to the variance inside: far below what the variance of any state is resolved to, so that F and the gain are those
# of the variance itself, and far above the square root of the smallest number, so that s^-4 (the fourth derivative at a
# jump) is finite.
FLOOR = 1e-150


def element_function(df: DescribingFunction, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """Compile a describing function: (m: k, S: k(k+1)/2 lower triangle row by row, q: parameters) -> (F: 1, gain: k)."""
    function = element_derivatives(df, free, 1)
    m, S, q = (ca.SX.sym(n, *function.size_in(i)) for i, n in enumerate("mSq"))
    F, gain = function(m, S, q)
    return ca.Function("element", [m, S, q], [F, gain], ["m", "S", "q"], ["F", "gain"])


def element_derivatives(df: DescribingFunction, free: tuple[sp.Symbol, ...], order: int = 3) -> ca.Function:
    """Compile F_0 .. F_order, F_k = d^k F/dm^k, of a function of one argument: (m, S, q) -> (F0, F1, ...)."""
    m, S, q = ca.SX.sym("m"), ca.SX.sym("S"), ca.SX.sym("q", len(free))
    env = {symbol: q[i] for i, symbol in enumerate(free)}
    outputs = moments(df, m, S, env, order)
    return ca.Function("moments", [m, S, q], outputs, ["m", "S", "q"], [f"F{k}" for k in range(order + 1)])


def moments(
    df: DescribingFunction, m: ca.SX, p: ca.SX, env: dict[sp.Symbol, ca.SX], order: int
) -> list[ca.SX]:
    """F_0 .. F_order as expressions of the mean and the variance of the one argument."""
    gaussian = _Gaussian(m, p, env)
    result, form, integrals = [], df.closed, df.integrals
    for k in range(order + 1):
        total = gaussian.piecewise(form)
        total += sum((gaussian.jump(kink, k) for kink in df.closed.kinks), start=ca.SX(0))
        total += sum((gaussian.integral(part) for part in integrals), start=ca.SX(0))
        result.append(total)
        form, integrals = form.derivative(), tuple(part.derivative() for part in integrals)
    return result


class _Gaussian:
    """Expectations under one normal distribution, N(m, p)."""

    def __init__(self, m: ca.SX, p: ca.SX, env: dict[sp.Symbol, ca.SX]):
        self.m, self.p, self.env = m, positive_part(p), env
        self.v = self.p + FLOOR
        self.s = ca.sqrt(self.v)
        self.shared: dict[tuple, tuple[ca.SX, ...]] = {}
        self.converted: dict[sp.Expr, ca.SX] = {}

    def value(self, expr: sp.Expr) -> ca.SX:
        if expr not in self.converted:
            self.converted[expr] = to_casadi(expr, self.env)
        return self.converted[expr]

    # -- closed form ----------------------------------------------------------------------------------------------

    def tilted(self, exponent: Exponent) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Mean, variance, the latter's square root, and weight of exp(a z + b z^2) N(m, p), normalised."""
        key = ("tilt", exponent)
        if key not in self.shared:
            a, b = map(self.value, exponent)
            m, p = self.m, self.p
            shrink = 1 / (1 - 2 * b * p)
            weight = ca.sqrt(shrink) * ca.exp((a * m + a * a * p / 2 + b * m * m) * shrink)
            v = self.v / (1 - 2 * b * self.v)
            self.shared[key] = ((m + a * p) * shrink, p * shrink, ca.sqrt(v), weight)
        return self.shared[key]

    def piecewise(self, form: PiecewiseForm) -> ca.SX:
        """E of the segment that holds the mean, and the tails of the changes at all kinks."""
        total = ca.SX(0)
        for segment in form.segments:
            for term in segment.terms:
                total += self.segment(segment, term)
        for kink in form.kinks:
            for term in kink.terms:
                total += self.tail(kink, term)
        return total

    def segment(self, segment: Segment, term: Term) -> ca.SX:
        centre = segment.centre
        exponent = _uncentred(term, centre)
        mean, p, _, weight = self.tilted(exponent)
        h = mean - self.value(centre)
        powers = _heat_polynomials(h, p, len(term.coefficients))
        total = sum(
            (self.value(c) * x for c, x in zip(term.coefficients, powers, strict=True)), start=ca.SX(0)
        )
        if exponent != (0, 0):
            a, b = exponent
            total *= weight * ca.exp(-self.value(a * centre + b * centre**2))
        if not segment.lower.is_infinite:
            total = ca.if_else(mean >= self.value(segment.lower), total, 0)
        if not segment.upper.is_infinite:
            total = ca.if_else(mean < self.value(segment.upper), total, 0)
        return total

    def tail(self, kink: Kink, term: Term) -> ca.SX:
        """E of the change above a kink that lies above the mean, or less that below a kink below the mean."""
        k = self.value(kink.position)
        mean, _, s, _ = self.tilted(_uncentred(term, kink.position))
        above, ratios = self.ratios(kink.position, _uncentred(term, kink.position), len(term.coefficients))
        total, power = ca.SX(0), ca.SX(1)
        for n, coefficient in enumerate(term.coefficients):
            part = self.value(coefficient) * power * ratios[n]
            total += part if n % 2 else ca.if_else(above, -part, part)
            power = power * s
        return total * (s / self.s) * self.density(kink.position)

    def density(self, position: sp.Expr) -> ca.SX:
        """phi((m - k)/s)."""
        key = ("density", position)
        if key not in self.shared:
            u = _clipped((self.m - self.value(position)) / self.s)
            self.shared[key] = (density(u), u)
        return self.shared[key][0]

    def ratios(self, position: sp.Expr, exponent: Exponent, count: int) -> tuple[ca.SX, list[ca.SX]]:
        key = ("ratios", position, exponent)
        if key not in self.shared or len(self.shared[key][1]) < count:
            mean, _, s, _ = self.tilted(exponent)
            x = (mean - self.value(position)) / s
            if exponent == (0, 0):
                x = _clipped(x)
            self.shared[key] = (x >= 0, mills_moments(magnitude(x), count))
        return self.shared[key]

    def jump(self, kink: Kink, k: int) -> ca.SX:
        """What the jumps of f, f', .. at a kink add to F_k: d_j d^(k-1-j)/dm^(k-1-j) phi((m - k)/s)/s."""
        total = ca.SX(0)
        for j, size in enumerate(kink.jumps[:k]):
            if size != 0:
                phi = self.density(kink.position)
                u = self.shared["density", kink.position][1]
                i = k - 1 - j
                total += self.value(size) * (-1) ** i * _hermite(u, i) * phi / self.s ** (i + 1)
        return total

    # -- quadrature -----------------------------------------------------------------------------------------------

    def integral(self, part: Integral) -> ca.SX:
        low = -REACH if part.lower.is_infinite else self._within(part.lower)
        high = REACH if part.upper.is_infinite else self._within(part.upper)
        nodes, weights = np.polynomial.legendre.leggauss(part.order)
        z = ca.SX.sym("z")
        f = ca.Function("f", [z, *self._symbols()], [to_casadi(part.value, {**self.env, part.argument: z})])
        total = ca.SX(0)
        for start, end in zip(PANELS[:-1], PANELS[1:], strict=True):
            centre, half = low + (high - low) * (start + end) / 2, (high - low) * (end - start) / 2
            for x, w in zip(nodes, weights, strict=True):
                u = centre + half * x
                total += w * half * density(u) * f(self.m + self.s * u, *self._symbols())
        return total

    def _symbols(self) -> list[ca.SX]:
        return list(self.env.values())

    def _within(self, position: sp.Expr) -> ca.SX:
        u = (self.value(position) - self.m) / self.s
        return ca.fmin(ca.fmax(u, -REACH), REACH)


def _uncentred(term: Term, centre: sp.Expr) -> Exponent:
    """The exponents of exp(a z + b z^2) from those of exp(a' x + b x^2), x = z - centre."""
    if term.exponent == (0, 0):
        return term.exponent
    return sp.expand(term.rate - 2 * term.curvature * centre), term.curvature


def _clipped(u: ca.SX) -> ca.SX:
    return ca.if_else(u > FAR, FAR, ca.if_else(u < -FAR, -FAR, u))


def _heat_polynomials(h: ca.SX, p: ca.SX, count: int) -> list[ca.SX]:
    """E[(h + sqrt(p) e)^n], n < count."""
    powers = [ca.SX(1), h]
    for n in range(2, count):
        powers.append(h * powers[n - 1] + (n - 1) * p * powers[n - 2])
    return powers[:count]


def _hermite(u: ca.SX, n: int) -> ca.SX:
    """He_n(u)."""
    values = [ca.SX(1), u]
    for k in range(2, n + 1):
        values.append(u * values[k - 1] - (k - 1) * values[k - 2])
    return values[n]
