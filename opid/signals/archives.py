"""ZIP archives that are logs (NumPy, Excel): opened only if they can hold what they promise."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from opid.errors import InputError

MOST_MEMBERS = 10_000
MOST_BYTES = 1 << 31
"""Unpacked bytes that are held in memory."""

_BYTES_PER_BYTE = 1040
"""No deflated byte unfolds to more; an archive that says so lies."""


@contextmanager
def opened_archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open an archive whose members, by its directory, are stored or deflated, differ, and unfold to what memory holds.

    Args:
        path: the file.

    Raises:
        InputError: they do not.
        zipfile.BadZipFile: it is damaged.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        promised = sum(member.file_size for member in members)
        known = all(member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members)
        encrypted = any(member.flag_bits & 1 for member in members)
        twice = len({member.filename for member in members}) < len(members)
        lies = promised > _BYTES_PER_BYTE * path.stat().st_size or len(members) > MOST_MEMBERS
        if lies or twice or encrypted or not known:
            raise InputError(
                f"{path} is an archive that is damaged, encrypted or packed in an unusual way: save it again"
            )
        if promised > MOST_BYTES:
            raise InputError(
                f"{path} unfolds to {promised / 2**30:.1f} GiB, more than the {MOST_BYTES / 2**30:g} GiB "
                "that are read at once: save shorter stretches, or HDF5, which is read block by block"
            )
        yield archive
