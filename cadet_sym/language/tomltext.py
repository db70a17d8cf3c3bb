"""The few forms of TOML that a model file is written in."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def key_text(name: str) -> str:
    """A key, quoted where it must be."""
    return name if _BARE.fullmatch(name) else string_text(name)


def string_text(text: str) -> str:
    """A basic string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def value_text(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key_text(k)} = {value_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(value_text, value)) + "]"
    return string_text(value)


def table_text(heading: str, entries: Mapping[str, Any]) -> str:
    """A table with its heading; `heading` is a dotted key, empty for the top."""
    lines = [f"[{heading}]"] if heading else []
    lines += [f"{key_text(key)} = {_block(value)}" for key, value in entries.items()]
    return "\n".join(lines)


def _block(value: Any) -> str:
    """A long list one row a line."""
    if isinstance(value, list) and len(value) > 2 and all(isinstance(row, list) for row in value):
        return "[\n" + "".join(f"    {value_text(row)},\n" for row in value) + "]"
    return value_text(value)
