"""What the nonlinearities of a model see at one moment of a run, and which of them have no expectation there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import sympy as sp

from cadet_sym.errors import ExpectationWarning
from cadet_sym.language.expression import DISTANCE, SPEED, SPEED_RATE, TIME, symbol
from cadet_sym.language.names import exact
from cadet_sym.language.needs import parameter_values
from cadet_sym.language.numeric import evaluate
from cadet_sym.linearisation import Nonlinearity, shown
from cadet_sym.lowering.elements import element_function, parameters_of
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.survey import nonlinearities
from cadet_sym.moments import MomentEquations
from cadet_sym.warning import warn

__all__ = ["Instant", "instant", "tell_lost", "warn_of_lost_outputs"]

Array = npt.NDArray[np.float64]

Lost = npt.NDArray[np.bool_]
"""Which outputs are no numbers, (m,)."""


@dataclass(frozen=True, eq=False)
class Instant:
    """Numbers of all that is in the expressions of a model at one time, and the moments of its states."""

    equations: MomentEquations
    numbers: Mapping[sp.Symbol, float]  # parameters, t, s, V and V'
    mean: Array  # (n,)
    covariance: Array  # (n, n)

    def seen_by(self, element: Nonlinearity) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the arguments of an element."""
        rows = np.zeros((len(element.forms), len(self.mean)))
        for row, form in zip(rows, element.forms, strict=True):
            for i, coefficient in form.coefficients:
                row[i] = evaluate(coefficient, self.numbers)
        constants = np.array([evaluate(form.constant, self.numbers) for form in element.forms])
        return rows @ self.mean + constants, rows @ self.covariance @ rows.T

    def lost(self) -> Iterator[tuple[str, Nonlinearity]]:
        """Elements whose expectation or gain is no number, and what of: the rates, an output, or the variance of one."""
        for where, element in nonlinearities(self.equations):
            mean, covariance = self.seen_by(element)
            free = parameters_of(element.describing)
            given = mean, covariance[np.tril_indices(len(mean))], [self.numbers[s] for s in free]
            found = element_function(element.describing, free)(*given)
            if not all(np.isfinite(np.asarray(part)).all() for part in found):
                yield where, element


def instant(lowered: MomentFunctions, p: Array, context: Array, mean: Array, covariance: Array) -> Instant:
    """A model with the parameters p, at context [t, s, V, V']."""
    model = lowered.equations.quasi_linear.system.model
    given = {name: exact(value) for name, value in zip(lowered.facts.parameters, p.tolist(), strict=True)}
    known = parameter_values({**{name: each.value for name, each in model.parameters.items()}, **given})
    moving = dict(zip((TIME, DISTANCE, SPEED, SPEED_RATE), context.tolist(), strict=True))
    return Instant(lowered.equations, {**{symbol(name): x for name, x in known.items()}, **moving}, mean, covariance)


def tell_lost(at: Instant, where: str) -> str:
    """A sentence on the first element of the rates, or of an output, that has no expectation at the moments; may be empty."""
    for of, element in at.lost():
        if of in (where, f"variance of {where}"):
            states, (mean, covariance) = at.equations.quasi_linear.system.states, at.seen_by(element)
            of_what = ", ".join(f"`{shown(form.of(states))}`" for form in element.forms)
            several = "" if len(mean) == 1 else "s"
            seen = f"mean{several} {_listed(mean)} and variance{several} {_listed(np.diag(covariance))}"
            return (
                f"The expectation of `{shown(element.of(states))}` or its gain is no number where {of_what} has the {seen}: "
                "it may exist at smaller variances only (limit what grows with `clip`)"
            )
    return ""


def warn_of_lost_outputs(lowered: MomentFunctions, p: Array, context: Array, y: Array, lost: Lost, when: str) -> None:
    """Warn of the outputs that are no numbers at packed moments y, and say why."""
    name = lowered.facts.outputs[int(np.flatnonzero(lost)[0])]
    why = tell_lost(instant(lowered, p, context, *lowered.facts.packing.unpack(y)), name)
    text = f"mean or variance of the output `{name}` is no number {when}" + (f". {why}." if why else ".")
    warn(ExpectationWarning(text, where=name, error=float("inf")))


def _listed(numbers: Array) -> str:
    return ", ".join(f"{number:.4g}" for number in numbers)
