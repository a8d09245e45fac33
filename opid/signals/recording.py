"""A recording: what was measured, in SI units, at a uniform rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, count_repeats, nearest
from opid.provenance import ReadFile

FloatArray = NDArray[np.float64]

LEAST_SIZE, LARGEST_SIZE = 1e-50, 1e50
"""Sizes between which SI values of all that can be measured lie, and whose sixth powers a computer still knows."""

LEAST_RATE_HZ, LARGEST_RATE_HZ = 1e-4, 1e10
"""Sampling rates of all recorders of motion: beyond them the time has another unit, as stamps in ns that count as s."""


@dataclass(frozen=True)
class Channel:
    """One measured quantity: its name and its SI unit (`m/s^2`, `m`, `N`, ...)."""

    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples (time, channel) at a uniform rate, read-only, with names, units and a history.

    Args:
        samples: (n_samples, n_channels) array in SI units; it is copied and made read-only.
        fs: sampling rate, Hz.
        channels: the channels, one for each column.
        start_s: time of the first sample, s.
        history: steps applied to the samples since they were read, in order.
        files: files that the samples were read from, and those that state what the samples mean (a study, for example).

    Raises:
        InputError: fewer than two samples, another number of columns than of channels, a value that is not finite or of
            a size that nothing has, a rate that is not positive or that of no recorder, or a repeated name.

    >>> import numpy as np
    >>> run = Recording(np.zeros((100, 1)), fs=50.0, channels=(Channel("upper_z", "m/s^2"),))
    >>> run.duration_s, run.names
    (2.0, ('upper_z',))
    """

    samples: FloatArray
    fs: float
    channels: tuple[Channel, ...]
    start_s: float = 0.0
    history: tuple[str, ...] = ()
    files: tuple[ReadFile, ...] = ()

    def __post_init__(self) -> None:
        samples = np.array(self.samples, dtype=np.float64, order="C")
        channels = tuple(self.channels)
        if samples.ndim != 2 or samples.shape[1] != len(channels) or not channels:
            raise InputError(
                f"samples have shape {samples.shape} for {len(channels)} channel(s): "
                "give an array (n_samples, n_channels) with one column for each channel"
            )
        if samples.shape[0] < 2:
            raise InputError(f"the recording has {samples.shape[0]} sample(s): at least two are needed")
        if not LEAST_RATE_HZ <= self.fs <= LARGEST_RATE_HZ:
            raise InputError(
                f"the sampling rate fs is {self.fs:g} Hz, and that of a recorder is {LEAST_RATE_HZ:g} to "
                f"{LARGEST_RATE_HZ:g} Hz: check the unit of the time"
            )
        names = [channel.name for channel in channels]
        require_distinct_names(names)
        bad = ~np.isfinite(samples)
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise InputError(
                f"channel {names[column]!r} has {int(bad[:, column].sum())} value(s) that are not finite, "
                f"the first at {self.start_s + row / self.fs:.4f} s: cut the run before it or mend the log"
            )
        for name, column in zip(names, samples.T, strict=True):
            if not has_usual_size(column):
                raise InputError(
                    f"channel {name!r} has values up to {np.abs(column).max():.3g}, which nothing measures: correct "
                    "its unit or mend the log"
                )
        samples.flags.writeable = False
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "fs", float(self.fs))
        object.__setattr__(self, "history", tuple(self.history))

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.samples.shape[0]

    @property
    def duration_s(self) -> float:
        """Number of samples over the rate, s."""
        return self.n_samples / self.fs

    @property
    def time_s(self) -> FloatArray:
        """Time of each sample, s."""
        return self.start_s + np.arange(self.n_samples) / self.fs

    @property
    def names(self) -> tuple[str, ...]:
        """Channel names in column order."""
        return tuple(channel.name for channel in self.channels)

    def index(self, name: str) -> int:
        """Column of the channel called `name`; raises InputError, which suggests the nearest name."""
        if name not in self.names:
            raise InputError(f"there is no channel {name!r} in this log: {nearest(name, self.names)}")
        return self.names.index(name)

    def channel(self, name: str) -> FloatArray:
        """Samples of the channel called `name`, (n_samples,), read-only."""
        return self.samples[:, self.index(name)]

    @property
    def rms(self) -> dict[str, float]:
        """Rms of each channel, SI."""
        return dict(zip(self.names, np.sqrt(np.mean(self.samples**2, axis=0)).tolist(), strict=True))

    def unit(self, name: str) -> str:
        """SI unit of the channel called `name`."""
        return self.channels[self.index(name)].unit

    def section(self, start_s: float | None = None, stop_s: float | None = None) -> Recording:
        """Return the samples with start_s <= time < stop_s (either may be left out).

        Raises:
            InputError: fewer than two samples are left.
        """
        first = -np.inf if start_s is None else start_s
        last = np.inf if stop_s is None else stop_s
        # half a sample of slack keeps times that are written with few digits from losing a sample
        slack = 0.5 / self.fs
        time_s = self.time_s
        keep = (time_s >= first - slack) & (time_s < last - slack)
        if keep.sum() < 2:
            raise InputError(
                f"the section {first:g} s to {last:g} s holds {int(keep.sum())} sample(s) of a log that runs "
                f"from {time_s[0]:g} s to {time_s[-1]:g} s: choose start and stop inside it"
            )
        begin = int(np.argmax(keep))
        return replace(
            self,
            samples=self.samples[keep],
            start_s=float(time_s[begin]),
            history=(*self.history, f"section {first:g} s to {last:g} s"),
        )


def has_usual_size(values: ArrayLike) -> bool:
    """Return whether numbers are finite, and the largest of them is zero or of a size that something real has.

    Args:
        values: the numbers, of any shape, in SI units.

    >>> has_usual_size([0.0, 1e-80, 2.0]), has_usual_size([0.0]), has_usual_size([1e300]), has_usual_size([np.nan])
    (True, True, False, False)
    """
    size = np.abs(np.asarray(values))
    largest = float(size.max(initial=0.0))
    return largest == 0.0 or LEAST_SIZE <= largest <= LARGEST_SIZE


def require_distinct_names(names: Sequence[str]) -> None:
    """Raise an error if two channels have one name."""
    for name, n in count_repeats(names).items():
        raise InputError(f"the channel name {name!r} stands {n} times: rename one")


def recording_from_arrays(
    arrays: Sequence[ArrayLike],
    names: Sequence[str],
    *,
    fs: float,
    unit: str | Sequence[str] = "m/s^2",
    start_s: float = 0.0,
) -> Recording:
    """Return the recording whose channels are the given one-dimensional arrays.

    Args:
        arrays: one (n_samples,) array for each channel, all of one length.
        names: names of the channels.
        fs: sampling rate, Hz.
        unit: SI unit of all channels, or one unit for each.
        start_s: time of the first sample, s.

    Raises:
        InputError: arrays of different lengths, another number of names or units than of arrays, a unit that is no
            text, or an error of `Recording`.

    >>> recording_from_arrays([[0, 1, 2], [3, 4, 5]], ["lower_z", "upper_z"], fs=10.0).samples.shape
    (3, 2)
    >>> recording_from_arrays([[0, 1], [3, 4]], ["tip", "force"], fs=10.0, unit=["m/s^2", "N"]).unit("force")
    'N'
    """
    columns = [np.asarray(array, dtype=np.float64) for array in arrays]
    lengths = sorted({column.shape for column in columns})
    if len(lengths) != 1 or len(lengths[0]) != 1:
        raise InputError(f"the arrays have shapes {lengths}: give one-dimensional arrays of one length")
    units = [unit] * len(columns) if isinstance(unit, str) else list(unit)
    for word, given in (("names", names), ("units", units)):
        if len(given) != len(columns):
            raise InputError(f"there are {len(columns)} arrays and {len(given)} {word}: give one for each array")
    for each in units:
        if not isinstance(each, str):
            raise InputError(f"unit holds {each!r}: give one text, like 'm/s^2', or one for each array")
    channels = tuple(Channel(name, each) for name, each in zip(names, units, strict=True))
    return Recording(np.stack(columns, axis=1), fs=fs, channels=channels, start_s=start_s)
