"""Heaps of HDF5 files, looked at before its library reads them: with a damaged one it would never come to an end.

Two kinds hold what has no fixed length: a global heap ("GCOL") texts of any length, a local heap ("HEAP") the names in
a group. The library follows the sizes within the first and the list of free places within the second, and checks
neither for a circle. After "HDF5 File Format Specification Version 3.0", III.D and III.E.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from opid.errors import InputError

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"

_GLOBAL, _LOCAL = b"GCOL\x01", b"HEAP\x00"  # with their versions: of another version, the library refuses them
_HEAD, _OBJECT = 16, 16  # bytes of the head of a global heap, and of each object in it
_LEAST_BYTES = 4096  # of a global heap
_MOST_OBJECTS = 1 << 16  # of a global heap: they are numbered in two bytes
_END = 1  # of the list of free places
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


class _Watched(io.RawIOBase):
    """A file whose heaps are checked when they are read."""

    def __init__(self, path: Path, file: Any) -> None:
        self._path, self._file, self._at = path, file, 0
        self._size = file.seek(0, io.SEEK_END)
        head = self._read(0, 520)
        self._base = 512 if head[512:] == SIGNATURE and head[:8] != SIGNATURE else 0  # addresses count from there
        self._checked: set[int] = set()

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
        margin = len(_GLOBAL) - 1
        first = max(0, self._at - margin)
        content = self._read(first, self._at - first + len(buffer) + margin)
        for signature, is_sound in ((_GLOBAL, self._is_sound_global), (_LOCAL, self._is_sound_local)):
            place = content.find(signature)
            while place >= 0:
                if first + place not in self._checked and not is_sound(first + place):
                    raise InputError(f"{self._path} is damaged in the heap at byte {first + place}: export it again")
                self._checked.add(first + place)
                place = content.find(signature, place + 1)
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
            number = int.from_bytes(self._read(place, 2), "little")
            (own,) = self._numbers(place + 8, 1)
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

    def _numbers(self, at: int, n: int) -> tuple[int, ...]:
        """Numbers of eight bytes, none where the file ends before."""
        content = self._read(at, 8 * n) if at < self._size else b""
        return struct.unpack(f"<{n}Q", content) if len(content) == 8 * n else ()
