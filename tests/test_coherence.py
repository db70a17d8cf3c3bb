"""Left and right tracks on one ground: spectra, coherence, and what the vehicle feels of them."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_models import toml
from scipy.special import k1

import cadet_sym as cs
from cadet_sym.language.coherence import ISOTROPIC_ERROR
from cadet_sym.language.expression import DISTANCE
from cadet_sym.language.modelfile import loads

ROAD = cs.exponential(sigma=0.01, cutoff=0.3).rolling_contact(cutoff=4)


def transfer(road: cs.ShapingFilter, kappa: float) -> complex:
    C, D, F = (np.array(m, dtype=float) for m in (road.C, road.D, road.F))
    return (F @ np.linalg.solve(1j * kappa * np.eye(len(C)) - C, D))[0, 0]


def spectra(ground: cs.Ground, kappa: float) -> tuple[float, float, float]:
    """Spectrum of the left and right track, and their cross spectrum."""
    parts = {track: ground.filters(track) for track in ("left", "right")}
    left, right = ([weight * transfer(road, kappa) for _, road, weight in parts[t]] for t in ("left", "right"))
    cross = sum(a * b.conjugate() for a, b in zip(left, right, strict=True))
    return sum(abs(a) ** 2 for a in left), sum(abs(b) ** 2 for b in right), cross


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 10), st.floats(0.0, 1.0), st.floats(0.01, 20))
def test_spectra_and_coherence_are_what_was_declared(width, share, kappa):
    ground = ROAD.coherent(["left", "right"], [share], [1.0, 0.0, width**2])
    own = abs(transfer(ROAD.shaping_filter(), kappa)) ** 2
    left, right, cross = spectra(ground, kappa)
    assert left == pytest.approx(own, rel=1e-9)
    assert right == pytest.approx(own, rel=1e-9)
    assert cross == pytest.approx(own * share / (1 + (width * kappa) ** 2), rel=1e-8, abs=1e-10 * own)


@pytest.mark.parametrize("kappa", [0.01, 0.1, 0.5, 1.0, 3.0, 8.0])
def test_isotropic_ground_has_the_coherence_of_its_bessel_function(kappa):
    left, _, cross = spectra(ROAD.coherent(["left", "right"], width=1.6), kappa)
    x = 1.6 * kappa
    assert abs(cross / left - x * k1(x)) < ISOTROPIC_ERROR


MODEL = """
name = "roll"
[rates]
x = "v"
v = "-100*x - 4*v + 100*(a + b)/2"
p = "q"
q = "-80*p - 4*q + 80*(a - b)"
[contacts]
a = {{ track = "left" }}
b = {{ track = "right" }}
c = {{ track = "right", setback = 1.5 }}
[ground]
kind = "exponential"
sigma = 0.01
cutoff = 0.3
rolling_contact = 4.0
{coherence}
[travel]
speed = "5 + t"
[outputs]
front = "a"
right = "b"
apart = "a - b"
rear = "b - c"
[run]
duration = 2.0
"""
COHERENT = '[ground.coherence]\ntracks = ["left", "right"]\n'


def history(coherence: str) -> cs.MomentHistory:
    return cs.compile(toml(MODEL.format(coherence=coherence))).propagate([0.0, 2.0], rtol=1e-9)


def test_tracks_without_coherence_are_independent():
    alone, none = history(""), history(COHERENT + "numerator = [0.0]\ndenominator = [1.0]")
    for name in ("x", "p", "front", "right", "apart", "rear"):
        np.testing.assert_allclose(alone.variance[name], none.variance[name], rtol=1e-7)


def test_tracks_of_full_coherence_are_one():
    full = history(COHERENT + "numerator = [1.0]\ndenominator = [1.0]")
    np.testing.assert_allclose(full.variance["apart"], 0.0, atol=1e-15)
    np.testing.assert_allclose(full.variance["p"], 0.0, atol=1e-15)
    np.testing.assert_allclose(full.variance["front"], history("").variance["front"], rtol=1e-9)


@pytest.mark.parametrize("share", [1.0, -1.0])
@pytest.mark.parametrize("road", [ROAD, ROAD.contact_patch(0.3, 6), ROAD.with_profile(sp.sin(DISTANCE))])
def test_full_coherence_needs_one_filter_whatever_the_road(road, share):
    """The other had no noise: its variance, zero but for roundings, kept stationary moments from being found."""
    ground = road.coherent(["left", "right"], [share], [1.0])
    profile = road.profile is not None
    assert len(ground.filters("left")) == (2 if share < 0 and profile else 1)
    x, a, b = sp.symbols("x a b")
    contacts = {a: cs.Contact(track="left"), b: cs.Contact(track="right", setback=1)}
    together = cs.Model(cs.Vehicle({x: -3 * x + a + int(share) * b}, contacts), ground, cs.Travel(speed=5))
    one_track = cs.Vehicle({x: -3 * x + a + b}, {a: cs.Contact(), b: cs.Contact(setback=1)})
    alone = cs.Model(one_track, road, cs.Travel(speed=5))
    if not profile:
        found, want = (cs.compile(model).stationary() for model in (together, alone))
        assert found.variance["x"] == pytest.approx(want.variance["x"], rel=1e-9)


def test_partial_coherence_lies_between_and_keeps_the_variance_of_each_track():
    some = history(COHERENT + "width = 1.6")
    alone = history("")
    for name in ("front", "right", "rear"):
        np.testing.assert_allclose(some.variance[name], alone.variance[name], rtol=1e-6)
    assert (some.variance["p"][1:] < alone.variance["p"][1:]).all()
    assert (some.variance["x"][1:] > alone.variance["x"][1:]).all()


def test_simulated_tracks_share_what_was_declared():
    model = toml(MODEL.format(coherence=COHERENT + "width = 1.6"))
    times = [1.0, 2.0]
    exact = cs.compile(model).propagate(times, rtol=1e-8)
    truth = cs.simulate(model, paths=4000, seed=3, times=times)
    for name in ("x", "p", "apart", "rear"):
        error = np.abs(np.asarray(exact.variance[name]) - np.asarray(truth.variance[name]))
        assert (error < 4.5 * np.asarray(truth.variance_standard_error[name])).all(), name


def test_the_model_file_gives_the_model_back():
    model = loads("schema = 1\n" + MODEL.format(coherence=COHERENT + "width = 1.6"))
    assert loads(model.to_toml()) == model


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("numerator = [1.2]\ndenominator = [1.0]", "lies between -1 and 1"),
        ("numerator = [1.0]\ndenominator = [1.0, 0.5]", "even"),
        ("width = -1", "positive width"),
        ("width = 1.0\nnumerator = [1.0]", "numerator"),
        ("numerator = [1.0, 0, 1.0]\ndenominator = [1.0]", "lies between -1 and 1"),
    ],
)
def test_a_coherence_that_cannot_be_is_refused(table, message):
    with pytest.raises(cs.ModelError, match=message):
        loads("schema = 1\n" + MODEL.format(coherence=COHERENT + table))


SAYS = {
    "above 1": ("numerator = [1.0, 0, 3.0]\ndenominator = [1.0, 0, 1.0, 0, 1.0]", "1.333 at the wavenumber 1"),
    "below -1": ("numerator = [-2.0]\ndenominator = [1.0, 0, 1.0]", "-2 at the wavenumber 0"),
    "infinite": ("numerator = [1.0]\ndenominator = [4.0, 0, -1.0]", "denominator of this one is 0 at the wavenumber 2"),
}


def three_tracks(tracks: str, coherence: str = "width = 1.5") -> cs.Model:
    return loads(
        f"""
        schema = 1
        name = "three tracks"
        [rates]
        x = "v"
        v = "-60*x - 3*v + 20*(a + b + c + d)"
        [contacts]
        a = {{ track = "left" }}
        b = {{ track = "right" }}
        c = {{ track = "trailer" }}
        d = {{ track = "trailer", setback = 2.0 }}
        [ground]
        kind = "exponential"
        sigma = 0.02
        cutoff = 0.3
        rolling_contact = 3.0
        [ground.coherence]
        tracks = [{tracks}]
        {coherence}
        [travel]
        speed = 5
        [run]
        duration = 1.0
        """
    )


@pytest.mark.parametrize("case", SAYS)
def test_a_coherence_that_is_none_is_refused_with_the_wavenumber(case):
    coherence, words = SAYS[case]
    with pytest.raises(cs.ModelError, match=words):
        three_tracks('"left", "right"', coherence)


def test_coherence_of_a_track_without_wheels_is_refused():
    with pytest.raises(cs.ModelError, match="no contact is on track `rigth`; did you mean `right`"):
        three_tracks('"left", "rigth"')


def test_a_third_track_apart_from_a_coherent_pair_is_independent():
    history = cs.compile(three_tracks('"left", "right"')).propagate([0.0, 1.0], rtol=1e-9)
    pair = [name for name in history.states if name.startswith(("a.", "b."))]
    for name in pair:
        assert history.covariance[name, "c.height"] == pytest.approx(0.0, abs=1e-18)
    assert history.variance["c.height"][1] == pytest.approx(0.02**2 * 3.0 / 3.3, rel=1e-8)
