"""How a step is made of rates and noise: Heun's rule, or an exponential one whose linear part is exact.

    x' = A x + M xi + f(x, xi, t) + kicks and noise.

Heun's rule has no A and M; f is the whole drift. The exponential rule (of Cox & Matthews 2002, ETD2RK, with phi_k of
Hochbruck & Ostermann 2010) takes the vehicle's linear terms exactly, however fast they are:

    p = E x + h phi_1 f(xs) + n,    m = p + h phi_2 (f(p) - f(xs)),    E = exp(h A),

where n is what ground and noise do to the linear part. Over the step the ground is the parabola that has its values at
both ends and its mean: xi = xi_0 + d s + 6 e s (1 - s). Noise in time is sampled by its own exact covariance,

    int_0^h exp(A u) B Q B^T exp(A u)^T du.

Coefficients that vary are frozen at the middle of the step, those of the ground taken at both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import sympy as sp

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.simulation.kicks import Separated
from cadet_sym.simulation.laws import covariance_factor, exact_law

__all__ = ["Exponential", "Heun", "Linear", "Numbers", "Rule", "closure", "split_linear"]


@dataclass(frozen=True)
class Linear:
    """Terms of the vehicle's drift that are linear in one state, and the drift that is left."""

    vehicle: dict[tuple[int, int], sp.Expr]  # A[a, b]
    ground: dict[tuple[int, int], sp.Expr]  # M[a, k], k counting filter states
    rest: tuple[sp.Expr, ...]


def split_linear(drift: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> Linear:
    """Sort the terms of the drift of the first len(drift) states."""
    nv, place = len(drift), {s: b for b, s in enumerate(states)}
    parts: tuple[dict[tuple[int, int], sp.Expr], dict[tuple[int, int], sp.Expr]] = ({}, {})
    rest = []
    for a, rate in enumerate(drift):
        left = []
        for whole in sp.Add.make_args(rate):
            terms = [(_linear_term(term, place), term) for term in sp.Add.make_args(sp.expand_mul(whole))]
            if all(found is None for found, _ in terms):
                left.append(whole)
                continue
            left += [term for found, term in terms if found is None]
            for b, factor in (found for found, _ in terms if found is not None):
                part, key = (parts[0], (a, b)) if b < nv else (parts[1], (a, b - nv))
                part[key] = part.get(key, sp.S.Zero) + factor
        rest.append(sp.Add(*left))
    return Linear(*parts, tuple(rest))


def _linear_term(term: sp.Expr, place: dict[sp.Symbol, int]) -> tuple[int, sp.Expr] | None:
    """State and factor of a term that is linear in one state, its factor free of all."""
    moving = term.free_symbols & set(place)
    if len(moving) != 1:
        return None
    state = next(iter(moving))
    factor, alone = term.as_independent(state, as_Add=False)
    return (place[state], factor) if alone == state else None


@dataclass(frozen=True)
class Numbers:
    """Values along the steps that the columns of a rule are made of."""

    H: np.ndarray  # (steps,)
    kicks: tuple[np.ndarray, np.ndarray]  # (steps, kicks) kappa at both ends
    noise: np.ndarray  # (steps, nv, unit noises) what noises in time do to the vehicle, in the mean of both ends
    A: np.ndarray  # (steps, nv, nv); this and M: exponential rule only
    M: tuple[np.ndarray, np.ndarray]  # (steps, nv, filter states) at both ends


At = Callable[[int, str], str]  # row of noise, node -> the text of its value


class Rule(Protocol):
    """Texts of a step, and the numbers they name k0, k1, ..."""

    name: str
    rest: tuple[sp.Expr, ...]  # rates that are evaluated
    removed: tuple[sp.Expr, ...]  # what was taken out of the drift for them
    noises: int  # rows of a node that hold noise in time
    columns: int
    pushed: set[int]  # states that have an n
    shifted: set[int]  # states that have an na and an nb

    def noise_line(self, j: int, at: At) -> str:
        """Noise of the step from the rows of its nodes: "a" the start, "b" the end, "(b - 1)" the one before."""
        ...

    def pushes(self) -> list[str]:
        """Lines of n, na and nb."""
        ...

    def predicted(self, z: str, rates: Sequence[str], noisy: bool = True) -> list[str]:
        """Texts of all states at the end of the step by the rates taken first, without shift."""
        ...

    def corrected(self, z: str, first: Sequence[str], last: Sequence[str], noisy: bool = True) -> list[str]:
        """Texts of all states at the end of the step by the rates taken first and last."""
        ...

    def table(self, numbers: Numbers) -> np.ndarray:
        """(steps, columns)."""
        ...


def _sum(terms: Iterable[str]) -> str:
    return " + ".join(terms) or "0.0"


class Heun:
    """Rates in the mean of both places; noise in time as increments of sums since the start."""

    name = "heun"

    def __init__(self, separated: Separated, entries: tuple[tuple[int, int], ...]):
        self.rest, self.removed = separated.drift, (sp.S.Zero,) * len(separated.drift)
        self.kicks, self.entries = separated.kicks, entries
        self.noises = len({j for _, j in entries})
        self.columns = 2 * len(self.kicks) + len(entries)
        self.shifted = {k.state for k in self.kicks}
        self.pushed = self.shifted | {i for i, _ in entries}

    def noise_line(self, j: int, at: At) -> str:
        """The increment of the sum."""
        return f"w{j} = {at(j, 'b')} - {at(j, 'a')}"

    def pushes(self) -> list[str]:
        """Factors times increments; int K dy = K g - dK e."""
        kicks, first = len(self.kicks), len(self.kicks) + len(self.entries)
        terms: dict[str, list[str]] = {}
        for column, kick in enumerate(self.kicks):
            g = f"g{kick.height}"
            own = (f"k{column} * {g}", f"k{first + column} * ((-0.5) * (a{g} + b{g}))")
            terms.setdefault(f"n{kick.state}", []).extend(own)
            for end in "ab":
                terms.setdefault(f"n{end}{kick.state}", []).append(f"k{column} * {end}{g}")
        for column, (state, j) in enumerate(self.entries, kicks):
            terms.setdefault(f"n{state}", []).append(f"k{column} * w{j}")
        return [f"{name} = {_sum(each)}" for name, each in terms.items()]

    def predicted(self, z: str, rates: Sequence[str], noisy: bool = True) -> list[str]:
        """Euler's rule."""
        return [f"{z}{a} + dt * {rate}{self._noise(a, noisy)}" for a, rate in enumerate(rates)]

    def corrected(self, z: str, first: Sequence[str], last: Sequence[str], noisy: bool = True) -> list[str]:
        """Heun's rule."""
        pairs = enumerate(zip(first, last, strict=True))
        return [f"{z}{a} + half * ({old} + {new}){self._noise(a, noisy)}" for a, (old, new) in pairs]

    def _noise(self, a: int, noisy: bool) -> str:
        return f" + n{a}" if noisy and a in self.pushed else ""

    def table(self, numbers: Numbers) -> np.ndarray:
        """Kicks and noises in the mean of both ends, and how much the kicks' factors change."""
        before, after = numbers.kicks
        entries = [numbers.noise[:, i, j] for i, j in self.entries]
        return np.column_stack([0.5 * (before + after), *entries, after - before])


class Exponential:
    """The linear part exactly; noise in time as what it does to every state within the step."""

    name = "exponential"

    def __init__(self, system: AugmentedSystem, separated: Separated, linear: Linear, entries: tuple[tuple[int, int], ...]):
        self.linear, self.kicks = linear, separated.kicks
        self.rest, nv = linear.rest, len(linear.rest)
        self.states, self.filters = nv, len(system.states) - nv
        self.removed = tuple(
            sp.Add(*(f * system.states[b] for (i, b), f in linear.vehicle.items() if i == a))
            + sp.Add(*(f * system.states[nv + k] for (i, k), f in linear.ground.items() if i == a))
            for a in range(nv)
        )
        self.reach = closure(nv, linear.vehicle)
        self.active = [b for b, rate in enumerate(linear.rest) if rate != 0]
        self.heights = sorted({k.height for k in self.kicks})
        self.met = sorted({k for _, k in linear.ground})
        self.noisy = [a for a in range(nv) if any(self.reach[a, i] for i, _ in entries)]
        self.noises = len(self.noisy)
        kicked = {(a, k.height) for k in self.kicks for a in range(nv) if self.reach[a, k.state]}
        fed = {(a, k) for b, k in linear.ground for a in range(nv) if self.reach[a, b]}
        pairs = [(a, b) for a in range(nv) for b in range(nv) if self.reach[a, b]]
        forced = [(a, b) for a, b in pairs if b in self.active]
        between = [(a, b) for a in self.noisy for b in self.noisy if self.reach[a, b]]
        groups = {"E": pairs, "F": forced, "P": forced, "G": sorted(kicked), "D": sorted(kicked)}
        groups |= {"U": sorted(fed), "V": sorted(fed), "W": sorted(fed), "N": between}
        self.groups, self.column = groups, {}
        for name, places in groups.items():
            for place in places:
                self.column[name, place] = len(self.column)
        self.columns = len(self.column)
        self.shifted = {a for a, _ in kicked}
        self.pushed = self.shifted | {a for a, _ in fed} | set(self.noisy)

    def _k(self, group: str, place: tuple[int, int]) -> str:
        return f"k{self.column[group, place]}"

    def noise_line(self, j: int, at: At) -> str:
        """What the noise of the step did; in a step that is two of the grid's, that of the first goes on through the second."""
        earlier = ((i, ("N", (self.noisy[j], b))) for i, b in enumerate(self.noisy))
        terms = [f"k{self.column[key]} * {at(i, '(b - 1)')}" for i, key in earlier if key in self.column]
        return f"w{j} = {_sum([at(j, 'b'), *terms])}"

    def pushes(self) -> list[str]:
        """What kicks, ground and noise do to the linear part."""
        terms: dict[str, list[str]] = {}
        for a, j in self.groups["G"]:
            g = f"g{j}"
            own = (f"{self._k('G', (a, j))} * {g}", f"{self._k('D', (a, j))} * (0.5 * (a{g} + b{g}))")
            terms.setdefault(f"n{a}", []).extend(own)
            for end in "ab":
                terms.setdefault(f"n{end}{a}", []).append(f"{self._k('G', (a, j))} * {end}{g}")
        for a, k in self.groups["U"]:
            for group, what in (("U", f"u{k}"), ("V", f"v{k}"), ("W", f"e{k}m")):
                terms.setdefault(f"n{a}", []).append(f"{self._k(group, (a, k))} * {what}")
        for j, a in enumerate(self.noisy):
            terms.setdefault(f"n{a}", []).append(f"w{j}")
        return [f"{name} = {_sum(each)}" for name, each in terms.items()]

    def predicted(self, z: str, rates: Sequence[str], noisy: bool = True) -> list[str]:
        """Exponential Euler."""
        return self.corrected(z, rates, rates, noisy)

    def corrected(self, z: str, first: Sequence[str], last: Sequence[str], noisy: bool = True) -> list[str]:
        """ETD2RK, h phi_1 f0 + h phi_2 (f1 - f0)."""
        texts = []
        for a in range(self.states):
            terms = [f"{self._k('E', (a, b))} * {z}{b}" for b in range(self.states) if self.reach[a, b]]
            for b in range(self.states):
                if ("F", (a, b)) in self.column and (first[b], last[b]) != ("0.0", "0.0"):
                    terms += [f"{self._k('F', (a, b))} * {first[b]}", f"{self._k('P', (a, b))} * {last[b]}"]
            texts.append(_sum([*terms, *([f"n{a}"] if noisy and a in self.pushed else [])]))
        return texts

    def table(self, numbers: Numbers) -> np.ndarray:
        """All matrices by their columns."""
        E, one, two, three = _phi(numbers.A, numbers.H)
        h = numbers.H[:, None, None]
        kicks, after = (np.zeros((len(h), self.states, 1 + max(self.heights, default=0))) for _ in range(2))
        for column, kick in enumerate(self.kicks):
            kicks[:, kick.state, kick.height] += 0.5 * (numbers.kicks[0] + numbers.kicks[1])[:, column]
            after[:, kick.state, kick.height] += (numbers.kicks[1] - numbers.kicks[0])[:, column]
        begin, end = numbers.M
        values = {
            "E": E,
            "F": h * (one - two),
            "P": h * two,
            "G": one @ kicks,
            "D": 6.0 * (one - 2.0 * two) @ kicks - one @ after,
            "U": h * (one - two) @ begin,
            "V": h * two @ end,
            "W": 3.0 * h * (two - 2.0 * three) @ (begin + end),
        }
        table = np.zeros((len(h), self.columns))
        for (name, (a, b)), column in self.column.items():
            if name in values:
                table[:, column] = values[name][:, a, b]
        return table

    def carry_on(self, table: np.ndarray, A: np.ndarray, H: np.ndarray) -> None:
        """Put in what becomes of the noise of the first half of a step in its second half, of length H."""
        E = _phi(A, H)[0]
        for a, b in self.groups["N"]:
            table[:, self.column["N", (a, b)]] = E[:, a, b]

    def noise_laws(self, numbers: Numbers) -> tuple[np.ndarray, np.ndarray]:
        """Factors of the noise's covariance in the rows it has, (laws, rows, rows), and the law of every step."""
        first, which = _distinct(numbers.H, numbers.A, numbers.noise)
        B = numbers.noise[first]
        _, sigma = exact_law(numbers.A[first], B @ np.swapaxes(B, -1, -2), numbers.H[first])
        return covariance_factor(sigma[:, self.noisy][:, :, self.noisy]), which


def _distinct(H: np.ndarray, *matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps that differ in length or matrices, and for every step which of them it is like."""
    key = np.round(H / (1e-10 * max(float(H.max(initial=0.0)), 1e-300)))
    together = np.column_stack([key, *(m.reshape(len(H), -1) for m in matrices)])
    _, first, which = np.unique(together, axis=0, return_index=True, return_inverse=True)
    return first, which.ravel().astype(np.int64)


def closure(n: int, entries: Iterable[tuple[int, int]]) -> np.ndarray:
    """Which state b reaches which state a through the linear part, (n, n) bool."""
    reach = np.eye(n, dtype=bool)
    for a, b in entries:
        reach[a, b] = True
    for b in range(n):
        reach |= reach[:, b : b + 1] & reach[b : b + 1, :]
    return reach


def _phi(A: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """exp(h A), phi_1, phi_2, phi_3 of every step, (steps, n, n) each; equal steps are worked out once.

    The exponential of [[h A, I, 0, 0], [0, 0, I, 0], [0, 0, 0, I], 0] holds them in its first row.
    """
    from scipy.linalg import expm

    n = A.shape[1]
    first, which = _distinct(H, A)
    block = np.zeros((len(first), 4 * n, 4 * n))
    block[:, :n, :n] = H[first, None, None] * A[first]
    for k in range(3):
        block[:, k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n] = np.eye(n)
    found = expm(block)[:, :n][which]
    return found[..., :n], found[..., n : 2 * n], found[..., 2 * n : 3 * n], found[..., 3 * n :]
