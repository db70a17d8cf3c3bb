"""Model to text: the model file that gives an equal model when it is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.ground import Ground
from cadet_sym.language.names import exact
from cadet_sym.language.noise import Noise
from cadet_sym.language.printer import unparse
from cadet_sym.language.tomltext import key_text, table_text
from cadet_sym.language.vocabulary import Lookup

if TYPE_CHECKING:
    from cadet_sym.language.model import Initial, Model, Parameter

_INITIAL_KEYS = ("ground", "whole", "covariance")


def to_toml(model: Model) -> str:
    """The model as a model file; measured curves stand in it row by row."""
    vehicle = model.vehicle
    top = {"schema": 1, "name": model.name, "text": model.text}
    sections = [table_text("", {key: value for key, value in top.items() if value != ""})]
    add = sections.append
    if model.parameters:
        add(table_text("parameters", {name: _parameter(p) for name, p in model.parameters.items()}))
    for name, element in vehicle.elements.items():
        entries: dict[str, Any] = {"arguments": [a.name for a in element.arguments]}
        entries |= (
            curve_entries(element.value) if isinstance(element.value, Lookup) else {"value": entry(element.value)}
        )
        if element.text:
            entries["text"] = element.text
        add(table_text(f"elements.{key_text(name)}", entries))
    add(table_text("rates", {state.name: entry(rate) for state, rate in vehicle.rates.items()}))
    if vehicle.contacts:
        contacts = {c.name: {"setback": entry(w.setback), "track": w.track} for c, w in vehicle.contacts.items()}
        add(table_text("contacts", contacts))
    if model.noise is not None:
        add(table_text("noise", noise_entries(model.noise)))
    if model.ground is not None:
        add(table_text("ground", _ground(model.ground)))
    if model.travel is not None:
        add(table_text("travel", _travel(model)))
    sections += _initial(model.initial)
    if vehicle.outputs:
        add(table_text("outputs", {name: entry(output) for name, output in vehicle.outputs.items()}))
    run = model.run
    add(table_text("run", {"duration": entry(run.duration), "points": run.points, "rtol": run.rtol}))
    return "\n\n".join(sections) + "\n"


def entry(expr: sp.Expr) -> int | float | str:
    """An expression as a value: a number where TOML has it exactly, else text."""
    if expr.is_Integer and abs(expr) < 2**63:
        return int(expr)
    if expr.is_Rational and abs(expr) < 10**300:
        number = int(expr.p) / int(expr.q)
        if number != 0 and exact(number) == expr:
            return number
    return unparse(expr)


def curve_entries(curve: Lookup) -> dict[str, Any]:
    """A measured curve, row by row."""
    rows = [[entry(z), entry(f)] for z, f in zip(curve.knots, curve.values, strict=True)]
    outside = {} if curve.outside == "end" else {"outside": curve.outside}
    return {"table": rows, **outside, "interpolation": curve.method}


def noise_entries(noise: Noise) -> dict[str, Any]:
    """Independent noises one by one, correlated ones as a matrix."""
    if noise.is_diagonal and not {"names", "intensity"} & set(noise.names):
        return {name: entry(noise.intensity[i, i]) for i, name in enumerate(noise.names)}
    return {
        "names": list(noise.names),
        "intensity": [[entry(e) for e in row] for row in noise.intensity.tolist()],
    }


def _parameter(parameter: Parameter) -> Any:
    value = entry(parameter.value)
    if not parameter.unit and not parameter.text:
        return value
    more = {"unit": parameter.unit, "text": parameter.text}
    return {"value": value, **{key: text for key, text in more.items() if text}}


def _ground(ground: Ground) -> dict[str, Any]:
    entries: dict[str, Any] = {"kind": ground.kind}
    for key, value in ground.settings.items():
        if isinstance(value, Noise):
            entries[key] = noise_entries(value)
        elif isinstance(value, Mapping):
            entries[key] = {str(k): entry(v) for k, v in value.items()}
        elif value is not None:
            entries[key] = _nested(value)
    if ground.patch is not None:
        entries["contact_patch"] = {"length": entry(ground.patch[0]), "order": ground.patch[1]}
    if ground.rolling is not None:
        entries["rolling_contact"] = entry(ground.rolling)
    if (shared := ground.coherence) is not None:
        rational = {"numerator": shared.numerator, "denominator": shared.denominator}
        lists = {key: [entry(c) for c in part] for key, part in rational.items()}
        entries["coherence"] = {"tracks": list(shared.tracks), **lists}
    if ground.profile is not None:
        measured = isinstance(ground.profile, Lookup)
        entries["profile"] = curve_entries(ground.profile) if measured else entry(ground.profile)
    return entries


def _nested(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_nested(part) for part in value]
    return entry(value) if isinstance(value, sp.Basic) else value


def _travel(model: Model) -> dict[str, Any]:
    travel = model.travel
    assert travel is not None
    if travel.distance is not None:
        return {"distance": entry(travel.distance)}
    speed = curve_entries(travel.table) if travel.table is not None else entry(travel.speed)
    return {"speed": speed, "start": entry(travel.start)}


def _initial(initial: Initial) -> list[str]:
    if initial.whole:
        return [table_text("initial", {"whole": "stationary"})]
    for state in initial.values:
        if state.name in _INITIAL_KEYS:
            raise ModelError(
                f"the state `{state}` cannot have an initial value in a model file: that word has a meaning there",
                table="initial",
                key=state.name,
            )
    values = {state.name: entry(value) for state, value in initial.values.items()}
    sections = [table_text("initial", {"ground": initial.ground, **values})]
    if initial.covariance:
        pairs = {f"{a},{b}": entry(value) for (a, b), value in initial.covariance.items()}
        sections.append(table_text("initial.covariance", pairs))
    return sections
