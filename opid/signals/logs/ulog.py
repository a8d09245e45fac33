"""PX4 flight logs (ULog): each topic is a track with time stamps of its own."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError
from opid.signals.log import Log, LoggedChannel, LogSettings, Track, make_distinct, rows_in_steps
from opid.signals.logs import reader

_TIME = "timestamp"
_UTC, _FIX = "time_utc_usec", "fix_type"
_GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
_SET_US = 946_684_800_000_000  # the year 2000: a receiver that shows less had no fix

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

    Times count from the start of the log that the header states; earlier stamps are negative. The header has the
    recorder's own clock, and a GPS receiver with a fix shows which UTC that was. The log ends where the power was cut:
    an incomplete last message is left out, as the format demands (docs.px4.io/main/en/dev_log/ulog_file_format).
    Dropouts show as gaps between the stamps. The messages are held in memory, in as many bytes as in the file.
    """
    from pyulog import ULog

    with path.open("rb") as stream:
        log = ULog(stream)
    if log.file_corruption:
        raise FileError(f"{path} has broken messages: copy it from the recorder again")
    topics = [topic for topic in log.data_list if set(topic.data) > {_TIME}]
    names = make_distinct(f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name for topic in topics)
    tracks = tuple(_make_track(name, topic, log.start_timestamp) for name, topic in zip(names, topics, strict=True))
    return Log(path, "ULog", tracks, _find_zero(topics, log.start_timestamp))


def _find_zero(topics: Sequence[Any], start_us: int) -> datetime | None:
    """When the log began by the first GPS receiver with a fix: the median, because some messages come late."""
    for topic in (each for wanted in _GPS_TOPICS for each in topics if each.name == wanted):
        if _UTC not in topic.data or _TIME not in topic.data:
            continue
        utc_us = topic.data[_UTC].astype(np.int64)
        held = (utc_us > _SET_US) & (topic.data[_FIX] >= 2 if _FIX in topic.data else True)
        if held.any():
            began_us = np.median((utc_us - (topic.data[_TIME].astype(np.int64) - np.int64(start_us)))[held])
            return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(began_us))
    return None


def _make_track(name: str, topic: Any, start_us: int) -> Track:
    fields = [field for field in topic.data if field != _TIME]
    n = len(topic.data[fields[0]])

    def read(_: None, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        stamps = None
        if _TIME in topic.data:  # the difference of integers loses nothing of a microsecond
            stamps = (topic.data[_TIME][first:last].astype(np.int64) - np.int64(start_us)) * 1e-6
        return [topic.data[fields[column]][first:last] for column in columns], stamps

    channels = tuple(LoggedChannel(field, _find_unit(topic.name, field)) for field in fields)
    return Track(channels, rows_in_steps(n, read), n_samples=n, name=name)


def _find_unit(topic: str, field: str) -> str | None:
    plain = field.rpartition(".")[2].partition("[")[0]
    if topic in _TOPIC_UNITS and plain in ("x", "y", "z", "xyz"):
        return _TOPIC_UNITS[topic]
    return next((unit for ending, unit in _ENDING_UNITS.items() if plain.endswith(ending)), None)
