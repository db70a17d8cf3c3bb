"""What can go wrong, by whose fault it is. Every message names the thing, what was found and what to do.

The command line turns the class into its exit status: 2 for a wrong model or wrong arguments, 1 for numerics and files.
"""

from __future__ import annotations

import re
from typing import Any


class CadetError(Exception):
    """Root of the errors this package raises on purpose; `exit_status` is what the command line returns."""

    exit_status = 1


class ModelError(CadetError):
    """The declaration is wrong: the user's model file, Python declaration or argument.

    Parameters
    ----------
    message : what was found and what to do about it.
    table, key : where in the model ("rates", "v"); the model file's own words.
    token : the offending name or text, to be pointed at when the text is at hand.
    file, text, column : the model file, the text of the entry, and the index of the character in it to point at.
    """

    exit_status = 2

    def __init__(
        self,
        message: str,
        *,
        table: str = "",
        key: str = "",
        token: str = "",
        file: str = "",
        text: str = "",
        column: Any = None,
    ):
        super().__init__(message)
        self.message, self.table, self.key, self.token = message, table, key, token
        self.file, self.text, self.column = file, text, column

    def placed(self, **where: Any) -> ModelError:
        """Return this error with the places that it did not know yet filled in (`file=`, `table=`, `key=`, `text=`)."""
        for name, value in where.items():
            if getattr(self, name) in ("", None):
                setattr(self, name, value)
        if self.column is None and self.token and self.text:
            self.column = _find_word(self.text, self.token)
        return self

    def __str__(self) -> str:
        place = " ".join(part for part in (f"[{self.table}]" if self.table else "", self.key) if part)
        head = ": ".join(part for part in (self.file, place, self.message) if part)
        if not self.text or self.column is None:
            return head
        return f"{head}\n{caret(self.text, self.column)}"

    def __reduce__(self):
        state = {name: value for name, value in self.__dict__.items() if name != "message"}
        return (_rebuild, (type(self), self.message, state))


class LinearisationError(ModelError):
    """No expectation exists, or there is no rule for this nonlinearity."""


class SolverError(CadetError):
    """Numerics failed: no convergence, no solution, overflow.

    Keyword arguments (time, state, eigenvalues, partial, ...) are kept in `details` and as attributes.
    """

    exit_status = 1
    partial: Any  # of a run that broke down: what it had reached

    def __init__(self, message: str, **details: Any):
        super().__init__(message)
        self.details = details
        for name, value in details.items():
            setattr(self, name, value)


class ExportError(CadetError):
    """Something could not be exported or written."""

    exit_status = 1


def caret(text: str, column: int, *, width: int = 100, indent: str = "    ") -> str:
    """The line of `text` that holds character `column`, and a caret under that character.

    Long lines are cut around the column, so that the message stays readable whatever the model holds.
    """
    from unicodedata import combining, east_asian_width

    start = text.rfind("\n", 0, column) + 1
    end = text.find("\n", column)
    line, position = text[start : end if end >= 0 else len(text)], column - start
    if len(line) > width:
        left = max(0, min(position - width // 2, len(line) - width))
        right = left + width
        head, tail = "..." if left else "", "..." if right < len(line) else ""
        line, position = head + line[left:right] + tail, position - left + len(head)
    line = "".join(c if c.isprintable() else "?" for c in line)
    cells = sum(0 if combining(c) else 2 if east_asian_width(c) in "WF" else 1 for c in line[:position])
    return f"{indent}{line}\n{indent}{' ' * cells}^"


def _find_word(text: str, word: str) -> int | None:
    """Where `word`, a name or a short piece of text, first stands by itself in `text`, blanks aside."""
    pieces = re.findall(r"\w+|\S", word)
    pattern = r"\s*".join(map(re.escape, pieces))
    found = re.search(rf"(?<!\w){pattern}(?!\w)", text)
    return found.start() if found else None


def _rebuild(kind: type[ModelError], message: str, state: dict[str, Any]) -> ModelError:
    error = kind(message)
    error.__dict__.update(state)
    return error


class ExpectationWarning(UserWarning):
    """An expectation is less accurate than it should be: where, and its relative error."""

    def __init__(self, message: str, where: str = "", error: float = 0.0) -> None:
        super().__init__(message)
        self.where, self.error = where, error
