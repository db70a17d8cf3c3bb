"""Turn a CasADi function of scalar operations into C.

CasADi's own generator wraps every function in an interface of its own and leaves one block of code, however long.
This one writes each operation as one constant, in the order in which CasADi evaluates them (so that the results are
the same to the last bits), and cuts long functions into blocks that a compiler takes in linear time; what a later block
needs of an earlier one goes through a scratch array.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from cadet_sym.errors import ExportError
from cadet_sym.export.tables import constant
from cadet_sym.lowering.operations import Entry, cut
from cadet_sym.lowering.operations import operations as take_apart

__all__ = ["Program", "Step", "operations", "translate"]

BLOCK = 1500
"""Operations of one C function; compile time grows faster than its length."""

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
class Program:
    """A function in C: its text, and what one evaluation costs."""

    name: str
    text: str
    scratch: int  # values that go from block to block, on the stack
    counts: Mapping[str, int] = field(default_factory=dict)  # operations of one evaluation, by kind

    @property
    def operations(self) -> int:
        """Arithmetic operations, comparisons and function calls of one evaluation."""
        return sum(self.counts.values())


@dataclass(frozen=True)
class Step:
    """One operation, or one result written: everything it refers to by its text or the step that made it."""

    kind: str  # of OPERATIONS, or the text of a result's place
    operands: tuple[str | int, ...]  # text, or index of a step


def translate(function: ca.Function, name: str, scalars: Sequence[str] = ()) -> Program:
    """Write an expanded CasADi function as C.

    Parameters
    ----------
    function : made of SX.
    name : of the C function; its arguments have the names of the function's inputs and outputs.
    scalars : inputs that are passed by value.

    Raises
    ------
    ExportError
        If an operation has no C.
    """
    steps = operations(function, scalars)
    pieces = cut(steps, BLOCK)
    blocks, slots, scratch = pieces.ranges, pieces.places, pieces.scratch
    outputs = function.name_out()
    signature = ", ".join(
        [f"R {x}" if x in scalars else f"const R *restrict {x}" for x in function.name_in()]
        + [f"R *restrict {x}" for x in outputs]
    )
    inputs = function.name_in()
    texts = []
    if len(blocks) == 1:
        unused = _unused(inputs + outputs, steps)
        body = [f"    (void){x};" for x in unused] + _body(steps, blocks[0], blocks, slots)
        texts.append("\n".join([f"void {name}({signature})", "{", *body, "}"]))
    else:
        calls, local = [], f"part_of_{function.name()}"
        for k, block in enumerate(blocks):
            texts.append("\n".join([f"static void {local}_{k}({signature}, R *restrict w)", "{"]))
            missing = _unused([*inputs, *outputs], [steps[i] for i in block])
            lines = [f"    (void){x};" for x in [*missing, "w"]]
            texts[-1] += "\n" + "\n".join([*lines, *_body(steps, block, blocks, slots), "}"])
            calls.append(f"    {local}_{k}({', '.join([*inputs, *outputs, 'w'])});")
        texts.append("\n".join([f"void {name}({signature})", "{", f"    R w[{max(scratch, 1)}];", *calls, "}"]))
    counts = Counter(OPERATIONS[step.kind][0] for step in steps if step.kind in OPERATIONS)
    counts.pop("moves", None)
    return Program(name, "\n\n".join(texts) + "\n", scratch, dict(sorted(counts.items())))


def operations(function: ca.Function, scalars: Sequence[str]) -> list[Step]:
    """The operations in the order of evaluation, all that they refer to as text or as the step that made it."""
    try:
        found = take_apart(function)
    except ValueError as error:
        raise ExportError(f"{error} and cannot be written as C") from None
    inputs, outputs = function.name_in(), function.name_out()

    def text(operand: int | float | Entry) -> str | int:
        if isinstance(operand, Entry):
            name = inputs[operand.vector]
            return name if name in scalars else f"{name}[{operand.index}]"
        return operand if type(operand) is int else constant(operand)

    steps = []
    for kind, operands, written, _ in found:
        if written is None and kind not in OPERATIONS:
            raise ExportError(
                f"the operation `{kind.lower()}` in `{function.name()}` has no counterpart in C; "
                "write the model without it"
            )
        place = kind if written is None else f"{outputs[written.vector]}[{written.index}]"
        steps.append(Step(place, tuple(map(text, operands))))
    return steps


def _body(steps: Sequence[Step], block: range, blocks: Sequence[range], slots: Mapping[int, int]) -> list[str]:
    """The lines of one block."""

    def place(operand: str | int) -> str:
        if isinstance(operand, str):
            return operand
        return f"a{operand}" if operand in block else f"w[{slots[operand]}]"

    lines = []
    for k in block:
        step = steps[k]
        operands = [place(operand) for operand in step.operands]
        if step.kind not in OPERATIONS:
            lines.append(f"    {step.kind} = {operands[0]};")
            continue
        lines.append(f"    const R a{k} = {OPERATIONS[step.kind][1].format(*operands)};")
        if k in slots:
            lines.append(f"    w[{slots[k]}] = a{k};")
    return lines


def _unused(names: Sequence[str], steps: Sequence[Step]) -> list[str]:
    """Arguments that no step refers to."""
    seen = {operand.partition("[")[0] for step in steps for operand in step.operands if isinstance(operand, str)}
    seen |= {step.kind.partition("[")[0] for step in steps if step.kind not in OPERATIONS}
    return [name for name in names if name not in seen]
