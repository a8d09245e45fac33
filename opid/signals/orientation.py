"""How a three-axis accelerometer is mounted: the vertical from gravity, and how two sensors are turned to each other.

At rest an accelerometer reads the acceleration that keeps it from falling, 9.81 m/s^2 upward. Its mean reading at rest
is therefore the vertical in its own axes, with the sign: nobody has to state which axis points up. If a sensor is
tilted by a small angle from what was found, this fraction of the motion across appears in the vertical reading, so that
the standard deviation of the angle in rad is that of a cross-axis leak.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError
from opid.signals.health.result import Health
from opid.signals.recording import FloatArray
from opid.signals.segments import find_standstill
from opid.signals.spectra import cross_spectra
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
        least_gravities: a mean reading below this fraction of gravity is none: the sensor is AC-coupled.
        most_gravities: a mean reading beyond this is not gravity: a false offset, or a wrong unit.
        slip_rad: if the vertical at two stretches of rest differs by more, the sensor has moved: 1 degree, which is
            more than two places of the ground differ, rad.
        same_rad: if the verticals of two runs differ by less, the sensor was not touched between them: 0.2 degrees,
            which at a fore-aft motion of 0.3 of the vertical is below the noise of the sensors, rad.
        gain_error: relative departure of the reading at rest from gravity below which the gain is not suspected.
        tilt_rad: standard deviation of a stated vertical: 2 degrees, as a sensor is mounted by eye, rad.
        shared_hz: the band in which a body moves with what carries it, Hz.
        coherence: least coherence of the motion that two sensors share.
    """

    zero_m_per_s2: float = 0.05
    slope_rad: float = 0.005
    acceleration_m_per_s2: float = 0.5
    quiet_m_per_s2: float = 0.05
    rest_s: float = 2.0
    least_gravities: float = 0.5
    most_gravities: float = 1.5
    slip_rad: float = math.radians(1.0)
    same_rad: float = math.radians(0.2)
    gain_error: float = 0.005
    tilt_rad: float = math.radians(2.0)
    shared_hz: tuple[float, float] = (0.4, 2.1)
    coherence: float = 0.5


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
    """

    axes: Axes
    vertical: Vector
    std_rad: float
    method: Method
    gravity_m_per_s2: float | None = None
    rest_s: tuple[tuple[float, float], ...] = ()
    moved_rad: float = 0.0
    has_slipped: bool = False

    @property
    def directions(self) -> FloatArray:
        """(3, 3) unit vectors in the sensor's axes: up, and two across it that make a right-handed system with it."""
        up = np.array(self.vertical)
        across = np.eye(3)[int(np.argmin(np.abs(up)))]
        across = across - up * (up @ across)
        across /= np.linalg.norm(across)
        return np.stack([up, across, np.cross(up, across)])

    @property
    def gain_error(self) -> float:
        """How much more than gravity the sensor reads at rest, relative; 0 if it is not known."""
        return self.gravity_m_per_s2 / STANDARD_GRAVITY - 1 if self.gravity_m_per_s2 and self.method == "rest" else 0.0

    def level(self, samples: ArrayLike, attitude: ArrayLike | None = None) -> FloatArray:
        """Return readings as motion up and in two directions across, (n, 3) m/s^2, without gravity.

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
        levelled[:, 0] -= self.gravity_m_per_s2 or STANDARD_GRAVITY * (levelled[:, 0].mean() > STANDARD_GRAVITY / 2)
        return np.asarray(levelled)


def find_orientation(
    health: Health, axes: Sequence[str], *, settings: OrientationSettings = ORIENTATION
) -> Orientation:
    """Return how a three-axis accelerometer is mounted, from its mean reading at rest.

    If the log has no standstill, the mean of the whole log is taken. The standard deviation allows for the zeros of the
    axes and for the slope of the ground (`OrientationSettings`), for the departure of the reading from gravity, which
    zeros or gains cause, for half of what the sensor moved between two stretches of rest, and without rest for the mean
    acceleration of the vehicle.

    Args:
        health: the result of `opid.inspect`, which holds the means of the channels second by second.
        axes: names of three channels, a right-handed system.
        settings: how far gravity is trusted.

    Raises:
        InputError: other than three channels of one clock, one that was not inspected, is no acceleration or is mute,
            or a mean reading that is not gravity, as of an AC-coupled sensor or of a false offset.
    """
    names = _require_axes(health, axes)
    clock = next((k for k, each in enumerate(health.clocks) if set(names) <= set(each.channels)), None)
    if clock is None:
        raise InputError(f"the axes {_join(names)} have different clocks: give three channels of one recorder")
    history, columns = health.rms_history[clock], [health.clocks[clock].channels.index(name) for name in names]
    complete = history.complete[:, columns].all(axis=1)
    mean, rms = history.mean[:, columns], history.rms[:, columns]
    quiet = find_standstill(health, names) | (np.nan_to_num(rms, nan=np.inf).max(axis=1) < settings.quiet_m_per_s2)
    stretches = _find_stretches(quiet & complete, settings.rest_s / history.length_s)
    if not complete.any():
        raise InputError(f"the axes {_join(names)} have no second without a gap: the vertical is not known")
    at_rest = np.concatenate(stretches) if stretches else np.flatnonzero(complete)
    reading = mean[at_rest].mean(axis=0)
    gravity = float(np.linalg.norm(reading))
    if not settings.least_gravities < gravity / STANDARD_GRAVITY < settings.most_gravities:
        why = "the sensor is AC-coupled" if gravity < STANDARD_GRAVITY else "an axis has a false offset or another unit"
        raise InputError(
            f"the axes {_join(names)} read {gravity:.3g} m/s^2 {'at rest' if stretches else 'on average'} where "
            f"gravity is {STANDARD_GRAVITY:.2f}: {why}; state its upward direction in its axes, as vertical = [0, 0, 1] in "
            "[channels.NAME] of a study"
        )
    if len(stretches) > 1:
        moved = _angle(mean[stretches[0]].mean(axis=0), mean[stretches[-1]].mean(axis=0))
    else:
        halves = np.array_split(np.flatnonzero(complete & ~quiet if (complete & ~quiet).any() else complete), 2)
        moved = _angle(*(mean[half].mean(axis=0) if half.size else reading for half in halves))
    off_m_per_s2 = math.hypot(settings.zero_m_per_s2, abs(gravity - STANDARD_GRAVITY))
    unknown = [off_m_per_s2 / STANDARD_GRAVITY, settings.slope_rad]
    unknown.append(moved / 2 if len(stretches) > 1 else 0.0)
    unknown.append(0.0 if stretches else settings.acceleration_m_per_s2 / STANDARD_GRAVITY)
    explained = settings.slip_rad if len(stretches) > 1 else 2 * settings.acceleration_m_per_s2 / STANDARD_GRAVITY
    ends = [
        (float(history.start_s[each[0]]), float(history.start_s[each[-1]] + history.length_s)) for each in stretches
    ]
    return Orientation(
        names,
        _make_unit(reading),
        math.hypot(*unknown),
        "rest" if stretches else "mean",
        gravity,
        tuple(ends),
        moved,
        moved > explained,
    )


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
        raise InputError(f"the axes are {_join(axes)} and the vertical {list(vertical)}: give three of each")
    length = float(np.linalg.norm(vertical))
    if not (math.isfinite(length) and length > 0):
        raise InputError(f"vertical is {list(vertical)}: give the upward direction in the axes of the sensor")
    std_rad = ORIENTATION.tilt_rad if std_rad is None else std_rad
    if not 0 < std_rad < 1:
        raise InputError(
            f"the standard deviation of the vertical is {std_rad:g} rad: give a positive angle below 1 rad"
        )
    return Orientation((axes[0], axes[1], axes[2]), _make_unit(np.array(vertical, dtype=float)), std_rad, "stated")


def mean_orientation(orientations: Sequence[Orientation]) -> Orientation:
    """Return the mean of several orientations of one sensor that was not touched between them.

    Args:
        orientations: one or more, which have the same axes; the largest standard deviation is kept, because the zeros
            of the sensor are the same in all.
    """
    widest = max(orientations, key=lambda each: each.std_rad)
    gravities = [each.gravity_m_per_s2 for each in orientations if each.gravity_m_per_s2]
    return replace(
        widest,
        vertical=_make_unit(np.mean([each.vertical for each in orientations], axis=0)),
        gravity_m_per_s2=float(np.mean(gravities)) if gravities else None,
    )


def angle_between(one: Orientation, other: Orientation) -> float:
    """Return the angle between the verticals of two orientations in the same axes, rad.

    Args:
        one: the first.
        other: the second.

    >>> up, forward = (state_orientation(["x", "y", "z"], each) for each in ([0, 0, 1], [1, 0, 0]))
    >>> round(angle_between(up, forward), 4)
    1.5708
    """
    return _angle(np.array(one.vertical), np.array(other.vertical))


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
        InputError: another shape, or fewer than two samples.

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
    return np.asarray(angles - np.outer(angles @ up, up))


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
    return (
        f"the vertical is ({vertical}) in its axes, +- {math.degrees(found.std_rad):.2f} degrees, "
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
        "or the vehicle stood on another slope; fasten it, or give start_s and stop_s of the stretch before it moved"
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
    """

    rotation: tuple[Vector, Vector, Vector]
    std_rad: float
    coherence: float


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
    if verticals is not None:
        # Only what is across the verticals tells the heading.
        one, other = (
            each - np.outer(each @ up, up) for each, up in zip((one, other), map(np.array, verticals), strict=True)
        )
    spectra = cross_spectra(np.hstack([one, other]), fs=fs, nperseg=block)
    low_hz, high_hz = settings.shared_hz
    lines = (spectra.frequency_hz >= low_hz) & (spectra.frequency_hz <= high_hz)
    density = spectra.density[lines]
    of_one, of_other, cross = density[:, :3, :3], density[:, 3:, 3:], density[:, :3, 3:]
    power = np.linalg.norm(of_one, axis=(1, 2)) * np.linalg.norm(of_other, axis=(1, 2)) + np.finfo(float).tiny
    shared = np.linalg.norm(cross, axis=(1, 2)) ** 2 / power
    weight = (np.clip(shared, 0, 0.999) / (1.001 - np.clip(shared, 0, 1)) / np.sqrt(power))[:, np.newaxis, np.newaxis]
    summed = (weight * cross.real).sum(axis=0)
    scale = math.sqrt(
        float((weight * of_one).real.sum(axis=0).trace()) * float((weight * of_other).real.sum(axis=0).trace())
    )
    held = summed / max(scale, np.finfo(float).tiny)
    if verticals is not None:
        held = held + 1e3 * np.outer(*verticals)
    left, sizes, right = np.linalg.svd(held)
    turned = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    coherence = float(np.clip((turned * summed).sum() / max(scale, np.finfo(float).tiny), 0.0, 1.0))
    band = f"from {low_hz:g} to {high_hz:g} Hz"
    if coherence < settings.coherence:
        raise NotDeterminedError(
            f"the two sensors do not share a motion: their coherence is {coherence:.2f} {band}, and "
            f"{settings.coherence:g} is needed; take sensors on one body, or a run with more slow motion"
        )
    # A motion along one line does not tell the rotation about it.
    second_size = float(sizes[1])
    n = spectra.n_averages * int(lines.sum())
    std_rad = math.sqrt((1 - coherence**2) / (2 * coherence**2 * n)) / math.sqrt(min(1.0, max(second_size, 1e-12)))
    if std_rad > 0.5:
        raise NotDeterminedError(
            f"the motion that the two sensors share {band} is along one line, which does not tell their rotation about "
            "it: give the verticals of both"
        )
    rows = [(float(row[0]), float(row[1]), float(row[2])) for row in turned]
    return Alignment((rows[0], rows[1], rows[2]), std_rad, coherence)


# ---- names -----------------------------------------------------------------------------------------


def group_axes(units: Mapping[str, str]) -> dict[str, Axes]:
    """Return the channels that look like the three axes of one accelerometer, by the name that they share.

    They are accelerations whose names differ by one letter, x, y and z.

    Args:
        units: SI unit of each channel, by its name.

    >>> group_axes({"imu_ax": "m/s^2", "imu_ay": "m/s^2", "imu_az": "m/s^2", "lower_z": "m/s^2"})
    {'imu_a': ('imu_ax', 'imu_ay', 'imu_az')}
    """
    found: dict[str, Axes] = {}
    accelerations = {name for name, unit in units.items() if unit == "m/s^2"}
    for name in units:
        for at in (k for k, letter in enumerate(name) if letter in "xX"):
            letters = "xyz" if name[at] == "x" else "XYZ"
            first, second, third = (f"{name[:at]}{letter}{name[at + 1 :]}" for letter in letters)
            if {first, second, third} <= accelerations:
                stem = f"{name[:at]}{name[at + 1 :]}".strip(" _-./") or "accelerometer"
                found.setdefault(stem, (first, second, third))
    return found


# ---- helpers ---------------------------------------------------------------------------------------


def _require_axes(health: Health, axes: Sequence[str]) -> Axes:
    if len(set(axes)) != 3 or len(axes) != 3:
        raise InputError(f"the axes of a sensor are {_join(axes)}: give three different channels")
    known = {channel.name: channel for channel in health.channels}
    for name in axes:
        if name not in known:
            raise InputError(f"the axis {name!r} was not inspected: give one of {_join(known)}")
        if known[name].unit != "m/s^2":
            raise InputError(f"the axis {name!r} is in {known[name].unit}: give three accelerations")
        if known[name].mute:
            raise InputError(f"the axis {name!r} is mute, so it is no axis: check the wiring and the export")
    return axes[0], axes[1], axes[2]


def _find_stretches(flags: np.ndarray, least: float) -> list[np.ndarray]:
    """Return the indices of each run of flags that is long enough."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    runs = [np.arange(first, stop) for first, stop in zip(edges[0::2], edges[1::2], strict=True)]
    return [run for run in runs if run.size >= least - 1e-9]


def _angle(one: FloatArray, other: FloatArray) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def _make_unit(vector: FloatArray) -> Vector:
    x, y, z = (float(each) for each in vector / np.linalg.norm(vector))
    return x, y, z


def _join(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names))
