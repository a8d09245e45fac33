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
            raise InputError(f"{path} has the schema {truth['schema']!r} where {schema!r} is needed")
        check(truth)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}: check the name") from error
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        raise InputError(f"{path} is no truth of {what}: give the truth.json of `{command}`") from error
    return truth
