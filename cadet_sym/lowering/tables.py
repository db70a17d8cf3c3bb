"""Expectation of a measured curve: all its knots at once, as columns, or of many by functions called for each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import sympy as sp

from cadet_sym.expectation.panels import legendre
from cadet_sym.expectation.tables import Table
from cadet_sym.expectation.univariate import STEEP
from cadet_sym.lowering.complex import Complex
from cadet_sym.lowering.special import clipped, density, density_sum, hermite, magnitude, mills_moments

if TYPE_CHECKING:
    from cadet_sym.lowering.gaussian import Gaussian

NARROW, NARROW_ORDER = 2.0, 14
"""Standard deviations over which a polynomial times the density is integrated to the last digit by so many nodes."""

FAR_OFF = 1e100
"""Where a row ends that does not."""

SERIES = {0.2: 12, NARROW: 31}
"""The same by so many terms of the density's series about the middle; |phi^(k)| <= 0.44 sqrt(k!)."""


def table_moment(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """d^order/dm^order of E[factor * curve(slope z + offset)]."""
    moment = _by_calls if table.is_long and not table.written_out else _in_line
    total = moment(table, gaussian, order)
    return gaussian.value(table.factor) * gaussian.value(table.slope) ** order * total


def _in_line(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The same for the curve itself, of scalar operations alone."""
    total = _together(table, gaussian, order)
    if table.degree >= STEEP and len(table.knots) > 1:
        widest, s = max(np.diff(table.knots)), moments_of(table, gaussian)[2]
        apart = _together(table.ends(), gaussian, order) + _between(table, gaussian, order)
        total = ca.if_else(widest < NARROW * s, apart, total)
    return total


def _together(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The polynomial around the mean, and the changes at the knots beyond them as seen from there."""
    mean, p, _ = moments_of(table, gaussian)
    total = _segments(table, mean, p, order)
    return total + _tails(table, gaussian, order) if table.knots else total


def _between(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The polynomials between the knots, where the distribution is wider: row by row, by Gauss and Legendre's rule."""
    mean, _, s = moments_of(table, gaussian)
    x, weights = _nodes_between(table)
    return density_sum(ca.DM(weights), ca.DM(x), mean, s, order)


def _nodes_between(table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of a rule for every row, and weights with the curve in them."""
    nodes, weights = legendre(NARROW_ORDER)
    x, values = _on_rows(table, nodes)
    return x.ravel(), (values * weights * np.diff(table.knots)[:, None]).ravel()


def _on_rows(table: Table, nodes: npt.NDArray[np.float64]) -> tuple[np.ndarray, np.ndarray]:
    """Places from 0 to 1 along every row, (rows, nodes), and the curve there."""
    x = np.array(table.knots[:-1])[:, None] + np.diff(table.knots)[:, None] * nodes
    values = np.zeros_like(x)
    for column in reversed(np.array(table.segments[1:-1]).T):
        values = values * (x - np.array(table.centres[1:-1])[:, None]) + column[:, None]
    return x, values


def moments_of(table: Table, gaussian: Gaussian) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Mean, variance and standard deviation of what the curve is read at."""
    slope = gaussian.value(table.slope)
    mean = slope * gaussian.m + gaussian.value(table.offset)
    return mean, slope * slope * gaussian.p, ca.fabs(slope) * gaussian.s


def _derivatives(rows: tuple[tuple[float, ...], ...], order: int) -> np.ndarray:
    """Coefficients of the derivative of the polynomials, (rows, degree + 1 - order)."""
    coefficients = np.array(rows)
    for _ in range(order):
        coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])
    return coefficients


def polynomial_at(table: Table, mean: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Centre and coefficients of the polynomial around the mean."""
    row = row_at(table, mean)
    return row[2], row[3:]


def row_at(table: Table, mean: Any) -> Any:
    """Where the row around the mean, SX or MX, begins and ends, its centre, its coefficients."""
    if table.is_long and not table.written_out:
        return _around(plain(table))(mean)
    return ca.mtimes(ca.DM(rows_of(table)).T, _here(table, mean))


def rows_of(table: Table) -> np.ndarray:
    """Where rows begin and end, their centres, their coefficients, (rows, 4 + degree)."""
    knots = np.array(table.knots)
    return np.column_stack([np.append(-FAR_OFF, knots), np.append(knots, FAR_OFF), table.centres, table.segments])


def _here(table: Table, mean: ca.SX) -> ca.SX:
    """One for the interval in which the mean is, zero for all others."""
    if not table.knots:
        return ca.SX(1)
    above = mean >= ca.DM(table.knots)
    return ca.vertcat(1, above) * ca.vertcat(1 - above, 1)


def _segments(table: Table, mean: ca.SX, p: ca.SX, order: int) -> ca.SX:
    """E of the polynomial around the mean, as if it held everywhere."""
    coefficients = _derivatives(table.segments, order)
    if coefficients.shape[1] == 0:
        return ca.SX(0)
    here = _here(table, mean)
    h = mean - ca.DM(table.centres)
    # where the mean is not, the distance is taken as zero: a number far too large must not come in times zero
    h = ca.if_else(here > 0, h, 0)
    powers = [ca.SX.ones(len(table.centres)), h]
    for n in range(2, coefficients.shape[1]):
        powers.append(h * powers[n - 1] + (n - 1) * p * powers[n - 2])
    value = sum((ca.DM(c) * x for c, x in zip(coefficients.T, powers, strict=False)), start=ca.SX(0))
    return ca.dot(here, value)


def _tails(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The changes at the knots, each beyond its knot as seen from the mean; impulses where a derivative jumps."""
    mean, _, s = moments_of(table, gaussian)
    if table not in gaussian.columns:
        u = clipped((mean - ca.DM(table.knots)) / s)
        ratios = mills_moments(Complex(magnitude(u)), table.degree + 1)
        gaussian.columns[table] = u, density(u), ca.if_else(u >= 0, -1, 1), [r.real for r in ratios]
    u, phi, side, ratios = gaussian.columns[table]
    total = ca.SX.zeros(len(table.knots))
    for n, column in enumerate(_derivatives(table.changes, order).T):
        if np.any(column):
            total += ca.DM(column) * (s**n * ratios[n] if n % 2 else s**n * ratios[n] * side)
    for j in range(order):  # the j-th derivative jumps by j! c_j
        jumps = _derivatives(table.changes, j)
        i = order - 1 - j
        if jumps.shape[1] and np.any(jumps[:, 0]):
            total += ca.DM(jumps[:, 0]) * (-1) ** i * hermite(u, i) / s ** (i + 1)
    return ca.dot(phi, total)


# -- by calls ---------------------------------------------------------------------------------------------------------


def _by_calls(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The same by a function that is called, of all orders up to this one, or the first, at once."""
    orders = max(order, 1) + 1
    if (table, orders) not in gaussian.curves:
        gaussian.curves[table, orders] = _curve(plain(table), orders)(ca.vertcat(*moments_of(table, gaussian)))
    return gaussian.curves[table, orders][order]


def plain(table: Table) -> Table:
    """The curve itself, read at its argument."""
    return replace(table, factor=sp.S.One, slope=sp.S.One, offset=sp.S.Zero)


@lru_cache(maxsize=64)
def _around(table: Table) -> ca.Function:
    """Mean -> centre and polynomial of the row in which it is."""
    low, high, mean, row = ca.SX.sym("low"), ca.SX.sym("high"), ca.SX.sym("mean"), ca.SX.sym("row", table.degree + 4)
    here = ca.if_else(ca.logic_and(mean >= low, mean < high), row, 0)
    of_row = ca.Function("row", [low, high, row, mean], [here])
    at, knots = ca.MX.sym("mean"), np.array(table.knots)
    rows = rows_of(table)
    low, high = (ca.DM(each).T for each in (np.append(-np.inf, knots), np.append(knots, np.inf)))
    total = of_row.map("rows", "serial", len(rows), [3], [0])(low, high, ca.DM(rows).T, at)
    return ca.Function("around", [at], [total], {"never_inline": True})


@lru_cache(maxsize=64)
def _curve(table: Table, orders: int) -> ca.Function:
    """(mean, variance, standard deviation) -> derivatives of E[curve] in the mean, from 0 on."""
    at = ca.MX.sym("at", 3)
    total = _sum_over_rows(table, orders)
    if table.degree < STEEP:
        return ca.Function("curve", [at], [total(at)], {"never_inline": True})
    ends, widest = _sum_over_rows(table.ends(), orders), float(max(np.diff(table.knots)))
    apart = [ca.Function("apart", [at], [ends(at) + _stretches(table, orders, count)(at)]) for count in SERIES.values()]
    rung = sum((widest >= ratio * at[2] for ratio in SERIES), start=ca.MX(0))
    choice = ca.Function.conditional("choice", apart, total)
    return ca.Function("curve", [at], [choice(rung, at)], {"never_inline": True})


def _sum_over_rows(table: Table, orders: int) -> ca.Function:
    """at -> what the polynomial around the mean and the changes at the knots make."""
    at = ca.MX.sym("at", 3)
    knots, changes, segments = (np.array(each) for each in (table.knots, table.changes, table.segments))
    present = tuple(int(n) for n in np.flatnonzero(np.any(changes != 0, axis=0)))
    low, high = np.append(-np.inf, knots), np.append(knots, np.inf)
    rows = _over(_row(table.degree, orders), at, [low, high, table.centres, *segments.T])
    return ca.Function("curve", [at], [rows + _over(_knot(present, orders), at, [knots, *changes[:, list(present)].T])])


def _stretches(table: Table, orders: int, count: int) -> ca.Function:
    """At -> the polynomials between the knots, each on its own row, by so many terms of the density's series there."""
    at, half = ca.MX.sym("at", 3), np.diff(table.knots) / 2
    nodes, weights = legendre((table.degree + count) // 2 + 1)
    _, values = _on_rows(table, nodes)
    powers = np.vander(2 * nodes - 1, count, increasing=True) / [float(math.factorial(k)) for k in range(count)]
    moments = 2 * half[:, None] * (values * weights) @ powers
    columns = [table.knots[:-1] + half, half, 1 / half, *moments.T]
    return ca.Function("stretches", [at], [_over(_stretch(count, orders), at, columns)])


@lru_cache(maxsize=16)
def _stretch(count: int, orders: int) -> ca.Function:
    """(at, middle, half the width H and 1/H, C_k) -> E of what is on a row and its derivatives; C_k = int f (x/H)^k dx / k!.

    With x and u the distances of a point from the middle, and of that from the mean in standard deviations,
    phi(u + x/s) = sum_k D_k (x/H)^k / k!, D_k = (-H/s)^k He_k(u) phi(u); one D further on, it is the derivative's.
    """
    at, middle, half, inverse = ca.SX.sym("at", 3), ca.SX.sym("middle"), ca.SX.sym("half"), ca.SX.sym("inverse")
    own, scale = [ca.SX.sym(f"c{k}") for k in range(count)], 1 / at[2]
    u, r = clipped((middle - at[0]) * scale), half * scale
    first, second = -u * r, r * r
    terms = [density(u), first * density(u)]
    for k in range(1, count + orders - 2):
        terms.append(first * terms[k] - k * second * terms[k - 1])
    totals = [sum((c * d for c, d in zip(own, terms[order:], strict=False)), start=ca.SX(0)) for order in range(orders)]
    scaled = [(-1) ** order * scale * inverse**order * total for order, total in enumerate(totals)]
    return ca.Function("stretch", [at, middle, half, inverse, *own], [ca.cse(ca.vertcat(*scaled))])


def _over(function: ca.Function, at: ca.MX, columns: Sequence[npt.ArrayLike]) -> ca.MX:
    """The sum of a function of `at` and a number of each column over these; every column is an argument of its own."""
    count = np.size(columns[0])
    total = function.map(f"{function.name()}s", "serial", count, [0], [0])
    return total(at, *(ca.DM(np.array(each)).T for each in columns))


@lru_cache(maxsize=16)
def _row(degree: int, orders: int) -> ca.Function:
    """(at, low, high, centre, coefficients) -> E of a polynomial and its derivatives, if the mean is from low up to high."""
    at, low, high, centre = ca.SX.sym("at", 3), ca.SX.sym("low"), ca.SX.sym("high"), ca.SX.sym("centre")
    own = [ca.SX.sym(f"c{n}") for n in range(degree + 1)]
    here = ca.logic_and(at[0] >= low, at[0] < high)
    h = ca.if_else(here, at[0] - centre, 0)
    powers = [ca.SX(1), h]
    for n in range(2, degree + 1):
        powers.append(h * powers[n - 1] + (n - 1) * at[1] * powers[n - 2])
    values = [
        sum((math.perm(n, order) * own[n] * powers[n - order] for n in range(order, degree + 1)), start=ca.SX(0))
        for order in range(orders)
    ]
    return ca.Function("row", [at, low, high, centre, *own], [ca.cse(ca.if_else(here, ca.vertcat(*values), 0))])


@lru_cache(maxsize=16)
def _knot(present: tuple[int, ...], orders: int) -> ca.Function:
    """(at, knot, changes in these powers) -> what the changes add to E and its derivatives."""
    at, knot, own = ca.SX.sym("at", 3), ca.SX.sym("knot"), [ca.SX.sym(f"c{n}") for n in present]
    s, change = at[2], dict(zip(present, own, strict=True))
    u = clipped((at[0] - knot) / s)
    side, degree = ca.if_else(u >= 0, -1, 1), max(present, default=0)
    ratios = [r.real for r in mills_moments(Complex(magnitude(u)), degree + 1)]
    totals = []
    for order in range(orders):
        total = ca.SX(0)
        for n in range(degree + 1 - order):
            if n + order in change:
                ratio = ratios[n] if n % 2 else ratios[n] * side
                total += math.perm(n + order, order) * change[n + order] * s**n * ratio
        for j in range(order):  # the j-th derivative jumps by j! c_j
            if j in change:
                i = order - 1 - j
                total += math.factorial(j) * change[j] * (-1) ** i * hermite(u, i) / s ** (i + 1)
        totals.append(density(u) * total)
    return ca.Function("knot", [at, knot, *own], [ca.cse(ca.densify(ca.vertcat(*totals)))])
