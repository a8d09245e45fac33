"""ASAM MDF: measurement files of vehicle recorders; each channel group is a track with its master as clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from opid.errors import InputError
from opid.signals.log import Block, Log, LoggedChannel, Rows, Track, distinct, rows_at_once
from opid.signals.log_settings import LogSettings
from opid.signals.logs import VALUES_PER_BYTE, reader
from opid.signals.logs.quiet import quiet

_FINISHED, _UNFINISHED = b"MDF     ", b"UnFinMF "
_FLAGS_AT = 60  # where version 4 says what its recorder left undone
_NO_MASTER, _TIME = 0, 1  # kinds of master channels
_VARIABLE_LENGTH, _VIRTUAL = 1, (3, 6)  # kinds of channels
_FLOAT = 5  # the last of the kinds of data that are numbers
_MAY_BE_INVALID = 2  # a flag of a channel
_LOCAL_TIME = 1  # a flag of the header

# What stands beside and below a block, and of which kind it must be (empty: of several): by numbers of links in version
# 4, by bytes in version 3. The library follows some of these links without a look at the kind.
_HEADER_AT = 64
_LINKS_4: dict[bytes, dict[int, bytes]] = {
    b"##HD": {0: b"##DG", 1: b"##FH", 3: b"", 4: b""},
    b"##DG": {0: b"##DG", 1: b"##CG", 2: b""},
    b"##CG": {0: b"##CG", 1: b"##CN"},
    b"##CN": {0: b"##CN", 1: b"", 5: b""},
    **{kind: {0: b""} for kind in (b"##CA", b"##FH", b"##AT", b"##EV", b"##DL", b"##LD", b"##HL")},
}
_LINKS_3 = {b"HD": {4: b"DG"}, b"DG": {4: b"DG", 8: b"CG"}, b"CG": {4: b"CG", 8: b"CN"}, b"CN": {4: b"CN"}}


@reader(".mf4", ".mdf", name="MDF", needs="asammdf", extra="mdf", magic=(_FINISHED, _UNFINISHED))
def open_mdf(path: Path, settings: LogSettings) -> Log:
    """Open a measurement of ASAM MDF 3 or 4: a track for each channel group, its master channel gives the stamps.

    Times count from the start of the measurement that the header states. Texts, arrays and whatever else is no number
    for each record are left out; values that the file marks as invalid are NaN. The library makes an empty temporary
    file while it reads, and in it puts in order what a recorder wrote unsorted.

    Args:
        path: the file.
        settings: what the file does not say; nothing of it concerns this format.

    Raises:
        InputError: the recorder did not finish the file.
    """
    with path.open("rb") as stream:
        _require_finished(path, stream.read(_HEADER_AT))
        _require_no_circles(path, stream)
    tracks = []
    with _opened(path) as file:
        names = distinct((_name(group) for group in file.groups), unnamed="group")
        for index, name in enumerate(names):
            numbers = _numbers(path, file, index)
            if numbers:
                tracks.append(_track(path, file, index, numbers, name))
        zero = _zero(file.header)
    return Log(path, "MDF", tuple(tracks), zero)


def _zero(header: Any) -> datetime | None:
    """When the measurement began, None where that is not set.

    Version 3 writes the recorder's time of day; what it writes in nanoseconds is read as local time or as UTC, so only
    their fraction of a second is of use. The library would invent the present moment where it cannot read these.
    """
    since_1970_ns = int(getattr(header, "abs_time", 0) or 0)
    if hasattr(header, "time_flags"):
        zone = None if header.time_flags & _LOCAL_TIME else UTC
        return (
            datetime(1970, 1, 1, tzinfo=zone) + timedelta(microseconds=round(since_1970_ns / 1000))
            if since_1970_ns
            else None
        )
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
        raise InputError(
            f"{path} was not finished by its recorder (power lost?): repair it with the recorder's software, "
            "or with asammdf, `MDF(path).save(other)`"
        )


def _require_no_circles(path: Path, stream: BinaryIO) -> None:
    """Refuse blocks that lead back to themselves, along which the library would read for ever."""
    stream.seek(0)
    head = stream.read(_HEADER_AT)
    old = head[8:9] != b"4"
    order: Literal["big", "little"] = "big" if old and any(head[24:26]) else "little"
    above: set[int] = set()  # on the way from the header to here
    done: set[int] = set()
    waiting = [(_HEADER_AT, b"HD" if old else b"##HD", False)]
    while waiting:
        address, kind, left = waiting.pop()
        if left:
            above.discard(address)
            done.add(address)
        elif address in above:
            raise InputError(f"{path} has blocks that lead back to themselves (byte {address}): export the log again")
        elif address and address not in done:
            stream.seek(min(address, 1 << 62))
            block = stream.read(24 + 8 * 8)
            if kind and not block.startswith(kind):
                raise InputError(f"{path} has no {kind.decode()} block at byte {address}: it is cut off or damaged")
            above.add(address)
            waiting.append((address, kind, True))
            waiting += [(to, wanted, False) for to, wanted in _links(block, old, order)]


def _links(block: bytes, old: bool, order: Literal["big", "little"]) -> list[tuple[int, bytes]]:
    """Addresses and kinds of the blocks beside and below one; none for what is no such block."""
    if old:
        return [(int.from_bytes(block[at : at + 4], order), kind) for at, kind in _LINKS_3.get(block[:2], {}).items()]
    links = _LINKS_4.get(block[:4], {}).items()
    return [(int.from_bytes(block[24 + 8 * link : 32 + 8 * link], "little"), kind) for link, kind in links]


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from asammdf import MDF

    # an opened file, not its name: the library would map it to memory, and a file that shrinks then ends the program
    with path.open("rb") as stream:
        try:
            with quiet("asammdf"):
                file = MDF(stream)
        except Exception as error:
            _close_half_opened(error)
            raise
        try:
            yield file
        finally:
            file.close()


def _close_half_opened(error: Exception) -> None:
    """Close what the library left half opened, which would complain on the terminal when it is forgotten."""
    step = error.__traceback__
    while step is not None:
        half: Any = step.tb_frame.f_locals.get("self")
        if getattr(half, "_closed", True) is False:
            half._closed = True
            half._tempfile.close()
        step = step.tb_next


def _name(group: Any) -> str:
    return str(getattr(group.channel_group, "acq_name", "") or getattr(group.channel_group, "comment", "") or "")


def _numbers(path: Path, file: Any, group: int) -> dict[int, LoggedChannel]:
    """The channels of a group that hold one number for each record, by their places in it."""
    held = file.groups[group]
    if not held.channel_group.cycles_nr:
        return {}
    _require_inside(path, held)
    found = {}
    for place, channel in enumerate(held.channels):
        if place == file.masters_db.get(group) or not _may_be_number(held, place):
            continue
        with quiet("asammdf"):
            signal = file.get(group=group, index=place, record_count=1)
        if signal.samples.ndim == 1 and signal.samples.dtype.kind in "biuf":
            found[place] = LoggedChannel(channel.name, str(signal.unit or "").strip() or None)
    return found


def _require_inside(path: Path, held: Any) -> None:
    """Refuse records longer than the file can hold and channels outside their record: the library looks at neither."""
    record, invalid = held.channel_group.samples_byte_nr, getattr(held.channel_group, "invalidation_bytes_nr", 0)
    size = path.stat().st_size
    if record + invalid > VALUES_PER_BYTE * size:
        raise InputError(
            f"{path} states records of {record + invalid} bytes in {size}: it is damaged; export the log again"
        )
    for channel in held.channels:
        if _is_version_4(channel):
            bits = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
            bits = 0 if channel.channel_type in _VIRTUAL else bits
            marked = bool(channel.flags & _MAY_BE_INVALID) and channel.pos_invalidation_bit >= 8 * invalid
        else:
            bits = channel.start_offset + 8 * channel.additional_byte_offset + channel.bit_count
            marked = False
        if bits > 8 * record or marked:
            raise InputError(
                f"{path} channel {channel.name!r} lies outside its records of {record} bytes: it is damaged; "
                "export the log again"
            )


def _may_be_number(held: Any, place: int) -> bool:
    channel = held.channels[place]
    if not _is_version_4(channel):
        return True
    return (
        channel.channel_type != _VARIABLE_LENGTH
        and channel.data_type <= _FLOAT
        and not held.channel_dependencies[place]
    )


def _is_version_4(channel: Any) -> bool:
    return hasattr(channel, "byte_offset")


def _track(path: Path, file: Any, group: int, numbers: Mapping[int, LoggedChannel], name: str) -> Track:
    names = distinct(channel.name for channel in numbers.values())
    channels = tuple(replace(channel, name=own) for own, channel in zip(names, numbers.values(), strict=True))
    n = int(file.groups[group].channel_group.cycles_nr)
    return Track(channels, _rows(path, group, tuple(numbers), n, _has_time(file, group)), n_samples=n, name=name)


def _has_time(file: Any, group: int) -> bool:
    master = file.masters_db.get(group)
    if master is None:
        return False
    kind = getattr(file.groups[group].channels[master], "sync_type", _TIME)  # version 3 knows the time only
    return kind in (_NO_MASTER, _TIME)


def _values(path: Path, file: Any, group: int, place: int, first: int, count: int) -> np.ndarray:
    """The physical values of some records, NaN where they are marked as invalid."""
    with quiet("asammdf"):
        # invalid values, if not ignored, would be dropped and the rest move up
        values, invalid = file.get(
            group=group,
            index=place,
            record_offset=first,
            record_count=count,
            samples_only=True,
            ignore_invalidation_bits=True,
        )
    if values.shape != (count,):
        raise InputError(f"{path} group {group + 1} is cut off at record {first + len(values) + 1}: copy it again")
    return values if invalid is None else np.where(invalid, np.nan, values)


def _rows(path: Path, group: int, places: Sequence[int], n: int, has_time: bool) -> Rows:
    def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
        end = n if stop is None else min(stop, n)
        step = rows_at_once(len(columns))
        with _opened(path) as file:
            for first in range(start, end, step):
                count = min(step, end - first)
                samples = np.empty((count, len(columns)))
                for place, column in enumerate(columns):
                    samples[:, place] = _values(path, file, group, places[column], first, count)
                stamps = None
                if has_time:
                    master = file.get_master(group, record_offset=first, record_count=count)
                    stamps = np.array(master, dtype=np.float64)
                    if stamps.shape != (count,):
                        raise InputError(f"{path} has {stamps.size} of {count} time stamps: it is cut off or damaged")
                yield Block(samples, stamps)

    return rows
