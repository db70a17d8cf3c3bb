"""Whether what is declared holds together: one name space, names where they belong, values that make sense.

`structure` looks at names and shapes only, `values` at numbers: it runs again when parameters change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.ground import Ground
from cadet_sym.language.kinks import breakpoints
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.places import Places
from cadet_sym.language.scope import Scope
from cadet_sym.language.vocabulary import TIME, ElementCall, symbol

if TYPE_CHECKING:
    from cadet_sym.language.model import Model

_GRID = 2001  # times at which a speed is looked at, besides its breakpoints


# --------------------------------------------------------------------------- names and shapes


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
        linear_noise(rate, places, state.name)
    for name, output in vehicle.outputs.items():
        _within(places.output(name), output, table="outputs", key=name)
    for contact, where in vehicle.contacts.items():
        _within(places.number("a setback"), where.setback, table="contacts", key=contact.name)
    if model.travel is not None:
        for key in ("speed", "distance"):
            if (expr := getattr(model.travel, key)) is not None:
                _within(places.travel(), expr, table="travel", key=key)
        _within(places.number("the start"), model.travel.start, table="travel", key="start")
    if model.noise is not None:
        for entry in model.noise.intensity:
            _within(places.intensity(), entry, table="noise", key="intensity")
    if model.ground is not None:
        ground_names(model.ground, places)
    _initial(model, places)
    _within(places.number("the duration"), model.run.duration, table="run", key="duration")


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
        raise ModelError(f"the contact `{contact}` touches no ground: declare [ground]", table="contacts", key=str(contact))
    if ground is not None and not vehicle.contacts:
        raise ModelError("no contact touches this ground: declare one in [contacts], or leave [ground] out", table="ground")
    if ground is not None and travel is None:
        raise ModelError("a ground needs a [travel]: declare its speed, as speed = 20.0", table="ground")


def parameters(model: Model) -> None:
    """Parameters are numbers or expressions in other parameters, with no circle among them."""
    places = model_places(model)
    for name, parameter in model.parameters.items():
        _within(places.parameter(), parameter.value, table="parameters", key=name)
    parameter_values({name: p.value for name, p in model.parameters.items()})


def parameter_values(given: Mapping[str, sp.Expr]) -> dict[str, float]:
    """Numbers of the parameters, each after those it needs; ModelError for a circle or what is not a finite number."""
    values: dict[sp.Symbol, float] = {}
    for name in _sorted_by_need({n: {s.name for s in e.free_symbols} & set(given) for n, e in given.items()}):
        value = evaluate(given[name], values)
        if not math.isfinite(value):
            raise ModelError(f"the value is not a finite number ({value})", table="parameters", key=name)
        values[symbol(name)] = value
    return {name: values[symbol(name)] for name in given}


def _sorted_by_need(needs: Mapping[str, set[str]]) -> list[str]:
    done: dict[str, None] = {}
    while len(done) < len(needs):
        ready = [name for name, needed in needs.items() if name not in done and needed <= done.keys()]
        if not ready:
            circle = find_circle(needs)
            raise ModelError(
                f"the parameters {' -> '.join(f'`{n}`' for n in circle)} need each other in a circle",
                table="parameters",
                key=circle[0],
            )
        done.update(dict.fromkeys(ready))
    return list(done)


def find_circle(needs: Mapping[str, Iterable[str]]) -> list[str]:
    """Names along one circle of a relation, the first again at the end; empty if there is none."""
    finished: set[str] = set()
    for start in needs:
        path: list[str] = []
        pending: list[Any] = [iter([start])]
        while pending:
            name = next(pending[-1], None)
            if name is None:
                pending.pop()
                if path:
                    finished.add(path.pop())
            elif name in path:
                return [*path[path.index(name) :], name]
            elif name in needs and name not in finished:
                path.append(name)
                pending.append(iter(sorted(needs[name])))
    return []


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


def linear_noise(rate: sp.Expr, places: Places, state: str) -> None:
    """White noise enters a rate linearly, multiplied by parameters, t and s only."""
    noises = {symbol(name) for name in places.of_kind("noise")} & rate.free_symbols
    foreign = {symbol(n) for n in (*places.of_kind("state"), *places.of_kind("contact"), *places.of_kind("noise"))}
    for noise in sorted(noises, key=str):
        where = {"table": "rates", "key": state, "token": noise.name}
        if any(noise in call.free_symbols for call in rate.atoms(ElementCall)):
            raise ModelError(f"the white noise `{noise}` enters an element: its variance would be infinite", **where)
        if sp.diff(rate, noise).free_symbols & foreign:
            raise ModelError(
                f"the white noise `{noise}` may be multiplied by parameters, `t` and `s`, not by a state; "
                "it may not pass through a function either",
                **where,
            )


def ground_names(ground: Ground, places: Places) -> None:
    """The ground's own equations use its own states and noises, parameters and s."""
    settings = ground.settings
    if ground.kind == "shaping_filter":
        own = places.ground([s.name for s in settings["rates"]], settings["noise"].names if settings["noise"] else ())
        for state, rate in settings["rates"].items():
            _within(own.ground_rate(), rate, table="ground", key=f"rates.{state}")
        _within(own.ground_height(), settings["height"], table="ground", key="height")
    else:
        own = places.ground([], ())
        for key, value in settings.items():
            if isinstance(value, sp.Basic):
                _within(own.ground_number(), value, table="ground", key=key)
    for entry in settings["noise"].intensity if settings.get("noise") else ():
        _within(own.ground_number(), entry, table="ground", key="noise")
    for key, value in (("rolling_contact", ground.rolling), ("profile", ground.profile)):
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
    from cadet_sym.language.vocabulary import der

    contacts = {symbol(name) for name in places.of_kind("contact")}
    stand_in = {call: sp.Dummy(real=True) for call in value.atoms(der)}
    plain = value.xreplace(stand_in)
    variables = [*stand_in.values(), *sorted(contacts & plain.free_symbols, key=str)]
    for variable in variables:
        if sp.diff(plain, variable).free_symbols & set(variables):
            raise ModelError(
                "an initial value is linear in the contacts and their derivatives, as `-h`", table="initial", key=state
            )


# --------------------------------------------------------------------------- numbers


def values(model: Model) -> None:
    """Numbers that make sense: durations, setbacks, covariances, a speed that is never negative."""
    duration = model.number(model.run.duration)
    if not (math.isfinite(duration) and duration > 0):
        raise ModelError(f"a positive duration is wanted, not {duration:g}", table="run", key="duration")
    for contact, where in model.vehicle.contacts.items():
        setback = model.number(where.setback)
        if not (math.isfinite(setback) and setback >= 0):
            raise ModelError(
                f"a setback is a distance behind the leading wheel, not negative: {setback:g} found",
                table="contacts",
                key=contact.name,
            )
    _positive_semidefinite_start(model)
    if model.noise is not None:
        known = {symbol(n): v for n, v in model.parameter_values().items()}
        for t in np.linspace(0, duration, 11):
            numbers = np.array([[evaluate(e, {**known, TIME: t}) for e in row] for row in model.noise.intensity.tolist()])
            _semidefinite(numbers, "the intensity", f" at t = {t:g}", table="noise", key=",".join(model.noise.names))
    if model.travel is not None:
        nonnegative_speed(model, duration)


def _positive_semidefinite_start(model: Model) -> None:
    states = list(model.vehicle.rates)
    matrix = np.zeros((len(states), len(states)))
    for (a, b), value in model.initial.covariance.items():
        i, j = states.index(a), states.index(b)
        matrix[i, j] = matrix[j, i] = model.number(value)
    if model.initial.covariance:
        _semidefinite(matrix, "the initial covariance", "", table="initial.covariance", key="")


def _semidefinite(matrix: np.ndarray, what: str, when: str, **where: str) -> None:
    if not np.isfinite(matrix).all():
        raise ModelError(f"{what} is not finite{when}", **where)
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -1e-12 * np.abs(matrix).max(initial=0.0):
        raise ModelError(
            f"{what} is not positive semidefinite{when}: its smallest eigenvalue is {smallest:.3g}. "
            "The variances are too small for the covariances, or one is negative",
            **where,
        )


def nonnegative_speed(model: Model, duration: float) -> None:
    """Refuse a speed that is negative, or no number, somewhere in the run."""
    travel = model.travel
    assert travel is not None
    known: dict[Any, Any] = {symbol(n): v for n, v in model.parameter_values().items()}
    key = "speed" if travel.speed is not None else "distance"
    speed = travel.speed_expression()
    kinks = [evaluate(k, known) for k in breakpoints([speed], TIME)]
    times = np.union1d(np.linspace(0, duration, _GRID), [k for k in kinks if 0 <= k <= duration])
    found = np.broadcast_to(evaluate(speed, {**known, TIME: times}), times.shape)
    if not np.isfinite(found).all():
        t = times[~np.isfinite(found)][0]
        raise ModelError(f"the speed is not a finite number at t = {t:g}", table="travel", key=key)
    worst = int(np.argmin(found))
    if found[worst] < -1e-9 * np.abs(found).max(initial=0.0):
        raise ModelError(
            f"the speed is negative within the run: {found[worst]:.6g} at t = {times[worst]:.6g}. "
            "A vehicle may stand but not reverse: shorten the run, or limit the speed, as max(..., 0)",
            table="travel",
            key=key,
        )

