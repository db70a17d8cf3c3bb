"""From a model, or the file it is declared in, to its functions: through the cache where they were made before.

A file is known by its text and that of the tables it names; a model by what it declares. Where every expectation has a
closed form the functions serve for any numbers of the parameters, which are their inputs: then the model is known by its
equations alone. SymPy is not even imported if nothing has to be made.
"""

from __future__ import annotations

import dataclasses
import json
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from cadet_sym import cache
from cadet_sym.delay import CHOICES
from cadet_sym.errors import ExpectationWarning, ModelError
from cadet_sym.lowering.facts import Declaration, Facts, declaration
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.warning import warn

if TYPE_CHECKING:
    from cadet_sym.language.model import Model
    from cadet_sym.lowering.system import LoweredSystem
    from cadet_sym.lowering.validity import Validity

__all__ = ["Compiled", "from_file", "from_model"]

Grid = tuple[int, int] | None


@dataclass(frozen=True)
class Compiled:
    """What a model becomes: its numbers, its functions, and the way back to it."""

    declaration: Declaration
    functions: MomentFunctions
    model: Callable[[], Model]

    @cached_property
    def declared(self) -> npt.NDArray[np.float64]:
        """p: the declared numbers of the parameters that have one of their own."""
        return np.array([float(self.declaration.values[name]) for name in self.functions.parameters])

    def column(self, name: str) -> int:
        """The entry of p that a parameter is."""
        if name not in self.functions.parameters:
            known = ", ".join(self.functions.parameters) or "none"
            raise ModelError(f"`{name}` is not a parameter with a number of its own; those are: {known}.")
        return self.functions.parameters.index(name)

    def vectors(self, values: Mapping[str, npt.ArrayLike], runs: int) -> npt.NDArray[np.float64]:
        """P (runs, count): the declared numbers, with values of some in their place; not to be written to."""
        if not values:
            return self.declared[None]
        p = np.repeat(self.declared[None], runs, axis=0)
        columns = {name: self.column(name) for name in values}
        for name, column in columns.items():
            p[:, column] = np.asarray(values[name], dtype=float)
        if any(name in self.functions.facts.integrated for name in values):
            for row in p.tolist():
                self._validity.include({name: row[column] for name, column in columns.items()})
        return p

    @cached_property
    def _validity(self) -> Validity:
        """What quadratures were chosen for, and looked at since."""
        from cadet_sym.lowering.validity import Validity

        return Validity(self.functions, self.declaration.values)


def from_file(path: Path, parameters: Mapping[str, Any], grid: Grid) -> Compiled:
    """Compile the model of a file, with other values of some parameters.

    Raises
    ------
    ModelError, LinearisationError
        If the model is wrong, or an element has no Gaussian expectation.
    """
    shelf = _shelf_of_file(path, parameters, grid)
    known = None if shelf is None else shelf.read("file")
    if shelf is not None and known is not None:
        found = json.loads(known)
        facts = _facts(found["key"])
        if facts is not None:
            shelf.use()
            _warn_of(facts.doubts)
            declared = Declaration(**found["declaration"])
            read = partial(_read_again, path, dict(parameters), declared.hash)
            return Compiled(declared, _functions(facts, read, found["key"]), read)
    model = _read(path, parameters)
    declared = declaration(model)
    key, functions = _from_model(model, grid)
    if shelf is not None and key:
        record = {"declaration": dataclasses.asdict(declared), "key": key}
        shelf.write("file", json.dumps(record).encode())
    return Compiled(declared, functions, partial(_same, model))


def from_model(model: Model, grid: Grid) -> Compiled:
    """Compile a model; see `from_file`."""
    return Compiled(declaration(model), _from_model(model, grid)[1], partial(_same, model))


def _from_model(model: Model, grid: Grid) -> tuple[str, MomentFunctions]:
    """The functions, and the key under which they are kept; no key if they are not."""
    chosen = repr(grid)
    general = cache.digest("equations", model.content(numbers=False), chosen)
    own = cache.digest("model", model.content(numbers=True), chosen)
    for key in (general, own):
        facts = _facts(key)
        if facts is not None:
            _warn_of(facts.doubts)
            return key, _functions(facts, partial(_same, model), key)
    from cadet_sym.lowering.survey import survey

    lowered, doubts = _lowered_and_doubted(model, grid)
    _warn_of(doubts)
    facts = survey(lowered.equations, lowered.parameters, doubts)
    key = general if facts.general else own
    shelf = cache.shelf(key)
    if shelf is not None:
        cache.trim()
        shelf.write("facts", facts.to_json())
    return key, MomentFunctions(facts, partial(_same, lowered), shelf)


def _facts(key: str) -> Facts | None:
    """What is known of a model that was compiled before."""
    shelf = cache.shelf(key)
    known = None if shelf is None else shelf.read("facts")
    if shelf is None or known is None:
        return None
    shelf.use()
    return Facts.from_json(known)


def _functions(facts: Facts, model: Callable[[], Model], key: str) -> MomentFunctions:
    return MomentFunctions(facts, partial(_lowered_again, model, facts), cache.shelf(key))


def _lowered_again(model: Callable[[], Model], facts: Facts) -> LoweredSystem:
    delay = facts.delay
    gap = None if delay is None else delay.tracks[0].gaps[0]
    return _lowered_and_doubted(model(), None if gap is None else (gap.elements, gap.modes))[0]  # warned of already


def _lowered_and_doubted(model: Model, grid: Grid) -> tuple[LoweredSystem, tuple[str, ...]]:
    """Every symbolic stage, and what there is to warn of, which is due each time that the model is compiled."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ExpectationWarning)
        lowered = _lowered(model, grid)
    worst: dict[str, ExpectationWarning] = {}
    for each in caught:
        doubt = each.message
        if not isinstance(doubt, ExpectationWarning):
            warnings.warn_explicit(doubt, each.category, each.filename, each.lineno)
        elif doubt.where not in worst or doubt.error > worst[doubt.where].error:
            worst[doubt.where] = doubt
    return lowered, tuple(map(str, worst.values()))


def _warn_of(doubts: Iterable[str]) -> None:
    for doubt in doubts:
        warn(ExpectationWarning(doubt))


def _lowered(model: Model, grid: Grid) -> LoweredSystem:
    """Every symbolic stage, one after the other."""
    from cadet_sym.augmentation import augment
    from cadet_sym.linearisation import linearise
    from cadet_sym.lowering.measured import measured
    from cadet_sym.lowering.survey import survey
    from cadet_sym.lowering.system import lower
    from cadet_sym.moments import moment_equations
    from cadet_sym.solve.wheels import suitable_grid

    quasi_linear = linearise(augment(model))
    equations = moment_equations(quasi_linear, grid or CHOICES[0])
    if grid is None and equations.delay is not None:
        coarse = lower(equations)
        functions = MomentFunctions(survey(equations, coarse.parameters), partial(_same, coarse))
        values = model.parameter_values()
        p = np.array([float(values[name]) for name in functions.parameters])
        best = suitable_grid(functions, p, np.zeros(equations.packing.moments), model.number(model.run.duration))
        equations = moment_equations(quasi_linear, best)
    return lower(measured(equations))


# -- files ------------------------------------------------------------------------------------------------


def _shelf_of_file(path: Path, parameters: Mapping[str, Any], grid: Grid) -> cache.Shelf | None:
    """The entry of a model file; None if there is none, or the file is for `load` to complain about."""
    try:
        text = path.read_bytes()
        names = _strings(tomllib.loads(text.decode()))
        tables = [name.encode() + b"\0" + table for name in names if (table := _table(path.parent, name)) is not None]
    except (OSError, ValueError, RecursionError):
        return None
    values = json.dumps({name: str(value) for name, value in parameters.items()}, sort_keys=True)
    return cache.shelf(cache.digest("file", text, *tables, values, repr(grid)))


def _strings(value: Any) -> Iterator[str]:
    """Every text in a document."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list):
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from _strings(each)


def _table(folder: Path, name: str) -> bytes | None:
    """What is in the file of that name beside the model, if there is one: whatever the model may read."""
    try:
        place = folder / name
        return place.read_bytes() if place.is_file() else None
    except (OSError, ValueError):
        return None


def _read(path: Path, parameters: Mapping[str, Any]) -> Model:
    from cadet_sym.language.modelfile import load

    model = load(path)
    return model.with_parameters(parameters) if parameters else model


def _read_again(path: Path, parameters: Mapping[str, Any], expected: str) -> Model:
    model = _read(path, parameters)
    if model.hash != expected:
        raise ModelError("the file has changed since the model was compiled; compile it again", file=str(path))
    return model


def _same(thing: Any) -> Any:
    return thing
