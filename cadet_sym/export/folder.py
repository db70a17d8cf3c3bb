"""Put a set of files into a folder, all or none of them; refuse to touch a folder that is not ours."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path

from cadet_sym.errors import ExportError

__all__ = ["MARKER", "check_folder", "write_folder"]

MARKER = "cadet-sym.json"
"""The file that says that a folder was written by us, with what, and which files are ours."""


def check_folder(path: str | Path, *, force: bool = False) -> Path:
    """Say at once whether an export can go to `path`; nothing is made.

    Raises
    ------
    ExportError
        The path is a file, a folder with contents that are not ours (unless `force`), or cannot be written to.
    """
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise ExportError(f"cannot export to `{target}`: it is a file; name a folder that is new, or empty")
    if target.is_dir() and not force and any(target.iterdir()) and _ours(target) is None:
        raise ExportError(
            f"cannot export to `{target}`: it holds files that are not an export of cadet-sym; "
            "name another folder, or add --force to write there and leave the rest alone (in Python `force=True`)"
        )
    existing = target if target.is_dir() else target.absolute().parent
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise ExportError(f"cannot export to `{target}`: `{existing}` is not a folder; choose another place")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise ExportError(f"cannot export to `{target}`: no permission in `{existing}`; choose another folder")
    return target


def write_folder(
    path: str | Path, files: Mapping[str, str | bytes], about: Mapping[str, object], *, force: bool = False
) -> Path:
    """Write files (relative name to content) and the marker; earlier files of ours that are not among them go.

    They are written beside the folder and moved into place when all of them are whole. Files in the folder that are
    not ours stay.

    Raises
    ------
    ExportError
        As `check_folder`, or if the disk is full; the folder is then as it was before.
    """
    target = check_folder(path, force=force)
    marker = json.dumps({**about, "files": sorted(files)}, indent=2, ensure_ascii=False) + "\n"
    missing = [folder for folder in (target.absolute(), *target.absolute().parents) if not folder.exists()][1:]
    temporary = target.absolute().parent / f".{target.name}.{secrets.token_hex(4)}"
    done = False
    try:
        temporary.mkdir(parents=True)
        for name, content in {**files, MARKER: marker}.items():
            _write(temporary / name, content)
        if target.exists():
            _merge(temporary, target, {*files, MARKER})
        else:
            temporary.replace(target)
        done = True
    except OSError as error:
        reason = error.strerror or error
        raise ExportError(f"cannot export to `{target}`: {reason}; choose another folder or make room there") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if not done:
            for folder in missing:
                _remove_if_empty(folder)
    return target


def _write(path: Path, content: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))


def _merge(source: Path, target: Path, names: set[str]) -> None:
    """Move new files over the old; remove those of an earlier export that are no longer written."""
    stale = set(_ours(target) or ()) - names
    for name in sorted(names):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).replace(target / name)
    for name in stale:
        place = target / name
        if target.resolve() in place.resolve().parents:
            place.unlink(missing_ok=True)


def _ours(folder: Path) -> list[str] | None:
    """The files of an earlier export; None if the folder is none."""
    try:
        content = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        names = content["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else None


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        return
