"""The kinds of study files, each known by its tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from opid.errors import InputError
from opid.studies.tables import Document, Key, maybe, misspelt


@dataclass(frozen=True, eq=False)
class StudyKind:
    """A kind of study file.

    Args:
        subject: what it is a study of.
        command: the command of `opid` that identifies from it.
        tables: those that may stand in it.
    """

    subject: str
    command: str
    tables: Mapping[str, Key]


_LOG = {"log": maybe(dict, "a table [log]")}

SUSPENSIONS = StudyKind(
    "suspensions",
    "identify",
    {
        **_LOG,
        "channels": Key(dict, "a table [channels]"),
        "interfaces": maybe(list, "one table [[interfaces]] for each suspension"),
        "body_sensors": maybe(list, "one table [[body_sensors]] for each further sensor on the body"),
        "structure": maybe(dict, "a table [structure]"),
        "sensors": maybe(dict, "tables [sensors.sprung], [sensors.unsprung], [[sensors.leak]]"),
        "runs": Key(list, "one table [[runs]] for each log"),
    },
)
MODAL_TESTS = StudyKind(
    "modal tests",
    "modal",
    {
        **_LOG,
        "modes": Key(dict, "a table [modes]"),
        "channels": maybe(dict, "a table [channels]"),
        "tests": Key(list, "one table [[tests]] for each log"),
    },
)
BACKBONES = StudyKind(
    "backbones",
    "update",
    {
        **_LOG,
        "structure": Key(dict, "a table [structure]"),
        "backbones": Key(list, "one table [[backbones]] for each file"),
        "classes": Key(list, "one table [[classes]] for each candidate law"),
        "sampling": maybe(dict, "a table [sampling]"),
        "noise": maybe(dict, "a table [noise]"),
    },
)
KINDS = (SUSPENSIONS, MODAL_TESTS, BACKBONES)

MOST_NAMED = 8
"""Keys of a file that is no study that are named."""


def kind_of(document: Document, source: Path) -> StudyKind:
    """Return the kind of study that a file is: the one of which it has the most tables that no other kind has.

    Args:
        document: what the file holds.
        source: the file.

    Raises:
        InputError: it has no table of a study, or as many of one kind as of another.

    >>> kind_of({"tests": [], "modes": {}}, Path("study.toml")).command
    'modal'
    """
    ranks = [_likeness(document, kind) for kind in KINDS]
    best = max(ranks)
    if best > (0, 0) and ranks.count(best) == 1:
        return KINDS[ranks.index(best)]
    named = [repr(name) for name in document][:MOST_NAMED] + ["..."] * (len(document) > MOST_NAMED)
    raise InputError(f"{source} is no study: it has {', '.join(named) or 'no keys'}; {'; '.join(_needed(document))}")


def _there(document: Document, kind: StudyKind) -> set[str]:
    """The tables of a kind that a file has; a slip in a name counts as the name unless another kind knows it."""
    known = {name for each in KINDS for name in each.tables}
    unknown = {name: value for name, value in document.items() if name not in known}
    return kind.tables.keys() & {*document, *misspelt(unknown, kind.tables)}


def _likeness(document: Document, kind: StudyKind) -> tuple[int, int]:
    """How many tables a file has that only this kind has, and how many that this kind needs."""
    there = _there(document, kind)
    others = {name for other in KINDS if other is not kind for name in other.tables}
    return len(there - others), sum(kind.tables[name].required for name in there)


def _needed(document: Document) -> Iterator[str]:
    for kind in KINDS:
        there = _there(document, kind)
        lacking = [(name, key) for name, key in kind.tables.items() if key.required and name not in there]
        words = [f"lacks {name!r}, give {key.what}" for name, key in lacking]
        yield f"as a study of {kind.subject} it {', and '.join(words) or 'lacks nothing'}"
