"""The truth.json of a simulation: read and checked, whatever was simulated."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from opid.errors import InputError


def read_truth_file(
    path: str | os.PathLike[str], *, schema: str, what: str, command: str, check: Callable[[dict[str, Any]], None]
) -> dict[str, Any]:
    """Read a truth.json.

    Args:
        path: the file.
        schema: that it must have.
        what: was simulated, for the message.
        command: that makes such a file, likewise.
        check: takes what the file holds, and makes numbers of what must be numbers; may raise anything.

    Raises:
        InputError: no such file, another schema, or a content that is not of that command's making.
    """
    try:
        truth = json.loads(Path(path).read_text(encoding="utf-8"))
        if truth["schema"] != schema:
            raise InputError(
                f"{path} has the schema {truth['schema']!r} where {schema!r} is needed: it is no truth of {what}; give "
                f"the truth.json that `{command}` wrote beside the study"
            )
        check(truth)
    except OSError as error:
        raise InputError(
            f"cannot read the truth {path}: {error.strerror or error}: give the truth.json that `{command}` wrote "
            "beside the study, or leave it out"
        ) from error
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        why = (
            f"it is no JSON (line {error.lineno}: {error.msg})"
            if isinstance(error, json.JSONDecodeError)
            else f"it has no {error.args[0]!r}"
            if isinstance(error, KeyError)
            else "a value in it is not what such a file holds"
        )
        raise InputError(
            f"{path} is no truth of {what}, {why}: give the truth.json that `{command}` wrote beside the study"
        ) from error
    return truth
