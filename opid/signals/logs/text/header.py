"""Where the table of a text begins, what separates its columns, and what they are called."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from opid.errors import FileError, InputError
from opid.signals.log import LogSettings
from opid.signals.logs.text.stamps import is_stamp, looks_dated
from opid.signals.logs.text.table import BLANKS, COMMENTS, MOST_COLUMNS, cells_of, has_thousands_mark, is_row, number_of
from opid.signals.units import si_unit, split_unit, time_name

EXAMPLE = "`time [s],lower_z [m/s^2],upper_z [m/s^2]`"

NUMBER, STAMP, UNREAD, DATE, TEXT, EMPTY = "number", "stamp", "stamp in another form", "date", "text", ""
INDEX = "index"  # a column without a name that counts the rows, as data frames are written

# where several fit equally well, the first is taken
_LAYOUTS = [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", "."), ("|", ",")]
_LAYOUTS += [(BLANKS, "."), (BLANKS, ","), (",", ",")]
_ROWS_TO_TELL = 60
_RULE = re.compile(r"[-=_+|*\s]+")
# after an underscore these are units, never a part of a name; upper_z, pump_in and imu_g are names
_UNDERSCORE_UNITS = frozenset(("mg", "ug", "mm", "mV", "kN", "Hz", "kHz", "rpm", "deg", "dps", "degC", "kPa", "MPa"))


@dataclass(frozen=True)
class Column:
    """A column of a text."""

    name: str  # name in the header
    unit: str | None  # unit as it is written; None where there is none
    kind: str = NUMBER  # what its first cells hold: `NUMBER`, `STAMP`, `UNREAD`, `DATE`, `TEXT`, `EMPTY` or `INDEX`


@dataclass(frozen=True)
class TextHeader:
    """What was found above the numbers."""

    columns: tuple[Column, ...]  # all columns
    delimiter: str  # delimiter between the columns
    decimal: str  # decimal mark, "." or ","
    line: int  # number of the header's line, 0 where there is none
    first_line: int  # number of the first line of numbers


def header_of(path: Path, lines: Sequence[str], settings: LogSettings) -> TextHeader:
    """Return what the first lines of a text say about its table."""
    skipped = settings.skip_lines or 0
    numbered = [(at, line) for at, line in enumerate(lines, start=1) if at > skipped and line.strip()]
    if not numbered:
        raise FileError(f"{path} has no header and no samples: begin with {EXAMPLE}")
    delimiter, decimal = _find_layout(path, [line for _, line in numbered][-_ROWS_TO_TELL:], settings)
    rows = [(at, line) for at, line in numbered if is_row(line, delimiter)]
    remarks = [(at, line) for at, line in numbered if line.lstrip().startswith(COMMENTS)]
    kinds = _find_kinds([cells_or_text(line, delimiter) for _, line in rows[-_ROWS_TO_TELL:]], decimal)[0]
    if kinds is None:
        return _read_header_alone(path, numbered, delimiter, decimal, settings)
    begin = (
        0 if settings.names and settings.skip_lines is not None else _find_first_row(rows, kinds, delimiter, decimal)
    )
    first = rows[begin][0]
    above = [(at, line) for at, line in numbered if at < first and is_row(line, delimiter)]
    if settings.names:
        line, cells = 0, _match_columns(list(settings.names), kinds)
        if cells is None:
            raise FileError(
                f"{path}: `names` of [log] has {len(settings.names)} entries, line {first} has {len(kinds)} cells: "
                "name every column, the time among them"
            )
        units: list[str | None] = [None] * len(kinds)
    else:
        line, cells, units = _find_header(
            path, above, [each for each in remarks if each[0] < first], first, kinds, delimiter
        )
    if len(cells) > 1 and not cells[0] and _is_counting([cells_or_text(row, delimiter)[0] for _, row in rows[begin:]]):
        cells, kinds = ["column 1", *cells[1:]], (INDEX, *kinds[1:])
    columns = columns_of(f"{path} line {line}" if line else str(path), cells, units, kinds)
    return TextHeader(columns, delimiter, decimal, line, first)


def columns_of(
    where: str, cells: Sequence[str], units: Sequence[str | None], kinds: Sequence[str]
) -> tuple[Column, ...]:
    """Return the columns that the cells of a header describe."""
    columns = []
    for number, (cell, unit, kind) in enumerate(zip(cells, units, kinds, strict=True), start=1):
        name, own = (cell, unit) if unit else name_and_unit(cell)
        if not name:
            if number == len(cells) > 1 and kind == EMPTY and not cell:
                name = f"column {number}"  # lines end with a delimiter: nothing is there
            else:
                remedy = "write one, or remove the separator before it"
                raise FileError(f"{where}: column {number} has no name: {remedy if number > 1 else 'write one'}")
        columns.append(Column(name, own, kind))
    twice = Counter(column.name for column in columns).most_common(1)
    if twice and twice[0][1] > 1:
        raise FileError(f"{where} names {twice[0][1]} columns {twice[0][0]!r}: rename all but one")
    return tuple(columns)


def name_and_unit(cell: str) -> tuple[str, str | None]:
    """Split a cell of a header into name and unit; None where there is no unit.

    >>> name_and_unit("upper_z (m/(s^2))"), name_and_unit("Time / ms"), name_and_unit("time_ms")
    (('upper_z', 'm/(s^2)'), ('Time', 'ms'), ('time_ms', 'ms'))
    >>> name_and_unit("left / right"), name_and_unit("upper_m")
    (('left / right', None), ('upper_m', None))
    """
    name, unit = split_unit(cell)
    if unit or name != cell.strip():
        return name, unit
    if re.fullmatch(r"\[.*\]|\(.*\)", cell):
        return "", cell[1:-1].strip() or None
    for mark in (" / ", ", "):
        name, found, unit = cell.partition(mark) if mark == " / " else cell.rpartition(mark)
        if found and si_unit(unit.strip()):
            return name.strip(), unit.strip()
    stem, found, unit = cell.rpartition("_")
    if found and stem and si_unit(unit) and (unit in _UNDERSCORE_UNITS or re.search(r"[/^²°]", unit)):
        return cell, unit
    return cell, None


def cells_or_text(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, or the line as one cell if it is no line of a table."""
    try:
        return cells_of(line, delimiter)
    except InputError:
        return [line]


# ---- where the rows begin ------------------------------------------------------------------------


def _find_layout(path: Path, lines: Sequence[str], settings: LogSettings) -> tuple[str, str]:
    """Return the delimiter and the decimal with which most cells of the last lines are numbers."""
    own = settings.delimiter
    if own is not None and (len(own) != 1 or own.isalnum() or own in '+-."\n\r'):
        raise FileError(f"{path}: delimiter is {own!r}: give one like ',', ';', '|', '\\t', or ' ' for runs of blanks")
    layouts = [each for each in _LAYOUTS if settings.decimal in (None, each[1])]
    if own is not None:
        layouts = [(own, decimal) for decimal in (".", ",") if settings.decimal in (None, decimal)]
    widest = max(max(max(map(line.count, ",;\t|")) + 1, len(line.split())) for line in lines)
    if widest > MOST_COLUMNS:
        raise FileError(
            f"{path} has lines of {widest} cells: write one line for each sample and at most {MOST_COLUMNS} columns"
        )
    best, found = 0, layouts[0]
    for delimiter, decimal in layouts:
        if delimiter != BLANKS and own is None and delimiter not in "".join(lines) and (delimiter, decimal) != found:
            continue
        rows = [cells_or_text(line, delimiter) for line in lines if is_row(line, delimiter)]
        kinds, score = _find_kinds(rows, decimal)
        if kinds is not None and score > best:
            best, found = score, (delimiter, decimal)
    return found if best or own is not None else (_guess_delimiter(lines), found[1])


def _guess_delimiter(lines: Sequence[str]) -> str:
    """Return the delimiter of a header without numbers below it: the one that makes most cells, the comma on a tie."""
    return max((",", ";", "\t", "|"), key=lambda mark: len(cells_or_text(lines[0], mark)))


def _classify(cell: str, decimal: str) -> str:
    if not cell:
        return EMPTY
    # a number with a thousands mark is refused where it is read
    if number_of(cell, decimal) is not None or has_thousands_mark(cell, decimal):
        return NUMBER
    if not looks_dated(cell):
        return TEXT
    return STAMP if is_stamp(cell) else UNREAD if ":" in cell else DATE


def _find_kinds(rows: Sequence[Sequence[str]], decimal: str) -> tuple[tuple[str, ...] | None, int]:
    """Return the kinds of the columns in most rows (None if no column holds numbers), and the weight of these rows."""
    found = [tuple(_classify(cell, decimal) for cell in cells) for cells in rows]
    best, most = None, 0
    for count in dict.fromkeys(map(len, found)):
        of_count = [kinds for kinds in found if len(kinds) == count]
        plain = [kinds for kinds in of_count if TEXT not in kinds]
        candidates = [kinds for kinds, _ in Counter(set(of_count) - set(plain)).most_common()]
        if plain:
            candidates.append(tuple(_find_most_common(column) for column in zip(*plain, strict=True)))
        for kinds in candidates:
            n_numbers = sum(kind in (NUMBER, STAMP, UNREAD) for kind in kinds)
            # a title may look like a row of texts and a number, but hardly like a row of numbers alone
            weight = (1 if TEXT in kinds else 3) * sum(_is_match(each, kinds) for each in of_count) * n_numbers
            if weight >= most and weight > 0:
                best, most = kinds, weight
    return best, most


def _find_most_common(kinds: Sequence[str]) -> str:
    held = Counter(kind for kind in kinds if kind != EMPTY)
    return held.most_common(1)[0][0] if held else EMPTY


def _is_match(kinds: Sequence[str], usual: Sequence[str]) -> bool:
    return len(kinds) == len(usual) and all(
        kind in (EMPTY, own) or own == EMPTY for kind, own in zip(kinds, usual, strict=True)
    )


def _find_first_row(rows: Sequence[tuple[int, str]], kinds: Sequence[str], delimiter: str, decimal: str) -> int:
    """Return the index of the first row of numbers; a faulty row counts if it begins like the others."""
    found: list[tuple[str, ...]] = []
    for _, line in rows:
        own = tuple(_classify(cell, decimal) for cell in cells_or_text(line, delimiter))
        found.append(own)
        if _is_match(own, kinds) and {NUMBER, STAMP} & set(own):
            break
    begin = len(found) - 1
    while begin and len(found[begin - 1]) == len(kinds) and found[begin - 1][0] == kinds[0] in (NUMBER, STAMP):
        begin -= 1
    return begin


# ---- names ---------------------------------------------------------------------------------------


def _find_header(
    path: Path,
    above: Sequence[tuple[int, str]],
    remarks: Sequence[tuple[int, str]],
    first: int,
    kinds: Sequence[str],
    delimiter: str,
) -> tuple[int, list[str], list[str | None]]:
    """Return the line, cells and units of the header: the line above the rows, or two lines, or a remark, or none."""
    n = len(kinds)
    above = [each for each in above if not _RULE.fullmatch(each[1])]
    plain: list[str | None] = [None] * n
    if above:
        at, text = above[-1]
        cells = _split_header(text, kinds, delimiter)
        before = _split_header(above[-2][1], kinds, delimiter) if len(above) > 1 else None
        if cells and before and _is_unit_line(cells) and all(before[:-1]) and not _is_unit_line(before):
            return above[-2][0], before, [cell.strip("[]() ") or None for cell in cells]
        if cells is None:
            k = len(cells_or_text(text, delimiter))
            raise FileError(
                f"{path} line {at} has {k} cell(s) where line {first} has {n}: mend the header, "
                "or give `names` in [log] for all columns"
            )
        return at, cells, plain
    if remarks:  # numpy.savetxt and others write the header as a remark
        at, text = remarks[-1]
        bare = text.lstrip().lstrip("#%/ ")
        cells = _split_header(bare, kinds, delimiter)
        if cells and ("[" in bare or "(" in bare or time_name([name_and_unit(cells[0])[0]])):
            return at, cells, plain
    return 0, [f"column {number}" for number in range(1, n + 1)], plain


def _split_header(text: str, kinds: Sequence[str], delimiter: str) -> list[str] | None:
    """Return the cells of a header, one for each column; their delimiter may differ from that of the numbers."""
    splits = [cells_or_text(text, delimiter)]
    if len(kinds) > 1:
        splits += [cells_or_text(text, other) for other in (",", ";", "\t", "|")]
        splits.append(re.split(r"\s{2,}|\t", text.strip()))
    if delimiter == BLANKS:
        # blanks also separate names from their units
        joined = re.findall(r'"[^"]*"|[^\s\[(]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?', text)
        splits.append([cell.strip('"') for cell in joined])
    return next((matched for cells in splits if (matched := _match_columns(cells, kinds)) is not None), None)


def _is_counting(cells: Sequence[str]) -> bool:
    if len(cells) < 2 or not all(re.fullmatch(r"\d{1,15}", cell, re.ASCII) for cell in cells):
        return False
    return [int(cell) for cell in cells] == list(range(int(cells[0]), int(cells[0]) + len(cells)))


def _match_columns(cells: list[str], kinds: Sequence[str]) -> list[str] | None:
    """Return the cells if there is one for each column; a delimiter at the end of lines may add or remove one."""
    if len(cells) == len(kinds) + 1 and not cells[-1]:
        return cells[:-1]
    if len(cells) == len(kinds) - 1 and kinds[-1] == EMPTY:
        return [*cells, ""]
    return cells if len(cells) == len(kinds) else None


def _is_unit_line(cells: Sequence[str]) -> bool:
    """Return whether the cells of a line are units: at least half of them are known, or all are in brackets."""
    held = [cell for cell in cells if cell]
    known = [si_unit(cell.strip("[]() ")) is not None for cell in held]
    bracketed = [cell[0] in "[(" and cell[-1] in "])" for cell in held]
    return bool(held) and (2 * sum(known) >= len(held) or all(bracketed))


def _read_header_alone(
    path: Path, numbered: Sequence[tuple[int, str]], delimiter: str, decimal: str, settings: LogSettings
) -> TextHeader:
    at, text = numbered[0]
    text = text.lstrip().lstrip("#%/ ")
    cells = list(settings.names) or cells_or_text(text, delimiter)
    if not any(cells):
        raise FileError(f"{path} has no header and no samples: begin with {EXAMPLE}")
    columns = columns_of(f"{path} line {at}", cells, [None] * len(cells), [NUMBER] * len(cells))
    return TextHeader(columns, delimiter, decimal, at, at + 1)
