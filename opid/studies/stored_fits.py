"""The fits in a result.json of `opid identify`."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from opid.errors import FileError
from opid.result import RESULT_FILE
from opid.studies.schema import read_tables
from opid.suspensions.answer.stored_fit import StoredFit
from opid.suspensions.flights.result_file import load_result


@dataclass(frozen=True)
class _Fits:
    fits: tuple[StoredFit, ...] = ()


def read_fits(path: str | os.PathLike[str]) -> tuple[StoredFit, ...]:
    """Return the fits of a result.json; none if the result gives no number with an interval.

    Args:
        path: the file, or the folder of a report.

    Raises:
        InputError: it is missing, no result of `opid identify`, or one of another method or of an older version.
    """
    file = Path(path)
    file = file / RESULT_FILE if os.path.isdir(file) else file
    document = load_result(file)
    if "fits" not in document:
        why = "by an older version" if document.get("method") == "model" else f"by --method {document.get('method')}"
        raise FileError(f"{file} was written {why} and holds no fit: identify the study again with `opid identify`")
    found, faults = read_tables(_Fits, {"fits": document["fits"]})
    if faults:
        raise FileError(f"{file} is no valid result: {faults[0]}: write it again with `opid identify`")
    names = Counter(name for fit in found.fits for name in fit.interfaces)
    if twice := [name for name, n in names.items() if n > 1]:
        raise FileError(
            f"{file} is no valid result: it has several fits of the interface {twice[0]!r}: write it again with "
            "`opid identify`"
        )
    return found.fits
