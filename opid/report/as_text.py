"""Plain text for a terminal of 80 columns: tables, rounded numbers, paragraphs."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterator, Sequence

from opid.report.document import Block, Column, Document, Paragraph, Remarks, Table, end_sentence
from opid.report.formulas import write_plain

WIDTH = 80

# the path of a file begins at a root, a drive, the home or this folder, ends with a suffix, and may hold blanks
_PATH = re.compile(r"(?<!\S)(?:~|\.{1,2}|[A-Za-z]:)?[/\\][^\n:;,'\"]*?\.\w{1,8}(?!\w)")
_NO_BREAK = "\ue000"  # no text holds this character


def wrap_text(text: str, head: str = "") -> list[str]:
    """Return a paragraph as lines of at most 80 characters with `head` before the first; only paths may be longer.

    >>> wrap_text("a " * 50, "Note: ")[1][:8]
    '      a '
    """
    kept = _PATH.sub(lambda path: path[0].replace(" ", _NO_BREAK), write_plain(text))
    lines = textwrap.wrap(
        kept,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]


def lay_out_text(document: Document) -> str:
    """Return a document for a terminal: paragraphs and aligned tables, without figures."""
    answer = f"Not determined: {end_sentence(document.not_determined)}" if document.not_determined else document.answer
    title = f"{document.title} ({document.about})" if document.about else document.title
    for file in document.command or ():  # a title may name what the command reads
        title = title.replace(file, file.replace(" ", _NO_BREAK))
    blocks = [wrap_text(title), wrap_text(answer), *map(_lay_out_block, document.blocks)]
    return "\n\n".join("\n".join(lines) for lines in blocks if lines) + "\n"


def _lay_out_block(block: Block) -> list[str]:
    if isinstance(block, Paragraph):
        return [*wrap_text(block.heading), *wrap_text(block.text)]
    if isinstance(block, Remarks):
        head = f"{block.label}: " if block.label else ""
        return [line for each in block.sentences for line in wrap_text(end_sentence(each), head)]
    if isinstance(block, Table):
        return [*wrap_text(block.title), *_lay_out_table(block), *wrap_text(block.note)]
    return []


def _lay_out_table(table: Table) -> list[str]:
    """The aligned rows below the names of their columns, with an empty line before each heading."""
    rows = table.rows[: table.most_in_text]
    lines = _lay_out_rows([tuple(column.head for column in table.columns), *(r for r in rows if len(r) > 1)], table)
    text = next(lines)
    for row in rows:
        text += next(lines) if len(row) > 1 else ["", *wrap_text(row[0])]
    more = len(table.rows) - len(rows)
    return text + [f"and {more} more in the report"] * (more > 0)


def _lay_out_rows(rows: Sequence[tuple[str, ...]], table: Table) -> Iterator[list[str]]:
    """Yield the lines of each row, first of that with the names of the columns.

    Where a line is too long for the terminal, optional columns are left out first. Then elastic cells are shortened,
    then the gap between the columns is reduced, and at last long names get a line of their own.
    """
    columns, gap = list(table.columns), 2

    def find_excess() -> int:
        return max(map(len, _align_columns(rows, columns, gap))) - WIDTH

    if find_excess() > 0:
        kept = [index for index, column in enumerate(columns) if not column.is_optional]
        columns, rows = [columns[index] for index in kept], [tuple(row[index] for index in kept) for row in rows]
    for index in [index for index, column in enumerate(columns) if column.is_elastic and find_excess() > 0]:
        room = max(max(len(row[index]) for row in rows) - find_excess(), 3)
        rows = [(*row[:index], _shorten(row[index], room), *row[index + 1 :]) for row in rows]
    gap = 2 if find_excess() <= 0 else 1
    longest = max(len(row[0]) for row in rows)
    room = longest if find_excess() <= 0 else max(12, longest - find_excess())
    short = [(row[0] if len(row[0]) <= room else "", *row[1:]) for row in rows]
    for row, line in zip(rows, _align_columns(short, columns, gap), strict=True):
        yield [row[0], line] if len(row[0]) > room else [line]


def _shorten(text: str, room: int) -> str:
    return text if len(text) <= room else f"{text[: room - 2]}.."


def _align_columns(rows: Sequence[Sequence[str]], columns: Sequence[Column], gap: int) -> list[str]:
    return align_table(rows, left=[index for index, each in enumerate(columns) if each.align == "left"], gap=gap)


def align_table(table: Sequence[Sequence[str]], *, left: Collection[int] = (0,), gap: int = 2) -> list[str]:
    """Return the rows of a table with aligned columns; those with an index in `left` are aligned to the left.

    >>> align_table([("name", "value"), ("mass", "1850")])
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
