"""Find polynomials times a power of a quadratic polynomial that is nowhere negative, and how many nodes they need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import sympy as sp

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.algebra import NumpyAlgebra
from cadet_sym.expectation.closed_form import normal
from cadet_sym.expectation.pieces import has_kinks
from cadet_sym.expectation.quadratic import QuadraticPower, Shape
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.tilted import COUNTS, Node, factors, frame_of, spread_out
from cadet_sym.expectation.univariate import univariate
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.products import multiplied_out

MAX_ARGUMENTS = 6  # a polynomial in more has too many moments
MOST_DEGREE, MOST_TERMS = 8, 40
MOST_NODES = 160  # of a factor that is integrated at every node of the other integral
FIXED, LITTLE = (40, 48, 56, 64, 80, 96), 1e-9  # nodes of a sum that is written out, and its error
STEPS = (0.4, 0.35, 0.3, 0.27, 0.24, 0.21, 0.18, 0.15)
FINEST = 0.08
WANTED, WARNED = 2e-12, 1e-8
SPREADS = (1e-3, 0.1, 0.5, 1.0, 3.0, 30.0, 1e3)  # of the moments at which the error is estimated, over the root of c
RATIOS = (1.0, 0.4, 1e-3)  # of one standard deviation to the one before
MEANS = (0.0, 0.5, 2.0, 5.0, 50.0)  # in standard deviations
LEANS = (0.0, 0.6, -0.999)


def quadratic_powers(
    arguments: tuple[sp.Symbol, ...], body: sp.Expr, where: str, wish: Wish
) -> tuple[list[QuadraticPower], sp.Expr]:
    """The terms that are polynomials times a power of a quadratic polynomial that is nowhere negative, and what is left.

    Raises
    ------
    LinearisationError
        If one is so large where the quadratic polynomial is zero that it has no expectation.
    """
    factors: dict[tuple[sp.Expr, sp.Expr, sp.Expr, bool], sp.Expr] = {}
    rest: list[sp.Expr] = []
    for term in sp.Add.make_args(multiplied_out(body, partial(sp.expand_mul, deep=False))):
        found = _taken_apart(term, arguments)
        if found is None or sum(found[1].has(z) for z in arguments) < 2:  # a power of one argument separates
            rest.append(term)
        else:
            factor, key = found[0], found[1:]
            factors[key] = factors.get(key, sp.S.Zero) + factor
    powers: list[QuadraticPower] = []
    for (base, power, kinked, log), factor in factors.items():
        if (found := _quadratic_power(arguments, (factor, base, power, kinked, log), where, wish)) is None:
            rest.append(_product((factor, base, power, kinked, log)))
        else:
            powers.append(found)
    return powers, sp.Add(*rest) if powers else body


_Parts = tuple[sp.Expr, sp.Expr, sp.Expr, sp.Expr, bool]
"""Polynomial, quadratic polynomial, its power, what is a function of one argument, or one, and whether there is a logarithm."""


def _product(parts: _Parts) -> sp.Expr:
    factor, base, power, kinked, log = parts
    return factor * base**power * kinked * (sp.log(base) if log else 1)


def _quadratic_power(arguments: tuple[sp.Symbol, ...], parts: _Parts, where: str, wish: Wish) -> QuadraticPower | None:
    factor, base, power, kinked, log = parts
    used = tuple(i for i, z in enumerate(arguments) if any(part.has(z) for part in (factor, base, kinked)))
    symbols = tuple(arguments[i] for i in used)
    free = (base.free_symbols | power.free_symbols) - set(symbols)
    numbers = {s: float(wish.sample.get(s, 1.0)) for s in free if isinstance(s, sp.Symbol)}
    if log and not power.is_number:
        return None
    squares = _completed(base, symbols, numbers)
    if squares is None:
        return None
    least = evaluate(squares.constant, numbers)
    if least < 0 or (least == 0 and squares.rank == 1):
        return None
    last = [z for z in symbols if kinked.has(z)]
    if last and least == 0 and base.has(*last):
        return None
    if last and kinked.has(sp.exp) and not has_kinks(kinked, last[0]):  # it changes the distribution: see `reduced`
        return None
    found = _in_forms(used, symbols, factor, squares, last)
    if found is None or len(found.forms) == 1:
        return None
    likely = sp.Rational(str(float(evaluate(power, numbers))))
    found = replace(found, value=_product(parts), power=likely, exponent=power, log=log)
    if last:
        try:
            function = univariate(kinked, last[0], where, wish)
        except LinearisationError:
            return None
        # not every derivative is to be had
        if function.is_singular or function.error_functions or function.powers or function.tables:
            return None
        if sum(part.nodes for part in function.integrals) > MOST_NODES:
            return None
        found = replace(found, factor=function)
    if least == 0 and not replace(found.shape, cone=True).exists(0):
        raise LinearisationError(
            f"{where} has no Gaussian expectation: `{found.value}` is too large where `{base}` is zero; "
            "add a positive number to that"
        )
    best = measured(found)
    if best.factor is not None:
        best = replace(best, error=max(best.error, best.factor.error))
    return best if best.error <= WARNED else None


def _taken_apart(term: sp.Expr, symbols: tuple[sp.Symbol, ...]) -> _Parts | None:
    factor, base, power, kinked, log = sp.S.One, None, sp.S.Zero, sp.S.One, False
    for part in sp.Mul.make_args(term):
        if part.is_polynomial(*symbols):
            factor *= part
            continue
        if sum((kinked * part).has(z) for z in symbols) == 1:
            kinked *= part
            continue
        if isinstance(part, sp.log) and not log:
            inner, exponent = _as_power(part.args[0])
            log, factor, exponent = True, factor * exponent, sp.S.Zero
        else:
            inner, exponent = _as_power(part)
        if exponent.has(*symbols) or exponent.is_real is False or not inner.is_polynomial(*symbols):
            return None
        if sp.Poly(inner, *symbols).total_degree() != 2:
            return None
        base = inner if base is None else base
        ratio = sp.cancel(inner / base)
        if ratio.has(*symbols) or (ratio != 1 and (log or not exponent.is_number)):
            return None
        exponent = sp.Rational(str(exponent)) if exponent.is_number else exponent
        factor, power = factor * ratio**exponent, power + exponent
    if base is None or (power.is_Integer and power >= 0 and not log):
        return None
    return factor, base, power, kinked, log


def _as_power(part: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Base and exponent, roots in roots taken as one: no base is negative."""
    base, exponent = part.as_base_exp()
    while isinstance(base, sp.Pow):
        base, exponent = base.base, base.exp * exponent
    return base, exponent


@dataclass(frozen=True)
class _Squares:
    """c + sum of squares of linear forms; each form has a symbol that no later one has."""

    forms: tuple[sp.Expr, ...]
    pivots: tuple[sp.Symbol, ...]
    constant: sp.Expr

    @property
    def rank(self) -> int:
        return len(self.forms)


def _completed(base: sp.Expr, symbols: tuple[sp.Symbol, ...], numbers: Mapping[sp.Symbol, float]) -> _Squares | None:
    """The squares completed; None if it takes negative ones."""
    left, forms, pivots = sp.expand(base), [], []
    while left.has(*symbols):
        for z in symbols:
            scale = normal(left.coeff(z, 2))
            if scale != 0:
                break
        else:
            return None
        if not evaluate(scale, numbers) > 0:
            return None
        form = z + left.coeff(z, 1) / (2 * scale)
        left = _tidy(left - scale * form**2, symbols)
        forms.append(sp.expand(sp.sqrt(scale) * form))
        pivots.append(z)
    return _Squares(tuple(forms), tuple(pivots), left)


def _tidy(expr: sp.Expr, symbols: tuple[sp.Symbol, ...]) -> sp.Expr:
    """A polynomial, coefficients that are zero seen to be so."""
    polynomial = sp.Poly(sp.expand(expr), *symbols)
    monomials = ((c, sp.prod(z**n for z, n in zip(symbols, powers, strict=True))) for powers, c in polynomial.terms())
    return sp.Add(*(sp.cancel(c) * monomial for c, monomial in monomials))


def _in_forms(
    used: tuple[int, ...],
    symbols: tuple[sp.Symbol, ...],
    factor: sp.Expr,
    squares: _Squares,
    last: list[sp.Symbol],
) -> QuadraticPower | None:
    """The polynomial in the forms, and in those arguments that are not the pivot of one.

    Or in the arguments, which may be much smaller than the forms that they are sums of; not where Q may be zero and the
    polynomial is so too, which must be seen. The last is the argument of a function, if there is one.
    """
    y = [sp.Dummy(f"y{k}", real=True) for k in range(squares.rank)]
    solved: dict[sp.Basic, sp.Expr] = {}
    for form, z, symbol in reversed(list(zip(squares.forms, squares.pivots, y, strict=True))):
        slope = sp.diff(form, z)
        solved[z] = sp.expand((symbol - form.subs(z, 0)) / slope).xreplace(solved)
    written = sp.expand(factor.xreplace(solved))
    others = [z for z in symbols if z not in squares.pivots and written.has(z) and z not in last] + last
    polynomial = sp.Poly(written, *y, *others)
    vanishes = squares.constant == 0 and all(any(powers[: len(y)]) for powers, _ in polynomial.terms())
    if any(len(sp.Add.make_args(form)) > 1 for form in squares.forms) and not vanishes:
        others = [z for z in symbols if factor.has(z) and z not in last] + last
        polynomial = sp.Poly(sp.expand(factor), *y, *others)
    terms = tuple((powers, sp.cancel(c)) for powers, c in polynomial.terms() if c != 0)
    size = max(len(used), len(y) + len(others))
    if size > MAX_ARGUMENTS or len(terms) > MOST_TERMS or polynomial.total_degree() > MOST_DEGREE:
        return None
    forms = tuple(
        (*(sp.cancel(sp.diff(form, z)) for z in symbols), sp.cancel(form.subs(dict.fromkeys(symbols, 0))))
        for form in (*squares.forms, *others)
    )
    none = sp.S.Zero
    return QuadraticPower(used, symbols, factor, forms, squares.rank, squares.constant, none, none, log=False, terms=terms)


# -- accuracy ---------------------------------------------------------------------------------------------------------


def measured(function: QuadraticPower) -> QuadraticPower:
    """The function with the largest step that is accurate enough over a grid of moments, and the error found there."""
    cases, found = _Cases(replace(function.shape, kinked=False)), replace(function, error=np.inf)
    for step in STEPS:
        error = cases.error(step)
        found = replace(function, step=step, error=error, nodes=int(np.median(cases.counts(step))))
        if error <= WANTED:
            break
    return found


def error_of(function: QuadraticPower, sample: Mapping[sp.Symbol, float]) -> float:
    """The error of the step that a function has, infinite where with these numbers there is no expectation."""
    numbers = {s: float(sample.get(s, 1.0)) for s in function.free if isinstance(s, sp.Symbol)}
    least, shape = evaluate(function.constant, numbers), function.shape
    power = float(evaluate(function.exponent, numbers))
    exists = replace(shape, cone=bool(least == 0), power=sp.Rational(str(power))).exists(0)
    real = all(np.isfinite(evaluate(x, numbers)) for row in function.forms for x in row)
    if not (least >= 0 and exists and real):
        return np.inf
    if not shape.given:
        return function.error
    near = abs(power - float(shape.power)) <= 1  # or the sum does not converge, or does not reach far enough
    return max(function.error, _Cases(replace(shape, kinked=False), power=power).error(function.step)) if near else np.inf


def with_count(function: QuadraticPower) -> QuadraticPower:
    """The function with the same number of nodes always, as few as leave little error where variances are not too unlike."""
    cases = _Cases(replace(function.shape, kinked=False), RATIOS[:-1])
    for count in FIXED:
        error = cases.error(0.0, count)
        if error <= LITTLE:
            break
    return replace(function, count=count, nodes=count, error=error)


class _Cases:
    """Moments on a grid, with c = 1 or 0, and accurate expectations there, against which steps are held."""

    def __init__(self, shape: Shape, ratios: tuple[float, ...] = RATIOS, power: float | None = None):
        self.shape, self.power, n = shape, power, shape.size
        spreads = (1.0,) if shape.cone else SPREADS  # without c there is no scale
        rows = np.array([(s, q, m, r) for s in spreads for q in ratios for m in MEANS for r in LEANS])
        spread, ratio, mean, lean = rows.T
        stds = [spread * ratio**i for i in range(n)]
        m = [mean * stds[i] * (-0.7) ** i for i in range(n)]
        S = [stds[i] * stds[j] * lean ** abs(i - j) for i in range(n) for j in range(i + 1)]
        c = np.zeros_like(spread) if shape.cone else np.ones_like(spread)
        with np.errstate(all="ignore"):
            self.c, self.frame = c, frame_of(shape, m, S, c, shape.floor(1), NumpyAlgebra())
        *self.reference, size = self._sums(FINEST)
        units = np.array([np.ones_like(spread), *stds])
        self.scale = units / size

    def error(self, step: float, count: int = 0) -> float:
        """The largest, relative to E|f|, of E[f] and of the gains times standard deviations."""
        with np.errstate(all="ignore"):
            errors = np.abs(self._sums(step, count)[:-1] - np.array(self.reference)) * self.scale
        worst = float(np.max(errors))
        return worst if np.isfinite(worst) else np.inf

    def counts(self, step: float) -> np.ndarray:
        """How many nodes each of them takes."""
        wanted = (self.frame.last - self.frame.first) / step + 1
        return np.array(COUNTS)[np.minimum(np.searchsorted(COUNTS, wanted), len(COUNTS) - 1)]

    def _sums(self, step: float, count: int = 0) -> np.ndarray:
        """E[f] and the gains, and for a size of f, the sum of all monomials without their signs; coefficients are all one."""
        shape, frame, xp = self.shape, self.frame, NumpyAlgebra()
        length = frame.last - frame.first
        counts = np.full(self.c.size, count) if count else np.ceil(length / step) if step == FINEST else self.counts(step)
        k = np.arange(int(np.max(counts)))[:, None]
        steps = np.where(k < counts, length / (counts - 1), 0.0)
        with np.errstate(all="ignore"):
            steps_of_t = spread_out(frame.first + np.minimum(k, counts - 1) * (length / (counts - 1)), frame.high, xp)
            node = Node(shape, frame.tilted(np.exp(steps_of_t[0])), steps_of_t, frame.scale, self.c, xp, p=self.power)
            terms = [*node.sums(shape.gains, [1.0] * len(shape.monomials)), node.size()]
            scales = factors(shape, [*shape.gains, shape.gains[0]], frame.scale, xp)
            return np.array([np.sum(term * steps, axis=0) * scale for term, scale in zip(terms, scales, strict=True)])
