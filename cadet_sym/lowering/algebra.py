"""What laying out the nodes of a quadrature needs of CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np


class CasadiAlgebra:
    """The algebra of SX expressions; nodes are columns."""

    exp = staticmethod(ca.exp)
    asinh = staticmethod(ca.asinh)
    sqrt = staticmethod(ca.sqrt)
    fabs = staticmethod(ca.fabs)
    fmin = staticmethod(ca.fmin)
    fmax = staticmethod(ca.fmax)
    where = staticmethod(ca.if_else)

    def frozen(self, x: ca.SX) -> ca.SX:
        """The number to 9 decimals, with no derivative."""
        return (ca.floor(x * 2**30) + 0.5) / 2**30

    def column(self, x: np.ndarray) -> ca.DM:
        """Constants, one a row."""
        return ca.DM(x)

    def geometric(self, first: ca.SX, step: ca.SX, count: int) -> tuple[ca.SX, ca.SX]:
        """exp(first + step n), n < count, and its inverse, from two exponentials."""
        growing, ratio = [ca.exp(first)], ca.exp(step)
        falling, inverse = [1 / growing[0]], 1 / ratio
        for _ in range(count - 1):
            growing.append(growing[-1] * ratio)
            falling.append(falling[-1] * inverse)
        return ca.vertcat(*growing), ca.vertcat(*falling)
