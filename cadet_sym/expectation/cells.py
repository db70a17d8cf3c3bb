"""Stretches of the line between bounds that may be symbolic.

A cell is the set of points above all its lower bounds and below all its upper bounds, where its conditions (on parameters
only) hold. The order of the bounds may be unknown; a cell that turns out empty is harmless, for its upper bound is then read
as equal to its lower one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import sympy as sp
from sympy.logic.boolalg import Boolean, BooleanFalse, BooleanTrue


@dataclass(frozen=True)
class Cell:
    """Where all lower bounds < z < all upper bounds, and the conditions on the parameters hold."""

    lowers: tuple[sp.Expr, ...] = ()
    uppers: tuple[sp.Expr, ...] = ()
    conditions: tuple[Boolean, ...] = ()

    @staticmethod
    def between(lower: sp.Expr, upper: sp.Expr) -> Cell:
        """The cell between two bounds, either of which may be infinite."""
        return Cell(() if lower.is_infinite else (lower,), () if upper.is_infinite else (upper,))

    def above(self, bound: sp.Expr) -> Cell | None:
        """The part of the cell above the bound; None if it is known to be empty."""
        if any(_known_not_less(bound, upper) for upper in self.uppers):
            return None
        return Cell(_tightest(self.lowers, bound, _known_not_less), self.uppers, self.conditions)

    def below(self, bound: sp.Expr) -> Cell | None:
        """The part of the cell below the bound; None if it is known to be empty."""
        if any(_known_not_less(lower, bound) for lower in self.lowers):
            return None
        return Cell(self.lowers, _tightest(self.uppers, bound, _known_not_greater), self.conditions)

    def where(self, condition: Boolean) -> Cell | None:
        """The cell under one more condition on the parameters; None if it can never hold."""
        if isinstance(condition, BooleanFalse) or any(_exclude(condition, known) for known in self.conditions):
            return None
        if isinstance(condition, BooleanTrue) or condition in self.conditions:
            return self
        return Cell(self.lowers, self.uppers, (*self.conditions, condition))

    @property
    def condition(self) -> Boolean:
        """All conditions on the parameters together."""
        return sp.And(*self.conditions)

    def indicated(self, value: sp.Expr) -> sp.Expr:
        """The value where the conditions on the parameters hold, else zero."""
        return sp.Piecewise((value, self.condition), (sp.S.Zero, sp.true)) if self.conditions else value

    @property
    def lower(self) -> sp.Expr:
        """The largest lower bound."""
        return _extreme(self.lowers, sp.Max, sp.S.NegativeInfinity)

    @property
    def upper(self) -> sp.Expr:
        """The smallest upper bound, but no smaller than the largest lower one."""
        upper = _extreme(self.uppers, sp.Min, sp.S.Infinity)
        if (
            not self.lowers
            or not self.uppers
            or (len(self.lowers) == 1 == len(self.uppers) and _known_not_less(upper, self.lower))
        ):
            return upper
        return sp.Max(self.lower, upper)


Partition = list[tuple[Cell, sp.Expr]]


def _exclude(a: Boolean, b: Boolean) -> bool:
    """Whether two conditions are seen never to hold together: opposites, or different signs of one expression."""
    if a == sp.Not(b):
        return True
    strict = sp.StrictGreaterThan | sp.StrictLessThan | sp.Equality
    return isinstance(a, strict) and isinstance(b, strict) and a.args == b.args and a.func is not b.func


def _known_not_less(a: sp.Expr, b: sp.Expr) -> bool:
    if a == b:
        return True
    if a.is_Rational and b.is_Rational:
        return bool(a >= b)
    difference = a - b
    return bool(difference.is_nonnegative)


def _known_not_greater(a: sp.Expr, b: sp.Expr) -> bool:
    return _known_not_less(b, a)


def _tightest(bounds: tuple[sp.Expr, ...], bound: sp.Expr, tighter: Callable[[sp.Expr, sp.Expr], bool]) -> tuple[sp.Expr, ...]:
    if any(tighter(other, bound) for other in bounds):
        return bounds
    return (*(other for other in bounds if not tighter(bound, other)), bound)


def _extreme(bounds: tuple[sp.Expr, ...], choose: Callable[..., sp.Expr], none: sp.Expr) -> sp.Expr:
    if not bounds:
        return none
    return bounds[0] if len(bounds) == 1 else choose(*bounds)
