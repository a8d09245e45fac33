"""The kinds of study files, each known by its tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from opid.errors import InputError
from opid.studies.schema import Document, misspelt


@dataclass(frozen=True)
class StudyKind:
    """A kind of study file.

    Args:
        subject: what it is a study of.
        command: the command of `opid` that identifies from it.
        needs: the tables that must stand in it, each in words.
        others: those that may.
    """

    subject: str
    command: str
    needs: Mapping[str, str]
    others: tuple[str, ...]

    @property
    def tables(self) -> tuple[str, ...]:
        """All that may stand in it."""
        return (*self.needs, *self.others)


SUSPENSIONS = StudyKind(
    "suspensions",
    "identify",
    {"channels": "a table [channels]", "runs": "one table [[runs]] for each log"},
    ("interfaces", "body_sensors", "structure", "sensors", "log"),
)
TEST_BENCH = StudyKind("a test bench", "law", {"bench": "a table [bench]"}, ("channels", "log"))
MODAL_TESTS = StudyKind(
    "modal tests",
    "modal",
    {"modes": "a table [modes]", "tests": "one table [[tests]] for each log"},
    ("channels", "log"),
)
BACKBONES = StudyKind(
    "backbones",
    "update",
    {
        "structure": "a table [structure]",
        "backbones": "one table [[backbones]] for each file",
        "classes": "one table [[classes]] for each candidate law",
    },
    ("sampling", "noise", "log"),
)
KINDS = (SUSPENSIONS, TEST_BENCH, MODAL_TESTS, BACKBONES)

MOST_NAMED = 8
"""Keys of a file that is no study that are named."""


def kind_of(document: Document, source: Path) -> StudyKind:
    """Return the kind of study that a file is: the one of which it has the most tables that no other kind has.

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
    raise InputError(
        f"{source} is no study: it has {', '.join(named) or 'no keys'}; {'; '.join(_say_what_lacks(document))}"
    )


def _there(document: Document, kind: StudyKind) -> set[str]:
    """The tables of a kind that a file has; a slip in a name counts as the name unless another kind knows it."""
    known = {name for each in KINDS for name in each.tables}
    unknown = {name: value for name, value in document.items() if name not in known}
    return {*kind.tables} & {*document, *misspelt(unknown, kind.tables)}


def _likeness(document: Document, kind: StudyKind) -> tuple[int, int]:
    """How many tables a file has that only this kind has, and how many that this kind needs."""
    there = _there(document, kind)
    of_others = {name for other in KINDS if other is not kind for name in other.tables}
    return len(there - of_others), len(there & {*kind.needs})


def _say_what_lacks(document: Document) -> Iterator[str]:
    for kind in KINDS:
        there = _there(document, kind)
        lacking = [f"lacks {name!r}, give {what}" for name, what in kind.needs.items() if name not in there]
        yield f"as a study of {kind.subject} it {', and '.join(lacking) or 'lacks nothing'}"
