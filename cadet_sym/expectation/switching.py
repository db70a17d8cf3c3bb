"""Find which functions of two arguments are polynomials on either side of conics, and how accurate their integrals are."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.algebra import NumpyAlgebra
from cadet_sym.expectation.cells import Cell, Partition
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.panels import legendre
from cadet_sym.expectation.pieces import Splitter
from cadet_sym.expectation.planar import Moments
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.switched import (
    ORDERS,
    Border,
    Region,
    Row,
    Sums,
    Switched,
    around,
    courses_of,
    order_index,
    side_points,
)
from cadet_sym.language.kinks import switching_functions
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.vocabulary import Lookup

MOST_LEVELS, MOST_DEGREE = 6, 8
WANTED, WARNED = 5e-10, 1e-8
FINER = (1.0, 1.25, 1.5, 2.0)
FINEST = 240  # nodes of a side of the reference
SPREADS = (0.1, 1.0, 10.0)  # of the moments at which the error is estimated
SHAPES = (  # ratio of the standard deviations, correlation, means in standard deviations
    (1.8, 0.0, (-1.6, 1.1)),
    (0.5, 0.5, (0.0, 0.0)),
    (2.0, -0.95, (0.6, -0.9)),
    (1.0, 0.999999, (-0.4, 0.9)),
    (3.0, 0.3, (1.3, 2.4)),
    (0.4, -0.2, (-3.0, -1.5)),
)
FLOOR = 1e-3  # of the polynomials themselves: what an error is relative to at least


def switched(arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, wish: Wish) -> Switched | None:
    """The function, if it is a polynomial on either side of level lines of one quadratic form, perhaps with a linear one."""
    if len(used) != 2 or wish.plain or body.has(Lookup):
        return None
    symbols = arguments[used[0]], arguments[used[1]]
    form = _form(body, symbols)
    canonical = None if form is None else _canonical(form, symbols)
    if form is None or canonical is None:
        return None
    level = sp.Dummy("G", real=True)
    try:
        cells = Splitter(level, f"`{body}`").split(_in_levels(body, symbols, form, level), Cell())
    except LinearisationError:
        return None
    if any(expr.has(*symbols) for cell, _ in cells for expr in (cell.lower, cell.upper, *cell.conditions)):
        return None
    values = [(cell, value.subs(level, form)) for cell, value in cells]
    if not all(value.is_polynomial(*symbols) and sp.total_degree(value, *symbols) <= MOST_DEGREE for _, value in values):
        return None
    candidate = _assembled((used[0], used[1]), symbols, body, canonical, values)
    if candidate is None:
        return None
    for finer in FINER:
        candidate = replace(candidate, finer=finer)
        candidate = replace(candidate, error=error_of(candidate, wish.sample))
        if candidate.error <= WANTED:
            break
    return candidate if candidate.error <= WARNED else None


# -- the quadratic form -----------------------------------------------------------------------------------------------


def _form(body: sp.Expr, symbols: tuple[sp.Symbol, sp.Symbol]) -> sp.Expr | None:
    """The quadratic and the linear part, a leading coefficient one, of what the function switches by."""
    x, y = symbols
    for expr in dict.fromkeys(e for z in symbols for e in switching_functions(body, z)):
        if not expr.is_polynomial(x, y) or sp.total_degree(expr, x, y) != 2:
            continue
        terms = sp.Poly(expr, x, y).as_dict()
        lead = terms[_leading(terms)]
        return sp.Add(*(sp.cancel(c / lead) * x**i * y**j for (i, j), c in terms.items() if i + j))
    return None


def _leading(terms: Mapping[tuple[int, int], sp.Expr]) -> tuple[int, int]:
    """The powers of the first quadratic term, or of the first linear one where that alone has a number."""
    present = [powers for powers in ((2, 0), (1, 1), (0, 2), (1, 0), (0, 1)) if powers in terms]
    return next((powers for powers in present if terms[powers].is_number), present[0])


def _in_levels(body: sp.Expr, symbols: tuple[sp.Symbol, sp.Symbol], form: sp.Expr, level: sp.Symbol) -> sp.Expr:
    """The function with the form, where it stands in switches, written as one symbol."""
    x, y = symbols
    lead = _leading(sp.Poly(form, x, y).as_dict())

    def written(expr: sp.Expr) -> sp.Expr:
        if not expr.is_polynomial(x, y):
            return expr
        factor = sp.Poly(expr, x, y).coeff_monomial(x ** lead[0] * y ** lead[1])
        return sp.expand(expr - factor * form) + factor * level

    def switches(expr: sp.Basic) -> sp.Basic:
        if isinstance(expr, Relational):
            return expr.func(written(expr.lhs - expr.rhs), 0)
        return expr.func(*(written(a) for a in expr.args))

    kinds = (sp.Abs, sp.sign, sp.Heaviside, sp.Max, sp.Min, Relational)
    return body.replace(lambda e: isinstance(e, kinds) and e.has(x, y), switches)


@dataclass(frozen=True)
class _Canonical:
    """The form as a parabola, hyperbola or circle in p and q, and the arguments in these."""

    kind: str
    forms: tuple[tuple[sp.Expr, sp.Expr, sp.Expr], ...]
    coordinates: tuple[sp.Symbol, sp.Symbol]
    arguments: dict[sp.Symbol, sp.Expr]
    shape: tuple[sp.Expr, ...]  # of the level `LEVEL`
    is_left: bool  # whether the form is greater on the left hand


LEVEL = sp.Dummy("level", real=True)


def _canonical(form: sp.Expr, symbols: tuple[sp.Symbol, sp.Symbol]) -> _Canonical | None:
    x, y = symbols
    terms = sp.Poly(form, x, y).as_dict()
    a, b, c, d, e = (terms.get(k, sp.S.Zero) for k in ((2, 0), (1, 1), (0, 2), (1, 0), (0, 1)))
    scale = next(number for number in (a, b, c) if number != 0)
    a, b, c = (sp.cancel(number / scale) for number in (a, b, c))
    if not all(number.is_Rational for number in (a, b, c)):
        return None
    if b * b == 4 * a * c:
        return _parabola(form, symbols, (a, b, c))
    if scale != 1:
        return None
    discriminant = b * b - 4 * a * c
    centre = (2 * c * d - b * e) / discriminant, (2 * a * e - b * d) / discriminant
    above = normal(form.subs({x: x + centre[0], y: y + centre[1]}, simultaneous=True)).subs({x: 0, y: 0})
    level = sp.expand(LEVEL - above)
    if discriminant > 0:
        root = sp.sqrt(discriminant)
        rows = ((a, (b + root) / 2), (1, (b - root) / (2 * a))) if a != 0 else ((b, c), (0, 1)) if c != 0 else ((b, 0), (0, 1))
        return _made("hyperbola", rows, centre, symbols, (level,), True)
    scale = sp.sqrt(-discriminant) / (2 * a)
    rows = (1, b / (2 * a)), (0, scale)
    return _made("circle", rows, centre, symbols, (sp.expand(level / a),), bool(a < 0))


def _made(kind, rows, centre, symbols, shape, is_left) -> _Canonical:
    p, q = sp.symbols("p q", real=True, cls=sp.Dummy)
    forms = tuple((u, v, sp.expand(-u * centre[0] - v * centre[1])) for u, v in (map(sp.sympify, row) for row in rows))
    solved = sp.Matrix([form[:2] for form in forms]).inv() * sp.Matrix([p - forms[0][2], q - forms[1][2]])
    arguments = dict(zip(symbols, map(sp.expand, solved), strict=True))
    return _Canonical(kind, forms, (p, q), arguments, shape, is_left)


def _parabola(
    form: sp.Expr, symbols: tuple[sp.Symbol, sp.Symbol], quadratic: tuple[sp.Expr, sp.Expr, sp.Expr]
) -> _Canonical | None:
    a, b, _ = quadratic
    rows = ((1, b / (2 * a)), (0, 1)) if a != 0 else ((0, 1), (1, 0))
    found = _made("parabola", rows, (0, 0), symbols, (), True)
    p, q = found.coordinates
    there = sp.Poly(sp.expand(form.subs(found.arguments, simultaneous=True)), p, q)
    across = there.coeff_monomial(q)
    if not (across.is_number and across != 0):
        return None
    shape = tuple(sp.cancel(e / across) for e in (-there.coeff_monomial(p**2), -there.coeff_monomial(p), LEVEL))
    return replace(found, shape=shape, is_left=bool(across > 0))


def _assembled(
    used: tuple[int, int], symbols: tuple[sp.Symbol, sp.Symbol], body: sp.Expr, canonical: _Canonical, cells: Partition
) -> Switched | None:
    regions, changes = [], defaultdict(lambda: sp.S.Zero)
    positions = list(dict.fromkeys(end for cell, _ in cells for end in (cell.lower, cell.upper) if not end.is_infinite))
    hand = 1 if canonical.is_left else -1
    for cell, value in cells:
        inside = cell.indicated(sp.expand(value.subs(canonical.arguments, simultaneous=True)))
        ends = [(end, sign) for end, sign in ((cell.lower, hand), (cell.upper, -hand)) if not end.is_infinite]
        if value != 0:
            regions.append(Region(inside, tuple((positions.index(end), sign) for end, sign in ends)))
        for end, sign in ends:
            changes[end] += sign * inside
    if len(positions) > MOST_LEVELS or not positions:
        return None
    p, q = canonical.coordinates
    borders = tuple(
        Border(canonical.kind, tuple(e.subs(LEVEL, end) for e in canonical.shape), _collected(changes[end], p, q))
        for end in positions
    )
    regions = [replace(region, value=_collected(region.value, p, q)) for region in regions]
    return Switched(*used, body, symbols, canonical.forms, (p, q), tuple(regions), borders)


def _collected(value: sp.Expr, p: sp.Symbol, q: sp.Symbol) -> sp.Expr:
    """Polynomials under conditions on parameters as one polynomial with such coefficients."""
    total: dict[tuple[int, int], sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for term in sp.Add.make_args(value):
        sign, rest = term.as_coeff_Mul()
        (inside, condition), *_ = rest.args if isinstance(rest, sp.Piecewise) else ((rest, sp.true),)
        for powers, c in sp.Poly(sign * inside, p, q).as_dict().items():
            total[powers] += c if condition == sp.true else sp.Piecewise((c, condition), (0, True), evaluate=False)
    return sp.Add(*(c * p**i * q**j for (i, j), c in total.items()))


# -- accuracy ---------------------------------------------------------------------------------------------------------


def with_order(function: Switched, order: int, sample: Mapping[sp.Symbol, float]) -> Switched:
    """The function with the same number of nodes always, and its error for moments of the order of its own scale."""
    fixed = replace(function, order=order)
    return replace(fixed, error=error_of(fixed, sample, SPREADS[:-1]))


def error_of(function: Switched, sample: Mapping[sp.Symbol, float], spreads: Sequence[float] = SPREADS) -> float:
    """The largest error over a grid of moments, relative to E|f|, of E[f] and of the gains."""
    free = function.free.union(*(e.free_symbols for form in function.forms for e in form))
    numbers = {s: float(sample.get(s, 1.0)) for s in free}
    grid = [(spread, *shape) for spread, shape in product(spreads, SHAPES)]
    spread, ratio, rho = (np.array([case[k] for case in grid]) for k in range(3))
    mean = np.array([case[3] for case in grid]).T
    s, sq = spread * np.sqrt(ratio), spread / np.sqrt(ratio)
    at = Moments(mean[0] * s, s, mean[1] * sq, rho * sq, sq * np.sqrt(1 - rho * rho), sq)
    reference, size = sums(function, function.rows(), at, numbers, FINEST)
    found, _ = sums(function, function.rows(), at, numbers, function.order)
    units = np.array([np.ones_like(s), s, sq])
    with np.errstate(all="ignore"):
        errors = np.abs(found - reference) * units / size
    return float(np.max(errors)) if np.all(np.isfinite(errors)) else np.inf


def sums(
    function: Switched, rows: Sequence[Row], at: Moments, numbers: Mapping[sp.Symbol, float], order: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """The rows, and the size of the polynomials; with so many nodes on every side, or as many as it takes."""
    xp = NumpyAlgebra()

    def valued(exprs: Sequence[sp.Expr], known: Mapping[sp.Symbol, np.ndarray]) -> list[np.ndarray | float]:
        return [evaluate(expr, {**numbers, **known}) for expr in exprs]

    with np.errstate(all="ignore"):
        courses = [courses_of(border, at, valued, xp) for border in function.borders]
        total = np.array([t + 0 * at.m for t in around(function, rows, at, [own[0] for own in courses], valued, xp)])
        for border, own in zip(function.borders, courses, strict=True):
            known = Sums(function, border, rows, valued, xp)
            shared = known.coefficients(at)
            for course, side in ((each, side) for each in own for side in each.sides):
                index = np.asarray(order_index(side, function.finer, xp)).astype(int)
                orders = np.full_like(index, order) if order else np.array(ORDERS)[index]
                for count in np.unique(orders):
                    t, w = (xp.column(x) for x in legendre(int(count)))
                    point, weight = side_points(border, course.numbers, side.numbers, t, w, xp)
                    added = known.terms(at, shared, point, weight * course.there)
                    on = orders == count
                    for row, term in enumerate(added):
                        total[row] += np.where(on, np.sum(np.broadcast_to(term, (t.size, on.size)), axis=0), 0.0)
    return total, _size(function, at, valued)


def _size(function: Switched, at: Moments, valued) -> np.ndarray:
    """E|f| by samples of the plane, no less than a part of E of the polynomials' sizes."""
    u = np.linspace(-4, 4, 33)[:, None, None]
    v = u.reshape(1, -1, 1)
    p, q = at.m + at.s * u, at.mean + at.lean * u + at.left * v
    density = np.exp(-(u * u + v * v) / 2)
    density = density / density.sum()
    coordinates = dict(zip(function.coordinates, (p, q), strict=True))
    x = _arguments_at(function, p, q, valued)
    own = np.sum(density * np.abs(valued((function.value,), x)[0]), axis=(0, 1))
    every = sum(np.sum(density * np.abs(valued((region.value,), coordinates)[0]), axis=(0, 1)) for region in function.regions)
    return np.maximum(own, FLOOR * every)


def _arguments_at(function: Switched, p: np.ndarray, q: np.ndarray, valued) -> dict[sp.Symbol, np.ndarray]:
    (a, b, e), (c, d, f) = (valued(form, {}) for form in function.forms)
    p, q, size = p - e, q - f, a * d - b * c
    return dict(zip(function.symbols, ((d * p - b * q) / size, (a * q - c * p) / size), strict=True))
