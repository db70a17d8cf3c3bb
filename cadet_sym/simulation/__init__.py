"""Monte Carlo simulation of the original nonlinear model, the judge of everything else.

Reading order: `engine` (what happens), `source` and `program` (the model as code), `step` and `within` (one step of
it), `grid`, `ground` and `plan` (everything that paths share), `streams`, `fast` and `plain` (the paths), `statistics`
and `ensemble` (the result).
"""

from cadet_sym.simulation.engine import simulate
from cadet_sym.simulation.ensemble import Ensemble

__all__ = ["Ensemble", "simulate"]
