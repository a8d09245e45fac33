"""Measured backbones, frequency and amplitude of each sensor at phase resonance, from CSV files, decays and resonances.

A CSV file has a column of frequencies and one of first-harmonic amplitudes for each sensor, in any unit of motion, and
may have columns of higher harmonics. The result.json of `opid decay` or `opid resonance` gives the amplitude of one
sensor.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from opid.errors import FileError, InputError, count_repeats, nearest
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.structure import read_only
from opid.provenance import ReadFile, read_file
from opid.result import load_document
from opid.signals.files import write_whole
from opid.signals.frequency_tables import FREQUENCY_NAMES, find_frequency, read_table
from opid.signals.motion import DERIVATIVES
from opid.signals.recording import FloatArray, has_usual_size
from opid.signals.units import split_unit, to_si
from opid.updating.settings import UPDATING

LARGEST_M = 1.0  # amplitude above which the unit must be wrong
LEAST_POINTS = 3  # points of a backbone: fewer do not make a curve

COMMANDS = {"opid.decay/1": "decay", "opid.resonance/1": "resonance"}
"""The commands whose result.json holds backbones, by the schema."""

HIGHER = re.compile(r"(.+)_h([2-9]|[1-9]\d+)")
"""The column of a higher harmonic: sensor, then its number."""

# units of columns that are left out: force, voltage, current, phase, strain
NO_MOTION = ("N", "V", "A", "rad", "1", "strain", "N*m")


Direction = Literal["x", "y", "z"]
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)


@dataclass(frozen=True)
class Place:
    """Where a sensor is, and the direction of the motion that it reads.

    Args:
        position: x, y and z, m.
        direction: "x", "y" or "z".

    Raises:
        InputError: another direction, or a position that is not three finite numbers.
    """

    position: tuple[float, float, float]
    direction: Direction = "z"

    def __post_init__(self) -> None:
        if self.direction not in DIRECTIONS:
            raise InputError(f"the direction is {self.direction!r}: give one of {', '.join(DIRECTIONS)}")
        if np.shape(self.position) != (3,) or not np.isfinite(self.position).all():
            raise InputError(f"the position is {self.position!r}: give x, y and z in m")


@dataclass(frozen=True, eq=False)
class SensorHarmonic:
    """A higher harmonic of the motion of one sensor along a backbone.

    Args:
        sensor: name of the sensor.
        order: number of the harmonic, from 2.
        amplitude: (n_points,) its amplitude a_h, m, in the motion sum_h a_h cos(h omega t) in which that of the
            controlled sensor at its first harmonic is positive.

    Raises:
        InputError: a number below 2, or values that are not finite.
    """

    sensor: str
    order: int
    amplitude: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", read_only(self.amplitude))
        if self.order != int(self.order) or self.order < 2:
            raise InputError(f"harmonic {self.order} of {self.sensor!r} is no higher one: give a whole number from 2")
        if not np.isfinite(self.amplitude).all():
            raise InputError(
                f"harmonic {self.order} of {self.sensor!r} has values that are not finite: leave its column or these "
                "points out"
            )


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
        drive: the sensor at which the force acts; "" where the force is not known.
        force_n: (n_points,) the part of the force that works, N: the work of a cycle over pi times the amplitude of the
            drive point, which is the force where it is in quadrature with the drive point; None where it is not known.
        day: what the curves of one test day have in common, such as its date; "" where it is not known.
        harmonics: higher harmonics of some of the sensors.

    Raises:
        InputError: too few points, counts that do not match, values that are not finite or not positive, an amplitude
            at the controlled sensor that does not grow, a force without a drive point that is one of the sensors, or a
            higher harmonic that is given twice, of no sensor, or larger than any first one.
    """

    name: str
    mode: int
    controlled_sensor: str
    frequency_hz: FloatArray
    amplitude: FloatArray
    sensors: tuple[str, ...]
    files: tuple[ReadFile, ...] = ()
    drive: str = ""
    force_n: FloatArray | None = None
    day: str = ""
    harmonics: tuple[SensorHarmonic, ...] = ()

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
        if not (has_usual_size(frequency) and has_usual_size(amplitude)):
            raise InputError(f"backbone {self.name!r} has values of a size that nothing measures: correct its units")
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
        self._check_force()
        object.__setattr__(self, "harmonics", tuple(self.harmonics))
        self._check_harmonics()

    def _check_harmonics(self) -> None:
        known = frozenset(self.sensors)
        repeated = count_repeats((each.sensor, each.order) for each in self.harmonics)
        largest = np.abs(self.amplitude).max(axis=1)
        for each in self.harmonics:
            named = f"harmonic {each.order} of {each.sensor!r} in backbone {self.name!r}"
            if each.sensor not in known:
                hint = nearest(each.sensor, self.sensors)
                raise InputError(f"{named} belongs to no sensor with a first harmonic: give that, too, or {hint}")
            if (each.sensor, each.order) in repeated:
                raise InputError(f"{named} is given twice: leave one out")
            if each.amplitude.shape != self.frequency_hz.shape:
                raise InputError(
                    f"{named} has the shape {each.amplitude.shape} for {self.frequency_hz.size} points: give one "
                    "number for each"
                )
            if (np.abs(each.amplitude) > largest).any():
                at = int(np.argmax(np.abs(each.amplitude) / largest))
                raise InputError(
                    f"{named} is {abs(each.amplitude[at]):.3g} m at point {at + 1}, where no first harmonic is more "
                    f"than {largest[at]:.3g} m: correct its unit, or leave it out"
                )

    def _check_force(self) -> None:
        if (self.force_n is None) != (not self.drive):
            raise InputError(
                f"backbone {self.name!r} has {'no force' if self.drive else 'a force'} and "
                f"{f'the drive point {self.drive!r}' if self.drive else 'no drive point'}: give both or neither"
            )
        if self.force_n is None:
            return
        if self.drive not in self.sensors:
            raise InputError(
                f"the force of backbone {self.name!r} acts at {self.drive!r}, which is not one of its sensors: "
                f"{nearest(self.drive, self.sensors)}"
            )
        force = np.array(self.force_n, dtype=np.float64)
        moved = self.amplitude[:, self.sensors.index(self.drive)]
        if force.shape != self.frequency_hz.shape:
            raise InputError(
                f"backbone {self.name!r} has a force of shape {force.shape} for {self.frequency_hz.size} points: give "
                "one number for each"
            )
        if not (np.isfinite(force) & (force > 0)).all():
            raise InputError(
                f"the force of backbone {self.name!r} is {force.min():.3g} N at one point: give positive amplitudes"
            )
        if not moved.all():
            raise InputError(
                f"the drive point {self.drive!r} of backbone {self.name!r} does not move at one point: leave that out, "
                "or name the point where the force acts"
            )
        force.flags.writeable = False
        object.__setattr__(self, "force_n", force)

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


def list_sensors(curves: Sequence[MeasuredBackbone]) -> tuple[str, ...]:
    """Return the sensors of any of the curves."""
    return tuple(dict.fromkeys(name for one in curves for name in one.sensors))


def spread_sensors(values: FloatArray, own: Sequence[str], sensors: Sequence[str]) -> FloatArray:
    """Return values of some sensors, (..., n_own), as columns of all, (..., n_sensors), 0 for the others."""
    found = np.zeros((*values.shape[:-1], len(sensors)))
    found[..., [sensors.index(name) for name in own]] = values
    return found


def reached_extensions(system: JointedModes, backbones: Iterable[MeasuredBackbone]) -> dict[int, float]:
    """Return the largest extension of a joint in the tests of each mode, m, by the linear shape of the mode."""
    reached: dict[int, float] = {}
    for curve in backbones:
        if curve.mode > system.n_modes or not system.joints or curve.controlled_sensor not in system.sensors:
            continue
        extension = system.extension_over(curve.mode, curve.controlled_sensor) * float(curve.controlled_amplitude[-1])
        if np.isfinite(extension):
            reached[curve.mode] = max(reached.get(curve.mode, 0.0), extension)
    return reached


# ---- files -----------------------------------------------------------------------------------------


def read_backbone(
    path: str | os.PathLike[str],
    *,
    mode: int,
    controlled_sensor: str,
    sensors: Sequence[str] | None = None,
    unit: str | None = None,
    name: str | None = None,
    drive: str | None = None,
) -> MeasuredBackbone:
    """Return the backbone that a CSV file holds, amplitudes of displacement in m.

    Args:
        path: a text with a header: `frequency_hz` (or `frequency [Hz]`, `omega [rad/s]`) and one column for each sensor
            with the amplitude of its first harmonic, the unit in brackets (`10 [mm]`); columns are separated by commas,
            semicolons or tabs. An acceleration is divided by (2 pi f)^2, a velocity by 2 pi f. Columns of a voltage or
            a phase are left out, and those of a force without a drive point. `10_h3 [mm]` is the third harmonic of the
            sensor `10`, positive where it is largest together with the first one of the controlled sensor (both as
            this quantity); its acceleration is divided by (2 pi 3 f)^2.
        mode: number of the mode, from 1.
        controlled_sensor: the sensor at whose amplitudes the model is solved.
        sensors: sensors of the structure: any other column of motion is refused; where left out, every column of
            motion is a sensor.
        unit: unit of the columns that state none; metres where left out. A higher harmonic has that of the first one.
        name: name of the backbone; that of the file where left out.
        drive: the sensor at which the force of the file acts, whose column has a unit of force, like `force [N]`.

    Raises:
        InputError: no such file, no header, no or two columns of frequencies, a column that is not a sensor, a unit
            that is not one of motion, a drive point without one column of a force, a cell that is not a number,
            amplitudes that no structure has, metres that are called millimetres, an even harmonic of a velocity, or
            what `MeasuredBackbone` refuses.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     path = Path(directory, "mode1.csv")
    ...     _ = path.write_text("frequency_hz,tip [mm]\\n14.6,0.2\\n14.8,1\\n15.1,2\\n")
    ...     read_backbone(path, mode=1, controlled_sensor="tip").amplitude.ravel().tolist()
    [0.0002, 0.001, 0.002]
    """
    source = Path(path)
    if not os.path.isfile(source):
        raise FileError(f"there is no backbone {path}: check the name")
    try:
        called = source.stem if name is None else name
        read = _read_curve(source, mode, controlled_sensor, sensors, unit, called, drive or "")
        return replace(read, files=(read_file(source),))
    except InputError as error:
        raise FileError(f"{path}: {error}") from None
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error


def read_result_backbones(
    path: str | os.PathLike[str],
    *,
    mode: int,
    controlled_sensor: str,
    sensors: Sequence[str] | None = None,
    modes: JointedModes | None = None,
    name: str | None = None,
) -> tuple[list[MeasuredBackbone], float]:
    """Return the backbones that a result.json holds, and the standard deviation of a frequency, as a fraction of it.

    A result of `opid decay` gives one backbone, or one for each of its repeats; its windows are averaged in up to 20
    parts of even width of their amplitudes. One of `opid resonance` gives the levels at phase resonance or, where there
    are none, one point for each response curve, at its resonance. Amplitudes are those of one sensor, so that no shape
    is compared.

    Args:
        path: the result.json.
        mode: number of the mode, from 1.
        controlled_sensor: the sensor from which the decay was read, or one of the sensors of the resonance test.
        sensors: sensors of the structure; any where left out.
        modes: modes of the structure, by which a decay in modal coordinates becomes one of the sensor.
        name: name of the backbone, that of the folder where left out; names of repeats are added to it.

    Raises:
        InputError: no such file, or the result of another command; a sensor or a mode that it does not have; an angle;
            modal coordinates without modes; amplitudes that hardly change; or what `MeasuredBackbone` refuses.
    """
    source = Path(path)
    document = load_document(source, COMMANDS)
    called = Path(os.path.realpath(source)).parent.name if name is None else name
    try:
        if sensors is not None and controlled_sensor not in sensors:
            raise InputError(
                f"the controlled sensor {controlled_sensor!r} is not one of the structure: "
                f"{nearest(controlled_sensor, sensors)}"
            )
        if COMMANDS[document["schema"]] == "decay":
            scale = _find_decay_scale(document, mode, controlled_sensor, sensors or (), modes)
            repeats = document["repeats"]
            names = [f"{called}, {each['name']}" for each in repeats] or [called]
            tables = [_tabulate_decay(each) * [scale, 1, 1] for each in repeats or [document]]
        else:
            names, tables = [called], [_tabulate_levels(document, controlled_sensor)]
        found, errors = [], []
        for own, (amplitude, frequency_hz, std_hz) in zip(names, map(_average_parts, tables), strict=True):
            _require_credible({controlled_sensor: amplitude}, {controlled_sensor: "m"})
            found.append(
                MeasuredBackbone(
                    own, mode, controlled_sensor, frequency_hz, amplitude[:, None], (controlled_sensor,),
                    (read_file(source),),
                )
            )  # fmt: skip
            errors.append(float(np.median(std_hz / frequency_hz)))
    except InputError as error:
        raise FileError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise FileError(f"{path} is damaged ({type(error).__name__}: {error}): write it again") from None
    return found, max(errors)


def write_backbone(backbone: MeasuredBackbone, path: str | os.PathLike[str]) -> None:
    """Write a backbone to a CSV file that `read_backbone` reads back, amplitudes in m; a failure leaves no half file.

    Args:
        backbone: the measured backbone.
        path: the file; its directory must exist.

    Raises:
        InputError: a directory that is not there, or a sensor whose name a header cannot hold.
    """
    for sensor in backbone.sensors:
        is_plain = split_unit(f"{sensor} [m]") == (sensor, "m") and not HIGHER.fullmatch(sensor)
        if not is_plain or "\n" in sensor or sensor.casefold() in FREQUENCY_NAMES:
            raise FileError(f"the sensor {sensor!r} cannot be the name of a column of {path}: rename it")
    with write_whole(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        force = [] if backbone.force_n is None else [backbone.force_n]
        higher = {f"{each.sensor}_h{each.order} [m]": each.amplitude for each in backbone.harmonics}
        motions = (f"{sensor} [m]" for sensor in backbone.sensors)
        writer.writerow(["frequency_hz", *motions, *higher, *["force [N]"] * len(force)])
        for row in np.column_stack([backbone.frequency_hz, backbone.amplitude, *higher.values(), *force]):
            writer.writerow([repr(float(value)) for value in row])


def _read_curve(
    source: Path, mode: int, controlled: str, sensors: Sequence[str] | None, unit: str | None, name: str, drive: str
) -> MeasuredBackbone:
    header, values = read_table(source, "frequency_hz,1 [mm],2 [mm]")
    frequency_hz, column = find_frequency(header, values)
    own: dict[str, FloatArray] = {}
    units: dict[str, str | None] = {}
    forces: dict[str, FloatArray] = {}
    higher: list[tuple[str, int, str | None, FloatArray]] = []
    for index, cell in enumerate(header):
        if index == column:
            continue
        sensor, given = (cell, None) if sensors is not None and cell in sensors else split_unit(cell)
        if (split := HIGHER.fullmatch(sensor)) and sensor not in (sensors or ()):
            higher.append((split[1], int(split[2]), given, values[:, index]))
            continue
        factor, quantity = to_si(given or unit or "m")
        if quantity == "N":
            forces[cell] = factor * values[:, index]
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
    if drive and len(forces) != 1:
        raise InputError(
            f"it has {len(forces)} columns of a force ({', '.join(forces)}), and the drive point {drive!r} is named: "
            "give one, like 'force [N]'"
        )
    force = next(iter(forces.values())) if drive else None
    # A motion that begins half a period later has odd harmonics of the other sign.
    turn = np.sign(own[controlled]) if controlled in own else np.ones_like(frequency_hz)
    harmonics = []
    for sensor, number, given, column_of_it in higher:
        motion = _to_displacement(sensor, given or units.get(sensor) or unit, column_of_it, frequency_hz, number)
        if motion is not None:
            harmonics.append(SensorHarmonic(sensor, number, motion * turn**number))
    return MeasuredBackbone(
        name, mode, controlled, frequency_hz, amplitude, tuple(order), drive=drive, force_n=force,
        harmonics=tuple(harmonics),
    )  # fmt: skip


def _to_displacement(
    sensor: str, unit: str | None, values: FloatArray, frequency_hz: FloatArray, order: int = 1
) -> FloatArray | None:
    """Return the amplitude of a harmonic of displacement, m; None for a column of another quantity.

    The signs of the n-th derivative are those against its own first harmonic at the controlled sensor, which leads that
    of the displacement by n quarters of its period, and harmonic h by n quarters of its own.
    """
    factor, quantity = to_si(unit or "m")
    if quantity in NO_MOTION:
        return None
    if quantity not in DERIVATIVES:
        raise InputError(f"the amplitude of sensor {sensor!r} is in {unit!r}: give a unit of motion, like mm or m/s^2")
    quarters = DERIVATIVES[quantity] * (order - 1)
    if quarters % 2:
        raise InputError(
            f"harmonic {order} of {sensor!r} is that of a velocity, whose sign does not tell its phase: give an "
            "acceleration or a displacement"
        )
    return (-1) ** (quarters // 2) * factor * values / (2 * np.pi * order * frequency_hz) ** DERIVATIVES[quantity]


def _require_credible(own: dict[str, FloatArray], units: dict[str, str | None]) -> None:
    """Refuse amplitudes whose unit must be wrong: larger than any structure has, or micrometres in mm, cm or inches."""
    largest, sensor = max((float(np.nanmax(np.abs(values), initial=0.0)), name) for name, values in own.items())
    stated = all(units.values())
    if largest > (LARGEST_M if stated else 0.05):  # without a unit millimetres are probable
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


def _find_decay_scale(
    document: dict[str, Any], mode: int, controlled: str, sensors: Sequence[str], modes: JointedModes | None
) -> float:
    """Return what turns the amplitudes of a decay into those of the sensor, m."""
    if document["amplitude_unit"] == "rad":
        raise InputError("it is the decay of an angle: follow an acceleration, a velocity or a displacement")
    if document["mode"] is None:
        channel = document["settings"].get("channel")
        if channel != controlled and channel in sensors:
            raise InputError(f"the decay was read from {channel!r}: name this as the controlled sensor")
        return 1.0
    if modes is None:
        raise InputError(
            "it is a decay in modal coordinates, and the structure is not given by its modes: follow one sensor, "
            "`opid decay --channel NAME`"
        )
    if document["mode"] != mode:
        raise InputError(f"it is a decay of mode {document['mode']}, and the backbone is of mode {mode}: correct one")
    return float(np.abs(modes.at_sensors[modes.sensor(controlled), modes.index(mode)]))


def _tabulate_decay(decay: dict[str, Any]) -> FloatArray:
    """Return amplitude, frequency, Hz, and its standard deviation in each window of a decay, (n_windows, 3)."""
    names = ("amplitude", "frequency_hz", "frequency_std_hz")
    table = np.column_stack([np.array(decay[name], dtype=np.float64) for name in names])
    table = table[np.isfinite(table).all(axis=1) & (table > 0).all(axis=1)]
    low, high = table[:, 0].min(initial=np.inf), table[:, 0].max(initial=0.0)
    if len(table) < LEAST_POINTS or high < UPDATING.least_range * low:
        reached = f"from {high:.3g} to {low:.3g}" if len(table) else "nothing"
        raise InputError(
            f"the decay {decay['name']!r} shows the frequency in {len(table)} window(s), amplitudes {reached}: a "
            f"backbone needs {LEAST_POINTS} windows and amplitudes that fall to 1/{UPDATING.least_range:g}"
        )
    return table


def _tabulate_levels(document: dict[str, Any], controlled: str) -> FloatArray:
    """Return amplitude, m, frequency, Hz, and its standard deviation at each level of a resonance test, (n_levels, 3).

    The deviation is that of the law at this amplitude; it is tiny where there is no law.
    """
    levels = document["levels"]
    if not levels:
        return _tabulate_curves(document["curves"], controlled)
    if controlled not in document["sensors"]:
        raise InputError(f"its test has no sensor {controlled!r}: {nearest(controlled, document['sensors'])}")
    row = document["sensors"].index(controlled)
    driven, hz, modal = (
        np.array([each[key] for each in levels], dtype=np.float64) for key in ("driven_hz", "resonance_hz", "amplitude")
    )
    amplitude = np.array([each["sensors"][row][0] for each in levels]) / (2 * np.pi * driven) ** 2
    law = document["backbone_law"] or document["records_law"]
    std = np.interp(modal, law["amplitude"], law["frequency_std_hz"]) if law else np.zeros_like(hz)
    return np.column_stack([amplitude, hz, np.maximum(std, 1e-9 * hz)])


def _tabulate_curves(curves: list[dict[str, Any]], controlled: str) -> FloatArray:
    """Return amplitude, m, frequency, Hz, and its standard deviation at resonance of each response curve, (n, 3)."""
    known = list(dict.fromkeys(each["sensor"] for each in curves))
    if controlled not in known:
        raise InputError(f"its curves have no sensor {controlled!r}: {nearest(controlled, known)}")
    found = [each["resonance"] for each in curves if each["sensor"] == controlled and each["resonance"]]
    if len(found) < LEAST_POINTS:
        raise InputError(
            f"{len(found)} of its response curves have points near phase resonance and a law: a backbone needs "
            f"{LEAST_POINTS}, each at a level of its own"
        )
    table = np.array([[each["motion"], each["hz"], each["hz_std_at_motion"]] for each in found], dtype=np.float64)
    return table[np.argsort(table[:, 0])]


def _average_parts(table: FloatArray) -> FloatArray:
    """Return amplitude, frequency and its standard deviation in parts of even width of the amplitude, (3, n_points).

    Each is the mean of the rows in its part, weighted by the inverse of their variances; a part may be empty.
    """
    amplitude, _, std = table.T
    edges = np.linspace(amplitude.min(), amplitude.max(), UPDATING.n_parts + 1)
    part = np.searchsorted(edges[1:-1], amplitude, side="right")
    weight = 1 / std**2
    total = np.bincount(part, weight, minlength=UPDATING.n_parts)
    sums = [np.bincount(part, weight * column, minlength=UPDATING.n_parts) for column in table.T[:2]]
    there = total > 0
    return np.array([*(each[there] / total[there] for each in sums), total[there] ** -0.5])
