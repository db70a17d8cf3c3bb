"""Turn a vehicle, its ground and its travel into one system in time: dx = f(x, t) dt + b dW.

This is the only module that knows both the distance s along the ground and the time t
(Harrison & Hammond 1986, equations 16-24). The ground obeys, in distance,

    xi'(s) = C xi + D w + o(s),        u = F xi + g(s),        E[w(s) w(s')^T] = Q delta(s - s'),

and along s(t), with V = ds/dt,

    xi_dot = V (C xi + o) + V D w(s(t)),      der(u) = V u',      der(u, 2) = V' u' + V^2 u''.

White noise in distance enters as b dW(s): the increments of W over ds have covariance Q ds = Q V dt, so the
diffusion V b Q b^T is polynomial in V and nothing is singular at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import sympy as sp

from cadet_sym.contacts import (
    FilterCopy,
    Heights,
    NoiseSource,
    at_wheel,
    derivative_of,
    filter_copies,
    filter_rates,
    travel_of,
)
from cadet_sym.errors import ModelError
from cadet_sym.language.expression import DISTANCE, SPEED, TIME, ElementCall, der, symbol
from cadet_sym.language.model import Model

__all__ = ["AugmentedSystem", "FilterCopy", "NoiseSource", "augment"]


@dataclass(frozen=True)
class AugmentedSystem:
    """The vehicle and its ground in time: dx = f(x, t) dt + b dW.

    Drift and outputs are expressions in the states, the parameters, `TIME`, `DISTANCE`, `SPEED` and
    `SPEED_RATE`; declared elements are kept as calls. Columns of `noise_input` whose source is in
    distance are driven by increments over ds, those in time by increments over dt. The intensity is that of the
    columns at equal argument: columns that meet the same noise at another setback are not correlated in it.
    """

    model: Model
    states: tuple[sp.Symbol, ...]
    drift: tuple[sp.Expr, ...]
    noise_input: sp.ImmutableMatrix  # (n, m)
    sources: tuple[NoiseSource, ...]  # m of them
    intensity: sp.ImmutableMatrix  # (m, m)
    copies: tuple[FilterCopy, ...]
    outputs: Mapping[str, sp.Expr]
    initial_offset: sp.ImmutableMatrix  # (nv, 1): vehicle x(0) = offset + map xi(0) + delta
    initial_map: sp.ImmutableMatrix  # (nv, nf)
    initial_covariance: sp.ImmutableMatrix  # (nv, nv): of delta
    speed: sp.Expr
    speed_rate: sp.Expr
    distance: sp.Expr | None  # None: integrate the speed from `start`
    start: sp.Expr

    @property
    def vehicle_size(self) -> int:
        """Number of the vehicle's own states; the filters' follow them."""
        return len(self.model.vehicle.rates)

    @property
    def needs_distance(self) -> bool:
        """Whether anything depends on the distance travelled itself, not only on the speed."""
        symbols: set[sp.Basic] = set()
        for expression in (*self.drift, *self.noise_input, *self.intensity, *self.outputs.values()):
            symbols |= expression.free_symbols
        return DISTANCE in symbols

    def _repr_latex_(self) -> str:
        rows = (
            rf"\dot{{{sp.latex(state)}}} &= {sp.latex(rate)}"
            for state, rate in zip(self.states, self.drift, strict=True)
        )
        return r"$$\begin{aligned}" + r" \\ ".join(rows) + r"\end{aligned}$$"


def augment(model: Model) -> AugmentedSystem:
    """Join the vehicle to the ground as each of its contacts meets it (Harrison & Hammond 1986, eqs 16-24).

    Raises
    ------
    ModelError
        If a derivative of the ground height does not exist (the message says how many more filter
        stages it needs), or if white noise enters an element, an output or an initial value.
    """
    vehicle_states = tuple(model.vehicle.rates)
    copies, sources = filter_copies(model, len(vehicle_states))
    states = vehicle_states + tuple(symbol(f"{copy.contact}.{name}") for copy in copies for name in copy.filter.states)
    noises = tuple(sp.Dummy(source.name, real=True) for source in sources)
    heights = Heights(model, copies, states, noises)

    rates = [heights.substitute(rate, f"rate of `{state}`") for state, rate in model.vehicle.rates.items()]
    rates += [rate for copy in copies for rate in filter_rates(copy, states, noises)]
    named = {symbol(s.name): noise for s, noise in zip(sources, noises, strict=True) if s.domain == "time"}
    rates = [rate.xreplace(named) for rate in rates]
    drift, noise_input = _separate_noise(rates, states, sources, noises)
    offset, initial_map, covariance = _initial_state(model, heights, states, noises)
    speed, distance, start = travel_of(model)
    return AugmentedSystem(
        model=model,
        states=states,
        drift=drift,
        noise_input=noise_input,
        sources=sources,
        intensity=_intensity(model, copies, len(sources)),
        copies=copies,
        outputs=_outputs(model, heights, rates[: len(vehicle_states)], named, noises),
        initial_offset=offset,
        initial_map=initial_map,
        initial_covariance=covariance,
        speed=speed,
        speed_rate=derivative_of(speed, TIME),
        distance=distance,
        start=start,
    )


def _separate_noise(
    rates: list[sp.Expr],
    states: tuple[sp.Symbol, ...],
    sources: tuple[NoiseSource, ...],
    noises: tuple[sp.Dummy, ...],
) -> tuple[tuple[sp.Expr, ...], sp.ImmutableMatrix]:
    """Split x' = f + (coefficients) w into the drift and the noise input."""
    drift: list[sp.Expr] = []
    columns = sp.zeros(len(rates), len(sources))
    for i, rate in enumerate(rates):
        quiet = rate.xreplace(dict.fromkeys(noises, sp.S.Zero))
        for j in (j for j, noise in enumerate(noises) if noise in rate.free_symbols):
            coefficient = sp.expand(_noise_coefficient(rate, noises[j], states[i].name, sources[j].name))
            if coefficient.free_symbols & {*states, *noises}:
                raise ModelError(
                    f"rate of `{states[i].name}`: white noise `{sources[j].name}` is multiplied by a state "
                    "(or by itself); it may be multiplied by parameters, `t` and `s` only."
                )
            # w ds = w V dt: a column in distance is driven by increments over ds, so one V goes with them.
            columns[i, j] = sp.expand(coefficient / SPEED) if sources[j].domain == "distance" else coefficient
        drift.append(quiet)
    return tuple(drift), sp.ImmutableMatrix(columns)


def _noise_coefficient(rate: sp.Expr, noise: sp.Dummy, state: str, name: str) -> sp.Expr:
    _refuse_noise_in_elements(rate, noise, f"rate of `{state}`", name)
    return sp.diff(rate, noise)


def _refuse_noise_in_elements(expression: sp.Expr, noise: sp.Dummy, where: str, name: str) -> None:
    """White noise has infinite variance: it may be added, never passed through a function."""
    for node in sp.preorder_traversal(expression):
        inside = isinstance(node, sp.Function | ElementCall | sp.Piecewise | sp.Max | sp.Min) or (
            isinstance(node, sp.Pow) and noise in node.free_symbols
        )
        if inside and noise in node.free_symbols:
            raise ModelError(
                f"{where}: white noise `{name}` enters the nonlinear function `{node}`, "
                "where its variance is infinite. Pass it through a filter state first "
                "(`rolling_contact` for the ground)."
            )


def _outputs(
    model: Model,
    heights: Heights,
    rates: list[sp.Expr],
    named: Mapping[sp.Symbol, sp.Dummy],
    noises: tuple[sp.Dummy, ...],
) -> Mapping[str, sp.Expr]:
    """Outputs in the augmented states: der(x) becomes the rate of x, earlier outputs are written out."""
    rate_of = {der(state, 1): rate for state, rate in zip(model.vehicle.rates, rates, strict=False)}
    outputs: dict[str, sp.Expr] = {}
    for name, expression in model.vehicle.outputs.items():
        where = f"output `{name}`"
        earlier = {symbol(key): value for key, value in outputs.items()}
        full = heights.substitute(expression.xreplace(rate_of), where).xreplace(earlier).xreplace(dict(named))
        found = next((noise for noise in noises if noise in full.free_symbols), None)
        if found is not None:
            raise ModelError(
                f"{where}: it contains the white noise `{found.name}` and so has infinite variance. "
                "Filter it first (`rolling_contact` for the ground), or leave that term out of the output."
            )
        outputs[name] = full
    return outputs


def _initial_state(
    model: Model, heights: Heights, states: tuple[sp.Symbol, ...], noises: tuple[sp.Dummy, ...]
) -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix, sp.ImmutableMatrix]:
    """Vehicle state at the start: x(0) = offset + map xi(0) + delta, delta of covariance Sigma."""
    vehicle = tuple(model.vehicle.rates)
    ground = states[len(vehicle) :]
    offset, linear = sp.zeros(len(vehicle), 1), sp.zeros(len(vehicle), len(ground))
    for i, state in enumerate(vehicle):
        where = f"initial value of `{state.name}`"
        value = heights.substitute(sp.sympify(model.initial.values.get(state, 0)), where)
        if any(noise in value.free_symbols for noise in noises):
            raise ModelError(
                f"{where}: it contains white noise (a derivative of the ground height that the filter does not "
                "smooth), which has infinite variance. Add `rolling_contact`, or start from a number."
            )
        present = [(j, xi) for j, xi in enumerate(ground) if xi in value.free_symbols]
        for j, xi in present:
            linear[i, j] = sp.diff(value, xi)
            if linear[i, j].free_symbols & set(ground):
                raise ModelError(f"{where}: it must be linear in the contacts and their derivatives.")
        offset[i] = value.xreplace({xi: sp.S.Zero for _, xi in present})
    covariance = sp.zeros(len(vehicle), len(vehicle))
    for (a, b), value in model.initial.covariance.items():
        i, j = vehicle.index(a), vehicle.index(b)
        covariance[i, j] = covariance[j, i] = value
    return sp.ImmutableMatrix(offset), sp.ImmutableMatrix(linear), sp.ImmutableMatrix(covariance)


def _intensity(model: Model, copies: Iterable[FilterCopy], size: int) -> sp.ImmutableMatrix:
    """Intensity of all noise columns at equal argument, block by block."""
    intensity = sp.zeros(size, size)
    if model.noise is not None:
        count = len(model.noise.names)
        intensity[:count, :count] = model.noise.intensity
    for copy in copies:
        first, last = copy.columns[0], copy.columns[-1] + 1
        intensity[first:last, first:last] = copy.filter.Q.applyfunc(_wheel(copy))
    return sp.ImmutableMatrix(intensity)


def _wheel(copy: FilterCopy) -> Callable[[sp.Expr], sp.Expr]:
    return lambda expression: at_wheel(expression, copy)
