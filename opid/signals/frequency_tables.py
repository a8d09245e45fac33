"""Small tables over frequency, as laboratories store curves: a header, and rows of numbers in CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from opid.errors import InputError
from opid.signals.files import read_table_text
from opid.signals.logs.text.table import cells_of, number_of
from opid.signals.recording import LARGEST_SIZE, FloatArray
from opid.signals.units import split_unit, to_si

FREQUENCY_NAMES = ("frequency_hz", "frequency", "freq", "f", "freq_hz", "f_hz", "hz", "omega")
"""Names that the column of frequencies may have, without regard to case; a unit in brackets may follow."""


def read_table(source: Path, header: str) -> tuple[list[str], FloatArray]:
    """Return the header of a table and its numbers, (n_rows, n_columns).

    Args:
        source: a text whose columns are separated by commas, semicolons or tabs.
        header: a header that such a file may have, which an error names.

    Raises:
        InputError: no table, or a cell that holds no number.
        OSError: the file cannot be read.
    """
    text, delimiter = read_table_text(source, header)
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    decimal = "." if delimiter == "," else "," if any("," in line for _, line in lines[1:]) else "."
    names = [cell.strip() for cell in cells_of(lines[0][1], delimiter)]
    while names and not names[-1]:
        names.pop()
    rows = []
    for number, line in lines[1:]:
        cells = cells_of(line, delimiter)
        if any(cell.strip() for cell in cells[len(names) :]) or len(cells) < len(names):
            raise InputError(
                f"line {number} has {len(cells)} cells and the header {len(names)}: give one cell for each column"
            )
        found = [number_of(cell, decimal) for cell in cells[: len(names)]]
        if None in found:
            raise InputError(f"line {number} has {cells[found.index(None)]!r} where a number is needed: correct it")
        if not all(abs(each) <= LARGEST_SIZE or each != each for each in found if each is not None):
            raise InputError(f"line {number} has a number beyond {LARGEST_SIZE:g}, which nothing measures: correct it")
        rows.append(found)
    return names, np.array(rows, dtype=np.float64).reshape(len(rows), len(names))


def find_frequency(header: Sequence[str], values: FloatArray) -> tuple[FloatArray, int]:
    """Return the frequencies of a table, Hz, and the index of their column, which one of `FREQUENCY_NAMES` names.

    Args:
        header: name of each column, with its unit in brackets or without.
        values: (n, n_columns) numbers.

    Raises:
        InputError: no or two columns of frequencies, a unit of another quantity, or a frequency that is not positive.

    >>> find_frequency(["f [kHz]", "tip [mm]"], np.array([[0.1, 2.0]]))
    (array([100.]), 0)
    """
    names = [split_unit(cell) for cell in header]
    columns = [index for index, (name, _) in enumerate(names) if name.casefold() in FREQUENCY_NAMES]
    if len(columns) != 1:
        what = "no column" if not columns else f"{len(columns)} columns"
        raise InputError(f"it has {what} of frequencies: call one 'frequency_hz' (its header is {', '.join(header)})")
    name, unit = names[columns[0]]
    factor, quantity = to_si(unit or ("rad/s" if name.casefold() == "omega" else "Hz"))
    if quantity not in ("Hz", "rad/s"):
        raise InputError(f"the frequencies are in {unit!r}: give them in Hz")
    factor /= 2 * np.pi if quantity == "rad/s" else 1.0
    frequency_hz = factor * values[:, columns[0]]
    if not (frequency_hz > 0).all():
        raise InputError(f"the frequency of row {int(np.argmin(frequency_hz > 0)) + 1} is not positive: leave it out")
    return frequency_hz, columns[0]
