"""Measured curves as flat tables that a compiled kernel can search."""

from __future__ import annotations

import numpy as np

from cadet_sym.language.curve import coefficients
from cadet_sym.language.expression import Lookup

__all__ = ["PIECE", "curve_table", "lookup"]

PIECE = 5  # numbers a piece: its origin and four coefficients of a cubic in z - origin


def curve_table(curve: Lookup) -> np.ndarray:
    """Breakpoints z_1 .. z_n, then n + 1 pieces (origin, c0, c1, c2, c3): one before z_1, one after z_n.

    Outside the rows the last piece goes on, or the last value holds, as the curve declares.
    """
    knots = [float(z) for z in curve.knots]
    inner = [(z, *map(float, c)) for z, c in zip(knots, coefficients(curve), strict=False)]
    if curve.outside == "hold":
        before, after = (knots[0], float(curve.values[0])), (knots[-1], float(curve.values[-1]))
    else:
        before, after = inner[0], inner[-1]
    pieces = np.zeros((len(knots) + 1, PIECE))
    for row, piece in zip(pieces, [before, *inner, after], strict=True):
        row[: len(piece)] = piece
    return np.concatenate([knots, pieces.ravel()])


def lookup(z: np.ndarray, table: np.ndarray, first: int, count: int) -> np.ndarray:
    """Values of the curve whose table begins at `first` and has `count` breakpoints."""
    knots = table[first : first + count]
    pieces = table[first + count : first + count + PIECE * (count + 1)].reshape(-1, PIECE)
    origin, c0, c1, c2, c3 = pieces[np.searchsorted(knots, z, side="right")].T
    d = z - origin
    return c0 + d * (c1 + d * (c2 + d * c3))
