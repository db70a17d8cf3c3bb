"""Exponentials of eight numbers at once: to a unit or two in the last place, whatever is beside them."""

from __future__ import annotations

import ctypes
import math
import platform
from collections.abc import Callable

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from test_machine import compiled_function, virtual

from cadet_sym.lowering import llvm, scalars, vectors
from cadet_sym.lowering.machine import machine_code

DIGITS = 40
EXACT = {
    "EXP": mp.exp,
    "LOG": mp.log,
    "TANH": mp.tanh,
    "ERF": mp.erf,
    "ASINH": mp.asinh,
    "SIN": mp.sin,
    "COS": mp.cos,
    "ATAN": mp.atan,
}
UNITS = {"EXP": 1.0, "LOG": 1.0, "TANH": 2.0, "ERF": 1.5, "ASINH": 2.0, "SIN": 1.0, "COS": 1.0, "ATAN": 2.0}
SPECIAL = [0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, -1e-310, 1e-160, -1e160, 1e300]
SPECIAL += [-1e6, 1e5, 745.2, -745.2, 709.8, -800.0]
COLUMNS = 200


def mapped(kind: str, count: int) -> ca.Function:
    x, X = ca.SX.sym("x"), ca.MX.sym("X", 1, count)
    each = ca.Function("each", [x], [getattr(ca, kind.lower())(x)])
    return ca.Function("all", [X], [each.map(count)(X)])


def numbers(kind: str) -> np.ndarray:
    """Of every size, and close to where one polynomial takes turns with another."""
    rng = np.random.default_rng(1)
    near = rng.normal(size=COLUMNS // 2) * 2
    far = {
        "EXP": rng.uniform(-745, 709, COLUMNS // 2),
        "SIN": rng.uniform(-1e5, 1e5, COLUMNS // 2),
        "COS": rng.uniform(-1e5, 1e5, COLUMNS // 2),
    }.get(kind, np.exp(rng.uniform(-300, 300, COLUMNS // 2)) * rng.choice([-1, 1], COLUMNS // 2))
    x = np.concatenate([near, far])
    return np.abs(x) if kind == "LOG" else x


def units(found: np.ndarray, x: np.ndarray, exact: Callable) -> float:
    """The largest error, in units of the last place."""
    with mp.workdps(DIGITS):
        wanted = [exact(mp.mpf(float(value))) for value in x]
        errors = (abs(mp.mpf(float(a)) - b) / float(np.spacing(abs(float(b)))) for a, b in zip(found, wanted, strict=True))
        return float(max(errors))


@pytest.mark.parametrize("kind", vectors.VECTORS)
def test_they_are_right_to_the_last_place_or_two(kind):
    x = numbers(kind)
    (found,) = compiled_function(mapped(kind, len(x)))(x)
    assert units(found, x, EXACT[kind]) <= UNITS[kind]


@pytest.mark.parametrize("kind", vectors.VECTORS)
def test_special_numbers_give_what_the_c_library_gives(kind):
    function = mapped(kind, len(SPECIAL))
    (found,), (wanted,) = compiled_function(function)(np.array(SPECIAL)), virtual(function, [np.array([SPECIAL])])
    np.testing.assert_allclose(found, wanted, rtol=5e-16, atol=5e-324)
    np.testing.assert_array_equal(np.signbit(found)[~np.isnan(wanted)], np.signbit(wanted)[~np.isnan(wanted)])


@pytest.mark.skipif(platform.machine().lower() not in ("x86_64", "amd64"), reason="the features of other processors")
@pytest.mark.parametrize("kind", vectors.VECTORS)
def test_processors_that_round_twice_do_as_well(kind):
    x = numbers(kind)
    old = ' nounwind "target-cpu"="x86-64" "target-features"="-fma,-avx512f,-avx2,-avx" {'
    text = llvm.intermediate(mapped(kind, len(x)), "old").replace(" nounwind {", old)
    found = np.empty(len(x))
    machine_code(text, "old").function("old", ctypes.c_void_p, ctypes.c_void_p)(x.ctypes.data, found.ctypes.data)
    assert units(found, x, EXACT[kind]) <= UNITS[kind] + 1


@pytest.mark.parametrize("count", [2, 3, 7, 8, 9, 16, 21])
def test_a_column_does_not_depend_on_those_beside_it(count):
    """Nor on where among the eight it is, nor on how many there are."""
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    value = ca.vertcat(*(ca.exp(x[0]) * ca.log(x[1]), ca.sin(x[0]) + ca.tanh(x[1] * y)))
    each = ca.Function("each", [x, y], [value, ca.erf(y) + x[0] * x[1]])
    rng = np.random.default_rng(2)
    given = rng.normal(size=(2, 21))
    given[1] = np.where(rng.random(21) < 0.2, [-1.0, 0.0, 1e-310] * 7, np.abs(given[1]))
    X, z = ca.MX.sym("X", 2, count), ca.MX.sym("z")
    columns = each.map("columns", "serial", count, [1], [])(X, z)
    every = compiled_function(ca.Function("f", [X, z], [*columns]))
    first, second = every(np.asfortranarray(given[:, :count]).ravel(order="F"), np.array(0.7))
    turned, other = every(np.asfortranarray(given[:, count - 1 :: -1][:, :count]).ravel(order="F"), np.array(0.7))
    np.testing.assert_array_equal(first.reshape(count, 2), turned.reshape(count, 2)[::-1])
    np.testing.assert_array_equal(second, other[::-1])
    twice = each.map("columns", "serial", 2, [1], [])
    alone = ca.Function("f", [X, z], [twice(ca.repmat(X[:, k], 1, 2), z)[0][:, 1] for k in range(count)])
    for k, one in enumerate(compiled_function(alone)(np.asfortranarray(given[:, :count]).ravel(order="F"), np.array(0.7))):
        np.testing.assert_array_equal(first.reshape(count, 2)[k], one)


@pytest.mark.parametrize("length", [3, 1000])
def test_scalars_that_do_not_wait_for_each_other_are_taken_together(length, monkeypatch):
    monkeypatch.setattr(scalars, "BLOCK", length)
    x, a = ca.SX.sym("x", 11), ca.MX.sym("a", 3)
    each = ca.Function("each", [a], [ca.sqrt(a), a[0] * a[1]], {"never_inline": True})
    first = [ca.exp(x[k]) for k in range(11)]
    root, product = each(ca.vertcat(*first[:3]))
    second = [ca.exp(-v) * ca.tanh(root[k % 3] * v) for k, v in enumerate(first)]
    third = [ca.sin(v + product) + ca.sin(first[k]) + ca.log(x[k]) for k, v in enumerate(second)]
    function = ca.Function("f", [x], [ca.vertcat(*third), ca.vertcat(*first), product])
    text = llvm.intermediate(function, "f")
    assert all((f"call void @{kind}.scalars(" in text) is (length > 3) for kind in ("exp", "tanh", "sin", "log"))
    given = np.linspace(0.1, 2.0, 11)
    for effort in (0, 1):
        for found, wanted in zip(compiled_function(function, effort)(given), virtual(function, [given]), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-14)


@pytest.mark.parametrize("count", [1, 3, 8, 12, 29])
def test_sums_over_columns_are_of_every_column_once(count):
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    each = ca.Function("each", [x, y], [ca.vertcat(x[0] * y, x[1]), x[0], x * x[0] + y])
    X, z = ca.MX.sym("X", 2, count), ca.MX.sym("z")
    total = each.map("total", "serial", count, [1], [0, 1])(X, z)
    apart = each.map("apart", "serial", count, [1], [])(X, z)
    function = ca.Function("f", [X, z], [*total, *apart, ca.sum2(apart[0]), ca.sum2(apart[2]) + apart[2][:, 0]])
    values = np.arange(1.0, 2 * count + 1)  # whole numbers: sums are exact in any order
    found = compiled_function(function)(values, np.array(3.0))
    for a, b in zip(found, virtual(function, [values.reshape(-1, 2).T, 3.0]), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_polynomials_are_the_interpolations_they_are_said_to_be():
    with mp.workdps(50):

        def erfc(y):
            t = y + mp.mpf(1) / 2
            x = 3 / t - 3
            return mp.exp(x * x) * mp.erfc(x) / t

        def even(function, start, power):  # (function(r) - start(r))/r^power in r^2
            return lambda z: (function(mp.sqrt(z)) - start(mp.sqrt(z))) / mp.sqrt(z) ** power

        cases = {
            "EXP": (lambda r: (mp.expm1(r) - r) / r**2, "-0.3467", "0.3467"),
            "LOG": (even(mp.atanh, lambda s: s, 3), 0, "0.02945"),
            "ERF": (even(mp.erf, lambda x: x, 1), 0, 1),
            "ERFC": (erfc, mp.mpf(-1) / 6, "0.25"),
            "SIN": (even(mp.sin, lambda r: r, 3), 0, "0.6169"),
            "COS": (even(mp.cos, lambda r: 1 - r * r / 2, 4), 0, "0.6169"),
            "ATAN": (even(mp.atan, lambda t: t, 3), 0, "0.1716"),
        }
        for name, (function, low, high) in cases.items():
            wanted = getattr(vectors, name)
            made = interpolation(function, mp.mpf(low), mp.mpf(high), len(wanted) - 1)
            factor = 2 if name == "LOG" else 1
            assert all(abs(factor * a - b) <= np.spacing(abs(b)) for a, b in zip(made, wanted, strict=True))


def interpolation(function: Callable, low, high, degree: int, points: int = 60) -> list:
    """Coefficients by rising power of the series of Chebyshev of a function on an interval, cut there."""
    middle, half = (low + high) / 2, (high - low) / 2
    angles = [mp.pi * (2 * k + 1) / (2 * points) for k in range(points)]
    values = [function(middle + half * mp.cos(angle)) for angle in angles]
    total, polynomials = [mp.mpf(0)] * (degree + 1), [[mp.mpf(1)], [-middle / half, 1 / half]]
    for n in range(degree + 1):
        if n > 1:  # T_n = 2 y T_(n-1) - T_(n-2), y = (x - middle)/half
            before, last = polynomials[-2:]
            product = [mp.mpf(0)] * (n + 1)
            for k, c in enumerate(last):
                product[k] -= 2 * c * middle / half
                product[k + 1] += 2 * c / half
            for k, c in enumerate(before):
                product[k] -= c
            polynomials.append(product)
        weight = (1 if n == 0 else 2) * mp.fsum(v * mp.cos(n * a) for v, a in zip(values, angles, strict=True)) / points
        for k, c in enumerate(polynomials[n]):
            total[k] += weight * c
    return total
