"""Names beside numbers, in any file: which one is the time, which the rate, and where the unit stands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

from opid.errors import InputError
from opid.signals.units import si_unit, to_si

T = TypeVar("T")

TIME_NAMES = ("time", "t", "times", "timestamp", "timestamps", "time stamp", "elapsed time", "elapsed", "zeit")
"""Names of the time, the likeliest first. Case does not matter, and an underscore counts as a blank."""

RATE_NAMES = (
    *("fs", "fs_hz", "srate", "sampling_rate", "sample_rate", "samplerate", "samplingrate"),
    *("sampling_frequency", "samplingfrequency", "sample_frequency", "samplefrequency", "samplefreq"),
)
INTERVAL_NAMES = ("dt", "ts", "delta_t", "sampling_interval", "sample_interval")
START_NAMES = ("start_s", "t0")
NAME_KEYS = ("names", "channel_names", "channels", "labels", "columns", "name", "label")
UNIT_KEYS = ("units", "unit", "unit_str")

RATE_RANGE_HZ = (1e-6, 1e9)
"""Every accelerometer is sampled at a rate between these."""


def split_unit(text: str) -> tuple[str, str | None]:
    """Split a text like `upper_z [m/s^2]` or `upper_z (m/s^2)` into name and unit; None where there is none.

    The unit of a time may follow its name without brackets, `time_ms`; it is then a part of the name as well.

    >>> split_unit("upper_z [m/(s^2)]"), split_unit("speed (km/h)"), split_unit("a[0]"), split_unit("upper_z")
    (('upper_z', 'm/(s^2)'), ('speed', 'km/h'), ('a[0]', None), ('upper_z', None))
    >>> split_unit("time_ms")
    ('time_ms', 'ms')
    """
    text = text.strip()
    for opening, closing in ("[]", "()"):
        depth = 0
        for at in range(len(text) - 1, -1, -1) if text.endswith(closing) else ():
            depth += (text[at] == closing) - (text[at] == opening)
            if depth == 0:
                name, unit = text[:at].strip(), text[at + 1 : -1].strip()
                # a[0] and x(2) are elements of something, not quantities without a unit
                is_element = unit.isdigit() and unit != "1"
                return (text, None) if not name or is_element else (name, unit or None)
    return text, _split_time(text)[1]


def time_name(names: Sequence[str]) -> str | None:
    """Return the one of the names that is a name of the time, None where there is none.

    >>> time_name(["az [g]", "Time [ms]", "t0"]), time_name(["Elapsed_Time", "time_ms"]), time_name(["t_inlet"])
    ('Time [ms]', 'time_ms', None)
    """
    plain = {_split_time(split_unit(name)[0])[0]: name for name in reversed(names)}
    return next((plain[known] for known in TIME_NAMES if known in plain), None)


def _split_time(name: str) -> tuple[str | None, str | None]:
    """Split a name of the time from a unit behind it; None for both where it is no name of the time."""
    plain = " ".join(name.replace("_", " ").split())
    if plain.casefold() in TIME_NAMES:
        return plain.casefold(), None
    stem, _, unit = plain.rpartition(" ")
    if stem.casefold() in TIME_NAMES and si_unit(unit) == "s":
        return stem.casefold(), unit
    return None, None


def find_value(values: Mapping[str, T], names: Sequence[str]) -> T | None:
    """Return the value whose key is the first of the names that is there, in any case; None where there is none."""
    plain = {key.casefold(): key for key in reversed(list(values))}
    return next((values[plain[known]] for known in names if known in plain), None)


def stated_rate(numbers: Mapping[str, float]) -> float | None:
    """Return the rate that some named numbers state, Hz, unchecked; None where none of them is a rate.

    >>> stated_rate({"Fs": 512.0}), stated_rate({"dt": 0.002}), stated_rate({"range": 16.0})
    (512.0, 500.0, None)
    """
    if (rate := find_value(numbers, RATE_NAMES)) is not None:
        return float(rate)
    interval = find_value(numbers, INTERVAL_NAMES)
    if interval is None:
        return None
    if not interval:
        return math.inf
    fs = 1 / float(interval)
    # a rate like 51.2 Hz is a round number, its interval is not
    return round(fs, 6) if abs(round(fs, 6) / fs - 1) < 1e-12 else fs


def require_names(path: object, names: Sequence[str], n: int, what: str = "channel(s)") -> None:
    """Raise an error unless [log] names each of n columns."""
    if len(names) != n:
        raise InputError(f"{path} has {n} {what}, names in [log] are {len(names)}: name each of them")


def require_rate(fs: float, *, where: str) -> float:
    """Return a rate, Hz; raise an error if no recorder can have it."""
    if not (math.isfinite(fs) and RATE_RANGE_HZ[0] <= fs <= RATE_RANGE_HZ[1]):
        raise InputError(f"{where} states a rate of {fs:g} Hz: give the true one as fs_hz in [log]")
    return float(fs)


def seconds_per_unit(unit: str | None, *, where: str) -> float:
    """Return the length of one unit of time, s; 1 where no unit is stated."""
    if not unit:
        return 1.0
    if si_unit(unit) != "s":
        raise InputError(
            f"{where}: the time is in {unit!r}, which is no unit of time: give time_unit in [log] of a study "
            "(--time-unit without one)"
        )
    return to_si(unit)[0]
