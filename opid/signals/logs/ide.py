"""enDAQ (Mide) recorders: several sensors in one file, each at its own rate and stamped block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError
from opid.signals.clock import GAP, JITTER_LIMIT
from opid.signals.log import Log, LoggedChannel, LogSettings, Track, make_distinct, rows_in_steps
from opid.signals.logs import reader
from opid.signals.recording import FloatArray

_EBML = b"\x1a\x45\xdf\xa3"
_BLOCK = "ChannelDataBlock"
_TICK_S = 1 / 32768
_SET = datetime(2000, 1, 1, tzinfo=UTC)  # such recorders are younger: a clock that shows less was never set
_TICKS_OF_ROUNDING = 1.25  # between blocks: the last stamp of one and the first of the next are whole ticks


# offset in the file and size, bytes, and the times of the first and the last sample, ticks
_StampedBlock = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class _Sensor:
    """A channel of the recorder."""

    path: Path
    dtype: np.dtype  # of a row, one field for each subchannel
    offsets: np.ndarray
    rows: np.ndarray  # (n_blocks + 1,) index of the first row of each block, and the number of all rows
    start_s: FloatArray  # (n_blocks,)
    end_s: FloatArray
    calibrations: Any  # counts -> units, for each subchannel
    is_compensated: bool


@reader(".ide", name="IDE", needs="idelib", extra="ide", magic=(_EBML,))
def open_ide(path: Path, settings: LogSettings) -> Log:
    """Open a recording of an enDAQ or Slam Stick recorder: each of its channels is a track of subchannels.

    Times count from the start of the recorder's clock, which the file states in whole seconds of UTC. The first and the
    last sample of each block have stamps in ticks of 1/32768 s. Where all blocks have one rate and no gap between them,
    the rows are equally spaced on the sensor's own clock. Its rate is the slope of the line through the medians of the
    first and the last third of the blocks' stamps, for those of the first block are often some milliseconds wrong.
    Otherwise the stamp of each row is interpolated in its block, so that irregular blocks show.
    """
    from idelib.importer import openFile

    with path.open("rb") as stream:
        dataset = openFile(stream, quiet=True)
        blocks = _find_blocks(path, dataset)
        held = {number: channel for number, channel in dataset.channels.items() if number in blocks}
        names = make_distinct(channel.name or f"Channel {number}" for number, channel in held.items())
        tracks = tuple(
            _make_track(name, _read_sensor(path, dataset, channel, blocks[number]), channel)
            for name, (number, channel) in zip(names, held.items(), strict=True)
        )
        zero = _read_zero(dataset)
    return Log(path, "IDE", tracks, zero)


# ---- content of the file ---------------------------------------------------------------------------


def _read_zero(dataset: Any) -> datetime | None:
    """Return the moment when the recorder's clock began; None where it was not set."""
    since_1970_s = dataset.sessions[0].utcStartTime if dataset.sessions else None
    if not isinstance(since_1970_s, int | float) or not 0 < since_1970_s < 1 << 33:
        return None
    zero = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=since_1970_s)
    return zero if zero >= _SET else None


def _find_blocks(path: Path, dataset: Any) -> dict[int, list[_StampedBlock]]:
    """Return the blocks of each channel; the library gets those that correct others, like those of a thermometer."""
    parser = dataset._parsers[_BLOCK]
    correcting = {
        each.channelId for each in dataset.transforms.values() if getattr(each, "channelId", None) is not None
    }
    found: dict[int, list[_StampedBlock]] = {}
    size = path.stat().st_size
    end = 0
    for element in dataset.ebmldoc:
        end = element.payloadOffset + element.size
        if end > size:
            break
        if element.name != _BLOCK:
            continue
        number = _add_block(element, parser.timeModulus, found)
        if number in correcting and number in dataset.channels:
            parser.parse(element)
        element.gc(recurse=True)
    if end != size:
        raise FileError(f"{path} is cut off or damaged after {min(end, size)} of {size} bytes: copy it again")
    for number in correcting & set(found) & set(dataset.channels):
        dataset.channels[number].getSession().fillCache()
    dataset.loading = False
    return found


def _add_block(element: Any, modulus: dict[int, int], found: dict[int, list[_StampedBlock]]) -> int | None:
    parts = {part.name: part for part in element}
    start, end = (parts.get(f"{which}TimeCodeAbs", parts.get(f"{which}TimeCodeAbsMod")) for which in ("Start", "End"))
    payload = parts.get("ChannelDataPayload")
    if "ChannelIDRef" not in parts or start is None or payload is None:
        return None
    number = parts["ChannelIDRef"].value
    blocks = found.setdefault(number, [])
    wrap = modulus.get(number, 1 << 24)
    first = _unwrap(start, blocks[-1][-1] if blocks else 0, wrap)
    last = first if end is None else _unwrap(end, first, wrap)
    blocks.append((payload.payloadOffset, payload.size, first, last))
    return number


def _unwrap(stamp: Any, before: int, wrap: int) -> int:
    """Return the ticks of a stamp that is not before another; those of old recorders begin again at 0 now and then."""
    ticks = stamp.value
    if not stamp.name.endswith("Mod") or ticks >= wrap or wrap <= 0:
        return ticks
    return ticks + -(-max(before - ticks, 0) // wrap) * wrap


def _read_sensor(path: Path, dataset: Any, channel: Any, blocks: Sequence[_StampedBlock]) -> _Sensor:
    from idelib.parsers import ChannelDataBlock

    form = channel.parser.format
    if not form:
        raise FileError(f"{path} channel {channel.name!r} is written as only the oldest recorders do: convert the file")
    order, letters = (form[0], form[1:]) if form[0] in "<>=" else ("=", form)
    types = [np.dtype(ChannelDataBlock.TO_NP_TYPESTR[letter]).newbyteorder(order) for letter in letters]
    dtype = np.dtype([(str(i), each) for i, each in enumerate(types)])
    offsets, sizes, starts, ends = np.array(blocks, dtype=np.int64).T
    counts = sizes // dtype.itemsize
    if channel.singleSample:
        counts = np.minimum(counts, 1)
    kept = counts > 0
    tick_s = dataset._parsers[_BLOCK].timeScalars.get(channel.id, _TICK_S * 1e6) * 1e-6
    calibrations = channel.getSession()._fullXform.polys
    correcting = [getattr(each, "channelId", None) for each in calibrations]
    return _Sensor(
        path,
        dtype,
        offsets[kept],
        np.concatenate([[0], np.cumsum(counts[kept])]),
        starts[kept] * tick_s,
        ends[kept] * tick_s,
        calibrations,
        # whether a channel that corrects a calibration was recorded as well
        any(len(dataset.channels[number].getSession()) for number in correcting if number in dataset.channels),
    )


# ---- clock and rows of a sensor --------------------------------------------------------------------


def _make_track(name: str, sensor: _Sensor, channel: Any) -> Track:
    subchannels = channel.children
    own = [
        (each.displayName if each.name == f"{channel.name}:{each.id:02d}" else each.name) or f"{each.id}"
        for each in subchannels
    ]
    units = [each.units[1] or None for each in subchannels]
    channels = tuple(LoggedChannel(plain, unit) for plain, unit in zip(make_distinct(own), units, strict=True))
    n = int(sensor.rows[-1])
    line = _fit_uniform_clock(sensor)
    fs, start_s = line or (None, 0.0)

    def read(stream: Any, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        raw = _read_raw(stream, sensor, first, last)
        values = [np.empty(last - first) for _ in columns]
        for column, own in zip(columns, values, strict=True):
            sensor.calibrations[column].inplace(raw[str(column)], out=own, noBivariates=not sensor.is_compensated)
        return values, _interpolate_stamps(sensor, first, last) if line is None else None

    return Track(channels, rows_in_steps(n, read, lambda: sensor.path.open("rb")), fs, start_s, n, name)


def _fit_uniform_clock(sensor: _Sensor) -> tuple[float, float] | None:
    """Return the rate and start of equally spaced rows; None if blocks have gaps between them or different rates."""
    counts = np.diff(sensor.rows)
    several = counts > 1
    if not several.any():
        return None
    periods = (sensor.end_s - sensor.start_s)[several] / (counts[several] - 1)
    period = float(np.median(periods))
    rounding = _TICKS_OF_ROUNDING * _TICK_S
    wandering = np.abs(periods - period) > JITTER_LIMIT * period + rounding / (counts[several] - 1)
    steps = sensor.start_s[1:] - sensor.end_s[:-1]
    low, high = min((2 - GAP) * period, period - rounding), max(GAP * period, period + rounding)
    if not period > 0 or wandering.any() or (steps < low).any() or (steps > high).any():
        return None
    rows, times = sensor.rows[:-1].astype(np.float64), sensor.start_s
    if times.size < 3:
        rows, times = np.append(rows, sensor.rows[-1] - 1.0), np.append(times, sensor.end_s[-1])
    third = max(times.size // 3, 1)
    early, late = ((np.median(rows[part]), np.median(times[part])) for part in (slice(third), slice(-third, None)))
    slope = (late[1] - early[1]) / (late[0] - early[0])
    return 1 / float(slope), float(np.median(times - slope * rows))


def _read_raw(stream: Any, sensor: _Sensor, first: int, last: int) -> np.ndarray:
    """Return some rows as they are written, from all blocks that hold them."""
    low = int(np.searchsorted(sensor.rows, first, side="right")) - 1
    parts = []
    for block in range(low, len(sensor.offsets)):
        begin, end = int(sensor.rows[block]), int(sensor.rows[block + 1])
        if begin >= last:
            break
        skipped, wanted = max(first - begin, 0), min(last, end) - max(first, begin)
        stream.seek(int(sensor.offsets[block]) + skipped * sensor.dtype.itemsize)
        parts.append(np.frombuffer(stream.read(wanted * sensor.dtype.itemsize), dtype=sensor.dtype))
    return np.concatenate(parts)


def _interpolate_stamps(sensor: _Sensor, first: int, last: int) -> FloatArray:
    """Return the times of some rows: those of a block are equally spaced from its first stamp to its last."""
    rows = np.arange(first, last)
    block = np.searchsorted(sensor.rows, rows, side="right") - 1
    counts = np.diff(sensor.rows)
    period = (sensor.end_s - sensor.start_s) / np.maximum(counts - 1, 1)
    return sensor.start_s[block] + (rows - sensor.rows[block]) * period[block]
