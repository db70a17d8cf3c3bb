"""Machine code: the same moments, made once, kept on disk, refused in a sentence where there is no compiler."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import cadet_sym as cs
from cadet_sym import cache
from cadet_sym.cli import main
from cadet_sym.errors import ModelError
from cadet_sym.lowering import machine
from cadet_sym.solve.transient import integrate

needs_compiler = pytest.mark.skipif(
    not any(shutil.which(name) for name in machine.COMPILERS), reason="there is no C compiler"
)
OLEO = "models/oleo_acceleration.toml"


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    return tmp_path / "cache"


def error(history: cs.MomentHistory, reference: cs.MomentHistory) -> float:
    size = np.sqrt(reference.variance.values.max(axis=0))
    return float((np.abs(history.state_covariance - reference.state_covariance) / np.outer(size, size)).max())


@needs_compiler
@pytest.mark.parametrize("name", ["oleo_acceleration", "quarter_car_linear", "road_class_change"])
def test_machine_code_gives_the_same_moments(name):
    path = f"models/{name}.toml"
    reference = cs.compile(path).propagate(rtol=1e-10, points=21)
    compiled = cs.compile(path, jit=True)
    for rtol, most in ((1e-6, 1e-5), (1e-8, 1e-7)):
        history = compiled.propagate(rtol=rtol, points=21)
        assert history.provenance.engine == "Runge-Kutta 5(4), machine code"
        assert error(history, reference) < most
    assert error(compiled.propagate([0.3, 0.31, 2.0], rtol=1e-8), cs.compile(path).propagate([0.3, 0.31, 2.0])) < 1e-6


@needs_compiler
def test_it_is_compiled_once_and_again_where_it_was_cut_off(place, monkeypatch):
    first = cs.compile(OLEO, jit=True).propagate(points=5)
    libraries = list(place.rglob("*.so"))
    assert len(libraries) == 1
    calls = []
    compile_text = machine._compile
    monkeypatch.setattr(machine, "_compile", lambda text: calls.append(1) or compile_text(text))
    again = cs.compile(OLEO, jit=True).propagate(points=5)
    assert calls == []
    cut = libraries[0].read_bytes()[:1000]
    libraries[0].unlink()  # the file itself is in use in this process
    libraries[0].write_bytes(cut)
    mended = cs.compile(OLEO, jit=True).propagate(points=5)
    assert calls == [1]
    for history in (again, mended):
        np.testing.assert_array_equal(history.state_covariance, first.state_covariance)


@needs_compiler
def test_the_rate_of_a_larger_engine_is_machine_code_too():
    compiled = cs.compile(OLEO, jit=True)
    assert compiled.functions.fast_rate.class_name() == "External"
    start = compiled._start(compiled.parameter_vector(), 10.0)
    found = integrate(compiled.functions, start, [5.0], rtol=1e-8, engine="implicit")
    np.testing.assert_allclose(found.y[0, :4], compiled.propagate([5.0]).state_mean[0], rtol=1e-5, atol=1e-7)


@needs_compiler
def test_without_a_cache_it_works(monkeypatch, capsys):
    monkeypatch.setenv(cache.VARIABLE, cache.OFF)
    assert main(["moments", OLEO, "--points", "3", "--jit", "--json"]) == 0
    assert capsys.readouterr().out


def test_no_compiler_is_one_sentence(monkeypatch, capsys):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(ModelError, match="C compiler"):
        cs.compile(OLEO, jit=True)
    assert main(["moments", OLEO, "--jit", "--json"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.skipif(shutil.which("false") is None, reason="there is no `false`")
def test_a_compiler_that_fails_is_said(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(ModelError, match="cannot compile"):
        cs.compile(OLEO, jit=True).propagate(points=3)
