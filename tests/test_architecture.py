"""Claims about the package as a whole: what it imports, when, and that its version is said once."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from conftest import ROOT

import cadet_sym as cs
from cadet_sym.version import VERSION

LATE = {
    "matplotlib",
    "xarray",
    "pandas",
    "numba",
    "llvmlite",
    "scipy",
    "sksundae",
    "h5py",
    "typer",
    "rich",
    "mpmath",
}
NEEDED_BY_SYMPY = {"mpmath"}


def loaded_by(code: str) -> set[str]:
    """Top-level names of the modules that a fresh interpreter holds after `code`."""
    script = f"import sys\n{code}\nprint('LOADED', *{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True, timeout=120
    )
    return set(run.stdout.rpartition("LOADED")[2].split())


def test_imports_run_one_way_only():
    pytest.importorskip("importlinter", reason="import-linter is not installed")
    linter = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run([linter], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stdout + run.stderr


def test_importing_the_package_loads_only_what_every_use_needs():
    assert not loaded_by("import cadet_sym") & (LATE - NEEDED_BY_SYMPY)


def test_moments_as_json_loads_no_drawing_or_data_frame():
    code = (
        "from cadet_sym.cli import main\n"
        "status = main(['moments', 'models/duffing.toml', '--points', '3', '--json'])\n"
        "assert status == 0"
    )
    assert not loaded_by(code) & (LATE - NEEDED_BY_SYMPY - {"typer", "llvmlite"})


def test_a_command_in_a_process_of_its_own_seldom_looks_for_garbage():
    code = (
        "import gc\n"
        "from cadet_sym.__main__ import SELDOM, run\n"
        "sys.argv = ['cadet-sym', 'moments', 'nowhere.toml']\n"
        "assert run() == 2\n"
        "assert gc.get_threshold()[0] == SELDOM\n"
        "assert gc.get_freeze_count() > SELDOM\n"
    )
    assert "cadet_sym" in loaded_by(code)


def imported_by(path: Path) -> set[str]:
    """Top-level names of all that a module's text imports, at once or late."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


def test_only_the_lowering_knows_sympy_and_casadi_both():
    package = ROOT / "cadet_sym"
    both = {p.relative_to(package) for p in package.rglob("*.py") if {"sympy", "casadi"} <= imported_by(p)}
    assert {path.parts[0] for path in both} <= {"lowering"}


def test_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert version("cadet-sym") == VERSION == project["version"]
    assert f"## {project['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_public_names_have_docstrings():
    missing = [name for name in cs.__all__ if not (getattr(cs, name).__doc__ or name.startswith("__"))]
    assert not missing
