"""What the user says of a log that the log does not say itself, or says wrongly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from opid.errors import InputError
from opid.signals.column_names import RATE_RANGE_HZ
from opid.signals.recording import FloatArray
from opid.signals.units import to_si

CLOCKS = ("stamps", "reconstructed")


@dataclass(frozen=True)
class LogSettings:
    """How a log is to be read: the table `[log]` of a study file.

    Args:
        names: of all columns of a text, the time among them, in place of its header; it may have none.
        time: name or number (from 1) of the column with the time stamps; found by its name where left out.
        time_unit: of the stamps, where the file states none or a wrong one.
        clock: "stamps": they must be those of a uniform clock, but for their rounding; "reconstructed": rows are taken
            to be equally spaced, and stamps that crowd (those of a host that empties a buffer) only give the rate.
        fs_hz: the rate, Hz; stamps are then not looked at.
        unit: of every channel for which the file states none.
        full_scale: what a WAV file's full scale stands for, in the unit.
        delimiter: between the columns of a text; found where left out.
        decimal: "." or ","; found where left out.
        encoding: of a text.
        skip_lines: lines of a text before its header, or before its numbers if `names` is given.

    Raises:
        InputError: a value that cannot be.
    """

    names: tuple[str, ...] = ()
    time: str | int | None = None
    time_unit: str | None = None
    clock: Literal["stamps", "reconstructed"] = "stamps"
    fs_hz: float | None = None
    unit: str | None = None
    full_scale: float | None = None
    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    skip_lines: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        for name in self.names:
            if not isinstance(name, str) or not name:
                raise InputError(f"names holds {name!r}: give the name of each column as text")
        if self.clock not in CLOCKS:
            raise InputError(f"clock is {self.clock!r}: give one of {', '.join(map(repr, CLOCKS))}")
        if self.full_scale is not None and not (math.isfinite(self.full_scale) and self.full_scale > 0):
            raise InputError(f"full_scale is {self.full_scale}: give a positive number")
        if self.fs_hz is not None and not RATE_RANGE_HZ[0] <= self.fs_hz <= RATE_RANGE_HZ[1]:
            raise InputError(f"fs_hz is {self.fs_hz:g}: give a rate in Hz that a recorder can have")
        if self.decimal not in (None, ".", ","):
            raise InputError(f"decimal is {self.decimal!r}: give '.' or ','")
        if self.skip_lines is not None and self.skip_lines < 0:
            raise InputError(f"skip_lines is {self.skip_lines}: give 0 or more")
        for unit, needed in ((self.unit, None), (self.time_unit, "s")):
            if unit is not None and to_si(unit)[1] != (needed or to_si(unit)[1]):
                raise InputError(f"time_unit is {unit!r}: give a unit of time")


AS_WRITTEN = LogSettings()
"""Nothing is said beside what the file says."""


@dataclass(frozen=True)
class ChannelSettings:
    """What one channel is, and what its values mean: `value in unit = sign (scale written + offset)`.

    Args:
        channel: its name in the log, or its number there, counted from 1.
        file: another file than the log of the run.
        unit: of the value; what the file states where left out.
        scale: of the values as they are written.
        offset: added to the scaled values, in `unit`.
        sign: 1, or -1 for a sensor that was mounted upside down.
        shift_s: added to the times of its file, whose clock began at another moment, s.

    Raises:
        InputError: a value that cannot be.

    >>> import numpy as np
    >>> settings = ChannelSettings("az", unit="g", scale=16 / 32767, sign=-1)
    >>> settings.to_si(np.array([32767.0]), None)
    (array([-156.9064]), 'm/s^2')
    """

    channel: str | int
    file: str | None = None
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    sign: int = 1
    shift_s: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.scale) and self.scale != 0):
            raise InputError(f"scale is {self.scale}: give a finite number other than 0")
        for name in ("offset", "shift_s"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{name} is {getattr(self, name)}: give a finite number")
        if self.sign not in (1, -1):
            raise InputError(f"sign is {self.sign}: give 1 or -1")
        if self.unit is not None:
            to_si(self.unit)

    def to_si(self, samples: FloatArray, written_unit: str | None) -> tuple[FloatArray, str]:
        """Return values in SI, and the name of their unit.

        Args:
            samples: (n,) as written.
            written_unit: what the file states.

        Raises:
            InputError: no unit is known, or one that is not known.
        """
        unit = self.unit or written_unit
        if unit is None:
            raise InputError(
                f"channel {self.channel!r} states no unit: write it in the log's header, like `{self.channel} [g]`, or "
                "give `unit` in its table of [channels] in a study file, or in [log] for all"
            )
        factor, name = to_si(unit)
        if (self.scale, self.offset, self.sign) == (1.0, 0.0, 1):
            return samples * factor, name
        return self.sign * (self.scale * samples + self.offset) * factor, name

    def words(self, written_unit: str | None, unit_of_all: str | None = None) -> str | None:
        """Return what is done to the values, for the history; None for nothing.

        Args:
            written_unit: what the file states.
            unit_of_all: of every channel for which the file states none.
        """
        unit = self.unit or written_unit or unit_of_all
        if unit is None:
            return None
        factor, name = to_si(unit)
        parts = [f"times {self.scale:.9g}"] * (self.scale != 1)
        parts += [f"plus {self.offset:.9g} {unit}"] * (self.offset != 0) + ["sign reversed"] * (self.sign < 0)
        parts += [f"{unit} -> {name}, times {factor:.9g}"] * (factor != 1)
        parts += [f"the file states {written_unit}"] * (self.unit is not None and written_unit not in (None, self.unit))
        return f"{self.channel}: {', '.join(parts)}" if parts else None
