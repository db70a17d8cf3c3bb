"""Backward differentiation formulas as machine code: for what is stiff and of moderate size.

The modal form of N, which the inverse of `backward` is made of, comes from LAPACK; the machine code returns whenever it
wants another one.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cadet_sym.lowering.blas import multiplication
from cadet_sym.lowering.functions import MomentFunctions
from cadet_sym.lowering.kernel import kernel
from cadet_sym.memory import Memory
from cadet_sym.solve.backward import HEAD, PROCEDURES, REFRESH, STATE, room_of
from cadet_sym.solve.breakdown import STALLED, Breakdown, settled
from cadet_sym.solve.evaluate import behind, gains
from cadet_sym.solve.implicit import scaled_form
from cadet_sym.solve.lyapunov import ModalForm
from cadet_sym.solve.native import MANY, aligned_zeros
from cadet_sym.solve.scales import Tolerance
from cadet_sym.solve.threads import one_thread

__all__ = ["MANY_STATES", "ModalArrays", "Stiff", "bdf_compiles", "modal_arrays"]

Array = npt.NDArray[np.float64]

MANY_STATES = 100
"""States up to which what is called between steps is most of the work elsewhere."""

STEPS = 20_000
"""Most steps of a stretch: more means that the gains react so strongly that other ways are better ..."""

FORMS, SHARE = 200, 0.25
"""... and so do more modal forms than this, and this share of the steps."""


@dataclass
class Stiff:
    """The moment equations of one run under backward differentiation formulas of order 1 to 5."""

    lowered: MomentFunctions
    p: Array
    tolerance: Tolerance
    steps: int = field(default=0, init=False)
    name = "BDF (Newton + Lyapunov), machine code"
    stiff = True
    reacting = False  # whether gains react so strongly that no earlier step tells how Newton's method converges

    def advance(self, begin: float, y: Array, grid: Array) -> Array:
        """Packed moments (k, size) at the times of the grid, from y at `begin`."""
        begin = behind(begin)
        rate = self._rate()
        n, size = self.lowered.facts.packing.n, len(y)
        x, given, times = y.copy(), self._given(), np.ascontiguousarray(grid, dtype=float)
        work = aligned_zeros(room_of(size, n))
        found, state, sizes = np.empty((len(grid), size)), np.zeros(STATE), np.ascontiguousarray(self.tolerance.size)
        state[0], latest, status = begin, np.nextafter(times[-1], begin), REFRESH
        forms, most = 0, min(STEPS, self.tolerance.steps)
        while status == REFRESH:
            forms += 1
            if forms > FORMS + SHARE * state[4]:
                status = STALLED
                break
            form = self._form(float(state[0]), x)
            state[8], state[9], state[12:] = 1.0, -1.0, (0.0, float(self.reacting), 0.0)
            with one_thread(n):
                status = _carry()(
                    rate, multiplication(n), times.ctypes.data, len(times), x.ctypes.data,
                    size, n, given.ctypes.data, sizes.ctypes.data, self.tolerance.relative, self.tolerance.absolute, latest,
                    most, form.matrices.ctypes.data, form.modes.ctypes.data, form.pairs, work.ctypes.data,
                    found.ctypes.data, state.ctypes.data, self.blocks,
                )  # fmt: skip
        self.steps += int(state[4])
        return settled(found, status, int(state[7]), float(state[0]), work[HEAD : HEAD + size].copy())

    @property
    def blocks(self) -> int:
        """Vectors of as many entries as there are moments, of which y consists."""
        return 1

    def _rate(self) -> int:
        """The address of the rate."""
        code = self.lowered.machine("rate")
        assert code is not None, "chosen only where there is machine code"
        return code.addresses["rate"]

    def _given(self) -> Array:
        """What the rate takes for parameters."""
        return np.append(self.p, 0.0)

    def _seen(self, y: Array) -> Array:
        """Packed moments as the elements see them."""
        return y

    def _form(self, t: float, y: Array) -> ModalArrays:
        """The modal form of N at packed moments y, as `backward` takes it."""
        packing = self.lowered.facts.packing
        rows, columns = packing.triangle
        scale = np.sqrt(np.maximum(self.tolerance.size[packing.n : packing.moments][rows == columns], 1e-300))
        N = gains(self.lowered, t, self._seen(y), self.p)
        if not np.isfinite(N).all():
            raise Breakdown("The equivalent gains are not finite.")
        return _forms(self.lowered, N.tobytes() + scale.tobytes(), lambda: modal_arrays(scaled_form(N, scale), scale))


_forms: Memory[ModalArrays] = Memory(8)
"""Of the last few N: runs that begin alike begin with the same, which takes as long as twenty steps to make."""


def bdf_compiles(lowered: MomentFunctions) -> bool:
    """Whether there is machine code of these formulas for a model."""
    facts = lowered.facts
    return facts.delay is None and facts.packing.n <= MANY_STATES and lowered.machine("rate") is not None


class ModalArrays(NamedTuple):
    """A modal form as `backward` takes it."""

    matrices: Array  # W^-1, its transpose, W, its transpose, in units of the states
    modes: Array  # real parts, absolute imaginary parts, signs within the pairs, partners
    pairs: int  # 1 if there are any


def modal_arrays(form: ModalForm, scale: Array) -> ModalArrays:
    """N = W B W^-1 in units of the states' sizes as flat arrays."""
    n = len(scale)
    partner, sign = np.arange(n, dtype=float), np.zeros(n)
    partner[form.first], partner[form.first + 1] = form.first + 1, form.first
    sign[form.first], sign[form.first + 1] = 1.0, -1.0
    left, right, values = form.inverse / scale, scale[:, None] * form.basis, form.eigenvalues
    matrices = aligned_zeros(4 * n * n)
    np.concatenate([part.ravel() for part in (left, left.T, right, right.T)], out=matrices)
    return ModalArrays(
        matrices,
        np.concatenate([np.real(values), np.abs(np.imag(values)), sign, partner]),
        int(sign.any()),
    )


@cache
def _carry() -> Any:
    """The integrator; the same machine code for all models."""
    vector, number, integer = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
    types = (vector, vector, vector, integer, vector, integer, integer, vector, vector, number, number, number, integer)
    more = (vector, vector, integer, vector, vector, vector, integer)
    return kernel(*PROCEDURES, fused=True, lanes=MANY).function("carry", *types, *more, returns=integer)
