"""What the layout of nodes needs of an algebra of numbers, and that of NumPy; that of CasADi is `lowering.algebra`."""

from __future__ import annotations

from typing import Any

import numpy as np

from cadet_sym.language.numeric import erf

Number = Any  # float, NumPy array or CasADi SX

Algebra = Any
"""What laying out nodes needs of NumPy (`NumpyAlgebra`) or CasADi: exp, log, ceil, sqrt, asinh, fabs, fmin, fmax, where,
column, geometric, and `frozen`, which makes a value a constant, for the integral does not depend on where it is split."""


class NumpyAlgebra:
    """The algebra of arrays, columns of constants against rows of cases."""

    exp = staticmethod(np.exp)
    log = staticmethod(np.log)
    ceil = staticmethod(np.ceil)
    asinh = staticmethod(np.arcsinh)
    expm1 = staticmethod(np.expm1)
    log1p = staticmethod(np.log1p)
    sqrt = staticmethod(np.sqrt)
    fabs = staticmethod(np.fabs)
    fmin = staticmethod(np.fmin)
    fmax = staticmethod(np.fmax)
    where = staticmethod(np.where)
    cos = staticmethod(np.cos)
    sin = staticmethod(np.sin)
    asin = staticmethod(np.arcsin)
    atan2 = staticmethod(np.arctan2)
    atanh = staticmethod(np.arctanh)
    floor = staticmethod(np.floor)
    erf = staticmethod(erf)

    def total(self, x: np.ndarray) -> np.ndarray:
        """Sums of columns."""
        return np.sum(x, axis=0)

    def frozen(self, x: Number) -> Number:
        """The number itself."""
        return x

    def column(self, x: np.ndarray) -> Number:
        """Constants, one a row."""
        return x[:, None]

    def geometric(self, first: Number, step: Number, count: int, factor: Number = 1.0) -> tuple[Number, Number]:
        """factor exp(+-(first + step n)), n < count."""
        grow = np.exp(first + step * np.arange(count)[:, None])
        return factor * grow, factor / grow
