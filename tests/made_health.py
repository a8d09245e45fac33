"""Health of logs made by hand, for the tests of its picture and of its words."""

from itertools import pairwise

import numpy as np
from scipy import signal

from opid.signals.health.result import (
    ChannelHealth,
    ClockHealth,
    Finding,
    Health,
    Overview,
    PairHealth,
    RmsHistory,
    SpectralLine,
    Stretch,
)

FS = 500.0


def overview_of(samples, fs=FS, start_s=0.0, n_stretches=600):
    """Return what a picture of (n,) samples shows, by scipy's spectra."""
    edges = np.linspace(0, samples.size, min(n_stretches, samples.size) + 1).astype(int)
    parts = [samples[a:b] for a, b in pairwise(edges)]
    # a stretch without values has no extremes
    bounds = [(np.nanmin(part), np.nanmax(part)) if np.isfinite(part).any() else (np.nan, np.nan) for part in parts]
    lowest, highest = np.transpose(bounds)
    filled = np.where(np.isfinite(samples), samples, np.nanmean(samples))
    nperseg = min(1024, samples.size)
    frequency_hz, psd = signal.welch(filled, fs=fs, nperseg=nperseg)
    bands_hz, times, spectrogram = signal.spectrogram(filled, fs=fs, nperseg=nperseg)
    middles = start_s + 0.5 * (edges[:-1] + edges[1:]) / fs
    return Overview(middles, lowest, highest, frequency_hz, psd, start_s + times, bands_hz, spectrogram.T)


def channel_of(name, samples, *, unit="m/s^2", fs=FS, **more):
    """Return the figures of (n,) samples as far as the tests look at them."""
    mean, rms = float(np.nanmean(samples)), float(np.nanstd(samples))
    peak = float(np.nanmax(np.abs(samples - mean)))
    figures = {
        "mean": mean,
        "rms": rms,
        "peak": peak,
        "crest_factor": peak / rms if rms else 0.0,
        "high_frequency_rms": 0.7 * rms,
        "quantisation_step": None,
        "clipped_fraction": 0.0,
        "longest_flat_s": 0.0,
        "spikes": 0,
        "mute": rms == 0,
        "drift": 0.02 * rms,
        "noise_floor": 0.03 * rms,
        "overview": overview_of(samples, fs),
    }
    return ChannelHealth(name=name, unit=unit, **(figures | more))


def vibration(seed, n=60000, fs=FS):
    """Return coloured noise: a body at 1.8 Hz, a wheel at 15 Hz, sensor noise; standing still at both ends."""
    rng = np.random.default_rng(seed)
    drive = rng.standard_normal(n)
    parts = [signal.lfilter(*signal.iirpeak(f, q, fs=fs), drive) for f, q in ((1.8, 3.0), (15.0, 4.0))]
    time = np.arange(n) / n
    level = np.clip(np.minimum((time - 0.15) / 0.02, (0.9 - time) / 0.3), 0.0, 1.0)
    return level * (parts[0] * 8 + parts[1] * 4) + 0.01 * rng.standard_normal(n)


def sound_health(n_channels=2):
    """Return the health of a log with nothing wrong."""
    names = ("lower_z", "upper_z", *(f"acc_{i}" for i in range(3, n_channels + 1)))[:n_channels]
    channels = tuple(channel_of(name, vibration(seed)) for seed, name in enumerate(names))
    clock = ClockHealth("", names, FS, False, 0.0, 120.0, 60000, jitter=2e-4, resolution_s=1e-6)
    pairs = tuple(PairHealth(names[0], other, 1.2e-4, 3e-5, (0.6, 31.0)) for other in names[1:])
    is_sound = np.ones((120, n_channels), bool)
    levels = RmsHistory(
        np.arange(120.0), 1.0, np.ones((120, n_channels)), np.zeros((120, n_channels)), is_sound, is_sound
    )
    unsprung = "lower_z" if n_channels > 1 else None
    return Health(FS, 120.0, 60000, channels, unsprung, (), (clock,), pairs, (levels,))


def faulty_health():
    """Return the health of a log with every fault there is, on two clocks."""
    time_s = np.arange(60000) / FS
    clipped = np.clip(vibration(1), -3.0, 3.0)
    spiky = vibration(2)
    spiky[[9000, 21000, 30500, 41000]] += [4000.0, -900.0, 2500.0, 3000.0]
    hum = vibration(3) + sum(0.4 / k * np.sin(2 * np.pi * 50.0 * k * time_s) for k in (1, 2, 3, 4))
    holed = vibration(4)
    holed[30000:33000] = np.nan
    holed[50000:52000] = holed[50000]
    slow = np.random.default_rng(5).standard_normal(12000).cumsum() * 0.02 + 31.0

    lines = tuple(
        SpectralLine(50.0 * k, 0.28 / k, "mains, 50 Hz" if k == 1 else f"harmonic {k} of the mains (50 Hz)", k)
        for k in (1, 2, 3, 4)
    )
    for each in (clipped, spiky, hum, holed):
        # lost by the clock they share
        each[16500:18250] = np.nan
    channels = (
        channel_of(
            "lower_z",
            clipped,
            clipped_fraction=0.021,
            stretches=tuple(Stretch("clipped", t, t + 0.02) for t in np.linspace(20, 80, 100)),
        ),
        channel_of(
            "upper_z",
            spiky,
            spikes=4,
            stretches=tuple(Stretch("spike", t / FS, (t + 1) / FS) for t in (9000, 21000, 30500, 41000)),
        ),
        channel_of("hum", hum, unit="?", lines=(*lines, SpectralLine(23.4, 0.05))),
        channel_of(
            "holed",
            holed,
            longest_flat_s=4.0,
            missing=3000,
            stretches=(Stretch("missing", 60.0, 66.0), Stretch("flat", 100.0, 104.0)),
        ),
        channel_of("dead", np.full(60000, 0.25), noise_floor=0.0, drift=0.0),
        channel_of("oil temperature", slow, unit="K", fs=100.0, quantisation_step=0.0625),
    )
    fast = ClockHealth(
        "fast",
        tuple(channel.name for channel in channels[:5]),
        FS,
        False,
        0.0,
        120.0,
        60000,
        jitter=0.083,
        resolution_s=1e-3,
        repeated=12,
        backward=1,
        gaps=(Stretch("gap", 33.0, 36.5), Stretch("gap", 110.0, 110.01)),
        n_gaps=2,
        n_lost=1755,
    )
    slow_clock = ClockHealth("slow", ("oil temperature",), 100.0, True, 0.5, 120.0, 12000)
    findings = (
        Finding("fault", "mute", "dead", "mute, all samples lie at 0.25 m/s^2: check the sensor and its cable"),
        Finding("warning", "gaps", "", "2 gaps, the first of 3.5 s at 33 s: choose a segment between them"),
        Finding("warning", "clipped", "lower_z", "2.10% of the samples are clipped: measure again with a larger range"),
        Finding("note", "gravity", "upper_z", "the mean is gravity: nothing to do"),
        Finding("note", "gravity", "holed", "the mean is gravity: nothing to do"),
    )
    pairs = (
        PairHealth("lower_z", "upper_z", 1.95e-3, 2.1e-5, (0.5, 28.0)),
        PairHealth("lower_z", "dead", np.nan, np.nan, None),
    )
    return Health(FS, 120.0, 60000, channels, "lower_z", findings, (fast, slow_clock), pairs)
