"""A measured road, as profile or spectrum, to the shaping filter that fits it best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cadet_sym.errors import ModelError
from cadet_sym.language.ground import Ground, sections
from cadet_sym.language.names import exact

_LINES = 32  # points on the logarithmic axis that a spectrum is averaged to
_LEAST = 64  # rows of a profile
_DIGITS = 6  # of fitted numbers: enough for any road, few enough to be the same whatever a machine's rounding is
_DAMPING = (0.02, 20.0)


@dataclass(frozen=True, eq=False)
class RoadFit:
    """A shaping filter fitted to a one-sided density against rad per length.

    Parameters
    ----------
    wavenumber, density, fitted : (k,) rad per length; length^3 per rad: measured, and the filter's.
    ground : the `Ground` of the fitted filter.
    order : of the filter.
    error : rms of log10(fitted / density), in decades.
    """

    wavenumber: np.ndarray
    density: np.ndarray
    fitted: np.ndarray
    ground: Ground
    order: int
    error: float

    def plot(self, path: Any) -> None:
        """Draw data against fit into a file."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 4.4), layout="constrained")
        axes = figure.subplots()
        axes.loglog(self.wavenumber, self.density, ".", label="measured")
        axes.loglog(self.wavenumber, self.fitted, "-", label=f"filter of order {self.order}")
        axes.set_xlabel("wavenumber, rad/m")
        axes.set_ylabel("one-sided density, m$^3$/rad")
        axes.set_title(f"rms difference {self.error:.2g} decades")
        axes.legend()
        figure.savefig(path)


def fit_profile(distance: Any, height: Any, order: int = 2) -> RoadFit:
    """Fit a filter to a measured profile by way of its Welch spectrum.

    Parameters
    ----------
    distance, height : (n,) at equal steps, units of length.
    order : of the filter.

    Raises
    ------
    ModelError : rows missing or not equally spaced, naming the row; too few rows; a flat road.
    """
    s, h = np.asarray(distance, float), np.asarray(height, float)
    if s.ndim != 1 or s.shape != h.shape or not (np.isfinite(s).all() and np.isfinite(h).all()):
        raise ModelError("a profile is two columns of finite numbers of one length")
    if s.size < _LEAST:
        raise ModelError(f"a profile of {s.size} rows, and {_LEAST} or more are needed for its spectrum")
    steps = np.diff(s)
    step = float(np.median(steps))
    off = np.flatnonzero(np.abs(steps - step) > 1e-3 * abs(step))
    if step <= 0 or off.size:
        row = int(off[0]) + 2 if off.size else 2
        raise ModelError(
            f"the profile is not sampled at equal steps: {steps[row - 2]:.6g} before row {row} (at {s[row - 1]:.6g}), "
            f"and {step:.6g} elsewhere; fill the gap or resample it"
        )
    wavenumber, density, weight = welch(h, step)
    return _fit(wavenumber, density, weight, order)


def fit_spectrum(wavenumber: Any, density: Any, order: int = 2) -> RoadFit:
    """Fit a filter to a measured one-sided spectrum: rad per length, length^3 per rad."""
    kappa, G = np.asarray(wavenumber, float), np.asarray(density, float)
    if kappa.ndim != 1 or kappa.shape != G.shape or kappa.size < 2 * order:
        raise ModelError(f"a spectrum of {kappa.size} rows is too short for a filter of order {order}")
    bad = np.flatnonzero(~((kappa > 0) & (G > 0) & np.isfinite(kappa) & np.isfinite(G)))
    if bad.size:
        k = int(bad[0])
        raise ModelError(f"wavenumbers and densities are positive: {kappa[k]:.6g}, {G[k]:.6g} in row {k + 1}")
    return _fit(kappa, G, np.ones_like(G), order)


def welch(height: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One-sided density against rad per length, averaged on a logarithmic axis, with the weight of each point.

    Hann windows over a quarter of the road each, half overlapping, straight lines removed; the lowest two lines, which
    the window smears, and wavenumbers above a quarter of the Nyquist limit, where sampling folds some of the spectrum
    back, are left out.
    """
    n = 2 * (height.size // 8)
    window = np.hanning(n + 1)[:n]
    x = np.arange(n) - (n - 1) / 2
    power = np.zeros(n // 2 + 1)
    starts = range(0, height.size - n + 1, n // 2)
    for start in starts:
        part = height[start : start + n]
        part = part - part.mean() - x * (x @ part) / (x @ x)
        power += np.abs(np.fft.rfft(window * part)) ** 2
    density = power / len(starts) * 2 * step / (window @ window) / (2 * np.pi)
    kappa = 2 * np.pi * np.fft.rfftfreq(n, step)
    keep = slice(2, max(6, n // 8))
    kappa, density = kappa[keep], density[keep]
    if not density.any():
        raise ModelError("the profile is flat: there is nothing to fit a filter to")
    bins = np.digitize(np.log(kappa), np.linspace(np.log(kappa[0]), np.log(kappa[-1]) + 1e-9, _LINES + 1))
    groups = [bins == b for b in np.unique(bins)]
    centres = np.array([np.exp(np.log(kappa[g]).mean()) for g in groups])
    # averaged as density times kappa^2, which varies little within a group
    means = np.array([(density[g] * kappa[g] ** 2).mean() for g in groups]) / centres**2
    return centres, means, np.sqrt([float(g.sum()) for g in groups])


def _fit(kappa: np.ndarray, density: np.ndarray, weight: np.ndarray, order: int) -> RoadFit:
    """Least squares in the logarithm of the density, poles and zeros in pairs (wavenumber, damping)."""
    if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= 8:
        raise ModelError(f"a filter of order 1 to 8 is wanted, not {order!r}", table="ground", key="order")
    from scipy.optimize import least_squares

    target = np.log(density)
    shape = _Shape(order)
    low, high = np.log(kappa[0]), np.log(kappa[-1])

    beyond, expected = _beyond(kappa, density)

    def residual(theta: np.ndarray) -> np.ndarray:
        inside = (shape.log_density(theta, kappa) - target) * weight
        return np.concatenate([inside, shape.log_density(theta, beyond) - expected])

    best = None
    for share in (0.1, 0.4, 0.7):
        start = shape.start(low, high, share)
        start[-1] += np.mean(target - shape.log_density(start, kappa))
        bounds = shape.bounds(low, high)
        found = least_squares(residual, np.clip(start, *bounds), bounds=bounds, x_scale="jac", jac="cs")
        if best is None or found.cost < best.cost * (1 - 1e-6):
            best = found
    assert best is not None
    theta = _settled(residual, best.x, best.active_mask == 0)
    zeros, poles, gain = shape.roots(theta)
    fitted = np.exp(shape.log_density(shape.written(theta), kappa))
    error = float(np.sqrt(np.mean(np.log10(fitted / density) ** 2)))
    return RoadFit(kappa, density, fitted, sections(zeros, poles, gain), order, error)


def _settled(residual: Callable[[np.ndarray], np.ndarray], theta: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Where Newton steps come to rest: sums of squares are flat there and tell places apart to eight digits only."""
    axes = np.eye(theta.size)[free]

    def gradient(at: np.ndarray) -> np.ndarray:
        slopes = np.imag([residual(at + 1e-30j * axis) for axis in axes]) * 1e30
        return slopes @ residual(at)

    before = 1e-2
    for _ in range(20):
        curvature = np.array([gradient(theta + 1e-5 * axis) - gradient(theta - 1e-5 * axis) for axis in axes]) / 2e-5
        step = np.linalg.lstsq(curvature, -gradient(theta))[0] @ axes
        size = float(np.abs(step).max(initial=0.0))
        if not 0 < size < before:
            break
        theta, before = theta + step, size
    return theta


def _beyond(kappa: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wavenumbers outside the band and what is expected there where nothing was measured, as logarithms.

    Level below the band, falling with the square above it, as roads do: without that a pole or zero outside the band
    is free to put the road's variance where it likes.
    """
    few = max(2, kappa.size // 6)
    level = np.log(density[:few]).mean()
    tail = np.log(density[-few:] * kappa[-few:] ** 2).mean()
    below, above = kappa[0] / np.array([10.0, 3.0]), kappa[-1] * np.array([3.0, 10.0, 30.0, 100.0])
    return np.concatenate([below, above]), np.concatenate([np.full(2, level), tail - 2 * np.log(above)])


@dataclass(frozen=True)
class _Shape:
    """How the unknowns of a fit are laid out: poles, zeros (each pairs, then a single), logarithm of the density."""

    order: int

    def _groups(self, theta: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        made, position = [], 0
        for count in (self.order, self.order - 1):
            groups = []
            for width in [2] * (count // 2) + [1] * (count % 2):
                groups.append(theta[position : position + width])
                position += width
            made.append(groups)
        return made[0], made[1]

    def log_density(self, theta: np.ndarray, kappa: np.ndarray) -> np.ndarray:
        """Logarithm of G = |H|^2 / pi."""
        poles, zeros = self._groups(theta)
        total = np.full(kappa.shape, theta[-1])
        for sign, groups in ((1, zeros), (-1, poles)):
            for group in groups:
                q = np.exp(group[0])
                if group.size == 1:
                    total += sign * np.log(kappa**2 + q**2)
                else:
                    total += sign * np.log((q**2 - kappa**2) ** 2 + (2 * np.exp(group[1]) * q * kappa) ** 2)
        return total

    def start(self, low: float, high: float, share: float) -> np.ndarray:
        """Breaks spread over the band, poles before zeros."""
        theta = []
        for count, offset in ((self.order, 0.0), (self.order - 1, 0.5)):
            groups = [2] * (count // 2) + [1] * (count % 2)
            for k, width in enumerate(groups):
                theta.append(low + (high - low) * min(1.0, share * (k + offset + 0.5) / len(groups)))
                theta += [0.0] * (width - 1)
        return np.array([*theta, 0.0])

    def bounds(self, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        """Breaks half below the band, where nothing was measured, to a decade above; dampings from a sharp peak up."""
        least, most = [], []
        for count in (self.order, self.order - 1):
            for width in [2] * (count // 2) + [1] * (count % 2):
                least += [low - np.log(2), np.log(_DAMPING[0])][:width]
                most += [high + np.log(10), np.log(_DAMPING[1])][:width]
        return np.array([*least, -np.inf]), np.array([*most, np.inf])

    def roots(self, theta: np.ndarray) -> tuple[list[Any], list[Any], Any]:
        """Zeros, poles and gain of H, to a fixed number of digits."""
        poles, zeros = (
            [_rounded(g[0]) if g.size == 1 else (_rounded(g[0]), _rounded(g[1])) for g in groups]
            for groups in self._groups(theta)
        )
        return zeros, poles, _rounded((theta[-1] + np.log(np.pi)) / 2)

    def written(self, theta: np.ndarray) -> np.ndarray:
        """The unknowns to the digits that `roots` gives."""
        numbers = [*theta[:-1], (theta[-1] + np.log(np.pi)) / 2]
        rounded = np.log([float(_rounded(number)) for number in numbers])
        return np.append(rounded[:-1], 2 * rounded[-1] - np.log(np.pi))


def _rounded(logarithm: float) -> Any:
    return exact(float(f"{np.exp(logarithm):.{_DIGITS}g}"))
