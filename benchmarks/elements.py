"""What a describing function costs: microseconds for E[f] and its gains, in CasADi's virtual machine and as machine code.

    python benchmarks/elements.py [NAME ...]

Of each the mean over moments of the size of the function's own scales, a third and three times that; the best of many
measurements of the processor's time. The bounds are 2 microseconds for a closed form, 10 for an integral over one argument
and 200 over several, or two measured curves, whose sums are as long. The last columns say how many operations the functions
have, and what it takes to make them and their code.
"""

from __future__ import annotations

import ctypes
import sys
import time
import warnings
from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
import sympy as sp
from sympy.core.symbol import Str

from cadet_sym.expectation import describing_function
from cadet_sym.expectation.conditional import Product
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.language.expression import parse, symbol
from cadet_sym.language.library import LIBRARY
from cadet_sym.language.vocabulary import Lookup
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.functions import is_small
from cadet_sym.lowering.llvm import intermediate
from cadet_sym.lowering.machine import machine_code
from cadet_sym.lowering.operations import size

X, Y, W = symbol("x"), symbol("y"), symbol("w")
STDS, MEANS, CORRELATION = (0.3, 1.0, 3.0), (0.3, -0.5, 0.2), 0.4
PLACES, REPEATS = 60, 15

BOUNDS = {"closed form": 2.0, "over one argument": 10.0, "over several arguments": 200.0, "two measured curves": 200.0}


def curve(argument: sp.Symbol, rows: int = 200, method: str = "linear") -> Lookup:
    """A measured curve of so many rows."""
    z = [sp.Rational(round(1000 * v), 1000) for v in np.linspace(-2, 2, rows)]
    f = [sp.Rational(round(1000 * (np.tanh(2 * float(v)) + 0.3 * np.sin(5 * float(v)))), 1000) for v in z]
    return Lookup(argument, sp.Tuple(*z), sp.Tuple(*f), Str("extrapolate"), Str(method))


def of_library(kind: str, **numbers: float) -> sp.Expr:
    """An element of the library in x, y and w."""
    element = LIBRARY[kind](**numbers)
    return element.value.xreplace(dict(zip(element.arguments, (X, Y, W), strict=False)))


ELEMENTS: Mapping[str, Callable[[], sp.Expr]] = {
    "cubic stiffness": lambda: of_library("cubic_stiffness", stiffness=2),
    "two-sided bump stop": lambda: of_library("two_sided_bump_stop", rebound_gap=0.5, bump_gap=0.4, stiffness=2),
    "hardening beyond gap": lambda: of_library("hardening_beyond_gap", gap=0.3, stiffness=2),
    "oleo": lambda: of_library("asymmetric_quadratic", r=0.1),
    "four-slope damper": lambda: of_library(
        "multi_slope_damper", rebound=2, rebound_high=1, rebound_knee=0.3, bump=1, bump_high=0.5, bump_knee=0.2
    ),
    "coulomb": lambda: of_library("coulomb", force=1),
    "relay": lambda: of_library("relay", level=1, dead_zone=0.2),
    "clip(x, -1, 1)**3": lambda: parse("clip(x, -1, 1)**3"),
    "Stribeck": lambda: of_library("stribeck", kinetic=0.5, static=1, speed=0.2),
    "table of 200 rows": lambda: curve(X),
    "monotone table of 200 rows": lambda: curve(X, method="monotone"),
    "|x|**0.4 sign(x)": lambda: of_library("power_law_damping", coefficient=1, exponent=0.4),
    "gas spring": lambda: of_library("gas_spring", force=1, length=1, stop=0.9),
    "tanh(x)": lambda: parse("tanh(x)"),
    "tanh(20*x)": lambda: parse("tanh(20*x)"),
    "atan(x)": lambda: parse("atan(x)"),
    "atan(5*x)*tanh(x - 1)": lambda: parse("atan(5*x)*tanh(x - 1)"),
    "x**2*y": lambda: parse("x**2*y"),
    "Bouc-Wen 1": lambda: of_library("bouc_wen", A=1, beta=0.5, gamma=0.5),
    "sign(x)*max(y, 0)": lambda: of_library("coulomb_normal_load", friction=0.4),
    "table of 8 rows by 8": lambda: curve(X, 8) * curve(Y, 8),
    "table of 200 rows by 200": lambda: curve(X) * curve(Y),
    "table of 200 rows times tanh(y)": lambda: curve(X) * parse("tanh(y)"),
    "table of 200 rows times |y|**0.5": lambda: curve(X) * parse("sqrt(abs(y))"),
    "monotone table of 60 by exp(-|y|)": lambda: curve(X, 60, "monotone") * parse("exp(-abs(y))"),
    "Bouc-Wen 1.5": lambda: of_library("bouc_wen", A=1, beta=0.5, gamma=0.5, exponent=sp.Rational(3, 2)),
    "|y||x|**0.5 x": lambda: parse("abs(y)*abs(x)**0.5*x"),
    "sqrt(|x - 0.5|) sqrt(|y + 0.3|)": lambda: parse("sqrt(abs(x - 0.5))*sqrt(abs(y + 0.3))"),
    "|x|**0.5 sign(x) tanh(y)": lambda: parse("abs(x)**0.5*sign(x)*tanh(y)"),
    "tanh(x*y)": lambda: parse("tanh(x*y)"),
    "|x| tanh(x*y)": lambda: parse("abs(x)*tanh(x*y)"),
    "max(x**2 - y, 0)": lambda: parse("max(x**2 - y, 0)"),
    "max(x - y**3, 0)": lambda: parse("max(x - y**3, 0)"),
    "clip(x*y**2, -1, 1)": lambda: parse("clip(x*y**2, -1, 1)"),
    "clip(x*y, -1, 1)": lambda: parse("clip(x*y, -1, 1)"),
    "y sqrt(x**2 + y**2 + 0.01)": lambda: parse("y*sqrt(x**2 + y**2 + 0.01)"),
    "y sqrt(x**2 + y**2)": lambda: parse("y*sqrt(x**2 + y**2)"),
    "sqrt(x**2 + y**2)": lambda: parse("sqrt(x**2 + y**2)"),
    "drag in space": lambda: of_library("drag_in_space", coefficient=1),
    "x sqrt(x**2 + y**2 + w**2 + 1)": lambda: parse("x*sqrt(x**2 + y**2 + w**2 + 1)"),
    "max(w, 0) x/sqrt(x**2 + y**2 + 1)": lambda: parse("max(w, 0)*x/sqrt(x**2 + y**2 + 1)"),
    "atan2(y, x)": lambda: parse("atan2(y, x)"),
}


def kind(df: DescribingFunction) -> str:
    if not df.nodes:
        return "two measured curves" if any(isinstance(p, Product) and p.pairs for p in df.products) else "closed form"
    return "over one argument" if len(df.arguments) == 1 else "over several arguments"


def places(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Means (places, k) and covariances (places, k (k + 1)/2)."""
    stds = np.resize(STDS, PLACES)[:, None, None]
    correlations = np.where(np.eye(count), 1.0, CORRELATION)
    S = (stds**2 * correlations)[:, *np.tril_indices(count)]
    return stds[:, 0] * MEANS[:count], np.ascontiguousarray(S)


def one_by_one(function: ca.Function) -> ca.Function:
    """The function at all places, at one after the other as in a rate: not at several at once."""
    inputs = [ca.MX.sym(f"x{k}", function.size1_in(k)) for k in range(3)]
    return ca.Function("one", inputs, function.call(inputs)).map("over", "serial", PLACES, [2], [])


def seconds(run: Callable[[], object]) -> float:
    """Of the processor, the best of many."""
    best, times = np.inf, 1
    for _ in range(REPEATS):
        begin = time.process_time()
        for _ in range(times):
            run()
        taken = time.process_time() - begin
        best = min(best, taken / times)
        times = max(times, int(0.02 / max(taken / times, 1e-6)))
    return best


def in_virtual_machine(over: ca.Function, m: np.ndarray, S: np.ndarray) -> float:
    """Seconds for one place."""
    buffer, evaluate = over.buffer()
    results = [np.empty(over.numel_out(k)) for k in range(2)]
    for k, given in enumerate((m, S)):
        buffer.set_arg(k, memoryview(given))
    for k, result in enumerate(results):
        buffer.set_res(k, memoryview(result))
    return seconds(evaluate) / len(m)


def as_machine_code(over: ca.Function, m: np.ndarray, S: np.ndarray) -> tuple[float, float]:
    """Seconds for one place, and to write and compile the code."""
    begin = time.process_time()
    code = machine_code(intermediate(over, "element"), "element", effort=int(is_small(over)))
    made = time.process_time() - begin
    run = code.function("element", *[ctypes.c_void_p] * 5)
    results = [np.empty(over.numel_out(k)) for k in range(2)]
    given = [each.ctypes.data for each in (m, S, np.zeros(1), *results)]
    return seconds(lambda: run(*given)) / len(m), made


def row(name: str) -> None:
    body = ELEMENTS[name]()
    arguments = tuple(z for z in (X, Y, W) if body.has(z))
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        df = describing_function(arguments, body)
    function = element_function(df, ())
    made = time.process_time() - begin
    m, S = places(len(arguments))
    over = one_by_one(function)
    virtual = in_virtual_machine(over, m, S)
    machine, compiled = as_machine_code(over, m, S)
    bound = BOUNDS[kind(df)]
    print(
        f"{name:<36}{kind(df):<24}{bound:6.0f}{1e6 * virtual:11.2f}{1e6 * machine:11.2f}{virtual / machine:8.1f}"
        f"{'' if 1e6 * machine <= bound else ' !':>2}{size(function):11d}{made:8.2f}{compiled:8.2f}"
    )


if __name__ == "__main__":
    print(f"{'':<60}{'bound':>6}{'CasADi us':>11}{'machine us':>11}{'ratio':>8}  {'operations':>11}{'made s':>8}{'code s':>8}")
    for name in sys.argv[1:] or ELEMENTS:
        row(name)
