"""Gaussian expectations: from an expression to its describing function, exact where that is possible."""

from cadet_sym.expectation.describing import DescribingFunction, describing_function

__all__ = ["DescribingFunction", "describing_function"]
