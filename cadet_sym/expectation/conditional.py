"""Several jointly Gaussian arguments: products that Stein's lemma and the bivariate normal do, else an integral over one.

A function is written as a sum of monomials times functions of one argument each. With none or one such function Stein's
lemma, E[(z - m) g] = S E[grad g], reduces it to one argument; with two that are piecewise polynomials, to the bivariate
normal distribution. Polynomials times powers of sums of squares are integrals over one variable. What is left is integrated
over one argument, given which the others are Gaussian again.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace

import sympy as sp
from sympy.logic.boolalg import Boolean

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.homogeneous import homogeneous
from cadet_sym.expectation.nested import Nested, nested
from cadet_sym.expectation.pieces import Splitter, has_kinks
from cadet_sym.expectation.planar import Planar
from cadet_sym.expectation.polar import Homogeneous
from cadet_sym.expectation.quadratic import QuadraticPower
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.reduced import Reduced, reduced
from cadet_sym.expectation.smooth import planar
from cadet_sym.expectation.squares import MAX_ARGUMENTS as MAX_OF_POWERS
from cadet_sym.expectation.squares import quadratic_powers
from cadet_sym.expectation.switched import Switched
from cadet_sym.expectation.switching import switched
from cadet_sym.expectation.tables import rows_in, written_out
from cadet_sym.expectation.univariate import Univariate, univariate
from cadet_sym.expectation.waves import Waves, waves
from cadet_sym.language.products import multiplied_out
from cadet_sym.language.vocabulary import Lookup

MAX_ARGUMENTS = 3  # of a function that is not a sum of products
MAX_TERMS = 400
DECAYED = 3  # over the rate of an exponential: the width from which on it is nothing to nodes

Integrated = Nested | Planar | Homogeneous | Switched | QuadraticPower | Reduced | Waves
"""What is left to an integral of several arguments, or reduced to what is."""


@dataclass(frozen=True)
class Product:
    """coefficient * prod_i z_i^powers[i] * prod f_i(z_i): a monomial times functions of single arguments."""

    coefficient: sp.Expr
    powers: tuple[int, ...]
    functions: tuple[tuple[int, Univariate], ...]  # (index of the argument, function of it); at most two

    @property
    def nodes(self) -> int:
        """Points at which functions are evaluated; 0 in closed form."""
        return sum(function.nodes for _, function in self.functions)

    @property
    def error(self) -> float:
        """Estimated relative error; 0 in closed form."""
        return max((function.error for _, function in self.functions), default=0.0)

    @property
    def pairs(self) -> int:
        """Pairs of kinks, where one of two functions is a measured curve."""
        if len(self.functions) < 2 or not any(function.tables for _, function in self.functions):
            return 0
        return math.prod(len(f.closed.kinks) + sum(len(table.knots) for table in f.tables) for _, f in self.functions)

    def written_out(self) -> Product:
        """The same of scalar operations alone, however many rows measured curves have; itself if it is so anyway."""
        if not self.pairs and not any(table.is_long for _, function in self.functions for table in function.tables):
            return self
        functions = tuple((argument, function.written_out()) for argument, function in self.functions)
        return replace(self, functions=functions)

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of kinks."""
        for argument, function in self.functions:
            for position in function.kinks():
                yield argument, position

    def roots(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of those kinks at which derivatives are infinite."""
        for argument, function in self.functions:
            for position in function.roots():
                yield argument, position

    def knots(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of the kinks of measured curves."""
        for argument, function in self.functions:
            for table in function.tables:
                yield from ((argument, place) for place in table.places())

    def expressions(self) -> Iterator[sp.Expr]:
        """Whatever depends on parameters."""
        for _, function in self.functions:
            for segment in function.closed.segments:
                yield from (segment.lower, segment.upper)
                yield from (c for term in segment.terms for c in term.coefficients)
            for power in function.powers:
                yield from (power.position, power.coefficient)
            for part in function.integrals:
                yield from (part.lower, part.upper, part.value)

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """Arguments, centres and widths of poles off the line, of error functions, and of what decays from a kink on."""
        for argument, function in self.functions:
            for error in function.error_functions:
                yield argument, -error.offset / error.slope, 1 / sp.Abs(error.slope)
            for part in function.integrals:
                for place in part.steep:
                    yield argument, place.centre, place.width
            for kink in function.closed.kinks:
                for term in kink.terms:
                    if term.rate != 0 and not term.rate.has(sp.I):
                        yield argument, kink.position, DECAYED / sp.Abs(term.rate)


@dataclass(frozen=True)
class _Term:
    """A product on its way: powers of arguments, and for an argument with a function all factors that hold it."""

    coefficient: sp.Expr
    powers: tuple[int, ...]
    functions: tuple[tuple[int, sp.Expr], ...]


Part = Product | Integrated
"""A term whose expectation is known, and how."""


def products(
    arguments: tuple[sp.Symbol, ...], body: sp.Expr, where: str, wish: Wish
) -> tuple[Part, ...]:
    """Write a function as a sum of terms whose expectation is known.

    Raises
    ------
    LinearisationError
        If a term has no expectation, or depends on more arguments than can be integrated over.
    """
    if len(arguments) == 1:
        return (Product(sp.S.One, (0,), ((0, univariate(body, arguments[0], where, wish)),)),)
    powers, body = quadratic_powers(arguments, body, where, wish)
    found: list[Part] = list(powers)
    terms, rest = _separated(arguments, body, where)
    for term in _merged(terms):
        product = _product(term, arguments, where, wish)
        if isinstance(product, Product):
            found.append(product)
        else:
            rest.append(product)
    closed, rest = waves(arguments, rest, where, wish)
    found.extend(closed)
    if rest and not closed and (whole := homogeneous(arguments, _used(arguments, body), body, wish)) is not None:
        return (*powers, whole)
    fewer, rest = reduced(arguments, rest, where, wish)
    found.extend(fewer)
    groups: dict[tuple[int, ...], list[sp.Expr]] = defaultdict(list)
    for expr in rest:
        groups[_used(arguments, expr)].append(expr)
    for used, exprs in groups.items():
        found.extend(_integrated(arguments, used, sp.Add(*exprs), where, wish))
    return tuple(found)


def in_closed_form(arguments: tuple[sp.Symbol, ...], body: sp.Expr, where: str, wish: Wish) -> bool:
    """Whether a function is a sum of products of functions of one argument that all are."""
    terms, rest = _separated(arguments, body, where)
    return not rest and all(isinstance(_product(term, arguments, where, wish), Product) for term in _merged(terms))


def _used(arguments: tuple[sp.Symbol, ...], expr: sp.Expr) -> tuple[int, ...]:
    return tuple(i for i, z in enumerate(arguments) if expr.has(z))


def _integrated(
    arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, where: str, wish: Wish
) -> tuple[Integrated, ...]:
    if len(used) > MAX_ARGUMENTS:
        names = ", ".join(str(arguments[i]) for i in used)
        raise LinearisationError(
            f"{where}: the term `{body}` is a function of {len(used)} arguments ({names}) that does not separate into "
            f"products of functions of one argument each; no more than {MAX_ARGUMENTS} can be integrated over, up to "
            f"{MAX_OF_POWERS} where it is a polynomial times a power of one sum of squares. Split it: give a part of it a "
            "state of its own (a fast first-order filter), or write it as a sum of products"
        )
    if (found := homogeneous(arguments, used, body, wish)) is not None:
        return (found,)
    curves, rest = [], []
    for term in dict.fromkeys((body, *sp.Add.make_args(body))):  # as a whole, or else one by one
        if (along := switched(arguments, used, term, wish)) is None:
            rest.append(term)
            continue
        curves.append(along)
        if term == body:
            return (along,)
    left = sp.Add(*(term for term in rest if term != body or not body.is_Add))
    return (*curves, *_smooth(arguments, used, left, where, wish)) if left != 0 else tuple(curves)


def _smooth(
    arguments: tuple[sp.Symbol, ...], used: tuple[int, ...], body: sp.Expr, where: str, wish: Wish
) -> tuple[Nested | Planar, ...]:
    """Terms with measured curves of different arguments each by themselves: the integral is over the argument of a curve."""
    groups: dict[frozenset[sp.Symbol], sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for term in sp.Add.make_args(body):
        groups[frozenset(arguments[i] for i in used if rows_in(term, arguments[i]))] += term
    found: list[Nested | Planar] = []
    for group in groups.values():
        found.extend(planar(arguments, used, group, wish) or (nested(arguments, used, group, where, wish),))
    return tuple(found)


# -- separation -------------------------------------------------------------------------------------------------------


def _separated(arguments: tuple[sp.Symbol, ...], body: sp.Expr, where: str) -> tuple[list[_Term], list[sp.Expr]]:
    """Terms that are products of functions of one argument, and those that are not."""
    separator = _Separator(arguments, where)
    terms: list[_Term] = []
    rest: list[sp.Expr] = []
    for factors in separator.sums_of_products(body):
        mixed = [f for f in factors if len(separator.used(f)) > 1]
        if mixed:
            rest.append(sp.Mul(*factors))
        else:
            terms.append(separator.term(factors))
    return terms, rest


class _Separator:
    """Multiplies out and cuts at kinks until every factor holds one argument, where that is possible."""

    def __init__(self, arguments: tuple[sp.Symbol, ...], where: str):
        self.arguments, self.where = arguments, where

    def used(self, expr: sp.Basic) -> frozenset[sp.Basic]:
        """The arguments in an expression."""
        return frozenset(self.arguments) & expr.free_symbols

    def sums_of_products(self, body: sp.Expr) -> Iterator[tuple[sp.Expr, ...]]:
        """Factors of every term."""
        waiting = list(sp.Add.make_args(_expanded(body)))
        count = 0
        while waiting:
            term = waiting.pop()
            factors = sp.Mul.make_args(term)
            cut = self._cut(factors)
            count += 1
            if cut is None or count > MAX_TERMS:
                yield factors
            else:
                waiting.extend(t for piece in cut for t in sp.Add.make_args(_expanded(piece)))

    def _cut(self, factors: tuple[sp.Expr, ...]) -> list[sp.Expr] | None:
        """A product with its first mixed factor cut at kinks in one argument; None if there is none, or it cannot be."""
        for i, factor in enumerate(factors):
            if len(self.used(factor)) < 2:
                continue
            pieces = self._pieces(factor)
            if pieces is not None:
                others = sp.Mul(*factors[:i], *factors[i + 1 :])
                return [others * piece for piece in pieces]
        return None

    def _pieces(self, factor: sp.Expr) -> list[sp.Expr] | None:
        factor = written_out(factor) if factor.has(Lookup) else factor
        for z in self.arguments:
            if not factor.has(z) or not has_kinks(factor, z):
                continue
            try:
                cells = Splitter(z, self.where).split(factor, Cell())
            except LinearisationError:
                continue
            if any(self.used(bound) - {z} for cell, _ in cells for bound in (*cell.lowers, *cell.uppers)):
                continue
            pieces = [value * self._indicator(cell, z) for cell, value in cells if value != 0]
            if all(piece != factor for piece in pieces):
                return pieces
        return None

    def _indicator(self, cell: Cell, z: sp.Symbol) -> sp.Expr:
        """One inside the cell: a product of indicators, each of as few arguments as possible."""
        inside: list[Boolean] = [sp.Gt(z, bound, evaluate=False) for bound in cell.lowers]
        inside += [sp.Lt(z, bound, evaluate=False) for bound in cell.uppers]
        factors = [_indicator(sp.And(*inside))] if inside else []
        return sp.Mul(*factors, *(_indicator(condition) for condition in cell.conditions))

    def term(self, factors: tuple[sp.Expr, ...]) -> _Term:
        """Sort the factors of a product by the argument that they hold."""
        coefficient, powers, functions = sp.S.One, [0] * len(self.arguments), defaultdict(lambda: sp.S.One)
        for factor in factors:
            used = self.used(factor)
            if not used:
                coefficient *= factor
                continue
            i = self.arguments.index(next(iter(used)))
            base, power = factor.as_base_exp()
            if base == self.arguments[i] and power.is_Integer and power > 0:
                powers[i] += int(power)
            else:
                functions[i] *= factor
        for i in functions:
            functions[i] *= self.arguments[i] ** powers[i]
            powers[i] = 0
        return _Term(coefficient, tuple(powers), tuple(sorted(functions.items(), key=lambda f: f[0])))


def _indicator(condition: Boolean) -> sp.Expr:
    if condition == sp.true:
        return sp.S.One
    return sp.Piecewise((sp.S.One, condition), (sp.S.Zero, sp.true), evaluate=False)


def _expanded(expr: sp.Expr) -> sp.Expr:
    """Multiplied out, products of exponentials taken apart."""
    return multiplied_out(expr, lambda e: sp.expand(e, deep=False, power_base=False, log=False))


def _merged(terms: list[_Term]) -> list[_Term]:
    """Add the functions of the last argument with equal other factors: what is continuous in it must come together."""
    sums: dict[tuple[tuple[int, ...], tuple[tuple[int, sp.Expr], ...], int, sp.Expr], sp.Expr] = {}
    plain: dict[tuple[int, ...], sp.Expr] = {}
    for term in terms:
        if not term.functions:
            plain[term.powers] = plain.get(term.powers, sp.S.Zero) + term.coefficient
            continue
        *others, (index, function) = term.functions
        key = (term.powers, tuple(others), index, _bells(function) if others else sp.S.One)
        sums[key] = sums.get(key, sp.S.Zero) + term.coefficient * function
    result = [_Term(coefficient, powers, ()) for powers, coefficient in plain.items() if coefficient != 0]
    for (powers, others, index, _), function in sums.items():
        if function != 0:
            result.append(_Term(sp.S.One, powers, (*others, (index, function))))
    return result


def _bells(function: sp.Expr) -> sp.Expr:
    """The factors exp(..) of squares, by which other functions are reduced to simpler ones."""
    exponentials = (f for f in sp.Mul.make_args(function) if isinstance(f, sp.exp))
    return sp.Mul(*(f for f in exponentials if any(isinstance(e, sp.Pow) and e.exp == 2 for e in f.args[0].atoms(sp.Pow))))


def _product(term: _Term, arguments: tuple[sp.Symbol, ...], where: str, wish: Wish) -> Product | sp.Expr:
    """The term with its functions ready; or the term itself if there is no closed form for two functions."""
    whole = sp.Mul(
        term.coefficient,
        *(z**n for z, n in zip(arguments, term.powers, strict=True)),
        *(f for _, f in term.functions),
    )
    if len(term.functions) > 2:
        return whole
    curved = any(f.has(Lookup) for _, f in term.functions)
    if len(term.functions) == 2 and curved and any(term.powers):  # would take E[f' g']
        return whole
    functions: dict[int, Univariate] = {}
    for i, f in sorted(term.functions, key=lambda function: function[1].has(Lookup)):  # curves last: they take longest
        functions[i] = univariate(f, arguments[i], where, wish)
        if len(term.functions) == 2 and not functions[i].is_piecewise_polynomial:
            return whole
    return Product(term.coefficient, term.powers, tuple(sorted(functions.items(), key=lambda function: function[0])))
