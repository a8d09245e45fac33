"""Recordings from and for other libraries: pandas DataFrames, xarray, and the dictionaries of SEP 5 (SDyPy).

SEP 5, "SDyPy Unified timeseries" (Weijtjens & Slavič 2023, draft): a list of dictionaries, one a channel, with `data`,
`name`, `unit_str` and either `fs` in Hz or `time`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, require
from opid.signals.clock import ClockError, resolution_of, uniform_clock
from opid.signals.recording import Channel, FloatArray, Recording, require_distinct_names
from opid.signals.resampling import on_common_clock
from opid.signals.units import require_rate, seconds_per_unit, split_unit, to_si

if TYPE_CHECKING:
    import pandas
    import xarray

Units = str | Mapping[str, str] | None
_Column = tuple[str, np.ndarray, str | None]  # name as written, numbers, unit

_SAME_RATE = 1e-5  # the rates of two runs of a study may differ by as much
_SEP5_NEEDED = ("data", "name", "unit_str")
_SEP5_PROHIBITED = ("unit", "timestamp", "signal", "sample_frequency")
_SEP5_OPTIONAL = ("fs", "time", "start_timestamp", "start_timestamp_format", "unit_tex")


# ---- pandas --------------------------------------------------------------------------------------


def recording_from_frame(frame: pandas.DataFrame, *, units: Units = None) -> Recording:
    """Return the recording of a DataFrame whose index is the time and whose columns are the channels.

    Args:
        frame: a DataFrame whose index is a time in seconds (or in the unit in its name: `time [ms]`), a DatetimeIndex,
            which counts from its first stamp, or a TimedeltaIndex. The unit of a column stands in `units`, in its name
            (`upper_z [m/s^2]`) or in `frame.attrs["units"]`; the first of these counts.
        units: the unit of all channels, or {name of the channel: unit}.

    Raises:
        InputError: an index that is no time or no uniform clock, or a column without a known unit or without numbers.

    >>> import pandas
    >>> frame = pandas.DataFrame({"upper_z [g]": [0.5, 1.0, 0.0]}, index=[0.0, 0.002, 0.004])
    >>> run = recording_from_frame(frame)
    >>> run.fs, run.channels, run.channel("upper_z")
    (500.0, (Channel(name='upper_z', unit='m/s^2'),), array([4.903325, 9.80665 , 0. ]))
    """
    import pandas

    index = frame.index
    if (isinstance(index, pandas.RangeIndex) and index.name is None) or isinstance(index, pandas.MultiIndex):
        raise InputError("the index of the DataFrame is no time: give it one, like `frame.set_index('time [s]')`")
    if isinstance(index, pandas.DatetimeIndex | pandas.TimedeltaIndex):
        since = index - index[:1][0] if isinstance(index, pandas.DatetimeIndex) and len(index) else index
        stamps = _to_seconds(since.to_numpy(), "s")
    else:
        stamps = _to_seconds(index.to_numpy(), split_unit(str(index.name or ""))[1] or "s")
    columns = []
    for name, values in frame.items():
        plain, bracketed = split_unit(str(name))
        if not pandas.api.types.is_numeric_dtype(values):
            raise _make_number_error(plain)
        own = bracketed or _find_unit(frame.attrs.get("units"), (str(name), plain))
        columns.append((str(name), values.to_numpy(dtype=float, na_value=np.nan), own))
    return _make_recording(_name_columns(columns, units), stamps, frame.attrs, "a DataFrame")


def frame_of(recording: Recording) -> pandas.DataFrame:
    """Return a recording as a DataFrame with the index `time [s]` and columns like `upper_z [m/s^2]`.

    Args:
        recording: the recording; its exact rate, its start and its history are stored in `attrs`.

    >>> from opid.signals.recording import recording_from_arrays
    >>> frame = frame_of(recording_from_arrays([[1.0, 2.0]], ["upper_z"], fs=10.0))
    >>> frame.columns.tolist(), frame.index.name, frame.index.tolist()
    (['upper_z [m/s^2]'], 'time [s]', [0.0, 0.1])
    """
    require("pandas", "a frame", "pandas", "tables")
    import pandas

    frame = pandas.DataFrame(
        recording.samples.copy(),
        index=pandas.Index(recording.time_s, name="time [s]"),
        columns=[f"{channel.name} [{channel.unit}]" for channel in recording.channels],
    )
    frame.attrs = _make_attributes(recording)
    return frame


# ---- xarray --------------------------------------------------------------------------------------


def recording_from_xarray(array: xarray.DataArray | xarray.Dataset, *, units: Units = None) -> Recording:
    """Return the recording of a DataArray (time, channel) or (time,), or of a Dataset of arrays (time,).

    Args:
        array: an array with a coordinate `time` in seconds (or in its `attrs["units"]`), in datetime64, which counts
            from its first stamp, or in timedelta64. The units of a DataArray stand in a coordinate `units` along
            `channel` or in `attrs["units"]`, and those of a Dataset in the attributes of each variable.
        units: the unit of all channels, or {name of the channel: unit}; it replaces the units of the array.

    Raises:
        InputError: dimensions other than these, no time, a time that is no uniform clock, or no known unit.
    """
    import xarray

    if "time" not in array.coords or array.coords["time"].dims != ("time",):
        raise InputError(
            f"the array has no time: give it a coordinate `time` along a dimension `time`, not {array.dims}"
        )
    time = array.coords["time"]
    stamps = _to_seconds(time.to_numpy(), str(time.attrs.get("units") or "s"))
    if isinstance(array, xarray.Dataset):
        columns = [
            (str(key), variable.to_numpy(), variable.attrs.get("units"))
            for key, variable in array.data_vars.items()
            if variable.dims == ("time",)
        ]
    else:
        columns = _list_columns(array)
    return _make_recording(_name_columns(columns, units), stamps, array.attrs, "an xarray")


def _list_columns(array: xarray.DataArray) -> list[_Column]:
    if set(array.dims) not in ({"time"}, {"time", "channel"}):
        raise InputError(f"the array has dimensions {array.dims}: give time and channel")
    whole = array if "channel" in array.dims else array.expand_dims(channel=[str(array.name or "channel_1")])
    whole = whole.transpose("time", "channel")
    keys = whole.coords["channel"].to_numpy() if "channel" in whole.coords else np.arange(1, whole.shape[1] + 1)
    keys = [str(key) if isinstance(key, str) else f"channel_{key}" for key in keys.tolist()]
    stored = next((np.ravel(whole.coords[key]).tolist() for key in ("units", "unit") if key in whole.coords), None)
    if stored is None:
        stored = [_find_unit(whole.attrs.get("units"), (key, split_unit(key)[0])) or "" for key in keys]
    return [(key, values, str(unit)) for key, values, unit in zip(keys, whole.to_numpy().T, stored, strict=False)]


def xarray_of(recording: Recording) -> xarray.DataArray:
    """Return a recording as a DataArray (time, channel) with its units as a coordinate along `channel`.

    Args:
        recording: the recording; its exact rate, its start and its history are stored in `attrs`.

    >>> from opid.signals.recording import recording_from_arrays
    >>> array = xarray_of(recording_from_arrays([[1.0, 2.0]], ["upper_z"], fs=10.0))
    >>> array.dims, array.sel(channel="upper_z").values, str(array.units.values[0])
    (('time', 'channel'), array([1., 2.]), 'm/s^2')
    """
    require("xarray", "a data array", "xarray", "tables")
    import xarray

    units = [channel.unit for channel in recording.channels]
    return xarray.DataArray(
        recording.samples.copy(),
        dims=("time", "channel"),
        coords={
            "time": ("time", recording.time_s, {"units": "s"}),
            "channel": list(recording.names),
            "units": ("channel", units),
        },
        attrs=_make_attributes(recording),
    )


# ---- SEP 5 ---------------------------------------------------------------------------------------


def recording_from_sep005(channels: Sequence[Mapping[str, Any]], *, units: Units = None) -> Recording:
    """Return the recording of a list of SEP 5 dictionaries; several rates are brought to the lowest.

    Args:
        channels: one dictionary for each channel, with `data` (n,), `name`, `unit_str` and `fs`, Hz, or `time` (n,), s;
            if both are given they must agree.
        units: the unit of all channels, or {name of the channel: unit}; it replaces the units of the dictionaries.

    Raises:
        InputError: a missing or misspelt key, channels that began at different times of day, a time that is no uniform
            clock or contradicts `fs`, or no known unit.

    >>> data = np.array([0.5, 1.0, 0.0])
    >>> run = recording_from_sep005([{"name": "upper_z", "unit_str": "g", "fs": 500, "data": data}])
    >>> run.fs, run.channels
    (500.0, (Channel(name='upper_z', unit='m/s^2'),))
    """
    if isinstance(channels, Mapping) or not len(channels):
        raise InputError("SEP 5 is a list of one or more dictionaries, one a channel: give such a list")
    for number, channel in enumerate(channels, start=1):
        _require_sep5(channel, number)
    names = [str(channel["name"]) for channel in channels]
    require_distinct_names(names)
    starts = {channel.get("start_timestamp") for channel in channels}
    if len(starts) > 1:
        raise InputError(f"the channels began at {len(starts)} different times of day: cut them to a common start")
    parts = []
    for name, channel in zip(names, channels, strict=True):
        column = {name: (_to_numbers(channel["data"], name), _find_unit(units, (name,)) or channel["unit_str"] or None)}
        stamps = None if channel.get("time") is None else _to_seconds(np.asarray(channel["time"]), "s")
        if channel.get("fs") is None:
            parts.append(_make_recording(column, stamps, {}, "SEP 5"))
            continue
        start_s = 0.0 if stamps is None else _require_same_clock(name, channel, column[name][0].size, stamps)
        attributes = {"fs": float(channel["fs"]), "start_s": float(channel.get("start_s", start_s))}
        parts.append(_make_recording(column, None, attributes, "SEP 5"))
    merged = on_common_clock(parts)
    began = next(iter(starts))
    return merged if began is None else replace(merged, history=(f"began {began}", *merged.history))


def _require_same_clock(name: str, channel: Mapping[str, Any], n: int, stamps: FloatArray) -> float:
    """Raise an error unless the n stamps have the stated rate; return the first one, s."""
    stated = require_rate(float(channel["fs"]), where=f"channel {name!r}")
    if stamps.shape != (n,):
        raise InputError(f"channel {name!r} has {n} samples, the time {stamps.size}: give as many")
    fs, start_s = _find_clock(stamps, {})
    # rounded stamps do not determine the rate better than this
    rounding_s = resolution_of(stamps) if np.ptp(np.diff(stamps)) * fs > 1e-6 else 0.0
    if abs(fs / stated - 1) > _SAME_RATE + rounding_s / (stamps[-1] - stamps[0]):
        raise InputError(
            f"channel {name!r} states fs {stated:.9g} Hz, its time is that of {fs:.9g} Hz: give the true one"
        )
    return start_s


def sep005_of(recording: Recording) -> list[dict[str, Any]]:
    """Return a recording as a list of SEP 5 dictionaries, one for each channel, each with `start_s` as well.

    Args:
        recording: the recording.

    >>> from opid.signals.recording import recording_from_arrays
    >>> [channel] = sep005_of(recording_from_arrays([[1.0, 2.0]], ["upper_z"], fs=10.0))
    >>> channel
    {'name': 'upper_z', 'unit_str': 'm/s^2', 'fs': 10.0, 'data': array([1., 2.]), 'start_s': 0.0}
    """
    return [
        {
            "name": channel.name,
            "unit_str": channel.unit,
            "fs": recording.fs,
            "data": samples.copy(),
            "start_s": float(recording.start_s),
        }
        for channel, samples in zip(recording.channels, recording.samples.T, strict=True)
    ]


def _require_sep5(channel: object, number: int) -> None:
    if not isinstance(channel, Mapping):
        raise InputError(f"channel {number} is no dictionary: SEP 5 is a list of dictionaries")
    for key in channel:
        plain = str(key).casefold().replace("_", "")
        right = [each for each in (*_SEP5_NEEDED, *_SEP5_OPTIONAL) if each.replace("_", "") == plain]
        if right and key not in right:
            raise InputError(f"channel {number} has the key {key!r}: SEP 5 writes {right[0]!r}")
        if key in _SEP5_PROHIBITED:
            raise InputError(f"channel {number} has the key {key!r}, which SEP 5 prohibits: write unit_str, data or fs")
    missing = [key for key in _SEP5_NEEDED if key not in channel]
    if missing:
        raise InputError(f"channel {number} has no key {missing[0]!r}: SEP 5 asks for {', '.join(_SEP5_NEEDED)}")
    if channel.get("fs") is None and channel.get("time") is None:
        raise InputError(f"channel {number} has neither `fs` nor `time`: SEP 5 asks for one of them")


# ---- used by all three -----------------------------------------------------------------------------


def _make_attributes(recording: Recording) -> dict[str, Any]:
    start_s = float(recording.start_s)
    return {"fs": recording.fs, "start_s": start_s, "history": list(recording.history)}


def _name_columns(columns: Sequence[_Column], units: Units) -> dict[str, tuple[FloatArray, str | None]]:
    """Return the numbers and the unit of each channel by its name, which may have its unit in brackets."""
    split = [split_unit(key) for key, *_ in columns]
    require_distinct_names([name for name, _ in split])
    return {
        name: (_to_numbers(values, name), _find_unit(units, (key, name)) or own or bracketed)
        for (name, bracketed), (key, values, own) in zip(split, columns, strict=True)
    }


def _find_unit(units: object, names: Sequence[str]) -> str | None:
    if units is None or isinstance(units, str):
        return units or None
    if isinstance(units, Mapping):
        return next((str(units[name]) for name in names if name in units), None)
    return None


def _make_number_error(name: str) -> InputError:
    return InputError(f"channel {name!r} does not hold numbers only: leave it out")


def _to_numbers(values: ArrayLike, name: str) -> FloatArray:
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise _make_number_error(name) from None
    if numbers.ndim != 1:
        raise InputError(f"channel {name!r} has shape {numbers.shape}: give one array (n_samples,) a channel")
    return numbers


def _to_seconds(stamps: np.ndarray, unit: str) -> FloatArray:
    """Return the stamps in seconds; dates count from the first one."""
    if stamps.dtype.kind == "M":
        stamps = stamps - stamps[:1]
    if stamps.dtype.kind == "m":
        return stamps / np.timedelta64(1, "s")
    if stamps.dtype.kind not in "fiu":
        raise InputError(f"the time is of type {stamps.dtype}: give seconds, or dates of the type datetime64")
    return stamps.astype(np.float64) * seconds_per_unit(unit, where="the time")


def _make_recording(
    columns: Mapping[str, tuple[FloatArray, str | None]],
    stamps: FloatArray | None,
    attributes: Mapping[Any, Any],
    source: str,
) -> Recording:
    """Return the recording of some columns; where `attributes` agree with the stamps, they state its clock exactly."""
    if not columns:
        raise InputError(f"{source} holds no channels: give one or more")
    converted, channels, words = [], [], []
    for name, (values, unit) in columns.items():
        if not unit:
            raise InputError(f"channel {name!r} states no unit: give `units`, or write it in brackets behind the name")
        try:
            factor, si = to_si(unit)
        except InputError as error:
            raise InputError(f"channel {name!r}: {error}") from None
        if stamps is not None and values.size != stamps.size:
            raise InputError(f"channel {name!r} has {values.size} samples, the time {stamps.size}: give as many")
        converted.append(values * factor)
        channels.append(Channel(name, si))
        words += [f"{name}: {unit} -> {si}, times {factor:.9g}"] * (factor != 1)
    fs, start_s = _find_clock(stamps, attributes)
    stored = attributes.get("history")
    history = tuple(map(str, stored)) if isinstance(stored, list | tuple) else (f"from {source}",)
    return Recording(np.stack(converted, axis=1), fs, tuple(channels), start_s, (*history, *words))


def _find_clock(stamps: FloatArray | None, attributes: Mapping[Any, Any]) -> tuple[float, float]:
    stated, start_s = attributes.get("fs"), attributes.get("start_s", 0.0)
    if stamps is None:
        return require_rate(float(attributes["fs"]), where="the channel"), float(start_s)
    if stamps.size < 2 or not np.isfinite(stamps).all():
        raise InputError(f"the time has {stamps.size} stamp(s), or some are missing: give two or more, all finite")
    try:
        clock = uniform_clock(stamps)
    except ClockError as error:
        raise InputError(f"sample {error.sample + 1}: {error}") from error
    # a slice or a decimation keeps the attributes of the whole
    if isinstance(stated, float | int) and stated > 0 and abs(clock.fs / stated - 1) < 1e-9:
        same = isinstance(start_s, float | int) and abs(clock.start_s - start_s) < 1e-6 / stated
        return float(stated), float(start_s) if same else clock.start_s
    return clock.fs, clock.start_s
