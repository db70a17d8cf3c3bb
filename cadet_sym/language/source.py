"""Source text of an expression: looked at character by character, then read by Python's parser; nothing is executed."""

from __future__ import annotations

import ast
import keyword
import re
import unicodedata
from dataclasses import dataclass
from typing import NoReturn

from cadet_sym.errors import ModelError
from cadet_sym.language.bounds import Limits
from cadet_sym.language.vocabulary import KEYWORDS

_PUNCTUATION = frozenset("_+-*/()<>=!., \t\r\n")
_HINTS = {
    "^": "a power is written `**`",
    "#": "comments stand outside the quotes",
    "=": "a comparison is written `==`",
    "&": "write `and`",
    "|": "write `or`",
    "~": "write `not`",
    "[": "group with round brackets",
    "{": "group with round brackets",
    "%": "there is no remainder in this language",
    "−": "the minus sign is `-`",
    "–": "the minus sign is `-`",
    "×": "multiplication is written `*`",
    "·": "multiplication is written `*`",
    "≤": "write `<=`",
    "≥": "write `>=`",
    "'": "a derivative is written `der(h)`",
}
_STUCK = re.compile(r"(?<![\w.])(?>\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?+[^\W\d]\w*")
# Letters of a script that no engineer names a damper in: they mask words that Python keeps to itself, as `lambda`.
_MASKS = [chr(code) for code in range(0x13A0, 0x13F0)]


@dataclass(frozen=True)
class Source:
    """A text that Python's parser could read, and where its nodes stand in it."""

    text: str
    code: str  # what was parsed: one line, masked, without the blanks around it
    margin: int  # blanks before it
    masked: dict[str, str]
    root: ast.expr

    def column(self, node: ast.AST, *, end: bool = False) -> int:
        """Character of the text at which a node begins (or ends)."""
        offset = getattr(node, "end_col_offset" if end else "col_offset", 0) or 0
        return self.margin + len(self.code.encode()[:offset].decode(errors="ignore"))

    def segment(self, node: ast.AST) -> str:
        """The text of a node."""
        return self.text[self.column(node) : self.column(node, end=True)]

    def name(self, node: ast.Name) -> str:
        """A name as it was written."""
        return self.masked.get(node.id, node.id)


def read_source(text: str, limits: Limits) -> Source:
    """Check the characters of a text and parse it; ModelError with the column of what is wrong."""
    if len(text) > limits.characters:
        raise ModelError(
            f"an expression of {len(text)} characters, and the limit is {limits.characters}: "
            "split it into elements, or raise the limit"
        )
    _check_characters(text)
    line = re.sub(r"\s", " ", text)
    masked: dict[str, str] = {}
    code = _mask(line, masked)
    margin = len(code) - len(code.lstrip())
    code = code.strip()
    try:
        root = ast.parse(code, mode="eval").body
    except SyntaxError as error:
        column = min((error.offset or len(code) + 1) - 1 + margin, len(text))
        _fail(text, _syntax_problem(text, column, error.msg or "", limits), column)
    except (RecursionError, MemoryError, ValueError, OverflowError):
        _fail(text, f"nested deeper than {limits.levels} levels: split it into elements", margin)
    return Source(text, code, margin, masked, root)


def _fail(text: str, message: str, column: int) -> NoReturn:
    raise ModelError(message, text=text, column=column)


def _check_characters(text: str) -> None:
    if not text.strip():
        raise ModelError("an empty expression; write 0 for nothing")
    for position, character in enumerate(text):
        if character in _PUNCTUATION or (character.isascii() and character.isalnum()):
            continue
        plain = unicodedata.normalize("NFKC", character)
        if plain != character and not character.isspace() and character not in _HINTS:
            _fail(text, f"the character `{character}` is a variant of `{plain}`: write that", position)
        if not ("_" + character).isidentifier():
            hint = f": {_HINTS[character]}" if character in _HINTS else ""
            shown = character if character.isprintable() else f"U+{ord(character):04X}"
            _fail(text, f"the character `{shown}` has no place in an expression{hint}", position)
    if stuck := _STUCK.search(text):
        _fail(
            text, f"`{stuck.group()}` cannot be read: multiplication is written `*`, numbers in digits", stuck.start()
        )
    plain = unicodedata.normalize("NFKC", text)
    if plain != text:
        position = next(i for i, (a, b) in enumerate(zip(text, plain + "\0", strict=False)) if a != b)
        _fail(text, "a letter and its accent are written apart: write them as one character (NFKC)", position)


def _mask(line: str, masked: dict[str, str]) -> str:
    """The line with words that are keywords of Python, but not of this language, behind names of the same length."""
    spare = (mark for mark in _MASKS if mark not in line)

    def replace(match: re.Match[str]) -> str:
        word = match.group()
        if not keyword.iskeyword(word) or word in KEYWORDS:
            return word
        known = next((mask for mask, original in masked.items() if original == word), None)
        mask = known or next(spare) + word[1:]
        masked[mask] = word
        return mask

    return re.sub(r"(?<![\w.])[^\W\d]\w*", replace, line)


def _syntax_problem(text: str, column: int, found: str, limits: Limits) -> str:
    """What is probably wrong where Python's parser gave up."""
    if "too many nested" in found:
        return f"nested deeper than {limits.levels} levels: split it into elements"
    if re.search(r"(?<![<>=!])=(?!=)", text):
        return "`=` has no place in an expression: a comparison is written `==`"
    if text.count("(") != text.count(")"):
        return "brackets do not match"
    if re.search(r"\bif\b", text) and not re.search(r"\belse\b", text):
        return "a conditional needs its `else`: write `A if C else B`"
    if not text[column:].strip():
        return "the expression ends too early"
    return "this cannot be read: an operator, a comma or a bracket is missing or too many"
