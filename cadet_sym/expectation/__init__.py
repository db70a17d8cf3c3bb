"""Gaussian expectations: from an expression to its describing function, exact where that is possible."""

from cadet_sym.expectation.describing import DescribingFunction, described, describing_function

__all__ = ["DescribingFunction", "described", "describing_function"]
