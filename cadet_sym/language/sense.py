"""Whether the numbers of a model make sense: durations, setbacks, covariances, intensities, the speed, the road.

Runs again when parameters change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.ground import Ground
from cadet_sym.language.kinks import jump
from cadet_sym.language.numeric import evaluate
from cadet_sym.language.shaping import ShapingFilter
from cadet_sym.language.vocabulary import DISTANCE, TIME, der, symbol

if TYPE_CHECKING:
    from cadet_sym.language.model import Model

_GRID = 2001  # times at which a speed is looked at, besides its breakpoints
_PLACES = 501  # places of the road that is travelled at which its numbers are looked at, besides its breakpoints
_TIMES = 11  # times at which an intensity is looked at


def values(model: Model) -> None:
    """Refuse numbers that make no sense; the message says which, where, and what would."""
    known = {symbol(name): value for name, value in model.parameter_values().items()}
    duration = evaluate(model.run.duration, known)
    if not (math.isfinite(duration) and duration > 0):
        raise ModelError(f"a positive duration is wanted, not {duration:g}", table="run", key="duration")
    for contact, where in model.vehicle.contacts.items():
        setback = evaluate(where.setback, known)
        if not (math.isfinite(setback) and setback >= 0):
            raise ModelError(
                f"a setback is a distance behind the leading wheel and not negative: {setback:g} found",
                table="contacts",
                key=f"{contact}.setback",
            )
    _start(model, known)
    if model.noise is not None:
        name = ",".join(model.noise.names)
        varies = TIME in model.noise.intensity.free_symbols
        for t in np.linspace(0, duration, _TIMES) if varies else [0.0]:
            intensity = _numbers(model.noise.intensity, {**known, TIME: t})
            when = f" at t = {t:g}" if varies else ""
            _semidefinite(intensity, f"the intensity of `{name}`{when}", table="noise")
    travels(model, duration)


def travels(model: Model, duration: float) -> None:
    """Refuse a speed or a road that makes no sense within a run of that duration."""
    known = {symbol(name): value for name, value in model.parameter_values().items()}
    if model.travel is not None:
        _speed(model, known, duration)
    if model.ground is not None and model.travel is not None:
        _ground(model, model.ground, known, duration)


def _numbers(matrix: sp.MatrixBase, known: Mapping[sp.Symbol, float]) -> np.ndarray:
    numbers = np.zeros(matrix.shape)
    for (i, j), entry in matrix.todok().items():
        numbers[i, j] = evaluate(entry, known)
    return numbers


# --------------------------------------------------------------------------- start


def _start(model: Model, known: Mapping[sp.Symbol, float]) -> None:
    for state, value in model.initial.values.items():
        number = evaluate(value, known) if not value.free_symbols - known.keys() and not value.has(der) else 0.0
        if not math.isfinite(number):
            raise ModelError(f"an initial value is a finite number, not {number}", table="initial", key=state.name)
    if not model.initial.covariance:
        return
    states = list(model.vehicle.rates)
    matrix = np.zeros((len(states), len(states)))
    for (a, b), value in model.initial.covariance.items():
        i, j = states.index(a), states.index(b)
        matrix[i, j] = matrix[j, i] = evaluate(value, known)
    _semidefinite(matrix, "the initial covariance", table="initial.covariance")


def _semidefinite(matrix: np.ndarray, what: str, **where: str) -> None:
    if not np.isfinite(matrix).all():
        raise ModelError(f"{what} is not finite", **where)
    # scaled to unit diagonal, so that states of different sizes are judged alike
    size = np.sqrt(np.abs(np.diag(matrix)))
    size = np.where(size > 0, size, np.sqrt(np.abs(matrix).max(initial=0.0)) or 1.0)
    smallest = float(np.linalg.eigvalsh(matrix / np.outer(size, size))[0])
    if smallest < -1e-10:
        raise ModelError(
            f"{what} is not positive semidefinite: scaled to unit variances, its smallest eigenvalue is "
            f"{smallest:.3g}. A variance is negative, or too small for its covariances",
            **where,
        )


# --------------------------------------------------------------------------- speed


def _speed(model: Model, known: Mapping[Any, Any], duration: float) -> None:
    """The speed is finite and never negative, and as smooth as the derivatives of the ground that are asked for."""
    travel = model.travel
    assert travel is not None
    key = "speed" if travel.speed is not None else "distance"
    where = {"table": "travel", "key": key}
    kinks = [k for k in _values(travel.breakpoints, known) if 0 < k < duration]
    if travel.distance is not None and (t := jump(travel.distance, TIME, kinks, known)) is not None:
        raise ModelError(f"the distance jumps at t = {t:g}: a vehicle moves continuously", **where)
    speed = travel.speed_expression()
    if travel.table is not None and travel.table.outside != "extrapolate":
        times = np.array([float(k) for k in travel.table.knots])
        found = np.array([float(v) for v in travel.table.values])
        if travel.table.outside == "end" and not times[0] <= 0 < duration <= times[-1]:
            raise ModelError(
                f"the rows of the speed go from t = {times[0]:g} to t = {times[-1]:g}, and the run from 0 to {duration:g}: "
                'change the duration, or say what the speed is beyond its rows, as outside = "hold"',
                **where,
            )
    else:
        times = np.sort(np.concatenate([np.linspace(0, duration, _GRID), kinks]))
        found = np.broadcast_to(evaluate(speed, {**known, TIME: times}), times.shape)
    if not np.isfinite(found).all():
        t = times[~np.isfinite(found)][0]
        raise ModelError(f"the speed is not a finite number at t = {t:g}", **where)
    worst = int(np.argmin(found))
    if found[worst] < -1e-9 * np.abs(found).max(initial=0.0):
        raise ModelError(
            f"the speed is negative within the run: {found[worst]:.6g} at t = {times[worst]:.6g}. A vehicle may stand "
            "but not reverse: shorten the run, or limit the speed, as in max(..., 0)",
            **where,
        )
    rate = speed
    for order in range(2, _asked(model) + 1):
        if (t := jump(rate, TIME, kinks, known)) is not None:
            what = "speed" if order == 2 else "acceleration" if order == 3 else "speed's derivative"
            raise ModelError(
                f"the {what} jumps at t = {t:g}, and `der(..., {order})` of a contact would be infinite there: "
                "let it change over a short time, or use a lower derivative",
                **where,
            )
        rate = sp.diff(rate, TIME)


def _values(expressions: Iterable[sp.Expr], known: Mapping[sp.Symbol, float]) -> list[float]:
    found = (evaluate(e, known) for e in expressions)
    return sorted({v for v in found if math.isfinite(v)})


def _asked(model: Model) -> int:
    """Highest derivative of a contact in a rate, an output or an initial value."""
    contacts = set(model.vehicle.contacts)
    tables = (model.vehicle.rates, model.vehicle.outputs, model.initial.values)
    calls = {call for table in tables for expr in table.values() for call in expr.atoms(der)}
    return max((call.order for call in calls if call.of in contacts), default=0)


# --------------------------------------------------------------------------- ground


def _ground(model: Model, ground: Ground, known: dict[sp.Symbol, float], duration: float) -> None:
    travel = model.travel
    assert travel is not None
    first = evaluate(travel.start if travel.distance is None else travel.distance, {**known, TIME: 0.0})
    places = sorted({first - evaluate(c.setback, known) for c in model.vehicle.contacts.values()})
    road = ground.shaping_filter()
    kinks = _values(ground.breakpoints, known)
    _along(ground, road, known, np.linspace(places[0], _last_place(model, known, duration), _PLACES), kinks)
    for s in places if model.initial.ground == "stationary" or DISTANCE not in road.C.free_symbols else ():
        grows = np.linalg.eigvals(C := _numbers(road.C, {**known, DISTANCE: s}))
        if grows.size and grows.real.max() > 1e-9 * np.abs(C).max():
            growth = grows[grows.real.argmax()]
            raise ModelError(
                f"the ground's filter is unstable: its eigenvalue {growth.real:.3g}"
                + (f" +- {abs(growth.imag):.3g}i" if growth.imag else "")
                + " (per unit of length) makes heights grow along the road; check the signs in its rates",
                table="ground",
            )
    spots = sorted({*places, *(k + d for k in kinks for d in (-1e-6, 1e-6))})
    for s in spots[:1000]:
        at = {**known, DISTANCE: s}
        _semidefinite(_numbers(road.Q, at), f"the intensity of the ground's noise at s = {s:g}", table="ground")
        for matrix in (road.C, road.D, road.F, road.offset, sp.Matrix([road.profile])):
            if not np.isfinite(_numbers(matrix, at)).all():
                raise ModelError(f"a coefficient of the ground is not a finite number at s = {s:g}", table="ground")
    _smooth_enough(road, kinks, known, _asked(model))


def _last_place(model: Model, known: Mapping[Any, Any], duration: float) -> float:
    """Where the leading wheel is at the end, nearly."""
    travel = model.travel
    assert travel is not None
    distance, times = travel.closed_distance(), np.linspace(0.0, duration, _GRID)
    if distance is not None:
        return float(evaluate(distance, {**known, TIME: duration}))
    speed = np.broadcast_to(evaluate(travel.speed_expression(), {**known, TIME: times}), times.shape)
    return float(evaluate(travel.start, known) + np.trapezoid(speed, times))


def _along(
    ground: Ground, road: ShapingFilter, known: Mapping[sp.Symbol, float], places: np.ndarray, kinks: list[float]
) -> None:
    """Numbers that are positive, or at least not negative, are that all along the road."""
    s = np.sort([*places, *(k + d for k in kinks for d in (-1e-6, 1e-6) if places[0] < k < places[-1])])
    numbers = {key: (ground.settings.get(key), True) for key in ("cutoff", "n0", "omega0")}
    numbers |= {key: (ground.settings.get(key), False) for key in ("sigma", "gd")}
    numbers["rolling_contact"] = ground.rolling, True
    numbers["contact_patch"] = ground.patch[0] if ground.patch else None, True
    for key, (expr, strictly) in [*numbers.items(), *(("noise", (road.Q[i, i], False)) for i in range(road.Q.rows))]:
        if expr is None or isinstance(expr, tuple):
            continue
        varies = DISTANCE in expr.free_symbols
        found = np.broadcast_to(evaluate(expr, {**known, DISTANCE: s if varies else s[0]}), s.shape)
        wrong = ~(found > 0) if strictly else ~(found >= 0)
        if wrong.any():
            k = int(np.argmax(wrong))
            what = "positive number" if strictly else "number that is not negative"
            where = f" at s = {s[k]:g}" if varies else ""
            raise ModelError(f"a {what} is wanted, not {found[k]:g}{where}", table="ground", key=key, token="")


def _smooth_enough(road: ShapingFilter, kinks: list[float], known: Mapping[sp.Symbol, float], order: int) -> None:
    """Each derivative of the height before the highest that is asked for is continuous along the road."""
    row, affine = sp.Matrix(road.F), road.profile
    for k in range(order):
        for expr in (*row, affine):
            if DISTANCE not in expr.free_symbols:
                continue
            if (s := jump(expr, DISTANCE, kinks, known)) is not None:
                what = "height" if k == 0 else "slope" if k == 1 else f"derivative of order {k}"
                raise ModelError(
                    f"the {what} of the ground jumps at s = {s:g}, and `der(..., {order})` of a contact would be "
                    "infinite there: give the step a length, or add rolling_contact",
                    table="ground",
                    key="profile" if expr == affine else "",
                )
        row, affine = (
            row.diff(DISTANCE) + row * road.C,
            (row * road.offset)[0] + sp.diff(affine, DISTANCE),
        )
