"""Expectation of a function of several jointly Gaussian arguments, and its gains, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import sympy as sp

from cadet_sym.expectation.conditional import Integrated, Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.nested import Nested
from cadet_sym.expectation.polar import Homogeneous
from cadet_sym.expectation.quadratic import QuadraticPower
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.expectation.switched import Switched
from cadet_sym.expectation.waves import Waves
from cadet_sym.lowering.columns import curves
from cadet_sym.lowering.gaussian import Gaussian
from cadet_sym.lowering.nested import nested_moments
from cadet_sym.lowering.pair import Pair
from cadet_sym.lowering.planar import planar_moments
from cadet_sym.lowering.polar import polar_moments
from cadet_sym.lowering.quadratic import quadratic_moments
from cadet_sym.lowering.reduced import reduced_moments
from cadet_sym.lowering.switched import switched_moments
from cadet_sym.lowering.waves import waves_moments


@dataclass
class Joint:
    """N(m, S), S given by its lower triangle row by row."""

    m: ca.SX
    S: ca.SX
    env: Mapping[sp.Symbol, ca.SX]
    marginals: dict[int, Gaussian] = field(default_factory=dict)
    pairs: dict[tuple[int, int], Pair] = field(default_factory=dict)

    def covariance(self, i: int, j: int) -> ca.SX:
        """S_ij."""
        i, j = max(i, j), min(i, j)
        return self.S[i * (i + 1) // 2 + j]

    def marginal(self, i: int) -> Gaussian:
        """The distribution of one argument."""
        if i not in self.marginals:
            self.marginals[i] = Gaussian(self.m[i], self.covariance(i, i), self.env)
        return self.marginals[i]

    def pair(self, i: int, j: int) -> Pair:
        """The distribution of two arguments."""
        if (i, j) not in self.pairs:
            self.pairs[i, j] = Pair(self.marginal(i), self.marginal(j), self.covariance(i, j))
        return self.pairs[i, j]

    def expectation(self, df: DescribingFunction) -> ca.SX:
        """E[f]."""
        F = ca.SX(0)
        for product in df.products:
            if isinstance(product, Product):
                moments = _ProductMoments(product, self)
                F += moments.scale * moments.expectation()
            else:
                F += self._integrated(product)[0]
        return F

    def expectation_and_gain(self, df: DescribingFunction) -> tuple[ca.SX, ca.SX]:
        """E[f] and its gradient in the mean."""
        count = len(df.arguments)
        F, gain = ca.SX(0), [ca.SX(0)] * count
        for product in df.products:
            if isinstance(product, Product):
                moments = _ProductMoments(product, self)
                scale = moments.scale
                F += scale * moments.expectation()
                gain = [k + scale * moments.gain(a) for a, k in enumerate(gain)]
            else:
                value, slopes = self._integrated(product)
                F += value
                gain = [k + slopes.get(a, ca.SX(0)) for a, k in enumerate(gain)]
        return F, ca.vertcat(*gain)

    def _integrated(self, product: Integrated) -> tuple[ca.SX, dict[int, ca.SX]]:
        if isinstance(product, QuadraticPower):
            return quadratic_moments(product, self)
        if isinstance(product, Homogeneous):
            return polar_moments(product, self)
        if isinstance(product, Waves):
            return waves_moments(product, self)
        if isinstance(product, Reduced):
            return reduced_moments(product, self)
        if isinstance(product, Switched):
            return switched_moments(product, self)
        return nested_moments(product, self) if isinstance(product, Nested) else planar_moments(product, self)


class _ProductMoments:
    """E of z^powers f(z_i) g(z_j) and of derivatives of f and g, by Stein's lemma E[(z - m) g] = S E[grad g]."""

    def __init__(self, product: Product, joint: Joint):
        self.product, self.joint = product, joint
        self.scale = ca.SX(1) if product.coefficient == 1 else joint.marginal(0).value(product.coefficient)
        self.known: dict[tuple[tuple[int, ...], tuple[int, ...]], ca.SX] = {}

    def expectation(self) -> ca.SX:
        """E of the product itself, but for its coefficient."""
        return self._moment(self.product.powers, (0,) * len(self.product.functions))

    def gain(self, a: int) -> ca.SX:
        """Its derivative in the mean of argument a: E of the derivative in the argument."""
        powers, orders = self.product.powers, (0,) * len(self.product.functions)
        total = powers[a] * self._moment(_less(powers, a), orders) if powers[a] else ca.SX(0)
        for f, (argument, _) in enumerate(self.product.functions):
            if argument == a:
                total += self._moment(powers, _more(orders, f))
        return total

    def _moment(self, powers: tuple[int, ...], orders: tuple[int, ...]) -> ca.SX:
        key = powers, orders
        if key not in self.known:
            self.known[key] = self._by_stein(powers, orders) if any(powers) else self._functions(orders)
        return self.known[key]

    def _by_stein(self, powers: tuple[int, ...], orders: tuple[int, ...]) -> ca.SX:
        a = next(i for i, n in enumerate(powers) if n)
        rest = _less(powers, a)
        total = self.joint.m[a] * self._moment(rest, orders)
        for b, n in enumerate(rest):
            if n:
                total += n * self.joint.covariance(a, b) * self._moment(_less(rest, b), orders)
        for f, (argument, _) in enumerate(self.product.functions):
            total += self.joint.covariance(a, argument) * self._moment(rest, _more(orders, f))
        return total

    def _functions(self, orders: tuple[int, ...]) -> ca.SX:
        functions = self.product.functions
        if not functions:
            return ca.SX(1)
        if len(functions) == 1:
            ((i, f),) = functions
            return self.joint.marginal(i).expectation(f, orders[0])
        (i, f), (j, g) = functions
        both = orders[0], orders[1]
        value = self.joint.pair(i, j).expectation(f, g, both)
        return value + self.curves[both] if f.tables or g.tables else value

    @cached_property
    def curves(self) -> dict[tuple[int, int], ca.SX]:
        """What measured curves in two functions add, by the orders of the derivatives."""
        (i, f), (j, g) = self.product.functions
        return curves(self.joint.pair(i, j), f, g)


def _less(numbers: tuple[int, ...], at: int) -> tuple[int, ...]:
    return tuple(n - (i == at) for i, n in enumerate(numbers))


def _more(numbers: tuple[int, ...], at: int) -> tuple[int, ...]:
    return tuple(n + (i == at) for i, n in enumerate(numbers))
