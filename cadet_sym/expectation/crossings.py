"""Where the mean of one argument, given another, meets a kink or a pole: there an integral over the other needs its nodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import sympy as sp

from cadet_sym.expectation.pieces import TINY
from cadet_sym.expectation.quadrature import PLAIN_RULE, Integral, Rule
from cadet_sym.expectation.steep import Steep

if TYPE_CHECKING:
    from cadet_sym.expectation.describing import DescribingFunction

MAX_CROSSINGS = 12
MAX_CURVES, MAX_PASSES = 4, 3
CURVED_ERROR = 1e-4  # of gains, the largest found where kinks lie on a curve
LEAN_ERROR = 1e-3  # the same, near full correlation at ten deviations, where nodes are at kinks alone and none at poles
LOST_ERROR = 0.1  # the same where there are too many to follow
FOUND_ERROR = 1e-9  # the largest that these rules were found to leave, relative, up to correlation one

GRADING = 10  # power of the substitution at an end where f has a root: its derivative, which may be infinite, vanishes there
WITH_STEPS = Rule(1, 24, straight=32, power=GRADING)
WITH_STEPS_AND_POLES = Rule(1, 40, straight=40, power=GRADING)
WITH_CURVES = Rule(3, 24, straight=32)
WITH_ROOTS = Rule(2, 56, straight=32, graded=32, power=GRADING)  # for second derivatives at full correlation
AT_ENDS = Rule(3, 32, straight=48, graded=48)
AT_ENDS_OF_PLACES = Rule(1, 32, straight=32, graded=48)  # where there are up to six of them
AT_ENDS_OF_SUMS = Rule(1, 16, straight=24, graded=20)  # where every node is a sum over nodes itself
TRAPEZOIDAL = Rule(order=80)
TRAPEZOIDAL_AT_ROOT = Rule(order=120)
WITH_POLES = Rule(order=56, straight=40)
OF_CURVE = Rule(6, 20, cut=True)
OF_CURVE_AND_ROOTS = Rule(12, 20, cut=True)


@dataclass(frozen=True)
class Crossing:
    """A kink or a pole of f in another argument, at start + slope z, z the outer argument."""

    argument: int
    start: sp.Expr
    slope: sp.Expr
    width: sp.Expr | None  # of a pole, perhaps a function of z; None for a kink
    root: bool = False  # a kink where derivatives are infinite, which is seen on every scale
    joined: bool = False  # a pole at the kink before it
    curve: sp.Expr | None = None  # or where this polynomial of degree two in z and `symbol` is zero
    symbol: sp.Symbol | None = None  # the argument
    branch: int = 0  # -1, 1: which of the two places where the line through the means passes the curve
    place: sp.Expr | None = None  # or any function of z, which that line passes at most so many times as there are branches


def crossings_of(inside: Sequence[DescribingFunction], z: sp.Symbol, others: tuple[int, ...]) -> tuple[list[Crossing], float]:
    """Kinks and poles in the inner arguments, where they are met in the outer one; and the error that is left."""
    kinks: dict[tuple[int, sp.Expr], None] = {}
    poles: dict[tuple[int, sp.Expr], sp.Expr] = {}
    for product in (product for df in inside for product in df.products):
        for argument, position in product.kinks():
            kinks.update({(others[argument], line): None for line in _lines(position)})
        for argument, position, width in product.poles():
            poles.setdefault((others[argument], position), width)
    roots = {(others[argument], line) for argument, at in _all(inside, "roots") for line in _lines(at)}
    straight, curves, places, error = [], {}, {}, FOUND_ERROR
    for argument, position in kinks | poles:
        width = None if (argument, position) in kinks else poles[argument, position]
        if position.is_polynomial(z) and sp.degree(position, z) <= 1:
            line = sp.expand(position)  # of what is not multiplied out coefficients are not found
            place = Crossing(argument, line.coeff(z, 0), line.coeff(z, 1), width, (argument, position) in roots)
            straight.append(place)
            if width is None and (argument, position) in poles and not place.root:
                straight.append(replace(place, width=poles[argument, position], joined=True))
        elif not position.is_number or width is None:
            error = CURVED_ERROR
            curve = _curve(position, z)
            if curve is not None:
                curves[argument, curve] = width
            elif width is None:
                places[argument, position] = None
    if next(_all(inside, "knots"), None) is not None:  # an integral over the curve's own argument is for these
        error = LOST_ERROR
    if len(curves) + len(places) <= MAX_CURVES:
        straight += [
            Crossing(argument, sp.S.Zero, sp.S.One, width, curve=curve, symbol=_ON_CURVE, branch=branch)
            for (argument, curve), width in curves.items()
            for branch in (-1, 1)
        ]
        straight += [
            Crossing(argument, sp.S.Zero, sp.S.One, None, branch=branch, place=place)
            for argument, place in places
            for branch in range(_passes(place, z))
        ]
    else:
        error = LOST_ERROR
    return straight[:MAX_CROSSINGS], error if len(straight) <= MAX_CROSSINGS else LOST_ERROR


def _passes(place: sp.Expr, z: sp.Symbol) -> int:
    """How often a straight line may pass a curve, as far as it is followed."""
    if place.is_polynomial(z):
        return min(int(sp.degree(place, z)), MAX_PASSES)
    falls = any(power.has(z) and power.exp.could_extract_minus_sign() for power in place.atoms(sp.Pow))
    return 2 if falls else MAX_PASSES  # one over z on a stretch that ends where z is zero


def _lines(position: sp.Expr) -> tuple[sp.Expr, ...]:
    """Of several places that one is the first or last of, all."""
    return position.args if isinstance(position, sp.Max | sp.Min) else (position,)


def _all(inside: Sequence[DescribingFunction], what: str) -> Iterator[tuple[int, sp.Expr]]:
    """Arguments and positions of the roots, or the knots of measured curves, of those that know any."""
    for product in dict.fromkeys(product for df in inside for product in df.products):
        yield from getattr(product, what, tuple)()


_ON_CURVE = sp.Dummy("y", real=True)


def _curve(position: sp.Expr, z: sp.Symbol) -> sp.Expr | None:
    """A polynomial of degree two in z and `_ON_CURVE` that is zero at a kink, which a straight line meets twice; or None."""
    position = position.replace(lambda e: isinstance(e, sp.Max) and TINY in e.args, lambda e: sp.Max(*set(e.args) - {TINY}))
    y, (numerator, denominator) = _ON_CURVE, sp.fraction(sp.together(position))
    curve = denominator * y - numerator
    roots = {node for node in curve.atoms(sp.Pow) if node.exp == sp.S.Half and node.has(z)}
    if len(roots) == 1:  # both signs of it at once
        (root,) = roots
        rest = sp.expand(curve).coeff(root, 0)
        curve = rest**2 - sp.expand(curve - rest) ** 2
    curve = sp.expand(curve)
    _, curve = sp.factor_terms(curve).as_independent(z, y, as_Add=False)
    curve = sp.expand(curve)
    return curve if curve.is_polynomial(z, y) and sp.total_degree(curve, z, y) == 2 else None


def ruled(
    part: Integral, crossings: tuple[Crossing, ...], *, sums: bool, plain: bool, lean: bool, waves: bool, curved: bool
) -> Integral:
    """The stretch with its rule and a place kept for every crossing, whose centre and width follow from the moments.

    `sums` is whether the expectation over the other arguments is a sum over nodes itself, `waves` whether f oscillates in them:
    the less they vary on their own, the more of that is left. `curved` is whether weights hold a measured curve.
    """
    roots = [crossing.root and not plain for crossing in crossings]
    places = (
        Steep(sp.S.Zero, sp.S.One, step=crossing.width is None and not root, root=root, joined=crossing.joined)
        for crossing, root in zip(crossings, roots, strict=True)
    )
    part = replace(part, steep=(*places, *part.steep))
    rule = WITH_POLES
    if curved:
        rule = OF_CURVE_AND_ROOTS if any(place.root for place in part.steep) else OF_CURVE
    elif plain:
        rule = PLAIN_RULE
    elif part.is_trapezoidal:
        rule = TRAPEZOIDAL_AT_ROOT if part.steep[0].root else TRAPEZOIDAL
    elif any(place.root for place in part.steep):
        rule = WITH_ROOTS
    elif any(place.step for place in part.steep) or any(part.singular):
        on_curves = any(crossing.curve is not None or crossing.place is not None for crossing in crossings)
        graded = any(part.singular) and len(part.steep) > 1  # from all but the first an end is seen as a pole is
        with_steps = WITH_STEPS if all(place.step for place in part.steep) and not graded else WITH_STEPS_AND_POLES
        many = any(crossing.place is not None for crossing in crossings)
        at_ends = AT_ENDS_OF_SUMS if sums else AT_ENDS_OF_PLACES if many else AT_ENDS
        rule = (at_ends if any(part.singular) or lean else WITH_CURVES) if on_curves else with_steps
    return replace(part, rule=rule.finer() if waves and not plain else rule)
