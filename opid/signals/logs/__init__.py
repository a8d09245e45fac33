"""One file per log format: each registers its reader and writer by file ending; units become SI here."""

from __future__ import annotations

import os
from collections.abc import Callable
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TypeVar

from opid.errors import InputError, nearest
from opid.signals.recording import Recording

Reader = Callable[[Path], Recording]
Writer = Callable[[Recording, Path], None]
_Function = TypeVar("_Function", bound=Callable[..., object])

_READERS: dict[str, Reader] = {}
_WRITERS: dict[str, Writer] = {}


def reader(*endings: str) -> Callable[[_Function], _Function]:
    """Register the decorated function (path -> Recording) as the reader of files with these `endings`."""
    return _registration(_READERS, endings)


def writer(*endings: str) -> Callable[[_Function], _Function]:
    """Register the decorated function (recording, path) as the writer of files with these `endings`."""
    return _registration(_WRITERS, endings)


def read_log(path: str | os.PathLike[str]) -> Recording:
    """Read a log of any known format into SI units at a uniform rate.

    Args:
        path: the log file; its ending (`.csv`, ...) says the format.

    Raises:
        InputError: there is no such file, it is empty, of an unknown format, or its content is at fault.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     log = Path(directory, "heavy.csv")
    ...     _ = log.write_text("time [ms],upper_z [g]\\n0,0.5\\n2,1.0\\n4,0.0\\n")
    ...     run = read_log(log)
    >>> run.fs, run.channels, run.channel("upper_z")
    (500.0, (Channel(name='upper_z', unit='m/s^2'),), array([4.903325, 9.80665 , 0. ]))
    """
    file = Path(path)
    _load_formats()
    if not file.exists():
        raise InputError(f"there is no file {path}{_nearest_log(file)}")
    if not file.is_file():
        raise InputError(f"{path} is a directory or a device, not a log: give the name of one file")
    read = _format(_READERS, file, "read")
    try:
        if file.stat().st_size == 0:
            raise InputError(f"{path} is empty: export the log again")
        return read(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error


def write_log(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording so that `read_log` gives back the same samples, rate, names and units.

    Args:
        recording: what to write, in SI units.
        path: the file to write; its ending (`.csv`, ...) says the format.

    Raises:
        InputError: an unknown ending, a place that cannot be written to, or names the format cannot hold.
    """
    _load_formats()
    _format(_WRITERS, Path(path), "write")(recording, Path(path))


def _registration(table: dict[str, Callable], endings: tuple[str, ...]) -> Callable[[_Function], _Function]:
    def register(function: _Function) -> _Function:
        table.update(dict.fromkeys(endings, function))
        return function

    return register


@cache
def _load_formats() -> None:
    """Import every module of this package once, so that each registers itself."""
    for module in iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")


def _format(table: dict[str, _Function], file: Path, verb: str) -> _Function:
    ending = file.suffix.lower()
    if ending not in table:
        raise InputError(f"cannot {verb} {file}: no format has the ending {ending!r}: {nearest(ending, table)}")
    return table[ending]


def _nearest_log(file: Path) -> str:
    """Return the hint for a file that does not exist: a log beside it of a like name, or what to check."""
    if not file.parent.is_dir():
        return f", nor a directory {file.parent}: check the path"
    logs = [each.name for each in file.parent.iterdir() if each.suffix.lower() in _READERS]
    close = get_close_matches(file.name, logs, n=1)
    return f": did you mean {close[0]!r}?" if close else ": check the name and the directory"
