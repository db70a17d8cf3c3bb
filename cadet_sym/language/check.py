"""Whether what is declared holds together: names declared once and used where they belong, and nothing missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.ground import Ground
from cadet_sym.language.names import did_you_mean
from cadet_sym.language.needs import find_circle, parameter_values
from cadet_sym.language.places import Places
from cadet_sym.language.roughness import check_noise
from cadet_sym.language.scope import Scope
from cadet_sym.language.vocabulary import ElementCall, der, symbol

if TYPE_CHECKING:
    from cadet_sym.language.model import Model


def structure(model: Model) -> None:
    """Names declared once and used where they belong; every part that another needs is there."""
    places = model_places(model)
    _wholeness(model)
    parameters(model)
    vehicle = model.vehicle
    for name, element in vehicle.elements.items():
        scope = places.element(tuple(a.name for a in element.arguments))
        _within(scope, element.value, table=f"elements.{name}", key="value")
    no_recursion({name: _calls(e.value) for name, e in vehicle.elements.items()})
    for state, rate in vehicle.rates.items():
        _within(places.rate(), rate, table="rates", key=state.name)
    for name, output in vehicle.outputs.items():
        _within(places.output(name), output, table="outputs", key=name)
    for contact, where in vehicle.contacts.items():
        _within(places.number("a setback"), where.setback, table="contacts", key=contact.name)
    if model.travel is not None:
        for key in ("speed", "distance"):
            # what was made of a table holds no names
            if (expr := getattr(model.travel, key)) is not None and model.travel.table is None:
                _within(places.travel(), expr, table="travel", key=key)
        _within(places.number("the start"), model.travel.start, table="travel", key="start")
    if model.noise is not None:
        for entry in set(model.noise.intensity):
            _within(places.intensity(), entry, table="noise", key="intensity")
    if model.ground is not None:
        ground_names(model.ground, places)
        _coherent_tracks(model.ground, [where.track for where in vehicle.contacts.values()])
    _initial(model, places)
    check_noise(model)
    _within(places.number("the duration"), model.run.duration, table="run", key="duration")


def _coherent_tracks(ground: Ground, tracks: Sequence[str]) -> None:
    """Coherence is that of tracks on which there are wheels."""
    for name in ground.coherence.tracks if ground.coherence else ():
        if name not in tracks:
            raise ModelError(
                f"no contact is on track `{name}`{did_you_mean(name, sorted(set(tracks)))}",
                table="ground.coherence",
                key="tracks",
            )


def model_places(model: Model) -> Places:
    """The declared names of a model and what may stand where."""
    vehicle = model.vehicle
    return Places.declared(
        parameter=model.parameters,
        state=[s.name for s in vehicle.rates],
        contact=[c.name for c in vehicle.contacts],
        element=vehicle.elements,
        output=vehicle.outputs,
        noise=model.noise.names if model.noise else (),
        elements={name: len(e.arguments) for name, e in vehicle.elements.items()},
        travels=model.travel is not None,
    )


def _within(scope: Scope, expr: sp.Basic, **where: str) -> None:
    try:
        scope.check(expr)
    except ModelError as error:
        raise error.placed(**where) from None


def _wholeness(model: Model) -> None:
    vehicle, ground, travel = model.vehicle, model.ground, model.travel
    if vehicle.contacts and ground is None:
        contact = next(iter(vehicle.contacts))
        raise ModelError(
            f"the contact `{contact}` touches no ground: declare [ground]", table="contacts", key=str(contact)
        )
    if ground is not None and not vehicle.contacts:
        raise ModelError(
            "no contact touches this ground: declare one in [contacts], or leave [ground] out", table="ground"
        )
    if ground is not None and travel is None:
        raise ModelError("a ground needs a [travel]: declare its speed, as speed = 20.0", table="ground")


def parameters(model: Model) -> None:
    """Parameters are numbers or expressions in other parameters, with no circle among them."""
    places = model_places(model)
    for name, parameter in model.parameters.items():
        _within(places.parameter(), parameter.value, table="parameters", key=name)
    parameter_values({name: p.value for name, p in model.parameters.items()})


def no_recursion(calls: Mapping[str, set[str]]) -> None:
    """Refuse an element that calls itself, directly or through others."""
    if circle := find_circle(calls):
        raise ModelError(
            f"elements may not call themselves: {' -> '.join(f'`{n}`' for n in circle)}",
            table=f"elements.{circle[0]}",
            key="value",
            token=circle[1],
        )


def _calls(expr: sp.Basic) -> set[str]:
    return {call.name for call in expr.atoms(ElementCall)}


def ground_names(ground: Ground, places: Places) -> None:
    """The ground's own equations use its own states and noises, parameters and s."""
    settings = ground.settings
    rates, noise = settings.get("rates", {}), settings.get("noise")
    own = places.ground([s.name for s in rates], noise.names if noise else ())
    for state, rate in rates.items():
        _within(own.ground_rate(), rate, table="ground.rates", key=state.name)
    if rates:
        _within(own.ground_height(), settings["height"], table="ground", key="height")
    for entry in noise.intensity if noise else ():
        _within(own.ground_number(), entry, table="ground.noise", key="")
    numbers = {key: value for key, value in settings.items() if isinstance(value, sp.Basic) and key != "height"}
    patch = ground.patch[0] if ground.patch else None
    more = {"rolling_contact": ground.rolling, "profile": ground.profile, "contact_patch": patch}
    for key, value in {**numbers, **more}.items():
        if value is not None:
            _within(own.ground_number(), value, table="ground", key=key)


def _initial(model: Model, places: Places) -> None:
    states = set(model.vehicle.rates)
    for state, value in model.initial.values.items():
        if state not in states:
            raise ModelError(places.not_a_state(state.name), table="initial", key=state.name)
        _within(places.initial(), value, table="initial", key=state.name)
        linear_in_contacts(value, places, state.name)
    for pair, value in model.initial.covariance.items():
        where = {"table": "initial.covariance", "key": ",".join(s.name for s in pair)}
        for state in pair:
            if state not in states:
                raise ModelError(places.not_a_state(state.name), **where)
        _within(places.number("a covariance"), value, **where)


def linear_in_contacts(value: sp.Expr, places: Places, state: str) -> None:
    """An initial value is linear in the contacts and their derivatives."""
    contacts = {symbol(name) for name in places.of_kind("contact")}
    stand_in = {call: sp.Dummy(real=True) for call in value.atoms(der)}
    plain = value.xreplace(stand_in)
    variables = [*stand_in.values(), *sorted(contacts & plain.free_symbols, key=str)]
    for variable in variables:
        if sp.diff(plain, variable).free_symbols & set(variables):
            raise ModelError(
                "an initial value is linear in the contacts and their derivatives, as `-h`",
                table="initial",
                key=state,
            )
