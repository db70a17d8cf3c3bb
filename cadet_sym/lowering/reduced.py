"""E[f] by that of a function of fewer arguments, or of other linear forms of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca

from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.expectation.reduced import Reduced
from cadet_sym.lowering.gaussian import LARGEST

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint


Moments = tuple[ca.SX, ca.SX]


def reduced_moments(function: Reduced, joint: Joint) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f], and its derivative in the mean of every argument."""
    count, value = joint.m.numel(), joint.marginal(0).value
    S = ca.vertcat(*(ca.horzcat(*(joint.covariance(i, j) for j in range(count))) for i in range(count)))
    there = _Changed(joint.m, S, ca.SX(0), ca.SX.zeros(count), ca.SX(ca.DM.eye(count)))
    for bell in function.bells:
        there = there.by_bell(bell.argument, value(bell.steepness), value(bell.centre))
    if any(function.rates):
        there = there.by_rates(ca.vertcat(*(ca.SX(value(rate)) for rate in function.rates)))
    S = there.S
    m = ca.SX.sym("m", count)
    nothing = (0,) * count
    known: dict[tuple[int, ...], Moments] = {nothing: _core(function, function.core, joint, m, S)}
    if function.slopes:
        slopes = [_core(function, slope, joint, m, S) for slope in function.slopes]
        for i in range(count):
            known[tuple(int(k == i) for k in range(count))] = _by_slopes(function, i, known[nothing], slopes, m, S)
    F, gain = ca.SX(0), ca.SX.zeros(count)
    for coefficient, powers in function.terms:
        total, slopes = _by_stein(powers, known, m, S)
        F += value(coefficient) * total
        gain += value(coefficient) * slopes
    F, gain = ca.substitute([F, gain], [m], [there.m])
    if function.rates or function.bells:
        weight = ca.if_else(there.exponent > LARGEST, ca.inf, ca.exp(ca.fmin(there.exponent, LARGEST)))
        F, gain = weight * F, weight * (there.slope * F + there.moves.T @ gain)
    return F, dict(enumerate(ca.vertsplit(gain)))


@dataclass(frozen=True)
class _Changed:
    """The distribution that exponentials leave, and the logarithm of their expectation."""

    m: ca.SX
    S: ca.SX
    exponent: ca.SX
    slope: ca.SX  # derivative of the exponent in the mean that there was
    moves: ca.SX  # that of the mean

    def by_bell(self, i: int, b: ca.SX, centre: ca.SX) -> _Changed:
        """Times exp(-b (z_i - centre)^2)."""
        D = 1 + 2 * b * self.S[i, i]
        D = ca.if_else(D > 0, D, math.nan)  # no number where there is none
        pull, row = 2 * b / D, self.S[i, :]
        distance = self.m[i] - centre
        S = self.S - pull * (row.T @ row)
        S[i, :] = row / D
        S[:, i] = row.T / D
        exponent = self.exponent - pull / 2 * distance**2 - ca.log(D) / 2
        slope = self.slope - pull * distance * self.moves[i, :].T
        return _Changed(self.m - pull * distance * row.T, S, exponent, slope, self.moves - pull * (row.T @ self.moves[i, :]))

    def by_rates(self, a: ca.SX) -> _Changed:
        """Times exp(a z)."""
        exponent = self.exponent + ca.dot(a, self.m) + ca.dot(a, self.S @ a) / 2
        return replace(self, m=self.m + self.S @ a, exponent=exponent, slope=self.slope + self.moves.T @ a)


def _core(function: Reduced, core: DescribingFunction, joint: Joint, m: ca.SX, S: ca.SX) -> Moments:
    """G and its gradient in the means of the arguments z."""
    value = joint.marginal(0).value
    C = ca.vertcat(*(ca.horzcat(*(value(c) for c in form.coefficients)) for form in function.forms))
    covariance = C @ S @ C.T
    size = C.size1()
    triangle = ca.vertcat(*(covariance[i, j] for i in range(size) for j in range(i + 1)))
    F, gain = type(joint)(C @ m, triangle, joint.env).expectation_and_gain(core)
    return F, C.T @ gain


def _by_slopes(
    function: Reduced, i: int, core: Moments, slopes: list[Moments], m: ca.SX, S: ca.SX
) -> Moments:
    """E[z_i g] and its gradient, by the expectations of the derivatives of g."""
    F, gain = m[i] * core[0], m[i] * core[1]
    gain[i] += core[0]
    for form, (value, change) in zip(function.forms, slopes, strict=True):
        assert form.argument is not None
        F += S[i, form.argument] * value
        gain += S[i, form.argument] * change
    return F, gain


def _by_stein(powers: tuple[int, ...], known: dict[tuple[int, ...], Moments], m: ca.SX, S: ca.SX) -> Moments:
    """E[z^powers g] and its gradient."""
    if powers not in known:
        i = next(k for k, n in enumerate(powers) if n)
        F, gain = _by_stein(tuple(n - (k == i) for k, n in enumerate(powers)), known, m, S)
        slopes = m[i] * gain + ca.jacobian(gain, m).T @ S[:, i]
        slopes[i] += F
        known[powers] = m[i] * F + ca.dot(S[:, i], gain), slopes
    return known[powers]
