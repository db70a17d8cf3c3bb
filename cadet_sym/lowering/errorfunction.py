"""Expectation of polynomial x erf(a z + b): erf again, and Gaussians."""

from __future__ import annotations

import math
from math import comb, perm
from typing import TYPE_CHECKING

import casadi as ca

from cadet_sym.expectation.errorfunction import ErrorFunction

if TYPE_CHECKING:
    from cadet_sym.lowering.gaussian import Gaussian


def error_function_moment(function: ErrorFunction, gaussian: Gaussian, order: int) -> ca.SX:
    """d^order/dm^order of E[sum_n c_n z^n erf(a z + b)], by Leibniz' rule for the derivative of the product."""
    moments = _Moments(function, gaussian)
    total = ca.SX(0)
    for n, coefficient in enumerate(function.coefficients):
        if coefficient != 0:
            parts = (comb(order, i) * perm(n, i) * moments.of(n - i, order - i) for i in range(min(n, order) + 1))
            total += gaussian.value(coefficient) * sum(parts, start=ca.SX(0))
    return total


class _Moments:
    """M(n, k) = E[z^n g^(k)(z)], g = erf(a z + b): E[g] = erf((a m + b)/sqrt(1 + 2 a^2 p)), the rest by Stein's lemma."""

    def __init__(self, function: ErrorFunction, gaussian: Gaussian):
        self.m, self.p = gaussian.m, gaussian.p
        a, b = gaussian.value(function.slope), gaussian.value(function.offset)
        width = ca.sqrt(1 + 2 * a * a * self.p)
        self.scale, self.x = a / width, (a * self.m + b) / width
        self.known: dict[tuple[int, int], ca.SX] = {}

    def of(self, n: int, k: int) -> ca.SX:
        """M(n, k)."""
        if (n, k) not in self.known:
            if n == 0:
                self.known[n, k] = self._derivative(k)
            else:
                inner = self.of(n - 1, k + 1) + ((n - 1) * self.of(n - 2, k) if n > 1 else 0)
                self.known[n, k] = self.m * self.of(n - 1, k) + self.p * inner
        return self.known[n, k]

    def _derivative(self, k: int) -> ca.SX:
        """d^k/dm^k of erf(x), x = scale m + ...: Hermite polynomials (of the physicists) times a Gaussian."""
        if k == 0:
            return ca.erf(self.x)
        before, value = ca.SX(0), ca.SX(1)
        for n in range(k - 1):
            before, value = value, 2 * self.x * value - 2 * n * before
        return (-1) ** (k - 1) * value * ca.exp(-self.x * self.x) * self.scale**k * (2 / math.sqrt(math.pi))
