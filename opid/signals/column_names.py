"""What the names beside numbers mean, whatever the file: which is the time, which the rate, where the unit stands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from opid.errors import InputError
from opid.signals.units import to_si

TIME_NAMES = ("time", "t", "times", "timestamp", "timestamps", "time stamp", "elapsed time", "elapsed", "zeit")
"""Names of the time, the likelier ones first; case is not looked at, an underscore is a blank."""

RATE_NAMES = (
    *("fs", "fs_hz", "srate", "sampling_rate", "sample_rate", "samplerate", "samplingrate"),
    *("sampling_frequency", "samplingfrequency", "sample_frequency", "samplefrequency", "samplefreq"),
)
INTERVAL_NAMES = ("dt", "ts", "delta_t", "sampling_interval", "sample_interval")
START_NAMES = ("start_s", "t0")
NAME_KEYS = ("names", "channel_names", "channels", "labels", "columns", "name", "label")
UNIT_KEYS = ("units", "unit", "unit_str")

RATE_RANGE_HZ = (1e-6, 1e9)
"""No accelerometer is sampled slower or faster than this."""


def split_unit(text: str) -> tuple[str, str | None]:
    """Split a text like `upper_z [m/s^2]` or `upper_z (m/s^2)` into name and unit; None where there is none.

    That of a time may stand behind it without brackets, `time_ms`, and is then a part of the name as well.

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
                return (
                    (text, None)
                    if not name or (unit.isdigit() and unit != "1") or unit == "0"
                    else (name, unit or None)
                )
    return text, _time_and_unit(text)[1]


def time_name(names: Sequence[str]) -> str | None:
    """Return which of the names is that of the time; None for none.

    >>> time_name(["az [g]", "Time [ms]", "t0"]), time_name(["Elapsed_Time", "time_ms"]), time_name(["t_inlet"])
    ('Time [ms]', 'time_ms', None)
    """
    plain = {_time_and_unit(split_unit(name)[0])[0]: name for name in reversed(names)}
    return next((plain[known] for known in TIME_NAMES if known in plain), None)


def _time_and_unit(name: str) -> tuple[str | None, str | None]:
    """Which of the names of the time one is, and the unit behind it; None for none."""
    plain = " ".join(name.replace("_", " ").split())
    if plain.casefold() in TIME_NAMES:
        return plain.casefold(), None
    stem, _, unit = plain.rpartition(" ")
    if stem.casefold() in TIME_NAMES and _is_time_unit(unit):
        return stem.casefold(), unit
    return None, None


def _is_time_unit(unit: str) -> bool:
    try:
        return to_si(unit)[1] == "s"
    except InputError:
        return False


def find_key(values: Mapping[str, object], names: Sequence[str]) -> str | None:
    """Return the key of `values` that is one of the names, whatever its case; None for none."""
    plain = {key.casefold(): key for key in reversed(list(values))}
    return next((plain[known] for known in names if known in plain), None)


def stated_rate(numbers: Mapping[str, float]) -> float | None:
    """Return the rate that some named numbers state, Hz, however absurd; None where none of them is a rate.

    >>> stated_rate({"Fs": 512.0}), stated_rate({"dt": 0.002}), stated_rate({"range": 16.0})
    (512.0, 500.0, None)
    """
    if (rate := find_key(numbers, RATE_NAMES)) is not None:
        return float(numbers[rate])
    if (interval := find_key(numbers, INTERVAL_NAMES)) is not None:
        dt_s = float(numbers[interval])
        if not dt_s:
            return math.inf
        fs = 1 / dt_s
        # a rate like 51.2 Hz is a round number, its interval is not
        return round(fs, 6) if abs(round(fs, 6) / fs - 1) < 1e-12 else fs
    return None


def require_names(path: object, names: Sequence[str], n: int, what: str = "channel(s)") -> None:
    """Refuse another number of names in [log] than there are columns to be named."""
    if len(names) != n:
        raise InputError(f"{path} has {n} {what}, names in [log] are {len(names)}: name each of them")


def require_rate(fs: float, *, where: str) -> float:
    """Return a rate, Hz, if there can be such a one."""
    if not (math.isfinite(fs) and RATE_RANGE_HZ[0] <= fs <= RATE_RANGE_HZ[1]):
        raise InputError(f"{where} states a rate of {fs:g} Hz: give the true one as fs_hz in [log]")
    return float(fs)


def seconds_per_unit(unit: str | None, *, where: str) -> float:
    """Return what one unit of a time is, s; 1 where none is stated."""
    if not unit:
        return 1.0
    try:
        factor, name = to_si(unit)
    except InputError:
        factor, name = 0.0, ""
    if name != "s":
        raise InputError(f"{where}: the time is in {unit!r}, which is no unit of time: give time_unit in [log]")
    return factor
