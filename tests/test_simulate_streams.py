"""Random numbers: normal, independent from path to path, and the same wherever they are drawn."""

from __future__ import annotations

import numpy as np
from scipy import stats

from cadet_sym.simulation.streams import HEIGHT, TAIL, WIDTH, Streams, ziggurat


def test_layers_have_equal_area_and_end_at_the_top():
    areas = WIDTH[1:-1] * np.diff(HEIGHT[1:])
    assert np.allclose(areas, 0.00492867323399, rtol=1e-9)
    assert WIDTH[1] == TAIL
    assert HEIGHT[-1] == 1.0
    tail = TAIL * HEIGHT[1] + np.sqrt(2 * np.pi) * stats.norm.sf(TAIL)
    assert np.isclose(tail, 0.00492867323399, rtol=1e-9)


def test_deviates_are_normal_in_the_middle_and_in_the_tails():
    z = Streams.of(seed=3, first=0, count=2000, purpose=2).normals(500).ravel()
    n = len(z)
    for power, value, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)):
        assert abs((z**power).mean() - value) < 4 * np.sqrt(variance / n)
    edges = np.concatenate([[-np.inf], np.linspace(-4.2, 4.2, 85), [np.inf]])
    expected = n * np.diff(stats.norm.cdf(edges))
    counts = np.histogram(z, edges)[0]
    assert stats.chi2.sf(((counts - expected) ** 2 / expected).sum(), len(counts) - 1) > 1e-4
    beyond = np.count_nonzero(np.abs(z) > TAIL)
    assert abs(beyond - 2 * n * stats.norm.sf(TAIL)) < 4 * np.sqrt(2 * n * stats.norm.sf(TAIL))


def test_paths_purposes_seeds_and_lags_are_uncorrelated():
    draws = {key: Streams.of(key[0], 0, 500, key[1]).normals(400) for key in ((0, 0), (0, 1), (1, 0))}
    z = draws[0, 0]
    others = [draws[0, 1], draws[1, 0], np.roll(z, 1, axis=0), np.roll(z, 1, axis=1), np.roll(z, 7, axis=1)]
    for other in others:
        for f in (lambda x: x, lambda x: x**2 - 1):
            product = f(z) * f(other)
            assert abs(product.mean()) < 4.5 * product.std() / np.sqrt(product.size)


def test_a_draw_belongs_to_its_path_and_number():
    whole = Streams.of(seed=9, first=0, count=40, purpose=1).normals(30)
    part = Streams.of(seed=9, first=25, count=10, purpose=1)
    assert np.array_equal(np.vstack([part.normals(12), part.normals(18)]), whole[:, 25:35])


def test_compiled_draws_are_the_same_numbers():
    from cadet_sym.simulation import fast

    streams = Streams.of(seed=5, first=0, count=fast.LANES, purpose=0)
    state, out = streams.state.copy(), np.zeros(3000 * fast.LANES)
    fast._draw(state, streams.gamma, out, 0, 3000, np.zeros(fast.LANES, np.uint64), np.zeros(fast.LANES + 1, np.int64))
    expected = streams.normals(3000)
    assert np.allclose(out.reshape(3000, -1), expected, rtol=1e-14)
    assert np.array_equal(state, streams.state)


def test_rejected_bits_still_give_normal_deviates():
    bits = np.random.default_rng(1).integers(0, 2**64, 400_000, dtype=np.uint64)
    late = bits[np.abs(ziggurat(bits)) > 2.0]
    share = len(late) / len(bits)
    assert abs(share - 2 * stats.norm.sf(2.0)) < 4 * np.sqrt(share / len(bits))
