"""Channels of several clocks on one: frequencies above a lower rate are filtered out first, nothing is delayed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.errors import InputError
from opid.signals.recording import FloatArray, Recording

PASS, STOP = 0.4, 0.5
"""Frequencies over the lower rate: up to the first all is kept, from the second (the Nyquist frequency) on nothing."""

STOP_DB = 80.0
"""Attenuation of what would be aliased: to 1 part in 10^4, below the noise of any accelerometer."""

SPLINE_FRACTION = 0.12
"""A quintic spline is exact to 1 part in 10^4 up to this fraction of the rate; samples of more are made finer first."""

HALF_WIDTH = 48
"""Samples on either side from which a value in between is computed: exact up to 0.45 of the rate."""

_SAME = 1e-6  # rounding of positions in samples, and of ratios of rates


def resampled(
    recording: Recording, fs_hz: float, *, start_s: float | None = None, n_samples: int | None = None
) -> Recording:
    """Return a recording at another rate, without delay.

    Args:
        recording: a recording at any rate.
        fs_hz: the new rate, Hz. If it is below the old one, frequencies above 0.5 fs_hz are filtered out, and those up
            to 0.4 fs_hz are kept.
        start_s: time of the first new sample, s; by default the start of the recording.
        n_samples: number of new samples; by default as many as reach the end of the recording.

    Raises:
        InputError: a rate that is not positive, or times outside the recording.

    >>> from opid.signals.recording import recording_from_arrays
    >>> t = np.arange(4000) / 1000.0
    >>> slow = resampled(recording_from_arrays([np.sin(2 * np.pi * 20 * t)], ["a"], fs=1000.0), 128.0)
    >>> bool(np.abs(slow.channel("a") - np.sin(2 * np.pi * 20 * slow.time_s))[50:-50].max() < 1e-3)
    True
    """
    if not (np.isfinite(fs_hz) and fs_hz > 0):
        raise InputError(f"fs_hz is {fs_hz}: give a positive rate in Hz")
    begin = recording.start_s if start_s is None else float(start_s)
    offset = (begin - recording.start_s) * recording.fs
    last = recording.n_samples - 1
    n = n_samples or int(np.floor((last - offset) * fs_hz / recording.fs + _SAME)) + 1
    position = offset + np.arange(n) * (recording.fs / fs_hz)
    if n < 2 and start_s is None and n_samples is None:
        raise InputError(
            f"the recording lasts {recording.n_samples / recording.fs:.3g} s, less than two samples at {fs_hz:g} Hz: "
            "give a longer one, or check the unit of its time"
        )
    if n < 2 or position[0] < -_SAME or position[-1] > last + 2 * _SAME * n:
        raise InputError(
            f"{n} samples at {fs_hz:g} Hz from {begin:g} s on are wanted of a recording from {recording.start_s:g} s "
            f"to {recording.time_s[-1]:g} s: choose times inside it"
        )
    samples = recording.samples
    limit = 0.5
    if fs_hz < recording.fs * (1 - _SAME):
        samples, limit = _filter_low_pass(samples, fs_hz / recording.fs), STOP * fs_hz / recording.fs
    return Recording(
        _interpolate(samples, np.clip(position, 0, last), limit),
        fs=fs_hz,
        channels=recording.channels,
        start_s=begin,
        history=(*recording.history, f"resampled from {recording.fs:.9g} Hz to {fs_hz:.9g} Hz"),
        files=recording.files,
    )


def on_common_clock(
    recordings: Sequence[Recording], *, order: Sequence[str] | None = None, fs_hz: float | None = None
) -> Recording:
    """Return the channels of several recordings over their common time, on one clock.

    Args:
        recordings: recordings with different names of channels; their times count from one origin.
        order: names of the channels in the order of the result; by default the order of the recordings.
        fs_hz: the rate, Hz; by default the lowest rate of the recordings.

    Raises:
        InputError: no common time.
    """
    fs = fs_hz or min(each.fs for each in recordings)
    begin = max(each.start_s for each in recordings)
    end = min(float(each.time_s[-1]) for each in recordings)
    n = int(np.floor((end - begin) * fs + _SAME)) + 1
    if n < 2:
        spans = ", ".join(f"{each.start_s:g} to {each.time_s[-1]:g} s" for each in recordings)
        raise InputError(f"the channels share no time ({spans}): check the recorders' clocks")
    same = [_is_on_clock(each, fs, begin) for each in recordings]
    parts = [
        each.samples[round((begin - each.start_s) * fs) :][:n]
        if fits
        else resampled(each, fs, start_s=begin, n_samples=n).samples
        for each, fits in zip(recordings, same, strict=True)
    ]
    channels = [channel for each in recordings for channel in each.channels]
    names = [channel.name for channel in channels]
    columns = [names.index(name) for name in (order or names)]
    history = [line for each in recordings for line in each.history]
    history += [
        f"{', '.join(each.names)}: resampled from {each.fs:.9g} Hz to {fs:.9g} Hz, from {begin:.9g} s on"
        for each, fits in zip(recordings, same, strict=True)
        if not fits
    ]
    return Recording(
        np.concatenate(parts, axis=1)[:, columns],
        fs=fs,
        channels=tuple(channels[column] for column in columns),
        start_s=begin,
        history=tuple(dict.fromkeys(history)),
        files=tuple(dict.fromkeys(file for each in recordings for file in each.files)),
    )


def interpolate_at(samples: FloatArray, positions: FloatArray, n_new: int, *, rounds: int) -> FloatArray:
    """Return samples at whole positions of signals that were sampled at others.

    A spline through the samples is corrected by what its band-limited interpolation leaves at their positions, which
    also makes it right between a quarter and 0.4 of the rate, where a spline alone is not.

    Args:
        samples: (n, n_channels) samples.
        positions: (n,) increasing positions of the samples, in new steps.
        n_new: number of new samples, at the positions 0, 1, ...
        rounds: number of corrections.
    """
    from scipy import interpolate

    whole = np.arange(n_new, dtype=np.float64)

    def carry(values: FloatArray) -> FloatArray:
        return np.asarray(interpolate.make_interp_spline(positions, values, k=3)(whole))

    within = np.clip(positions, 0, n_new - 1)
    found = carry(samples)
    for _ in range(rounds):
        found = found + carry(samples - _interpolate(found, within, STOP))
    return found


def design_low_pass(pass_hz: float, stop_hz: float, *, fs: float, stop_db: float) -> FloatArray:
    """Design a filter without delay: a sinc in a Kaiser window, whose coefficients have the sum 1.

    `scipy.signal.firwin` gives the same. It is not used because every identification needs this filter, and loading
    `scipy.signal` takes longer than filtering.

    Args:
        pass_hz: up to this frequency all is kept, Hz.
        stop_hz: from this frequency on nothing is left, Hz.
        fs: sampling rate, Hz.
        stop_db: attenuation above `stop_hz`, dB; at least 50, where Kaiser's formulas for the window and its length
            hold (J. F. Kaiser, Nonrecursive digital filter design using the I0-sinh window function, 1974).

    Returns:
        (n_taps,) coefficients; their number is odd.

    >>> taps = design_low_pass(40.0, 60.0, fs=500.0, stop_db=80.0)
    >>> gain = np.abs(np.fft.rfft(taps, 5000))
    >>> bool(np.abs(gain[:400] - 1).max() < 2e-4), bool(gain[600:].max() < 2e-4)
    (True, True)
    """
    n_taps = int(np.ceil((stop_db - 7.95) / (2.285 * 2 * np.pi * (stop_hz - pass_hz) / fs) + 1)) | 1
    offset = np.arange(n_taps) - n_taps // 2
    taps = np.sinc((pass_hz + stop_hz) / fs * offset) * np.kaiser(n_taps, 0.1102 * (stop_db - 8.7))
    return np.asarray(taps / taps.sum())


def _is_on_clock(recording: Recording, fs: float, begin: float) -> bool:
    position = (begin - recording.start_s) * recording.fs
    drift = abs(recording.fs / fs - 1) * recording.n_samples
    return abs(position - round(position)) + drift < 1e-3


def _filter_low_pass(samples: FloatArray, ratio: float) -> FloatArray:
    """Return the samples without frequencies above half of the lower rate, `ratio` of the old one; without delay."""
    from scipy import signal

    taps = design_low_pass(PASS * ratio, STOP * ratio, fs=1.0, stop_db=STOP_DB)
    half = min(taps.size // 2, samples.shape[0] - 1)
    filtered = signal.oaconvolve(_extend(samples, half), taps[:, np.newaxis], mode="same", axes=0)
    return filtered[half : half + samples.shape[0]]


def _extend(samples: FloatArray, n: int) -> FloatArray:
    """Return the samples, continued at both ends by n samples of their mirror image through the end samples."""
    before = 2 * samples[:1] - samples[n:0:-1]
    after = 2 * samples[-1:] - samples[-2 : -n - 2 : -1]
    return np.concatenate([before, samples, after])


def _interpolate(samples: FloatArray, position: FloatArray, limit: float) -> FloatArray:
    """Return the values at positions between samples of signals without frequencies above `limit` times their rate."""
    from scipy import interpolate, signal

    nearest = np.round(position)
    if np.abs(position - nearest).max() < _SAME * max(1.0, position.size / 1e3):
        return samples[nearest.astype(np.int64)]
    finer = int(np.ceil(limit / SPLINE_FRACTION))
    if finer > 1:
        edge = min(HALF_WIDTH, samples.shape[0] - 1)
        taps = signal.firwin(2 * HALF_WIDTH * finer + 1, 1 / finer, window=("kaiser", signal.kaiser_beta(STOP_DB)))
        samples = signal.resample_poly(_extend(samples, edge), finer, 1, axis=0, window=taps)
        position = (position + edge) * finer
    return interpolate.make_interp_spline(np.arange(samples.shape[0]), samples, k=5)(position)
