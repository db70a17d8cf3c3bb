"""Integrals of a smooth function times a measured curve: nodes that know nothing of its rows, weights that hold all of them.

On a part of the line, on which x runs from -1 to 1, the smooth function is the polynomial through its values at the n nodes of
Gauss and Legendre, and the integral of that against the curve is exact (product integration; A. Young, Proc. R. Soc. A 224
(1954), 552): the sum over the nodes with the curve f replaced by its expansion in the Legendre polynomials of degree below n.
With p the polynomial that f is where the part begins, and its i-th derivative changing by i! c_ki at row k, passed at x_k,

    f^n(x) = p(x) + sum_m (m + 1/2) P_m(x) sum_k sum_i c_ki int_{x_k}^1 (x' - x_k)^i P_m(x') dx'.

The sums over the rows are found once for all nodes of a part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import factorial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
import sympy as sp

from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Slice
from cadet_sym.expectation.panels import REACH, SPACED, density
from cadet_sym.expectation.quadrature import NARROW
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.nodes import at_once, nothing, sums_at
from cadet_sym.lowering.tables import plain, row_at

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
    if in_line:
        some = ca.Function("part", inputs, [ca.if_else(there, part(*inputs), 0)])
    else:
        none = ca.Function("none", inputs, [nothing(inputs, part.size1_out(0))])
        some = ca.Function("part", inputs, [ca.Function.conditional("part", [none], part)(there, *inputs)])
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

    def u(self, x: ca.SX) -> ca.SX:
        """Where x is on the line."""
        return self.ends[0] + self.slope * (x + 1)

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
    start = ca.Function("start", [part.ends, part.known], [part.read_at(part.ends[0])])(*given)
    passed, knots = _passed(table, part, order), np.array(table.knots)
    changes = [ca.DM(knots).T, ca.DM(np.array(table.changes)[:, 1:]).T]
    change = passed.map("rows", "serial", len(knots), [2, 3], [0])(*changes, *given)
    together = sums.size1_in(0)
    x, w = np.polynomial.legendre.leggauss(order)
    expanded = np.polynomial.legendre.legvander(x, order - 1) * (np.arange(order) + 0.5)
    columns = [ca.DM(column.reshape(order // together, -1).T) for column in (x, w, expanded)]
    inputs = [row_at(table, start)[2:], change, *given, *same]
    symbols = [ca.MX.sym(f"x{k}", *each.shape) for k, each in enumerate(inputs)]
    totals: list[ca.Function] = []
    for each in several:
        node = _nodes(table, part, order, each)
        total = node.map("nodes", "serial", order // together, list(range(3, 3 + len(inputs))), [0])(*columns, *symbols)
        totals.append(ca.Function("sums", symbols, [total]))
    total = totals[0](*inputs)
    if len(totals) > 1:
        total = ca.Function.conditional("sums", totals[:1], totals[-1])(narrow, *inputs)
    return ca.Function("part", [given[0], narrow, given[1], *same], [total])


def _passed(table: Table, part: _Part, order: int) -> ca.Function:
    """(a row, its changes, ends, `read`) -> Legendre's coefficients of what it adds to the curve and to its derivative.

    With I_1 the integral of P_m from x to 1 and I_j that of I_{j-1}, the integral of (x' - x)^i P_m(x') is i! I_{i+1}, and
    (2 m + 1) I_{j+1,m} = I_{j,m-1} - I_{j,m+1}.
    """
    knot, own, degree = ca.SX.sym("knot"), ca.SX.sym("change", table.degree), table.degree
    first, last = (part.read_at(end) for end in ca.vertsplit(part.ends))
    is_passed = ca.logic_and(first >= knot, knot > last)
    x, scale = ca.if_else(is_passed, part.passes(knot), 1), part.slope * part.known[3]
    below: list[ca.SX] = [ca.SX(1), x]
    for m in range(1, order + degree):
        below.append(((2 * m + 1) / (m + 1)) * x * below[m] - (m / (m + 1)) * below[m - 1])
    value, rate, first = ca.SX.zeros(order), ca.SX.zeros(order), 1 - x
    for j in range(1, degree + 2):
        integrals = [first, *((below[m - 1] - below[m + 1]) / (2 * m + 1) for m in range(1, len(below) - 1))]
        column = ca.vertcat(*integrals[:order])
        if j > 1:
            value += factorial(j - 1) * own[j - 2] * scale ** (j - 1) * column
        if j <= degree:
            rate += factorial(j) * own[j - 1] * scale ** (j - 1) * column
        below, first = integrals, first * (1 - x) / (j + 1)
    added = ca.if_else(is_passed, -ca.vertcat(value, rate), 0)
    return ca.Function("passed", [knot, own, part.ends, part.known], [ca.cse(added)])


def _nodes(table: Table, part: _Part, order: int, sums: ca.Function) -> ca.Function:
    """(x, w, Legendre polynomials there, p, coefficients, ends, `read`, as `sums_at`) -> what a few nodes add."""
    together = sums.size1_in(0)
    x, w, expanded = ca.SX.sym("x", together), ca.SX.sym("w", together), ca.SX.sym("P", together * order)
    row, change = ca.SX.sym("row", table.degree + 2), ca.SX.sym("change", 2 * order)
    same = [ca.SX.sym(f"same{k}", sums.size1_in(k)) for k in range(4, 8)]
    mean, s, _, _, slope, factor = ca.vertsplit(part.known)
    u = part.u(x)
    z = part.read_at(u) - row[0]
    P = ca.reshape(expanded, order, together).T
    value, rate = (ca.mtimes(P, each) for each in (change[:order], change[order:]))
    powers = [(n, row[1 + n]) for n in range(table.degree, -1, -1)]
    value += ca.polyval(ca.vertcat(*(c for _, c in powers)), z)
    rate += ca.polyval(ca.vertcat(*(n * c for n, c in powers[:-1])), z)
    weight = factor * ca.fabs(part.slope) * w * density(u, CasadiAlgebra())
    total = sums(mean + s * u, u, weight * value, slope * weight * rate, *same)
    return ca.Function("nodes", [x, w, expanded, row, change, part.ends, part.known, *same], [total])
