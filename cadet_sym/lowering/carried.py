"""The rate of a model with wheels on one track as machine code: loops over the ground between the wheels.

What goes before that ground, N, V/h and what wheels add are a function of scalars like any other (`head`). The ground itself
is the same few operations for every mode of every element, on all rows at once: written out, they would fill the
processor's memory for instructions.

    a_i' = N a_i - slope_i    (see `cadet_sym.delay`; the arithmetic is that of `lowering.delay`)

The rate of the ground is linear in what it consists of, a and what enters, and in what moves it, N and V/h. So the loops
carry derivatives too: once with those of the former, and once more, added, with those of the latter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from cadet_sym.delay import DelayGrid, Gap
from cadet_sym.lowering.held import opened
from cadet_sym.lowering.instructions import literal
from cadet_sym.lowering.llvm import intermediate

if TYPE_CHECKING:
    from cadet_sym.lowering.functions import MomentFunctions

__all__ = ["WIDEST", "carried_code", "carried_slopes_code", "head", "slopes_head"]

WIDEST = 64
"""Rows up to which a vector of them is worth its registers."""


def head(lowered: MomentFunctions, *, free: bool) -> ca.Function:
    """(t, x, p) -> rate of what goes before the ground between wheels, and what moves that ground as one vector.

    With `free`, x and p are those of `held.free_rate`. What moves the ground: the columns of N in the rows carried along
    that are not zero, then V/h of every gap, then what the wheel in front of it adds, by noises.
    """
    grid, packing, count = lowered.facts.delay, lowered.facts.packing, len(lowered.parameters)
    assert grid is not None
    kept = np.array(lowered.free_entries()["free"], dtype=int).ravel() if free else np.arange(packing.size)
    t, x, p, y = opened(lowered, kept)
    rates, N, speed, entering = lowered.parts(t, y, p[:count])
    columns = [ca.densify(N[: grid.rows, c]) for c in used_columns(lowered.parts.sparsity_out(1), grid.rows)]
    added, first = [], 0
    for track in grid.tracks:
        for _ in track.gaps:
            added.append(ca.reshape(entering[first : first + packing.n * track.noises], packing.n, track.noises))
            first += packing.n * track.noises
    moves = ca.vertcat(*columns, speed, *(ca.vec(b[: grid.rows, :]) for b in added))
    before = [i for i in kept.tolist() if i < rates.numel()]
    results = ca.cse([ca.densify(rates[before]), ca.densify(moves)])
    return ca.Function("head", [t, x, p], results, ["t", "x", "p"], ["dx", "moves"])


def used_columns(N: ca.Sparsity, rows: int) -> list[int]:
    """Columns of N that are not zero in the first rows."""
    pairs = zip(N.row(), N.get_col(), strict=True)
    return sorted({column for row, column in pairs if row < rows})


@dataclass(frozen=True)
class _Layout:
    """Where everything is: in x, in p and among what moves the ground."""

    grid: DelayGrid
    columns: list[int]
    first: int  # of the ground in x
    apart: str  # what is known of it is in x or in p ...
    known: int  # ... from here on
    moves: int
    adds: bool = False  # the rates to what is there


def slopes_head(lowered: MomentFunctions, directions: ca.SX) -> ca.Function:
    """(t, [y; columns of S], p) -> what `head` gives, and its derivatives along every column.

    First the rates and their derivatives, then what moves the ground; and of every column what moves the derivatives of
    the ground, N and V/h with the derivative of what enters, and what moves the ground besides, the other way round.

    Parameters
    ----------
    directions : (parameters, columns) along which p goes.
    """
    function, grid, size = lowered.rate_head, lowered.facts.delay, lowered.facts.packing.size
    assert grid is not None
    t, p = ca.SX.sym("t"), ca.SX.sym("p", len(lowered.parameters))
    z = ca.SX.sym("z", size * (1 + directions.size2()))
    y, S = z[:size], ca.reshape(z[size:], size, directions.size2())
    rates, moves = function(t, y, p)
    entering = moves.numel() - sum(len(track.gaps) * track.noises * grid.rows for track in grid.tracks)
    all_rates, all_moves = [rates], [moves]
    for k in range(directions.size2()):
        slopes, changes = (ca.jtimes(f, y, S[:, k]) + ca.jtimes(f, p, directions[:, k]) for f in (rates, moves))
        all_rates.append(ca.densify(slopes))
        all_moves += [ca.vertcat(moves[:entering], changes[entering:]), ca.vertcat(changes[:entering], moves[entering:])]
    return ca.Function("head", [t, z, p], ca.cse([*all_rates, *map(ca.densify, all_moves)]))


def carried_slopes_code(lowered: MomentFunctions, function: ca.Function, name: str) -> str:
    """LLVM's text of the rate (t, [y; S], p) of the moments and their derivatives, from `slopes_head`."""
    size, columns = lowered.facts.packing.size, (function.n_out() - 2) // 3
    layout = _layout(lowered, lowered.rate_head, "x")
    pointers = [f"d{k}" for k in range(1 + columns)] + [f"m{k}" for k in range(1 + 2 * columns)]
    lines = [
        intermediate(function, f"{name}_head"),
        *_ground(layout, "ground"),
        *_ground(replace(layout, adds=True), "more_ground"),
        f"define void @{name}(ptr %t, ptr %z, ptr %p, ptr %dz) nounwind {{",
        *(f"  %m{k} = alloca [{layout.moves} x double], align 32" for k in range(1 + 2 * columns)),
        *(f"  %z{k} = getelementptr double, ptr %z, i64 {k * size}" for k in range(1 + columns)),
        *(f"  %d{k} = getelementptr double, ptr %dz, i64 {k * size}" for k in range(1 + columns)),
        f"  call void @{name}_head(ptr %t, ptr %z, ptr %p, {', '.join(f'ptr %{each}' for each in pointers)})",
        "  call void @ground(ptr %m0, ptr %z0, ptr %p, ptr %d0)",
    ]
    for k in range(1, 1 + columns):
        lines.append(f"  call void @ground(ptr %m{2 * k - 1}, ptr %z{k}, ptr %p, ptr %d{k})")
        lines.append(f"  call void @more_ground(ptr %m{2 * k}, ptr %z0, ptr %p, ptr %d{k})")
    return "\n".join([*lines, "  ret void\n}\n"])


def _layout(lowered: MomentFunctions, head: ca.Function, apart: str) -> _Layout:
    grid = lowered.facts.delay
    assert grid is not None
    columns = used_columns(lowered.parts.sparsity_out(1), grid.rows)
    known = head.size1_in(1 if apart == "x" else 2) - grid.known
    return _Layout(grid, columns, head.size1_out(0), apart, known, head.size1_out(1))


def carried_code(lowered: MomentFunctions, function: ca.Function, name: str) -> str:
    """LLVM's text of the rate (t, x, p) -> dx, from its `head`."""
    layout = _layout(lowered, function, "x" if name == "rate" else "p")
    lines = [
        intermediate(function, f"{name}_head"),
        *_ground(layout, "ground"),
        f"define void @{name}(ptr %t, ptr %x, ptr %p, ptr %dx) nounwind {{",
        f"  %moves = alloca [{layout.moves} x double], align 32",
        f"  call void @{name}_head(ptr %t, ptr %x, ptr %p, ptr %dx, ptr %moves)",
        "  call void @ground(ptr %moves, ptr %x, ptr %p, ptr %dx)",
        "  ret void\n}\n",
    ]
    return "\n".join(lines)


def _ground(layout: _Layout, name: str) -> Iterator[str]:
    """A function that writes the rates of the ground, or adds them to what is there."""
    grid, rows = layout.grid, layout.grid.rows
    vector = f"<{rows} x double>"
    yield f"define internal void @{name}(ptr %moves, ptr %x, ptr %p, ptr %dx) nounwind {{"
    yield f"  %inflow = alloca {vector}, align 32"
    for c in range(len(layout.columns)):
        yield from _load(f"%n{c}", "%moves", c * rows, vector)
    first, known, g = layout.first, layout.known, 0
    speed = len(layout.columns) * rows
    added = speed + sum(len(track.gaps) for track in grid.tracks)
    for track in grid.tracks:
        q = track.noises
        for k, gap in enumerate(track.gaps):
            for noise in range(q):
                place = _Place(first + noise * rows, known + noise * len(gap.known), q, added + noise * rows)
                yield from _gap(layout, gap, place, f"g{g}q{noise}", speed + g, joined=k > 0)
            first += gap.elements * gap.modes * q * rows
            known += gap.elements * gap.modes * q * len(gap.known)
            added, g = added + q * rows, g + 1
    if layout.apart == "x" and grid.known and not layout.adds:
        yield f"  %rest = getelementptr double, ptr %dx, i64 {layout.known}"
        yield f"  call void @llvm.memset.p0.i64(ptr %rest, i8 0, i64 {8 * grid.known}, i1 false)"
    yield "  ret void\n}"


@dataclass(frozen=True)
class _Place:
    """Where one noise of one gap begins, and how many noises lie between two modes."""

    carried: int
    known: int
    noises: int
    added: int


def _gap(layout: _Layout, gap: Gap, place: _Place, label: str, speed: int, *, joined: bool) -> Iterator[str]:
    """A loop over the elements of a gap, for one noise."""
    rows, vector = layout.grid.rows, f"<{layout.grid.rows} x double>"
    stride = place.noises * rows
    yield from _load(f"%{label}in", "%moves", place.added, vector)
    if joined:
        yield from _load(f"%{label}before", "%x", place.carried - stride, vector)
        yield f"  %{label}all = fadd {vector} %{label}before, %{label}in"
    yield f"  store {vector} %{label}{'all' if joined else 'in'}, ptr %inflow, align 32"
    yield from _load(f"%{label}v", "%moves", speed, "double")
    for m in range(gap.modes):
        yield f"  %{label}s{m} = fmul double %{label}v, {literal(2.0 * (2 * m + 1))}"
        yield from _splat(f"%{label}w{m}", f"%{label}s{m}", rows)
    yield f"  br label %{label}start\n{label}start:\n  br label %{label}loop\n{label}loop:"
    yield f"  %{label}e = phi i64 [ 0, %{label}start ], [ %{label}next, %{label}loop ]"
    between = place.noises * len(gap.known)
    for of, pointer, base, per in (("x", "x", place.carried, stride), ("z", layout.apart, place.known, between)):
        yield f"  %{label}{of}o = mul i64 %{label}e, {gap.modes * per}"
        yield f"  %{label}{of}i = add i64 %{label}{of}o, {base}"
        yield f"  %{label}{of} = getelementptr double, ptr %{pointer}, i64 %{label}{of}i"
    yield f"  %{label}d = getelementptr double, ptr %dx, i64 %{label}xi"
    yield from _element(layout, gap, place, label)
    yield f"  %{label}next = add i64 %{label}e, 1"
    yield f"  %{label}more = icmp slt i64 %{label}next, {gap.elements}"
    yield f"  br i1 %{label}more, label %{label}loop, label %{label}end\n{label}end:"


def _element(layout: _Layout, gap: Gap, place: _Place, label: str) -> Iterator[str]:
    """The rates of all modes of one element; `label` x, z and d point at its own."""
    rows, vector, last = layout.grid.rows, f"<{layout.grid.rows} x double>", gap.modes - 1
    stride = place.noises * rows

    def operation(result: str, kind: str, a: str, b: str) -> str:
        return f"  %{label}{result} = {kind} {vector} %{label}{a}, %{label}{b}"

    for m in range(gap.modes):
        yield from _load(f"%{label}a{m}", f"%{label}x", m * stride, vector)
    yield f"  %{label}i = load {vector}, ptr %inflow, align 32"
    yield f"  store {vector} %{label}a{last}, ptr %inflow, align 32"
    half = f"<{', '.join([f'double {literal(0.5)}'] * rows)}>"
    for of, whole in (("hi", "i"), ("ho", f"a{last}")):
        yield f"  %{label}{of} = fmul {vector} %{label}{whole}, {half}"
    yield operation("h0", "fsub", "ho", "hi")
    yield operation("hp", "fadd", "ho", "hi")
    for m in range(gap.modes):
        if m:
            yield operation(f"h{m}", "fsub", f"h{m - 2}" if m > 1 else "hp", f"a{m - 1}")
        yield operation(f"k{m}", "fmul", f"w{m}", f"h{m}")
        if m:
            yield operation(f"t{m}", "fadd", f"t{m - 1}" if m > 1 else "k0", f"k{m}")
        total = yield from _product(layout, gap, place, label, m)
        slope = f"%{label}{'t' if m == last else 'k'}{m}"
        rate = f"%{label}r{m}"
        yield f"  {rate} = fsub {vector} {total}, {slope}"
        yield f"  %{label}d{m} = getelementptr double, ptr %{label}d, i64 {m * stride}"
        if layout.adds:
            yield f"  {rate}b = load {vector}, ptr %{label}d{m}, align 8"
            yield f"  {rate}s = fadd {vector} {rate}, {rate}b"
        yield f"  store {vector} {rate}{'s' if layout.adds else ''}, ptr %{label}d{m}, align 8"


def _product(layout: _Layout, gap: Gap, place: _Place, label: str, m: int) -> Iterator[str]:
    """N a of one mode, the known rows of a included; gives the register with the sum."""
    rows, vector, total = layout.grid.rows, f"<{layout.grid.rows} x double>", ""
    for c, column in enumerate(layout.columns):
        if column < rows:
            of, index = "x", m * place.noises * rows + column
        elif column in gap.known:
            of, index = "z", m * place.noises * len(gap.known) + gap.known.index(column)
        else:
            continue  # a filter that is not reached yet
        here = f"%{label}m{m}c{c}"
        yield from _load(here, f"%{label}{of}", index, "double")
        yield from _splat(f"{here}s", here, rows)
        yield f"  {here}t = fmul {vector} %n{c}, {here}s"
        if total:
            yield f"  {here}u = fadd {vector} {total}, {here}t"
        total = f"{here}u" if total else f"{here}t"
    return total or "zeroinitializer"


def _load(register: str, pointer: str, index: int, kind: str) -> Iterator[str]:
    yield f"  {register}.at = getelementptr double, ptr {pointer}, i64 {index}"
    yield f"  {register} = load {kind}, ptr {register}.at, align 8"


def _splat(register: str, scalar: str, rows: int) -> Iterator[str]:
    """A vector of one number."""
    vector = f"<{rows} x double>"
    yield f"  {register}.one = insertelement {vector} poison, double {scalar}, i64 0"
    yield f"  {register} = shufflevector {vector} {register}.one, {vector} poison, <{rows} x i32> zeroinitializer"
