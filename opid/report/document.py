"""What a report says, in reading order: the text for a terminal and the page are both laid out from it.

A document has no JSON of its own: result.json is what the result's own `to_dict` gives, numbers instead of words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of running text.

    Args:
        text: one or more sentences.
    """

    text: str


@dataclass(frozen=True)
class Remarks:
    """Sentences behind one word that says what they are about: "Sensors: ...".

    Args:
        label: that word; "" for none.
        sentences: each a paragraph; without any, nothing is shown.
        is_warning: whether the page sets them apart in a box.
    """

    label: str
    sentences: tuple[str, ...]
    is_warning: bool = False


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Args:
        header: what stands in it.
        unit: of its numbers where all have the same; shown behind the header.
        align: how its cells stand below one another.
        is_elastic: whether its cells may be cut in a terminal, and broken into lines on a page, to save width.
        is_optional: whether a terminal may leave it out to save width.
    """

    header: str
    unit: str = ""
    align: Literal["left", "right"] = "right"
    is_elastic: bool = False
    is_optional: bool = False

    @property
    def head(self) -> str:
        """Header and unit."""
        return f"{self.header} [{self.unit}]" if self.unit else self.header


@dataclass(frozen=True)
class Table:
    """A table of cells that are rounded already.

    Args:
        columns: in their order.
        rows: of as many cells each; a row of one cell is a heading over the rows below it.
        title: above the table.
        note: below it.
        legend: below it on the page only: what its words mean.
        most_in_text: rows that a terminal shows, or None for all.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""
    note: str = ""
    legend: str = ""
    most_in_text: int | None = None


@dataclass(frozen=True)
class Figure:
    """One figure of the page.

    Args:
        name: of its PNG file, without the ending.
        heading: what it is about.
        text: what to see in it.
        draw: makes it, and returns its Axes.
    """

    name: str
    heading: str
    text: str
    draw: Callable[[], Any]


Block = Paragraph | Remarks | Table | Figure


def _nothing() -> Iterable[Block]:
    return ()


@dataclass(frozen=True)
class Document:
    """The report of one result.

    Args:
        title: headline.
        about: in a few words what was done or looked at; beside the title.
        answer: the most important in one sentence.
        not_determined: why there is no answer, which is shown instead of one. Empty or None if there is one.
        blocks: what text and page tell, in their order.
        details: makes what the page alone has room for: its figures, and tables that few readers need.
        command: words of the command line that gives the result again; None where no command does.
        python: lines of Python that give it again; empty where a command is enough.
        source: what the command reads: "log", "logs", "record", "study" or "results".
        reference: a sentence that names the paper.
        data_file: name of the file beside the page that has all numbers.
    """

    title: str
    about: str
    answer: str
    not_determined: str | None = None
    blocks: tuple[Block, ...] = ()
    details: Callable[[], Iterable[Block]] = _nothing
    command: Sequence[str] | None = None
    python: str = ""
    source: str = "logs"
    reference: str = ""
    data_file: str = "result.json"

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The figures of the page."""
        return tuple(block for block in self.details() if isinstance(block, Figure))


def columns(
    *headers: str, left: Sequence[int] = (0,), elastic: Sequence[int] = (), optional: Sequence[int] = ()
) -> tuple[Column, ...]:
    """Return the columns of a table.

    Args:
        headers: one for each.
        left: indices of those whose cells stand to the left.
        elastic: indices of those that may be cut or broken.
        optional: indices of those that a terminal may leave out.

    >>> [column.align for column in columns("run", "mass")]
    ['left', 'right']
    """
    return tuple(
        Column(header, "", "left" if index in left else "right", index in elastic, index in optional)
        for index, header in enumerate(headers)
    )


def warnings(sentences: Iterable[str]) -> Remarks:
    """Return what is to be doubted, one sentence a warning.

    Args:
        sentences: none where nothing is.
    """
    return Remarks("Warning", tuple(sentences), is_warning=True)


def ended(text: str) -> str:
    """Return a clause with one full stop.

    Args:
        text: the clause.

    >>> ended("run 1: an offset"), ended("")
    ('run 1: an offset.', '')
    """
    text = text.rstrip(". ")
    return f"{text}." if text else ""


def sentence(text: str) -> str:
    """Return a clause as a sentence: with a capital letter and one full stop.

    Args:
        text: the clause.

    >>> sentence("the mass is known")
    'The mass is known.'
    """
    return text[:1].upper() + ended(text[1:])


def counted(number: int, word: str) -> str:
    """Return a number with its word in the singular or the plural.

    Args:
        number: of things.
        word: for one of them.

    >>> counted(1, "joint"), counted(2, "joint")
    ('1 joint', '2 joints')
    """
    return f"{number} {word}{'s' * (number != 1)}"
