"""LabVIEW TDMS: channels in groups, with their rate as properties, scaled by the library."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.signals.column_names import require_rate, seconds_per_unit, split_unit, stated_rate, time_name
from opid.signals.log import Log, LoggedChannel, Rows, Track, make_distinct, rows_in_steps
from opid.signals.log_settings import LogSettings
from opid.signals.logs import reader
from opid.signals.recording import FloatArray

_UNSET_YEAR = 1904  # LabVIEW's zero of time


@dataclass(frozen=True)
class _Clock:
    """What channels must share to stand in one track."""

    group: str
    n: int
    increment_s: float | None
    start_s: float
    time: str | None  # name of the channel with the time stamps


@reader(".tdms", name="TDMS", needs="npTDMS", extra="tdms", magic=(b"TDSm",))
def open_tdms(path: Path, settings: LogSettings) -> Log:
    """Open a TDMS file: channels of a group that share length, increment and start form a track, named as the group.

    The rate is the inverse of `wf_increment`; without it, a channel of dates or one that is called time gives the
    stamps. Times count from the earliest `wf_start_time` in the file (or the first date where there is none).
    Texts, empty channels and the decimated copies that SignalExpress keeps for its displays are left out. An index
    file beside it is not looked at.
    """
    with _open(path) as file:
        if any(each.read_length < each.expected_length for each in (file.file_status.channel_statuses or {}).values()):
            raise InputError(f"{path} is cut off in its last segment: copy it from the recorder again")
        groups = {group.name: _channels_of(group) for group in file.groups()}
        if settings.time is not None and not any(_wanted_time(channels, settings) for channels in groups.values()):
            every = [name for channels in groups.values() for name in channels]
            raise InputError(f"{path} has no channel {settings.time!r}: {nearest(str(settings.time), every)}")
        origin = _origin(groups)
        members: dict[_Clock, list[str]] = {}
        for group, channels in groups.items():
            for name, clock in _clocks(group, channels, origin, settings).items():
                members.setdefault(clock, []).append(name)
        names = make_distinct((clock.group for clock in members), unnamed="group") if len(members) > 1 else ("",)
        tracks = []
        for name, (clock, own) in zip(names, members.items(), strict=False):
            logged = tuple(LoggedChannel(each, _unit(groups[clock.group][each])) for each in own)
            tracks.append(_track(path, name, clock, logged, origin, settings))
        return Log(path, "TDMS", tuple(tracks), _zero(groups, members, origin))


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    from nptdms import TdmsFile

    # the library gets an opened file: by its name it would also read the index file, which may belong to another
    with path.open("rb") as stream:
        yield TdmsFile.open(stream)


def _channels_of(group: Any) -> dict[str, Any]:
    """The channels with values, none of them if the group is a copy of another with fewer samples."""
    if _number(group.properties.get("DecimationLevel")):
        return {}
    return {channel.name: channel for channel in group.channels() if len(channel) and _kind(channel) in "biufM"}


def _kind(channel: Any) -> str:
    return np.dtype(channel.dtype).kind


def _origin(groups: Mapping[str, Mapping[str, Any]]) -> np.datetime64 | None:
    """The time that counts as zero: the earliest that a channel states as its start, or else the first date."""
    every = [channel for channels in groups.values() for channel in channels.values()]
    starts = [start for channel in every if (start := _start_time(channel)) is not None]
    dates = [channel[0] for channel in every if not starts and _kind(channel) == "M"]
    return min([*starts, *dates], default=None)


def _zero(
    groups: Mapping[str, Mapping[str, Any]], members: Mapping[_Clock, Sequence[str]], origin: np.datetime64 | None
) -> datetime | None:
    """The origin as a moment (TDMS stamps are in UTC) if the times of any channel count from it."""
    counting = any(
        _kind(groups[clock.group][clock.time]) == "M"
        if clock.time is not None
        else any(_start_time(groups[clock.group][name]) is not None for name in names)
        for clock, names in members.items()
    )
    plain = None if origin is None else origin.astype("datetime64[us]").item()
    return plain.replace(tzinfo=UTC) if counting and isinstance(plain, datetime) else None


def _start_time(channel: Any) -> np.datetime64 | None:
    start = channel.properties.get("wf_start_time")
    if not isinstance(start, np.datetime64) or np.isnat(start):
        return None
    return None if start.astype("datetime64[Y]").astype(int) + 1970 <= _UNSET_YEAR else start


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float | np.number) and np.isfinite(value) else 0.0


def _clocks(
    group: str, channels: Mapping[str, Any], origin: np.datetime64 | None, settings: LogSettings
) -> dict[str, _Clock]:
    """The clock of each channel of a group, those of time stamps left out."""
    stamps = _time_channels(channels, settings)
    found = {}
    for name, channel in channels.items():
        if name in stamps.values() or _kind(channel) == "M":
            continue
        increment_s = _number(channel.properties.get("wf_increment")) or None
        start_s = _number(channel.properties.get("wf_start_offset"))
        begun = _start_time(channel)
        if begun is not None and origin is not None:
            start_s += _seconds(np.asarray(begun), origin).item()
        time = stamps.get(len(channel)) if increment_s is None or settings.time is not None else None
        found[name] = _Clock(group, len(channel), *((None, 0.0) if time else (increment_s, start_s)), time)
    return found


def _wanted_time(channels: Mapping[str, Any], settings: LogSettings) -> str | None:
    """The channel of a group that the user says holds the time stamps, by its name or its number."""
    if isinstance(settings.time, int):
        return dict(enumerate(channels, start=1)).get(settings.time)
    return settings.time if settings.time in channels else None


def _time_channels(channels: Mapping[str, Any], settings: LogSettings) -> dict[int, str]:
    """The channel with the time stamps, for each length of channels: the one wanted, or of dates, or called time."""
    if settings.time is not None:
        wanted = _wanted_time(channels, settings)
        return {} if wanted is None else {len(channels[wanted]): wanted}
    found: dict[int, str] = {}
    for n in {len(channel) for channel in channels.values()}:
        alike = {name: channel for name, channel in channels.items() if len(channel) == n}
        plain = [name for name in alike if not _number(alike[name].properties.get("wf_increment"))]
        dates = [name for name in plain if _kind(alike[name]) == "M"]
        time = dates[0] if dates else time_name(plain)
        if time is not None and len(alike) > 1:
            found[n] = time
    return found


def _seconds(times: np.ndarray, origin: np.datetime64) -> np.ndarray:
    return (times - origin) / np.timedelta64(1, "us") * 1e-6


def _unit(channel: Any) -> str | None:
    for key in ("unit_string", "NI_UnitDescription"):
        unit = channel.properties.get(key)
        if isinstance(unit, str) and unit.strip():
            return unit.strip()
    return split_unit(channel.name)[1]


def _track(
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
    rows = _rows(path, clock, tuple(channel.name for channel in channels), origin, settings)
    return Track(channels, rows, fs=fs, start_s=clock.start_s, n_samples=clock.n, name=name)


def _rows(path: Path, clock: _Clock, names: Sequence[str], origin: np.datetime64 | None, settings: LogSettings) -> Rows:
    def read(file: Any, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        group = file[clock.group]
        stamps = None
        if clock.time is not None:
            stamps = _stamps(path, group[clock.time], first, last - first, origin, settings)
        return [group[names[column]].read_data(first, last - first) for column in columns], stamps

    return rows_in_steps(clock.n, read, partial(_open, path))


def _stamps(
    path: Path, channel: Any, first: int, count: int, origin: np.datetime64 | None, settings: LogSettings
) -> FloatArray:
    times = channel.read_data(first, count)
    if times.dtype.kind == "M" and origin is not None:
        return _seconds(times, origin)
    factor = seconds_per_unit(settings.time_unit or _unit(channel), where=f"{path} channel {channel.name!r}")
    return times.astype(np.float64) * factor
