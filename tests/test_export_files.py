"""Names that C accepts, and folders that are written whole, only where they may be."""

from __future__ import annotations

import errno
import json
import keyword
import os
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cadet_sym.cli import main
from cadet_sym.errors import ExportError
from cadet_sym.export.folder import MARKER, write_folder
from cadet_sym.export.names import c_comment, c_string, identifier, identifiers, prefix_of

ABOUT = {"written by": "test"}
WORD = re.compile(r"[A-Za-z0-9_]+\Z", re.ASCII)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("x", "x"), ("h.height", "h_height"), ("ω_n", "omega_n"), ("Ω", "Omega"), ("é", "e"), ("int", "int"),
     ("a b  c", "a_b_c"), ("変", "u5909"), ("", "x"), ("__", "x"), ("λ2", "lamda2")],
)  # fmt: skip
def test_identifiers_resemble_the_name(name, expected):
    assert identifier(name) == expected


@given(st.lists(st.text(max_size=60), unique=True, max_size=30))
@settings(max_examples=300, deadline=None)
def test_identifiers_are_c_and_all_different(names):
    found = identifiers(names)
    assert list(found) == names
    assert all(WORD.match(word) and len(word) < 60 for word in found.values())
    assert len({word.lower() for word in found.values()}) == len(names)


@given(st.text(max_size=60))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_prefix_a_string_and_a_comment(text):
    assert re.match(r"[a-z][a-z0-9_]*\Z", prefix_of(text), re.ASCII)
    literal = c_string(text)
    assert literal.isascii()
    octal = re.sub(r"\\([0-7]{3})", lambda m: chr(int(m[1], 8)), literal[1:-1])
    assert octal.encode("latin-1").decode("utf-8") == text
    comment = c_comment(text)
    assert not re.search(r"\*/|/\*|\?\?|\\|\n", comment)


def test_keywords_do_no_harm_behind_a_prefix():
    assert all(prefix_of(word) for word in keyword.kwlist)


@pytest.mark.parametrize("name", ["main", "Test", "fmi2", "m", "c", "all", "reference"])
def test_names_of_other_files_and_targets_are_left_alone(name):
    assert prefix_of(name) == f"m_{name.lower()}"


def test_a_new_folder_is_written_whole(tmp_path):
    folder = write_folder(tmp_path / "a" / "b", {"x.c": "1", "src/y.c": b"2"}, ABOUT)
    assert (folder / "x.c").read_text() == "1"
    assert (folder / "src" / "y.c").read_bytes() == b"2"
    assert json.loads((folder / MARKER).read_text())["files"] == ["src/y.c", "x.c"]
    assert [path.name for path in folder.parent.iterdir()] == ["b"]


def test_an_export_is_renewed_and_what_is_not_ours_stays(tmp_path):
    write_folder(tmp_path / "c", {"x.c": "1", "old.c": "1"}, ABOUT)
    (tmp_path / "c" / "mine.txt").write_text("kept")
    write_folder(tmp_path / "c", {"x.c": "2"}, ABOUT)
    assert sorted(path.name for path in (tmp_path / "c").iterdir()) == [MARKER, "mine.txt", "x.c"]
    assert (tmp_path / "c" / "x.c").read_text() == "2"


def test_a_folder_that_is_not_ours_is_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("kept")
    with pytest.raises(ExportError, match="--force"):
        write_folder(tmp_path, {"x.c": "1"}, ABOUT)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    write_folder(tmp_path, {"x.c": "1"}, ABOUT, force=True)
    assert (tmp_path / "mine.txt").read_text() == "kept"


def test_a_file_in_the_way_is_refused(tmp_path):
    (tmp_path / "c").write_text("kept")
    for place in (tmp_path / "c", tmp_path / "c" / "below"):
        with pytest.raises(ExportError):
            write_folder(place, {"x.c": "1"}, ABOUT, force=True)
    assert (tmp_path / "c").read_text() == "kept"


def test_a_stale_name_cannot_reach_outside(tmp_path):
    (tmp_path / "victim").write_text("kept")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / MARKER).write_text(json.dumps({"files": ["../victim"]}))
    write_folder(tmp_path / "c", {"x.c": "1"}, ABOUT)
    assert (tmp_path / "victim").read_text() == "kept"


def test_a_full_disk_leaves_nothing_behind(tmp_path, monkeypatch):
    write = Path.write_bytes

    def full(self, data):
        if self.name == "y.c":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ExportError, match="No space left"):
        write_folder(tmp_path / "a" / "b", {"x.c": "1", "y.c": "2"}, ABOUT)
    assert not list(tmp_path.iterdir())
    (tmp_path / "c").mkdir()
    with pytest.raises(ExportError):
        write_folder(tmp_path / "c", {"x.c": "1", "y.c": "2"}, ABOUT)
    assert [path.name for path in tmp_path.iterdir()] == ["c"]
    assert not list((tmp_path / "c").iterdir())


def test_a_read_only_folder_is_one_sentence(tmp_path, monkeypatch, capsys):
    # for the superuser every folder is writable
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    models = Path(__file__).parent.parent / "models"
    assert main(["export", str(models / "duffing.toml"), "--to", str(tmp_path / "c")]) == 1
    assert "no permission" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
