"""Refuse what has no Gaussian expectation: poles, values that are not real, growth faster than the normal tails fall."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import sympy as sp

from cadet_sym.errors import LinearisationError, ModelError
from cadet_sym.expectation.cells import Cell
from cadet_sym.expectation.pieces import Splitter, factored
from cadet_sym.language.numeric import evaluate

SCANNED = 50.0  # how far from zero an expression is looked at for zeros that cannot be written down
REACH = 10.0  # standard deviations, in units of the scale, at which a function is looked at in numbers
SAMPLES = 4000
GROWING = (sp.exp, sp.sinh, sp.cosh)  # what may become infinite by its size alone


def require_expectation(value: sp.Expr, cell: Cell, splitter: Splitter) -> None:
    """Raise LinearisationError if a smooth expression on a cell has no expectation for certain."""
    if value.is_polynomial(splitter.z):
        return
    nodes = sp.preorder_traversal(value)
    for node in nodes:
        if not node.has(splitter.z):
            continue
        if isinstance(node, sp.atan):  # bounded, whatever is infinite inside
            nodes.skip()
        if isinstance(node, sp.Pow):
            _check_power(node, cell, splitter)
        elif isinstance(node, sp.log):
            _check_real(node, node.args[0], cell, splitter)
        elif isinstance(node, sp.asin | sp.acos):
            _check_real(node, 1 - node.args[0] ** 2, cell, splitter)
        elif isinstance(node, sp.tan):
            _check_tangent(node, cell, splitter)
    _check_growth(value, cell, splitter)


def gap(
    arguments: Sequence[sp.Symbol], body: sp.Expr, numbers: Mapping[sp.Symbol, float], scale: float
) -> np.ndarray | None:
    """Where, next to zero, a function is seen to be no finite real number; None if nowhere."""
    points = REACH * scale * np.random.default_rng(0).normal(size=(SAMPLES, len(arguments)))
    values = np.broadcast_to(evaluate(body, {**numbers, **dict(zip(arguments, points.T, strict=True))}), SAMPLES)
    gaps = points[np.isnan(values) if body.has(*GROWING) else ~np.isfinite(values)]
    return gaps[np.argmin(np.linalg.norm(gaps, axis=1))] if gaps.size else None


def may_have_gaps(body: sp.Expr) -> bool:
    """Whether there is anything in a function that is no number everywhere, and nothing that may grow beyond all numbers."""
    powers = (power for power in body.atoms(sp.Pow) if not (power.exp.is_integer and power.exp.is_nonnegative))
    rooted = body.has(sp.log, sp.asin, sp.acos) or any(not power.base.is_number for power in powers)
    return rooted and not body.has(*GROWING)


def _refuse(splitter: Splitter, what: str, remedy: str) -> None:
    raise LinearisationError(f"{splitter.where} has no Gaussian expectation: {what}; {remedy}")


def _clip_remedy(splitter: Splitter, at: str) -> str:
    return f"clip `{splitter.z}` before it gets to {at} (max, min, clip, or a stop in a conditional)"


def _check_power(node: sp.Pow, cell: Cell, splitter: Splitter) -> None:
    base, power = node.args
    if not base.has(splitter.z) or (power.is_integer and power.is_nonnegative):
        return
    negative = bool(power.is_negative) or power.could_extract_minus_sign()
    whole = bool(power.is_integer)
    if not whole:
        _check_real(node, base, cell, splitter)
    if negative and not (power.is_number and power > -1):
        for zero in zeros(base, splitter.z):
            if _surely_holds(cell, zero):
                _refuse(splitter, f"`{node}` is infinite at {splitter.z} = {zero}", _clip_remedy(splitter, f"{zero}"))
        if not base.is_polynomial(splitter.z) and _changes_sign(base, cell, splitter.z):
            _refuse(splitter, f"`{node}` is infinite where {base} = 0", _clip_remedy(splitter, "such a point"))


def _changes_sign(base: sp.Expr, cell: Cell, z: sp.Symbol) -> bool:
    """Whether an expression without parameters is seen to take both signs on a cell."""
    if base.free_symbols != {z} or any(not bound.is_number for bound in (*cell.lowers, *cell.uppers)):
        return False
    low = max((float(bound) for bound in cell.lowers), default=-SCANNED)
    high = min((float(bound) for bound in cell.uppers), default=SCANNED)
    values = evaluate(base, {z: np.linspace(low, high, 4001)[1:-1]})
    return bool(np.nanmin(values) < 0 < np.nanmax(values))


def _check_real(node: sp.Expr, base: sp.Expr, cell: Cell, splitter: Splitter) -> None:
    """The node is real where base >= 0."""
    try:
        parts = splitter.signs(base, cell)
    except LinearisationError:
        return
    for part, sign in parts:
        if sign < 0 and part.conditions == cell.conditions and _surely_not_empty(part):
            edge = part.upper if not part.upper.is_infinite else part.lower
            if edge.is_infinite:
                _refuse(splitter, f"`{node}` is nowhere a real number", "correct it, or a sign in it")
            _refuse(splitter, f"`{node}` is not a real number where {base} < 0", _clip_remedy(splitter, f"{edge}"))


def _check_tangent(node: sp.Expr, cell: Cell, splitter: Splitter) -> None:
    ends = [node.args[0].subs(splitter.z, bound) for bound in (cell.lower, cell.upper)]
    if not all(end.is_number and abs(end) < sp.pi / 2 for end in ends):
        _refuse(splitter, f"`{node}` is infinite at odd multiples of pi/2", _clip_remedy(splitter, "them"))


def zeros(base: sp.Expr, z: sp.Symbol) -> Iterator[sp.Expr]:
    """Real zeros of a polynomial that can be written down."""
    if not base.is_polynomial(z):
        return
    for factor, _ in factored(base)[1]:
        if not factor.has(z):
            continue
        polynomial = sp.Poly(factor, z)
        if polynomial.degree() <= 2:
            yield from (root for root in sp.roots(polynomial) if root.is_real is not False)
        elif all(c.is_number for c in polynomial.all_coeffs()):
            yield from polynomial.real_roots()


def _surely_holds(cell: Cell, point: sp.Expr) -> bool:
    """Whether the closed cell is known to hold the point."""
    if point.is_real is None or cell.conditions:
        return False
    return all((point - low).is_nonnegative for low in cell.lowers) and all(
        (high - point).is_nonnegative for high in cell.uppers
    )


def _surely_not_empty(cell: Cell) -> bool:
    return all((high - low).is_positive for low in cell.lowers for high in cell.uppers)


# -- growth -----------------------------------------------------------------------------------------------------------


def _check_growth(value: sp.Expr, cell: Cell, splitter: Splitter) -> None:
    z = splitter.z
    exponents = [node.args[0] for node in value.atoms(sp.exp, sp.sinh, sp.cosh) if node.has(z)]
    exponents += [
        power * sp.log(base) for base, power in (node.args for node in value.atoms(sp.Pow)) if power.has(z) and base.is_positive
    ]
    sides = [side for side, bounds in ((1, cell.uppers), (-1, cell.lowers)) if not bounds]
    for w in exponents:
        even = value.has(sp.sinh(w), sp.cosh(w))
        for side in sides:
            if _outgrows(w, z, side) or (even and _outgrows(-w, z, side)):
                _refuse(
                    splitter,
                    f"exp of `{w}` grows as fast as the tails of the normal distribution fall, or faster",
                    _clip_remedy(splitter, "where it grows"),
                )


def _outgrows(w: sp.Expr, z: sp.Symbol, side: int) -> bool:
    """Whether exp(w) grows like exp(c z^2), c > 0, or faster towards side * infinity."""
    if w.is_polynomial(z):
        polynomial = sp.Poly(w, z)
        if polynomial.degree() < 2:
            return False
        lead = polynomial.LC() * side ** polynomial.degree()
        return bool(lead.is_positive) or (polynomial.degree() > 2 and not lead.is_negative)
    values = dict.fromkeys(w.free_symbols, 1.0)
    try:
        near, far = (evaluate(w, {**values, z: side * x}) / x**2 for x in (1e3, 1e4))
    except ModelError:
        return False
    return bool(np.isposinf(far) or (far > 1e-3 and far > near / 2))
