"""Integrals of a smooth function times a measured curve: nodes that know nothing of its rows, weights that hold all of them.

On a part of the line, on which x runs from -1 to 1, the smooth function is the polynomial through its values at the n nodes of
Gauss and Legendre, and the integral of that against the curve is exact (product integration; A. Young, Proc. R. Soc. A 224
(1954), 552): the sum over the nodes with the curve f replaced by its expansion in the Legendre polynomials of degree below n,

    f^n(x) = sum_m (m + 1/2) P_m(x) int_{-1}^1 f(x') P_m(x') dx',

whose coefficients are sums over the rows, found once for all nodes of a part. The same holds for f', which the gain takes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Slice
from cadet_sym.expectation.panels import REACH, SPACED, density, legendre
from cadet_sym.expectation.quadrature import NARROW
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.nodes import at_once, passed_over, sums_at
from cadet_sym.lowering.tables import plain, row_at, rows_of

if TYPE_CHECKING:
    from cadet_sym.expectation.tables import Table
    from cadet_sym.lowering.crossings import MeanLine
    from cadet_sym.lowering.gaussian import Gaussian

READ = 6  # numbers that `read` finds


def read(table: Table, outer: Gaussian) -> ca.SX:
    """Of the outer argument mean and standard deviation, the same of what the curve is read at, its slope and its factor.

    The second standard deviation has the sign of the slope.
    """
    slope = outer.value(table.slope)
    mean = slope * outer.m + outer.value(table.offset)
    return ca.vertcat(outer.m, outer.s, mean, slope * outer.s, slope, outer.value(table.factor))


def square_of_row(table: Table, outer: Gaussian) -> ca.SX:
    """The square of the distance of the mean from the nearest row, in the outer argument."""
    slope, mean = read(table, outer)[4], read(table, outer)[2]
    row = row_at(table, mean)
    return (ca.fmin(mean - row[0], row[1] - mean) / slope) ** 2


def around_mean(table: Table, outer: Gaussian) -> ca.SX:
    """The polynomial that the curve is around the mean: slope and offset of what it is a polynomial of, its coefficients."""
    slope, row = outer.value(table.slope), row_at(table, read(table, outer)[2])
    return ca.vertcat(slope, outer.value(table.offset) - row[2], outer.value(table.factor) * row[3:])


@lru_cache(maxsize=256)
def curve_sums(piece: Slice, free: tuple[sp.Symbol, ...], parts: int, in_line: bool) -> ca.Function:
    """(parts of the line, `is_narrow`, `read`, means, lean, covariances, parameters) -> sums over all of them."""
    part = _on_part(piece, free, in_line)
    inputs = [ca.MX.sym(f"x{k}", part.size1_in(k)) for k in range(part.n_in())]
    there = inputs[0][1] != inputs[0][0]
    some = ca.Function("part", inputs, [passed_over(part, in_line=in_line)(there, *inputs)])
    ends, same = ca.MX.sym("ends", 2, parts), inputs[1:]
    total = some.map("parts", "serial", parts, list(range(1, part.n_in())), [0])(ends, *same)
    return ca.Function("nested", [ends, *same], [total], {} if in_line else {"never_inline": True})


def falling(known: ca.SX, ends: list[tuple[ca.SX, ca.SX]]) -> ca.SX:
    """Parts of the line from where the curve is read at more to where it is at less.

    So a row at which one begins, as at zero in a state of rest, is a row of it and not of the one that ends there.
    """
    pairs = ((ca.fmin(*pair), ca.fmax(*pair)) for pair in ends)
    return ca.horzcat(*(ca.if_else(known[3] > 0, ca.vertcat(high, low), ca.vertcat(low, high)) for low, high in pairs))


def is_narrow(piece: Slice, line: MeanLine) -> ca.SX:
    """Whether what is left of the other argument varies so little that fewer nodes are enough for it.

    The variable in which they are equally spaced runs over asinh(l sinh(REACH/l)/w) to either side at the most, w the width of
    the steep place in standard deviations and l the length from which on they are so in the argument itself.
    """
    longest = ca.SX(0)
    for width in _widths(piece) or ():
        w = line.outer.value(width) / ca.sqrt(line.left[0])
        far = ca.sqrt(w * w + SPACED**2)
        longest = ca.fmax(longest, ca.asinh(far / w * ca.sinh(REACH / far)))
    return 2 * longest < NARROW


def _widths(piece: Slice) -> list[sp.Expr] | None:
    """Of the steep places of functions of the one other argument that take many nodes; None if they move with the outer one."""
    functions = [f for df in (piece.inner, piece.slope) for p in df.products if isinstance(p, Product) for _, f in p.functions]
    widths = [place.width for f in functions for part in f.integrals if not part.is_coarse for place in part.steep]
    return None if len(piece.inner.arguments) > 1 or any(w.has(piece.symbol) for w in widths) else widths


def _coarser(df: DescribingFunction) -> DescribingFunction:
    """The same with as few nodes as are enough where `is_narrow` holds."""
    products = (
        replace(p, functions=tuple((i, f.coarser()) for i, f in p.functions)) if isinstance(p, Product) else p
        for p in df.products
    )
    return replace(df, products=tuple(products))


@dataclass(frozen=True)
class _Part:
    """A stretch of the line from u = first to last, on which x runs from -1 to 1."""

    ends: ca.SX
    known: ca.SX  # as `read` has it

    @property
    def slope(self) -> ca.SX:
        """Of u in x."""
        return (self.ends[1] - self.ends[0]) / 2

    @property
    def fall(self) -> ca.SX:
        """Of what the curve is read at, in x."""
        return self.known[3] * self.slope

    def read_at(self, u: ca.SX) -> ca.SX:
        """What the curve is read at."""
        return self.known[2] + self.known[3] * u

    def passes(self, z: ca.SX) -> ca.SX:
        """Where the curve is read at z."""
        return ((z - self.known[2]) / self.known[3] - self.ends[0]) / self.slope - 1


def _on_part(piece: Slice, free: tuple[sp.Symbol, ...], in_line: bool) -> ca.Function:
    """(the ends of a part, `read`, means, lean, covariances, parameters) -> what it adds."""
    assert piece.table is not None
    table, order = plain(replace(piece.table, written_out=in_line)), piece.part.rule.order
    part = _Part(ca.SX.sym("ends", 2), ca.SX.sym("read", READ))
    functions = [(piece.inner, piece.slope)]
    if _widths(piece):
        functions.append((_coarser(piece.inner), _coarser(piece.slope)))
    several = [sums_at(*each, free, at_once(order), 1, True) for each in functions]
    sums = several[0]
    narrow, given = ca.MX.sym("narrow"), [ca.MX.sym("ends", 2), ca.MX.sym("read", READ)]
    same = [ca.MX.sym(f"same{k}", sums.size1_in(k)) for k in range(4, 8)]
    curve = _by_changes(table, part, order) if table.degree == 1 else _by_rows(table, part, order, in_line)
    together = sums.size1_in(0)
    x, w = np.polynomial.legendre.leggauss(order)
    expanded = np.polynomial.legendre.legvander(x, order - 1) * (np.arange(order) + 0.5)
    columns = [ca.DM(column.reshape(order // together, -1).T) for column in (x, w, expanded)]
    inputs = [curve(*given), *given, *same]
    symbols = [ca.MX.sym(f"x{k}", *each.shape) for k, each in enumerate(inputs)]
    totals: list[ca.Function] = []
    for each in several:
        node = _nodes(part, order, each)
        total = node.map("nodes", "serial", order // together, list(range(3, 3 + len(inputs))), [0])(*columns, *symbols)
        totals.append(ca.Function("sums", symbols, [total]))
    total = totals[0](*inputs)
    if len(totals) > 1:
        total = ca.Function.conditional("sums", totals[:1], totals[-1])(narrow, *inputs)
    return ca.Function("part", [given[0], narrow, given[1], *same], [total])


def _by_changes(table: Table, part: _Part, order: int) -> ca.Function:
    """(ends, `read`) -> Legendre's coefficients of f^n and of that of the derivative, for a curve of straight lines.

    With I_1 the integral of P_m from x to 1 and I_2 that of I_1, the integral of (x' - x) P_m(x') is I_2, and
    (2 m + 1) I_{j+1,m} = I_{j,m-1} - I_{j,m+1}.
    """
    knot, change = ca.SX.sym("knot"), ca.SX.sym("change")
    first, last = (part.read_at(end) for end in ca.vertsplit(part.ends))
    is_passed = ca.logic_and(first >= knot, knot > last)
    x = ca.if_else(is_passed, part.passes(knot), 1)
    P = _legendre(x, order + 2)
    once = [1 - x, *((P[m - 1] - P[m + 1]) / (2 * m + 1) for m in range(1, order + 1))]
    twice = [(1 - x) ** 2 / 2, *((once[m - 1] - once[m + 1]) / (2 * m + 1) for m in range(1, order))]
    added = -change * ca.vertcat(*(part.fall * value for value in twice), *once[:order])
    passed = ca.Function("passed", [knot, change, part.ends, part.known], [ca.cse(ca.if_else(is_passed, added, 0))])
    line, start = ca.SX.sym("line", 3), part.read_at(part.ends[0])
    middle = line[1] + line[2] * (start + part.fall - line[0])
    none = ca.SX.zeros(order - 2)
    along = ca.vertcat(2 * middle, 2 * line[2] * part.fall / 3, none, 2 * line[2], 0, none)
    straight = ca.Function("straight", [line, part.ends, part.known], [along])
    begin = ca.Function("begin", [part.ends, part.known], [start])
    given = [ca.MX.sym("ends", 2), ca.MX.sym("read", READ)]
    rows = [ca.DM(np.array(each)).T for each in (table.knots, [change[1] for change in table.changes])]
    changes = passed.map("rows", "serial", len(table.knots), [2, 3], [0])(*rows, *given)
    return ca.Function("curve", given, [straight(row_at(table, begin(*given))[2:], *given) + changes])


def _by_rows(table: Table, part: _Part, order: int, in_line: bool) -> ca.Function:
    """The same for a curve of polynomials, on every row by Gauss and Legendre's rule that is exact for it times P_m.

    What changes at a row is not seen from afar: its powers would cancel where rows are narrow for the distribution.
    """
    low, high, row = ca.SX.sym("low"), ca.SX.sym("high"), ca.SX.sym("row", table.degree + 2)
    first, last = (part.read_at(end) for end in ca.vertsplit(part.ends))
    begin = ca.if_else(high <= first, part.passes(high), -1)
    end = ca.if_else(low > last, part.passes(low), 1)
    powers = [(n, row[1 + n]) for n in range(table.degree, -1, -1)]
    value, rate = ca.vertcat(*(c for _, c in powers)), ca.vertcat(*(n * c for n, c in powers[:-1]))
    total = ca.SX.zeros(2 * order)
    for t, w in zip(*legendre((order + table.degree) // 2 + 1), strict=True):
        x = begin + (end - begin) * t
        z = first + part.fall * (x + 1) - row[0]
        P = ca.vertcat(*_legendre(x, order))
        total += (end - begin) * w * ca.vertcat(ca.polyval(value, z) * P, ca.polyval(rate, z) * P)
    inputs = [low, high, row, part.ends, part.known]
    is_met = ca.logic_and(low <= first, high > last)
    met = ca.Function("met", inputs, [is_met])
    symbols = [ca.MX.sym(f"x{k}", *each.shape) for k, each in enumerate(inputs)]
    row_met = passed_over(ca.Function("row", inputs, [total]), in_line=in_line)(met(*symbols), *symbols)
    of_row = ca.Function("row", symbols, [row_met])
    given = [ca.MX.sym("ends", 2), ca.MX.sym("read", READ)]
    rows = rows_of(table)
    columns = [ca.DM(each).T for each in (rows[:, 0], rows[:, 1], rows[:, 2:])]
    return ca.Function("curve", given, [of_row.map("rows", "serial", len(rows), [3, 4], [0])(*columns, *given)])


def _legendre(x: ca.SX, count: int) -> list[ca.SX]:
    """The first so many Legendre polynomials."""
    P = [ca.SX(1), x]
    for m in range(1, count - 1):
        P.append(((2 * m + 1) / (m + 1)) * x * P[m] - (m / (m + 1)) * P[m - 1])
    return P[:count]


def _nodes(part: _Part, order: int, sums: ca.Function) -> ca.Function:
    """(x, w, Legendre polynomials there, coefficients, ends, `read`, as `sums_at`) -> what a few nodes add."""
    together = sums.size1_in(0)
    x, w, expanded = ca.SX.sym("x", together), ca.SX.sym("w", together), ca.SX.sym("P", together * order)
    curve = ca.SX.sym("curve", 2 * order)
    same = [ca.SX.sym(f"same{k}", sums.size1_in(k)) for k in range(4, 8)]
    mean, s, _, _, slope, factor = ca.vertsplit(part.known)
    u = part.ends[0] + part.slope * (x + 1)
    P = ca.reshape(expanded, order, together).T
    weight = factor * ca.fabs(part.slope) * w * density(u, CasadiAlgebra())
    value, rate = (weight * ca.mtimes(P, each) for each in (curve[:order], curve[order:]))
    total = sums(mean + s * u, u, value, slope * rate, *same)
    return ca.Function("nodes", [x, w, expanded, curve, part.ends, part.known, *same], [total])
