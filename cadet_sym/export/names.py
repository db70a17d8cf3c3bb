"""Make C identifiers of any names: Greek, dots, keywords, whatever a model calls its states."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

__all__ = ["c_comment", "c_string", "identifier", "identifiers", "prefix_of"]

LONGEST = 40
"""Characters of an identifier before it is cut; C99 tells 63 apart, and ours carry a prefix."""


def identifier(name: str) -> str:
    """ASCII letters, digits and underscores that resemble a name; to be put behind a prefix of ours."""
    parts = []
    for character in unicodedata.normalize("NFKD", name):
        if character.isascii() and (character.isalnum() or character == "_"):
            parts.append(character)
        elif unicodedata.combining(character):
            continue
        elif character.isalpha():
            parts.append(_spelled(character))
        else:
            parts.append("_")
    return re.sub("__+", "_", "".join(parts)).strip("_")[:LONGEST].rstrip("_") or "x"


def _spelled(letter: str) -> str:
    """A letter in words: omega, Omega, or its number."""
    words = unicodedata.name(letter, "").split()
    if len(words) == 4 and words[0] in ("GREEK", "CYRILLIC") and words[2] == "LETTER":
        return words[3].capitalize() if words[1] == "CAPITAL" else words[3].lower()
    return f"u{ord(letter):04x}"


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Every name's identifier, each different from all others, in capitals and small letters alike."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        base = candidate = identifier(name)
        number = 1
        while candidate.lower() in taken:
            number += 1
            candidate = f"{base}_{number}"
        taken.add(candidate.lower())
        found[name] = candidate
    return found


TAKEN = frozenset(
    {
        # files of ours beside the library's
        *("main", "test", "reference", "unit", "fmi2", "fmi3"),
        # libraries that it is linked with
        *("m", "c"),
        # what make and CMake call targets of their own
        *("all", "clean", "help", "install", "package", "edit_cache", "rebuild_cache", "preinstall"),
    }
)


def prefix_of(name: str) -> str:
    """What every public name of a library begins with: small letters, not a digit first, no name that is taken."""
    base = identifier(name).lower()
    return base if base[0].isalpha() and base not in TAKEN else f"m_{base}"


def c_string(text: str) -> str:
    """A C string literal in plain ASCII that holds the text in UTF-8."""
    parts = []
    for byte in text.encode("utf-8"):
        plain = 32 <= byte < 127 and chr(byte) not in '"\\?'
        parts.append(chr(byte) if plain else f"\\{byte:03o}")
    return '"' + "".join(parts) + '"'


def c_comment(text: str) -> str:
    """Text that can stand in a C comment on one line: nothing in it ends, continues or opens one."""
    printable = "".join(c if c.isprintable() else " " for c in " ".join(text.split()))
    return printable.replace("\\", "/").replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
