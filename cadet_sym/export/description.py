"""Say in plain text what was exported: the model's equations, its names and its noises."""

from __future__ import annotations

from collections.abc import Iterator

from cadet_sym.language.expression import unparse
from cadet_sym.moments import MomentEquations

__all__ = ["equations_text"]


def equations_text(equations: MomentEquations) -> Iterator[str]:
    """The augmented equations, the noises and how every nonlinearity is averaged, a line at a time."""
    quasi_linear = equations.quasi_linear
    system = quasi_linear.system
    for i, (state, drift) in enumerate(zip(system.states, system.drift, strict=True)):
        noises = [
            f" + ({unparse(system.noise_input[i, j])}){' * V(t)' if source.domain == 'distance' else ''} * w{j + 1}"
            for j, source in enumerate(system.sources)
            if system.noise_input[i, j] != 0
        ]
        yield f"d/dt {state.name} = {unparse(drift)}{''.join(noises)}"
    if system.sources:
        yield ""
    for j, source in enumerate(system.sources):
        argument = "t" if source.domain == "time" else f"s - {unparse(source.setback)}" if source.setback != 0 else "s"
        yield f"w{j + 1} = {source.name}({argument}), white noise of intensity {unparse(system.intensity[j, j])}"
    if system.model.ground is not None:
        yield f"V(t) = {unparse(system.speed)}, the speed; s, the distance"
    if system.outputs:
        yield ""
        yield from (f"{name} = {unparse(value)}" for name, value in system.outputs.items())
    if quasi_linear.elements:
        yield ""
    for element in quasi_linear.elements:
        describing = element.describing
        of = ", ".join(unparse(form.of(system.states)) for form in element.forms)
        how = describing.method
        if describing.nodes:
            how += f", {describing.nodes} nodes, estimated relative error {describing.error:.1e}"
        yield f"{element.name} of {of}: expectation by {how}"
