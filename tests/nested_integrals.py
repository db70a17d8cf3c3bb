"""Gaussian expectations of functions written as text, by nested integration that shares nothing with what it judges.

The text is evaluated by Python itself over arrays. Lines are cut where arguments pass a ladder of sizes, and where anything
that switches changes its sign on them; what is left of kinks on the outer lines is found by halving.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import erf

Function = Callable[..., np.ndarray]

REACH = 13.0
LADDER = 0.08 * 2.5 ** np.arange(18)
LADDER = np.concatenate([-LADDER[::-1], [0.0], LADDER])  # sizes of the arguments at which lines are cut
BESIDE = np.array([0, 1e-9, 1e-6, 1e-4, 0.01, 0.1, 0.25, 0.4])
BESIDE = np.concatenate([BESIDE, [0.5], 1 - BESIDE[::-1]])  # where a switch is looked at between two cuts
BISECTIONS = 52
NODES = 24
BATCH = 20_000


def _erf(z: np.ndarray) -> np.ndarray:
    return erf(np.asarray(z, float))


WORDS: dict[str, Any] = {
    "abs": np.abs, "sign": np.sign, "sqrt": np.sqrt, "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos, "tan": np.tan,
    "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2, "sinh": np.sinh, "cosh": np.cosh,
    "tanh": np.tanh, "erf": _erf, "min": lambda *z: reduce(np.minimum, z), "max": lambda *z: reduce(np.maximum, z), "pi": np.pi,
    "clip": lambda z, low, high: np.minimum(np.maximum(z, low), high), "heaviside": lambda z: (1 + np.sign(z)) / 2,
    "where": np.where,
}  # fmt: skip


class _Arrays(ast.NodeTransformer):
    """Writes conditionals for arrays, and collects what changes its sign where the function switches."""

    def __init__(self) -> None:
        self.switches: list[str] = []

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        return ast.Call(ast.Name("where"), [self.visit(each) for each in (node.test, node.body, node.orelse)], [])

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        sides = [self.visit(each) for each in (node.left, *node.comparators)]
        for a, b in pairwise(sides):
            self._difference(a, b)
        parts = [ast.Compare(a, [op], [b]) for (a, b), op in zip(pairwise(sides), node.ops, strict=True)]
        return reduce(lambda a, b: ast.BinOp(a, ast.BitAnd(), b), parts[1:], parts[0])

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        op = ast.BitAnd() if isinstance(node.op, ast.And) else ast.BitOr()
        first, *rest = (self.visit(each) for each in node.values)
        return reduce(lambda a, b: ast.BinOp(a, op, b), rest, first)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        name, arguments = node.func.id, [self.visit(each) for each in node.args]
        if name in ("abs", "sign", "heaviside", "sqrt", "log"):
            self.switches.append(ast.unparse(arguments[0]))
        for i in range(1, len(arguments) if name in ("min", "max", "clip") else 0):
            for j in range(i if name != "clip" else 1):
                self._difference(arguments[i], arguments[j])
        if name in ("asin", "acos"):
            self.switches += [f"1 - ({ast.unparse(arguments[0])})**2"]
        return ast.Call(node.func, arguments, [])

    def _difference(self, a: ast.expr, b: ast.expr) -> None:
        self.switches.append(ast.unparse(ast.BinOp(a, ast.Sub(), b)))


def function_of(
    text: str,
    names: Sequence[str],
    numbers: Mapping[str, float],
    curves: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None,
) -> tuple[Function, list[Function]]:
    """The function, and the functions at whose zeros it switches; curves are linear, and go on beyond their last points."""
    words = {**WORDS, **numbers}
    writer = _Arrays()
    body = writer.visit(ast.parse(text, mode="eval").body)
    for name, (z, f) in (curves or {}).items():
        words[name] = lambda x, z=z, f=f: _read(x, z, f)
        for call in (each for each in ast.walk(body) if isinstance(each, ast.Call) and each.func.id == name):
            writer.switches += [f"{ast.unparse(call.args[0])} - {knot}" for knot in z[1:-1]]

    def made(source: str) -> Function:
        code = compile(source, "text", "eval")

        def function(*z: np.ndarray) -> np.ndarray:
            with np.errstate(all="ignore"):
                value = eval(code, {"__builtins__": {}, **words, **dict(zip(names, z, strict=True))})
            return np.broadcast_to(np.asarray(value, np.result_type(float, *z)), np.broadcast(*z).shape)

        return function

    moving = (s for s in dict.fromkeys(writer.switches) if any(re.search(rf"\b{name}\b", s) for name in names))
    return made(ast.unparse(ast.fix_missing_locations(ast.Expression(body)))), [made(s) for s in moving]


def _read(x: np.ndarray, z: np.ndarray, f: np.ndarray) -> np.ndarray:
    i = np.clip(np.searchsorted(z, x) - 1, 0, len(z) - 2)
    return f[i] + (f[i + 1] - f[i]) / (z[i + 1] - z[i]) * (x - z[i])


@dataclass(frozen=True)
class Truth:
    """Under z = m + L e, e standard normal."""

    value: float  # E[f]
    gains: np.ndarray  # E[f e_i], that is L^T dE[f]/dm
    bends: np.ndarray  # E[f (e_i e_j - [i = j])], that is L^T d2E[f]/dm2 L
    size: float  # E|f|
    error: float  # estimated


def truth(
    function: Function,
    switches: Sequence[Function],
    mean: Any,
    L: Any,
    tolerance: float = 1e-11,
    most: float = 2e7,
    nodes: int = NODES,
) -> Truth:
    """E[f], its derivatives and an error, relative to E|f|; infinite if that takes too many evaluations."""
    problem = _Problem(function, switches, np.asarray(mean, float), np.asarray(L, float), most, nodes)
    rough = np.abs(function(*problem.at(np.random.default_rng(0).normal(size=(len(mean), 4000)))))
    size = float(np.mean(rough[np.isfinite(rough)])) or 1e-300
    (sums,), (error,) = problem.lines(np.zeros((0, 1)), tolerance * size)
    n = len(mean)
    bends = np.zeros((n, n))
    bends[np.tril_indices(n)] = sums[1 + n : -1]
    bends += np.tril(bends, -1).T
    error = float(error) if problem.spent < most else np.inf
    return Truth(float(sums[0]), sums[1 : 1 + n], bends, float(sums[-1]), error / float(sums[-1] or 1))


def _clenshaw_curtis(n: int) -> np.ndarray:
    k = np.arange(n + 1)
    j = np.arange(1, n // 2 + 1)
    b = np.where(j == n / 2, 1, 2) / (4 * j**2 - 1)
    weights = 1 - np.cos(2 * np.pi * np.outer(k, j) / n) @ b
    return np.where((k == 0) | (k == n), 1, 2) / n * weights


POINTS = np.cos(np.pi * np.arange(17) / 16)
FINE, COARSE = _clenshaw_curtis(16), np.zeros(17)
COARSE[::2] = _clenshaw_curtis(8)


@dataclass
class _Problem:
    function: Function
    switches: Sequence[Function]
    mean: np.ndarray
    L: np.ndarray
    most: float
    nodes: int
    spent: float = 0

    @property
    def sums(self) -> int:
        """How many integrals are taken at once."""
        n = len(self.mean)
        return 2 + n + n * (n + 1) // 2

    def at(self, e: Sequence[np.ndarray] | np.ndarray) -> list[np.ndarray]:
        """The arguments."""
        return [m + sum(a * x for a, x in zip(row, e, strict=False)) for m, row in zip(self.mean, self.L, strict=True)]

    def cuts(self, e: np.ndarray) -> np.ndarray:
        """Where lines on which so many of the e are given are cut whatever happens there, (lines, cuts)."""
        level, count = len(e), e.shape[1]
        found = [np.broadcast_to(np.linspace(-REACH, REACH, 21), (count, 21))]
        for m, row in zip(self.mean[level:], self.L[level:], strict=True):
            slope = row[level]
            if abs(slope) * REACH < 1e-13:
                continue
            centre = np.broadcast_to(m + sum(a * x for a, x in zip(row, e, strict=False)), count)
            sizes = LADDER[np.abs(LADDER) <= 2 * REACH * abs(slope)]
            found.append(np.clip((sizes - centre[:, None]) / slope, -REACH, REACH))
        return np.sort(np.concatenate(found, axis=1), axis=1)

    def lines(self, e: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """Integrals over all e that are not given, and their errors, on lines (given, n)."""
        if len(e) == len(self.mean) - 1:
            return self._last(e), np.zeros(e.shape[1])
        total, error = np.zeros((e.shape[1], self.sums)), np.zeros(e.shape[1])
        cuts = self.cuts(e)
        line, at = np.nonzero(np.diff(cuts, axis=1) > 1e-13)
        low, high = cuts[line, at], cuts[line, at + 1]
        while len(line):
            left = []
            for k in range(0, len(line), BATCH // 17):
                part = slice(k, k + BATCH // 17)
                left.append(self._panels(e, line[part], low[part], high[part], tolerance, total, error))
            line, low, high = (np.concatenate(each) for each in zip(*left, strict=True))
        return total, error

    def _panels(self, e, line, low, high, tolerance, total, error) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Adds those that are accurate enough, and gives the halves of the others."""
        half = (high - low) / 2
        u = (low + half)[:, None] + half[:, None] * POINTS
        given = np.concatenate([np.repeat(e[:, line], 17, axis=1), u.reshape(1, -1)])
        values = self.lines(given, tolerance / 20)[0].reshape(len(line), 17, -1)
        values = values * (np.exp(-u * u / 2) / np.sqrt(2 * np.pi) * half[:, None])[..., None]
        fine, coarse = (np.einsum("lps,p->ls", values, weights) for weights in (FINE, COARSE))
        off = np.abs(fine - coarse)[:, :-1].max(axis=1)
        done = (off < tolerance * np.maximum(half / 4, 0.004)) | (half < 1e-11) | (self.spent > self.most)
        np.add.at(total, line[done], fine[done])
        np.add.at(error, line[done], off[done])
        again, middle = ~done, low + half
        starts, ends = (np.concatenate([a[again], b[again]]) for a, b in ((low, middle), (middle, high)))
        return np.tile(line[again], 2), starts, ends

    def _last(self, e: np.ndarray) -> np.ndarray:
        """The innermost lines, each by Gauss and Legendre between its cuts and all its switches."""
        cuts = self._switched(e, self.cuts(e))
        line, at = np.nonzero(np.diff(cuts, axis=1) > 0)
        low, high = cuts[line, at][:, None], cuts[line, at + 1][:, None]
        t, w = np.polynomial.legendre.leggauss(self.nodes)
        t = (t + 1) / 2
        t, w = t**3 * (10 - 15 * t + 6 * t * t), w / 2 * 30 * (t * (1 - t)) ** 2  # so that a root at an end is none
        total = np.zeros((e.shape[1], self.sums))
        for k in range(0, len(line), BATCH):
            part = slice(k, k + BATCH)
            v = low[part] + (high[part] - low[part]) * t
            given = [*(x[line[part]][:, None] for x in e), v]
            f = self.function(*self.at(given)) * (high[part] - low[part]) * w * np.exp(-v * v / 2) / np.sqrt(2 * np.pi)
            self.spent += f.size
            rows = [f, *(f * x for x in given)]
            rows += [f * (given[i] * given[j] - (i == j)) for i in range(len(given)) for j in range(i + 1)]
            for number, row in enumerate([*rows, np.abs(f)]):
                total[:, number] += np.bincount(line[part], weights=row.sum(axis=1), minlength=len(total))
        return total

    def _switched(self, e: np.ndarray, cuts: np.ndarray) -> np.ndarray:
        """The cuts, and where switches change their sign between them."""
        found = [cuts]
        if not self.L[-1, -1]:
            return cuts
        grid = (cuts[:, :-1, None] + np.diff(cuts, axis=1)[..., None] * BESIDE).reshape(len(cuts), -1)
        for switch in self.switches:
            above = switch(*self.at([*(x[:, None] for x in e), grid])) > 0
            self.spent += above.size / 4
            line, at = np.nonzero(above[:, 1:] != above[:, :-1])
            low, high, side = grid[line, at], grid[line, at + 1], above[line, at]
            for _ in range(BISECTIONS if len(line) else 0):
                middle = (low + high) / 2
                same = (switch(*self.at([*(x[line] for x in e), middle])) > 0) == side
                low, high = np.where(same, middle, low), np.where(same, high, middle)
            counts = np.bincount(line, minlength=len(cuts))
            places = np.full((len(cuts), counts.max()), REACH)
            places[line, np.arange(len(line)) - np.repeat(np.cumsum(counts) - counts, counts)] = (low + high) / 2
            found.append(places)
        return np.sort(np.concatenate(found, axis=1), axis=1)
