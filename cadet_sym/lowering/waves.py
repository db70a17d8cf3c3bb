"""E[P exp(q)] in closed form, q of degree two and complex, and its gains."""

from __future__ import annotations

import math
from functools import reduce
from typing import TYPE_CHECKING

import casadi as ca
import sympy as sp

from cadet_sym.expectation.pairs import square_root
from cadet_sym.expectation.waves import Waves
from cadet_sym.lowering.algebra import CasadiAlgebra
from cadet_sym.lowering.complex import Complex, complex_exp, converted
from cadet_sym.lowering.expressions import Lowering

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

Row = list[Complex]


def waves_moments(waves: Waves, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of every argument."""
    count = joint.m.numel()
    m = ca.SX.sym("m", count)
    S = [[joint.covariance(i, j) for j in range(count)] for i in range(count)]
    for i in range(count):
        S[i][i] = joint.marginal(i).p
    lowering = Lowering({**joint.env, **dict(zip(waves.arguments, ca.vertsplit(m), strict=True))})
    found = [_Wave(waves, coefficient, phase, m, S, lowering) for coefficient, phase in waves.phases]
    F = sum((wave.expectation() for wave in found), start=ca.SX(0))
    both = ca.vertcat(F, ca.gradient(F, m)) + ca.if_else(found[0].exists(), 0, math.nan)  # no number where there is none
    F, *gain = ca.vertsplit(ca.substitute(both, m, joint.m))
    return F, dict(enumerate(gain))


class _Wave:
    """One of the waves."""

    def __init__(
        self, waves: Waves, coefficient: sp.Expr, phase: sp.Expr, m: ca.SX, S: list[list[ca.SX]], lowering: Lowering
    ):
        self.waves, self.m, self.S, self.lowering = waves, ca.vertsplit(m), S, lowering
        self.coefficient, self.q = coefficient, waves.exponent + sp.I * phase
        J = self.curved = waves.curved
        z = waves.arguments
        self.A = [[self._value(sp.diff(self.q, z[i], z[j]) / 2) for j in J] for i in J]

    def _value(self, expr: sp.Expr) -> Complex:
        return converted(sp.expand(expr), self.lowering.convert)

    def expectation(self) -> ca.SX:
        """Re(coefficient E[P exp(q)])."""
        gradient = [self._value(sp.diff(self.q, z)) for z in self.waves.arguments]
        S = self._covariance()
        step = [_dot(row, gradient) for row in S]
        weight = complex_exp(self._value(self.q) + _dot(gradient, step) * 0.5) * self._root()
        mean = [Complex(m) + shift for m, shift in zip(self.m, step, strict=True)]
        moments = _Moments(mean, S)
        terms = (moments.of(powers) * self.lowering.convert(c) for c, powers in self.waves.terms)
        return (self._value(self.coefficient) * weight * reduce(Complex.__add__, terms)).real

    def _left(self, A: list[Row]) -> list[Row]:
        """1 - 2 A S of the curved arguments."""
        J = self.curved
        left = [[_dot(row, [Complex(self.S[j][k]) for j in J]) * -2.0 for k in J] for row in A]
        for i in range(len(J)):
            left[i][i] = left[i][i] + Complex(ca.SX(1))
        return left

    def _root(self) -> Complex:
        """det(1 - 2 S A)^(-1/2): of at most two eigenvalues whose real parts are positive the root's real part is, too."""
        det = _determinant(self._left(self.A))
        if det.imaginary is None:
            return Complex(1 / ca.sqrt(det.real))
        return Complex(*square_root(det.real, det.imaginary, CasadiAlgebra())).inverse()

    def exists(self) -> ca.SX:
        """Whether the eigenvalues of the real part are positive."""
        left = [[each.real for each in row] for row in self._left([[Complex(each.real) for each in row] for row in self.A])]
        if len(left) == 1:
            return left[0][0] > 0
        det = left[0][0] * left[1][1] - left[0][1] * left[1][0]
        return ca.logic_and(det > 0, left[0][0] + left[1][1] > 0)

    def _covariance(self) -> list[Row]:
        """S' = S + 2 S_J A (1 - 2 S_J A)^-1 S_J, of a curved argument S_J (1 - 2 A S)^-1, which loses no digits."""
        J, count = self.curved, len(self.m)
        inverse = _inverse(self._left(self.A))
        S = [[Complex(each) for each in row] for row in self.S]
        columns = [[_dot([row[j] for j in J], list(column)) for column in zip(*inverse, strict=True)] for row in S]
        for i in range(count):
            for j in range(count):
                if j in J:
                    S[i][j] = columns[i][J.index(j)]
                elif i in J:
                    S[i][j] = columns[j][J.index(i)]
                else:
                    by_A = [_dot(columns[i], list(column)) for column in zip(*self.A, strict=True)]
                    S[i][j] = Complex(self.S[i][j]) + _dot(by_A, [Complex(self.S[j][k]) for k in J]) * 2.0
        return S


class _Moments:
    """E[z^powers] under a mean and a covariance that may be complex."""

    def __init__(self, mean: Row, S: list[Row]):
        self.mean, self.S = mean, S
        self.known = {(0,) * len(mean): Complex(ca.SX(1))}

    def of(self, powers: tuple[int, ...]) -> Complex:
        """By E[z_a h] = mean_a E[h] + sum_b S_ab E[dh/dz_b]."""
        if powers not in self.known:
            a = next(i for i, n in enumerate(powers) if n)
            rest = tuple(n - (i == a) for i, n in enumerate(powers))
            total = self.mean[a] * self.of(rest)
            for b, n in enumerate(rest):
                if n:
                    total = total + self.S[a][b] * self.of(tuple(k - (i == b) for i, k in enumerate(rest))) * float(n)
            self.known[powers] = total
        return self.known[powers]


def _dot(a: Row, b: Row) -> Complex:
    return reduce(Complex.__add__, (x * y for x, y in zip(a, b, strict=True)))


def _determinant(matrix: list[Row]) -> Complex:
    """Of one row, or two."""
    return matrix[0][0] if len(matrix) == 1 else matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]


def _inverse(matrix: list[Row]) -> list[Row]:
    """Of one row, or two."""
    over = _determinant(matrix).inverse()
    if len(matrix) == 1:
        return [[over]]
    return [[matrix[1][1] * over, -matrix[0][1] * over], [-matrix[1][0] * over, matrix[0][0] * over]]
