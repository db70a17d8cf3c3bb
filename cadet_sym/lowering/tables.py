"""Expectation of a measured curve: all its knots at once, as columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from cadet_sym.expectation.panels import legendre
from cadet_sym.expectation.tables import Table
from cadet_sym.expectation.univariate import STEEP
from cadet_sym.lowering.complex import Complex
from cadet_sym.lowering.special import clipped, density, density_sum, hermite, magnitude, mills_moments

if TYPE_CHECKING:
    from cadet_sym.lowering.gaussian import Gaussian

NARROW, NARROW_ORDER = 2.0, 14
"""Standard deviations over which a polynomial times the density is integrated to the last digit by so many nodes."""


def table_moment(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """d^order/dm^order of E[factor * curve(slope z + offset)]."""
    total = _together(table, gaussian, order)
    if table.degree >= STEEP and len(table.knots) > 1:
        widest, s = max(np.diff(table.knots)), moments_of(table, gaussian)[2]
        apart = _together(table.ends(), gaussian, order) + _between(table, gaussian, order)
        total = ca.if_else(widest < NARROW * s, apart, total)
    return gaussian.value(table.factor) * gaussian.value(table.slope) ** order * total


def _together(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The polynomial around the mean, and the changes at the knots beyond them as seen from there."""
    mean, p, _ = moments_of(table, gaussian)
    total = _segments(table, mean, p, order)
    return total + _tails(table, gaussian, order) if table.knots else total


def _between(table: Table, gaussian: Gaussian, order: int) -> ca.SX:
    """The polynomials between the knots, where the distribution is wider: row by row, by Gauss and Legendre's rule."""
    mean, _, s = moments_of(table, gaussian)
    knots, widths = np.array(table.knots[:-1]), np.diff(table.knots)
    nodes, weights = legendre(NARROW_ORDER)
    x = knots[:, None] + widths[:, None] * nodes
    rows, centres = np.array(table.segments[1:-1]), np.array(table.centres[1:-1])
    values = np.zeros_like(x)
    for column in reversed(rows.T):
        values = values * (x - centres[:, None]) + column[:, None]
    weighted = values * weights * widths[:, None]
    return density_sum(ca.DM(weighted.ravel()), ca.DM(x.ravel()), mean, s, order)


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
    here = _here(table, mean)
    return ca.dot(here, ca.DM(table.centres)), ca.mtimes(ca.DM(table.segments).T, here)


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
