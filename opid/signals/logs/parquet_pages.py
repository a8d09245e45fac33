"""Pages of Parquet files, looked at before the library makes room for them: one that lies may take all the memory.

A column of a row group is a chain of pages, each behind a header in Thrift's compact encoding. After
"Apache Parquet format", parquet.thrift, and "Thrift Compact protocol encoding".
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from opid.errors import InputError

_FOOTER_END = 8  # bytes: its length, "PAR1"
_ROW_GROUPS, _COLUMNS, _FACTS = 4, 1, 3  # fields of the footer, of a row group, of its column
_PATH, _ALL_VALUES, _ALL_UNFOLDED, _ALL_BYTES, _FIRST_PAGE, _DICTIONARY = 3, 5, 6, 7, 9, 11  # of what is said of that
_MOST_UNFOLDED = 16_000  # bytes from one of the file: a thousand of the longest values
_HEADER_BYTES = 4096  # those of columns of numbers take some tens
_KIND, _UNFOLDED, _SIZE, _VALUES = 1, 2, 3, 1  # fields of a header; _VALUES of the header within it
_OF_VALUES = {0: 5, 3: 8}  # kind of page -> field with the header within it
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _TEXT, _LIST, _STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 9, 12  # types
_DEEPEST = 16
_DAMAGE = (IndexError, KeyError, TypeError, ValueError, AttributeError)


Chunks = tuple[dict[str, "Chunk"], ...]
"""The columns of each row group, by their names."""


@dataclass(frozen=True)
class Chunk:
    """A column of a row group, as the footer states it.

    Args:
        first: byte where its first page begins.
        size: bytes of all its pages.
        unfolded: bytes of these when nothing is compressed.
        values: how many it has.
    """

    first: int
    size: int
    unfolded: int
    values: int


def stated_chunks(path: Path) -> Chunks:
    """Return what the footer states of each column of each row group, nested columns left out.

    Args:
        path: the file, which its library has opened.

    Raises:
        InputError: the footer is damaged.
    """
    with path.open("rb") as file:
        end = file.seek(-_FOOTER_END, io.SEEK_END)
        size = int.from_bytes(file.read(4), "little")
        file.seek(max(0, end - size))
        footer = file.read(size)
    try:
        groups = _struct(footer, 0, _DEEPEST)[0].get(_ROW_GROUPS) or []
        chunks = [[chunk[_FACTS] for chunk in group[_COLUMNS]] for group in groups]
        return tuple({each[_PATH][0].decode(): _chunk(each) for each in own if len(each[_PATH]) == 1} for own in chunks)
    except _DAMAGE as error:
        raise InputError(f"{path} has a damaged footer: it is cut off or damaged; export it again") from error


def require_sound_pages(path: Path, chunks: Chunks, groups: Iterable[int], columns: Iterable[str]) -> None:
    """Refuse a file with pages that do not fit into what its footer says of their column.

    Args:
        path: the file.
        chunks: what its footer states.
        groups: numbers of the row groups that are to be read.
        columns: names of the columns that are to be read.

    Raises:
        InputError: a page is larger than its column, or a header is damaged.
    """
    size = path.stat().st_size
    columns = list(columns)
    with path.open("rb") as file:
        for group in groups:
            for column in columns:
                chunk = chunks[group].get(column) if group < len(chunks) else None
                if chunk is None or not _is_sound(file, size, chunk):
                    raise InputError(
                        f"{path} says of its column {column!r} what its pages belie (row group {group + 1}): "
                        "it is damaged; export it again"
                    )


def _chunk(facts: dict[int, Any]) -> Chunk:
    first, dictionary = facts[_FIRST_PAGE], facts.get(_DICTIONARY) or 0
    first = dictionary if 0 < dictionary < first else first
    return Chunk(first, facts[_ALL_BYTES], facts[_ALL_UNFOLDED], facts[_ALL_VALUES])


def _is_sound(file: BinaryIO, size: int, chunk: Chunk) -> bool:
    at, end, values = chunk.first, chunk.first + chunk.size, 0
    if not 0 <= at <= end <= size or chunk.unfolded > _MOST_UNFOLDED * size:
        return False
    while values < chunk.values and at < end:
        file.seek(at)
        try:
            header, length = _struct(file.read(_HEADER_BYTES), 0, _DEEPEST)
            packed, unfolded, within = header[_SIZE], header[_UNFOLDED], header.get(_OF_VALUES.get(header[_KIND], 0))
            own = 0 if within is None else within[_VALUES]
        except _DAMAGE:
            return False
        at += length + packed
        values += own
        if min(packed, unfolded, own) < 0 or at > end or unfolded > chunk.unfolded:
            return False
    return values == chunk.values


def _struct(content: bytes, at: int, depth: int) -> tuple[dict[int, Any], int]:
    """The fields of a struct by their numbers, and where it ends; truths and fractions are not kept."""
    fields: dict[int, Any] = {}
    number = 0
    while (head := content[at]) != 0:
        at += 1
        kind = head & 15
        if head >> 4:
            number += head >> 4
        else:
            number, at = _number(content, at)
        fields[number], at = (None, at) if kind in (_TRUE, _FALSE) else _value(content, at, kind, depth)
    return fields, at + 1


def _value(content: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """A value and where it ends."""
    if depth == 0:
        raise ValueError("structs within structs beyond reason")
    if kind == _STRUCT:
        return _struct(content, at, depth - 1)
    if kind in (_I16, _I32, _I64):
        return _number(content, at)
    if kind in (_TRUE, _FALSE, _BYTE, _DOUBLE):
        return content[at], at + (8 if kind == _DOUBLE else 1)
    if kind == _TEXT:
        length, at = _unsigned(content, at)
        return content[at : at + length], at + length
    if kind == _LIST:
        head, at = content[at], at + 1
        length, at = _unsigned(content, at) if head >> 4 == 15 else (head >> 4, at)
        values = []
        for _ in range(length):
            value, at = _value(content, at, head & 15, depth - 1)
            values.append(value)
        return values, at
    raise ValueError(f"type {kind}, which no header of Parquet has")


def _number(content: bytes, at: int) -> tuple[int, int]:
    """A whole number with a sign (zigzag), and where it ends."""
    value, at = _unsigned(content, at)
    return (value >> 1) ^ -(value & 1), at


def _unsigned(content: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while content[at] & 0x80:
        value |= (content[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
    return value | content[at] << shift, at + 1
