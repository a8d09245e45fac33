"""Columns of a log that are clocks beside its time: counters, a second time. They are no signals."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from opid.errors import InputError
from opid.signals.column_names import time_name
from opid.signals.log import Log, LoggedChannel, Track
from opid.signals.recording import FloatArray
from opid.signals.units import to_si

_ROWS_TO_TELL = 1000
_LEAST_ROWS = 10
_OFF_THE_LINE = 0.6
"""Part of a step by which a clock may lie off a straight line: half a step is rounding."""


def with_clocks(log: Log) -> Log:
    """Return the log, the channels marked that run with its time.

    Such a channel states no unit, or one of time, and goes up in each of the first rows: along a straight line over the
    time (or over the rows where there are no stamps), or however it likes if its name is one of a time.
    """
    tracks = tuple(_marked(track) for track in log.tracks)
    names = [channel.name for track in tracks for channel in track.channels if channel.is_clock]
    told = tuple(f"{name!r} runs with the time and is taken for no signal: name it if it is one" for name in names)
    return replace(log, tracks=tracks, remarks=(*log.remarks, *told)) if names else log


def _marked(track: Track) -> Track:
    columns = [column for column, channel in enumerate(track.channels) if _may_be_clock(channel)]
    if not columns:
        return track
    values = np.empty((0, len(columns)))
    stamps: FloatArray | None = None
    with suppress(InputError):  # what is at fault there is told where it is read
        blocks = list(track.blocks(columns, 0, _ROWS_TO_TELL))
        values = np.concatenate([values, *(block.samples for block in blocks)])
        known = [block.stamps for block in blocks if block.stamps is not None]
        stamps = np.concatenate(known) if known else None
    time_s = np.arange(len(values), dtype=np.float64) if stamps is None else stamps
    clocks = {
        column
        for column, own in zip(columns, values.T, strict=True)
        if _is_clock(own, time_s, called_time=time_name([track.channels[column].name]) is not None)
    }
    if not clocks or len(clocks) == len(track.channels):
        return track
    channels = (replace(each, is_clock=column in clocks) for column, each in enumerate(track.channels))
    return replace(track, channels=tuple(channels))


def _may_be_clock(channel: LoggedChannel) -> bool:
    if channel.unit is None:
        return True
    with suppress(InputError):
        return to_si(channel.unit)[1] == "s"
    return False


def _is_clock(values: FloatArray, time_s: FloatArray, *, called_time: bool) -> bool:
    if len(values) < _LEAST_ROWS or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    if not (steps > 0).all():
        return False
    if called_time:
        return True
    if not (np.isfinite(time_s).all() and np.ptp(time_s) > 0):
        return False
    beside = time_s - time_s.mean()
    own = values - values.mean()
    off = own - beside * float(beside @ own / (beside @ beside))
    return float(np.abs(off).max()) <= _OFF_THE_LINE * float(np.median(steps))
