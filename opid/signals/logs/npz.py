"""NumPy archives (.npz), as `numpy.savez` writes them; time, rate, names and units are found as in MATLAB files.

`time` or `t` holds the stamps; without it `fs`, `dt`, ... is the rate. `names` and `units` are arrays of texts. Arrays
of Python objects are not read, for they are pickles and could run code. An archive is read whole when it is opened.
"""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError, InputError
from opid.signals.log import Log, LogSettings
from opid.signals.logs import reader
from opid.signals.logs.archives import read_archive
from opid.signals.logs.named_arrays import groups_of_values, tracks_of
from opid.signals.units import time_name


@reader(".npz", name="NumPy", magic=(b"PK\x03\x04",), apart=True)
def open_npz(path: Path, settings: LogSettings) -> Log:
    """Open a NumPy archive."""
    try:
        held = read_archive(path)
    except InputError as error:
        raise FileError(f"{path}: {error}") from None
    values, pickled = {name: _simplify(array) for name, array in held.arrays.items()}, held.pickled
    signals = [name for name, value in values.items() if np.size(value) > 1 and time_name([name]) is None]
    if pickled and not signals:
        raise FileError(
            f"{path} holds no signals as numbers; not read, for they hold Python objects: {', '.join(pickled)}. Save "
            "arrays of numbers, `time` or `fs` beside"
        )
    tracks = tracks_of(path, list(groups_of_values(values, "", {})), settings, nullcontext)
    if not tracks:
        raise FileError(f"{path} holds no arrays of numbers: save the signals themselves, `time` or `fs` beside")
    remarks = tuple(f"{name!r} holds Python objects and is not read" for name in pickled)
    return Log(path, "NumPy", tracks, remarks=remarks)


def _simplify(values: np.ndarray) -> Any:
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    if values.dtype.names:
        return {name: values[name] for name in values.dtype.names}
    return str(values) if values.dtype.kind == "U" and values.ndim == 0 else values
