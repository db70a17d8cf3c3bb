"""Terms of several arguments whose expectation follows from that of a function of fewer, or of other linear forms.

With z ~ N(m, S) and f(z) = sum_k c_k z^(p_k) exp(a z) g(y), y = C z + d,

    E[f] = exp(a m + a S a/2) sum_k c_k E'[z^(p_k) g],    z ~ N(m', S) there, m' = m + S a,
    E'[z_i h] = m'_i E'[h] + sum_j S_ij dE'[h]/dm'_j

(Stein's lemma), down to E'[g] = G(C m' + d, C S C^T), G the describing function of g. A bell exp(-b (z_i - k)^2) changes the
distribution likewise, its covariance too: with D = 1 + 2 b S_ii and e the i-th unit vector

    m' = m - S e 2 b (m_i - k)/D,    S' = S - S e e S 2 b/D,    times exp(-b (m_i - k)^2/D)/sqrt(D).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation.pieces import has_kinks
from cadet_sym.expectation.quadratic import QuadraticPower
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.expectation.switched import Switched
from cadet_sym.language.numeric import evaluate

if TYPE_CHECKING:
    from cadet_sym.expectation.describing import DescribingFunction

MOST_POWERS = 2  # of arguments that the function does not have: each takes one more derivative


@dataclass(frozen=True)
class Form:
    """y = sum_i coefficients[i] z_i."""

    coefficients: tuple[sp.Expr, ...]

    @property
    def argument(self) -> int | None:
        """Which argument it is; None if it is a form of several."""
        used = [i for i, c in enumerate(self.coefficients) if c != 0]
        return used[0] if len(used) == 1 and self.coefficients[used[0]] == 1 else None


@dataclass(frozen=True)
class Bell:
    """exp(-steepness (z_i - centre)^2), steepness > 0."""

    argument: int
    steepness: sp.Expr
    centre: sp.Expr


@dataclass(frozen=True)
class Reduced:
    """sum_k coefficient_k z^powers_k exp(rates z) bells core(forms)."""

    core: DescribingFunction
    forms: tuple[Form, ...]  # one for each argument of the core
    terms: tuple[tuple[sp.Expr, tuple[int, ...]], ...]
    rates: tuple[sp.Expr, ...]
    bells: tuple[Bell, ...] = ()
    slopes: tuple[DescribingFunction, ...] = ()  # of the derivatives of the core, if its gains are not to be differentiated

    @property
    def nodes(self) -> int:
        """Points at which functions are evaluated; 0 in closed form."""
        return sum(df.nodes for df in (self.core, *self.slopes))

    @property
    def error(self) -> float:
        """Estimated relative error; 0 in closed form."""
        return max(df.error for df in (self.core, *self.slopes))

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """Arguments and positions of kinks that stand still while the others move."""
        yield from ((argument, position) for argument, (position,) in self._of_arguments("kinks"))

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """Arguments, centres and widths of poles off the line."""
        yield from ((argument, centre, width) for argument, (centre, width) in self._of_arguments("poles"))

    def _of_arguments(self, what: str) -> Iterator[tuple[int, tuple[sp.Expr, ...]]]:
        for product in self.core.products:
            for k, *places in getattr(product, what)():
                argument = self.forms[k].argument
                if argument is not None:
                    yield argument, tuple(places)

    def written_with(self, change: Callable[[DescribingFunction], DescribingFunction]) -> Reduced:
        """The same with its functions changed."""
        return replace(self, core=change(self.core), slopes=tuple(map(change, self.slopes)))

    def expressions(self) -> Iterator[sp.Expr]:
        """Whatever depends on parameters."""
        for product in self.core.products:
            yield from product.expressions()


def reduced(
    arguments: tuple[sp.Symbol, ...], exprs: Sequence[sp.Expr], where: str, wish: Wish
) -> tuple[list[Reduced], list[sp.Expr]]:
    """What can be written so, and what cannot."""
    rest: list[sp.Expr] = []
    found: list[Reduced] = []
    sums: dict[tuple[_Exponential, tuple[int, ...]], sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for expr in exprs:
        exponential, core = _without_exponentials(arguments, expr, wish.sample)
        powers, core = _without_powers(arguments, core)
        if exponential.acts or 0 < sum(powers) <= MOST_POWERS:
            sums[exponential, powers] += core
        elif (in_forms := _in_forms(arguments, expr, where, wish)) is not None:
            found.append(in_forms)
        else:
            rest.append(expr)
    for (exponential, core), terms in _shared(sums).items():
        part = _described(arguments, core, terms, exponential, where, wish)
        if part is None:
            rest.append(exponential.of(arguments) * core * _polynomial(arguments, terms))
        else:
            found.append(part)
    return found, rest


@dataclass(frozen=True)
class _Exponential:
    """exp(rates z) times bells."""

    rates: tuple[sp.Expr, ...]
    bells: tuple[Bell, ...] = ()

    @property
    def acts(self) -> bool:
        """Whether it is not one."""
        return bool(any(self.rates) or self.bells)

    def of(self, arguments: Sequence[sp.Symbol]) -> sp.Expr:
        """It written out."""
        exponents = [rate * z for rate, z in zip(self.rates, arguments, strict=True)]
        exponents += [-bell.steepness * (arguments[bell.argument] - bell.centre) ** 2 for bell in self.bells]
        return sp.exp(sp.Add(*exponents))


Terms = tuple[tuple[sp.Expr, tuple[int, ...]], ...]


def _polynomial(arguments: Sequence[sp.Symbol], terms: Terms) -> sp.Expr:
    return sp.Add(*(c * sp.Mul(*(z**n for z, n in zip(arguments, powers, strict=True))) for c, powers in terms))


def _shared(sums: Mapping[tuple[_Exponential, tuple[int, ...]], sp.Expr]) -> dict[tuple[_Exponential, sp.Expr], Terms]:
    """The terms with the same function together."""
    found: dict[tuple[_Exponential, sp.Expr], Terms] = {}
    for (exponential, powers), core in sums.items():
        coefficient, function = core.as_coeff_Mul()
        found[exponential, function] = (*found.get((exponential, function), ()), (coefficient, powers))
    return found


def _described(
    arguments: tuple[sp.Symbol, ...], body: sp.Expr, terms: Terms, exponential: _Exponential, where: str, wish: Wish
) -> Reduced | None:
    """The terms with the describing function of what is in all; None if that has not so many derivatives."""
    from cadet_sym.expectation.describing import describe

    used = [i for i, z in enumerate(arguments) if body.has(z)] or [0]
    own = tuple(arguments[i] for i in used)
    forms = tuple(Form(tuple(sp.Integer(i == k) for i in range(len(arguments)))) for k in used)
    core = describe(own, body, where, wish)
    degree = max(sum(powers) for _, powers in terms)
    if degree and any(isinstance(part, QuadraticPower) for part in core.products):  # which does with powers by itself
        whole = body * _polynomial(arguments, terms)
        return _described(arguments, whole, ((sp.S.One, (0,) * len(arguments)),), exponential, where, wish)
    if degree <= _derivatives(core):
        return Reduced(core, forms, terms, exponential.rates, exponential.bells)
    if degree > 1 or not all(isinstance(part, Switched) and not part.jumps for part in core.products):
        return None
    slopes = (sp.diff(body, z).replace(sp.DiracDelta, lambda *_: sp.S.Zero) for z in own)
    described = tuple(describe(own, slope, where, wish) for slope in slopes)
    return Reduced(core, forms, terms, exponential.rates, exponential.bells, described)


def _derivatives(core: DescribingFunction) -> int:
    """How many times the gains are to be differentiated, besides those in the Jacobian of a model."""
    found = [MOST_POWERS]
    for part in core.products:
        if isinstance(part, Switched):
            found += [0 for border in part.borders if border.kind != "parabola"]
        elif part.nodes:
            found.append(1)
    return min(found)


def _without_exponentials(
    arguments: tuple[sp.Symbol, ...], expr: sp.Expr, sample: Mapping[sp.Symbol, float]
) -> tuple[_Exponential, sp.Expr]:
    """A product as its exponentials, and all else; with that those that may grow where something cuts them off."""
    rates, bells, rest = [sp.S.Zero] * len(arguments), [], list(sp.Mul.make_args(expr))
    for factor in list(rest):
        found = _exponent(factor.args[0], arguments, sample) if isinstance(factor, sp.exp) else None
        if found is None:
            continue
        own, falling, constant = found
        others = sp.Mul(*(f for f in rest if f is not factor))
        rest.remove(factor)
        for i, z in enumerate(arguments):
            if own[i] != 0 and has_kinks(others, z):
                constant += own[i] * z
            else:
                rates[i] += own[i]
        rest.append(sp.exp(constant))
        bells += falling
    return _Exponential(tuple(rates), tuple(bells)), sp.Mul(*rest)


def _exponent(
    expr: sp.Expr, arguments: tuple[sp.Symbol, ...], sample: Mapping[sp.Symbol, float]
) -> tuple[list[sp.Expr], list[Bell], sp.Expr] | None:
    """A sum of linear terms and squares that fall, as rates, bells and a constant; None if it is none."""
    if not expr.has(*arguments) or not expr.is_polynomial(*arguments) or sp.total_degree(expr, *arguments) > 2:
        return None
    polynomial = sp.Poly(expr, *arguments)
    constant, bells = polynomial.coeff_monomial(1), []
    rates = [polynomial.coeff_monomial(z) for z in arguments]
    for i, z in enumerate(arguments):
        steepness = -polynomial.coeff_monomial(z**2)
        if steepness == 0:
            continue
        falls = steepness.is_nonnegative or (1 / steepness).is_nonnegative  # of a real parameter squared only the one is seen
        decided = rates[i] == 0 and steepness.free_symbols <= sample.keys()  # the centre is, whatever the numbers
        if not (falls or (decided and evaluate(steepness, sample) > 0)):
            return None
        bells.append(Bell(i, steepness, rates[i] / (2 * steepness)))
        constant += rates[i] ** 2 / (4 * steepness)
        rates[i] = sp.S.Zero
    known = sp.Add(*(-b.steepness * (arguments[b.argument] - b.centre) ** 2 for b in bells), constant)
    known += sp.Add(*(rate * z for rate, z in zip(rates, arguments, strict=True)))
    return (rates, bells, constant) if sp.expand(known - expr) == 0 else None


def _without_powers(arguments: tuple[sp.Symbol, ...], expr: sp.Expr) -> tuple[tuple[int, ...], sp.Expr]:
    """A product as powers of arguments that nothing else in it has, and all else."""
    powers, core = [0] * len(arguments), list(sp.Mul.make_args(expr))
    for i, z in enumerate(arguments):
        own = [f for f in core if f.as_base_exp()[0] == z and f.as_base_exp()[1].is_Integer and f.as_base_exp()[1] > 0]
        if not any(f.has(z) for f in core if f not in own):
            powers[i] = sum(int(f.as_base_exp()[1]) for f in own)
            core = [f for f in core if f not in own]
    return tuple(powers), sp.Mul(*core)


def _slopes(expr: sp.Expr, arguments: tuple[sp.Symbol, ...]) -> list[sp.Expr] | None:
    """Coefficients of an expression that is linear in the arguments but for a constant; None if it is not."""
    if not expr.has(*arguments) or not expr.is_polynomial(*arguments):
        return None
    polynomial = sp.Poly(expr, *arguments)
    return [polynomial.coeff_monomial(z) for z in arguments] if polynomial.total_degree() == 1 else None


# -- other linear forms -----------------------------------------------------------------------------------------------


def _in_forms(arguments: tuple[sp.Symbol, ...], expr: sp.Expr, where: str, wish: Wish) -> Reduced | None:
    """The term as a function of linear forms of several arguments, where that takes no more of them, or is in closed form."""
    from cadet_sym.expectation.conditional import in_closed_form
    from cadet_sym.expectation.describing import describe

    rewriter = _Rewriter(arguments)
    body = rewriter.rewritten(expr)
    plain = [i for i, z in enumerate(arguments) if body.has(z)]
    own = (*(arguments[i] for i in plain), *rewriter.found.values())
    if not rewriter.found or (len(own) > sum(expr.has(z) for z in arguments) and not in_closed_form(own, body, where, wish)):
        return None
    forms = [Form(tuple(sp.Integer(i == k) for i in range(len(arguments)))) for k in plain]
    nothing = sp.S.One, (0,) * len(arguments)
    try:
        core = describe(own, body, where, wish)
    except LinearisationError:  # which is to be told of the arguments themselves
        return None
    return Reduced(core, (*forms, *rewriter.found), (nothing,), (sp.S.Zero,) * len(arguments))


class _Rewriter:
    """Writes what is linear in several arguments as arguments of their own."""

    def __init__(self, arguments: tuple[sp.Symbol, ...]):
        self.arguments = arguments
        self.found: dict[Form, sp.Symbol] = {}

    def rewritten(self, expr: sp.Basic) -> sp.Basic:
        """The expression in the arguments and `found`."""
        if sum(expr.has(z) for z in self.arguments) < 2:
            return expr
        if isinstance(expr, sp.Expr) and (slopes := _slopes(expr, self.arguments)) is not None:
            return self._form(expr, slopes)
        if isinstance(expr, Relational):
            return expr.func(self.rewritten(sp.expand(expr.lhs - expr.rhs)), sp.S.Zero)
        if isinstance(expr, sp.Max | sp.Min) and len(expr.args) == 2:
            a, b = expr.args
            if all(_slopes(each, self.arguments) is not None for each in (a, b)):
                return b + expr.func(self.rewritten(sp.expand(a - b)), sp.S.Zero, evaluate=False)
        if isinstance(expr, sp.Add):
            linear = [a for a in expr.args if _slopes(a, self.arguments) is not None]
            parts = [sp.Add(*linear), *(a for a in expr.args if a not in linear)]
            return sp.Add(*(self.rewritten(part) for part in parts))
        if isinstance(expr, sp.Piecewise):
            return sp.Piecewise(*((self.rewritten(e), self.rewritten(c)) for e, c in expr.args), evaluate=False)
        return expr.func(*(self.rewritten(argument) for argument in expr.args))

    def _form(self, expr: sp.Expr, slopes: list[sp.Expr]) -> sp.Expr:
        scale = next(slope for slope in slopes if slope != 0)
        form = Form(tuple(sp.cancel(slope / scale) for slope in slopes))
        if form not in self.found:
            self.found[form] = sp.Symbol(f"z{len(self.found) + 1}''", real=True)
        return scale * self.found[form] + expr.subs(dict.fromkeys(self.arguments, 0))
