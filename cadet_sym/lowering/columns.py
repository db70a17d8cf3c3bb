"""E[f(x) g(y)] of jointly Gaussian arguments, f and g piecewise polynomial with many kinks, as measured curves have.

The sum over pairs of kinks of `lowering.pair`, taken in a loop: each function is the polynomial around the mean of its
argument, plus the tails of its changes beyond their kinks, so that

    E[f g] = E[p q] + sum_k E[t_k q] + sum_l E[p t_l] + sum_kl E[t_k t_l]

Of many pairs the sum is long. Unless the correlation is near one, Mehler's series is shorter, with the orthonormal Hermite
polynomials h_k of u = (x - m_x)/s_x and w = (y - m_y)/s_y:

    E[f g] = sum_k rho^k f_k g_k,    f_k = E[f h_k(u)] = s_x^k E[f^(k)] / sqrt(k!)

What is left after K terms is at most |rho|^K times the standard deviations of f and g (Cauchy and Schwarz). Beyond its degree
a polynomial contributes by its kinks alone, so that all f_k come from one recursion over k.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.closed_form import PLAIN_TERM, PiecewiseForm, Term
from cadet_sym.expectation.tables import Table
from cadet_sym.expectation.univariate import Univariate
from cadet_sym.lowering.gaussian import FLOOR, Gaussian
from cadet_sym.lowering.pair import Pair
from cadet_sym.lowering.special import clipped, density
from cadet_sym.lowering.tables import moments_of, polynomial_at

__all__ = ["curves"]

FEW = 9
"""Pairs of kinks up to which the sum is written out."""

TERMS = (32, 128, 512, 2048)
"""Of Mehler's series: the fewest that leave less than ..."""

LEFT = 1e-14
"""... this; beyond the last the pairs are taken one by one."""

STEPS = 8
"""Terms that are found by one call; the numbers of terms are this times a power of two."""

START, PAIR = 15, 40
"""Cost of a term and of a pair in kinks: a term costs START and one for every kink."""

ONE = ca.SX(1)

K, L, C, D = sp.symbols("k l c d", real=True, cls=sp.Dummy)


@dataclass(frozen=True)
class Column:
    """A piecewise polynomial of a Gaussian variable, as it looks from the mean."""

    gaussian: Gaussian
    centre: ca.SX
    polynomial: ca.SX  # (degree + 1,): around the mean, in powers of the distance from the centre
    kinks: ca.SX  # (n,)
    changes: ca.SX  # (n, degree + 1): in powers of the distance from the kink
    factor: ca.SX = ONE
    slope: ca.SX = ONE  # of what a curve is read at, in the argument
    curve: bool = False


def curves(pair: Pair, f: Univariate, g: Univariate) -> dict[tuple[int, int], ca.SX]:
    """What the tables in f and g add to E[f g], E[f' g] and E[f g'], by the orders of the derivatives.

    Long sums are functions that are called, unless they are to be written out.
    """
    total = dict.fromkeys(((0, 0), (1, 0), (0, 1)), ca.SX(0))
    written_out = any(table.written_out for table in (*f.tables, *g.tables))
    for first, second in product(_parts(f, pair.x), _parts(g, pair.y)):
        if first.curve or second.curve:
            covariance = first.slope * second.slope * pair.covariance
            values = _products(first, second, covariance, written_out)
            for order, value in zip(total, values, strict=True):
                total[order] += first.factor * second.factor * first.slope ** order[0] * second.slope ** order[1] * value
    return total


def _parts(f: Univariate, gaussian: Gaussian) -> Iterator[Column]:
    if f.closed.segments or f.closed.kinks:
        yield _of_closed(f.closed, gaussian)
    for table in f.tables:
        yield _of_table(table, gaussian)


def _of_table(table: Table, gaussian: Gaussian) -> Column:
    """A measured curve, of what it is read at."""
    mean, p, _ = moments_of(table, gaussian)
    centre, polynomial = polynomial_at(table, mean)
    changes = ca.SX(ca.DM(table.changes)) if table.knots else ca.SX(0, table.degree + 1)
    factor, slope = gaussian.value(table.factor), gaussian.value(table.slope)
    there = Gaussian(mean, p, gaussian.env)
    return Column(there, centre, polynomial, ca.SX(ca.DM(table.knots)), changes, factor, slope, curve=True)


def _of_closed(form: PiecewiseForm, gaussian: Gaussian) -> Column:
    """Segments and kinks that may depend on parameters."""
    parts = (*form.segments, *form.kinks)
    size = max((len(t.coefficients) for part in parts for t in part.terms), default=1)

    def row(terms: tuple[Term, ...]) -> ca.SX:
        coefficients = [gaussian.value(c) for t in terms for c in t.coefficients]
        return ca.vertcat(*coefficients, ca.SX.zeros(size - len(coefficients)))

    centre, polynomial = ca.SX(0), ca.SX.zeros(size)
    for segment in form.segments:
        inside = gaussian.inside(segment, ca.SX(1), PLAIN_TERM)
        centre += inside * gaussian.value(segment.centre)
        polynomial += inside * row(segment.terms)
    kinks = ca.vertcat(ca.SX(0, 1), *(gaussian.value(kink.position) for kink in form.kinks))
    changes = ca.vertcat(ca.SX(0, size), *(row(kink.terms).T for kink in form.kinks))
    return Column(gaussian, centre, polynomial, kinks, changes)


def _products(f: Column, g: Column, covariance: ca.SX, written_out: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """E[f g], E[f' g] and E[f g'], without the impulses that jumps leave in f' and g'."""
    n, m, a, b = f.kinks.numel(), g.kinks.numel(), f.polynomial.numel(), g.polynomial.numel()
    here = ca.vertcat(f.gaussian.m, f.gaussian.p, g.gaussian.m, g.gaussian.p, covariance)
    few = written_out or n * m <= FEW
    function = _written_out(n, m, a, b) if few else _called(n, m, a, b, (f.curve, g.curve))
    total = function(here, f.centre, f.polynomial, f.kinks, f.changes, g.centre, g.polynomial, g.kinks, g.changes)
    return total[0], total[1], total[2]


@lru_cache(maxsize=64)
def _written_out(n: int, m: int, a: int, b: int) -> ca.Function:
    """The sum over pairs for so many kinks and coefficients of each polynomial."""
    inputs = _inputs(ca.SX, n, m, a, b)
    return ca.Function("products", inputs, [_pairs(n, m, a, b, inputs)])


@lru_cache(maxsize=64)
def _called(n: int, m: int, a: int, b: int, measured: tuple[bool, bool]) -> ca.Function:
    """The same as loops, by whichever sum is shorter; measured curves are numbers, with no derivative in them."""
    inputs = _inputs(ca.MX, n, m, a, b)
    one_by_one = ca.Function("pairs", inputs, [_pairs(n, m, a, b, inputs)])
    terms = [count for count in TERMS if count * (START + n + m) < PAIR * n * m]
    series = [ca.Function(f"series{count}", inputs, [_series(count, n, m, a, b, inputs)]) for count in terms]
    varies = [True, *[not measured[0]] * 4, *[not measured[1]] * 4]
    options = {"never_inline": True, "is_diff_in": varies}
    if not series:
        return ca.Function("products", inputs, [one_by_one(*inputs)], options)
    choice = ca.Function.conditional("choice", series, one_by_one)
    here = inputs[0]
    rho = ca.fabs(here[4]) / ca.sqrt((here[1] + FLOOR) * (here[3] + FLOOR))
    rung = sum((rho**count > LEFT for count in terms), start=ca.MX(0))
    return ca.Function("products", inputs, [choice(rung, *inputs)], options)


def _inputs(kind: type[Any], n: int, m: int, a: int, b: int) -> list[Any]:
    """Means and variances of x and y, covariance; centre, polynomial, kinks and changes of f and of g."""
    return _symbols(5, 1, a, n, (n, a), 1, b, m, (m, b), kind=kind)


def _pairs(n: int, m: int, a: int, b: int, inputs: list[Any]) -> Any:
    """The sum over pairs of kinks."""
    here, c, p, k, u, d, q, l, v = inputs
    turned = here[[2, 3, 0, 1, 4]]
    total = _polynomials(a, b)(here, c, p, d, q)
    if n:
        total += _added(_tail(a, b), n, [here, d, q], [k.T, u.T])
    if m:
        total += _added(_tail(b, a), m, [turned, c, p], [l.T, v.T])[[0, 2, 1]]
    if n and m:
        pairs = [ca.repmat(k.T, 1, m), ca.repmat(u.T, 1, m), _each(l.T, n), _each(v.T, n)]
        total += _added(_corner(a, b), n * m, [here], pairs)
    return total


def _series(count: int, n: int, m: int, a: int, b: int, inputs: list[ca.MX]) -> ca.MX:
    """Mehler's series, of f g, f' g and f g'."""
    here, c, p, k, u, d, q, l, v = inputs
    f, slope_f = _hermite(count, n, a)(here[:2], c, p, k, u)
    g, slope_g = _hermite(count, m, b)(here[2:4], d, q, l, v)
    rho = here[4] / ca.sqrt((here[1] + FLOOR) * (here[3] + FLOOR))
    terms = ca.vertcat(f * g, slope_f * g, f * slope_g)
    backwards = terms[:, list(range(count, -1, -1))]
    return _horner().fold(count + 1)(ca.MX.zeros(3), ca.repmat(rho, 1, count + 1), backwards)


@lru_cache(maxsize=1)
def _horner() -> ca.Function:
    total, rho, term = _symbols(3, 1, 3)
    return ca.Function("horner", [total, rho, term], [total * rho + term])


@lru_cache(maxsize=64)
def _hermite(count: int, n: int, a: int) -> ca.Function:
    """f_0 .. f_count, and those of f'."""
    at, c, p, k, u = _symbols(2, 1, a, n, (n, a), kind=ca.MX)
    s = ca.sqrt(at[1] + FLOOR)
    regular = _regular(n, a)(at, c, p, k, u)  # (a, 2): of f and f', E of the derivatives between the kinks
    sums = _kink_sums(count, n, a)(at, k, u) if n else None  # (a, count): sum over kinks of change_j phi h_i
    found = []
    for slope in range(2):
        row = [regular[i, slope] * s**i / math.sqrt(math.factorial(i)) for i in range(a)]
        total = ca.horzcat(*row, ca.MX.zeros(1, count + 1 - a))
        if sums is not None:
            for j in range(a - slope):  # the change in power j; impulses from derivative j + 1 on
                i = np.arange(count - j)
                weight = (-1.0) ** i * np.exp([(math.lgamma(x + 1) - math.lgamma(x + j + 2)) / 2 for x in i])
                factor = math.factorial(j + slope) * s**j
                total += ca.horzcat(ca.MX.zeros(1, j + 1), factor * ca.DM(weight).T * sums[j + slope, : count - j])
        found.append(total)
    return ca.Function("hermite", [at, c, p, k, u], found)


def _each(columns: Any, times: int) -> Any:
    """Every column so many times, one after the other."""
    return ca.reshape(ca.repmat(columns, times, 1), columns.shape[0], times * columns.shape[1])


def _added(function: ca.Function, times: int, same: list[Any], columns: list[Any]) -> Any:
    """The sum of a function over columns."""
    first = list(range(len(same)))
    return function.map(f"{function.name()}s", "serial", times, first, [0])(*same, *columns)


@lru_cache(maxsize=64)
def _kink_sums(count: int, n: int, a: int) -> ca.Function:
    """Sums over kinks of their changes times phi h_i, i < count."""
    at, kink = _symbols(2, 1)
    away = clipped((at[0] - kink) / ca.sqrt(at[1] + FLOOR))
    start = ca.Function("start", [at, kink], [away, density(away)]).map("starts", "serial", n, [0], [])
    at, k, u = _symbols(2, n, (n, a), kind=ca.MX)
    x, first = (ca.vec(row) for row in start(at, k.T))
    i = np.arange(count)
    factors = ca.DM(np.array([1 / np.sqrt(i + 1), np.sqrt(i / (i + 1))]))  # given as numbers: at 0 a root has no derivative
    _, _, sums = _recurrence(count, n, a)(first, ca.MX.zeros(n), x, u.T, factors)
    return ca.Function("kink_sums", [at, k, u], [sums])


@lru_cache(maxsize=64)
def _recurrence(count: int, n: int, a: int) -> ca.Function:
    """So many steps of h_(i+1) = (u h_i - sqrt(i) h_(i-1)) / sqrt(i + 1), of which twice as many are two calls.

    (h, that before it, u, changes, factors) -> both after them, sums of the changes times those met.
    """
    h, before, x, rows, factors = given = _symbols(n, n, n, (a, n), (2, count), kind=ca.MX)
    if count > STEPS:
        half, middle = _recurrence(count // 2, n, a), count // 2
        h, before, first = half(h, before, x, rows, factors[:, :middle])
        h, before, second = half(h, before, x, rows, factors[:, middle:])
        return ca.Function(f"recurrence{count}", given, [h, before, ca.horzcat(first, second)])
    met = []
    for i in range(count):
        met.append(h)
        h, before = factors[0, i] * x * h - factors[1, i] * before, h
    return ca.Function("recurrence", given, [h, before, ca.mtimes(rows, ca.horzcat(*met))])


@lru_cache(maxsize=16)
def _regular(n: int, a: int) -> ca.Function:
    """E of the derivatives 0 .. a - 1 of f, and of f', between the kinks."""
    at, c, p = _symbols(2, 1, a)
    moment = _pair(ca.vertcat(at, 0, 0, 0), {C: c, D: ca.SX(0)}).powers(C, D)
    smooth = ca.Function("smooth", [at, c, p], [_derivatives(p, lambda i: moment(i, 0))])
    at, k, u = _symbols(2, 1, a)
    beyond = Gaussian(at[0], at[1], {K: k})
    tails = ca.Function("tails", [at, k, u], [ca.cse(_derivatives(u, lambda i: beyond.tail_moment(K, i)))])
    at, c, p, k, u = _symbols(2, 1, a, n, (n, a), kind=ca.MX)
    total = smooth(at, c, p)
    if n:
        total += tails.map("each", "serial", n, [0], [0])(at, k.T, u.T)
    return ca.Function("regular", [at, c, p, k, u], [total])


def _derivatives(p: ca.SX, moment: Callable[[int], ca.SX]) -> ca.SX:
    """E of the derivatives of sum p_i x^i, and of its first derivative, from E[x^i]."""
    a = p.numel()

    def of(order: int) -> ca.SX:
        return sum((math.perm(i, order) * p[i] * moment(i - order) for i in range(order, a)), start=ca.SX(0))

    return ca.vertcat(*(ca.horzcat(of(order), of(order + 1)) for order in range(a)))


@lru_cache(maxsize=16)
def _polynomials(a: int, b: int) -> ca.Function:
    here, c, p, d, q = _symbols(5, 1, a, 1, b)
    return ca.Function("polynomials", [here, c, p, d, q], [_three(p, q, _pair(here, {C: c, D: d}).powers(C, D))])


@lru_cache(maxsize=16)
def _tail(a: int, b: int) -> ca.Function:
    here, d, q, k, u = _symbols(5, 1, b, 1, a)
    tail = _pair(here, {K: k, D: d}).tail(K)
    return ca.Function("tail", [here, d, q, k, u], [ca.cse(_three(u, q, lambda i, j: tail.moment(i, D, j)))])


@lru_cache(maxsize=16)
def _corner(a: int, b: int) -> ca.Function:
    here, k, u, l, v = _symbols(5, 1, a, 1, b)
    total = _three(u, v, _pair(here, {K: k, L: l}).corner(K, L).moment)
    return ca.Function("corner", [here, k, u, l, v], [ca.cse(total)])


def _symbols(*shapes: int | tuple[int, int], kind: type[Any] = ca.SX) -> list[Any]:
    """Vectors and matrices of symbols."""
    return [kind.sym(f"x{i}", *(shape if isinstance(shape, tuple) else (shape,))) for i, shape in enumerate(shapes)]


def _pair(here: ca.SX, env: dict[sp.Symbol, ca.SX]) -> Pair:
    x, y, covariance = Gaussian(here[0], here[1], env), Gaussian(here[2], here[3], env), here[4]
    return Pair(x, y, covariance)


def _three(p: ca.SX, q: ca.SX, moment: Callable[[int, int], ca.SX]) -> ca.SX:
    """E of sum p_i q_j x^i y^j, and of its two derivatives, from E[x^i y^j]."""
    total = [ca.SX(0)] * 3
    for i in range(p.numel()):
        for j in range(q.numel()):
            both = p[i] * q[j]
            total[0] += both * moment(i, j)
            if i:
                total[1] += i * both * moment(i - 1, j)
            if j:
                total[2] += j * both * moment(i, j - 1)
    return ca.vertcat(*total)
