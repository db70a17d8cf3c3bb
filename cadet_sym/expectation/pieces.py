"""Cut a function of one variable at its kinks: a partition of the line with a smooth expression on each cell."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.relational import Relational
from sympy.logic.boolalg import Boolean, BooleanFalse, BooleanTrue

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.cells import Cell, Partition
from cadet_sym.language.curve import curve_pieces
from cadet_sym.language.vocabulary import Lookup

MAX_PIECES = 4096
SAME = 1e-12  # relative difference of points that are one
TINY = sp.Rational(1, 10**200)  # what stands under the root of two zeros at least, where they may not exist


def _sign_of(difference: sp.Expr) -> int | None:
    """Sign of an expression free of the variable, if it is known."""
    if difference.is_zero:
        return 0
    if difference.is_positive:
        return 1
    if difference.is_negative:
        return -1
    return None


Range = tuple[sp.Expr, sp.Expr]
"""Between which two bounds a variable is."""


def _sign_within(expr: sp.Expr, ranges: Mapping[sp.Symbol, Range]) -> int | None:
    """Sign of a polynomial in one variable that has no root within that one's range, if that is seen."""
    free = expr.free_symbols & ranges.keys()
    if len(free) != 1 or not expr.is_polynomial(*free):
        return None
    (z,) = free
    coefficients = sp.Poly(expr, z).all_coeffs()
    if all(each.is_number for each in (*coefficients, *ranges[z])):
        return _sign_between(np.array(coefficients, dtype=float), *map(float, ranges[z]))
    if len(coefficients) != 3 or not coefficients[0].is_number:
        return None
    a, b, _ = coefficients
    low, high = ranges[z]
    ends = [end for end in (low, high) if not end.is_infinite]
    if not ends or any(sp.expand(expr.subs(z, end)) != 0 for end in ends):
        return None
    if len(ends) == 2:  # both roots
        return -int(sp.sign(a))
    beyond = (low + b / a + low) if high.is_infinite else -(b / a + high + high)  # from the other root
    return int(sp.sign(a)) if beyond.is_nonnegative else None


def _sign_between(coefficients: np.ndarray, low: float, high: float) -> int | None:
    roots = np.roots(coefficients)
    own = roots.real[np.abs(roots.imag) < SAME * (1 + np.abs(roots))]
    near = SAME * (1 + np.abs(own))
    if ((own > low + near) & (own < high - near)).any():
        return None
    inside = (low + high) / 2 if np.isfinite(low) and np.isfinite(high) else low + 1 if np.isfinite(low) else high - 1
    return int(np.sign(np.polyval(coefficients, inside if np.isfinite(inside) else 0.0)))


@dataclass
class Splitter:
    """Cuts expressions in one variable; one method a kind of expression."""

    z: sp.Symbol
    where: str
    outside: Mapping[sp.Symbol, Range] = field(default_factory=dict)  # of other variables
    solved: dict[tuple[sp.Expr, Cell], list[tuple[Cell, int]]] = field(default_factory=dict)

    def terms(self, body: sp.Expr) -> Partition:
        """Cut a function at its kinks: it is the sum over all cells of the expression times the cell's indicator.

        The cells of different terms of a sum overlap; what has no kink is left in one piece.
        """
        smooth: list[sp.Expr] = []
        pieces: Partition = []
        for term in _distributed(body, self.z):
            if has_kinks(term, self.z):
                pieces.extend(self.split(term, Cell()))
            else:
                smooth.append(term)
        if smooth:
            pieces.append((Cell(), sp.Add(*smooth)))
        return [(cell, value) for cell, value in pieces if value != 0]

    # -- values ---------------------------------------------------------------------------------------------------

    def split(self, expr: sp.Expr, cell: Cell) -> Partition:
        """Cells that fill the given one, with the smooth expression on each."""
        if not expr.has(self.z) or not has_kinks(expr, self.z):
            return [(cell, expr)]
        for kind, rule in _RULES.items():
            if isinstance(expr, kind):
                pieces = rule(self, expr, cell)
                break
        else:
            pieces = self._through(expr, cell)
        if len(pieces) > MAX_PIECES:
            raise LinearisationError(f"{self.where}: more than {MAX_PIECES} pieces; simplify the nested conditions")
        return pieces

    def _through(self, expr: sp.Expr, cell: Cell) -> Partition:
        """A smooth function of several expressions with kinks: the common refinement of their partitions."""
        smooth = [a for a in expr.args if not has_kinks(a, self.z)]
        kinked = [a for a in expr.args if has_kinks(a, self.z)]
        if not kinked:
            raise LinearisationError(
                f"{self.where}: there is no rule for `{expr.func.__name__}` in `{expr}`; "
                "write it with abs, sign, min, max or a conditional"
            )
        parts: list[tuple[Cell, tuple[sp.Expr, ...]]] = [(cell, ())]
        for argument in kinked:
            parts = [(inner, (*done, value)) for outer, done in parts for inner, value in self.split(argument, outer)]
        if isinstance(expr, (sp.Add, sp.Mul)):
            return [(c, expr.func(*smooth, *values)) for c, values in parts]
        index = {a: i for i, a in enumerate(kinked)}
        return [(c, expr.func(*(values[index[a]] if a in index else a for a in expr.args))) for c, values in parts]

    def _abs(self, expr: sp.Expr, cell: Cell) -> Partition:
        return [(c, value * sign) for outer, value in self.split(expr.args[0], cell) for c, sign in self.signs(value, outer)]

    def _sign(self, expr: sp.Expr, cell: Cell) -> Partition:
        return [
            (c, sp.Integer(sign)) for outer, value in self.split(expr.args[0], cell) for c, sign in self.signs(value, outer)
        ]

    def _heaviside(self, expr: sp.Expr, cell: Cell) -> Partition:
        return [
            (c, sp.Rational(1 + sign, 2))
            for outer, value in self.split(expr.args[0], cell)
            for c, sign in self.signs(value, outer)
        ]

    def _extremum(self, expr: sp.Expr, cell: Cell) -> Partition:
        keep = 1 if isinstance(expr, sp.Max) else -1
        arguments = sorted(expr.args, key=lambda a: a.has(self.z))
        pieces = self.split(arguments[0], cell)
        for argument in arguments[1:]:
            pieces = [
                (c, value if sign == keep else best)
                for outer, best in pieces
                for middle, value in self.split(argument, outer)
                for c, sign in self.signs(value - best, middle)
            ]
        return pieces

    def _piecewise(self, expr: sp.Expr, cell: Cell) -> Partition:
        pieces: Partition = []
        left = [cell]
        for value, condition in expr.args:
            outside: list[Cell] = []
            for part in left:
                for c, holds in self.region(condition, part):
                    if holds:
                        pieces.extend(self.split(value, c))
                    else:
                        outside.append(c)
            left = outside
        if left:
            raise LinearisationError(
                f"{self.where}: the conditional `{expr}` has no value for some {self.z}; "
                "give it a last branch that holds otherwise"
            )
        return pieces

    def _curve(self, expr: Lookup, cell: Cell) -> Partition:
        """A measured curve, cut where its argument is and, in each part, at the rows that the argument passes there."""
        pieces: Partition = []
        for part, value in self.split(expr.argument, cell):
            curve = expr.func(value, *expr.args[1:])
            pieces.extend(self.split(curve_pieces(curve, *_extent(value, self.z, part)), part))
        return pieces

    # -- conditions -----------------------------------------------------------------------------------------------

    def region(self, condition: Boolean, cell: Cell) -> Iterator[tuple[Cell, bool]]:
        """Cells that fill the given one, with whether the condition holds there (points apart)."""
        if isinstance(condition, (BooleanTrue, BooleanFalse)):
            yield cell, bool(condition)
        elif not condition.has(self.z):
            for truth in (True, False):
                part = cell.where(condition if truth else sp.Not(condition))
                if part is not None:
                    yield part, truth
        elif isinstance(condition, sp.Not):
            for c, holds in self.region(condition.args[0], cell):
                yield c, not holds
        elif isinstance(condition, (sp.And, sp.Or)):
            deciding = isinstance(condition, sp.Or)
            first, rest = condition.args[0], condition.func(*condition.args[1:])
            for c, holds in self.region(first, cell):
                if holds is deciding:
                    yield c, deciding
                else:
                    yield from self.region(rest, c)
        elif isinstance(condition, sp.ITE):  # what SymPy makes of a conditional within a condition
            decides, *cases = condition.args
            for c, holds in self.region(decides, cell):
                yield from self.region(cases[0 if holds else 1], c)
        elif isinstance(condition, (sp.Eq, sp.Ne)):
            yield from ((c, isinstance(condition, sp.Ne)) for c, sign in self._relation_signs(condition, cell))
        elif isinstance(condition, Relational):
            keep = 1 if isinstance(condition, (sp.Gt, sp.Ge)) else -1
            yield from ((c, sign == keep) for c, sign in self._relation_signs(condition, cell))
        else:
            raise LinearisationError(f"{self.where}: the condition `{condition}` is not a comparison")

    def _relation_signs(self, relation: Relational, cell: Cell) -> Iterator[tuple[Cell, int]]:
        for outer, value in self.split(relation.args[0] - relation.args[1], cell):
            yield from self.signs(value, outer)

    def signs(self, expr: sp.Expr, cell: Cell) -> list[tuple[Cell, int]]:
        """Cells that fill the given one, with the sign of a smooth expression there (zeros apart)."""
        key = (expr, cell)
        if key not in self.solved:
            self.solved[key] = list(self._signs(expr, cell))
        return self.solved[key]

    def _signs(self, expr: sp.Expr, cell: Cell) -> Iterator[tuple[Cell, int]]:
        if not expr.has(self.z):
            yield from self._constant_signs(expr, cell)
            return
        if expr.is_positive or expr.is_negative:
            yield cell, 1 if expr.is_positive else -1
            return
        line = affine(expr, self.z)
        if line is not None:
            yield from self._affine_signs(*line, cell)
            return
        factors = factors_of(expr, self.z)
        if len(factors) > 1:
            yield from self._product_signs(factors, cell)
            return
        yield from self._irreducible_signs(factors[0], cell)

    def _constant_signs(self, expr: sp.Expr, cell: Cell) -> Iterator[tuple[Cell, int]]:
        sign = _sign_of(expr)
        sign = _sign_within(expr, self.outside) if sign is None else sign
        if sign is not None:
            yield cell, sign
            return
        factor, core = expr.as_coeff_Mul()
        if core.could_extract_minus_sign():
            factor, core = -factor, -core
        side = 1 if factor > 0 else -1
        for condition, sign in ((sp.Gt(core, 0), side), (sp.Lt(core, 0), -side), (sp.Eq(core, 0), 0)):
            part = cell.where(condition)
            if part is not None:
                yield part, sign

    def _affine_signs(self, slope: sp.Expr, offset: sp.Expr, cell: Cell) -> Iterator[tuple[Cell, int]]:
        root = _root(slope, offset)
        for part, direction in self._constant_signs(slope, cell):
            if direction == 0:
                yield from self._constant_signs(offset, part)
                continue
            for c, sign in ((part.above(root), direction), (part.below(root), -direction)):
                if c is not None:
                    yield c, sign

    def _product_signs(self, factors: list[sp.Expr], cell: Cell) -> Iterator[tuple[Cell, int]]:
        parts = [(cell, 1)]
        for factor in factors:
            parts = [(c, sign * s) for outer, sign in parts for c, s in self.signs(factor, outer)]
        yield from parts

    def _irreducible_signs(self, expr: sp.Expr, cell: Cell) -> Iterator[tuple[Cell, int]]:
        if expr.is_Pow and not expr.exp.has(self.z) and not expr.exp.is_integer:
            for part, side in self.signs(expr.base, cell):
                if side < 0 and expr.exp.is_integer is None:
                    raise LinearisationError(
                        f"{self.where}: `{expr}` has a sign only where `{expr.base}` is not negative; limit it with `max`"
                    )
                yield part, 1  # where the base is negative it is no number, which is told elsewhere
            return
        inverse = _inverted(expr, self.z)
        if inverse is not None:
            yield from self.signs(inverse, cell)
            return
        if not expr.is_polynomial(self.z):
            raise LinearisationError(
                f"{self.where}: cannot find where `{expr}` changes sign; "
                "compare an expression linear in the argument, or a polynomial, instead"
            )
        polynomial = sp.Poly(expr, self.z)
        if polynomial.degree() == 2:
            yield from self._quadratic_signs(polynomial, cell)
            return
        if not all(c.is_number for c in polynomial.all_coeffs()):
            raise LinearisationError(
                f"{self.where}: cannot find where `{expr}` changes sign for unknown parameters; "
                "write it in factors, or give the parameters their numbers"
            )
        yield from self._between(
            [sp.Rational(str(r)) if not r.is_Rational else r for r in _real_roots(polynomial)],
            polynomial,
            cell,
        )

    def _between(self, roots: list[sp.Expr], polynomial: sp.Poly, cell: Cell) -> Iterator[tuple[Cell, int]]:
        """Signs between sorted numeric roots of odd order."""
        sign = int(sp.sign(polynomial.LC())) * (-1) ** polynomial.degree()
        bounds = [None, *roots, None]
        for low, high in itertools.pairwise(bounds):
            part = cell if low is None else cell.above(low)
            part = part if high is None or part is None else part.below(high)
            if part is not None:
                yield part, sign
            sign = -sign

    def _quadratic_signs(self, polynomial: sp.Poly, cell: Cell) -> Iterator[tuple[Cell, int]]:
        a, b, c = polynomial.all_coeffs()
        discriminant = sp.expand(b**2 - 4 * a * c)
        for part, real in self._constant_signs(discriminant, cell):
            for inner, lead in self._constant_signs(a, part):
                if lead == 0:
                    yield from self.signs(b * self.z + c, inner)
                elif real <= 0:
                    yield inner, lead
                else:
                    # where there are no roots the condition on the cell says so, but their formula must stay a number
                    known = discriminant if discriminant.is_positive else sp.Max(discriminant, TINY)
                    half, centre = lead * sp.sqrt(known) / (2 * a), -b / (2 * a)
                    low, high = inner.below(centre - half), inner.above(centre + half)
                    middle = inner.above(centre - half)
                    middle = middle.below(centre + half) if middle is not None else None
                    for region, sign in ((low, lead), (middle, -lead), (high, lead)):
                        if region is not None:
                            yield region, sign


_RULES: dict[type, Callable[[Splitter, sp.Expr, Cell], Partition]] = {
    sp.Abs: Splitter._abs,
    sp.sign: Splitter._sign,
    sp.Heaviside: Splitter._heaviside,
    sp.Max: Splitter._extremum,
    sp.Min: Splitter._extremum,
    sp.Piecewise: Splitter._piecewise,
    Lookup: Splitter._curve,
}
_KINKED = tuple(_RULES)


def _extent(value: sp.Expr, z: sp.Symbol, cell: Cell) -> tuple[Any, Any]:
    """Bounds of a polynomial with numbers on a cell, a little wide of the mark; infinite where they are not known."""
    if value.is_Rational:
        return value, value
    numbers = sp.Poly(value, z).all_coeffs() if value.is_polynomial(z) else []
    places = [float(end) for end in (cell.lower, cell.upper) if end.is_number or end.is_infinite]
    highest = 2 if np.isinf(places).any() else 4
    if len(places) < 2 or not 1 < len(numbers) <= highest or not all(each.is_number for each in numbers):
        return -math.inf, math.inf
    coefficients = np.array(numbers, dtype=float)
    turns = np.roots(np.polyder(coefficients)).real
    finite = [*(end for end in places if math.isfinite(end)), *turns[(turns > places[0]) & (turns < places[1])]]
    values = [*np.polyval(coefficients, finite), *(end * coefficients[0] for end in places if math.isinf(end))]
    wide = SAME * np.polyval(np.abs(coefficients), np.abs(finite).max(initial=0.0))
    return min(values) - wide, max(values) + wide


def _root(slope: sp.Expr, offset: sp.Expr) -> sp.Expr:
    """-offset/slope, of which 0**q, q a parameter, is no part if it is a factor of both: SymPy makes zoo of its reciprocal."""
    named = {power: sp.Dummy() for each in (slope, offset) for power in each.atoms(sp.Pow) if power.base.is_zero}
    return (-offset.xreplace(named) / slope.xreplace(named)).xreplace({name: power for power, name in named.items()})


def has_kinks(expr: sp.Expr, z: sp.Symbol) -> bool:
    """Whether the expression has a part that may have a kink or a jump in z."""
    return any(node.has(z) for node in expr.atoms(*_KINKED))


def _distributed(body: sp.Expr, z: sp.Symbol) -> Iterator[sp.Expr]:
    """Terms of a sum, products with a sum that has kinks multiplied out: sums need no common partition."""
    for term in sp.Add.make_args(body):
        sums = [f for f in term.args if f.is_Add and has_kinks(f, z)] if term.is_Mul else []
        if not sums:
            yield term
            continue
        rest = sp.Mul(*(f for f in term.args if f != sums[0]))
        for part in sums[0].args:
            yield from _distributed(rest * part, z)


def affine(expr: sp.Expr, z: sp.Symbol) -> tuple[sp.Expr, sp.Expr] | None:
    """Slope and offset of an expression affine in z."""
    if not expr.is_polynomial(z):
        return None
    polynomial = sp.Poly(expr, z)
    if polynomial.degree() > 1:
        return None
    return polynomial.coeff_monomial(z), polynomial.coeff_monomial(1)


def factors_of(expr: sp.Expr, z: sp.Symbol) -> list[sp.Expr]:
    """Factors whose product has the sign of the expression: odd powers once, even powers left out."""
    constant, factors = factored(expr) if expr.is_polynomial(z) else (sp.S.One, _literal_factors(expr))
    odd = [base for base, power in factors if not sp.sympify(power).is_even]
    return [constant, *odd] if constant != 1 and odd else odd or [constant]


@lru_cache(maxsize=4096)  # the same polynomials are met again and again
def factored(expr: sp.Expr) -> tuple[sp.Expr, tuple[tuple[sp.Expr, int], ...]]:
    """A constant with the sign of the polynomial's, and its factors with their powers."""
    numerator, denominator = sp.fraction(sp.together(expr))
    try:
        constant, factors = sp.factor_list(numerator)
    except sp.PolynomialError:  # exponentials of other symbols beside roots of numbers
        constant, rest = numerator.as_coeff_mul(*numerator.free_symbols)
        factors = [(factor, 1) for factor in rest]
    return constant * denominator, tuple(factors)


def _literal_factors(expr: sp.Expr) -> list[tuple[sp.Expr, sp.Expr]]:
    factors = [factor.as_base_exp() for factor in sp.Mul.make_args(expr)]
    return [(b, e) if e.is_integer else (sp.Pow(b, e), sp.S.One) for b, e in factors]


_MONOTONE: dict[type, Callable[[sp.Expr], sp.Expr]] = {
    sp.exp: sp.log,
    sp.log: sp.exp,
    sp.tanh: sp.atanh,
    sp.sinh: sp.asinh,
    sp.atan: sp.tan,
    sp.erf: sp.erfinv,
}


def _inverted(expr: sp.Expr, z: sp.Symbol) -> sp.Expr | None:
    """For g(w) - c with g increasing: an expression with the same sign, w - g^-1(c)."""
    level, rest = expr.as_independent(z, as_Add=True)
    scale, core = rest.as_independent(z, as_Add=False)
    if core.is_Pow and core.exp.is_number and not core.exp.is_integer:  # a number, and not negative, where the base is not
        if core.exp < 0:  # times base**-exp, which is positive
            level, scale = scale, level
        return scale * (core.base - sp.Max(-level / scale, 0) ** (1 / sp.Abs(core.exp))) if scale != 0 else level
    value = -level / scale
    inverse = _MONOTONE.get(type(core))
    if inverse is None:
        return None
    if not value.is_number:
        return scale * core.args[0] if level == 0 and core.func(0) == 0 else None
    lowest, highest = core.func(sp.S.NegativeInfinity), core.func(sp.S.Infinity)
    if (lowest.is_real and value <= lowest) or (isinstance(core, sp.exp) and value <= 0):
        return scale
    if highest.is_real and value >= highest:
        return -scale
    # to so many digits that what is continuous there is seen to be
    return scale * (core.args[0] - sp.Rational(str(sp.N(inverse(value), 60))))


def _real_roots(polynomial: sp.Poly) -> list[sp.Expr]:
    """Numeric real roots of odd order, sorted."""
    roots: list[sp.Expr] = []
    for factor, power in polynomial.sqf_list()[1]:
        if power % 2:
            roots.extend(sp.N(r, 30) for r in factor.real_roots())
    return sorted(roots, key=lambda r: float(r) if math.isfinite(float(r)) else 0.0)
