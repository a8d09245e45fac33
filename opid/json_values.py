"""Values that JSON knows, and the text of a JSON file, written and read: numbers that are not finite become null."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import INVISIBLE
from opid.provenance import read_content

LARGEST = 1e100
"""Size of a number beyond which it is a slip, and its square would soon overflow."""

LEAST = 1e-100
"""Size of a number below which it is zero: its square would be."""

_MOST_DIGITS = 18
"""Digits of a whole number: 64 bits hold as many."""


def plain(value: Any) -> Any:
    """Return a value with nothing in it that JSON does not know: numpy becomes Python, NaN and infinity null.

    Args:
        value: dicts, lists, tuples, arrays, numbers, text and None, in each other.

    >>> plain({"a": np.array([1.0, np.nan]), "b": (np.int64(2), True)})
    {'a': [1.0, None], 'b': [2, True]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(document: Mapping[str, Any]) -> str:
    """Return a document as the text of a JSON file.

    Args:
        document: of plain values (see `plain`).

    Raises:
        ValueError: a number that is not finite.

    >>> json_text({"a": [1, None]})
    '{\\n  "a": [1, null]\\n}\\n'
    """
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    # a terminal that shows the document shall not be steered by a name in it
    text = INVISIBLE.sub(_escape_one, text)
    # a list of numbers on one line: thousands of lines with one number each help nobody
    return re.sub(r"\[[^\[\]{}\"]*\]", _join_numbers, text) + "\n"


def read_json(path: Path) -> Any:
    """Return what a JSON file holds, whose numbers are finite.

    Args:
        path: the file.

    Raises:
        ValueError: it is no JSON; the message is the end of a sentence.
        InputError: it is no file that can be read whole.
        OSError: it cannot be read.
    """
    try:
        return json.loads(
            read_content(path).decode("utf-8"),
            parse_int=_read_int,
            parse_float=_read_float,
            parse_constant=_read_float,
            object_pairs_hook=_read_object,
        )
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno}: {error.msg}") from error
    except UnicodeDecodeError as error:
        raise ValueError("it is not UTF-8 text") from error
    except RecursionError as error:
        raise ValueError("its lists nest too deeply") from error


def _read_int(text: str) -> int:
    if len(text.lstrip("-")) > _MOST_DIGITS:
        raise ValueError(f"it holds a whole number of {len(text.lstrip('-'))} digits")
    return int(text)


def _read_float(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"it holds {text[:20]}, and JSON has no number without an end")
    if abs(value) > LARGEST:
        raise ValueError(f"it holds {text[:20]}, and no result has a number beyond {LARGEST:g}")
    return value if abs(value) >= LEAST else 0.0


def _read_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, n in Counter(key for key, _ in pairs).items() if n > 1)
        raise ValueError(f"it holds {twice[:40]!r} twice in one object")
    return found


def _escape_one(found: re.Match[str]) -> str:
    """Return a character as JSON escapes it: beyond the first plane as two units."""
    units = found[0].encode("utf-16-be", "surrogatepass").hex(" ", 2).split()
    return found[0] if found[0] == "\n" else "".join(f"\\u{unit}" for unit in units)


def _join_numbers(found: re.Match[str]) -> str:
    return re.sub(r"\n\s*", "", re.sub(r",\n\s*", ", ", found[0]))
