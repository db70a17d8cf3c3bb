"""E of a polynomial times a power of a quadratic polynomial, as a function that CasADi calls and that knows its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.quadratic import QuadraticPower, Row, Shape, symmetric
from cadet_sym.expectation.tilted import COUNTS, Factor, Frame, Node, factors, frame_of, spread_out, tilted
from cadet_sym.expectation.univariate import Univariate
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.called import with_derivative
from cadet_sym.lowering.gaussian import Gaussian

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

FINER = 0.8  # the step for derivatives of the gains over that for E[f]
TOGETHER = 8  # nodes of one call, by which it is faster and larger; all of `COUNTS` are multiples of it
SEVERAL = 10  # rows with which it is half as many
DECIMALS = 6  # of the ends of the sums in scalar operations
XP = CasadiAlgebra(decimals=DECIMALS)


def quadratic_moments(function: QuadraticPower, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of every argument."""
    value, used, shape = joint.marginal(function.used[0]).value, function.used, function.shape
    T = ca.vertcat(*(ca.horzcat(*map(value, row[:-1])) for row in function.forms))
    m = T @ ca.vertcat(*(joint.m[i] for i in used)) + ca.vertcat(*(value(row[-1]) for row in function.forms))
    S = T @ ca.vertcat(*(ca.horzcat(*(joint.covariance(i, j) for j in used)) for i in used)) @ T.T
    known = [] if shape.cone else [value(function.constant)]
    known += [value(coefficient) for _, coefficient in function.terms]
    free = tuple(sorted(function.free, key=str)) if function.factor else ()
    known += [value(symbol) for symbol in free] + [value(function.exponent)] * shape.given
    moments = ca.vertcat(m, *(S[i, j] for i in range(shape.size) for j in range(i + 1)), *known)
    what = _Integrand(shape, function.factor, free)
    found = (_in_line(what, function.count) if function.count else _expectation(what, function.step))(moments)
    gains = T.T @ found[1:]
    return found[0], {i: gains[k] for k, i in enumerate(used)}


@dataclass(frozen=True)
class _Integrand:
    """What is integrated: monomials times a factor g in some parameters, which may be one, times a power."""

    shape: Shape
    factor: Univariate | None
    free: tuple[sp.Symbol, ...]

    def exponent(self, parameters: Sequence[ca.SX]) -> ca.SX | None:
        """p, the last of the parameters, if it is one."""
        return parameters[-1] if self.shape.given else None

    def expectations(self, parameters: Sequence[ca.SX]) -> Factor:
        """E[g] and its derivatives."""
        env, factor = dict(zip(self.free, parameters[: len(self.free)], strict=True)), self.factor
        if factor is None:
            return lambda m, p: lambda order: ca.SX(1)
        return lambda m, p: partial(Gaussian(m, p, env).expectation, factor)


@lru_cache(maxsize=256)
def _expectation(what: _Integrand, step: float) -> ca.Function:
    """(means of y, covariances, c if it is not zero, coefficients, parameters of g, p if that is given) -> E[f] and its gains.

    By the heat equation dF/dS_ii = (1/2) d2F/dm_i^2, dF/dS_ij = d2F/dm_i dm_j: finite without variance.
    """
    shape = what.shape
    n, sums = shape.size, _Sums(what, shape.gains, step, shape.floor(1))
    v, out = ca.MX.sym("v", sums.v.numel()), ca.MX.sym("out", n + 1)
    curved, more = shape.curvatures, shape.slopes
    found = _Sums(what, (*curved, *more), FINER * step, shape.floor(3)).function()(v)
    indices = [i for order in (2, 3) for i in symmetric(n, order)]
    at = {i: found[k] for k, i in enumerate(indices)}

    def derivative(*i: int) -> ca.MX:
        return at[tuple(sorted(i, reverse=True))]

    def heat(*before: int) -> list[ca.MX]:
        return [derivative(*before, i, j) * (0.5 if i == j else 1.0) for i in range(n) for j in range(i + 1)]

    rows = [[*(out[1 + i] for i in range(n)), *heat()]]
    rows += [[*(derivative(k, i) for i in range(n)), *heat(k)] for k in range(n)]
    slopes = ca.reshape(found[len(curved) :], n + 1, len(more) // (n + 1))
    jacobian = ca.horzcat(ca.vertcat(*(ca.horzcat(*row) for row in rows)), slopes)
    if sums.parameters:
        moved = _Sums(what, shape.gains, FINER * step, shape.floor(3), by_parameters=True).function()(v)
        jacobian = ca.horzcat(jacobian, ca.reshape(moved, n + 1, len(sums.parameters)))
    return with_derivative(v, sums.function()(v), ca.Function("jac_called", [v, out], [jacobian], ["v", "out_F"], ["jac_F_v"]))


@lru_cache(maxsize=256)
def _in_line(what: _Integrand, count: int) -> ca.Function:
    """The same of scalar operations alone, with as many nodes always."""
    shape = what.shape
    sums = _Sums(what, shape.gains, 1.0, shape.floor(1))
    frame, c, xp = sums.frame, sums.c, XP
    first, last, high = frame.first, xp.frozen(frame.last), xp.frozen(frame.high)  # the sum does not depend on where nodes are
    scale = ca.exp(xp.frozen(ca.log(frame.scale)))
    total = ca.SX(0)
    for k in range(count):
        steps = spread_out(first + (last - first) * (k / (count - 1)), high, xp)
        at = tilted(shape, sums.m, sums.S, c, ca.exp(steps[0]) / scale, xp)
        node = Node(
            shape, at, steps, scale, c, xp, what.expectations(sums.parameters), what.exponent(sums.parameters)
        )
        total += ca.vertcat(*node.sums(shape.gains, sums.coefficients))
    total *= (last - first) / (count - 1) * ca.vertcat(*factors(shape, shape.gains, scale, xp))
    return ca.Function("quadratic", [sums.v], [total])


@dataclass
class _Sums:
    """Some rows under one distribution, or their derivatives in the parameters of g and p, parameter by parameter."""

    what: _Integrand
    rows: Sequence[Row]
    step: float
    floor: float
    by_parameters: bool = False

    def __post_init__(self) -> None:
        self.shape = self.what.shape
        n, known = self.shape.size, int(not self.shape.cone)
        size = n * (n + 1) // 2
        self.v = ca.SX.sym("v", n + size + known + len(self.shape.monomials) + len(self.what.free) + self.shape.given)
        parts = ca.vertsplit(self.v)
        self.m, self.S = parts[:n], parts[n : n + size]
        self.c = parts[n + size] if known else ca.SX(0)
        self.coefficients = parts[n + size + known :][: len(self.shape.monomials)]
        self.parameters = parts[n + size + known + len(self.coefficients) :]

    @cached_property
    def frame(self) -> Frame:
        """The distribution in its principal axes."""
        return frame_of(self.shape, self.m, self.S, self.c, self.floor, XP)

    def function(self) -> ca.Function:
        """v -> the rows."""
        frame, count = self.frame, len(self.rows)
        rows = [*self.rows] * (len(self.parameters) if self.by_parameters else 1)
        scales = ca.vertcat(*factors(self.shape, rows, frame.scale, XP))
        wanted = (frame.last - frame.first) / self.step + 1
        rung = sum((wanted > each for each in COUNTS[:-1]), start=ca.SX(0))
        known = ca.vertcat(*frame.numbers, self.c, *self.coefficients, *self.parameters)
        setup = ca.Function("setup", [self.v], [rung, known, scales])
        v = ca.MX.sym("v", self.v.numel())
        number, numbers, factor = setup(v)
        together = 1 if self.what.factor else max(1, TOGETHER // (1 + count // SEVERAL))
        node = self._nodes(known.numel(), together)
        sums = [self._of_count(node, each, together) for each in COUNTS]
        total = ca.Function.conditional("count", sums[:-1], sums[-1])(number, numbers)
        return ca.Function("sums", [v], [factor * total])

    def _of_count(self, node: ca.Function, count: int, together: int) -> ca.Function:
        numbers = ca.MX.sym("numbers", node.size1_in(1))
        step = (numbers[1] - numbers[0]) / (count - 1)
        x = numbers[0] + step * ca.DM(range(count)).T
        total = node.map("nodes", "serial", count // together, [1], [0])(x, numbers)
        return ca.Function(f"count{count}", [numbers], [step * total])

    def _nodes(self, size: int, together: int) -> ca.Function:
        """(x, numbers) -> what a few nodes add to the rows."""
        x, numbers = ca.SX.sym("x", 1, together), ca.SX.sym("numbers", size)
        parts, own = ca.vertsplit(numbers), 1 + len(self.coefficients) + len(self.parameters)
        frame, (c, *others) = Frame.of_numbers(parts[:-own], self.shape), parts[-own:]
        coefficients, parameters = others[: len(self.coefficients)], others[len(self.coefficients) :]
        steps = spread_out(x, frame.high, XP)
        expectations = self.what.expectations(parameters)
        p = self.what.exponent(parameters)
        node = Node(self.shape, frame.tilted(ca.exp(steps[0])), steps, frame.scale, c, XP, expectations, p)
        terms = [ca.sum2(ca.SX(term) + ca.SX.zeros(1, together)) for term in node.sums(self.rows, coefficients)]
        total = ca.vertcat(*terms)
        if self.by_parameters:
            total = ca.densify(ca.vec(ca.jacobian(total, ca.vertcat(*parameters))))
        return ca.Function("nodes", [x, numbers], [total])
