"""The models of the benchmarks: chains of any length with three nonlinear elements; non-stiff, stiff, like a car."""

from __future__ import annotations

import sympy as sp

import cadet_sym as cs

Z = sp.Symbol("z", real=True)
ELEMENTS = (
    cs.Element("cubic", [Z], Z**3),
    cs.Element("clearance", [Z], sp.Piecewise((Z - 1, Z > 1), (Z + 1, Z < -1), (0, True))),
    cs.Element("quadratic", [Z], Z * sp.Abs(Z)),
)


def names(letter: str, count: int) -> list[sp.Symbol]:
    return [sp.Symbol(f"{letter}{i + 1}", real=True) for i in range(count)]


def masses(n: int) -> cs.Model:
    """Non-stiff: n/2 equal masses in a row, springs of rate 1, white noise on each; n states."""
    count = n // 2
    x, v, w = names("x", count), names("v", count), names("w", count)
    places = {0, count // 2, count - 1}
    rates: dict[sp.Symbol, sp.Expr] = {}
    for i in range(count):
        left = x[i] - (x[i - 1] if i else 0)
        right = (x[i + 1] if i + 1 < count else 0) - x[i]
        force = right - left - sp.Rational(1, 5) * v[i]
        for place, element in zip(sorted(places), ELEMENTS, strict=False):
            if i == place:
                force -= sp.Rational(1, 10) * element(v[i] if element.name == "quadratic" else left)
        rates[x[i]], rates[v[i]] = v[i], force + w[i]
    return white(rates, w, f"masses {n}")


def relaxations(n: int) -> cs.Model:
    """Stiff: n first-order lags in a row, rates 1 .. 1e5; each is driven by noise and its neighbours."""
    x, w = names("x", n), names("w", n)
    speeds = [sp.Rational(round(10 ** (5 * i / (n - 1)), 6)) for i in range(n)]
    rates = {}
    for i in range(n):
        neighbour = (x[i - 1] if i else 0) + (x[i + 1] if i + 1 < n else 0)
        rates[x[i]] = speeds[i] * (-x[i] + neighbour / 4) + w[i]
    for i, element in zip((0, n // 3, n // 2), ELEMENTS, strict=True):
        rates[x[i]] -= speeds[i] / 10 * element(x[i] - (x[i - 1] if i else 0))
    return white(rates, w, f"relaxations {n}")


def car(n: int) -> cs.Model:
    """Like a car: a chain of n/2 masses whose suspension is stiffer towards the road, dampers with a quadratic part."""
    count = n // 2
    x, v, w = names("x", count), names("v", count), [sp.Symbol("w", real=True)]
    damper = cs.Element("damper", [Z], Z + Z * sp.Abs(Z) / 2)
    rates: dict[sp.Symbol, sp.Expr] = {}
    stiffness = [sp.Rational(round(40 + 2000 * (i / (count - 1)) ** 2, 3)) for i in range(count)]
    for i in range(count):
        force = -stiffness[i] * x[i] if i == count - 1 else 0
        if i:
            pull = damper(v[i] - v[i - 1]) if i <= 3 else v[i] - v[i - 1]
            force = force + stiffness[i - 1] * (x[i - 1] - x[i]) - 2 * pull
        if i + 1 < count:
            force = force + stiffness[i] * (x[i + 1] - x[i])
            force = force + 2 * (damper(v[i + 1] - v[i]) if i < 3 else v[i + 1] - v[i])
        rates[x[i]], rates[v[i]] = v[i], force + (w[0] if i == count - 1 else 0)
    return white(rates, w, f"car-like {n}")


def white(rates: dict[sp.Symbol, sp.Expr], noises: list[sp.Symbol], name: str) -> cs.Model:
    intensity = sp.ImmutableMatrix(sp.eye(len(noises)))
    noise = cs.Noise(names=tuple(w.name for w in noises), intensity=intensity)
    return cs.Model(cs.Vehicle(rates=rates), noise=noise, duration=20, points=21, name=name)


def damped(n: int) -> cs.Model:
    """Stiff: n/2 masses in a row on dampers to the ground, rates 1 .. 1e5, each driven by noise; n states."""
    count = n // 2
    x, v, w = names("x", count), names("v", count), names("w", count)
    speeds = [sp.Rational(round(10 ** (5 * i / (count - 1)), 6)) for i in range(count)]
    rates: dict[sp.Symbol, sp.Expr] = {}
    for i in range(count):
        stretch = x[i] - (x[i - 1] if i else 0)
        force = (x[i + 1] - x[i] if i + 1 < count else 0) - stretch - x[i] / 2
        rates[x[i]], rates[v[i]] = v[i], speeds[i] * (force - v[i]) + w[i]
    for i, element in zip((0, count // 2, count - 1), ELEMENTS, strict=True):
        rates[v[i]] -= speeds[i] / 10 * element(x[i] - (x[i - 1] if i else 0))
    return white(rates, w, f"damped {n}")
