"""Heaps of HDF5 files, looked at before its library reads them: with a damaged one it would never come to an end.

Two kinds hold what has no fixed length: a global heap ("GCOL") texts of any length, a local heap ("HEAP") the names in
a group. The library follows the sizes within the first and the list of free places within the second, and checks
neither for a circle; and for a text it makes as much room as is stated beside its place in the heap, up to 4 GiB. After
"HDF5 File Format Specification Version 3.0", III.D, III.E, IV.A.2.m and VIII.A.
"""

from __future__ import annotations

import io
import math
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from opid.errors import InputError
from opid.signals.column_names import NAME_KEYS, UNIT_KEYS

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"

_GLOBAL, _LOCAL = b"GCOL\x01", b"HEAP\x00"  # with their versions: of another version, the library refuses them
_HEAD, _OBJECT = 16, 16  # bytes of the head of a global heap, and of each object in it
_REFERENCE = 16  # bytes of what stands in place of a text: its length, the heap, its number there
_LEAST_BYTES = 4096  # of a global heap
_MOST_OBJECTS = 1 << 16  # of a global heap: they are numbered in two bytes
_END = 1  # of the list of free places
_MOST_TEXT = 1 << 20  # bytes of all names, or of all units, beside one another
_TEXT = re.compile(  # the head of an attribute's message: version, flags, bytes of name, type and shape
    rb"[\1-\3][\0-\3](..)(..)(..).?(" + b"|".join(key.encode() for key in (*NAME_KEYS, *UNIT_KEYS)) + rb")\0",
    re.IGNORECASE | re.DOTALL,
)
_VARIABLE = 9  # class of types
_MARGIN = 32
_LENGTHS = (8, 8)  # bytes of an address and of a length: what every writer takes


@contextmanager
def opened_with_care(path: Path) -> Iterator[h5py.File]:
    """Open an HDF5 file for a look at what it holds, until the block ends.

    Every read of the library passes through Python: for long reads of samples that is slow, `h5py.File` is not.

    Args:
        path: the file.

    Raises:
        InputError: a heap that the library comes upon is damaged.
    """
    import h5py

    with path.open("rb") as raw, h5py.File(_Watched(path, raw), "r") as file:
        if file.id.get_create_plist().get_sizes() != _LENGTHS:
            raise InputError(f"{path} has addresses that are not of 8 bytes: it is damaged; export it again")
        yield file


def is_readable_text(path: Path, member: h5py.Dataset) -> bool:
    """Return whether a dataset holds texts, and is stored so that their lengths can be checked; no compressed one is.

    Args:
        path: of its file.
        member: the dataset, not empty.

    Raises:
        InputError: its texts are longer than any names.
    """
    import h5py

    kind = h5py.check_string_dtype(member.dtype)
    if kind is None or member.size > _MOST_TEXT:
        return False
    if kind.length is not None:
        return bool(member.size * kind.length <= _MOST_TEXT)
    if member.chunks is None:
        at = member.id.get_offset()
        if at is None:
            return False
        with path.open("rb") as file:
            file.seek(at)
            total = _total_of(file.read(_REFERENCE * member.size))
    else:
        if member.id.get_create_plist().get_nfilters():
            return False
        chunks = [member.id.get_chunk_info(number).chunk_offset for number in range(member.id.get_num_chunks())]
        total = sum(_total_of(member.id.read_direct_chunk(chunk)[1]) for chunk in chunks)
    if total > _MOST_TEXT:
        raise InputError(f"{path} has texts of {total} bytes in {member.name[:80]}: it is damaged; export it again")
    return True


def _total_of(places: bytes) -> int:
    """How many bytes all texts have, from what is stored in place of them."""
    whole = places[: len(places) // _REFERENCE * _REFERENCE]
    return int(np.frombuffer(whole, dtype="<u4")[:: _REFERENCE // 4].sum(dtype=np.int64))


class _Watched(io.RawIOBase):
    """A file whose heaps are checked when they are read."""

    def __init__(self, path: Path, file: Any) -> None:
        self._path, self._file, self._at = path, file, 0
        self._size = file.seek(0, io.SEEK_END)
        head = self._read(0, 520)
        self._base = 512 if head[512:] == SIGNATURE and head[:8] != SIGNATURE else 0  # addresses count from there
        self._checked: set[int] = set()
        checks = {_GLOBAL: self._is_sound_global, _LOCAL: self._is_sound_local, _TEXT: self._is_sound_text}
        self._checks = [(re.compile(pattern), is_sound) for pattern, is_sound in checks.items()]

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        # a few bytes more on both sides: what the library holds already it leaves out, were it half a signature
        first = max(0, self._at - _MARGIN)
        content = self._read(first, self._at - first + len(buffer) + _MARGIN)
        for pattern, is_sound in self._checks:
            for found in pattern.finditer(content):
                place = first + found.start()
                if place not in self._checked and not is_sound(place):
                    raise InputError(f"{self._path} is damaged at byte {place}, where it holds texts: export it again")
                self._checked.add(place)
        wanted = content[self._at - first :][: len(buffer)]
        buffer[: len(wanted)] = wanted
        self._at += len(wanted)
        return len(wanted)

    def _read(self, at: int, n: int) -> bytes:
        self._file.seek(at)
        return self._file.read(n)

    def _is_sound_global(self, at: int) -> bool:
        """Whether the sizes of its objects lead to its end."""
        (size,) = self._numbers(at + 8, 1) or (0,)
        if not _LEAST_BYTES <= size <= self._size - at:
            return False
        place, end = at + _HEAD, at + size
        for _ in range(_MOST_OBJECTS):
            if end - place < _OBJECT:
                return place <= end
            number, _, _, own = struct.unpack("<HHIQ", self._read(place, _OBJECT))
            if number == 0 and own < _OBJECT:  # free space, whose size counts its head
                return False
            place += own if number == 0 else _OBJECT + own + -own % 8
        return False

    def _is_sound_local(self, at: int) -> bool:
        """Whether the list of its free places ends, or leads out of it, which the library finds out itself."""
        size, free, address = self._numbers(at + 8, 3) or (0, _END, 0)
        seen = set()
        while free != _END and free + 16 <= size:
            if free in seen:
                return False
            seen.add(free)
            (free,) = self._numbers(self._base + address + free, 1) or (_END,)
        return True

    def _is_sound_text(self, at: int) -> bool:
        """Whether the texts of an attribute are of a length in reason, if they are of any length."""
        version, _, *sizes = struct.unpack("<BBHHH", self._read(at, 8))
        if version == 1:
            sizes = [size + -size % 8 for size in sizes]
        kind = at + (9 if version == 3 else 8) + sizes[0]
        shape = kind + sizes[1]
        if self._read(kind, 1)[:1] < b"\x10" or self._read(kind, 1)[0] & 0x0F != _VARIABLE:
            return True
        form, rank = (*self._read(shape, 2), 0, 0)[:2]
        count = math.prod(self._numbers(shape + (8 if form == 1 else 4), rank))
        return count > _MOST_TEXT or _total_of(self._read(shape + sizes[2], _REFERENCE * count)) <= _MOST_TEXT

    def _numbers(self, at: int, n: int) -> tuple[int, ...]:
        """Numbers of eight bytes, none where the file ends before."""
        content = self._read(at, 8 * n) if at < self._size else b""
        return struct.unpack(f"<{n}Q", content) if len(content) == 8 * n else ()
