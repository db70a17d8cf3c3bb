"""Take down what the numeric stages need to know of the moment equations, in names and numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from cadet_sym.augmentation import AugmentedSystem
from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.language.expression import DISTANCE, TIME
from cadet_sym.linearisation import Nonlinearity, OutputForm
from cadet_sym.lowering.facts import Facts, FilterPlace
from cadet_sym.moments import MomentEquations

__all__ = ["describing_functions", "survey", "with_elements"]


def survey(equations: MomentEquations, parameters: tuple[str, ...], doubts: tuple[str, ...] = ()) -> Facts:
    """The facts of a system of moment equations; `doubts` is what there is to warn of."""
    quasi_linear = equations.quasi_linear
    system, initial = quasi_linear.system, quasi_linear.system.model.initial
    closed = all(not describing.nodes for describing in describing_functions(equations))
    return Facts(
        states=equations.states,
        outputs=tuple(quasi_linear.outputs),
        parameters=parameters,
        packing=equations.packing,
        vehicle=system.vehicle_size,
        arguments=tuple(len(element.forms) for element in quasi_linear.elements),
        ground=system.model.ground is not None,
        smooth=initial.ground == "smooth",
        whole=bool(initial.whole),
        known_distance=system.distance is not None,
        needs_distance=system.needs_distance,
        gated=bool(equations.gates),
        explicit=_explicit(system),
        filters=tuple(
            FilterPlace(copy.contact, copy.start, len(copy.filter.states), profile=not copy.filter.offset.is_zero_matrix)
            for copy in system.copies
        ),
        delay=equations.delay,
        # A quadrature may choose its order by the parameters' numbers, the order of wheels is that of their setbacks.
        general=closed and len(system.copies) < 2,
        speed_ends=_speed_ends(system),
        integrated=_integrated(equations, parameters),
        doubts=doubts,
    )


def _speed_ends(system: AugmentedSystem) -> float | None:
    travel = system.model.travel
    return float(travel.table.knots[-1]) if travel and travel.table and travel.table.outside == "end" else None


def _integrated(equations: MomentEquations, parameters: tuple[str, ...]) -> tuple[str, ...]:
    """Parameters that a quadrature's integrand depends on, through others too."""
    declared = equations.quasi_linear.system.model.parameters
    waiting = {s.name for df in describing_functions(equations) if df.nodes for s in df.body.free_symbols - set(df.arguments)}
    found: set[str] = set()
    while waiting:
        name = waiting.pop()
        found.add(name)
        if name in declared:
            waiting |= {s.name for s in declared[name].value.free_symbols} - found
    return tuple(name for name in parameters if name in found)


def describing_functions(equations: MomentEquations) -> Iterator[DescribingFunction]:
    """Those of all elements, of the rates and of the outputs and their variances."""
    return (element.describing for _, element in nonlinearities(equations))


def nonlinearities(equations: MomentEquations) -> Iterator[tuple[str, Nonlinearity]]:
    """All elements and what of: the rates, an output, or the variance of one."""
    yield from (("rates", element) for element in equations.quasi_linear.elements)
    for name, form in equations.quasi_linear.outputs.items():
        yield from ((name, element) for element in form.elements)
        for product in form.products.values():
            yield from ((f"variance of {name}", element) for element in product.elements)


Change = Callable[[Nonlinearity, str], Nonlinearity]
"""An element and what messages call it -> what it becomes."""


def with_elements(equations: MomentEquations, change: Change) -> MomentEquations:
    """The same equations with other elements, of the rates, of the outputs and of their variances; themselves if none is."""
    quasi_linear, others = equations.quasi_linear, []

    def noted(element: Nonlinearity, where: str) -> Nonlinearity:
        found = change(element, where)
        if found is not element:  # equality does not see what is known of errors
            others.append(found)
        return found

    elements = tuple(noted(element, f"the element `{element.describing.name}`") for element in quasi_linear.elements)
    outputs = {name: _with_elements(form, f"the output `{name}`", noted) for name, form in quasi_linear.outputs.items()}
    if not others:
        return equations
    return replace(equations, quasi_linear=replace(quasi_linear, elements=elements, outputs=outputs))


def _with_elements(form: OutputForm, where: str, change: Change) -> OutputForm:
    return replace(
        form,
        elements=tuple(change(element, where) for element in form.elements),
        products={key: _with_elements(product, where, change) for key, product in form.products.items()},
    )


def _explicit(system: AugmentedSystem) -> str:
    """Say which rate or output depends on t or s itself; empty if none does."""
    for state, rate in zip(system.states, system.drift, strict=True):
        if found := rate.free_symbols & {TIME, DISTANCE}:
            return f"the rate of `{state}` depends on `{next(iter(found))}`"
    for name, output in system.outputs.items():
        if found := output.free_symbols & {TIME, DISTANCE}:
            return f"the output `{name}` depends on `{next(iter(found))}`"
    for entry in (*system.noise_input, *system.intensity):
        if found := entry.free_symbols & {TIME, DISTANCE}:
            return f"the noise depends on `{next(iter(found))}`"
    return ""
