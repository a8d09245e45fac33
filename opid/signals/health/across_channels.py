"""Accelerations compared: which one comes later, where they move alike, which is on the wheel's side."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.signals.health.chunks import LARGEST
from opid.signals.health.result import Finding, PairHealth
from opid.signals.health.settings import HEALTH
from opid.signals.health.spectrum import SHARED_BY_LINES, hann
from opid.signals.health.spikes import remove_spikes
from opid.signals.recording import FloatArray, Recording
from opid.signals.spectra import ComplexArray
from opid.signals.units import STANDARD_GRAVITY

PairSpectra = tuple[FloatArray, FloatArray, ComplexArray]
"""One-sided densities of both channels, and the cross-spectrum E[conj(X_1) X_2]."""


def compare_pairs(
    names: Sequence[str], frequency_hz: FloatArray, density: ComplexArray, averages: float, *, fs: float
) -> tuple[tuple[PairHealth, ...], tuple[Finding, ...]]:
    """Return the figures of each two channels, and what is wrong between them: a lag, or the same signal twice.

    The lag of a channel is reported once, against the first channel that moves alike. `density`, (n, n, n_lines), holds
    the cross-spectra E[conj(X_i) X_j] for i <= j of as many independent averages.
    """
    spectra = {
        (i, j): (density[i, i].real, density[j, j].real, density[i, j]) for i, j in combinations(range(len(names)), 2)
    }
    pairs = {(i, j): _compare(names[i], names[j], frequency_hz, own, averages) for (i, j), own in spectra.items()}
    findings: list[Finding] = []
    for j, name in enumerate(names):
        twin = next((names[i] for i in range(j) if _is_same(spectra[i, j])), None)
        if twin is not None:
            message = f"the same signal as {twin!r}: check the wiring and the export"
            findings.append(Finding("warning", "same_signal", name, message))
            continue
        rigid = [pairs[i, j] for i in range(j) if _moves_alike(pairs[i, j], frequency_hz, spectra[i, j])]
        findings += _find_lag(rigid[0], fs) if rigid else ()
    return tuple(pairs.values()), tuple(findings)


def _find_lag(pair: PairHealth, fs: float) -> Iterator[Finding]:
    least_s = max(HEALTH.lag_sigma * pair.lag_std_s, HEALTH.lag_samples / fs)
    if pair.coherent_band_hz is None or abs(pair.lag_s) <= least_s:
        return
    low, high = pair.coherent_band_hz
    later = "later" if pair.lag_s > 0 else "earlier"
    yield Finding(
        "warning",
        "lag",
        pair.second,
        f"comes {1e3 * abs(pair.lag_s):.4g} ms (standard deviation {1e3 * pair.lag_std_s:.1g} ms) {later} than "
        f"{pair.first!r}, with which it moves alike from {low:.3g} to {high:.3g} Hz: the recorder samples or "
        f"filters them differently; write `shift_s = {-pair.lag_s:.4g}` in its table of [channels]",
    )


def _compare(
    first: str,
    second: str,
    frequency_hz: FloatArray,
    spectra: PairSpectra,
    averages: float,
) -> PairHealth:
    coherence = _compute_coherence(spectra)
    is_short = averages < HEALTH.least_averages
    band = None if is_short else _find_coherent_band(frequency_hz, coherence)
    if band is None:
        return PairHealth(first, second, np.nan, np.nan, None, is_short)
    inside = slice(*band)
    lag_s, std_s = _fit_lag(frequency_hz, spectra[2], coherence, inside, averages)
    low, high = float(frequency_hz[band[0]]), float(frequency_hz[band[1] - 1])
    return PairHealth(first, second, lag_s, std_s, (low, high))


def _compute_coherence(spectra: PairSpectra) -> FloatArray:
    one, other, cross = spectra
    power = one * other
    return np.divide(np.abs(cross) ** 2, power, out=np.zeros(power.size), where=power > 0)


def _find_coherent_band(frequency_hz: FloatArray, coherence: FloatArray) -> tuple[int, int] | None:
    """Return the first line of the longest band of coherence, and the line after its last.

    Single lines do not interrupt the band.
    """
    from scipy.ndimage import median_filter

    above = np.concatenate([[False], median_filter(coherence, size=5, mode="nearest") > HEALTH.coherence, [False]])
    above[1] = False  # the mean was subtracted
    edges = np.flatnonzero(above[1:] != above[:-1])
    if not edges.size or frequency_hz.size < HEALTH.least_lines:
        return None
    longest = int(np.argmax(edges[1::2] - edges[0::2]))
    low, high = int(edges[2 * longest]), int(edges[2 * longest + 1])
    return (low, high) if high - low >= 2 else None


def _fit_lag(
    frequency_hz: FloatArray, cross: ComplexArray, coherence: FloatArray, inside: slice, averages: float
) -> tuple[float, float]:
    """Return the delay tau of exp(-i 2 pi f tau) in the band and its standard deviation; NaN if no delay fits.

    The lines are weighted by the inverse variance of their phase, (1 - c)/(2 n c) (Bendat & Piersol, 9.3).
    """
    f, c = frequency_hz[inside], np.clip(coherence[inside], 1e-6, 1 - 1e-9)
    if f.size < HEALTH.least_lines or f[-1] < HEALTH.broad_band * f[0]:
        return np.nan, np.nan
    weight = 2 * averages * c / (1 - c)
    turned = np.zeros(frequency_hz.size, dtype=np.complex128)
    turned[inside] = cross[inside] / np.maximum(np.abs(cross[inside]), 1e-300) * np.minimum(c, 0.99)
    n = 8 * (frequency_hz.size - 1)
    correlation = np.fft.irfft(turned, n)
    at = int(np.abs(correlation).argmax())
    lag_s = (at if at < n / 2 else at - n) / (n * frequency_hz[1])
    upside_down = -1.0 if correlation[at] < 0 else 1.0
    leverage = float(weight @ f**2)
    for _ in range(3):
        phase = np.angle(upside_down * turned[inside] * np.exp(2j * np.pi * f * lag_s))
        lag_s -= float(weight @ (f * phase) / (2 * np.pi * leverage))
    phase = np.angle(upside_down * turned[inside] * np.exp(2j * np.pi * f * lag_s))
    parts = np.array([part.mean() for part in np.array_split(phase, 8)])
    if np.abs(parts).max() > HEALTH.phase_tolerance_rad:
        return np.nan, np.nan
    scatter = max(1.0, float(weight @ phase**2) / f.size)
    return float(lag_s), float(np.sqrt(SHARED_BY_LINES * scatter / leverage) / (2 * np.pi))


def _moves_alike(pair: PairHealth, frequency_hz: FloatArray, spectra: PairSpectra) -> bool:
    """Return whether the gain is flat where a delay fits the phase: a suspension changes both phase and gain."""
    if not np.isfinite(pair.lag_s) or pair.coherent_band_hz is None:
        return False
    low, high = pair.coherent_band_hz
    inside = (frequency_hz >= low) & (frequency_hz <= high)
    one, other, _ = spectra
    ratio = np.maximum(other[inside], 1e-300) / np.maximum(one[inside], 1e-300)
    gains = np.array([np.sqrt(np.exp(np.log(part).mean())) for part in np.array_split(ratio, 8)])
    return bool(gains.max() < HEALTH.gain_tolerance * gains.min())


def _is_same(spectra: PairSpectra) -> bool:
    one, other, cross = (part.sum() for part in spectra)
    return bool(one > 0 and abs(one + other - 2 * cross.real) < 1e-12 * one)


# ---- the wheel's side and the airframe's -----------------------------------------------------------


def check_pair(unsprung: ArrayLike, sprung: ArrayLike, *, fs: float, names: tuple[str, str]) -> tuple[Finding, ...]:
    """Return the reasons why two accelerations, m/s^2, may not be those of a spindle and the airframe above it.

    Raises:
        InputError: both are the same signal, one is mute, one seems to be in another unit, or values are impossible.

    >>> rng = np.random.default_rng(0)
    >>> wheel = rng.standard_normal(4096)
    >>> body = np.convolve(wheel, np.ones(20) / 20, "same")
    >>> check_pair(wheel, body, fs=256.0, names=("lower_z", "upper_z"))
    ()
    >>> check_pair(body, wheel, fs=256.0, names=("lower_z", "upper_z"))[0].severity
    'warning'
    """
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if np.array_equal(lower, upper):
        raise InputError(f"the channels {names[0]!r} and {names[1]!r} are the same signal: name two sensors")
    for name, samples in zip(names, (lower, upper), strict=True):
        if not np.abs(samples).max() <= LARGEST:
            raise InputError(
                f"the channel {name!r} reaches {np.abs(samples).max():.3g} m/s^2: check its unit and scale"
            )
    pair = (lower, upper)
    below, above = (np.fft.rfft((samples - samples.mean()) * hann(samples.size)) for samples in pair)
    frequency_hz = np.asarray(np.fft.rfftfreq(lower.size, 1 / fs), dtype=np.float64)
    mistake = _find_unit_mistake(frequency_hz, below, above, names)
    if mistake:
        raise InputError(mistake)
    rms = [float(np.std(samples)) for samples in pair]
    for name, samples, own, other in zip(names, pair, rms, rms[::-1], strict=True):
        # for nearly every channel the first samples suffice, and the others need not be sorted
        is_mute = all(np.unique(each).size <= HEALTH.mute_values for each in (samples[:1000], samples))
        if is_mute or own < HEALTH.mute_ratio * other:
            why = (
                f"it has not more than {HEALTH.mute_values} different values"
                if is_mute
                else f"its rms is {own:.3g} m/s^2, and that of the other channel {other:.3g} m/s^2"
            )
            raise InputError(f"the channel {name!r} is mute ({why}): check sensor, cable, range and unit")
    findings: list[Finding] = []
    quiet = int(np.argmin(rms))
    if rms[quiet] < HEALTH.quiet_ratio * rms[1 - quiet]:
        message = (
            f"{rms[quiet]:.3g} m/s^2 rms beside {rms[1 - quiet]:.3g} at {names[1 - quiet]!r}: "
            "this may be the sensor's noise alone; check its cable, its range and the units"
        )
        findings.append(Finding("warning", "quiet_channel", names[quiet], message))
    high = [_compute_rms_above(remove_spikes(samples, fs=fs)[0], fs, HEALTH.high_frequency_hz) for samples in pair]
    if high[0] < HEALTH.swap_ratio * high[1] and not _lags_behind(frequency_hz, below, above):
        message = (
            f"the spindle ({names[0]!r}, {high[0]:.3g} m/s^2 rms above {HEALTH.high_frequency_hz:g} Hz) is quieter "
            f"than the airframe ({names[1]!r}, {high[1]:.3g}): if swapped, exchange sprung and unsprung, "
            f"sprung = {names[0]!r} and unsprung = {names[1]!r}"
        )
        findings.append(Finding("warning", "swapped_channels", names[0], message))
    return tuple(findings)


def _lags_behind(frequency_hz: FloatArray, below: ComplexArray, above: ComplexArray) -> bool:
    """Return whether the upper side lags behind the lower one, as a body on a damper does at every frequency.

    With H = (k + i w c)/(k - m w^2 + i w c) from below to above, Im H = -m w^3 c/|k - m w^2 + i w c|^2 < 0.
    """
    inside = (frequency_hz >= HEALTH.lag_hz[0]) & (frequency_hz <= HEALTH.lag_hz[1])
    cross = complex(np.vdot(below[inside], above[inside]))
    size = float(np.linalg.norm(below[inside]) * np.linalg.norm(above[inside]))
    return cross.imag < -HEALTH.least_lag * size


def find_unit_ratio(ratios: Iterable[float]) -> tuple[str, str, float] | None:
    """Return a larger unit, a smaller one and their ratio if all ratios of accelerations lie near it; else None.

    Args:
        ratios: the ratios of one acceleration to another, either all above 1 or all below.

    >>> find_unit_ratio([10.2, 11.9]), find_unit_ratio([0.001]), find_unit_ratio([1.2])
    (('g', 'm/s^2', 9.80665), ('m/s^2', 'mm/s^2', 1000.0), None)
    """
    logs = np.log(np.maximum(list(ratios), 1e-300))
    for larger, smaller, apart in (
        ("g", "m/s^2", STANDARD_GRAVITY),
        ("m/s^2", "mm/s^2", 1e3),
        ("g", "mm/s^2", 1e3 * STANDARD_GRAVITY),
    ):
        if any(np.abs(sign * logs - np.log(apart)).max() < np.log(HEALTH.unit_tolerance) for sign in (1, -1)):
            return larger, smaller, apart
    return None


def _find_unit_mistake(
    frequency_hz: FloatArray, below: ComplexArray, above: ComplexArray, names: tuple[str, str]
) -> str | None:
    """Return why one of two channels seems to be in another unit: slow motion is equal above and below a suspension."""
    gains, n_lines = [], 0
    for low_hz, high_hz in HEALTH.carried_hz:
        inside = (frequency_hz >= low_hz) & (frequency_hz < high_hz)
        cross = complex(np.vdot(below[inside], above[inside]))
        own, other = (float(np.sum(np.abs(side[inside]) ** 2)) for side in (below, above))
        if abs(cross) ** 2 <= HEALTH.unit_coherence * own * other or abs(np.angle(cross)) > HEALTH.unit_phase_rad:
            return None
        gains.append(abs(cross) / own)
        n_lines += int(inside.sum())
    found = find_unit_ratio(gains) if n_lines >= HEALTH.unit_lines else None
    if found is None:
        return None
    larger, smaller, apart = found
    too_large, too_small = names[::-1] if gains[0] > 1 else names
    ratio = gains[0] if gains[0] > 1 else 1 / gains[0]
    return (
        f"{too_large!r} moves {ratio:.3g} times as much as {too_small!r} from {HEALTH.carried_hz[0][0]:g} to "
        f"{HEALTH.carried_hz[-1][1]:g} Hz, where a suspension carries its body along and both move alike, and {larger} "
        f"is {apart:.4g} {smaller}: either {too_large!r} is written in {smaller} and was read as {larger}, or "
        f"{too_small!r} is written in {larger} and was read as {smaller}; give the right `unit` in the table of that "
        "channel in the study file ([channels.NAME]; [runs.channels.NAME] for this run alone), or in the log's header"
    )


def check_magnitudes(recording: Recording, names: Sequence[str]) -> Iterator[Finding]:
    """Yield why all sensors of a recording, m/s^2, may be in another unit; no ratio between them shows that.

    >>> from opid.signals.recording import recording_from_arrays
    >>> shaken = 500 * np.random.default_rng(0).standard_normal((2, 512))
    >>> run = recording_from_arrays(shaken, ["a", "b"], fs=512.0)
    >>> [finding.severity for finding in check_magnitudes(run, ["a", "b"])]
    ['warning']
    """
    channels = [recording.channel(name) for name in names]
    unit = "give the right `unit` in [channels.NAME] of the study file, or in the log's header"
    if all(np.std(samples) > HEALTH.largest_rms for samples in channels):
        yield Finding(
            "warning",
            "too_large",
            "",
            f"every channel has more than {HEALTH.largest_rms:g} m/s^2 rms, which no vehicle or building has in "
            f"operation: are they written in mm/s^2, or in m/s^2 and were read as g? Then {unit}",
        )
    elif all(abs(abs(np.mean(samples)) - 1) < HEALTH.rest_tolerance for samples in channels):
        yield Finding(
            "warning",
            "all_gravity_in_g",
            "",
            "the mean of every channel is 1 m/s^2, which would be gravity in g: if they are written in g and were read "
            f"as m/s^2, {unit}",
        )


def _compute_rms_above(samples: FloatArray, fs: float, frequency_hz: float) -> float:
    """Return the rms above a frequency, by Parseval under a Hann window (the whole rms if fs is too low)."""
    window = hann(samples.size)
    spectrum = np.fft.rfft((samples - samples.mean()) * window)
    first = int(np.ceil(frequency_hz * samples.size / fs)) if frequency_hz < 0.5 * fs else 1
    power = 2 * np.sum(np.abs(spectrum[first:]) ** 2)
    return float(np.sqrt(power / (samples.size * np.sum(window**2))))
