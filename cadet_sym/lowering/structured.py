"""The rate of a large model as machine code: products of matrices in loops, where CasADi's graph would name every term.

P' = N P + (N P)^T + D with a sparse N. Of the model come the functions of a few numbers, mu', the entries of N and those
of D; what is made of them is the same for all models.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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
    work: Vector, adds: int,
) -> int:
    """Write the lower triangle of N P + (N P)^T + D, packed column by column, or add it to what is there.

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
            value = half[j * n + i] + half[i * n + j]
            out[k] = out[k] + value if adds > 0 else value
            k += 1
    for e in range(forced):
        place = int(places[e])
        out[place] += D[e]
    return 0


@cache
def _assemble() -> MachineCode:
    return kernel(assemble)


def structured_rate(
    ingredients: ca.Function, shelf: Shelf | None, name: str = "rate", directions: ca.SX | None = None
) -> MachineCode:
    """The machine code of `rate`, (t, y, p) -> dy/dt, from the function (t, y, p) -> mu', N, D (see `LoweredSystem`).

    Parameters
    ----------
    directions : (parameters, columns) along which p goes: with them that of (t, [y; S], p), the moments and their derivatives,
        of which those of P have the rate N S + (N S)^T + dN P + (dN P)^T + dD.
    """
    few, N, below = _few(ingredients, directions)
    n, rows, size, blocks = N.size1(), few.size1_out(0), ingredients.size1_in(1), few.size2_out(0)
    # CasADi's entries go column by column; those of the transpose, row by row of N
    begins, columns = N.T.get_ccs()
    places = [j * n - j * (j - 1) // 2 + i - j for i, j in below]
    lines = [
        intermediate(few, "few"),
        *(_table(*each) for each in (("begins", begins), ("columns", columns), ("places", places))),
        "declare i64 @assemble(ptr, ptr, ptr, ptr, ptr, ptr, ptr, i64, i64, ptr, i64)",
        f"define void @{name}(ptr %t, ptr %z, ptr %p, ptr %dz) nounwind {{",
        f"  %mean = call ptr @malloc(i64 {8 * (blocks * (rows + N.nnz() + len(below)) + 2 * n * n)})",
        _at("%N", "%mean", blocks * rows),
        _at("%D", "%N", blocks * N.nnz()),
        _at("%work", "%D", blocks * len(below)),
        "  call void @few(ptr %t, ptr %z, ptr %p, ptr %mean, ptr %N, ptr %D)",
    ]
    for k in range(blocks):
        lines += [
            _at(f"%mean{k}", "%mean", k * rows),
            _at(f"%N{k}", "%N", k * N.nnz()),
            _at(f"%D{k}", "%D", k * len(below)),
            _at(f"%P{k}", "%z", k * size + n),
            _at(f"%d{k}", "%dz", k * size),
            _at(f"%slope{k}", f"%d{k}", n),
            _assembled(n, f"%P{k}", f"%slope{k}", "%N0", f"%D{k}", len(below), adds=0),
        ]
        if k:
            lines.append(_assembled(n, "%P0", f"%slope{k}", f"%N{k}", f"%D{k}", 0, adds=1))
        lines += _copies(n, rows, k)
    text = "\n".join([*lines, "  call void @free(ptr %mean)", "  ret void\n}\n"])
    code = machine_code(text, name, shelf=shelf, symbols={"assemble": _assemble().addresses["assemble"]})
    return MachineCode(code.addresses, (code, _assemble()))


def _few(ingredients: ca.Function, directions: ca.SX | None) -> tuple[ca.Function, ca.Sparsity, list[tuple[int, int]]]:
    """(t, z, p) -> mu', the entries of N row by row, and those of D below the diagonal, a column for each block of z.

    And the pattern of N, and where the entries of D stand.
    """
    N, D = ingredients.sparsity_out(1), ingredients.sparsity_out(2)
    below = [(i, j) for i, j in zip(*D.get_triplet(), strict=True) if i >= j]
    size, t, p = ingredients.size1_in(1), ca.SX.sym("t"), ca.SX.sym("p", ingredients.size1_in(2))
    directions = ca.SX(p.numel(), 0) if directions is None else directions
    z = ca.SX.sym("z", size * (1 + directions.size2()))
    y = z[:size]
    mean, gains, diffusion = ingredients(t, y, p)
    forced = ca.vertcat(*(diffusion[i, j] for i, j in below)) if below else ca.SX(0, 1)
    parts = [ca.densify(mean), ca.densify(ca.vertcat(*gains.T.nz)), forced]
    columns = [[part] for part in parts]
    for k in range(directions.size2()):
        S, along = z[(1 + k) * size : (2 + k) * size], directions[:, k]
        for column, f in zip(columns, parts, strict=True):
            column.append(ca.densify(ca.jtimes(f, y, S) + ca.jtimes(f, p, along)))
    return ca.Function("few", [t, z, p], [ca.horzcat(*column) for column in columns]), N, below


def _assembled(n: int, P: str, slope: str, N: str, D: str, forced: int, *, adds: int) -> str:
    given = f"ptr {P}, ptr {slope}, ptr {N}, ptr @begins, ptr @columns, ptr {D}, ptr @places, i64 {forced}, i64 {n}"
    return f"  call i64 @assemble({given}, ptr %work, i64 {adds})"


def _at(pointer: str, base: str, index: int) -> str:
    return f"  {pointer} = getelementptr double, ptr {base}, i64 {index}"


def _copies(n: int, rows: int, block: int) -> Iterator[str]:
    """The mean's rate to the front, the distance's behind the covariance."""
    for i in range(rows):
        here = f"{block}x{i}"
        yield _at(f"%from{here}", f"%mean{block}", i)
        yield f"  %value{here} = load double, ptr %from{here}"
        yield _at(f"%to{here}", f"%d{block}", i if i < n else n + n * (n + 1) // 2)
        yield f"  store double %value{here}, ptr %to{here}"


def _table(name: str, numbers: Iterable[int]) -> str:
    values = list(numbers) or [0]
    return f"@{name} = internal constant [{len(values)} x double] [{', '.join(f'double {literal(k)}' for k in values)}]"
