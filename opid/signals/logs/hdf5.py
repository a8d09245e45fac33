"""HDF5 files: recordings as opid writes them, and the usual layouts of others.

opid's own layout: one group for each recording, with the attributes `opid_layout` = 1, `fs` (Hz), `start_s` (s),
`names`, `units` (SI) and `history`, and one dataset `samples` (n_samples, n_channels), float64.

Others: the datasets of a group with the same length are channels, and a dataset n x m is m channels. The rate is an
attribute `fs`, `sampling_rate`, `dt`, ... of the dataset, its group or a group above, or a scalar dataset of such a
name; or a dataset `time` holds the stamps. Units are attributes `unit` or `units`. Links to other files, data in other
files and virtual datasets are not followed: only the named file is opened.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from opid.errors import FileError
from opid.signals.files import write_whole
from opid.signals.log import Log, LogSettings
from opid.signals.logs import reader, writer
from opid.signals.logs.named_arrays import NamedArray, NamedGroup, tracks_of
from opid.signals.recording import Recording
from opid.signals.units import NAME_KEYS, UNIT_KEYS

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"

_LAYOUT = 1
_TEXT_KEYS = (*NAME_KEYS, *UNIT_KEYS, "history")
_HEADER_BYTES = 60_000  # an attribute of HDF5 holds 64 KiB


@reader(".h5", ".hdf5", ".hdf", name="HDF5", needs="h5py", extra="hdf5", magic=(SIGNATURE,))
def open_hdf5(path: Path, settings: LogSettings) -> Log:
    """Open an HDF5 log; its samples are read in slices, so that it may be larger than memory."""
    elsewhere: list[str] = []
    with open_file(path) as file:
        groups = list(_find_groups(path, file, {}, elsewhere))
    if not any(group.arrays for group in groups):
        links = f", only links to data elsewhere ({', '.join(elsewhere[:3])}), which are not followed"
        raise FileError(
            f"{path} holds no datasets of numbers{links if elsewhere else ''}: export the log again, in one file"
        )
    history = tuple(line for group in groups for line in group.texts.get("history", ()))
    return Log(path, "HDF5", tracks_of(path, groups, settings, lambda: open_file(path)), history=history)


@writer(".h5", ".hdf5", ".hdf")
def write_hdf5(recording: Recording, path: Path) -> None:
    """Write a recording as HDF5 in opid's own layout, to the last bit, with its history."""
    import h5py

    names, units = [list(recording.names), [channel.unit for channel in recording.channels]]
    held = io.BytesIO()
    try:
        with h5py.File(held, "w") as file:
            group = file.create_group("recording")
            group.attrs["opid_layout"] = _LAYOUT
            group.attrs["fs"] = recording.fs
            group.attrs["start_s"] = float(recording.start_s)
            for key, values in (("names", names), ("units", units), ("history", list(recording.history))):
                coded = [value.encode() for value in values]
                if any(b"\0" in each for each in coded):
                    raise ValueError(f"a NUL in {key}")
                # texts of fixed length store no lengths and addresses that could be wrong in a damaged file
                text = h5py.string_dtype(length=max(1, *map(len, coded), 1))
                if len(coded) * text.itemsize > _HEADER_BYTES:
                    group.create_dataset(key, data=np.array(coded, dtype=text))
                else:
                    group.attrs.create(key, np.array(coded, dtype=text))
            group.create_dataset("samples", data=recording.samples)
    except (ValueError, RuntimeError) as error:  # a NUL or half a character in a name
        raise FileError(f"cannot write {path}: HDF5 does not hold the names {names} and units {units}") from error
    with write_whole(path, "wb") as target:
        target.write(held.getbuffer())


def open_file(path: Path) -> AbstractContextManager[Any]:
    """Return an HDF5 file, open for reading until the block ends."""
    import h5py

    return h5py.File(path, "r")


def members(group: h5py.Group, elsewhere: list[str]) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Yield names and objects that a group holds itself, not by links; append those in other files to `elsewhere`."""
    import h5py

    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.HardLink):
            own = group[name]
            if isinstance(own, h5py.Dataset) and (own.is_virtual or own.external):
                elsewhere.append(own.name)
            elif isinstance(own, h5py.Group | h5py.Dataset):
                yield name, own
        elif isinstance(link, h5py.ExternalLink):
            elsewhere.append(f"{group.name.rstrip('/')}/{name}")


def texts_of(value: object) -> tuple[str, ...]:
    """Return the texts in a value of HDF5; none where it holds something else."""
    found = np.asarray(value).reshape(-1).tolist()
    texts = [each.decode("utf-8", "replace") if isinstance(each, bytes) else each for each in found]
    return tuple(texts) if all(isinstance(text, str) for text in texts) else ()


def _find_groups(
    path: Path, group: h5py.Group, above: Mapping[str, float], elsewhere: list[str], seen: set[Any] | None = None
) -> Iterator[NamedGroup]:
    """Return the group and the groups in it; `above` are the numbers that the groups above it state."""
    import h5py

    seen = set() if seen is None else seen
    own, texts = _read_attributes(group)
    if "opid_layout" in own:
        yield _read_recording(path, group, own, texts)
        return
    arrays, within = [], []
    for name, member in members(group, elsewhere):
        if hash(member.id) in seen:
            continue
        seen.add(hash(member.id))
        if isinstance(member, h5py.Group):
            within.append(member)
        elif member.dtype.kind in "fiub" and member.shape is not None:
            if member.shape == () or member.shape == (1,):
                own[name] = float(np.asarray(member[()]).reshape(-1)[0])
            elif len(member.shape) <= 2 and min(member.shape) > 0:
                arrays.append(NamedArray(name, member.shape, partial(_read, member.name), *_read_attributes(member)))
        elif name.casefold() in _TEXT_KEYS and _is_text(member):
            texts[name] = texts_of(member[()])
    stated = {**above, **own}
    yield NamedGroup(group.name.strip("/"), tuple(arrays), stated, texts)
    for each in within:
        yield from _find_groups(path, each, stated, elsewhere, seen)


def _read_attributes(member: h5py.Group | h5py.Dataset) -> tuple[dict[str, float], dict[str, tuple[str, ...]]]:
    """Return the attributes that are one number each, and those that are names, units or a history."""
    numbers, texts = {}, {}
    for name in member.attrs:
        header = member.attrs.get_id(name)
        if header.dtype.kind in "fiu" and np.prod(header.shape) == 1:
            numbers[name] = float(np.asarray(member.attrs[name]).reshape(-1)[0])
        elif name.casefold() in _TEXT_KEYS and header.dtype.kind in "OSU":
            texts[name] = texts_of(member.attrs[name])
    return numbers, texts


def _is_text(member: h5py.Group | h5py.Dataset) -> bool:
    import h5py

    return isinstance(member, h5py.Dataset) and h5py.check_string_dtype(member.dtype) is not None


def _read(name: str, file: Any, key: tuple[slice, ...]) -> np.ndarray:
    return file[name][key]


def _read_recording(
    path: Path, group: h5py.Group, numbers: dict[str, float], texts: dict[str, tuple[str, ...]]
) -> NamedGroup:
    layout = numbers["opid_layout"]
    if layout != _LAYOUT:
        raise FileError(f"{path} has layout {layout:g} of opid, known is {_LAYOUT}: read it with a newer opid")
    found = dict(members(group, []))
    stored = {key: texts_of(found[key][()]) for key in _TEXT_KEYS if key in found and _is_text(found[key])}
    texts = stored | texts
    samples: Any = found.get("samples")
    shape = getattr(samples, "shape", None)
    count = {len(texts.get(key, ())) for key in ("names", "units")}
    if shape is None or len(shape) != 2 or count != {shape[1]} or samples.dtype.kind not in "fiu":
        raise FileError(
            f"{path} {group.name} is no recording as opid writes it: `samples` has shape {shape}, with "
            f"{len(texts.get('names', ()))} name(s) and {len(texts.get('units', ()))} unit(s): export the log again"
        )
    if not {"fs", "start_s"} <= set(numbers):
        raise FileError(f"{path} {group.name} states no fs or no start_s: export the log again")
    own = {key: texts[key] for key in ("names", "units")}
    array = NamedArray("samples", shape, partial(_read, samples.name), texts=own, time_axis=0)
    history = {"history": texts.get("history", ())}
    return NamedGroup(group.name.strip("/"), (array,), numbers, history, alone=True)
