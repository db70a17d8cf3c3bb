"""Complex arithmetic on pairs of CasADi expressions; what is real stays one expression."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


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
