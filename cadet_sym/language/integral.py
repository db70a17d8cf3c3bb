"""Distance from speed: the integral of a piecewise polynomial in time, in closed form."""

from __future__ import annotations

from typing import Any

import sympy as sp

from cadet_sym.language.kinks import breakpoints, switching_functions, zeros
from cadet_sym.language.numeric import quotient
from cadet_sym.language.vocabulary import TIME, Lookup, extreme

_PIECES = 2000  # beyond that many the distance is better integrated than written out


def integral(speed: sp.Expr) -> sp.Expr | None:
    """The integral of `speed` from 0 to t, or None where it is not a piecewise polynomial that can be written out."""
    total: list[sp.Expr] = []
    for term in sp.Add.make_args(speed):
        part = _term(term)
        if part is None:
            return _numbered(speed)
        total.append(part)
    return sp.Add(*total)


def _term(term: sp.Expr) -> sp.Expr | None:
    if term.is_polynomial(TIME):
        return _antiderivative(term)
    choices = [f for f in sp.Mul.make_args(term) if isinstance(f, sp.Piecewise)]
    if len(choices) != 1:
        return None
    factor = sp.Mul(*(f for f in sp.Mul.make_args(term) if f is not choices[0]))
    pieces = [(factor * branch.args[0], branch.args[1]) for branch in choices[0].args]
    if not all(piece.is_polynomial(TIME) for piece, _ in pieces):
        return None
    spans = _spans([test for _, test in pieces])
    if spans is None:
        return None
    terms = []
    for (piece, _), (low, high) in zip(pieces, spans, strict=True):
        whole = _antiderivative(piece)
        inside = extreme(sp.Max, [TIME, low])
        inside = inside if high is None else extreme(sp.Min, [inside, high])
        terms.append(whole.xreplace({TIME: inside}) - whole.xreplace({TIME: low}))
    return sp.Add(*terms)


def _spans(tests: list[Any]) -> list[tuple[sp.Expr, sp.Expr | None]] | None:
    """From when to when, after 0, each branch of `A if t < a else B if t < b else C` (or all with `>`) is taken."""
    edges = [_edge(test) for test in tests[:-1]]
    if any(edge is None for edge in edges) or len({edge[0] for edge in edges if edge}) > 1:
        return None
    spans: list[tuple[sp.Expr, sp.Expr | None]] = []
    low, later = sp.S.Zero, None
    for before, edge in (edge for edge in edges if edge):
        place = extreme(sp.Max, [edge, low])
        if before:
            spans.append((low, place))
            low = place
        else:
            place = place if later is None else extreme(sp.Min, [place, later])
            spans.append((place, later))
            later = place
    return [*spans, (low, later)]


def _edge(test: Any) -> tuple[bool, sp.Expr] | None:
    """(True, a) for `t < a`, (False, a) for `t > a`, whichever way it is written; None for anything else."""
    if not isinstance(test, sp.Gt | sp.Ge | sp.Lt | sp.Le):
        return None
    difference = test.lhs - test.rhs
    slope = sp.diff(difference, TIME)
    if not slope.is_Rational or slope == 0:
        return None
    below = isinstance(test, sp.Lt | sp.Le) == (slope > 0)
    return below, sp.expand(TIME - difference / slope)


def _antiderivative(polynomial: sp.Expr) -> sp.Expr:
    terms = sp.Poly(polynomial, TIME).terms()
    return sp.Add(*(c * TIME ** (n + 1) / (n + 1) for (n,), c in terms))


def _numbered(speed: sp.Expr) -> sp.Expr | None:
    """Where all breakpoints are numbers: piece by piece, each carried on from the one before."""
    switching = [zeros(function, TIME) for function in switching_functions(speed, TIME)]
    if speed.has(Lookup) or None in switching:
        return None
    edges = [e for e in breakpoints([speed], TIME) if not e.is_Rational or e > 0]
    if not all(e.is_Rational for e in edges) or len(edges) > _PIECES:
        return None
    middles = [(a + b) / 2 for a, b in zip([sp.S.Zero, *edges], edges, strict=False)]
    middles.append((edges[-1] if edges else sp.S.Zero) + 1)
    pieces = [_settled(speed, middle) for middle in middles]
    if not all(piece is not None and piece.is_polynomial(TIME) for piece in pieces):
        return None
    carried, branches, start = sp.S.Zero, [], sp.S.Zero
    for piece, edge in zip(pieces, [*edges, None], strict=True):
        whole = _antiderivative(piece)
        part = carried + whole - whole.xreplace({TIME: start})
        if edge is None:
            return sp.Piecewise(*branches, (part, sp.true), evaluate=False) if branches else part
        branches.append((part, sp.StrictLessThan(TIME, edge, evaluate=False)))
        carried, start = part.xreplace({TIME: edge}), edge
    return None


def _settled(expr: sp.Expr, at: sp.Rational) -> sp.Expr | None:
    """The branch of an expression that is taken at a time; None where that depends on parameters."""
    if TIME not in expr.free_symbols:
        return expr
    if isinstance(expr, sp.Piecewise):
        for branch in expr.args:
            test = branch.args[1].xreplace({TIME: at})
            if test == sp.true:
                return _settled(branch.args[0], at)
            if test != sp.false:
                return None
        return None
    if isinstance(expr, sp.Abs | sp.sign | sp.Heaviside):
        value = expr.args[0].xreplace({TIME: at})
        inner = _settled(expr.args[0], at)
        if not value.is_Rational or inner is None:
            return None
        if isinstance(expr, sp.Abs):
            return inner if value >= 0 else -inner
        return sp.sign(value) if isinstance(expr, sp.sign) else sp.Heaviside(value, sp.Rational(1, 2))
    if isinstance(expr, sp.Min | sp.Max):
        values = {argument: argument.xreplace({TIME: at}) for argument in expr.args}
        if not all(value.is_Rational for value in values.values()):
            return None
        choose: Any = min if isinstance(expr, sp.Min) else max
        return _settled(choose(values, key=lambda a: quotient(values[a])), at)
    if not expr.args:
        return expr
    parts = [_settled(argument, at) for argument in expr.args]
    return None if any(part is None for part in parts) else expr.func(*parts)
