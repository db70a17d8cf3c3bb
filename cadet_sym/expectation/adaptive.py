"""Expectations by adaptive integration of the function itself, with an error: what quadratures are held against.

With z = m + L e, e independent standard normal, the integral over e_1 of the integral over e_2 of ... is taken on every line by
the rule of Gauss and Kronrod with 21 points (Piessens et al., QUADPACK, 1983), halved where it is not accurate enough. Lines
are cut where f switches or is steep: at the zeros, found on the line, of what stands under abs, sign, max, comparisons, powers
and functions. What such zeros do as they meet or leave the line is left to the halving. All lines of one level are taken
at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice, permutations
from math import ceil

import numpy as np
import sympy as sp

from cadet_sym.expectation.pieces import factored
from cadet_sym.expectation.roots import roots
from cadet_sym.language.kinks import switching_functions
from cadet_sym.language.numeric import evaluate

REACH, FARTHEST = 6.0, 37.0  # standard deviations: no nearer and no farther than these
NEGLIGIBLE = 1e-5  # of the largest f times the density, times the tolerance
RAYS, STEPS = 200, 400  # along which the reach is looked for
EVEN = np.linspace(0.0, 1.0, 9)  # where a switching function is looked at on an interval
GRADED = np.array([1e-12, 1e-9, 1e-7, 1e-5, 1e-3, 0.02, 0.15])
GRADED = np.concatenate([GRADED, [0.5], 1 - GRADED[::-1]])  # the same between the places found so
FINER = 0.02  # than the tolerance are zeros found
PANELS = (3.3, 3.3, 6.5)  # the longest interval at first, in standard deviations: of one, two, three arguments
NARROWEST = 1e-13  # interval that is not halved
CLOSER = 0.03  # the tolerance of a line inside over that outside
LOOSER = 1e3  # the tolerance that is tried where one is not met
HOPELESS = 0.1  # relative error at which a looser tolerance is not tried
MARGIN = 30.0  # the error that may be left over the tolerance: estimates are large where much is halved
LEAST_SHARE = 0.02  # of a line's tolerance that an interval may take, however short
BATCH = 400_000  # evaluations at once
MOST_PLACES = 60
HARD = 20  # the degree, as it were, of what is no polynomial
SHAPES = np.array([[[0, 3, -2], [0, 1, 0]], [[2, -1, 0], [1, 0, 0]]], float)  # of an interval, by whether its ends are regular

_KRONROD = (  # positive nodes, weights; every second node from the second on is Gauss's
    (0.995657163025808080735527280689003, 0.011694638867371874278064396062192),
    (0.973906528517171720077964012084452, 0.032558162307964727478818972459390),
    (0.930157491355708226001207180059508, 0.054755896574351996031381300244580),
    (0.865063366688984510732096688423493, 0.075039674810919952767043140916190),
    (0.780817726586416897063717578345042, 0.093125454583697605535065465083366),
    (0.679409568299024406234327365114874, 0.109387158802297641899210590325805),
    (0.562757134668604683339000099272694, 0.123491976262065851077958109585166),
    (0.433395394129247190799265943165784, 0.134709217311473325928054001771707),
    (0.294392862701460198131126603103866, 0.142775938577060080797094273138717),
    (0.148874338981631210884826001129720, 0.147739104901338491374841515972068),
)
_MIDDLE = 0.149445554002916905664936468389821
_HALF = np.array(_KRONROD)
_NODES = np.concatenate([-_HALF[:, 0], [0.0], _HALF[::-1, 0]])
_BESIDE = np.array([1e-3, 3e-5, 1e-6])  # from the ends: what is so steep there that no node sees it shows here
NODES = np.concatenate([_NODES, _BESIDE - 1, 1 - _BESIDE])
NONE = np.zeros(2 * len(_BESIDE))
KRONROD = np.concatenate([_HALF[:, 1], [_MIDDLE], _HALF[::-1, 1], NONE])
GAUSS = np.zeros(len(NODES))
GAUSS[1:21:2] = np.polynomial.legendre.leggauss(10)[1]
RULES = np.stack([KRONROD, GAUSS])
BANDS = np.tile([4e-3, 1e-3, 3e-5], 2)  # how much of the interval each of these stands for
EXTRAPOLATED = np.linalg.solve(  # values at the 21 nodes -> at these
    np.polynomial.legendre.legvander(_NODES, 20).T, np.polynomial.legendre.legvander(NODES[21:], 20).T
).T


@dataclass(frozen=True)
class Integrated:
    """Expectations under N(m, L L^T), and how far they can be trusted."""

    value: float  # E[f]
    moments: np.ndarray  # E[f e_i]
    size: float  # E|f|
    error: float  # estimated, of the value and the moments
    evaluations: int
    converged: bool


@dataclass
class _Budget:
    """How many evaluations are left."""

    most: int
    spent: int = 0

    @property
    def is_left(self) -> bool:
        return self.spent < self.most


@dataclass
class _Lines:
    """Integrals on lines: E[f], E[f e_i] of the arguments integrated over, E|f|; and the error of the others, E|f| apart."""

    total: np.ndarray
    error: np.ndarray


@dataclass(frozen=True)
class _Intervals:
    """Stretches of lines from t = low to high, x = start + length (a t + b t^2 + c t^3), t from 0 to 1.

    From an end where something switches x goes as t^2, so that a root there is smooth in t.
    """

    line: np.ndarray
    start: np.ndarray
    length: np.ndarray
    shape: np.ndarray  # (intervals, 3): a, b, c
    low: np.ndarray
    high: np.ndarray

    @staticmethod
    def between(line: np.ndarray, start: np.ndarray, end: np.ndarray, is_regular: tuple[np.ndarray, np.ndarray]) -> _Intervals:
        """Whole stretches; whether nothing switches at their ends."""
        shape = SHAPES[is_regular[0].astype(int), is_regular[1].astype(int)]
        return _Intervals(line, start, end - start, shape, np.zeros(len(line)), np.ones(len(line)))

    def __len__(self) -> int:
        return len(self.line)

    def __getitem__(self, k: slice | np.ndarray) -> _Intervals:
        return _Intervals(self.line[k], self.start[k], self.length[k], self.shape[k], self.low[k], self.high[k])

    def halved(self) -> _Intervals:
        """Both halves of every one."""
        middle = (self.low + self.high) / 2
        line, start, length, shape = (np.concatenate([each, each]) for each in (self.line, self.start, self.length, self.shape))
        return _Intervals(line, start, length, shape, np.concatenate([self.low, middle]), np.concatenate([middle, self.high]))

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """x at the nodes, and dx over half an interval of the rule, (intervals, nodes)."""
        half = (self.high - self.low)[:, None] / 2
        t = self.low[:, None] + half * (1 + NODES)
        a, b, c = self.shape.T[..., None]
        length = self.length[:, None]
        return self.start[:, None] + length * t * (a + t * (b + t * c)), length * (a + t * (2 * b + t * 3 * c)) * half


@dataclass(frozen=True)
class _Integrand:
    arguments: tuple[sp.Symbol, ...]
    body: sp.Expr
    numbers: Mapping[sp.Symbol, float]
    mean: np.ndarray
    L: np.ndarray
    places: tuple[tuple[sp.Expr, ...], ...]  # for every level, what is zero where a line is cut
    fineness: float  # to which such a zero is found, of the interval that it is looked for in

    def at(self, expr: sp.Expr, e: np.ndarray) -> np.ndarray:
        """An expression in the arguments of the first levels at points (levels, n)."""
        z = self.mean[: len(e), None] + np.einsum("ij,jn->in", self.L[: len(e), : len(e)], e)
        values = evaluate(expr, {**self.numbers, **dict(zip(self.arguments, z, strict=False))})
        return np.broadcast_to(values, e.shape[1:])


def integrate(
    arguments: tuple[sp.Symbol, ...],
    body: sp.Expr,
    numbers: Mapping[sp.Symbol, float],
    mean: Sequence[float] | np.ndarray,
    L: np.ndarray,
    *,
    tolerance: float,
    most: int,
) -> Integrated:
    """E[f], E[f e_i] and E|f| for z = m + L e, e independent standard normal.

    Parameters
    ----------
    arguments, body, numbers : f, and the numbers of what else is in it.
    mean, L : (n,), and (n, n) lower triangular; zeros on the diagonal are allowed.
    tolerance : of the result, relative to E|f|.
    most : evaluations of f after which it stops; if it has not converged, it tries again with a tolerance that may be met.
    """
    m, root = np.asarray(mean, float), np.asarray(L, float)
    placed = tuple(_places(body, arguments, level) for level in range(len(arguments)))
    integrand = _Integrand(arguments, body, numbers, m, root, placed, FINER * tolerance)
    reach, size = _extent(integrand, NEGLIGIBLE * tolerance)
    best: Integrated | None = None
    for wanted in (tolerance, LOOSER * tolerance):
        budget = _Budget(most)
        lines = _along(integrand, np.zeros((0, 1)), np.array([wanted * size]), reach, budget)
        total, error = lines.total[0], float(lines.error[0])
        spent = budget.spent + (best.evaluations if best else 0)
        converged = error <= MARGIN * wanted * float(total[-1]) and wanted == tolerance
        if best is None or error < best.error:
            best = Integrated(float(total[0]), total[1:-1], float(total[-1]), error, spent, converged)
        if converged or error > HOPELESS * float(total[-1]):
            break
    return replace(best, evaluations=spent)


@lru_cache(maxsize=256)  # the same function is integrated for many moments
def _places(body: sp.Expr, arguments: tuple[sp.Symbol, ...], level: int) -> tuple[sp.Expr, ...]:
    """What is zero where f switches, is singular or is steep, and has this argument for its last."""
    z, later = arguments[level], set(arguments[level + 1 :])
    found = dict.fromkeys(f for a in arguments for f in switching_functions(body, a))
    for node in sorted(body.atoms(sp.Function, sp.Pow), key=sp.default_sort_key):
        if isinstance(node, sp.Pow) and node.exp.is_Integer and node.exp > 0:
            continue
        inner = node.args[0] if not (isinstance(node, sp.Pow) and node.exp.free_symbols & set(arguments)) else node.exp
        if isinstance(node, sp.asin | sp.acos):
            inner = 1 - inner**2
        if isinstance(inner, sp.Expr):
            found[inner] = None
    found.update({sp.diff(place, z): None for place in list(found)})  # zeros near to each other lie about one of this
    parts = dict.fromkeys(part for place in found for part in _parts(place, arguments, level))
    usable = (p for p in parts if p.has(z) and not p.free_symbols & later and not p.has(sp.Derivative, sp.DiracDelta, sp.Subs))
    return tuple(islice(usable, MOST_PLACES))


@lru_cache(maxsize=256)
def easiest_order(arguments: tuple[sp.Symbol, ...], body: sp.Expr) -> tuple[int, ...]:
    """The arguments in the order in which they are best integrated over: what switches should be linear in the last it has.

    Zeros of x - y cos(w) on a line along w come, go and meet as x and y change; along x there is always one.
    """

    def toil(order: tuple[int, ...]) -> int:
        ordered = [arguments[k] for k in order]
        switching = dict.fromkeys(f for z in arguments for f in switching_functions(body, z))
        lasts = [(f, max((z for z in ordered if f.has(z)), key=ordered.index)) for f in switching]
        return sum(_toil(f, z) for f, z in lasts)

    return min(permutations(range(len(arguments))), key=toil)


def _toil(function: sp.Expr, z: sp.Symbol) -> int:
    if not function.is_polynomial(z):
        return HARD
    polynomial = sp.Poly(function, z)
    return 2 * int(polynomial.degree()) + bool(polynomial.LC().free_symbols)  # where that is zero a zero goes to infinity


def _parts(place: sp.Expr, arguments: tuple[sp.Symbol, ...], level: int) -> Iterator[sp.Expr]:
    """Factors; of polynomial ones with later arguments the coefficients: where they are zero, zeros go to infinity."""
    if isinstance(place, sp.Mul):
        for factor in place.args:
            yield from _parts(factor, arguments, level)
        return
    if isinstance(place, sp.Heaviside | sp.sign):
        return  # from the slope of something that switches: where it does so is a place by itself
    if not place.is_polynomial(*arguments):
        yield place
        return
    later = [z for z in arguments[level + 1 :] if place.has(z)]
    for factor, _ in factored(place)[1]:
        if not factor.has(*later):
            yield factor
            continue
        for coefficient in sp.Poly(factor, *later).coeffs():
            yield from (part for part, _ in factored(coefficient)[1])


def _extent(integrand: _Integrand, negligible: float) -> tuple[float, float]:
    """How far from the mean f times the density is to be seen; a first idea of E|f|."""
    count = len(integrand.mean)
    rays = np.random.default_rng(0).normal(size=(RAYS, count))
    rays = np.concatenate([rays, np.eye(count), -np.eye(count)])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    r = np.linspace(0, FARTHEST, STEPS + 1)[1:]
    with np.errstate(all="ignore"):
        values = np.abs(integrand.at(integrand.body, (rays.T[..., None] * r).reshape(count, -1))).reshape(-1, STEPS)
        profile = values * np.exp(-r * r / 2)
        profile = np.where(np.isfinite(profile), profile, 0.0)
        weight = r ** (count - 1) * np.exp(-r * r / 2)
        size = float(np.sum(np.where(np.isfinite(values), values, 0.0) * weight) / (len(rays) * np.sum(weight)))
    largest = profile.max()
    seen = np.any(profile > negligible * largest, axis=0)
    return float(np.clip(r[seen][-1], REACH, FARTHEST) if seen.any() else REACH), size or 1.0


def _along(integrand: _Integrand, e: np.ndarray, tolerance: np.ndarray, reach: float, budget: _Budget) -> _Lines:
    """Integrals over the arguments that are left, on lines (levels so far, n), each to its own absolute tolerance."""
    level, count = len(e), len(integrand.mean)
    if not integrand.L[level:, level].any():  # nothing depends on it
        return _nothing_left(integrand, e, tolerance, reach, budget)
    waiting = _cut(integrand, e, reach, budget)
    done = _Lines(np.zeros((e.shape[1], count - level + 2)), np.zeros(e.shape[1]))
    while len(waiting):
        values, own, inside = _kronrod(integrand, e, waiting, tolerance, reach, budget)
        share = waiting.length * (waiting.high - waiting.low) / (2 * reach)
        allowed = tolerance[waiting.line] * np.maximum(share, LEAST_SHARE)
        final = (own <= np.maximum(allowed, 3 * inside)) | (waiting.high - waiting.low < NARROWEST)
        final |= not budget.is_left
        np.add.at(done.total, waiting.line[final], values[final])
        np.add.at(done.error, waiting.line[final], (own + inside)[final])
        waiting = waiting[~final].halved()
    return done


def _nothing_left(integrand: _Integrand, e: np.ndarray, tolerance: np.ndarray, reach: float, budget: _Budget) -> _Lines:
    """A level without variance: E[f e] is zero, and e may as well be zero."""
    there = np.concatenate([e, np.zeros((1, e.shape[1]))])
    inner = _inside(integrand, there, tolerance, reach, budget)
    return _Lines(np.insert(inner.total, 1, 0.0, axis=1), inner.error)


def _inside(integrand: _Integrand, e: np.ndarray, tolerance: np.ndarray, reach: float, budget: _Budget) -> _Lines:
    """f itself where all arguments are given, else its integrals over the others."""
    count, points = e.shape
    if count < len(integrand.mean):
        size = max(1, BATCH // 400)
        cuts = [slice(k, k + size) for k in range(0, points, size)]
        parts = [_along(integrand, e[:, k], tolerance[k], reach, budget) for k in cuts]
        return _Lines(np.concatenate([p.total for p in parts]), np.concatenate([p.error for p in parts]))
    budget.spent += points
    f = integrand.at(integrand.body, e)
    f = np.where(np.isfinite(f), f, 0.0)
    return _Lines(np.stack([f, np.abs(f)], axis=1), np.zeros(points))


def _kronrod(
    integrand: _Integrand, e: np.ndarray, waiting: _Intervals, tolerance: np.ndarray, reach: float, budget: _Budget
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrals over the intervals, the rule's own error, and that of what is integrated."""
    values = np.zeros((len(waiting), len(integrand.mean) - len(e) + 2))
    own, inside = np.zeros(len(waiting)), np.zeros(len(waiting))
    size = max(1, BATCH // len(NODES))
    for start in range(0, len(waiting), size):
        k = slice(start, start + size)
        x, dx = waiting[k].points()
        lines = np.repeat(waiting.line[k], len(NODES))
        weight = np.exp(-x * x / 2) / np.sqrt(2 * np.pi)
        wanted = tolerance[lines] * CLOSER / np.maximum(weight, 1e-300).ravel()
        found = _inside(integrand, np.concatenate([e[:, lines], x.reshape(1, -1)]), wanted, reach, budget)
        weight = weight * dx
        f = found.total.reshape(*x.shape, -1) * weight[..., None]
        f = np.concatenate([f[..., :1], f[..., :1] * x[..., None], f[..., 1:]], axis=-1)
        kronrod, gauss = np.moveaxis(RULES @ f, 1, 0)
        spread = KRONROD @ np.abs(f - kronrod[:, None] / 2)
        hidden = BANDS @ np.abs(f[:, 21:] - EXTRAPOLATED @ f[:, :21])
        values[k] = kronrod
        own[k] = (_scaled(np.abs(kronrod - gauss), spread) + hidden)[:, :-1].max(axis=1)
        inside[k] = np.einsum("ij,j->i", found.error.reshape(x.shape) * weight, KRONROD)
    return values, own, inside


def _scaled(difference: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """The error of the finer rule from the difference to the coarser one, as QUADPACK has it."""
    with np.errstate(all="ignore"):
        ratio = np.where(spread > 0, 200 * difference / spread, 0.0)
    return spread * np.minimum(1.0, ratio * np.sqrt(ratio))


def _cut(integrand: _Integrand, e: np.ndarray, reach: float, budget: _Budget) -> _Intervals:
    """The lines in intervals between fixed edges and the zeros of what has a place there."""
    panels = np.linspace(-reach, reach, ceil(2 * reach / PANELS[len(integrand.mean) - 1]) + 1)
    lines = np.repeat(np.arange(e.shape[1]), len(panels) - 1)
    low, high = np.tile(panels[:-1], e.shape[1]), np.tile(panels[1:], e.shape[1])
    for fractions in (EVEN, GRADED) if integrand.places[len(e)] else ():
        budget.spent += len(lines) * len(fractions) // 4
        found = [_zeros(integrand, place, e, (lines, low, high), fractions) for place in integrand.places[len(e)]]
        ends = [(lines, low), (lines, high), *found]
        cut, points = (np.concatenate(each) for each in zip(*ends, strict=True))
        order = np.lexsort((points, cut))
        cut, points = cut[order], points[order]
        real = (cut[1:] == cut[:-1]) & (points[1:] > points[:-1])
        lines, low, high = cut[:-1][real], points[:-1][real], points[1:][real]
    return _Intervals.between(lines, low, high, (np.isin(low, panels), np.isin(high, panels)))


def _zeros(
    integrand: _Integrand,
    place: sp.Expr,
    e: np.ndarray,
    intervals: tuple[np.ndarray, np.ndarray, np.ndarray],
    fractions: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Where a function changes its sign on intervals of lines, as far as samples show it: line, position."""
    lines, low, high = intervals

    def at(of: np.ndarray, x: np.ndarray) -> np.ndarray:
        return integrand.at(place, np.concatenate([e[:, of], x[None]]))

    grid = low[:, None] + (high - low)[:, None] * fractions
    values = at(np.repeat(lines, len(fractions)), grid.ravel()).reshape(grid.shape)
    above = values >= 0
    which, k = np.nonzero(above[:, 1:] != above[:, :-1])
    of = lines[which]
    ends, f = ((both[which, k], both[which, k + 1]) for both in (grid, values))
    return of, roots(lambda some, x: at(of[some], x), ends, f, integrand.fineness)
