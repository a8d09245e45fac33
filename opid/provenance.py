"""Where a result comes from: the files that were read, as they were then, the version of opid, the time of writing."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from opid.errors import FileError, InputError

MOST_BYTES = 1 << 29
"""Bytes of a file that is read whole: tables, studies and results are small, and logs are read block by block."""


@dataclass(frozen=True)
class ReadFile:
    """A file that was read.

    Args:
        name: its path as it was given.
        sha256: of what it held.
    """

    name: str
    sha256: str


def read_file(path: Path) -> ReadFile:
    """Return the name of a file with the hash of what it holds, read block by block.

    Args:
        path: of the file.

    Raises:
        InputError: it is a directory, a pipe or a device, which may have no end.
        OSError: it cannot be read.
    """
    if path.exists() and not path.is_file():
        raise FileError(f"{path} is a directory, a pipe or a device: give the name of a file")
    with path.open("rb") as file:
        return ReadFile(str(path), hashlib.file_digest(file, "sha256").hexdigest())


def read_content(path: Path) -> bytes:
    """Return what a small file holds.

    Args:
        path: of the file.

    Raises:
        InputError: it is a directory, a pipe or a device, or too large to be read whole; the path is not in the words.
        OSError: it cannot be read.
    """
    if "\0" in str(path):
        raise InputError("its name holds a zero byte: give the name of a file")
    size = path.stat().st_size
    if not path.is_file():
        raise InputError("it is a directory, a pipe or a device: give the name of a file")
    if size > MOST_BYTES:
        raise InputError(f"it has {size / 1e9:.3g} GB, and at most {MOST_BYTES / 1e9:.3g} GB are read: is it a log?")
    return path.read_bytes()


def time_of_writing() -> str:
    """Return the time now, ISO 8601 in UTC; where the environment has `SOURCE_DATE_EPOCH`, that many s after 1970.

    With it what is written depends on nothing but what went in (https://reproducible-builds.org/specs/source-date-epoch).

    Raises:
        InputError: that is no time.
    """
    stated = os.environ.get("SOURCE_DATE_EPOCH", "")
    if stated and not (stated.isdecimal() and len(stated) <= 11):  # the year 9999 has 12 digits
        raise InputError(
            f"the environment variable SOURCE_DATE_EPOCH is {stated[:40]!r}: give a whole number of seconds since 1970 "
            "of at most 11 digits, or unset it"
        )
    moment = datetime.fromtimestamp(int(stated), UTC) if stated else datetime.now(UTC)
    return moment.isoformat(timespec="seconds")


def traced(document: Mapping[str, Any], files: Iterable[ReadFile]) -> dict[str, Any]:
    """Return the content of a JSON file with where it comes from behind its schema.

    Args:
        document: of plain values, with `schema`.
        files: that were read; one that was read more than once is named once.

    Returns:
        `schema`, `provenance` {opid, written, files [{name, sha256}]}, and what else the document has.
    """
    # an import statement would tie every module to the lists of public names
    version = import_module("opid").__version__
    read = [asdict(each) for each in dict.fromkeys(files)]
    provenance = {"opid": version, "written": time_of_writing(), "files": read}
    return {"schema": document["schema"], "provenance": provenance} | {**document}
