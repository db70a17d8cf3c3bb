"""Exported C calls what CasADi calls and takes what is alike in loops: the same bits, and little text."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from exported import Exported, build, compiler, sources
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_export import samples
from test_machine_calls import CALLED, X, Y

import cadet_sym as cs
from cadet_sym.errors import ExportError
from cadet_sym.export.calls import CalledFunctions
from cadet_sym.export.program import translate
from cadet_sym.lowering.portable import portable

HEADER = "#include <math.h>\ntypedef double R;\n#define K(x) (x)\n#define TINY(x) (x)\n#define M(f) f\n"

BODIES = {
    **{name: body for name, body in CALLED.items() if name in ("both", "angle", "along a curve", "curve", "curves")},
    "Bouc-Wen": sp.Abs(X) * sp.sqrt(sp.Abs(Y)) * Y + X * sp.Abs(Y) ** sp.Rational(3, 2),
}


def evaluated(function: ca.Function, folder: Path, *arguments: np.ndarray) -> list[np.ndarray]:
    """What the C of a function gives."""
    calls = CalledFunctions("of")
    program = calls.of(function)
    (folder / "f.c").write_text(HEADER + calls.header([program.name]) + calls.source([program.name]))
    made = folder / f"{len(list(folder.iterdir()))}.so"  # those of one name are the same to the linker
    build(folder, made, [folder / "f.c"], "-shared", "-fPIC", "-O1")
    given = [np.ascontiguousarray(x, dtype=float) for x in arguments]
    found = [np.full(function.nnz_out(k), np.nan) for k in range(function.n_out())]
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (*given, *found) if x.size]
    getattr(ctypes.CDLL(str(made)), program.name)(*pointers)
    return found


def same(function: ca.Function, folder: Path, *arguments: np.ndarray) -> None:
    wanted = function.call([ca.DM(ca.reshape(ca.DM(x), *function.size_in(k))) for k, x in enumerate(arguments)])
    for found, value in zip(evaluated(function, folder, *arguments), wanted, strict=True):
        np.testing.assert_array_equal(found, np.array(value.nonzeros()))


def model(body: sp.Expr) -> cs.Model:
    """A mass on the function, driven by white noise."""
    x, v, w = (sp.Symbol(name, real=True) for name in ("x", "v", "w"))
    element = cs.Element("f", [X, Y], body)
    rates = {x: v, v: -x - sp.Rational(2, 5) * v - element(x, v) + w}
    noise = cs.Noise(names=("w",), intensity=sp.ImmutableMatrix([[1]]))
    return cs.Model(cs.Vehicle(rates=rates), noise=noise, duration=1, points=2, name="calls")


@pytest.mark.parametrize("name", [name if name == "both" else pytest.param(name, marks=pytest.mark.slow) for name in BODIES])
def test_models_that_call_functions_are_casadis(name, tmp_path):
    compiler()
    compiled = cs.compile(model(BODIES[name]))
    folder = compiled.export_c(tmp_path / "c", prefix="of")
    if name != "Bouc-Wen":
        assert sum(path.stat().st_size for path in sources(folder)) < 2e6
    c = Exported(folder, "of", tmp_path)
    functions, p, size = compiled.functions, compiled.parameter_vector(), compiled.equations.packing.size
    for t, y in samples(compiled):
        np.testing.assert_array_equal(c.call("rate", t, y, p, result=size), np.asarray(functions.rate(t, y, p)).ravel())
        dense = c.call("jacobian_dense", t, y, p, result=size**2).reshape(size, size).T
        np.testing.assert_allclose(dense, np.asarray(ca.densify(functions.jacobian(t, y, p))), rtol=1e-14)


@pytest.mark.slow
@pytest.mark.xfail(reason="4.3 MB: where its panels lie moves with the moments, and that is written out", strict=True)
def test_bouc_wen_with_a_broken_exponent_is_small(tmp_path):
    folder = cs.compile(model(BODIES["Bouc-Wen"])).export_c(tmp_path / "c", prefix="of")
    assert sum(path.stat().st_size for path in sources(folder)) < 2e6


def test_they_pass_their_own_test_in_either_precision(tmp_path):
    compiler()
    folder = cs.compile(model(CALLED["both"])).export_c(tmp_path / "c", prefix="of")
    for option in ("-DOF_DOUBLE", "-DOF_FLOAT"):
        made = build(folder, tmp_path / "test", [*sources(folder), folder / "test.c"], option)
        run = subprocess.run([made], capture_output=True, text=True, timeout=60)
        assert run.returncode == 0, run.stdout


@pytest.mark.slow
def test_a_chain_of_many_states_is_loops():
    """Ten times as many operations are not ten times as much code: what grows is tables."""
    Z = sp.Symbol("z", real=True)
    cubic = cs.Element("cubic", [Z], Z**3)
    n = 40
    x, v, w = ([sp.Symbol(f"{letter}{i}", real=True) for i in range(n)] for letter in "xvw")
    rates = {}
    for i in range(n):
        left, right = x[i] - (x[i - 1] if i else 0), (x[i + 1] if i + 1 < n else 0) - x[i]
        rates[x[i]], rates[v[i]] = v[i], right - left - cubic(left) - v[i] / 5 + w[i]
    noise = cs.Noise(names=tuple(each.name for each in w), intensity=sp.ImmutableMatrix(sp.eye(n)))
    compiled = cs.compile(cs.Model(cs.Vehicle(rates=rates), noise=noise, duration=1, points=2))
    function = portable(compiled.functions).rate
    text = translate(function, "rate").text
    assert function.n_instructions() > 25_000
    assert sum(text.count(sign) for sign in (" = ", " += ")) < 2000
    assert len(text) < 500_000


def test_graphs_of_matrices_are_casadis(tmp_path):
    compiler()
    rng = np.random.default_rng(2)
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    each = ca.Function("each", [x, y], [ca.vertcat(x[0] * y, ca.sin(x[1]), y), x[0] + y])
    A, u, z = ca.MX.sym("A", 2, 4), ca.MX.sym("u", 4), ca.MX.sym("z")
    many, one = each.map(4)(A, u.T)
    total, _ = each.map("total", "serial", 4, [1], [0])(A, z)
    marched = ca.Function("march", [x, y], [ca.vertcat(x[1], x[0] * 0.5) + y]).mapaccum("marched", 4)
    moved = u + 0
    moved[[2, 0]] = z * A[0, :2].T
    picked = ca.vertcat(many[2, 3], many[0, 1], many[1, 1])
    results = [
        total, many.T, ca.mtimes(A, u) + A[:, 2], picked * z, ca.repmat(picked, 1, 3) + 1, ca.vertcat(*ca.vertsplit(u)[::-1]),
        marched(A[:, 0], u.T), one * ca.DM([[1.0, 2.0, 3.0, 4.0]]), ca.fmax(u, z), ca.reshape(A, 4, 2),
        ca.project(ca.diag(u), ca.Sparsity.lower(4)), moved, ca.jtimes(u[[3, 1, 3]], u, A[0, :3].T, True),
    ]
    first = ca.Function("first", [A, u, z], results)
    same(first, tmp_path, rng.normal(size=8), rng.normal(size=4), rng.normal(size=1))
    cases = [ca.Function(f"case{k}", [x, y], [x * k + y, ca.SX(0, 1)]) for k in range(4)]
    chosen = ca.Function.conditional("chosen", cases[:-1], cases[-1])
    for number in (-2.0, -0.5, 0.0, 1.9, 2.0, 3.0, 99.0, np.nan):
        by_choice = ca.Function("by_choice", [z, A, u], [chosen(z, A[:, 1], u[0])[0]])
        same(by_choice, tmp_path, np.array([number]), rng.normal(size=8), rng.normal(size=4))


def test_what_is_not_known_is_refused_in_a_sentence():
    A, b = ca.MX.sym("A", 2, 2), ca.MX.sym("b", 2)
    with pytest.raises(ExportError, match="has no C"):
        CalledFunctions("of").of(ca.Function("f", [A, b], [ca.solve(A, b)]))


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_random_columns_keep_every_bit(tmp_path, seed):
    """Operations on columns, parts of them in any order, long and short sums, calls, numbers that all share."""
    compiler()
    rng = np.random.default_rng(seed)
    x, q = ca.SX.sym("x", 60), ca.SX.sym("q", 3)
    a, b = ca.MX.sym("a", 20), ca.MX.sym("b")
    called = ca.Function("inner", [a, b], [a * b, ca.sum1(a)], {"never_inline": True})
    columns = [x, x[::-1], ca.repmat(q, 20, 1)]
    one = [ca.sin, ca.exp, ca.fabs, lambda v: v * v, lambda v: v + 0.25, lambda v: ca.DM(rng.normal(size=60)) * v]
    results = []
    for _ in range(60):
        u, v = (columns[i] for i in rng.integers(len(columns), size=2))
        kind = rng.integers(6)
        if kind == 0:
            columns.append(u * v + q[0])
        elif kind == 1:
            columns.append(one[rng.integers(len(one))](ca.fmin(ca.fmax(u, -3), 3)))
        elif kind == 2:
            columns.append(u[[int(i) for i in rng.permutation(60)]] - v)
        elif kind == 3:
            total = ca.dot(u, v) if rng.integers(2) else ca.sum1(u[:30]) + ca.sum1(v[int(rng.integers(40)) :])
            results.append(total)
            columns.append(ca.if_else(v > total, u, ca.tanh(total)))
        elif kind == 4:
            product, total = called(u[20:40], q[1])
            columns.append(ca.vertcat(product, u[:40]) * total)
        else:
            columns.append(ca.vertcat(v[:20], u[20:]) / (1 + u * u))
        columns[-1] = ca.fmin(ca.fmax(columns[-1], -1e3), 1e3)
    function = ca.Function("random", [x, q], [ca.vertcat(*results, *columns[-3:]), columns[-5]], ["x", "q"], ["y", "z"])
    same(function, tmp_path, rng.normal(size=60), rng.normal(size=3))


def test_parts_of_vectors_are_handed_over_where_they_are():
    y, a = ca.SX.sym("y", 6), ca.MX.sym("a", 3)
    called = ca.Function("inner", [a], [a * 2], {"never_inline": True})
    results = called(called(y[1:4])) + called(ca.SX([1, 2, 3]))
    program = translate(ca.Function("f", [y], [results], ["y"], ["r"]), "f", calls=CalledFunctions("of"))
    assert "of_inner_0(y + 1, w + 0);" in program.text
    assert "of_inner_0(w + 0, w + 3);" in program.text
    assert "of_inner_0(f_c0, w + 6);" in program.text
