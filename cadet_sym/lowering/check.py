"""Hold a describing function against adaptive integration of the nonlinearity itself, over a grid of means and variances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.expectation.describing import DescribingFunction, describing_function
from cadet_sym.expectation.quadrature import legendre
from cadet_sym.language.element import Element
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import ElementCall
from cadet_sym.lowering.elements import element_function

SPREADS = (0.0, 1e-3, 0.1, 1.0, 10.0)  # standard deviations, times the scale
PLACES = (-3.0, -0.7, 0.0, 1.0, 4.0)  # of the mean about a kink, in standard deviations
SEVERAL_SPREADS = (0.3, 1.0)
CORRELATIONS = (-0.95, 0.0, 0.5)
REACH = 9.0
GRADED = (0.0, *(10.0**-k for k in range(1, 9)))  # about the middle of a function, in standard deviations
TOLERANCE = {1: 1e-11, 2: 1e-10, 3: 1e-8}  # asked of the adaptive integration
INSIDE_ORDER = {1: 20, 2: 20, 3: 12}  # nodes a panel of the integrals inside the adaptive one
PANELS = (-REACH, -6.0, -3.0, 0.0, 3.0, 6.0, REACH)
BESIDE = 1e-12
BESIDE_KINKS = (-0.2, -0.01, 0.0, 0.01, 0.2)  # also split there, for powers that are no integers


@dataclass(frozen=True)
class ElementCheck:
    """What a check found, and where the worst was.

    Errors are relative to E|f|, of gains to E|f| over the standard deviation, without variance to |f| around the mean.
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

    def __str__(self) -> str:
        nodes = f", {self.nodes} nodes, {self.estimated:.0e} estimated" if self.nodes else ""
        return "\n    ".join([f"{self.name}: {self.method}{nodes}", *self.findings()])

    def findings(self) -> tuple[str, str]:
        """The largest errors and the worst place, in a line each."""
        return (
            f"{self.cases} cases against adaptive integration: largest error {self.error:.1e} in E[f], "
            f"{self.gain_error:.1e} in the gain",
            f"worst at mean {_listed(self.mean)}, covariance {_listed(self.covariance)}: "
            f"{self.found:.12g}, integrated {self.integrated:.12g}",
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
    function = element_function(df, tuple(numbers))
    rows = []
    for mean, covariance in _grid(df, numbers, scale):
        F, gain = (np.array(x).ravel() for x in function(mean, covariance[np.tril_indices(len(mean))], list(numbers.values())))
        rows += [(*row, mean, covariance) for row in _compared(df, numbers, mean, covariance, F, gain, scale)]
    worst = max(rows, key=lambda row: row[0])
    _, _, found, integrated, mean, covariance = worst
    return ElementCheck(
        name=df.name or str(df.body),
        method=df.method,
        nodes=df.nodes,
        estimated=df.error,
        cases=len({(tuple(row[4]), row[5].tobytes()) for row in rows}),
        error=max(row[0] for row in rows if not row[1]),
        gain_error=max((row[0] for row in rows if row[1]), default=0.0),
        mean=tuple(float(m) for m in mean),
        covariance=tuple(tuple(float(c) for c in line) for line in covariance),
        found=float(found),
        integrated=float(integrated),
    )


def _describe(element: Element, values: Mapping[str, float]) -> DescribingFunction:
    body = written_out(element)
    known = {s: float(values[s.name]) for s in body.free_symbols if isinstance(s, sp.Symbol) and s.name in values}
    return describing_function(element.arguments, body, name=element.name, values=known)


def written_out(element: Element) -> sp.Expr:
    """The value of an element with the elements that it calls written out."""
    known = {e.name: e for e in element.elements}
    body = element.value
    while calls := body.atoms(ElementCall):
        table = {}
        for call in calls:
            called = known[call.name]
            known |= {e.name: e for e in called.elements}
            table[call] = called.value.xreplace(dict(zip(called.arguments, call.arguments, strict=True)))
        body = body.xreplace(table)
    return body


def _numbers(df: DescribingFunction, values: Mapping[str, float]) -> dict[sp.Symbol, float]:
    free = sorted(df.body.free_symbols - set(df.arguments), key=str)
    missing = [str(s) for s in free if str(s) not in values]
    if missing:
        raise ModelError(f"the check of `{df.name or df.body}` needs numbers for its parameters: {', '.join(missing)}")
    return {s: float(values[str(s)]) for s in free if isinstance(s, sp.Symbol)}


def _kinks(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], argument: int) -> list[float]:
    found = {evaluate(k, numbers) for product in df.products for a, k in product.kinks() if a == argument}
    return sorted(k for k in found if np.isfinite(k))


def _centres(df: DescribingFunction, numbers: Mapping[sp.Symbol, float]) -> list[float]:
    """Where functions of the first argument alone, however steep, have their middle: zeros of what stands in them."""
    z, found = df.arguments[0], set()
    for node in df.body.atoms(sp.Function, sp.Pow):
        for inner in node.args:
            if isinstance(inner, sp.Expr) and inner.has(z) and not inner.has(*df.arguments[1:]) and inner.is_polynomial(z):
                polynomial = sp.Poly(inner.xreplace({s: sp.Float(v) for s, v in numbers.items()}), z)
                found |= {float(root.real) for root in np.roots([float(c) for c in polynomial.all_coeffs()])}
    return sorted(found)[:4]


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
    for spread in SEVERAL_SPREADS:
        for rho in CORRELATIONS:
            s = spread * scale * (1 + 0.4 * np.arange(count))
            correlation = rho ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
            mean = np.array([p[0] for p in points]) + s * np.linspace(0.5, -0.8, count)
            yield mean, correlation * np.outer(s, s)


def _compared(
    df: DescribingFunction,
    numbers: Mapping[sp.Symbol, float],
    mean: np.ndarray,
    covariance: np.ndarray,
    F: np.ndarray,
    gain: np.ndarray,
    scale: float,
) -> Iterator[tuple[float, bool, float, float]]:
    """(error, whether it is of a gain, found, integrated) of E[f] and every gain."""
    if not covariance.any():
        beside = BESIDE * (1 + np.abs(mean))  # at a jump, the mean of its two sides
        plain = float(_value(df, numbers, mean - beside) + _value(df, numbers, mean + beside)) / 2
        around = np.abs([_value(df, numbers, mean + side * scale) for side in (-1, 0, 1)])
        yield abs(F[0] - plain) / max(around.max(), 1e-300), False, F[0], plain
        return
    L = np.linalg.cholesky(covariance)
    integrals = _integrated(df, numbers, mean, L)
    size = max(integrals[-1], 1e-300)
    yield abs(F[0] - integrals[0]) / size, False, F[0], integrals[0]
    # Stein: gain = S^-1 E[f (z - m)] = L^-T E[f e]
    slopes = np.linalg.solve(L.T, integrals[1:-1])
    unit = size / np.sqrt(np.diag(covariance))
    for found, wanted, one in zip(gain, slopes, unit, strict=True):
        yield abs(found - wanted) / one, True, found, wanted


def _value(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], z: np.ndarray) -> np.ndarray:
    """f at points z, (..., arguments)."""
    at = dict(zip(df.arguments, np.moveaxis(z, -1, 0), strict=True))
    return np.broadcast_to(evaluate(df.body, {**numbers, **at}), z.shape[:-1])


def _integrated(df: DescribingFunction, numbers: Mapping[sp.Symbol, float], mean: np.ndarray, L: np.ndarray) -> np.ndarray:
    """E[f], E[f e_1], .., E|f| over independent standard normal e, z = m + L e.

    Adaptive over the first, split at kinks over all.
    """
    from scipy.integrate import cubature

    count = len(mean)
    kinks = [np.array(_kinks(df, numbers, a)) for a in range(count)]

    def inside(e: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sums over the arguments that are left; e (points, .., arguments so far), weight (points, ..)."""
        a = e.shape[-1]
        if a == count:
            f = _value(df, numbers, mean + e @ L.T) * weight
            integrands = [f, *(f * e[..., i] for i in range(count)), np.abs(f)]
            return np.stack([each.reshape(len(e), -1).sum(axis=1) for each in integrands], axis=1)
        x, w = _panels((kinks[a] - (mean[a] + e @ L[a, :a])[..., None]) / L[a, a], INSIDE_ORDER[count])
        wider = np.broadcast_to(e[..., None, :], (*x.shape, a))
        return inside(np.concatenate([wider, x[..., None]], axis=-1), weight[..., None] * w)

    def integrand(first: np.ndarray) -> np.ndarray:
        return inside(first, np.exp(-first[:, 0] ** 2 / 2) / np.sqrt(2 * np.pi))

    middles = [(c - mean[0]) / L[0, 0] for c in _centres(df, numbers)]
    steep = [middle + side * distance for middle in middles for side in (-1, 1) for distance in GRADED]
    breaks = sorted({k for k in (*(kinks[0] - mean[0]) / L[0, 0], *steep) if abs(k) < REACH} | set(PANELS))
    parts = [
        cubature(integrand, [low], [high], rule="gk21", atol=1e-15, rtol=TOLERANCE[count], max_subdivisions=400).estimate
        for low, high in pairwise(breaks)
    ]
    return np.sum(parts, axis=0)


def _panels(kinks: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights times the normal density, on panels split at kinks; (..., kinks) -> (..., nodes)."""
    fixed = np.broadcast_to(np.array(PANELS), (*kinks.shape[:-1], len(PANELS)))
    about = (kinks[..., None] + np.array(BESIDE_KINKS)).reshape(*kinks.shape[:-1], -1)
    edges = np.sort(np.concatenate([fixed, np.clip(about, -REACH, REACH)], axis=-1), axis=-1)
    nodes, weights = legendre(order)
    lengths = np.diff(edges, axis=-1)[..., None]
    x = (edges[..., :-1, None] + lengths * nodes).reshape(*edges.shape[:-1], -1)
    w = (lengths * weights).reshape(x.shape)
    return x, w * np.exp(-x * x / 2) / np.sqrt(2 * np.pi)


def _listed(numbers: Any) -> str:
    if isinstance(numbers, tuple):
        return "(" + ", ".join(_listed(n) for n in numbers) + ")"
    return f"{numbers:.6g}"
