"""Turn LLVM's intermediate language into machine code, and keep it in the cache. No compiler needs to be there.

The compiler is the one that numba brings. Code is found by the digest of its text, the processor and the compiler's
version, so that it is never out of date or meant for another machine.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from cadet_sym.cache import Shelf

__all__ = ["MachineCode", "address", "available", "machine_code"]


@dataclass(frozen=True)
class MachineCode:
    """Functions in memory, by name; they live as long as this record does."""

    addresses: Mapping[str, int]
    _engine: Any

    def function(self, name: str, *types: Any, returns: Any = None) -> Any:
        """A function to be called with ctypes' types; it keeps this record alive."""
        function: Any = ctypes.CFUNCTYPE(returns, *types)(self.addresses[name])
        function.code = self
        return function


def address(memory: Any) -> int:
    """Where an array's numbers are; five times as fast as NumPy says it, which counts in short runs."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(memory))
    except (TypeError, ValueError):  # read-only, or empty
        return memory.ctypes.data


@cache
def available() -> bool:
    """Whether LLVM is there and knows this machine."""
    try:
        _target(0)
    except (ImportError, OSError, RuntimeError):
        return False
    return True


def machine_code(
    text: str | Callable[[], str],
    *names: str,
    shelf: Shelf | None = None,
    effort: int = 1,
    symbols: Mapping[str, int] | None = None,
) -> MachineCode:
    """The functions of a module in LLVM's intermediate language.

    Parameters
    ----------
    text : or what writes it, where the shelf has nothing else of these names; it is then read without its being written.
    names : of the functions wanted.
    shelf : where the code is kept, if anywhere.
    effort : 0 compiles six times as fast as 1 to code half as fast; 1 is for long stretches of arithmetic; 2 is for loops.
    symbols : addresses of functions that are elsewhere, by the names that the text declares.
    """
    import llvmlite.binding as llvm

    written = text if isinstance(text, str) else ""
    made_of = "\n".join([written, str(effort), llvm.get_host_cpu_name(), str(llvm.llvm_version_info)])
    name = f"{names[0]}-{hashlib.sha256(made_of.encode()).hexdigest()[:24]}.o"
    code = None if shelf is None else shelf.read(name)
    if code is None:
        code = _compiled(text if isinstance(text, str) else text(), effort)
        if shelf is not None:
            shelf.write(name, code)
    for each, address in (symbols or {}).items():
        llvm.add_symbol(each, address)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target(effort))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return MachineCode({each: engine.get_function_address(each) for each in names}, engine)


def _compiled(text: str, effort: int) -> bytes:
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(text)
    machine = _target(effort)
    if effort > 1:
        options = llvm.create_pipeline_tuning_options(speed_level=2)
        options.loop_unrolling, options.slp_vectorization, options.inlining_threshold = False, False, 0  # cost, no gain
        passes = llvm.create_pass_builder(machine, options)
        passes.getModulePassManager().run(module, passes)
    return machine.emit_object(module)


def _target(effort: int) -> Any:
    """The machine to compile for; an engine takes the one that it is given with it when it goes."""
    import llvmlite.binding as llvm

    _prepare()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=2 * min(effort, 1), jit=True
    )


@cache
def _prepare() -> None:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if (library := ctypes.util.find_library("m")) is not None:  # where the C library keeps its functions apart
        llvm.load_library_permanently(library)
