"""Write files whole or not at all: beside their place first, then moved into it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cadet_sym.errors import ExportError, ModelError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["DATA_SUFFIXES", "FIGURE_SUFFIXES", "check_target", "save_as", "whole_file"]

DATA_SUFFIXES = (".nc", ".csv", ".mat")
FIGURE_SUFFIXES = (".png", ".pdf", ".svg")


def check_target(path: str | Path, suffixes: Sequence[str]) -> Path:
    """Say at once whether ``path`` can be written, so that no long run ends in vain; nothing is made.

    Raises
    ------
    ModelError
        The suffix is not one of ``suffixes``.
    ExportError
        The path is a folder, or its folder cannot be written to.
    """
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        found = f"the suffix `{target.suffix}`" if target.suffix else "no suffix"
        raise ModelError(f"cannot write `{target}`: found {found}; end the name in {' or '.join(suffixes)}")
    if target.is_dir():
        raise ExportError(f"cannot write `{target}`: it is a folder; give the name of a file")
    folder = target.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        raise ExportError(f"cannot write `{target}`: `{folder}` is not a folder; choose another place")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ExportError(f"cannot write `{target}`: no permission in `{folder}`; choose another folder")
    return target


@contextmanager
def whole_file(path: str | Path, suffixes: Sequence[str]) -> Iterator[Path]:
    """Give a temporary path beside ``path`` to write to; move it into place if all went well, else remove it.

    The folder is made if it is missing. A file that was there before stays as it was on failure.

    Raises
    ------
    ModelError
        The suffix is not one of ``suffixes``.
    ExportError
        The file cannot be written: no permission, disk full.
    """
    target = check_target(path, suffixes)
    temporary = target.with_name(f".{target.stem}.{os.urandom(4).hex()}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(target)
    except OSError as error:
        reason = error.strerror or error
        raise ExportError(
            f"cannot write `{target}`: {reason}; choose another folder or make room there"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def save_as(
    path: str | Path, dataset: Callable[[], xr.Dataset], columns: Callable[[], Mapping[str, np.ndarray]]
) -> Path:
    """Write netCDF or MATLAB from a labelled data set, or CSV from columns, by the suffix of ``path``."""
    with whole_file(path, DATA_SUFFIXES) as temporary:
        match temporary.suffix.lower():
            case ".nc":
                dataset().to_netcdf(temporary, engine="h5netcdf")
            case ".mat":
                _save_mat(temporary, dataset())
            case _:
                _save_csv(temporary, columns())
    return Path(path)


def _save_csv(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    import csv

    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*(np.atleast_1d(column).tolist() for column in columns.values()), strict=True))


def _save_mat(path: Path, dataset: xr.Dataset) -> None:
    from scipy.io import savemat

    arrays = {str(name): variable.values for name, variable in dataset.variables.items()}
    # MATLAB has no arrays of strings of several lengths, but cell arrays.
    arrays = {name: a.astype(object) if a.dtype.kind in "UT" else a for name, a in arrays.items()}
    attributes = {str(name).replace(" ", "_"): value for name, value in dataset.attrs.items()}
    savemat(path, {**arrays, "attributes": attributes}, do_compression=True, long_field_names=True)
