"""Operations of CasADi's functions as C: what each of them is there, and all that it refers to as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from cadet_sym.errors import ExportError
from cadet_sym.export.tables import constant
from cadet_sym.lowering.operations import Entry
from cadet_sym.lowering.operations import operations as take_apart

__all__ = ["OPERATIONS", "Names", "Step", "operations"]

Names = tuple[tuple[str, ...], tuple[str, ...]]
"""Of the arguments and of the results."""

OPERATIONS: Mapping[str, tuple[str, str]] = {
    # CasADi's operation: what it is counted as, and its C
    "ASSIGN": ("moves", "{0}"),
    "LIFT": ("moves", "{0}"),
    "ADD": ("additions", "{0} + {1}"),
    "SUB": ("additions", "{0} - {1}"),
    "NEG": ("additions", "-{0}"),
    "TWICE": ("additions", "{0} + {0}"),
    "MUL": ("multiplications", "{0} * {1}"),
    "SQ": ("multiplications", "{0} * {0}"),
    "DIV": ("divisions", "{0} / {1}"),
    "INV": ("divisions", "K(1.0) / {0}"),
    "SQRT": ("square roots", "M(sqrt)({0})"),
    "LT": ("comparisons", "(R)({0} < {1})"),
    "LE": ("comparisons", "(R)({0} <= {1})"),
    "EQ": ("comparisons", "(R)({0} == {1})"),
    "NE": ("comparisons", "(R)({0} != {1})"),
    "NOT": ("comparisons", "(R)({0} == K(0.0))"),
    "AND": ("comparisons", "(R)({0} != K(0.0) && {1} != K(0.0))"),
    "OR": ("comparisons", "(R)({0} != K(0.0) || {1} != K(0.0))"),
    "IF_ELSE_ZERO": ("comparisons", "{0} != K(0.0) ? {1} : K(0.0)"),
    "SIGN": ("comparisons", "{0} < K(0.0) ? K(-1.0) : {0} > K(0.0) ? K(1.0) : {0}"),
    "FABS": ("comparisons", "M(fabs)({0})"),
    "COPYSIGN": ("comparisons", "M(copysign)({0}, {1})"),
    "FMIN": ("comparisons", "M(fmin)({0}, {1})"),
    "FMAX": ("comparisons", "M(fmax)({0}, {1})"),
    "FLOOR": ("comparisons", "M(floor)({0})"),
    "CEIL": ("comparisons", "M(ceil)({0})"),
    "POW": ("function calls", "M(pow)({0}, {1})"),
    "CONSTPOW": ("function calls", "M(pow)({0}, {1})"),
    "ATAN2": ("function calls", "M(atan2)({0}, {1})"),
    "FMOD": ("function calls", "M(fmod)({0}, {1})"),
    "REMAINDER": ("function calls", "M(remainder)({0}, {1})"),
    "HYPOT": ("function calls", "M(hypot)({0}, {1})"),
    **{
        name.upper(): ("function calls", f"M({name})({{0}})")
        for name in (
            *("exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"),
            *("asinh", "acosh", "atanh", "erf", "expm1", "log1p"),
        )
    },
}


@dataclass(frozen=True)
class Step:
    """One operation, or one result written: everything it refers to by its text or the step that made it."""

    kind: str  # of OPERATIONS, `CALL`, `RESULT` of a call, or the text of a result's place
    operands: tuple[str | int, ...]  # text, or index of a step
    entry: Entry | None = None  # of the call of that number: which of its results
    called: ca.Function | None = None


def operations(function: ca.Function, scalars: Sequence[str], names: Names | None = None) -> list[Step]:
    """The operations in the order of evaluation, all that they refer to as text or as the step that made it."""
    try:
        found = take_apart(function)
    except ValueError as error:
        raise ExportError(f"{error} and cannot be written as C") from None
    inputs, outputs = names or (tuple(function.name_in()), tuple(function.name_out()))

    def text(operand: int | float | Entry) -> str | int:
        if isinstance(operand, Entry):
            name = inputs[operand.vector]
            return name if name in scalars else f"{name}[{operand.index}]"
        return operand if type(operand) is int else constant(operand)

    steps = []
    for kind, operands, entry, called in found:
        if kind == "OUTPUT":
            assert entry is not None
            steps.append(Step(f"{outputs[entry.vector]}[{entry.index}]", tuple(map(text, operands))))
            continue
        if kind not in OPERATIONS and kind not in ("CALL", "RESULT"):
            raise ExportError(
                f"the operation `{kind.lower()}` in `{function.name()}` has no counterpart in C; "
                "write the model without it"
            )
        steps.append(Step(kind, tuple(map(text, operands)), entry, called))
    return steps
