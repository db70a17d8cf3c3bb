"""Expectations over two arguments that CasADi calls: they choose their order by themselves, and know their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

import casadi as ca
import sympy as sp

from cadet_sym.expectation.planar import Moments, Planar
from cadet_sym.expectation.polar import Homogeneous
from cadet_sym.lowering.bivariate import one_minus_square
from cadet_sym.lowering.gaussian import FLOOR
from cadet_sym.lowering.special import positive_part

if TYPE_CHECKING:
    from cadet_sym.lowering.joint import Joint

Kind = TypeVar("Kind", Planar, Homogeneous)


def moments_of_two(
    function: Kind, joint: Joint, make: Callable[[Kind, tuple[sp.Symbol, ...]], ca.Function]
) -> tuple[ca.SX, dict[int, ca.SX]]:
    """E[f] and its derivative in the mean of either argument, by what `make` gives for f and its parameters.

    That is a function (m_x, m_y, S_xx, S_xy, S_yy, parameters) -> E[f] and its two gains.
    """
    free = tuple(sorted(function.free, key=str))
    o, i = function.outer, function.inner
    moments = [joint.m[o], joint.m[i], joint.covariance(o, o), joint.covariance(o, i), joint.covariance(i, i)]
    parameters = [joint.marginal(o).value(symbol) for symbol in free]
    F, outer, inner = ca.vertsplit(make(function, free)(ca.vertcat(*moments, *parameters)))
    return F, {o: outer, i: inner}


def with_derivative(v: ca.MX, F: ca.MX, derivative: ca.Function) -> ca.Function:
    """v -> F, never put in line; its derivative is (v, F) -> dF/dv, a function called `jac_called`."""
    options = {
        "never_inline": True,
        "custom_jacobian": derivative,
        "jac_penalty": 0,
        "enable_forward": False,
        "enable_reverse": False,
        "enable_fd": False,
    }
    return ca.Function("called", [v], [F], ["v"], ["F"], options)


@lru_cache(maxsize=1)
def given() -> ca.Function:
    """(m_o, m_i, S_oo, S_oi, S_ii) -> `Moments`."""
    v = ca.SX.sym("v", 5)
    s, spread = (ca.sqrt(positive_part(p) + FLOOR) for p in (v[2], v[4]))
    rho = v[3] / (s * spread)
    rho = ca.if_else(rho > 1, 1, ca.if_else(rho < -1, -1, rho))
    left = spread * ca.sqrt(one_minus_square(rho))
    return ca.Function("given", [v], [ca.vertcat(*astuple(Moments(v[0], s, v[1], rho * spread, left, spread)))])
