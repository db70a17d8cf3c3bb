"""Random numbers that belong to a path, whatever thread, chunk or machine it runs on.

Every path has its own streams of normal deviates, one a purpose (initial state, noise in time, each track). A stream
is SplitMix64 with an increment of its own: draw k is mix(start + k gamma), start and gamma being hashed from the
seed, the path and the purpose (Steele, Lea & Flood, OOPSLA 2014; mix is Stafford's variant 13). Bits become a normal
deviate by the ziggurat of 256 layers (Marsaglia & Tsang, J. Stat. Softw. 5(8), 2000), layer, sign and place taken
from different bits (Doornik 2005). A draw that the ziggurat rejects, one in ninety, goes on with bits hashed from its
own: it takes one draw of the stream whatever happens, so that NumPy and the compiled kernel stay in step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cadet_sym.simulation.tables import StartTables

__all__ = ["BASE", "GOLDEN", "HEIGHT", "MIX", "TAIL", "WIDTH", "Streams", "start_values", "ziggurat"]

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_GAMMA = (np.uint64(0xFF51AFD7ED558CCD), np.uint64(0xC4CEB9FE1A85EC53))
_ALTERNATING = np.uint64(0xAAAAAAAAAAAAAAAA)
_PURPOSES = np.uint64(1 << 12)  # streams a path can have

LAYERS = 256
TAIL = 3.6541528853610088  # right edge of the lowest layer
_AREA = 0.00492867323399  # of each layer
BASE = 2.0**-53


def _layers() -> tuple[np.ndarray, np.ndarray]:
    """Right edges x_0 > x_1 = TAIL > ... > x_256 = 0 of the layers, and exp(-x^2/2) there."""
    x = np.zeros(LAYERS + 1)
    x[0], x[1] = _AREA * np.exp(0.5 * TAIL**2), TAIL
    for i in range(2, LAYERS):
        x[i] = np.sqrt(-2.0 * np.log(_AREA / x[i - 1] + np.exp(-0.5 * x[i - 1] ** 2)))
    return x, np.exp(-0.5 * x**2)


WIDTH, HEIGHT = _layers()


def _mix(z: Any) -> Any:
    z = (z ^ (z >> np.uint64(30))) * MIX[0]
    z = (z ^ (z >> np.uint64(27))) * MIX[1]
    return z ^ (z >> np.uint64(31))


def _mix_gamma(z: np.ndarray) -> np.ndarray:
    """An odd increment whose bits change often enough (Steele, Lea & Flood 2014, section 5)."""
    z = (z ^ (z >> np.uint64(33))) * _GAMMA[0]
    z = (z ^ (z >> np.uint64(33))) * _GAMMA[1]
    z = (z ^ (z >> np.uint64(33))) | np.uint64(1)
    few = np.bitwise_count(z ^ (z >> np.uint64(1))) < 24
    return np.where(few, z ^ _ALTERNATING, z)


@dataclass
class Streams:
    """One stream a path for one purpose: `state` moves on with every draw, `gamma` stays."""

    state: np.ndarray  # (paths,) uint64
    gamma: np.ndarray  # (paths,) uint64

    @classmethod
    def of(cls, seed: int, first: int, count: int, purpose: int) -> Streams:
        """Streams of the paths first .. first + count - 1."""
        root = np.random.SeedSequence(seed).generate_state(2, np.uint64)
        with np.errstate(over="ignore"):
            number = np.arange(first + 1, first + count + 1, dtype=np.uint64) * _PURPOSES + np.uint64(purpose)
            return cls(_mix(root[0] + number * GOLDEN), _mix_gamma(root[1] + number * GOLDEN))

    def normals(self, count: int) -> np.ndarray:
        """Draw `count` standard normal deviates a path: (count, paths)."""
        with np.errstate(over="ignore"):
            steps = np.arange(1, count + 1, dtype=np.uint64)[:, None] * self.gamma
            bits = _mix(self.state + steps)
            self.state = self.state + np.uint64(count) * self.gamma
        return ziggurat(bits)


def start_values(start: StartTables, streams: list[Streams]) -> tuple[np.ndarray, np.ndarray]:
    """What is drawn before the first step: the vehicle apart from the ground, and the ground behind all wheels.

    Returns
    -------
    (rows, paths), and (filter states of all tracks, paths).
    """
    vehicle = start.offset[:, None] + start.root @ streams[0].normals(len(start.offset))
    delta = np.where(start.rows[:, None] >= 0, vehicle[start.rows], 0.0)
    behind = [root @ stream.normals(len(root)) for root, stream in zip(start.ground, streams[2:], strict=True)]
    return delta, np.concatenate([delta[:0], *behind])


def ziggurat(bits: np.ndarray) -> np.ndarray:
    """A standard normal deviate from each 64 random bits."""
    layer = (bits & np.uint64(255)).astype(np.int64)
    z = (bits >> np.uint64(11)).astype(float) * (WIDTH * BASE)[layer]
    sign = 1.0 - 2.0 * ((bits >> np.uint64(8)) & np.uint64(1)).astype(float)
    z *= sign
    rejected = np.abs(z) >= WIDTH[layer + 1]
    with np.errstate(over="ignore"):
        z[rejected] = [_resume(b) for b in bits[rejected]]
    return z


def _unit(bits: Any) -> float:
    """A number inside (0, 1)."""
    return (float(bits >> np.uint64(11)) + 0.5) * BASE


def _resume(bits: Any) -> float:
    """What a draw that missed its layer's inner rectangle becomes: the wedge, the tail, or another draw."""
    while True:
        layer = int(bits & np.uint64(255))
        x = float(bits >> np.uint64(11)) * (WIDTH[layer] * BASE)
        sign = -1.0 if bits & np.uint64(256) else 1.0
        if x < WIDTH[layer + 1]:
            return sign * x
        if layer == 0:
            while True:
                bits = _mix(bits + GOLDEN)
                a = -np.log(_unit(bits)) / TAIL
                bits = _mix(bits + GOLDEN)
                if -2.0 * np.log(_unit(bits)) > a * a:
                    return sign * (TAIL + a)
        u = _unit(_mix(bits ^ GOLDEN))
        if HEIGHT[layer] + u * (HEIGHT[layer + 1] - HEIGHT[layer]) < np.exp(-0.5 * x * x):
            return sign * x
        bits = _mix(bits + GOLDEN)
