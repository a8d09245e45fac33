"""From the named arrays of a file (MATLAB, HDF5) to tracks: which one is the time, which the rate, which a channel."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import FileError, InputError, nearest
from opid.signals.log import LoggedChannel, LogSettings, Rows, Track, make_distinct, rows_in_steps
from opid.signals.units import (
    INTERVAL_NAMES,
    NAME_KEYS,
    RATE_NAMES,
    START_NAMES,
    UNIT_KEYS,
    find_value,
    require_names,
    require_rate,
    seconds_per_unit,
    split_unit,
    stated_rate,
    time_name,
    to_si,
)

CONSTANTS = 16
"""Arrays of fewer rows are constants (a range, a position) where there are longer arrays."""

MOST_CHANNELS = 10_000
"""No logger has more; a header that says so lies."""

DEEPEST = 8
"""Structs that are nested deeper than this are not read."""

_DATA, _HEADER = "_data", "_header"
_SIGNAL_KEYS = ("signalname", "signal_name", "channelname", "channel_name")
_PLAIN = ("data", "samples", "signal", "values", "value", "y")


@dataclass(frozen=True, eq=False)
class NamedArray:
    """Numbers of a file under one name, not yet read."""

    name: str  # as it is written
    shape: tuple[int, ...]  # (n,) or (n, m)
    # (opened file, one slice for each dimension) -> the numbers there
    read: Callable[[Any, tuple[slice, ...]], np.ndarray]
    numbers: Mapping[str, float] = field(default_factory=dict)  # stated with it, like its rate
    # stated with it, like its unit and the names of its columns
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    time_axis: int | None = None  # the dimension that is the time, where that is known


@dataclass(frozen=True, eq=False)
class NamedGroup:
    """Arrays that stand together: a MATLAB struct, an HDF5 group, or the file itself."""

    name: str  # empty for the file itself
    arrays: tuple[NamedArray, ...]  # in the order of the file
    numbers: Mapping[str, float] = field(default_factory=dict)  # stated for all of them: the rate, `start_s`
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # stated for all of them: names and units
    alone: bool = False  # whether it is a recording of its own that is never joined with others


@dataclass(frozen=True, eq=False)
class _Column:
    array: NamedArray
    axis: int  # along which the time runs in the array
    number: int
    name: str
    unit: str | None


@dataclass(frozen=True, eq=False)
class _Bundle:
    group: NamedGroup
    n: int
    time: _Column | None
    fs: float | None
    start_s: float
    columns: tuple[_Column, ...]


def groups_of_values(
    values: Mapping[str, Any], name: str, above: Mapping[str, float], depth: int = 0
) -> Iterator[NamedGroup]:
    """Yield the group of some variables or fields in memory, and the groups of the structs among them."""
    arrays, numbers, texts, within = [], {}, {}, {}
    for key, value in values.items():
        if isinstance(value, dict):
            within[key] = value
        elif (found := _to_texts(value)) is not None:
            texts[key] = found
        elif (isinstance(value, np.ndarray) and value.dtype == object) or isinstance(value, list):
            structs = [each for each in value if isinstance(each, dict)] if np.ndim(value) <= 1 else []
            within |= {f"{key}_{number}": each for number, each in enumerate(structs, start=1)}
        elif np.size(value) == 1 and np.asarray(value).dtype.kind in "fiub":
            numbers[key] = float(np.asarray(value).reshape(-1)[0])
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size and value.ndim <= 2:
            arrays.append(NamedArray(key, value.shape, partial(_read_from, value)))
    stated = {**above, **numbers}
    yield NamedGroup(name, tuple(arrays), stated, texts)
    for key, fields in within.items():
        if depth < DEEPEST:
            yield from groups_of_values(fields, f"{name}/{key}".strip("/"), stated, depth + 1)


def tracks_of(
    path: Path,
    groups: Sequence[NamedGroup],
    settings: LogSettings,
    open_file: Callable[[], AbstractContextManager[Any]],
) -> tuple[Track, ...]:
    """Return the tracks of a file's groups of arrays.

    In each group, the array called `time` or `t` (or `settings.time`) holds the stamps. Every other array of its length
    is a channel, a matrix is one channel for each column. Without stamps, arrays of one length and one stated rate make
    a track. The time runs along the dimension of a matrix that fits the stamps or the names, else along the longer one.
    """
    groups = _apply_headers(groups)
    bundles = [bundle for group in groups for bundle in _bundle_arrays(path, group, settings)]
    if settings.time is not None and not any(bundle.time for bundle in bundles):
        arrays = [array.name for group in groups for array in group.arrays]
        known = nearest(str(settings.time), arrays[:20]) if arrays else "it holds no array of numbers"
        raise FileError(f"{path} has no time {settings.time!r} (time in [log]) beside other numbers: {known}")
    bundles = _join_sensors(bundles)
    if settings.names:
        bundles = [_rename(path, bundles, settings.names)]
    stated = len({bundle.group.name for bundle in bundles}) == len(bundles)
    tracks = []
    for bundle in bundles:
        channels = tuple(LoggedChannel(column.name, column.unit) for column in bundle.columns)
        rate = "stamps" if bundle.time else f"{bundle.n} samples" if bundle.fs is None else f"{bundle.fs:g} Hz"
        name = bundle.group.name if stated else f"{bundle.group.name} {rate}".strip()
        unit = None if bundle.time is None or settings.fs_hz else settings.time_unit or bundle.time.unit
        rows = _make_rows(bundle, open_file, seconds_per_unit(unit, where=str(path)))
        fs = None if bundle.time else bundle.fs
        name = name if len(bundles) > 1 else ""
        tracks.append(Track(channels, rows, fs, bundle.start_s, bundle.n, name, locate=lambda row: f"sample {row + 1}"))
    return tuple(tracks)


def _apply_headers(groups: Sequence[NamedGroup]) -> Sequence[NamedGroup]:
    """Return the groups with the names of `Channel_1_Header` for `Channel_1_Data`, and with the rate of `File_Header`.

    Catman and other programs of recorders write MATLAB files in this way, with numbers as texts.
    """
    headers = {group.name.casefold(): group for group in groups if group.name.casefold().endswith(_HEADER)}
    if not headers:
        return groups
    result = []
    for group in groups:
        inside = group.name.casefold() + "/" * bool(group.name)
        arrays = []
        for array in group.arrays:
            stem = array.name.casefold().removesuffix(_DATA)
            header = headers.get(f"{inside}{stem}{_HEADER}") if array.name.casefold().endswith(_DATA) else None
            if header is not None:
                name = (
                    next(iter(_find_texts(header.texts, (*_SIGNAL_KEYS, *NAME_KEYS))), "") or array.name[: -len(_DATA)]
                )
                units = {key: text for key, text in header.texts.items() if key.casefold() in UNIT_KEYS}
                array = replace(array, name=name, texts={**units, **array.texts}, numbers=_read_numbers(header))
            arrays.append(array)
        if arrays != list(group.arrays):
            names = make_distinct(array.name for array in arrays)
            arrays = [replace(array, name=name) for array, name in zip(arrays, names, strict=True)]
        of_file = headers.get(f"{inside}file{_HEADER}")
        numbers = {**(_read_numbers(of_file) if of_file else {}), **group.numbers}
        result.append(replace(group, arrays=tuple(arrays), numbers=numbers))
    return result


def _read_numbers(header: NamedGroup) -> dict[str, float]:
    """Return the rate, interval and start of a header; they may stand there as texts."""
    numbers: dict[str, float] = {}
    for key, texts in header.texts.items():
        if len(texts) == 1:
            with suppress(ValueError):
                numbers[key] = float(texts[0].strip().replace(",", "."))
    wanted = (*RATE_NAMES, *INTERVAL_NAMES, *START_NAMES)
    return {key: number for key, number in {**numbers, **header.numbers}.items() if key.casefold() in wanted}


# ---- which arrays belong together ----------------------------------------------------------------


def _bundle_arrays(path: Path, group: NamedGroup, settings: LogSettings) -> Iterator[_Bundle]:
    time = _find_time(group, settings)
    arrays = [array for array in group.arrays if array is not time]
    if time is not None:
        n = max(time.shape)
        fitting = [(array, axis) for array in arrays if (axis := _find_time_axis(array, group, n)) is not None]
        if fitting:
            name, unit = split_unit(time.name)
            unit = next(iter(_split_units(_find_texts(time.texts, UNIT_KEYS))), None) or unit
            stamps = _Column(time, int(np.argmax(time.shape)), 0, name, unit)
            yield _Bundle(group, n, stamps, None, 0.0, _make_columns(path, group, fitting))
        return
    lengths = {array.name: max(array.shape) for array in arrays}
    least = CONSTANTS if max(lengths.values(), default=0) >= CONSTANTS else 2
    alike: dict[tuple[int, float | None], list[tuple[NamedArray, int]]] = {}
    for array in arrays:
        axis = _find_time_axis(array, group, None)
        if axis is None or array.shape[axis] < (1 if group.alone else least):
            continue
        fs = settings.fs_hz or stated_rate(array.numbers) or stated_rate(group.numbers)
        if fs is None and any(stated_rate(numbers) is not None for numbers in (array.numbers, group.numbers)):
            fs = 0.0
        where = f"{path}{f' ({group.name})' if group.name else ''}"
        fs = None if fs is None else require_rate(fs, where=where)
        alike.setdefault((array.shape[axis], fs), []).append((array, axis))
    start_s = float(find_value(group.numbers, START_NAMES) or 0.0)
    if not np.isfinite(start_s):
        raise FileError(f"{path} states that it begins at {start_s} s: export the log again")
    for (n, fs), fitting in alike.items():
        yield _Bundle(group, n, None, fs, start_s, _make_columns(path, group, fitting))


def _find_time(group: NamedGroup, settings: LogSettings) -> NamedArray | None:
    vectors = {array.name: array for array in group.arrays if len(array.shape) == 1 or 1 in array.shape}
    if isinstance(settings.time, int):
        numbered = group.arrays[settings.time - 1 : settings.time] if settings.time > 0 else ()
        return next((array for array in numbered if array.name in vectors), None)
    if settings.time is not None:
        return vectors.get(settings.time)
    found = time_name(list(vectors))
    return None if found is None or max(vectors[found].shape) < 2 or len(group.arrays) < 2 else vectors[found]


def _find_time_axis(array: NamedArray, group: NamedGroup, n: int | None) -> int | None:
    """Return the dimension along which the time runs, with n stamps where there are any; None where none fits."""
    if array.time_axis is not None:
        return array.time_axis
    if n is not None:
        return next((axis for axis, length in enumerate(array.shape) if length == n), None)
    if len(array.shape) == 2:
        count = len(_find_texts(array.texts, NAME_KEYS) or _find_texts(group.texts, NAME_KEYS))
        if count in array.shape and array.shape[0] != array.shape[1]:
            return 1 - array.shape.index(count)
    return int(np.argmax(array.shape))


def _make_columns(path: Path, group: NamedGroup, fitting: Sequence[tuple[NamedArray, int]]) -> tuple[_Column, ...]:
    counts = [array.shape[1 - axis] if len(array.shape) == 2 else 1 for array, axis in fitting]
    if sum(counts) > MOST_CHANNELS:
        raise FileError(
            f"{path} says that it holds {sum(counts)} channels, more than any logger has ({MOST_CHANNELS}): "
            "it is damaged, or a matrix lies on its side"
        )
    columns = []
    for (array, axis), count in zip(fitting, counts, strict=True):
        own_names, own_units = _find_texts(array.texts, NAME_KEYS), _find_units(array.texts)
        for number in range(count):
            name = array.name if count == 1 else f"{split_unit(array.name)[0]}_{number + 1}"
            name = own_names[number] if len(own_names) == count else name
            exact = len(own_names) == len(own_units) == count and array.time_axis is not None
            name, unit = (name, None) if exact else split_unit(name)
            if len(own_units) in (1, count):
                unit = own_units[number % len(own_units)] or unit
            columns.append(_Column(array, axis, number, name, unit or split_unit(array.name)[1]))
    # the names of the group are those of a matrix or of its one channel; the first may be that of the time
    names, units = _find_texts(group.texts, NAME_KEYS), _find_units(group.texts)
    names, units = (texts[1:] if len(texts) == len(columns) + 1 else texts for texts in (names, units))
    if len(names) == len(columns):
        split = [split_unit(name) for name in names]
        columns = [
            replace(column, name=name or column.name, unit=column.unit or unit)
            for column, (name, unit) in zip(columns, split, strict=True)
        ]
    if len(units) in (1, len(columns)):
        units = units * (len(columns) // len(units))
        columns = [
            replace(column, unit=column.unit or unit or None) for column, unit in zip(columns, units, strict=True)
        ]
    return tuple(columns)


def _find_texts(texts: Mapping[str, tuple[str, ...]], keys: Sequence[str]) -> tuple[str, ...]:
    return find_value(texts, keys) or ()


def _find_units(texts: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the units of channels; one text may list several, with that of the time first: "s, m/s^2"."""
    stated = _find_texts(texts, UNIT_KEYS)
    units = _split_units(stated)
    return units[1:] if len(units) > len(stated) and _is_time_unit(units[0]) else units


def _split_units(stated: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(each.strip() for each in stated[0].split(",")) if len(stated) == 1 and "," in stated[0] else stated


def _is_time_unit(unit: str) -> bool:
    try:
        return to_si(unit)[1] == "s"
    except InputError:
        return False


def _join_sensors(bundles: Sequence[_Bundle]) -> list[_Bundle]:
    """Return the bundles, with sensors that have a group each joined where rate, length and start are the same."""
    result: list[_Bundle] = []
    for bundle in bundles:
        if bundle.time or bundle.group.alone or len(bundle.columns) != 1 or not bundle.group.name:
            result.append(bundle)
            continue
        column = bundle.columns[0]
        written = column.array.name == column.name
        name = f"{bundle.group.name}/{column.name}" if written else column.name
        name = bundle.group.name if written and column.name.casefold() in _PLAIN else name
        own = replace(bundle, group=NamedGroup("sensors", ()), columns=(replace(column, name=name),))
        for i, other in enumerate(result):
            if not other.group.arrays and (other.n, other.fs, other.start_s) == (own.n, own.fs, own.start_s):
                result[i] = replace(other, columns=other.columns + own.columns)
                break
        else:
            result.append(own)
    return result


def _rename(path: Path, bundles: Sequence[_Bundle], names: Sequence[str]) -> _Bundle:
    if len(bundles) != 1:
        raise FileError(f"{path} has {len(bundles)} clocks: name its channels in [channels], not by names in [log]")
    bundle = bundles[0]
    order = [array.name for array in bundle.group.arrays]
    every = [*bundle.columns, *([bundle.time] if bundle.time else [])]
    every.sort(key=lambda column: order.index(column.array.name) if column.array.name in order else -1)
    require_names(path, names, len(every), "column(s), the time among them" if bundle.time else "column(s)")
    split = {id(column): split_unit(name) for column, name in zip(every, names, strict=True)}
    columns = [
        replace(column, name=split[id(column)][0], unit=split[id(column)][1] or column.unit)
        for column in bundle.columns
    ]
    return replace(bundle, columns=tuple(columns))


# ---- rows ----------------------------------------------------------------------------------------


def _make_rows(bundle: _Bundle, open_file: Callable[[], AbstractContextManager[Any]], seconds: float) -> Rows:
    def read(file: Any, wanted: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        columns = [bundle.columns[index] for index in wanted]
        held = {id(each.array): _read_stretch(file, each, first, last) for each in columns}
        stamps = None
        if bundle.time is not None:
            stamps = _read_stretch(file, bundle.time, first, last)[:, 0].astype(np.float64) * seconds
        return [held[id(each.array)][:, each.number] for each in columns], stamps

    # a matrix is read with all its columns, for in most files the numbers of a row are neighbours
    return rows_in_steps(bundle.n, read, open_file, width=len(bundle.columns))


def _read_stretch(file: object, column: _Column, first: int, last: int) -> np.ndarray:
    """Return all columns of an array from one row to another, (last - first, m)."""
    rows = slice(first, last)
    if len(column.array.shape) == 1:
        return column.array.read(file, (rows,))[:, np.newaxis]
    key = (rows, slice(None)) if column.axis == 0 else (slice(None), rows)
    block = column.array.read(file, key)
    return block if column.axis == 0 else block.T


# ---- values in memory ----------------------------------------------------------------------------


def _read_from(values: np.ndarray, _: object, key: tuple[slice, ...]) -> np.ndarray:
    return values[key]


def _to_texts(value: object) -> tuple[str, ...] | None:
    if isinstance(value, str):
        return (value.strip(),)
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind in "OU" and value.ndim == 1):
        every = ["" if np.size(each) == 0 else each for each in value]  # an empty text is an empty matrix
        if any(every) and all(isinstance(each, str) for each in every):
            return tuple(each.strip() for each in every)
    return None
