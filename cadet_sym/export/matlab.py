"""Write the moment equations as one MATLAB function file, which GNU Octave reads, too: a struct of function handles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.errors import ExportError
from cadet_sym.export.names import c_comment
from cadet_sym.export.steps import operations
from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["matlab_text"]

OPERATIONS: Mapping[str, str] = {
    "ASSIGN": "{0}",
    "LIFT": "{0}",
    "ADD": "{0} + {1}",
    "SUB": "{0} - {1}",
    "NEG": "-{0}",
    "TWICE": "{0} + {0}",
    "MUL": "{0} * {1}",
    "SQ": "{0} * {0}",
    "DIV": "{0} / {1}",
    "INV": "1 / {0}",
    "LT": "double({0} < {1})",
    "LE": "double({0} <= {1})",
    "EQ": "double({0} == {1})",
    "NE": "double({0} ~= {1})",
    "NOT": "double({0} == 0)",
    "AND": "double({0} ~= 0 && {1} ~= 0)",
    "OR": "double({0} ~= 0 || {1} ~= 0)",
    "IF_ELSE_ZERO": "pick({0}, {1})",
    "SIGN": "sign({0})",
    "FABS": "abs({0})",
    "COPYSIGN": "abs({0}) * (1 - 2 * (1 / {1} < 0 || {1} < 0))",
    "FMIN": "min({0}, {1})",
    "FMAX": "max({0}, {1})",
    "POW": "{0} ^ {1}",
    "CONSTPOW": "{0} ^ {1}",
    "FMOD": "rem({0}, {1})",
    "ATAN2": "atan2({0}, {1})",
    "HYPOT": "hypot({0}, {1})",
    **{
        name.upper(): f"{name}({{0}})"
        for name in (
            *("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"),
            *("asinh", "acosh", "atanh", "erf", "expm1", "log1p", "floor", "ceil"),
        )
    },
}

HEAD = """function m = {name}()
% {title}
% Mean and covariance of the states of a random vibration model (CADET), written by cadet-sym.
%
%   m = {name}();
%   m.rate(t, y, p)       rate of the packed moments y (means, then the lower triangle of the covariance by columns)
%   m.jacobian(t, y, p)   its Jacobian in y, sparse
%   m.outputs(t, y, p)    [mean, variance] of the outputs, a column each
%   m.p, m.y0             default parameters and the moments at t = 0
%   [t, y] = ode15s(@(t, y) m.rate(t, y, m.p), [0, m.duration], m.y0, odeset('RelTol', 1e-8, 'AbsTol', 1e-10));
"""


def matlab_text(
    lowered: MomentFunctions,
    p: npt.NDArray[np.float64],
    start: npt.NDArray[np.float64],
    name: str,
) -> str:
    """The file `name`.m.

    Raises
    ------
    ExportError
        If an operation has no counterpart in MATLAB.
    """
    functions = _scalar_functions(lowered)
    model = lowered.equations.quasi_linear.system.model
    outputs = tuple(lowered.equations.quasi_linear.outputs)
    lines = [HEAD.format(name=name, title=c_comment(model.name)).rstrip()]
    tables = {"states": lowered.equations.states, "parameters": lowered.parameters, "output_names": outputs}
    for field, names in tables.items():
        lines.append(f"m.{field} = {{{', '.join(map(_text, names))}}};")
    lines.append(f"m.p = {_column(p)};")
    lines.append(f"m.y0 = {_column(start)};")
    lines.append(f"m.duration = {model.number(model.run.duration)!r};")
    lines.append("m.rate = @rate;\nm.jacobian = @jacobian;\nm.outputs = @outputs;\nend")
    lines += ["", "function dy = rate(t, y, p)", *_body(functions["rate"]), "end"]
    pattern = lowered.jacobian.sparsity_out(0)
    rows, columns = pattern.get_triplet()
    size = lowered.rate.size1_out(0)
    lines += ["", "function J = jacobian(t, y, p)", *_body(functions["jacobian"])]
    lines.append(f"J = sparse({_integers(rows)}, {_integers(columns)}, values, {size}, {size});")
    lines += ["end", "", "function moments = outputs(t, y, p)", *_body(functions["outputs"])]
    lines += ["moments = [mean, variance];", "end", "", "function x = pick(condition, x)"]
    lines += ["if condition == 0", "    x = 0;", "end", "end", ""]
    return "\n".join(lines)


def _scalar_functions(lowered: MomentFunctions) -> dict[str, ca.Function]:
    """Rate, entries of the Jacobian, outputs; every result dense."""
    t, y = ca.SX.sym("t"), ca.SX.sym("y", lowered.equations.packing.size)
    p = ca.SX.sym("p", len(lowered.parameters))
    results = {
        "rate": {"dy": ca.densify(lowered.rate(t, y, p))},
        "jacobian": {"values": ca.vertcat(*lowered.jacobian(t, y, p).nz)},
        "outputs": dict(zip(("mean", "variance"), map(ca.densify, lowered.outputs(t, y, p)), strict=True)),
    }
    return {
        name: ca.Function(name, [t, y, p], [ca.SX(v) for v in parts.values()], ["t", "y", "p"], list(parts))
        for name, parts in results.items()
    }


def _body(function: ca.Function) -> Iterator[str]:
    """One assignment an operation."""
    for k, output in enumerate(function.name_out()):
        yield f"{output} = zeros({function.nnz_out(k)}, 1);"
    for k, step in enumerate(operations(function, ("t",))):
        operands = [f"a{x}" if isinstance(x, int) else _place(x) for x in step.operands]
        if "[" in step.kind:
            yield f"{_place(step.kind)} = {operands[0]};"
        elif step.kind in OPERATIONS:
            yield f"a{k} = {OPERATIONS[step.kind].format(*operands)};"
        else:
            raise ExportError(f"the operation `{step.kind.lower()}` has no counterpart in MATLAB; export C instead")


def _place(text: str) -> str:
    """A number or an entry as MATLAB writes it, entries counted from one."""
    for opening in ("K(", "TINY("):
        if text.startswith(opening):
            return f"({text[len(opening) : -1]})"
    if "INFINITY" in text:
        return "(-Inf)" if "-" in text else "Inf"
    if "NAN" in text:
        return "NaN"
    name, bracket, index = text.partition("[")
    return f"{name}({int(index[:-1]) + 1})" if bracket else name


def _text(name: str) -> str:
    return "'" + c_comment(name).replace("'", "''") + "'"


def _column(values: npt.NDArray[np.float64]) -> str:
    return "[" + "; ".join(repr(float(value)) for value in values) + "]" if len(values) else "zeros(0, 1)"


def _integers(values: list[int]) -> str:
    return "[" + " ".join(str(value + 1) for value in values) + "]"
