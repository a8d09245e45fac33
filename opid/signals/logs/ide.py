"""enDAQ (Mide) recorders: several sensors in one file, each at its own rate and stamped block by block."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.signals.clock import GAP, JITTER_LIMIT
from opid.signals.log import Log, LoggedChannel, Rows, Track, make_distinct, rows_in_steps
from opid.signals.log_settings import LogSettings
from opid.signals.logs import reader
from opid.signals.recording import FloatArray

_EBML = b"\x1a\x45\xdf\xa3"
_BLOCK = "ChannelDataBlock"
_EXPRESSIONS = ("SampleRate", "TimeCodeScale")  # texts that the library would evaluate
_PLAIN = re.compile(r"\s*[\d.eE+-]{1,24}\s*(/\s*[\d.eE+-]{1,24}\s*)?")
_TICK_S = 1 / 32768
_SET = datetime(2000, 1, 1, tzinfo=UTC)  # such recorders did not exist before: an earlier clock was never set
_TICKS_OF_ROUNDING = 1.25  # the last stamp of a block and the first of the next are cut to whole ticks


@dataclass
class _Blocks:
    """Where the blocks of a channel stand in the file, and the times of their first and last samples, in ticks."""

    offsets: list[int] = field(default_factory=list)  # bytes from the beginning of the file
    sizes: list[int] = field(default_factory=list)  # bytes
    starts: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Sensor:
    """A channel of the recorder."""

    path: Path
    dtype: np.dtype  # of a row, one field for each subchannel
    offsets: np.ndarray
    rows: np.ndarray  # (n_blocks + 1,) number of the first row of each block, and of all rows
    start_s: FloatArray  # (n_blocks,)
    end_s: FloatArray
    calibrations: Any  # counts -> units, for each subchannel
    compensated: bool


@reader(".ide", name="IDE", needs="idelib", extra="ide", magic=(_EBML,))
def open_ide(path: Path, settings: LogSettings) -> Log:
    """Open a recording of an enDAQ or Slam Stick recorder: each of its channels is a track, its subchannels in units.

    Times count from the moment at which the recorder's clock began, which the file states in whole seconds of UTC. It
    stamps the first and the last sample of each block, in ticks of 1/32768 s. Where no step from one block to the next
    is a gap and all blocks have the same rate, the rows are equally spaced on the sensor's own clock, whose rate is the
    slope of the line through the stamps of the blocks, drawn between the medians of their first and last thirds: the
    first block's are often some milliseconds off.
    Elsewhere each row has a stamp, interpolated in its block, and what is irregular shows.
    """
    from idelib.importer import openFile

    with path.open("rb") as stream:
        _require_plain_numbers(path, stream)
        stream.seek(0)
        dataset = openFile(stream, quiet=True)
        blocks = _blocks_of(path, stream, dataset)
        held = {number: channel for number, channel in dataset.channels.items() if number in blocks}
        names = make_distinct(channel.name or f"Channel {number}" for number, channel in held.items())
        tracks = tuple(
            _track(name, _sensor(path, dataset, channel, blocks[number]), channel)
            for name, (number, channel) in zip(names, held.items(), strict=True)
        )
        zero = _zero(dataset)
    return Log(path, "IDE", tracks, zero)


# ---- what the file holds ---------------------------------------------------------------------------


def _require_plain_numbers(path: Path, stream: Any) -> None:
    """Refuse rates and scales that are no numbers or fractions: the library evaluates such texts."""
    from idelib.dataset import loadSchema

    for element in loadSchema("mide_ide.xml").load(stream, headers=True):
        if element.name == _BLOCK:
            return
        for part in _inside(element):
            if part.name in _EXPRESSIONS and not _PLAIN.fullmatch(_text(part.value)):
                raise InputError(
                    f"{path} states {_text(part.value)[:40]!r} as a {part.name}, where a number is needed: "
                    "it is damaged; copy it from the recorder again"
                )


def _zero(dataset: Any) -> datetime | None:
    """When the recorder's clock began, None where it was not set."""
    since_1970_s = dataset.sessions[0].utcStartTime if dataset.sessions else None
    if not isinstance(since_1970_s, int | float) or not 0 < since_1970_s < 1 << 33:
        return None
    zero = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=since_1970_s)
    return zero if zero >= _SET else None


def _inside(element: Any) -> Iterator[Any]:
    yield element
    if isinstance(element.value, list):
        for part in element.value:
            yield from _inside(part)


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes | bytearray) else str(value)


def _blocks_of(path: Path, stream: Any, dataset: Any) -> dict[int, _Blocks]:
    """The blocks of each channel; those that correct others (of a thermometer) are given to the library, too."""
    parser = dataset._parsers[_BLOCK]
    correcting = {
        each.channelId for each in dataset.transforms.values() if getattr(each, "channelId", None) is not None
    }
    found: dict[int, _Blocks] = {}
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
        raise InputError(f"{path} is cut off or damaged after {min(end, size)} of {size} bytes: copy it again")
    for number in correcting & set(found) & set(dataset.channels):
        dataset.channels[number].getSession().fillCache()
    dataset.loading = False
    return found


def _add_block(element: Any, modulus: dict[int, int], found: dict[int, _Blocks]) -> int | None:
    number: int | None = None
    start: tuple[int, bool] | None = None
    end: tuple[int, bool] | None = None
    payload: Any = None
    for part in element:
        if part.name == "ChannelIDRef":
            number = part.value
        elif part.name in ("StartTimeCodeAbs", "StartTimeCodeAbsMod"):
            start = part.value, part.name.endswith("Mod")
        elif part.name in ("EndTimeCodeAbs", "EndTimeCodeAbsMod"):
            end = part.value, part.name.endswith("Mod")
        elif part.name == "ChannelDataPayload":
            payload = part
    if number is None or start is None or payload is None:
        return None
    blocks = found.setdefault(number, _Blocks())
    wrap = modulus.get(number, 1 << 24)
    first = _unwrap(start, blocks.ends[-1] if blocks.ends else 0, wrap)
    blocks.offsets.append(payload.payloadOffset)
    blocks.sizes.append(payload.size)
    blocks.starts.append(first)
    blocks.ends.append(_unwrap(end, first, wrap) if end is not None else first)
    return number


def _unwrap(stamp: tuple[int, bool], before: int, wrap: int) -> int:
    """A stamp of old recorders begins again at 0 now and then: the first that is not before the last one."""
    ticks, wraps = stamp
    if not wraps or ticks >= wrap or wrap <= 0:
        return ticks
    return ticks + -(-max(before - ticks, 0) // wrap) * wrap


def _sensor(path: Path, dataset: Any, channel: Any, blocks: _Blocks) -> _Sensor:
    from idelib.parsers import ChannelDataBlock

    form = channel.parser.format
    if not form:
        raise InputError(
            f"{path} channel {channel.name!r} is written as only the oldest recorders do: convert the file"
        )
    order, letters = (form[0], form[1:]) if form[0] in "<>=" else ("=", form)
    types = [np.dtype(ChannelDataBlock.TO_NP_TYPESTR[letter]).newbyteorder(order) for letter in letters]
    dtype = np.dtype([(str(i), each) for i, each in enumerate(types)])
    counts = np.array(blocks.sizes) // dtype.itemsize
    if channel.singleSample:
        counts = np.minimum(counts, 1)
    kept = counts > 0
    tick_s = dataset._parsers[_BLOCK].timeScalars.get(channel.id, _TICK_S * 1e6) * 1e-6
    calibrations = channel.getSession()._fullXform.polys
    return _Sensor(
        path,
        dtype,
        np.array(blocks.offsets)[kept],
        np.concatenate([[0], np.cumsum(counts[kept])]),
        np.array(blocks.starts, dtype=np.float64)[kept] * tick_s,
        np.array(blocks.ends, dtype=np.float64)[kept] * tick_s,
        calibrations,
        any(_compensates(dataset, each) for each in calibrations),
    )


def _compensates(dataset: Any, calibration: Any) -> bool:
    """Whether what corrects the calibration was recorded, too."""
    number = getattr(calibration, "channelId", None)
    return number in dataset.channels and len(dataset.channels[number].getSession()) > 0


# ---- its clock and its rows ------------------------------------------------------------------------


def _track(name: str, sensor: _Sensor, channel: Any) -> Track:
    subchannels = channel.children
    own = [
        (each.displayName if each.name == f"{channel.name}:{each.id:02d}" else each.name) or f"{each.id}"
        for each in subchannels
    ]
    units = [each.units[1] or None for each in subchannels]
    channels = tuple(LoggedChannel(plain, unit) for plain, unit in zip(make_distinct(own), units, strict=True))
    n = int(sensor.rows[-1])
    line = _uniform(sensor)
    if line is None:
        return Track(channels, _rows(sensor, with_stamps=True), n_samples=n, name=name)
    fs, start_s = line
    return Track(channels, _rows(sensor, with_stamps=False), fs=fs, start_s=start_s, n_samples=n, name=name)


def _uniform(sensor: _Sensor) -> tuple[float, float] | None:
    """Rate and start of rows without a gap between blocks; None where there is one, or no rate follows from them."""
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


def _rows(sensor: _Sensor, *, with_stamps: bool) -> Rows:
    def read(stream: Any, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        raw = _raw(stream, sensor, first, last)
        values = []
        for column in columns:
            values.append(np.empty(last - first))
            calibration = sensor.calibrations[column]
            calibration.inplace(raw[str(column)], out=values[-1], noBivariates=not sensor.compensated)
        return values, _stamps(sensor, first, last) if with_stamps else None

    return rows_in_steps(int(sensor.rows[-1]), read, lambda: sensor.path.open("rb"))


def _raw(stream: Any, sensor: _Sensor, first: int, last: int) -> np.ndarray:
    """Some rows as they are written, of whatever blocks they lie in."""
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


def _stamps(sensor: _Sensor, first: int, last: int) -> FloatArray:
    """Times of some rows, each block's samples spread from its first stamp to its last."""
    rows = np.arange(first, last)
    block = np.searchsorted(sensor.rows, rows, side="right") - 1
    counts = np.diff(sensor.rows)
    period = (sensor.end_s - sensor.start_s) / np.maximum(counts - 1, 1)
    return sensor.start_s[block] + (rows - sensor.rows[block]) * period[block]
