"""Make loops of straight code: operations that differ in nothing but where their operands are go over tables of places.

Each operation is the very one that it was, so that the bits are the same. Two are alike if they are of a kind, as are, all the
way down, the operations that made their operands; so none of them waits for another. Loops of one length whose passes take only
what the same pass has made are one loop. Long sums are loops, too, from the first term to the last.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from cadet_sym.export.steps import Step

__all__ = ["SUM", "Block", "Loops", "is_constant", "needed", "rolled", "straight"]

FEWEST = 12
"""Passes of a loop, and terms of a sum."""

LOOKED_AT = 60
"""Blocks before, of which one may take more operations."""

LONGEST = 300
"""Operations of a block without a loop."""

COMMON = 1 / 16
"""The part of all constants from which on one is the same for a whole loop, not another one in every pass."""

SUM = "SUM"
"""The kind of a step that adds others to its first operand, one after the other."""


@dataclass
class Block:
    """Operations one after the other, or those of a loop."""

    count: int  # passes of a loop; 1 for what is none
    units: list[int] = field(default_factory=list)
    sums: list[int] = field(default_factory=list)  # units that add up while the loop runs


@dataclass(frozen=True)
class Loops:
    """Steps; those that are alike as units, one step a pass; the blocks that units make, in order."""

    steps: Sequence[Step]
    units: Sequence[Sequence[int]]
    blocks: Sequence[Block]
    unit_of: Sequence[int]  # by step
    block_of: Mapping[int, int]  # by unit


def straight(steps: Sequence[Step]) -> Loops:
    """Steps one after the other, as they are."""
    every = range(len(steps))
    blocks = [Block(1, list(every[k : k + LONGEST])) for k in every[::LONGEST]]
    return Loops(steps, [[k] for k in every], blocks, every, {u: u // LONGEST for u in every})


def rolled(steps: Sequence[Step]) -> Loops:
    """Arrange steps in loops where many are alike, if that makes half of them or fewer."""
    found, shapes = _shaped(steps)
    units, unit_of = _alike(found, shapes)
    if len(units) > len(steps) / 2:
        return straight(steps)
    blocks, block_of = _fused(found, units, unit_of)
    return Loops(found, units, blocks, unit_of, block_of)


def needed(step: Step) -> Iterator[int]:
    """The steps that one needs."""
    yield from (operand for operand in step.operands if isinstance(operand, int))
    if step.kind == "RESULT" and step.entry is not None:
        yield step.entry.vector


# -- shapes, and sums ------------------------------------------------------------------------------------------------


def _shaped(steps: Sequence[Step]) -> tuple[list[Step], list[int]]:
    """The steps with long chains of additions as sums, and a number for each that is the same for those that are alike."""
    chains, common = _chains(steps), _common(steps)
    gone = {k for chain in chains.values() for k in chain[:-1]}
    known: dict[object, int] = {}
    place: dict[int, int] = {}
    found: list[Step] = []
    shapes: list[int] = []
    depths: list[int] = []

    def add(step: Step) -> int:
        depth = 1 + max((depths[k] for k in needed(step)), default=0)
        alone = step.kind in ("CALL", "RESULT", SUM)
        kinds = (depth,) if alone else tuple(shapes[x] if isinstance(x, int) else _kind(x, common) for x in step.operands)
        shapes.append(known.setdefault((step.kind.partition("[")[0], alone, *kinds), len(known)))
        depths.append(depth)
        found.append(step)
        return len(found) - 1

    for k, step in enumerate(steps):
        if k in gone:
            continue
        if k in chains:
            first, *terms = (place[x] if isinstance(x, int) else x for x in _terms(steps, chains[k]))
            for run in _runs(terms, shapes):
                many = len(run) >= FEWEST
                for part in [run] if many else [[x] for x in run]:
                    first = add(Step(SUM if many else "ADD", (first, *part)))
            assert isinstance(first, int)
            place[k] = first
            continue
        entry = step.entry
        if step.kind == "RESULT" and entry is not None:
            entry = entry._replace(vector=place[entry.vector])
        moved = tuple(place[x] if isinstance(x, int) else x for x in step.operands)
        place[k] = add(Step(step.kind, moved, entry, step.called))
    return found, shapes


def _kind(text: str, common: set[str]) -> str:
    """Of what is not made by a step: the vector it is an entry of, a constant, or itself."""
    if is_constant(text):
        return text if text in common else "constant"
    return text.partition("[")[0]


def is_constant(text: str) -> bool:
    """Whether an operand is a number, not an entry of a vector or an argument passed by value."""
    return "(" in text


def _common(steps: Sequence[Step]) -> set[str]:
    """Constants that are met often."""
    counts = Counter(x for step in steps for x in step.operands if isinstance(x, str) and is_constant(x))
    return {x for x, count in counts.items() if count >= COMMON * counts.total()}


def _chains(steps: Sequence[Step]) -> dict[int, list[int]]:
    """Additions each of which adds to the one before, which nothing else needs; by the last of them."""
    uses = Counter(k for step in steps for k in needed(step))
    chains: dict[int, list[int]] = {}
    for k, step in enumerate(steps):
        if step.kind == "ADD":
            before = [i for i in step.operands if isinstance(i, int) and i in chains and uses[i] == 1]
            longest = max(before, key=lambda i: len(chains[i]), default=None)
            chains[k] = [] if longest is None else chains.pop(longest)
            chains[k].append(k)
    return {k: chain for k, chain in chains.items() if len(chain) >= FEWEST}


def _terms(steps: Sequence[Step], chain: Sequence[int]) -> Iterator[str | int]:
    yield from steps[chain[0]].operands
    for before, k in pairwise(chain):
        first, second = steps[k].operands
        yield second if first == before else first


def _runs(terms: Sequence[str | int], shapes: Sequence[int]) -> Iterator[list[str | int]]:
    """Terms of one shape that follow each other."""
    run: list[str | int] = []
    for term in terms:
        if run and (isinstance(term, str) or isinstance(run[-1], str) or shapes[term] != shapes[run[-1]]):
            yield run
            run = []
        run.append(term)
    yield run


# -- units and blocks ------------------------------------------------------------------------------------------------


def _alike(steps: Sequence[Step], shapes: Sequence[int]) -> tuple[list[list[int]], list[int]]:
    """Steps that are alike, in an order in which each pass takes, where it can, what the same pass of another loop made."""
    members: dict[int, list[int]] = defaultdict(list)
    for k, shape in enumerate(shapes):
        members[shape].append(k)
    units: list[list[int]] = []
    unit_of = [-1] * len(steps)
    lane: dict[int, int] = {}
    for own in members.values():  # in the order of their first steps: what they need is there
        alone = len(own) < FEWEST or steps[own[0]].kind in ("CALL", "RESULT", SUM)
        for unit in [[k] for k in own] if alone else [_in_step(own, steps, units, unit_of, lane)]:
            for place, k in enumerate(unit):
                unit_of[k], lane[k] = len(units), place
            units.append(unit)
    return units, unit_of


def _in_step(
    own: list[int], steps: Sequence[Step], units: Sequence[Sequence[int]], unit_of: Sequence[int], lane: Mapping[int, int]
) -> list[int]:
    for operands in zip(*(steps[k].operands for k in own), strict=True):
        made = {unit_of[x] if isinstance(x, int) else -1 for x in operands}
        if len(made) == 1 and -1 not in made and len(units[made.pop()]) == len(set(operands)) == len(own):
            return [k for _, k in sorted((lane[x], k) for x, k in zip(operands, own, strict=True) if isinstance(x, int))]
    return own


def _fused(
    steps: Sequence[Step], units: Sequence[Sequence[int]], unit_of: Sequence[int]
) -> tuple[list[Block], dict[int, int]]:
    """Blocks in an order in which each has what it needs: every unit in the latest block that can take it, or a new one."""
    blocks: list[Block] = []
    block_of: dict[int, int] = {}
    loops = Loops(steps, units, blocks, unit_of, block_of)
    for u in _ordered(steps, units, unit_of):
        unit = units[u]
        count, step = len(unit), steps[unit[0]]
        if step.kind == SUM and (place := _while_it_runs(step, loops)) is not None:
            block_of[u] = place
            blocks[place].sums.append(u)
            continue
        block_of[u] = chosen = _block(u, loops)
        if chosen == len(blocks):
            blocks.append(Block(count))
        blocks[chosen].units.append(u)
    return blocks, block_of


def _while_it_runs(step: Step, loops: Loops) -> int | None:
    """The loop that makes all terms of a sum one by one, if the first is there before."""
    first, *terms = step.operands
    if not isinstance(terms[0], int) or terms != list(loops.units[unit := loops.unit_of[terms[0]]]):
        return None
    block = loops.block_of[unit]
    return block if not isinstance(first, int) or loops.block_of[loops.unit_of[first]] < block else None


def _block(u: int, loops: Loops) -> int:
    """The latest block that can take a unit; their number if there is none."""
    unit, blocks = loops.units[u], loops.blocks
    count = len(unit)
    earliest, apart = 0, 0  # from there on what it needs is there; the same but for what may be in the same block
    for operands in zip(*(loops.steps[k].operands for k in unit), strict=True):
        for made in {loops.unit_of[x] for x in operands if isinstance(x, int)}:
            there = loops.block_of[made]
            earliest = max(earliest, there)
            before = blocks[there].count == 1 if count == 1 else list(operands) == list(loops.units[made])
            if not before:
                apart = max(apart, there + 1)
    for k in unit:
        step = loops.steps[k]
        if step.kind == "RESULT" and step.entry is not None:
            apart = max(apart, loops.block_of[loops.unit_of[step.entry.vector]])
    for b in range(len(blocks) - 1, max(earliest, apart, len(blocks) - LOOKED_AT) - 1, -1):
        if blocks[b].count == count and (count > 1 or len(blocks[b].units) < LONGEST):
            return b
    return len(blocks)


def _ordered(steps: Sequence[Step], units: Sequence[Sequence[int]], unit_of: Sequence[int]) -> Iterator[int]:
    """Units, each after those that it needs, and not long after."""
    needs = [list(dict.fromkeys(unit_of[x] for k in unit for x in needed(steps[k]))) for unit in units]
    seen: set[int] = set()
    results = [u for u, unit in enumerate(units) if "[" in steps[unit[0]].kind]
    waiting = [(u, False) for u in reversed(results)]
    while waiting:
        u, ready = waiting.pop()
        if ready:
            yield u
        elif u not in seen:
            seen.add(u)
            waiting.append((u, True))
            waiting += [(each, False) for each in reversed(needs[u]) if each not in seen]
