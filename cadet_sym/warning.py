"""Warn at the place that asked, not at the line of this package that found the reason."""

from __future__ import annotations

import sys
import warnings

__all__ = ["warn"]

PACKAGE = __name__.partition(".")[0]


def warn(warning: Warning) -> None:
    """Give a warning at the line from which this package was called."""
    frame, depth, outermost = sys._getframe(1), 1, 1
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] == PACKAGE:
            outermost = depth
        frame, depth = frame.f_back, depth + 1
    warnings.warn(warning, stacklevel=outermost + 2)
