"""WAV files: whole numbers or floats of any number of channels, as instrument-grade recorders write them.

A WAV file states neither unit nor scale. Its samples are fractions of its full scale, from -1 to 1; `full_scale` of the
table [log] is the value that 1 stands for, in `unit`. The chunks are read here and not by a library: scipy reads files
of 24 bits, which most recorders write, only as a whole, and warns about every remark that a recorder adds.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from opid.errors import FileError
from opid.signals.log import Log, LoggedChannel, LogSettings, Track, rows_in_steps
from opid.signals.logs import reader
from opid.signals.recording import FloatArray
from opid.signals.units import require_names, require_rate, split_unit

MOST_CHUNKS = 10_000
"""A file with more chunks before its samples is damaged."""

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_CODES = {2: "ADPCM", 6: "A-law", 7: "mu-law", 0x55: "MP3"}
_BYTES = {_PCM: (1, 2, 3, 4), _FLOAT: (4, 8)}
_IN_DS64 = 0xFFFFFFFF


@dataclass(frozen=True)
class _Form:
    code: int
    n_channels: int
    fs: int
    frame: int  # bytes of a row
    order: str  # "<" or ">"

    @property
    def width(self) -> int:
        """Bytes of a sample."""
        return self.frame // self.n_channels


@reader(".wav", ".wave", name="WAV", magic=(b"RIFF", b"RIFX", b"RF64"))
def open_wav(path: Path, settings: LogSettings) -> Log:
    """Open a WAV file (RIFF, RIFX or RF64) of 8 to 32-bit integers or 32 or 64-bit floats; it is read in slices."""
    if settings.unit is not None and settings.full_scale is None:
        raise FileError(
            f"{path} holds fractions of its full scale: give full_scale in [log], the value of its full scale in "
            f"{settings.unit} (1 where floats are in {settings.unit} themselves)"
        )
    with path.open("rb") as file:
        form, begin, size = _read_header(path, file)
    fs = require_rate(settings.fs_hz or form.fs, where=str(path))
    names = settings.names or tuple(f"channel_{number + 1}" for number in range(form.n_channels))
    require_names(path, names, form.n_channels)
    channels = tuple(LoggedChannel(*split_unit(name)) for name in names)
    n = size // form.frame
    scale = (settings.full_scale or 1.0) / (1.0 if form.code == _FLOAT else 2.0 ** (8 * form.width - 1))

    def read(file: BinaryIO, columns: Sequence[int], first: int, last: int) -> tuple[list[FloatArray], None]:
        file.seek(begin + first * form.frame)
        values = _decode_samples(_read_exactly(path, file, (last - first) * form.frame), form)
        return [values[:, column] * scale for column in columns], None

    rows = rows_in_steps(n, read, lambda: path.open("rb"), width=form.n_channels)
    return Log(path, "WAV", (Track(channels, rows, fs, 0.0, n, locate=lambda row: f"sample {row + 1}"),))


def _read_header(path: Path, file: BinaryIO) -> tuple[_Form, int, int]:
    """Return the form of the samples, the position of the first one, and their size, both in bytes."""
    file_size = path.stat().st_size
    order = ">" if file.read(12)[:4] == b"RIFX" else "<"
    file.seek(8)
    if file.read(4) != b"WAVE":
        raise FileError(f"{path} is no WAV file, though it begins like one: export the log as WAV")
    form, long_size, at = None, None, 12
    for _ in range(MOST_CHUNKS):
        file.seek(at)
        head = file.read(8)
        if len(head) < 8:
            break
        name, size = head[:4], struct.unpack(order + "I", head[4:])[0]
        if name == b"ds64":
            long_size = struct.unpack("<Q", _read_exactly(path, file, 16)[8:])[0]
        elif name == b"fmt ":
            form = _read_form(path, _read_exactly(path, file, min(size, 40)), order)
        elif name == b"data":
            if form is None:
                raise FileError(f"{path} has samples before its format is stated: export the log again")
            size = long_size if size == _IN_DS64 and long_size is not None else size
            held = file_size - at - 8
            if size > held or (size == 0 and held >= form.frame):
                raise FileError(
                    f"{path} says that it holds {size} bytes of samples, {held} are there: the recorder did not close "
                    "it, or it is cut off; copy it again, or have an audio program repair its header"
                )
            return form, at + 8, size
        at += 8 + size + size % 2
    raise FileError(f"{path} has no samples (no chunk `data`): it is cut off or damaged; copy it again")


def _read_form(path: Path, chunk: bytes, order: str) -> _Form:
    if len(chunk) < 16:
        raise FileError(f"{path} has a format chunk of {len(chunk)} bytes, 16 are needed: export the log again")
    code, n_channels, fs, _, frame, bits = struct.unpack(order + "HHIIHH", chunk[:16])
    if code == _EXTENSIBLE and len(chunk) >= 26:
        code = struct.unpack(order + "H", chunk[24:26])[0]
    if code not in _BYTES:
        kind = _CODES.get(code, f"of kind {code}")
        raise FileError(f"{path} holds compressed samples ({kind}): export the log as PCM or float")
    if not n_channels:
        raise FileError(f"{path} states 0 channels: export the log again")
    form = _Form(code, n_channels, fs, frame, order)
    if frame % n_channels or form.width not in _BYTES[code] or not 8 * (form.width - 1) < bits <= 8 * form.width:
        raise FileError(
            f"{path} states {bits} bits and {frame} bytes for a row of {n_channels} channel(s), which do not fit: "
            "its header is damaged, export the log as 16, 24 or 32 bit"
        )
    return form


def _read_exactly(path: Path, file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise FileError(f"{path} is cut off: {size} bytes were to follow, {len(data)} do; copy it again")
    return data


def _decode_samples(raw: bytes, form: _Form) -> FloatArray:
    """Return the numbers of some rows as they are written, (n, n_channels); unsigned numbers of 8 bits are centred."""
    if form.code == _PCM and form.width == 3:
        # put into the upper three bytes of 32-bit numbers
        wide = np.zeros((len(raw) // 3, 4), dtype=np.uint8)
        upper = slice(1, 4) if form.order == "<" else slice(0, 3)
        wide[:, upper] = np.frombuffer(raw, dtype=np.uint8).reshape(-1, 3)
        values = (wide.view(form.order + "i4")[:, 0] >> 8).astype(np.float64)
    elif form.code == _PCM and form.width == 1:
        values = np.frombuffer(raw, dtype=np.uint8).astype(np.float64) - 128.0
    else:
        kind = "f" if form.code == _FLOAT else "i"
        values = np.frombuffer(raw, dtype=f"{form.order}{kind}{form.width}").astype(np.float64)
    return values.reshape(-1, form.n_channels)
