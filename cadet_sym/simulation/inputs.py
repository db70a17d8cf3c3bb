"""What enters the nonlinearities: linear forms of which statistical linearisation supposes that they are Gaussian."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.language.expression import ElementCall
from cadet_sym.language.printer import unparse
from cadet_sym.simulation.riders import is_affine

__all__ = ["Input", "inputs_of"]


@dataclass(frozen=True)
class Input:
    """A linear form that enters a nonlinearity."""

    text: str  # as it is written in a model file
    form: sp.Expr  # in the augmented states
    elements: tuple[str, ...]  # declared elements that it enters; none if all are written out in the rates


def inputs_of(system: AugmentedSystem) -> tuple[Input, ...]:
    """The inputs of all nonlinearities of the vehicle's rates, in the order in which they are met."""
    found: dict[sp.Expr, list[str]] = {}
    for rate in system.drift[: system.vehicle_size]:
        for term in _nonlinear_terms(rate, system.states):
            _look_into(term, system.states, "", found)
    return tuple(Input(unparse(form), form, tuple(dict.fromkeys(filter(None, names)))) for form, names in found.items())


def _nonlinear_terms(rate: sp.Expr, states: tuple[sp.Symbol, ...]) -> Iterator[sp.Expr]:
    """The terms that are not linear, also within a sum that is multiplied by what does not depend on the path."""
    if is_affine(rate, states):
        return
    moving = [part for part in rate.args if part.free_symbols & set(states)]
    if rate.is_Add or (rate.is_Mul and len(moving) == 1):
        for part in moving:
            yield from _nonlinear_terms(part, states)
    else:
        yield rate


def _look_into(node: sp.Basic, states: tuple[sp.Symbol, ...], element: str, found: dict[sp.Expr, list[str]]) -> None:
    """Go down to the largest parts that are linear in the states."""
    if not node.free_symbols & set(states):
        return
    if isinstance(node, sp.Expr) and is_affine(node, states):
        constant = node.xreplace(dict.fromkeys(states, sp.S.Zero))
        factor, form = sp.expand(node - constant).as_independent(*states, as_Add=False)
        found.setdefault(form if factor != 0 else node, []).append(element)
        return
    for part in node.arguments if isinstance(node, ElementCall) else node.args:
        _look_into(part, states, node.name if isinstance(node, ElementCall) else element, found)
