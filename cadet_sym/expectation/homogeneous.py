"""Find homogeneous functions of two arguments, where they have kinks and jumps, and how many nodes they need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import sympy as sp
from sympy.core.relational import Relational
from sympy.logic.boolalg import Boolean

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.algebra import NumpyAlgebra
from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.existence import require_expectation
from cadet_sym.expectation.pieces import Splitter
from cadet_sym.expectation.planar import Moments
from cadet_sym.expectation.polar import FIXED, NARROW, NEAR, Arc, Homogeneous, Layout, Node, Ray
from cadet_sym.expectation.quadrature import Rule, Wish
from cadet_sym.expectation.steep import singular_at, steep_places
from cadet_sym.language.numeric import evaluate

AXES = (sp.S.NegativeInfinity, sp.S.Zero, sp.S.Infinity)
MOST_ARCS = 8
MOST_POLES = 2  # of one arc
ORDERS = (16, 24, 32, 40)
FINEST = Rule(panels=4, order=48, straight=160, graded=80)
WANTED, WARNED = 1e-10, 1e-8
FLOOR = 1e-2  # of the largest E|f| at the same distance: what an error is relative to at least
LOST, NEARBY = 1e-6, 100.0  # error of gains that shows that a jump was not seen; deviations from the origin where it would
RATIOS = (1e-6, 1e-3, 0.03, 0.6, 1.8, 50.0, 1e6)  # of the standard deviations
FARTHER = ((6.5, 0.0), (-6.2, 1.8), (4.6, -4.6), (-1.8, -6.2), (0.0, -6.1))  # of independent ones: there arcs are longest
SHAPES = (  # correlation, means in standard deviations
    (0.0, (0.0, 0.0)),
    (0.3, (0.3, -0.2)),
    (0.5, (-1.6, 1.1)),
    (-0.95, (3.0, 3.5)),
    (0.999999, (-0.4, 0.9)),
    (0.0, (0.0, 6.0)),
    (0.7, (-9.0, 0.1)),
    (-0.5, (70.0, -40.0)),
    (0.3, (-2e4, 0.6)),
    (0.0, (-0.9, 1e4)),
    *((rho, (m, rho * m + np.sqrt(1 - rho * rho) * n)) for rho in (0.0, 0.999) for m, n in FARTHER),
)


def homogeneous(arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, wish: Wish) -> Homogeneous | None:
    """The function, if it is homogeneous in two arguments of a whole degree, smooth between rays, and integrated well so."""
    if len(used) != 2 or wish.plain:
        return None
    symbols = [arguments[i] for i in used]
    degree = degree_of(body, frozenset(symbols))
    if degree is None or not degree.is_Integer or degree < 0:
        return None
    found = []
    for outer, inner in (used, used[::-1]):
        try:
            candidate = _cut(outer, inner, (arguments[outer], arguments[inner]), body, int(degree))
        except (LinearisationError, NotImplementedError):  # angles that cannot be solved for: the rules for any function serve
            continue
        found += [] if candidate is None else [candidate]
    for candidate in sorted(found, key=lambda f: f.nodes):
        best = measured(candidate, wish)
        if best.error <= WARNED:
            return best
    return None


# -- the degree -------------------------------------------------------------------------------------------------------

ANY = sp.S.Infinity  # the degree of zero


def degree_of(expr: sp.Basic, symbols: frozenset[sp.Basic]) -> sp.Expr | None:
    """k of f(r z) = r^k f(z), r > 0; None if there is none, or it is not seen."""
    if expr in symbols:
        return sp.S.One
    if expr == 0:
        return ANY
    if not expr.free_symbols & symbols:
        return sp.S.Zero
    if isinstance(expr, sp.Pow):
        base, power = expr.args
        degree = degree_of(base, symbols)
        return None if degree is None or power.free_symbols & symbols else degree * power
    if isinstance(expr, sp.Piecewise):
        conditions = (degree_of(condition, symbols) for _, condition in expr.args)
        return None if None in conditions else _common(expr.args, symbols)
    degrees = [degree_of(argument, symbols) for argument in expr.args]
    if None in degrees:
        return None
    if isinstance(expr, sp.Mul):
        return sp.Add(*degrees)
    if isinstance(expr, sp.Abs):
        return degrees[0]
    if isinstance(expr, sp.Add | sp.Max | sp.Min):
        return _common([(argument,) for argument in expr.args], symbols)
    if isinstance(expr, Relational | sp.atan2):
        return None if _common([(argument,) for argument in expr.args], symbols) is None else sp.S.Zero
    if isinstance(expr, sp.sign | sp.Heaviside | Boolean):
        return sp.S.Zero
    return sp.S.Zero if all(degree == 0 for degree in degrees) else None


def _common(rows: list[tuple[sp.Basic, ...]], symbols: frozenset[sp.Basic]) -> sp.Expr | None:
    """The degree that the first of every row has."""
    degrees = {degree_of(row[0], symbols) for row in rows} - {ANY}
    if len(degrees) > 1:
        return None
    return degrees.pop() if degrees else ANY


# -- arcs and rays ----------------------------------------------------------------------------------------------------


def _cut(outer: int, inner: int, symbols: tuple[sp.Symbol, sp.Symbol], body: sp.Expr, degree: int) -> Homogeneous | None:
    arcs: list[Arc] = []
    rays: list[Ray] = []
    for side in (1, -1):
        half = list(_arcs(side, symbols, body))
        arcs += [arc for arc, _ in half]
        rays += _jumps(half, symbols[1])
    if any(len(arc.poles) > MOST_POLES for arc in arcs) or len(arcs) > MOST_ARCS:
        return None
    for sign in (1, -1):
        ahead, behind = (_limit(body, side, sign, symbols) for side in (1, -1))
        if (jump := normal(ahead - behind)) != 0:
            rays.append(Ray(1, sign * sp.S.Infinity, jump))
    return Homogeneous(outer, inner, body, symbols, degree, tuple(arc for arc in arcs if arc.value != 0), tuple(rays))


def _arcs(side: int, symbols: tuple[sp.Symbol, sp.Symbol], body: sp.Expr) -> Iterator[tuple[Arc, sp.Expr]]:
    """The half plane cut at the kinks of f(side, q), and that on every arc."""
    x, y = symbols
    splitter = Splitter(y, f"`{body}`")
    for cell, value in splitter.split(body.subs(x, side), Cell()):
        if cell.conditions:
            raise LinearisationError("where the kinks are depends on parameters")
        require_expectation(value, cell, splitter)
        ends = tuple(
            _is_singular_without(x, side, sign, symbols, body) if end.is_infinite else singular_at(value, y, end)
            for end, sign in ((cell.lower, -1), (cell.upper, 1))
        )
        if any(is_singular and end not in AXES for is_singular, end in zip(ends, (cell.lower, cell.upper), strict=True)):
            raise LinearisationError("singular across both arguments")
        poles = tuple(steep_places(value, y, Cell.between(cell.lower, cell.upper), (ends[0], ends[1])))
        here = _decided(body, cell, side, symbols)
        slopes = tuple(sp.diff(here, z).replace(sp.DiracDelta, lambda *_: sp.S.Zero) for z in symbols)
        if any(slope.has(sp.Derivative, sp.Subs) for slope in slopes):
            raise LinearisationError(f"`{body}` cannot be differentiated")
        yield Arc(side, cell.lower, cell.upper, here, (slopes[0], slopes[1]), poles, (ends[0], ends[1])), value


def _decided(body: sp.Expr, cell: Cell, side: int, symbols: tuple[sp.Symbol, sp.Symbol]) -> sp.Expr:
    """The function with no more kinks than it has on the arc, where these are seen."""
    low, high = cell.lower, cell.upper
    if not all(bound.is_number for bound in (low, high)):
        return body
    tangents = [float(sp.atan(bound)) for bound in (low, high)]
    point = {symbols[0]: float(side), symbols[1]: float(np.tan(sum(tangents) / 2 + 0.05 * (tangents[1] - tangents[0])))}

    def is_known(expr: sp.Basic) -> bool:
        return expr.free_symbols <= point.keys()

    body = body.replace(
        lambda e: isinstance(e, Relational) and is_known(e), lambda e: sp.sympify(bool(evaluate(e, point)))
    )
    body = body.replace(
        lambda e: isinstance(e, sp.sign | sp.Heaviside) and is_known(e), lambda e: sp.Rational(str(evaluate(e, point)))
    )
    body = body.replace(
        lambda e: isinstance(e, sp.Max | sp.Min) and is_known(e),
        lambda e: next(a for a in e.args if evaluate(a, point) == evaluate(e, point)),
    )
    body = body.replace(
        lambda e: isinstance(e, sp.Abs) and is_known(e), lambda e: e.args[0] * (1 if evaluate(e.args[0], point) > 0 else -1)
    )
    return body.replace(lambda e: isinstance(e, sp.atan), _whole_angle)


def _whole_angle(half: sp.Expr) -> sp.Expr:
    """atan(p/(q +- r)), r^2 = p^2 + q^2, as atan(p/q)/2, whose derivatives are shorter: q is not zero within an arc."""
    p, denominator = sp.fraction(sp.together(half.args[0]))
    roots = [term for term in sp.Add.make_args(denominator) if term.has(sp.Pow) and not term.is_polynomial()]
    if len(roots) != 1:
        return half
    q = denominator - roots[0]
    return sp.atan(p / q) / 2 if sp.expand(roots[0] ** 2 - p**2 - q**2) == 0 else half


def _is_singular_without(
    x: sp.Symbol, side: int, sign: int, symbols: tuple[sp.Symbol, sp.Symbol], body: sp.Expr
) -> bool:
    distance = sp.Dummy("x", positive=True)

    def finite(w: sp.Expr) -> sp.Expr:
        return w if w.subs(distance, 0).is_finite else 1 / w  # atan(w) + atan(1/w) = +-pi/2

    value = body.subs(dict(zip(symbols, (side * distance, sp.Integer(sign)), strict=True)))
    return singular_at(value.replace(sp.atan, finite), distance, sp.S.Zero)


def _jumps(half: list[tuple[Arc, sp.Expr]], q: sp.Symbol) -> Iterator[Ray]:
    """Rays within a half plane across which the function jumps."""
    for position in dict.fromkeys(arc.upper for arc, _ in half if not arc.upper.is_infinite):
        above, below = ([pair for pair in half if getattr(pair[0], end) == position] for end in ("lower", "upper"))
        if len(above) != 1 or len(below) != 1:
            raise LinearisationError("kinks in no known order")
        jump = normal(_one_sided(above[0][1], q, position, "+") - _one_sided(below[0][1], q, position, "-"))
        if jump != 0:
            yield Ray(above[0][0].side, position, jump)


def _limit(body: sp.Expr, side: int, sign: int, symbols: tuple[sp.Symbol, sp.Symbol]) -> sp.Expr:
    """f(0 from one side, +-1)."""
    distance = sp.Dummy("x", positive=True)
    value = body.subs(dict(zip(symbols, (side * distance, sp.Integer(sign)), strict=True)))
    cells = Splitter(distance, f"`{body}`").split(value, Cell((sp.S.Zero,)))
    near = [value for cell, value in cells if cell.lower == 0]
    if len(near) != 1:
        raise LinearisationError("kinks in no known order")
    return _one_sided(near[0], distance, sp.S.Zero, "+")


def _one_sided(value: sp.Expr, z: sp.Symbol, position: sp.Expr, side: str) -> sp.Expr:
    found = value.subs(z, position)
    if found.has(sp.nan, sp.zoo, sp.oo, sp.AccumBounds):
        found = sp.limit(value, z, position, side)
    if not found.is_finite and found.is_number:
        raise LinearisationError(f"`{value}` is infinite")
    return found


# -- accuracy ---------------------------------------------------------------------------------------------------------


def measured(function: Homogeneous, wish: Wish) -> Homogeneous:
    """The function with the smallest order that is accurate enough over a grid of moments, and the error found there."""
    cases = _Cases(function, wish.sample)
    found = replace(function, error=np.inf)
    if cases.lost() > LOST:
        return found
    for order in ORDERS:
        rule = Rule(order=order, straight=order, graded=order + 8)
        error = cases.error(rule)
        if error < found.error:
            found = replace(function, rule=rule, error=error)
        if error <= WANTED:
            break
    return found


def error_of(function: Homogeneous, sample: Mapping[sp.Symbol, float]) -> float:
    """The error of the rules that a function has, for other numbers of the parameters."""
    return _Cases(function, sample).error(function.rule)


def with_one_rule(function: Homogeneous, sample: Mapping[sp.Symbol, float]) -> Homogeneous:
    """The function with the same nodes always, and its error for moments with no pole very near to the line."""
    fixed = replace(function, rule=FIXED, fixed=True)
    return replace(fixed, error=_Cases(fixed, sample).error(fixed.rule))


class _Cases:
    """Moments on a grid, and accurate expectations there, against which rules are held."""

    def __init__(self, function: Homogeneous, sample: Mapping[sp.Symbol, float]):
        self.function, self.narrow_errors = function, np.empty(0)
        self.numbers = {s: float(sample.get(s, 1.0)) for s in function.free}
        rows = [(ratio, rho, *mean) for ratio, (rho, mean) in product(RATIOS, SHAPES)]
        ratio, rho, m, mean = np.array(rows).T
        s, spread = np.sqrt(ratio), 1 / np.sqrt(ratio)
        self.at = Moments(m * s, s, mean * spread, rho * spread, spread * np.sqrt(1 - rho * rho), spread)
        *self.reference, size = self.sums(FINEST)
        radius = ((m * m + 1) * s * s + (mean * mean + 1) * spread * spread) ** (function.degree / 2)
        size = size + FLOOR * np.max(size / radius) * radius
        self.scale = np.array([np.ones_like(s), s, spread]) / size
        self.narrow = self._layout(function).nearest() < NEAR

    def error(self, rule: Rule) -> float:
        """The largest error, relative to E|f|, of E[f] and of the gains times standard deviations."""
        errors = self.errors(rule)
        if not self.function.fixed:
            self.narrow_errors = self.narrow_errors if self.narrow_errors.size else self.errors(NARROW)
            errors = np.where(self.narrow, self.narrow_errors, errors)
        worst = float(np.max(errors, where=~(self.narrow & self.function.fixed), initial=0.0))
        return worst if np.isfinite(worst) else np.inf

    def errors(self, rule: Rule) -> np.ndarray:
        """The same case by case."""
        with np.errstate(all="ignore"):
            return np.max(np.abs(self.sums(rule)[:3] - self.reference) * self.scale, axis=0)

    def sums(self, rule: Rule) -> np.ndarray:
        """E[f], the gains and E|f|, (4, cases)."""
        layout, total = self._layout(replace(self.function, rule=rule)), np.zeros((4, self.at.m.size))
        with np.errstate(all="ignore"):
            for _, node in self._nodes(layout):
                total += [np.sum(term, axis=0) for term in node.sums()]
            across, along = layout.jumps()
        total[1] += across
        total[2] += along
        return total

    def lost(self) -> float:
        """By how much the gains are not those that E[f (z - m)] gives: what a jump would that was not seen."""
        layout, gains, frame = self._layout(replace(self.function, rule=FINEST)), np.zeros((2, self.at.m.size)), None
        with np.errstate(all="ignore"):
            for side, node in self._nodes(layout):
                at, frame = layout.at[side], layout.frames[side]
                first, second = (np.sum(term, axis=0) for term in node.by_density())
                gains += [side * (first - at.lean / at.left * second) / at.s, second / at.left]
            errors = np.abs(gains - self.reference[1:]) * self.scale[1:]
        near = frame is not None and frame.d < NEARBY
        return float(np.max(errors, where=near & np.isfinite(errors), initial=0.0))

    def _nodes(self, layout: Layout) -> Iterator[tuple[int, Node]]:
        xp = NumpyAlgebra()
        for arc in self.function.arcs:
            for piece in layout.pieces(arc):
                for panel in piece.panels:
                    nodes = panel.nodes(xp.column(panel.rule[0]), xp.column(panel.rule[1]), xp)
                    frame = layout.frames[arc.side]
                    yield arc.side, Node(self.function, arc, piece, frame, nodes, self._evaluate, xp, more=2)

    def _layout(self, function: Homogeneous) -> Layout:
        with np.errstate(all="ignore"):
            return Layout(function, self.at, self._evaluate, NumpyAlgebra())

    def _evaluate(self, exprs: Sequence[sp.Expr], known: Mapping[sp.Symbol, np.ndarray]) -> list[np.ndarray | float]:
        return [evaluate(expr, {**self.numbers, **known}) for expr in exprs]
