"""LabVIEW TDMS: channels in groups, with their rate in properties, scaled by the library."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError, nearest
from opid.signals.log import Log, LoggedChannel, LogSettings, Track, make_distinct, rows_in_steps
from opid.signals.logs import reader
from opid.signals.recording import FloatArray
from opid.signals.units import require_rate, seconds_per_unit, split_unit, stated_rate, time_name

_UNSET_YEAR = 1904  # LabVIEW's zero of time


@dataclass(frozen=True)
class _Clock:
    """What the channels of one track have in common."""

    group: str
    n: int
    increment_s: float | None
    start_s: float
    time: str | None  # name of the channel with the time stamps


@reader(".tdms", name="TDMS", needs="npTDMS", extra="tdms", magic=(b"TDSm",))
def open_tdms(path: Path, settings: LogSettings) -> Log:
    """Open a TDMS file: channels of a group with one length, increment and start form a track, named as the group.

    The rate is the inverse of `wf_increment`; without it, the stamps are a channel of dates or one that is called time.
    Times count from the earliest `wf_start_time` in the file, or from the first date where there is none. Texts, empty
    channels and the decimated copies that SignalExpress keeps for its displays are left out. An index file beside the
    log is ignored.
    """
    with _open(path) as file:
        if any(each.read_length < each.expected_length for each in (file.file_status.channel_statuses or {}).values()):
            raise FileError(f"{path} is cut off in its last segment: copy it from the recorder again")
        groups = {group.name: _find_channels(group) for group in file.groups()}
        if settings.time is not None and not any(_find_wanted_time(channels, settings) for channels in groups.values()):
            every = [name for channels in groups.values() for name in channels]
            raise FileError(f"{path} has no channel {settings.time!r}: {nearest(str(settings.time), every)}")
        origin = _find_origin(groups)
        members: dict[_Clock, list[str]] = {}
        for group, channels in groups.items():
            for name, clock in _find_clocks(group, channels, origin, settings).items():
                members.setdefault(clock, []).append(name)
        names = make_distinct((clock.group for clock in members), unnamed="group") if len(members) > 1 else ("",)
        tracks = []
        for name, (clock, own) in zip(names, members.items(), strict=False):
            logged = tuple(LoggedChannel(each, _read_unit(groups[clock.group][each])) for each in own)
            tracks.append(_make_track(path, name, clock, logged, origin, settings))
        return Log(path, "TDMS", tuple(tracks), _make_zero(groups, members, origin))


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    from nptdms import TdmsFile

    # the library gets an open file: with a name it would also read the index file, which may belong to another log
    with path.open("rb") as stream:
        yield TdmsFile.open(stream)


def _find_channels(group: Any) -> dict[str, Any]:
    """Return the channels with values; none if the group is a decimated copy of another."""
    if _to_number(group.properties.get("DecimationLevel")):
        return {}
    return {channel.name: channel for channel in group.channels() if len(channel) and _find_kind(channel) in "biufM"}


def _find_kind(channel: Any) -> str:
    return np.dtype(channel.dtype).kind


def _find_origin(groups: Mapping[str, Mapping[str, Any]]) -> np.datetime64 | None:
    """Return the zero of the times: the earliest stated start of a channel, or else the first date."""
    every = [channel for channels in groups.values() for channel in channels.values()]
    starts = [start for channel in every if (start := _read_start(channel)) is not None]
    dates = [channel[0] for channel in every if not starts and _find_kind(channel) == "M"]
    return min([*starts, *dates], default=None)


def _make_zero(
    groups: Mapping[str, Mapping[str, Any]], members: Mapping[_Clock, Sequence[str]], origin: np.datetime64 | None
) -> datetime | None:
    """Return the origin as a moment (in UTC, as TDMS stamps are) where the times of a channel count from it."""
    counting = any(
        _find_kind(groups[clock.group][clock.time]) == "M"
        if clock.time is not None
        else any(_read_start(groups[clock.group][name]) is not None for name in names)
        for clock, names in members.items()
    )
    plain = None if origin is None else origin.astype("datetime64[us]").item()
    return plain.replace(tzinfo=UTC) if counting and isinstance(plain, datetime) else None


def _read_start(channel: Any) -> np.datetime64 | None:
    start = channel.properties.get("wf_start_time")
    if not isinstance(start, np.datetime64) or np.isnat(start):
        return None
    return None if start.astype("datetime64[Y]").astype(int) + 1970 <= _UNSET_YEAR else start


def _to_number(value: object) -> float:
    return float(value) if isinstance(value, int | float | np.number) and np.isfinite(value) else 0.0


def _find_clocks(
    group: str, channels: Mapping[str, Any], origin: np.datetime64 | None, settings: LogSettings
) -> dict[str, _Clock]:
    """Return the clock of each channel of a group, without channels of time stamps."""
    stamps = _find_time_channels(channels, settings)
    found = {}
    for name, channel in channels.items():
        if name in stamps.values() or _find_kind(channel) == "M":
            continue
        increment_s = _to_number(channel.properties.get("wf_increment")) or None
        start_s = _to_number(channel.properties.get("wf_start_offset"))
        begun = _read_start(channel)
        if begun is not None and origin is not None:
            start_s += _to_seconds(np.asarray(begun), origin).item()
        time = stamps.get(len(channel)) if increment_s is None or settings.time is not None else None
        found[name] = _Clock(group, len(channel), *((None, 0.0) if time else (increment_s, start_s)), time)
    return found


def _find_wanted_time(channels: Mapping[str, Any], settings: LogSettings) -> str | None:
    if isinstance(settings.time, int):
        return dict(enumerate(channels, start=1)).get(settings.time)
    return settings.time if settings.time in channels else None


def _find_time_channels(channels: Mapping[str, Any], settings: LogSettings) -> dict[int, str]:
    """Return the channel with the time stamps for each length: the user's choice, one of dates, or one called time."""
    if settings.time is not None:
        wanted = _find_wanted_time(channels, settings)
        return {} if wanted is None else {len(channels[wanted]): wanted}
    found: dict[int, str] = {}
    for n in {len(channel) for channel in channels.values()}:
        alike = {name: channel for name, channel in channels.items() if len(channel) == n}
        plain = [name for name in alike if not _to_number(alike[name].properties.get("wf_increment"))]
        dates = [name for name in plain if _find_kind(alike[name]) == "M"]
        time = dates[0] if dates else time_name(plain)
        if time is not None and len(alike) > 1:
            found[n] = time
    return found


def _to_seconds(times: np.ndarray, origin: np.datetime64) -> np.ndarray:
    return (times - origin) / np.timedelta64(1, "us") * 1e-6


def _read_unit(channel: Any) -> str | None:
    for key in ("unit_string", "NI_UnitDescription"):
        unit = channel.properties.get(key)
        if isinstance(unit, str) and unit.strip():
            return unit.strip()
    return split_unit(channel.name)[1]


def _make_track(
    path: Path,
    name: str,
    clock: _Clock,
    channels: tuple[LoggedChannel, ...],
    origin: np.datetime64 | None,
    settings: LogSettings,
) -> Track:
    fs = None
    if clock.increment_s is not None:
        stated = stated_rate({"dt": clock.increment_s})
        fs = settings.fs_hz or require_rate(stated or 0.0, where=f"{path} group {clock.group!r}")

    def read(file: Any, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        group = file[clock.group]
        stamps = None
        if clock.time is not None:
            stamps = _read_stamps(path, group[clock.time], first, last - first, origin, settings)
        return [group[channels[column].name].read_data(first, last - first) for column in columns], stamps

    return Track(channels, rows_in_steps(clock.n, read, partial(_open, path)), fs, clock.start_s, clock.n, name)


def _read_stamps(
    path: Path, channel: Any, first: int, count: int, origin: np.datetime64 | None, settings: LogSettings
) -> FloatArray:
    times = channel.read_data(first, count)
    if times.dtype.kind == "M" and origin is not None:
        return _to_seconds(times, origin)
    factor = seconds_per_unit(settings.time_unit or _read_unit(channel), where=f"{path} channel {channel.name!r}")
    return times.astype(np.float64) * factor
