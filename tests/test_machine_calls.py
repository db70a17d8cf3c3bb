"""Functions that call others as machine code: CasADi's numbers, each function written once.

To the last bit, but for sums over columns, which are taken in another order, and exponentials taken several at a time, which
are not those of the C library (see test_vectors.py).
"""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import half
from test_expectation_curves import curve
from test_lowering_elements import NUMBERS, named
from test_machine import ONE, SPECIAL, TWO, compiled_function, virtual

import cadet_sym as cs
from cadet_sym.expectation import describing_function
from cadet_sym.language.expression import symbol
from cadet_sym.language.library import LIBRARY
from cadet_sym.lowering import llvm, scalars
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.vectors import VECTORS
from cadet_sym.solve.native import Native
from cadet_sym.solve.stiff import Stiff

X, Y = symbol("x"), symbol("y")

ROUNDING = 8e-16
"""What a function of eight numbers may differ from the C library's by ..."""

SUMS = 1e-12
"""... and what is left of that where sums over many nodes cancel in part."""

CALLED = {
    "both": sp.tanh(X * Y),
    "kinks": sp.Abs(X) * sp.tanh(X * Y),
    "radius": Y * sp.sqrt(X**2 + Y**2 + sp.Rational(1, 100)),
    "angle": sp.atan2(Y, X),
    "homogeneous": X**3 / (X**2 + 2 * Y**2),
    "one inside the other": sp.Abs(Y) * sp.sqrt(sp.Abs(X)) * X,
    "along a curve": sp.Max(X**2 - Y, 0),
    "curve": Y * X**2 + curve(X, 40) + curve(Y, 30, "hold", "monotone"),
    "curves": curve(X, 20) * curve(Y, 20),
}


def same(function: ca.Function, *cases: list, rtol: float = 0.0) -> None:
    """Machine code and CasADi agree on every bit, or so far, for what is no number too."""
    run = compiled_function(function, effort=0)
    for case in cases:
        given = [np.asfortranarray(x, dtype=float).ravel(order="F") for x in case]
        for found, wanted in zip(run(*given), virtual(function, case), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=rtol, atol=0)


def moments(rng: np.random.Generator, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Means and covariances, one by one: of every size, correlated in part, fully, and without variance."""
    found = []
    for spread in (1.0, 1e-3, 30.0):
        root = spread * rng.normal(size=(count, count))
        found.append(root @ root.T)
        found.append(np.outer(root[0], root[0]))  # correlations of 1 and -1
    found += [np.zeros((count, count)), np.diag(np.arange(count) * 1.0), 1e-300 * np.eye(count)]
    return [(rng.normal(size=count), each[np.tril_indices(count)]) for each in found]


def parts(x, y):
    return [x + 2 * y, x * y, ca.fmax(x, y), ca.sin(x)]


def test_operations_on_matrices_are_casadis():
    A, u, v, z = ca.MX.sym("A", 2, 3), ca.MX.sym("u"), ca.MX.sym("v", 2), ca.MX.sym("z", 3)
    moved = z + 0
    moved[[2, 0]] = 3 * v
    results = [
        moved,
        ca.jtimes(z[[2, 0, 2]], z, A[0, :].T, True),
        ca.densify(ca.project(ca.diag(z), ca.Sparsity.lower(3))),
        *(ca.vertcat(*map(ca.vec, parts(a, b))) for a, b in ((A, 2 * A), (A, u), (u, A), (A, ca.DM([[1, 2, 3], [4, 5, 6]])))),
        ca.horzcat(A, v, ca.MX.zeros(2), ca.DM([-0.0, 0.0])),
        ca.vertcat(v, u, z),
        ca.horzcat(*reversed(ca.horzsplit(A))),
        ca.vertcat(*reversed(ca.vertsplit(z))),
        ca.vertcat(A[0, 1], A[:, 1], A[0, :].T),
        A[:, [2, 0]],
        A.T / 3,
        ca.reshape(A, 3, 2) ** 2,
        ca.repmat(v, 1, 4),
        ca.mtimes(A.T, A) + ca.mtimes(ca.vertcat(v, v)[:3], z.T),
        ca.repmat(A, 1, 2) * u,
        u**1.5,
    ]
    function = ca.Function("matrices", [A, u, ca.vertcat(v, z)], [*results, A, ca.vertcat(2 * v, z)])
    rng = np.random.default_rng(0)
    special = np.array([[np.inf, np.nan, -0.0], [1e300, -1e-300, 0.0]])
    same(function, [rng.normal(size=(2, 3)), 0.7, rng.normal(size=5)], [special, -0.0, np.arange(5.0)])


def test_functions_are_called_for_every_column_one_after_the_other_and_by_choice():
    x, y, k, Z = ca.SX.sym("x", 2), ca.SX.sym("y"), ca.MX.sym("k"), ca.MX.sym("Z", 2, 5)
    one = ca.Function("one", [x, y], [x * ca.exp(y), ca.sum1(x) + y])
    other = ca.Function("other", [x, y], [ca.tanh(x), y / 3])
    last = ca.Function("last", [x, y], [ca.fmax(x, y), y])
    chosen = ca.Function.conditional("chosen", [one, other], last)
    values = ca.MX.sym("values", 1, 5)
    function = ca.Function(
        "calls",
        [k, Z, values],
        [
            *one.map(5)(Z, values),
            one.map(5)(Z, values)[1],  # of which one result is not used
            one.map("sums", "serial", 5, [1], [0])(Z, values[2])[0],
            *one.mapaccum(5)(Z[:, 0], values),
            *one.mapaccum("pairs", 5, {"base": 2})(Z[:, 1], values),
            *one.fold(5)(Z[:, 0], values),
            *chosen.map(5)(values, Z, values),
            *chosen(k, Z[:, 3], values[0]),
            *ca.Function.if_else("either", one, other)(k, Z[:, 2], k),
        ],
    )
    rng = np.random.default_rng(1)
    numbers = (-1e300, -1.0, -0.999, -0.0, 0.999, 1.0, 1.999, 2.0, 7.0, 1e300, np.inf, np.nan)
    cases = ([k, rng.normal(size=(2, 5)), np.array([[0.0, 1.0, 2.0, -1.0, np.nan]])] for k in numbers)
    same(function, *cases, rtol=ROUNDING)


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_operations_on_eight_columns_at_a_time_are_casadis(name):
    """To the last bit but for the functions that are written for eight numbers."""
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    value = getattr(ca, name)(x, y) if name in TWO else getattr(ca, name)(x)
    each = ca.Function("each", [x, y], [value, ca.if_else(x[1], value[0], -y)])
    X, Y, z = ca.MX.sym("X", 2, 21), ca.MX.sym("Y", 1, 21), ca.MX.sym("z")
    function = ca.Function("all", [X, Y, z], [*each.map(21)(X, Y), *each.map("shared", "serial", 21, [1], [])(X, z)])
    values = np.array(list(itertools.islice(itertools.cycle(SPECIAL), 42)))
    cases = ([values.reshape(2, 21), values[None, k : k + 21], z] for k, z in enumerate((0.3, -2.5, 0.0, np.nan, np.inf)))
    same(function, *cases, rtol=ROUNDING if name.upper() in VECTORS else 0.0)


@pytest.mark.parametrize("length", [3, 1000])
def test_scalars_call_functions_from_any_block(length, monkeypatch):
    monkeypatch.setattr(scalars, "BLOCK", length)
    x, a, b = ca.SX.sym("x", 4), ca.MX.sym("a", 2), ca.MX.sym("b")
    first = ca.Function("first", [a], [ca.sin(a), a[0] * a[1]], {"never_inline": True})
    second = ca.Function("second", [a, b], [ca.cos(a) / b], {"never_inline": True})
    u, v = first(x[:2])
    w = second(ca.vertcat(u[1] + x[3], v), x[2])
    _, last = first(w)
    same(ca.Function("f", [x], [u * w, v + x[2], w[0], last]), [[0.3, -1.2, 0.5, 2.0]])


def test_what_needs_much_memory_does_not_take_it_from_the_stack():
    x = ca.SX.sym("x")
    each = ca.Function("each", [x], [ca.exp(-x * x)])
    values = ca.MX.sym("values", 1, 300_000)
    same(ca.Function("many", [values], [each.map(300_000)(2 * values)]), [np.linspace(-1, 1, 300_000)], rtol=ROUNDING)


def test_functions_are_written_once_under_names_that_stay():
    def make() -> str:
        x, z = ca.SX.sym("x"), ca.MX.sym("z", 1, 4)
        same_as, each = (ca.Function("each", [x], [ca.sin(x) * x]) for _ in range(2))
        return llvm.intermediate(ca.Function("f", [z], [each.map(4)(z), same_as.map(4)(2 * z), each(z[0])]), "f")

    text = make()
    assert text.count("call double @sin") == 1 + 8  # for one column, and for eight
    assert make() == text


def test_what_is_not_known_is_refused():
    A, b = ca.MX.sym("A", 2, 2), ca.MX.sym("b", 2)
    with pytest.raises(ValueError, match="has no machine code"):
        llvm.intermediate(ca.Function("f", [A, b], [ca.solve(A, b)]), "f")
    x = ca.SX.sym("x")
    sparse = ca.SX(2, 1)
    sparse[1] = x
    dense = ca.Function("dense", [x], [ca.vertcat(x, x)])
    choice = ca.Function.conditional("choice", [dense], ca.Function("sparse", [x], [sparse]))
    with pytest.raises(ValueError, match="differ in their sparsity"):
        llvm.intermediate(choice, "f")
    with pytest.raises(ValueError, match="`root`, a Newton, has no machine code"):
        llvm.intermediate(ca.rootfinder("root", "newton", {"x": x, "p": ca.SX.sym("p"), "g": x**2 - 1}), "f")


@pytest.mark.parametrize("kind", half(LIBRARY))
def test_elements_of_the_library_are_casadis(kind):
    """To the last bit, but for those with sums over nodes, or exponentials taken together."""
    element = named(kind)
    free = tuple(sorted(element.value.free_symbols - set(element.arguments), key=str))
    known = {s: NUMBERS[s.name] for s in free}
    function = element_function(describing_function(element.arguments, element.value, values=known), free)
    cases = moments(np.random.default_rng(5), len(element.arguments))
    loose = function.find_functions() or ".scalars(" in llvm.intermediate(function, "f")
    same(function, *([*case, list(known.values())] for case in cases), rtol=SUMS if loose else 0.0)


@pytest.mark.parametrize("body", half(CALLED.values()), ids=CALLED)
def test_elements_that_call_functions_are_casadis(body):
    function = element_function(describing_function((X, Y), body), ())
    assert function.find_functions()
    same(function, *([*case, []] for case in moments(np.random.default_rng(6), 2)), rtol=SUMS)


def test_models_that_call_functions_run_as_machine_code():
    x, v, w, c = sp.symbols("x v w c")
    vehicle = cs.Vehicle(rates={x: v, v: -x - v - c * sp.tanh(x * v) + w})
    model = cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), parameters={c: 0.3}, duration=2)
    compiled = cs.compile(model)
    histories = {engine: compiled.propagate([1, 2], rtol=1e-8, engine=engine) for engine in ("native", "stiff", "direct")}
    assert compiled.propagate([1, 2]).provenance.engine == Native.name
    assert histories["stiff"].provenance.engine == Stiff.name
    bouc_wen = cs.from_library("bouc_wen", A=1, beta=0.5, gamma=0.5, exponent=sp.Rational(3, 2))
    z = sp.Symbol("z")
    hysteretic = cs.Vehicle(rates={x: v, v: -x - v - z + w, z: bouc_wen(v, z)})
    noise = cs.Noise(names=("w",), intensity=sp.eye(1))
    assert cs.compile(cs.Model(hysteretic, noise=noise, duration=2)).propagate([2]).provenance.engine == Native.name
    for history in histories.values():
        np.testing.assert_allclose(history.state_covariance, histories["direct"].state_covariance, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("body", [CALLED["one inside the other"], curve(X, 40) * 3 - X])
def test_for_export_nothing_is_called_and_the_numbers_are_the_same(body):
    x, v, w = sp.symbols("x v w")
    vehicle = cs.Vehicle(rates={x: v, v: -x - v - body.subs({X: x, Y: v}) + w})
    functions = cs.compile(cs.Model(vehicle, noise=cs.Noise(names=("w",), intensity=sp.eye(1)), duration=2)).functions
    alone = functions.unrolled()
    assert functions.calls
    assert not alone.calls
    y = [0.3, -0.2, 0.5, 0.1, 0.8]
    np.testing.assert_allclose(np.array(alone.rate(0, y, [])), np.array(functions.rate(0, y, [])), rtol=1e-13)
    jacobians = (np.array(ca.densify(each.jacobian(0, y, []))) for each in (alone, functions))
    np.testing.assert_allclose(*jacobians, rtol=1e-9, atol=1e-12)
