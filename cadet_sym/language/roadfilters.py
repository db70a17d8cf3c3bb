"""Ready-made grounds as shaping filters: kind -> filter from its settings.

Every filter is driven by white noise of the two-sided intensity Q that stands in it; the factor 1/2 of one-sided road
spectra is in `one_sided_intensity` and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sympy as sp

from cadet_sym.language.names import exact
from cadet_sym.language.noise import Noise
from cadet_sym.language.shaping import ShapingFilter, filter_of_rates, make_filter
from cadet_sym.language.vocabulary import DISTANCE

# Geometric means of ISO 8608: G_d in 1e-6 m^3 at n_0 = 0.1 cycle/m, and at 1 rad/m.
CLASSES = {letter: 4**k for k, letter in enumerate("ABCDEFGH")}
CYCLE, RADIAN, TWO = sp.Rational(1, 10), sp.Integer(1), sp.Integer(2)

NAMES = ("height", "slope", "curvature")


def state_names(count: int) -> tuple[str, ...]:
    """`height`, `slope`, `curvature`, `derivative_3`, ...: the smooth parts of the height's derivatives."""
    return tuple(NAMES[k] if k < len(NAMES) else f"derivative_{k}" for k in range(count))


def one_sided_intensity(gd: sp.Expr, at: sp.Expr, waviness: sp.Expr = TWO) -> sp.Expr:
    """Q of the noise that gives the one-sided spectrum gd (at / Omega)^waviness, Omega in rad per length.

    A one-sided density G over Omega > 0 is S = G / 2 over both sides, and with h = H w, S = |H|^2 Q / (2 pi): so
    |H|^2 Q = pi G. For h' = w it is Q = pi gd at^2; against cycles, 2 pi^2 n0^2 gd.
    """
    return sp.pi * gd * at**waviness


def per_radian(gd: sp.Expr, n0: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """One-sided density against cycles, at n0 cycles per length, as density against radians: gd / (2 pi) at 2 pi n0."""
    return gd / (2 * sp.pi), 2 * sp.pi * n0


def exponential(sigma: sp.Expr, cutoff: sp.Expr) -> ShapingFilter:
    """Road h' = -cutoff h + sigma sqrt(2 cutoff) w.

    What varies along the road is written as the noise's intensity: where wheels follow each other, the correlation of the state
    with a noise of constant amplitude is smooth, and a jump of sigma is exact.
    """
    if DISTANCE in sigma.free_symbols | cutoff.free_symbols:
        return make_filter(("height",), [[-cutoff]], [[1]], [[2 * cutoff * sigma**2]], [[1]])
    return make_filter(("height",), [[-cutoff]], [[sigma * sp.sqrt(2 * cutoff)]], [[1]], [[1]])


def second_order(sigma: sp.Expr, cutoff: sp.Expr, wavenumber: sp.Expr) -> ShapingFilter:
    """Road q'' + 2 al q' + w0^2 q = w, h = sigma sqrt(2 al) (w0 q + q'), w0^2 = al^2 + be^2."""
    w0 = sp.sqrt(cutoff**2 + wavenumber**2)
    gain = sigma * sp.sqrt(2 * cutoff)
    return chain([w0**2, 2 * cutoff], [gain * w0, gain])


def chain(denominator: Sequence[sp.Expr], numerator: Sequence[sp.Expr]) -> ShapingFilter:
    """States (h, h' - m_1 w, ...) of (b_0 + b_1 p + ...) / (p^n + a_(n-1) p^(n-1) + ... + a_0), noise of intensity 1.

    x_k' = x_(k+1) + m_k w with the Markov parameters m_k = b_(n-k) - sum_(i<k) a_(n-k+i) m_i.
    """
    n = len(denominator)
    b = [*numerator, *[sp.S.Zero] * (n - len(numerator))]
    markov: list[sp.Expr] = []
    for k in range(1, n + 1):
        earlier = (denominator[n - k + i] * markov[i - 1] for i in range(1, k))
        markov.append(sp.expand(b[n - k] - sp.Add(*earlier)))
    C = sp.zeros(n, n)
    for k in range(n - 1):
        C[k, k + 1] = 1
    C[n - 1, :] = sp.Matrix([[-a for a in denominator]])
    F = [1] + [0] * (n - 1)
    return make_filter(state_names(n), C.tolist(), [[m] for m in markov], [[1]], [F])


def iso8608(
    gd: sp.Expr,
    n0: sp.Expr | None = None,
    omega0: sp.Expr | None = None,
    cutoff: sp.Expr = sp.S.Zero,
    waviness: sp.Expr = TWO,
    order: int = 1,
) -> ShapingFilter:
    """Road h' = -cutoff h + w, Q = 2 pi^2 n0^2 gd; integrated white noise if not cut off; or fitted."""
    density, at = per_radian(gd, n0) if n0 is not None else (gd, omega0 or RADIAN)
    Q = one_sided_intensity(density, at, waviness)
    if waviness != 2:
        from cadet_sym.language.waviness import fitted_power

        fit = fitted_power(float(waviness), float(cutoff), order)
        return sections(fit.zeros, fit.poles, fit.gain, Q)
    return make_filter(("height",), [[-cutoff]], [[1]], [[Q]], [[1]])


def spectrum(numerator: Sequence[sp.Expr], denominator: Sequence[sp.Expr], sides: int = 1) -> ShapingFilter:
    """The stable filter whose squared gain is the spectrum, by spectral factorisation."""
    from cadet_sym.language.spectrum import spectral_factor

    b, a = spectral_factor([float(c) for c in numerator], [float(c) for c in denominator], sides)
    return chain([exact(c) for c in a], [exact(c) for c in b])


def sections(zeros: Sequence[Any], poles: Sequence[Any], gain: sp.Expr, Q: sp.Expr = sp.S.One) -> ShapingFilter:
    """Cascade of first- and second-order sections, gain prod (p + z) / prod (p + q), noise of intensity Q.

    A zero or pole is its break wavenumber, or (wavenumber, damping) for a pair. Fewer zeros than poles. A cascade keeps
    its accuracy where poles are decades apart.
    """
    A, B, C = sp.zeros(0, 0), sp.zeros(0, 1), sp.zeros(1, 0)
    D: sp.Expr = sp.S.One
    for numerator, denominator in _matched([_polynomial(z) for z in zeros], [_polynomial(q) for q in poles]):
        A2, B2, C2, D2 = _controller(numerator, denominator)
        top = sp.Matrix.hstack(A, sp.zeros(A.rows, A2.cols))
        A = sp.Matrix.vstack(top, sp.Matrix.hstack(B2 * C, A2))
        B = sp.Matrix.vstack(B, B2 * D)
        C = sp.Matrix.hstack(D2 * C, C2)
        D = D2 * D
    names = tuple(f"section_{k + 1}" for k in range(A.rows))
    return make_filter(names, A.tolist(), (gain * B).tolist(), [[Q]], C.tolist())


def _polynomial(root: Any) -> list[sp.Expr]:
    """Coefficients, lowest first, of p + q, or of p^2 + 2 d q p + q^2."""
    if isinstance(root, tuple):
        q, damping = root
        return [q**2, 2 * damping * q, sp.S.One]
    return [root, sp.S.One]


def _matched(zeros: list[list[Any]], poles: list[list[Any]]) -> list[tuple[list[Any], list[Any]]]:
    """Sections: each pole takes the zeros that it can carry; single poles join where only a pair of zeros is left."""
    waiting, made = sorted(zeros, key=len, reverse=True), []
    poles = sorted(poles, key=len, reverse=True)
    for k, denominator in enumerate(poles):
        numerator: list[Any] = [sp.S.One]
        last = k == len(poles) - 1  # strictly proper, so that the whole cascade is
        for factor in list(waiting):
            if len(numerator) + len(factor) - 1 <= len(denominator) - last:
                numerator = _product(numerator, factor)
                waiting.remove(factor)
        made.append((numerator, denominator))
    if waiting:
        return _matched(zeros, [_product(poles[-1], poles[-2]), *poles[:-2]])
    return made


def _product(a: Sequence[sp.Expr], b: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Coefficients of the product of two polynomials."""
    made = [sp.S.Zero] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            made[i + j] += x * y
    return made


def _controller(numerator: list[sp.Expr], denominator: list[sp.Expr]) -> tuple[Any, Any, Any, sp.Expr]:
    """Controller form of a section: A, B, C, D."""
    n = len(denominator) - 1
    b = [*numerator, *[sp.S.Zero] * (n + 1 - len(numerator))]
    A = sp.zeros(n, n)
    for k in range(n - 1):
        A[k, k + 1] = 1
    A[n - 1, :] = sp.Matrix([[-a for a in denominator[:-1]]])
    B = sp.zeros(n, 1)
    B[n - 1] = 1
    C = sp.Matrix([[b[k] - b[n] * denominator[k] for k in range(n)]])
    return A, B, C, b[n]


def shaping_filter(rates: Mapping[Any, sp.Expr], noise: Noise | None, height: sp.Expr) -> ShapingFilter:
    """The user's own equations."""
    return filter_of_rates(rates, noise or Noise(("w",), sp.S.Zero), height)


FILTERS: dict[str, Callable[..., ShapingFilter]] = {
    "exponential": exponential,
    "second_order": second_order,
    "iso8608": iso8608,
    "sections": sections,
    "spectrum": spectrum,
    "shaping_filter": shaping_filter,
}
