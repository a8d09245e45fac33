"""What stands beside numbers in any file: units with their factors to SI, and names of the time and the rate.

Signals are converted to SI once, when they are read.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import TypeVar

from opid.errors import FileError, InputError, nearest

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s^2 (3rd CGPM, 1901)."""

_INCH, _FOOT, _POUND_FORCE = 0.0254, 0.3048, 4.4482216152605

_LENGTHS = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH, "ft": _FOOT}


def _list_prefixed(symbol: str, prefixes: str) -> dict[str, float]:
    factors = {"G": 1e9, "M": 1e6, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9}
    return {symbol: 1.0} | {prefix + symbol: factors[prefix] for prefix in prefixes}


def _list_lengths_per(*times: str) -> dict[str, float]:
    return {length + per_time: factor for length, factor in _LENGTHS.items() for per_time in times}


# One row for each SI unit: its name, and every spelling with its factor. Spellings are in the form that `_simplify`
# returns: no spaces, powers as plain digits (m/s2, ms-2), micro as u.
_TABLE: dict[str, dict[str, float]] = {
    "m/s^2": _list_lengths_per("/s2", "s-2", "/s/s", "/ss", "/sec2", "/sec/sec")
    | dict.fromkeys(("metre/s2", "meter/s2", "metres/s2", "meters/s2", "meter/second2", "meters/second2"), 1.0)
    | dict.fromkeys(("g", "gn", "g_n", "g0", "g_0", "gee", "gs", "g's"), STANDARD_GRAVITY)
    | {"mg": 1e-3 * STANDARD_GRAVITY, "ug": 1e-6 * STANDARD_GRAVITY}
    | {"Gal": 1e-2, "gal": 1e-2, "mGal": 1e-5, "mgal": 1e-5},
    "m/s": _list_lengths_per("/s", "s-1", "/sec")
    | {"ips": _INCH, "fps": _FOOT, "inch/s": _INCH, "inches/s": _INCH}
    | {"km/h": 1 / 3.6, "kph": 1 / 3.6, "mph": 0.44704, "knot": 1852 / 3600, "knots": 1852 / 3600},
    "m": _LENGTHS
    | dict.fromkeys(("metre", "meter", "metres", "meters"), 1.0)
    | {"inch": _INCH, "inches": _INCH, "mil": 1e-3 * _INCH, "mils": 1e-3 * _INCH, "feet": _FOOT, "micron": 1e-6},
    "N": _list_prefixed("N", "Mkm")
    | dict.fromkeys(("newton", "newtons"), 1.0)
    | {"lbf": _POUND_FORCE, "klbf": 1e3 * _POUND_FORCE, "kip": 1e3 * _POUND_FORCE, "kips": 1e3 * _POUND_FORCE}
    | {"kgf": STANDARD_GRAVITY, "kp": STANDARD_GRAVITY, "tf": 1e3 * STANDARD_GRAVITY, "daN": 10.0},
    "N/m": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3, "kN/mm": 1e6, "lbf/in": _POUND_FORCE / _INCH},
    "N*m": {"Nm": 1.0, "kNm": 1e3},
    "kg": {"kg": 1.0, "t": 1e3, "lb": 0.45359237, "lbm": 0.45359237},
    "s": _list_prefixed("s", "mun")
    | dict.fromkeys(("sec", "second", "seconds"), 1.0)
    | {"msec": 1e-3, "usec": 1e-6, "min": 60.0, "h": 3600.0},
    "Hz": _list_prefixed("Hz", "GMkm") | {"rpm": 1 / 60, "rev/min": 1 / 60},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "dps": math.pi / 180, "°/s": math.pi / 180},
    "rad/s^2": {"rad/s2": 1.0, "deg/s2": math.pi / 180, "°/s2": math.pi / 180},
    "V": _list_prefixed("V", "kmun") | dict.fromkeys(("volt", "volts"), 1.0),
    "A": _list_prefixed("A", "kmun") | dict.fromkeys(("amp", "amps"), 1.0),
    "Pa": _list_prefixed("Pa", "GMk") | {"bar": 1e5, "mbar": 1e2, "psi": _POUND_FORCE / _INCH**2},
    "degC": dict.fromkeys(("degC", "°C"), 1.0),
    # A strain is a quantity of its own, so that no ratio or count is taken for one. m/m and mm/m may be slopes.
    "strain": dict.fromkeys(("strain", "ε"), 1.0)
    | dict.fromkeys(("ustrain", "microstrain", "ue", "uε", "um/m", "uin/in"), 1e-6),
    "strain/s^2": {"strain/s2": 1.0, "ustrain/s2": 1e-6},
    "1": dict.fromkeys(("1", "-", "ratio", "count", "counts"), 1.0) | {"%": 1e-2, "percent": 1e-2},
}

_SPELLINGS: dict[str, tuple[float, str]] = {
    spelling: (factor, name) for name, row in _TABLE.items() for spelling, factor in row.items()
}

# These are suggested where a unit is not known.
_USUAL = (
    *("m/s^2", "g", "mg", "mm/s^2", "in/s^2", "m/s", "mm/s", "m", "mm", "in", "N", "kN", "lbf", "s", "ms", "V", "%"),
    *("deg", "rad", "strain", "ustrain"),
)


def _simplify(unit: str) -> str:
    """Return the one form of equivalent spellings: m/s², m/s**2, m / s^2 and m/(s^2) all become m/s2."""
    # the compatibility form turns superscripts into digits and the two micro signs into one
    text = unicodedata.normalize("NFKC", unit).replace("μ", "u").replace("−", "-").replace("º", "°")
    text = re.sub(r"\*\*|[\s^()]", "", text)
    return re.sub(r"[·⋅.*]", "", text)


def to_si(unit: str) -> tuple[float, str]:
    """Return the factor that turns values in `unit` into SI, and the name of that SI unit.

    Case counts where it has a meaning (mN and MN, ms and Ms), and is ignored elsewhere (G, M/S^2). The letter g is
    always standard gravity, never the gram.

    Args:
        unit: a unit as loggers write it: `g`, `mg`, `m/s^2`, `m/s²`, `m s-2`, `in/s^2`, `gal`, `kN`, `ms`

    Raises:
        InputError: the unit is not known; the message names the nearest one that is.

    >>> to_si("g")
    (9.80665, 'm/s^2')
    >>> to_si("m s⁻²")
    (1.0, 'm/s^2')
    >>> to_si("ms")
    (0.001, 's')
    """
    text = _simplify(unit)
    if text in _SPELLINGS:
        return _SPELLINGS[text]
    # M before one small letter is mega: Mg and Mm are not in the table, and must not be read as mg and mm
    mega = re.match(r"M[a-z](?![a-z])", text)
    alike = {meaning for spelling, meaning in _SPELLINGS.items() if spelling.casefold() == text.casefold()}
    if len(alike) == 1 and not mega:
        return alike.pop()
    raise InputError(f"the unit {unit!r} is not known: {nearest(unit, _USUAL)}")


def si_unit(unit: str) -> str | None:
    """Return the SI unit of values in `unit`, None where the unit is not known.

    >>> si_unit("ms"), si_unit("furlong")
    ('s', None)
    """
    try:
        return to_si(unit)[1]
    except InputError:
        return None


# ---- names -----------------------------------------------------------------------------------------

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
        raise FileError(f"{path} has {n} {what}, names in [log] are {len(names)}: name each of them")


def require_rate(fs: float, *, where: str) -> float:
    """Return a rate, Hz; raise an error if no recorder can have it."""
    if not (math.isfinite(fs) and RATE_RANGE_HZ[0] <= fs <= RATE_RANGE_HZ[1]):
        raise FileError(f"{where} states a rate of {fs:g} Hz: give the true one as fs_hz in [log]")
    return float(fs)


def seconds_per_unit(unit: str | None, *, where: str) -> float:
    """Return the length of one unit of time, s; 1 where no unit is stated."""
    if not unit:
        return 1.0
    if si_unit(unit) != "s":
        raise FileError(
            f"{where}: the time is in {unit!r}, which is no unit of time: give time_unit in [log] of a study "
            "(--time-unit without one)"
        )
    return to_si(unit)[0]
