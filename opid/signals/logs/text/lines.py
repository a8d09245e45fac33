"""A text of any length as lines: compressed or not, in any encoding, and never a line as long as a file."""

from __future__ import annotations

import codecs
import gzip
import io
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import IO

from opid.errors import InputError
from opid.signals.log_settings import LogSettings

LONGEST_LINE = 1 << 20
"""Characters of a line beyond which a file is no table: 40,000 numbers of full precision."""

BYTES_AT_ONCE = 1 << 20
"""A block of text: 1 MiB, some 4 MiB as lines and numbers."""

HEAD_BYTES = 1 << 17
"""The beginning of a text, which shows its encoding and its header."""

_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_WESTERN = frozenset(  # headers in Western Europe hold these, damaged bytes rarely: not ÿ, þ or ð
    "ÄÖÜäöüßÁÀÂÃÅÆÇÉÈÊËÍÌÎÏÑÓÒÔÕØÚÙÛáàâãåæçéèêëíìîïñóòôõøúùûŒœ°²³µ±·×½§€–—’“”…™®©"
)
_LATIN = "°²³µ".encode("latin-1")


def lines_of(
    path: Path, encoding: str | None = None, *, bytes_at_once: int = BYTES_AT_ONCE
) -> Generator[list[str], None, None]:
    r"""Yield the lines of a text, block by block, without their ends (\n, \r\n or \r)."""
    number, rest = 0, ""  # complete lines so far, and the beginning of the next
    with _open(path) as file:
        data = file.read(bytes_at_once)
        # an explicit encoding of UTF-8 must not keep the mark as a part of the first name
        marked = next((own for mark, own in _MARKS.items() if data.startswith(mark)), "utf-8")
        known = marked if encoding is None or marked.startswith(encoding.lower()) else encoding
        decoder = io.IncrementalNewlineDecoder(_decoder(known), translate=True)
        while True:
            try:
                text = decoder.decode(data, final=not data)
            except UnicodeDecodeError as error:
                raise _not_decoded(path, number, error, known, stated=encoding is not None) from error
            except UnicodeError as error:
                raise InputError(f"{path} is not {known} text ({error}): give another `encoding` in [log]") from error
            if "\0" in text:
                line = number + 1 + text[: text.index("\0")].count("\n")
                raise InputError(
                    f"{path} line {line} is binary or UTF-16 without its mark, not text: export the log as UTF-8 text, "
                    "or give `encoding` in [log]"
                )
            lines = (rest + text).split("\n")
            rest = lines.pop() if data else ""
            for at, line_text in enumerate((*lines, rest) if len(rest) + len(text) > LONGEST_LINE else (), start=1):
                if len(line_text) > LONGEST_LINE:
                    raise InputError(
                        f"{path} line {number + at} has more than {LONGEST_LINE} characters, as no log has: "
                        "write one line for each sample, one column for each channel"
                    )
            if not data and lines[-1:] == [""]:
                lines.pop()  # the end of the last line begins no other
            number += len(lines)
            if lines:
                yield lines
            if not data:
                return
            data = file.read(bytes_at_once)


def with_encoding(path: Path, settings: LogSettings) -> tuple[LogSettings, tuple[str, ...]]:
    """Return the settings with the encoding that a text shows where none is stated, and a remark where that is so."""
    encoding = None if settings.encoding else encoding_of(path)
    if encoding is None:
        return settings, ()
    return replace(settings, encoding=encoding), (f"the text is no UTF-8 and is read as {encoding} (Western Windows)",)


def encoding_of(path: Path) -> str | None:
    """Return "cp1252" for a text whose beginning is written as Windows does in Western Europe; None for any other.

    Such a text is no UTF-8, holds no characters that are, and is made of ASCII and what headers hold there.
    """
    with _open(path) as file:
        head = file.read(HEAD_BYTES)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last sign may be cut
        return None
    except UnicodeDecodeError:
        pass
    if any(map(head.startswith, _MARKS)) or not head.decode("utf-8", "ignore").isascii():
        return None
    try:
        text = head.decode("cp1252")
    except UnicodeDecodeError:
        return None
    return "cp1252" if all(sign.isascii() or sign in _WESTERN for sign in text) and "\0" not in text else None


def _open(path: Path) -> IO[bytes] | gzip.GzipFile:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rb")
    return path.open("rb")


def _decoder(encoding: str) -> codecs.IncrementalDecoder:
    try:
        io.TextIOWrapper(
            io.BytesIO(), encoding=encoding
        ).detach()  # refuses encodings of other things than text, like "hex"
        return codecs.getincrementaldecoder(encoding)()
    except (LookupError, ValueError) as error:
        raise InputError(
            f"the encoding {encoding!r} is not known: give one like 'utf-8', 'latin-1', 'cp1252'"
        ) from error


def _not_decoded(path: Path, number: int, error: UnicodeDecodeError, encoding: str, *, stated: bool) -> InputError:
    byte = error.object[error.start]
    line = number + 1 + error.object[: error.start].count(b"\n")
    name = "UTF-8" if encoding in ("utf-8", "utf-8-sig") else encoding
    remedy = "give another `encoding` in [log]" if stated else "give `encoding` in [log], or export the log as UTF-8"
    if not stated and byte in _LATIN and name == "UTF-8":
        sign = bytes([byte]).decode("latin-1")
        remedy = f"""if that stands for {sign!r}, give encoding = "latin-1" in [log], or export the log as UTF-8"""
    return InputError(f"{path} line {line} is not {name} text (byte 0x{byte:02x}): {remedy}")
