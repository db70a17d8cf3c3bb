"""What needs what: parameters worked out in order, and circles found."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import symbol


def parameter_values(given: Mapping[str, sp.Expr]) -> dict[str, float]:
    """Numbers of the parameters, each after those it needs; ModelError for a circle or what is not a finite number."""
    values: dict[sp.Symbol, float] = {}
    for name in _sorted_by_need({n: {s.name for s in e.free_symbols} & set(given) for n, e in given.items()}):
        value = evaluate(given[name], values)
        if not math.isfinite(value):
            raise ModelError(f"the value is not a finite number ({value})", table="parameters", key=name)
        values[symbol(name)] = value
    return {name: values[symbol(name)] for name in given}


def _sorted_by_need(needs: Mapping[str, set[str]]) -> list[str]:
    done: dict[str, None] = {}
    while len(done) < len(needs):
        ready = [name for name, needed in needs.items() if name not in done and needed <= done.keys()]
        if not ready:
            circle = find_circle(needs)
            raise ModelError(
                f"the parameters {' -> '.join(f'`{n}`' for n in circle)} need each other in a circle",
                table="parameters",
                key=circle[0],
                token=circle[1],
            )
        done.update(dict.fromkeys(ready))
    return list(done)


def find_circle(needs: Mapping[str, Iterable[str]]) -> list[str]:
    """Names along one circle of a relation, the first again at the end; empty if there is none."""
    finished: set[str] = set()
    for start in needs:
        path: list[str] = []
        pending: list[Any] = [iter([start])]
        while pending:
            name = next(pending[-1], None)
            if name is None:
                pending.pop()
                if path:
                    finished.add(path.pop())
            elif name in path:
                return [*path[path.index(name) :], name]
            elif name in needs and name not in finished:
                path.append(name)
                pending.append(iter(sorted(needs[name])))
    return []
