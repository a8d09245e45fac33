"""What stands out of a spectrum: lines, peaks that may be lines, and what supplies are called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.signals.health.result import SpectralLine
from opid.signals.health.settings import HEALTH
from opid.signals.recording import FloatArray

MAINS_HZ = (50.0, 60.0)
AIRCRAFT_HZ = 400.0

SHARED_BY_LINES = 1.94  # neighbouring lines under a Hann window: 1 + 2 ((2/3)^2 + (1/6)^2)


def lines_of(frequency_hz: FloatArray, psd: FloatArray, averages: FloatArray, *, fs: float) -> tuple[SpectralLine, ...]:
    """Return the narrow peaks of a spectrum, the strongest first, supplies and their harmonics by name.

    The half-width of a resonance is zeta f. Where that of one with 1 % of damping is no wider than the spectrum's
    lines, a peak may be either: it is not resolved.

    Args:
        frequency_hz: (n_lines,) evenly spaced from 0, Hz.
        psd: (n_lines,) under a Hann window, unit^2/Hz.
        averages: (n_lines,) how many periodograms of equal power it is worth.
        fs: rate, Hz.
    """
    if psd.size < 40 or averages.max() <= 0 or not np.isfinite(psd).all() or psd.max() <= 0:
        return ()
    from scipy.ndimage import median_filter

    edges = growing_edges(psd.size, fraction=HEALTH.line_group)
    sizes = np.diff(np.append(edges, psd.size))
    power = np.add.reduceat(psd, edges) / sizes
    sizes_of_median = HEALTH.usual_groups, HEALTH.near_groups
    usual, near = (median_filter(power, size=size, mode="reflect") for size in sizes_of_median)
    df = float(frequency_hz[1])
    resolved_hz = df / HEALTH.least_damping
    ends = np.append(edges, psd.size)
    found = []
    for k in _narrow_peaks(
        power, usual, near, np.maximum(averages[edges], 1.0) * np.maximum(1.0, sizes / SHARED_BY_LINES)
    ):
        inside = slice(ends[k - 2], ends[k + 3])
        around = np.maximum(psd[inside] - usual[k], 0.0)
        # centre of the main lobe of the window, which is symmetric about a pure tone
        found.append((float(frequency_hz[inside] @ around / around.sum()), float(np.sqrt(around.sum() * df))))
    found.sort(key=lambda each: -each[1])
    # over the minutes of a log the mains wander by more than the lines of long blocks are apart
    names = names_of_lines([at for at, _ in found], fs=fs, resolution_hz=max(df, HEALTH.mains_wander_hz))
    every = [
        SpectralLine(at, rms, name, resolved=at >= resolved_hz) for (at, rms), name in zip(found, names, strict=True)
    ]
    named = [line for line in every if line.name]
    return tuple(sorted({*every[: HEALTH.most_lines], *named[: HEALTH.most_lines]}, key=lambda line: -line.rms))


def growing_edges(n_lines: int, *, fraction: float) -> np.ndarray:
    """Return the first line of each group of lines that are this part of their frequency wide, one line at least.

    >>> growing_edges(12, fraction=0.4).tolist()
    [0, 1, 2, 3, 4, 5, 7, 9]
    """
    edges = []
    line = 0
    while line < n_lines:
        edges.append(line)
        line += max(1, int(fraction * line))
    return np.array(edges)


def _narrow_peaks(power: FloatArray, usual: FloatArray, near: FloatArray, averages: FloatArray) -> np.ndarray:
    """Groups that stand out of a spectrum and are no wider than the window makes a line."""
    from scipy import special
    from scipy.ndimage import maximum_filter

    inner = slice(5, power.size - 5)
    own, base, n = power[inner], usual[inner], averages[inner]
    chance = special.gammainccinv(n, HEALTH.line_chance / n.size) / special.gammaincinv(n, 0.5)
    peak = (own == maximum_filter(power, size=5)[inner]) & (
        own > np.maximum(HEALTH.line_ratio, chance) * np.maximum(base, near[inner])
    )
    beside = np.convolve(power, np.full(3, 1 / 3), mode="valid")
    scatter = 1 + 3 * np.sqrt(SHARED_BY_LINES / (3 * n))
    narrow = np.maximum(beside[: own.size], beside[8 : 8 + own.size]) < own / HEALTH.line_width + scatter * base
    return np.flatnonzero(peak & narrow) + 5


def names_of_lines(lines_hz: Sequence[float], *, fs: float, resolution_hz: float) -> list[str]:
    """Return what lines are called: mains at 50 or 60 Hz, the supply of an aircraft at 400 Hz, harmonics, aliases.

    A harmonic (or what the rate folds it to, `|k f - n fs|`) is called so only where its fundamental is there too.

    >>> names_of_lines([50.0, 150.02, 33.0], fs=512.0, resolution_hz=0.5)
    ['mains, 50 Hz', 'harmonic 3 of the mains (50 Hz)', '']
    >>> names_of_lines([60.0, 20.0], fs=200.0, resolution_hz=0.5)
    ['mains, 60 Hz', 'harmonic 3 of the mains (60 Hz), aliased']
    """
    names = [""] * len(lines_hz)
    supplies = [(hz, f"mains, {hz:g} Hz", f"the mains ({hz:g} Hz)", HEALTH.mains_tolerance) for hz in MAINS_HZ]
    supplies.append((AIRCRAFT_HZ, "aircraft supply, 400 Hz", "the aircraft supply (400 Hz)", HEALTH.aircraft_tolerance))
    for supply_hz, name, of, tolerance in supplies:
        if supply_hz >= fs / 2:
            continue
        slack = tolerance * supply_hz + 0.2 * resolution_hz
        near = [i for i, hz in enumerate(lines_hz) if abs(hz - supply_hz) <= slack and not names[i]]
        if not near:
            continue
        base = min(near, key=lambda i: abs(lines_hz[i] - supply_hz))
        names[base] = name
        own_hz = lines_hz[base]
        for k in range(2, HEALTH.most_harmonic + 1):
            folded = abs(k * own_hz - fs * round(k * own_hz / fs))
            alias = ", aliased" if k * own_hz > fs / 2 else ""
            slack = (0.1 * k + 0.2) * resolution_hz
            for i, hz in enumerate(lines_hz):
                if not names[i] and abs(hz - folded) <= slack:
                    names[i] = f"harmonic {k} of {of}{alias}"
    return names
