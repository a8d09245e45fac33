"""Parquet files: a table with a column for each channel, as pandas, polars or a database exports it.

The time is the column called `time` or `t` (or `time` of the table [log]), else the index that pandas stored, else the
one column of time stamps. Without one the rate is `fs`, `dt`, ... in the metadata of the file. Time stamps with a date
become seconds from the first. The unit of a column stands in its field's metadata (`unit`), in its name in brackets, or
in what pandas stored of `DataFrame.attrs["units"]`. A missing value is NaN. Columns of text are left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from opid.errors import FileError, count_repeats, nearest
from opid.signals.log import Block, Log, LoggedChannel, LogSettings, Track, rows_at_once, rows_from_start
from opid.signals.logs import reader
from opid.signals.recording import FloatArray
from opid.signals.units import (
    UNIT_KEYS,
    find_value,
    require_names,
    require_rate,
    seconds_per_unit,
    split_unit,
    stated_rate,
    time_name,
)

if TYPE_CHECKING:
    import pyarrow

_TICKS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_BUFFER_BYTES = 1 << 20  # of each column, so that a file of one row group is not held in memory as a whole


@dataclass(frozen=True)
class _Time:
    column: int  # its index in the file
    seconds: float  # in one unit of it
    first: int = 0  # subtracted, in its unit


@reader(".parquet", ".pq", name="Parquet", needs="pyarrow", extra="parquet", magic=(b"PAR1",))
def open_parquet(path: Path, settings: LogSettings) -> Log:
    """Open a Parquet log; only the wanted columns are read, batch by batch, so that it may be larger than memory."""
    with _open(path) as file:
        schema, n = file.schema_arrow, file.metadata.num_rows
        _require_distinct(path, schema.names)
        columns = [number for number, field in enumerate(schema) if _is_number(field.type)]
        metadata = _decode(schema.metadata or {})
        time = _find_time(path, file, columns, metadata, settings)
    stored = _read_frame_attributes(metadata).get("units")
    units = {str(key): str(value) for key, value in stored.items()} if isinstance(stored, dict) else {}
    names = [schema.names[number] for number in columns]
    if settings.names:
        require_names(path, settings.names, len(columns), "column(s) of numbers, the time among them")
        names = list(settings.names)
    channels, numbers = [], []
    for number, name in zip(columns, names, strict=True):
        if time is not None and number == time.column:
            continue
        plain, unit = split_unit(name)
        own = _decode(schema.field(number).metadata or {})
        channels.append(LoggedChannel(plain, find_value(own, UNIT_KEYS) or unit or units.get(schema.names[number])))
        numbers.append(number)
    fs = (settings.fs_hz or stated_rate(_find_numbers(metadata))) if time is None else None
    fs = None if fs is None else require_rate(fs, where=str(path))
    rows = rows_from_start(lambda columns: _read_blocks(path, [numbers[column] for column in columns], time))
    return Log(path, "Parquet", (Track(tuple(channels), rows, fs, 0.0, n),))


def _open(path: Path) -> Any:
    import pyarrow.parquet

    return pyarrow.parquet.ParquetFile(path, buffer_size=_BUFFER_BYTES, pre_buffer=False, memory_map=False)


def _require_distinct(path: Path, names: Sequence[str]) -> None:
    for name, n in count_repeats(names).items():
        raise FileError(f"{path} has {n} columns {name!r}: rename all but one")


# ---- columns -------------------------------------------------------------------------------------


def _is_number(kind: pyarrow.DataType) -> bool:
    from pyarrow import types

    plain = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)
    return plain or types.is_decimal(kind) or _find_tick(kind) is not None


def _find_tick(kind: pyarrow.DataType) -> float | None:
    """Return the length of one tick of a type of time, s; None for any other type."""
    from pyarrow import types

    if types.is_timestamp(kind) or types.is_duration(kind) or types.is_time(kind):
        return _TICKS_S[kind.unit]
    return None


def _find_time(
    path: Path, file: Any, columns: Sequence[int], metadata: Mapping[str, str], settings: LogSettings
) -> _Time | None:
    from pyarrow import types

    schema = file.schema_arrow
    number = _find_time_column(path, schema, columns, metadata, settings)
    if number is None:
        return None
    kind = schema.field(number).type
    ticks = _find_tick(kind)
    if ticks is not None:
        first = 0
        if types.is_timestamp(kind):
            batch = next(file.iter_batches(batch_size=1, columns=[schema.names[number]]), None)
            first = (batch.column(0)[0].value if batch is not None and batch.num_rows else 0) or 0
        return _Time(number, ticks, first)
    own = _decode(schema.field(number).metadata or {})
    unit = settings.time_unit or find_value(own, UNIT_KEYS) or split_unit(schema.names[number])[1]
    return _Time(number, 1.0 if settings.fs_hz else seconds_per_unit(unit, where=str(path)))


def _find_time_column(
    path: Path, schema: pyarrow.Schema, columns: Sequence[int], metadata: Mapping[str, str], settings: LogSettings
) -> int | None:
    names = list(settings.names) if len(settings.names) == len(columns) else [schema.names[each] for each in columns]
    if isinstance(settings.time, int):
        if not 1 <= settings.time <= len(columns):
            raise FileError(f"{path} has {len(columns)} column(s) of numbers, none is number {settings.time} (time)")
        return columns[settings.time - 1]
    if settings.time is not None:
        plain = [split_unit(name)[0] for name in names]
        for each in (names, plain):
            if settings.time in each:
                return columns[each.index(settings.time)]
        raise FileError(f"{path} has no column {settings.time!r} (time in [log]): {nearest(settings.time, names)}")
    known = time_name(names)
    if known is not None:
        return columns[names.index(known)]
    stored = _read_frame_entry(metadata, "index_columns")
    index = [name for name in (stored if isinstance(stored, list) else ()) if name in schema.names]
    if len(index) == 1 and schema.names.index(index[0]) in columns:
        return schema.names.index(index[0])
    stamps = [number for number in columns if _find_tick(schema.field(number).type) is not None]
    return stamps[0] if len(stamps) == 1 else None


def _decode(metadata: Mapping[bytes, bytes]) -> dict[str, str]:
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in metadata.items()}


def _find_numbers(metadata: Mapping[str, str]) -> dict[str, float]:
    found = {}
    for key, value in [*_read_frame_attributes(metadata).items(), *metadata.items()]:
        with suppress(TypeError, ValueError):
            found[key] = float(value)
    return found


def _read_frame_entry(metadata: Mapping[str, str], key: str) -> object:
    """Return what pandas stored of its frame under a key, None where there is nothing."""
    with suppress(ValueError, RecursionError):
        found = json.loads(metadata.get("pandas", "{}"))
        return found.get(key) if isinstance(found, dict) else None
    return None


def _read_frame_attributes(metadata: Mapping[str, str]) -> dict[str, Any]:
    attributes = _read_frame_entry(metadata, "attributes")
    return attributes if isinstance(attributes, dict) else {}


# ---- rows ----------------------------------------------------------------------------------------


def _read_blocks(path: Path, wanted: Sequence[int], time: _Time | None) -> Iterator[Block]:
    with _open(path) as file:
        names = file.schema_arrow.names
        read = [names[number] for number in dict.fromkeys([*wanted, *([time.column] if time else [])])]
        for batch in file.iter_batches(batch_size=rows_at_once(len(read)), columns=read):
            samples = np.empty((batch.num_rows, len(wanted)))
            for index, number in enumerate(wanted):
                samples[:, index] = _read_values(batch.column(names[number]))
            stamps = None
            if time is not None:
                stamps = _read_values(batch.column(names[time.column]), time.first) * time.seconds
            yield Block(samples, stamps)


def _read_values(column: pyarrow.Array, first: int = 0) -> FloatArray:
    """Return the numbers of a column minus `first`; NaN where one is missing."""
    import pyarrow
    from pyarrow import types

    kind = column.type
    if _find_tick(kind) is not None:
        column = column.cast(pyarrow.int64() if kind.bit_width == 64 else pyarrow.int32())
    if types.is_boolean(kind):
        column = column.cast(pyarrow.int8())
    missing = column.is_null().to_numpy(zero_copy_only=False) if column.null_count else None
    if first:
        # integers are subtracted: nanoseconds since 1970 have more digits than floats hold
        whole = column.fill_null(first) if missing is not None else column
        values = (whole.to_numpy(zero_copy_only=False) - first).astype(np.float64)
    else:
        values = column.cast(pyarrow.float64(), safe=False).to_numpy(zero_copy_only=False).astype(np.float64)
    if missing is not None:
        values[missing] = np.nan
    return values
