"""What the README and the documentation show is run here, as it stands."""

from __future__ import annotations

import re
import shlex

import pytest
from conftest import ROOT

import cadet_sym as cs
from cadet_sym.cli import main

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")


def blocks(language: str) -> list:
    found = []
    for page in PAGES:
        for number, (kind, text) in enumerate(FENCE.findall(page.read_text(encoding="utf-8"))):
            if kind == language:
                found.append(pytest.param(text, id=f"{page.stem}-{number}"))
    return found


@pytest.mark.parametrize("text", blocks("sh"))
def test_shell_blocks_run(text, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    for line in text.splitlines():
        command, *words = shlex.split(line, comments=True)
        assert command == "cadet-sym", f"a block of sh holds `{line}`"
        assert main(words) == 0, capsys.readouterr().err
    assert capsys.readouterr().out


@pytest.mark.parametrize("text", blocks("python"))
def test_python_blocks_run_and_print_what_they_say(text, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    exec(compile(text, "README", "exec"), {})
    promised = re.findall(r"print\(.*\)  # (.+)$", text, re.MULTILINE)
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) >= len(promised)
    for said, shown in zip(promised, printed, strict=False):
        assert float(shown) == pytest.approx(float(said), rel=1e-4)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_make_command_named_in_the_readme_exists():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = set(re.findall(r"\bmake ([a-z-]+)", (ROOT / "README.md").read_text(encoding="utf-8")))
    assert {"demo", "test"} <= named <= targets


@pytest.mark.parametrize("text", blocks("toml"))
def test_model_files_shown_load_and_run(text, tmp_path):
    (tmp_path / "model.toml").write_text(text, encoding="utf-8")
    history = cs.compile(cs.load(tmp_path / "model.toml")).propagate(points=3)
    assert history.mean.values.shape[0] == 3
