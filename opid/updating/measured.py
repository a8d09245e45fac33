"""Measured backbones, frequency and amplitude of each sensor at phase resonance, and their CSV files.

A file has a column of frequencies and one of first-harmonic amplitudes for each sensor, in any unit of motion.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from opid.errors import InputError, nearest
from opid.provenance import ReadFile, read_file
from opid.signals.files import write_whole
from opid.signals.frequency_tables import FREQUENCY_NAMES, find_frequency, read_table
from opid.signals.motion import DERIVATIVES
from opid.signals.recording import FloatArray
from opid.signals.units import split_unit, to_si

LEAST_POINTS = 3  # points of a backbone: fewer do not make a curve

# units of columns that are left out: force, voltage, current, phase, strain
NO_MOTION = ("N", "V", "A", "rad", "1", "strain", "N*m")


@dataclass(frozen=True, eq=False)
class MeasuredBackbone:
    """One backbone of one mode, measured in one test.

    Args:
        name: the name of the test (that of the sensor whose quadrature was held, for example).
        mode: number of the mode, from 1.
        controlled_sensor: the sensor at whose amplitudes the model is solved.
        frequency_hz: (n_points,) frequencies, Hz.
        amplitude: (n_points, n_sensors) first-harmonic amplitude of displacement, m, with the sign of the phase;
            columns in the order of `sensors`.
        sensors: names of the sensors.
        files: the file of the backbone, and those of its study.

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
    files: tuple[ReadFile, ...] = ()

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
                f"backbone {self.name!r} has values that are not finite, or frequencies that are not positive: leave "
                "these points out"
            )
        if self.controlled_sensor not in sensors:
            raise InputError(
                f"backbone {self.name!r} is controlled at {self.controlled_sensor!r}, which is not one of its sensors: "
                f"{nearest(self.controlled_sensor, sensors)}"
            )
        held = np.abs(amplitude[:, sensors.index(self.controlled_sensor)])
        if (held <= 0).any() or (np.diff(held) <= 0).any():
            at = int(np.argmax(np.diff(held) <= 0)) + 1 if (held > 0).all() else int(np.argmin(held))
            raise InputError(
                f"the amplitude at {self.controlled_sensor!r} of backbone {self.name!r} does not grow at point "
                f"{at + 1}: sort the points, leave out those that fall back, or name the sensor that was controlled"
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


def by_mode(backbones: Iterable[MeasuredBackbone]) -> dict[int, list[MeasuredBackbone]]:
    """Return the backbones of each mode, the modes in order."""
    curves = list(backbones)
    return {mode: [one for one in curves if one.mode == mode] for mode in sorted({one.mode for one in curves})}


# ---- files -----------------------------------------------------------------------------------------


def read_backbone(
    path: str | os.PathLike[str],
    *,
    mode: int,
    controlled_sensor: str,
    sensors: Sequence[str] | None = None,
    unit: str | None = None,
    name: str | None = None,
) -> MeasuredBackbone:
    """Return the backbone that a CSV file holds, amplitudes of displacement in m.

    Args:
        path: a text with a header: `frequency_hz` (or `frequency [Hz]`, `omega [rad/s]`) and one column for each sensor
            with the amplitude of its first harmonic, the unit in brackets (`10 [mm]`); columns are separated by commas,
            semicolons or tabs. An acceleration is divided by (2 pi f)^2, a velocity by 2 pi f. Columns of a force, a
            voltage or a phase are left out.
        mode: number of the mode, from 1.
        controlled_sensor: the sensor at whose amplitudes the model is solved.
        sensors: sensors of the structure: any other column of motion is refused; where left out, every column of
            motion is a sensor.
        unit: unit of the columns that state none; metres where left out.
        name: name of the backbone; that of the file where left out.

    Raises:
        InputError: no such file, no header, no or two columns of frequencies, a column that is not a sensor, a unit
            that is not one of motion, a cell that is not a number, amplitudes that no structure has, metres that are
            called millimetres, or what `MeasuredBackbone` refuses.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     path = Path(directory, "mode1.csv")
    ...     _ = path.write_text("frequency_hz,tip [mm]\\n14.6,0.2\\n14.8,1\\n15.1,2\\n")
    ...     read_backbone(path, mode=1, controlled_sensor="tip").amplitude.ravel().tolist()
    [0.0002, 0.001, 0.002]
    """
    source = Path(path)
    if not source.is_file():
        raise InputError(f"there is no backbone {path}: check the name")
    try:
        read = _read_curve(source, mode, controlled_sensor, sensors, unit, source.stem if name is None else name)
        return replace(read, files=(read_file(source),))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error


def write_backbone(backbone: MeasuredBackbone, path: str | os.PathLike[str]) -> None:
    """Write a backbone to a CSV file that `read_backbone` reads back, amplitudes in m; a failure leaves no half file.

    Args:
        backbone: the measured backbone.
        path: the file; its directory must exist.

    Raises:
        InputError: a directory that is not there, or a sensor whose name a header cannot hold.
    """
    for sensor in backbone.sensors:
        if split_unit(f"{sensor} [m]") != (sensor, "m") or "\n" in sensor or sensor.casefold() in FREQUENCY_NAMES:
            raise InputError(f"the sensor {sensor!r} cannot be the name of a column of {path}: rename it")
    with write_whole(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frequency_hz", *(f"{sensor} [m]" for sensor in backbone.sensors)])
        for frequency, row in zip(backbone.frequency_hz, backbone.amplitude, strict=True):
            writer.writerow([repr(float(value)) for value in (frequency, *row)])


def _read_curve(
    source: Path, mode: int, controlled: str, sensors: Sequence[str] | None, unit: str | None, name: str
) -> MeasuredBackbone:
    header, values = read_table(source, "frequency_hz,1 [mm],2 [mm]")
    frequency_hz, column = find_frequency(header, values)
    own: dict[str, FloatArray] = {}
    units: dict[str, str | None] = {}
    for index, cell in enumerate(header):
        if index == column:
            continue
        sensor, given = (cell, None) if sensors is not None and cell in sensors else split_unit(cell)
        found = _to_displacement(sensor, given or unit, values[:, index], frequency_hz)
        if found is None:
            continue
        if sensors is not None and sensor not in sensors:
            raise InputError(f"the column {cell!r} is not a sensor of the structure: {nearest(sensor, sensors)}")
        if sensor in own:
            raise InputError(f"the sensor {sensor!r} has two columns: leave one out")
        own[sensor], units[sensor] = found, given or unit
    if not own:
        raise InputError("it has no column of a sensor: give one column of amplitudes for each sensor")
    _require_credible(own, units)
    order = [sensor for sensor in sensors if sensor in own] if sensors is not None else list(own)
    amplitude = np.column_stack([own[sensor] for sensor in order])
    return MeasuredBackbone(name, mode, controlled, frequency_hz, amplitude, tuple(order))


def _to_displacement(sensor: str, unit: str | None, values: FloatArray, frequency_hz: FloatArray) -> FloatArray | None:
    """Return the amplitude of displacement, m; None for a column of another quantity."""
    factor, quantity = to_si(unit or "m")
    if quantity in NO_MOTION:
        return None
    if quantity not in DERIVATIVES:
        raise InputError(f"the amplitude of sensor {sensor!r} is in {unit!r}: give a unit of motion, like mm or m/s^2")
    return factor * values / (2 * np.pi * frequency_hz) ** DERIVATIVES[quantity]


def _require_credible(own: dict[str, FloatArray], units: dict[str, str | None]) -> None:
    """Refuse amplitudes whose unit must be wrong: larger than any structure has, or micrometres in mm, cm or inches."""
    largest, sensor = max((float(np.nanmax(np.abs(values), initial=0.0)), name) for name, values in own.items())
    stated = all(units.values())
    if largest > (1.0 if stated else 0.05):  # m; without a unit millimetres are probable
        source = "in the stated unit" if stated else "because no unit is stated"
        raise InputError(
            f"the amplitude at sensor {sensor!r} reaches {largest:.3g} m, {source}: name the unit in the header, like "
            f"'{sensor} [mm]'"
        )
    factor, quantity = to_si(units[sensor] or "m")
    if quantity == "m" and 1e-3 <= factor < 1 and 0 < largest < 1e-5:
        raise InputError(
            f"the amplitude at sensor {sensor!r} reaches {largest / factor:.3g} {units[sensor]}, {1e6 * largest:.3g} "
            "micrometres: if the numbers are metres, name the unit 'm', and if they are that small, 'µm'"
        )
