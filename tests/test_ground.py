"""Roads: the filter has the spectrum that was declared, and what is no road is refused."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, Lookup, evaluate, parse, symbol
from cadet_sym.language.ground import (
    Ground,
    exponential,
    iso8608,
    second_order,
    sections,
    shaping_filter,
    spectrum,
)
from cadet_sym.language.model import Model, Noise
from cadet_sym.language.modelfile import loads
from cadet_sym.language.roadfilters import CLASSES
from cadet_sym.language.shaping import ShapingFilter
from cadet_sym.language.spectrum import spectral_factor

MEASURED = Path(__file__).parents[1] / "models" / "measured_road.csv"

KAPPA = np.geomspace(1e-3, 1e2, 41)  # rad/m


def numbers(matrix: sp.MatrixBase, **values: float) -> np.ndarray:
    known = {symbol(name): value for name, value in values.items()}
    return np.array([[evaluate(entry, known) for entry in row] for row in matrix.tolist()]).reshape(matrix.shape)


def response(road: ShapingFilter, kappa: np.ndarray, **values: float) -> np.ndarray:
    """Height over white noise at p = i kappa, (k, m)."""
    C, D, F = (numbers(m, **values) for m in (road.C, road.D, road.F))
    eye = np.eye(len(C))
    return np.array([(F @ np.linalg.solve(1j * k * eye - C, D))[0] for k in kappa])


def density(ground: Ground, kappa: np.ndarray = KAPPA, **values: float) -> np.ndarray:
    """One-sided density of the height against rad per metre: twice |H|^2 Q / (2 pi)."""
    road = ground.shaping_filter()
    H, Q = response(road, kappa, **values), numbers(road.Q, **values)
    return np.einsum("ki,ij,kj->k", H, Q, H.conj()).real / np.pi


def variance(ground: Ground, **values: float) -> float:
    from scipy.linalg import solve_continuous_lyapunov

    road = ground.shaping_filter()
    C, D, Q, F = (numbers(m, **values) for m in (road.C, road.D, road.Q, road.F))
    P = solve_continuous_lyapunov(C, -D @ Q @ D.T)
    return float((F @ P @ F.T)[0, 0])


def correlation(ground: Ground, d: float) -> float:
    from scipy.linalg import expm, solve_continuous_lyapunov

    road = ground.shaping_filter()
    C, D, Q, F = (numbers(m) for m in (road.C, road.D, road.Q, road.F))
    P = solve_continuous_lyapunov(C, -D @ Q @ D.T)
    return float((F @ expm(C * d) @ P @ F.T)[0, 0])


# ------------------------------------------------------------------ kinds


@pytest.mark.parametrize("letter", sorted(CLASSES))
def test_iso_classes_have_their_density_at_the_reference(letter):
    """R50: 16, 64, 256, ... 1e-6 m^3 at 0.1 cycle/m; 1, 4, 16, ... at 1 rad/m. One-sided."""
    n0 = np.array([2 * np.pi * 0.1])
    assert density(iso8608(letter), n0)[0] * 2 * np.pi == pytest.approx(16e-6 * CLASSES[letter], rel=1e-12)
    assert density(iso8608(letter, omega0=1), np.array([1.0]))[0] == pytest.approx(1e-6 * CLASSES[letter], rel=1e-12)


def test_the_intensity_of_the_roads_noise_is_half_the_one_sided_one():
    """R50: Q = 2 pi^2 n0^2 gd."""
    road = iso8608("C").shaping_filter()
    assert float(road.Q[0]) == pytest.approx(2 * np.pi**2 * 0.01 * 256e-6, rel=1e-14)
    assert 20 * float(road.Q[0]) == pytest.approx(0.0010106474906715502, rel=1e-14)


def test_a_low_cutoff_gives_the_road_its_variance():
    """R14: pi n0^2 gd / (2 n00) at a cut-off of n00 cycle/m."""
    ground = iso8608(gd=256e-6, cutoff=2 * sp.pi * sp.Rational("0.011"))
    assert variance(ground) == pytest.approx(0.00036556714514499413, rel=1e-12)


@pytest.mark.parametrize("waviness", [1.5, 1.8, 2.0, 2.3, 3.0])
def test_other_waviness_is_fitted_within_its_stated_error(waviness):
    ground = iso8608("C", waviness=waviness, cutoff=0.07)
    band = np.geomspace(0.07, 2 * np.pi * 10, 60)
    at = 2 * np.pi * 0.1
    want = 256e-6 / (2 * np.pi) * (at**2 / (band**2 + 0.07**2)) ** (waviness / 2)
    off = np.abs(density(ground, band) / want - 1).max()
    if waviness == 2:
        assert off < 1e-12
        assert ground.note == ""
        return
    assert off < 0.02
    stated = float(ground.note.split("at most ")[1].split(" %")[0]) / 100
    assert off <= stated * 1.1


def test_the_roughness_may_be_a_parameter_whatever_the_waviness():
    ground = iso8608(gd=symbol("g"), waviness=2.5, cutoff=0.1)
    np.testing.assert_allclose(density(ground, g=4.0), 4 * density(ground, g=1.0), rtol=1e-12)


@pytest.mark.parametrize("ground", [exponential(1.1, 0.2), exponential(1.1, symbol("c"))])
def test_exponential_ground_has_its_autocovariance(ground):
    al = 0.2
    want = 2 * 1.1**2 * al / (np.pi * (KAPPA**2 + al**2))
    np.testing.assert_allclose(density(ground, c=al), want, rtol=1e-12)


def test_published_roads_have_their_autocovariance():
    """R53: sigma^2 exp(-al d) cos(be d) for asphalt."""
    ground = second_order(1.1, 0.2, 0.4)
    want = [1.21, 0.9124621631133913, 0.24062804402369795, -0.28114249396588264]
    np.testing.assert_allclose([correlation(ground, d) for d in (0, 1, 3, 7)], want, rtol=1e-12)
    assert ground.shaping_filter().states == ("height", "slope")


def test_own_equations_are_read_as_they_stand():
    h, p, w = sp.symbols("h p w")
    al, be, k = sp.symbols("alpha beta k")
    ground = shaping_filter({h: p, p: -(al + be) * p - al * be * h + k * w}, {w: 1}, h)
    values = {"alpha": 0.8, "beta": 8.0, "k": 8 * np.sqrt(1.6)}
    want = density(exponential(1, 0.8).rolling_contact(8))
    np.testing.assert_allclose(density(ground, **values), want, rtol=1e-12)


def test_correlated_noises_add_their_covariance():
    h, u, w = sp.symbols("h u w")
    noise = Noise([u, w], [[1, sp.Rational(1, 2)], [sp.Rational(1, 2), 2]])
    both = shaping_filter({h: -h + u + w}, noise, h)
    alone = shaping_filter({h: -h + w}, {w: 4}, h)
    np.testing.assert_allclose(density(both), density(alone), rtol=1e-12)


def test_a_ground_without_noise_is_a_profile_only():
    h = sp.Symbol("h")
    road = shaping_filter({h: -h + 1}, None, h).shaping_filter()
    assert road.D.is_zero_matrix
    assert road.offset[0] == 1


# ------------------------------------------------------------------ rational spectra

even_polynomial = st.lists(st.floats(0.05, 20), min_size=1, max_size=3)


@settings(max_examples=60, deadline=None)
@given(zeros=st.lists(st.floats(0.05, 20), max_size=2), poles=st.lists(st.floats(0.05, 20), min_size=3, max_size=4))
def test_spectral_factorisation_gives_the_spectrum_back(zeros, poles):
    """From breaks of both: |H|^2 = pi G, and every pole is stable."""
    top, bottom = (np.polynomial.polynomial.polyfromroots([-(q**2) for q in roots]) for roots in (zeros, poles))
    numerator, denominator = (np.repeat(c, 2)[:-1] * np.resize([1, 0], 2 * len(c) - 1) for c in (top, bottom))
    b, a = spectral_factor(list(numerator), list(denominator))
    p = 1j * KAPPA
    H = np.polyval(b[::-1], p) / np.polyval([1, *a[::-1]], p)
    G = np.polyval(top[::-1], KAPPA**2) / np.polyval(bottom[::-1], KAPPA**2)
    np.testing.assert_allclose(abs(H) ** 2, np.pi * G, rtol=1e-8)
    assert np.roots([1, *a[::-1]]).real.max() < 0


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([1], [0.04, 0, 1]),
        ([1, 0, 0.3], [1, 0, 0.5, 0, 0.2]),
        ([1], [0, 0, 1]),  # integrated white noise
        ([1, 0, -2, 0, 1], [1, 0, 0.5, 0, 0.2, 0, 3]),  # touches zero at 1
        ([1], [1, 0, 1, 0, 1]),  # complex poles
        ([2, 0, 1], [4, 0, 4, 0, 1, 0, 0.5]),
    ],
)
def test_a_rational_spectrum_is_the_roads_own(numerator, denominator):
    ground = spectrum(numerator, denominator)
    want = np.polyval(numerator[::-1], KAPPA) / np.polyval(denominator[::-1], KAPPA)
    np.testing.assert_allclose(density(ground), want, rtol=1e-9, atol=1e-12 * want.max())
    np.testing.assert_allclose(
        density(spectrum(numerator, denominator, sides=2)), 2 * density(ground), rtol=1e-12, atol=1e-15
    )


@pytest.mark.parametrize(
    ("numerator", "denominator", "words"),
    [
        ([1], [1], "not proper"),
        ([1, 0, 1], [1, 0, 1], "degrees are 2 and 2"),
        ([1, 0, -1], [1, 0, 1, 0, 1], "negative at the wavenumber"),
        ([1, 0, -3, 0, 1], [1, 0, 1, 0, 1, 0, 1], "negative at the wavenumber"),
        ([-1], [1, 0, 1], "negative"),
        ([1], [1, 0, -1], "negative"),
        ([1], [1, 0, -2, 0, 1], "infinite at the wavenumber 1"),
        ([1, 1], [1, 0, 1], "kappa^1 must be 0"),
        ([0], [1, 0, 1], "not all zero"),
        ([], [1, 0, 1], "not all zero"),
        ("1", [1, 0, 1], "list of coefficients"),
        ([symbol("a")], [1, 0, 1], "a number is wanted here"),
    ],
)
def test_what_is_no_spectrum_is_refused(numerator, denominator, words):
    with pytest.raises(ModelError) as caught:
        spectrum(numerator, denominator)
    assert words in str(caught.value)


def test_a_cascade_of_sections_is_the_product():
    ground = sections([(1, 0.5), 3], [0.1, 2, (5, 0.2), 7], sp.Rational(1, 100))
    p = 1j * KAPPA
    H = 0.01 * (p**2 + p + 1) * (p + 3) / ((p + 0.1) * (p + 2) * (p**2 + 2 * p + 25) * (p + 7))
    np.testing.assert_allclose(density(ground), abs(H) ** 2 / np.pi, rtol=1e-9)
    with pytest.raises(ModelError, match="more poles than zeros"):
        sections([1], [2], 1)


# ------------------------------------------------------------------ contact


@pytest.mark.parametrize(
    "road",
    [
        exponential(1, 0.8),
        second_order(1, 0.2, 0.4),
        iso8608("C"),
        spectrum([1], [1, 0, 1, 0, 1]),
        sections([1], [0.1, 2], 1),
    ],
)
def test_a_rolling_contact_is_a_low_pass_in_distance(road):
    rolled = road.rolling_contact(8)
    np.testing.assert_allclose(density(rolled), density(road) * 64 / (KAPPA**2 + 64), rtol=1e-9)
    assert rolled.shaping_filter().states[0] == "height"


def test_the_rolled_exponential_has_height_and_slope_as_states():
    """R40: h'' + (al + be) h' + al be h = k w; R45: var h = be/(al + be), var h' = al be^2/(al + be)."""
    road = exponential(1, 0.8).rolling_contact(8).shaping_filter()
    assert road.states == ("height", "slope")
    assert [list(row) for row in road.C.tolist()] == [[0, 1], [-sp.Rational(32, 5), -sp.Rational(44, 5)]]
    assert float(road.D[1]) == pytest.approx(8 * np.sqrt(1.6))
    assert list(road.F) == [1, 0]
    from scipy.linalg import solve_continuous_lyapunov

    C, D = numbers(road.C), numbers(road.D)
    P = solve_continuous_lyapunov(C, -D @ D.T)
    np.testing.assert_allclose(np.diag(P), [0.9090909090909091, 5.818181818181818], rtol=1e-12)


@pytest.mark.parametrize("order", range(1, 9))
def test_a_contact_patch_averages_over_its_length(order):
    length = 0.4
    ground = exponential(1, 0.8).contact_patch(length, order)
    low = KAPPA[KAPPA * length < 0.5 + order / 2]
    gain = density(ground, low) / density(exponential(1, 0.8), low)
    np.testing.assert_allclose(gain, np.sinc(low * length / 2 / np.pi) ** 2, atol=0.13 * 0.15 ** (order - 1) + 2e-4)
    C = numbers(ground.shaping_filter().C)
    assert np.linalg.eigvals(C).real.max() < 0


def test_a_patch_of_even_order_smooths_twice():
    road = iso8608("C", cutoff=0.1).contact_patch(0.2, 2).shaping_filter()
    assert (road.F * road.D).is_zero_matrix
    assert (road.F * road.C * road.D).is_zero_matrix
    assert "Pade" in iso8608("C").contact_patch(0.2).note


@pytest.mark.parametrize("order", [0, 13, 1.5, True])
def test_a_patch_of_no_order_is_refused(order):
    with pytest.raises(ModelError, match="order 1 to 12"):
        exponential(1, 1).contact_patch(0.2, order)


# ------------------------------------------------------------------ profiles and places


def height_along(ground: Ground, s: np.ndarray) -> np.ndarray:
    """Mean height along the road from rest, by small steps."""
    from scipy.integrate import solve_ivp

    road = ground.shaping_filter()
    C, F = numbers(road.C), numbers(road.F)
    cuts = [s[0], *(float(b) for b in ground.breakpoints if s[0] < b < s[-1]), s[-1]]

    def rate(position, state):
        offset = np.array([evaluate(e, {DISTANCE: position}) for e in road.offset])
        return C @ state + offset

    state, found = np.zeros(len(C)), np.zeros(0)
    for a, b in pairwise(cuts):
        last = s <= b if b == s[-1] else s < b
        at = s[(s >= a) & last]
        run = solve_ivp(rate, (a, b), state, t_eval=np.unique([*at, b]), rtol=1e-10, atol=1e-12)
        found = np.append(found, (F @ run.y)[0][: len(at)])
        state = run.y[:, -1]
    return found + np.array([evaluate(road.profile, {DISTANCE: position}) for position in s])


@pytest.mark.parametrize("road", [exponential(1, 0.8), second_order(1, 0.2, 0.4), spectrum([1], [1, 0, 1, 0, 1])])
def test_a_step_in_the_profile_goes_through_the_rolling_contact(road):
    """The answer of u' = be (g - u) to a unit step at s = 1 is 1 - exp(-be (s - 1))."""
    s = np.linspace(0, 3, 31)
    ground = road.with_profile(parse("1 if s > 1 else 0")).rolling_contact(5)
    want = np.where(s > 1, 1 - np.exp(-5 * (s - 1)), 0)
    np.testing.assert_allclose(height_along(ground, s), want, atol=1e-8)


def test_a_profile_is_zero_before_the_start_unless_it_says_otherwise():
    quiet = exponential(1, 1).with_profile(parse("0.1*cos(s)")).shaping_filter().profile
    assert [evaluate(quiet, {DISTANCE: s}) for s in (-1, 0, np.pi)] == pytest.approx([0, 0.1, -0.1])
    own = exponential(1, 1).with_profile(parse("2 if s < 0 else 0.1*cos(s)")).shaping_filter().profile
    assert evaluate(own, {DISTANCE: -1}) == 2
    inside = exponential(1, 1).with_profile(parse("0.1 if 1 < s < 2 else 0")).shaping_filter().profile
    assert evaluate(inside, {DISTANCE: 1.5}) == 0.1


def test_places_where_the_road_changes_are_known():
    ground = exponential(parse("0.01 if s < 50 else L"), 0.2).with_profile(parse("0.05 if a < s < a + 0.5 else 0"))
    assert set(ground.breakpoints) == {0, 50, symbol("a"), symbol("a") + sp.Rational(1, 2)}
    assert exponential(1, 0.2).breakpoints == ()
    bump = loads(ROAD.format("profile = { table = [[1, 0], [1.5, 0.05], [2, 0]] }")).ground
    assert bump is not None
    assert isinstance(bump.profile, Lookup)
    assert bump.breakpoints == (0, 1, sp.Rational(3, 2), 2)
    assert exponential(1, 0.2).with_profile(parse("abs(s**2 - 4)")).breakpoints == (-2, 0, 2)


# ------------------------------------------------------------------ what a road must bear

ROAD = """
schema = 1
[rates]
x = "v"
v = "-x - v - der(h, 2)"
[contacts]
h = {{}}
[travel]
speed = 20
[ground]
kind = "exponential"
sigma = 0.01
cutoff = 0.2
rolling_contact = 2
{}
"""


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('profile = "0.1 if 5 < s < 6 else 0"', "jumps at s = 5"),
        ('profile = "0.1*cos(s)"', "jumps at s = 0"),
        ('profile = "x"', "belongs to the vehicle"),
        ('profile = "t"', "time, `t`"),
        ("profile = { table = [[1, 0], [1, 1]] }", "row 2: the same position"),
        ("profile = { table = [[1, 0], [2]] }", "row 2 of the table"),
        ('profile = { table = [[1, 0], [2, "q"]] }', "undeclared name `q`"),
        ('profile = { table = "x.csv" }', "no folder"),
        ("contact_patch = { order = 2 }", "`length` is missing"),
        ("contact_patch = -1", "positive"),
        ("class = 'A'", "unknown key `class`"),
    ],
)
def test_a_road_that_does_not_bear_the_vehicle_is_refused(line, words):
    with pytest.raises(ModelError) as caught:
        loads(ROAD.format(line))
    assert words in str(caught.value)
    assert "[ground" in str(caught.value)


@pytest.mark.parametrize(
    "line",
    [
        'profile = "0.05*(1 - cos(pi*s))/2 if s < 4 else 0"',
        'profile = "sin(s)"',
        "profile = { table = [[1, 0], [1.5, 0.05], [2, 0]] }",
        'contact_patch = 0.2\nprofile = "0.1 if 5 < s < 6 else 0"',
        "contact_patch = { length = 0.2, order = 3 }",
    ],
)
def test_a_road_that_does_is_read(line):
    model = loads(ROAD.format(line))
    assert loads(model.to_toml()) == model


def test_a_coefficient_that_jumps_is_refused_only_where_it_hurts():
    text = ROAD.replace("rolling_contact = 2", 'rolling_contact = "2 if s < 50 else 4"').format("")
    with pytest.raises(ModelError, match="slope of the ground jumps at s = 50"):
        loads(text)
    assert loads(text.replace("der(h, 2)", "der(h)"))
    assert loads(ROAD.replace("sigma = 0.01", 'sigma = "0.01 if s < 50 else 0.02"').format(""))


def kind(text: str) -> Model:
    lines = ROAD.format("").replace("sigma = 0.01\ncutoff = 0.2\nrolling_contact = 2", "").replace("der(h, 2)", "h")
    return loads(lines.replace('kind = "exponential"', text))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('kind = "iso8608"', "neither given"),
        ('kind = "iso8608"\nclass = "I"', "A to H"),
        ('kind = "iso8608"\nclass = "A"\ngd = 1', "both given"),
        ('kind = "iso8608"\nclass = "A"\nn0 = 1', "stated at n0 = 0.1"),
        ('kind = "iso8608"\nclass = "A"\nwaviness = 2.5', "needs a `cutoff`"),
        ('kind = "iso8608"\nclass = "A"\nwaviness = 5\ncutoff = 0.1', "between 1 and 3.9"),
        ('kind = "iso8608"\nclass = "A"\nwaviness = 2.5\ncutoff = 0.1\norder = 99', "order 2 to 12"),
        ('kind = "iso8608"\ngd = 1\nn0 = 0.1\nomega0 = 1', "both given"),
        ('kind = "iso8608"\ngd = 1\ncutoff = 0', "positive"),
        ('kind = "spectrum"\nnumerator = [1]', "`denominator` is missing"),
        ('kind = "spectrum"\nnumerator = [1]\ndenominator = [1]', "not proper"),
        ('kind = "spectrum"\nnumerator = "1"\ndenominator = [1, 0, 1]', "a list is wanted"),
        ('kind = "spectrum"\nnumerator = [1]\ndenominator = [1, 0, 1]\nsides = 3', "1 or 2 sides"),
        ('kind = "second_order"\nsigma = 1\ncutoff = 1', "`wavenumber` is missing"),
        ('kind = "shaping_filter"\nrates = { h = "-h" }', "`height` is missing"),
        ('kind = "shaping_filter"\nrates = { h = "-h + w" }\nheight = "h"', "undeclared name `w`"),
        ('kind = "shaping_filter"\nrates = { h = "-h*w" }\nnoise = { w = 1 }\nheight = "h"', "not linear"),
        ('kind = "shaping_filter"\nrates = { h = "-h + w" }\nnoise = { w = -1 }\nheight = "h"', "is wanted, not -1"),
        ('kind = "shaping_filter"\nrates = { h = "-h + w" }\nnoise = { h = 1 }\nheight = "h"', "state and a noise"),
        ('kind = "shaping_filter"\nrates = { h = "-h + w" }\nnoise = { w = 1 }\nheight = "h*w"', "white noise"),
        (
            'kind = "shaping_filter"\nrates = { h = "-x + w" }\nnoise = { w = 1 }\nheight = "h"',
            "belongs to the vehicle",
        ),
        ('kind = "shaping_filter"\nrates = {}\nheight = "0"', "at least one state"),
        ('kind = "sections"\nzeros = []\npoles = []\ngain = 1', "more poles than zeros"),
        ('kind = "sections"\nzeros = []\npoles = [[1, 2, 3]]\ngain = 1', "[wavenumber, damping]"),
        ('kind = "profile"', "`table` is missing"),
    ],
)
def test_wrong_declarations_of_each_kind_are_named(text, words):
    with pytest.raises(ModelError) as caught:
        kind(text)
    assert words in str(caught.value)
    assert "[ground" in str(caught.value) or "[initial]" in str(caught.value)


def test_the_spectrum_may_be_declared_in_the_file():
    found = kind('kind = "spectrum"\nnumerator = [1]\ndenominator = [1, 0, 1, 0, 1]')
    assert found.ground == spectrum([1], [1, 0, 1, 0, 1])
    assert loads(found.to_toml()) == found


# ------------------------------------------------------------------ measured roads


def sampled(ground: Ground, step: float, count: int, seed: int = 0) -> np.ndarray:
    """A sample of the road at equal steps, exact in law."""
    from scipy.linalg import expm, solve_continuous_lyapunov

    road = ground.shaping_filter()
    C, D, Q, F = (numbers(m) for m in (road.C, road.D, road.Q, road.F))
    P = solve_continuous_lyapunov(C, -D @ Q @ D.T)
    A = expm(C * step)
    rng = np.random.default_rng(seed)
    jump = np.linalg.cholesky(P - A @ P @ A.T + 1e-14 * np.trace(P) * np.eye(len(P)))
    state = np.linalg.cholesky(P + 1e-14 * np.trace(P) * np.eye(len(P))) @ rng.standard_normal(len(P))
    heights = np.empty(count)
    noise = rng.standard_normal((count, len(P))) @ jump.T
    for k in range(count):
        heights[k] = (F @ state)[0]
        state = A @ state + noise[k]
    return heights


@pytest.mark.parametrize(
    "ground",
    [
        exponential(0.01, 0.2),
        second_order(0.02, 0.2, 0.6),
        iso8608("C", cutoff=0.05).rolling_contact(3),
        iso8608("A", cutoff=0.05, waviness=2.6),
        spectrum([1e-5], [0.04, 0, 1, 0, 1]),
        exponential(0.01, 0.2).contact_patch(0.5),
        shaping_filter({"h": parse("-h/5 + 2*w")}, noise={"w": parse("1e-4")}, height=parse("h")),
    ],
    ids=["exponential", "second order", "ISO rolled", "waviness", "spectrum", "patch", "own equations"],
)
def test_the_welch_spectrum_of_a_sample_is_the_declared_one(ground):
    from cadet_sym.language.roadfit import welch

    heights = sampled(ground, 0.25, 40_000)
    kappa, found, weight = welch(heights, 0.25)
    high = kappa > 0.03
    ratio = found[high] / density(ground, kappa[high])
    # (number of lines, times the effective number of segments) gives the scatter of each point
    scatter = 1 / (weight[high] * np.sqrt(3.6))
    assert np.all(np.abs(ratio - 1) < 5 * scatter + 0.05)


def test_a_filter_fitted_to_a_sample_is_the_filter_that_made_it():
    from cadet_sym.language.roadfit import fit_profile

    made = exponential(0.01, 0.2)
    heights = sampled(made, 0.2, 20_000)
    fit = fit_profile(np.arange(20_000) * 0.2, heights, order=1)
    band = np.geomspace(0.05, 5, 20)
    np.testing.assert_allclose(density(fit.ground, band), density(made, band), rtol=0.25)
    assert fit.error < 0.2
    np.testing.assert_allclose(density(fit.ground, fit.wavenumber), fit.fitted, rtol=1e-8)


def test_a_fit_finds_the_dominant_wave_of_a_road():
    from cadet_sym.language.roadfit import fit_profile

    made = second_order(0.02, 0.05, 0.8)
    fit = fit_profile(np.arange(16_000) * 0.25, sampled(made, 0.25, 16_000), order=2)
    peak = fit.wavenumber[np.argmax(fit.fitted)]
    assert 0.65 < peak < 0.95


def test_a_spectrum_that_is_negative_only_at_large_wavenumbers_is_refused_there():
    with pytest.raises(ModelError, match=r"negative at the wavenumber 2\.449: the numerator is -3 there"):
        spectral_factor([3.0, 0.0, -1.0], [1.0, 0.0, 2.0, 0.0, 1.0])


@pytest.mark.parametrize("order", [2, 4, 5])
def test_a_fitted_road_does_not_depend_on_rounding(order):
    from cadet_sym.language.roadfit import fit_profile

    distance, height = np.loadtxt(MEASURED, delimiter=",", skiprows=1, unpack=True)
    wobble = 1 + 1e-14 * np.random.default_rng(order).standard_normal(height.size)
    first, second = (fit_profile(distance, h, order).ground for h in (height, height * wobble))
    assert first == second


def test_a_measured_spectrum_is_fitted_too(tmp_path):
    n = np.geomspace(0.01, 3, 60)
    G = 256e-6 * (n / 0.1) ** -2.2
    rows = "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(n, G, strict=True))
    (tmp_path / "psd.csv").write_text(f"n [cycle/m],G [m^3]\n{rows}\n")
    declared = 'kind = "spectrum"\ntable = "psd.csv"\nunits = ["cycle/m", "m^3"]\norder = 3'
    text = ROAD.format("").replace('kind = "exponential"\nsigma = 0.01\ncutoff = 0.2\nrolling_contact = 2', declared)
    model = loads(text.replace("der(h, 2)", "h"), folder=tmp_path)
    assert model.ground is not None
    assert model.ground.kind == "sections"
    found = density(model.ground, 2 * np.pi * n) * 2 * np.pi
    assert np.abs(np.log10(found / G)).max() < 0.1
    assert loads(model.to_toml()) == model
    rows = "\n".join(f"{2 * np.pi * a:.12g},{b / (2 * np.pi):.12g}" for a, b in zip(n, G, strict=True))
    (tmp_path / "psd.csv").write_text(f"kappa,G\n{rows}\n")
    per_radian = declared.replace("cycle/m", "rad/m").replace("m^3", "m^3/rad")
    again = loads(text.replace(declared, per_radian).replace("der(h, 2)", "h"), folder=tmp_path).ground
    assert again is not None
    np.testing.assert_allclose(density(again), density(model.ground), rtol=1e-4)
    with pytest.raises(ModelError, match="say what the spectrum is against"):
        loads(text.replace('units = ["cycle/m", "m^3"]', "").replace("der(h, 2)", "h"), folder=tmp_path)


def test_a_fit_can_be_drawn(tmp_path):
    from cadet_sym.language.roadfit import fit_spectrum

    kappa = np.geomspace(0.1, 10, 30)
    fit = fit_spectrum(kappa, 1e-5 / (kappa**2 + 0.04), order=1)
    assert fit.error < 0.05
    fit.plot(tmp_path / "fit.png")
    assert (tmp_path / "fit.png").stat().st_size > 1000


def test_measured_roads_that_cannot_be_fitted_are_refused():
    from cadet_sym.language.roadfit import fit_profile, fit_spectrum

    s = np.arange(100) * 0.1
    gap = np.concatenate([s[:50], s[50:] + 0.05])
    for distance, height, words in [
        (gap, np.sin(gap), "before row 51"),
        (s[:20], s[:20], "64 or more"),
        (s, 0 * s, "flat"),
        (s, np.where(s == s[3], np.nan, s), "finite"),
        (s, s[:-1], "one length"),
    ]:
        with pytest.raises(ModelError, match=words):
            fit_profile(distance, height)
    with pytest.raises(ModelError, match="positive: 1, -1 in row 1"):
        fit_spectrum([1, 2, 3, 4], [-1, 1, 1, 1])
    with pytest.raises(ModelError, match="too short"):
        fit_spectrum([1, 2], [1, 1], order=2)
    with pytest.raises(ModelError, match="order 1 to 8"):
        fit_spectrum([1, 2], [1, 1], order=0)


def test_a_profile_road_is_read_from_its_file(tmp_path):
    heights = sampled(exponential(0.01, 0.2), 0.25, 4000)
    rows = "\n".join(f"{250 * k},{1000 * h:.6f}" for k, h in enumerate(heights))
    (tmp_path / "road.csv").write_text(f"s,h\n{rows}\n")
    declared = 'kind = "profile"\ntable = "road.csv"\nunits = ["mm", "mm"]\norder = 2'
    text = ROAD.format("").replace('kind = "exponential"\nsigma = 0.01\ncutoff = 0.2\nrolling_contact = 2', declared)
    model = loads(text.replace("der(h, 2)", "h"), folder=tmp_path)
    assert model.ground is not None
    assert variance(model.ground) == pytest.approx(np.var(heights), rel=0.5)
    with pytest.raises(ModelError, match="a length is wanted, and `N` is none"):
        loads(text.replace('["mm", "mm"]', '["mm", "N"]'), folder=tmp_path)


def test_reference_table_of_classes():
    reference = Path(__file__).parent / "data" / "reference_cases.json"
    if not reference.is_file():
        pytest.skip("the reference cases are not here")
    cases = {case["id"]: case for case in json.loads(reference.read_text())["cases"]}
    for letter, row in cases["R50"]["value"]["classes"].items():
        assert 20 * float(iso8608(letter).shaping_filter().Q[0]) == pytest.approx(row["Q_V20"], rel=1e-12)
