"""Logs made in memory, read in blocks of any size, for the tests of health and segments."""

from pathlib import Path

import numpy as np

from opid.signals.log import Block, Log, LoggedChannel, Track


def track_of(samples, *, fs=None, stamps=None, rows=100000, names=None, unit="m/s^2", name="", start_s=0.0):
    """Return a track that is read in blocks of so many rows."""
    samples = np.asarray(samples, dtype=np.float64)
    names = names or [f"c{i}" for i in range(samples.shape[1])]

    def blocks(columns, start, stop):
        end = len(samples) if stop is None else min(stop, len(samples))
        for first in range(start, end, rows):
            last = min(first + rows, end)
            own = samples[first:last][:, list(columns)]
            yield Block(own, None if stamps is None else np.asarray(stamps)[first:last])

    channels = tuple(LoggedChannel(each, unit) for each in names)
    return Track(channels, blocks, fs, start_s, len(samples), name)


def log_of(*tracks, **settings):
    """Return a log of tracks, or of what `track_of` takes."""
    if not isinstance(tracks[0], Track):
        tracks = (track_of(tracks[0], **settings),)
    return Log(Path("made.csv"), "made", tracks)


def noise(n, channels=1, seed=0):
    return np.random.default_rng(seed).standard_normal((n, channels))


def messages(health, severity=None):
    return [finding.message for finding in health.findings if severity in (None, finding.severity)]
