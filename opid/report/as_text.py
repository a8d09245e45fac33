"""Plain text for a terminal of 80 columns: tables, rounded numbers, paragraphs."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterator, Sequence
from itertools import zip_longest

from opid.errors import escape_in_line, escape_invisible
from opid.report.document import Block, Column, Document, Paragraph, Remarks, Row, Table, end_sentence
from opid.report.formulas import write_plain

WIDTH = 80

# the path of a file begins at a root, a drive, the home or this folder, ends with a suffix, and may hold blanks
_PATH = re.compile(r"(?<!\S)(?:~|\.{1,2}|[A-Za-z]:)?[/\\][^\n:;,'\"]*?\.\w{1,8}(?!\w)")
_NO_BREAK = "\ue000"  # no text holds this character


def wrap_text(text: str, head: str = "", files: Collection[str] = ()) -> list[str]:
    """Return a paragraph as lines of at most 80 characters with `head` before the first; only paths may be longer.

    Neither what looks like a path nor any of these files is broken.

    >>> wrap_text("a " * 50, "Note: ")[1][:8]
    '      a '
    """
    words = escape_invisible(write_plain(text))
    kept = _PATH.sub(lambda path: path[0].replace(" ", _NO_BREAK), words)
    for file in map(escape_invisible, files):
        kept = kept.replace(file, file.replace(" ", _NO_BREAK))
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
    # a title may name what the command reads
    blocks = [wrap_text(title, files=document.command or ()), wrap_text(answer), *map(_lay_out_block, document.blocks)]
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
    # a row of one cell is a heading, which is wrapped, and may hold a formula
    rows = [tuple(map(escape_in_line, row)) if len(row) > 1 else row for row in table.rows[: table.most_in_text]]
    heads = tuple(escape_in_line(column.head) for column in table.columns)
    lines = _lay_out_rows([heads, *(row for row in rows if len(row) > 1)], table)
    text = next(lines)
    for row in rows:
        text += next(lines) if len(row) > 1 else ["", *wrap_text(row[0])]
    more = len(table.rows) - len(rows)
    return text + [f"and {more} more in the report"] * (more > 0)


def _lay_out_rows(rows: Sequence[Row], table: Table) -> Iterator[list[str]]:
    """Yield the lines of each row, first of that with the names of the columns.

    Where a line is too long for the terminal, optional columns are left out first. Then elastic cells are broken into
    lines, then the gap between the columns is reduced, and at last long names get a line of their own.
    """
    columns, gap = list(table.columns), 2
    blocks = [[row] for row in rows]

    def find_excess() -> int:
        return max(map(len, _align_columns([line for block in blocks for line in block], columns, gap))) - WIDTH

    if find_excess() > 0:
        kept = [index for index, column in enumerate(columns) if not column.is_optional]
        columns, blocks = [columns[index] for index in kept], [[tuple(row[index] for index in kept)] for row in rows]
    for index in [index for index, column in enumerate(columns) if column.is_elastic and find_excess() > 0]:
        room = max(len(block[0][index]) for block in blocks) - find_excess()
        blocks = [_break_cell(block, index, room) for block in blocks]
    gap = 2 if find_excess() <= 0 else 1
    longest = max(len(block[0][0]) for block in blocks)
    room = longest if find_excess() <= 0 else max(12, longest - find_excess())
    names = [block[0][0] if len(block[0][0]) > room else "" for block in blocks]
    short = [("", *line[1:]) if name else line for name, block in zip(names, blocks, strict=True) for line in block]
    lines = iter(_align_columns(short, columns, gap))
    for name, block in zip(names, blocks, strict=True):
        yield [*([name] if name else []), *(next(lines) for _ in block)]


def _break_cell(lines: list[Row], index: int, room: int) -> list[Row]:
    """Return the lines of a row with one cell broken after its blanks and plus signs; a long word stays whole."""
    pieces = [""]
    for word in re.split(r"(?<=[ +])(?![ +])", lines[0][index]):
        if pieces[-1] and len(f"{pieces[-1]}{word}".rstrip()) > room:
            pieces.append("")
        pieces[-1] += word
    empty = ("",) * len(lines[0])
    pairs = zip_longest(lines, map(str.rstrip, pieces))
    return [(*(line or empty)[:index], piece or "", *(line or empty)[index + 1 :]) for line, piece in pairs]


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
