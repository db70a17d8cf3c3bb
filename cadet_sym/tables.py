"""Small tables as text or HTML, and arrays as plain lists."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

__all__ = ["Shown", "aligned", "html", "plain"]


class Shown:
    """Shows at a prompt what it prints, not all the numbers that it holds."""

    def __repr__(self) -> str:
        return str(self)


def plain(values: Any) -> Any:
    """Nested lists of floats (or one float), with None where a value does not exist."""
    array = np.asarray(values, dtype=float)
    return array.tolist() if np.isfinite(array).all() else _with_gaps(array)


def _with_gaps(array: np.ndarray) -> Any:
    gaps = array.astype(object)
    gaps[~np.isfinite(array)] = None
    return gaps.tolist()


def aligned(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table: the first column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    return [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
        for row in (header, *rows)
    ]


def html(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], foot: str) -> str:
    """The same table as HTML, with a title above and a line below."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return (
        f"<div><strong>{escape(title)}</strong>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table><small>{escape(foot)}</small></div>"
    )
