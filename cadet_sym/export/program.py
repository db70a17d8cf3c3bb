"""Turn a CasADi function of scalar operations into C.

CasADi's own generator wraps every function in an interface of its own and leaves one block of code, however long.
This one writes each operation as one constant, in the order in which CasADi evaluates them (so that the results are
the same to the last bits), and cuts long functions into blocks that a compiler takes in linear time; what a later block
needs of an earlier one goes through a scratch array. There, too, are the arguments and results of functions that are called.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import casadi as ca

from cadet_sym.export.functions import Calls, Program, definition, own_names, signature, taken
from cadet_sym.export.rolled import rolled, straight
from cadet_sym.export.steps import OPERATIONS, operations
from cadet_sym.export.tables import Tables
from cadet_sym.export.writer import Writer

__all__ = ["translate"]

BLOCK = 1500
"""Lines of one C function; compile time grows faster than its length. What is longer is written as loops where it can be."""


def translate(
    function: ca.Function,
    name: str,
    scalars: Sequence[str] = (),
    calls: Calls | None = None,
    tables: Tables | None = None,
    *,
    plain: bool = False,
) -> Program:
    """Write a CasADi function of scalars as C.

    Parameters
    ----------
    function : made of SX.
    name : of the C function.
    scalars : inputs that are passed by value.
    calls : where functions that it calls are written.
    tables : where its constants are; by default before it.
    plain : whether its arguments and results have no names of their own, and those without entries are left out.

    Raises
    ------
    ExportError
        If an operation has no C.
    """
    names = own_names(function) if plain else (tuple(function.name_in()), tuple(function.name_out()))
    inputs, outputs = taken(function) if plain else names
    steps = operations(function, scalars, names)
    own = Tables(f"{function.name()}_c") if tables is None else tables
    writer = Writer(rolled(steps) if len(steps) > BLOCK else straight(steps), BLOCK, own, calls)
    pieces, size = writer.pieces()
    parameters, given = signature(inputs, outputs, scalars), (*inputs, *outputs)
    work, texts = [f"    R w[{size}];"] * bool(size), [own.text] if own.names and tables is None else []
    if len(pieces) == 1:
        texts.append(definition(f"void {name}", parameters, given, [*work, *pieces[0]]))
    else:
        local, lines = f"part_of_{name if plain else function.name()}", []
        for k, piece in enumerate(pieces):
            beside = f"{parameters}, R *restrict w"
            texts.append(definition(f"static void {local}_{k}", beside, (*given, "w"), piece))
            lines.append(f"    {local}_{k}({', '.join([*given, 'w'])});")
        texts.append("\n".join([f"void {name}({parameters})", "{", *work, *lines, "}"]))
    counts = Counter(OPERATIONS[step.kind][0] for step in steps if step.kind in OPERATIONS)
    for called in writer.called:
        counts.update(called.counts)
    counts.pop("moves", None)
    scratch = size + max((called.scratch for called in writer.called), default=0)
    called = tuple(dict.fromkeys(each.name for each in writer.called))
    return Program(name, "\n\n".join(texts) + "\n", scratch, dict(sorted(counts.items())), called)
