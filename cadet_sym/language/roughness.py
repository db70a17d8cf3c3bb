"""Whether the ground is smooth enough for what the vehicle asks of it, and white noise is kept where it may be.

With xi' = C xi + D w and u = F xi, the derivative of order k has a finite variance if F C^j D = 0 for all j < k; it is
white noise if that holds for j < k - 1 only; beyond that it does not exist.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import sympy as sp

from cadet_sym.errors import ModelError
from cadet_sym.language.printer import unparse
from cadet_sym.language.shaping import ShapingFilter
from cadet_sym.language.vocabulary import DISTANCE, ElementCall, der, symbol

if TYPE_CHECKING:
    from cadet_sym.language.model import Model


def smooth_order(road: ShapingFilter, most: int) -> int:
    """Highest order, up to `most`, of a derivative of the height that has a finite variance."""
    row = sp.Matrix(road.F)
    for order in range(most):
        if not (row * road.D).applyfunc(sp.expand).is_zero_matrix:
            return order
        row = row.diff(DISTANCE) + row * road.C
    return most


def check_noise(model: Model) -> None:
    """Refuse derivatives of the ground that do not exist, and white noise in an element, an output or a start."""
    contacts = set(model.vehicle.contacts)
    rates, outputs, values = model.vehicle.rates, model.vehicle.outputs, model.initial.values
    calls = {c for table in (rates, outputs, values) for e in table.values() for c in e.atoms(der) if c.of in contacts}
    white: set[sp.Basic] = {symbol(name) for name in model.noise.names} if model.noise is not None else set()
    if model.ground is not None and calls:
        finite = smooth_order(model.ground.shaping_filter(), max(call.order for call in calls))
        _refuse_rough({call for call in calls if call.order > finite + 1}, finite, model)
        white |= {call for call in calls if call.order == finite + 1}
    if not white:
        return
    for state, rate in rates.items():
        _linear(rate, white, {*rates, *contacts}, table="rates", key=state.name)
    for state, value in values.items():
        _absent(value, white, table="initial", key=state.name)
    noisy = {der(state): rate.free_symbols | rate.atoms(der) for state, rate in rates.items()}
    for name, output in outputs.items():
        _absent(output, white, table="outputs", key=name)
        for call in output.atoms(der):
            if noisy.get(call, set()) & white:
                raise ModelError(
                    f"output `{name}`: the rate of `{call.of}` contains white noise, so `{unparse(call)}` has "
                    "infinite variance: filter the noise, or leave that term out",
                    table="outputs",
                    key=name,
                    token=unparse(call),
                )


_PLACES = {"rates": "rate of", "outputs": "output", "initial": "initial value of"}


def _refuse_rough(calls: set[Any], finite: int, model: Model) -> None:
    tables: dict[str, Mapping[Any, sp.Expr]] = {
        "rates": model.vehicle.rates,
        "outputs": model.vehicle.outputs,
        "initial": model.initial.values,
    }
    for table, entries in tables.items():
        for key, expr in entries.items():
            for call in sorted(calls & expr.atoms(der), key=unparse):
                lacking = call.order - 1 - finite
                stages = "one more filter stage" if lacking == 1 else f"{lacking} more filter stages"
                raise ModelError(
                    f"{_PLACES[table]} `{key}`: the ground is too rough for `{unparse(call)}`: its variance would be "
                    f"infinite. It needs {stages} between the white noise and the height: "
                    "add `rolling_contact` to [ground]",
                    table=table,
                    key=str(key),
                    token=unparse(call),
                )


def _linear(rate: sp.Expr, white: set[sp.Basic], varying: set[sp.Basic], **where: str) -> None:
    """White noise enters a rate linearly, multiplied by parameters, t and s."""
    present = sorted(white & (rate.free_symbols | rate.atoms(der)), key=str)
    stand_in = {noise: sp.Dummy(str(noise), real=True) for noise in present}
    plain = rate.xreplace(stand_in)
    for noise, dummy in stand_in.items():
        if any(dummy in call.free_symbols for call in plain.atoms(ElementCall)):
            raise ModelError(
                f"{_what(noise)} enters an element: its variance would be infinite", token=unparse(noise), **where
            )
        if sp.diff(plain, dummy).free_symbols & {*varying, *stand_in.values()}:
            raise ModelError(
                f"{_what(noise)} may be multiplied by parameters, `t` and `s`, not by a state, "
                "and may not pass through a function: its variance is infinite",
                token=unparse(noise),
                **where,
            )


def _absent(expr: sp.Expr, white: set[sp.Basic], **where: str) -> None:
    for noise in sorted(white & (expr.free_symbols | expr.atoms(der)), key=str):
        place = f"{_PLACES[where['table']]} `{where['key']}`"
        raise ModelError(
            f"{place}: {_what(noise)} has infinite variance and may not stand here: filter it first "
            "(`rolling_contact` for the ground), or leave the term out",
            token=unparse(noise),
            **where,
        )


def _what(noise: Any) -> str:
    return (
        f"`{unparse(noise)}`, white noise on this ground," if isinstance(noise, der) else f"the white noise `{noise}`"
    )
