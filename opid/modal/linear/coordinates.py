"""Measured accelerations and force in modal coordinates (Pacini eqs. 2 and 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from opid.errors import InputError
from opid.modal.linear.modes import LinearModes, force_projection, modal_filter, with_sensors
from opid.signals.motion import differentiate
from opid.signals.recording import Channel, FloatArray, Recording


@dataclass(frozen=True, eq=False)
class ModalTest:
    """One test in modal coordinates, and as it was measured.

    Args:
        name: of the test.
        recording: the sensors and, where there is one, the force.
        acceleration: (n, n_modes) q'' = pinv(Phi) x'', m/s^2 kg^1/2.
        force: (n,) force at the drive point, N; None for a free decay.
        modes: linear modes that belong to this test.
        drive_point: the sensor at whose place the force acts; None for a free decay.
    """

    name: str
    recording: Recording
    acceleration: FloatArray
    force: FloatArray | None
    modes: LinearModes
    drive_point: str | None

    @property
    def fs(self) -> float:
        """Sampling rate, Hz."""
        return self.recording.fs

    def modal_force(self, mode: int) -> FloatArray:
        """(n,) f_q of a mode counted from 1, N/kg^1/2; zero in a free decay."""
        place = self.modes.place(mode)
        if self.force is None or self.drive_point is None:
            return 0.0 * self.acceleration[:, place]
        return force_projection(self.modes, self.drive_point)[place] * self.force


def modal_test(
    recording: Recording, modes: LinearModes, *, name: str, force: str | None = None, drive_point: str | None = None
) -> ModalTest:
    """Return a recording in modal coordinates.

    Args:
        recording: with a channel for each sensor of the modes, in m/s^2 or m/s; further channels are left aside.
            Sensors that it lacks are left out of the shapes, too, if those left can still tell the modes apart.
        modes: linear modes that describe the structure during this test.
        name: of the test.
        force: channel of the force, in N; None for a free decay.
        drive_point: the sensor at whose place and in whose direction it acts; needed with a force.

    Raises:
        InputError: no channel for any sensor, one that is neither an acceleration nor a velocity, a force that is no
            force, no drive point, or fewer sensors than modes.

    >>> import numpy as np
    >>> from opid.signals.recording import recording_from_arrays
    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> decay = modal_test(recording_from_arrays([[1.0, 0.5, 0.0]], ["a"], fs=10.0), modes, name="decay")
    >>> decay.acceleration[:, 0].tolist()
    [2.0, 1.0, 0.0]
    """
    sensors = [sensor for sensor in modes.sensors if sensor in recording.names]
    if not sensors:
        raise InputError(
            f"test {name!r} has none of the sensors {_listed(modes.sensors)}: its channels are "
            f"{_listed(recording.names)}; call the channels as the shapes call their sensors"
        )
    for sensor in sensors:
        if recording.unit(sensor) not in ("m/s^2", "m/s"):
            raise InputError(
                f"channel {sensor!r} of test {name!r} is in {recording.unit(sensor) or 'no unit'} where an "
                "acceleration or a velocity is needed: give its unit in [channels]"
            )
    recording = _with_accelerations(recording, sensors)
    if force is not None:
        _require_force(recording, modes, name, force, drive_point)
    accelerations = recording.samples[:, [recording.index(sensor) for sensor in sensors]]
    return ModalTest(
        name=name,
        recording=recording,
        acceleration=accelerations @ modal_filter(with_sensors(modes, sensors)).T,
        force=None if force is None else recording.channel(force),
        modes=modes,
        drive_point=drive_point if force is not None else None,
    )


def _with_accelerations(recording: Recording, sensors: Sequence[str]) -> Recording:
    """The recording, the velocities among its sensors differentiated, as those of a laser vibrometer."""
    velocities = [sensor for sensor in sensors if recording.unit(sensor) == "m/s"]
    if not velocities:
        return recording
    samples = recording.samples.copy()
    channels = list(recording.channels)
    for sensor in velocities:
        column = recording.index(sensor)
        samples[:, column] = differentiate(samples[:, column], fs=recording.fs)
        channels[column] = Channel(sensor, "m/s^2")
    history = (*recording.history, f"{', '.join(velocities)}: velocities differentiated to accelerations")
    return replace(recording, samples=samples, channels=tuple(channels), history=history)


def _require_force(recording: Recording, modes: LinearModes, name: str, force: str, drive_point: str | None) -> None:
    if drive_point is None:
        raise InputError(f"test {name!r} has a force and no drive point: say at which sensor the force acts")
    modes.row(drive_point)
    if recording.unit(force) != "N":
        raise InputError(
            f"the force channel {force!r} of test {name!r} is in {recording.unit(force) or 'no unit'} where N, "
            "kN or lbf is needed: give its unit and scale in [channels]"
        )
    if not recording.channel(force).any():
        raise InputError(f"the force {force!r} of test {name!r} is zero throughout: name the channel of the force cell")


def _listed(names: tuple[str, ...], most: int = 6) -> str:
    shown = ", ".join(repr(name) for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "")
