"""What nodes of an integral over one argument add to E[f] and its gains, and what takes their place without variance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Slice
from cadet_sym.expectation.panels import Nodes, Panel, composite, density, finished
from cadet_sym.lowering.algebra import CasadiAlgebra

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

TOGETHER = 8  # nodes of one call, by which it is faster and larger


@lru_cache(maxsize=256)
def sums_at(
    df: DescribingFunction,
    slope: DescribingFunction,
    free: tuple[sp.Symbol, ...],
    count: int,
    turned: int,
    curved: bool = False,
) -> ca.Function:
    """What a few nodes add, (z, u, weights, means, lean, covariances, parameters) -> sums of F, E[slope] and gains.

    Functions under one distribution share what they need of it. z may be the distance from an end; `turned` is its derivative
    in the outer argument, 1 or -1. Where weights hold a curve, its derivative times the weights follows them.
    """
    size = len(df.means)
    columns = [ca.SX.sym(name, count) for name in ("z", "u", "weights", "rates")[: 3 + curved]]
    m, lean, S = ca.SX.sym("m", size), ca.SX.sym("lean", size), ca.SX.sym("S", len(df.covariances))
    same = [m, lean, S, ca.SX.sym("q", len(free) - 1)]
    node, total = _sums_at_one(df, slope, free, turned, same, curved), ca.SX.zeros(2 + size)
    for k in range(count):
        total += node(*(column[k] for column in columns), *same)
    total = ca.densify(total)
    arguments = [*columns, *same]
    function = ca.Function("nodes", arguments, [total])
    return function if function.find_functions() else ca.Function("nodes", arguments, [ca.cse(total)])


def _sums_at_one(
    df: DescribingFunction,
    slope: DescribingFunction,
    free: tuple[sp.Symbol, ...],
    turned: int,
    same: list[ca.SX],
    curved: bool,
) -> ca.Function:
    """The same of one node, written out once for all of them."""
    from cadet_sym.lowering.joint import Joint

    z, u, weight, rate = (ca.SX.sym(name) for name in ("z", "u", "weight", "rate"))
    m, lean, S, q = same
    joint = Joint(m + lean * u, S, dict(zip(free, (z, *ca.vertsplit(q)), strict=True)))
    F, gain = joint.expectation_and_gain(df)
    values = ca.vertcat(F, joint.expectation(slope) + turned * _moving_jumps(df, joint, free[0]), gain)
    if curved:
        values = weight * values + ca.vertcat(0, rate * F, ca.SX.zeros(len(df.means)))
        return ca.Function("node", [z, u, weight, rate, *same], [values])
    return ca.Function("node", [z, u, weight, *same], [weight * ca.if_else(weight != 0, values, 0)])


@lru_cache(maxsize=256)
def expanded(df: DescribingFunction, free: tuple[sp.Symbol, ...], turned: int, degree: int = 0) -> ca.Function:
    """(z, S_zz, S_zi, means, covariances of the others, parameters, curve) -> E[f], gains, to second order in the outer one.

    If there is a degree, f is multiplied by a polynomial of slope z + offset: `curve` are slope, offset and coefficients.
    """
    from cadet_sym.lowering.joint import Joint

    size = len(df.means)
    z, p, c = ca.SX.sym("z"), ca.SX.sym("p"), ca.SX.sym("c", size)
    m, S, q = ca.SX.sym("m", size), ca.SX.sym("S", len(df.covariances)), ca.SX.sym("q", len(free) - 1)
    curve = ca.SX.sym("curve", degree + 3 if degree else 0)
    F = Joint(m, S, dict(zip(free, (z, *ca.vertsplit(q)), strict=True))).expectation(df)
    if degree:
        F *= ca.polyval(ca.vertcat(*reversed(ca.vertsplit(curve[2:]))), curve[0] * z + curve[1])

    def across(value: ca.SX) -> ca.SX:
        return ca.dot(c, ca.gradient(value, m))

    slope = turned * ca.jacobian(F, z)
    bend = turned * ca.jacobian(slope, z)
    value = F + across(slope) + (p * bend + across(across(bend))) / 2
    total = ca.vertcat(value, slope + across(bend), ca.gradient(value, m))
    return ca.Function("expanded", [z, p, c, m, S, q, curve], [ca.densify(total)])


@lru_cache(maxsize=256)
def called(nodes: ca.Function, calls: int) -> ca.Function:
    """`sums_at` of many columns of nodes, never put in line."""
    columns = [ca.MX.sym(name, nodes.size1_in(k), calls) for k, name in enumerate(("z", "u", "weights"))]
    same = [ca.MX.sym(f"same{k}", nodes.size1_in(k)) for k in range(3, 7)]
    total = nodes.map("many", "serial", calls, [3, 4, 5, 6], [0])(*columns, *same)
    return ca.Function("nested", [*columns, *same], [total], {"never_inline": True})


@dataclass(frozen=True)
class Frame:
    """What the nodes of a slice have in common."""

    m: ca.SX
    s: ca.SX
    end: ca.SX  # where the stretch begins, seen from a singular end
    beyond: ca.SX  # how far the mean is within a singular end
    gap: ca.SX  # how far that is out of reach
    somewhere: ca.SX  # a point within the slice: what has no weight must have derivatives all the same

    def placed(self, piece: Slice, nodes: Nodes) -> tuple[ca.SX, ca.SX]:
        """What the functions of a slice are taken at, the outer argument or its distance from a singular end; the weights."""
        points, weight = self.m + self.s * nodes.u, nodes.weight
        if (place := piece.part.singular_end) is not None:
            assert nodes.distance is not None
            points = ca.if_else(self.gap > 0, self.beyond - place[1] * self.s * nodes.u, self.s * nodes.distance)
            weight = ca.if_else(points > 0, weight, 0)  # at the end itself derivatives have no value
        return ca.if_else(weight != 0, points, self.somewhere), weight


def sums_on(piece: Slice, panel: Panel, free: tuple[sp.Symbol, ...]) -> ca.Function:
    """(is there anything of it, numbers of the panel, `Frame`, means, lean, covariances, parameters) -> what a panel adds."""
    return _sums_on(piece, panel.run, len(panel.numbers), panel.parts, panel.order, free)


@lru_cache(maxsize=512)
def _sums_on(
    piece: Slice, run: Callable[..., Nodes], size: int, parts: int, order: int, free: tuple[sp.Symbol, ...]
) -> ca.Function:
    count, xp = parts * order, CasadiAlgebra()
    together = at_once(count)
    t, w = ca.SX.sym("t", together), ca.SX.sym("w", together)
    numbers, known = ca.SX.sym("numbers", size), ca.SX.sym("frame", len(fields(Frame)))
    frame = Frame(*ca.vertsplit(known))
    nodes = run(t, w, xp, *ca.vertsplit(numbers))
    nodes = finished(piece.part, replace(nodes, weight=nodes.weight * density(nodes.u, xp)), frame.end, xp)
    sums = sums_at(piece.inner, piece.slope, free, together, turned(piece))
    same = [ca.SX.sym(f"same{k}", sums.size1_in(k)) for k in range(3, 7)]
    points, weight = frame.placed(piece, nodes)
    node = ca.Function("nodes", [t, w, numbers, known, *same], [sums(points, nodes.u, weight, *same)])
    inputs = [ca.MX.sym(f"x{k}", node.size1_in(k)) for k in range(2, 8)]
    rule = [ca.reshape(ca.DM(x), together, count // together) for x in composite(parts, order)]
    total = node.map("many", "serial", count // together, list(range(2, 8)), [0])(*rule, *inputs)
    there, some = ca.MX.sym("there"), passed_over(ca.Function("panel", inputs, [total]))
    return ca.Function("nested", [there, *inputs], [some(there, *inputs)], {"never_inline": True})


def passed_over(function: ca.Function, *, in_line: bool = False) -> ca.Function:
    """(is there anything, inputs) -> what a function of columns gives, which is not evaluated where there is nothing.

    In line it is, and multiplied by zero.
    """
    inputs = [ca.MX.sym(f"x{k}", function.size1_in(k)) for k in range(function.n_in())]
    there, name = ca.MX.sym("there"), function.name()
    if in_line:
        return ca.Function(name, [there, *inputs], [ca.if_else(there, function(*inputs), 0)])
    none = ca.Function("none", inputs, [_nothing(inputs, function.size1_out(0))])
    return ca.Function(name, [there, *inputs], [ca.Function.conditional(name, [none], function)(there, *inputs)])


def _nothing(inputs: list[ca.MX], size: int) -> ca.MX:
    """Zeros that CasADi does not know to be zero: functions that one is chosen from have entries in the same places."""
    total = sum((ca.sum1(each) for each in inputs if each.numel()), start=ca.MX(0))
    return ca.repmat(ca.fmax(ca.fmin(total, 0), 1) - 1, size, 1)


def at_once(count: int) -> int:
    """How many of so many nodes are taken in one call."""
    return next(k for k in range(min(TOGETHER, count), 0, -1) if count % k == 0)


def turned(piece: Slice) -> int:
    """The derivative of what a slice's functions are taken at in the outer argument, 1 or -1."""
    end = piece.part.singular_end
    return 1 if end is None else -end[1]


def _moving_jumps(df: DescribingFunction, joint: Joint, z: sp.Symbol) -> ca.SX:
    """E of what the derivative in z of jumps J 1(y > k(z)) adds to the slope: -J k'(z) times the density of y at k."""
    total = ca.SX(0)
    for product in df.products:
        if not isinstance(product, Product) or len(product.functions) != 1:
            continue
        ((i, function),) = product.functions
        y = joint.marginal(i)
        for jump in function.jumps if not any(product.powers) else ():
            size = jump.size(0) * sp.diff(jump.position, z)
            if size != 0:
                total -= y.complex_value(product.coefficient * size).real * y.impulse(jump.position, 0)
    return total
