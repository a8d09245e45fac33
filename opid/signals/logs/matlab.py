"""MATLAB files (.mat) of version 4 to 7.3: how time, rate, names and units are found among the variables.

- The variables of the file stand together, and so do the fields of a struct, and of each element of a struct array.
- `time` or `t` (or `time` of the table [log]), a vector, holds the stamps; every other numeric vector of that length is
  a channel, and a matrix n x m gives the channels name_1 to name_m.
- Without stamps a scalar `fs`, `Fs`, `srate`, `sampling_rate`, ... is the rate, or `dt`, `Ts`, ... the interval; a
  struct without one has that of the file.
- `Channel_1_Data` beside a struct `Channel_1_Header` has its `SignalName` and `Unit`, and the rate of `File_Header`.
- `names` (or `labels`, `channels`, ...) and `units` (or `unit`) are texts, one for each channel or one for all; a name
  may carry its unit in brackets.

The table [log] (`time`, `time_unit`, `fs_hz`, `names`, `unit`) overrides what is found. Versions up to 7.2 are read
whole when they are opened, their compression allows nothing else; version 7.3 is HDF5 and read in slices.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from opid.errors import InputError
from opid.signals.column_names import NAME_KEYS, UNIT_KEYS
from opid.signals.log import Log
from opid.signals.log_settings import LogSettings
from opid.signals.logs import reader
from opid.signals.logs.hdf5 import MOST_OBJECTS, members, opened
from opid.signals.logs.hdf5_heaps import SIGNATURE, opened_with_care
from opid.signals.logs.named_arrays import DEEPEST, NamedArray, NamedGroup, groups_of_values, tracks_of

if TYPE_CHECKING:
    import h5py

MOST_MATRICES = 5000
"""Structs and cells within one another, and fields and elements of one variable, beyond which it is not read."""

_NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_READ = (*_NUMERIC, "struct", "cell", "char")
_WHOLE, _MATRIX, _COMPRESSED = (5, 6), 14, 15  # types of elements
_HOLDS_OTHERS, _SPARSE, _NO_SIZE = (1, 2, 3), 5, (16, 17)  # classes: cell, struct, object; function, opaque
_COMPLEX = 0x0800  # flag
_ANY, _UNSOUND = -1, -2  # numbers of elements
_KNOWN = (1, 2, 3, 4, 5, 6, 7, 9, 12, 13, _MATRIX, 16, 17, 18)
_MOST_BYTES = 1 << 31


@reader(".mat", name="MATLAB", needs="h5py", extra="hdf5")
def open_matlab(path: Path, settings: LogSettings) -> Log:
    """Open a MATLAB file: version 7.3 is read in slices, an older one whole.

    Args:
        path: the file.
        settings: what the file does not say.

    Raises:
        InputError: the file is damaged, no MATLAB file, holds no numbers, or states an absurd rate.
    """
    with path.open("rb") as file:
        head = file.read(520)
    if SIGNATURE in (head[:8], head[512:520]):
        with opened_with_care(path) as content:
            groups = list(_groups_of_hdf5(content, content, "", {}, set()))
        tracks = tracks_of(path, groups, settings, lambda: opened(path))
    else:
        groups = list(groups_of_values(_variables(path), "", {}))
        tracks = tracks_of(path, groups, settings, nullcontext)
    if not tracks:
        raise InputError(f"{path} holds no vectors or matrices of numbers: save the signals themselves, not objects")
    return Log(path, "MATLAB", tracks)


# ---- up to version 7.2 ---------------------------------------------------------------------------


def _variables(path: Path) -> dict[str, Any]:
    """The variables that may be signals, or say something of them."""
    from scipy.io import loadmat, whosmat

    _require_sound(path)
    listed = whosmat(path, appendmat=False)
    names = [name for name, _, kind in listed if kind in _READ]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path} holds {names.count(twice)} variables called {twice!r}: save it again in MATLAB")
    found = loadmat(path, appendmat=False, variable_names=names, simplify_cells=True)
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"{path} is cut off or damaged: its variable {missing[0]!r} cannot be read; save it again")
    return {name: found[name] for name in names}


def _require_sound(path: Path) -> None:
    """Refuse what would crash the library that reads it: elements of unknown types, nesting without end."""
    with path.open("rb") as file:
        file_size = path.stat().st_size
        order = {b"IM": "<", b"MI": ">"}.get(file.read(128)[126:])
        while order and len(tag := file.read(8)) == 8:  # version 4 has no such elements, and no order here
            kind, size = struct.unpack(order + "II", tag)
            if size > file_size - file.tell():
                raise InputError(f"{path} is cut off: {size} bytes were to follow, fewer do; copy it again")
            content = file.read(size)
            if kind == _COMPRESSED:
                unpacking = zlib.decompressobj()
                content = unpacking.decompress(content, _MOST_BYTES)
                if unpacking.unconsumed_tail:
                    raise InputError(f"{path} holds a variable of more than 2 GB: save it with version 7.3")
                kind = struct.unpack_from(order + "I", content)[0]
                content = content[8:]
            if kind != _MATRIX or not _is_sound(content, order):
                raise InputError(
                    f"{path} holds a variable that is damaged, or nests structs and cells beyond reason: "
                    "save the signals again, as plain matrices"
                )


def _is_sound(matrix: bytes, order: str) -> bool:
    """Whether the elements of a matrix, and of those within it, are of known types, as many as needed, and fill it."""
    at, count = 0, 0
    within = [[len(matrix), _elements(matrix, 0, len(matrix), order), 0]]  # end, elements needed, elements found
    while within:
        end, needed, found = within[-1]
        if needed == _UNSOUND or len(within) + count > MOST_MATRICES:
            return False
        if end - at < 8:
            at = end
            within.pop()
            if needed not in (_ANY, found):
                return False
            continue
        kind, size = struct.unpack_from(order + "II", matrix, at)
        small = kind >> 16  # a tag of four bytes, and at most as many of content
        kind = kind & 0xFFFF if small else kind
        if kind not in _KNOWN or small > 4 or (not small and size > end - at - 8):
            return False
        within[-1][2] += 1
        if kind == _MATRIX:
            if small or needed != _ANY:
                return False
            at, count = at + 8, count + 1
            within.append([at + size, _elements(matrix, at, at + size, order), 0])
        else:
            at += 8 if small else 8 + size + -size % 8
    return True


def _elements(matrix: bytes, at: int, end: int, order: str) -> int:
    """How many elements a matrix of numbers needs: flags, size, name and values; `_UNSOUND` if these have no room."""
    if at == end:
        return 0  # an empty matrix is but a tag
    if end - at < 24:
        return _UNSOUND
    flags = struct.unpack_from(order + "I", matrix, at + 8)[0]
    kind = flags & 0xFF
    if kind in _NO_SIZE:
        return _ANY
    tag, size = struct.unpack_from(order + "II", matrix, at + 16)
    if tag not in _WHOLE or not 8 <= size <= end - at - 24:  # two dimensions at the least
        return _UNSOUND
    # a value takes a byte at the least, but for those of a sparse matrix
    if kind != _SPARSE and math.prod(struct.unpack_from(f"{order}{size // 4}i", matrix, at + 24)) > end - at:
        return _UNSOUND
    return _ANY if kind in _HOLDS_OTHERS else 4 + 2 * (kind == _SPARSE) + bool(flags & _COMPLEX)


# ---- version 7.3 ---------------------------------------------------------------------------------


def _groups_of_hdf5(
    file: h5py.File, group: h5py.Group, name: str, above: Mapping[str, float], seen: set[int], depth: int = 0
) -> Iterator[NamedGroup]:
    """The group of some variables or fields; matrices lie transposed in such a file."""
    import h5py

    arrays, numbers, within = [], {}, {}
    texts: dict[str, tuple[str, ...]] = {}
    for key, member in members(group, []):
        if key.startswith("#") or hash(member.id) in seen or len(seen) > MOST_OBJECTS:
            continue  # "#refs#" holds what cells and struct arrays refer to
        seen.add(hash(member.id))
        if isinstance(member, h5py.Group):
            within[key] = member
        elif member.shape is None or "MATLAB_empty" in member.attrs:
            continue
        elif _class_of(member) == b"char":
            texts[key] = (_text(member),)
        elif h5py.check_ref_dtype(member.dtype) is h5py.Reference:
            if key.casefold() in (*NAME_KEYS, *UNIT_KEYS) and member.size <= 10_000:
                referred = [file[each] for each in member[()].reshape(-1) if each]
                texts[key] = tuple(_text(each) for each in referred if isinstance(each, h5py.Dataset))
        elif member.dtype.kind in "fiub" and member.size == 1:
            numbers[key] = float(np.asarray(member[()]).reshape(-1)[0])
        elif member.dtype.kind in "fiub" and member.size and len(member.shape) <= 2:
            shape = tuple(length for length in member.shape[::-1] if length > 1)
            arrays.append(NamedArray(key, shape, _reading(member.name, member.shape)))
    stated = {**above, **numbers}
    yield NamedGroup(name, tuple(arrays), stated, texts)
    for key, fields in within.items():
        if depth < DEEPEST:
            yield from _groups_of_hdf5(file, fields, f"{name}/{key}".strip("/"), stated, seen, depth + 1)


def _reading(name: str, shape: tuple[int, ...]) -> Any:
    def read(file: Any, key: tuple[slice, ...]) -> np.ndarray:
        if len(shape) == 2 and len(key) == 1:  # a vector is a matrix with one row or column
            return file[name][(0, key[0]) if shape[0] == 1 else (key[0], 0)]
        return file[name][key[::-1]].T

    return read


def _class_of(member: h5py.Dataset) -> object:
    """Its class in MATLAB: a text of fixed length, any other is not read."""
    name = "MATLAB_class"
    fixed = name in member.attrs and member.attrs.get_id(name).dtype.kind == "S" and not member.attrs.get_id(name).shape
    return member.attrs[name] if fixed else None


def _text(member: h5py.Dataset) -> str:
    """A text: its characters as 16-bit numbers."""
    if member.dtype.kind not in "ui" or member.size > 10_000:
        return ""
    codes = np.asarray(member[()]).astype(np.uint16).reshape(-1)
    return codes.astype("<u2").tobytes().decode("utf-16-le", "replace").strip("\0 ")
