"""Curves of stationary solutions: followed through folds, judged along the way, each found once."""

from dataclasses import replace

import numpy as np
import pytest
from stationary_systems import cubic, problem, sine
from test_stationary import chain, quarter_car, two_wheels

from cadet_sym.errors import SolverError
from cadet_sym.solve.branches import find_branches, follow_branches
from cadet_sym.solve.stationary import stationary_point


def bistable(Q: float, load: float = 0.0):
    """x' = x - x^3 + load + w."""
    return problem([[1]], [[-1]], [[1]], [cubic()], [[Q]], c=[load])


@pytest.fixture(scope="module", name="wells")
def _wells():
    return find_branches(bistable, (0.02, 0.6), "Q")


def test_the_bistable_equation_has_three_branches_and_two_folds(wells):
    assert len(wells.branches) == 3
    # closed form: m^2 = 1 - 3 s there, so that 6 s^2 - 2 s + Q / 2 = 0, whose roots meet at Q = 1/3
    np.testing.assert_allclose(wells.folds, [1 / 3, 1 / 3], rtol=1e-9)
    assert wells.parameter == "Q"


def test_every_point_of_a_branch_is_a_solution(wells):
    for branch in wells.branches:
        m, s, Q = branch.mean[:, 0], branch.covariance[:, 0, 0], branch.parameter
        np.testing.assert_allclose(m - m**3 - 3 * m * s, 0, atol=1e-9)
        np.testing.assert_allclose(2 * (1 - 3 * (m * m + s)) * s + Q, 0, atol=1e-9)
        assert np.all(s > 0)
        assert branch.residual.max() < 1e-10


def test_stability_changes_at_the_folds(wells):
    for branch in wells.branches:
        away = np.abs(branch.rightmost.real) > 1e-6
        np.testing.assert_array_equal(branch.stable[away], branch.rightmost.real[away] < 0)
        if not branch.folds:
            assert branch.stable.all()
            assert branch.pieces() == [(slice(0, len(branch)), True)]
        else:
            (solid, first), (dashed, second) = branch.pieces()
            assert first != second
            assert abs(solid.stop - 1 - branch.folds[0]) <= 1
            assert dashed.start == solid.stop - 1


def test_branches_reach_both_ends_of_the_range(wells):
    ends = {(round(b.parameter[0], 9), round(b.parameter[-1], 9)) for b in wells.branches}
    assert {frozenset(pair) for pair in ends} == {frozenset({0.02, 0.6}), frozenset({0.02})}
    assert all("the end of the range" in b.end for b in wells.branches)


@pytest.mark.parametrize(("Q", "count"), [(0.1, 5), (0.3, 5), (0.4, 1)])
def test_a_value_is_crossed_by_all_its_solutions(wells, Q, count):
    assert len(wells.at(Q)) == count


def test_hysteresis_in_the_load():
    """A load tips the state from well to well over a wide state between them: one curve, four folds, three stable."""
    found = find_branches(lambda load: bistable(0.01, load), (-0.6, 0.6), "load")
    assert len(found.branches) == 1
    branch = found.branches[0]
    assert [stable for _, stable in branch.pieces()] == [True, False, True, False, True]
    np.testing.assert_allclose(found.folds, -found.folds[::-1], rtol=1e-6)
    # without noise it is 2 / (3 sqrt 3) = 0.385; noise tips it earlier
    assert 0.3 < found.folds[-1] < 0.385
    assert len(found.folds) == 4


def test_a_fold_is_where_a_phase_locked_loop_loses_lock():
    found = find_branches(lambda Q: problem([[0]], [[-1]], [[1]], [sine()], [[Q]]), (0.2, 2.0), "Q")
    np.testing.assert_allclose(found.folds, [4 / np.e], rtol=1e-9)


def test_a_linear_system_has_one_straight_branch():
    def family(Q):
        return problem([[-2]], np.zeros((1, 0)), np.zeros((0, 1)), [], [[Q]])

    found = find_branches(family, (1.0, 3.0))
    assert len(found.branches) == 1
    branch = found.branches[0]
    np.testing.assert_allclose(branch.covariance[:, 0, 0], branch.parameter / 4, rtol=1e-10)
    assert len(branch) >= 25


def test_a_branch_agrees_with_solutions_found_one_by_one():
    def family(strength):
        p = chain(8)
        return replace(p, b=p.b * strength)

    start = stationary_point(family(1.0))
    found = follow_branches(family, (0.1, 10.0), [(1.0, start)])
    branch = found.branches[0]
    np.testing.assert_allclose([branch.parameter.min(), branch.parameter.max()], [0.1, 10.0])
    for i in range(0, len(branch), 9):
        point = stationary_point(family(branch.parameter[i]))
        np.testing.assert_allclose(branch.covariance[i], point.covariance, atol=1e-8)


def test_wheels_in_one_track_are_followed_in_the_speed():
    def family(time):
        return two_wheels(time, [cubic(0.5)])

    branch = follow_branches(family, (0.5, 1.2), [(0.9, stationary_point(family(0.9)))]).branches[0]
    assert branch.stable.all()
    for i in (0, len(branch) // 2, -1):
        point = stationary_point(family(branch.parameter[i]))
        np.testing.assert_allclose(branch.covariance[i], point.covariance, atol=1e-8)


def test_what_drifts_has_no_value_along_a_branch():
    branch = find_branches(lambda d: quarter_car(damper=d), (100.0, 1000.0)).branches[0]
    drifting = [True, True, False, False, True]
    np.testing.assert_array_equal(np.isnan(branch.mean[0]), drifting)
    np.testing.assert_array_equal(np.isnan(np.diag(branch.covariance[0])), drifting)
    assert np.isfinite(branch.lifted[1]).all()


def test_no_solution_anywhere_is_an_error():
    with pytest.raises(SolverError):
        find_branches(lambda a: problem([[a]], [[1]], [[1]], [cubic()], [[1]]), (1.0, 2.0))
