"""Replace every nonlinearity by its Gaussian describing function: f(x, t) = A x + c + sum_j b_j f_j(C_j x + d_j).

The split is found in what the user wrote: the affine part goes to A and c; what remains is cut into terms,
each a static function of as few linear forms of the state as possible (`abs(x1 - x2)*(x1 - x2)` is a function of
one), equal ones shared between equations. See Harrison & Hammond (1986), section 3, and Roberts & Spanos,
"Random Vibration and Statistical Linearization" (1990), chapter 5.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import sympy as sp
from sympy.core.relational import Relational

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.errors import ExpectationWarning, LinearisationError
from cadet_sym.expectation import DescribingFunction, described
from cadet_sym.expectation.accuracy import WARNED
from cadet_sym.language.element import Element
from cadet_sym.language.expression import ElementCall, symbol, unparse
from cadet_sym.language.products import multiplied_out
from cadet_sym.language.vocabulary import Lookup
from cadet_sym.linear_forms import MARK, Basis, LinearForm, added, local_arguments, scaled
from cadet_sym.warning import warn

__all__ = ["Nonlinearity", "OutputForm", "QuasiLinearSystem", "linearise", "readable"]


@dataclass(frozen=True)
class Nonlinearity:
    """A static function f(z_1, .., z_k) of linear forms of the state, with its describing function."""

    name: str
    forms: tuple[LinearForm, ...]
    describing: DescribingFunction

    def of(self, states: Sequence[sp.Symbol]) -> sp.Expr:
        """f as a function of the states."""
        forms = (form.of(states) for form in self.forms)
        return self.describing.body.xreplace(dict(zip(self.describing.arguments, forms, strict=True)))


@dataclass(frozen=True)
class OutputForm:
    """y = linear x + constant + sum_j coefficient_j f_j, and what E[f_i f_j] is made of."""

    linear: sp.ImmutableMatrix  # (1, n)
    constant: sp.Expr
    coefficients: tuple[sp.Expr, ...]
    elements: tuple[Nonlinearity, ...]
    products: Mapping[tuple[int, int], OutputForm] = field(default_factory=dict)  # f_i f_j, i >= j


@dataclass(frozen=True)
class QuasiLinearSystem:
    """The system in Lur'e form, x' = A x + c + sum_j b_j f_j(z_j) + noise; all entries depend on parameters and t."""

    system: AugmentedSystem
    A: sp.ImmutableSparseMatrix  # (n, n)
    c: sp.ImmutableMatrix  # (n, 1)
    b: sp.ImmutableSparseMatrix  # (n, J)
    elements: tuple[Nonlinearity, ...]  # J of them
    outputs: Mapping[str, OutputForm]

    @property
    def states(self) -> tuple[sp.Symbol, ...]:
        """The augmented states."""
        return self.system.states

    def _repr_latex_(self) -> str:
        rows = []
        for j, element in enumerate(self.elements):
            arguments = zip(element.describing.arguments, element.forms, strict=True)
            where = r",\; ".join(f"{sp.latex(readable(z))} = {sp.latex(form.of(self.states))}" for z, form in arguments)
            rows.append(rf"f_{{{j + 1}}} &= {sp.latex(readable(element.describing.body))},\quad {where}")
        return r"$$\begin{aligned}" + r" \\ ".join(rows) + r"\end{aligned}$$"


def linearise(system: AugmentedSystem) -> QuasiLinearSystem:
    """Split the drift into a linear part and elements, and give every element its describing function.

    Raises
    ------
    LinearisationError
        If an element has no Gaussian expectation, or depends on more arguments than there is a rule for.
    """
    known = {symbol(name): value for name, value in system.model.parameter_values().items()}
    splitter = _Splitter(system.states, system.model.vehicle.elements, known)
    n = len(system.states)
    elements: dict[_Key, int] = {}
    A: dict[tuple[int, int], sp.Expr] = {}
    b: dict[tuple[int, int], sp.Expr] = {}
    c = sp.zeros(n, 1)
    for i, rate in enumerate(system.drift):
        parts = splitter.split(rate)
        A.update({(i, j): value for j, value in parts.linear.items()})
        c[i] = parts.constant
        for key, coefficient in parts.terms.items():
            b[i, elements.setdefault(key, len(elements))] = coefficient
    return QuasiLinearSystem(
        system=system,
        A=sp.ImmutableSparseMatrix(n, n, A),
        c=sp.ImmutableMatrix(c),
        b=sp.ImmutableSparseMatrix(n, len(elements), b),
        elements=tuple(splitter.nonlinearity(key, k) for key, k in elements.items()),
        outputs={name: _output(splitter, expression, n, f"the output `{name}`") for name, expression in system.outputs.items()},
    )


def _output(splitter: _Splitter, expression: sp.Expr, n: int, where: str) -> OutputForm:
    """Split an output, and every product of two of its elements, whose expectations its variance needs."""
    form, keys = _output_form(splitter, expression, n, where)
    products = {}
    for i, first in enumerate(keys):
        for j, second in enumerate(keys[: i + 1]):
            product = splitter.written_out(first) * splitter.written_out(second)
            products[i, j] = _output_form(splitter, product, n, where.replace("the", "the variance of the", 1))[0]
    return OutputForm(form.linear, form.constant, form.coefficients, form.elements, products)


def _output_form(splitter: _Splitter, expression: sp.Expr, n: int, where: str) -> tuple[OutputForm, tuple[_Key, ...]]:
    parts = splitter.split(expression)
    row = sp.zeros(1, n)
    for j, value in parts.linear.items():
        row[j] = value
    keys = tuple(parts.terms)
    nonlinearities = tuple(splitter.nonlinearity(key, k, where) for k, key in enumerate(keys))
    return OutputForm(sp.ImmutableMatrix(row), parts.constant, tuple(parts.terms.values()), nonlinearities), keys


@dataclass(frozen=True)
class _Key:
    """What makes two nonlinear terms the same: the function and the linear forms it is taken of."""

    body: sp.Expr
    forms: tuple[LinearForm, ...]
    name: str = field(default="", compare=False)


@dataclass
class _Parts:
    """An expression on its way into linear part, constant and nonlinear terms."""

    linear: dict[int, sp.Expr] = field(default_factory=dict)
    constant: sp.Expr = sp.S.Zero
    terms: dict[_Key, sp.Expr] = field(default_factory=dict)

    def add_affine(self, form: LinearForm, factor: sp.Expr) -> None:
        for i, value in form.coefficients:
            total = self.linear.get(i, sp.S.Zero) + factor * value
            self.linear[i] = total
            if total == 0:
                del self.linear[i]
        self.constant += factor * form.constant

    def add_term(self, key: _Key, factor: sp.Expr) -> None:
        total = self.terms.get(key, sp.S.Zero) + factor
        self.terms[key] = total
        if total == 0:
            del self.terms[key]


class _Splitter:
    """Splits expressions in the states; remembers the affine forms it has met, and the describing functions made."""

    def __init__(
        self, states: tuple[sp.Symbol, ...], elements: Mapping[str, Element], values: Mapping[sp.Symbol, float]
    ) -> None:
        self.states, self.elements, self.values = states, elements, values
        self.index = {state: i for i, state in enumerate(states)}
        self.known: dict[sp.Basic, LinearForm | None] = {}
        self.made: dict[tuple[sp.Expr, float], DescribingFunction] = {}

    def split(self, expression: sp.Expr) -> _Parts:
        parts = _Parts()
        for factor, term in self._additive(sp.sympify(expression), sp.S.One):
            form = self.affine(term)
            if form is not None:
                parts.add_affine(form, factor)
            else:
                self._add_nonlinear(parts, term, factor)
        return parts

    def nonlinearity(self, key: _Key, number: int, where: str = "") -> Nonlinearity:
        """A term with its describing function; `where` is what messages call it that has no name of its own."""
        name = key.name or f"f{number + 1}"
        where = where if where and not key.name else f"the element `{name}`"
        try:
            scale = max(form.scale(self.values) for form in key.forms)
            found = self.made.get((key.body, scale))  # at another wheel, or in an output
            if found is None:
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always")
                    found = described(local_arguments(len(key.forms)), key.body, name, where, self.values, scale)
                self._warn_again(caught, key)
            if found.error <= WARNED:  # else each is warned of by its own name
                self.made[key.body, scale] = found
            return Nonlinearity(name, key.forms, replace(found, name=name))
        except LinearisationError as error:
            error.message = self._in_states(error.message, key)
            error.add_note(f"The term is `{shown(self.written_out(key))}`.")
            raise

    def _warn_again(self, caught: list[warnings.WarningMessage], key: _Key) -> None:
        for each in caught:
            doubt = each.message
            if isinstance(doubt, ExpectationWarning):
                warn(ExpectationWarning(self._in_states(str(doubt), key), doubt.where, doubt.error))
            else:
                warnings.warn_explicit(doubt, each.category, each.filename, each.lineno)

    def _in_states(self, message: str, key: _Key) -> str:
        """What is said of local arguments, said of the states."""
        for argument, form in zip(local_arguments(len(key.forms)), key.forms, strict=True):
            stands = shown(form.of(self.states))
            for left, right in ("``", "()"):
                message = message.replace(left + argument.name + right, left + stands + right)
            message = message.replace(argument.name, stands if stands.isidentifier() else f"({stands})")
        return message

    def written_out(self, key: _Key) -> sp.Expr:
        """The term in the states again."""
        forms = (form.of(self.states) for form in key.forms)
        return key.body.xreplace(dict(zip(local_arguments(len(key.forms)), forms, strict=True)))

    def depends(self, expression: sp.Basic) -> bool:
        return not self.index.keys().isdisjoint(expression.free_symbols)

    # -- terms of a sum -----------------------------------------------------------------------------

    def _additive(self, expression: sp.Expr, factor: sp.Expr) -> Iterator[tuple[sp.Expr, sp.Expr]]:
        """(state-free factor, term) of every term; a sum times something state-free is distributed."""
        if not self.depends(expression) or self.affine(expression) is not None:
            yield factor, expression
        elif isinstance(expression, sp.Add):
            for term in expression.args:
                yield from self._additive(term, factor)
        elif isinstance(expression, sp.Mul):
            free, rest = self._separate(expression)
            if isinstance(rest, sp.Mul):
                yield factor * free, rest
            else:
                yield from self._additive(rest, factor * free)
        elif isinstance(expression, ElementCall) and not self._is_atomic(expression):
            yield from self._additive(self._inline(expression), factor)
        elif isinstance(expression, sp.Max | sp.Min):
            linear, rest = self._relative(expression)
            if linear != 0:
                yield factor, linear
            yield factor, rest
        else:
            yield factor, expression

    def _separate(self, product: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        free, rest = [], []
        for argument in product.args:
            (rest if self.depends(argument) else free).append(argument)
        return sp.Mul(*free), sp.Mul(*rest)

    def _relative(self, extremum: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        """max(a, b) = b + max(a - b, 0): one argument fewer when both are affine in the state."""
        moving = [a for a in extremum.args if self.depends(a)]
        if len(moving) < 2 or any(self.affine(a) is None for a in moving):
            return sp.S.Zero, extremum
        base = moving[-1]
        return base, extremum.func(*(sp.expand(a - base) for a in extremum.args))

    def _is_atomic(self, call: ElementCall) -> bool:
        """A declared element of linear forms keeps its name; any other is written out."""
        return all(self.affine(argument) is not None for argument in call.args[1:])

    def _inline(self, expression: sp.Expr) -> sp.Expr:
        """Write declared elements out."""
        while calls := expression.atoms(ElementCall):
            table = {}
            for call in calls:
                element = self.elements[str(call.args[0])]
                arguments = dict(zip(element.arguments, call.args[1:], strict=True))
                table[call] = element.value.xreplace(arguments)
            expression = expression.xreplace(table)
        return expression

    # -- nonlinear terms ------------------------------------------------------------------------------

    def _add_nonlinear(self, parts: _Parts, term: sp.Expr, factor: sp.Expr) -> None:
        """Write a term in its own arguments, take out what is linear, and share what is left."""
        name = str(term.args[0]) if isinstance(term, ElementCall) else ""
        basis, local = self._local(self._inline(term))
        arguments = local_arguments(len(basis))
        pieces = sp.Add.make_args(_expanded(local, arguments))
        affine = [piece for piece in pieces if piece.as_independent(*arguments, as_Add=False)[1] in arguments]
        constant = [piece for piece in pieces if not piece.has(*arguments)]
        curved = [piece for piece in pieces if piece not in affine and piece not in constant]
        parts.constant += factor * sp.Add(*constant)
        for piece in affine:
            free, argument = piece.as_independent(*arguments, as_Add=False)
            parts.add_affine(basis[arguments.index(argument)], factor * free)
        # A declared element stays in one piece under its name; what was written inline is cut up and shared.
        for piece in [sp.Add(*curved)] if name and curved else curved:
            free, body = piece.as_independent(*arguments, as_Add=False)
            used = [i for i, z in enumerate(arguments) if z in body.free_symbols]
            own = dict(zip((arguments[i] for i in used), local_arguments(len(used)), strict=True))
            parts.add_term(_Key(body.xreplace(own), tuple(basis[i] for i in used), name), factor * free)

    def _local(self, term: sp.Expr) -> tuple[tuple[LinearForm, ...], sp.Expr]:
        """The term as a function of the fewest linear forms: (forms, function of the local arguments)."""
        found: dict[LinearForm, bool] = {}
        self._collect(term, inside=False, found=found)
        basis = Basis()
        for form in sorted(found, key=lambda f: (not found[f], f.operations)):  # inside nonlinear functions, and simple, first
            basis.add(form)
        return tuple(basis.forms), self._rewrite(term, basis)

    def _collect(self, node: sp.Basic, inside: bool, found: dict[LinearForm, bool]) -> None:
        for part in self._parts_of(node):
            form = self.affine(part)
            if form is not None:
                if form.coefficients:
                    found[form] = found.get(form, False) or inside
            else:
                self._collect(part, inside or not isinstance(part, sp.Add | sp.Mul), found)

    def _parts_of(self, node: sp.Basic) -> tuple[sp.Basic, ...]:
        """The arguments of a node, with what is affine in a sum taken together."""
        if self.affine(node) is not None:
            return (node,)
        if isinstance(node, sp.Add):
            affine = [a for a in node.args if self.affine(a) is not None]
            return (sp.Add(*affine), *(a for a in node.args if a not in affine))
        if isinstance(node, Relational) and self.depends(node.lhs) and self.depends(node.rhs):
            return (sp.expand(node.lhs - node.rhs),)
        return node.args

    def _rewrite(self, node: sp.Basic, basis: Basis) -> sp.Expr:
        if not self.depends(node):
            return node
        form = self.affine(node)
        if form is not None:
            return basis.express(form)
        if isinstance(node, sp.Add):
            return sp.Add(*(self._rewrite(part, basis) for part in self._parts_of(node)))
        if isinstance(node, Relational) and self.depends(node.lhs) and self.depends(node.rhs):
            return node.func(self._rewrite(sp.expand(node.lhs - node.rhs), basis), 0)
        if isinstance(node, sp.Piecewise):
            branches = ((self._rewrite(e, basis), self._rewrite(c, basis)) for e, c in node.args)
            return sp.Piecewise(*branches, evaluate=False)
        return node.func(*(self._rewrite(argument, basis) for argument in node.args))

    # -- affine forms ---------------------------------------------------------------------------------

    def affine(self, expression: sp.Basic) -> LinearForm | None:
        """The expression as a linear form of the states, or None if it is not one."""
        if expression not in self.known:
            self.known[expression] = self._find_affine(expression)
        return self.known[expression]

    def _find_affine(self, expression: sp.Basic) -> LinearForm | None:
        if isinstance(expression, sp.Symbol) and expression in self.index:
            return LinearForm(((self.index[expression], sp.S.One),))
        if not isinstance(expression, sp.Expr):
            return None
        if not self.depends(expression):
            return LinearForm((), expression)
        if isinstance(expression, sp.Add):
            return added(self.affine(a) for a in expression.args)
        if isinstance(expression, sp.Mul):
            free, rest = self._separate(expression)
            form = None if isinstance(rest, sp.Mul) else self.affine(rest)
            return None if form is None else scaled(form, free)
        return None


def readable(expression: sp.Basic) -> Any:
    """An expression with the mark of local arguments taken off, to be shown."""
    local = [s for s in expression.free_symbols if isinstance(s, sp.Symbol) and s.name.endswith(MARK)]
    return expression.xreplace({s: sp.Symbol(s.name.removesuffix(MARK), real=True) for s in local})


def shown(expression: sp.Basic) -> str:
    """An expression in the words of the model file, for reading only: of a measured curve how many rows it has."""

    def named(curve: Any) -> sp.Symbol:
        return sp.Symbol(f"table({shown(curve.argument)}; {len(curve.knots)} rows)", real=True)

    return unparse(readable(expression).replace(lambda e: isinstance(e, Lookup), named))


def _expanded(local: sp.Expr, arguments: tuple[sp.Symbol, ...]) -> sp.Expr:
    """Multiply out products of sums; powers of sums too where all is polynomial."""
    if local.is_polynomial(*arguments):
        return sp.expand(local)
    return multiplied_out(local, partial(sp.expand_mul, deep=False))
