"""What a C library holds of wheels that follow each other on one track: tables for the loops of its templates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from cadet_sym.delay import DelayGrid, Gap, radau_nodes, transport_matrix
from cadet_sym.export.tables import array, constant, rows
from cadet_sym.lowering.portable import PortableFunctions

__all__ = ["GapPlace", "GroundTables", "ground_tables", "start_values"]

Integers = npt.NDArray[np.intp]


@dataclass(frozen=True)
class GapPlace:
    """Where the correlation behind one wheel is in y, and what moves it among the parts."""

    gap: Gap
    first: int
    known_first: int
    columns: int
    joined: bool  # what leaves the gap in front enters, too
    entering: int

    @property
    def count(self) -> int:
        """Modes of all elements."""
        return self.gap.elements * self.gap.modes

    def place(self, rows: int, vector: int, state: int) -> int:
        """Index in y of a state's value in one vector, a mode for one noise; -1 if it is zero."""
        if state < rows:
            return self.first + vector * rows + state
        known = self.gap.known
        return self.known_first + vector * len(known) + known.index(state) if state in known else -1


@dataclass(frozen=True, eq=False)
class GroundTables:
    """The layout of the correlation with the ground between the wheels; without such wheels there are no gaps."""

    states: int
    rows: int  # states whose rows are carried along
    head: int  # values of y before it
    active: int  # values of y before what is known of it
    size: int
    parts: int
    gain: ca.Sparsity
    gaps: tuple[GapPlace, ...]
    pattern: ca.Sparsity  # of the whole Jacobian
    functions: PortableFunctions

    @property
    def blocks(self) -> int:
        """Values of the Jacobian's blocks, one an element."""
        return sum(place.gap.elements * (place.gap.modes * place.columns * self.rows) ** 2 for place in self.gaps)

    @property
    def moving(self) -> list[int]:
        """Entries of N in the rows that are carried along."""
        return [k for k, row in enumerate(self.gain.row()) if row < self.rows]

    @property
    def operations(self) -> int:
        """Additions and multiplications of the loops, for one rate."""
        one = 2 * len(self.moving) + 6 * self.rows
        return sum(place.columns * (place.count * one + place.gap.elements * 4 * self.rows) for place in self.gaps)

    def header(self) -> Mapping[str, object]:
        """What the internal header says."""
        start = self.functions.start_parts
        largest = max((states for _, states, _ in start.copies), default=1)
        rows = self.states if start.smooth else max(largest, *(len(place.gap.known) for place in self.gaps))
        return {
            "head": self.head,
            "active": self.active,
            "rows": self.rows,
            "parts": self.parts,
            "gain": self.gain.nnz(),
            "gaps": len(self.gaps),
            "longest": max(place.count for place in self.gaps) * rows,
            "collocated": max(place.gap.modes for place in self.gaps) * rows,
        }

    def source(self, prefix: str) -> Mapping[str, object]:
        """What the loops need."""
        own, carried = self.functions.pattern, self.functions.parts_pattern
        part_rows, part_columns = carried.get_triplet()
        tables = [_prototypes(prefix)]
        for count in sorted({place.gap.modes for place in self.gaps}):
            for name, values in _element_tables(count).items():
                tables.append(array(f"static const R {name}_{count}", map(constant, values.ravel().tolist())))
        for g, place in enumerate(self.gaps):
            tables.append(array(f"static const int known_{g}", map(str, place.gap.known)))
        places = (
            f"    {{{p.first}, {p.known_first}, {len(p.gap.known)}, {p.columns}, {p.gap.elements}, {p.gap.modes}, "
            f"{int(p.joined)}, {p.entering}, known_{g}, derivative_{m}, places_{m}, from_nodes_{m}}}"
            for g, p in enumerate(self.gaps)
            for m in [p.gap.modes]
        )
        tables.append(f"const {prefix}_gap {prefix}_gaps[] = {{\n" + ",\n".join(places) + "\n};")
        gain_rows, gain_columns = self.gain.get_triplet()
        integers = {
            "gain_row": gain_rows,
            "gain_column": gain_columns,
            "moving": self.moving,
            "own_column": own.colind(),
            "part_row": part_rows,
            "part_column": part_columns,
        }
        tables += [array(f"static const int {name}", map(str, values)) for name, values in integers.items()]
        return {
            "tables": "\n".join(tables),
            "own": max(own.nnz(), 1),
            "of_parts": carried.nnz(),
            "moving": len(self.moving),
            "columns": max(place.columns for place in self.gaps),
            "most_modes": max(place.gap.modes for place in self.gaps),
        }


def _element_tables(modes: int) -> Mapping[str, npt.NDArray[np.float64]]:
    """Of an element: places of the right-Radau nodes, [e, T] of `transport_matrix`, modes from values at the nodes."""
    places = radau_nodes(modes)
    T, e = transport_matrix(modes)
    from_nodes = np.zeros((modes, modes))
    from_nodes[:] = np.linalg.inv(np.polynomial.legendre.legvander(2 * places - 1, modes - 1))
    from_nodes[-1] = np.arange(modes) == modes - 1
    return {"places": places, "derivative": np.column_stack([e, T]), "from_nodes": from_nodes}


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
    grid = functions.start_parts.delayed
    gaps = () if grid is None else tuple(_places(grid, head, functions.gain.nnz(), states))
    rows, active = (states, size) if grid is None else (grid.rows, head + grid.carried)
    parts = functions.parts_pattern.size1()
    pattern = functions.pattern if not gaps else _whole_pattern(functions, gaps, states, rows)
    return GroundTables(states, rows, head, active, size, parts, functions.gain, gaps, pattern, functions)


def _places(grid: DelayGrid, head: int, gain: int, states: int) -> Iterable[GapPlace]:
    """Where every gap is in y and among the parts."""
    first, known_first = head, head + grid.carried
    entering = gain + sum(len(track.gaps) for track in grid.tracks)
    for track in grid.tracks:
        for k, gap in enumerate(track.gaps):
            yield GapPlace(gap, first, known_first, track.noises, k > 0, entering)
            vectors = gap.elements * gap.modes * track.noises
            first, known_first = first + vectors * grid.rows, known_first + vectors * len(gap.known)
            entering += track.noises * states


def _whole_pattern(functions: PortableFunctions, gaps: tuple[GapPlace, ...], states: int, rows: int) -> ca.Sparsity:
    """Places of the whole Jacobian: the head's rows, N and the transport, and what the parts depend on."""
    size, gain = functions.pattern.size2(), functions.gain
    places = [np.array(functions.pattern.get_triplet())]
    entries = [(row, column) for row, column in zip(*gain.get_triplet(), strict=True) if row < rows]
    part_rows, part_columns = (np.array(x, dtype=int) for x in functions.parts_pattern.get_triplet())
    for g, place in enumerate(gaps):
        block = place.columns * rows
        for vector in range(place.count * place.columns):
            found = [(place.first + vector * rows + row, place.place(rows, vector, column)) for row, column in entries]
            places.append(np.array([pair for pair in found if pair[1] >= 0], dtype=int).reshape(-1, 2).T)
        derivative = _element_tables(place.gap.modes)["derivative"]
        for node in range(place.count):
            j, here = node % place.gap.modes, place.first + node * block + np.arange(block)
            before = -1 if node >= place.gap.modes or place.joined else 0
            seen = [m for m in range(before, place.gap.modes) if derivative[j, m + 1]]
            places += [np.array([here, here + (m - j) * block]) for m in seen]
        for part, column in zip(part_rows, part_columns, strict=True):
            touched = _touched(place, g, int(part), gain, states, rows)
            places.append(np.array([touched, np.full(len(touched), column)]))
    rows_found, columns_found = np.hstack(places)
    return ca.Sparsity.triplet(size, size, rows_found.tolist(), columns_found.tolist())


def _touched(place: GapPlace, g: int, part: int, gain: ca.Sparsity, states: int, rows: int) -> Integers:
    """Entries of a gap whose rate depends on one of the parts."""
    vectors = np.arange(place.count * place.columns)
    if part < gain.nnz():
        row, column = gain.row()[part], gain.get_col()[part]
        seen = [v for v in vectors if row < rows and place.place(rows, int(v), column) >= 0]
        return place.first + np.array(seen, dtype=int) * rows + row
    if part == gain.nnz() + g:
        return place.first + np.arange(len(vectors) * rows)
    q, state = divmod(part - place.entering, states)
    if 0 <= q < place.columns and state < rows:
        return place.first + q * rows + state + place.columns * rows * np.arange(place.gap.modes)
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
    widest = tables.states if start.smooth else largest
    text = []
    if copies:
        text.append(f"static const struct {{ int first, states, parts; }} copies[] = {{{', '.join(copies)}}};")
        text.append(
            f"static const struct {{ int count, distances, members[{members}]; }} tracks[] = {{\n    "
            + ",\n    ".join(tracks) + "\n};"
        )
    if gaps:
        columns = max(place.columns for place in gaps)
        text.append(
            f"enum {{ HEAD = {tables.head}, COPIES = {len(copies)}, WIDEST = {widest * columns}, LAST_PART = {place} }};"
        )
    return {
        "vehicle": nv,
        "ground": nf,
        "tracks": len(start.tracks),
        "copies": len(copies),
        "pairs": int(bool(gaps)),
        "smooth": int(start.smooth),
        "most": max(1, largest**2),
        "parts": max(functions.start.size1_out(0), 1),
        "tables": "\n".join(text),
        "profile": rows(profile),
    }
