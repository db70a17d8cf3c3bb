"""Functions in C: what is known of one, its parameters, how it is called."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import casadi as ca

from cadet_sym.export.steps import Names
from cadet_sym.export.tables import Tables

__all__ = ["Calls", "Program", "call", "definition", "own_names", "signature", "sizes_of", "taken"]


@dataclass(frozen=True)
class Program:
    """A function in C: its text, and what one evaluation costs."""

    name: str
    text: str
    scratch: int  # values that it keeps on the stack, with those of what it calls
    counts: Mapping[str, int] = field(default_factory=dict)  # operations of one evaluation, by kind; at most, if it may choose
    called: tuple[str, ...] = ()  # names of the functions that it calls itself

    @property
    def operations(self) -> int:
        """Arithmetic operations, comparisons and function calls of one evaluation."""
        return sum(self.counts.values())


class Calls(Protocol):
    """What is written beside a function."""

    tables: Tables

    def of(self, function: ca.Function) -> Program:
        """A function that is called, which is written if it is not yet."""
        ...


def own_names(function: ca.Function) -> Names:
    """Names of arguments and results that are nothing else in C."""
    return tuple(f"i{k}" for k in range(function.n_in())), tuple(f"o{k}" for k in range(function.n_out()))


def taken(function: ca.Function) -> Names:
    """Those of a function that is called: what has no entries is left out."""
    inputs, outputs = own_names(function)
    return (
        tuple(x for k, x in enumerate(inputs) if function.nnz_in(k)),
        tuple(x for k, x in enumerate(outputs) if function.nnz_out(k)),
    )


def sizes_of(function: ca.Function) -> list[int]:
    """Numbers of entries of all arguments, then of all results."""
    return [*map(function.nnz_in, range(function.n_in())), *map(function.nnz_out, range(function.n_out()))]


def call(called: Program, function: ca.Function, pointers: Sequence[str]) -> str:
    """The statement that calls a function with pointers to all arguments and results."""
    given = [pointer for pointer, size in zip(pointers, sizes_of(function), strict=True) if size]
    return f"{called.name}({', '.join(given)});"


def signature(inputs: Iterable[str], outputs: Iterable[str], scalars: Sequence[str] = ()) -> str:
    """The parameters of a C function."""
    given = [f"R {x}" if x in scalars else f"const R *restrict {x}" for x in inputs]
    return ", ".join([*given, *(f"R *restrict {x}" for x in outputs)])


def definition(name: str, parameters: str, names: Iterable[str], body: Sequence[str]) -> str:
    """The text of a C function; `names` are those of its parameters, of which some may not be used."""
    used = set(re.findall(r"\b[A-Za-z_]\w*", "\n".join(body)))
    return "\n".join([f"{name}({parameters})", "{", *(f"    (void){x};" for x in names if x not in used), *body, "}"])
