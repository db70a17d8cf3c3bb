"""The exported C library is the model: the same equations, runs and stationary moments, on any compiler."""

from __future__ import annotations

import csv
import io
import random
import subprocess
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from conftest import ROOT, SHIPPED, half
from exported import Exported, build, compiler, shared, sources
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cadet_sym as cs
from cadet_sym.export.c import Run, library
from cadet_sym.export.ground import ground_tables
from cadet_sym.export.names import c_comment, c_string, identifiers
from cadet_sym.export.program import translate
from cadet_sym.lowering.portable import portable

QUICK = ("duffing", "oleo_acceleration", "oleo_constant_speed", "quarter_car_linear", "van_der_pol")
MODELS = [
    path.stem if path.stem in QUICK else pytest.param(path.stem, marks=pytest.mark.slow)
    for path in SHIPPED
]
FIRST = "oleo_acceleration"


@pytest.fixture(scope="module")
def exported(tmp_path_factory, shipped):
    """The compiled library of a shipped model, and its folder."""

    @cache
    def make(name: str) -> tuple[Exported, Path]:
        compiler()
        folder = shipped(name).export_c(tmp_path_factory.mktemp("c") / name, prefix=name)
        return Exported(folder, name, tmp_path_factory.mktemp("so")), folder

    return make


@pytest.fixture(scope="module")
def program(exported, tmp_path_factory):
    """The program of main.c of a shipped model."""

    @cache
    def make(name: str) -> Path:
        c, folder = exported(name)
        return build(folder, tmp_path_factory.mktemp("bin") / name, [folder / "main.c", c.path])

    return make


def samples(compiled: cs.CompiledModel, count: int = 5):
    """Times and moments like those of a run, the first of them without any variance."""
    rng = np.random.default_rng(1)
    packing = compiled.equations.packing
    for k in range(count):
        root = k * rng.normal(size=(packing.n, packing.n))
        moments = packing.pack(k * rng.normal(size=packing.n), root @ root.T)
        y = np.concatenate([moments, np.abs(rng.normal(size=packing.size - packing.moments))])
        yield float(rng.uniform(0.1, 5.0)), y


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    expected = np.asarray(expected).ravel()
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("name", MODELS)
def test_equations_are_those_of_python(name, exported, shipped):
    c, _ = exported(name)
    compiled = shipped(name)
    functions, p = compiled.functions, compiled.parameter_vector()
    size, outputs = compiled.equations.packing.size, len(compiled.outputs)
    pattern = ground_tables(portable(functions), compiled.equations.packing.n).pattern
    close(c.call("initial", p, result=size), compiled.initial(), 1e-13)
    for t, y in samples(compiled):
        close(c.call("rate", t, y, p, result=size), functions.rate(t, y, p), 1e-13)
        values = c.call("jacobian", t, y, p, result=pattern.nnz())
        close(values, np.array(ca.project(functions.jacobian(t, y, p), pattern).nonzeros()), 1e-13)
        dense = c.call("jacobian_dense", t, y, p, result=size**2).reshape(size, size).T
        close(dense.ravel(), np.asarray(ca.densify(functions.jacobian(t, y, p))), 1e-13)
        mean, variance = np.zeros(max(outputs, 1)), np.zeros(max(outputs, 1))
        c.call("outputs", t, y, p, mean, variance)
        expected = functions.outputs(t, y, p)
        close(mean[:outputs], expected[0], 1e-13)
        close(variance[:outputs], expected[1], 1e-13)
    assert list(c.integers("jacobian_row", pattern.nnz())) == pattern.row()
    assert list(c.integers("jacobian_column", size + 1)) == pattern.colind()


@pytest.mark.parametrize(
    ("name", "changed"),
    [("oleo_acceleration", {"a": 3.0}), ("quarter_car_linear", {"m_s": 250.0}), ("half_car", {"x_2": 1.2, "G_d": 1e-4})],
)
def test_the_start_follows_the_parameters(name, changed, exported, shipped):
    c, _ = exported(name)
    compiled = shipped(name)
    assert changed.keys() <= set(compiled.functions.parameters)
    p = compiled.parameter_vector(changed)
    close(c.call("initial", p, result=compiled.equations.packing.size), compiled.initial(changed), 1e-12)


START = """
schema = 1
name = "Two wheels"
[parameters]
k = 30.0
c = 3.0
L = 1.5
V0 = 4.0
[rates]
x = "v"
v = "-k*(2*x - h_1 - h_2) - 2*c*v - v**3"
[contacts]
h_1 = {{ setback = 0.5, track = "main" }}
h_2 = {{ setback = "0.5 + L", track = "main" }}
[ground]
kind = "exponential"
sigma = 0.1
cutoff = 0.5
rolling_contact = 4.0
{profile}
[travel]
speed = "V0 + 0.5*t"
[initial]
{initial}
[run]
duration = 2.0
points = 3
"""


@pytest.mark.parametrize(
    ("initial", "profile", "changed"),
    half([
        ('ground = "smooth"', "", {"k": 20.0, "L": 1.1, "V0": 2.0}),
        ('ground = "stationary"\nx = "h_1"', "", {"k": 20.0, "L": 1.1}),
        ('ground = "stationary"\nx = "h_1"', 'profile = "0.1 if s < -0.2 else 0"', {}),
        ('whole = "stationary"', "", {"k": 20.0, "L": 1.1}),
    ]),
    ids=["smooth", "stationary", "profile", "whole"],
)
def test_every_kind_of_start(initial, profile, changed, tmp_path):
    from cadet_sym.language.modelfile import loads

    compiled = cs.compile(loads(START.format(initial=initial, profile=profile)))
    c = Exported(compiled.export_c(tmp_path / "c", prefix="two"), "two", tmp_path)
    p, size = compiled.parameter_vector(changed), compiled.equations.packing.size
    work = np.zeros(100 * size**2)
    y = np.zeros(size)
    assert c.call("start", p, work, y) is not None
    steady = "whole" in initial
    moments = compiled.equations.packing.moments
    # Python leaves the grid's own error in the correlation with the ground where a run starts in the stationary state
    count, tolerance = (moments, 1e-8) if steady else (size, 1e-11)
    close(y[:count], compiled.initial(changed)[:count], tolerance)
    if profile:
        assert np.abs(y[: compiled.equations.packing.n]).max() > 1e-3


def test_a_direction_that_drifts_is_refused_in_a_sentence(tmp_path):
    from cadet_sym.language.modelfile import loads

    # two masses coupled to each other and to nothing else: their mean place drifts, their distance does not
    text = START.format(initial="", profile="").replace(
        'v = "-k*(2*x - h_1 - h_2) - 2*c*v - v**3"',
        'v = "-k*(x - u) - c*(v - w) + k*h_1"\nu = "w"\nw = "-k*(u - x) - c*(w - v) - k*h_1"',
    )
    compiled = cs.compile(loads(text.replace('h_2 = { setback = "0.5 + L", track = "main" }', "")))
    assert compiled.stationary(speed=5.0).drifting
    folder = compiled.export_c(tmp_path / "c", prefix="two")
    made = build(folder, tmp_path / "two", [*sources(folder), folder / "main.c"])
    run = subprocess.run([made, "--stationary", "5"], capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert not run.stdout
    assert "drifts" in run.stderr


def test_many_nodes_between_wheels_cost_little_text(shipped):
    compiled = shipped("half_car_acceleration")
    assert compiled.equations.packing.size > 800
    run = Run(compiled.parameter_vector(), compiled.initial(), 5.0, 51)
    equations = library(compiled.functions, run, "car").files()
    assert sum(map(len, equations.values())) < 1_500_000


def table(program: Path, *arguments: str) -> dict[str, np.ndarray]:
    run = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    rows = list(csv.reader(io.StringIO(run.stdout)))
    return {name: np.array([float(row[k]) for row in rows[1:]]) for k, name in enumerate(rows[0])}


LARGE = [path.stem for path in SHIPPED if path.stem not in QUICK]
RUNS = [(name, method) for name in QUICK for method in ((), ("--stiff",))]
RUNS += [pytest.param(name, ("--duration", "1"), marks=pytest.mark.slow) for name in LARGE]


@pytest.mark.parametrize(("name", "method"), RUNS)
def test_runs_agree_with_cvodes(name, method, program, shipped):
    rtol = "1e-7" if "--stiff" in method else "1e-9"
    found = table(program(name), "--points", "6", "--rtol", rtol, *method)
    history = shipped(name).propagate(found["t"], rtol=1e-10)
    for column, expected in history.columns().items():
        scale = np.abs(expected).max()
        if column.startswith("covariance"):
            first, second = column.split()[1:]
            scale = max(scale, history.std[first].max() * history.std[second].max())
        np.testing.assert_allclose(found[column], expected, rtol=0, atol=1e-6 * scale + 1e-12, err_msg=column)


@pytest.mark.parametrize("name", MODELS)
def test_stationary_moments_agree(name, program, shipped):
    compiled = shipped(name)
    speed = 20.0 if compiled.model.ground is not None else None
    frozen = bool(compiled.functions.facts.explicit)
    solution = compiled.stationary(speed=speed, at=0.0 if frozen else None)
    if frozen:
        run = subprocess.run([program(name), "--stationary", "20"], capture_output=True, text=True, timeout=60)
        assert run.returncode == 2
        assert "--at" in run.stderr
    found = table(program(name), "--stationary", str(speed or 0.0), *(["--at", "0"] if frozen else []))
    scale = 1e-9 * np.nanmax(solution.std.values)
    for column, expected in solution.columns().items():
        np.testing.assert_allclose(found[column][0], expected, rtol=1e-9, atol=scale)


def test_fixed_steps_converge_to_the_run(program):
    name = "oleo_acceleration"

    def final(*method: str) -> float:
        return table(program(name), "--points", "2", *method)["variance x"][-1]

    errors = [abs(final("--fixed", steps) - final("--rtol", "1e-10")) for steps in ("1500", "3000")]
    assert errors[1] < errors[0] / 10
    assert "fixed step" in subprocess.run([program(name), "--cost"], capture_output=True, text=True).stdout


def test_parameters_may_change(program):
    found = table(program("oleo_acceleration"), "--points", "3", "--set", "r=1")
    assert found["variance x"][1:] == pytest.approx([1.145568, 0.853872], rel=1e-6)
    assert found["mean x"] == pytest.approx(0.0, abs=1e-12)


BRAKE = """
schema = 1
name = "Brake, Ω and a pulse"
[parameters]
"λ" = 3.0
int = 2.0
V = 4.0
[rates]
x = "v"
v = "-int*x - λ*v - v**3 + (20 if t > 1.23 and t < 1.24 else 0) - der(h)"
[contacts]
h = {}
[ground]
kind = "exponential"
sigma = 0.1
cutoff = 0.5
rolling_contact = 2.0
[travel]
speed = "max(V - t, 0)"
[outputs]
"switch" = "x"
[run]
duration = 6.0
points = 7
"""


@pytest.fixture(scope="module")
def brake(tmp_path_factory):
    from cadet_sym.language.modelfile import loads

    compiled = cs.compile(loads(BRAKE))
    folder = compiled.export_c(tmp_path_factory.mktemp("c") / "brake", prefix="auto")
    return compiled, folder, Exported(folder, "auto", tmp_path_factory.mktemp("so"))


def test_breakpoints_follow_the_parameters(brake):
    compiled, _, c = brake
    for V in (4.0, 2.5):
        p = compiled.parameter_vector({"V": V})
        times = np.zeros(16)
        count = c.function("breakpoints")(*map(_pointer, (p,)), _double(6.0), _pointer(times), 16)
        assert times[:count] == pytest.approx(compiled.breakpoints(p, 6.0), abs=1e-9)


def test_a_short_pulse_is_not_stepped_over(brake, tmp_path):
    compiled, folder, c = brake
    made = build(folder, tmp_path / "brake", [folder / "main.c", c.path])
    history = compiled.propagate(rtol=1e-10)
    for method in ([], ["--stiff"]):
        found = table(made, *method)
        np.testing.assert_allclose(found["mean x"], history.mean["x"], rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(found["variance v"], history.variance["v"], rtol=1e-6)


def _pointer(values: np.ndarray):
    import ctypes

    return values.ctypes.data_as(ctypes.c_void_p)


def _double(value: float):
    import ctypes

    return ctypes.c_double(value)


SANITISE = ["-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


EVERY = [
    pytest.param(path.stem, by, marks=pytest.mark.slow)
    for path in SHIPPED
    for by in ("gcc", "clang")
    if (path.stem, by) != ("duffing", "gcc")
]


@pytest.mark.parametrize(("name", "by"), [("duffing", "gcc"), *EVERY])
def test_the_library_is_clean_and_passes_its_own_test(name, by, exported, tmp_path):
    compiler(by)
    _, folder = exported(name)
    library = shared(folder, tmp_path / "library.so", *SANITISE, by=by)
    made = build(folder, tmp_path / "test", [folder / "test.c", library], *SANITISE, by=by)
    run = subprocess.run([made], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    main = build(folder, tmp_path / "main", [folder / "main.c", library], *SANITISE, by=by)
    runs = (["--stationary", "20", "--at", "0"], ["--fixed", "3000"], ["--points", "3", "--stiff"]) if name in QUICK else ()
    for arguments in runs:
        run = subprocess.run([main, *arguments], capture_output=True, text=True, timeout=300)
        assert run.returncode == 0, run.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", [path.stem for path in SHIPPED])
def test_valgrind_finds_nothing(name, program):
    compiler("valgrind")
    short = ["--points", "2", "--duration", "0.5", "--rtol", "1e-4"]
    for arguments in (short, ["--stationary", "20"]) if name in QUICK else (short,):
        run = subprocess.run(
            ["valgrind", "--error-exitcode=9", "--leak-check=full", program(name), *arguments],
            capture_output=True, text=True, timeout=600,
        )
        assert run.returncode == 0, run.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", ["oleo_acceleration", "half_car"])
def test_cmake_builds_and_tests_it(name, exported, tmp_path):
    cmake = compiler("cmake")
    _, folder = exported(name)
    for command in (
        [cmake, "-S", str(folder), "-B", str(tmp_path)],
        [cmake, "--build", str(tmp_path)],
        [compiler("ctest"), "--test-dir", str(tmp_path)],
    ):
        run = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("name", [FIRST, *(pytest.param(n, marks=pytest.mark.slow) for n in QUICK if n != FIRST)])
def test_single_precision(name, exported, tmp_path):
    _, folder = exported(name)
    option = f"-D{name.upper()}_FLOAT"
    made = build(folder, tmp_path / "test", [*sources(folder), folder / "test.c"], "-O1", option)
    run = subprocess.run([made], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stdout


def test_the_library_allocates_nothing(exported):
    c, folder = exported(FIRST)
    names = subprocess.run(["nm", "-u", c.path], capture_output=True, text=True, check=True).stdout
    needed = {line.split()[-1].partition("@")[0] for line in names.splitlines()}
    assert not needed & {"malloc", "calloc", "free", "printf"}
    assert subprocess.run(["make", "-C", folder, "-n"], capture_output=True).returncode == 0


@pytest.mark.parametrize("name", [path.stem for path in SHIPPED])
def test_what_ships_in_generated_is_what_is_exported(name, shipped):
    compiled = shipped(name)
    run = Run(
        compiled.parameter_vector(), compiled.initial(), compiled.model.number(compiled.model.run.duration),
        compiled.model.run.points,
    )
    written = library(compiled.functions, run, name).files()
    folder = ROOT / "generated" / name
    for file, content in written.items():
        assert (folder / file).read_text(encoding="utf-8") == content, f"{file}: run `make generate`"
    assert {path.name for path in folder.iterdir()} >= written.keys()


def test_every_operation_is_written_as_casadi_computes_it(tmp_path):
    """Each row of the table, against CasADi's own evaluation, bit for bit where libm allows."""
    compiler()
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    one = [
        "exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "atanh",
        "floor", "ceil", "fabs", "sign", "erf", "expm1", "log1p",
    ]
    two = ["fmin", "fmax", "atan2", "fmod", "hypot", "copysign", "remainder", "logic_and", "logic_or"]
    results = [getattr(ca, name)(x) for name in one] + [getattr(ca, name)(x, y) for name in two]
    results += [ca.acosh(1 + x), x + y, x - y, x * y, x / y, 1 / x, -x, x + x, x**2, x**y, x**2.5]
    results += [x < y, x <= y, ca.eq(x, y), ca.ne(x, y), ca.logic_not(x), ca.if_else(x < y, x, y)]
    results += [x * 0.1, x + 1e300, x - 5e-324, x + ca.inf]
    function = ca.Function("all", [ca.vertcat(x, y)], [ca.vertcat(*results)], ["z"], ["f"])
    text = translate(function, "all_of_them").text
    header = "#include <math.h>\ntypedef double R;\n#define K(x) (x)\n#define TINY(x) (x)\n#define M(f) f\n"
    (tmp_path / "all.c").write_text(header + "void all_of_them(const R *restrict z, R *restrict f);\n" + text)
    build(tmp_path, tmp_path / "all.so", [tmp_path / "all.c"], "-shared", "-fPIC")
    import ctypes

    made = ctypes.CDLL(str(tmp_path / "all.so"))
    for values in ([0.3, 0.7], [0.9, 0.2], [0.5, 0.5]):
        z, f = np.array(values), np.zeros(len(results))
        made.all_of_them(_pointer(z), _pointer(f))
        np.testing.assert_allclose(f, np.asarray(function(z)).ravel(), rtol=1e-15)


@pytest.mark.slow
def test_long_functions_are_cut_into_blocks(tmp_path):
    z, rng = ca.SX.sym("z", 40), np.random.default_rng(1)
    f, kinds = z, [ca.sin, ca.cos, ca.tanh, ca.atan, ca.sqrt, ca.fabs, ca.exp, ca.sign]
    for k in range(120):  # no two of them alike, or they would be loops
        f = ca.vertcat(*(kinds[rng.integers(8)](ca.fabs(x) / 10) for x in ca.vertsplit(f)))
        f += ca.vertcat(f[1:], f[0]) * (k + 1) / 100
    function = ca.Function("long", [z], [f], ["z"], ["f"])
    program = translate(function, "long_one")
    assert program.text.count("static void") > 3
    header = "#include <math.h>\ntypedef double R;\n#define K(x) (x)\n#define M(f) f\n"
    (tmp_path / "f.c").write_text(header + "void long_one(const R *restrict z, R *restrict f);\n" + program.text)
    build(tmp_path, tmp_path / "f.so", [tmp_path / "f.c"], "-shared", "-fPIC")
    import ctypes

    values, found = np.linspace(-1, 1, 40), np.zeros(40)
    ctypes.CDLL(str(tmp_path / "f.so")).long_one(_pointer(values), _pointer(found))
    np.testing.assert_allclose(found, np.asarray(function(values)).ravel(), rtol=1e-15)


def test_matlab_reads_the_same(shipped, tmp_path):
    octave = compiler("octave-cli")
    compiled = shipped(FIRST)
    folder = compiled.export_c(tmp_path / "m", prefix="oleo", matlab=True)
    (t, y) = list(samples(compiled))[3]
    p = compiled.parameter_vector()
    column = "[" + ";".join(repr(float(v)) for v in y) + "]"
    script = f"m = oleo(); y = {column}; "
    script += f"printf('%.17g\\n', m.rate({t!r}, y, m.p), full(m.jacobian({t!r}, y, m.p)), m.outputs({t!r}, y, m.p));"
    run = subprocess.run([octave, "--quiet", "--eval", script], cwd=folder, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    functions = compiled.functions
    parts = [functions.rate(t, y, p), ca.densify(functions.jacobian(t, y, p)), *functions.outputs(t, y, p)]
    expected = np.concatenate([np.asarray(part).ravel(order="F") for part in parts])
    np.testing.assert_allclose(np.array(run.stdout.split(), dtype=float), expected, rtol=1e-12, atol=1e-12)


WORDS = st.one_of(
    st.sampled_from(
        ["int", "double", "restrict", "main", "NULL", "EOF", "INFINITY", "R", "K", "M", "t", "_Bool", "errno", "rate",
         "y0", "__x", "ω", "Ω", "é", "x y", "a*/b", "a\\", "??/", "sin", "omega", "OMEGA", "用", "", "9a", "a.b"]
    ),
    st.text(max_size=12),
)


ONE = [ca.sin, ca.cos, ca.tanh, ca.erf, ca.fabs, ca.sign, ca.floor, ca.exp, ca.sqrt, ca.log]
TWO = [
    lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / b, ca.fmin, ca.fmax, ca.atan2,
    lambda a, b: ca.if_else(a < b, a, b * b), lambda a, b: ca.fabs(a) ** b,
]


def _leaf():
    return st.one_of(
        st.sampled_from([0, 1]).map(lambda k: lambda z: z[k]),
        st.floats(-3, 3, allow_subnormal=False).map(lambda c: lambda z: ca.SX(c)),
    )


def _grown(inner):
    return st.one_of(
        st.tuples(st.sampled_from(ONE), inner).map(lambda f: lambda z: f[0](f[1](z))),
        st.tuples(st.sampled_from(TWO), inner, inner).map(lambda f: lambda z: f[0](f[1](z), f[2](z))),
    )


def _any(chance: random.Random, z: ca.SX, depth: int = 5) -> ca.SX:
    """An expression in z, from the same operations."""
    kind = chance.random() if depth else 0.0
    if kind < 0.2:
        return z[chance.randrange(2)] if chance.random() < 0.7 else ca.SX(chance.uniform(-3, 3))
    if kind < 0.5:
        return chance.choice(ONE)(_any(chance, z, depth - 1))
    return chance.choice(TWO)(_any(chance, z, depth - 1), _any(chance, z, depth - 1))


def _word(chance: random.Random) -> str:
    letters = [chr(chance.choice([chance.randrange(32, 127), chance.randrange(160, 0x2000), chance.randrange(0xD7FF)]))
               for _ in range(chance.randrange(12))]
    return "".join(letters)


SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]


@settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=SLOW)
@given(
    made=st.lists(st.recursive(_leaf(), _grown, max_leaves=12), min_size=40, max_size=60),
    names=st.lists(WORDS, min_size=20, max_size=30, unique=True),
)
def test_random_expressions_and_names_compile_and_agree(made, names, tmp_path_factory):
    """Many expressions and identifiers in one compilation: the same numbers as CasADi, bit for bit where libm allows."""
    z = ca.SX.sym("z", 2)
    compiled_and_compared(z, [f(z) for f in made], names, tmp_path_factory.mktemp("random"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(6), 7, 11, 13, 17, 19, 23, 29, 31, 77, 99, 1000, 4504, 12345, 2**32])
def test_ten_thousand_expressions_and_names(seed, tmp_path_factory):
    """Twenty files of five hundred of both."""
    chance, z = random.Random(seed), ca.SX.sym("z", 2)
    names = list({_word(chance): None for _ in range(520)})[:500]
    compiled_and_compared(z, [_any(chance, z) for _ in range(500)], names, tmp_path_factory.mktemp("random"))


def compiled_and_compared(z: ca.SX, made: list[ca.SX], names: list[str], folder: Path) -> None:
    import ctypes

    compiler()
    function = ca.Function("all", [z], [ca.vertcat(*made)], ["z"], ["f"])
    words = identifiers(names)
    members = ", ".join(f"NAME_{word} /* {c_comment(name)} */" for name, word in words.items())
    lines = [
        "#include <math.h>\n#include <stdio.h>\n#include <errno.h>\ntypedef double R;",
        "#define K(x) ((R)(x))\n#define TINY(x) (x)\n#define M(f) f",
        f"enum {{ {members} }};",
        f"extern const char *const names[];\nconst char *const names[] = {{ {', '.join(map(c_string, names))} }};",
        "void all_of_them(const R *restrict z, R *restrict f);",
        translate(function, "all_of_them").text,
    ]
    (folder / "f.c").write_text("\n".join(lines), encoding="utf-8")
    build(folder, folder / "f.so", [folder / "f.c"], "-O1", "-ffp-contract=off", "-shared", "-fPIC")
    library = ctypes.CDLL(str(folder / "f.so"))
    held = (ctypes.c_char_p * len(names)).in_dll(library, "names")
    assert [value.partition(b"\0")[0] for value in held] == [name.encode().partition(b"\0")[0] for name in names]
    for values in ([0.3, -1.7], [0.0, 2.0], [-2.5, 0.4], [1.0, 1.0]):
        found = np.zeros(len(made))
        library.all_of_them(_pointer(np.array(values)), _pointer(found))
        expected = np.asarray(function(values)).ravel()
        endless = np.isinf(expected)  # of which sign, C leaves open: that of max(0, -0)
        assert np.isinf(found[endless]).all()
        np.testing.assert_allclose(found[~endless], expected[~endless], rtol=1e-12)
