"""Objectives and constraints: expressions in parameters and in statistics of states and outputs.

The words are those of the model file and four more: `mean(x)`, `variance(x)`, `std(x)` of a state or an output, and
`covariance(x, y)` of two states. Nothing else of a state may stand in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.model import Model
from cadet_sym.language.parser import parse, parse_comparison
from cadet_sym.language.scope import Scope
from cadet_sym.language.vocabulary import ElementCall, symbol

__all__ = ["STATISTICS", "Constraint", "Goal", "read_constraint", "read_goal"]

STATISTICS = {"mean": 1, "variance": 1, "std": 1, "covariance": 2}
"""The statistics and how many names each takes."""


@dataclass(frozen=True)
class Goal:
    """An expression in parameters and in statistics, each of which a symbol stands for."""

    text: str
    expression: sp.Expr
    statistics: tuple[tuple[sp.Symbol, str, tuple[str, ...]], ...]  # symbol, kind, names

    @property
    def names(self) -> frozenset[str]:
        """States and outputs it depends on."""
        return frozenset(name for _, _, names in self.statistics for name in names)


@dataclass(frozen=True)
class Constraint:
    """A goal that is to be nowhere above zero, or exactly zero."""

    text: str
    goal: Goal
    equal: bool = False


def read_goal(text: str, model: Model, states: Sequence[str]) -> Goal:
    """Turn the text of an objective into a goal.

    Parameters
    ----------
    text : as `variance(closure) + r*std(force)**2`.
    model : names its parameters and outputs.
    states : of the augmented system.

    Raises
    ------
    ModelError
        What is wrong in the text, and where.
    """
    scope, outputs = _scope(model, states)
    return _goal(text, parse(text, scope), set(states), outputs)


def read_constraint(text: str, model: Model, states: Sequence[str]) -> list[Constraint]:
    """Turn the text of a comparison, as `std(stroke) <= 0.02`, into constraints: one for each link of a chain.

    Raises
    ------
    ModelError
        What is wrong in the text, and where.
    """
    scope, outputs = _scope(model, states)
    links = parse_comparison(text, scope)
    found = []
    for sign, left, right in links:
        excess = right - left if sign == ">=" else left - right
        where = text if len(links) == 1 else f"{text} ({left} {sign} {right})"
        found.append(Constraint(where, _goal(text, excess, set(states), outputs), sign == "=="))
    return found


def _scope(model: Model, states: Sequence[str]) -> tuple[Scope, set[str]]:
    outputs = {str(name) for name in model.vehicle.outputs}
    kinds = dict.fromkeys(model.parameters, "parameter")
    kinds |= dict.fromkeys(outputs, "output") | dict.fromkeys(states, "state")
    scope = Scope(
        place="an objective or a constraint",
        kinds=kinds,
        allowed=frozenset({"parameter", "state", "output"}),
        elements=STATISTICS,
    )
    return scope, outputs


def _goal(text: str, expression: sp.Expr, states: set[str], outputs: set[str]) -> Goal:
    statistics, stand_in = [], {}
    for number, call in enumerate(sorted(expression.atoms(ElementCall), key=str)):
        names = tuple(_name(text, call, argument) for argument in call.arguments)
        known = states if call.name == "covariance" else states | outputs
        for name in names:
            if name not in known:
                what = "two states" if call.name == "covariance" else "a state or an output"
                raise ModelError(f"`{call.name}` is taken of {what}, and `{name}` is none", text=text, token=name)
        stand_in[call] = symbol(f"statistic {number}")
        statistics.append((stand_in[call], call.name, names))
    rest = expression.xreplace(stand_in)
    for name in sorted({str(free) for free in rest.free_symbols} & (states | outputs)):
        raise ModelError(
            f"`{name}` varies at random: name one of its statistics, as `variance({name})`", text=text, token=name
        ).placed(text=text)
    return Goal(text, rest, tuple(statistics))


def _name(text: str, call: ElementCall, argument: sp.Expr) -> str:
    if isinstance(argument, sp.Symbol):
        return argument.name
    raise ModelError(
        f"`{call.name}` is taken of a name, not of `{argument}`: declare an output for it", text=text, token=call.name
    ).placed(text=text)
