"""cadet-sym: a symbolic model compiler for random vibration of nonlinear systems.

From a vehicle, rough ground and a speed history to mean and covariance, by covariance analysis with describing
functions (CADET; Harrison & Hammond, J. Sound Vib. 105(3), 361-371, 1986).

Read it in the order in which a model passes through it:

    language/       what a user writes down: Vehicle + Ground + Travel + Initial = Model
    contacts.py     the ground as each contact meets it, along s(t)
    augment.py      Model -> AugmentedSystem: ground in distance becomes a system in time
    expectation/    E[f(z)] of a nonlinearity for Gaussian z: its describing function
    linearise.py    AugmentedSystem -> QuasiLinearSystem: linear part and elements
    delay.py        wheels on one track: the grid that carries their correlation
    moments.py      QuasiLinearSystem -> MomentEquations: mu' and P'
    lowering/       MomentEquations -> CasADi functions
    solve/          integrate them, find their fixed points
    compiled.py     all of the above in one: what `compile` returns
    export/         C that stands alone
    sweep.py        the same model at many values of its parameters
    simulate/       the judge: Monte Carlo of the original model, which shares nothing after augment.py
    report.py       the verdict: what CADET says against what the judge says

Glossary: *shaping filter*, white noise in, ground height out. *Describing function* (random input), E[f(z)] for
Gaussian z; *equivalent gain*, its derivative in the mean. *Zero-lag covariance*, E[(x - mu)(x - mu)^T] at one time.
*Intensity* Q of a white noise, E[w(t) w(t')^T] = Q delta(t - t'), two-sided. *Quasi-linear*, linear with gains that
depend on the moments. *Setback*, distance behind the leading wheel. *Closure*, relative displacement.

Not to be confused with CADET-Core, which simulates chromatography.
"""

from cadet_sym.augment import AugmentedSystem, augment
from cadet_sym.compiled import CompiledModel, compile
from cadet_sym.errors import CadetError, ExportError, LinearisationError, ModelError, SolverError
from cadet_sym.expectation import DescribingFunction, describing_function
from cadet_sym.language.element import Element
from cadet_sym.language.expression import der
from cadet_sym.language.ground import Ground, ShapingFilter, exponential, shaping_filter
from cadet_sym.language.model import Initial, Model, Noise, Parameter, Run
from cadet_sym.language.modelfile import load
from cadet_sym.language.travel import Travel
from cadet_sym.language.vehicle import Contact, Vehicle
from cadet_sym.linearise import QuasiLinearSystem, linearise
from cadet_sym.moments import MomentEquations, moment_equations
from cadet_sym.report import Comparison, compare
from cadet_sym.results import MomentHistory, StationaryMoments
from cadet_sym.simulate import Ensemble, simulate
from cadet_sym.sweep import Sweep, sweep

__all__ = [
    "AugmentedSystem",
    "CadetError",
    "Comparison",
    "CompiledModel",
    "Contact",
    "DescribingFunction",
    "Element",
    "Ensemble",
    "ExportError",
    "Ground",
    "Initial",
    "LinearisationError",
    "Model",
    "ModelError",
    "MomentEquations",
    "MomentHistory",
    "Noise",
    "Parameter",
    "QuasiLinearSystem",
    "Run",
    "ShapingFilter",
    "SolverError",
    "StationaryMoments",
    "Sweep",
    "Travel",
    "Vehicle",
    "augment",
    "compare",
    "compile",
    "der",
    "describing_function",
    "exponential",
    "linearise",
    "load",
    "moment_equations",
    "shaping_filter",
    "simulate",
    "sweep",
]
