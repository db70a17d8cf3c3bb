"""Products of matrices for machine code: in loops while they are small, else by the library that comes with SciPy.

At 64 rows that is three times as fast as loops; at two, its call takes as long as ten products.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from cadet_sym.cache import digest, shelf
from cadet_sym.lowering.kernel import Vector, kernel
from cadet_sym.lowering.machine import MachineCode, machine_code

__all__ = ["multiplication"]

FEW = 10
"""Rows up to which loops are the fastest."""


def by_rows(shape: Vector, A: Vector, B: Vector, out: Vector) -> int:
    """Set the first rows and columns of out = A B, n x n by rows; shape = (n, rows, columns)."""
    n = int(shape[0])
    columns = int(shape[2])
    for i in range(int(shape[1])):
        for j in range(columns):
            out[i * n + j] = 0.0
        for k in range(n):
            weight = A[i * n + k]
            for j in range(columns):
                out[i * n + j] += weight * B[k * n + j]
    return 0


# The library keeps matrices by columns: what it takes for B^T A^T, and writes as (A B)^T, is A B by rows.
TEXT = """
declare void @blas_dgemm(ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr)
@as_it_is = internal constant i8 78
@one = internal constant double 1.0
@nothing = internal constant double 0.0
define void @multiply(ptr %shape, ptr %A, ptr %B, ptr %out) nounwind {
  %whole = alloca <3 x i32>
  %given = load <3 x double>, ptr %shape, align 8
  %counts = fptosi <3 x double> %given to <3 x i32>
  store <3 x i32> %counts, ptr %whole
  %rows = getelementptr i32, ptr %whole, i64 1
  %columns = getelementptr i32, ptr %whole, i64 2
  call void @blas_dgemm(ptr @as_it_is, ptr @as_it_is, ptr %columns, ptr %rows, ptr %whole, ptr @one, ptr %B, ptr %whole,
                        ptr %A, ptr %whole, ptr @nothing, ptr %out, ptr %whole)
  ret void
}
"""


def multiplication(n: int) -> int:
    """Address of a function of (shape, A, B, out) that sets rows and columns of out = A B, n x n by rows (see `by_rows`)."""
    code, name = (_loops(), "by_rows") if n <= FEW else (_library(), "multiply")
    return code.addresses[name]


@cache
def _loops() -> MachineCode:
    return kernel(by_rows, fused=True)


@cache
def _library() -> MachineCode:
    from scipy.linalg import cython_blas

    library: Any = cython_blas
    capsule, python = library.__pyx_capi__["dgemm"], ctypes.pythonapi
    python.PyCapsule_GetName.restype, python.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    python.PyCapsule_GetPointer.restype = ctypes.c_void_p
    python.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    address = python.PyCapsule_GetPointer(capsule, python.PyCapsule_GetName(capsule))
    return machine_code(TEXT, "multiply", shelf=shelf(digest(TEXT)), symbols={"blas_dgemm": address})
