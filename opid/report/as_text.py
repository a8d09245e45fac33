"""Plain text for a terminal of 80 columns: tables, rounded numbers, paragraphs."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterator, Sequence

from opid.report.document import Block, Column, Document, Paragraph, Remarks, Table, ended

WIDTH = 80

# a path to a file, which may hold blanks: it begins at a root, a drive, the home or this folder, and ends with a suffix
_PATH = re.compile(r"(?<!\S)(?:~|\.{1,2}|[A-Za-z]:)?[/\\][^\n:;,'\"]*?\.\w{1,8}(?!\w)")
_NO_BREAK = "\ue000"  # a character that no text holds


def wrapped(text: str, head: str = "") -> list[str]:
    """Return a paragraph as lines of at most 80 characters with `head` before the first; only paths may be longer.

    >>> wrapped("a " * 50, "Note: ")[1][:8]
    '      a '
    """
    kept = _PATH.sub(lambda path: path[0].replace(" ", _NO_BREAK), text)
    lines = textwrap.wrap(
        kept,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]


def as_text(document: Document) -> str:
    """Return a document for a terminal: paragraphs and aligned tables, without figures."""
    answer = f"Not determined: {ended(document.not_determined)}" if document.not_determined else document.answer
    title = f"{document.title} ({document.about})" if document.about else document.title
    for file in document.command or ():  # a title may name what the command reads
        title = title.replace(file, file.replace(" ", _NO_BREAK))
    blocks = [wrapped(title), wrapped(answer), *map(_block_lines, document.blocks)]
    return "\n\n".join("\n".join(lines) for lines in blocks if lines) + "\n"


def _block_lines(block: Block) -> list[str]:
    if isinstance(block, Paragraph):
        return [*wrapped(block.heading), *wrapped(block.text)]
    if isinstance(block, Remarks):
        head = f"{block.label}: " if block.label else ""
        return [line for each in block.sentences for line in wrapped(ended(each), head)]
    if isinstance(block, Table):
        return [*wrapped(block.title), *_lines_of_table(block), *wrapped(block.note)]
    return []


def _lines_of_table(table: Table) -> list[str]:
    """The aligned rows below the names of their columns, with an empty line before each heading."""
    rows = table.rows[: table.most_in_text]
    lines = _rows_in_width([tuple(column.head for column in table.columns), *(r for r in rows if len(r) > 1)], table)
    text = next(lines)
    for row in rows:
        text += next(lines) if len(row) > 1 else ["", *wrapped(row[0])]
    more = len(table.rows) - len(rows)
    return text + [f"and {more} more in the report"] * (more > 0)


def _rows_in_width(rows: Sequence[tuple[str, ...]], table: Table) -> Iterator[list[str]]:
    """Yield the lines of each row, first of that with the names of the columns.

    Where a line is too long for the terminal, optional columns are left out first. Then elastic cells are shortened,
    then the gap between the columns is reduced, and at last long names get a line of their own.
    """
    columns, gap = list(table.columns), 2

    def excess() -> int:
        return max(map(len, _align_columns(rows, columns, gap))) - WIDTH

    if excess() > 0:
        kept = [index for index, column in enumerate(columns) if not column.is_optional]
        columns, rows = [columns[index] for index in kept], [tuple(row[index] for index in kept) for row in rows]
    for index in [index for index, column in enumerate(columns) if column.is_elastic and excess() > 0]:
        room = max(max(len(row[index]) for row in rows) - excess(), 3)
        rows = [(*row[:index], _shorten(row[index], room), *row[index + 1 :]) for row in rows]
    gap = 2 if excess() <= 0 else 1
    longest = max(len(row[0]) for row in rows)
    room = longest if excess() <= 0 else max(12, longest - excess())
    short = [(row[0] if len(row[0]) <= room else "", *row[1:]) for row in rows]
    for row, line in zip(rows, _align_columns(short, columns, gap), strict=True):
        yield [row[0], line] if len(row[0]) > room else [line]


def _shorten(text: str, room: int) -> str:
    return text if len(text) <= room else f"{text[: room - 2]}.."


def _align_columns(rows: Sequence[Sequence[str]], columns: Sequence[Column], gap: int) -> list[str]:
    return aligned(rows, left=[index for index, each in enumerate(columns) if each.align == "left"], gap=gap)


def aligned(table: Sequence[Sequence[str]], *, left: Collection[int] = (0,), gap: int = 2) -> list[str]:
    """Return the rows of a table with aligned columns; those with an index in `left` are aligned to the left.

    >>> aligned([("name", "value"), ("mass", "1850")])
    ['name  value', 'mass   1850']
    """
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    return [
        (gap * " ")
        .join(
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        .rstrip()
        for row in table
    ]
