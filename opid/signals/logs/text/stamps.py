"""From dates and times of day, as loggers write them, to nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

DAY_NS = 86_400 * 10**9

_YEAR = r"(?:19|20|21)\d\d"
_DATE = rf"(?:(?P<y>{_YEAR})[-/](?P<m>\d\d?)[-/](?P<d>\d\d?)|(?P<d2>\d\d?)\.(?P<m2>\d\d?)\.(?P<y2>{_YEAR}))"
_CLOCK = r"(?P<hour>\d{1,4}):(?P<minute>[0-5]\d):(?P<second>[0-5]\d|60)(?:[.,](?P<part>\d+))?"
_ZONE = r"(?P<zone>Z|(?P<sign>[+-])(?P<zone_hour>\d\d):?(?P<zone_minute>\d\d))"
_STAMP = re.compile(rf"(?:{_DATE}(?:T|\s+))?{_CLOCK}\s*{_ZONE}?", re.ASCII)
_OTHER_DATE = (
    r"(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}[-/. ]?[A-Za-z]{3,9}[-/. ,]\s*\d{2,4}|[A-Za-z]{3,9}\.? \d{1,2},? \d{4})"
)
_OTHER_CLOCK = r"\d{1,2}:\d\d(?::\d\d(?:[.,:]\d+)?)?(?:\s*[AaPp]\.?[Mm]\.?)?(?:\s*(?:[A-Za-z]{1,5}|[+-]\d\d:?\d\d))?"
_OTHER = re.compile(rf"{_OTHER_DATE}(?:(?:T|,?\s+){_OTHER_CLOCK})?|{_OTHER_CLOCK}", re.ASCII)
_ISO = re.compile(rf"{_YEAR}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?", re.ASCII)


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time of day, with or without a date before it.

    >>> is_stamp("2024-05-01T12:00:00.002"), is_stamp("12:00:00,5"), is_stamp("12.5")
    (True, True, False)
    """
    return _STAMP.fullmatch(cell.strip()) is not None


def has_date(cell: str) -> bool:
    """Return whether a stamp has a date, so that it does not go back at midnight."""
    found = _STAMP.fullmatch(cell.strip())
    return found is not None and bool(found["y"] or found["y2"])


def looks_dated(cell: str) -> bool:
    """Return whether a cell is a date or a time of day in any form, also in one that is not read here.

    >>> looks_dated("05/01/2024 11:59:59.0 PM"), looks_dated("01-May-2024 12:00:00"), looks_dated("1.5")
    (True, True, False)
    """
    return is_stamp(cell) or _OTHER.fullmatch(cell.strip()) is not None


def moment(cell: str) -> datetime | None:
    """Return the moment that a stamp states, in UTC where it has a time zone; None where it has no date.

    >>> str(moment("2024-05-01T12:00:00.5+02:00")), str(moment("1.5.2024 12:00:00")), moment("12:00:00")
    ('2024-05-01 10:00:00.500000+00:00', '2024-05-01 12:00:00', None)
    """
    found = _STAMP.fullmatch(cell.strip())
    if found is None or not has_date(cell):
        return None
    try:
        since = timedelta(microseconds=_find_nanoseconds(cell.strip(), 0) // 1000)
    except ValueError:
        return None
    return datetime(1970, 1, 1, tzinfo=UTC if found["zone"] else None) + since


def nanoseconds(cells: Sequence[str]) -> NDArray[np.int64]:
    """Return stamps, all in one form, as nanoseconds since 1970, or since midnight where they have no date.

    Raises:
        ValueError: a cell that is no stamp; the argument of the error is its index.

    >>> np.diff(nanoseconds(["2024-05-01T23:59:59.998", "2024-05-02 00:00:00"])).tolist()
    [2000000]
    """
    plain = [cell.strip() for cell in cells]
    # numpy parses these all at once; it gets no other texts, because it reads "today" and warns of time zones
    if all(map(_ISO.fullmatch, plain)):
        try:
            days = np.array([cell[:29] for cell in plain], dtype="datetime64[ns]")
        except ValueError:
            pass
        else:
            if not np.isnat(days).any():
                return days.astype(np.int64)
    return np.array([_find_nanoseconds(cell, at) for at, cell in enumerate(plain)], dtype=np.int64)


def _find_nanoseconds(cell: str, at: int) -> int:
    found = _STAMP.fullmatch(cell)
    if found is None:
        raise ValueError(at)
    seconds = 3600 * int(found["hour"]) + 60 * int(found["minute"]) + int(found["second"])
    year, month, day = (found[name] or found[name + "2"] for name in "ymd")
    if year:
        try:
            seconds += 86_400 * (date(int(year), int(month), int(day)).toordinal() - date(1970, 1, 1).toordinal())
        except ValueError:
            raise ValueError(at) from None
    if found["sign"]:
        zone = 3600 * int(found["zone_hour"]) + 60 * int(found["zone_minute"])
        seconds += -zone if found["sign"] == "+" else zone
    return 10**9 * seconds + int((found["part"] or "0")[:9].ljust(9, "0"))


def past_midnight(stamps: NDArray[np.int64], before: int | None) -> NDArray[np.int64]:
    """Return times of day, ns, that continue past midnight: one half a day or more earlier is of the next day.

    >>> hour = DAY_NS // 24
    >>> (past_midnight(np.array([23 * hour, 0, hour]), None) / hour).tolist()
    [23.0, 24.0, 25.0]
    """
    first = int(stamps[0]) if before is None else before
    steps = np.diff(stamps, prepend=np.int64(first % DAY_NS if first >= DAY_NS else first))
    carried = first // DAY_NS * DAY_NS if before is not None and stamps[0] < DAY_NS else 0
    return stamps + carried + DAY_NS * np.cumsum(steps <= -DAY_NS // 2)
