"""A command line made of functions: a function is a command, its annotated parameters are what is written behind it.

    Model = Annotated[Path, Argument("MODEL", "The model file.")]
    Points = Annotated[int | None, Option("Output times.", metavar="N", least=2)]

A type is `str`, `int`, `float` or `Path`; `list[str]` for an option that may be repeated; `bool` for one without a value,
or for two of which one says yes and the other no ("--control/--plain"). Libraries that do the same take a tenth of a
second to import.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from cadet_sym.errors import CadetError

__all__ = ["Argument", "Commands", "Option", "UsageError"]


class UsageError(CadetError):
    """What is written on the command line is not understood."""

    exit_status = 2


@dataclass(frozen=True)
class Argument:
    """What is written without an option before it."""

    metavar: str
    help: str


@dataclass(frozen=True)
class Option:
    """An option, named as the parameter is unless it says otherwise."""

    help: str
    names: str = ""  # "--name", or "--yes/--no"
    metavar: str = ""  # of its value
    least: float | None = None


@dataclass(frozen=True)
class _Place:
    """A parameter of a command."""

    name: str
    kind: type  # of one value
    repeated: bool
    required: bool
    what: Argument | Option

    @property
    def flag(self) -> bool:
        return self.kind is bool

    @property
    def options(self) -> tuple[str, ...]:
        """As they are written; of a flag the second says no."""
        if isinstance(self.what, Argument):
            return ()
        return tuple((self.what.names or f"--{self.name.replace('_', '-')}").split("/"))

    @property
    def shown(self) -> str:
        """As the help shows it."""
        if isinstance(self.what, Argument):
            return self.what.metavar
        return " ".join(filter(None, ["/".join(self.options), "" if self.flag else self.what.metavar or "TEXT"]))

    def value(self, text: str) -> Any:
        """What is meant by a text."""
        try:
            found = self.kind(text)
        except ValueError:
            wanted = {int: "a whole number", float: "a number"}.get(self.kind, self.kind.__name__)
            raise UsageError(f"{self.options[0]} {text}: expected {wanted}") from None
        least = getattr(self.what, "least", None)
        if least is not None and found < least:
            raise UsageError(f"{self.options[0]} {text}: expected {least} or more")
        return found


class Commands:
    """The commands of a program.

    Parameters
    ----------
    program : its name.
    text : what it does.
    common : options that the program understands by itself, whatever the command, and what they do.
    """

    def __init__(self, program: str, text: str, common: Mapping[str, str]) -> None:
        self._program, self._text, self._common = program, text, common
        self._commands: dict[str, Callable[..., None]] = {}

    def command(self, function: Callable[..., None]) -> Callable[..., None]:
        """Make a function a command of its name."""
        self._commands[function.__name__] = function
        return function

    def run(self, words: Sequence[str]) -> int:
        """Call the function that the words name with what else they say; returns 0, or 2 where they say nothing.

        Raises
        ------
        UsageError
            If the words are not understood.
        """
        if not words or words[0] == "--help":
            print(self._help())
            return 0 if words else 2
        name, rest = words[0], words[1:]
        function = self._commands.get(name)
        if function is None:
            if name.startswith("-"):
                raise UsageError(f"there is no option {name}{_close(name, self._common)}")
            raise UsageError(f"there is no command `{name}`{_close(name, self._commands)}")
        places = _places(function)
        if "--help" in rest:
            print(self._help_of(function, places))
            return 0
        function(**_parsed(places, rest))
        return 0

    def _help(self) -> str:
        commands = {name: _first_line(each) for name, each in self._commands.items()}
        parts = [f"Usage: {self._program} [OPTIONS] COMMAND ...", self._text, "Commands:", *_table(commands)]
        common = {**self._common, "--help": "Show this, or what may be written behind a command."}
        return "\n".join([parts[0], "", parts[1], "", *parts[2:], "", "Options:", *_table(common)])

    def _help_of(self, function: Callable[..., None], places: Sequence[_Place]) -> str:
        arguments = [each for each in places if isinstance(each.what, Argument)]
        needed = [each.shown for each in places if each.required and each.options]
        words = [self._program, function.__name__, *(each.shown for each in arguments), *needed, "[OPTIONS]"]
        lines = [f"Usage: {' '.join(words)}", "", _first_line(function), ""]
        lines += _table({each.shown: each.what.help for each in arguments})
        options = {each.shown: f"{each.what.help}{_bound(each)}" for each in places if each.options}
        return "\n".join([*lines, "", "Options:", *_table(options | {"--help": "Show this."})])


def _places(function: Callable[..., None]) -> list[_Place]:
    """The parameters of a command, by its annotations."""
    hints, found = get_type_hints(function, include_extras=True), []
    for name, parameter in signature(function).parameters.items():
        assert get_origin(hints[name]) is Annotated, f"{function.__name__}: {name} does not say what it is"
        kind, what = get_args(hints[name])
        if get_origin(kind) in (Union, types.UnionType):  # or nothing
            kind = next(each for each in get_args(kind) if each is not type(None))
        repeated = get_origin(kind) is list
        kind = get_args(kind)[0] if repeated else kind
        assert kind in (bool, int, float, str, Path), f"{function.__name__}: {name} is {kind}"
        found.append(_Place(name, kind, repeated, parameter.default is Parameter.empty, what))
    return found


def _parsed(places: Sequence[_Place], words: Sequence[str]) -> dict[str, Any]:
    """Values by the names of the parameters, as the words say."""
    by_option = {option: place for place in places for option in place.options}
    waiting = [place for place in places if not place.options]
    given: dict[str, Any] = {}
    rest, bare = list(words), False
    while rest:
        word = rest.pop(0)
        if word == "--" and not bare:
            bare = True
        elif bare or not word.startswith("-") or word == "-":
            if not waiting:
                raise UsageError(f"`{word}` is one word too many")
            place = waiting.pop(0)
            given[place.name] = place.value(word)
        else:
            option, equals, text = word.partition("=")
            if option not in by_option:
                raise UsageError(f"there is no option {option}{_close(option, by_option)}")
            place = by_option[option]
            if place.flag:
                if equals:
                    raise UsageError(f"{option} takes no value")
                given[place.name] = option == place.options[0]
                continue
            if not equals:
                if not rest or rest[0].partition("=")[0] in by_option:
                    raise UsageError(f"{option} needs a value behind it")
                text = rest.pop(0)
            value = place.value(text)
            given[place.name] = [*given.get(place.name, ()), value] if place.repeated else value
    for place in places:
        if place.required and place.name not in given:
            raise UsageError(f"{place.shown} is missing: {place.what.help[0].lower()}{place.what.help[1:].rstrip('.')}")
    return given


def _close(word: str, known: Mapping[str, Any]) -> str:
    """What may have been meant."""
    from difflib import get_close_matches

    found = get_close_matches(word, known, n=1)
    return f"; did you mean {found[0]}?" if found else ""


def _bound(place: _Place) -> str:
    least = getattr(place.what, "least", None)
    return "" if least is None else f" At least {least}."


def _first_line(function: Callable[..., None]) -> str:
    return (function.__doc__ or "").strip().split("\n")[0]


def _table(rows: Mapping[str, str]) -> list[str]:
    """Two columns, the second wrapped."""
    from shutil import get_terminal_size
    from textwrap import wrap

    first = max(map(len, rows), default=0) + 4
    width = max(get_terminal_size().columns - first, 30)
    lines = []
    for name, text in rows.items():
        head, *more = wrap(text, width) or [""]
        lines += [f"  {name:{first - 2}}{head}", *(" " * first + line for line in more)]
    return lines
