"""The spellings of units and their factors to SI: signals are converted to SI once, when they are read."""

from __future__ import annotations

import math
import re
import unicodedata

from opid.errors import InputError, nearest

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s^2 (3rd CGPM, 1901)."""

_INCH, _FOOT, _POUND_FORCE = 0.0254, 0.3048, 4.4482216152605

_LENGTHS = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH, "ft": _FOOT}


def _with_prefixes(symbol: str, prefixes: str) -> dict[str, float]:
    factors = {"G": 1e9, "M": 1e6, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9}
    return {symbol: 1.0} | {prefix + symbol: factors[prefix] for prefix in prefixes}


def _lengths_per(*times: str) -> dict[str, float]:
    return {length + per_time: factor for length, factor in _LENGTHS.items() for per_time in times}


# One row for each SI unit: its name, and every spelling with its factor. Spellings are in the form that `_plain`
# returns: no spaces, powers as plain digits (m/s2, ms-2), micro as u.
_TABLE: dict[str, dict[str, float]] = {
    "m/s^2": _lengths_per("/s2", "s-2", "/s/s", "/ss", "/sec2", "/sec/sec")
    | dict.fromkeys(("metre/s2", "meter/s2", "metres/s2", "meters/s2", "meter/second2", "meters/second2"), 1.0)
    | dict.fromkeys(("g", "gn", "g_n", "g0", "g_0", "gee", "gs", "g's"), STANDARD_GRAVITY)
    | {"mg": 1e-3 * STANDARD_GRAVITY, "ug": 1e-6 * STANDARD_GRAVITY}
    | {"Gal": 1e-2, "gal": 1e-2, "mGal": 1e-5, "mgal": 1e-5},
    "m/s": _lengths_per("/s", "s-1", "/sec")
    | {"ips": _INCH, "fps": _FOOT, "inch/s": _INCH, "inches/s": _INCH}
    | {"km/h": 1 / 3.6, "kph": 1 / 3.6, "mph": 0.44704, "knot": 1852 / 3600, "knots": 1852 / 3600},
    "m": _LENGTHS
    | dict.fromkeys(("metre", "meter", "metres", "meters"), 1.0)
    | {"inch": _INCH, "inches": _INCH, "mil": 1e-3 * _INCH, "mils": 1e-3 * _INCH, "feet": _FOOT, "micron": 1e-6},
    "N": _with_prefixes("N", "Mkm")
    | dict.fromkeys(("newton", "newtons"), 1.0)
    | {"lbf": _POUND_FORCE, "klbf": 1e3 * _POUND_FORCE, "kip": 1e3 * _POUND_FORCE, "kips": 1e3 * _POUND_FORCE}
    | {"kgf": STANDARD_GRAVITY, "kp": STANDARD_GRAVITY, "tf": 1e3 * STANDARD_GRAVITY, "daN": 10.0},
    "N/m": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3, "kN/mm": 1e6, "lbf/in": _POUND_FORCE / _INCH},
    "N*m": {"Nm": 1.0, "kNm": 1e3},
    "kg": {"kg": 1.0, "t": 1e3, "lb": 0.45359237, "lbm": 0.45359237},
    "s": _with_prefixes("s", "mun")
    | dict.fromkeys(("sec", "second", "seconds"), 1.0)
    | {"msec": 1e-3, "usec": 1e-6, "min": 60.0, "h": 3600.0},
    "Hz": _with_prefixes("Hz", "GMkm") | {"rpm": 1 / 60, "rev/min": 1 / 60},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "dps": math.pi / 180, "°/s": math.pi / 180},
    "V": _with_prefixes("V", "kmun") | dict.fromkeys(("volt", "volts"), 1.0),
    "A": _with_prefixes("A", "kmun") | dict.fromkeys(("amp", "amps"), 1.0),
    "Pa": _with_prefixes("Pa", "GMk") | {"bar": 1e5, "mbar": 1e2, "psi": _POUND_FORCE / _INCH**2},
    "degC": dict.fromkeys(("degC", "°C"), 1.0),
    "1": dict.fromkeys(("1", "-", "ratio", "count", "counts"), 1.0)
    | {"%": 1e-2, "percent": 1e-2, "strain": 1.0, "ustrain": 1e-6, "ue": 1e-6},
}

_SPELLINGS: dict[str, tuple[float, str]] = {
    spelling: (factor, name) for name, row in _TABLE.items() for spelling, factor in row.items()
}

# These are suggested where a unit is not known.
_USUAL = ("m/s^2", "g", "mg", "mm/s^2", "in/s^2", "m/s", "mm/s", "m", "mm", "in", "N", "kN", "lbf", "s", "ms", "V", "%")


def _plain(unit: str) -> str:
    """The one form of equivalent spellings: m/s², m/s**2, m / s^2 and m/(s^2) all become m/s2."""
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
    text = _plain(unit)
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
