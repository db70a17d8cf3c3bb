"""Measured curves: from arrays, from CSV files that stand beside the model, or row by row in it."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.symbol import Str

from cadet_sym.errors import ModelError
from cadet_sym.language.bounds import current_limits
from cadet_sym.language.names import did_you_mean, exact
from cadet_sym.language.units import conversion
from cadet_sym.language.vocabulary import Lookup

_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_HEADER_UNIT = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
OUTSIDE = ("extrapolate", "hold")
INTERPOLATION = ("linear", "monotone")
Row = tuple[sp.Rational, ...]


def measured_curve(
    argument: Any, positions: Any, values: Any, *, outside: str = "extrapolate", interpolation: str = "linear"
) -> sp.Expr:
    """A measured curve as an expression: the value of an `Element`, or of a profile along `s`.

    Parameters
    ----------
    argument : a symbol or an expression: where the curve is read.
    positions, values : (k,) numbers, k >= 2, the positions increasing.
    outside : "extrapolate", the first and the last piece go on; or "hold", the first and the last value do.
    interpolation : "linear" between the rows, or "monotone": the cubic of Fritsch and Butland.

    Raises
    ------
    ModelError : rows missing, not finite, out of order or too many; an unknown word.
    """
    for key, given, known in (("outside", outside, OUTSIDE), ("interpolation", interpolation, INTERPOLATION)):
        if given not in known:
            raise ModelError(f"`{key}` of a measured curve is one of: {', '.join(known)}; not {given!r}")
    try:
        columns = [np.asarray(column, dtype=float) for column in (positions, values)]
    except (TypeError, ValueError):
        raise ModelError("the rows of a measured curve are real numbers, in two columns of one length") from None
    if columns[0].ndim != 1 or columns[0].shape != columns[1].shape:
        shapes = " and ".join(str(column.shape) for column in columns)
        raise ModelError(f"a measured curve is two columns of one length; their shapes are {shapes}")
    if not all(np.isfinite(column).all() for column in columns):
        raise ModelError("the rows of a measured curve are finite numbers; leave the others out")
    given = [list(row) for row in zip(*(column.tolist() for column in columns), strict=True)]
    return make_curve(sp.sympify(argument), inline_rows(given, exact), outside, interpolation)


def make_curve(argument: sp.Expr, rows: Sequence[Row], outside: str, interpolation: str) -> Lookup:
    """A Lookup from its rows, (z, f) each."""
    knots, values = (sp.Tuple(*column) for column in zip(*rows, strict=True))
    return Lookup(argument, knots, values, Str(outside), Str(interpolation))


def checked_rows(rows: Sequence[Row], what: str, label: Callable[[int], str]) -> list[Row]:
    """Rows in increasing order of the first column; ModelError that names the row that is not."""
    if len(rows) < 2:
        raise ModelError(f"{what} has {len(rows)} row{'s' if len(rows) != 1 else ''}, and a curve needs two or more")
    for k in range(1, len(rows)):
        if rows[k][0] == rows[k - 1][0]:
            raise ModelError(f"{what}, {label(k)}: the same position {_short(rows[k][0])} as the row before; keep one of them")
        if rows[k][0] < rows[k - 1][0]:
            raise ModelError(
                f"{what}, {label(k)}: {_short(rows[k][0])} after {_short(rows[k - 1][0])}; "
                "sort the rows by the first column, increasing"
            )
    return list(rows)


def _short(number: sp.Rational) -> str:
    return f"{float(number):.6g}"


def inline_rows(
    given: Any, number: Callable[[Any], sp.Expr], units: Sequence[str] = (), kinds: Sequence[str] = ("", "")
) -> list[Row]:
    """Rows written in the model itself, [[z, f], ...], in SI units."""
    rows: list[Row] = []
    factors = [conversion(unit, kind) for unit, kind in zip(units, kinds, strict=True)] if units else [sp.S.One] * 2
    if len(given) > current_limits().rows:
        raise ModelError(f"a table of {len(given)} rows, and the limit is {current_limits().rows}")
    for k, row in enumerate(given, start=1):
        if not isinstance(row, list) or len(row) != 2:
            raise ModelError(f"row {k} of the table: two numbers are wanted, as [0.1, 25.0]")
        values = tuple(number(value) for value in row)
        if not all(value.is_Rational for value in values):
            raise ModelError(f"row {k} of the table: numbers are wanted, not {row}")
        rows.append(tuple(value * factor for value, factor in zip(values, factors, strict=True)))
    return checked_rows(rows, "the table", lambda k: f"row {k + 1}")


def csv_rows(
    folder: Path,
    path: str,
    *,
    columns: Sequence[str] = (),
    units: Sequence[str] = (),
    kinds: Sequence[str] = ("", ""),
) -> list[Row]:
    """Two columns of a CSV file as exact numbers in SI units.

    Parameters
    ----------
    folder, path : the model's folder and the file in it; the path may not lead out of the folder.
    columns : names of the two columns in the header; the first two if none are given.
    units : their units in the file; SI, or what the header says in brackets if that is SI, if none are given.
    kinds : what they must be: "length", "time", "speed", or "" for anything.

    Raises
    ------
    ModelError : naming the file and the row.
    """
    header, lines = _read(folder, path)
    picked = _columns(header, columns, path)
    factors = _factors([header[i] for i in picked], units, kinds, path)
    rows: list[Row] = []
    for line, fields in lines:
        if len(fields) != len(header):
            raise ModelError(f"{path}, line {line}: {len(fields)} values, and the header has {len(header)} columns")
        rows.append(
            tuple(
                _number(fields[i], f"{path}, line {line}, column `{header[i]}`") * factor
                for i, factor in zip(picked, factors, strict=True)
            )
        )
    numbers = [line for line, _ in lines]
    return checked_rows(rows, path, lambda k: f"line {numbers[k]}")


def _read(folder: Path, path: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Header and rows with their line numbers."""
    limits = current_limits()
    text = read_text(inside(folder, path), path, limits.table_bytes)
    if not text.strip():
        raise ModelError(f"{path} is empty: a header row and rows of numbers are wanted")
    lines: list[tuple[int, list[str]]] = []
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for fields in reader:
            if any(field.strip() for field in fields):
                lines.append((reader.line_num, [field.strip() for field in fields]))
            if len(lines) > limits.rows + 1:
                raise ModelError(f"{path} has more than {limits.rows} rows, which is the limit")
    except csv.Error as error:
        raise ModelError(f"{path}, line {reader.line_num}: this is not a row of a CSV file ({error})") from None
    header = lines[0][1]
    if all(_DECIMAL.fullmatch(field) for field in header):
        raise ModelError(f"{path}, line {lines[0][0]}: numbers where the header should be; name the columns in the first row")
    if len(header) < 2:
        hint = ": separate them by commas, with a decimal point" if ";" in header[0] or "\t" in header[0] else ""
        raise ModelError(f"{path} has one column, and two are wanted{hint}")
    return header, lines[1:]


def inside(folder: Path, path: str) -> Path:
    """The file that a path names, if it lies in the folder or below it."""
    if not isinstance(path, str) or not path or "\0" in path:
        raise ModelError(f"the name of a file is wanted, not {path!r}")
    root = folder.resolve()
    target = (root / path).resolve()
    if Path(path).is_absolute() or not target.is_relative_to(root):
        raise ModelError(f"the file `{path}` lies outside the model's folder: put it beside the model", token=path)
    if not target.is_file():
        raise ModelError(f"there is no file `{path}` beside the model", token=path)
    return target


def read_text(target: Path, shown: str, most: int) -> str:
    """Text of a file of at most so many bytes."""
    try:
        with target.open("rb") as stream:
            data = stream.read(most + 1)
    except OSError as error:
        raise ModelError(f"{shown} cannot be read: {error.strerror or error}") from None
    if len(data) > most:
        raise ModelError(f"{shown} is larger than {most} bytes, which is the limit")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise ModelError(f"{shown}, line {line}: this is not UTF-8 text; save the file as UTF-8") from None


def _columns(header: list[str], wanted: Sequence[str], path: str) -> list[int]:
    if not wanted:
        return [0, 1]
    bare = [_HEADER_UNIT.sub("", name).strip() for name in header]
    picked = []
    for name in wanted:
        if name not in header and name not in bare:
            raise ModelError(
                f"{path} has no column `{name}`{did_you_mean(name, bare)}; it has {', '.join(header)}",
                token=name,
            )
        picked.append(header.index(name) if name in header else bare.index(name))
    return picked


def _factors(header: list[str], units: Sequence[str], kinds: Sequence[str], path: str) -> list[sp.Expr]:
    """What each column is multiplied by to be in SI units."""
    factors = []
    for i, (name, kind) in enumerate(zip(header, kinds, strict=True)):
        in_header = _HEADER_UNIT.search(name)
        declared = units[i] if units else None
        said = in_header.group(1) if in_header else None
        try:
            known = conversion(said, kind) if said else None
        except ModelError:
            known = None
        if declared is None:
            if known is not None and known != 1:
                raise ModelError(f"{path}: the header says `{name}`, which is not SI; declare it, as units = [..., ...]")
            factors.append(sp.S.One)
            continue
        factor = conversion(declared, kind)
        if known is not None and known != factor:
            raise ModelError(f"{path}: the header says `{name}`, and the model declares `{declared}`; correct one of them")
        factors.append(factor)
    return factors


def _number(field: str, where: str) -> sp.Rational:
    if not field:
        raise ModelError(f"{where}: a value is missing")
    if len(field) > 60 or not _DECIMAL.fullmatch(field):
        hint = "; a decimal point is wanted" if re.fullmatch(r"[+-]?\d+,\d+", field) else ""
        raise ModelError(f"{where}: `{field[:40]}` is not a finite number{hint}")
    number = float(field)
    return exact(number) if number not in (float("inf"), float("-inf")) else _infinite(field, where)


def _infinite(field: str, where: str) -> sp.Rational:
    raise ModelError(f"{where}: `{field}` is beyond the range of floating point")
