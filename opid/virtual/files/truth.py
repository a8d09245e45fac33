"""A simulated test on disk: the study with its logs, and its truth.json; written and read in one way for every kind."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from opid.errors import InputError
from opid.json_values import json_text, plain
from opid.signals.directory import made_directory
from opid.signals.files import written_whole
from opid.studies.study_file import write_study

if TYPE_CHECKING:
    from opid.studies.study_file import AnyStudy


@dataclass(frozen=True)
class TruthKind:
    """A kind of truth.json.

    Args:
        schema: that it has.
        what: was simulated, for messages.
        command: that makes such a file, likewise.
        check: takes what a file holds, and makes numbers of what must be numbers; may raise anything.
    """

    schema: str
    what: str
    command: str
    check: Callable[[dict[str, Any]], None]

    def content(self, settings: Mapping[str, Any] | None, **known: Any) -> dict[str, Any]:
        """Return the content of such a file, ready for JSON.

        Args:
            settings: what it was simulated with, kept as they are.
            known: what is true.
        """
        return plain({"schema": self.schema, **known, "settings": dict(settings or {})})


def write_field_test(study: AnyStudy, truth: Mapping[str, Any], directory: str | os.PathLike[str]) -> Path:
    """Write the logs or other files of a study, study.toml and truth.json, and return the path of the study.

    Args:
        study: what was measured.
        truth: what is true of it, of one of the kinds.
        directory: made if it is not there.

    Raises:
        InputError: a place that cannot be written to, or what `write_study` refuses.
    """
    target = made_directory(directory)
    write_study(study, target / "study.toml")
    with written_whole(target / "truth.json") as file:
        file.write(json_text(truth))
    return target / "study.toml"


def read_truth(path: str | os.PathLike[str], kind: TruthKind) -> dict[str, Any]:
    """Read a truth.json.

    Args:
        path: the file.
        kind: that it must be of.

    Raises:
        InputError: no such file, another schema, or a content that is not of that command's making.
    """
    remedy = f"give the truth.json that `{kind.command}` wrote beside the study"
    try:
        truth = json.loads(Path(path).read_text(encoding="utf-8"))
        if truth["schema"] != kind.schema:
            raise InputError(
                f"{path} has the schema {truth['schema']!r} where {kind.schema!r} is needed: it is no truth of "
                f"{kind.what}; {remedy}"
            )
        kind.check(truth)
    except OSError as error:
        raise InputError(
            f"cannot read the truth {path}: {error.strerror or error}: {remedy}, or leave it out"
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
        raise InputError(f"{path} is no truth of {kind.what}, {why}: {remedy}") from error
    return truth
