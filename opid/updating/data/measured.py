"""Measured backbones: frequency and first-harmonic amplitude of each sensor at phase resonance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.errors import InputError, nearest
from opid.provenance import ReadFile
from opid.signals.recording import FloatArray

LEAST_POINTS = 3
"""Of a backbone: with fewer there is no curve."""


@dataclass(frozen=True, eq=False)
class MeasuredBackbone:
    """One backbone of one mode, as one test gave it.

    Args:
        name: of the test (the sensor whose quadrature was held, say).
        mode: number of the mode, from 1.
        controlled_sensor: the sensor whose amplitude is prescribed to the model.
        frequency_hz: (n_points,) Hz.
        amplitude: (n_points, n_sensors) first-harmonic amplitude of displacement, m, with the sign of the phase;
            columns in the order of `sensors`.
        sensors: names of the sensors.
        file: that it was read from, if there is one.

    Raises:
        InputError: too few points, counts that do not match, values that are not finite or not positive, or an
            amplitude at the controlled sensor that does not grow.
    """

    name: str
    mode: int
    controlled_sensor: str
    frequency_hz: FloatArray
    amplitude: FloatArray
    sensors: tuple[str, ...]
    file: ReadFile | None = None

    def __post_init__(self) -> None:
        frequency, amplitude = (np.array(getattr(self, key), dtype=np.float64) for key in ("frequency_hz", "amplitude"))
        sensors = tuple(self.sensors)
        if self.mode < 1:
            raise InputError(f"backbone {self.name!r} is of mode {self.mode}: modes are counted from 1, rigid ones too")
        if frequency.ndim != 1 or frequency.size < LEAST_POINTS:
            raise InputError(
                f"backbone {self.name!r} has {frequency.size} point(s): give at least {LEAST_POINTS}, from small "
                "amplitudes up"
            )
        if amplitude.shape != (frequency.size, len(sensors)):
            raise InputError(
                f"backbone {self.name!r} has {frequency.size} frequencies and amplitudes of shape {amplitude.shape}: "
                f"give one row for each frequency and one column for each of the {len(sensors)} sensors"
            )
        if not (np.isfinite(frequency).all() and np.isfinite(amplitude).all() and (frequency > 0).all()):
            raise InputError(
                f"backbone {self.name!r} has values that are not finite, or frequencies that are not positive"
            )
        if self.controlled_sensor not in sensors:
            raise InputError(
                f"backbone {self.name!r} is controlled at {self.controlled_sensor!r}, which is none of its sensors: "
                f"{nearest(self.controlled_sensor, sensors)}"
            )
        held = np.abs(amplitude[:, sensors.index(self.controlled_sensor)])
        if (held <= 0).any() or (np.diff(held) <= 0).any():
            at = int(np.argmax(np.diff(held) <= 0)) + 1 if (held > 0).all() else int(np.argmin(held))
            raise InputError(
                f"the amplitude at {self.controlled_sensor!r} of backbone {self.name!r} does not grow at point "
                f"{at + 1}: sort the points, leave out what crosses, or name the sensor that was controlled"
            )
        for key, array in (("frequency_hz", frequency), ("amplitude", amplitude)):
            array.flags.writeable = False
            object.__setattr__(self, key, array)
        object.__setattr__(self, "sensors", sensors)

    @property
    def controlled_amplitude(self) -> FloatArray:
        """(n_points,) amplitude at the controlled sensor, m, positive."""
        return np.abs(self.amplitude[:, self.sensors.index(self.controlled_sensor)])

    @property
    def eigenvalue(self) -> FloatArray:
        """(n_points,) lambda = (2 pi f)^2, 1/s^2."""
        return (2 * np.pi * self.frequency_hz) ** 2
