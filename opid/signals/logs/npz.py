"""NumPy archives (.npz), as `numpy.savez` writes them; what their arrays are is found as in MATLAB files.

`time` or `t` holds the stamps; without it `fs`, `dt`, ... is the rate. `names` and `units` are arrays of texts. Arrays
of Python objects are pickles, which could run code: they are not read. An archive is read whole when it is opened.
"""

from __future__ import annotations

import math
import zipfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from opid.errors import InputError
from opid.signals.archives import opened_archive
from opid.signals.log import Log
from opid.signals.log_settings import LogSettings
from opid.signals.logs import reader
from opid.signals.logs.named_arrays import groups_of_values, tracks_of

_SUFFIX = ".npy"


@reader(".npz", name="NumPy", magic=(b"PK\x03\x04",))
def open_npz(path: Path, settings: LogSettings) -> Log:
    """Open a NumPy archive.

    Args:
        path: the file.
        settings: what the file does not say.

    Raises:
        InputError: the file is damaged, promises more than it can hold, holds no numbers, or states an absurd rate.
    """
    with opened_archive(path) as archive:
        members = [each for each in archive.infolist() if each.filename.endswith(_SUFFIX)]
        found = {each.filename.removesuffix(_SUFFIX): _array(path, archive, each) for each in members}
    values = {name: value for name, value in found.items() if value is not None}
    tracks = tracks_of(path, list(groups_of_values(values, "", {})), settings, nullcontext)
    if not tracks:
        pickled = " (arrays of Python objects are not read)" if len(values) < len(found) else ""
        raise InputError(
            f"{path} holds no arrays of numbers{pickled}: save the signals themselves, `time` or `fs` beside"
        )
    return Log(path, "NumPy", tracks)


def _array(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Any:
    """The array of a member, its fields by name where it has some; None where it holds objects."""
    with archive.open(member) as file:
        version = npy.read_magic(file)
        if version not in ((1, 0), (2, 0), (3, 0)):
            raise InputError(
                f"{path} holds {member.filename!r} in a version of NumPy's format that is not known: {version}"
            )
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = read_header(file)
        # for the sizes that are promised as much is allocated
        promised, held = math.prod(shape) * kind.itemsize, member.file_size - file.tell()
        if not kind.hasobject and promised != held:
            raise InputError(
                f"{path} is damaged: {member.filename!r} says that it holds {promised} bytes, and holds {held}; "
                "save it again"
            )
    if kind.hasobject:
        return None
    with archive.open(member) as file:
        values = npy.read_array(file, allow_pickle=False)
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    if values.dtype.names:
        return {name: values[name] for name in values.dtype.names}
    return str(values) if values.dtype.kind == "U" and values.ndim == 0 else values
