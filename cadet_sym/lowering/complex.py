"""Complex arithmetic on pairs of CasADi expressions; what is real stays one expression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import casadi as ca
import sympy as sp


@dataclass(frozen=True)
class Complex:
    """real + i imaginary; `imaginary` is None for a real number."""

    real: ca.SX
    imaginary: ca.SX | None = None

    def __add__(self, other: Complex) -> Complex:
        if self.imaginary is None or other.imaginary is None:
            imaginary = other.imaginary if self.imaginary is None else self.imaginary
        else:
            imaginary = self.imaginary + other.imaginary
        return Complex(self.real + other.real, imaginary)

    def __neg__(self) -> Complex:
        return Complex(-self.real, None if self.imaginary is None else -self.imaginary)

    def __sub__(self, other: Complex) -> Complex:
        return self + (-other)

    def __mul__(self, other: Complex | ca.SX | float) -> Complex:
        if not isinstance(other, Complex):
            return Complex(self.real * other, None if self.imaginary is None else self.imaginary * other)
        if other.imaginary is None:
            return self * other.real
        if self.imaginary is None:
            return other * self.real
        return Complex(
            self.real * other.real - self.imaginary * other.imaginary,
            self.real * other.imaginary + self.imaginary * other.real,
        )

    def inverse(self) -> Complex:
        """1/z."""
        if self.imaginary is None:
            return Complex(1 / self.real)
        size = self.size_squared()
        return Complex(self.real / size, -self.imaginary / size)

    def size_squared(self) -> ca.SX:
        """|z|^2."""
        if self.imaginary is None:
            return self.real * self.real
        return self.real * self.real + self.imaginary * self.imaginary


def converted(expr: sp.Expr, real: Callable[[sp.Basic], ca.SX]) -> Complex:
    """An expression in real symbols and the imaginary unit; `real` converts what is real."""
    if not expr.has(sp.I):
        return Complex(real(expr))
    if expr == sp.I:
        return Complex(ca.SX(0), ca.SX(1))
    if isinstance(expr, sp.Add):
        return reduce(lambda a, b: a + b, (converted(term, real) for term in expr.args))
    if isinstance(expr, sp.Mul):
        plain, rest = expr.as_independent(sp.I, as_Add=False)
        factors = (converted(factor, real) for factor in sp.Mul.make_args(rest))
        return reduce(lambda a, b: a * b, factors) * real(plain)
    if isinstance(expr, sp.exp):
        return complex_exp(converted(expr.args[0], real))
    if isinstance(expr, sp.Pow) and expr.exp.is_Integer:
        power = reduce(lambda a, b: a * b, [converted(expr.base, real)] * abs(int(expr.exp)))
        return power if expr.exp > 0 else power.inverse()
    if isinstance(expr, sp.Piecewise):
        *branches, (value, _) = expr.args
        result = converted(value, real)
        for value, condition in reversed(branches):
            result = select(real(condition), converted(value, real), result)
        return result
    parts = expr.as_real_imag()
    return Complex(*(real(part) for part in parts))


def complex_exp(z: Complex) -> Complex:
    """exp(z)."""
    size = ca.exp(z.real)
    if z.imaginary is None:
        return Complex(size)
    return Complex(size * ca.cos(z.imaginary), size * ca.sin(z.imaginary))


def select(condition: ca.SX, first: Complex, second: Complex) -> Complex:
    """`first` where the condition holds, else `second`."""
    real = ca.if_else(condition, first.real, second.real)
    if first.imaginary is None and second.imaginary is None:
        return Complex(real)
    a = ca.SX(0) if first.imaginary is None else first.imaginary
    b = ca.SX(0) if second.imaginary is None else second.imaginary
    return Complex(real, ca.if_else(condition, a, b))
