"""Response curves in the CSV files of laboratories: columns of frequency, amplitude, phase, and perhaps force."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from opid.errors import FileError, InputError, nearest
from opid.mechanics.structure import ComplexArray
from opid.modal.resonance.curves import ResponseCurve
from opid.provenance import read_file
from opid.signals.files import write_whole
from opid.signals.frequency_tables import find_frequency, read_table
from opid.signals.log import ChannelSettings
from opid.signals.motion import DERIVATIVES
from opid.signals.recording import FloatArray
from opid.signals.units import si_unit, split_unit

HEADER = ("frequency_hz", "amplitude [m/s^2]", "phase [deg]", "force [N]")
"""The header of a file that `write_curve` writes."""


@dataclass(frozen=True)
class CurveColumns:
    """Which columns of a file hold a response curve; each is found by its unit where left out.

    Args:
        frequency: frequencies; where left out, the column that is called so.
        amplitude: amplitudes of a displacement, a velocity or an acceleration.
        phase: phases of that motion over the force.
        force: amplitudes of the force.
    """

    frequency: ChannelSettings | None = None
    amplitude: ChannelSettings | None = None
    phase: ChannelSettings | None = None
    force: ChannelSettings | None = None


def read_curve(
    path: str | os.PathLike[str],
    *,
    sensor: str,
    mode: int | None = None,
    force_n: float | None = None,
    columns: CurveColumns = CurveColumns(),
    error_fraction: float = 0.01,
    name: str | None = None,
) -> ResponseCurve:
    """Return the response curve that a CSV file holds.

    Args:
        path: a text with a header, whose columns are separated by commas, semicolons or tabs: frequencies
            (`frequency [Hz]`), amplitudes of a motion (`amplitude [g]`), its phase over the force (`phase [deg]`), and
            perhaps amplitudes of the force (`force [N]`), the units in brackets.
        sensor: the sensor that was measured.
        mode: number of the mode that the curve shows, from 1; where left out, the nearest one to its peak.
        force_n: amplitude of the force at all points, N; where left out, the file has a column of it.
        columns: names and units of columns that their headers do not tell.
        error_fraction: standard deviation of force and motion, as a fraction.
        name: the name of the curve; that of the file where left out.

    Raises:
        InputError: no such file, no or several columns of a quantity, a unit of another quantity, a cell that is no
            number, no force, or what `ResponseCurve` refuses.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     path = Path(directory, "two_newton.csv")
    ...     _ = path.write_text("f [Hz],tip [mm],phase [deg]\\n10,0.5,-80\\n11,0.4,-100\\n")
    ...     curve = read_curve(path, sensor="tip", force_n=2.0)
    >>> curve.phase_deg.round(6).tolist(), curve.amplitude.round(3).tolist()
    ([100.0, 80.0], [1.974, 1.911])
    """
    source = Path(path)
    if not os.path.isfile(source):
        raise FileError(f"there is no response curve {path}: check the name")
    try:
        header, values = read_table(source, ",".join(HEADER))
        table = _Table(tuple(header), values)
        hz = find_frequency(header, values)[0] if columns.frequency is None else table.read_frequency(columns.frequency)
        motion, sign = _read_motion(table, columns, hz)
        curve = ResponseCurve(
            name=source.stem if name is None else name,
            sensor=sensor,
            frequency_hz=hz,
            amplitude=np.abs(motion) * sign,
            phase_deg=np.degrees(np.angle(motion * sign)),
            force_n=_read_force(table, columns, force_n),
            mode=mode,
            error_fraction=error_fraction,
        )
        return replace(curve, files=(read_file(source),))
    except InputError as error:
        raise FileError(f"{path}: {error}") from None
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error


def _read_motion(table: _Table, columns: CurveColumns, hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Return the complex acceleration at each point, m/s^2, and the sign that its amplitude has in the file.

    A sign that the study states for the amplitude turns the phase: the sensor reads the motion the other way round.
    """
    amplitude, unit = table.read("amplitude", columns.amplitude, tuple(DERIVATIVES))
    phase, _ = table.read("phase", columns.phase, ("rad",))
    stated = 1.0 if columns.amplitude is None else float(columns.amplitude.sign)
    motion = amplitude * np.exp(1j * phase) * (2j * np.pi * hz) ** (2 - DERIVATIVES[unit])
    return np.asarray(motion, dtype=np.complex128), np.sign(amplitude) * stated


def _read_force(table: _Table, columns: CurveColumns, force_n: float | None) -> FloatArray:
    """Return the amplitudes of the force, or the only one, N."""
    if force_n is None:
        return table.read("force", columns.force, ("N",))[0]
    if columns.force is not None:
        raise InputError("it has a number and a column for its force: give one of them")
    return np.asarray(force_n, dtype=np.float64)


def write_curve(curve: ResponseCurve, path: str | os.PathLike[str]) -> None:
    """Write a response curve to a CSV file that `read_curve` reads back; a failure leaves no half file.

    Args:
        curve: the curve.
        path: the file; its directory must exist.

    Raises:
        InputError: a directory that is not there.
    """
    with write_whole(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        rows = zip(curve.frequency_hz, curve.amplitude, curve.phase_deg, curve.force_n, strict=True)
        writer.writerows([repr(float(value)) for value in row] for row in rows)


@dataclass(frozen=True, eq=False)
class _Table:
    """A file of curves as it is written."""

    header: tuple[str, ...]
    values: FloatArray  # (n, n_columns)

    def read(self, what: str, given: ChannelSettings | None, units: Sequence[str]) -> tuple[FloatArray, str]:
        """Return a column in SI units, and its unit; where no column is named, the only one with one of the units."""
        names = [split_unit(cell) for cell in self.header]
        if given is not None:
            column = self._find(given.channel)
        else:
            fitting = [at for at, (_, unit) in enumerate(names) if unit is not None and si_unit(unit) in units]
            if len(fitting) != 1:
                count = "no column" if not fitting else f"{len(fitting)} columns"
                listed = ", ".join(self.header)
                raise InputError(
                    f"it has {count} in a unit of {' or '.join(units)} for the {what} (its header is {listed}): say "
                    f'which one with {what} = {{channel = "NAME", unit = "UNIT"}}'
                )
            column = fitting[0]
            given = ChannelSettings(self.header[column])
        unit = given.unit or names[column][1]
        if unit is None or si_unit(unit) not in units:
            stated = "states no unit" if unit is None else f"is in {unit!r}"
            raise InputError(
                f"the column {self.header[column]!r} of the {what} {stated}: give a unit of {' or '.join(units)} in "
                "its header, or with `unit` in the study"
            )
        return given.to_si(self.values[:, column], unit)

    def read_frequency(self, given: ChannelSettings) -> FloatArray:
        """Return the frequencies of a column that is named, Hz; its unit is Hz where none is stated."""
        column = self._find(given.channel)
        unit = given.unit or split_unit(self.header[column])[1] or "Hz"
        hz, _ = find_frequency([f"frequency [{unit}]"], self.values[:, [column]])
        return hz

    def _find(self, channel: str | int) -> int:
        if isinstance(channel, int):
            if not 1 <= channel <= len(self.header):
                raise InputError(f"there is no column {channel}: it has {len(self.header)}")
            return channel - 1
        plain = [split_unit(cell)[0] for cell in self.header]
        found = [at for at, name in enumerate(plain) if channel in (name, self.header[at])]
        if len(found) != 1:
            raise InputError(f"it has {len(found)} columns {channel!r}: {nearest(channel, plain)}")
        return found[0]
