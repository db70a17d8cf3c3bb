"""cadet-sym: a symbolic model compiler for random vibration of nonlinear systems.

From a vehicle, rough ground and a speed history to mean and covariance, by covariance analysis with describing
functions (CADET; Harrison & Hammond, J. Sound Vib. 105(3), 361-371, 1986).

Read it in the order in which a model passes through it:

    language/        what a user writes down: Vehicle + Ground + Travel + Initial = Model
    contacts.py      the ground as each contact meets it, along s(t)
    augmentation.py  Model -> AugmentedSystem: ground in distance becomes a system in time
    expectation/     E[f(z)] of a nonlinearity for Gaussian z: its describing function
    linearisation.py AugmentedSystem -> QuasiLinearSystem: linear part and elements
    delay.py         wheels on one track: the grid that carries their correlation
    moments.py       QuasiLinearSystem -> MomentEquations: mu' and P'
    lowering/        MomentEquations -> CasADi functions
    solve/           integrate them, find their fixed points
    compilation.py   all of the above in one, through the cache.py of what was made before
    runs.py          run it over a time, once or with many values of its parameters
    stationary.py    find the moments that stay as they are; solutions.py and results.py hold what was found
    compiled.py      what `compile` returns, and what can be done with it
    checking.py      its describing functions held against adaptive integration, at the moments of a run
    export/          C that stands alone
    sweeps.py        the same model at many values of its parameters
    bifurcation.py   stationary moments followed over the range of one parameter
    optimisation.py  parameters chosen so that a statistic of the stationary state is least
    simulation/      the judge: Monte Carlo of the original model, which shares nothing after augmentation.py
    controlled.py    the judge helped by what it judges: the quasi-linear system as control variate
    report/          the verdict: what CADET says against what the judge says

Glossary: *shaping filter*, white noise in, ground height out. *Describing function* (random input), E[f(z)] for
Gaussian z; *equivalent gain*, its derivative in the mean. *Zero-lag covariance*, E[(x - mu)(x - mu)^T] at one time.
*Intensity* Q of a white noise, E[w(t) w(t')^T] = Q delta(t - t'), two-sided. *Quasi-linear*, linear with gains that
depend on the moments. *Setback*, distance behind the leading wheel. *Closure*, relative displacement.

Not to be confused with CADET-Core, which simulates chromatography.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
