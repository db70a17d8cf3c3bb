"""The model: a vehicle on its ground, travelling, from its initial state, for the length of a run."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping
from dataclasses import KW_ONLY, InitVar, dataclass, field, fields, is_dataclass
from functools import cached_property
from typing import Any, Literal

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language import check, sense
from cadet_sym.language.canonical import canonical
from cadet_sym.language.element import declared_name, set_field
from cadet_sym.language.frozen import FrozenDict
from cadet_sym.language.ground import Ground
from cadet_sym.language.names import did_you_mean
from cadet_sym.language.needs import parameter_values
from cadet_sym.language.noise import Noise
from cadet_sym.language.parser import parse
from cadet_sym.language.travel import Travel
from cadet_sym.language.vehicle import Vehicle, entries
from cadet_sym.language.vocabulary import symbol

__all__ = ["Initial", "Model", "Noise", "Parameter", "Run"]


@dataclass(frozen=True)
class Parameter:
    """A named number: value (a number, or an expression in other parameters), unit, and a word about it."""

    value: sp.Expr
    unit: str = field(default="", compare=False)
    text: str = field(default="", compare=False)

    def __post_init__(self):
        set_field(self, "value", canonical(self.value))


@dataclass(frozen=True)
class Initial:
    """State at t = 0.

    Parameters
    ----------
    ground : "stationary", or "smooth": flat behind the start, so that every filter starts at rest.
    values : state -> expression in parameters, linear in contacts and their derivatives; a state not listed is 0.
    covariance : (state, state) -> what is added to the covariance that the values imply; each pair once.
    whole : start the whole system in its stationary state at the initial speed; excludes the others.
    """

    ground: Literal["stationary", "smooth"] = "stationary"
    values: Mapping[Any, Any] = field(default_factory=FrozenDict)
    covariance: Mapping[Any, Any] = field(default_factory=FrozenDict)
    whole: bool = False

    def __post_init__(self):
        if self.ground not in ("stationary", "smooth"):
            raise ModelError(
                f'`ground` is "stationary" or "smooth", not {self.ground!r}', table="initial", key="ground"
            )
        values = {}
        for key, value in entries(self.values, "initial values"):
            name = key.name if isinstance(key, sp.Symbol) else str(key)
            try:
                values[symbol(name)] = canonical(value)
            except ModelError as error:
                raise error.placed(table="initial", key=name) from None
        set_field(self, "values", FrozenDict(values))
        set_field(self, "covariance", FrozenDict(_pairs(self.covariance)))
        if self.whole and (self.values or self.covariance or self.ground == "smooth"):
            raise ModelError(
                '`whole = "stationary"` sets every state: leave the other initial values out',
                table="initial",
                key="whole",
            )


def _pairs(table: Any) -> dict[tuple[sp.Symbol, sp.Symbol], sp.Expr]:
    pairs: dict[tuple[sp.Symbol, sp.Symbol], sp.Expr] = {}
    for key, value in entries(table, "initial covariance"):
        where = {"table": "initial.covariance", "key": str(key)}
        names: Any = key.split(",") if isinstance(key, str) else key
        if not isinstance(names, list | tuple) or len(names) != 2:
            raise ModelError('a covariance is named by two states, as "x,v"', **where)
        a, b = (symbol(n.name if isinstance(n, sp.Symbol) else str(n).strip()) for n in names)
        where["key"] = f"{a},{b}"
        if (a, b) in pairs or (b, a) in pairs:
            raise ModelError(f"the covariance of `{a}` and `{b}` is given twice", **where)
        try:
            first, second = sorted((a, b), key=lambda s: s.name)
            pairs[first, second] = canonical(value)
        except ModelError as error:
            raise error.placed(**where) from None
    return pairs


_TEN = sp.Integer(10)


@dataclass(frozen=True)
class Run:
    """Length of the run, number of output times (both ends included), relative tolerance."""

    duration: sp.Expr = _TEN
    points: int = 101
    rtol: float = 1e-8

    def __post_init__(self):
        try:
            set_field(self, "duration", canonical(self.duration))
        except ModelError as error:
            raise error.placed(table="run", key="duration") from None
        if isinstance(self.points, bool) or not isinstance(self.points, int) or not 2 <= self.points <= 10_000_000:
            raise ModelError(
                f"a whole number of output times, 2 or more, is wanted, not {self.points!r}",
                table="run",
                key="points",
            )
        if isinstance(self.rtol, bool) or not isinstance(self.rtol, float | int) or not 0 < self.rtol < 1:
            raise ModelError(f"a tolerance between 0 and 1 is wanted, not {self.rtol!r}", table="run", key="rtol")
        set_field(self, "rtol", float(self.rtol))


@dataclass(frozen=True)
class Model:
    """All that is declared. Two models are equal if they compute the same: names, units and texts do not count.

    Parameters
    ----------
    vehicle, ground, travel : what moves, on what, and how. A system x' = f(x, t) + B w has neither ground nor travel.
    parameters : name (or symbol) -> number, expression in other parameters, or `Parameter`.
    noise : white noise in time: `Noise`, or a mapping of noise to intensity.
    initial : state at t = 0: `Initial`, or a mapping of state to value.
    run : length of the run; or `duration=`, `points=`, `rtol=`.

    Raises
    ------
    ModelError : what is declared does not hold together; the message names table, key, what was found, what to do.
    """

    vehicle: Vehicle
    ground: Ground | None = None
    travel: Travel | None = None
    _: KW_ONLY
    parameters: Mapping[Any, Any] = field(default_factory=FrozenDict)
    noise: Any = None
    initial: Any = field(default_factory=Initial)
    run: Run = field(default_factory=Run)
    name: str = field(default="", compare=False)
    text: str = field(default="", compare=False)
    duration: InitVar[Any] = None
    points: InitVar[Any] = None
    rtol: InitVar[Any] = None

    def __post_init__(self, duration: Any, points: Any, rtol: Any):
        given = {"duration": duration, "points": points, "rtol": rtol}
        given = {key: value for key, value in given.items() if value is not None}
        if given:
            own = {f.name: getattr(self.run, f.name) for f in fields(self.run)}
            set_field(self, "run", Run(**{**own, **given}))
        set_field(self, "parameters", FrozenDict(_parameters(self.parameters)))
        if self.noise is not None and not isinstance(self.noise, Noise):
            set_field(self, "noise", Noise.independent(dict(entries(self.noise, "noise"))))
        if not isinstance(self.initial, Initial):
            set_field(self, "initial", Initial(values=dict(entries(self.initial, "initial"))))
        check.structure(self)
        sense.values(self)

    @cached_property
    def _values(self) -> dict[str, float]:
        return parameter_values({name: p.value for name, p in self.parameters.items()})

    def parameter_values(self) -> dict[str, float]:
        """Every parameter as a number, expressions in other parameters worked out."""
        return dict(self._values)

    def number(self, expr: sp.Expr) -> float:
        """Value of an expression in parameters."""
        from cadet_sym.language.numeric import evaluate

        return evaluate(expr, {symbol(name): value for name, value in self._values.items()})

    def with_parameters(self, values: Mapping[Any, Any]) -> Model:
        """The same model with other values of some parameters.

        Parameters
        ----------
        values : name (or symbol) -> number, or expression in other parameters (text is parsed).

        Raises
        ------
        ModelError : an unknown name, or a value with which the model does not hold.
        """
        changed = dict(self.parameters)
        for key, value in values.items():
            name = key.name if isinstance(key, sp.Symbol) else str(key)
            if name not in changed:
                raise ModelError(
                    f"there is no parameter `{name}`{did_you_mean(name, changed)}",
                    table="parameters",
                    key=name,
                )
            try:
                expr = parse(value) if isinstance(value, str) else canonical(value)
            except ModelError as error:
                raise error.placed(table="parameters", key=name) from None
            changed[name] = Parameter(expr, changed[name].unit, changed[name].text)
        made = copy.copy(self)
        for known in ("_values", "_contents", "hash"):
            made.__dict__.pop(known, None)
        set_field(made, "parameters", FrozenDict(changed))
        check.parameters(made)
        sense.values(made)
        return made

    @cached_property
    def hash(self) -> str:
        """Digest of what the model computes; the same for equal models, in every process."""
        return hashlib.sha256(_content(self).encode()).hexdigest()

    def content(self, *, numbers: bool) -> str:
        """Text of all that its equations follow from, in the order declared; with the parameters' numbers or without."""
        if numbers not in self._contents:
            values = {name: p.value for name, p in self.parameters.items() if numbers or p.value.free_symbols}
            parts = (self.vehicle, self.ground, self.travel, self.noise, self.initial)
            own = (tuple(self.parameters), values, self.run if numbers else None)
            self._contents[numbers] = "\n".join(_content(part, ordered=True) for part in (*parts, *own))
        return self._contents[numbers]

    @cached_property
    def _contents(self) -> dict[bool, str]:
        return {}

    def to_toml(self) -> str:
        """The model as the text of a model file; loading it gives an equal model."""
        from cadet_sym.language.modeltext import to_toml

        return to_toml(self)


def _parameters(table: Any) -> dict[str, Parameter]:
    declared: dict[str, Parameter] = {}
    for key, value in entries(table, "parameters"):
        name = declared_name(key, "parameter", table="parameters")
        if name in declared:
            raise ModelError("this parameter is declared twice", table="parameters", key=name)
        try:
            declared[name] = value if isinstance(value, Parameter) else Parameter(value)
        except ModelError as error:
            raise error.placed(table="parameters", key=name) from None
    return declared


def _content(value: Any, *, ordered: bool = False) -> str:
    """Text of everything that counts in a comparison; entries of mappings in their order, or in the alphabet's."""
    if is_dataclass(value):
        parts = ((f.name, getattr(value, f.name)) for f in fields(value) if f.compare)
        inner = ",".join(f"{name}={_content(part, ordered=ordered)}" for name, part in parts)
        return f"{type(value).__name__}({inner})"
    if isinstance(value, Mapping):
        entries = [f"{_content(k, ordered=ordered)}:{_content(v, ordered=ordered)}" for k, v in value.items()]
        return "{" + ",".join(entries if ordered else sorted(entries)) + "}"
    if isinstance(value, tuple):
        return "(" + ",".join(_content(part, ordered=ordered) for part in value) + ")"
    return sp.srepr(value) if isinstance(value, sp.Basic) else repr(value)
