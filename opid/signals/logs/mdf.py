"""ASAM MDF: measurement files of vehicle recorders; each channel group is a track, and its master channel the clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError
from opid.signals.log import Log, LoggedChannel, LogSettings, Track, make_distinct, rows_in_steps
from opid.signals.logs import reader

_FINISHED, _UNFINISHED = b"MDF     ", b"UnFinMF "
_HEADER_BYTES = 64
_FLAGS_AT = 60  # version 4 states there what its recorder did not finish
_NO_MASTER, _TIME = 0, 1  # kinds of master channels
_VARIABLE_LENGTH = 1  # a kind of channel
_FLOAT = 5  # the last of the kinds of data that are numbers
_LOCAL_TIME = 1  # a flag of the header


@reader(".mf4", ".mdf", name="MDF", needs="asammdf", extra="mdf", magic=(_FINISHED, _UNFINISHED))
def open_mdf(path: Path, settings: LogSettings) -> Log:
    """Open a measurement of ASAM MDF 3 or 4: each channel group is a track whose stamps are its master channel.

    Times count from the start of the measurement that the header states. Texts, arrays and other channels that are not
    one number for each record are left out; values that the file marks as invalid are NaN. While it reads, the library
    keeps an empty temporary file, in which it sorts the records of recorders that wrote them unsorted.
    """
    with path.open("rb") as stream:
        _require_finished(path, stream.read(_HEADER_BYTES))
    tracks = []
    with _open(path) as file:
        headers = [group.channel_group for group in file.groups]
        names = (getattr(each, "acq_name", "") or getattr(each, "comment", "") or "" for each in headers)
        for index, name in enumerate(make_distinct(map(str, names), unnamed="group")):
            if channels := _find_channels(file, index):
                tracks.append(_make_track(path, file, index, channels, name))
        zero = _read_zero(file.header)
    return Log(path, "MDF", tuple(tracks), zero)


def _read_zero(header: Any) -> datetime | None:
    """Return the moment when the measurement began; None where that is not set.

    Version 3 writes the recorder's time of day, and nanoseconds that programs read as local time or as UTC: only their
    fraction of a second is reliable. Where the library cannot read these it would return the present moment.
    """
    since_1970_ns = int(getattr(header, "abs_time", 0) or 0)
    if hasattr(header, "time_flags"):
        if not since_1970_ns:
            return None
        zone = None if header.time_flags & _LOCAL_TIME else UTC
        return datetime(1970, 1, 1, tzinfo=zone) + timedelta(microseconds=round(since_1970_ns / 1000))
    text = f"{header.date.decode('latin-1')} {header.time.decode('latin-1')}".replace("\0", "").strip()
    try:
        began = datetime.strptime(text, "%d:%m:%Y %H:%M:%S")
    except ValueError:
        return None
    whole, fraction = divmod(since_1970_ns, 10**9)
    return began + timedelta(microseconds=round(fraction / 1000)) if whole % 60 == began.second else began


def _require_finished(path: Path, head: bytes) -> None:
    flags = any(head[_FLAGS_AT:]) and head[8:9] == b"4"
    if head.startswith(_UNFINISHED) or flags:
        raise FileError(
            f"{path} was not finished by its recorder (power lost?): repair it with the recorder's software, "
            "or with asammdf, `MDF(path).save(other)`"
        )


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    from asammdf import MDF

    with path.open("rb") as stream, MDF(stream) as file:
        yield file


def _find_channels(file: Any, group: int) -> dict[int, LoggedChannel]:
    """Return the channels of a group that hold one number for each record, by their indices in the group."""
    held = file.groups[group]
    if not held.channel_group.cycles_nr:
        return {}
    found = {}
    for index, channel in enumerate(held.channels):
        if index == file.masters_db.get(group) or not _may_be_number(held, index):
            continue
        signal = file.get(group=group, index=index, record_count=1)
        if signal.samples.ndim == 1 and signal.samples.dtype.kind in "biuf":
            found[index] = LoggedChannel(channel.name, str(signal.unit or "").strip() or None)
    return found


def _may_be_number(held: Any, index: int) -> bool:
    channel = held.channels[index]
    if not hasattr(channel, "byte_offset"):  # version 3
        return True
    return (
        channel.channel_type != _VARIABLE_LENGTH
        and channel.data_type <= _FLOAT
        and not held.channel_dependencies[index]
    )


def _make_track(path: Path, file: Any, group: int, channels: Mapping[int, LoggedChannel], name: str) -> Track:
    names = make_distinct(channel.name for channel in channels.values())
    n = int(file.groups[group].channel_group.cycles_nr)
    master = file.masters_db.get(group)
    # in version 3 the master always is the time
    kind = None if master is None else getattr(file.groups[group].channels[master], "sync_type", _TIME)
    indices = tuple(channels)

    def read(file: Any, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        records = {"record_offset": first, "record_count": last - first}
        # the library would leave out values that are marked as invalid
        wanted = {"group": group, "samples_only": True, "ignore_invalidation_bits": True, **records}
        found = [file.get(index=indices[column], **wanted) for column in columns]
        values = [own if invalid is None else np.where(invalid, np.nan, own) for own, invalid in found]
        has_time = kind in (_NO_MASTER, _TIME)
        return values, np.array(file.get_master(group, **records), dtype=np.float64) if has_time else None

    logged = tuple(replace(channel, name=own) for own, channel in zip(names, channels.values(), strict=True))
    return Track(logged, rows_in_steps(n, read, partial(_open, path)), n_samples=n, name=name)
