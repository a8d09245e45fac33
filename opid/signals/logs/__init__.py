"""One file per log format: each registers its reader and writer by file ending; units become SI at this door.

A reader opens a file and returns its `Log`, which is read block by block. It executes nothing, writes nothing and
refuses headers that contradict the size of the file. `read_log` makes a `Recording` of the log.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from opid.errors import FileError, InputError, missing_library, nearest
from opid.signals.clock import mark_clocks
from opid.signals.conversion import recording_of
from opid.signals.files import nearest_beside
from opid.signals.log import AS_WRITTEN, Block, ChannelSettings, Log, LogSettings, Track
from opid.signals.logs.apart import open_apart
from opid.signals.recording import Recording

logger = logging.getLogger(__name__)

Opener = Callable[[Path, LogSettings], Log]
Writer = Callable[[Recording, Path], None]

GZIP = ".gz"
VALUES_PER_BYTE = 1000
"""No compression packs more values into a byte: a header that says so is wrong, and would be read for hours."""

_SCALED = "WAV"  # the format whose samples are fractions of a full scale
_FOREIGN = {
    b"PK\x03\x04": "a ZIP archive (a spreadsheet?)",
    b"\x1f\x8b": "gzip data",
    b"%PDF": "a PDF document",
    b"\x7fELF": "a program",
    b"\x93NUMPY": "a NumPy array",
    b"\x80\x04": "a Python pickle",
}


@dataclass(frozen=True)
class Format:
    """A format that can be read."""

    name: str  # usual name of the format
    open: Opener
    needs: str | None = None  # distribution that must be installed, None for none
    extra: str | None = None  # extra of opid that installs it
    magic: tuple[bytes, ...] = ()  # such files begin with one of these; empty where their beginning shows nothing
    text: bool = False  # whether it is a text, which may be compressed (.gz)


_READERS: dict[str, Format] = {}
_WRITERS: dict[str, Writer] = {}


def reader(*endings: str, name: str, apart: bool = False, **form: Any) -> Callable[[Opener], Opener]:
    """Register the decorated function (path, settings) -> `Log` as the reader of files with these `endings` (".csv").

    The other arguments are those of `Format`. Where a library parses the file (`needs`, or `apart`), it does so in a
    process of its own with bounded memory and time, so that the function can ignore damaged files.
    """

    def register(function: Opener) -> Opener:
        where = f"{function.__module__}:{function.__name__}"
        opener = partial(open_apart, where) if "needs" in form or apart else function
        _READERS.update(dict.fromkeys(endings, Format(name, opener, **form)))
        return function

    return register


def writer(*endings: str) -> Callable[[Writer], Writer]:
    """Register the decorated function (recording, path) as the writer of files with these `endings`."""

    def register(function: Writer) -> Writer:
        _WRITERS.update(dict.fromkeys(endings, function))
        return function

    return register


def open_log(path: str | os.PathLike[str], settings: LogSettings = AS_WRITTEN) -> Log:
    """Open a log of any known format, as its file holds it.

    Args:
        path: the file; its ending (`.csv`, ...) decides the format, or its beginning where the ending is not known.
        settings: the user's settings for what the file does not state.

    Raises:
        InputError: there is no such file, it is empty, damaged, or of an unknown format, its reader is not installed,
            or a full scale is given for a file that is no WAV file.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     file = Path(directory, "heavy.csv")
    ...     _ = file.write_text("time [ms],upper_z [g]\\n0,0.5\\n2,1.0\\n4,0.0\\n")
    ...     log = open_log(file)
    >>> log.format, log.names
    ('CSV', ('upper_z',))
    """
    file = Path(path)
    _load_formats()
    try:
        if not os.path.exists(file):
            raise FileError(f"there is no file {path}{nearest_beside(file, _READERS)}")
        if not os.path.isfile(file):
            raise FileError(f"{path} is a directory or a device, not a log: give the name of one file")
        if file.stat().st_size == 0:
            raise FileError(f"{path} is empty: export the log again")
        form = _find_format(file)
        if settings.full_scale is not None and form.name != _SCALED:
            raise FileError(
                f"{path} is a {form.name} file, and full_scale of [log] is for {_SCALED} files: remove it, "
                "or give `scale` in the channel's table of [channels]"
            )
        log = mark_clocks(_guard(file, form, settings))
        logger.info("opened %s: %s with %d channels", path, form.name, len(log.names))
        return log
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}: check the file and its rights") from error


def read_log(
    path: str | os.PathLike[str],
    settings: LogSettings = AS_WRITTEN,
    *,
    channels: Sequence[str] | Mapping[str, ChannelSettings] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    fs_hz: float | None = None,
) -> Recording:
    """Read a log of any known format into SI units at a uniform rate.

    Args:
        path: the log file.
        settings: the user's settings for what the file does not state.
        channels: names of the channels to read, or {name in the recording: settings}; by default all channels.
        start_s: time of the first sample, s; by default the beginning of the log.
        stop_s: time at which the recording ends, s; by default the end of the log.
        fs_hz: rate to which the channels are resampled, Hz; by default the lowest of their rates, if these differ.

    Raises:
        InputError: there is no such file, it is empty, of an unknown format, or its content is faulty.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     log = Path(directory, "heavy.csv")
    ...     _ = log.write_text("time [ms],upper_z [g]\\n0,0.5\\n2,1.0\\n4,0.0\\n")
    ...     run = read_log(log)
    >>> run.fs, run.channels, run.channel("upper_z")
    (500.0, (Channel(name='upper_z', unit='m/s^2'),), array([4.903325, 9.80665 , 0. ]))
    """
    log = open_log(path, settings)
    return recording_of(log, settings, channels=channels, start_s=start_s, stop_s=stop_s, fs_hz=fs_hz)


def write_log(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording so that `read_log` gives back the same samples, rate, names and units.

    Args:
        recording: the recording, in SI units.
        path: the file to write; its ending (`.csv`, ...) decides the format.

    Raises:
        InputError: an unknown ending, a path that cannot be written to, or names that the format cannot hold.
    """
    require_written_format(path)
    _WRITERS[Path(path).suffix.lower()](recording, Path(path))


def require_written_format(path: str | os.PathLike[str]) -> None:
    """Refuse before long work a log to be written whose ending is that of no format that is written.

    Args:
        path: of the file.

    Raises:
        InputError: an unknown ending.
    """
    _load_formats()
    ending = Path(path).suffix.lower()
    if ending not in _WRITERS:
        raise FileError(f"cannot write {path}: no format has the ending {ending!r}: {nearest(ending, _WRITERS)}")


def formats() -> dict[str, Format]:
    """Return the formats that can be read, by file ending."""
    _load_formats()
    return dict(_READERS)


@cache
def _load_formats() -> None:
    """Import every module of this package once, so that each registers itself."""
    for module in iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")


def _find_format(file: Path) -> Format:
    """Return the format by the ending, or by the beginning where the ending is not known; the two must agree."""
    with file.open("rb") as opened:
        head = opened.read(4096)
    ending = file.suffix.lower()
    if ending == GZIP:
        form = _READERS.get(Path(file.stem).suffix.lower())
        if form is None or not form.text:
            raise FileError(f"cannot read {file}: only text logs (.csv.gz, ...) are read compressed: unpack it first")
        if not head.startswith(b"\x1f\x8b"):
            raise FileError(f"{file} is no gzip data, as its ending says: rename it, or export it again")
        return form
    form = _READERS.get(ending)
    if form is None:
        alike = {each.name: each for each in _READERS.values() if head.startswith(each.magic)}
        if ending == ".xls":
            raise FileError(f"cannot read {file}: the older format of Excel is not read: save it as .xlsx")
        if len(alike) != 1:
            raise FileError(f"cannot read {file}: no format has the ending {ending!r}: {nearest(ending, _READERS)}")
        return next(iter(alike.values()))
    if form.magic and not head.startswith(form.magic):
        raise FileError(
            f"{file} is no {form.name} file{_describe_beginning(head)}: check the ending, or export it again"
        )
    if form.text and not form.magic and (foreign := _describe_beginning(head)):
        raise FileError(f"{file} is no {form.name} file{foreign}: check the ending, or export it as {form.name}")
    return form


def _describe_beginning(head: bytes) -> str:
    known = {each: form.name for form in _READERS.values() for each in form.magic}
    for magic, name in (known | _FOREIGN).items():
        if head.startswith(magic):
            return f", it begins like {name}"
    return ""


def _guard(file: Path, form: Format, settings: LogSettings) -> Log:
    """Open a log whose header agrees with the size of the file; reading it raises errors on damage and on change."""
    before = file.stat()
    with _raise_one_sentence(file, form):
        log = form.open(file, settings)
    if not log.tracks or not any(track.channels for track in log.tracks):
        raise FileError(f"{file} holds no channel with numbers: export the log again")
    for track in log.tracks:
        if (track.n_samples or 0) * len(track.channels) > VALUES_PER_BYTE * before.st_size:
            raise FileError(
                f"{file} says that it holds {track.n_samples} samples of {len(track.channels)} channel(s) in "
                f"{before.st_size} bytes: its header is damaged; export the log again"
            )

    def watch(track: Track) -> Track:
        def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
            with _raise_one_sentence(file, form):
                yield from track.rows(columns, start, stop)
            after = file.stat() if file.exists() else None  # it may have been deleted
            if after is None or (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
                raise FileError(f"{file} changed while it was read: wait until the recorder has closed it, or copy it")

        return replace(track, rows=rows)

    return replace(log, tracks=tuple(map(watch, log.tracks)))


@contextmanager
def _raise_one_sentence(file: Path, form: Format) -> Iterator[None]:
    """Turn whatever goes wrong with a file or in its library into an InputError of one sentence."""
    try:
        yield
    except InputError:
        raise
    except ModuleNotFoundError as error:
        if form.needs is None or form.extra is None:
            raise
        raise FileError(str(missing_library(f"reading {file} ({form.name})", form.needs, form.extra))) from error
    except MemoryError as error:
        raise FileError(
            f"{file} takes more memory than its size explains: it is damaged, or a whole that is packed tightly; "
            "export it again, or as shorter stretches, or as HDF5, which is read block by block"
        ) from error
    except Exception as error:
        # with a number it comes from the system, not from a library that met damage
        if isinstance(error, OSError) and error.errno is not None:
            raise FileError(f"cannot read {file}: {error.strerror or error}: check the file and its rights") from error
        reason = (str(error).strip() or type(error).__name__).splitlines()[0][:200]
        raise FileError(
            f"{file} is no sound {form.name} file ({reason}): it is cut off or damaged; export it again"
        ) from error
