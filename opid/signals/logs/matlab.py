"""MATLAB files (.mat) of version 4 to 7.3: how time, rate, names and units are found among the variables.

- The variables of the file belong together, and so do the fields of a struct, and of each element of a struct array.
- The vector `time` or `t` (or `time` of the table [log]) holds the stamps; every other numeric vector of that length is
  a channel, and a matrix n x m is the channels name_1 to name_m.
- Without stamps a scalar `fs`, `Fs`, `srate`, `sampling_rate`, ... is the rate, or `dt`, `Ts`, ... the interval; a
  struct that states none has the rate of the file.
- `Channel_1_Data` beside a struct `Channel_1_Header` has its `SignalName` and `Unit`, and the rate of `File_Header`.
- `names` (or `labels`, `channels`, ...) and `units` (or `unit`) are texts, one for each channel or one for all; a name
  may have its unit in brackets.

The table [log] (`time`, `time_unit`, `fs_hz`, `names`, `unit`) overrides what is found. Files up to version 7.2 are
compressed, so they are read whole when they are opened; version 7.3 is HDF5 and read in slices.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from opid.errors import FileError, count_repeats
from opid.signals.log import Log, LogSettings
from opid.signals.logs import reader
from opid.signals.logs.hdf5 import SIGNATURE, members, open_file
from opid.signals.logs.named_arrays import DEEPEST, NamedArray, NamedGroup, groups_of_values, tracks_of
from opid.signals.units import NAME_KEYS, UNIT_KEYS

if TYPE_CHECKING:
    import h5py

_NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_READ = (*_NUMERIC, "struct", "cell", "char")


@reader(".mat", name="MATLAB", needs="h5py", extra="hdf5")
def open_matlab(path: Path, settings: LogSettings) -> Log:
    """Open a MATLAB file: version 7.3 is read in slices, an older one whole."""
    with path.open("rb") as file:
        head = file.read(520)
    if SIGNATURE in (head[:8], head[512:520]):
        with open_file(path) as content:
            groups = list(_find_groups(content, content, "", {}, set()))
        tracks = tracks_of(path, groups, settings, lambda: open_file(path))
    else:
        groups = list(groups_of_values(_read_variables(path), "", {}))
        tracks = tracks_of(path, groups, settings, nullcontext)
    if not tracks:
        raise FileError(f"{path} holds no vectors or matrices of numbers: save the signals themselves, not objects")
    return Log(path, "MATLAB", tracks)


# ---- up to version 7.2 ---------------------------------------------------------------------------


def _read_variables(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat, whosmat

    listed = whosmat(path, appendmat=False)
    names = [name for name, _, kind in listed if kind in _READ]
    for name, n in count_repeats(names).items():
        raise FileError(f"{path} holds {n} variables called {name!r}: save it again in MATLAB")
    found = loadmat(path, appendmat=False, variable_names=names, simplify_cells=True)
    missing = [name for name in names if name not in found]
    if missing:
        raise FileError(f"{path} is cut off or damaged: its variable {missing[0]!r} cannot be read; save it again")
    return {name: found[name] for name in names}


# ---- version 7.3 ---------------------------------------------------------------------------------


def _find_groups(
    file: h5py.File, group: h5py.Group, name: str, above: Mapping[str, float], seen: set[int], depth: int = 0
) -> Iterator[NamedGroup]:
    """Return the group of some variables or fields, and those of the structs in it; matrices are stored transposed."""
    import h5py

    arrays, numbers, within = [], {}, {}
    texts: dict[str, tuple[str, ...]] = {}
    for key, member in members(group, []):
        if key.startswith("#") or hash(member.id) in seen:
            continue  # "#refs#" holds the elements of cells and struct arrays
        seen.add(hash(member.id))
        if isinstance(member, h5py.Group):
            within[key] = member
        elif member.shape is None or "MATLAB_empty" in member.attrs:
            continue
        elif _read_class(member) == b"char":
            texts[key] = (_read_text(member),)
        elif h5py.check_ref_dtype(member.dtype) is h5py.Reference:
            if key.casefold() in (*NAME_KEYS, *UNIT_KEYS):
                referred = [file[each] for each in member[()].reshape(-1) if each]
                texts[key] = tuple(_read_text(each) for each in referred if isinstance(each, h5py.Dataset))
        elif member.dtype.kind in "fiub" and member.size == 1:
            numbers[key] = float(np.asarray(member[()]).reshape(-1)[0])
        elif member.dtype.kind in "fiub" and member.size and len(member.shape) <= 2:
            shape = tuple(length for length in member.shape[::-1] if length > 1)
            arrays.append(NamedArray(key, shape, partial(_read, member.name, member.shape)))
    stated = {**above, **numbers}
    yield NamedGroup(name, tuple(arrays), stated, texts)
    for key, fields in within.items():
        if depth < DEEPEST:
            yield from _find_groups(file, fields, f"{name}/{key}".strip("/"), stated, seen, depth + 1)


def _read(name: str, shape: tuple[int, ...], file: Any, key: tuple[slice, ...]) -> np.ndarray:
    if len(shape) == 2 and len(key) == 1:  # a vector is a matrix with one row or column
        return file[name][(0, key[0]) if shape[0] == 1 else (key[0], 0)]
    return file[name][key[::-1]].T


def _read_class(member: h5py.Dataset) -> object:
    """Return its class in MATLAB, where that is stored as a text of fixed length."""
    name = "MATLAB_class"
    fixed = name in member.attrs and member.attrs.get_id(name).dtype.kind == "S" and not member.attrs.get_id(name).shape
    return member.attrs[name] if fixed else None


def _read_text(member: h5py.Dataset) -> str:
    """Return a text, whose characters are stored as 16-bit numbers."""
    if member.dtype.kind not in "ui":
        return ""
    codes = np.asarray(member[()]).astype(np.uint16).reshape(-1)
    return codes.astype("<u2").tobytes().decode("utf-16-le", "replace").strip("\0 ")
