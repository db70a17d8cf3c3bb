"""Wrong input is answered with one message that names the thing, and the exit status says whose fault it is."""

from __future__ import annotations

import json

import pytest
from conftest import ROOT

from cadet_sym.cli import main

TOY = """
schema = 1
name = "toy"

[parameters]
k = 1.0
q = 0.1

[elements.spring]
arguments = ["z"]
value = "z + z**3"

[rates]
x = "v"
v = "-k*spring(x) - 0.2*v + w"

[noise]
w = "q"

[outputs]
displacement = "x"

[run]
duration = 2.0
points = 3
"""

ROAD = """
schema = 1
name = "road"

[parameters]
V = 10.0
sigma = 0.01

[rates]
x = "v"
v = "-40*x - 2*v - der(h, 2)"

[contacts]
h = {}

[ground]
kind = "exponential"
sigma = "sigma"
cutoff = 0.5
rolling_contact = 5.0

[travel]
speed = "V"

[run]
duration = 2.0
points = 3
"""


@pytest.fixture
def run(capsys, tmp_path):
    """Write a model file and run a command on it: gives status and standard error; checks that nothing else came."""

    def run(text: str, command: str = "moments", *words: str) -> tuple[int, str]:
        model = tmp_path / "model.toml"
        model.write_text(text, encoding="utf-8")
        status = main([command, str(model), *words])
        out, err = capsys.readouterr()
        assert out == ""
        assert "Traceback" not in err
        assert err.count("cadet-sym:") == 1, err
        return status, err

    return run


def edited(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new)


DECLARATIONS = {
    "undeclared name": (edited(TOY, "0.2*v", "0.2*vv"), ["model.toml", "[rates] v", "vv", "^"]),
    "missing rate": (edited(TOY, 'x = "v"\n', ""), ["x"]),
    "unknown key": (edited(TOY, "points = 3", "point = 3"), ["[run]", "point"]),
    "unknown table": (edited(TOY, "[outputs]", "[output]"), ["output"]),
    "wrong type": (edited(TOY, "duration = 2.0", "duration = true"), ["[run]", "duration"]),
    "wrong number of arguments": (edited(TOY, "spring(x)", "spring(x, v)"), ["spring", "1", "2"]),
    "not TOML": (edited(TOY, "[rates]", "[rates"), ["model.toml"]),
    "not an expression": (edited(TOY, "-k*spring(x)", "-k*spring(x"), ["[rates] v", "^"]),
    "code": (edited(TOY, "0.2*v", "__import__('os')"), ["[rates] v"]),
    "no function of the state": (edited(TOY, '"z + z**3"', '"3"'), ["[elements.spring] value", "`3`", "`z`"]),
    "limits in the wrong order": (edited(TOY, "z + z**3", "clip(z, 1, -1)"), ["[elements.spring] value", "swap them", "^"]),
    "no expectation": (edited(TOY, "z + z**3", "(1 + z)**-1.4"), ["`spring`", "`x + 1`", "clip", "1/(x + 1)**1.4"]),
    "nowhere a number": (edited(TOY, "z + z**3", "sqrt(-1 - z**2)"), ["`spring`", "sqrt(-x**2 - 1)", "nowhere a real number"]),
    "a stop beyond the pole": (edited(TOY, "z + z**3", "(1 + max(z, -k))**-1.4"), ["`spring`", "k", "is -1", "parameters"]),
    "noise in an output": (
        edited(TOY, 'displacement = "x"', 'displacement = "x + w"'),
        ["displacement", "w"],
    ),
    "negative intensity": (edited(TOY, "q = 0.1", "q = -0.1"), ["w"]),
    "no such schema": (edited(TOY, "schema = 1", "schema = 99"), ["schema", "99"]),
    "cyclic parameters": (edited(TOY, "k = 1.0", 'k = "q"').replace("q = 0.1", 'q = "k"'), ["k", "q"]),
    "covariance": (TOY + '[initial.covariance]\n"x,v" = 0.1\n', ["covariance", "positive semidefinite"]),
    "too rough a ground": (edited(ROAD, "rolling_contact = 5.0\n", ""), ["der(h, 2)", "rolling_contact"]),
    "negative speed": (edited(ROAD, 'speed = "V"', 'speed = "V - 10*t"'), ["speed", "t ="]),
}


@pytest.mark.parametrize("case", DECLARATIONS, ids=str)
def test_a_wrong_declaration_ends_with_status_2(case, run):
    text, named = DECLARATIONS[case]
    status, err = run(text)
    assert status == 2, err
    for word in named:
        assert word in err


ARGUMENTS = {
    "unknown parameter": ("moments", ["--set", "kk=2"], ["kk", "k"]),
    "not a setting": ("moments", ["--set", "k"], ["--set k", "NAME=VALUE"]),
    "not a value": ("moments", ["--set", "k=1+"], ["k", "1+"]),
    "not times": ("moments", ["--times", "1,two"], ["--times 1,two", "1,5,10"]),
    "falling times": ("moments", ["--times", "2,1"], ["increase"]),
    "times and points": ("moments", ["--times", "1", "--points", "3"], ["--times", "--points"]),
    "negative duration": ("moments", ["--duration", "-1"], ["duration", "-1"]),
    "no points": ("moments", ["--points", "0"], ["--points", "2"]),
    "tolerance": ("moments", ["--rtol", "-1"], ["rtol", "-1"]),
    "unknown option": ("moments", ["--fast"], ["--fast", "--help"]),
    "suffix of data": ("moments", ["--save", "run.xls"], ["run.xls", ".nc"]),
    "suffix of a figure": ("moments", ["--plot", "run.gif"], ["run.gif", ".png"]),
    "no paths": ("validate", ["--paths", "0"], ["paths", "0"]),
    "some paths": ("validate", ["--paths", "some"], ["--paths some", "a whole number or auto"]),
    "target of a number of paths": ("validate", ["--target", "0.1"], ["--target 0.1", "give --paths auto"]),
    "no target": ("validate", ["--paths", "auto", "--target", "-1"], ["`target`", "greater than zero"]),
    "target of nothing": ("validate", ["--paths", "auto", "--target", "0"], ["`target`", "greater than zero"]),
    "sweep of nothing": ("stationary", ["--sweep", "k=1:2"], ["--sweep k=1:2", "NAME=LO:HI:N"]),
    "sweep of no parameter": ("stationary", ["--sweep", "kk=1:2:3"], ["kk"]),
    "figure of one solution": ("stationary", ["--plot", "run.png"], ["--sweep"]),
    "speed without a ground": ("stationary", ["--speed", "3"], ["speed", "ground"]),
}


@pytest.mark.parametrize("case", ARGUMENTS, ids=str)
def test_a_wrong_argument_ends_with_status_2(case, run, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    command, words, named = ARGUMENTS[case]
    status, err = run(TOY, command, *words)
    assert status == 2, err
    for word in named:
        assert word in err
    assert [path.name for path in tmp_path.iterdir()] == ["model.toml"]


NUMERICS = {
    "no stationary solution": ("stationary", edited(TOY, "-k*spring(x)", "k*spring(x)"), []),
    "overflow": ("moments", edited(TOY, "-k*spring(x)", "k*spring(x)"), ["--duration", "100"]),
}


@pytest.mark.parametrize("case", NUMERICS, ids=str)
def test_failing_numerics_end_with_status_1_and_leave_no_file(case, run, tmp_path):
    command, text, words = NUMERICS[case]
    status, err = run(text, command, *words, "--save", str(tmp_path / "run.nc"))
    assert status == 1, err
    assert [path.name for path in tmp_path.iterdir()] == ["model.toml"]


def test_a_missing_model_file_is_named(capsys):
    assert main(["moments", "nowhere.toml"]) == 2
    assert "nowhere.toml" in capsys.readouterr().err


def test_a_missing_command_or_argument_ends_with_status_2(capsys):
    assert main(["moment", "x.toml"]) == 2
    assert "moment" in capsys.readouterr().err
    assert main(["moments"]) == 2
    assert "MODEL" in capsys.readouterr().err


def test_an_unwritable_folder_is_refused_before_the_run(run, tmp_path):
    (tmp_path / "file").write_text("")
    status, err = run(TOY, "moments", "--save", str(tmp_path / "file" / "run.nc"))
    assert status == 1
    assert "is not a folder" in err


def test_debug_shows_where_it_arose(tmp_path):
    model = tmp_path / "model.toml"
    model.write_text(edited(TOY, "0.2*v", "0.2*vv"), encoding="utf-8")
    with pytest.raises(Exception, match="vv"):
        main(["moments", str(model), "--debug"])


def test_what_a_library_prints_does_not_reach_the_json(capsys, monkeypatch):
    import cadet_sym as cs

    compile_model = cs.compile

    def noisy(*arguments, **options):
        print("a library speaks")
        return compile_model(*arguments, **options)

    monkeypatch.setattr(cs, "compile", noisy)
    assert main(["moments", str(ROOT / "models" / "duffing.toml"), "--points", "2", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["model"]
    assert "a library speaks" in err


def test_a_warning_is_one_line_on_standard_error(capsys, monkeypatch):
    import warnings

    import cadet_sym as cs

    compile_model = cs.compile

    def wary(*arguments, **options):
        warnings.warn("element `spring` is known to 1e-6 only", stacklevel=1)
        return compile_model(*arguments, **options)

    monkeypatch.setattr(cs, "compile", wary)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(["moments", str(ROOT / "models" / "duffing.toml"), "--points", "2", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)
    assert err == "cadet-sym: warning: element `spring` is known to 1e-6 only\n"
