"""Expectation of a function of one Gaussian variable, and its derivatives in the mean, as CasADi expressions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import comb

import casadi as ca
import sympy as sp

from cadet_sym.expectation.closed_form import PLAIN_TERM, Kink, PiecewiseForm, Segment, Term, normal
from cadet_sym.expectation.panels import REACH, legendre
from cadet_sym.expectation.quadrature import Integral
from cadet_sym.expectation.tables import Table
from cadet_sym.expectation.univariate import Apart, Bounded, Univariate
from cadet_sym.lowering.complex import Complex, complex_exp, converted, select
from cadet_sym.lowering.errorfunction import error_function_moment
from cadet_sym.lowering.expressions import Lowering
from cadet_sym.lowering.panels import Panels
from cadet_sym.lowering.power import power_moment
from cadet_sym.lowering.special import clipped, density, density_sum, hermite, magnitude, mills_moments, positive_part
from cadet_sym.lowering.tables import NARROW, NARROW_ORDER, table_moment

# Added to the variance inside: far below what the variance of any state is resolved to, so that F and the gain are those
# of the variance itself, and so large that s^-6 is finite: derivatives at a jump go as powers of 1/s.
FLOOR = 1e-100
LARGEST = 600.0  # of an exponent


@dataclass
class Gaussian:
    """One normal distribution N(m, p), and what the expectations under it share."""

    m: ca.SX
    p: ca.SX
    env: Mapping[sp.Symbol, ca.SX]
    lowering: Lowering = field(init=False)

    def __post_init__(self):
        self.lowering = Lowering(self.env)
        self.p = positive_part(self.p)
        self.v = self.p + FLOOR
        self.s = ca.sqrt(self.v)
        self.densities: dict[sp.Expr, tuple[ca.SX, ca.SX]] = {}
        self.tilts: dict[tuple[sp.Expr, ...], Tilt] = {}
        self.columns: dict[Table, tuple[ca.SX, ca.SX, ca.SX, list[ca.SX]]] = {}
        self.curves: dict[tuple[Table, int], ca.SX] = {}
        self.powers: dict[tuple[sp.Expr | bool | int, ...], ca.SX] = {}
        self.panels: dict[Integral, Panels] = {}
        self.moved: dict[sp.Expr, Gaussian] = {}  # by the rate of an exponential
        self.tails: dict[tuple[sp.Expr, ...], tuple[ca.SX, list[Complex]]] = {}

    def value(self, expr: sp.Expr) -> ca.SX:
        """A parameter expression."""
        return self.lowering.convert(expr)

    def complex_value(self, expr: sp.Expr) -> Complex:
        """A parameter expression that may be complex."""
        return converted(expr, self.value)

    def expectation(self, function: Univariate, order: int = 0, *, since: int = 0) -> ca.SX:
        """F_k = d^k E[f] / dm^k, k = order; without the impulses that jumps of f^(j), j < since, leave in f^(k)."""
        if order > 1 and function.is_singular:
            return self._by_derivative(function, order)
        total = self._closed(function, order, since)
        if function.apart is not None and not since:
            total = self._apart(function.apart, order, total)
        for table in function.tables:
            total += table_moment(table, self, order)
        for error_function in function.error_functions:
            total += error_function_moment(error_function, self, order)
        for power in function.powers:
            total += power_moment(power, self, order)
        for part in function.integrals:
            total += self._integral(part, order)
        return total

    def _closed(self, part: Univariate | Apart | Bounded, order: int, since: int = 0) -> ca.SX:
        """F_k of what is piecewise in closed form, and of jumps."""
        form = part.closed
        for _ in range(order):
            form = form.derivative()
        total = self._piecewise(form)
        for jump in part.jumps:
            for j in range(since, order):
                size = jump.size(j)
                if size != 0:
                    total += self.complex_value(size).real * self.impulse(jump.position, order - 1 - j)
        return total

    def _apart(self, apart: Apart, order: int, together: ca.SX) -> ca.SX:
        """The same with polynomials between kinks by themselves, where the distribution is wider than one of them."""
        total, least = self._closed(apart, order), ca.SX(math.inf)
        for piece in apart.bounded:
            width = self.value(piece.upper) - self.value(piece.lower)
            least = ca.fmin(least, width)
            total += ca.if_else(width < NARROW * self.s, self._narrow(piece, width, order), self._closed(piece, order))
        return ca.if_else(ca.logic_and(least < NARROW * self.s, least > 0), total, together)

    def _narrow(self, piece: Bounded, width: ca.SX, order: int) -> ca.SX:
        """F_k of a polynomial over a stretch on which the density hardly bends: Gauss and Legendre's rule is exact."""
        nodes, weights = (ca.DM(x) for x in legendre(NARROW_ORDER))
        x = width * (nodes - 0.5)
        value = ca.SX(0)
        for coefficient in reversed(piece.coefficients):
            value = value * x + self.value(coefficient)
        middle = self.value((piece.lower + piece.upper) / 2)
        return width * density_sum(weights * value, x + middle, self.m, self.s, order)

    def _by_derivative(self, function: Univariate, order: int) -> ca.SX:
        """Beyond the gain, a function with a singular point is differentiated by CasADi."""
        m, p = ca.SX.sym("m"), ca.SX.sym("p")
        value = Gaussian(m, p, self.env).expectation(function, 1)
        for _ in range(order - 1):
            value = ca.jacobian(value, m)
        return ca.substitute(value, ca.vertcat(m, p), ca.vertcat(self.m, self.p))

    def inside(self, segment: Segment, value: ca.SX, term: Term = PLAIN_TERM) -> ca.SX:
        """The value if the mean (of the distribution times the term's exponential) lies in the segment, else zero."""
        for bound, above in ((segment.lower, True), (segment.upper, False)):
            if not bound.is_infinite:
                # the very distance by whose sign the tail at the kink is told, or they would differ by a rounding
                rate = normal(term.rate + 2 * term.curvature * (bound - segment.centre))
                distance = self.tilt(bound, Term(rate, term.curvature, ())).mean.real
                value = ca.if_else(distance >= 0, value if above else 0, 0 if above else value)
        return value

    def tail_moment(self, position: sp.Expr, n: int) -> ca.SX:
        """E[(z - k)^n 1(z > k)] for a kink above the mean, else -E[(z - k)^n 1(z < k)]."""
        return self._tail(Kink(position, ()), Term(sp.S.Zero, sp.S.Zero, (*[sp.S.Zero] * n, sp.S.One)))

    # -- closed form ----------------------------------------------------------------------------------------------

    def density(self, position: sp.Expr) -> tuple[ca.SX, ca.SX]:
        """phi(u) and u = (m - k)/s, the latter kept where phi is not zero."""
        if position not in self.densities:
            u = clipped((self.m - self.value(position)) / self.s)
            self.densities[position] = density(u), u
        return self.densities[position]

    def impulse(self, position: sp.Expr, order: int) -> ca.SX:
        """d^order/dm^order of phi((m - k)/s)/s."""
        phi, u = self.density(position)
        return (-1) ** order * hermite(u, order) * phi / self.s ** (order + 1)

    def tilt(self, centre: sp.Expr, term: Term) -> Tilt:
        """The normal distribution times exp(a x + b x^2), x = z - centre, normalised."""
        key = centre, term.rate, term.curvature
        if key not in self.tilts:
            self.tilts[key] = _tilted(self, centre, term)
        return self.tilts[key]

    def _piecewise(self, form: PiecewiseForm) -> ca.SX:
        """E of the segment that holds the mean, and the tails of the changes at all kinks."""
        total = ca.SX(0)
        for segment in form.segments:
            for term in segment.terms:
                total += self._segment(segment, term)
        for kink in form.kinks:
            for term in kink.terms:
                total += self._tail(kink, term)
        return total

    def _segment(self, segment: Segment, term: Term) -> ca.SX:
        tilt = self.tilt(segment.centre, term)
        powers = _heat_polynomials(tilt.mean, tilt.p, len(term.coefficients))
        total = Complex(ca.SX(0))
        for coefficient, power in zip(term.coefficients, powers, strict=True):
            if coefficient != 0:
                total = total + self.complex_value(coefficient) * power
        value = (total * tilt.weight).real
        if tilt.overflows is not None:
            value = ca.if_else(tilt.overflows, ca.if_else(value >= 0, math.inf, -math.inf), value)
        return self.inside(segment, value, term)

    def _tail(self, kink: Kink, term: Term) -> ca.SX:
        """E of the change above a kink that lies above the mean, or less that below a kink below the mean."""
        tilt = self.tilt(kink.position, term)
        above, ratios = self._ratios(kink.position, term, tilt)
        total, power = Complex(ca.SX(0)), ca.SX(1)
        for n, coefficient in enumerate(term.coefficients):
            if coefficient != 0:
                # of odd powers the reflected tail has the same sign
                ratio = ratios[n] if n % 2 else select(above, -ratios[n], ratios[n])
                total = total + self.complex_value(coefficient) * ratio * power
            power = power * tilt.s
        scale = self.density(kink.position)[0]
        return total.real * scale if term.curvature == 0 else total.real * scale * tilt.s / self.s

    def _ratios(self, position: sp.Expr, term: Term, tilt: Tilt) -> tuple[ca.SX, list[Complex]]:
        """Whether the mean is above the kink, and r_n(|u|)."""
        key, count = (position, term.rate, term.curvature), len(term.coefficients)
        if key not in self.tails or len(self.tails[key][1]) < count:
            u = tilt.mean * (1 / tilt.s)
            if term.is_polynomial:
                u = Complex(clipped(u.real))
            above = u.real >= 0
            x = Complex(magnitude(u.real))
            if u.imaginary is not None:
                x = Complex(x.real, ca.if_else(above, u.imaginary, -u.imaginary))
            self.tails[key] = above, mills_moments(x, count, far=not term.is_polynomial)
        return self.tails[key]

    # -- quadrature -----------------------------------------------------------------------------------------------

    def of_variance(self, p: ca.SX) -> Gaussian:
        """The same with another variance."""
        return Gaussian(self.m, p, self.env)

    def within(self, position: sp.Expr) -> ca.SX:
        """A point in standard deviations from the mean, kept within reach; just there it moves with the mean as within."""
        u = (self.value(position) - self.m) / self.s
        return ca.if_else(ca.fabs(u) > REACH, REACH * ca.sign(u), u)

    def _integral(self, part: Integral, order: int) -> ca.SX:
        if part.rate != 0:
            return self._moved(part, order)
        if part not in self.panels:
            self.panels[part] = Panels(self, part)
        return self.panels[part].total(order)

    def _moved(self, part: Integral, order: int) -> ca.SX:
        """d^order/dm^order of E[exp(a z) g] = exp(a m + a^2 p / 2) G(m + a p), G = E[g]."""
        a, plain = self.value(part.rate), replace(part, rate=sp.S.Zero)
        if part.rate not in self.moved:
            self.moved[part.rate] = Gaussian(self.m + a * self.p, self.p, self.env)
        there = self.moved[part.rate]
        total = sum((comb(order, j) * a ** (order - j) * there._integral(plain, j) for j in range(order + 1)), start=ca.SX(0))
        return total * ca.exp(a * self.m + a * a * (self.p / 2))


@dataclass(frozen=True)
class Tilt:
    """N(m, p) times exp(a x + b x^2), x = z - centre: a normal distribution of x, and its weight."""

    mean: Complex  # of x
    p: ca.SX
    s: ca.SX
    weight: Complex
    overflows: ca.SX | None = None  # whether the weight is too large, and another number stands for it


def _tilted(gaussian: Gaussian, centre: sp.Expr, term: Term) -> Tilt:
    h = gaussian.m - gaussian.value(centre)
    if term.is_polynomial:
        return Tilt(Complex(h), gaussian.p, gaussian.s, Complex(ca.SX(1)))
    a, p = gaussian.complex_value(term.rate), gaussian.p
    if term.curvature == 0:
        exponent = a * h + a * a * (p / 2)
        return Tilt(Complex(h) + a * p, p, gaussian.s, complex_exp(_limited(exponent)), exponent.real > LARGEST)
    b = gaussian.value(term.curvature)
    shrink = 1 / (1 - 2 * b * p)
    exponent = (a * h + a * a * (p / 2) + Complex(b * h * h)) * shrink
    s = ca.sqrt(gaussian.v / (1 - 2 * b * gaussian.v))
    weight = complex_exp(_limited(exponent)) * ca.sqrt(shrink)
    return Tilt((Complex(h) + a * p) * shrink, p * shrink, s, weight, exponent.real > LARGEST)


def _limited(exponent: Complex) -> Complex:
    """So that beside a segment that does not hold the mean nothing is infinite, whose derivative backwards is no number."""
    return Complex(ca.if_else(exponent.real > LARGEST, LARGEST, exponent.real), exponent.imaginary)


def _heat_polynomials(h: Complex, p: ca.SX, count: int) -> list[Complex]:
    """E[(h + sqrt(p) e)^n], n < count."""
    powers = [Complex(ca.SX(1)), h]
    for n in range(2, count):
        powers.append(h * powers[n - 1] + powers[n - 2] * ((n - 1) * p))
    return powers[:count]
