"""Polynomials times exponentials and waves of polynomials of degree two in several arguments: sin(x y - c), exp(-(x - y)^2).

With q(z) = exponent + i phase = q(m) + g (z - m) + (z - m) A (z - m), A complex, and z ~ N(m, S), in closed form

    E[P exp(q)] = det(1 - 2 S A)^(-1/2) exp(q(m) + g S' g/2) E'[P],    z ~ N(m + S' g, S') there,  S' = (1 - 2 S A)^-1 S

(completing the square; the moments of a polynomial hold for a complex mean and covariance too). It exists as long as the real
part of 1 - 2 S A has positive eigenvalues only: for any S where the exponent grows in no direction.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from cadet_sym.errors import LinearisationError, ModelError
from cadet_sym.expectation.quadrature import Wish
from cadet_sym.language.numeric import evaluate

MOST_CURVED = 2  # arguments with squares or products of them: the root of a determinant of more has a branch to choose
MOST_WAVES = 4  # factors that are waves: each doubles the terms
GROWING = 1e-12  # of an exponent, relative, for which rounding may stand
FAR = (10.0, 30.0)


@dataclass(frozen=True)
class Waves:
    """sum_k Re(coefficient_k exp(exponent + i phase_k)) sum_j c_j z^powers_j."""

    arguments: tuple[sp.Symbol, ...]
    exponent: sp.Expr
    phases: tuple[tuple[sp.Expr, sp.Expr], ...]  # (coefficient, phase): no two of them each other's negative
    terms: tuple[tuple[sp.Expr, tuple[int, ...]], ...]
    nodes = 0
    error = 0.0

    @property
    def curved(self) -> tuple[int, ...]:
        """Which arguments have squares, or products with others."""
        return _curved(self.arguments, (self.exponent, *(phase for _, phase in self.phases)))

    def kinks(self) -> Iterator[tuple[int, sp.Expr]]:
        """None."""
        return iter(())

    def poles(self) -> Iterator[tuple[int, sp.Expr, sp.Expr]]:
        """None."""
        return iter(())

    def expressions(self) -> Iterator[sp.Expr]:
        """No condition depends on parameters."""
        return iter(())


def waves(
    arguments: tuple[sp.Symbol, ...], terms: Sequence[sp.Expr], where: str, wish: Wish
) -> tuple[list[Waves], list[sp.Expr]]:
    """The terms that are such, and the others.

    Raises
    ------
    LinearisationError
        If an exponential outgrows the normal distribution in some direction.
    """
    found, rest = [], []
    for term in terms:
        _require_expectation(arguments, term, where, wish)
        wave = _wave(arguments, term)
        if wave is None:
            rest.append(term)
        else:
            found.append(wave)
    return found, rest


def _wave(arguments: tuple[sp.Symbol, ...], term: sp.Expr) -> Waves | None:
    exponent, phases, polynomial, mixed = sp.S.Zero, {sp.S.Zero: sp.S.One}, sp.S.One, False
    for factor in sp.Mul.make_args(term):
        base, power = factor.as_base_exp()
        inner = factor.args[0] if isinstance(factor, sp.exp) else base.args[0] if isinstance(base, sp.sin | sp.cos) else None
        if factor.is_polynomial(*arguments):
            polynomial *= factor
            continue
        if inner is None or not _is_quadratic(inner, arguments):
            return None
        mixed |= sp.total_degree(inner, *arguments) == 2 and sum(inner.has(z) for z in arguments) > 1
        if isinstance(factor, sp.exp):
            exponent += inner
            continue
        if not (power.is_Integer and 0 < power <= MOST_WAVES) or len(phases) * 2**power > 2**MOST_WAVES:
            return None
        for _ in range(int(power)):
            phases = _times(phases, base)
    if not mixed or len(_curved(arguments, (exponent, *phases))) > MOST_CURVED:
        return None
    terms = tuple((c, powers) for powers, c in sp.Poly(polynomial, *arguments).terms())
    return Waves(arguments, sp.expand(exponent), tuple(_in_pairs(phases)), terms)


def _is_quadratic(expr: sp.Expr, arguments: Sequence[sp.Symbol]) -> bool:
    return bool(expr.is_polynomial(*arguments)) and sp.total_degree(expr, *arguments) <= 2


def _curved(arguments: Sequence[sp.Symbol], forms: Sequence[sp.Expr]) -> tuple[int, ...]:
    return tuple(i for i, z in enumerate(arguments) if any(sp.diff(form, z).has(*arguments) for form in forms))


def _times(phases: Mapping[sp.Expr, sp.Expr], wave: sp.Expr) -> dict[sp.Expr, sp.Expr]:
    """A sum of exp(i phase), each with a coefficient, times sin or cos."""
    found: dict[sp.Expr, sp.Expr] = defaultdict(lambda: sp.S.Zero)
    for sign in (1, -1):
        half = sp.Rational(1, 2) if isinstance(wave, sp.cos) else -sign * sp.I / 2
        for phase, coefficient in phases.items():
            found[sp.expand(phase + sign * wave.args[0])] += half * coefficient
    return dict(found)


def _in_pairs(phases: Mapping[sp.Expr, sp.Expr]) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    """Of every two that are each other's conjugate one, twice."""
    for phase, coefficient in phases.items():
        if phase == 0:
            yield coefficient, phase
        elif coefficient != 0 and not phase.could_extract_minus_sign():
            yield 2 * coefficient, phase


# -- existence --------------------------------------------------------------------------------------------------------


def _require_expectation(arguments: tuple[sp.Symbol, ...], term: sp.Expr, where: str, wish: Wish) -> None:
    """Refuse a term whose exponentials of degree two grow along a line on which nothing else vanishes."""
    factors = sp.Mul.make_args(term)
    exponentials = [f for f in factors if isinstance(f, sp.exp) and _is_quadratic(f.args[0], arguments)]
    exponent = sp.expand(sp.Add(*(f.args[0] for f in exponentials)))
    bends = [[sp.diff(exponent, a, b) for b in arguments] for a in arguments]
    if not all(bend.free_symbols <= wish.sample.keys() for row in bends for bend in row):
        return
    values, axes = np.linalg.eigh([[evaluate(bend, wish.sample) for bend in row] for row in bends])
    if values[-1] <= GROWING * np.abs(values).max():
        return
    others = sp.Mul(*(f for f in factors if f not in exponentials))
    for place in (side * far * axes[:, -1] for side in (-1, 1) for far in FAR):
        try:
            value = evaluate(others, {**wish.sample, **dict(zip(arguments, map(float, place), strict=True))})
        except (ModelError, LinearisationError):
            continue
        if np.isfinite(value) and value != 0:
            raise LinearisationError(
                f"{where} has no Gaussian expectation: exp of `{exponent}` grows as fast as the tails of the normal "
                f"distribution fall, or faster, along a line in {', '.join(map(str, arguments))}, unless all variances are "
                "small; clip the exponent where it grows (max, min, clip)"
            )
