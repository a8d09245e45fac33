"""Find the free decay in a record: its frequency, the end of the impact or the force before it, what comes after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import next_fast_len, rfft, rfftfreq
from scipy.ndimage import uniform_filter1d
from scipy.signal import detrend, fftconvolve, find_peaks, peak_prominences

from opid.errors import InputError, NotDeterminedError
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

Beginning = Literal["given", "impact", "drive", "force"]
"""Where a decay begins: at a time that was given, after an impact, after a steady motion that something drove, or after
the end of a measured force."""


@dataclass(frozen=True)
class Stretch:
    """The part of a record that holds a free decay."""

    frequency_hz: float  # rough frequency of the mode, Hz
    rate: float  # rough decay rate, 1/s: the amplitude falls as exp(-rate t)
    start: int  # first sample
    stop: int  # sample after the last that may be used
    sure_stop: int  # sample where the envelope comes near its value at the end of the record
    warnings: tuple[str, ...]  # one sentence for each warning about the choice
    beginning: Beginning


@dataclass(frozen=True, eq=False)
class ActingForce:
    """When a measured force acts.

    Args:
        acts: (n,) whether it stands out of its noise and of its rest, for each sample.
        fraction: (n,) size of the force over its largest.
        free: first sample and sample after the last of the part in which no force acts and the motion is largest.
        ends: whether the force ends before that part; else it falls with the motion, as a load cell in the structure
            does, or acts until the end.
    """

    acts: NDArray[np.bool_]
    fraction: FloatArray
    free: tuple[int, int]
    ends: bool


def find_stretch(
    samples: FloatArray,
    *,
    fs: float,
    near_hz: float | None = None,
    band_hz: tuple[float, float] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    free: tuple[int, int] | None = None,
) -> Stretch:
    """Return the stretch of a record where its strongest mode, or the one asked for, decays freely.

    The mode is the peak of the spectrum that loses most from the first half of the decay to the second; hum, which
    stays, is therefore not taken for a mode. The peak lies within a tenth of `near_hz`, or in `band_hz`. Only the
    samples `free`, the first and the one after the last, are looked at; None for all of them.

    Raises:
        InputError: a band or times outside the record.
        NotDeterminedError: no peak, or fewer than ten cycles of it.
    """
    n = samples.size
    first, last = _find_limits(n, fs, start_s, stop_s)
    if free is not None:
        first, last = max(first, free[0]), min(last, free[1])
    low, high = _choose_band(last - first, fs, near_hz, band_hz)
    part = samples[first:last] - np.median(samples[first:last])
    peak = 0 if start_s is not None else int(np.argmax(np.abs(detrend(part))))
    if peak > 0.95 * part.size:
        raise NotDeterminedError(
            f"the signal is largest at {(first + peak) / fs:.4g} s, at the end of the record: it grows, or an "
            "impact comes at the end; give start_s and stop_s of a free decay"
        )
    frequency = _find_decaying_peak(part[peak:], fs, low, high)
    cycle = fs / frequency
    if last - first < MODAL.fewest_cycles * cycle:
        raise _make_length_error(first / fs, (last - first) / cycle, frequency)
    warnings: list[str] = []
    envelope = find_envelope(part, fs=fs, frequency_hz=frequency)
    start = 0
    beginning: Beginning = "given"
    if start_s is None:
        start, beginning = _find_start(part, envelope, cycle)
        start = max(start, _skip_clipped(part, cycle, warnings))
    stop = _find_next_impact(part, start, cycle)
    if stop - start < MODAL.fewest_cycles * cycle:
        raise _make_length_error((first + start) / fs, (stop - start) / cycle, frequency)
    if start_s is None:
        frequency = _find_decaying_peak(part[start:stop], fs, low, high)
        envelope = find_envelope(part, fs=fs, frequency_hz=frequency)
    floor = float(np.quantile(envelope[start + (stop - start) // 2 : stop], 0.2))
    quiet = np.flatnonzero(envelope[start:stop] < max(3.0 * floor, 2e-3 * envelope[start]))
    sure = start + int(quiet[0]) if quiet.size else stop
    sure = min(stop, max(sure, start + int(MODAL.fewest_cycles * fs / frequency)))
    rate = _fit_slope(envelope[start:sure], fs)
    if free is not None and free[0] > 0 and beginning == "impact":
        beginning = "force"
    return Stretch(frequency, rate, first + start, first + stop, first + sure, tuple(warnings), beginning)


def find_free_part(samples: FloatArray, force: ArrayLike, *, fs: float) -> ActingForce:
    """Return when any of some forces acts on a structure whose motion is (n,) `samples`.

    Args:
        samples: (n,) the motion.
        force: (n,) one force, or (n, m) several.
        fs: sampling rate, Hz.

    Raises:
        InputError: forces of another length, or that are not finite.
    """
    columns = np.asarray(force, dtype=np.float64)
    columns = columns[:, None] if columns.ndim == 1 else columns
    if columns.ndim != 2 or len(columns) != samples.size or not np.isfinite(columns).all():
        raise InputError(
            f"the force has shape {columns.shape} for {samples.size} samples of the motion, or is not finite: give a "
            "number for each sample"
        )
    n = samples.size
    fractions, period = np.zeros(n), 4.0
    for column in columns.T:
        fraction, own_period = _compare_with_largest(column)
        fractions, period = np.maximum(fractions, fraction), max(period, own_period)
    acts = fractions > MODAL.acting
    edges = np.concatenate([[-1], np.flatnonzero(acts), [n]])
    gaps = np.flatnonzero(np.diff(edges) > 2.0 * period)
    if not acts.any() or not gaps.size:
        return ActingForce(acts, fractions, (0, n), False)
    parts = [(int(edges[gap]) + 1, int(edges[gap + 1])) for gap in gaps]
    first, last = max(parts, key=lambda part: float(np.abs(detrend(samples[part[0] : part[1]])).max()))
    return ActingForce(acts, fractions, (first, last), first > 0 and not _falls_with(samples, fractions, first, period))


def find_envelope(samples: FloatArray, *, fs: float, frequency_hz: float) -> FloatArray:
    """Return the amplitude of a signal near a frequency, (n,), through a Hann kernel of six cycles."""
    return np.abs(find_phasor(samples, fs=fs, frequency_hz=frequency_hz))


def find_phasor(samples: FloatArray, *, fs: float, frequency_hz: float) -> NDArray[np.complex128]:
    """Return amplitude and phase beside that of a frequency as complex numbers, (n,), through the same kernel."""
    length = max(3, round(MODAL.kernel_cycles * fs / frequency_hz))
    kernel = np.hanning(length + 2)[1:-1]
    turned = samples * np.exp(-2j * np.pi * frequency_hz / fs * np.arange(samples.size))
    weight = fftconvolve(np.ones(samples.size), kernel, mode="same")
    return np.asarray(2.0 * fftconvolve(turned, kernel, mode="same") / weight, dtype=np.complex128)


@dataclass(frozen=True)
class Hum:
    """A steady line at a multiple of the mains, which the mode at the same frequency hides until it has decayed."""

    frequency_hz: float
    phasor: complex  # the line is the real part of phasor exp(2 pi j frequency t), t from the first sample
    std: float  # standard deviation of the phasor, real and imaginary part together

    def make_line(self, n: int, fs: float) -> FloatArray:
        """Return n samples of the line."""
        return np.real(self.phasor * np.exp(2j * np.pi * self.frequency_hz / fs * np.arange(n)))


def find_hum(samples: FloatArray, stretch: Stretch, *, fs: float) -> Hum | None:
    """Return the hum in the frequency of a mode, by the end of its decay and the quiet before it; None without any.

    The end holds the line and what is left of the mode, which decays at a rate of its own. The line must stand out of
    its error, and of the mode at the end of the record.
    """
    own, mains = stretch.frequency_hz, find_mains(stretch.frequency_hz)
    hop = max(1, round(0.5 * MODAL.kernel_cycles * fs / own))
    tail = np.arange(stretch.sure_stop + hop, stretch.stop - hop, hop)
    # A window of the decay separates lines that are farther away.
    longest = min((stretch.sure_stop - stretch.start) / fs / 2.5, MODAL.longest_decay / max(stretch.rate, 1e-9))
    if abs(mains - own) > max(MODAL.hum_width * mains, MODAL.resolved / longest) or tail.size < MODAL.fewest_hum:
        return None
    turned = find_phasor(samples - np.median(samples[stretch.sure_stop :]), fs=fs, frequency_hz=mains)
    before = np.arange(hop, stretch.start - 3 * hop, hop)
    if before.size and np.abs(turned[before]).max() > 2.0 * np.abs(turned[tail]).max():
        before = before[:0]
    at = np.concatenate([before, tail])
    centre = tail[tail.size // 2]
    line, mode_at_end, std, apart = _fit_line(
        turned[at], (at - centre) / fs, before.size, own - mains, max(stretch.rate, 1e-3 * own), mains
    )
    is_sure = abs(line) > MODAL.hum_sigma * std and mode_at_end < MODAL.left_beside_hum * abs(line)
    if not is_sure or abs(apart) > 0.49 * MODAL.mains_width * mains:
        return None
    frequency = mains + apart
    # The phasors turn with the mains from the first sample on, and with the rest from the centre.
    return Hum(frequency, line * complex(np.exp(-2j * np.pi * apart * centre / fs)), std)


def find_mains(frequency_hz: float) -> float:
    """Return the multiple of 50 or 60 Hz that is nearest to a frequency."""
    lines = [base * max(round(frequency_hz / base), 1) for base in (50.0, 60.0)]
    return min(lines, key=lambda line: abs(line - frequency_hz))


def _fit_line(
    seen: NDArray[np.complex128], time: FloatArray, n_before: int, mode_hz: float, rate: float, mains: float
) -> tuple[complex, float, float, float]:
    """Fit C exp(2 pi j f t) + D exp(2 pi j g t - r t) to phasors; the first `n_before` hold nothing of the second.

    Returns:
        C, the size of the second term at the last time, the standard deviation of C, and f, Hz. Frequencies are counted
        from that of the mains, and f stays within half of what mains keep.
    """
    from scipy.optimize import least_squares

    since = time - time[n_before]
    has_mode = np.arange(time.size) >= n_before

    def make_columns(unknown: FloatArray) -> NDArray[np.complex128]:
        fall = np.exp(-np.exp(unknown[2]) * np.where(has_mode, since, 0.0)) * has_mode
        return np.stack([np.exp(2j * np.pi * unknown[0] * time), fall * np.exp(2j * np.pi * unknown[1] * time)], axis=1)

    def errors(unknown: FloatArray) -> FloatArray:
        columns = make_columns(unknown)
        left = seen - columns @ np.linalg.lstsq(columns, seen, rcond=1e-10)[0]
        return np.asarray(left.view(np.float64) / np.abs(seen).max())

    width, own = 0.5 * MODAL.mains_width * mains, mains + mode_hz
    low = np.array([-width, mode_hz - 0.02 * own, np.log(1e-4 * own)])
    high = np.array([width, mode_hz + 0.02 * own, np.log(own)])
    late = slice((time.size + n_before) // 2, None)
    turn = float(np.polyfit(time[late], np.unwrap(np.angle(seen[late])), 1)[0]) / (2.0 * np.pi)
    start = np.clip([turn, mode_hz, np.log(rate)], low + 1e-9, high - 1e-9)
    found = least_squares(errors, start, bounds=(low, high), x_scale=[0.1, 0.1, 1.0]).x
    columns = make_columns(found)
    values = np.linalg.lstsq(columns, seen, rcond=1e-10)[0]
    left = seen - columns @ values
    terms = columns * values
    # The derivatives by real and imaginary part of C and D, by both frequencies and by the logarithm of the rate.
    slopes = np.column_stack(
        [columns, 1j * columns, 2j * np.pi * time[:, None] * terms, -np.exp(found[2]) * since * terms[:, 1]]
    )
    both = np.concatenate([slopes.real, slopes.imag])
    variance = float(np.sum(np.abs(left) ** 2)) / max(2 * seen.size - both.shape[1], 1)
    covariance = variance * np.linalg.pinv(both.T @ both, rcond=1e-12, hermitian=True)
    return (
        complex(values[0]),
        float(abs(terms[-1, 1])),
        float(np.sqrt(covariance[0, 0] + covariance[2, 2])),
        float(found[0]),
    )


def find_spectrum_peaks(
    samples: FloatArray, *, fs: float, low_hz: float, high_hz: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return frequencies (m,) Hz and heights (m,) of the peaks of an amplitude spectrum, highest first, and its median.

    The window is the falling half of a Hann window, so that the start counts most.
    """
    frequency, height = _compute_spectrum(samples, fs)
    inside = (frequency >= low_hz) & (frequency <= high_hz)
    floor = float(np.median(height[inside])) if inside.any() else 0.0
    return *_select_peaks(frequency, height, low_hz, high_hz), floor


def _compare_with_largest(force: FloatArray) -> tuple[FloatArray, float]:
    """Return the size of a force over its largest, zero where it is noise, and its period, samples."""
    n = force.size
    blocks = force[: n - n % 50].reshape(50, -1) if n >= 200 else force[None, :]
    spread = blocks.std(axis=1)
    # The force at rest is that of its quietest part: a load cell may be preloaded.
    size = np.abs(force - float(np.median(blocks[int(np.argmin(spread))])))
    largest = float(size.max())
    if not largest > MODAL.acting_over_noise * float(spread.min()):
        return np.zeros(n), 4.0
    size = np.where(size > MODAL.acting_over_noise * float(spread.min()), size, 0.0)
    spectrum = np.abs(rfft(detrend(force)))
    period = 1.0 / float(rfftfreq(n)[1 + int(np.argmax(spectrum[1:]))])
    return size / largest, min(period, n / 50.0)


def _falls_with(samples: FloatArray, fraction: FloatArray, end: int, period: float) -> bool:
    """Return whether a force falls to its end gradually, and the motion with it."""
    half = int(np.flatnonzero(fraction[:end] > 0.5)[-1]) if (fraction[:end] > 0.5).any() else end
    if end - half < MODAL.sudden_end * period:
        return False
    width = max(4, round(2.0 * period))
    before, after = (np.ptp(samples[max(0, at - width) : at + width]) for at in (half, end))
    return bool(after < 0.3 * before)


def _compute_spectrum(samples: FloatArray, fs: float) -> tuple[FloatArray, FloatArray]:
    n = samples.size
    size = next_fast_len(4 * n)
    window = 0.5 * (1.0 + np.cos(np.pi * np.arange(n) / n))
    spectrum = rfft(detrend(samples) * window, size)
    return rfftfreq(size, 1.0 / fs), 2.0 * np.abs(spectrum) / window.sum()


def _select_peaks(
    frequency: FloatArray, height: FloatArray, low_hz: float, high_hz: float
) -> tuple[FloatArray, FloatArray]:
    peaks, _ = find_peaks(height)
    prominent = peak_prominences(height, peaks)[0] > 0.3 * height[peaks]
    peaks = peaks[prominent & (frequency[peaks] >= low_hz) & (frequency[peaks] <= high_hz)]
    peaks = peaks[np.argsort(-height[peaks])]
    return frequency[peaks], height[peaks]


def _find_limits(n: int, fs: float, start_s: float | None, stop_s: float | None) -> tuple[int, int]:
    first = 0 if start_s is None else round(start_s * fs)
    last = n if stop_s is None else min(n, round(stop_s * fs))
    if not 0 <= first < last <= n:
        raise InputError(
            f"start_s is {start_s}, stop_s {stop_s}: give times within the record of {n / fs:.4g} s, the start first"
        )
    return first, last


def _choose_band(n: int, fs: float, near_hz: float | None, band_hz: tuple[float, float] | None) -> tuple[float, float]:
    low, high = 4.0 * fs / n, 0.45 * fs
    if band_hz is not None:
        low, high = band_hz
    elif near_hz is not None:
        low, high = 0.9 * near_hz, 1.1 * near_hz
    if not 0.0 < low < high <= 0.5 * fs:
        raise InputError(
            f"the mode would be searched between {low:.4g} and {high:.4g} Hz in {n / fs:.3g} s at {fs:g} Hz: give a "
            f"band below half the sampling rate, or a record of ten cycles or more"
        )
    return low, high


def _find_decaying_peak(part: FloatArray, fs: float, low: float, high: float) -> float:
    half = part.size // 2
    if half < 8:
        raise NotDeterminedError("the record is largest at its very end, so no decay follows: give start_s and stop_s")
    frequency, early = _compute_spectrum(part[:half], fs)
    _, late = _compute_spectrum(part[half : 2 * half], fs)
    lost = np.maximum(early - late, 0.0)
    peaks, _ = _select_peaks(frequency, early, low, high)
    if not peaks.size:
        raise NotDeterminedError(
            f"the spectrum has no peak between {low:.4g} and {high:.4g} Hz after the largest sample: give near_hz or "
            "another stretch of the record"
        )
    return float(peaks[np.argmax(np.interp(peaks, frequency, lost))])


def _find_start(part: FloatArray, envelope: FloatArray, cycle: float) -> tuple[int, Beginning]:
    """Return the first sample after an impact, or after a dwell, and which of them it is."""
    highest, reach = int(np.argmax(envelope)), round(0.5 * MODAL.kernel_cycles * cycle) + 1
    steady = _find_steady_end(envelope, cycle)
    if steady is not None:
        return steady + reach, "drive"
    # The mean over a cycle follows slower motion, and the mode cancels in it.
    level = np.abs(part - uniform_filter1d(part, max(3, round(cycle))))
    first = max(0, highest - 4 * reach)
    near = level[first : highest + reach]
    peak = first + int(np.argmax(near))
    # An impact rises far above the motion before it; the end of a dwell does not.
    onset = first + int(np.flatnonzero(near * MODAL.impact_rise >= near.max())[0])
    rise = level[onset : onset + round(2.5 * cycle)].max() > 0.75 * near.max()
    loud = int(np.flatnonzero(envelope >= 0.97 * envelope[highest])[-1])
    # A record that begins loud begins in a decay, or in a dwell.
    begins_loud = onset < 1.25 * cycle
    if not (loud < peak + 2 * reach if begins_loud else rise and onset > first + 1.25 * cycle):
        # After a dwell the kernel must not reach back across the end of the dwell.
        return loud + reach, "drive"
    # A hammer that drives the mode touches for less than half of its period, so the impact is over by then.
    return (peak if peak < onset + 2.5 * cycle else onset) + round(MODAL.after_peak_cycles * cycle), "impact"


def _find_steady_end(envelope: FloatArray, cycle: float) -> int | None:
    """Return the last sample of a steady motion before the decay, which something drives; None where there is none.

    A decay passes one level after another in times that change slowly; a drive holds its envelope at one level.
    """
    reach = round(0.5 * MODAL.kernel_cycles * cycle) + 1
    inner = envelope[reach:-reach]  # the kernel reaches beyond the record at its ends
    if inner.size < 4 * reach:
        return None
    step = 1.0 - MODAL.steady_step
    levels = inner.max() * step ** np.arange(1, 1 + int(np.log(MODAL.least_steady) / np.log(step)))
    levels = levels[levels > inner[-reach:].max()]  # those that are passed within the record
    if levels.size < 4:
        return None
    last = np.array([int(np.flatnonzero(inner >= level)[-1]) for level in levels])
    began = np.concatenate([[int(np.argmax(inner >= levels[0]))], last[:-1]])
    times = last - began
    for k in range(levels.size - 4, -1, -1):
        is_long = times[k] > MODAL.steady_times * max(float(np.median(times[k + 1 : k + 4])), 0.5 * reach)
        held = inner[began[k] : last[k]]
        if is_long and float(np.quantile(held, 0.05)) > step * float(np.median(held)):
            return reach + int(np.flatnonzero(inner >= 0.97 * np.median(held))[-1])
    return None


def _skip_clipped(part: FloatArray, cycle: float, warnings: list[str]) -> int:
    last = -1
    n = MODAL.clipped_samples
    values = np.unique(part)
    step = float(np.diff(values).min()) if values.size > 1 else 0.0
    for at_limit in (part >= part.max(), part <= part.min()):
        run = np.convolve(at_limit.astype(np.int64), np.ones(n, dtype=np.int64), mode="valid")
        ends = np.flatnonzero(run == n) + n - 1
        # The flat top of a slow signal with coarse steps leaves it by few steps, a clipped one by its slope.
        inside = ends[ends < part.size - 1]
        leaves = np.abs(part[inside + 1] - part[inside])
        if ends.size and leaves.max(initial=0.0) > MODAL.clipped_steps * step:
            last = max(last, int(ends.max()))
    if last < 0:
        return 0
    warnings.append("samples are clipped: the record up to the last clipped sample is left out; increase the range")
    return last + 1 + round(0.1 * cycle)


def _find_next_impact(part: FloatArray, start: int, cycle: float) -> int:
    """Return the sample before the next impact, where the rms of a cycle rises above the three before."""
    length = max(4, round(cycle))
    n_blocks = (part.size - start) // length
    blocks = part[start : start + n_blocks * length].reshape(n_blocks, length)
    level = blocks.std(axis=1)
    for k in range(4, n_blocks):
        if level[k] > MODAL.next_impact_rise * level[k - 3 : k].max() > 0.0:
            return start + (k - 1) * length
    return part.size


def _fit_slope(envelope: FloatArray, fs: float) -> float:
    time = np.arange(envelope.size) / fs
    return -float(np.polyfit(time, np.log(np.maximum(envelope, 1e-300)), 1, w=envelope)[0])


def _make_length_error(start_s: float, cycles: float, frequency: float) -> NotDeterminedError:
    return NotDeterminedError(
        f"the free decay after {start_s:.4g} s is {max(cycles, 0.0):.1f} cycles of {frequency:.4g} Hz long: at least "
        f"{MODAL.fewest_cycles} are needed to determine frequency and damping over amplitude; record longer, or name "
        "another mode with near_hz"
    )
