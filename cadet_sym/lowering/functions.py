"""The functions of a compiled model: read from the cache, or made of the moment equations when first asked for.

A model that was compiled before brings its functions with it: its moment equations are written again, in SymPy, only if
something is asked for that was never made.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca

from cadet_sym.cache import Shelf
from cadet_sym.lowering.carried import WIDEST, carried_code, head
from cadet_sym.lowering.facts import Facts
from cadet_sym.lowering.llvm import intermediate
from cadet_sym.lowering.machine import MachineCode, available, machine_code
from cadet_sym.lowering.operations import size
from cadet_sym.lowering.scalars import is_casadis
from cadet_sym.lowering.structured import structured_rate

if TYPE_CHECKING:
    from cadet_sym.lowering.system import LoweredSystem
    from cadet_sym.moments import MomentEquations

__all__ = ["MomentFunctions", "is_small"]

PAYS = 2500
"""Evaluations in CasADi's virtual machine that take as long as it takes to make machine code."""

SMALL = 2000
"""Operations of a function, and of those that it calls, up to which thorough machine code takes a tenth of a second ..."""

CALLING = 5000
"""... the same of functions that call others in loops, where it takes a third of a second and is worth it ..."""

LARGE = 20_000
"""... up to which some machine code takes half a second ..."""

LARGE_CALLING = 60_000
"""... the same of functions that call others in loops, where it takes a second and saves as much in every run ..."""

LARGEST = 200_000
"""... and up to which it takes seconds, and is made only where that is asked for."""


def _kept(make: Callable[[MomentFunctions], ca.Function]) -> cached_property[ca.Function]:
    """A function that is read from the cache, or else made, and kept there."""
    name = make.__name__

    def read(self: MomentFunctions) -> ca.Function:
        if (known := self.read(name)) is not None:
            return known
        made = make(self)
        self.write(name, made)
        return made

    read.__doc__ = make.__doc__
    return cached_property(read)


def is_small(function: ca.Function) -> bool:
    """Whether thorough machine code is worth its time."""
    return size(function) <= (CALLING if function.find_functions() else SMALL)


class MomentFunctions:
    """The moment equations as CasADi functions of t, the packed moments y, the parameters p, and ctx = [t, s, V, V'].

    Parameters
    ----------
    facts : what there is to know of them.
    make : gives the moment equations, lowered; called when they are needed.
    shelf : where functions are kept, if anywhere.
    """

    def __init__(self, facts: Facts, make: Callable[[], LoweredSystem], shelf: Shelf | None = None) -> None:
        self.facts, self._make, self._shelf = facts, make, shelf
        self.jit = False  # whether machine code is worth seconds
        self._machine: dict[str, MachineCode | None] = {}
        self._outputs_asked_for = 0

    @cached_property
    def symbolic(self) -> LoweredSystem:
        """The moment equations in symbols, and the environment that turns expressions in them into CasADi's."""
        return self._make()

    def unrolled(self) -> MomentFunctions:
        """The same made of scalar operations alone."""
        lowered = self.symbolic.unrolled()
        return self if lowered is self.symbolic else MomentFunctions(self.facts, lambda: lowered)

    @property
    def calls(self) -> bool:
        """Whether the rate calls other functions, which find the order of a quadrature by themselves."""
        return bool((self.ingredients if self.large else self.rate).find_functions())

    @property
    def equations(self) -> MomentEquations:
        """The moment equations in symbols; through them every earlier stage."""
        return self.symbolic.equations

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the entries of p."""
        return self.facts.parameters

    def read(self, name: str) -> ca.Function | None:
        """A function from the cache; None if it is not there."""
        text = None if self._shelf is None else self._shelf.read(f"{name}.casadi")
        if text is None:
            return None
        with contextlib.suppress(RuntimeError, ValueError):
            return ca.Function.deserialize(text.decode())
        return None

    def write(self, name: str, function: ca.Function) -> None:
        """Keep a function in the cache."""
        if self._shelf is not None:
            self._shelf.write(f"{name}.casadi", function.serialize().encode())

    def machine(self, name: str) -> MachineCode | None:
        """One of the functions as machine code; None where that is not to be had, or takes long and was not asked for."""
        if name not in self._machine:
            self._machine[name] = self._compiled(name)
        return self._machine[name]

    def machine_outputs(self, times: int) -> MachineCode | None:
        """`outputs` as machine code, once that pays; to be evaluated so many times.

        At once where that gives other last digits than CasADi: no result depends on what ran before.
        """
        self._outputs_asked_for += times
        pays = self._outputs_asked_for > PAYS or (available() and not self._outputs_are_casadis)
        return self.machine("outputs") if pays else None

    @cached_property
    def _outputs_are_casadis(self) -> bool:
        return is_casadis(self.outputs)

    def _compiled(self, name: str) -> MachineCode | None:
        if name == "rate" and self.large:
            return self.machine_in_products(name)
        if name != "outputs" and self.in_loops:
            head = getattr(self, f"{name}_head")
            return self.machine_of(head, name, lambda: carried_code(self, head, name))
        return self.machine_of(getattr(self, name), name)

    def machine_in_products(self, name: str, directions: ca.SX | None = None) -> MachineCode | None:
        """The rate of a large model, and of its derivatives along directions of p, made of products of matrices."""
        return structured_rate(self.ingredients, self._shelf, name, directions) if available() else None

    def machine_of(self, function: ca.Function, name: str, text: Callable[[], str] | None = None) -> MachineCode | None:
        """A function made of these, or what stands in `text` for it, as machine code kept under a name; None as above."""
        if not available() or size(function) > self.longest(function):
            return None
        thorough = self.jit or is_small(function)
        with contextlib.suppress(ValueError):  # an operation that only CasADi knows
            return machine_code(text or (lambda: intermediate(function, name)), name, shelf=self._shelf, effort=int(thorough))
        return None

    def longest(self, function: ca.Function) -> int:
        """Operations up to which a function like this one is worth making machine code of."""
        return LARGEST if self.jit else LARGE_CALLING if function.find_functions() else LARGE

    @property
    def in_loops(self) -> bool:
        """Whether machine code goes over the ground between wheels in loops."""
        return self.facts.delay is not None and self.facts.delay.rows <= WIDEST

    @cached_property
    def large(self) -> bool:
        """Whether the rate is best written as products of matrices."""
        return self.facts.delay is None and 2 * self.gain_matrix.nnz_out(0) * self.facts.packing.n > LARGE

    @_kept
    def ingredients(self) -> ca.Function:
        """(t, y, p) -> mu', N and D, of which the rate is made."""
        return self.symbolic.ingredients

    @_kept
    def rate(self) -> ca.Function:
        """(t, y, p) -> dy/dt of the packed moments."""
        return self.symbolic.rate

    @_kept
    def jacobian(self) -> ca.Function:
        """(t, y, p) -> d(dy/dt)/dy, sparse."""
        return self.symbolic.jacobian

    @_kept
    def held_rate(self) -> ca.Function:
        """(t, s, V, y, p) -> dy/dt at a constant speed, wheels all on the ground."""
        return self.symbolic.held_rate

    @_kept
    def free_entries(self) -> ca.Function:
        """() -> the packed moments that do not stay as they are at the start."""
        from cadet_sym.lowering.held import free_entries

        return free_entries(self)

    @_kept
    def free_rate(self) -> ca.Function:
        """(t, y free, [p; y held]) -> dy/dt of the free moments."""
        from cadet_sym.lowering.held import free_rate

        return free_rate(self)

    @_kept
    def resting_rate(self) -> ca.Function:
        """(t, y, [p; d^2]) -> dy/dt, elements seeing at least the deviations d of the states."""
        from cadet_sym.lowering.resting import resting_rate

        return resting_rate(self)

    @_kept
    def parts(self) -> ca.Function:
        """(t, y, p) -> dy/dt of what goes before the ground between the wheels, N, and what moves that ground."""
        return self.symbolic.parts

    @_kept
    def rate_head(self) -> ca.Function:
        """(t, y, [p; y known]) -> dy/dt of what goes before the ground between the wheels, and what moves that ground."""
        return head(self, free=False)

    @_kept
    def free_rate_head(self) -> ca.Function:
        """(t, y free, [p; y held]) -> the same of the free moments."""
        return head(self, free=True)

    @_kept
    def outputs(self) -> ca.Function:
        """(t, y, p) -> means and variances of the outputs."""
        return self.symbolic.outputs

    @_kept
    def outputs_at(self) -> ca.Function:
        """(y, ctx, p) -> means and variances of the outputs, speed and time given."""
        return self.symbolic.outputs_at

    @_kept
    def output_rows(self) -> ca.Function:
        """(ctx, p) -> for every output, the linear forms of the state that it depends on, (rows, n) each."""
        return self.symbolic.output_rows

    @_kept
    def motion(self) -> ca.Function:
        """(t, p) -> speed, its rate, the distance where it is known in closed form (else 0), and that at the start."""
        return self.symbolic.motion

    @_kept
    def linear(self) -> ca.Function:
        """(ctx, p) -> A, c, b, C, d, D of mu' = A mu + c + b F, z = C mu + d, wheels all on the ground."""
        return self.symbolic.linear

    @_kept
    def elements(self) -> ca.Function:
        """(theta, ctx, p) -> F, gain, dF/dtheta, dgain/dtheta; theta = [z means; covariances element by element]."""
        return self.symbolic.elements

    @_kept
    def gain_matrix(self) -> ca.Function:
        """(y, ctx, p) -> N = E[df/dx] at packed means and covariances, wheels all on the ground."""
        return self.symbolic.gain_matrix

    @_kept
    def noise(self) -> ca.Function:
        """(ctx, p) -> noise input b (n, m), intensity Q (m, m) and the setback of each column (m)."""
        return self.symbolic.noise

    @_kept
    def initial(self) -> ca.Function:
        """P -> the packed moments at the start, where the ground is stationary or flat."""
        from cadet_sym.lowering.initial import initial_moments

        return initial_moments(self.symbolic)

    @_kept
    def vehicle_start(self) -> ca.Function:
        """P -> offset (nv), map (nv, nf), covariance (nv, nv) of the vehicle's initial state."""
        from cadet_sym.lowering.initial import vehicle_start

        return vehicle_start(self.symbolic)

    @_kept
    def filters(self) -> ca.Function:
        """P -> C of every copy of the ground's filter where it stands at the start."""
        from cadet_sym.lowering.initial import filters

        return filters(self.symbolic)

    @_kept
    def unevenness(self) -> ca.Function:
        """P -> how unlike the ground is under the wheels of one track at the start."""
        from cadet_sym.lowering.initial import unevenness

        return unevenness(self.symbolic)

    @_kept
    def profiles(self) -> ca.Function:
        """(s, p) -> C and offset of every copy of the ground's filter, one after the other, at places on the ground."""
        from cadet_sym.lowering.initial import profiles

        return profiles(self.symbolic)

    @_kept
    def places(self) -> ca.Function:
        """P -> setback of every copy of the ground's filter, places of the edges of the ground's profile."""
        from cadet_sym.lowering.initial import places

        return places(self.symbolic)

    @_kept
    def switches(self) -> ca.Function:
        """(t, s, p) -> (functions of t alone, functions of s too): a change of sign of any is a breakpoint."""
        from cadet_sym.lowering.switches import switch_functions

        return switch_functions(self.symbolic)
