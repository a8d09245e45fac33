"""A rough runway and the speed at which a wheel goes over it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from opid.errors import InputError, nearest
from opid.mechanics.laws.law import FloatArray

ROAD_CLASSES = {name: 16e-6 * 4.0**k for k, name in enumerate("ABCDEFGH")}
"""ISO 8608 classes: displacement PSD Gd(n0), m^3, at n0 = 0.1 cycles/m (geometric mean of the class)."""

REFERENCE_CYCLES_PER_M = 0.1
_GRID_POINTS_PER_CYCLE = 16


@dataclass(frozen=True, eq=False)
class Road:
    """Elevation of the road under the tyre, a cubic spline, so that elevation and slope agree at every place.

    Attributes:
        length_m: after this length the road repeats itself.
        footprint_m: length of the contact patch that the elevation is averaged over.
    """

    length_m: float
    footprint_m: float
    _spline: CubicSpline = field(repr=False)

    def elevation(self, place_m: ArrayLike) -> FloatArray:
        """Return the elevation, m, at places along the road, m."""
        return self._spline(place_m)

    def slope(self, place_m: ArrayLike) -> FloatArray:
        """Return the derivative of the elevation along the road, m/m."""
        return self._spline(place_m, 1)


def road_psd(road_class: str, cycles_per_m: ArrayLike) -> FloatArray:
    """Return the one-sided displacement PSD of ISO 8608, Gd(n) = Gd(n0) (n/n0)^-2, n0 = 0.1 cycles/m.

    Args:
        road_class: "A" (16e-6 m^3 at n0) to "H", four times rougher each.
        cycles_per_m: spatial frequencies n, cycles/m.

    Returns:
        Gd, m^3, of the shape of `cycles_per_m`.

    Raises:
        InputError: an unknown class.

    >>> road_psd("B", [0.1, 1.0])
    array([6.4e-05, 6.4e-07])
    """
    if road_class not in ROAD_CLASSES:
        raise InputError(f"there is no road class {road_class!r}: {nearest(road_class, ROAD_CLASSES)}")
    n = np.asarray(cycles_per_m, dtype=np.float64)
    return ROAD_CLASSES[road_class] * (n / REFERENCE_CYCLES_PER_M) ** -2.0


def iso8608_road(
    road_class: str,
    *,
    length_m: float,
    rng: np.random.Generator,
    footprint_m: float = 0.3,
    band_cycles_per_m: tuple[float, float] = (0.02, 4.0),
) -> Road:
    """Return a random road of an ISO 8608 class: cosines of the prescribed amplitudes with random phases.

    xb(s) = sum_k sqrt(2 Gd(n_k) dn) sinc(n_k L) cos(2 pi n_k s + phi_k), n_k = k dn in the band, dn one over
    the length; sinc(n L) = sin(pi n L)/(pi n L) is the moving average over a footprint of length L.

    Args:
        road_class: "A" to "H".
        length_m: the shortest length before the road may repeat; at least ten of the longest waves are made.
        rng: source of the phases.
        footprint_m: length of the contact patch, m; 0 for a point.
        band_cycles_per_m: lowest and highest spatial frequency.

    Raises:
        InputError: an unknown class, a length that is not positive, a band that is empty.

    >>> road = iso8608_road("B", length_m=500.0, rng=np.random.default_rng(1))
    >>> road.elevation([0.0, 100.0]).shape
    (2,)
    """
    low, high = band_cycles_per_m
    if not 0.0 < low < high < np.inf:
        raise InputError(f"the band is {low} to {high} cycles/m: give two positive numbers, the lower first")
    if not (0.0 < length_m < np.inf and 0.0 <= footprint_m < np.inf):
        raise InputError(f"the length is {length_m} m, the footprint {footprint_m} m: give positive numbers")
    length_m = max(float(length_m), 10.0 / low)
    n_grid = int(np.ceil(_GRID_POINTS_PER_CYCLE * high * length_m))
    cycles_per_m = np.arange(n_grid // 2 + 1) / length_m
    inside = (cycles_per_m >= low) & (cycles_per_m <= high)
    n = cycles_per_m[inside]
    amplitude = np.sqrt(2.0 * road_psd(road_class, n) / length_m) * np.sinc(n * footprint_m)
    # irfft sums conjugate pairs and divides by n_grid
    spectrum = np.zeros(cycles_per_m.size, dtype=np.complex128)
    spectrum[inside] = 0.5 * n_grid * amplitude * np.exp(2j * np.pi * rng.random(n.size))
    profile = np.fft.irfft(spectrum, n_grid)
    place_m = np.linspace(0.0, length_m, n_grid + 1)
    spline = CubicSpline(place_m, np.append(profile, profile[0]), bc_type="periodic")
    return Road(length_m, float(footprint_m), spline)


@dataclass(frozen=True)
class SpeedProfile:
    """A speed that goes linearly from one value to another, and is constant before and after.

    Args:
        start_m_per_s: speed up to time 0.
        stop_m_per_s: speed from `duration_s` on.
        duration_s: duration of the change.

    Raises:
        InputError: a negative speed or a duration that is not positive.

    >>> braking = SpeedProfile(18.0, 0.0, 40.0)
    >>> braking.position_m([0.0, 40.0]), braking.speed_m_per_s([-1.0, 20.0])
    (array([  0., 360.]), array([18.,  9.]))
    """

    start_m_per_s: float
    stop_m_per_s: float
    duration_s: float

    def __post_init__(self) -> None:
        speeds = (self.start_m_per_s, self.stop_m_per_s)
        if not all(0.0 <= speed < np.inf for speed in speeds) or not 0.0 < self.duration_s < np.inf:
            raise InputError(
                f"the speed goes from {speeds[0]} to {speeds[1]} m/s in {self.duration_s} s: give "
                "speeds that are not negative and a positive duration"
            )

    def speed_m_per_s(self, time_s: ArrayLike) -> FloatArray:
        """Return the speed, m/s, at times, s."""
        return np.interp(
            np.asarray(time_s, dtype=np.float64),
            (0.0, self.duration_s),
            (self.start_m_per_s, self.stop_m_per_s),
        )

    def position_m(self, time_s: ArrayLike) -> FloatArray:
        """Return the way covered since time 0, m (negative before)."""
        time = np.asarray(time_s, dtype=np.float64)
        inside = np.clip(time, 0.0, self.duration_s)
        slope = (self.stop_m_per_s - self.start_m_per_s) / self.duration_s
        braking = self.start_m_per_s * inside + 0.5 * slope * inside**2
        constant = np.where(time < 0.0, self.start_m_per_s, self.stop_m_per_s) * (time - inside)
        return braking + constant
