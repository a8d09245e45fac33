"""Loading tables: CSV files that say what a run carries more than the reference, and where."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from opid.errors import InputError, nearest
from opid.suspensions.study import PointMass

COLUMNS = ("mass_kg", "x_m", "y_m")
"""Of a loading table."""


def read_loading(path: Path) -> tuple[PointMass, ...]:
    """Read a loading table: a CSV file with the columns mass_kg, x_m and y_m, in any order among others.

    Args:
        path: the file; its columns stand apart by commas, or by semicolons (numbers may then have decimal commas).

    Raises:
        InputError: no such file, a column that is missing, a cell that is no number: all at once.
    """
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except OSError as error:
        raise InputError(f"cannot read the loading table {path}: {error.strerror}: check the name") from error
    except ValueError as error:  # no UTF-8, or a zero byte in the name
        raise InputError(f"the loading table {path} is no UTF-8 text: give a CSV file") from error
    delimiter = ";" if lines and ";" in lines[0] else ","
    head, *rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter)] or [[]]
    faults = [f"lacks the column {name!r} ({nearest(name, head)})" for name in COLUMNS if name not in head]
    loading = []
    for number, row in enumerate([] if faults else rows, start=2):
        cells = [row[head.index(name)] if head.index(name) < len(row) else "" for name in COLUMNS]
        values = [_number(cell.replace(",", ".") if delimiter == ";" else cell) for cell in cells]
        faults += [
            f"has {cell!r} for {name} in row {number}, give a number"
            for name, cell, value in zip(COLUMNS, cells, values, strict=True)
            if value is None
        ]
        loading.append(PointMass(*(math.nan if value is None else value for value in values)))
    if not faults and not rows:
        faults = ["has no row below its head, give one a mass (for the reference leave 'loading' out)"]
    if faults:
        raise InputError(f"the loading table {path} {'; it '.join(faults)}")
    return tuple(loading)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
