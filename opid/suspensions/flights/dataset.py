"""The dataset of a campaign: a row for each parameter of each flight, in Parquet files partitioned by tail number."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from opid.errors import FileError, InputError, require
from opid.estimate import Estimate
from opid.provenance import ReadFile, read_file
from opid.signals.files import make_directory, write_whole
from opid.signals.recording import FloatArray
from opid.suspensions.flights.campaign import DATASET, Outcome
from opid.suspensions.flights.result_file import Quantity

StringArray = NDArray[np.str_]

COVARIATES = "opid.covariates"
"""Key of the metadata of each file: the names of its columns of covariates, separated by line feeds."""

_NO_TAIL = "__HIVE_DEFAULT_PARTITION__"

RESERVED_TAILS = frozenset({_NO_TAIL})
"""Tail numbers that readers of partitioned datasets take for none."""
_WHOLE = Quantity("", "", "")


def columns() -> dict[str, str]:
    """Return the columns of the dataset beside tail and covariates, each with its type in Arrow."""
    texts = ("flight", "verdict", "reason", "structure", "method", "gear", "quantity", "kind", "unit")
    numbers = ("value", "std", "low", "high")
    traces = ("folder", "opid", "task_sha256")
    return {
        **dict.fromkeys(texts, "string"),
        "date": "date32[day]",
        "recommended": "bool",
        **dict.fromkeys(numbers, "double"),
        **dict.fromkeys(traces, "string"),
        "files_sha256": "list<string>",
    }


def require_dataset() -> None:
    """Refuse before long work what needs the library of Parquet files.

    Raises:
        InputError: it is not installed.
    """
    require("pyarrow", "a dataset of flights", "pyarrow", "campaign")


def write_part(directory: Path, outcomes: Sequence[Outcome], number: int, covariates: Sequence[str]) -> Path:
    """Write the rows of some flights of one tail as one file, whole or not at all, and return its path.

    Args:
        directory: of the dataset.
        outcomes: of one tail.
        number: of the part among those of this tail.
        covariates: the columns of covariates; a flight without one of them has no value there.

    Raises:
        InputError: the directory cannot be written to.
    """
    import pyarrow
    import pyarrow.parquet

    kinds = {name: _choose_type(pyarrow, kind) for name, kind in columns().items()} | dict.fromkeys(
        covariates, pyarrow.float64()
    )
    rows = [row for outcome in outcomes for row in _list_rows(outcome)]
    schema = pyarrow.schema(list(kinds.items()), metadata={COVARIATES: "\n".join(covariates)})
    table = pyarrow.Table.from_pylist(rows, schema=schema)
    path = make_directory(partition_of(directory, outcomes[0].tail)) / f"part-{number:05}.parquet"
    with write_whole(path, "wb") as file:
        pyarrow.parquet.write_table(table, file)
    return path


def partition_of(directory: Path, tail: str) -> Path:
    """Return the folder of the flights of one tail."""
    return directory / f"tail={quote(tail, safe='') if tail else _NO_TAIL}"


def _choose_type(pyarrow: Any, kind: str) -> Any:
    return pyarrow.list_(pyarrow.string()) if kind == "list<string>" else pyarrow.type_for_alias(kind)


def _list_rows(outcome: Outcome) -> Iterator[dict[str, Any]]:
    """Yield the rows of a flight: one for each value, or one without a value that gives the reason."""
    flight = outcome.flight
    values = {} if flight is None else {what: each for what, each in flight.values.items() if each.value is not None}
    for what, estimate in values.items() or [(_WHOLE, Estimate())]:
        low, high = estimate.interval95 or (None, None)
        yield {
            "flight": outcome.name,
            "date": outcome.date,
            "verdict": outcome.verdict.value,
            "reason": outcome.reason,
            "structure": "" if flight is None else flight.structure,
            "method": "" if flight is None else flight.method,
            "recommended": flight is not None and flight.recommended,
            "gear": what.gear,
            "quantity": what.name,
            "kind": what.kind,
            "unit": what.unit,
            "value": estimate.value,
            "std": estimate.std,
            "low": low,
            "high": high,
            "folder": outcome.folder,
            "opid": outcome.opid,
            "task_sha256": outcome.task_sha256,
            "files_sha256": [each.sha256 for each in outcome.files],
        } | dict(outcome.covariates)


# ---- dataset -> tables --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FleetTable:
    """The values of one quantity in a dataset; each array has an entry for each value.

    Args:
        quantity: what they are values of, with its unit.
        tail: tail number of each.
        flight: name of each flight.
        day: date of each, days since 1970; NaN where it has none.
        value: the values.
        std: their standard deviations.
        covariates: {name: array}, NaN where a flight has none.
        folder: of the results of each flight, beside the dataset.
    """

    quantity: Quantity
    tail: StringArray
    flight: StringArray
    day: FloatArray
    value: FloatArray
    std: FloatArray
    covariates: Mapping[str, FloatArray]
    folder: StringArray


@dataclass(frozen=True, eq=False)
class FleetDataset:
    """A dataset of flights.

    Args:
        path: of its folder.
        tables: one for each quantity of each gear.
        n_flights: flights, with those that have no values.
        without_values: {reason: number of flights}.
        files: its parts with the hash of their content.
    """

    path: Path
    tables: tuple[FleetTable, ...]
    n_flights: int
    without_values: Mapping[str, int]
    files: tuple[ReadFile, ...]


def is_dataset(path: Path) -> bool:
    """Whether a folder is a dataset of flights, or that of a campaign, which holds one.

    Args:
        path: of the folder; it need not exist.
    """
    return next(find_dataset(path).glob("tail=*/part-*.parquet"), None) is not None


def find_dataset(path: Path) -> Path:
    """Return the folder of the dataset: that of a campaign holds it under a name of its own."""
    return path / DATASET if os.path.isdir(path / DATASET) else path


def read_dataset(path: str | os.PathLike[str]) -> FleetDataset:
    """Read the dataset of a campaign.

    Args:
        path: its folder, or that of the campaign.

    Raises:
        InputError: it is no dataset of flights, a column is missing, a part is no Parquet file, or parts were written
            with different covariates.
    """
    require_dataset()
    import pyarrow
    import pyarrow.parquet

    folder = find_dataset(Path(path))
    parts = sorted(folder.glob("tail=*/part-*.parquet"))
    if not parts:
        raise FileError(f"there is no dataset of flights in {path}: give the folder that `opid campaign` wrote")
    found, names = [], None
    for part in parts:
        if not part.is_file():
            raise FileError(f"{part} is a directory, a pipe or a device: run `opid campaign` again")
        try:
            table = pyarrow.parquet.ParquetFile(part).read()
            named = (table.schema.metadata or {}).get(COVARIATES.encode(), b"").decode().splitlines()
        except (OSError, ValueError, pyarrow.ArrowException) as error:
            raise FileError(f"{part} is no sound Parquet file: run `opid campaign` again") from error
        lacking = columns().keys() - set(table.column_names)
        if lacking:
            raise FileError(f"{part} has no column {', '.join(sorted(lacking))}: give a dataset of `opid campaign`")
        if names is not None and named != names:
            raise InputError(f"{part} has other covariates than the parts before it: run `opid campaign` again")
        names = named
        tail = unquote(part.parent.name.removeprefix("tail="))
        found.append(table.append_column("tail", pyarrow.array(["" if tail == _NO_TAIL else tail] * table.num_rows)))
    try:
        return _split_by_quantity(folder, pyarrow.concat_tables(found), names or [], tuple(map(read_file, parts)))
    except (ValueError, TypeError, pyarrow.ArrowException) as error:
        raise FileError(f"a part of {folder} holds values of another kind: run `opid campaign` again") from error


def _require_sound(
    folder: Path, flight: StringArray, is_mass: NDArray[np.bool_], numbers: Mapping[str, FloatArray]
) -> None:
    """Refuse estimates that no identification gives, as `read_flight` does.

    Raises:
        InputError: a negative standard deviation, an interval that does not hold its value, or no positive mass.
    """
    value, std, low, high = (numbers[name] for name in ("value", "std", "low", "high"))
    for is_wrong, what in (
        (std < 0.0, "a negative standard deviation"),
        ((low > value) | (high < value), "an interval that does not hold its value"),
        (is_mass & (value <= 0.0), "a mass that is not positive"),
    ):
        if is_wrong.any():
            name = str(flight[int(np.argmax(is_wrong))])
            raise FileError(f"the flight {name!r} in {folder} has {what}: run `opid campaign` again")


def _split_by_quantity(
    folder: Path, table: Any, covariates: Sequence[str], files: tuple[ReadFile, ...]
) -> FleetDataset:
    texts = {
        name: np.array(table.column(name).to_pylist(), str)
        for name in ("tail", "flight", "gear", "quantity", "kind", "unit", "reason", "folder")
    }
    names = ("value", "std", "low", "high", *covariates)
    numbers = {name: table.column(name).to_numpy().astype(float) for name in names}
    _require_sound(folder, texts["flight"], texts["quantity"] == "mass", numbers)
    day = table.column("date").cast("int32").to_numpy().astype(float)
    has_value = table.column("recommended").to_numpy() & np.isfinite(numbers["value"])
    flights = np.char.add(np.char.add(texts["tail"], "\n"), texts["flight"])
    identified = set(flights[has_value])
    reasons = dict(zip(flights, texts["reason"], strict=True))
    lost = Counter(reason for flight, reason in reasons.items() if flight not in identified)
    is_judged = has_value & np.isfinite(numbers["std"])
    of_row = list(zip(*(texts[name] for name in ("gear", "quantity", "unit", "kind")), strict=True))
    tables = []
    for each in dict.fromkeys(of_row):
        rows = np.array([other == each for other in of_row]) & is_judged
        if rows.any():
            tables.append(
                FleetTable(
                    Quantity(*map(str, each)),
                    texts["tail"][rows],
                    texts["flight"][rows],
                    day[rows],
                    numbers["value"][rows],
                    numbers["std"][rows],
                    {name: numbers[name][rows] for name in covariates},
                    texts["folder"][rows],
                )
            )
    return FleetDataset(folder, tuple(tables), len(reasons), dict(lost), files)
