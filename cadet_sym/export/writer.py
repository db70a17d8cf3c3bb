"""Write steps and loops of them as the lines of C functions, with an array for what does not stay where it is made."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import casadi as ca

from cadet_sym.errors import ExportError
from cadet_sym.export.functions import Calls, Program, call, sizes_of
from cadet_sym.export.rolled import SUM, Block, Loops, is_constant
from cadet_sym.export.steps import OPERATIONS, Step
from cadet_sym.export.tables import Tables

__all__ = ["Writer"]

Operands = Sequence[str | int]


class Writer:
    """Writes blocks in pieces of a length, each the body of a function that is given the array `w`."""

    def __init__(self, loops: Loops, length: int, tables: Tables, calls: Calls | None) -> None:
        self.loops, self.tables, self.calls = loops, tables, calls
        self.steps, self.units, self.unit_of = loops.steps, loops.units, loops.unit_of
        self.lane = {k: lane for unit in self.units for lane, k in enumerate(unit)}
        self.piece_of = _pieces(loops.blocks, length)
        self.called: list[Program] = []  # one for every call
        self.stored: set[int] = set()  # units that have a place in w
        self.last: dict[int, int] = {}  # block that needs a unit, or results of a call, last
        self.passed: set[int] = set()  # units that another of their loop takes pass by pass
        for b, block in enumerate(loops.blocks):
            for u in (*block.units, *block.sums):
                self._needs(u, b)
        self.place: dict[int, int] = {}  # by unit
        self.room = _Room()

    def pieces(self) -> tuple[list[list[str]], int]:
        """The lines of all pieces, and how long w is."""
        found: list[list[str]] = [[] for _ in range(max(self.piece_of, default=0) + 1)]
        ends: dict[int, list[tuple[int, int]]] = defaultdict(list)  # places that are free after a block
        for b, block in enumerate(self.loops.blocks):
            for u in (*block.units, *block.sums):
                size = self._size(u)
                if size:
                    self.place[u] = self.room.taken(size)
                    ends[self.last.get(u, b)].append((self.place[u], size))
            self.beside: list[tuple[int, int]] = []  # arguments of calls
            lines = self._loop(block, b) if block.count > 1 else self._straight(block, b)
            found[self.piece_of[b]] += [f"    {line}" for line in lines]
            for place, size in (*ends.pop(b, ()), *self.beside):
                self.room.free(place, size)
        return found, self.room.size

    # -- what is needed where -----------------------------------------------------------------------------------

    def _size(self, u: int) -> int:
        """Numbers in w."""
        step = self.steps[self.units[u][0]]
        if step.called is not None:
            return sum(map(step.called.nnz_out, range(step.called.n_out())))
        return len(self.units[u]) if u in self.stored else 0

    def _needs(self, u: int, b: int) -> None:
        unit = self.units[u]
        step, alone = self.steps[unit[0]], len(unit) == 1
        if u in self.loops.blocks[b].sums:
            self.passed.add(self.unit_of[_number(step.operands[1])])
            self._need(step.operands[:1], b, gathered=False)
        elif alone:
            self._need(step.operands, b, gathered=False)
        else:
            for operands in self._columns(unit):
                if (made := self._in_pass(operands, b)) is not None:
                    self.passed.add(made)
                else:
                    self._need(set(operands), b, gathered=len(set(operands)) > 1)

    def _need(self, operands: Iterable[str | int], b: int, *, gathered: bool) -> None:
        for x in operands:
            if not isinstance(x, int):
                continue
            u, entry = self.unit_of[x], self.steps[x].entry
            if entry is not None:
                u = self.unit_of[entry.vector]
            elif len(self.units[u]) > 1 or gathered or self.piece_of[self.loops.block_of[u]] != self.piece_of[b]:
                self.stored.add(u)
            self.last[u] = max(b, self.last.get(u, b))

    def _columns(self, unit: Sequence[int]) -> Iterator[Operands]:
        """The first operands of all steps of a unit, then the second ones."""
        yield from zip(*(self.steps[k].operands for k in unit), strict=True)

    def _in_pass(self, operands: Operands, b: int) -> int | None:
        """The unit of the same loop that makes these, pass by pass."""
        if isinstance(operands[0], int):
            made = self.unit_of[operands[0]]
            if self.loops.block_of[made] == b and list(operands) == list(self.units[made]):
                return made
        return None

    # -- loops --------------------------------------------------------------------------------------------------

    def _loop(self, block: Block, b: int) -> Iterator[str]:
        sums = [self.units[u][0] for u in block.sums]
        for k in sums:
            yield f"R a{k} = {self._value(self.steps[k].operands[0], b)};"
        yield f"for (int k = 0; k < {block.count}; k++) {{"
        for u in block.units:
            yield from (f"    {line}" for line in self._pass(u, b))
        for k in sums:
            yield f"    a{k} += a{self._made(self.steps[k].operands[1])};"
        yield "}"
        yield from (f"w[{self.place[u]}] = a{self.units[u][0]};" for u in block.sums if u in self.place)

    def _pass(self, u: int, b: int) -> Iterator[str]:
        unit = self.units[u]
        step = self.steps[unit[0]]
        operands = [self._over(column, b) for column in self._columns(unit)]
        if step.kind not in OPERATIONS:
            yield f"{self._entry([self.steps[k].kind for k in unit])} = {operands[0]};"
            return
        value = OPERATIONS[step.kind][1].format(*operands)
        stored = f"w[{_index(range(self.place[u], self.place[u] + len(unit)), self.tables)}]" if u in self.place else ""
        if u in self.passed:
            yield f"const R a{unit[0]} = {value};"
            value = f"a{unit[0]}"
        if stored:
            yield f"{stored} = {value};"

    def _made(self, operand: str | int) -> int:
        """The step by which what a loop makes is named in it."""
        return self.units[self.unit_of[_number(operand)]][0]

    def _over(self, operands: Operands, b: int) -> str:
        """What a pass takes."""
        if (made := self._in_pass(operands, b)) is not None:
            return f"a{self.units[made][0]}"
        if len(set(operands)) == 1:
            return self._value(operands[0], b)
        texts = [x for x in operands if isinstance(x, str)]
        if not texts:
            return f"w[{_index([self._place(_number(x)) for x in operands], self.tables)}]"
        return self._entry(texts) if "[" in texts[0] else f"{self.tables.add('R', texts)}[k]"

    def _entry(self, texts: Sequence[str]) -> str:
        """An entry of a vector, another one in every pass."""
        vector, _, _ = texts[0].partition("[")
        return f"{vector}[{_index([int(text[len(vector) + 1 : -1]) for text in texts], self.tables)}]"

    # -- one after the other ------------------------------------------------------------------------------------

    def _straight(self, block: Block, b: int) -> Iterator[str]:
        for u in block.units:
            (k,) = self.units[u]
            step = self.steps[k]
            if step.called is not None:
                yield from self._call(u, step.called, step.operands, b)
            elif step.kind == SUM:
                yield from self._sum(k, step, b)
            elif step.kind == "RESULT":
                continue
            elif step.kind not in OPERATIONS:
                yield f"{step.kind} = {self._value(step.operands[0], b)};"
            else:
                operands = [self._value(operand, b) for operand in step.operands]
                yield f"const R a{k} = {OPERATIONS[step.kind][1].format(*operands)};"
            if u in self.stored:
                yield f"w[{self.place[u]}] = a{k};"

    def _sum(self, k: int, step: Step, b: int) -> Iterator[str]:
        first, *terms = step.operands
        yield f"R a{k} = {self._value(first, b)};"
        places = [self._place(x) if isinstance(x, int) and self._is_there(x) else -1 for x in terms]
        if -1 in places:
            yield from (f"a{k} += {self._value(x, b)};" for x in terms)
        else:
            yield f"for (int k = 0; k < {len(terms)}; k++)"
            yield f"    a{k} += w[{_index(places, self.tables)}];"

    def _call(self, u: int, function: ca.Function, operands: Operands, b: int) -> Iterator[str]:
        if self.calls is None:
            raise ExportError(f"`{function.name()}` is called, and there is no place for it")
        called, pointers, first = self.calls.of(function), [], 0
        self.called.append(called)
        sizes, n_in, place = sizes_of(function), function.n_in(), self.place.get(u, 0)
        for size in sizes[:n_in]:
            own = operands[first : first + size]
            first += size
            pointer = self._vector(own)
            if pointer is None:
                beside = self.room.taken(size)
                self.beside.append((beside, size))
                pointer = f"w + {beside}"
                yield from (f"w[{beside + j}] = {self._value(x, b)};" for j, x in enumerate(own))
            pointers.append(pointer)
        for size in sizes[n_in:]:
            pointers.append(f"w + {place}")
            place += size
        yield call(called, function, pointers)

    def _vector(self, operands: Operands) -> str | None:
        """A pointer to these numbers if they stand one after the other somewhere."""
        if not operands:
            return ""
        if all(isinstance(x, int) and self._is_there(x) for x in operands):
            vector, places = "w", [self._place(_number(x)) for x in operands]
        elif all(isinstance(x, str) and "[" in x for x in operands):
            names = {str(x).partition("[")[0] for x in operands}
            vector, places = names.pop(), [int(str(x).partition("[")[2][:-1]) for x in operands]
            if names:
                return None
        elif all(isinstance(x, str) and is_constant(x) for x in operands):
            return self.tables.add("R", map(str, operands))
        else:
            return None
        return f"{vector} + {places[0]}" if all(j - i == 1 for i, j in pairwise(places)) else None

    # -- where numbers are --------------------------------------------------------------------------------------

    def _is_there(self, k: int) -> bool:
        """Whether it has a place in w."""
        return self.steps[k].entry is not None or self.unit_of[k] in self.place

    def _place(self, k: int) -> int:
        entry = self.steps[k].entry
        if entry is not None:
            return self.place[self.unit_of[entry.vector]] + entry.index
        u = self.unit_of[k]
        return self.place[u] + self.lane[k]

    def _value(self, operand: str | int, b: int) -> str:
        if isinstance(operand, str):
            return operand
        u = self.unit_of[operand]
        here = self.steps[operand].entry is None and len(self.units[u]) == 1
        if here and self.piece_of[self.loops.block_of[u]] == self.piece_of[b]:
            return f"a{operand}"
        return f"w[{self._place(operand)}]"


def _number(operand: str | int) -> int:
    assert isinstance(operand, int)
    return operand


def _pieces(blocks: Sequence[Block], length: int) -> list[int]:
    """The piece of every block."""
    found, lines = [], 0
    for block in blocks:
        own = len(block.units) + (2 * len(block.sums) + 2 if block.count > 1 else 0)
        first = not found
        piece = 0 if first else found[-1]
        if not first and lines + own > length:
            piece, lines = piece + 1, 0
        found.append(piece)
        lines += own
    return found


def _index(places: Sequence[int], tables: Tables) -> str:
    """Text of a number that is another one for every k."""
    first, step = places[0], places[1] - places[0]
    if any(j - i != step for i, j in pairwise(places)) or step < 0:
        return f"{tables.add('int', map(str, places))}[k]"
    if not step:
        return str(first)
    text = "k" if step == 1 else f"{step} * k"
    return f"{first} + {text}" if first else text


class _Room:
    """Parts of an array that are taken and free again."""

    def __init__(self) -> None:
        self.size = 0
        self.gaps: list[tuple[int, int]] = []  # places and sizes, in order

    def taken(self, size: int) -> int:
        """The place of so many numbers."""
        for k, (place, there) in enumerate(self.gaps):
            if there >= size:
                self.gaps[k : k + 1] = [(place + size, there - size)] if there > size else []
                return place
        if self.gaps and sum(self.gaps[-1]) == self.size:  # the last gap is where the array ends
            place, _ = self.gaps.pop()
        else:
            place = self.size
        self.size = place + size
        return place

    def free(self, place: int, size: int) -> None:
        """Give a part back."""
        if not size:
            return
        gaps: list[tuple[int, int]] = []
        for each in sorted([*self.gaps, (place, size)]):
            if gaps and sum(gaps[-1]) == each[0]:
                gaps[-1] = gaps[-1][0], gaps[-1][1] + each[1]
            else:
                gaps.append(each)
        self.gaps = gaps
