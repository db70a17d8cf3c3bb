"""The gamma function where its argument is no constant, and the derivative of its logarithm."""

from __future__ import annotations

from math import log, pi

from cadet_sym.expectation.algebra import Algebra, Number

LANCZOS = (
    # of Gamma(z + 1), g = 7
    *(0.99999999999980993, 676.5203681218851, -1259.1392167224028, 771.32342877765313, -176.61502916214059),
    *(12.507343278686905, -0.13857109526572012, 9.9843695780195716e-6, 1.5056327351493116e-7),
)


def reciprocal_gamma(a: Number, xp: Algebra) -> Number:
    """1/Gamma(a) of a positive a (C. Lanczos, SIAM J. Numer. Anal. B 1 (1964), 86)."""
    base = a + 7.5
    terms = sum((c / (a + k) for k, c in enumerate(LANCZOS[1:], start=1)), start=LANCZOS[0])
    return a * xp.exp(base - (a + 0.5) * xp.log(base)) / ((2 * pi) ** 0.5 * terms)


def digamma(a: float) -> float:
    """psi(a) of a positive a, by its asymptotic series."""
    shift = 0.0
    while a < 12:
        shift, a = shift - 1 / a, a + 1
    square = 1 / (a * a)
    series = square * (1 / 12 - square * (1 / 120 - square * (1 / 252 - square * (1 / 240 - square * (1 / 132)))))
    return shift + log(a) - 0.5 / a - series
