"""How a three-axis accelerometer is mounted: the vertical from gravity, and how two sensors are turned to each other.

At rest an accelerometer reads the acceleration that keeps it from falling, 9.81 m/s^2 upward. Its mean reading at rest
is therefore the vertical in its own axes, with the sign: nobody has to state which axis points up. If a sensor is
tilted by a small angle from what was found, this fraction of the motion across appears in the vertical reading, so that
the standard deviation of the angle in rad is that of a cross-axis leak.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, cross_spectra
from opid.signals.units import STANDARD_GRAVITY

Axes = tuple[str, str, str]
Vector = tuple[float, float, float]
Method = Literal["rest", "mean", "stated"]


@dataclass(frozen=True)
class OrientationSettings:
    """How far gravity is trusted, and when two sensors count as moving together.

    Args:
        zero_m_per_s2: standard deviation of the zero of one axis: 5 mg, a calibrated sensor some months later, m/s^2.
        slope_rad: standard deviation of the angle between the ground where the vehicle stands and the horizontal, with
            that between its attitude at rest and in motion: 0.3 degrees, as of a parking place, rad.
        acceleration_m_per_s2: standard deviation of the mean acceleration along the ground of a run that has no rest:
            a vehicle brakes from 18 m/s to standstill within 40 s, m/s^2.
        quiet_m_per_s2: a sensor whose axes have a smaller rms stands still, however weak its other motion is: the noise
            of a telephone's sensor is a half of it, m/s^2.
        rest_s: the shortest stretch that counts as rest, s.
        rolling_ratio: a stretch that vibrates more than this many times the quietest one is no rest: a vehicle that
            rolls out is quiet, but it brakes.
        least_gravities: a mean reading below this fraction of gravity is none: the sensor is AC-coupled.
        most_gravities: a mean reading beyond this is not gravity: a false offset, or a wrong unit.
        slip_rad: if the vertical at two stretches of rest differs by more, the sensor has moved: 1 degree, which is
            more than two places of the ground differ, rad.
        same_rad: if the verticals of two runs differ by less, the sensor was not touched between them: 0.2 degrees,
            which at a fore-aft motion of 0.3 of the vertical is below the noise of the sensors, rad.
        gain_error: relative departure of the reading at rest from gravity below which the gain is not suspected.
        most_attitude_rad: roll and pitch of more are no motion of a vehicle on its wheels, but a wrong unit, rad.
        tilt_rad: standard deviation of a stated vertical: 2 degrees, as a sensor is mounted by eye, rad.
        shared_hz: the band in which a body moves with what carries it, Hz.
        coherence: least coherence of the motion that two sensors share. The two ends of an axle in shimmy reach 0.8,
            and are turned against each other by as much as they move apart.
        most_across: a motion whose second direction has more than this fraction of the power of the first one has no
            direction.
    """

    zero_m_per_s2: float = 0.05
    slope_rad: float = 0.005
    acceleration_m_per_s2: float = 0.5
    quiet_m_per_s2: float = 0.05
    rest_s: float = 2.0
    rolling_ratio: float = 2.0
    least_gravities: float = 0.5
    most_gravities: float = 1.5
    slip_rad: float = math.radians(1.0)
    same_rad: float = math.radians(0.2)
    gain_error: float = 0.005
    most_attitude_rad: float = math.radians(30.0)
    tilt_rad: float = math.radians(2.0)
    shared_hz: tuple[float, float] = (0.4, 2.1)
    coherence: float = 0.9
    most_across: float = 0.25


ORIENTATION = OrientationSettings()


@dataclass(frozen=True)
class Orientation:
    """How one three-axis sensor is mounted.

    Args:
        axes: names of its three channels, a right-handed system.
        vertical: unit vector that points up, in these axes.
        std_rad: standard deviation of its angle to the true vertical in each of two directions, rad.
        method: "rest" from gravity at standstill, "mean" from the mean of a log without standstill, "stated" by the
            user.
        gravity_m_per_s2: length of the mean reading, m/s^2; None if the vertical is stated.
        rest_s: begin and end of each stretch of rest, s.
        moved_rad: angle between the vertical in the first and the last stretch of rest; without two of them between
            that in the first and the second half of the log, rad.
        has_slipped: whether that angle is more than the ground or the braking of a vehicle explains.
        along: unit vector across the vertical along which the sensor moves, in these axes; None for a sensor whose
            vertical motion is read.
        along_std_rad: standard deviation of the angle of that direction about the vertical, rad.
    """

    axes: Axes
    vertical: Vector
    std_rad: float
    method: Method
    gravity_m_per_s2: float | None = None
    rest_s: tuple[tuple[float, float], ...] = ()
    moved_rad: float = 0.0
    has_slipped: bool = False
    along: Vector | None = None
    along_std_rad: float = 0.0

    @property
    def directions(self) -> FloatArray:
        """(3, 3) unit vectors in the sensor's axes: that of its motion, and two across it, a right-handed system.

        The motion is the one up, or the one along `along`; the last direction is then up.
        """
        up = np.array(self.vertical)
        if self.along is not None:
            return np.stack([np.array(self.along), np.cross(up, self.along), up])
        across = np.eye(3)[int(np.argmin(np.abs(up)))]
        across = across - up * (up @ across)
        across /= np.linalg.norm(across)
        return np.stack([up, across, np.cross(up, across)])

    @property
    def stds_across_rad(self) -> tuple[float, float]:
        """Standard deviations of the fractions of the second and the third of the `directions` that leak in."""
        return (self.std_rad if self.along is None else self.along_std_rad), self.std_rad

    @property
    def gain_error(self) -> float:
        """How much more than gravity the sensor reads at rest, relative; 0 if it is not known."""
        return self.gravity_m_per_s2 / STANDARD_GRAVITY - 1 if self.gravity_m_per_s2 and self.method == "rest" else 0.0

    def reverse(self) -> Orientation:
        """Return the orientation with the motion counted in the other direction across the vertical."""
        return self if self.along is None else replace(self, along=make_unit(-np.array(self.along)))

    def level(self, samples: ArrayLike, attitude: ArrayLike | None = None) -> FloatArray:
        """Return readings as motion in the three `directions`, (n, 3) m/s^2, without gravity.

        Args:
            samples: (n, 3) readings of the three axes, m/s^2.
            attitude: (n, 3) rotation of the body in the sensor's axes at each moment, as `follow_attitude` returns it,
                rad; None if the body does not turn.

        Raises:
            InputError: another shape.

        >>> upside_down = Orientation(("x", "y", "z"), (0.0, 0.0, -1.0), 0.005, "stated")
        >>> bool(np.allclose(upside_down.level([[0.0, 0.0, -9.80665 - 0.5]])[0, 0], 0.5))
        True
        """
        readings = np.asarray(samples, dtype=np.float64)
        if readings.ndim != 2 or readings.shape[1] != 3:
            raise InputError(f"samples have shape {readings.shape}: give an array (n, 3), one column for each axis")
        if attitude is not None:
            from scipy.spatial.transform import Rotation

            readings = Rotation.from_rotvec(np.asarray(attitude, dtype=np.float64)).apply(readings)
        levelled = readings @ self.directions.T
        upward = levelled[:, 0 if self.along is None else 2]
        upward -= self.gravity_m_per_s2 or STANDARD_GRAVITY * (upward.mean() > STANDARD_GRAVITY / 2)
        return np.asarray(levelled)


def state_orientation(axes: Sequence[str], vertical: Sequence[float], *, std_rad: float | None = None) -> Orientation:
    """Return an orientation that the user states.

    Args:
        axes: names of the three channels.
        vertical: vector of any length that points up, in these axes.
        std_rad: standard deviation of its angle, rad; by default that of a sensor that is mounted by eye.

    Raises:
        InputError: other than three numbers or names, a vector of no length, or an angle that is not positive.

    >>> state_orientation(["ax", "ay", "az"], [0, 0, -2]).vertical
    (0.0, 0.0, -1.0)
    """
    if len(axes) != 3 or len(vertical) != 3:
        raise InputError(f"the axes are {', '.join(axes)} and the vertical {list(vertical)}: give three of each")
    length = float(np.linalg.norm(vertical))
    if not (math.isfinite(length) and length > 0):
        raise InputError(f"vertical is {list(vertical)}: give the upward direction in the axes of the sensor")
    std_rad = ORIENTATION.tilt_rad if std_rad is None else std_rad
    if not 0 < std_rad < 1:
        raise InputError(
            f"the standard deviation of the vertical is {std_rad:g} rad: give a positive angle below 1 rad"
        )
    return Orientation((axes[0], axes[1], axes[2]), make_unit(np.array(vertical, dtype=float)), std_rad, "stated")


def mean_orientation(orientations: Sequence[Orientation]) -> Orientation:
    """Return the mean of several orientations of one sensor that was not touched between them.

    Args:
        orientations: one or more, which have the same axes; the largest standard deviation is kept, because the zeros
            of the sensor are the same in all.
    """
    widest = max(orientations, key=lambda each: each.std_rad)
    gravities = [each.gravity_m_per_s2 for each in orientations if each.gravity_m_per_s2]
    vertical = make_unit(np.mean([each.vertical for each in orientations], axis=0))
    alongs = [each.along for each in orientations if each.along is not None]
    return replace(
        widest,
        vertical=vertical,
        along=_make_level(np.mean(alongs, axis=0), vertical) if alongs else None,
        along_std_rad=max(each.along_std_rad for each in orientations),
        gravity_m_per_s2=float(np.mean(gravities)) if gravities else None,
    )


def angle_between(one: Orientation, other: Orientation) -> float:
    """Return the angle between the verticals of two orientations in the same axes, or of their motions if larger, rad.

    Args:
        one: the first.
        other: the second.

    >>> up, forward = (state_orientation(["x", "y", "z"], each) for each in ([0, 0, 1], [1, 0, 0]))
    >>> round(angle_between(up, forward), 4)
    1.5708
    """
    angle = measure_angle(np.array(one.vertical), np.array(other.vertical))
    if one.along is None or other.along is None:
        return angle
    return max(angle, measure_angle(np.array(one.along), np.array(other.along)))


def follow_attitude(rates: ArrayLike, *, fs: float, vertical: Sequence[float]) -> FloatArray:
    """Return the roll and pitch of a body at each moment of a run, (n, 3) rotation vectors in the sensor's axes, rad.

    The rates are integrated. A straight line is taken off the angles: its slope is the zero of the gyroscope, and its
    height the mean attitude of the run, which belongs to the orientation. Rotation about the vertical (a turn of the
    vehicle) is left out. Angles are assumed to be small: at 10 degrees of roll and pitch the error is 1 degree.

    Args:
        rates: (n, 3) angular rates about the axes of the accelerometer, rad/s.
        fs: sampling rate, Hz.
        vertical: unit vector that points up, in these axes.

    Raises:
        InputError: another shape, fewer than two samples, or rates that make more roll and pitch than a vehicle.

    >>> t = np.arange(0.0, 10.0, 0.01)
    >>> pitch = 0.02 * np.sin(2 * np.pi * t)
    >>> rates = np.stack([0 * t, 0.02 * 2 * np.pi * np.cos(2 * np.pi * t) + 0.1, 0 * t], axis=1)
    >>> bool(np.abs(follow_attitude(rates, fs=100.0, vertical=(0, 0, 1))[:, 1] - pitch).max() < 2e-3)
    True
    """
    from scipy import integrate, signal

    turning = np.asarray(rates, dtype=np.float64)
    if turning.ndim != 2 or turning.shape[1] != 3 or turning.shape[0] < 2:
        raise InputError(f"rates have shape {turning.shape}: give an array (n, 3), one column for each axis")
    angles = signal.detrend(integrate.cumulative_trapezoid(turning, dx=1 / fs, initial=0.0, axis=0), axis=0)
    up = np.asarray(vertical, dtype=np.float64)
    tilts = np.asarray(angles - np.outer(angles @ up, up))
    largest = float(np.linalg.norm(tilts, axis=1).max())
    if largest > ORIENTATION.most_attitude_rad:
        raise InputError(
            f"the angular rates make {math.degrees(largest):.3g} degrees of roll and pitch, and at most "
            f"{math.degrees(ORIENTATION.most_attitude_rad):.3g} are accepted: check their unit, or leave them out"
        )
    return tilts


def say_orientation(found: Orientation) -> str:
    """Return a sentence on how a sensor is mounted.

    Args:
        found: its orientation.
    """
    vertical = ", ".join(f"{each:.3f}" for each in found.vertical)
    rests = " and ".join(f"{begin:.3g} to {end:.3g} s" for begin, end in found.rest_s[:2])
    more = f" and {len(found.rest_s) - 2} more" if len(found.rest_s) > 2 else ""
    how = {
        "rest": f"from gravity at rest ({rests}{more})",
        "mean": "from the mean of the log, which has no rest",
        "stated": "as stated",
    }
    reads = f"; gravity reads {found.gravity_m_per_s2:.2f} m/s^2" if found.gravity_m_per_s2 else ""
    if found.along is not None:
        along = ", ".join(f"{each:.3f}" for each in found.along)
        reads += f"; it moves along ({along}), standard deviation {math.degrees(found.along_std_rad):.2f} degrees"
    return (
        f"the vertical is ({vertical}) in its axes, standard deviation {math.degrees(found.std_rad):.2f} degrees, "
        f"{how[found.method]}{reads}"
    )


def say_movement(found: Orientation) -> str:
    """Return a warning about a sensor that has moved within a log.

    Args:
        found: its orientation, with `has_slipped`.
    """
    between = "the first and the last rest" if len(found.rest_s) > 1 else "the two halves of the log"
    return (
        f"its vertical differs by {math.degrees(found.moved_rad):.1f} degrees between {between}: the sensor has moved, "
        "or the vehicle stood on another slope or rolled out; fasten it, or give start_s and stop_s of the stretch "
        "before it moved"
    )


# ---- two sensors -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Alignment:
    """How two three-axis sensors that share a motion are turned against each other.

    Args:
        rotation: (3, 3) rows of the matrix that turns readings in the axes of the second sensor into those of the
            first.
        std_rad: standard deviation of its angle, rad.
        coherence: coherence of the motion that both share in the band, between 0 and 1.
        first: name of the first sensor, where it is known.
        second: name of the second.
    """

    rotation: tuple[Vector, Vector, Vector]
    std_rad: float
    coherence: float
    first: str = ""
    second: str = ""


def align_sensors(
    first: ArrayLike,
    second: ArrayLike,
    *,
    fs: float,
    verticals: tuple[Sequence[float], Sequence[float]] | None = None,
    settings: OrientationSettings = ORIENTATION,
) -> Alignment:
    """Return how two sensors on one body, or on bodies that move together slowly, are turned against each other.

    The rotation R minimises the sum over the lines of a low band of w |A - R B|^2 (Wahba 1965), by the singular values
    of the sum of the cross-spectra (Kabsch 1976). The weight w of a line is c/(1 - c) over the power, with c the
    coherence of the two vectors. If the verticals of both are given, they are kept, and the motion across them gives
    the heading.

    Args:
        first: (n, 3) readings of the first sensor, m/s^2.
        second: (n, 3) readings of the second, on the same clock.
        fs: sampling rate, Hz.
        verticals: unit vectors that point up in the axes of the first and of the second sensor; None to find the whole
            rotation from the motion, which must then have more than one direction.
        settings: the band, and the least coherence.

    Raises:
        InputError: another shape, or a run with fewer than four blocks of 4 s.
        NotDeterminedError: the sensors do not share a motion, or only one along a single line.
    """
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    block = round(4 * fs)
    if one.shape != other.shape or one.ndim != 2 or one.shape[1] != 3 or len(one) < 2.5 * block:
        raise InputError(
            f"the sensors have shapes {one.shape} and {other.shape}: give two arrays (n, 3) of at least 10 s"
        )
    spectra = cross_spectra(np.hstack([one, other]), fs=fs, nperseg=block)
    return align_spectra(spectra.frequency_hz, spectra.density, spectra.n_averages, verticals, settings=settings)


def align_spectra(
    frequency_hz: FloatArray,
    density: ComplexArray,
    n_averages: float,
    verticals: tuple[Sequence[float], Sequence[float]] | None = None,
    *,
    settings: OrientationSettings = ORIENTATION,
) -> Alignment:
    """Return how two sensors are turned against each other, from their cross-spectra, as `align_sensors` does.

    Args:
        frequency_hz: (n_lines,) frequencies, Hz.
        density: (n_lines, 6, 6) cross-spectra E[conj(X_i) X_j] of the axes of the first and of the second sensor.
        n_averages: number of independent averages.
        verticals: unit vectors that point up in the axes of the first and of the second sensor; None if unknown.
        settings: the band, and the least coherence.

    Raises:
        NotDeterminedError: the sensors do not share a motion, or only one along a single line.
    """
    low_hz, high_hz = settings.shared_hz
    lines, least = (frequency_hz >= low_hz) & (frequency_hz <= high_hz), np.finfo(float).tiny
    if verticals is not None:
        # Only the motion across the verticals tells the heading.
        across = np.zeros((6, 6))
        across[:3, :3], across[3:, 3:] = (np.eye(3) - np.outer(up, up) for up in verticals)
        density = across @ density @ across
    of_one, of_other, cross = density[lines, :3, :3], density[lines, 3:, 3:], density[lines, :3, 3:]
    power = np.linalg.norm(of_one, axis=(1, 2)) * np.linalg.norm(of_other, axis=(1, 2)) + least
    shared = np.clip(np.linalg.norm(cross, axis=(1, 2)) ** 2 / power, 0.0, 0.999)
    weight = (shared / (1 - shared) / np.sqrt(power))[:, np.newaxis, np.newaxis]
    of_each = [(weight * each).real.sum(axis=0) for each in (of_one, of_other)]
    scale = math.sqrt(float(of_each[0].trace() * of_each[1].trace())) + least
    of_each, summed = [each / scale for each in of_each], (weight * cross.real).sum(axis=0) / scale
    # The verticals outweigh the motion a thousand times, so that they are kept.
    left, sizes, right = np.linalg.svd(summed if verticals is None else summed + 1e3 * np.outer(*verticals))
    sign = np.sign(np.linalg.det(left @ right))
    turned = left @ np.diag([1.0, 1.0, sign]) @ right
    coherence = float(np.clip((turned * summed).sum(), 0.0, 1.0))
    band = f"from {low_hz:g} to {high_hz:g} Hz"
    if coherence < settings.coherence:
        where = "a motion" if verticals is None else "a motion across the vertical"
        raise NotDeterminedError(
            f"the two sensors do not share {where}: their coherence is {coherence:.2f} {band}, and "
            f"{settings.coherence:g} is needed; take sensors on one body, or a run with more slow motion"
        )
    # The rotation about the strongest motion, or about the vertical, follows from the motion across it.
    weaker = [np.eye(3) - np.outer(strong, strong) for strong in (left[:, 0], right[0])]
    powers = [float((across * each).sum()) for across, each in zip(weaker, of_each, strict=True)]
    told = float((sizes[1] + sign * sizes[2]) / (math.sqrt(powers[0] * powers[1]) + least))
    if told < settings.coherence:
        raise NotDeterminedError(
            f"the motion that the two sensors share {band} is along one line (across it their coherence is "
            f"{told:.2f}), which does not tell their rotation about it: give the verticals of both"
        )
    std_rad = math.sqrt((1 - told**2) / (2 * told**2 * n_averages * int(lines.sum()))) if told < 1 else 0.0
    rows = [(float(row[0]), float(row[1]), float(row[2])) for row in turned]
    return Alignment((rows[0], rows[1], rows[2]), std_rad, coherence)


def find_motion_along(
    first: ArrayLike,
    second: ArrayLike,
    orientations: tuple[Orientation, Orientation],
    *,
    fs: float,
    settings: OrientationSettings = ORIENTATION,
) -> tuple[Orientation, Orientation, Alignment]:
    """Return the orientations of two sensors with the direction across the vertical in which both move.

    In a low band the second one moves with the first. The direction is that of the largest motion of the first one
    across its vertical, and the rotation between both (`align_spectra`) turns it into the axes of the second.

    Args:
        first: (n, 3) readings of the sensor that tells the direction, m/s^2.
        second: (n, 3) readings of the other, on the same clock.
        orientations: of both, whose verticals are known.
        fs: sampling rate, Hz.
        settings: the band, and how clearly one direction must stand out.

    Returns:
        Both orientations, and how the second sensor is turned against the first one.

    Raises:
        NotDeterminedError: the sensors do not share a motion across the vertical, or it has no direction.
    """
    one, other = orientations
    block = round(4 * fs)
    spectra = cross_spectra(np.hstack([first, second]), fs=fs, nperseg=min(block, len(np.asarray(first))))
    verticals = (one.vertical, other.vertical)
    turned = align_spectra(spectra.frequency_hz, spectra.density, spectra.n_averages, verticals, settings=settings)
    low_hz, high_hz = settings.shared_hz
    lines = (spectra.frequency_hz >= low_hz) & (spectra.frequency_hz <= high_hz)
    level = np.eye(3) - np.outer(one.vertical, one.vertical)
    power = level @ spectra.density[lines, :3, :3].real.sum(axis=0) @ level
    powers, axes = np.linalg.eigh(power)
    across, along = float(powers[1]), float(powers[2])
    if across > settings.most_across * along:
        raise NotDeterminedError(
            f"across the vertical it moves {math.sqrt(across / along):.2f} times as much in the second direction as in "
            f"the first one from {low_hz:g} to {high_hz:g} Hz, and at most {math.sqrt(settings.most_across):.2g} times "
            "tells the direction of the motion: give the axis that points along it as channel, in the place of axes"
        )
    n_free = spectra.n_averages * int(lines.sum())
    std_rad = math.hypot(settings.slope_rad, math.sqrt(across * along / n_free) / (along - across))
    direction = _make_level(axes[:, 2] * np.sign(axes[np.abs(axes[:, 2]).argmax(), 2]), one.vertical)
    there = _make_level(np.array(turned.rotation).T @ direction, other.vertical)
    return (
        replace(one, along=direction, along_std_rad=std_rad),
        replace(other, along=there, along_std_rad=math.hypot(std_rad, turned.std_rad)),
        turned,
    )


def say_alignment(found: Alignment) -> str:
    """Return a sentence on how a sensor is turned against another one.

    Args:
        found: the rotation from its axes to those of the other.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(found.rotation).as_rotvec()
    angle = float(np.linalg.norm(turn))
    about = ", ".join(f"{each:.2f}" for each in turn / angle) if angle else "0, 0, 0"
    return (
        f"turned by {math.degrees(angle):.1f} degrees about ({about}), standard deviation "
        f"{math.degrees(found.std_rad):.1f} degrees, by the motion that both share (coherence {found.coherence:.2f})"
    )


# ---- helpers ---------------------------------------------------------------------------------------


def measure_angle(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between two vectors of three numbers, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def _make_level(vector: FloatArray, vertical: Vector) -> Vector:
    """Return the unit vector across the vertical that is nearest to a vector."""
    return make_unit(vector - np.array(vertical) * float(vector @ np.array(vertical)))


def make_unit(vector: FloatArray) -> Vector:
    """Return the unit vector along a vector of three numbers."""
    x, y, z = (float(each) for each in vector / np.linalg.norm(vector))
    return x, y, z
