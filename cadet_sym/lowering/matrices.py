"""Take a CasADi function of matrices apart into its instructions, for those who write it in another language.

What an instruction makes has a place of its own in a work array, or is a part of what is there already. Nothing is
unrolled: what is the same for many entries or columns is left to loops of that language.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cache
from typing import ClassVar

import casadi as ca

from cadet_sym.lowering.operations import kinds as names

__all__ = ["Matrices", "of_entries"]


@cache
def of_entries(operation: int, operands: int) -> ca.Function:
    """An operation on numbers as a function."""
    x = [ca.SX.sym(f"x{k}") for k in range(operands)]
    return ca.Function("entries", x, [ca.SX.binary(operation, *x) if operands == 2 else ca.SX.unary(operation, *x)])


class Matrices(ABC):
    """Goes through the instructions one after the other; a language adds how each of them is written.

    Places are text: a pointer of that language.
    """

    language: ClassVar[str]

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.lines: list[str] = []
        self.used = 0
        self.at: dict[int, str] = {}  # what CasADi has in a register: a pointer ...
        self.size: dict[int, int] = {}  # ... to so many numbers,
        self.tiled: dict[int, tuple[str, int]] = {}  # or one to fewer that are there again and again
        self.summed: set[int] = set()  # or one to the sum of what CasADi has there
        self.sums = _sums(function, self.can_sum)
        self.written = [0] * function.n_out()

    def walk(self) -> None:
        """Write all of them.

        Raises
        ------
        ValueError
            If there is one that is not known here.
        """
        for k in range(self.function.n_instructions()):
            operation = self.function.instruction_id(k)
            kind = names()[operation]
            read, into = self.function.instruction_input(k), self.function.instruction_output(k)
            if kind == "OUTPUT":
                self._output(read[0], into[0])
                continue
            node = self.function.instruction_MX(k)
            write = getattr(self, f"_of_{kind.lower()}", None)
            if kind == "CALL":
                self._call(k, node.which_function(), read, into)
            elif write is not None:
                write(node, read, into)
            else:
                self._entries(kind, operation, node, read, into)

    # -- what a language adds -----------------------------------------------------------------------------------

    @abstractmethod
    def can_sum(self, function: ca.Function) -> bool:
        """Whether results of a function can be summed over columns while it is called for them."""

    @abstractmethod
    def pointer(self, pointer: str, first: int) -> str:
        """One so many numbers further on."""

    @abstractmethod
    def numbers(self, values: Sequence[float]) -> str:
        """A pointer to constants."""

    @abstractmethod
    def copy(self, there: str, x: str, size: int) -> None:
        """So many numbers."""

    @abstractmethod
    def tile(self, count: int, there: str, x: str, size: int) -> None:
        """The same numbers so many times."""

    @abstractmethod
    def pick(self, which: Sequence[int], there: str, x: str) -> None:
        """Some of the numbers."""

    @abstractmethod
    def put(self, which: Sequence[int], there: str, x: str, *, adds: bool) -> None:
        """Numbers to other places among those that are there, or added to what is in these."""

    @abstractmethod
    def add_up(self, count: int, there: str, x: str, size: int) -> None:
        """The sum of so many times `size` numbers, in this order."""

    @abstractmethod
    def multiply(self, shape: tuple[int, int, int], there: str, x: str, y: str) -> None:
        """Add x y to what is there: (rows, n) by (n, columns) is (rows, n, columns)."""

    @abstractmethod
    def call(self, function: ca.Function, given: Sequence[str], results: Sequence[str]) -> None:
        """Call a function."""

    @abstractmethod
    def call_over(
        self, function: ca.Function, count: int, shared: Sequence[bool], summed: Sequence[bool], given: Sequence[str],
        results: Sequence[str],
    ) -> None:
        """Call a function for so many columns of what is not shared; of what is summed only the sum is written."""

    @abstractmethod
    def operate(self, operation: int, count: int, shared: Sequence[bool], given: Sequence[str], there: str) -> None:
        """One of CasADi's operations on so many numbers; what is shared is one number."""

    # -- instructions -------------------------------------------------------------------------------------------

    def _of_input(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._part(into[0], f"i{read[0]}", node.info()["offset"], node.nnz())

    def _output(self, of: int, result: int) -> None:
        self.copy(self._further(f"o{result}", self.written[result]), self._whole(of), self.size[of])
        self.written[result] += self.size[of]

    def _of_const(self, node: ca.MX, _: list[int], into: list[int]) -> None:
        values = node.to_DM().nonzeros()
        self._part(into[0], self.numbers(values) if values else "", 0, len(values))

    def _call(self, k: int, called: ca.Function, read: list[int], into: list[int]) -> None:
        if called.class_name() != "Map":
            results = [self._new(to, called.nnz_out(j)) for j, to in enumerate(into)]
            self.call(called, [self._whole(i) for i in read], results)
            return
        each, count = called.info()["f"], called.info()["n"]
        summed = self.sums.get(k, [False] * len(into))
        # what is the same in every column need not be there for each
        shared = [i in self.tiled and self.tiled[i][1] == each.nnz_in(j) for j, i in enumerate(read)]
        given = [self.tiled[i][0] if same else self._whole(i) for i, same in zip(read, shared, strict=True)]
        sizes = [each.nnz_out(j) * (1 if total else count) for j, total in enumerate(summed)]
        results = [self._new(to, size) for to, size in zip(into, sizes, strict=True)]
        self.summed.update(to for to, total in zip(into, summed, strict=True) if total)
        self.call_over(each, count, shared, summed, given, results)

    def _of_horzsplit(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        parts, first = node.info()["output"], 0
        for j, to in enumerate(into):
            self._part(to, self._whole(read[0]), first, parts.nnz_out(j))
            first += parts.nnz_out(j)

    def _of_vertsplit(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._only(node.dep(0).is_column(), "a matrix is split into rows")
        self._of_horzsplit(node, read, into)

    def _of_horzcat(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        parts, first = [(self._whole(i), self.size[i]) for i in read], 0
        there = self._new(into[0], node.nnz())
        for pointer, size in parts:
            self.copy(self._further(there, first), pointer, size)
            first += size

    def _of_vertcat(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._only(node.is_column(), "matrices are put below each other")
        self._of_horzcat(node, read, into)

    def _of_horzrepmat(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        x, n = self._whole(read[0]), self.size[read[0]]
        self._part(into[0], "", 0, node.nnz())
        self.tiled[into[0]] = x, n

    def _of_horzrepsum(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        x, count, n = self._whole(read[0]), self.size[read[0]], node.nnz()
        if read[0] in self.summed:
            self._part(into[0], x, 0, n)
            return
        self.add_up(count // n, self._new(into[0], n), x, n)

    def _of_mtimes(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        (rows, columns), n = node.shape, node.dep(1).shape[1]
        self._only(all(each.is_dense() for each in (node, node.dep(1), node.dep(2))), "sparse matrices are multiplied")
        before, x, y = (self._whole(i) for i in read)
        there = self._new(into[0], node.nnz())
        self.copy(there, before, node.nnz())
        self.multiply((rows, n, columns), there, x, y)

    def _of_reshape(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._part(into[0], self._whole(read[0]), 0, node.nnz())

    _of_sparsity_cast = _of_reshape

    def _of_transpose(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        rows, columns = node.shape
        self._only(node.is_dense(), "a sparse matrix is transposed")
        self._picked(self._whole(read[0]), into[0], [i * columns + j for j in range(columns) for i in range(rows)])

    def _of_getnonzeros(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        self._picked(self._whole(read[0]), into[0], [int(i) for i in node.mapping().nonzeros()])

    def _of_setnonzeros(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        before, x = (self._whole(i) for i in read)
        there = self._new(into[0], node.nnz())
        self.copy(there, before, node.nnz())
        self.put([int(i) for i in node.mapping().nonzeros()], there, x, adds=node.info()["add"])

    _of_addnonzeros = _of_setnonzeros

    def _of_project(self, node: ca.MX, read: list[int], into: list[int]) -> None:
        """Entries that stay, and zeros."""
        dep, x = node.dep(0), self._whole(read[0])
        places = {place: k for k, place in enumerate(zip(*dep.sparsity().get_triplet(), strict=True))}
        which = [places.get(place, dep.nnz()) for place in zip(*node.sparsity().get_triplet(), strict=True)]
        if dep.nnz() in which:
            beside = self._new(-1, dep.nnz() + 1)
            self.copy(beside, x, dep.nnz())
            self.copy(self._further(beside, dep.nnz()), self.numbers([0.0]), 1)
            x = beside
        self._picked(x, into[0], which)

    def _entries(self, kind: str, operation: int, node: ca.MX, read: list[int], into: list[int]) -> None:
        """An operation on every entry; one number takes part in all."""
        count = node.nnz()
        sizes = [self.size[i] for i in read]
        self._only(all(size in (1, count) for size in sizes), f"matrices of other sparsity meet in `{kind.lower()}`")
        given = [self._whole(i) for i in read]
        self.operate(operation, count, [size != count for size in sizes], given, self._new(into[0], count))

    # -- memory -------------------------------------------------------------------------------------------------

    def _new(self, register: int, size: int) -> str:
        """A place of its own; of what is not used the register is negative."""
        there = self._further("w", self.used)
        self.used += size
        self._part(register, there, 0, size)
        return there

    def _part(self, register: int, pointer: str, first: int, size: int) -> None:
        if register >= 0:
            self.at[register], self.size[register] = self._further(pointer, first), size
            self.tiled.pop(register, None)
            self.summed.discard(register)

    def _whole(self, register: int) -> str:
        """Where its numbers are, all of them."""
        if register in self.tiled:
            (x, n), size = self.tiled[register], self.size[register]
            self.tile(size // max(n, 1), self._new(register, size), x, n)
        return self.at[register]

    def _further(self, pointer: str, first: int) -> str:
        return self.pointer(pointer, first) if first else pointer

    def _picked(self, x: str, register: int, which: Sequence[int]) -> None:
        first = which[0] if which else 0
        if list(which) == list(range(first, first + len(which))):
            self._part(register, x, first, len(which))
        else:
            self.pick(which, self._new(register, len(which)), x)

    def _only(self, fine: bool, otherwise: str) -> None:
        if not fine:
            raise ValueError(f"{otherwise} in `{self.function.name()}`, which has no {self.language}")


def _sums(function: ca.Function, can_sum: Callable[[ca.Function], bool]) -> dict[int, list[bool]]:
    """Of calls for many columns, which results are summed over these and not used otherwise."""
    kind = [names()[function.instruction_id(k)] for k in range(function.n_instructions())]
    holds: dict[int, tuple[int, int]] = {}  # by register: the call and which of its results
    users: dict[tuple[int, int], list[int]] = {}
    for k, name in enumerate(kind):
        for i in function.instruction_input(k) if name != "INPUT" else ():
            if i in holds:
                users[holds[i]].append(k)
        for j, to in enumerate(function.instruction_output(k) if name != "OUTPUT" else ()):
            holds.pop(to, None)
            if name == "CALL":
                holds[to] = k, j
                users[k, j] = []
    found = {}
    for k in {k for k, _ in users}:
        called = function.instruction_MX(k).which_function()
        if called.class_name() == "Map" and can_sum(each := called.info()["f"]):
            found[k] = []
            for j in range(each.n_out()):
                summed = [kind[i] == "HORZREPSUM" and function.instruction_MX(i).nnz() == each.nnz_out(j) for i in users[k, j]]
                found[k].append(summed == [True])
    return found
