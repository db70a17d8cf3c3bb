"""Linear forms of the state, z = C x + d, and a basis of as few as others can be written in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from cadet_sym.language.numeric import evaluate

MARK = "'"  # of local arguments: no name of the user has it


@dataclass(frozen=True)
class LinearForm:
    """One argument of a nonlinearity: z = sum_i coefficient_i x_i + constant."""

    coefficients: tuple[tuple[int, sp.Expr], ...]  # (index of the state, coefficient), by index
    constant: sp.Expr = sp.S.Zero

    def of(self, states: Sequence[sp.Expr]) -> sp.Expr:
        """The form written in the states."""
        return sp.Add(*(c * states[i] for i, c in self.coefficients), self.constant)

    @property
    def operations(self) -> int:
        """How much its coefficients take to compute."""
        return sum(int(sp.count_ops(c)) + len(c.free_symbols) for _, c in self.coefficients)

    def scale(self, values: Mapping[sp.Symbol, float]) -> float:
        """The largest of its coefficients that are known: what one unit of a state is of the argument."""
        known = [abs(float(evaluate(c, values))) for _, c in self.coefficients if c.free_symbols <= values.keys()]
        return max(known, default=1.0)


def local_arguments(count: int) -> tuple[sp.Symbol, ...]:
    """The local arguments of a nonlinearity, z or z1, z2, .. with a mark that no name of the user can have."""
    names = ["z"] if count == 1 else [f"z{i + 1}" for i in range(count)]
    return tuple(sp.Symbol(name + MARK, real=True) for name in names)


def added(forms: Iterable[LinearForm | None]) -> LinearForm | None:
    """The sum; None if one of them is none."""
    total: dict[int, sp.Expr] = {}
    constant = sp.S.Zero
    for form in forms:
        if form is None:
            return None
        for i, value in form.coefficients:
            total[i] = total.get(i, sp.S.Zero) + value
        constant += form.constant
    return LinearForm(tuple(sorted((i, v) for i, v in total.items() if v != 0)), constant)


def scaled(form: LinearForm, factor: sp.Expr) -> LinearForm:
    """The form times something free of the state."""
    return LinearForm(tuple((i, factor * v) for i, v in form.coefficients), factor * form.constant)


class Basis:
    """Linear forms found independent so far; expresses any other in them (Gaussian elimination, exact)."""

    def __init__(self) -> None:
        self.forms: list[LinearForm] = []
        self.rows: list[tuple[int, dict[int, sp.Expr], dict[int, sp.Expr]]] = []  # pivot, row, combination

    def add(self, form: LinearForm) -> None:
        """Take a form in, unless it is a combination of those found so far."""
        row, combination = self._reduce(form)
        if not row:
            return
        number = len(self.forms)
        self.forms.append(LinearForm(form.coefficients, form.constant))
        combination = {k: -v for k, v in combination.items()}
        combination[number] = sp.S.One
        pivot = next(iter(row))
        scale = row[pivot]
        self.rows.append(
            (
                pivot,
                {i: sp.cancel(v / scale) for i, v in row.items()},
                {k: sp.cancel(v / scale) for k, v in combination.items()},
            )
        )

    def express(self, form: LinearForm) -> sp.Expr:
        """The form as a combination of the basis' arguments, with the constant that is left."""
        row, combination = self._reduce(form)
        assert not row, "every form was offered to the basis first"
        arguments = local_arguments(len(self.forms))
        constant = form.constant - sp.Add(*(v * self.forms[k].constant for k, v in combination.items()))
        return sp.Add(*(v * arguments[k] for k, v in combination.items())) + sp.expand(constant)

    def _reduce(self, form: LinearForm) -> tuple[dict[int, sp.Expr], dict[int, sp.Expr]]:
        row = dict(form.coefficients)
        combination: dict[int, sp.Expr] = {}
        for pivot, known, made_of in self.rows:
            factor = row.get(pivot)
            if factor is None:
                continue
            for i, value in known.items():
                left = sp.cancel(row.get(i, sp.S.Zero) - factor * value)
                row[i] = left
                if left == 0:
                    del row[i]
            for k, value in made_of.items():
                combination[k] = sp.cancel(combination.get(k, sp.S.Zero) + factor * value)
        return row, {k: v for k, v in combination.items() if v != 0}
