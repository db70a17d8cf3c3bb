"""Compiled models on disk: found again in any process, never out of date, never in the way."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, one_in

import cadet_sym as cs
from cadet_sym import cache
from cadet_sym.cli import main
from cadet_sym.errors import ExpectationWarning, ModelError

MODEL = """
schema = 1
name = "kept"
[parameters]
k = 4.0
e = 0.1
[rates]
x = "v"
v = "-k*x - 0.4*v - e*x**3 + w"
[noise]
w = 1.0
[outputs]
force = "e*x**3"
[run]
duration = 2.0
points = 3
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch) -> Path:
    """A cache of the test's own."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(cache.VARIABLE, str(folder))
    return folder


@pytest.fixture
def path(tmp_path) -> Path:
    file = tmp_path / "kept.toml"
    file.write_text(MODEL)
    return file


def run(*arguments: str | Path, place: Path | None = None) -> subprocess.CompletedProcess[str]:
    """`cadet-sym` in a process of its own, which says on standard error whether it imported SymPy."""
    code = (
        "import sys\nfrom cadet_sym.cli import main\nstatus = main(sys.argv[1:])\n"
        "print('sympy' in sys.modules, file=sys.stderr)\nsys.exit(status)"
    )
    words = [sys.executable, "-c", code, *map(str, arguments)]
    env = os.environ if place is None else {**os.environ, cache.VARIABLE: str(place)}
    return subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, timeout=120)


def files(place: Path) -> list[Path]:
    return sorted(file for file in place.rglob("*") if file.is_file())


def same(first: cs.MomentHistory, second: cs.MomentHistory) -> bool:
    return all(
        np.array_equal(getattr(first, name), getattr(second, name))
        for name in ("state_mean", "state_covariance", "output_mean", "output_variance")
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """What the first process of all printed for the moments of the model, and what it left in its cache."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "kept.toml").write_text(MODEL)
    return run("moments", folder / "kept.toml", "--json", place=folder / "cache"), folder / "cache"


@pytest.fixture
def first(made, place) -> subprocess.CompletedProcess[str]:
    """What a first process printed for the moments, with what it left in place."""
    printed, folder = made
    shutil.copytree(folder, place)
    return printed


def test_a_second_process_makes_nothing_and_needs_no_sympy(first, path, place):
    is_found_again("moments", first, path, place)


@pytest.mark.slow
def test_nor_does_one_that_looks_for_the_stationary_state(path, place):
    is_found_again("stationary", run("stationary", path, "--json"), path, place)


def is_found_again(command: str, first: subprocess.CompletedProcess[str], path: Path, place: Path) -> None:
    kept = {file: file.stat().st_mtime_ns for file in files(place)}
    second = run(command, path, "--json")
    assert (first.stderr, second.stderr) == ("True\n", "False\n")
    assert first.stdout == second.stdout
    assert json.loads(second.stdout)["states"] == ["x", "v"]
    assert {file: file.stat().st_mtime_ns for file in files(place)} == kept


def test_other_numbers_of_the_parameters_need_no_new_equations(first, path, place, capsys):
    equations = {file.parent for file in files(place) if file.name == "facts"}
    changed = run("moments", path, "--set", "k=9", "--json")
    again = run("moments", path, "--set", "k=9", "--json")
    assert again.stderr == "False\n"
    assert again.stdout == changed.stdout
    assert {file.parent for file in files(place) if file.name == "facts"} == equations
    cache.clear()
    assert main(["moments", str(path), "--set", "k=9", "--json"]) == 0
    assert capsys.readouterr().out == changed.stdout


DAMAGES = [lambda text: text[: len(text) // 2], lambda text: b"", lambda text: b"foreign" + text]


@pytest.mark.parametrize("damage", one_in(3, DAMAGES))
def test_a_file_cut_off_or_foreign_is_made_again_without_a_complaint(damage, first, path, place):
    whole = {file: file.read_bytes() for file in files(place)}
    for file in whole:
        file.write_bytes(damage(file.read_bytes()))
    second = run("moments", path, "--json")
    assert (second.returncode, second.stdout, second.stderr) == (0, first.stdout, "True\n")
    assert {file: file.read_bytes() for file in files(place)} == whole


def test_one_lost_function_is_made_again(path, place):
    first = cs.compile(path).propagate()
    next(file for file in files(place) if file.name == "rate.casadi").unlink()
    assert same(cs.compile(path).propagate(), first)
    assert any(file.name == "rate.casadi" for file in files(place))


def test_a_writer_that_is_killed_leaves_nothing_that_is_read(path, place):
    code = (
        "import os, signal, sys, cadet_sym as cs\n"
        "os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        "cs.compile(sys.argv[1])"
    )
    killed = subprocess.run([sys.executable, "-c", code, str(path)], cwd=ROOT, capture_output=True, timeout=120)
    assert killed.returncode < 0
    assert [file.name for file in files(place) if not file.name.startswith(".writing-")] == []
    assert main(["moments", str(path), "--json"]) == 0
    assert run("moments", path, "--json").stderr == "False\n"


def test_writers_at_the_same_time_do_not_disturb_each_other(path):
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda _: run("moments", path, "--json"), range(2)))
    assert len({each.stdout for each in together}) == 1
    assert {each.returncode for each in together} == {0}
    assert run("moments", path, "--json").stderr == "False\n"


def test_where_nothing_can_be_written_all_else_works(path, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    expected = cs.compile(path).propagate()
    for place in (str(tmp_path / "file" / "cache"), cache.OFF):
        monkeypatch.setenv(cache.VARIABLE, place)
        assert same(cs.compile(path).propagate(), expected)


def test_a_changed_file_or_table_is_another_model(path, tmp_path):
    table = tmp_path / "damper.csv"
    table.write_text("v,F\n-1,-2\n0,0\n1,2\n")
    text = MODEL.replace("e*x**3 + w", "damper(v) + w") + '[elements.damper]\narguments = ["z"]\ntable = "damper.csv"\n'
    path.write_text(text.replace('force = "e*x**3"', 'force = "damper(v)"'))
    first = cs.compile(path)
    found = first.propagate()
    table.write_text("v,F\n-1,-2\n0,0\n1,8\n")
    assert not same(cs.compile(path).propagate(), found)
    path.write_text(path.read_text().replace("0.4*v", "0.9*v"))
    second = cs.compile(path)
    assert not same(second.propagate(), found)
    assert second.model.hash == second.declaration.hash


def test_a_model_read_after_its_file_changed_is_refused(path):
    cs.compile(path)
    kept = cs.compile(path)
    path.write_text(MODEL.replace("k*x", "2*k*x"))
    with pytest.raises(ModelError, match="has changed"):
        assert kept.model


def test_equations_in_another_order_keep_their_own_order(path):
    first = cs.load(path)
    path.write_text(MODEL.replace('x = "v"\n', "").replace('+ w"\n', '+ w"\nx = "v"\n', 1))
    second = cs.load(path)
    assert cs.compile(first).propagate().states == ("x", "v")
    assert cs.compile(second).propagate().states == ("v", "x")
    np.testing.assert_allclose(
        cs.compile(second).propagate().variance["x"], cs.compile(first).propagate().variance["x"], rtol=1e-7
    )


@pytest.mark.parametrize("name", ["oleo_acceleration", "half_car", "road_class_change", "quarter_car_linear", "stop_and_go"])
def test_functions_from_the_cache_give_the_same_bit_for_bit(name):
    path = ROOT / "models" / f"{name}.toml"
    made, kept = cs.compile(path), None
    fresh = made.propagate(points=5, rtol=1e-6)
    kept = cs.compile(path)
    assert same(kept.propagate(points=5, rtol=1e-6), fresh)
    assert "symbolic" not in vars(kept.functions)
    assert kept.equations.states == made.equations.states


def test_a_warning_of_an_inexact_expectation_comes_every_time(path, monkeypatch):
    monkeypatch.setattr("cadet_sym.expectation.accuracy.WARNED", 1e-17)
    path.write_text(MODEL.replace("e*x**3", "e*tanh(3*x)*(1 + sign(x))"))
    seen, found = [], []
    for _ in range(2):
        with pytest.warns(ExpectationWarning) as caught:
            compiled = cs.compile(path)
        seen.append([str(each.message) for each in caught])
        assert {each.filename for each in caught} == {__file__}, "told where the package was called"
        found.append(compiled.propagate())
    assert seen[0] == seen[1]
    assert len(seen[0]) == 2, "the worst of an element, and of an output"
    assert same(*found)
    assert "symbolic" not in vars(compiled.functions), "read from the cache all the same"


def test_the_command_shows_and_clears_it(path, place, capsys, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, cache.OFF)
    cs.compile(path).propagate()  # the integrator's own code, of which each process asks once
    monkeypatch.setenv(cache.VARIABLE, str(place))
    cs.compile(path).propagate()
    (place / "mine.txt").write_text("not ours")
    assert main(["cache"]) == 0
    assert f"Kept in {place}: 2 entries, 0." in capsys.readouterr().out
    assert main(["cache", "--clear"]) == 0
    assert "2 entries" in capsys.readouterr().out
    assert main(["cache"]) == 0
    assert ": 0 entries, 0.0 MB" in capsys.readouterr().out
    assert os.listdir(place) == ["mine.txt"]
    monkeypatch.setenv(cache.VARIABLE, cache.OFF)
    assert main(["cache"]) == 0
    assert "No cache" in capsys.readouterr().out


def test_what_was_not_used_for_long_goes(place, monkeypatch):
    monkeypatch.setattr(cache, "MOST", 10)
    for k in range(12):
        shelf = cache.shelf(f"{k:064x}")
        assert shelf is not None
        shelf.write("facts", b"{}")
        os.utime(shelf.path, (k, k))
    cache.trim()
    assert sorted(int(entry.name, 16) for entry in place.iterdir()) == list(range(3, 12))
