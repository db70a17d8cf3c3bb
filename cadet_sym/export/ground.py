"""What a C library holds of wheels that follow each other on one track: tables for the loops of its templates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.delay import radau
from cadet_sym.export.tables import array, constant, rows
from cadet_sym.lowering.portable import PortableFunctions

__all__ = ["GapPlace", "GroundTables", "ground_tables", "start_values"]

Integers = npt.NDArray[np.intp]


@dataclass(frozen=True)
class GapPlace:
    """Where the correlation behind one wheel is in y, and what moves it among the parts."""

    first: int
    columns: int
    elements: int
    nodes: int
    joined: bool  # what leaves the gap in front enters, too
    entering: int

    def values(self, states: int) -> int:
        """Number of values of one element."""
        return self.nodes * self.columns * states


@dataclass(frozen=True, eq=False)
class GroundTables:
    """The layout of the correlation with the ground between the wheels; without such wheels there are no gaps."""

    states: int
    head: int  # values of y before it
    size: int
    parts: int
    gain: ca.Sparsity
    gaps: tuple[GapPlace, ...]
    pattern: ca.Sparsity  # of the whole Jacobian
    functions: PortableFunctions

    @property
    def blocks(self) -> int:
        """Values of the Jacobian's blocks, one an element."""
        return sum(gap.elements * gap.values(self.states) ** 2 for gap in self.gaps)

    @property
    def operations(self) -> int:
        """Additions and multiplications of the loops, for one rate."""
        one = 2 * self.gain.nnz() + 2 * self.states
        return sum(
            gap.elements * gap.nodes * gap.columns * (one + self.states * (2 * gap.nodes + 1)) + gap.columns * self.states
            for gap in self.gaps
        )

    def header(self) -> Mapping[str, object]:
        """What the internal header says."""
        return {"head": self.head, "parts": self.parts, "gain": self.gain.nnz(), "gaps": len(self.gaps)}

    def source(self, prefix: str) -> Mapping[str, object]:
        """What the loops need."""
        own, carried = self.functions.pattern, self.functions.parts_pattern
        part_rows, part_columns = carried.get_triplet()
        tables = [_prototypes(prefix)]
        for count in sorted({gap.nodes for gap in self.gaps}):
            for name, values in zip(("places", "derivative"), radau(count), strict=True):
                tables.append(array(f"static const R {name}_{count}", map(constant, values.ravel().tolist())))
        places = (
            f"    {{{g.first}, {g.columns}, {g.elements}, {g.nodes}, {int(g.joined)}, {g.entering}, "
            f"derivative_{g.nodes}, places_{g.nodes}}}"
            for g in self.gaps
        )
        tables.append(f"const {prefix}_gap {prefix}_gaps[] = {{\n" + ",\n".join(places) + "\n};")
        gain_rows, gain_columns = self.gain.get_triplet()
        integers = {
            "gain_row": gain_rows,
            "gain_column": gain_columns,
            "own_column": own.colind(),
            "part_row": part_rows,
            "part_column": part_columns,
        }
        tables += [array(f"static const int {name}", map(str, values)) for name, values in integers.items()]
        return {"tables": "\n".join(tables), "own": max(own.nnz(), 1), "of_parts": carried.nnz()}


def _prototypes(prefix: str) -> str:
    run, held = "R t, const R *restrict y, const R *restrict p", "R t, R s, R V, const R *restrict y, const R *restrict p"
    lines = [
        f"void {prefix}_{name}({arguments}, R *restrict {result}, R *restrict parts);"
        for name, arguments, result in (
            ("rate_parts", run, "dy"),
            ("jacobian_parts", run, "values"),
            ("slope_parts", run, "slope"),
            ("held_rate_parts", held, "dy"),
            ("held_jacobian_parts", held, "values"),
        )
    ]
    return "\n".join(lines) + "\n"


def ground_tables(functions: PortableFunctions, states: int) -> GroundTables:
    """Lay out y behind its head, and the whole Jacobian's pattern."""
    head, size = functions.pattern.shape
    start = functions.start_parts
    count = sum(len(track.gaps) for track in start.delayed)
    first, entering = head, functions.gain.nnz() + count
    gaps = []
    for track in start.delayed:
        columns = len(track.columns[0])
        for k, gap in enumerate(track.gaps):
            gaps.append(GapPlace(first, columns, gap.elements, gap.nodes, k > 0, entering))
            first += gap.elements * gap.nodes * columns * states
            entering += columns * states
    assert first == size
    parts = functions.parts_pattern.size1()
    assert parts == (entering if gaps else 0)
    pattern = functions.pattern if not gaps else _whole_pattern(functions, tuple(gaps), states)
    return GroundTables(states, head, size, parts, functions.gain, tuple(gaps), pattern, functions)


def _whole_pattern(functions: PortableFunctions, gaps: tuple[GapPlace, ...], n: int) -> ca.Sparsity:
    """Places of the whole Jacobian: the head's rows, N and the transport, and what the parts depend on."""
    size, gain = functions.pattern.size2(), functions.gain
    places = [np.array(functions.pattern.get_triplet())]
    N = np.array(gain.get_triplet())
    part_rows, part_columns = (np.array(x, dtype=int) for x in functions.parts_pattern.get_triplet())
    for g, gap in enumerate(gaps):
        block, count = gap.columns * n, gap.elements * gap.nodes
        vectors = gap.first + n * np.arange(count * gap.columns)
        places.append((N[:, :, None] + vectors).reshape(2, -1))
        for node in range(count):
            j, here = node % gap.nodes, gap.first + node * block + np.arange(block)
            before = -1 if node >= gap.nodes or gap.joined else 0
            places += [np.array([here, here + (m - j) * block]) for m in range(before, gap.nodes)]
        for part, column in zip(part_rows, part_columns, strict=True):
            touched = _touched(gap, g, int(part), gain, vectors, n)
            places.append(np.array([touched, np.full(len(touched), column)]))
    rows_found, columns_found = np.hstack(places)
    return ca.Sparsity.triplet(size, size, rows_found.tolist(), columns_found.tolist())


def _touched(gap: GapPlace, g: int, part: int, gain: ca.Sparsity, vectors: Integers, n: int) -> Integers:
    """Entries of a gap whose rate depends on one of the parts."""
    if part < gain.nnz():
        return vectors + gain.row()[part]
    if part == gain.nnz() + g:
        return (vectors[:, None] + np.arange(n)).ravel()
    block = gap.columns * n
    if gap.entering <= part < gap.entering + block:
        return gap.first + part - gap.entering + block * np.arange(gap.nodes)
    return np.zeros(0, dtype=int)


def start_values(functions: PortableFunctions, tables: GroundTables, profile: Iterable[str]) -> Mapping[str, object]:
    """What the template of the moments at the start holds."""
    start = functions.start_parts
    nv, nf, gaps = start.vehicle, start.ground, tables.gaps
    place = nv + nv * nf + nv * nv
    copies, tracks = [], []
    for first, states, noises in start.copies:
        copies.append(f"{{{first}, {states}, {place}}}")
        place += 2 * states**2 + states * noises
    members = max((len(track) for track in start.tracks), default=1)
    for track in start.tracks:
        tracks.append(f"{{{len(track)}, {place}, {{{', '.join(map(str, track))}}}}}")
        place += len(track) - 1
    largest = max((states for _, states, _ in start.copies), default=1)
    widest, size = (tables.states, tables.states) if start.smooth else (largest, largest)
    text = []
    if copies:
        text.append(f"static const struct {{ int first, states, parts; }} copies[] = {{{', '.join(copies)}}};")
        text.append(
            f"static const struct {{ int count, distances, members[{members}]; }} tracks[] = {{\n    "
            + ",\n    ".join(tracks) + "\n};"
        )
    if gaps:
        columns = max(gap.columns for gap in gaps)
        longest = max(gap.elements * gap.nodes for gap in gaps) * size
        text.append(
            f"enum {{ HEAD = {tables.head}, COPIES = {len(copies)}, WIDEST = {widest * columns}, LONGEST = {longest}, "
            f"LAST_PART = {place} }};"
        )
    most = max([1, largest**2, *(gap.nodes * size for gap in gaps)])
    return {
        "vehicle": nv,
        "ground": nf,
        "tracks": len(start.tracks),
        "copies": len(copies),
        "pairs": int(bool(gaps)),
        "smooth": int(start.smooth),
        "most": most,
        "parts": max(functions.start.size1_out(0), 1),
        "tables": "\n".join(text),
        "profile": rows(profile),
    }
