"""Three-axis sensors of a study: how each is mounted in each run, and the vertical motion that they read together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.signals.clock_matching import ClockMatch
from opid.signals.health.gravity import find_orientation
from opid.signals.health.result import Finding, Health
from opid.signals.orientation import (
    ORIENTATION,
    Axes,
    Orientation,
    angle_between,
    find_motion_along,
    follow_attitude,
    mean_orientation,
    say_alignment,
    say_movement,
    say_orientation,
    state_orientation,
)
from opid.signals.recording import Channel, FloatArray, Recording
from opid.suspensions.study import Run

AXES: Axes = ("x", "y", "z")


@dataclass(frozen=True)
class TriaxialSensor:
    """A three-axis accelerometer of a run, and what is stated of how it is mounted.

    Args:
        name: name that the channel of its vertical motion will have.
        has_gyroscope: whether its angular rates are recorded, too.
        vertical: its upward direction in its axes, as the user states it; empty where gravity tells it.
        tilt_tolerance_deg: standard deviation of the angle of the vertical, degrees; None for the usual one.
    """

    name: str
    has_gyroscope: bool = False
    vertical: tuple[float, ...] = ()
    tilt_tolerance_deg: float | None = None

    @property
    def axes(self) -> Axes:
        """Names of its axes in the recording."""
        first, second, third = (f"{self.name}.{axis}" for axis in AXES)
        return first, second, third

    @property
    def rates(self) -> Axes:
        """Names of the rates of its gyroscope in the recording."""
        first, second, third = (f"{self.name}.rate_{axis}" for axis in AXES)
        return first, second, third

    def find(self, health: Health) -> Orientation:
        """Return how it is mounted, as stated or from gravity.

        Args:
            health: what was found in the log.

        Raises:
            InputError: as for `find_orientation` and `state_orientation`.
        """
        std_rad = None if self.tilt_tolerance_deg is None else math.radians(self.tilt_tolerance_deg)
        if self.vertical:
            return state_orientation(self.axes, self.vertical, std_rad=std_rad)
        found = find_orientation(health, self.axes)
        return found if std_rad is None else replace(found, std_rad=std_rad)


@dataclass(frozen=True)
class Mounting:
    """What the mounting of a sensor leaves unknown, for the estimator.

    Args:
        leaks: channel of a motion across, and the standard deviation of the fraction that leaks in.
        gain_tolerance: standard deviation of its gain; 0 if it reads gravity as it is.
    """

    leaks: tuple[tuple[str, float], ...]
    gain_tolerance: float


def describe_mounting(name: str, sensor: TriaxialSensor, found: Orientation, health: Health) -> Iterator[Finding]:
    """Yield what is noteworthy about how a sensor is mounted.

    Args:
        name: its channel.
        sensor: what is stated.
        found: how it is mounted.
        health: what was found in its log.
    """
    yield Finding("note", "orientation", name, say_orientation(found))
    if found.has_slipped:
        yield Finding("warning", "sensor_moved", name, say_movement(found))
    if found.method == "stated":
        try:
            by_gravity = find_orientation(health, sensor.axes)
        except InputError:
            return  # The user states the vertical because the log does not tell it.
        angle, std_rad = angle_between(found, by_gravity), math.hypot(found.std_rad, by_gravity.std_rad)
        if angle > 4 * std_rad:
            words = (
                f"the stated vertical and gravity in its log are {math.degrees(angle):.1f} degrees apart: correct "
                "vertical, or leave it out"
            )
            yield Finding("warning", "false_vertical", name, words)


def level_runs(
    runs: Sequence[Run], sensors: Sequence[Mapping[str, TriaxialSensor]], *, level_pair: tuple[str, str] | None = None
) -> tuple[list[Run], dict[str, Mounting]]:
    """Replace the axes of each three-axis sensor by its motion up and in two directions across.

    Of a pair on a suspension that moves horizontally it is the motion along the direction in which both move, and those
    across are the other one and that up.

    A sensor whose vertical is the same in all runs was not touched between them: the mean is taken, and the fractions
    that leak in are the same in all runs. Otherwise each run has its own vertical and its own fractions: the motion
    across is then a channel for each run, which is zero in the others.

    Args:
        runs: runs whose recordings hold the axes.
        sensors: the three-axis sensors of each run.
        level_pair: the two channels of a suspension that moves horizontally, the one that drives it first; None for
            vertical motion.

    Returns:
        The runs, and the mounting of each sensor by its name.

    Raises:
        InputError: a sensor that has three axes in some runs and one channel in others, or rates that are no angular
            rates.
    """
    names = list(dict.fromkeys(name for each in sensors for name in each))
    mountings = {}
    levelled = list(runs if level_pair is None else _find_level_motion(runs, sensors, level_pair))
    for name in names:
        if not all(name in each for each in sensors):
            raise InputError(
                f"{name!r} has three axes in some runs and one channel in others: give axes in all of them"
            )
        every = [run.orientations[name] for run in levelled]
        is_one = all(angle_between(every[0], each) <= ORIENTATION.same_rad for each in every)
        used = [mean_orientation(every)] * len(runs) if is_one else every
        across = [f"{name}_across_{number}" for number in (1, 2)]
        own = [across if is_one else [f"{channel} of {run.name}" for channel in across] for run in runs]
        leaks = {
            channel: std_rad
            for channels, each in zip(own, used, strict=True)
            for channel, std_rad in zip(channels, each.stds_across_rad, strict=True)
        }
        for k, (orientation, sensor) in enumerate(zip(used, (each[name] for each in sensors), strict=True)):
            levelled[k] = replace(
                levelled[k],
                recording=_level(levelled[k].recording, sensor, orientation, own[k], list(leaks)),
                orientations={**levelled[k].orientations, name: orientation},
                clocks=tuple(_name_in_match(match, sensor) for match in levelled[k].clocks),
            )
            if not is_one:
                words = (
                    f"its mounting in this run is up to {_largest_angle(every):.1f} degrees from that of another run: "
                    "it was mounted anew or stood on another slope, so what leaks in is fitted for each run"
                )
                finding = Finding("note", "orientation", name, words)
                levelled[k] = replace(levelled[k], findings=(*levelled[k].findings, finding))
        off = max(abs(each.gain_error) for each in used)
        mountings[name] = Mounting(tuple(leaks.items()), off if off > ORIENTATION.gain_error else 0.0)
    return levelled, mountings


def _find_level_motion(
    runs: Sequence[Run], sensors: Sequence[Mapping[str, TriaxialSensor]], pair: tuple[str, str]
) -> list[Run]:
    """Return the runs with the direction in which the sensors of a pair move, of one sign in all of them."""
    found: list[Run] = []
    for run, own in zip(runs, sensors, strict=True):
        lacking = [name for name in pair if name not in own]
        if lacking:
            raise InputError(
                f"run {run.name!r}: two three-axis sensors tell together in which horizontal direction they move, and "
                f"{lacking[0]!r} has no axes: give the axes of both sensors, or one channel of each"
            )
        first, second = (_take(run.recording, own[name].axes) for name in pair)
        mounted = run.orientations[pair[0]], run.orientations[pair[1]]
        try:
            below, above, turned = find_motion_along(first, second, mounted, fs=run.recording.fs)
        except NotDeterminedError as error:
            raise InputError(f"run {run.name!r}, the axes of {' and '.join(map(repr, pair))}: {error}") from None
        if found and np.dot(found[0].orientations[pair[0]].along or (), below.along or ()) < 0:
            below, above = below.reverse(), above.reverse()
        words = f"against {pair[0]!r} it is {say_alignment(turned)}"
        found.append(
            replace(
                run,
                orientations={**run.orientations, **dict(zip(pair, (below, above), strict=True))},
                findings=(*run.findings, Finding("note", "orientation", pair[1], words)),
            )
        )
    return found


def _name_in_match(match: ClockMatch, sensor: TriaxialSensor) -> ClockMatch:
    """Return a match of clocks that names a sensor in the place of its axes: what is left of its lag is fitted."""
    if not {*sensor.axes} <= {*match.channels}:
        return match
    gone = {*sensor.axes, *(sensor.rates if sensor.has_gyroscope else ())}
    return replace(match, channels=(sensor.name, *(each for each in match.channels if each not in gone)))


def _level(
    recording: Recording, sensor: TriaxialSensor, orientation: Orientation, own: Sequence[str], across: Sequence[str]
) -> Recording:
    """Return a recording with the levelled motion of a sensor in place of its axes."""
    attitude = None
    if sensor.has_gyroscope:
        wrong = [name for name in sensor.rates if recording.unit(name) != "rad/s"]
        if wrong:
            raise InputError(f"the rate {wrong[0]!r} is in {recording.unit(wrong[0])}: give angular rates, as deg/s")
        attitude = follow_attitude(_take(recording, sensor.rates), fs=recording.fs, vertical=orientation.vertical)
    up, *sideways = orientation.level(_take(recording, sensor.axes), attitude).T
    zeros = np.zeros_like(up)
    beside = [dict(zip(own, sideways, strict=True)).get(name, zeros) for name in across]
    gone = {*sensor.axes, *(sensor.rates if sensor.has_gyroscope else ())}
    kept = [k for k, name in enumerate(recording.names) if name not in gone]
    return replace(
        recording,
        samples=np.column_stack([up, *beside, recording.samples[:, kept]]),
        channels=(
            *(Channel(name, "m/s^2") for name in (sensor.name, *across)),
            *(recording.channels[k] for k in kept),
        ),
        history=(*recording.history, f"{sensor.name}: {say_orientation(orientation)}"),
    )


def _take(recording: Recording, names: Sequence[str]) -> FloatArray:
    return np.stack([recording.channel(name) for name in names], axis=1)


def _largest_angle(orientations: Sequence[Orientation]) -> float:
    """Return the largest angle between the first vertical and another, degrees."""
    return math.degrees(max(angle_between(orientations[0], each) for each in orientations))
