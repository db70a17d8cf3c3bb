"""Hold the describing functions of a model against adaptive integration, at the moments that a run came to.

A describing function says how accurate it is over a grid of moments that nobody can choose well beforehand; a run shows which
moments matter. What is compared is E[f], relative to E|f|, and the gains, relative to that over the standard deviation: the
Gaussian closure itself is judged by Monte Carlo, not here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.linearisation import shown
from cadet_sym.lowering.check import ElementCheck, check_at
from cadet_sym.lowering.survey import nonlinearities
from cadet_sym.solve.freeze import context_at
from cadet_sym.solve.seen import instant
from cadet_sym.tables import Shown, aligned, plain

if TYPE_CHECKING:
    from cadet_sym.compiled import CompiledModel
    from cadet_sym.results import MomentHistory

__all__ = ["RunCheck", "check_run"]

TIMES = 5
BUDGET = 4_000_000  # evaluations of one function, for all times together


@dataclass(frozen=True)
class Place:
    """A describing function of a model: which, and what of."""

    where: str  # "rates", or an output
    function: str
    arguments: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class RunCheck(Shown):
    """What adaptive integration says of every describing function at the moments of a run."""

    model: str
    times: tuple[float, ...]
    found: tuple[tuple[Place, ElementCheck], ...]

    @property
    def error(self) -> float:
        """The largest error of all, of expectations and gains."""
        return max((max(each.error, each.gain_error) for _, each in self.found), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym moments --check --json`` adds to the history; an error of what is no number is null."""
        functions = [
            {
                "function": place.function,
                "arguments": list(place.arguments),
                "where": place.where,
                "method": each.method,
                "nodes": each.nodes,
                "error": plain(each.error),
                "gain_error": plain(each.gain_error),
                "sure": plain(each.sure),
            }
            for place, each in self.found
        ]
        return {"times": list(self.times), "functions": functions}

    def __str__(self) -> str:
        header = ["function", "of", "in", "method", "error", "gain", "integration"]
        rows = [
            [
                _short(place.function),
                _short(", ".join(place.arguments)),
                place.where,
                each.method + (f", {each.nodes} nodes" if each.nodes else ""),
                f"{each.error:.1e}",
                f"{each.gain_error:.1e}",
                f"{each.sure:.0e}",
            ]
            for place, each in self.found
        ]
        count = len(self.times)
        title = f"Describing functions of {self.model} at the moments of {count} times, {self.times[0]:g} to {self.times[-1]:g}"
        if not rows:
            return f"{title}: there are none, the model is linear"
        return "\n".join([f"{title}: largest error {self.error:.1e}", *aligned(header, rows)])


def check_run(compiled: CompiledModel, history: MomentHistory, times: Sequence[float] | None = None) -> RunCheck:
    """Check every describing function of the rates, of the outputs and of their variances at some times of a history.

    Parameters
    ----------
    compiled, history : a model, and what `propagate` made of it.
    times : output times of the history; by default its start, its end and three between them.

    Returns
    -------
    RunCheck
        To be printed: a line a function. Errors of E[f] are relative to E|f|, of gains to that over the standard deviation;
        where the integration itself is less sure than 1e-8, as its column says, they are what exceeds its own error.

    Raises
    ------
    ModelError
        If the history has no such times, or is of another model.
    """
    equations = compiled.equations
    if not len(history.time):
        raise ModelError("this history has no times at which it could be checked")
    some = np.unique(np.linspace(0, len(history.time) - 1, TIMES).round().astype(int))
    wanted = history.time[some].tolist() if times is None else list(times)
    system = equations.quasi_linear.system
    if history.states != tuple(state.name for state in system.states):
        raise ModelError("this history is of another model: its states are not those of the one it is checked with")
    rows = [int(np.argmin(np.abs(history.time - t))) for t in wanted]
    if not rows or any(abs(history.time[k] - t) > 1e-9 * (1 + abs(t)) for k, t in zip(rows, wanted, strict=True)):
        raise ModelError("the times of a check are output times of the history that is checked")
    lowered = compiled.functions
    p = np.array([history.provenance.parameters[name] for name in lowered.parameters])
    instants = [
        instant(lowered, p, context_at(lowered, p, float(history.time[k])), history.state_mean[k], history.state_covariance[k])
        for k in rows
    ]
    found: dict[tuple[sp.Expr, tuple[sp.Expr, ...]], tuple[Place, ElementCheck]] = {}
    for where, element in nonlinearities(equations):
        forms = tuple(form.of(system.states) for form in element.forms)
        key = element.describing.body, forms
        if key in found:
            continue
        place = Place(where, shown(element.describing.body), tuple(map(shown, forms)))
        cases = [(*at.seen_by(element), at.numbers) for at in instants]
        found[key] = place, check_at(element.describing, cases, BUDGET)
    return RunCheck(history.model, tuple(float(history.time[k]) for k in rows), tuple(found.values()))


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."
