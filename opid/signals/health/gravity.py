"""The vertical of three-axis sensors, from gravity in the means of a log second by second."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from opid.errors import InputError
from opid.signals.health.result import Health
from opid.signals.orientation import (
    ORIENTATION,
    Axes,
    Orientation,
    OrientationSettings,
    make_unit,
    measure_angle,
)
from opid.signals.segments import find_standstill
from opid.signals.units import STANDARD_GRAVITY


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
    quiet = find_standstill(health, [names]) | (np.nan_to_num(rms, nan=np.inf).max(axis=1) < settings.quiet_m_per_s2)
    stretches = _find_stretches(quiet & complete, settings.rest_s / history.length_s)
    vibration = [float(np.median(np.linalg.norm(rms[each], axis=1))) for each in stretches]
    stretches = [
        each for each, own in zip(stretches, vibration, strict=True) if own <= settings.rolling_ratio * min(vibration)
    ]
    if not complete.any():
        raise InputError(f"the axes {_join(names)} have no second without a gap: the vertical is not known")
    at_rest = np.concatenate(stretches) if stretches else np.flatnonzero(complete)
    reading = mean[at_rest].mean(axis=0)
    gravity = float(np.linalg.norm(reading))
    if not settings.least_gravities < gravity / STANDARD_GRAVITY < settings.most_gravities:
        where = "at rest" if stretches else "on average"
        words = f"the axes {_join(names)} read {gravity:.3g} m/s^2 {where} where gravity is {STANDARD_GRAVITY:.2f}"
        if gravity > STANDARD_GRAVITY:
            raise InputError(f"{words}: an axis has a false offset or another unit; correct its `offset` or `unit`")
        raise InputError(
            f"{words}: the sensor is AC-coupled; state its upward direction in its axes, as vertical = [0, 0, 1], in "
            "[channels.NAME] of a study"
        )
    if len(stretches) > 1:
        moved = measure_angle(mean[stretches[0]].mean(axis=0), mean[stretches[-1]].mean(axis=0))
    else:
        halves = np.array_split(np.flatnonzero(complete & ~quiet if (complete & ~quiet).any() else complete), 2)
        moved = measure_angle(*(mean[half].mean(axis=0) if half.size else reading for half in halves))
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
        make_unit(reading),
        math.hypot(*unknown),
        "rest" if stretches else "mean",
        gravity,
        tuple(ends),
        moved,
        moved > explained,
    )


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


def _join(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names))
