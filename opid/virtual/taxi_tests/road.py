"""A rough runway, the speed at which a wheel goes over it, and the tracks of wheels side by side."""

from __future__ import annotations

from collections.abc import Sequence
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
_FASTEST_M_PER_S, _LONGEST_M = 1e3, 2e5  # the road of the longest taxi run; its spline takes 1 GB
_POINTS_PER_M = 64  # the shortest wave of a road has sixteen


@dataclass(frozen=True, eq=False)
class Road:
    """Elevation of the road under the tyre, a cubic spline, so that elevation and slope agree everywhere.

    Attributes:
        length_m: length after which the road repeats itself.
        footprint_m: length of the contact patch over which the elevation is averaged.
    """

    length_m: float
    footprint_m: float
    _spline: CubicSpline = field(repr=False)

    def elevation(self, position_m: ArrayLike) -> FloatArray:
        """Return the elevation, m, at positions along the road, m."""
        return self._spline(position_m)

    def slope(self, position_m: ArrayLike) -> FloatArray:
        """Return the derivative of the elevation along the road, m/m."""
        return self._spline(position_m, 1)


def road_psd(road_class: str, cycles_per_m: ArrayLike) -> FloatArray:
    """Return the one-sided displacement PSD of ISO 8608, Gd(n) = Gd(n0) (n/n0)^-2, n0 = 0.1 cycles/m.

    Args:
        road_class: "A" (16e-6 m^3 at n0) to "H", each four times rougher than the one before.
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
        length_m: the shortest length before the road may repeat; the road has at least ten of the longest waves.
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
    if not (0.0 < length_m <= _LONGEST_M and 0.0 <= footprint_m < np.inf):
        raise InputError(
            f"the length is {length_m} m, the footprint {footprint_m} m: give positive numbers, and a road of at most "
            f"{_LONGEST_M:g} m (less time, or slower)"
        )
    length_m = max(float(length_m), 10.0 / low)
    n_grid = int(np.ceil(_GRID_POINTS_PER_CYCLE * high * length_m))
    cycles_per_m = np.arange(n_grid // 2 + 1) / length_m
    inside = (cycles_per_m >= low) & (cycles_per_m <= high)
    n = cycles_per_m[inside]
    amplitude = np.sqrt(2.0 * road_psd(road_class, n) / length_m) * np.sinc(n * footprint_m)
    # The function irfft sums conjugate pairs and divides by n_grid.
    spectrum = np.zeros(cycles_per_m.size, dtype=np.complex128)
    spectrum[inside] = 0.5 * n_grid * amplitude * np.exp(2j * np.pi * rng.random(n.size))
    profile = np.fft.irfft(spectrum, n_grid)
    position_m = np.linspace(0.0, length_m, n_grid + 1)
    spline = CubicSpline(position_m, np.append(profile, profile[0]), bc_type="periodic")
    return Road(length_m, float(footprint_m), spline)


@dataclass(frozen=True)
class SpeedProfile:
    """A speed that goes linearly from one value to another, and is constant before and after.

    Args:
        start_m_per_s: speed up to time 0.
        stop_m_per_s: speed from `duration_s` on.
        duration_s: duration of the change.

    Raises:
        InputError: a speed below zero or above 1000 m/s, or a duration that is not positive.

    >>> braking = SpeedProfile(18.0, 0.0, 40.0)
    >>> braking.position_m([0.0, 40.0]), braking.speed_m_per_s([-1.0, 20.0])
    (array([  0., 360.]), array([18.,  9.]))
    """

    start_m_per_s: float
    stop_m_per_s: float
    duration_s: float

    def __post_init__(self) -> None:
        speeds = (self.start_m_per_s, self.stop_m_per_s)
        if not all(0.0 <= speed <= _FASTEST_M_PER_S for speed in speeds) or not 0.0 < self.duration_s < np.inf:
            raise InputError(
                f"the speed goes from {speeds[0]} to {speeds[1]} m/s in {self.duration_s} s: give "
                f"speeds that are not negative and at most {_FASTEST_M_PER_S:g} m/s, and a positive duration"
            )

    def speed_m_per_s(self, time_s: ArrayLike) -> FloatArray:
        """Return the speed, m/s, at times, s."""
        return np.interp(
            np.asarray(time_s, dtype=np.float64), (0.0, self.duration_s), (self.start_m_per_s, self.stop_m_per_s)
        )

    def position_m(self, time_s: ArrayLike) -> FloatArray:
        """Return the distance covered since time 0, m (negative before)."""
        time = np.asarray(time_s, dtype=np.float64)
        inside = np.clip(time, 0.0, self.duration_s)
        slope = (self.stop_m_per_s - self.start_m_per_s) / self.duration_s
        braking = self.start_m_per_s * inside + 0.5 * slope * inside**2
        constant = np.where(time < 0.0, self.start_m_per_s, self.stop_m_per_s) * (time - inside)
        return braking + constant


# ---- wheels side by side ---------------------------------------------------------------------------


def track_correlation(cycles_per_m: ArrayLike, distance_m: ArrayLike) -> FloatArray:
    """Return cross-PSD over PSD of two parallel tracks of an isotropic surface whose PSD falls with n^-2.

    g = x K_1(x), x = 2 pi n b, K_1 the modified Bessel function of the second kind: 1 for waves much longer than the
    distance b of the tracks, 0 for much shorter ones (Kamash and Robson, J. Sound Vib. 57 (1978) 89). It is real; the
    coherence, a squared magnitude, is g^2.

    Args:
        cycles_per_m: spatial frequencies n along the tracks, cycles/m.
        distance_m: b, m; broadcast against `cycles_per_m`.

    >>> track_correlation([0.02, 0.1, 1.0], 3.0).round(4)
    array([0.8839, 0.3071, 0.    ])
    """
    from scipy.special import k1

    n, b = np.broadcast_arrays(np.asarray(cycles_per_m, dtype=np.float64), np.asarray(distance_m, dtype=np.float64))
    x = 2.0 * np.pi * np.abs(n * b)
    # x K_1(x) goes to 1 as x goes to 0, where K_1 is infinite.
    correlation = np.ones(x.shape)
    np.multiply(x, k1(np.maximum(x, 1e-12)), out=correlation, where=x > 1e-12)
    return correlation


def iso8608_tracks(
    road_class: str,
    *,
    lateral_m: Sequence[float],
    length_m: float,
    rng: np.random.Generator,
    footprint_m: float = 0.3,
    coherent: bool = True,
) -> tuple[Road, ...]:
    """Return the roads under wheels that stand side by side, each with the PSD of an ISO 8608 class.

    Independent roads are mixed wave by wave with the square root of the matrix of `track_correlation`. The PSD of a
    mixed road is that of the class in the mean over draws; a single road has it in each draw.

    Args:
        road_class: "A" to "H".
        lateral_m: positions of the wheels across the runway; wheels at the same position have the same road.
        length_m: the shortest length before the roads may repeat.
        rng: source of the phases; each of several roads has a stream of its own.
        footprint_m: length of the contact patch, m; 0 for a point.
        coherent: whether they lie on one isotropic surface; if not, different positions have independent roads.

    Returns:
        One road for each wheel, in the order of `lateral_m`.

    Raises:
        InputError: no position or one that is not finite; an unknown class, a length that is not positive.

    >>> tracks = iso8608_tracks("B", lateral_m=(0.0, 1.5, -1.5, 1.5), length_m=500.0, rng=np.random.default_rng(1))
    >>> tracks[1] is tracks[3], tracks[1] is tracks[2]
    (True, False)
    """
    lateral = np.asarray(lateral_m, dtype=np.float64)
    if lateral.ndim != 1 or lateral.size == 0 or not np.isfinite(lateral).all():
        raise InputError(f"lateral_m is {lateral_m!r}: give one finite number for each wheel, m")
    positions, which = np.unique(lateral, return_inverse=True)
    roads = tuple(
        iso8608_road(road_class, length_m=length_m, rng=stream, footprint_m=footprint_m)
        for stream in (rng.spawn(positions.size) if positions.size > 1 else [rng])
    )
    if coherent and positions.size > 1:
        roads = _mix_roads(roads, np.abs(positions[:, None] - positions))
    return tuple(roads[k] for k in which)


def _mix_roads(roads: tuple[Road, ...], distance_m: FloatArray) -> tuple[Road, ...]:
    """Mix independent roads so that any two correlate as tracks at their distance."""
    length_m, footprint_m = roads[0].length_m, roads[0].footprint_m
    n_grid = int(np.ceil(_POINTS_PER_M * length_m))
    position_m = np.linspace(0.0, length_m, n_grid + 1)
    spectra = np.fft.rfft([road.elevation(position_m[:-1]) for road in roads], axis=1)
    # A road has no mean.
    waves = np.flatnonzero(np.abs(spectra).max(axis=0) > 1e-9 * np.abs(spectra).max())
    correlation = track_correlation((waves / length_m)[:, None, None], distance_m)
    values, vectors = np.linalg.eigh(correlation)
    # Tracks that are close together have eigenvalues that rounding makes negative.
    root = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.transpose(0, 2, 1)
    mixed = np.zeros_like(spectra)
    mixed[:, waves] = np.einsum("nij,jn->in", root, spectra[:, waves])
    profiles = np.fft.irfft(mixed, n_grid, axis=1)
    return tuple(
        Road(length_m, footprint_m, CubicSpline(position_m, np.append(profile, profile[0]), bc_type="periodic"))
        for profile in profiles
    )
