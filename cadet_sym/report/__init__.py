"""Results in words, tables and figures: the comparison with simulation, and what a model became."""

from cadet_sym.report.comparison import Comparison, Verdict, compare

__all__ = ["Comparison", "Verdict", "compare"]
