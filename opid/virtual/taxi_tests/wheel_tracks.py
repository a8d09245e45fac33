"""Wheel tracks side by side on one rough runway: each a road of ISO 8608, alike where the waves are long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from opid.errors import InputError
from opid.mechanics.laws.law import FloatArray
from opid.virtual.taxi_tests.road import Road, iso8608_road

# sixteen to the shortest wave of a road
_POINTS_PER_M = 64


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
    # x K_1(x) goes to 1 as x goes to 0, where K_1 is infinite
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
    """Return the roads under wheels that stand side by side, each of the PSD of an ISO 8608 class.

    Independent roads are mixed wave by wave with the square root of the matrix of `track_correlation`. The PSD of a
    mixed road is that of the class in the mean over draws; that of a road alone is so in each draw.

    Args:
        road_class: "A" to "H".
        lateral_m: where the wheels stand across the runway; wheels at the same place have the same road.
        length_m: the shortest length before the roads may repeat.
        rng: source of the phases; each of several roads has a stream of its own.
        footprint_m: length of the contact patch, m; 0 for a point.
        coherent: whether they lie on one isotropic surface; if not, different places have independent roads.

    Returns:
        One road a wheel, in the order of `lateral_m`.

    Raises:
        InputError: no place or one that is not finite; an unknown class, a length that is not positive.

    >>> tracks = iso8608_tracks("B", lateral_m=(0.0, 1.5, -1.5, 1.5), length_m=500.0, rng=np.random.default_rng(1))
    >>> tracks[1] is tracks[3], tracks[1] is tracks[2]
    (True, False)
    """
    lateral = np.asarray(lateral_m, dtype=np.float64)
    if lateral.ndim != 1 or lateral.size == 0 or not np.isfinite(lateral).all():
        raise InputError(f"lateral_m is {lateral_m!r}: give one finite number a wheel, m")
    places, which = np.unique(lateral, return_inverse=True)
    roads = tuple(
        iso8608_road(road_class, length_m=length_m, rng=stream, footprint_m=footprint_m)
        for stream in (rng.spawn(places.size) if places.size > 1 else [rng])
    )
    if coherent and places.size > 1:
        roads = _mixed(roads, np.abs(places[:, None] - places))
    return tuple(roads[k] for k in which)


def _mixed(roads: tuple[Road, ...], distance_m: FloatArray) -> tuple[Road, ...]:
    """Mix independent roads so that any two correlate as tracks at their distance."""
    length_m, footprint_m = roads[0].length_m, roads[0].footprint_m
    n_grid = int(np.ceil(_POINTS_PER_M * length_m))
    place_m = np.linspace(0.0, length_m, n_grid + 1)
    spectra = np.fft.rfft([road.elevation(place_m[:-1]) for road in roads], axis=1)
    # without the mean, which a road has none of
    waves = np.flatnonzero(np.abs(spectra).max(axis=0) > 1e-9 * np.abs(spectra).max())
    correlation = track_correlation((waves / length_m)[:, None, None], distance_m)
    values, vectors = np.linalg.eigh(correlation)
    # tracks close together leave eigenvalues that rounding makes negative
    root = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.transpose(0, 2, 1)
    mixed = np.zeros_like(spectra)
    mixed[:, waves] = np.einsum("nij,jn->in", root, spectra[:, waves])
    profiles = np.fft.irfft(mixed, n_grid, axis=1)
    return tuple(
        Road(length_m, footprint_m, CubicSpline(place_m, np.append(profile, profile[0]), bc_type="periodic"))
        for profile in profiles
    )
