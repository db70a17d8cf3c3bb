"""Hold a describing function against adaptive integration of the nonlinearity itself, over a grid of means and variances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.expectation.adaptive import easiest_order, integrate
from cadet_sym.expectation.describing import DescribingFunction, describing_function
from cadet_sym.language.element import Element, written_out
from cadet_sym.language.numeric import evaluate
from cadet_sym.lowering.elements import element_function, parameters_of
from cadet_sym.tables import Shown

SPREADS = (0.0, 1e-3, 0.1, 1.0, 10.0)  # standard deviations, times the scale
PLACES = (-3.0, -0.7, 0.0, 1.0, 4.0)  # of the mean about a kink, in standard deviations
SEVERAL = {  # the same with a correlation between neighbours
    2: ((0.0, 0.0), *((s, rho) for s in (0.1, 1.0, 10.0) for rho in (-0.95, 0.0, 0.5)), (1.0, 0.999)),
    3: ((0.0, 0.0), (0.3, -0.95), (0.3, 0.5), (1.0, 0.0), (1.0, 0.8)),
}
PLANES = (0.0, 0.1, 1.0)  # spreads of more arguments than those
TOLERANCE = {1: 1e-12, 2: 1e-10, 3: 1e-7}  # asked of the adaptive integration, relative to E|f|
BUDGET = {1: 4_000_000, 2: 30_000_000, 3: 60_000_000}  # evaluations of f for all cases together
SURE = 1e-8  # error of the integration itself from which on a case is told apart
BESIDE = 1e-12
WAYS = 40  # in which f is looked at around a point
SINGULAR = 1e-10  # variance along an axis, of standardised arguments, over the largest: it is taken to be none
MOST_AXES = 2  # on which functions of more than three arguments are looked at
NOTHING = 1e-100  # in any unit: of what is left of a function many deviations from all of it, an error is none
BEYOND = ((8.0, 1e-6), (40.0, 1e-20))  # deviations at which |f| is looked at, and the least part of it that counts


@dataclass(frozen=True, repr=False)
class ElementCheck(Shown):
    """What a check found, and where the worst was.

    Errors are relative to E|f|, of gains to E|f| over the standard deviation, without variance to |f| around the mean. Where
    the integration itself is good to less than `SURE`, they are what exceeds its own error; infinite, of what is no number.
    """

    name: str
    method: str  # "closed form" or "quadrature"
    nodes: int
    estimated: float  # what the describing function says of its own error
    cases: int
    error: float  # of E[f], the largest
    gain_error: float  # of the gains, the largest
    mean: tuple[float, ...]  # where the worst was
    covariance: tuple[tuple[float, ...], ...]
    found: float  # E[f] or the gain there
    integrated: float
    sure: float  # estimated error of the integration itself, the largest
    unsettled: int  # cases in which that is more than `SURE`

    def __str__(self) -> str:
        nodes = f", {self.nodes} nodes, {self.estimated:.0e} estimated" if self.nodes else ""
        return "\n    ".join([f"{self.name}: {self.method}{nodes}", *self.findings()])

    def findings(self) -> Iterator[str]:
        """The largest errors and the worst place, in a line each; and how far the integration itself can be trusted."""
        good = "" if self.unsettled else f" good to {self.sure:.0e}"
        yield (
            f"{self.cases} cases against adaptive integration{good}: largest error {self.error:.1e} in E[f], "
            f"{self.gain_error:.1e} in the gain"
        )
        yield (
            f"worst at mean {_listed(self.mean)}, covariance {_listed(self.covariance)}: "
            f"{self.found:.12g}, integrated {self.integrated:.12g}"
        )
        if self.unsettled:
            yield (
                f"in {self.unsettled} of {self.cases} cases the integration itself did not converge in the evaluations that it "
                f"has and is good to {self.sure:.0e} only: smaller errors are not seen there"
            )


def check(
    element: Element | DescribingFunction,
    values: Mapping[str, float] | None = None,
    *,
    scale: float = 1.0,
) -> ElementCheck:
    """Test an element, one's own included, against adaptive integration.

    Parameters
    ----------
    element : an element, or its describing function.
    values : numbers of the parameters in it.
    scale : a typical size of its arguments; the grid reaches from a thousandth of it to ten times as much.

    Returns
    -------
    ElementCheck
        To be printed: the largest errors and the worst place.

    Raises
    ------
    ModelError
        If a parameter has no value.
    LinearisationError
        If the element has no describing function.
    """
    df = element if isinstance(element, DescribingFunction) else _describe(element, values or {})
    numbers = _numbers(df, values or {})
    cases = [(mean, covariance, numbers) for mean, covariance in _grid(df, numbers, scale)]
    return check_at(df, cases, BUDGET[min(len(df.arguments), max(BUDGET))], scale)


Case = tuple[np.ndarray, np.ndarray, Mapping[sp.Symbol, float]]
"""Mean, covariance, and the numbers of what else is in a function."""


def check_at(df: DescribingFunction, cases: Sequence[Case], budget: int, scale: float = 1.0) -> ElementCheck:
    """Hold a describing function against adaptive integration for some means and covariances.

    A singular covariance, and one of more than three arguments, is taken on its principal axes, of the latter the first two.
    """
    free = parameters_of(df)
    function = element_function(df, free)
    rows, sure = [], [0.0]
    for k, (mean, whole, numbers) in enumerate(cases):
        root = _axes(whole)
        covariance = whole if root is None else root @ root.T
        known = {s: numbers[s] for s in free}
        at = mean, covariance[np.tril_indices(len(mean))], list(known.values())
        F, gain = (np.array(x).ravel() for x in function(*at))
        if not covariance.any():
            rows.append((*_without_variance(df, known, mean, F[0], scale), mean, covariance))
            continue
        section = (df, mean, covariance) if root is None else _on_axes(df, mean, root)
        own = gain if root is None else root.T @ gain
        truth = Truth.of(section[0], known, *section[1:], TOLERANCE[len(section[1])], budget // (len(cases) - k))
        budget -= truth.evaluations
        sure.append(truth.own)
        rows += [(*row, mean, covariance) for row in truth.compared(F, own)]
    _, _, found, integrated, mean, covariance = max(rows, key=lambda row: row[0])
    return ElementCheck(
        name=df.name or str(df.body),
        method=df.method,
        nodes=df.nodes,
        estimated=df.error,
        cases=len(cases),
        error=max(row[0] for row in rows if not row[1]),
        gain_error=max((row[0] for row in rows if row[1]), default=0.0),
        mean=tuple(float(m) for m in mean),
        covariance=tuple(tuple(float(c) for c in line) for line in covariance),
        found=float(found),
        integrated=float(integrated),
        sure=max(sure),
        unsettled=sum(own > SURE for own in sure),
    )


def _describe(element: Element, values: Mapping[str, float]) -> DescribingFunction:
    body = written_out(element.value, element.elements)
    known = {s: float(values[s.name]) for s in body.free_symbols if isinstance(s, sp.Symbol) and s.name in values}
    return describing_function(element.arguments, body, name=element.name, values=known)


def _numbers(df: DescribingFunction, values: Mapping[str, float]) -> dict[sp.Symbol, float]:
    free = sorted(df.body.free_symbols - set(df.arguments), key=str)
    missing = [str(s) for s in free if str(s) not in values]
    if missing:
        raise ModelError(f"the check of `{df.name or df.body}` needs numbers for its parameters: {', '.join(missing)}")
    return {s: float(values[str(s)]) for s in free if isinstance(s, sp.Symbol)}


def _kinks(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], argument: int) -> list[float]:
    found = {evaluate(k, numbers) for product in df.products for a, k in product.kinks() if a == argument}
    return sorted(k for k in found if np.isfinite(k))


def _grid(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], scale: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    count = len(df.arguments)
    points = [(_kinks(df, numbers, a) or [0.0])[:6] for a in range(count)]
    if count == 1:
        for spread in SPREADS:
            for point in points[0]:
                for place in PLACES:
                    s = spread * scale
                    yield np.array([point + place * (s or scale)]), np.array([[s * s]])
        return
    if count not in SEVERAL:  # on planes through the mean, which is as far as integration goes
        for spread in PLANES:
            s, angle = (spread or 1.0) * scale * (1 + 0.4 * np.arange(count)), np.arange(1, count + 1)
            root = np.sign(spread) * s * np.array([np.cos(angle), np.sin(angle)])
            yield s * np.linspace(0.5, -0.8, count), root.T @ root
        return
    for spread, rho in SEVERAL[count]:
        s = spread * scale * (1 + 0.4 * np.arange(count))
        correlation = rho ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
        mean = np.array([p[0] for p in points]) + (s if spread else scale) * np.linspace(0.5, -0.8, count)
        yield mean, correlation * np.outer(s, s)


def _axes(covariance: np.ndarray) -> np.ndarray | None:
    """Principal axes times their standard deviations, in columns; None where integration can do without."""
    s = np.sqrt(np.diag(covariance))
    unit = np.where(s > 0, s, 1.0)
    variances, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    kept = variances > SINGULAR * max(variances[-1], 0.0)
    many = len(s) > max(BUDGET)
    if not covariance.any() or (kept.all() and not many):
        return None if covariance.any() else np.zeros((len(s), 1))
    number = min(int(kept.sum()), MOST_AXES if many else len(s))
    return unit[:, None] * axes[:, -number:] * np.sqrt(variances[-number:])


def _on_axes(df: DescribingFunction, mean: np.ndarray, root: np.ndarray) -> tuple[DescribingFunction, np.ndarray, np.ndarray]:
    """A function on axes of its distribution, as one of as many independent arguments."""
    count = root.shape[1]
    e = sp.symbols(f"e1:{count + 1}", real=True, cls=sp.Dummy)
    exact = [[sp.Rational(float(x)) for x in row] for row in np.column_stack([mean, root])]
    points = (row[0] + sp.Add(*(a * z for a, z in zip(row[1:], e, strict=True))) for row in exact)
    body = df.body.xreplace(dict(zip(df.arguments, points, strict=True)))
    return replace(df, arguments=tuple(e), body=body), np.zeros(count), np.eye(count)


Row = tuple[float, bool, float, float]
"""An error, whether it is of a gain, what was found, what was integrated."""


def _without_variance(
    df: DescribingFunction, numbers: Mapping[sp.Symbol, float], mean: np.ndarray, found: float, scale: float
) -> Row:
    """At a jump the mean of its two sides is wanted; either side will do where rounding moves the mean off it."""
    ways = np.random.default_rng(0).normal(size=(WAYS, len(mean)))
    sides = np.array([_value(df, numbers, mean + side * BESIDE * (1 + np.abs(mean)) * ways) for side in (-1, 1)])
    likely = [float(_value(df, numbers, mean)), *sides.ravel().tolist(), *sides.mean(axis=0).tolist()]
    plain = min(likely, key=lambda value: abs(found - value))
    around = np.abs(_value(df, numbers, mean + scale * ways))
    error = abs(found - plain) / max(around.max(), 1e-300) if np.isfinite(found) else np.inf
    return float(error), False, found, plain


@dataclass(frozen=True)
class Truth:
    """E[f] and the gains by integration of f, each with the unit of its error and the error itself in that."""

    values: np.ndarray
    units: np.ndarray
    errors: np.ndarray
    evaluations: int

    @staticmethod
    def of(
        df: DescribingFunction,
        numbers: Mapping[sp.Symbol, float],
        mean: np.ndarray,
        covariance: np.ndarray,
        tolerance: float,
        most: int,
    ) -> Truth:
        """For one mean and covariance, in no more than so many evaluations.

        With Stein gain = S^-1 E[f (z - m)] = L^-T E[f e].
        """
        order = list(easiest_order(df.arguments, df.body))
        L = np.linalg.cholesky(covariance[np.ix_(order, order)])
        arguments = tuple(df.arguments[k] for k in order)
        found = integrate(arguments, df.body, numbers, mean[order], L, tolerance=tolerance, most=most)
        back = np.linalg.inv(L).T[np.argsort(order)]
        ways = np.array(list(product((-1, 0, 1), repeat=len(mean)))) @ L[np.argsort(order)].T
        far = [np.abs(_value(df, numbers, mean + times * ways)) for times, _ in BEYOND]  # hardly ever met
        least = [part * np.max(f, where=np.isfinite(f), initial=0.0) for f, (_, part) in zip(far, BEYOND, strict=True)]
        size = max(found.size, *least, NOTHING)
        units = np.array([size, *(size / np.sqrt(np.diag(covariance)))])
        errors = found.error * np.array([1.0, *np.linalg.norm(back, axis=1)])
        return Truth(np.array([found.value, *(back @ found.moments)]), units, errors / units, found.evaluations)

    @property
    def own(self) -> float:
        """The largest error of the integration itself."""
        return float(self.errors.max())

    def rows(self, F: np.ndarray, gain: np.ndarray) -> Iterator[tuple[float, float, float, float]]:
        """What was found, the truth, the unit of the error, and the truth's own error in that; E[f], then every gain."""
        yield from zip(map(float, (*F, *gain)), self.values, self.units, self.errors, strict=True)

    def compared(self, F: np.ndarray, gain: np.ndarray) -> Iterator[Row]:
        """What was found held against it."""
        for i, (found, wanted, unit, own) in enumerate(self.rows(F, gain)):
            error = abs(found - wanted) / unit if np.isfinite(found) else np.inf
            yield float(max(error - own, 0.0) if own > SURE else error), i > 0, found, float(wanted)


def _value(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], z: np.ndarray) -> np.ndarray:
    """f at points z, (..., arguments)."""
    at = dict(zip(df.arguments, np.moveaxis(z, -1, 0), strict=True))
    return np.broadcast_to(evaluate(df.body, {**numbers, **at}), z.shape[:-1])


def _listed(numbers: Any) -> str:
    if isinstance(numbers, tuple):
        return "(" + ", ".join(_listed(n) for n in numbers) + ")"
    return f"{numbers:.6g}"
