"""Directories for results: made when needed, and several files in them that appear together or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

from opid.errors import InputError
from opid.signals.files import written_whole


def require_directory(path: str | os.PathLike[str]) -> Path:
    """Return the path of a directory that is there or can be made, without making it.

    To be asked before long work, so that a slip of the pen does not cost it.

    Args:
        path: of the directory.

    Raises:
        InputError: a file stands in the way, or the place is not writable.

    >>> require_directory(".")
    PosixPath('.')
    """
    target = Path(path)
    there = next(part for part in (target, *target.absolute().parents) if os.path.lexists(part))
    if not there.is_dir():
        raise InputError(f"cannot write into {path}: {there} is no directory: choose another place")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"cannot write into {path}: {there} is not writable: choose another place")
    return target


def made_directory(path: str | os.PathLike[str]) -> Path:
    """Make a directory, and those above it, unless it is there.

    Args:
        path: of the directory.

    Raises:
        InputError: as `require_directory`.
    """
    target = require_directory(path)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the directory {path}: {error.strerror}: choose another place") from error
    return target


def write_together(directory: str | os.PathLike[str], contents: Mapping[str, bytes]) -> None:
    """Write several files so that either all of them appear or none; other files in the directory stay.

    Args:
        directory: made if it is not there, and taken away again after a failure.
        contents: bytes by the name of the file.

    Raises:
        InputError: a place that cannot be written to.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     write_together(f"{place}/new", {"a": b"1", "b": b"2"})
    ...     sorted(os.listdir(f"{place}/new"))
    ['a', 'b']
    """
    target = Path(directory)
    made = [part for part in (target, *target.parents) if not part.exists()]
    made_directory(target)
    try:
        with ExitStack() as stack:
            files = {name: stack.enter_context(written_whole(target / name, "wb")) for name in contents}
            for name, content in contents.items():
                files[name].write(content)
                # a full disk is to show before the first file is moved to its name
                files[name].flush()
    except BaseException:
        for part in made:
            with suppress(OSError):
                part.rmdir()
        raise
