"""A command line made of functions: what is written arrives as annotated, and what is not understood is named."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pytest

from cadet_sym.commands import Argument, Commands, Option, UsageError


@pytest.fixture
def program():
    """The commands and the arguments that the last one was called with."""
    commands, called = Commands("prog", "Does things.", {"--loud": "Say more."}), {}

    @commands.command
    def run(
        model: Annotated[Path, Argument("MODEL", "The file.")],
        settings: Annotated[list[str] | None, Option("Values.", names="--set", metavar="NAME=VALUE")] = None,
        at: Annotated[float | None, Option("When.", metavar="T")] = None,
        points: Annotated[int, Option("How many.", metavar="N", least=2)] = 5,
        time_limit: Annotated[float | None, Option("How long.", metavar="S")] = None,
        quick: Annotated[bool, Option("Hurry.")] = False,
        control: Annotated[bool | None, Option("Which.", names="--control/--plain")] = None,
    ) -> None:
        """Run it.

        More.
        """
        called.update(model=model, settings=settings, at=at, points=points, time_limit=time_limit, quick=quick, control=control)

    @commands.command
    def write(
        to: Annotated[Path, Option("Where to.", metavar="FOLDER")],
        over: Annotated[list[str], Option("What over.")],
    ) -> None:
        """Write it."""
        called.update(to=to, over=over)

    return commands, called


def test_what_is_written_arrives(program):
    commands, called = program
    words = ["--set", "a=1", "m.toml", "--set=b=-2", "--at", "-1e-3", "--points=7", "--plain", "--quick"]
    assert commands.run(["run", *words]) == 0
    assert called == {
        "model": Path("m.toml"),
        "settings": ["a=1", "b=-2"],
        "at": -1e-3,
        "points": 7,
        "time_limit": None,
        "quick": True,
        "control": False,
    }
    commands.run(["run", "--time-limit", "3", "--control", "--", "--at"])
    assert (called["model"], called["time_limit"], called["control"], called["points"]) == (Path("--at"), 3.0, True, 5)
    commands.run(["write", "--over", "k=1:2", "--to", "here", "--over", "c=-1:2"])
    assert (called["to"], called["over"]) == (Path("here"), ["k=1:2", "c=-1:2"])


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["runs"], ["`runs`", "run"]),
        (["--lout"], ["--lout", "--loud"]),
        (["run"], ["MODEL is missing"]),
        (["run", "a", "b"], ["`b`"]),
        (["run", "a", "--ponts", "3"], ["--ponts", "--points"]),
        (["run", "a", "-p"], ["-p"]),
        (["run", "a", "--points", "1"], ["--points 1", "2 or more"]),
        (["run", "a", "--points", "1.5"], ["--points 1.5", "a whole number"]),
        (["run", "a", "--at", "noon"], ["--at noon", "a number"]),
        (["run", "a", "--at"], ["--at needs a value"]),
        (["run", "a", "--at", "--quick"], ["--at needs a value"]),
        (["run", "a", "--quick=yes"], ["--quick takes no value"]),
        (["write", "--over", "k"], ["--to FOLDER is missing"]),
    ],
)
def test_what_is_not_understood_is_named(program, words, named):
    commands, called = program
    with pytest.raises(UsageError) as caught:
        commands.run(words)
    assert all(each in str(caught.value) for each in named)
    assert not called


def test_help_says_all_that_may_be_written(program, capsys):
    commands, called = program
    assert commands.run(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(each in text for each in ("prog", "Does things.", "run", "Run it.", "write", "--loud", "--help"))
    assert commands.run([]) == 2
    assert capsys.readouterr().out == text
    assert commands.run(["run", "--help"]) == 0
    text = capsys.readouterr().out
    for each in ("MODEL", "--set NAME=VALUE", "--points N", "At least 2", "--control/--plain", "--time-limit S", "--quick  "):
        assert each in text
    assert "More." not in text
    commands.run(["write", "--help"])
    assert "Usage: prog write --to FOLDER --over TEXT [OPTIONS]" in capsys.readouterr().out
    assert not called
