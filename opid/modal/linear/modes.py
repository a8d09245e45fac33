"""Linear modes as they come from a modal test, and records in their coordinates (Pacini eqs. 2 and 3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from opid.errors import InputError, count_repeats, list_names, nearest
from opid.mechanics.structure import Structure, natural_frequencies
from opid.modal.settings import MODAL
from opid.signals.health.inspection import clipped_fractions
from opid.signals.motion import DERIVATIVES, differentiate
from opid.signals.recording import LEAST_SIZE, Channel, FloatArray, Recording, has_usual_size

ACCELERATION, STRAIN_ACCELERATION = "m/s^2", "strain/s^2"  # units of the second derivatives of what sensors read

READINGS = {
    **{unit: (2 - number, ACCELERATION) for unit, number in DERIVATIVES.items()},
    "strain": (2, STRAIN_ACCELERATION),
    STRAIN_ACCELERATION: (0, STRAIN_ACCELERATION),
}
"""Units in which sensors read, how often each is differentiated, and the unit that it has then."""


@dataclass(frozen=True, eq=False)
class LinearModes:
    """Natural frequencies, damping ratios and mass-normalised shapes, rigid-body modes (0 Hz) included.

    Args:
        frequency_hz: (n_modes,) natural frequencies, Hz; 0 for a rigid-body mode.
        damping_ratio: (n_modes,) fraction of critical damping; that of a rigid-body mode has no effect.
        shapes: (n_sensors, n_modes), one mass-normalised shape a column, kg^-1/2, so that x = shapes q; the row of a
            strain gauge is the strain for each modal coordinate, 1/m kg^-1/2.
        sensors: names of the sensors, one a row of `shapes`.
        strains: names of the sensors that are strain gauges; `modal_test` and `ModalStudy` take them from the channels.

    Raises:
        InputError: counts that do not match, values that are not finite, a negative frequency, a damping ratio outside
            0 .. 1, a mode that no sensor sees, a repeated sensor, or a strain of no sensor.

    >>> modes = LinearModes([0.0, 25.0], [0.0, 0.004], [[0.5, 0.3], [0.5, -0.3]], ("left", "right"))
    >>> modes.n_modes, modes.row("left").tolist()
    (2, [0.5, 0.3])
    """

    frequency_hz: FloatArray
    damping_ratio: FloatArray
    shapes: FloatArray
    sensors: tuple[str, ...]
    strains: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, n_axes in (("frequency_hz", 1), ("damping_ratio", 1), ("shapes", 2)):
            array = _to_real(name, getattr(self, name))
            if array.ndim != n_axes or array.size == 0:
                needed = "one number a mode" if n_axes == 1 else "one row a sensor and one column a mode"
                raise InputError(f"{name} has shape {array.shape}: give {needed}")
            if not np.isfinite(array).all():
                raise InputError(f"{name} has values that are not finite: leave out the modes that were not identified")
            if not has_usual_size(array):
                raise InputError(
                    f"{name} has values up to {np.abs(array).max():.3g}, which no structure has: correct them"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if isinstance(self.sensors, str):
            raise InputError(f"sensors is {self.sensors!r}: give a sequence of names, one for each row of shapes")
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "strains", tuple(self.strains))
        _require_counts(self)
        wrong = np.flatnonzero((self.frequency_hz != 0) & (self.frequency_hz < LEAST_SIZE))
        if wrong.size:
            raise InputError(f"frequency_hz holds {self.frequency_hz[wrong[0]]:g} Hz: give 0 for rigid-body modes")
        wrong = np.flatnonzero((self.damping_ratio < 0) | (self.damping_ratio >= 1))
        if wrong.size:
            raise InputError(
                f"the damping ratio of mode {wrong[0] + 1} is {self.damping_ratio[wrong[0]]:g}: give the fraction of "
                "critical damping, from 0 to 1 (0.004, not 0.4 %)"
            )
        silent = np.flatnonzero(~self.shapes.any(axis=0))
        if silent.size:
            raise InputError(f"the shape of mode {silent[0] + 1} is zero at every sensor: leave the mode out")

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return self.frequency_hz.size

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """(n_modes,) whether a mode has a frequency above zero."""
        return self.frequency_hz > 0

    def row(self, sensor: str) -> FloatArray:
        """(n_modes,) entry of each shape at the sensor called `sensor`; InputError names the nearest sensor."""
        if sensor not in self.sensors:
            raise InputError(f"there is no sensor {sensor!r} among the shapes: {nearest(sensor, self.sensors)}")
        return self.shapes[self.sensors.index(sensor)]

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of the second derivative of what each sensor reads: m/s^2, or strain/s^2 of a strain gauge."""
        return tuple(STRAIN_ACCELERATION if name in self.strains else ACCELERATION for name in self.sensors)

    def unit(self, sensor: str) -> str:
        """Unit of the second derivative of what a sensor reads; InputError names the nearest sensor."""
        self.row(sensor)
        return self.units[self.sensors.index(sensor)]

    def stiffness(self) -> FloatArray:
        """(n_modes,) k0 = omega^2, 1/s^2 (Pacini eq. 5)."""
        return (2 * np.pi * self.frequency_hz) ** 2

    def damping(self) -> FloatArray:
        """(n_modes,) c0 = 2 zeta omega, 1/s (Pacini eq. 6)."""
        return 2 * self.damping_ratio * (2 * np.pi * self.frequency_hz)

    def index(self, mode: int) -> int:
        """Column of a mode, which users count from 1; InputError for a mode that is not there."""
        if mode not in range(1, self.n_modes + 1):
            raise InputError(f"there is no mode {mode}: give a number from 1 to {self.n_modes}")
        return int(mode) - 1

    def neighbours_hz(self, mode: int) -> tuple[float, float]:
        """Return the frequencies of the next elastic modes below and above a mode, Hz; 0 or infinity without one."""
        own = self.frequency_hz[self.index(mode)]
        below, above = (self.frequency_hz[side] for side in (self.frequency_hz < own, self.frequency_hz > own))
        return float(below.max(initial=0.0)), float(above.min(initial=np.inf))


def weigh_sensors(modes: LinearModes) -> FloatArray:
    """Return the weights of the sensors by which strains count as much as motions, (n_sensors,); 1 where all are alike.

    The shapes of strain gauges get the rms that those of the other sensors have over the elastic modes, and so do their
    readings: noise of the same fraction of the readings is then the same in all weighted rows. Rigid-body modes do not
    count, for they strain nothing.

    >>> modes = LinearModes([0, 9], [0, 0], [[0.4, 0.5], [0.4, -0.5], [0, 0.02]], ("a", "b", "gauge"), ("gauge",))
    >>> weigh_sensors(modes).tolist()
    [1.0, 1.0, 25.0]
    """
    shapes = modes.shapes[:, modes.elastic] if modes.elastic.any() else modes.shapes
    kinds = sorted(set(modes.units))  # accelerations come first
    rms = {unit: float(np.sqrt(np.mean(shapes[np.equal(modes.units, unit)] ** 2))) or 1.0 for unit in kinds}
    return np.array([rms[kinds[0]] / rms[unit] for unit in modes.units])


def weighted_shapes(modes: LinearModes) -> FloatArray:
    """Return the shapes, (n_sensors, n_modes), with each row times its weight of `weigh_sensors`."""
    return modes.shapes * weigh_sensors(modes)[:, np.newaxis]


def modal_filter(modes: LinearModes) -> FloatArray:
    """Return pinv(Phi), (n_modes, n_sensors): accelerations at the sensors -> modal accelerations (Pacini eq. 2).

    Where there are strain gauges, the rows of Phi have the weights W of `weigh_sensors`: it is pinv(W Phi) W.

    Args:
        modes: linear modes with at least as many sensors as modes.

    Raises:
        InputError: fewer sensors than modes, or shapes that depend on each other.

    >>> modes = LinearModes([0.0, 25.0], [0.0, 0.004], [[0.5, 0.3], [0.5, -0.3]], ("left", "right"))
    >>> bool(np.allclose(modal_filter(modes) @ modes.shapes, np.eye(2)))
    True
    """
    n_sensors, n_modes = modes.shapes.shape
    shapes = weighted_shapes(modes)
    if n_sensors < n_modes:
        raise InputError(
            f"{n_sensors} sensor(s) cannot separate {n_modes} modes: add sensors, or leave out modes that do not move"
        )
    if np.linalg.matrix_rank(shapes) < n_modes:
        raise InputError(
            f"the {n_modes} shapes depend on each other at these {n_sensors} sensors: leave out modes, or add "
            "sensors where their shapes differ"
        )
    return np.asarray(np.linalg.pinv(shapes) * weigh_sensors(modes), dtype=np.float64)


def force_projection(modes: LinearModes, drive_point: str) -> FloatArray:
    """Return Phi^T e, (n_modes,) kg^-1/2: one force at a sensor -> modal forces (Pacini eq. 3).

    Args:
        modes: linear modes of the structure.
        drive_point: name of the sensor where and in whose direction the force acts.

    Raises:
        InputError: no such sensor, or a strain gauge, whose row does not say how the point moves.
    """
    if modes.unit(drive_point) != ACCELERATION:
        raise InputError(
            f"the force acts at {drive_point!r}, which reads a strain: name a sensor that reads the motion there, or "
            "add its row to the shapes (it needs no channel)"
        )
    return modes.row(drive_point).copy()


def condition_number(modes: LinearModes) -> float:
    """Return the condition number of the shapes of `modes`: the modal filter amplifies noise and wrong shapes by it.

    Rows of strain gauges are weighted as in the filter.

    >>> round(condition_number(LinearModes([1, 2], [0, 0], [[1, 0], [0, 0.5]], ("a", "b"))), 6)
    2.0
    """
    return float(np.linalg.cond(weighted_shapes(modes)))


def modes_of_structure(structure: Structure, sensors: ArrayLike, names: Sequence[str]) -> LinearModes:
    """Return the linear modes of a structure as sensors on it see them.

    Args:
        structure: the structure; its nonlinear laws are left out.
        sensors: (n_sensors, n_dof), each row the reading of a sensor for unit motion of each degree of freedom.
        names: names of the sensors.

    Raises:
        InputError: what `LinearModes` or `natural_frequencies` refuses.
    """
    found = natural_frequencies(structure)
    return LinearModes(found.frequency_hz, np.nan_to_num(found.zeta), np.asarray(sensors) @ found.shapes, tuple(names))


def with_sensors(modes: LinearModes, sensors: Sequence[str]) -> LinearModes:
    """Return the `modes` at some of their `sensors`, in the given order; InputError for a sensor that is not there."""
    if not sensors:
        raise InputError("no sensor is asked for: name at least one")
    shapes = np.stack([modes.row(name) for name in sensors])
    unseen = np.flatnonzero(~shapes.any(axis=0))
    if unseen.size:
        raise InputError(
            f"mode {unseen[0] + 1} does not move the sensors {list_names(map(repr, sensors))}: name one that it moves, "
            "or leave the mode out"
        )
    strains = tuple(name for name in sensors if name in modes.strains)
    return replace(modes, shapes=shapes, sensors=tuple(sensors), strains=strains)


def with_units(modes: LinearModes, units: Mapping[str, str]) -> LinearModes:
    """Return the `modes` with the `units` of some sensors by their names; the same modes where nothing changes."""
    known = dict(zip(modes.sensors, modes.units, strict=True)) | {**units}
    strains = tuple(name for name in modes.sensors if known[name] == STRAIN_ACCELERATION)
    return modes if {*strains} == {*modes.strains} else replace(modes, strains=strains)


@dataclass(frozen=True, eq=False)
class AppliedForce:
    """A measured force and the place where it acts.

    Args:
        channel: the channel of the recording that holds it.
        drive_point: the sensor where and in whose direction it acts.
        samples: (n,) the force, N.
    """

    channel: str
    drive_point: str
    samples: FloatArray


@dataclass(frozen=True, eq=False)
class ModalTest:
    """One test in modal coordinates, and as it was measured.

    Args:
        name: the name of the test.
        recording: the recording of the sensors and, where there is one, of the force; velocities, displacements and
            strains in it are differentiated.
        acceleration: (n, n_modes) q'' = pinv(Phi) x'', m/s^2 kg^1/2.
        forces: the forces that act, one for each shaker; none in a free decay.
        modes: linear modes that belong to this test.
        readings: the recording before that.
    """

    name: str
    recording: Recording
    acceleration: FloatArray
    forces: tuple[AppliedForce, ...]
    modes: LinearModes
    readings: Recording

    @property
    def force(self) -> FloatArray | None:
        """(n,) the force of a test with one, N; None in a free decay. InputError for several forces."""
        return self._find_only_force().samples if self.forces else None

    @property
    def drive_point(self) -> str | None:
        """The sensor where the force of a test with one acts; None in a free decay. InputError for several forces."""
        return self._find_only_force().drive_point if self.forces else None

    @property
    def drive_points(self) -> tuple[str, ...]:
        """The sensors where the forces act, one for each force."""
        return tuple(each.drive_point for each in self.forces)

    @property
    def fs(self) -> float:
        """Sampling rate, Hz."""
        return self.recording.fs

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors of the modes that the recording has."""
        return tuple(sensor for sensor in self.modes.sensors if sensor in self.recording.names)

    @property
    def times_differentiated(self) -> tuple[int, ...]:
        """How often the reading of each of `sensors` was differentiated."""
        return tuple(READINGS[self.readings.unit(sensor)][0] for sensor in self.sensors)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of `at_sensors`."""
        return tuple(self.recording.unit(sensor) for sensor in self.sensors)

    @property
    def at_sensors(self) -> FloatArray:
        """(n, n_sensors) accelerations at `sensors`, m/s^2, and second derivatives of strains, strain/s^2."""
        return self.recording.samples[:, [self.recording.index(sensor) for sensor in self.sensors]]

    @cached_property
    def clipped(self) -> dict[str, float]:
        """The channels that are clipped, and which fraction of the samples of each."""
        return clipped_fractions(self.readings)

    @property
    def clipped_sensors(self) -> tuple[str, ...]:
        """Those of `sensors` that are clipped."""
        return tuple(sensor for sensor in self.sensors if sensor in self.clipped)

    @property
    def has_clipped_force(self) -> bool:
        """Whether a force is clipped."""
        return any(each.channel in self.clipped for each in self.forces)

    def modal_acceleration(self, mode: int) -> FloatArray:
        """(n,) q'' of a mode counted from 1, m/s^2 kg^1/2."""
        return self.acceleration[:, self.modes.index(mode)]

    def split_acceleration(self, mode: int) -> dict[int, FloatArray]:
        """Return the parts of a modal acceleration by how often their sensors' readings were differentiated."""
        kinds = sorted(set(self.times_differentiated))
        if len(kinds) == 1:
            return {kinds[0]: self.modal_acceleration(mode)}
        row = modal_filter(with_sensors(self.modes, self.sensors))[self.modes.index(mode)]
        of_kind = {times: np.equal(self.times_differentiated, times) for times in kinds}
        return {times: self.at_sensors @ np.where(own, row, 0.0) for times, own in of_kind.items()}

    def modal_force(self, mode: int) -> FloatArray:
        """(n,) f_q of a mode counted from 1, N/kg^1/2: the sum of phi_d f over the forces; zero in a free decay."""
        index = self.modes.index(mode)
        total = np.zeros(len(self.acceleration))
        for each in self.forces:
            total += self.modes.row(each.drive_point)[index] * each.samples
        return total

    def _find_only_force(self) -> AppliedForce:
        if len(self.forces) > 1:
            channels = list_names(repr(each.channel) for each in self.forces)
            raise InputError(
                f"test {self.name!r} has {len(self.forces)} forces ({channels}) "
                "where one is needed, for a response to a single force: give a test with one shaker"
            )
        return self.forces[0]


def modal_test(
    recording: Recording,
    modes: LinearModes,
    *,
    name: str,
    force: str | Mapping[str, str] | None = None,
    drive_point: str | None = None,
) -> ModalTest:
    """Return a recording in modal coordinates.

    Args:
        recording: a recording with a channel for each sensor of the modes, in m/s^2, m/s, m or strain (or strain/s^2);
            velocities are differentiated once, displacements and strains twice. Further channels are ignored. Sensors
            that it lacks are left out of the shapes, too, if the others can still separate the modes.
        modes: linear modes that describe the structure during this test.
        name: the name of the test.
        force: channel of the force, in N; None for a free decay. Of several forces, the sensor where and in whose
            direction each acts, by the name of its channel.
        drive_point: the sensor where and in whose direction a single force acts; needed with the name of its channel.

    Raises:
        InputError: no channel for any sensor, one that reads neither a motion nor a strain, a strain that no structure
            bears, a force channel with another unit or without any force, no drive point or a strain gauge as one, or
            fewer sensors than modes.

    >>> from opid.signals.recording import recording_from_arrays
    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> decay = modal_test(recording_from_arrays([[1.0, 0.5, 0.0]], ["a"], fs=10.0), modes, name="decay")
    >>> decay.acceleration[:, 0].tolist()
    [2.0, 1.0, 0.0]
    """
    sensors = [sensor for sensor in modes.sensors if sensor in recording.names]
    if not sensors:
        raise InputError(
            f"test {name!r} has none of the sensors {list_names(map(repr, modes.sensors))}: its channels are "
            f"{list_names(map(repr, recording.names))}; give the channels the names that the sensors have in the shapes"
        )
    for sensor in sensors:
        check_reading(recording, sensor, name)
    readings, recording = recording, with_accelerations(recording, sensors)
    modes = with_units(modes, {sensor: recording.unit(sensor) for sensor in sensors})
    points = _place_forces(name, force, drive_point)
    for channel, point in points.items():
        force_projection(modes, point)
        check_force(recording, channel, name)
    accelerations = recording.samples[:, [recording.index(sensor) for sensor in sensors]]
    return ModalTest(
        name=name,
        recording=recording,
        acceleration=accelerations @ modal_filter(with_sensors(modes, sensors)).T,
        forces=tuple(AppliedForce(each, point, recording.channel(each)) for each, point in points.items()),
        modes=modes,
        readings=readings,
    )


def delay_forces(test: ModalTest, delay_s: float) -> ModalTest:
    """Return a test whose forces come later by a time, s; both ends of the forces should be quiet.

    Args:
        test: a test with forces.
        delay_s: the time by which its accelerations come after its forces.
    """
    n = len(test.acceleration)
    turn = np.exp(-2j * np.pi * fft.rfftfreq(n, 1 / test.fs) * delay_s)
    late = [replace(each, samples=fft.irfft(turn * fft.rfft(each.samples), n)) for each in test.forces]
    return replace(test, forces=tuple(late))


def _to_real(name: str, given: ArrayLike) -> FloatArray:
    try:
        array = np.array(given)
        real = np.real(array).astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} is not an array of numbers: give rows of one length") from None
    if np.iscomplexobj(array):
        raise InputError(
            f"{name} is complex: give real normal modes (rotate the phase of each shape, take its real part)"
        )
    return real


def _require_counts(modes: LinearModes) -> None:
    n_sensors, n_modes = modes.shapes.shape
    counts = {"frequency_hz": modes.frequency_hz.size, "damping_ratio": modes.damping_ratio.size}
    if set(counts.values()) != {n_modes}:
        listed = ", ".join(f"{size} in {name}" for name, size in counts.items())
        turned = " (shapes are sensors x modes: transpose them)" if {*counts.values()} == {n_sensors} else ""
        raise InputError(f"{n_modes} columns in shapes, {listed}: give one value for each mode{turned}")
    if len(modes.sensors) != n_sensors:
        raise InputError(f"{n_sensors} rows in shapes and {len(modes.sensors)} names of sensors: give one for each row")
    for name in modes.strains:
        if name not in modes.sensors:
            raise InputError(f"strains names {name!r}, no sensor of the shapes: {nearest(name, modes.sensors)}")
    for name, n in count_repeats(modes.sensors).items():
        raise InputError(f"the sensor {name!r} is named {n} times: rename one")


def with_accelerations(recording: Recording, sensors: Sequence[str]) -> Recording:
    """Return the recording with velocities (of a laser vibrometer, say) differentiated to accelerations.

    Displacements and strains are differentiated twice.

    Args:
        recording: a recording.
        sensors: its channels that read a motion or a strain, see `READINGS`.
    """
    found: dict[str, list[str]] = {}
    for sensor in sensors:
        found.setdefault(recording.unit(sensor), []).append(sensor)
    steps = (
        ("m/s", "velocities differentiated to accelerations"),
        ("m", "displacements differentiated to accelerations"),
        ("strain", "strains differentiated twice"),
    )
    done = [(unit, step) for unit, step in steps if unit in found]
    if not done:
        return recording
    samples, channels = recording.samples.copy(), list(recording.channels)
    for unit, _ in done:
        times, derivative = READINGS[unit]
        for sensor in found[unit]:
            column = recording.index(sensor)
            samples[:, column] = differentiate(samples[:, column], fs=recording.fs, times=2 if times == 2 else 1)
            channels[column] = Channel(sensor, derivative)
    history = (*recording.history, *(f"{', '.join(found[unit])}: {step}" for unit, step in done))
    return replace(recording, samples=samples, channels=tuple(channels), history=history)


def check_reading(recording: Recording, sensor: str, name: str) -> None:
    """Refuse a channel of a sensor that reads neither a motion nor a strain, or a strain that no structure bears.

    Args:
        recording: a recording.
        sensor: the channel.
        name: the name of the test.

    Raises:
        InputError: another unit than those of `READINGS`, or a strain above `most_strain` of the settings.
    """
    unit = recording.unit(sensor)
    if unit not in READINGS:
        raise InputError(
            f"channel {sensor!r} of test {name!r} is in {unit or 'no unit'} where an acceleration, a velocity, a "
            "displacement or a strain is needed: give its unit in [channels]"
        )
    # The bridge of a gauge need not be balanced, so that its mean tells nothing.
    largest = float(np.ptp(recording.channel(sensor))) / 2 if unit == "strain" else 0.0
    if largest > MODAL.most_strain:
        raise InputError(
            f"channel {sensor!r} of test {name!r} swings by a strain of {largest:.3g}, and more than "
            f"{MODAL.most_strain:g} breaks a structure: give its true unit in [channels], like ustrain"
        )


def _place_forces(name: str, force: str | Mapping[str, str] | None, drive_point: str | None) -> Mapping[str, str]:
    """Return the drive point of each force by the name of its channel."""
    if not isinstance(force, str):
        return force or {}
    if drive_point is None:
        raise InputError(f"test {name!r} has a force and no drive point: name the sensor at which the force acts")
    return {force: drive_point}


def check_force(recording: Recording, force: str, name: str) -> None:
    """Refuse a force in another unit, or none.

    Args:
        recording: a recording.
        force: the channel of the force.
        name: the name of the test.

    Raises:
        InputError: the force is not in N, or zero throughout.
    """
    if recording.unit(force) != "N":
        raise InputError(
            f"the force channel {force!r} of test {name!r} is in {recording.unit(force) or 'no unit'} where N, "
            "kN or lbf is needed: name the channel of the force cell, or give its unit, in [channels] of a study or "
            "with --unit of `opid modes`"
        )
    if not recording.channel(force).any():
        raise InputError(f"the force {force!r} of test {name!r} is zero throughout: name the channel of the force cell")
