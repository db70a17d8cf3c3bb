"""The words of an expression: canonical symbols, the three functions SymPy lacks, and the table of the others.

Every symbol of a model is `symbol(name)`, real and nothing else, so that an expression read from a file and the same
one built in SymPy are equal. Numbers are exact. A conditional, a relation, Min and Max are built without SymPy's
evaluation, which solves inequalities and asks assumptions at a cost no one can bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp
from sympy.core.symbol import Str
from sympy.logic.boolalg import Boolean

from cadet_sym.errors import ModelError


def symbol(name: str) -> sp.Symbol:
    """The symbol of that name as all stages after `language` know it."""
    return sp.Symbol(name, real=True)


TIME = symbol("t")
DISTANCE = symbol("s")
SPEED = symbol("V(t)")
SPEED_RATE = symbol("V'(t)")

HALF = sp.Rational(1, 2)


class der(sp.Function):  # noqa: N801  the word of the language
    """Derivative in time: `der(h)`, `der(h, 2)` of a contact; `der(x)` of a state in an output."""

    is_real = True

    def __new__(cls, of: Any, order: Any = 1):  # noqa: D102
        of, order = sp.sympify(of), sp.sympify(order)
        if not order.is_Integer or order < 0:
            raise ModelError(f"the order of a derivative is a whole number, `der({of}, {order})` has {order}")
        if order == 0:
            return of
        if isinstance(of, der):
            return cls(of.of, of.order + order)
        return super().__new__(cls, of, order)

    @property
    def of(self) -> sp.Expr:
        """What is differentiated."""
        return self.args[0]

    @property
    def order(self) -> int:
        """How many times."""
        return int(self.args[1])

    def _eval_derivative(self, s: sp.Symbol) -> sp.Expr:
        return sp.S.Zero  # a quantity of its own, whatever becomes of the height itself

    def _sympystr(self, printer: Any) -> str:
        return f"der({printer._print(self.of)}" + (f", {self.order})" if self.order > 1 else ")")

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        dots = "d" * self.order if self.order <= 4 else ""
        of = printer._print(self.of)
        text = rf"\{dots}ot{{{of}}}" if dots else rf"{of}^{{({self.order})}}"
        return rf"\left({text}\right)^{{{exp}}}" if exp is not None else text


class ElementCall(sp.Function):
    """A declared element at arguments: `ElementCall(Str("oleo"), v)`, printed as `oleo(v)`."""

    is_real = True

    @property
    def name(self) -> str:
        """Name of the element."""
        return self.args[0].name

    @property
    def arguments(self) -> tuple[sp.Expr, ...]:
        """What it is evaluated at."""
        return self.args[1:]

    def _eval_derivative(self, s: sp.Symbol) -> sp.Expr:
        # what the slope is belongs to the element; here it is enough that it is one
        slopes = (ElementCall(Str(f"{self.name}'{k}"), *self.arguments) for k in range(1, len(self.args)))
        return sp.Add(*(slope * a.diff(s) for slope, a in zip(slopes, self.arguments, strict=True)))

    def _sympystr(self, printer: Any) -> str:
        return f"{self.name}({', '.join(printer._print(a) for a in self.arguments)})"

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        name = self.name.replace("_", r"\_")
        body = rf"\operatorname{{{name}}}\left({', '.join(printer._print(a) for a in self.arguments)}\right)"
        return rf"{body}^{{{exp}}}" if exp is not None else body


class Lookup(sp.Function):
    """A measured curve: `Lookup(z, (z_1, ..), (f_1, ..), "extrapolate"|"hold"|"end", "linear"|"monotone")`.

    Between the rows straight lines, or the monotone cubic of Fritsch and Butland (1984, SIAM J. Sci. Stat. Comput. 5,
    300); outside, the last piece goes on, or the last value holds. "end": nothing is known there, and a run must not get
    there; only for a speed.
    """

    is_real = True

    @property
    def argument(self) -> sp.Expr:
        """Where the curve is read."""
        return self.args[0]

    @property
    def knots(self) -> tuple[sp.Rational, ...]:
        """Positions of the rows, increasing."""
        return tuple(self.args[1])

    @property
    def values(self) -> tuple[sp.Rational, ...]:
        """Values of the rows."""
        return tuple(self.args[2])

    @property
    def outside(self) -> str:
        """What happens outside the rows: "extrapolate", "hold" or, of a speed, "end"."""
        return self.args[3].name

    @property
    def method(self) -> str:
        """What happens between the rows: "linear" or "monotone"."""
        return self.args[4].name

    def as_piecewise(self) -> sp.Expr:
        """The curve as a Piecewise of polynomials in its argument, one a row interval."""
        from cadet_sym.language.curve import curve_pieces

        return curve_pieces(self)

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        text = rf"\operatorname{{table}}_{{{len(self.knots)}}}\left({printer._print(self.argument)}\right)"
        return text if exp is None else f"{text}^{{{exp}}}"

    def _eval_derivative(self, s: sp.Symbol) -> sp.Expr:
        return self.slope() * self.argument.diff(s)

    def slope(self) -> sp.Expr:
        """Slope of the curve in its argument, a Piecewise."""
        z = sp.Dummy("z", real=True)
        return self.func(z, *self.args[1:]).as_piecewise().diff(z).xreplace({z: self.argument})


class NamedElement(Str):
    """The name of an element that still knows its declaration: what calling an `Element` leaves in an expression.

    `Vehicle` collects the declarations and keeps the plain name.
    """

    __slots__ = ("declaration", "element")
    declaration: str
    element: Any

    def __new__(cls, name: str, element: Any):  # noqa: D102
        made = Str.__new__(cls, name)
        made.element = element
        # SymPy sorts what it compares: the declaration as text has an order
        made.declaration = sp.srepr((*element.arguments, element.value))
        return made

    def _hashable_content(self) -> tuple[Any, ...]:
        return (self.name, self.declaration)

    def __getnewargs__(self) -> tuple[Any, ...]:
        return (self.name, self.element)


# --------------------------------------------------------------------------- constructors without evaluation


def relation(kind: type[sp.Rel], left: sp.Expr, right: sp.Expr) -> Boolean:
    """A comparison in its one form: what is positive left, what is negative right, the first term with coefficient 1.

    `2*z - 1 < 0` is `z < 1/2`, `b < a` is `a > b`; two rational sides are decided. A conditional on either side is
    taken apart: SymPy has no place for it in a condition.
    """
    if (inner := next(iter(sorted((left - right).atoms(sp.Piecewise), key=sp.default_sort_key)), None)) is not None:
        return _unfolded(kind, left, right, inner)
    parts = [term.as_coeff_Mul(rational=True) for term in sp.Add.make_args(left - right)]
    constant = sp.Add(*(c for c, rest in parts if rest == 1))
    terms = sorted(((rest, c) for c, rest in parts if rest != 1), key=lambda term: sp.default_sort_key(term[0]))
    if not terms:
        return kind(constant, 0)
    scale = 1 / terms[0][1]
    if kind in _MIRRORED:  # an order: turned so that the greater side comes first
        scale = abs(scale) * (-1 if kind in (sp.StrictLessThan, sp.LessThan) else 1)
        kind = sp.StrictGreaterThan if kind in (sp.StrictGreaterThan, sp.StrictLessThan) else sp.GreaterThan
    more = sp.Add(*(scale * c * rest for rest, c in terms if scale * c > 0))
    less = sp.Add(*(-scale * c * rest for rest, c in terms if scale * c < 0))
    if more == 0:
        return _MIRRORED[kind](less, scale * constant, evaluate=False)
    return kind(more, less - scale * constant, evaluate=False)


def negation(condition: Any) -> Any:
    """What is true where a condition is not, in the one form of comparisons."""
    if isinstance(condition, sp.And | sp.Or):
        other = sp.Or if isinstance(condition, sp.And) else sp.And
        return other(*map(negation, condition.args))
    if isinstance(condition, sp.Rel):
        return relation(_NEGATED[type(condition)], *condition.args)
    return sp.Not(condition)


def _unfolded(kind: type[sp.Rel], left: sp.Expr, right: sp.Expr, inner: sp.Piecewise) -> Boolean:
    """A comparison of a conditional: one case after the other."""
    if len(left.atoms(sp.Piecewise) | right.atoms(sp.Piecewise)) > _MOST_INNER or len(inner.args) > _MOST_INNER:
        raise ModelError("too many conditionals inside a condition: give them a name as an element or write them apart")
    cases, missed = [], sp.true
    for branch in inner.args:
        value, test = branch.args
        sides = (side.xreplace({inner: value}) for side in (left, right))
        cases.append(sp.And(missed, test, relation(kind, *sides)))
        missed = sp.And(missed, negation(test))
    return sp.Or(*cases)


_MOST_INNER = 4
_MIRRORED = {
    sp.StrictGreaterThan: sp.StrictLessThan,
    sp.GreaterThan: sp.LessThan,
    sp.StrictLessThan: sp.StrictGreaterThan,
    sp.LessThan: sp.GreaterThan,
}
_NEGATED = {
    sp.StrictGreaterThan: sp.LessThan,
    sp.GreaterThan: sp.StrictLessThan,
    sp.StrictLessThan: sp.GreaterThan,
    sp.LessThan: sp.StrictGreaterThan,
    sp.Equality: sp.Unequality,
    sp.Unequality: sp.Equality,
}


def piecewise(branches: Sequence[tuple[sp.Expr, Any]]) -> sp.Expr:
    """`A if c else B if d else C` as a Piecewise, flat in its last branch, without branches that cannot be taken."""
    flat: list[tuple[sp.Expr, Any]] = []
    for value, condition in branches:
        if condition == sp.false:
            continue
        if condition == sp.true:
            if isinstance(value, sp.Piecewise):
                flat.extend((pair.expr, pair.cond) for pair in value.args)
            else:
                flat.append((value, sp.true))
            break
        flat.append((value, condition))
    if not flat or flat[-1][1] != sp.true:
        raise ModelError("a conditional needs a value for every case: end it with `else` (in SymPy: `(value, True)`)")
    if len(flat) == 1:
        return flat[0][0]
    return sp.Piecewise(*flat, evaluate=False)


def extreme(kind: type[sp.Max] | type[sp.Min], arguments: Sequence[sp.Expr]) -> sp.Expr:
    """Min or Max: flattened, numbers folded into one, nothing else."""
    flat: set[sp.Expr] = set()
    numbers: list[sp.Expr] = []
    for argument in arguments:
        for part in argument.args if isinstance(argument, kind) else (argument,):
            (numbers.append if part.is_Rational else flat.add)(part)
    if numbers:
        flat.add(max(numbers) if kind is sp.Max else min(numbers))
    if len(flat) == 1:
        return flat.pop()
    return kind(*flat, evaluate=False)


def clip(z: sp.Expr, low: sp.Expr, high: sp.Expr) -> sp.Expr:
    """`z` held between two limits: Min(Max(z, low), high).

    Raises
    ------
    ModelError : limits that are seen to be in the wrong order.
    """
    if sp.sympify(high - low).is_negative:
        raise ModelError(f"`clip` holds `{z}` between a lower limit {low} and an upper one {high}, which is less: swap them")
    return extreme(sp.Min, [extreme(sp.Max, [z, low]), high])


def heaviside(z: sp.Expr) -> sp.Expr:
    """Unit step, 1/2 at 0."""
    return sp.Heaviside(z, HALF)


# name -> (least, greatest number of arguments, constructor); None: as many as wanted
FUNCTIONS: dict[str, tuple[int, int | None, Any]] = {
    "abs": (1, 1, sp.Abs),
    "sign": (1, 1, sp.sign),
    "sqrt": (1, 1, sp.sqrt),
    "exp": (1, 1, sp.exp),
    "log": (1, 1, sp.log),
    "sin": (1, 1, sp.sin),
    "cos": (1, 1, sp.cos),
    "tan": (1, 1, sp.tan),
    "asin": (1, 1, sp.asin),
    "acos": (1, 1, sp.acos),
    "atan": (1, 1, sp.atan),
    "atan2": (2, 2, sp.atan2),
    "sinh": (1, 1, sp.sinh),
    "cosh": (1, 1, sp.cosh),
    "tanh": (1, 1, sp.tanh),
    "erf": (1, 1, sp.erf),
    "min": (2, None, lambda *z: extreme(sp.Min, z)),
    "max": (2, None, lambda *z: extreme(sp.Max, z)),
    "clip": (3, 3, clip),
    "heaviside": (1, 1, heaviside),
}
KEYWORDS = frozenset({"and", "or", "not", "if", "else"})
RESERVED = {"t": "time", "s": "distance", "pi": "the number", "der": "the derivative"}
