"""Expressions as source: every function of the language, by numba and by NumPy, against its own evaluation."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from reference_models import toml

from cadet_sym.augmentation import augment
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import Lookup, evaluate, symbol
from cadet_sym.simulation.kicks import separate_kicks
from cadet_sym.simulation.numbers import numeric
from cadet_sym.simulation.plan import Problem
from cadet_sym.simulation.program import write_program
from cadet_sym.simulation.source import CALLS, FOLDS, Emitter, Shared
from cadet_sym.simulation.workers import records_of

EXPRESSIONS = [
    "abs(x) + sign(y) - sqrt(abs(x*y))",
    "exp(-x) * log(1 + y**2)",
    "sin(x) + cos(y) - tan(x/3)",
    "asin(sin(x)) + acos(cos(y)/2) + atan(x - y)",
    "atan2(x, y) + sinh(x/2) - cosh(y/2)*tanh(x)",
    "erf(x) * heaviside(y) + heaviside(x - x)",
    "min(x, y, 1/2) + max(x, -y, 0) + clip(x, -1, k)",
    "x**2 + x**3 - x**7 + y**-2 + abs(x)**(3/2) + abs(y)**-0.5",
    "abs(x)**k + abs(x)**1.7 + abs(y)**(x/4)",
    "1 if x > 0 else 2*y if y >= 0 else -x",
    "x if 0 < y <= 1 else y",
    "x if x > 0 and y > 0 or not x < -1 else y",
    "x if x == y else -x if x != 2 else 3",
    "x if k > 1 else y",
    "x if t > 2 else y if t >= 1 and x > 0 else 7",
    "k*x + 2*k*t*y - t*x*pi + k**2 + t",
    "-(x*y) - k*(x + y) + -x",
    "bend(x) + bend(y) + 3*bend(x)*t",
    "twice(x - y, k) + bend(t)*x",
    "steep(x, 2*t)",
]
MODEL = """
[parameters]
k = 1.25
[elements.bend]
arguments = ["z"]
value = "z**2 if z > 0 else -k*z**2"
[elements.twice]
arguments = ["z", "k"]
value = "bend(z*k) + k*bend(z) + t"
[elements.steep]
arguments = ["a", "b"]
value = "max(a, b) if b > k else twice(a, b)"
[rates]
x = "0"
y = "0"
[initial]
{start}
[noise]
w = 1.0
[outputs]
{outputs}
[run]
duration = 3.0
points = 4
"""
START = """
[initial.covariance]
"x,x" = 2.0
"y,y" = 2.0
"x,y" = 0.3
"""


@pytest.fixture(scope="module")
def system():
    outputs = "\n".join(f'o{k} = "{text}"' for k, text in enumerate(EXPRESSIONS))
    return augment(toml(MODEL.replace("[initial]\n{start}", START).format(outputs=outputs)))


@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_every_function_of_the_language_is_evaluated(system, engine):
    problem = Problem(system, np.linspace(0.0, 3.0, 4))
    records, _ = records_of(problem.plan(1.0)[0], engine, 0, 0, 400)
    x, y = records[:, 0], records[:, 1]
    values = {symbol("x"): x, symbol("y"): y, symbol("t"): problem.times[:, None], symbol("k"): 1.25}
    for k, name in enumerate(system.outputs):
        expected = numeric([system.outputs[name]], values, system.model.vehicle.elements)[..., 0]
        assert np.allclose(records[:, 2 + k], expected, rtol=1e-12, atol=1e-12, equal_nan=True), EXPRESSIONS[k]


def test_the_expressions_use_every_row_of_the_tables(system):
    nodes = {type(n) for e in system.outputs.values() for n in sp.preorder_traversal(e)}
    nodes |= {type(n) for e in system.model.vehicle.elements.values() for n in sp.preorder_traversal(e.value)}
    # The language turns these two round as it reads them.
    assert set(CALLS) | set(FOLDS) <= nodes | {sp.Not, sp.StrictLessThan}


@pytest.mark.parametrize("engine", ["numpy", "numba"])
@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
@pytest.mark.parametrize("method", ["linear", "monotone"])
def test_measured_curves_are_searched(engine, outside, method):
    from cadet_sym.simulation import curves

    z = symbol("z")
    rows = [(-2, 1), (-1, -1), (0, 0), (sp.Rational(1, 2), 3), (2, 3), (4, 7)]
    text = sp.core.symbol.Str
    curve = Lookup(z, sp.Tuple(*(r[0] for r in rows)), sp.Tuple(*(r[1] for r in rows)), text(outside), text(method))
    at = np.concatenate([np.linspace(-4, 6, 201), [float(r[0]) for r in rows]])
    table = np.concatenate([np.zeros(3), curves.curve_table(curve)])
    if engine == "numpy":
        found = curves.lookup(at, table, 3, len(rows))
    else:
        from cadet_sym.simulation import translated

        found = [translated.NAMESPACE["lookup"](float(a), table, 3, len(rows)) for a in at]
    assert np.allclose(found, evaluate(curve, {z: at}), rtol=1e-13, atol=1e-13)


def test_what_does_not_depend_on_the_path_is_worked_out_beforehand():
    k, x, t, V = (symbol(n) for n in ("k", "x", "t", "V(t)"))
    shared = Shared({})
    lines = Emitter({x: "x0"}, shared)
    assert lines.operand(sp.exp(k) * sp.sqrt(t) * x + V**2 * k) == "e1"
    assert set(shared.coefficients) == {sp.exp(k) * sp.sqrt(t), V**2 * k}
    assert lines.lines == ["e0 = c0 * x0", "e1 = c1 + e0"]
    assert lines.operand(sp.sqrt(k) + x) == "e2"
    assert set(shared.constants) == {sp.sqrt(k)}


def test_a_subexpression_is_written_once():
    x = symbol("x")
    lines = Emitter({x: "x0"}, Shared({}))
    lines.operand(sp.sin(x) ** 2 + sp.exp(sp.sin(x)) + sp.sin(x))
    assert sum("sin(" in line for line in lines.lines) == 1


def test_nothing_but_the_table_is_written():
    x = symbol("x")
    with pytest.raises(ModelError, match="cannot evaluate `gamma`"):
        Emitter({x: "x0"}, Shared({})).operand(sp.gamma(x))


def test_names_of_a_model_do_not_reach_the_source():
    system = augment(toml(MODEL.replace("[initial]\n{start}", "").format(outputs='print = "x*k"').replace("bend", "exec_")))
    program = write_program(system, separate_kicks(system))
    for word in ("exec_", "print", "bend"):
        assert word not in program.numba_source
        assert word not in program.numpy_source
