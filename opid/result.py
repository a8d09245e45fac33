"""What every result can do: a short summary on the screen, a table in a notebook, rows, a dict and a frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from opid.errors import FileError, InputError, require, shorten_middle
from opid.estimate import Estimate, rounded, with_std
from opid.json_values import read_json
from opid.provenance import ReadFile

if TYPE_CHECKING:
    import pandas

RESULT_FILE = "result.json"

_WIDTH = 100  # letters of a line in the short summary

MOST_ROWS = 7
"""Numbers in the short summary; `Result.summary` has all of them."""


@dataclass(frozen=True)
class SummaryRow:
    """One number of a result.

    Args:
        name: of the number; a dot stands before the name of a part: "law.cubic_stiffness.stiffness_n_per_m3".
        value: None where the data do not determine it.
        std: standard deviation, or None.
        interval95: lower and upper end of the 95 % interval, or None.
        unit: of the value, "1" without one.
    """

    name: str
    value: float | None
    std: float | None
    interval95: tuple[float, float] | None
    unit: str

    @property
    def estimate(self) -> Estimate:
        """The value with its standard deviation and interval."""
        return Estimate(self.value, self.std, self.interval95)

    @classmethod
    def of(cls, name: str, estimate: Estimate, unit: str) -> SummaryRow:
        """Return the row of an estimate."""
        return cls(name, estimate.value, estimate.std, estimate.interval95, unit)

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """Name, value, standard deviation, interval and unit, rounded as the standard deviation says."""
        ends = self.interval95
        between = "-" if ends is None else f"{rounded(ends[0], self.std)} .. {rounded(ends[1], self.std)}"
        return self.name, rounded(self.value, self.std), rounded(self.std, self.std), between, self.unit


class Result(ABC):
    """A result of opid: what it found as rows, as the content of result.json, and as a frame of pandas."""

    @abstractmethod
    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the numbers that were found, in SI units, the most important first."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return what result.json holds but `provenance`: plain values, null where there is no finite number."""

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files that it was made from, as they were when they were read; none of what was made in Python."""
        return ()

    @abstractmethod
    def _write_headline(self) -> str:
        """Return in one line what this is about."""

    def _list_remarks(self) -> Iterator[str]:
        """Yield what has to be said beside the numbers, a line each."""
        reason, warnings = getattr(self, "not_determined", None), getattr(self, "warnings", ())
        if reason:
            yield f"not determined: {reason}"
        if warnings:
            yield f"{len(warnings)} warning{'s' * (len(warnings) != 1)}, see opid.text(result)"

    def to_frame(self) -> pandas.DataFrame:
        """Return the summary as a frame with the columns value, std, low, high (of the 95 % interval) and unit.

        Raises:
            InputError: pandas is not installed.
        """
        require("pandas", "a frame", "pandas", "tables")
        import pandas

        rows = self.summary()
        nothing = (None, None)
        table = [(row.value, row.std, *(row.interval95 or nothing), row.unit) for row in rows]
        index = pandas.Index([row.name for row in rows], name="name")
        frame = pandas.DataFrame(table, index=index, columns=["value", "std", "low", "high", "unit"])
        return frame.astype(dict.fromkeys(("value", "std", "low", "high"), float))

    def __repr__(self) -> str:
        rows = self.summary()
        width = max((len(row.name) for row in rows[:MOST_ROWS]), default=0)
        lines = [_write_line(f"{type(self).__name__}: {self._write_headline()}")]
        for row in rows[:MOST_ROWS]:
            unit = "" if row.unit == "1" else f" {row.unit}"
            lines.append(f"  {row.name.ljust(width)}  {with_std(row.value, row.std)}{unit}")
        more = ["± is one standard deviation"] if any(row.std is not None for row in rows[:MOST_ROWS]) else []
        more += [f"{len(rows) - MOST_ROWS} more in summary()"] if len(rows) > MOST_ROWS else []
        remarks = "; ".join([*more, *map(_write_line, self._list_remarks())])
        return "\n".join([*lines, f"  {remarks}"] if remarks else lines)

    def _repr_html_(self) -> str:
        head = ("", "value", "standard deviation", "95 % interval", "unit")
        table = [_build_html_row("th", head), *(_build_html_row("td", row.cells) for row in self.summary())]
        remarks = "".join(f"<p>{escape(each)}</p>" for each in self._list_remarks())
        return f"<p><b>{escape(self._write_headline())}</b></p><table>{''.join(table)}</table>{remarks}"


def first_lines(lines: Sequence[str], name: str) -> list[str]:
    """Return the first lines of a summary, and how many more there are in the attribute `name`.

    >>> first_lines(["a"] * 9, "runs")[-1]
    '  2 more in runs'
    """
    more = len(lines) - MOST_ROWS
    return [*(f"  {line}" for line in lines[:MOST_ROWS]), *([f"  {more} more in {name}"] if more > 0 else [])]


def _build_html_row(tag: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _write_line(text: str) -> str:
    return shorten_middle(" ".join(text.split()), _WIDTH)


def load_document(path: Path, commands: Mapping[str, str]) -> dict[str, Any]:
    """Return the content of a result.json.

    Args:
        path: the file.
        commands: the command of opid that writes it, by the schema; several where any of them will do.

    Raises:
        InputError: it cannot be read, or is the result of no such command.
    """
    advice = f"give the {RESULT_FILE} of {' or '.join(f'`opid {each}`' for each in commands.values())}"
    try:
        document: dict[str, Any] = read_json(path)
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}: check the name") from error
    except InputError as error:
        raise FileError(f"cannot read {path}: {error}") from error
    except ValueError as error:
        raise FileError(f"{path} is no JSON ({error}): {advice}") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(schema, str) or schema not in commands:
        has = f"has the schema {_write_line(repr(schema))}" if schema is not None else "has no schema"
        raise FileError(f"{path} {has} where {' or '.join(map(repr, commands))} is needed: {advice}")
    return document
