"""Read NumPy archives (.npz), which users bring from anywhere: whole arrays of numbers and text, or one clear sentence.

The directory of the archive and the header of each array are read first, so that nothing is allocated for what cannot
be there. Arrays of Python objects are pickles, which could run code: they are named and never read.
"""

from __future__ import annotations

import errno
import math
import os
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

from numpy.lib import format as npy
from numpy.typing import NDArray

from opid.errors import InputError, count_repeats

MOST_MEMBERS = 10_000
"""Arrays of an archive: a log has one for each channel, and a hundred thousand take minutes to read."""

MEMORY_FRACTION = 0.25
"""Fraction of the memory of the machine that the arrays of an archive may take: an answer needs copies of them."""
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_ENCRYPTED = 0x1
# numpy and Python read the headers of arrays, which are Python text, and raise any of these for a wrong one
_OF_HEADERS = (EOFError, ValueError, LookupError, TypeError, SyntaxError, MemoryError, RecursionError, TokenError)
_DAMAGES = (
    *(zipfile.BadZipFile, zlib.error, struct.error, OverflowError, NotImplementedError, RuntimeError, OSError),
    *_OF_HEADERS,
)


@dataclass(frozen=True, eq=False)
class Archive:
    """The content of a NumPy archive.

    Args:
        arrays: those that were read, by their names: numbers, text, and also times and records, which
            `require_plain_arrays` refuses.
        pickled: names of those that hold Python objects and were not read.
    """

    arrays: dict[str, NDArray[Any]]
    pickled: tuple[str, ...]

    def require_plain_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays, all of which hold numbers or text.

        Raises:
            InputError: some hold Python objects, or neither numbers nor text, like times and records.
        """
        if self.pickled:
            raise InputError(
                f"{', '.join(map(repr, self.pickled))} of it holds Python objects, which are never read: give arrays "
                "of numbers, and names as text, np.array(names, dtype=str)"
            )
        others = [name for name, array in self.arrays.items() if array.dtype.kind not in "biufcSU"]
        if others:
            kind = self.arrays[others[0]].dtype
            raise InputError(
                f"{', '.join(map(repr, others))} of it holds neither numbers nor text ({kind}): give arrays of numbers"
            )
        return self.arrays


def read_archive(path: Path) -> Archive:
    """Return all arrays of a NumPy archive.

    Args:
        path: the file, as `numpy.savez` writes it.

    Raises:
        InputError: the file is no such archive, is damaged, truncated or encrypted, has two arrays of one name, or
            would take more memory than the machine can give.
        OSError: the file cannot be read.

    >>> import tempfile
    >>> import numpy as np
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     np.savez(f"{directory}/two.npz", a=[1.0, 2.0], b="text")
    ...     found = read_archive(Path(directory, "two.npz"))
    >>> sorted(found.arrays)
    ['a', 'b']
    """
    with path.open("rb") as file:
        if file.read(len(npy.MAGIC_PREFIX)) == npy.MAGIC_PREFIX:
            raise InputError("it holds one array and no names: write the file with numpy.savez")
        try:
            with zipfile.ZipFile(file) as archive:
                return _read_members(archive)
        except _DAMAGES as error:
            # A place before the beginning of the file is damage, a disk that fails is not.
            if isinstance(error, InputError) or (isinstance(error, OSError) and error.errno != errno.EINVAL):
                raise
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"it is no valid .npz file ({reason}): write it again with numpy.savez") from None


def read_array(path: Path) -> NDArray[Any]:
    """Return the array of a file that `numpy.save` wrote.

    Args:
        path: the file.

    Raises:
        InputError: it is no such file, is damaged or truncated, holds Python objects, or would take more memory than
            the machine can give.
        OSError: the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            n_bytes, is_pickled = _read_header(file, path.name, path.stat().st_size)
            if is_pickled:
                raise InputError("it holds Python objects, which are never read: give an array of numbers")
            require_memory(n_bytes)
            file.seek(0)
            return npy.read_array(file, allow_pickle=False)
    except _OF_HEADERS as error:
        if isinstance(error, InputError):
            raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"it is no valid .npy file ({reason}): write it again with numpy.save") from None


@dataclass(frozen=True)
class _Member:
    """An array of an archive, by its header."""

    name: str
    info: zipfile.ZipInfo
    n_bytes: int
    is_pickled: bool


def _read_members(archive: zipfile.ZipFile) -> Archive:
    listed = archive.infolist()
    if len(listed) > MOST_MEMBERS:
        raise InputError(f"it has {len(listed)} arrays, and at most {MOST_MEMBERS} are read: write fewer into one file")
    members = [_read_member(archive, info) for info in listed if not info.is_dir()]
    for name, n in count_repeats(member.name for member in members).items():
        raise InputError(f"it has {n} arrays of the name {name!r}: write each once")
    require_memory(sum(member.n_bytes for member in members if not member.is_pickled))
    arrays = {}
    for member in members:
        if not member.is_pickled:
            with archive.open(member.info) as file:
                arrays[member.name] = npy.read_array(file, allow_pickle=False)
    return Archive(arrays, tuple(member.name for member in members if member.is_pickled))


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Member:
    if info.flag_bits & _ENCRYPTED:
        raise InputError(f"its member {info.filename!r} is encrypted: write the file without a password")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"its member {info.filename!r} is packed in a way that numpy does not use: write it again")
    name = info.filename.removesuffix(".npy")
    with archive.open(info) as file:
        return _Member(name, info, *_read_header(file, name, info.file_size))


def _read_header(file: IO[bytes], name: str, file_size: int) -> tuple[int, bool]:
    """Return how many bytes an array has by its header, and whether it holds Python objects.

    Raises:
        InputError: it holds more or less than its header says.
        ValueError: it is no array.
    """
    version = npy.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"the header of {name!r} has the unknown version {version}")
    shape, _, dtype = _HEADERS[version](file)
    left = file_size - file.tell()
    # Python's integers have no largest number, so that an absurd shape does not wrap around.
    n_bytes = math.prod(map(int, shape)) * int(dtype.itemsize)
    if not dtype.hasobject and (min(shape, default=0) < 0 or n_bytes != left):
        raise InputError(
            f"its array {name!r} has the shape {shape} of {dtype}, which takes {n_bytes} bytes, and there are {left}: "
            "write it again"
        )
    return n_bytes, bool(dtype.hasobject)


def require_memory(needed: int) -> None:
    """Refuse arrays that are too large for the machine, before they are allocated.

    Args:
        needed: bytes that they take.

    Raises:
        InputError: they take more than a `MEMORY_FRACTION` of its memory.
    """
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return  # The system does not tell.
    if needed > MEMORY_FRACTION * memory:
        raise InputError(
            f"its arrays would take {needed / 1e9:.3g} GB, and this machine has {memory / 1e9:.3g} GB of memory, of "
            f"which they may take {MEMORY_FRACTION:.0%}: save a part of them"
        )
