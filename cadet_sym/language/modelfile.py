"""Model file to model: TOML read key by key, every key known, every expression in the scope of its place."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.bounds import current_limits
from cadet_sym.language.check import no_recursion
from cadet_sym.language.element import Element, declared_arguments, declared_name
from cadet_sym.language.entries import CURVE_KEYS, Entries, expression, noise_names, one_of, read_noise
from cadet_sym.language.groundfile import read_ground
from cadet_sym.language.library import Kind, known_kind
from cadet_sym.language.measured import INTERPOLATION, OUTSIDE, csv_rows, inline_rows, make_curve, read_text
from cadet_sym.language.model import Initial, Model, Parameter, Run
from cadet_sym.language.places import Places
from cadet_sym.language.travel import Travel
from cadet_sym.language.vehicle import Contact, Vehicle
from cadet_sym.language.vocabulary import TIME, ElementCall, symbol

TOP = (
    "schema", "name", "text", "parameters", "elements", "rates", "contacts",
    "noise", "ground", "travel", "initial", "outputs", "run",
)  # fmt: skip


_KEY_PARTS = 32
# the time that TOML's own reader takes grows with the square of a key's parts
_LONG_KEY = re.compile(rf"(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{_KEY_PARTS}}}")


def load(path: str | os.PathLike[str]) -> Model:
    """Read a model file.

    Parameters
    ----------
    path : of a TOML file in the form of the documentation's chapter on the model file.

    Raises
    ------
    ModelError : naming file, table, key, with the offending text and a caret under the column where there is one.
    """
    path = Path(path)
    shown = str(path)
    try:
        if not path.is_file():
            what = "is a folder" if path.is_dir() else "is not a file" if path.exists() else "does not exist"
            raise ModelError(f"this {what}; the path of a model file is wanted")
        text = read_text(path, "the file", current_limits().bytes)
    except ModelError as error:
        raise error.placed(file=shown) from None
    return loads(text, folder=path.parent, file=shown)


def loads(text: str, *, folder: str | os.PathLike[str] | None = None, file: str = "") -> Model:
    """Read a model from the text of a model file; `folder` is where its tables lie.

    Raises
    ------
    ModelError : as `load`.
    """
    document: dict[str, Any] = {}
    try:
        document.update(_toml(text))
        return _Document(document, Path(folder) if folder is not None else None).model()
    except ModelError as error:
        written = _written(document, error.table, error.key)
        where = {"text": written} if isinstance(written, str) else {}
        raise error.placed(file=file, **where) from None


def _toml(text: str) -> dict[str, Any]:
    if long := _LONG_KEY.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise ModelError(f"line {line} has a key of more than {_KEY_PARTS} parts; a model file needs three")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        found = re.search(r"\(at line (\d+), column (\d+)\)", message)
        reason = re.sub(r"\s*\(at .*\)$", "", message)
        if found is None:
            raise ModelError(f"this is not TOML: {reason}") from None
        line, column = int(found.group(1)), int(found.group(2))
        lines = text.replace("\r\n", "\n").split("\n")
        written = lines[line - 1] if line <= len(lines) else ""
        raise ModelError(f"line {line} is not TOML: {reason}", text=written or " ", column=column - 1) from None
    except (RecursionError, ValueError, OverflowError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise ModelError(f"this is not a model file: {reason}") from None


def _written(document: Mapping[str, Any], table: str, key: str) -> Any:
    """What stands in the file under a table and key."""
    found: Any = document
    for part in [*table.split("."), *(key.split(".") if "." in key and "," not in key else [key])]:
        if not part:
            continue
        if not isinstance(found, Mapping) or part not in found:
            return None
        found = found[part]
    return found.get("value") if isinstance(found, Mapping) else found


class _Document:
    """One model file on its way to a model."""

    def __init__(self, content: dict[str, Any], folder: Path | None):
        self.top = Entries("", content)
        self.folder = folder

    def table(self, name: str) -> Entries:
        return Entries(name, self.top.content.get(name, {}))

    def has(self, name: str) -> bool:
        return name in self.top.content

    def model(self) -> Model:
        self._schema()
        self.top.only(TOP)
        self.places = self._places()
        parameters = self._parameters()
        vehicle = self._vehicle()
        return Model(
            vehicle,
            read_ground(self.table("ground"), self.places, self.curve) if self.has("ground") else None,
            self._travel() if self.has("travel") else None,
            parameters=parameters,
            noise=read_noise(self.table("noise"), self.places.intensity()) if self.has("noise") else None,
            initial=self._initial(),
            run=self._run(),
            name=self.top.get("name", str, ""),
            text=self.top.get("text", str, ""),
        )

    def _schema(self) -> None:
        if "schema" not in self.top.content:
            raise ModelError("`schema` is missing: write schema = 1 on the first line", key="schema")
        schema = self.top.content["schema"]
        if isinstance(schema, bool) or schema != 1:
            raise ModelError(f"this version reads schema = 1, not {schema!r}", key="schema")

    def _places(self) -> Places:
        """Declared names, before any expression is read."""
        names: dict[str, list[str]] = {}
        tables = [
            ("parameter", "parameters"),
            ("state", "rates"),
            ("contact", "contacts"),
            ("element", "elements"),
        ]
        for kind, name in [*tables, ("output", "outputs")]:
            content = self.table(name).content
            names[kind] = [declared_name(key, kind, table=name, key=key) for key in content]
        if not self.has("rates") or not names["state"]:
            raise ModelError('a system has at least one state: declare its rate, as x = "v"', table="rates")
        names["noise"] = [
            declared_name(key, "noise", table="noise", key=key) for key in noise_names(self.table("noise"))
        ]
        elements = {}
        for name in names["element"]:
            elements[name] = self._argument_count(name)
        return Places.declared(**names, elements=elements, travels=self.has("travel"))

    def _argument_count(self, name: str) -> int:
        if (kind := self._kind(name)) is not None:
            return len(kind.arguments)
        return len(declared_arguments(name, self._element_entries(name).names("arguments")))

    def _parameters(self) -> dict[str, Parameter]:
        table, scope = self.table("parameters"), self.places.parameter()
        parameters = {}
        for name, content in table.content.items():
            if not isinstance(content, Mapping):
                parameters[name] = Parameter(table.expression(name, scope))
                continue
            entries = Entries(f"parameters.{name}", content).only(["value", "unit", "text"])
            if "value" not in content:
                raise ModelError("`value` is missing", table="parameters", key=name)
            value = expression(content["value"], scope, table="parameters", key=name)
            parameters[name] = Parameter(value, entries.get("unit", str, ""), entries.get("text", str, ""))
        return parameters

    def _vehicle(self) -> Vehicle:
        elements = {name: self._element(name) for name in self.table("elements").content}
        no_recursion({n: {c.name for c in e.value.atoms(ElementCall)} for n, e in elements.items()})
        rates = {}
        for name in self.table("rates").content:
            rates[symbol(name)] = self.table("rates").expression(name, self.places.rate())
        contacts = {symbol(name): self._contact(name) for name in self.table("contacts").content}
        outputs = {
            name: self.table("outputs").expression(name, self.places.output(name))
            for name in self.table("outputs").content
        }
        return Vehicle(rates, contacts, outputs, elements)

    def _contact(self, name: str) -> Contact:
        entries = Entries(f"contacts.{name}", self.table("contacts").content[name]).only(["setback", "track"])
        setback = expression(
            entries.content.get("setback", 0),
            self.places.number("a setback"),
            table="contacts",
            key=f"{name}.setback",
        )
        return Contact(setback, entries.get("track", str, "main"))

    def _kind(self, name: str) -> Kind | None:
        """The kind in the library that an element is declared by."""
        entries = Entries(f"elements.{name}", self.table("elements").content[name])
        if "library" not in entries.content:
            return None
        try:
            return known_kind(entries.get("library", str))
        except ModelError as error:
            raise error.placed(table=entries.name) from None

    def _element_of(self, kind: Kind, name: str) -> Element:
        """An element of the library: its coefficients are keys beside `library`."""
        entries = Entries(f"elements.{name}", self.table("elements").content[name])
        entries.only(["library", *kind.coefficients, "text"])
        scope = self.places.element(())
        given = {key: entries.expression(key, scope) for key in entries.content if key in kind.coefficients}
        try:
            element = kind(name=name, **given)
        except ModelError as error:
            raise error.placed(table=entries.name) from None
        return replace(element, text=entries.get("text", str, element.text))

    def _element_entries(self, name: str) -> Entries:
        entries = Entries(f"elements.{name}", self.table("elements").content[name])
        return entries.only(["arguments", "value", "text", "table", "outside", "interpolation", "columns", "units"])

    def _element(self, name: str) -> Element:
        if (kind := self._kind(name)) is not None:
            return self._element_of(kind, name)
        entries = self._element_entries(name)
        arguments, text = entries.names("arguments"), entries.get("text", str, "")
        if ("value" in entries.content) == ("table" in entries.content):
            what = "both" if "value" in entries.content else "neither"
            raise ModelError(
                f"an element is declared by a `value`, a `table` or a kind in the `library`; {what} of the first two given",
                table=entries.name,
            )
        if "value" in entries.content:
            return Element(name, arguments, entries.expression("value", self.places.element(arguments)), text)
        if len(arguments) != 1:
            raise ModelError(
                f"a measured element has one argument, {len(arguments)} given",
                table=entries.name,
                key="arguments",
            )
        curve = self.curve(entries, symbol(arguments[0]), ("", ""), "extrapolate", "linear")
        return Element(name, arguments, curve, text)

    def curve(
        self, entries: Entries, argument: sp.Expr, kinds: tuple[str, str], outside: str, interpolation: str
    ) -> sp.Expr:
        """A measured curve: `table` with its `outside`, `interpolation`, `columns`, `units`."""
        where = {"table": entries.name, "key": "table"}
        outside = one_of(entries, "outside", OUTSIDE, "") if "outside" in entries.content else outside
        interpolation = one_of(entries, "interpolation", INTERPOLATION, interpolation)
        table = entries.get("table", (str, list))
        columns, units = (entries.names(key) if key in entries.content else [] for key in ("columns", "units"))
        for key, given in (("columns", columns), ("units", units)):
            if key in entries.content and len(given) != 2:
                raise ModelError(f"two are wanted, one a column, {len(given)} given", table=entries.name, key=key)
        try:
            if isinstance(table, list):
                if columns:
                    raise ModelError("rows that stand here have two columns: leave `columns` out")
                scope = self.places.number("a table")
                rows = inline_rows(table, lambda value: expression(value, scope), units, kinds)
            elif self.folder is None:
                raise ModelError("a model without a file has no folder to look for a table in; write its rows here")
            else:
                rows = csv_rows(self.folder, table, columns=columns, units=units, kinds=kinds)
            return make_curve(argument, rows, outside, interpolation)
        except ModelError as error:
            raise error.placed(**where) from None

    def _travel(self) -> Travel:
        entries = self.table("travel").only(["speed", "distance", "start"])
        if ("speed" in entries.content) == ("distance" in entries.content):
            what = "both" if "speed" in entries.content else "neither"
            raise ModelError(f"either `speed` or `distance` is wanted, {what} given", table="travel")
        start: Any = entries.expression("start", self.places.number("the start")) if "start" in entries.content else 0
        if "distance" in entries.content:
            return Travel(distance=entries.expression("distance", self.places.travel()), start=start)
        if isinstance(entries.content["speed"], Mapping):
            inner = Entries("travel.speed", entries.content["speed"]).only(CURVE_KEYS)
            return Travel(speed=self.curve(inner, TIME, ("time", "speed"), "end", "monotone"), start=start)
        return Travel(speed=entries.expression("speed", self.places.travel()), start=start)

    def _initial(self) -> Initial:
        table = self.table("initial")
        content = dict(table.content)
        ground = table.get("ground", str, "stationary")
        covariance = Entries("initial.covariance", content.get("covariance", {}))
        whole = table.get("whole", str, "")
        if whole not in ("", "stationary"):
            raise ModelError(f'`whole` is "stationary" or left out, not "{whole}"', table="initial", key="whole")
        others = [key for key in content if key != "whole"]
        if whole and others:
            raise ModelError(
                f'`whole = "stationary"` sets every state: leave `{others[0]}` out, or `whole`',
                table="initial",
                key="whole",
            )
        values = {}
        for name in content:
            if name in ("ground", "covariance", "whole"):
                continue
            if self.places.kinds.get(name) != "state":
                raise ModelError(self.places.not_a_state(name), table="initial", key=name)
            values[symbol(name)] = table.expression(name, self.places.initial())
        scope = self.places.number("a covariance")
        pairs = {key: covariance.expression(key, scope) for key in covariance.content}
        return Initial(ground, values, pairs, bool(whole))

    def _run(self) -> Run:
        entries = self.table("run").only(["duration", "points", "rtol"])
        own = Run()
        duration = own.duration
        if "duration" in entries.content:
            duration = entries.expression("duration", self.places.number("the duration"))
        return Run(duration, entries.get("points", int, own.points), entries.get("rtol", (float, int), own.rtol))
