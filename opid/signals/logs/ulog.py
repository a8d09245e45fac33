"""PX4 flight logs (ULog): each topic is a track with time stamps of its own."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from opid.errors import InputError
from opid.signals.log import Block, Log, LoggedChannel, Track, distinct, rows_at_once
from opid.signals.log_settings import LogSettings
from opid.signals.logs import reader
from opid.signals.logs.quiet import quiet

_TIME = "timestamp"
_UTC, _FIX = "time_utc_usec", "fix_type"
_GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
_SET_US = 946_684_800_000_000  # 2000, before there were such recorders: a receiver without a fix
_HEADER_BYTES = 16
_LARGEST_MESSAGE = 0xFFFF  # its length is written with two bytes
_KINDS = b"BFIMPQAROSLCD"
_LARGEST_UNKNOWN = 10_000  # the library takes a longer message of an unknown kind for a damage

# the format states no units; these are from the definitions of PX4's messages (github.com/PX4/PX4-Autopilot, msg)
_TOPIC_UNITS = {
    "sensor_accel": "m/s^2",
    "vehicle_acceleration": "m/s^2",
    "sensor_gyro": "rad/s",
    "vehicle_angular_velocity": "rad/s",
}
_ENDING_UNITS = {"_m_s2": "m/s^2", "_rad_s": "rad/s", "gyro_rad": "rad/s"}


@reader(".ulg", name="ULog", needs="pyulog", extra="ulog", magic=(b"ULog\x01\x12\x35",))
def open_ulog(path: Path, settings: LogSettings) -> Log:
    """Open a flight log of PX4: a track `topic` or `topic_1` for each topic and instance, `x[0]` for the parts of `x`.

    Times count from the moment that the header states as the start of the log; what was stamped before is negative.
    The header has the recorder's own clock; what UTC that was is known from a GPS receiver with a fix.
    The log stops where the power did: a last message that is not whole is left out, as the format demands
    (docs.px4.io/main/en/dev_log/ulog_file_format). Dropouts show as gaps between the stamps. The messages are held in
    memory, as many bytes as they have in the file.

    Args:
        path: the file.
        settings: what the file does not say; nothing of it concerns this format.

    Raises:
        InputError: definitions that no log can have, or broken messages.
    """
    from pyulog import ULog

    with quiet(), path.open("rb") as head, path.open("rb") as stream:
        _require_messages(path, stream)
        stream.seek(0)
        _require_sane_definitions(path, ULog(head, parse_header_only=True).message_formats)
        log = ULog(stream)
    if log.file_corruption:
        raise InputError(f"{path} has broken messages: copy it from the recorder again")
    topics = [topic for topic in log.data_list if set(topic.data) > {_TIME}]
    names = distinct(f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name for topic in topics)
    tracks = tuple(_track(name, topic, log.start_timestamp) for name, topic in zip(names, topics, strict=True))
    return Log(path, "ULog", tracks, _zero(topics, log.start_timestamp))


def _zero(topics: Sequence[Any], start_us: int) -> datetime | None:
    """When the log began by its GPS receivers, the first with a fix: the median, as some messages come late."""
    for topic in (each for wanted in _GPS_TOPICS for each in topics if each.name == wanted):
        if _UTC not in topic.data or _TIME not in topic.data:
            continue
        utc_us = topic.data[_UTC].astype(np.int64)
        held = (utc_us > _SET_US) & (topic.data[_FIX] >= 2 if _FIX in topic.data else True)
        if held.any():
            began_us = np.median((utc_us - (topic.data[_TIME].astype(np.int64) - np.int64(start_us)))[held])
            return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(began_us))
    return None


def _track(name: str, topic: Any, start_us: int) -> Track:
    fields = [field for field in topic.data if field != _TIME]
    n = len(topic.data[fields[0]])

    def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
        end = n if stop is None else min(stop, n)
        step = rows_at_once(len(columns))
        for first in range(start, end, step):
            last = min(first + step, end)
            samples = np.empty((last - first, len(columns)))
            for place, column in enumerate(columns):
                samples[:, place] = topic.data[fields[column]][first:last]
            yield Block(samples, _stamps(topic.data, first, last, start_us))

    channels = tuple(LoggedChannel(field, _unit(topic.name, field)) for field in fields)
    return Track(channels, rows, n_samples=n, name=name)


def _stamps(data: Mapping[str, np.ndarray], first: int, last: int, start_us: int) -> np.ndarray | None:
    """Seconds since the start; the difference is taken of integers, which lose nothing of a microsecond."""
    if _TIME not in data:
        return None
    return (data[_TIME][first:last].astype(np.int64) - np.int64(start_us)) * 1e-6


def _unit(topic: str, field: str) -> str | None:
    plain = field.rpartition(".")[2].partition("[")[0]
    if topic in _TOPIC_UNITS and plain in ("x", "y", "z", "xyz"):
        return _TOPIC_UNITS[topic]
    return next((unit for ending, unit in _ENDING_UNITS.items() if plain.endswith(ending)), None)


def _require_messages(path: Path, stream: BinaryIO) -> None:
    """Refuse what is no chain of messages: the library looks for their next one, at times for ever."""
    size = path.stat().st_size
    parts = [_HEADER_BYTES, *(each for each in _appended(stream) if _HEADER_BYTES < each < size), size]
    defined = False
    for start, end in pairwise(sorted(parts)):
        at = start
        while at + 3 <= end:
            stream.seek(at)
            length, kind = struct.unpack("<HB", stream.read(3))
            if kind not in _KINDS and (kind == 0 or not 0 < length <= _LARGEST_UNKNOWN):
                raise InputError(f"{path} has broken messages from byte {at}: copy it from the recorder again")
            at += 3 + length
            defined = defined or (kind in b"ALC" and at <= end)
    if not defined:
        raise InputError(f"{path} holds no channel with numbers, only definitions: copy it from the recorder again")


def _appended(stream: BinaryIO) -> tuple[int, ...]:
    """Where recorders appended messages after a crash, which the first message says."""
    stream.seek(_HEADER_BYTES)
    flags = stream.read(3 + 40)
    if len(flags) < 43 or flags[2:3] != b"B" or not flags[11] & 1:
        return ()
    return tuple(offset for offset in struct.unpack("<3Q", flags[19:43]) if offset)


def _require_sane_definitions(path: Path, formats: Mapping[str, Any]) -> None:
    """Refuse nested definitions that would unfold into more fields than a message has bytes."""
    counts: dict[str, int] = {}

    def count(name: str, above: tuple[str, ...]) -> int:
        if name in above:
            raise InputError(f"{path} defines {name!r} by itself: it is damaged; copy it from the recorder again")
        if name not in counts:
            parts = formats[name].fields if name in formats else ()
            counts[name] = sum(max(size, 1) * count(kind, (*above, name)) for kind, size, _ in parts) if parts else 1
            if counts[name] > _LARGEST_MESSAGE:
                raise InputError(
                    f"{path} defines messages {name!r} of {counts[name]} fields, more than a message can hold: "
                    "it is damaged; copy it from the recorder again"
                )
        return counts[name]

    for name in formats:
        count(name, ())
