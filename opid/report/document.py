"""What a report says, in reading order. The text for a terminal and the page are both made from it.

A document has no JSON of its own: result.json holds what the `to_dict` of the result gives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of running text.

    Args:
        text: one or more sentences.
        heading: its title, or empty.
    """

    text: str
    heading: str = ""


@dataclass(frozen=True)
class Remarks:
    """Sentences with one label before each of them: "Clock: ...".

    Args:
        label: the label.
        sentences: each is a paragraph; if there are none, nothing is shown.
        is_warning: whether the page shows them in a box.
    """

    label: str
    sentences: tuple[str, ...]
    is_warning: bool = False


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Args:
        header: its name.
        unit: of all of its numbers; it is shown after the header.
        align: the side to which its cells are aligned.
        is_elastic: whether its cells may be broken into lines.
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


Row = tuple[str, ...]
"""The cells of a row of a table; a row of one cell is a heading over the rows below it."""


@dataclass(frozen=True)
class Table:
    """A table of cells that are already rounded.

    Args:
        columns: from left to right.
        rows: each has a cell for every column, or is a heading.
        title: above the table.
        note: below it.
        legend: explains its words; it is shown below it on the page only.
        most_in_text: number of rows that a terminal shows; None for all.
        is_filtered: whether the page has a field that shows only the rows with some words, and sorts by each column.
        links: the file that each row leads to, beside or above the page, or None; empty where no row leads anywhere.
        overlay: name of the figure in which a reader overlays curves by choosing rows; empty without one. The curves
            have the names in `keys`.
        keys: a name for each row.
        fold: title of the part of the page that a reader opens to see it; tables and figures that follow each other
            with the same title share that part. Empty where it is seen at once.
    """

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    title: str = ""
    note: str = ""
    legend: str = ""
    most_in_text: int | None = None
    is_filtered: bool = False
    links: tuple[Path | None, ...] = ()
    overlay: str = ""
    keys: tuple[str, ...] = ()
    fold: str = ""


@dataclass(frozen=True)
class Figure:
    """One figure of the page.

    Args:
        name: of its PNG file, without the ending.
        heading: its title.
        text: what can be seen in it.
        draw: draws it, and returns its Axes.
        is_chosen: whether its curves are shown only when they are chosen, in the table that names it as its overlay.
        fold: title of the part of the page that a reader opens to see it, as that of a table.
    """

    name: str
    heading: str
    text: str
    draw: Callable[[], Any]
    is_chosen: bool = False
    fold: str = ""


@dataclass(frozen=True)
class Sketch:
    """A drawing of the machine with its numbers; only the page shows it.

    Args:
        svg: the drawing, in the colour of the text around it.
        alt: the same in words.
    """

    svg: str
    alt: str


Block = Paragraph | Remarks | Table | Figure


@dataclass(frozen=True)
class Document:
    """The report of one result.

    Args:
        title: headline.
        about: what was done, in a few words beside the title.
        answer: the main result in one sentence.
        not_determined: why there is no answer, shown in its place. Empty or None if there is an answer.
        blocks: shown in the text and on the page.
        details: makes the blocks that only the page shows: figures, and tables that few readers need.
        command: words of the command line that gives the result again; None if there is no such command.
        python: lines of Python that give it again; empty if the command is enough.
        source: what the command reads: "log", "logs", "record", "study" or "results".
        reference: a sentence that names the paper.
        data_file: name of the file beside the page that holds all numbers.
        numbers: where all numbers stand, in a sentence; that they stand in `data_file` if empty.
        page_file: name of the page.
        sketch: stands on the page before all blocks; None without one.
    """

    title: str
    about: str
    answer: str
    not_determined: str | None = None
    blocks: tuple[Block, ...] = ()
    details: Callable[[], Iterable[Block]] = tuple
    command: Sequence[str] | None = None
    python: str = ""
    source: str = "logs"
    reference: str = ""
    data_file: str = "result.json"
    numbers: str = ""
    page_file: str = "report.html"
    sketch: Sketch | None = None

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The figures of the page."""
        return tuple(block for block in self.details() if isinstance(block, Figure))


def build_columns(
    *headers: str, left: Sequence[int] = (0,), elastic: Sequence[int] = (), optional: Sequence[int] = ()
) -> tuple[Column, ...]:
    """Return the columns of a table; `left`, `elastic` and `optional` are the indices of those that are so.

    >>> [column.align for column in build_columns("run", "mass")]
    ['left', 'right']
    """
    return tuple(
        Column(header, "", "left" if index in left else "right", index in elastic, index in optional)
        for index, header in enumerate(headers)
    )


def build_warnings(sentences: Iterable[str]) -> Remarks:
    """Return the warnings of a result, one for each sentence."""
    return Remarks("Warning", tuple(sentences), is_warning=True)


def end_sentence(text: str) -> str:
    """Return a clause that ends with one full stop.

    >>> end_sentence("run 1: an offset"), end_sentence("")
    ('run 1: an offset.', '')
    """
    text = text.rstrip(". ")
    return f"{text}." if text else ""


def write_sentence(text: str) -> str:
    """Return a clause as a sentence: with a capital letter and one full stop.

    >>> write_sentence("the mass is known")
    'The mass is known.'
    """
    return text[:1].upper() + end_sentence(text[1:])


def write_options(given: Mapping[str, object]) -> list[str]:
    """Return the words of the options of a command that have these values.

    >>> write_options({"start_s": 0.5})
    ['--start-s', '0.5']
    """
    return [word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", str(value))]


def format_count(number: int, word: str) -> str:
    """Return a number with its word in the singular or the plural.

    >>> format_count(1, "joint"), format_count(2, "joint")
    ('1 joint', '2 joints')
    """
    return f"{number} {word}{'s' * (number != 1)}"
