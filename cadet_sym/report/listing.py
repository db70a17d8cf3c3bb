"""What a model became: augmented equations, and every describing function with how it was obtained."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp

from cadet_sym.augmentation import AugmentedSystem, NoiseSource
from cadet_sym.expectation import DescribingFunction
from cadet_sym.expectation.formula import tidy
from cadet_sym.language.expression import SPEED
from cadet_sym.linearisation import Nonlinearity, readable, shown
from cadet_sym.lowering.check import ElementCheck, check
from cadet_sym.lowering.measured import numbers_at_start
from cadet_sym.moments import MomentEquations

__all__ = ["Listing"]


@dataclass(frozen=True)
class Listing:
    """The stages of one model, for reading: as text, LaTeX or plain data."""

    equations: MomentEquations
    checked: bool = False
    """Whether every nonlinearity is held against adaptive integration."""

    @property
    def system(self) -> AugmentedSystem:
        """The augmented system in time."""
        return self.equations.quasi_linear.system

    @property
    def elements(self) -> tuple[Nonlinearity, ...]:
        """The nonlinearities of the rates, in the order in which they were found."""
        return self.equations.quasi_linear.elements

    @cached_property
    def rates(self) -> dict[str, sp.Expr]:
        """The rate of every state, white noise as a symbol of its own."""
        system = self.system
        noise = [_noise_symbol(source) for source in system.sources]
        weight = [SPEED if source.domain == "distance" else sp.S.One for source in system.sources]
        return {
            state.name: sp.Add(
                drift, *(b * v * w for b, v, w in zip(system.noise_input.row(i), weight, noise, strict=True))
            )
            for i, (state, drift) in enumerate(zip(system.states, system.drift, strict=True))
        }

    @cached_property
    def checks(self) -> tuple[ElementCheck | None, ...]:
        """What adaptive integration says of every nonlinearity, at t = s = 0 and speed 1 where it depends on them."""
        if not self.checked:
            return (None,) * len(self.elements)
        numbers = {s.name: value for s, value in numbers_at_start(self.equations).items()}
        return tuple(check(element.describing, numbers) for element in self.elements)

    def to_dict(self) -> dict[str, Any]:
        """What ``cadet-sym show --json`` prints: equations as text of the model language."""
        return {
            "model": self.system.model.name,
            "states": list(self.rates),
            "equations": {name: shown(rate) for name, rate in self.rates.items()},
            "intensity": [[shown(value) for value in row] for row in self.system.intensity.tolist()],
            "outputs": {name: shown(value) for name, value in self.system.outputs.items()},
            "speed": shown(self.system.speed),
            "describing_functions": [*map(self._element, self.elements, self.checks)],
        }

    def _element(self, element: Nonlinearity, checked: ElementCheck | None) -> dict[str, Any]:
        describing = element.describing
        expectation, gains = written_out(describing)
        found = {} if checked is None else {"check": {name: getattr(checked, name) for name in ("error", "gain_error", "sure")}}
        return {
            "name": element.name,
            "function": shown(describing.body),
            "arguments": [shown(form.of(self.system.states)) for form in element.forms],
            "expectation": None if expectation is None else shown(expectation),
            "gains": [shown(gain) for gain in gains],
            "method": describing.method,
            "nodes": describing.nodes,
            "error": describing.error,
            **found,
        }

    def lines(self) -> Iterator[str]:
        """The listing as text, a line at a time."""
        system = self.system
        yield f"{system.model.name}: {len(system.states)} states, {len(self.elements)} nonlinearities"
        yield ""
        yield from (f"  {name}' = {shown(rate)}" for name, rate in self.rates.items())
        if system.sources:
            yield ""
            yield from (f"  {line}" for line in self._noises())
        if system.outputs:
            yield ""
            yield from (f"  {name} = {shown(value)}" for name, value in system.outputs.items())
        for element, checked in zip(self.elements, self.checks, strict=True):
            yield ""
            yield from self._describe(element)
            if checked is not None:
                yield from (f"    {line}" for line in checked.findings())

    def _noises(self) -> Iterator[str]:
        """The intensity of every noise, and of every pair that is correlated at equal argument."""
        intensity, names = self.system.intensity, [_noise_symbol(each).name for each in self.system.sources]
        for i, first in enumerate(names):
            for j, second in enumerate(names[: i + 1]):
                if intensity[i, j] != 0:
                    of = first if i == j else f"{second} with {first}"
                    yield f"intensity of {of}: {shown(intensity[i, j])}"

    def _describe(self, element: Nonlinearity) -> Iterator[str]:
        describing = element.describing
        arguments = zip(describing.arguments, element.forms, strict=True)
        of = ", ".join(f"{readable(z)} = {shown(form.of(self.system.states))}" for z, form in arguments)
        yield f"  {element.name}: f = {shown(describing.body)},  {of}"
        yield f"    {_how(describing)}"
        expectation, gains = written_out(describing)
        if expectation is not None:
            yield f"    E[f] = {shown(expectation)}"
            yield from (f"    {mark} = {shown(gain)}" for mark, gain in zip(_marks(describing), gains, strict=True))

    def latex(self) -> str:
        """The same as LaTeX: augmented equations, nonlinearities and their expectations, moment equations."""
        quasi_linear = self.equations.quasi_linear
        parts = [self.system._repr_latex_(), quasi_linear._repr_latex_() if self.elements else ""]
        for j, element in enumerate(self.elements):
            formula = element.describing.formula()
            if formula is not None:
                expectation = sp.latex(formula.xreplace(_short(element.describing)))
                parts.append(rf"$$F_{{{j + 1}}} = \mathrm{{E}}[f_{{{j + 1}}}] = {expectation}$$")
        parts.append(self.equations._repr_latex_())
        return "\n".join(part for part in parts if part)


def written_out(describing: DescribingFunction) -> tuple[sp.Expr | None, tuple[sp.Expr, ...]]:
    """E[f] and the equivalent gains dE[f]/dm for reading; of one argument the mean is m and the variance p."""
    formula = describing.formula()
    if formula is None:
        return None, ()
    gains = tuple(tidy(sp.diff(formula, mean)) for mean in describing.means)
    short = _short(describing)
    return formula.xreplace(short), tuple(gain.xreplace(short) for gain in gains)


def _short(describing: DescribingFunction) -> dict[sp.Symbol, sp.Symbol]:
    """Shorter names of the mean and the variance where there is one of each."""
    if len(describing.means) > 1:
        return {}
    return dict(zip((*describing.means, *describing.covariances), sp.symbols("m p", real=True), strict=True))


def _marks(describing: DescribingFunction) -> list[str]:
    count = len(describing.means)
    return ["gain"] if count == 1 else [f"gain {i + 1}" for i in range(count)]


def _noise_symbol(source: NoiseSource) -> sp.Symbol:
    """The noise as the equations show it: w(t), w(s), or w(s - setback) under a wheel further back."""
    if source.domain == "time":
        return sp.Symbol(f"{source.name}(t)", real=True)
    behind = "" if source.setback == 0 else f" - {_factor(source.setback)}"
    return sp.Symbol(f"{source.name}(s{behind})", real=True)


def _factor(expression: sp.Expr) -> str:
    text = shown(expression)
    return f"({text})" if expression.is_Add else text


def _how(describing: DescribingFunction) -> str:
    if not describing.nodes:
        return describing.method
    return f"{describing.method}, {describing.nodes} nodes, estimated relative error {describing.error:.1e}"

