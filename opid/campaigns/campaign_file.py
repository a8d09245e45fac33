"""A campaign file, or a folder of studies -> the flights that are to be identified, each with its own study."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

from opid.errors import FileError, InputError, count_repeats, nearest, refuse, shorten_middle
from opid.json_values import LARGEST
from opid.signals.files import nearest_beside, read_table
from opid.studies.schema import Document, collect_faults, load, read_tables, require_plain
from opid.studies.study_file import SUSPENSIONS, kind_of
from opid.suspensions.settings import METHODS_OF_LAW

Cell = str | int | float | date

NAME, TAIL, DATE, STUDY = "flight", "tail", "date", "study"
"""Columns of the table of flights that have a meaning of their own."""

_MOST_FAULTS = 6

_OF_A_STUDY = "runs"
"""A table that every study of suspensions has, and no campaign."""

_PLACEHOLDER = re.compile(r"\{(\w+)\}")
_OF_STUDIES = {"run"}
"""Placeholders that a study file has anyway: the name of a run in the file of a channel."""


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions:
    """How each flight is identified: the arguments of `opid.identify` that a campaign may state.

    Args:
        law: the law to be fitted; searched for each flight if left out.
        band_hz: lines that are compared, Hz; the usual ones if left out.
        ground: whether springs to the ground may be added.
        method_of_law: how a law is searched.
    """

    law: str | None = None
    band_hz: tuple[float, float] | None = None
    ground: bool = True
    method_of_law: Literal[METHODS_OF_LAW] = METHODS_OF_LAW[0]  # type: ignore[valid-type]


@dataclass(frozen=True, kw_only=True)
class PlannedFlight:
    """A flight that is to be identified.

    Args:
        name: of the flight, unlike that of any other flight of its tail.
        tail: tail number of the aircraft; empty where none is stated.
        document: content of its study file, with nothing left to fill in.
        source: path of that study file, or of the template; logs are beside it.
        date: of the flight, or None.
        covariates: {name: value} of what may act on the suspensions, like a temperature.
    """

    name: str
    tail: str
    document: Document
    source: Path
    date: date | None = None
    covariates: Mapping[str, float] = field(default_factory=dict)

    @property
    def folder(self) -> str:
        """Path of its results, beside those of the other flights."""
        return f"{self.tail}/{self.name}" if self.tail else self.name


@dataclass(frozen=True)
class CampaignPlan:
    """What a campaign is to do.

    Args:
        title: of the campaign.
        flights: in the order of the table.
        options: how each is identified.
    """

    title: str
    flights: tuple[PlannedFlight, ...]
    options: IdentifyOptions = IdentifyOptions()


class _RowError(InputError):
    """What is wrong with a flight: the rest of a sentence that begins with it."""


@dataclass(frozen=True, kw_only=True)
class _CampaignTables:
    title: str | None = None
    study: str | None = None
    flights: Annotated[
        str | tuple[Mapping[str, str | int | float | date], ...],
        "the name of a CSV file with a row for each flight, or one table [[flights]] for each",
    ]
    identify: IdentifyOptions = IdentifyOptions()


def read_campaign(path: str | os.PathLike[str]) -> CampaignPlan:
    """Read what a campaign is to do; no log is read.

    A campaign file (TOML) has `flights`, the name of a CSV file with a row for each flight, or a table `[[flights]]`
    for each; `study`, a study file of suspensions that is the template for all of them; and optionally `title` and a
    table `[identify]` with the fields of `IdentifyOptions`. The table of flights has a column `flight` (a name), and
    optionally `tail` (number of the aircraft), `date`, `study` (a study file of this flight alone), and any others.
    `{column}` in a text of the template stands for the cell of the flight, so that `log = "{flight}/heavy.csv"` and
    `mass_change_kg = "{fuel_kg}"` make a study for each. Columns of numbers are covariates for `opid compare`.

    In a folder each study file of suspensions below it is a flight, named after its folder (after itself if it is not
    called study.toml). Of TAIL/FLIGHT/study.toml the first is the tail number.

    Args:
        path: a campaign file, or a folder.

    Raises:
        InputError: it is missing, no TOML and no folder, or has no flight; an unknown, missing or mistyped key; a row
            without a name or with that of another; a placeholder without a column: all at once.
    """
    source = Path(path)
    if os.path.isdir(source):
        return CampaignPlan(source.resolve().name, tuple(_find_studies(source)))
    if not os.path.exists(source):
        raise FileError(f"there is no campaign file or folder {source}{nearest_beside(source, ('.toml',))}")
    document = load(source)
    if _OF_A_STUDY in document:
        raise FileError(
            f"{source} is a study, which `opid identify` takes: name it as the template of a campaign, study = "
            f'"{source.name}", in a file that also has flights'
        )
    tables, faults = read_tables(_CampaignTables, document)
    refuse(faults, source)
    rows: Sequence[Mapping[str, Cell]] = ()
    with collect_faults(faults):
        named = tables.flights
        rows = read_rows(source.parent / named) if isinstance(named, str) else named
    refuse(faults, source)
    template = None if tables.study is None else source.parent / tables.study
    flights = _plan_flights(rows, template, source, faults)
    more = [f"and {len(faults) - _MOST_FAULTS} more"] if len(faults) > _MOST_FAULTS else []
    refuse([*faults[:_MOST_FAULTS], *more], source)
    return CampaignPlan(source.stem if tables.title is None else tables.title, flights, tables.identify)


def read_rows(path: Path) -> list[dict[str, Cell]]:
    """Read a table of flights: a CSV file with a head; its cells stay texts, and empty ones are left out.

    Args:
        path: the file; its columns stand apart by commas, or by semicolons (numbers may then have decimal commas).

    Raises:
        InputError: it cannot be read, has no row below its head, a head without a name or with one twice, a row with
            more cells than the head, or a quotation mark that is not closed.
    """
    try:
        table, delimiter = read_table(path)
    except OSError as error:
        # what is there and cannot be opened has no other name
        hint = nearest_beside(path, (".csv",)) if isinstance(error, FileNotFoundError) else ": check its permissions"
        raise FileError(f"cannot read the table of flights {path}: {error.strerror}{hint}") from error
    except InputError as error:
        raise FileError(f"cannot read the table of flights {path}: {error}") from error
    head, *rows = [row for row in table if any(row)] or [[]]
    faults = ["a column without a name in its head"] if "" in head else []
    faults += [f"the column {name!r} {n} times" for name, n in count_repeats(head).items() if name]
    faults += [
        f"{len(row)} cells in row {number} where the head has {len(head)} (put a number with a decimal comma in "
        "quotation marks)"
        for number, row in enumerate(rows, start=1)
        if len(row) > len(head)
    ]
    if not rows:
        faults.append("no row below its head")
    if faults:
        raise FileError(f"the table of flights {path} has {'; '.join(faults[:_MOST_FAULTS])}: mend it")
    mend = _with_decimal_point if delimiter == ";" else str
    return [{name: mend(cell) for name, cell in zip(head, row, strict=False) if cell} for row in rows]


def _with_decimal_point(text: str) -> str:
    """A number with a decimal comma as one with a point; any other text as it is."""
    return text.replace(",", ".") if re.fullmatch(r"[+-]?\d*,\d+", text) else text


def _find_number(cell: Cell) -> int | float | None:
    """The number of a cell, which is a text in a CSV file and has a type in TOML; None if it is none.

    Raises:
        _RowError: a number without an end.
    """
    if isinstance(cell, bool) or not isinstance(cell, str | int | float):
        return None
    number: int | float | None = cell if not isinstance(cell, str) else None
    for kind in (int, float) if number is None else ():
        with suppress(ValueError):
            number = kind(cell)
            break
    if number is not None and not abs(number) < LARGEST:
        raise _RowError(f"has the number {shorten_middle(str(cell), 40)}: give a finite one, below {LARGEST:g}")
    return number


def _find_date(cell: Cell) -> date | None:
    """The date of a cell; None if it is none."""
    if isinstance(cell, str) and re.fullmatch(r"\d{4}-\d\d-\d\d", cell):
        with suppress(ValueError):
            return date.fromisoformat(cell)
    return cell if type(cell) is date else None


# ---- rows -> flights ----------------------------------------------------------------------------------


def _plan_flights(
    rows: Sequence[Mapping[str, Cell]], template: Path | None, source: Path, faults: list[str]
) -> tuple[PlannedFlight, ...]:
    documents: dict[Path, Document] = {}
    broken: set[Path] = set()
    flights: dict[tuple[str, str], PlannedFlight] = {}  # by names without case, as some disks take them
    for number, row in enumerate(rows, start=1):
        name, tail = str(row.get(NAME, "")), str(row.get(TAIL, ""))
        where = f"flight {name!r}" if name else f"row {number} of the flights"
        own = row.get(STUDY)
        study = source.parent / str(own) if own is not None else template
        try:
            if not name:
                raise _RowError(f"has no {NAME!r}: give it a name ({nearest(NAME, row)})")
            require_plain(NAME, name)
            if tail:
                require_plain(TAIL, tail)
            key = tail.casefold(), name.casefold()
            if key in flights:
                raise _RowError("stands in the table twice: give each flight of an aircraft a name of its own")
            if study is None:
                raise _RowError("has no study: give a template, study = \"study.toml\", or a column 'study'")
            if study in broken:
                continue
            if study not in documents:
                broken.add(study)  # its faults are told once, and not for each flight
                documents[study] = _load_study(study)
                broken.remove(study)
            flights[key] = _plan_flight(name, tail, row, documents[study], study)
        except _RowError as error:
            faults.append(f"{where} {error}")
        except InputError as error:
            faults.append(f"{where}: {error}")
    return tuple(flights.values())


def _plan_flight(name: str, tail: str, row: Mapping[str, Cell], document: Document, source: Path) -> PlannedFlight:
    day = None if DATE not in row else _find_date(row[DATE])
    if DATE in row and day is None:
        raise _RowError(f"has the {DATE} {str(row[DATE])!r}: give one like 2026-03-01")
    filled = _fill_in(document, row)
    filled.setdefault("title", name)
    if day is not None:
        filled["date"] = day
    stated = filled.get("date")
    cells = {key: _find_number(cell) for key, cell in row.items() if key not in (NAME, TAIL, STUDY, DATE)}
    numbers = {key: float(cell) for key, cell in cells.items() if cell is not None}
    return PlannedFlight(
        name=name,
        tail=tail,
        document=filled,
        source=source,
        date=stated if type(stated) is date else None,
        covariates=numbers,
    )


def _fill_in(value: Any, row: Mapping[str, Cell]) -> Any:
    """Return a part of a study with the cells of a row in the place of its placeholders."""
    if isinstance(value, dict):
        return {key: _fill_in(each, row) for key, each in value.items()}
    if isinstance(value, list):
        return [_fill_in(each, row) for each in value]
    if not isinstance(value, str):
        return value
    for name in _PLACEHOLDER.findall(value):
        if name not in row and name not in _OF_STUDIES:
            raise _RowError(f"has no cell for {{{name}}} in the study ({nearest(name, row)})")
    whole = _PLACEHOLDER.fullmatch(value)
    if whole and whole[1] in row:
        cell = row[whole[1]]
        # A text that is a number or a date as a whole becomes one, as the study needs it.
        return next((each for each in (_find_date(cell), _find_number(cell)) if each is not None), cell)
    return _PLACEHOLDER.sub(lambda found: str(row.get(found[1], found[0])), value)


# ---- studies -> flights --------------------------------------------------------------------------------


def _load_study(path: Path) -> Document:
    document = load(path)
    kind = kind_of(document, path)
    if kind is not SUSPENSIONS:
        raise FileError(f"{path} is a study of {kind.subject}: give one of suspensions")
    return document


def _find_studies(folder: Path) -> Iterator[PlannedFlight]:
    """Yield a flight for each study of suspensions below a folder."""
    found = False
    for path in sorted(folder.rglob("*.toml")):
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue  # it is not complete
        try:
            document = load(path)
            if kind_of(document, path) is not SUSPENSIONS:
                continue
        except InputError:
            continue  # it is no study
        parts = path.relative_to(folder).with_suffix("").parts
        above = parts[:-1] if path.name == "study.toml" else parts
        name = above[-1] if above else folder.resolve().name
        stated = document.get("date")
        found = True
        yield PlannedFlight(
            name=name,
            tail="_".join(above[:-1]),
            document={"title": name} | document,
            source=path,
            date=stated if type(stated) is date else None,
        )
    if not found:
        raise FileError(
            f"there is no study of suspensions in the folder {folder} or below: give a folder with a study.toml for "
            "each flight, or a campaign file"
        )
