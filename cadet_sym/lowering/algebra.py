"""What laying out the nodes of a quadrature needs of CasADi."""

from __future__ import annotations

from math import ceil, log2

import casadi as ca
import numpy as np


class CasadiAlgebra:
    """The algebra of SX expressions; nodes are columns."""

    exp = staticmethod(ca.exp)
    log = staticmethod(ca.log)
    ceil = staticmethod(ca.ceil)
    asinh = staticmethod(ca.asinh)
    expm1 = staticmethod(ca.expm1)
    log1p = staticmethod(ca.log1p)
    sqrt = staticmethod(ca.sqrt)
    fabs = staticmethod(ca.fabs)
    fmin = staticmethod(ca.fmin)
    fmax = staticmethod(ca.fmax)
    where = staticmethod(ca.if_else)
    cos = staticmethod(ca.cos)
    sin = staticmethod(ca.sin)
    asin = staticmethod(ca.asin)
    atan2 = staticmethod(ca.atan2)
    atanh = staticmethod(ca.atanh)
    floor = staticmethod(ca.floor)
    erf = staticmethod(ca.erf)
    total = staticmethod(ca.sum1)

    def __init__(self, decimals: int = 9):
        self.grain = 2.0 ** ceil(decimals * log2(10))

    def frozen(self, x: ca.SX) -> ca.SX:
        """The number to so many decimals, with no derivative."""
        return (ca.floor(x * self.grain) + 0.5) / self.grain

    def column(self, x: np.ndarray) -> ca.DM:
        """Constants, one a row."""
        return ca.DM(x)

    def geometric(self, first: ca.SX, step: ca.SX, count: int, factor: ca.SX | float = 1.0) -> tuple[ca.SX, ca.SX]:
        """factor exp(+-(first + step n)), n < count, from two exponentials."""
        start, ratio = ca.exp(first), ca.exp(step)
        return self._powers(start * factor, ratio, count), self._powers(factor / start, 1 / ratio, count)

    def _powers(self, first: ca.SX, ratio: ca.SX, count: int) -> ca.SX:
        """first ratio^n, n < count, one multiplication each, doubling what there is."""
        column = ca.SX(first)
        while column.numel() < count:
            more = column[: min(column.numel(), count - column.numel())] * ratio
            column, ratio = ca.vertcat(column, more), ratio * ratio
        return column
