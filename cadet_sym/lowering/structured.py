"""The rate of a large model as machine code: products of matrices in loops, where CasADi's graph would name every term.

P' = N P + (N P)^T + D with a sparse N. Of the model come the functions of a few numbers, mu', the entries of N and those
of D; what is made of them is the same for all models.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING

import casadi as ca

from cadet_sym.lowering.instructions import literal
from cadet_sym.lowering.kernel import Vector, kernel, part
from cadet_sym.lowering.llvm import intermediate
from cadet_sym.lowering.machine import MachineCode, machine_code

if TYPE_CHECKING:
    from cadet_sym.cache import Shelf

__all__ = ["structured_rate"]


def assemble(
    y: Vector, out: Vector, N: Vector, begins: Vector, columns: Vector, D: Vector, places: Vector, forced: int, n: int,
    work: Vector,
) -> int:
    """Write the lower triangle of N P + (N P)^T + D, packed column by column.

    Parameters
    ----------
    y : (n (n + 1) / 2,) the lower triangle of P. out : the same of P'.
    N : entries row by row, where each row begins (n + 1,), and the columns of the entries.
    D : entries (forced,) and their places in the packed triangle.
    work : (2 n^2,).
    """
    half = part(work, n * n)
    k = 0
    for j in range(n):
        for i in range(j, n):
            work[j * n + i] = y[k]
            work[i * n + j] = y[k]
            k += 1
    for i in range(n):
        row = part(half, i * n)
        for j in range(n):
            row[j] = 0.0
        for e in range(int(begins[i]), int(begins[i + 1])):
            weight = N[e]
            other = part(work, int(columns[e]) * n)
            for j in range(n):
                row[j] += weight * other[j]
    k = 0
    for j in range(n):
        for i in range(j, n):
            out[k] = half[j * n + i] + half[i * n + j]
            k += 1
    for e in range(forced):
        place = int(places[e])
        out[place] += D[e]
    return 0


@cache
def _assemble() -> MachineCode:
    return kernel(assemble)


def structured_rate(ingredients: ca.Function, shelf: Shelf | None) -> MachineCode:
    """The machine code of `rate`, (t, y, p) -> dy/dt, from the function (t, y, p) -> mu', N, D (see `LoweredSystem`)."""
    n, rows = ingredients.size1_out(1), ingredients.size1_out(0)  # one more row where the distance is integrated
    N, D = ingredients.sparsity_out(1), ingredients.sparsity_out(2)
    # CasADi's entries go column by column; those of the transpose, row by row of N
    begins, columns = N.T.get_ccs()
    below = [(i, j) for i, j in zip(*D.get_triplet(), strict=True) if i >= j]
    places = [j * n - j * (j - 1) // 2 + i - j for i, j in below]
    t, y, p = (ca.SX.sym(name, ingredients.size1_in(k)) for k, name in enumerate(("t", "y", "p")))
    mean, gains, diffusion = ingredients(t, y, p)
    entries = ca.vertcat(*(diffusion[i, j] for i, j in below)) if below else ca.SX(0, 1)
    few = ca.Function("few", [t, y, p], [mean, ca.vertcat(*gains.T.nz), entries])
    size = 8 * (rows + N.nnz() + len(below) + 2 * n * n)
    text = f"""{intermediate(few, "few")}
{_table("begins", begins)}
{_table("columns", columns)}
{_table("places", places)}
declare i64 @assemble(ptr, ptr, ptr, ptr, ptr, ptr, ptr, i64, i64, ptr)
define void @rate(ptr %t, ptr %y, ptr %p, ptr %out) nounwind {{
  %mean = call ptr @malloc(i64 {size})
  %N = getelementptr double, ptr %mean, i64 {rows}
  %D = getelementptr double, ptr %N, i64 {N.nnz()}
  %work = getelementptr double, ptr %D, i64 {len(below)}
  call void @few(ptr %t, ptr %y, ptr %p, ptr %mean, ptr %N, ptr %D)
  %P = getelementptr double, ptr %y, i64 {n}
  %slope = getelementptr double, ptr %out, i64 {n}
  %done = call i64 @assemble(ptr %P, ptr %slope, ptr %N, ptr @begins, ptr @columns,
                             ptr %D, ptr @places, i64 {len(below)}, i64 {n}, ptr %work)
{_copies(n, rows)}
  call void @free(ptr %mean)
  ret void
}}
"""
    code = machine_code(text, "rate", shelf=shelf, symbols={"assemble": _assemble().addresses["assemble"]})
    return MachineCode(code.addresses, (code, _assemble()))


def _copies(n: int, rows: int) -> str:
    """The mean's rate to the front, the distance's behind the covariance."""
    lines = []
    for i in range(rows):
        to = i if i < n else n + n * (n + 1) // 2
        lines += [
            f"  %from{i} = getelementptr double, ptr %mean, i64 {i}",
            f"  %value{i} = load double, ptr %from{i}",
            f"  %to{i} = getelementptr double, ptr %out, i64 {to}",
            f"  store double %value{i}, ptr %to{i}",
        ]
    return "\n".join(lines)


def _table(name: str, numbers: Iterable[int]) -> str:
    values = list(numbers) or [0]
    return f"@{name} = internal constant [{len(values)} x double] [{', '.join(f'double {literal(k)}' for k in values)}]"
