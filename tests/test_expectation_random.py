"""Random expressions of the language against nested integration: right, or as wrong as is claimed, or refused at once."""

from __future__ import annotations

import random
import time
import warnings

import casadi as ca
import numpy as np
import pytest
from conftest import half
from hypothesis import given, settings
from hypothesis import strategies as st
from nested_integrals import Truth, function_of, truth

from cadet_sym.errors import LinearisationError
from cadet_sym.expectation import describing_function
from cadet_sym.language.expression import parse, symbol
from cadet_sym.lowering.check import check_at
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.measured import measured_error

X, Y = symbol("x"), symbol("y")
NUMBERS = {"a": 1.3, "c": 0.7, "t": 0.6}
LINES = ("{0}", "({0} - 0.5)", "(2*{0} + 1)", "(a*{0} - 0.3)", "(0.7 - {0})", "({0} - c)", "(t*{0} + 0.1)")
KINKED = (
    "abs({0})", "sign({0})", "max({0}, 0)", "min({0}, 1)", "clip({0}, -1, 0.5)", "heaviside({0})", "clip({0}, -c, c)",
    "(1 if {0}**2 > 1 and {0} > 0 else 0.3*{0})", "({0}**2 if {0} > 0 else -{0}**2/10)",
    "(-1 if {0} < -0.5 else {0} if {0} <= c else 1)", "max({0}, 0)**2*sign({0} - c)",
    "sign({0})*max(abs({0}) - c, 0)", "(({0} - 1)**3 if ({0} - 1)*({0} + 2) > 0 else 0)", "abs(abs({0}) - 1)",
)  # fmt: skip
POWERS = (
    "{0}**2", "{0}**3", "abs({0})*{0}", "abs({0})**1.5*sign({0})", "abs({0})**2.3", "abs({0})**c*sign({0})", "sqrt(abs({0}))",
)  # fmt: skip
SMOOTH = (
    "exp(-0.4*{0})", "sin(1.3*{0})", "cos({0})", "tanh({0})", "atan(2*{0})", "erf({0})", "sqrt(1 + {0}**2)", "log(1 + {0}**2)",
    "1/(1 + {0}**2)", "exp(-{0}**2)", "tanh(5*{0})", "{0}/sqrt(0.1 + {0}**2)", "log(1 + exp({0}))",
    "sin({0})**2", "{0}*exp(-{0}**2/2)",
)  # fmt: skip
OF_TWO = (
    "max({x}, {y})", "clip({x}, -abs({y}), abs({y}))", "clip({x}*{y}, -1, 1)", "max({x}**2 - {y}, 0)", "sign({x}*{y} - c)*{y}",
    "max({x}**2 + {y}**2 - 1, 0)", "tanh({x}*{y})", "exp({x}/3 - {y}/2)*abs({y} - c)",
    "sin({x} + {y})*{y}", "abs({x} - a*{y} + c)*{x}",
    "sign({x})*(c + exp(-{x}**2)/2)*max({y}, 0)", "tanh({x} - {y})*{x}", "max({x} - 2*{y}, 0)**1.5",
    "{x}*sqrt({x}**2 + {y}**2 + 0.1)",
)  # fmt: skip
MENDED = {  # each was wrong without a word, no number, or refused
    1: [
        "abs(x - c)**c*sign(x - c)*clip(x - 0.5, -1, 0.5)", "(a*x - 0.3)**2*sign(a*x - 0.3)*sqrt(abs(t*x + 0.1))",
        "log(1 + clip(t*x + 0.1, -1, 0.5)**2)", "sin(min(t*x + 0.1, 1))**2", "(x - c)**5/(1 + abs(x - c))*abs(x)",
        "sign(x - c)*max(abs(x - c) - c, 0)*abs(x)**2.3", "abs(a*x - 0.3)**1.5*sign(a*x - 0.3)*sin(1.3*clip(2*x + 1, -1, 0.5))",
    ],
    2: [
        "clip(x, -1, 0.5)*sqrt(abs(y - 0.5))", "sign(x)*(c + exp(-x**2)/2)*max(y, 0)", "max(x - 2*y + 0.3, 0)**1.5*y",
        "tanh(y)*sign(x - 0.5)", "clip(x*y, -1, 1)*x", "max(x**2 + y**2 - 1, 0)", "exp(x + y)", "cos(x + y/2 - c)*x",
    ],
}  # fmt: skip
DEVIATIONS = {1: (1e-6, 1e-3, 0.1, 0.5, 1.0, 3.0, 10.0), 2: (1e-3, 0.1, 0.5, 1.0, 3.0)}
CORRELATIONS = (-1.0, -0.999999, -0.95, 0.0, 0.5, 0.999999, 1.0)
WARNED = 1e-8
SUMMED = 30  # roundings that sums over nodes may add up to
SECONDS = 30.0  # of processor time, for the slowest refusal or description under load


def of_one(rng: random.Random, z: str, depth: int = 0) -> str:
    """A function of one argument: products, sums and functions of functions."""
    line = rng.choice(LINES).format(z)
    kind = rng.random()
    if kind < 0.35:
        return rng.choice(KINKED).format(line)
    if kind < 0.5:
        return rng.choice(POWERS).format(line)
    if kind < 0.75 or depth:
        inner = line if rng.random() < 0.7 else rng.choice(("abs({0})", "max({0}, 0)", "clip({0}, -1, 0.5)")).format(line)
        return rng.choice(SMOOTH).format(inner)
    first, second = of_one(rng, z, 1), of_one(rng, z, 1)
    return f"({first} - {rng.choice(('0.5', 'a'))}*{second})" if kind < 0.85 else f"{first}*{second}"


def of_two(rng: random.Random) -> str:
    """A function of two arguments: a product, or one across both, perhaps times a power of one."""
    x, y = rng.sample("xy", 2)
    if rng.random() < 0.5:
        return f"{of_one(rng, x, 1)}*{of_one(rng, y, 1)}"
    return rng.choice(OF_TWO).format(x=x, y=y)


def moments(rng: random.Random, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Means, and L."""
    spread = rng.choice(DEVIATIONS[count])
    stds = spread * np.array([rng.choice((1.0, 0.4, 1.5)) for _ in range(count)])
    means = np.array([rng.choice((0.0, 0.4, -0.3, -1.2, 2.0)) + rng.choice((0.0, 0.7)) * s for s in np.fmin(stds, 3)])
    rho = rng.choice(CORRELATIONS)
    return means, np.diag(stds) if count == 1 else np.array([[stds[0], 0], [rho * stds[1], stds[1] * np.sqrt(1 - rho**2)]])


class Judged:
    """A function, its describing function and the error that this claims."""

    def __init__(self, text: str, count: int):
        names, values = ("x", "y")[:count], {symbol(n): v for n, v in NUMBERS.items()}
        self.function, self.switches = function_of(text, names, NUMBERS)
        start = time.process_time()
        try:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                df = describing_function(tuple(map(symbol, names)), parse(text), name="f", values=values)
                claimed = measured_error(df, values) if count > 1 and df.nodes else 0.0
            claims = [getattr(warning.message, "error", 0.0) for warning in told]
            self.claimed, self.refused = max(claimed, df.error, *claims, 0.0), ""
        except LinearisationError as error:
            self.refused = str(error)
        assert time.process_time() - start < SECONDS
        if not self.refused:
            v = ca.SX.sym("v", count * (count + 3) // 2)
            found = ca.vertcat(*element_function(df, tuple(values))(v[:count], v[count:], [*NUMBERS.values()]))
            self.moments = ca.Function("moments", [v], [found, ca.jacobian(found, v)])

    def judge(self, mean: np.ndarray, L: np.ndarray) -> None:
        """E[f], L^T gain and L^T second derivatives L, relative to E|f|."""
        count, S = len(mean), L @ L.T
        found, slopes = (np.array(x) for x in self.moments([*mean, *S[np.tril_indices(count)]]))
        wanted = self._truth(mean, L)
        if wanted is None:
            return
        where = f"at mean {mean}, L {L.tolist()}: claimed {self.claimed:.0e}"
        assert np.all(np.isfinite(found)), where
        far = [mean + side * L @ e for e in np.eye(count) for side in (-25, -12, 12, 25)]
        size = max(wanted.size, 1e-6 * max(abs(float(self.function(*map(np.array, z)))) for z in far))
        limit = max({1: 1e-9, 2: 1e-8}[count], 3 * self.claimed) * size + SUMMED * self._rounding(mean, L)
        assert found[0, 0] == pytest.approx(wanted.value, abs=limit), where
        assert L.T @ found[1:, 0] == pytest.approx(wanted.gains, abs=limit), where
        if self.claimed <= WARNED:
            assert pytest.approx(wanted.bends, abs=100 * limit) == L.T @ slopes[1:, :count] @ L, where

    def _rounding(self, mean: np.ndarray, L: np.ndarray) -> float:
        """What the last digits of f are worth around the mean, where its terms may cancel."""
        z = mean[:, None] + L @ np.random.default_rng(0).normal(size=(len(mean), 100))
        return float(np.nanmax(np.abs(self.function(*z) - self.function(*z.astype(np.longdouble)))))

    def _truth(self, mean: np.ndarray, L: np.ndarray) -> Truth | None:
        """The integrals; None if they are not sure: with one argument, the same with nodes elsewhere."""
        if len(mean) > 1:
            found = truth(self.function, self.switches, mean, L, 1e-10)
            return found if 0 < found.size < 1e100 and found.error < 1e-9 else None
        found, again = (truth(self.function, self.switches, mean, L, nodes=nodes) for nodes in (80, 61))
        pairs = zip((found.value, *found.gains, *found.bends.flat), (again.value, *again.gains, *again.bends.flat), strict=True)
        return found if 0 < found.size < 1e100 and all(abs(a - b) < 1e-10 * found.size for a, b in pairs) else None


def look_at(text: str, count: int, rng: random.Random, cases: int) -> None:
    judged = Judged(text, count)
    for _ in range(0 if judged.refused else cases):
        judged.judge(*moments(rng, count))
    if judged.refused:
        assert len(judged.refused) < 1000


@pytest.mark.parametrize(("text", "count"), half((text, count) for count, texts in MENDED.items() for text in texts))
def test_what_was_found_wrong_is_right(text, count):
    judged = Judged(text, count)
    assert not judged.refused
    assert judged.claimed <= 1e-6
    rng = random.Random(text)
    for _ in range(2):
        judged.judge(*moments(rng, count))


def test_what_vanishes_at_the_mean_is_as_right_under_the_least_variance():
    """Up to terms of fourth order tanh(x)^2 atan(3x + 1) is x^2 (pi/4 + 3x/2), tanh(y)^2 |x - 0.2| is y^2 (0.2 - x)."""
    v, S = ca.SX.sym("v"), ca.SX.sym("S", 3)
    one = ca.vertcat(*element_function(describing_function((X,), parse("tanh(x)**2*atan(3*x + 1)")), ())(0, v, []))
    two = ca.vertcat(*element_function(describing_function((X, Y), parse("tanh(y)**2*abs(x - 0.2)")), ())([0, 0], S, []))
    one, two = (ca.Function("f", [p], [found, ca.jacobian(found, p)]) for p, found in ((v, one), (S, two)))
    for s in (0.0, 1e-12, 3e-9, 1e-7, 1e-5):
        values, slopes = map(np.array, one(s * s))
        assert values.ravel() == pytest.approx([np.pi / 4 * s * s, 4.5 * s * s], rel=1e-9)
        assert slopes.ravel() == pytest.approx([np.pi / 4, 4.5], rel=1e-7)
        xy, yy = -0.6 * s * s, s * s
        values, slopes = map(np.array, two([4 * s * s, xy, yy]))
        assert values.ravel() == pytest.approx([0.2 * yy, -yy, -2 * xy], rel=1e-9)
        assert slopes == pytest.approx(np.array([[0, 0, 0.2], [0, 0, -1], [0, -2, 0]]), abs=1e-6)


def test_gains_of_what_changes_within_a_standard_deviation_keep_their_digits():
    """By Stein's lemma they hold a third derivative of the steep factor, from which they were a fifth off."""
    judged, mean, L = Judged("atan(4*x)**2*y**2", 2), np.array([138.0, -257.6]), np.array([[230.0, 0.0], [-305.9, 100.5]])
    found = np.array(judged.moments([*mean, *(L @ L.T)[np.tril_indices(2)]])[0]).ravel()
    wanted = truth(judged.function, judged.switches, mean, L, 1e-10)
    assert [found[0], *(L.T @ found[1:])] == pytest.approx([wanted.value, *wanted.gains], abs=1e-8 * wanted.size)


@pytest.mark.parametrize(
    ("text", "mean", "stds", "rho"),
    [
        ("clip(a*y, -max(1 - c*x, 0), max(1 - c*x, 0))", (0.2, -0.1), (5.0, 5.0), 0.999),  # two smoothed kinks over each other
        ("log(1 + exp(x - c))*tanh(5*max(a*y - 0.3, 0))", (2.84, 2.0), (1.2, 4.5), 1.0),  # steep from a kink on
        ("max(x, 0)**1.2*tanh(3*y)", (2.8, -4.0), (10.0, 14.0), 1.0),  # steep beyond a root
        ("max(x, 0)*sin(y)**2*sqrt(1 + y**2)", (0.2, -0.1), (10.0, 10.0), 0.999),  # many waves
        ("max(x, 0)*(1 - exp(-abs(y)/c))*sign(y)", (0.2, -0.1), (10.0, 14.0), 1.0),  # what decays from a kink on
        ("max(x, 0)**1.5*clip(10*y, -1, 1)", (0.2, -0.1), (10.0, 14.0), 1.0),  # two kinks beside a root
        ("clip(x*abs(x) - y, -1, 1)", (2.8, -4.0), (10.0, 14.0), 0.999),  # two kinks on each of two curves
    ],
)
def test_what_lies_close_to_a_kink_is_seen_beside_it(text, mean, stds, rho):
    body, values = parse(text), {symbol(name): value for name, value in NUMBERS.items()}
    df = describing_function((X, Y), body, values={s: values[s] for s in body.free_symbols & values.keys()})
    covariance = np.outer(stds, stds) * np.array([[1, rho], [rho, 1]])
    result = check_at(df, [(np.array(mean), covariance, values)], 1_000_000)
    assert max(result.error, result.gain_error) < 1e-9


def test_derivatives_are_right_where_an_end_is_just_within_reach():
    """Nodes reach eight deviations from the mean: a kink there moves with it, or nothing does, but not half of each."""
    judged, S = Judged("max(y, 0)*sqrt(max(1 - x, 0))", 2), (0.01, 0.007, 0.0196)
    bends = [np.array(judged.moments([m, -0.1, *S])[1])[1:, :2] for m in (0.2, 0.2 + 1e-6)]
    assert bends[0] == pytest.approx(bends[1], rel=1e-4)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_a_random_function_of_one_argument(seed):
    rng = random.Random(seed)
    look_at(of_one(rng, "x"), 1, rng, 2)


@settings(max_examples=2, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_a_random_function_of_two_arguments(seed):
    rng = random.Random(seed)
    look_at(of_two(rng), 2, rng, 2)


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(st.integers(0, 2**32))
def test_many_random_functions_of_one_argument(seed):
    rng = random.Random(seed)
    look_at(of_one(rng, "x"), 1, rng, 5)


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32))
def test_many_random_functions_of_two_arguments(seed):
    rng = random.Random(seed)
    look_at(of_two(rng), 2, rng, 3)
