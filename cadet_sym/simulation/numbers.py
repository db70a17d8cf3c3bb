"""Values of expressions that do not depend on the path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.language.expression import ElementCall, evaluate

__all__ = ["matrices", "numeric"]


def numeric(expressions: Sequence[sp.Expr], values: Mapping[sp.Symbol, Any], elements: Mapping[str, Any]) -> np.ndarray:
    """Values of expressions that do not depend on the path: (times, expressions) where values are arrays over time."""
    shape = np.broadcast_shapes(*(np.shape(v) for v in values.values())) if values else ()
    rows = [np.broadcast_to(evaluate(_written_out(e, elements), values), shape) for e in expressions]
    return np.stack(rows, axis=-1) if rows else np.zeros((*shape, 0))


def matrices(
    entries: Mapping[tuple[int, int], sp.Expr],
    shape: tuple[int, int],
    values: Mapping[sp.Symbol, Any],
    elements: Mapping[str, Any],
    times: int,
) -> np.ndarray:
    """(times, *shape) of the entries that are not zero."""
    found = np.zeros((times, *shape))
    numbers = np.broadcast_to(numeric(list(entries.values()), values, elements), (times, len(entries)))
    for place, value in zip(entries, numbers.T, strict=True):
        found[:, *place] = value
    return found


def _written_out(expression: sp.Expr, elements: Mapping[str, Any]) -> sp.Expr:
    """The bodies of declared elements in place of their calls, elements inside elements too."""
    while calls := expression.atoms(ElementCall):
        bodies = {}
        for call in calls:
            element = elements[call.name]
            bodies[call] = element.value.xreplace(dict(zip(element.arguments, call.arguments, strict=True)))
        expression = expression.xreplace(bodies)
    return expression
