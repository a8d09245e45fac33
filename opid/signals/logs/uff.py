"""Universal files (UFF, UNV): the time histories of data sets 58, in ASCII or binary (58b).

Each data set is a channel; those of one spacing, start and length form a track. The name of a channel is ID line 1
where that distinguishes the sets, else its node and direction; its unit is the label of the ordinate. The increment of
the time has six digits in such files: the rate is the number of fewest decimals that rounds to it. Files are written as
58b in double precision, with the exact rate and start in ID line 2, which other programs show as a remark.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError
from opid.signals.clock import plain_number
from opid.signals.files import write_whole
from opid.signals.log import Block, Log, LoggedChannel, LogSettings, Rows, Track, rows_of_array
from opid.signals.logs import reader, writer
from opid.signals.recording import Recording
from opid.signals.units import require_names, require_rate, seconds_per_unit, split_unit

_MAGIC = (b"    -1\n", b"    -1\r", b"    -1 ")
_TIME = 17  # specific data type of the abscissa
_KINDS = {
    0: "a general function",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response function",
    5: "transmissibility",
    6: "coherence",
    7: "auto correlation",
    8: "cross correlation",
    9: "power spectral density",
    10: "energy spectral density",
    12: "spectrum",
    25: "impulse response",
    26: "multiple coherence",
    27: "order function",
}
_DIRECTIONS = {1: "+X", 2: "+Y", 3: "+Z", 4: "+RX", 5: "+RY", 6: "+RZ"}
_DIRECTIONS |= {-number: word.replace("+", "-") for number, word in _DIRECTIONS.items()}
_REMARK = re.compile(r"opid: fs_hz=(\S+) start_s=(\S+)")


@reader(".uff", ".unv", ".58", ".uf", name="UFF58", needs="pyuff", extra="uff", magic=_MAGIC)
def open_uff(path: Path, settings: LogSettings) -> Log:
    """Open a universal file; a data set is read whole when one of its samples is wanted.

    The date in ID line 3 is that of the processing, not of the first sample, so the zero of the times is not known.
    """
    import pyuff

    _require_closed(path)
    file = pyuff.UFF(str(path))
    kinds = [int(kind) for kind in file.get_set_types()]
    headers = {number: _read_header(path, file, number) for number, kind in enumerate(kinds) if kind == 58}
    histories = {number: header for number, header in headers.items() if _is_history(header)}
    if not histories:
        raise FileError(
            f"{path} holds no time histories, but {_describe_contents(kinds, headers)}: export the time histories"
        )
    channels = _name_channels(path, histories, settings)
    clocks: dict[tuple[Any, ...], list[int]] = {}
    for number, header in histories.items():
        clocks.setdefault(_read_clock(path, number, header, settings), []).append(number)
    tracks = []
    for index, ((fs, start_s, n, own), sets) in enumerate(clocks.items(), start=1):
        name = f"set {own + 1}" if own is not None else f"clock {index}"
        rows = _make_rows(path, [histories[number] for number in sets], sets, settings)
        logged = tuple(channels[number] for number in sets)
        name = name if len(clocks) > 1 else ""
        tracks.append(Track(logged, rows, fs, start_s, n, name, locate=lambda row: f"sample {row + 1}"))
    return Log(path, "UFF58", tuple(tracks))


@writer(".uff", ".unv", ".58")
def write_uff(recording: Recording, path: Path) -> None:
    """Write a recording as data sets 58b in double precision, one a channel, to the last bit, without its history."""
    for channel in recording.channels:
        if not (
            _is_fitting(channel.name, 80)
            and _is_fitting(channel.unit, 20)
            and split_unit(channel.name) == (channel.name, None)
        ):
            raise FileError(
                f"cannot write {path}: a universal file does not hold the name {channel.name!r} or the unit "
                f"{channel.unit!r}: give names of up to 80 and units of up to 20 printable characters, not NONE"
            )
    start_s, dt_s = float(recording.start_s), 1 / recording.fs
    none = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}"
    with write_whole(path, "wb") as file:
        for node, (channel, samples) in enumerate(zip(recording.channels, recording.samples.T, strict=True), start=1):
            kind = 12 if channel.unit == "m/s^2" else 0
            lines = [
                f"{-1:6d}",
                f"{58:6d}b{1:6d}{2:6d}{11:12d}{8 * samples.size:12d}{0:6d}{0:6d}{0:12d}{0:12d}",
                channel.name,
                f"opid: fs_hz={recording.fs!r} start_s={start_s!r}",
                *["NONE"] * 3,
                f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{node:10d}{0:4d} {'NONE':<10}{0:10d}{0:4d}",
                f"{4:10d}{samples.size:10d}{1:10d}{start_s:13.5E}{dt_s:13.6E}{0.0:13.5E}",
                f"{_TIME:10d}{0:5d}{0:5d}{0:5d} {'Time':<20} {'s':<20}",
                f"{kind:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {channel.unit:<20}",
                none,
                none,
            ]
            file.write("".join(f"{line:<80}\n" for line in lines).encode())
            file.write(np.ascontiguousarray(samples, dtype="<f8").tobytes())
            file.write(f"{-1:6d}\n".encode())


def _is_fitting(text: str, most: int) -> bool:
    return 0 < len(text) <= most and text == text.strip() and text.isprintable() and text.upper() != "NONE"


# ---- headers -------------------------------------------------------------------------------------


def _require_closed(path: Path) -> None:
    """Raise an error where the last data set is cut off: the library would silently leave it out."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4096))
        end = file.read().rstrip(b" \r\n\0\x1a")
    if not end.endswith(b"    -1"):
        raise FileError(f"{path} is cut off: its last data set is not closed (by a line -1); copy or export it again")


def _read_header(path: Path, file: Any, number: int) -> dict[str, Any]:
    try:
        return file.read_sets(number, header_only=True)
    except Exception as error:  # pyuff raises nothing more specific
        raise FileError(f"{path}: the header of data set {number + 1} is damaged: export the log again") from error


def _is_history(header: Mapping[str, Any]) -> bool:
    """Return whether a data set holds real numbers over the time."""
    is_general = header["func_type"] == 0 and header["abscissa_spec_data_type"] == _TIME
    return header["ord_data_type"] in (2, 4) and (header["func_type"] == 1 or is_general)


def _describe_contents(kinds: Sequence[int], headers: Mapping[int, Mapping[str, Any]]) -> str:
    words = [_KINDS.get(each["func_type"], f"functions of type {each['func_type']}") for each in headers.values()]
    words += [f"data set {kind}" for kind in kinds if kind not in (0, 58)]
    counted = [f"{words.count(word)} x {word}" for word in dict.fromkeys(words)]
    return ", ".join(counted) or "no data set that is whole"


def _name_channels(
    path: Path, histories: Mapping[int, Mapping[str, Any]], settings: LogSettings
) -> dict[int, LoggedChannel]:
    lines = [str(header["id1"]).strip() for header in histories.values()]
    positions = [_describe_position(header) for header in histories.values()]
    candidates = [lines, positions, [f"channel_{number}" for number in range(1, len(histories) + 1)]]
    names = next(
        each
        for each in candidates
        if len(set(each)) == len(each) and all(name.upper() not in ("", "NONE") for name in each)
    )
    require_names(path, settings.names or names, len(names))
    channels = {}
    for number, name in zip(histories, settings.names or names, strict=True):
        unit = str(histories[number]["ordinate_axis_units_lab"]).strip()
        name, bracketed = split_unit(name)
        channels[number] = LoggedChannel(name, bracketed if unit.upper() in ("", "NONE") else unit)
    return channels


def _describe_position(header: Mapping[str, Any]) -> str:
    entity = str(header["rsp_ent_name"]).strip()
    direction = _DIRECTIONS.get(header["rsp_dir"], "")
    if entity.upper() in ("", "NONE"):
        return f"{header['rsp_node']}{direction}" if header["rsp_node"] else ""
    return f"{entity}:{header['rsp_node']}{direction}"


def _read_clock(
    path: Path, number: int, header: Mapping[str, Any], settings: LogSettings
) -> tuple[float | None, float, int, int | None]:
    """Return the rate (None for stamps), start and length; for stamps also the number of the set, for its own clock."""
    n = header["num_pts"]
    where = f"{path}, data set {number + 1},"
    if n < 1:
        raise FileError(f"{where} says that it holds {n} samples: export the log again")
    if header["abscissa_spacing"] == 0:
        return None, 0.0, n, number
    seconds = _find_time_unit(path, header, settings)
    increment_s = header["abscissa_inc"] * seconds
    fs = require_rate(settings.fs_hz or (1 / increment_s if increment_s else 0.0), where=where)
    start_s = header["abscissa_min"] * seconds
    if settings.fs_hz:
        return fs, start_s, n, None
    digits = f"{increment_s:.5e}"  # as most programs write it: it may be wrong by half of the last digit
    plain = plain_number(fs, fs * 0.5e-5 / float(digits[:7])) if float(digits) == increment_s else fs
    if not np.isfinite(start_s):
        raise FileError(f"{where} begins at {start_s} s: export the log again")
    exact = _REMARK.fullmatch(str(header["id2"]).strip())
    if exact:
        exact_fs, exact_start = float(exact[1]), float(exact[2])
        if abs(exact_fs / fs - 1) < 1e-5 and abs(exact_start - start_s) <= 1e-5 * abs(start_s):
            return exact_fs, exact_start, n, None
    return plain, start_s, n, None


def _find_time_unit(path: Path, header: Mapping[str, Any], settings: LogSettings) -> float:
    label = str(header["abscissa_axis_units_lab"]).strip()
    known = settings.time_unit or (None if label.upper() in ("", "NONE") else label)
    return seconds_per_unit(known, where=str(path))


# ---- samples -------------------------------------------------------------------------------------


def _make_rows(path: Path, headers: Sequence[Mapping[str, Any]], sets: Sequence[int], settings: LogSettings) -> Rows:
    def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
        import pyuff

        file = pyuff.UFF(str(path))
        n = headers[0]["num_pts"]
        samples = np.empty((n, len(columns)))
        stamps = None
        for index, column in enumerate(columns or [0]):
            found = _read_data_set(path, file, sets[column], n)
            if columns:
                samples[:, index] = found["data"][:n]
            if headers[0]["abscissa_spacing"] == 0:
                stamps = found["x"][:n] * _find_time_unit(path, headers[0], settings)
        yield from rows_of_array(samples, stamps)(range(len(columns)), start, stop)

    return rows


def _read_data_set(path: Path, file: Any, number: int, n: int) -> dict[str, Any]:
    try:
        found = file.read_sets(number)
    except Exception as error:  # pyuff raises nothing more specific
        raise FileError(f"{path}: data set {number + 1} cannot be read: it is damaged, export the log again") from error
    held = found["data"].size
    # some programs write a line end after the binary numbers
    if not n <= held <= n + 1:
        raise FileError(
            f"{path}: data set {number + 1} says that it holds {n} samples, {held} are there: export the log again"
        )
    return found
