"""Restoring-force surfaces: what the suspension did, point by point, before any law is assumed.

The sprung mass obeys M2 x2'' = -C2 z' - K2 z - K3 x2 - f(z, z') (Iwaniec & Uhl 2007, eq. 2), so -x2'' is the restoring
force per unit mass. Drawn over the travel z and the rate z' it shows the law (Masri & Caughey 1979).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError
from opid.signals.motion import filter_like, relative_motion
from opid.signals.recording import FloatArray
from opid.suspensions.paper.settings import PaperSettings


@dataclass(frozen=True, eq=False)
class RestoringForce:
    """The scattered restoring-force surface of one run: one point a sample.

    Args:
        travel: (n,) relative displacement z = x2 - x1, m.
        velocity: (n,) relative velocity z', m/s.
        force_per_mass: (n,) -x2'' through the same filter, m/s^2.
        fs: sampling rate, Hz.
    """

    travel: FloatArray
    velocity: FloatArray
    force_per_mass: FloatArray
    fs: float

    def thinned(self, n_points: int) -> RestoringForce:
        """Return every so many points, about `n_points`: enough for start values and for verdicts on terms."""
        step = max(1, self.travel.size // n_points)
        z, v, force = (np.ascontiguousarray(each[::step]) for each in (self.travel, self.velocity, self.force_per_mass))
        return RestoringForce(z, v, force, self.fs / step)


@dataclass(frozen=True, eq=False)
class BinnedSurface:
    """The surface averaged over cells of the plane of travel and velocity.

    Args:
        travel_edges: (n_travel + 1,) m.
        velocity_edges: (n_velocity + 1,) m/s.
        counts: (n_travel, n_velocity) points in each cell.
        mean: (n_travel, n_velocity) mean force per mass, m/s^2; NaN where a cell has too few points.
        scatter: (n_travel, n_velocity) standard deviation within the cell, m/s^2; NaN likewise.
        min_count: points below which a cell is left empty.
    """

    travel_edges: FloatArray
    velocity_edges: FloatArray
    counts: FloatArray
    mean: FloatArray
    scatter: FloatArray
    min_count: int

    @property
    def visited(self) -> NDArray[np.bool_]:
        """(n_travel, n_velocity) True where a cell has `min_count` points or more."""
        return self.counts >= self.min_count

    @property
    def coverage(self) -> float:
        """Fraction of the cells of the bounding rectangle that were visited."""
        return float(np.mean(self.visited))

    @property
    def centres(self) -> tuple[FloatArray, FloatArray]:
        """Travel and velocity at the middle of each cell, two arrays (n_travel, n_velocity)."""
        travel = (self.travel_edges[1:] + self.travel_edges[:-1]) / 2
        velocity = (self.velocity_edges[1:] + self.velocity_edges[:-1]) / 2
        return tuple(np.meshgrid(travel, velocity, indexing="ij"))  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class SliceCurve:
    """The points of a surface near one axis: the stiffness curve (z' near 0) or the damping curve (z near 0).

    Args:
        along: "travel" (stiffness curve) or "velocity" (damping curve).
        position: (n,) travel in m or velocity in m/s, in the order of time.
        force_per_mass: (n,) m/s^2.
        sample: (n,) index of each point in the run.
        half_width: half width of the slice in the other coordinate, m/s or m.
        fs: sampling rate of the run, Hz.
    """

    along: Literal["travel", "velocity"]
    position: FloatArray
    force_per_mass: FloatArray
    sample: np.ndarray
    half_width: float
    fs: float


def restoring_force(
    unsprung: ArrayLike, sprung: ArrayLike, *, fs: float, high_pass_hz: float = PaperSettings.high_pass_hz
) -> RestoringForce:
    """Return the points (z, z', -x2'') of one run, without the ends in which the filter has not settled.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        high_pass_hz: as in `opid.signals.integrate`.

    Raises:
        InputError: as `relative_motion`, or a run too short to leave anything once the ends are cut.

    >>> t = np.arange(5120) / 256.0
    >>> surface = restoring_force(np.zeros(t.size), np.cos(12 * t), fs=256.0)
    >>> bool(np.corrcoef(surface.force_per_mass, surface.travel)[0, 1] > 0.999)
    True
    """
    motion = relative_motion(unsprung, sprung, fs=fs, high_pass_hz=high_pass_hz)
    inside = motion.interior
    if motion.displacement[inside].size < fs:
        raise InputError(
            f"the run lasts {motion.displacement.size / fs:.3g} s and the {high_pass_hz:g} Hz high-pass needs "
            f"{2 * motion.settle_s:.3g} s to settle: give a longer run or a higher corner"
        )
    force = -filter_like(sprung, motion)
    return RestoringForce(motion.displacement[inside], motion.velocity[inside], force[inside], float(fs))


def binned_surface(
    surface: RestoringForce,
    *,
    n_travel: int = PaperSettings.n_cells,
    n_velocity: int = PaperSettings.n_cells,
    min_count: int = PaperSettings.least_points_of_cell,
) -> BinnedSurface:
    """Average a scattered surface over the cells of a grid, with counts and scatter.

    Args:
        surface: the points.
        n_travel: cells along the travel.
        n_velocity: cells along the velocity.
        min_count: points below which a cell stays empty.

    Raises:
        InputError: fewer than two cells along an axis, or a surface without extent.

    >>> rng = np.random.default_rng(0)
    >>> z, v = rng.standard_normal((2, 5000))
    >>> grid = binned_surface(RestoringForce(z, v, 3 * z, 100.0), n_travel=9, n_velocity=9)
    >>> grid.counts.sum() == 5000, 0 < grid.coverage < 1
    (np.True_, True)
    """
    if min(n_travel, n_velocity) < 2 or min_count < 1:
        raise InputError(
            f"the grid is {n_travel} x {n_velocity} cells of {min_count} point(s): give 2 x 2 and 1 at least"
        )
    z, v, force = surface.travel, surface.velocity, surface.force_per_mass
    if np.ptp(z) == 0 or np.ptp(v) == 0:
        raise InputError("the surface has no extent in travel or in velocity: the two sensors moved as one")
    grid = (np.linspace(z.min(), z.max(), n_travel + 1), np.linspace(v.min(), v.max(), n_velocity + 1))
    counts, _, _ = np.histogram2d(z, v, bins=grid)
    total, _, _ = np.histogram2d(z, v, bins=grid, weights=force)
    square, _, _ = np.histogram2d(z, v, bins=grid, weights=force**2)
    enough = counts >= min_count
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(enough, total / counts, np.nan)
        scatter = np.sqrt(np.maximum(square / counts - mean**2, 0))
    return BinnedSurface(*grid, counts, mean, scatter, min_count)


def slice_curve(
    surface: RestoringForce,
    *,
    along: Literal["travel", "velocity"],
    half_width_std: float = PaperSettings.slice_half_width,
) -> SliceCurve:
    """Return the points of a surface near an axis.

    Along the travel this is the stiffness curve (z' near 0), along the velocity the damping curve (z near 0).

    Args:
        surface: the points.
        along: "travel" or "velocity".
        half_width_std: half width of the slice over the standard deviation of the other coordinate.

    Raises:
        InputError: an unknown axis, or a slice with fewer than 50 points.

    >>> rng = np.random.default_rng(0)
    >>> z, v = rng.standard_normal((2, 5000))
    >>> slice_curve(RestoringForce(z, v, 3 * z, 100.0), along="travel").position.size > 300
    True
    """
    if along not in ("travel", "velocity"):
        raise InputError(f"along is {along!r}: give 'travel' or 'velocity'")
    position, other = (surface.travel, surface.velocity) if along == "travel" else (surface.velocity, surface.travel)
    half_width = half_width_std * float(other.std())
    sample = np.flatnonzero(np.abs(other) <= half_width)
    if sample.size < 50:
        raise InputError(
            f"the slice along the {along} holds {sample.size} points: widen it (half_width_std is {half_width_std:g})"
        )
    return SliceCurve(along, position[sample], surface.force_per_mass[sample], sample, half_width, surface.fs)
