"""Models that a C compiler could trip over: names that are its own, one state, nothing random, frozen and drifting states."""

from __future__ import annotations

import csv
import io
import subprocess

import numpy as np
import pytest
from conftest import one_in
from exported import build, shared, sources

import cadet_sym as cs
from cadet_sym.errors import ExportError
from cadet_sym.language.modelfile import loads

MODELS = {
    "keywords": r"""
schema = 1
name = "int main(void) { return 0; } */ // \\ ??/"

[parameters]
K = 30.0
M = 1.0
R = 2.0
NULL = 0.5
errno = 1.0
TINY = 0.1
SIZE = 0.2
FLT_EPSILON = 0.3
[rates]
int = "double"
double = "-K*int - R*double - NULL*main"
main = "y - M*main + w"
y = "-y*errno + 0.1*I"
I = "-I*TINY - SIZE*dy + z1"
dy = "-dy*FLT_EPSILON + w"
R2 = "-R2+w"
values = "-values"
stages = "-stages + w"
u = "-u + z1"
[noise]
w = 1.0
z1 = 0.5
[outputs]
restrict = "int**2"
return = "double*main"
P = "der(int)"
[run]
duration = 2.0
points = 5
""",
    "clashes": r"""
schema = 1
name = "ω"

[parameters]
"α" = 1.0
alpha = 2.0
Alpha = 3.0
"ALPHA" = 1.0
[rates]
x_1 = "-alpha*x_1 - α*x_1 + w"
"x__1" = "-Alpha*x__1 + x_1"
X_1 = "-ALPHA*X_1+x_1"
"é" = "-é + w"
e = "-e + é"
"用" = "-用 + w"
_ = "-_ + w"
__ = "-__ + _"
[noise]
w = 1.0
[outputs]
x_1_ = "x_1"
"Ω" = "X_1"
"ω" = "e"
[run]
duration = 1.0
points = 3
""",
    "tiny": r"""
schema = 1
name = "one state"

[rates]
x = "-x**3 + w"
[noise]
w = 1.0
[run]
duration = 3.0
points = 3
""",
    "constant": r"""
schema = 1
name = "frozen and drifting"

[parameters]
a = 2.0
[rates]
x = "0"
y = "1"
z = "w"
v = "-v*abs(v) + x"
[noise]
w = "a"
[initial]
x = 1.0
[run]
duration = 3.0
points = 3
""",
    "nonoise": r"""
schema = 1
name = "no noise at all"

[rates]
x = "v"
v = "-x - 0.2*v*abs(v)"
[initial]
x = 1.0
[run]
duration = 3.0
points = 3
""",
    "both": r"""
schema = 1
name = "noise in time and ground"

[parameters]
V = 10.0
q = 0.1
[rates]
x = "v"
v = "-100*(x-h_f/2-h_r/2) - 4*v - 3*max(v,0) + w + 0.5*u"
[noise]
names = ["w", "u"]
intensity = [["q", "0.02"], ["0.02", "q*2"]]
[contacts]
h_f = { setback = 0.0, track = "l" }
h_r = { setback = "1.5", track = "l" }
g = { setback = 0.3, track = "r" }
[ground]
kind = "exponential"
sigma = 0.02
cutoff = 0.3
rolling_contact = 4.0
[travel]
speed = "V + 2*t"
[outputs]
stroke = "x - h_f + g"
[run]
duration = 2.0
points = 3
""",
    "distance": r"""
schema = 1
name = "distance, class change, profile"

[parameters]
V = 6.0
b = 0.05
[rates]
x = "v"
v = "-100*(x-h) - 4*v - 30*clip(v, -0.1, 0.2)"
[contacts]
h = {}
[ground]
kind = "shaping_filter"
rates = { h = "p", p = "-1.2*p - 0.4*h + (0.05 if s < 7 else 0.1)*w" }
noise = { w = 1.0 }
height = "h"
profile = "b*(1-cos(s)) if s > -3 and s < 6 else 0"
[travel]
speed = "V + sin(t)*exp(-t*t)"
[run]
duration = 2.0
points = 3
""",
}

MIXED = """
schema = 1
name = "Smooth in two arguments at once"
[elements.mix]
arguments = ["a", "b"]
value = "tanh(a*b)"
[rates]
x = "v"
v = "-x - 0.4*v - mix(x, v) + w"
[noise]
w = 1.0
[run]
duration = 0.5
points = 3
"""


@pytest.mark.parametrize("name", one_in(3, MODELS))
def test_it_compiles_and_agrees(name, tmp_path):
    compiled = cs.compile(loads(MODELS[name]))
    folder = compiled.export_c(tmp_path / "c", prefix="hostile")
    library = shared(folder, tmp_path / "library.so")
    for program in ("test", "main"):
        build(folder, tmp_path / program, [folder / f"{program}.c", library])
    check = subprocess.run([tmp_path / "test"], capture_output=True, text=True, timeout=60)
    assert check.returncode == 0, check.stdout
    run = subprocess.run([tmp_path / "main", "--rtol", "1e-9"], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    header, *rows = csv.reader(io.StringIO(run.stdout))
    numbers = np.array(rows, dtype=float)
    assert len(set(header)) == len(header)
    history = compiled.propagate(numbers[:, 0], rtol=1e-10)
    for column, values in zip(header[1:], numbers.T[1:], strict=True):
        expected = history.columns()[column]
        scale = np.abs(expected).max()
        if column.startswith("covariance"):
            first, second = column.split()[1:]
            scale = max(scale, history.std[first].max() * history.std[second].max())
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-6 * scale + 1e-12, err_msg=column)


def test_stationary_moments_are_found_where_nothing_is_damped_at_first(tmp_path):
    folder = cs.compile(loads(MODELS["tiny"])).export_c(tmp_path / "c", prefix="hostile")
    made = build(folder, tmp_path / "main", [*sources(folder), folder / "main.c"])
    run = subprocess.run([made, "--stationary", "0"], capture_output=True, text=True, timeout=60)
    # x' = -x^3 + w: 6 P^2 = Q
    assert float(run.stdout.splitlines()[1].split(",")[2]) == pytest.approx(6**-0.5, rel=1e-12)


def test_what_is_too_much_for_a_compiler_is_refused_in_a_sentence(tmp_path, monkeypatch):
    from cadet_sym.lowering import portable

    monkeypatch.setattr(portable, "LARGEST", 1000)
    compiled = cs.compile(loads(MIXED))
    with pytest.raises(ExportError, match=r"operations.*nodes.*`mix`"):
        compiled.export_c(tmp_path / "c")
    assert not list(tmp_path.iterdir())
